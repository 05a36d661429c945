//! Goal: `mullion enroll` makes a wall's certificates and spoils none; `serve` and `tile` use them, say what is wrong with a file, and open
//! no door to other machines that was not asked for.
//! Method: the real binary, in a folder of its own.

mod support;

use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

use mullion_common::identity::{Bearer, IdentityFile};
use mullion_server::enroll::Authority;
use support::{Process, mullion};

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

fn authority() -> Authority {
    Authority::new(SystemTime::now()).expect("random numbers")
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
    assert!(out.contains(": 3 made, 0 replaced, 0 kept\n"), "{out}");
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
    assert!(out.contains(": 1 made, 0 replaced, 2 kept\n"), "{out}");
    let after = names.each_ref().map(|name| folder.text(name));
    assert_eq!(before[..4], after[..4]);
    assert_ne!(before[4], after[4], "that one is new");

    // A node with other tiles than before gets another certificate.
    let with_node = format!("{WALL}\n[[nodes]]\nname = \"left\"\ntiles = [\"t0x0\"]\n");
    fs::write(folder.path("wall.toml"), &with_node).expect("written");
    assert!(folder.enroll(&[]).contains(": 1 made, 0 replaced, 2 kept\n"));
    fs::write(folder.path("wall.toml"), with_node.replace("[\"t0x0\"]", "[\"t0x0\", \"t1x0\"]")).expect("written");
    let out = folder.enroll(&[]);
    assert!(out.contains(": 0 made, 1 replaced, 1 kept\n") && out.contains("left.pem to its node again"), "{out}");
    let left = IdentityFile::parse(folder.text("ids/nodes/left.pem").as_bytes()).expect("an identity");
    let Bearer::Node(left) = left.bearer else { panic!("{:?}", left.bearer) };
    assert_eq!((left.name.as_str(), left.tiles.join(" ").as_str()), ("left", "t0x0 t1x0"));
    assert!(folder.enroll(&["--force"]).contains(": 0 made, 2 replaced, 0 kept\n"));
    assert_eq!(folder.text("ids/authority.pem"), before[0], "the authority stays");
}

#[test]
fn spares_and_standbys_are_enrolled_when_they_are_asked_for() {
    let folder = Folder::new();
    let out = folder.enroll(&["--spares", "2", "--standbys", "1"]);
    assert!(out.contains(": 6 made, 0 replaced, 0 kept\n") && out.contains("--spare ") && out.contains("--standby-of "), "{out}");
    let identity = |name: &str| IdentityFile::parse(folder.text(&format!("ids/{name}")).as_bytes()).expect("an identity");
    for name in ["spare-1", "spare-2"] {
        assert_eq!(identity(&format!("spares/{name}.pem")).bearer, Bearer::Spare(name.into()));
    }
    let (master, standby) = (identity("master.pem"), identity("standbys/standby-1.pem"));
    assert_eq!(standby.bearer, Bearer::Master, "a master in waiting");
    assert_ne!(standby.certificate, master.certificate, "each machine has a key of its own");
    assert!(folder.enroll(&[]).contains(": 0 made, 0 replaced, 3 kept\n"), "the others are not touched");
    assert!(folder.enroll(&["--spares", "3"]).contains(": 1 made, 0 replaced, 5 kept\n"));
    let (wall, ids) = (folder.path("wall.toml"), folder.path("ids"));
    let spare = folder.path("ids/spares/spare-1.pem");
    fs::copy(folder.path("ids/nodes/t0x0.pem"), &spare).expect("copied");
    refused(&["enroll", &wall, "--out", &ids, "--spares", "1"], &[&spare, "somebody else"]);
    let too_many = mullion(&["enroll", &wall, "--out", &ids, "--spares", "1001"], LIMIT);
    assert!(too_many.code == Some(2) && too_many.err.contains("1001"), "{}", too_many.err);
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
    assert_eq!(serve.wait(LIMIT * 2), Some(0), "{}", serve.err.text());
    for (tile, name) in tiles.iter_mut().zip(["t0x0", "t1x0"]) {
        assert_eq!(tile.wait(LIMIT * 2), Some(0), "{}", tile.err.text());
        assert!(Path::new(&pictures).join(format!("{name}.png")).exists());
    }
}
