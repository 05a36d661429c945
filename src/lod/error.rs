//! How far a picture of a simplified mesh is from that of the whole one, in pixels.
//!
//! Of each pixel of either picture the point that is seen there is held against the surface that the other shows nearby: its distance from
//! the planes of the triangles around the same pixel, or from points seen further around, whichever is least, as pixels at its own distance.
//! Where the other shows nothing near, it is the distance to where it does in the picture. What is opaque and not simplified is in both pictures, as it is
//! on a wall.

use glam::{DMat4, DVec3, Vec3};

use super::{Look, Seen};
use crate::item_buffer::NOTHING;

/// How far around a pixel the other picture is searched. No error is greater.
const REACH_PX: i32 = 8;

/// Distances in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct ImageError {
    /// Over all pixels at which either picture shows something.
    pub all: Distances,
    /// Over those at which it shows something simplified.
    pub simplified: Distances,
}

/// Of some pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Distances {
    /// Of both pictures together: of few of them a percentile says little.
    pub pixels: usize,
    pub mean_px: f64,
    /// The 99th percentile.
    pub p99_px: f64,
}

/// What is seen at a pixel.
#[derive(Clone, Copy)]
struct Sample {
    point: Vec3,
    normal: Vec3,
    is_simplified: bool,
}

impl ImageError {
    /// Of two pictures of the same look.
    pub fn between(look: &Look, a: &Seen, b: &Seen) -> Self {
        let (of_a, of_b) = (samples(look, a), samples(look, b));
        let mut errors = errors(look, a, &of_a, &of_b);
        errors.extend(self::errors(look, b, &of_b, &of_a));
        errors.sort_unstable_by(|(a, _), (b, _)| a.total_cmp(b));
        let simplified = errors.iter().filter(|(_, is_simplified)| *is_simplified).map(|(error, _)| *error).collect::<Vec<_>>();
        let all = errors.into_iter().map(|(error, _)| error).collect::<Vec<_>>();
        Self { all: Distances::of(&all), simplified: Distances::of(&simplified) }
    }
}

impl Distances {
    /// Of distances that ascend.
    fn of(errors: &[f32]) -> Self {
        let pixels = errors.len();
        let mean_px = errors.iter().map(|e| f64::from(*e)).sum::<f64>() / pixels.max(1) as f64;
        let p99_px = errors.get(pixels * 99 / 100).copied().unwrap_or(0.0).into();
        Self { pixels, mean_px, p99_px }
    }
}

fn samples(look: &Look, seen: &Seen) -> Vec<Option<Sample>> {
    let offset_from_clip: DMat4 = look.projection.clip_from_offset.inverse();
    let [width, height] = seen.size_px.map(f64::from);
    let sample = |(at, (item, depth)): (usize, (&u32, &f32))| {
        if *item == NOTHING {
            return None;
        }
        let (x, y) = (at % seen.size_px[0] as usize, at / seen.size_px[0] as usize);
        let (x, y) = ((x as f64 + 0.5) / width * 2.0 - 1.0, 1.0 - (y as f64 + 0.5) / height * 2.0);
        let point = offset_from_clip.project_point3(DVec3::new(x, y, f64::from(*depth))).as_vec3();
        let [a, b, c] = seen.scene.corners(*item);
        Some(Sample { point, normal: (b - a).cross(c - a).normalize_or_zero(), is_simplified: *item < seen.simplified })
    };
    seen.items.iter().zip(&seen.depths).enumerate().map(sample).collect()
}

/// Of each pixel at which something is seen: how far it is off, and whether it is of what is simplified.
fn errors(look: &Look, seen: &Seen, own: &[Option<Sample>], other: &[Option<Sample>]) -> Vec<(f32, bool)> {
    let [width, height] = seen.size_px.map(|size| size as i32);
    let mut errors = Vec::new();
    for (at, sample) in own.iter().enumerate() {
        let Some(Sample { point, is_simplified, .. }) = sample else { continue };
        let (x, y) = (at as i32 % width, at as i32 / width);
        let pixel = point.length() / look.pixels_per_radian;
        let mut least = REACH_PX as f32;
        for reach in 0..=REACH_PX {
            // What is further around is at least so far away in the picture.
            if least <= 0.5 || (reach > 2 && least <= reach as f32) {
                break;
            }
            for (dx, dy) in ring(reach) {
                let (x, y) = (x + dx, y + dy);
                if x < 0 || y < 0 || x >= width || y >= height {
                    continue;
                }
                let Some(Sample { point: found, normal, .. }) = other[(y * width + x) as usize] else { continue };
                let way = *point - found;
                let error = if reach <= 1 { way.dot(normal).abs() / pixel } else { way.length() / pixel };
                least = least.min(error.max(reach.saturating_sub(1) as f32));
            }
        }
        errors.push((least, *is_simplified));
    }
    errors
}

/// Pixels at the edge of a square around one.
fn ring(reach: i32) -> impl Iterator<Item = (i32, i32)> {
    let edge = move |d: i32| d.abs() == reach;
    (-reach..=reach).flat_map(move |y| (-reach..=reach).filter(move |x| edge(*x) || edge(y)).map(move |x| (x, y)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::item_buffer::ItemScene;

    const SIZE_PX: u32 = 64;

    /// A triangle that faces the eye, a tenth as high as it is far, or many times as high.
    fn triangle(size: f32, away: f32) -> ItemScene {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]].map(|[x, y]: [f32; 2]| Vec3::new(x * size, y * size, -away));
        ItemScene::of_triangles(DVec3::ZERO, std::iter::once((corners, false)))
    }

    fn look() -> Look {
        Look::new(DVec3::ZERO, DVec3::NEG_Z, 0.1, SIZE_PX)
    }

    /// All of what both show is simplified.
    fn between(a: ItemScene, b: ItemScene) -> Distances {
        let [a, b] = [a, b].map(|scene| Seen::new(&look(), scene, u32::MAX, [SIZE_PX; 2]));
        let found = ImageError::between(&look(), &a, &b);
        assert_eq!(found.all, found.simplified);
        found.all
    }

    #[test]
    fn what_moves_away_is_off_by_as_much() {
        let found = between(triangle(99.0, 10.0), triangle(99.0, 10.3));
        assert_eq!(found.pixels, 2 * 64 * 64);
        // 0.3 of 10 metres, at 64 pixels a radian; towards the corners pixels are larger.
        let most = 0.3 / 10.0 * 64.0;
        assert!(found.mean_px <= found.p99_px && found.p99_px <= most && found.mean_px > most * 0.7, "{found:?}");
    }

    #[test]
    fn what_is_gone_is_off_by_as_much_as_is_searched() {
        let found = between(triangle(1.0, 10.0), ItemScene::of_triangles(DVec3::ZERO, std::iter::empty()));
        assert!((1..100).contains(&found.pixels), "{found:?}");
        assert_eq!((found.mean_px, found.p99_px), (f64::from(REACH_PX), f64::from(REACH_PX)));
    }

    #[test]
    fn what_is_not_simplified_hides_what_is_behind_and_is_told_apart() {
        let nothing = || ItemScene::of_triangles(DVec3::ZERO, std::iter::empty());
        let seen = |simplified: ItemScene, away: f32| {
            let count = simplified.len() as u32;
            Seen::new(&look(), simplified.and(&triangle(99.0, away)), count, [SIZE_PX; 2])
        };
        let between = |away: f32| ImageError::between(&look(), &seen(triangle(1.0, 10.0), away), &seen(nothing(), away));
        let in_front = between(20.0);
        assert_eq!(in_front.all.pixels, 2 * 64 * 64);
        assert!((1..100).contains(&in_front.simplified.pixels), "{in_front:?}");
        assert_eq!(in_front.simplified.p99_px, f64::from(REACH_PX));
        assert!(in_front.all.mean_px > 0.0 && in_front.all.mean_px < in_front.simplified.mean_px, "{in_front:?}");
        let behind = between(5.0);
        assert_eq!(behind.simplified.pixels, 0);
        assert!(behind.all.p99_px < 1e-3, "{behind:?}");
    }
}
