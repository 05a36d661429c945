//! Where a node's tiles go in a window of its own.

use glam::{DVec2, DVec3};
use mullion_common::wire::ViewSpec;

use crate::gpu::TileRect;

/// How far a tile may stick out of the first one's plane, or lean against its edges, in lengths of its own edges.
const LEAN: f64 = 0.01;
/// How far tiles may overlap, pixels: what rounding leaves.
const OVERLAP_PX: f32 = 1.5;

/// Places tiles as they stand on the wall, where that can be seen in one picture: all lie in one plane with their edges
/// along the first one's, and none covers another (as the views of two eyes do). Else side by side, in the order given.
///
/// Units are pixels of the first tile, y down; the top left corner of all is the origin.
pub(crate) fn lay_out(views: &[ViewSpec]) -> Vec<TileRect> {
    as_they_stand(views).unwrap_or_else(|| in_a_row(views))
}

fn in_a_row(views: &[ViewSpec]) -> Vec<TileRect> {
    let mut left = 0.0;
    let place = |spec: &ViewSpec| {
        let [w, h] = spec.size_px.map(|edge| edge as f32);
        let rect = TileRect { view: spec.view, x: left, y: 0.0, w, h };
        left += w;
        rect
    };
    views.iter().map(place).collect()
}

/// A tile's bottom left corner and its edges to the right and up, metres.
fn edges(spec: &ViewSpec) -> [DVec3; 3] {
    let [bottom_left, bottom_right, top_left] = spec.corners.map(DVec3::from);
    [bottom_left, bottom_right - bottom_left, top_left - bottom_left]
}

fn as_they_stand(views: &[ViewSpec]) -> Option<Vec<TileRect>> {
    let first = views.first()?;
    let [origin, right, up] = edges(first);
    let (x_axis, y_axis) = (right.try_normalize()?, up.try_normalize()?);
    let normal = x_axis.cross(y_axis);
    let px_per_m = DVec2::from(first.size_px.map(f64::from)) / DVec2::new(right.length(), up.length());
    let mut spans = Vec::with_capacity(views.len());
    for spec in views {
        let [corner, right, up] = edges(spec);
        let leans = |edge: DVec3, axis: DVec3| edge.distance(axis * edge.length()) > LEAN * edge.length();
        let sticks_out = (corner - origin).dot(normal).abs() > LEAN * right.length().min(up.length());
        if leans(right, x_axis) || leans(up, y_axis) || sticks_out {
            return None;
        }
        let pixels = |point: DVec3| DVec2::new(point.dot(x_axis), -point.dot(y_axis)) * px_per_m;
        spans.push((spec.view, pixels(corner - origin + up), pixels(corner - origin + right)));
    }
    let top_left = spans.iter().map(|(_, min, _)| *min).reduce(DVec2::min)?;
    let rect = |&(view, min, max): &(_, DVec2, DVec2)| {
        // Edges are rounded, not sizes: neighbours stay neighbours.
        let (min, max) = ((min - top_left).round().as_vec2(), (max - top_left).round().as_vec2());
        TileRect { view, x: min.x, y: min.y, w: max.x - min.x, h: max.y - min.y }
    };
    let rects: Vec<TileRect> = spans.iter().map(rect).collect();
    let overlap = |a: &TileRect, b: &TileRect| {
        (a.x + a.w).min(b.x + b.w) - a.x.max(b.x) > OVERLAP_PX && (a.y + a.h).min(b.y + b.h) - a.y.max(b.y) > OVERLAP_PX
    };
    let is_covered = rects.iter().enumerate().any(|(i, a)| rects[..i].iter().any(|b| overlap(a, b)));
    (!is_covered).then_some(rects)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mullion_common::wall::{ViewId, Wall, WallConfig};

    /// The views of all tiles of a wall, as its only node gets them.
    fn views(text: &str) -> Vec<ViewSpec> {
        let wall: Wall = WallConfig::parse(text).unwrap();
        (0..wall.views().len() as u16).map(|view| ViewSpec::of(&wall, ViewId(view))).collect()
    }

    fn rects(views: &[ViewSpec]) -> Vec<(&str, [f32; 4])> {
        views.iter().zip(lay_out(views)).map(|(v, r)| (v.tile_name.as_str(), [r.x, r.y, r.w, r.h])).collect()
    }

    const GRID: &str = "columns = 2\nrows = 2\ntile_px = [100, 50]\nbezel_m = [0.02, 0.04]\n";

    #[test]
    fn tiles_of_a_plane_go_where_they_stand() {
        let stand = [[0.0, 0.0, 100.0, 50.0], [102.0, 0.0, 100.0, 50.0], [0.0, 54.0, 100.0, 50.0], [102.0, 54.0, 100.0, 50.0]];
        let names = ["t0x0", "t1x0", "t0x1", "t1x1"];
        let grid = views(&format!("[grid]\ntile_m = [1.0, 0.5]\n{GRID}"));
        let mut got = rects(&grid);
        got.sort_by_key(|(name, _)| names.iter().position(|n| n == name));
        assert_eq!(got, names.into_iter().zip(stand).collect::<Vec<_>>());
        // On a wall to the right, named in any other order.
        let corners = "bottom_left = [1.5, 0.0, 1.0]\nbottom_right = [1.5, 0.0, 3.02]\ntop_left = [1.5, 1.04, 1.0]\n";
        let mut side = views(&format!("eye = [0.0, 0.6, 1.7]\n[[screens]]\nname = \"right\"\n{corners}{GRID}"));
        side.rotate_left(3);
        let mut got: Vec<_> = rects(&side).into_iter().map(|(_, rect)| rect).collect();
        got.sort_by_key(|[x, y, ..]| (*y as i32, *x as i32));
        assert_eq!(got, stand);
    }

    #[test]
    fn other_densities_are_scaled_to_the_first() {
        let mut grid = views("[grid]\ncolumns = 2\nrows = 1\ntile_px = [100, 50]\ntile_m = [1.0, 0.5]\n");
        grid[1].size_px = [400, 200];
        let got: Vec<_> = rects(&grid).into_iter().map(|(_, rect)| rect).collect();
        assert_eq!(got, [[0.0, 0.0, 100.0, 50.0], [100.0, 0.0, 100.0, 50.0]]);
    }

    #[test]
    fn tiles_that_no_plane_holds_or_that_cover_each_other_go_in_a_row() {
        let cave = views(include_str!("../../../configs/cave_4.toml"));
        let row = |count: usize, w: f32, h: f32| (0..count).map(|i| [w * i as f32, 0.0, w, h]).collect::<Vec<_>>();
        let places = |views: &[ViewSpec]| rects(views).into_iter().map(|(_, rect)| rect).collect::<Vec<_>>();
        assert_eq!(places(&cave), row(4, 720.0, 720.0));
        let mut eyes = views("[grid]\ncolumns = 1\nrows = 1\ntile_px = [100, 50]\ntile_m = [1.0, 0.5]\n");
        eyes.push(eyes[0].clone());
        assert_eq!(places(&eyes), row(2, 100.0, 50.0));
        let mut stepped = views("[grid]\ncolumns = 2\nrows = 1\ntile_px = [100, 50]\ntile_m = [1.0, 0.5]\n");
        stepped[1].corners.iter_mut().for_each(|corner| corner[2] += 0.1);
        assert_eq!(places(&stepped), row(2, 100.0, 50.0));
        assert_eq!(places(&[]), row(0, 1.0, 1.0));
    }
}
