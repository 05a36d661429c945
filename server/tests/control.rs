//! Goal: whatever was moved, removed and brought back in whatever order, a scene is culled as one that got its last state at once.
//! Method: random edits over many frames, against a fresh scene with the same final state. The object hierarchy finds the same sets.
//! The sweep's boxes are rounded outwards in steps that a node keeps from before, so that its sets may hold more next to a plane:
//! they hold all that the oracle finds, and nothing that is away.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use mullion_common::camera_path::{CameraPath, CameraPose};
use mullion_common::control::{Command, Steps};
use mullion_common::geometry::Obb;
use mullion_common::scene::{ObjectId, Package};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::{ViewId, Wall, WallConfig};
use mullion_common::wire::{Budget, Course, Moved, Steering};
use mullion_server::control::{self, ControlError, Driver, LiveScene, Subject};
use mullion_server::cull::{Algorithm, oracle};
use mullion_server::service::{Heritage, Pose};
use mullion_server::tree::{Bounds, DynamicScene, Presence};
use proptest::prelude::*;

#[path = "../../tests/session_support/mod.rs"]
mod session_support;

const LEAVES: u32 = 60;

#[derive(Clone, Debug)]
enum Edit {
    Move(u32, [f64; 3], f64),
    Presence(u32, Presence),
}

fn edit() -> impl Strategy<Value = Edit> {
    let object = 0..session_support::OBJECTS;
    let at = prop::array::uniform3(-40.0..40.0);
    let presence = prop_oneof![Just(Presence::There), Just(Presence::Away)];
    prop_oneof![
        (object.clone(), at, 0.0..6.0).prop_map(|(object, at, angle)| Edit::Move(object, at, angle)),
        (object, presence).prop_map(|(object, presence)| Edit::Presence(object, presence)),
    ]
}

fn moved(object: u32, at: [f64; 3], angle: f64) -> Moved {
    let transform = DAffine3::from_rotation_translation(DQuat::from_rotation_y(angle), DVec3::from(at)).into();
    Moved { object: ObjectId(object), transform }
}

fn sets(scene: &mut LiveScene, pose: &Pose, wall: &Wall) -> Vec<VisibleSet> {
    let mut sets = vec![VisibleSet::default(); wall.views().len()];
    scene.cull(pose, &mut sets);
    sets
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn a_scene_is_what_its_last_state_is(frames in prop::collection::vec(prop::collection::vec(edit(), 0..6), 1..8)) {
        let text = "[grid]\ncolumns = 3\nrows = 2\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
        let wall: Arc<Wall> = Arc::new(WallConfig::parse(text).expect("a valid wall"));
        let package: Arc<Package> = session_support::package(LEAVES);
        let room = DAffine3::from_translation(DVec3::new(8.0, 1.0, 25.0));
        let still = Pose { world_from_room: room, eyes: wall.default_eyes(), ..Pose::default() };
        for algorithm in [Algorithm::Sweep, Algorithm::Oh] {
            let mut scene = LiveScene::new(algorithm, &wall, &package);
            let mut places = vec![None; session_support::OBJECTS as usize];
            let mut presences = vec![Presence::There; places.len()];
            let mut last = Vec::new();
            for edits in &frames {
                let mut pose = still.clone();
                for edit in edits {
                    match *edit {
                        Edit::Move(object, at, angle) => {
                            places[object as usize] = Some(moved(object, at, angle));
                            pose.moved.push(moved(object, at, angle));
                        }
                        Edit::Presence(object, presence) => {
                            presences[object as usize] = presence;
                            pose.presence.push((ObjectId(object), presence));
                        }
                    }
                }
                last = sets(&mut scene, &pose, &wall);
            }
            let away = (0..).zip(&presences).filter(|(_, presence)| **presence == Presence::Away);
            let presence = away.map(|(object, presence)| (ObjectId(object), *presence)).collect();
            let pose = Pose { moved: places.into_iter().flatten().collect(), presence, ..still.clone() };
            let fresh = sets(&mut LiveScene::new(algorithm, &wall, &package), &pose, &wall);
            if algorithm == Algorithm::Oh {
                prop_assert_eq!(&last, &fresh);
            }
            let mut known = DynamicScene::new(Arc::clone(&package), Bounds::default());
            pose.moved.iter().for_each(|moved| known.move_object(moved.object, &moved.transform.affine()));
            let there = |leaf: &u32| {
                presences[package.scene.manifest.leaves[*leaf as usize].object.0 as usize] == Presence::There
            };
            let boxes: Vec<(u32, Obb)> =
                (0..LEAVES).filter(|leaf| there(leaf)).map(|leaf| (leaf, *known.tree().leaf_bound(leaf))).collect();
            for (view, set) in last.iter().enumerate() {
                let frustum = wall.frustum(ViewId(view as u16), pose.eyes[view], &room);
                let mut truth = VisibleSet::default();
                oracle::visible_boxes(boxes.iter().map(|(leaf, bound)| (*leaf, bound)), &frustum, &mut truth);
                prop_assert!(set.is_superset_of(&truth), "{}: view {}: {:?} lacks some of {:?}", algorithm, view, set, truth);
                prop_assert!(set.leaves().all(|leaf| there(&leaf)), "{}: view {}: {:?} holds what is away", algorithm, view, set);
            }
        }
    }
}

#[test]
fn a_camera_goes_on_as_another_master_left_it() {
    let (wall, package) = (session_support::wall(2, 1), session_support::package(LEAVES));
    let stand = |x: f64| CameraPose { translation: DVec3::new(x, 1.0, 12.0), rotation: DQuat::IDENTITY, scale: 1.0 };
    let path = CameraPath::new((0..500).map(|frame| stand(f64::from(frame))).collect()).expect("a path");
    let (inlet, batches, questions) = control::channel(&wall, &package);
    let mut scene = LiveScene::new(Algorithm::Sweep, &wall, &package).answering(questions);
    let mut driver = Driver::new(Arc::clone(&wall), path.clone(), batches);
    let succession = driver.succession();
    inlet.submit(&[Command::Step(Steps { frames: 9 })], Box::new(|_| panic!("of a reign that is over"))).expect("there is room");
    let all = Subject::Wall(ObjectId(0));
    inlet.ask(all, Box::new(|_| panic!("of a reign that is over"))).expect("there is room");
    succession.stand_by();
    assert_eq!(inlet.ask(all, Box::new(|_| ())), Err(ControlError::StandingBy));
    assert_eq!(inlet.submit(&[Command::Pause], Box::new(|_| ())), Err(ControlError::StandingBy));

    let eyes = vec![DVec3::new(0.2, 0.1, 2.0); 2];
    let budgets = vec![Budget { triangles: Some(7), gpu_us: None }, Budget::default()];
    let room = DAffine3::from_translation(DVec3::new(5.0, 6.0, 7.0));
    let steering = Steering { path_frame: 20, held_after: Some(1), is_off_path: true };
    let course =
        Course { number: 90, world_from_room: room, steering, eyes: eyes.clone(), budgets: budgets.clone(), ..Course::default() };
    let grown = Arc::new(session_support::package(LEAVES + 1));
    succession.take_over(Heritage { course, package: Arc::clone(&grown) });
    assert_eq!(
        inlet.submit(&[], Box::new(|_| ())),
        Err(ControlError::StandingBy),
        "its commands are not checked by that scene yet"
    );
    let pose = driver.pose(91);
    assert!(Arc::ptr_eq(&inlet.checker().package(), &grown));
    scene.cull(&pose, &mut [VisibleSet::default(), VisibleSet::default()]);
    assert_eq!((pose.world_from_room, &pose.eyes, &pose.budgets), (room, &eyes, &budgets));
    assert_eq!(pose.scene_time_s, 21.0 / wall.rate_hz(), "the step that was left");
    assert_eq!(pose.steering, Steering { path_frame: 21, held_after: Some(0), is_off_path: true });
    inlet.submit(&[], Box::new(|frame| assert_eq!(frame, 92))).expect("it takes commands again");
    assert_eq!(driver.pose(92).steering.path_frame, 21, "held");
    inlet.submit(&[Command::Resume, Command::FollowPath], Box::new(|_| ())).expect("there is room");
    let pose = driver.pose(93);
    assert_eq!(pose.world_from_room, path.pose(22), "the path goes on where it was held");
    assert_eq!(pose.steering, Steering { path_frame: 22, held_after: None, is_off_path: false });
}
