//! Goal: a show is steered from outside, whoever sends what goes on, and what came in can be culled again bit for bit.
//! Method: a service and the control API on loopback, steered with the client crate and with bytes that no client sends. Nothing
//! sleeps to synchronise; every wait ends.

#[path = "support/memory_file.rs"]
mod memory_file;
mod session_support;
#[path = "support/steered.rs"]
mod steered;

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};

use glam::{DAffine3, DVec3};
use mullion_common::visible_set::VisibleSet;
use mullion_control::{
    CameraAt, Command, Control, Error, Moved, ObjectId, ObjectNumber, Reason, Side, Steps, TileBudget, Transform,
};
use mullion_server::control::LiveScene;
use mullion_server::record::{Ending, Reader};
use session_support::{OBJECTS, package, wall};
use steered::{LEAVES, PATIENCE, Steered};

/// Runs a show that `steer` steers, and gives back its record.
fn steered(steer: impl FnOnce(SocketAddr)) -> Vec<u8> {
    let show = Steered { distance_m: 12.0, rate_hz: 250.0, barrier_wait: None, packages: None };
    show.run(|addresses| steer(addresses.control)).0
}

/// Culls a record again: how many frames, and how it ended.
fn replayed(record: &[u8]) -> (u64, Option<Ending>) {
    let (wall, package) = (wall(2, 1), package(LEAVES));
    let mut reader = Reader::open(record).unwrap();
    let mut scene = LiveScene::new(reader.header().algorithm.parse().unwrap(), &wall, &package);
    let mut sets = vec![VisibleSet::default(); wall.views().len()];
    let mut frames = 0;
    while let Some(frame) = reader.next_frame().unwrap() {
        scene.cull(&frame.pose, &mut sets);
        let digests: Vec<u64> = sets.iter().map(VisibleSet::digest).collect();
        assert_eq!(digests, frame.digests, "frame {}", frame.number);
        frames += 1;
    }
    (frames, reader.ending().cloned())
}

fn number(object: u32) -> ObjectNumber {
    ObjectNumber { object }
}

#[test]
fn a_show_is_steered_and_its_record_culls_the_same() {
    let record = steered(|address| {
        let mut control = Control::connect(address).unwrap();
        let camera =
            |z: f64| Command::Camera(CameraAt { translation: [3.0, 1.0, z], rotation: [0.0, 0.0, 0.0, 1.0], scale: 1.0 });
        let first = control.send(&[camera(60.0)]).unwrap();
        let why = control.why("0", "t0x0").unwrap();
        assert!(why.frame >= first && why.leaf_count > 0, "{why:?}");
        let seen = control.tiles("0").unwrap();
        assert!(!seen.tiles.is_empty(), "{seen:?}");

        // Behind the camera nothing is seen, and the near plane is the reason, or a side.
        control.send(&[camera(-60.0)]).unwrap();
        let why = control.why("0", "t1x0").unwrap();
        assert!(!why.is_seen);
        let is_outside = |reason: &Reason| matches!(reason, Reason::Outside { distance_m, .. } if *distance_m < 0.0);
        assert!(why.leaves.iter().all(|leaf| leaf.views.iter().all(is_outside)), "{why:?}");
        assert!(control.tiles("0").unwrap().tiles.is_empty());

        control.send(&[camera(60.0), Command::Remove(number(0))]).unwrap();
        let why = control.why("0", "t0x0").unwrap();
        assert!(!why.is_seen && why.leaves.iter().all(|leaf| leaf.views == [Reason::Removed]), "{why:?}");
        control.send(&[Command::Add(number(0))]).unwrap();
        assert_eq!(control.tiles("0").unwrap().tiles, seen.tiles);

        // Far to the left, by the binary message; the command behind it comes no earlier.
        let transform = Transform::from(DAffine3::from_translation(DVec3::new(-1e6, 0.0, 0.0)));
        let moves: Vec<Moved> = (0..OBJECTS).map(|object| Moved { object: ObjectId(object), transform }).collect();
        control.move_objects(&moves).unwrap();
        control.send(&[Command::Budget(TileBudget { triangles: Some(1000), ..TileBudget::default() })]).unwrap();
        let why = control.why("0", "t0x0").unwrap();
        let is_left = |reason: &Reason| matches!(reason, Reason::Outside { side: Side::Left, .. });
        assert!(why.leaves.iter().all(|leaf| leaf.views.iter().all(is_left)), "{why:?}");

        // Time stands, while frames go on; a step of five is five frames of the path.
        let paused = control.send(&[Command::Pause, Command::FollowPath]).unwrap();
        let held = loop {
            let status = control.next_status().unwrap();
            if status.frame >= paused {
                assert!(status.is_paused);
                break status.clone();
            }
        };
        assert!(control.next_status().unwrap().frame > held.frame);
        assert_eq!(control.status().path_frame, held.path_frame);
        control.send(&[Command::Step(Steps { frames: 5 })]).unwrap();
        let end = loop {
            let status = control.next_status().unwrap();
            if status.is_paused && status.path_frame > held.path_frame {
                break status.clone();
            }
        };
        assert_eq!(end.path_frame, held.path_frame + 5);
        let resumed = control.send(&[Command::Resume]).unwrap();
        while control.status().frame < resumed {
            control.next_status().unwrap();
        }
        assert!(!control.status().is_paused);
    });
    let (frames, ending) = replayed(&record);
    assert!(frames > 10);
    assert_eq!(ending, Some(Ending::Complete));
    // A crash leaves whole frames, then part of one.
    assert_eq!(replayed(&record[..record.len() - 40]), (frames - 1, None));
    assert!(Reader::open(&b"MULLREC"[..]).is_err());
}

/// Sends a request as it stands, and gives back the first line and the body of the answer.
fn raw(address: SocketAddr, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(request).unwrap();
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer); // a refused body may end in a reset
    String::from_utf8_lossy(&answer).into_owned()
}

fn post(address: SocketAddr, headers: &str, body: &str) -> String {
    let length = body.len();
    raw(
        address,
        format!(
            "POST /commands HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{headers}Content-Length: {length}\r\n\r\n{body}"
        )
        .as_bytes(),
    )
}

#[test]
fn what_is_wrong_is_refused_in_one_line_and_the_show_goes_on() {
    steered(|address| {
        let good = r#"[{"camera":{"translation":[0,1,20]}},{"follow_path":null},"pause","resume",{"eyes":[]}]"#;
        let answer = post(address, "", good);
        assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("\"frame\":"), "{answer}");
        let bad = [
            ("", "[{", "400", "not a request"),
            ("", r#"[{"remove":{"object":99}}]"#, "400", "object 99"),
            ("", r#"["pause",{"camera":{"translation":[0,1e300,0]}}]"#, "400", "command 1: camera: translation y"),
            ("", r#"[{"eyes":[[0,0,-5]]}]"#, "400", "eyes: observer 0"),
            ("", r#"[{"budget":{"tile":"t9x9"}}]"#, "400", "t9x9"),
            ("", r#"[{"step":{"frames":0}}]"#, "400", "step: 0 frames"),
            ("", r#"[{"explode":null}]"#, "400", "explode"),
            ("Origin: https://example.org\r\n", good, "403", "Origin"),
            ("Origin: null\r\n", good, "403", "Origin"),
        ];
        for (headers, body, code, problem) in bad {
            let answer = post(address, headers, body);
            assert!(answer.starts_with(&format!("HTTP/1.1 {code}")) && answer.contains(problem), "{body}: {answer}");
        }
        assert!(post(address, "Origin: http://localhost:8080\r\n", "[]").starts_with("HTTP/1.1 200"));
        let metrics = raw(address, b"GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
        assert!(metrics.contains("openmetrics-text") && metrics.contains("mullion_frames_total"), "{metrics}");
        let rebound = raw(address, b"GET /status HTTP/1.1\r\nHost: example.org\r\nConnection: close\r\n\r\n");
        assert!(rebound.starts_with("HTTP/1.1 403"), "{rebound}");
        let huge = format!("POST /commands HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nContent-Length: 99999999\r\n\r\n");
        assert!(raw(address, huge.as_bytes()).starts_with("HTTP/1.1 413"));

        let mut control = Control::connect(address).unwrap();
        assert!(matches!(control.why("0", "t7x7"), Err(Error::Refused(reason)) if reason.contains("t0x0")));
        assert!(matches!(control.why("99", "t0x0"), Err(Error::Refused(_))));
        let transform = Transform::from(DAffine3::from_translation(DVec3::splat(f64::NAN)));
        control.move_objects(&[Moved { object: ObjectId(0), transform }]).unwrap();
        let refused = loop {
            if let Err(error) = control.next_status() {
                break error;
            }
        };
        assert!(refused.to_string().contains("move 0: object 0"), "{refused}");
        control.send(&[Command::Resume]).unwrap();
    });
}
