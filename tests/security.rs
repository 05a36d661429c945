//! Goal: with certificates, nobody but the wall's own nodes gets in, nobody but its master is listened to, and whoever is turned away
//! reads why. Without them, a master is not reached from other machines unless that was asked for.
//! Method: services and nodes on loopback with identities made here; the binary where files and arguments matter.

mod session_support;
mod support;

use std::fs;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime};

use mullion_client::node::{
    self, DEFAULT_MEMORY_BYTES, NodeError, NodeOptions, NodeReport, NodeTls, PaintError, Painter, Reconnect, Security,
};
use mullion_client::tile_session::{DrawStats, FrameToDraw};
use mullion_common::identity::{Bearer, IdentityFile, NodeIdentity};
use mullion_common::scene::{ChunkId, SceneManifest};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wire::{ByeCode, Hello, LENGTH_BYTES, Moved, OPENING_LIMIT, Opening, PROTOCOL_VERSION, ToTile, ViewSpec};
use mullion_server::enroll::Authority;
use mullion_server::service::{self, MasterTls, Pose, Rate, SecurityError, ServiceError, Show, ShowOptions, ShowReport};
use session_support::{package, wall};
use support::{Process, mullion};
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
    let options = NodeOptions {
        master: address.to_string(),
        node: name.into(),
        credentials: None,
        security,
        memory_bytes: DEFAULT_MEMORY_BYTES,
        cache: None,
        reconnect: Reconnect { give_up_after: Some(Duration::ZERO), ..Reconnect::default() },
        stop: None,
    };
    node::run(options, &mut Guest { left: frames })
}

/// Closes after so many frames.
struct Guest {
    left: u32,
}

impl Painter for Guest {
    fn open_scene(&mut self, _: &Arc<SceneManifest>, _: &[ViewSpec]) -> Result<(), PaintError> {
        Ok(())
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
    let hello = Hello { node: "t0x0".into(), credentials: None, cached: vec![] };
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

const LIMIT: Duration = Duration::from_secs(30);
const WALL: &str = "[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [1.0, 0.75]\n";

/// A folder with a wall of two tiles.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().expect("a folder"));
        fs::write(folder.path("wall.toml"), WALL).expect("written");
        folder
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).expect("it is there")
    }

    #[track_caller]
    fn enroll(&self, more: &[&str]) -> String {
        let done = mullion(&[&["enroll", &self.path("wall.toml"), "--out", &self.path("ids")], more].concat(), LIMIT);
        assert_eq!((done.code, done.err.as_str()), (Some(0), ""), "{}", done.out);
        done.out
    }
}

/// Runs a command that must fail with one line that holds all of `words`.
#[track_caller]
fn refused(args: &[&str], words: &[&str]) {
    let done = mullion(args, LIMIT);
    assert_eq!((done.code, done.err.lines().count()), (Some(2), 1), "mullion {}\n{}", args.join(" "), done.err);
    for word in words {
        assert!(done.err.contains(word), "{word:?} is not in: {}", done.err);
    }
}

#[test]
fn enrolling_again_adds_what_is_missing_and_keeps_the_rest() {
    let folder = Folder::new();
    let out = folder.enroll(&[]);
    assert!(out.starts_with("3 certificates made, 0 replaced, 0 kept"), "{out}");
    let all = ["authority.pem", "authority.key", "master.pem", "nodes/t0x0.pem", "nodes/t1x0.pem"];
    let names = all.map(|name| format!("ids/{name}"));
    let before = names.each_ref().map(|name| folder.text(name));
    #[cfg(unix)]
    for name in &names {
        use std::os::unix::fs::PermissionsExt;
        let mode = fs::metadata(folder.path(name)).expect("it is there").permissions().mode();
        assert_eq!(mode & 0o777, 0o600, "{name}");
    }
    assert!(!before[0].contains("PRIVATE KEY") && before[1].contains("PRIVATE KEY"));

    fs::remove_file(folder.path("ids/nodes/t1x0.pem")).expect("it is there");
    let out = folder.enroll(&[]);
    assert!(out.starts_with("1 certificates made, 0 replaced, 2 kept"), "{out}");
    let after = names.each_ref().map(|name| folder.text(name));
    assert_eq!(before[..4], after[..4]);
    assert_ne!(before[4], after[4], "that one is new");

    // A node with other tiles than before gets another certificate.
    let with_node = format!("{WALL}\n[[nodes]]\nname = \"left\"\ntiles = [\"t0x0\"]\n");
    fs::write(folder.path("wall.toml"), &with_node).expect("written");
    assert!(folder.enroll(&[]).starts_with("1 certificates made, 0 replaced, 2 kept"));
    fs::write(folder.path("wall.toml"), with_node.replace("[\"t0x0\"]", "[\"t0x0\", \"t1x0\"]")).expect("written");
    let out = folder.enroll(&[]);
    assert!(out.starts_with("0 certificates made, 1 replaced, 1 kept") && out.contains("left.pem to its node again"), "{out}");
    let left = IdentityFile::parse(folder.text("ids/nodes/left.pem").as_bytes()).expect("an identity");
    let Bearer::Node(left) = left.bearer else { panic!("{:?}", left.bearer) };
    assert_eq!((left.name.as_str(), left.tiles.join(" ").as_str()), ("left", "t0x0 t1x0"));
    assert!(folder.enroll(&["--force"]).starts_with("0 certificates made, 2 replaced, 0 kept"));
    assert_eq!(folder.text("ids/authority.pem"), before[0], "the authority stays");
}

#[test]
fn enrolling_overwrites_nothing_of_somebody_elses() {
    let folder = Folder::new();
    folder.enroll(&[]);
    let (wall, ids, master) = (folder.path("wall.toml"), folder.path("ids"), folder.path("ids/master.pem"));
    let enroll = ["enroll", &wall, "--out", &ids];
    let whole = folder.text("ids/master.pem");
    fs::write(&master, "a poem").expect("written");
    refused(&enroll, &[&master, "no identity file", "--force"]);
    assert_eq!(folder.text("ids/master.pem"), "a poem");
    fs::write(&master, folder.text("ids/nodes/t0x0.pem")).expect("written");
    refused(&enroll, &[&master, "somebody else", "--force"]);
    let other = authority().issue(&Bearer::Master, SystemTime::now()).expect("random numbers");
    fs::write(&master, other).expect("written");
    refused(&enroll, &[&master, "another authority", "--force"]);
    fs::write(&master, whole).expect("written");
    let key = folder.path("ids/authority.key");
    fs::write(&key, authority().key_pem()).expect("written");
    refused(&enroll, &["authority.pem", "do not belong together"]);
    fs::remove_file(&key).expect("it is there");
    refused(&enroll, &[&key, "is not there", "put it back"]);
    refused(&["enroll", &folder.path("absent.toml"), "--out", &ids], &["absent.toml"]);
    let below_file = folder.path("wall.toml/ids");
    refused(&["enroll", &wall, "--out", &below_file], &[&below_file]);
}

fn with<'a>(args: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    [args, more].concat()
}

#[test]
fn an_open_door_must_be_asked_for() {
    let folder = Folder::new();
    folder.enroll(&[]);
    let scene = support::city(Path::new(&folder.path("")));
    let (wall, scene) = (folder.path("wall.toml"), scene.display().to_string());
    let (master, of_node) = (folder.path("ids/master.pem"), folder.path("ids/nodes/t0x0.pem"));
    let open = ["serve", &wall, &scene, "--listen", "0.0.0.0:0"];
    refused(&open, &["--listen", "0.0.0.0:0", "mullion enroll", "--identity", "--insecure"]);
    refused(&with(&open, &["--identity", &of_node]), &[&of_node, "node \"t0x0\"", "master.pem"]);
    refused(&with(&open, &["--identity", &wall]), &[&wall, "no identity file"]);
    refused(&with(&open, &["--identity", &folder.path("absent.pem")]), &["absent.pem", "No such file"]);
    refused(&with(&open, &["--identity", &master, "--insecure"]), &["--identity", "--insecure"]);
    refused(&["tile", "t0x0", "--identity", &master, "--headless", "x"], &[&master, "is for the master"]);

    let mut process = Process::start(&with(&open, &["--insecure"]));
    support::address_of(&mut process);
    process.error_line(&["warning: ", "any node that knows a name"], 0, LIMIT);
    drop(process);
    let mut process = Process::start(&with(&open, &["--identity", &master]));
    support::address_of(&mut process);
    assert!(process.is_running() && process.err.text().is_empty(), "{}", process.err.text());
}

#[test]
fn processes_with_certificates_show_a_wall() {
    if !support::has_gpu() {
        return;
    }
    let folder = Folder::new();
    folder.enroll(&[]);
    let scene = support::city(Path::new(&folder.path("")));
    let (wall, scene, master) = (folder.path("wall.toml"), scene.display().to_string(), folder.path("ids/master.pem"));
    let listen = ["serve", &wall, &scene, "--listen", "127.0.0.1:0", "--identity", &master];
    let mut serve = Process::start(&[&listen[..], &["--frames", "5", "--wait", "60", "--barrier", "20000"]].concat());
    let address = support::address_of(&mut serve);
    let pictures = folder.path("pictures");
    let mut start = |name: &str| {
        let identity = folder.path(&format!("ids/nodes/{name}.pem"));
        let common = ["--master", &address, "--headless", &pictures, "--give-up-after", "20", "--cache-mib", "0"];
        Process::start(&[&["tile", name, "--identity", &identity], &common[..]].concat())
    };
    let mut tiles = ["t0x0", "t1x0"].map(&mut start);
    assert_eq!(serve.wait(PATIENCE), Some(0), "{}", serve.err.text());
    for (tile, name) in tiles.iter_mut().zip(["t0x0", "t1x0"]) {
        assert_eq!(tile.wait(PATIENCE), Some(0), "{}", tile.err.text());
        assert!(Path::new(&pictures).join(format!("{name}.png")).exists());
    }
}
