//! Goal: what moves, an object or the eye, does not go on hiding what it no longer hides. Method: an object that leaves the place before another,
//! and an eye that jumps, held against nodes that have seen nothing else.

use glam::{DAffine3, DVec3};
use mullion_client::lod::LodObject;
use mullion_common::wire::DetailWeight;

use super::away::{Node, place};
use super::{meshes, vertices};

fn moved<'a>(object: &LodObject<'a>, way: DVec3) -> LodObject<'a> {
    LodObject { world_from_local: DAffine3::from_translation(way) * object.world_from_local, ..*object }
}

#[test]
fn what_moves_far_is_followed_within_four_frames() {
    let (torus, sphere) = (vertices(&meshes::torus(60, 40)), vertices(&meshes::sphere(16)));
    let before = [place(&torus, 1.0, -12.0), place(&torus, -5.0, -12.0), place(&sphere, 0.4, -5.0)];
    let far = [before[0], before[1], moved(&before[2], DVec3::Y * 20.0)];
    let near = [before[0], before[1], moved(&before[2], DVec3::Y * 0.1)];
    for weight in [DetailWeight::None, DetailWeight::Nohc] {
        let mut node = Node::new(weight);
        assert!(node.frame(1, &before).1);
        let (_, is_drawn) = node.frame(2, &near);
        assert!(!is_drawn && !node.occluder.has_turn(4), "{weight}: about where it was");
        let (kept, is_drawn) = node.frame(3, &far);
        assert!(!is_drawn && node.occluder.has_turn(4), "{weight}: not in each frame");
        let (seen, is_drawn) = node.frame(4, &far);
        assert!(is_drawn && seen[0] > kept[0], "{weight}: {seen:?}, {kept:?} before");
        assert_eq!(Node::new(weight).frame(4, &far).0, seen, "{weight}: whoever comes then finds the same");
        assert!(!node.frame(5, &far).1 && !node.occluder.has_turn(8), "{weight}: it stands");
    }
}

#[test]
fn an_eye_that_jumps_takes_no_occluder_with_it() {
    let (torus, sphere) = (vertices(&meshes::torus(60, 40)), vertices(&meshes::sphere(16)));
    let objects = [place(&torus, 1.0, -12.0), place(&torus, -5.0, -12.0), place(&sphere, 0.4, -5.0)];
    // The picture's scale is that of what is in it.
    for scale in [1.0, 100.0] {
        let objects = objects.map(|object| LodObject {
            world_from_local: DAffine3::from_scale(DVec3::splat(scale)) * object.world_from_local,
            ..object
        });
        let mut node = Node::new(DetailWeight::None);
        let hidden = node.frame(0, &objects).0;
        let (_, is_drawn) = node.frame_from(1, DVec3::X * 0.5 * scale, &objects);
        assert!(!is_drawn, "a step");
        let jump = DVec3::X * 8.0 * scale;
        let (seen, is_drawn) = node.frame_from(2, jump, &objects);
        assert!(is_drawn && seen != hidden, "{seen:?}");
        assert_eq!(Node::new(DetailWeight::None).frame_from(2, jump, &objects).0, seen);
        assert!(!node.frame_from(3, jump, &objects).1);
    }
}
