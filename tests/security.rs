//! Goal: with certificates, nobody but the wall's own nodes gets in, nobody but its master is listened to, and whoever is turned away
//! reads why, in bounded time, while the show goes on.
//! Method: services and nodes on loopback, with identities made here. `tests/enroll.rs` has what the commands make of it.

mod session_support;

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, mpsc};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime};

use mullion_client::missing::WhenMissing;
use mullion_client::node::{
    self, DEFAULT_MEMORY_BYTES, NodeError, NodeOptions, NodeReport, NodeTls, PaintError, Painter, Reconnect, Security,
};
use mullion_client::tile_session::{DrawStats, FrameToDraw};
use mullion_common::identity::{Bearer, IdentityFile, NodeIdentity};
use mullion_common::scene::{ChunkId, SceneManifest};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wire::{
    ByeCode, Hello, LENGTH_BYTES, Moved, OPENING_LIMIT, Opening, PROTOCOL_VERSION, Part, ToTile, ViewSpec,
};
use mullion_server::enroll::Authority;
use mullion_server::service::{self, MasterTls, Pose, Rate, SecurityError, ServiceError, Show, ShowOptions, ShowReport};
use session_support::{package, wall};
use tokio::sync::watch;

const LEAVES: u32 = 40;
/// Longer than it takes to turn all the others away.
const STEADY_FRAMES: u32 = 100;
const PATIENCE: Duration = Duration::from_secs(60);

/// A node of a wall where each tile has one.
fn node(name: &str) -> Bearer {
    Bearer::Node(NodeIdentity { name: name.into(), tiles: vec![name.into()] })
}

fn authority() -> Authority {
    Authority::new(SystemTime::now()).expect("random numbers")
}

fn identity(authority: &Authority, bearer: &Bearer) -> IdentityFile {
    let text = authority.issue(bearer, SystemTime::now()).expect("random numbers");
    let file = IdentityFile::parse(text.as_bytes()).expect("it was just made");
    assert_eq!(file.bearer, *bearer);
    file
}

fn of_master(identity: IdentityFile) -> service::Security {
    service::Security::Tls(MasterTls::new(identity).expect("a master's"))
}

fn of_node(identity: IdentityFile) -> Security {
    Security::Tls(NodeTls::new(identity).expect("a node's"))
}

/// A show of a wall of two tiles that goes on until it is stopped.
struct Running {
    address: SocketAddr,
    stop: watch::Sender<bool>,
    service: JoinHandle<Result<ShowReport, ServiceError>>,
}

impl Running {
    fn start(security: service::Security) -> Self {
        let wall = wall(2, 1);
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("it is bound");
        let (stop, stopped) = watch::channel(false);
        let eyes = wall.default_eyes();
        let show = Show {
            options: ShowOptions { security, rate: Rate::Hz(100.0), ..ShowOptions::for_wall(&wall) },
            wall,
            package: package(LEAVES),
            camera: Box::new(move |_| Pose { eyes: eyes.clone(), ..Pose::default() }),
            cull: Box::new(|_, sets| sets.fill(VisibleSet::all(LEAVES))),
            observer: Box::new(|_| {}),
            node_observer: Box::new(|_| {}),
            shown_observer: Box::new(|_, _| {}),
            stop: Some(stopped),
        };
        let service = thread::spawn(move || service::run(listener, show));
        Self { address, stop, service }
    }

    fn end(self) -> ShowReport {
        self.stop.send_replace(true);
        self.service.join().expect("no panic").expect("the show goes on to its end")
    }

    /// Is a node until it has shown so many frames or cannot go on.
    fn play(&self, name: &str, security: Security, frames: u32) -> Result<NodeReport, NodeError> {
        play(self.address, name, security, frames)
    }

    /// Why a node is never let in.
    fn unreachable(&self, name: &str, security: Security) -> String {
        match self.play(name, security, 1) {
            Err(NodeError::Unreachable { last, .. }) => last,
            other => panic!("{other:?}"),
        }
    }

    /// The goodbye of a master that refuses for good.
    fn refusal(&self, name: &str, security: Security) -> String {
        match self.play(name, security, 1) {
            Err(NodeError::Refused(bye)) if bye.code == ByeCode::Refused => bye.reason,
            other => panic!("{other:?}"),
        }
    }
}

fn play(address: SocketAddr, name: &str, security: Security, frames: u32) -> Result<NodeReport, NodeError> {
    paint(address, name, security, Guest { left: frames, draws: None })
}

fn paint(address: SocketAddr, name: &str, security: Security, mut guest: Guest) -> Result<NodeReport, NodeError> {
    let options = NodeOptions {
        masters: vec![address.to_string()],
        part: Part::Own,
        when_missing: WhenMissing::Hold,
        node: name.into(),
        credentials: None,
        security,
        memory_bytes: DEFAULT_MEMORY_BYTES,
        cache: None,
        reconnect: Reconnect { give_up_after: Some(Duration::ZERO), ..Reconnect::default() },
        stop: None,
    };
    node::run(options, &mut guest)
}

/// Closes after so many frames.
struct Guest {
    left: u32,
    /// Is told of the first frame that is drawn: by then the scene has come.
    draws: Option<mpsc::Sender<()>>,
}

impl Painter for Guest {
    fn open_scene(&mut self, _: &Arc<SceneManifest>, _: &[ViewSpec]) -> Result<(), PaintError> {
        Ok(())
    }

    fn grow_scene(&mut self, _: &Arc<SceneManifest>) -> Result<(), PaintError> {
        panic!("this scene does not grow")
    }

    fn upload(&mut self, _: ChunkId, bytes: &[u8]) -> Result<u64, PaintError> {
        Ok(bytes.len() as u64)
    }

    fn evict(&mut self, _: ChunkId) -> Result<(), PaintError> {
        Ok(())
    }

    fn set_transform(&mut self, _: &Moved) -> Result<(), PaintError> {
        Ok(())
    }

    fn draw(&mut self, frame: &FrameToDraw) -> Result<DrawStats, PaintError> {
        if self.left == 0 {
            return Err(PaintError::Closed);
        }
        self.draws.take().into_iter().for_each(|draws| draws.send(()).expect("the test waits for it"));
        Ok(DrawStats { draw_us: 1, leaves: frame.views[0].leaves.len(), triangles: 1 })
    }

    fn show(&mut self, _: u64) -> Result<(), PaintError> {
        self.left = self.left.saturating_sub(1);
        Ok(())
    }
}

#[test]
fn nodes_with_certificates_show_what_others_are_not_let_near() {
    let (ours, others) = (authority(), authority());
    let show = Running::start(of_master(identity(&ours, &Bearer::Master)));
    let address = show.address;
    let steady = {
        let security = of_node(identity(&ours, &node("t1x0")));
        thread::spawn(move || play(address, "t1x0", security, STEADY_FRAMES))
    };

    let reason = show.refusal("t0x0", of_node(identity(&ours, &node("t1x0"))));
    assert!(reason.contains("\"t0x0\"") && reason.contains("\"t1x0\""), "{reason}");

    let both = Bearer::Node(NodeIdentity { name: "t0x0".into(), tiles: vec!["t0x0".into(), "t1x0".into()] });
    let reason = show.refusal("t0x0", of_node(identity(&ours, &both)));
    assert!(reason.contains("t0x0, t1x0") && reason.contains("mullion enroll"), "{reason}");

    let reason = show.refusal("t0x0", Security::Plain);
    assert!(reason.contains("--identity"), "{reason}");

    let reason = show.unreachable("t0x0", of_node(identity(&others, &node("t0x0"))));
    assert!(reason.contains("the master's certificate is of another authority"), "{reason}");

    let stranger = IdentityFile { authority: ours.certificate().clone(), ..identity(&others, &node("t0x0")) };
    let reason = show.unreachable("t0x0", of_node(stranger));
    assert!(reason.contains("does not take this node's certificate"), "{reason}");

    // The master's own certificate makes nobody a node.
    let as_node = IdentityFile { bearer: node("t0x0"), ..identity(&ours, &Bearer::Master) };
    show.unreachable("t0x0", of_node(as_node));

    // All that while, those who belong there were undisturbed.
    let report = steady.join().expect("no panic").expect("it belongs there");
    assert!(report.shown >= u64::from(STEADY_FRAMES) && report.connections == 1, "{report:?}");
    assert!(report.blob_bytes > 0, "the scene came by a chunk connection of the same certificate");
    let report = show.play("t0x0", of_node(identity(&ours, &node("t0x0"))), 5).expect("it belongs there");
    assert!(report.shown >= 5, "{report:?}");
    let report = show.end();
    assert!(report.refused >= 5, "{report:?}");
}

#[test]
fn a_node_listens_to_its_master_only() {
    let ours = authority();
    // A node's certificate, served by one who says that it is the master's.
    let rogue = IdentityFile { bearer: Bearer::Master, ..identity(&ours, &node("t1x0")) };
    let show = Running::start(of_master(rogue));
    let reason = show.unreachable("t0x0", of_node(identity(&ours, &node("t0x0"))));
    assert!(reason.contains("not the master"), "{reason}");
    show.end();
    let refused = MasterTls::new(identity(&ours, &node("t1x0")));
    assert!(matches!(refused, Err(SecurityError::IsNode(name)) if name == "t1x0"));

    // One who speaks no TLS.
    let show = Running::start(service::Security::Plain);
    let reason = show.unreachable("t0x0", of_node(identity(&ours, &node("t0x0"))));
    assert!(reason.contains("does not speak TLS") && reason.contains("--identity"), "{reason}");
    show.end();
}

#[test]
fn who_does_not_get_to_the_point_is_closed_in_time_and_nobody_waits() {
    let ours = authority();
    let show = Running::start(of_master(identity(&ours, &Bearer::Master)));
    let address = show.address;
    let started = Instant::now();
    let mut plain_greeting = Vec::new();
    let hello = Hello { node: "t0x0".into(), part: Part::Own, credentials: None, cached: vec![] };
    Opening::Control(hello).encode_as_version(PROTOCOL_VERSION, &mut plain_greeting).expect("it fits");
    // Nothing; half a TLS record; a record that claims more than it brings; an old hand.
    let openings: [&[u8]; 4] = [b"", b"\x16\x03\x01", b"\x16\x03\x01\x40\x00\x01\x00\x3f\xfc", &plain_greeting];
    let ends: Vec<_> = openings
        .into_iter()
        .map(|opening| {
            let mut stream = TcpStream::connect(address).expect("it listens");
            stream.set_read_timeout(Some(PATIENCE)).expect("a socket");
            stream.write_all(opening).expect("it is read");
            thread::spawn(move || {
                let mut answer = Vec::new();
                stream.read_to_end(&mut answer).expect("the master closes");
                (answer, started.elapsed())
            })
        })
        .collect();
    let report = show.play("t0x0", of_node(identity(&ours, &node("t0x0"))), 20).expect("it belongs there");
    assert!(report.shown >= 20, "{report:?}");
    assert!(started.elapsed() < OPENING_LIMIT, "it did not wait for the others");
    let mut ends: Vec<_> = ends.into_iter().map(|end| end.join().expect("closed in time")).collect();
    let (goodbye, at) = ends.pop().expect("four");
    assert!(at < OPENING_LIMIT, "who speaks no TLS is told at once");
    match ToTile::decode(&goodbye[LENGTH_BYTES..]) {
        Ok(ToTile::Bye(bye)) => assert!(bye.code == ByeCode::Refused && bye.reason.contains("--identity"), "{bye}"),
        other => panic!("{other:?}"),
    }
    for (_, at) in ends {
        assert!(at < OPENING_LIMIT * 2, "closed after {at:?}");
    }
    assert_eq!(show.end().refused, 4, "all were counted, and once");
}

#[test]
fn a_flood_of_silent_connections_is_bounded_and_drowns_nobody() {
    const FLOOD: usize = 120;
    let ours = authority();
    let show = Running::start(of_master(identity(&ours, &Bearer::Master)));
    let address = show.address;
    let (draws, is_drawing) = mpsc::channel();
    let steady = {
        let security = of_node(identity(&ours, &node("t1x0")));
        thread::spawn(move || paint(address, "t1x0", security, Guest { left: STEADY_FRAMES, draws: Some(draws) }))
    };
    is_drawing.recv_timeout(PATIENCE).expect("it gets in while there is room");
    let started = Instant::now();
    let flood: Vec<_> = (0..FLOOD).map(|_| TcpStream::connect(address).expect("it listens")).collect();
    let ends: Vec<Duration> = flood
        .into_iter()
        .map(|stream| {
            stream.set_read_timeout(Some(PATIENCE)).expect("a socket");
            (&stream).read_to_end(&mut Vec::new()).expect("the master closes");
            started.elapsed()
        })
        .collect();
    assert!(ends.iter().all(|at| *at < OPENING_LIMIT * 2), "{ends:?}");
    let report = steady.join().expect("no panic").expect("it belongs there");
    assert_eq!(report.connections, 1);
    let report = show.play("t0x0", of_node(identity(&ours, &node("t0x0"))), 5).expect("there is room again");
    assert!(report.shown >= 5);
    assert_eq!(show.end().refused, FLOOD as u64);
}
