//! The dull parts by hand. Whole boxes against rays, and the GPU against this: `client/tests/drawing/unit.rs`.

use super::*;
use glam::DQuat;
use proptest::prelude::*;

/// A polygon with these corners on a tile of 40 by 30, at depth 0.5.
fn polygon(corners: &[[i32; 2]]) -> Footprint {
    let mut footprint = Footprint { nearest: 0.5, corner_count: corners.len(), ..Footprint::nothing([40, 30]) };
    footprint.corners[..corners.len()].copy_from_slice(corners);
    footprint
}

/// Whether a centre is covered, by each edge in turn.
fn is_covered(footprint: &Footprint, x: u32, y: u32) -> bool {
    let center = [x, y].map(|at| i64::from(at) * 256 + 128);
    let is_inside = |(from, to): ([i64; 2], [i64; 2])| {
        let side = (to[0] - from[0]) * (center[1] - from[1]) - (to[1] - from[1]) * (center[0] - from[0]);
        let is_left = to[1] < from[1];
        let is_top = to[1] == from[1] && to[0] > from[0];
        side > 0 || (side == 0 && (is_left || is_top))
    };
    footprint.corner_count > 0 && footprint.edges().all(is_inside)
}

fn count_centers(footprint: &Footprint) -> u32 {
    footprint.rows().map(|y| footprint.span(y).len() as u32).sum()
}

proptest! {
    #[test]
    fn spans_are_the_centers_inside_all_edges(
        points in prop::collection::vec((-300..11000i32, -300..8000i32), 1..14),
        to_centers in any::<bool>(),
    ) {
        let mut outline = Points::default();
        // Corners on centres make many edges pass through others.
        let snapped = |at: i32| f64::from(if to_centers { at.div_euclid(256) * 256 + 128 } else { at });
        points.iter().for_each(|&(x, y)| outline.push(DVec2::new(snapped(x), snapped(y))));
        let corners: Vec<_> = outline.hull().as_slice().iter().map(|p| [p.x as i32, p.y as i32]).collect();
        prop_assume!(corners.len() <= MAX_CORNERS);
        let footprint = polygon(&corners);
        for y in 0..30 {
            for x in 0..40 {
                let is_in_span = footprint.rows().contains(&y) && footprint.span(y).contains(&x);
                prop_assert_eq!(is_in_span, is_covered(&footprint, x, y), "{} {} of {:?}", x, y, corners);
            }
        }
    }

    /// A tile cut along any line through corners: the parts share no pixel and lack none.
    #[test]
    fn parts_along_an_edge_share_no_pixel(across in 0..40i32, down in 0..30i32) {
        let (left, right) = (across * 256 + 128, (39 - across) * 256 + 128);
        let parts = [[[0, 0], [left, 0], [right, 7680], [0, 7680]], [[left, 0], [10240, 0], [10240, 7680], [right, 7680]]];
        prop_assert_eq!(parts.map(|part| count_centers(&polygon(&part))).iter().sum::<u32>(), 1200);
        let (top, bottom) = (down * 256 + 128, (29 - down) * 256 + 128);
        let parts = [[[0, 0], [10240, 0], [10240, bottom], [0, top]], [[0, top], [10240, bottom], [10240, 7680], [0, 7680]]];
        prop_assert_eq!(parts.map(|part| count_centers(&polygon(&part))).iter().sum::<u32>(), 1200);
    }
}

#[test]
fn centers_on_top_and_left_edges_are_covered() {
    let (a, b) = (5 * 256 + 128, 8 * 256 + 128);
    let square = polygon(&[[a, a], [b, a], [b, b], [a, b]]);
    assert_eq!((square.rows(), square.span(5), square.span(7)), (5..9, 5..8, 5..8));
    assert_eq!(square.span(8), 0..0, "the bottom edge");
    assert_eq!(count_centers(&square), 9);
}

#[test]
fn registers_hold_what_is_counted_by_hand() {
    let mut footprint = polygon(&[[512, 256], [1536, 256], [1536, 1024], [512, 1024]]); // columns 2 to 5, rows 1 to 3
    footprint.fronts[0] = Front { right: 0.125, down: -0.0625, at_anchor: 0.25 };
    footprint.anchor_px = [2, 1];
    assert_eq!(footprint.depth_at([3, 2]), 0.3125);
    assert_eq!(footprint.depth_at([5, 1]), 0.5, "no nearer than the nearest");
    let depths: Vec<f32> = (0..1200).map(|at| if at % 40 == 4 { 0.5 } else { 0.3125 }).collect();
    let depth = DepthImage::new([40, 30], &depths).expect("as many as pixels");
    let counts = footprint.count(&depth);
    // Column 3: 0.375, 0.3125 and 0.25. Column 4: 0.5, 0.4375. Column 5: 0.5 each.
    let rect = Some(PixelRect { first: [3, 1], last: [5, 3] });
    assert_eq!(counts, Counts { projected: 12, visible: 6, closest: 0.5, rect });
    assert_eq!(DepthImage::new([40, 31], &depths).map(|_| ()), None);
    let hidden = footprint.count(&DepthImage::new([40, 30], &[0.75; 1200]).expect("as many"));
    assert_eq!(hidden, Counts { projected: 12, ..Counts::default() });
}

/// From the origin along −Z through a square of 2 at distance 1, with the near plane at 0.5.
fn ahead() -> Projection {
    let corners = [DVec3::new(-1.0, -1.0, -1.0), DVec3::new(1.0, -1.0, -1.0), DVec3::new(-1.0, 1.0, -1.0)];
    Projection::through_rectangle(DVec3::ZERO, corners, 0.5, &DAffine3::IDENTITY)
}

fn of(min: [f64; 3], max: [f64; 3]) -> Footprint {
    let bounds = Aabb { min: min.into(), max: max.into() };
    Footprint::of(&ahead(), [20, 10], &bounds, &DAffine3::IDENTITY)
}

#[test]
fn a_box_ahead_covers_its_front() {
    // Its front, at distance 2, reaches from 2/5 to 9/10 of the width and from 1/4 to 1/2 of the height.
    let footprint = of([-0.4, 0.0, -7.0], [1.6, 1.0, -2.0]);
    assert_eq!(footprint.coverage(), Coverage::Fronts);
    assert_eq!((footprint.rows(), footprint.span(3)), (2..5, 8..18));
    // Nearer by 1/128 of what the left side, 0.4 from the eye, changes by within a pixel: 0.5 / 0.4 · 2 / 20.
    assert!((footprint.depth_at([9, 4]) - (0.25 + 0.125 / 128.0)).abs() < 1e-4, "{}", footprint.depth_at([9, 4]));
    assert!((footprint.distance_m() - 2.0).abs() < 1e-12);
    assert_eq!(footprint.corners().len(), 4, "all else is behind the front");
}

#[test]
fn where_no_front_is_left_depth_is_the_nearest() {
    let around = of([-3.0, -3.0, -3.0], [3.0, 3.0, 3.0]);
    assert_eq!((around.coverage(), count_centers(&around), around.depth_at([3, 3])), (Coverage::NoFront, 200, 1.0));
    assert!((around.distance_m() - 0.5).abs() < 1e-12);
    // It ends before the near plane does.
    let within_near = of([-0.4; 3], [0.4; 3]);
    assert_eq!((within_near.coverage(), count_centers(&within_near)), (Coverage::Nothing, 0));
    // The eye is inside, but the box is small beyond the near plane.
    let narrow = of([-0.1, -0.1, -1.0], [0.1, 0.1, 1.0]);
    assert_eq!((narrow.coverage(), count_centers(&narrow), narrow.nearest()), (Coverage::NoFront, 8, 1.0));
    let nowhere = of([0.0, 0.0, -2.0], [f64::MAX, 1.0, -1.0]);
    assert_eq!((nowhere.coverage(), count_centers(&nowhere), nowhere.distance_m()), (Coverage::NoFront, 200, 0.0));
}

#[test]
fn a_box_that_passes_the_eye_is_cut_at_the_near_plane() {
    // Right of the eye, from behind it to far ahead: the left side is the front, from the right edge in to 3/5.
    let beside = of([0.2, -9.0, -2.0], [9.0, 9.0, 4.0]);
    assert_eq!((beside.coverage(), beside.rows(), beside.span(4)), (Coverage::Fronts, 0..10, 11..20));
    // Where the ray of column 12 meets x = 0.2: at distance 0.8.
    assert!((beside.depth_at([12, 4]) - 0.5 / 0.8).abs() < 3e-3, "{}", beside.depth_at([12, 4]));
    assert_eq!(beside.depth_at([19, 4]), 1.0, "cut");
    assert_eq!(of([0.2, -9.0, 1.0], [9.0, 9.0, 4.0]).coverage(), Coverage::Nothing, "behind the eye");
    assert_eq!(of([8.0, -1.0, -2.0], [9.0, 1.0, -1.0]).coverage(), Coverage::Nothing, "beside the tile");
    assert_eq!(of([1.0; 3], [0.0; 3]).coverage(), Coverage::Nothing, "empty");
}

#[test]
fn points_and_flattened_boxes_cover_what_they_may() {
    let point = of([0.05, 0.1, -1.0], [0.05, 0.1, -1.0]); // on the centre of column 10, row 4
    assert_eq!((count_centers(&point), point.span(4)), (1, 10..11));
    let flattened = DAffine3::from_scale_rotation_translation(
        DVec3::new(1.0, 0.0, 1.0),
        DQuat::from_rotation_x(0.3),
        DVec3::new(0.0, -0.2, -2.0),
    );
    let bounds = Aabb { min: DVec3::new(-1.0, -2.0, -0.5), max: DVec3::new(1.0, 2.0, 0.5) };
    let footprint = Footprint::of(&ahead(), [20, 10], &bounds, &flattened);
    assert_eq!(footprint.coverage(), Coverage::NoFront, "no side is the outer one");
    assert!(count_centers(&footprint) > 0);
}

const PAPERS_WALL: ViewPlane = ViewPlane { pixels: 650 * 650, eye_m: 0.002 };

#[test]
fn contributions_are_those_of_the_paper() {
    let counts = Counts { projected: 423, visible: 20, ..Counts::default() };
    // (0.002 + 10) / 0.002 = 5001; 423 · 5001 / 422500 and 20 · 5001 / 422500
    assert!((contribution_as_printed(&counts, &PAPERS_WALL, 10.0) - 5.006918).abs() < 1e-6);
    assert!((contribution(counts.visible, &PAPERS_WALL, 10.0) - 0.236734).abs() < 1e-6);
    // A threshold of 100 pixels is 0.02 % of the view plane, and that is a hundred visible pixels in the plane itself.
    assert!((contribution(100, &PAPERS_WALL, 0.0) - 0.000_236_686).abs() < 1e-9);
    let seen = |visible| Counts { projected: 5000, visible, ..Counts::default() };
    assert_eq!(contribution_as_printed(&seen(0), &PAPERS_WALL, 3.0), contribution_as_printed(&seen(300), &PAPERS_WALL, 3.0));
}
