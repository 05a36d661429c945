//! What users see on bad input: exit code 2 and one line that names the file and what is wrong, soon.
//!
//! Every case runs the real binary. What the importer makes of each fault is tested beside the importer.

mod support;

use std::fs;
use std::net::TcpListener;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use mullion_common::scene::Package;
use support::{Process, mullion};
use tempfile::TempDir;

/// Generous for a debug build on a busy machine; a hang is longer.
const LIMIT: Duration = Duration::from_secs(30);

const WALL: &str = "[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [1.0, 0.75]\n";

/// One triangle with normals' worth of nothing: 36 bytes of positions in a data URI.
fn triangle_gltf() -> String {
    let corners: [f32; 9] = [0.0, 0.0, -2.0, 1.0, 0.0, -2.0, 0.0, 1.0, -2.0];
    let bytes: Vec<u8> = corners.iter().flat_map(|c| c.to_le_bytes()).collect();
    let uri = base64(&bytes);
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,-2],"max":[1,1,-2]}}],
"bufferViews":[{{"buffer":0,"byteLength":36}}],
"buffers":[{{"byteLength":36,"uri":"data:application/octet-stream;base64,{uri}"}}]}}"#
    )
}

/// Of lengths that three divides.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    assert!(bytes.len().is_multiple_of(3));
    let digits = |c: &[u8]| {
        let bits = u32::from_be_bytes([0, c[0], c[1], c[2]]);
        [18, 12, 6, 0].map(|shift| char::from(DIGITS[(bits >> shift & 63) as usize]))
    };
    bytes.chunks_exact(3).flat_map(digits).collect()
}

fn glb(json: &str) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    let lengths = [2, 20 + json.len() as u32, json.len() as u32];
    bytes.extend(lengths.iter().flat_map(|n| n.to_le_bytes()));
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes
}

/// A folder with a good scene and a good wall.
struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(TempDir::new().expect("a folder"));
        folder.write("good.gltf", triangle_gltf());
        folder.write("good.toml", WALL);
        folder
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        let path = self.path(name);
        fs::write(&path, bytes).expect("written");
        path
    }

    fn path(&self, name: &str) -> String {
        Path::join(self.0.path(), name).display().to_string()
    }

    /// The good scene as a package.
    fn package(&self) -> Vec<u8> {
        let out = self.path("good.mull");
        let done = mullion(&["prepare", &self.path("good.gltf"), "--out", &out], LIMIT);
        assert_eq!(done.code, Some(0), "{}", done.err);
        fs::read(out).expect("it was written")
    }
}

/// Runs a command that must fail as a user can mend it, with a line that holds all of `words`.
#[track_caller]
fn refused(args: &[&str], words: &[&str]) {
    let done = mullion(args, LIMIT);
    let shown = format!("mullion {}\n{}{}", args.join(" "), done.out, done.err);
    assert_eq!(done.code, Some(2), "{shown}");
    assert_eq!(done.err.lines().count(), 1, "one line: {shown}");
    assert!(done.err.starts_with("mullion: "), "{shown}");
    assert!(!done.err.contains("panicked") && !done.err.contains("RUST_BACKTRACE"), "{shown}");
    for word in words {
        assert!(done.err.contains(word), "{word:?} is not in: {shown}");
    }
}

/// A scene that cannot be read is refused alike by every command that reads one.
#[track_caller]
fn refused_scene(folder: &Folder, scene: &str, words: &[&str]) {
    let mut all = vec![scene];
    all.extend(words);
    refused(&["info", scene], &all);
    refused(&["prepare", scene, "--out", &folder.path("out.mull")], &all);
    assert!(!Path::new(&folder.path("out.mull")).exists(), "nothing is left behind");
    refused(&["cull", scene, "--wall", &folder.path("good.toml")], &all);
    refused(&["serve", &folder.path("good.toml"), scene, "--listen", "127.0.0.1:0"], &all);
}

#[test]
fn the_good_files_are_good() {
    let folder = Folder::new();
    let done = mullion(&["cull", &folder.path("good.gltf"), "--wall", &folder.path("good.toml")], LIMIT);
    assert_eq!(done.code, Some(0), "{}", done.err);
    folder.package();
    let done = mullion(&["info", &folder.path("good.mull")], LIMIT);
    assert_eq!((done.code, done.err.as_str()), (Some(0), ""));
}

#[test]
fn files_that_are_no_scenes() {
    let folder = Folder::new();
    refused_scene(&folder, &folder.path("absent.glb"), &["No such file"]);
    refused_scene(&folder, &folder.path(""), &["is a directory"]);
    let pipe = folder.path("pipe.glb");
    if Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()) {
        refused_scene(&folder, &pipe, &["no regular file"]);
    }
    let whole = glb(&triangle_gltf());
    refused_scene(&folder, &folder.write("short.glb", &whole[..whole.len() / 2]), &["bytes"]);
    refused_scene(&folder, &folder.write("header.glb", &whole[..10]), &[]);
    refused_scene(&folder, &folder.write("empty.glb", ""), &[]);
    let garbage: Vec<u8> = (0..5000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    refused_scene(&folder, &folder.write("garbage.glb", garbage), &[]);
    refused_scene(&folder, &folder.write("text.gltf", "{\n\"asset\": 3,\n}"), &["line"]);
}

#[test]
fn scenes_that_would_do_harm() {
    let folder = Folder::new();
    let depth = 100_000;
    let chain: Vec<String> = (1..depth).map(|i| format!("{{\"children\":[{i}]}}")).collect();
    let chain = format!("\"nodes\":[{},{{\"mesh\":0}}]", chain.join(","));
    let deep = triangle_gltf().replace(r#""nodes":[{"mesh":0}]"#, &chain);
    refused_scene(&folder, &folder.write("deep.gltf", deep), &["deep"]);
    let huge = triangle_gltf().replace("\"count\":3", "\"count\":4611686018427387904");
    refused_scene(&folder, &folder.write("huge.gltf", huge), &["4611686018427387904"]);
    let data = triangle_gltf();
    let uri = data.split('"').find(|part| part.starts_with("data:")).expect("it has one").to_owned();
    let climbing = data.replace(&uri, "../../../../etc/passwd");
    refused_scene(&folder, &folder.write("climbing.gltf", climbing), &["../../../../etc/passwd"]);
    let cycle = triangle_gltf().replace(r#"{"mesh":0}"#, r#"{"mesh":0,"children":[0]}"#);
    refused_scene(&folder, &folder.write("cycle.gltf", cycle), &["node 0"]);
}

#[test]
fn packages_that_are_damaged() {
    let folder = Folder::new();
    let package = folder.package();
    for share in [1, 3, 5, 7] {
        let cut = &package[..package.len() * share / 8];
        refused_scene(&folder, &folder.write("cut.mull", cut), &[]);
    }
    for share in [1, 3, 5, 7] {
        let mut flipped = package.clone();
        flipped[package.len() * share / 8] ^= 0x10;
        refused_scene(&folder, &folder.write("flipped.mull", flipped), &[]);
    }
    for at in 0..package.len() {
        let mut flipped = package.clone();
        flipped[at] ^= 1 << (at % 8);
        assert!(Package::read(&flipped).is_err(), "a flip in byte {at} goes unnoticed");
    }
    let mut other = package.clone();
    other[8] = 99; // the version stands after the magic
    refused_scene(&folder, &folder.write("other.mull", other), &["version", "99"]);
}

#[test]
fn walls_with_mistakes() {
    let folder = Folder::new();
    let scene = folder.path("good.gltf");
    let on_wall = |wall: &str, words: &[&str]| {
        let mut all = vec![wall];
        all.extend(words);
        refused(&["serve", wall, &scene, "--listen", "127.0.0.1:0"], &all);
        refused(&["cull", &scene, "--wall", wall], &all);
        refused(&["demo", "--wall", wall, "--out", &folder.path("demo"), "--scene", &scene], &all);
        assert!(!Path::new(&folder.path("demo")).exists(), "nothing is left behind");
    };
    on_wall(&folder.path("absent.toml"), &["No such file"]);
    on_wall(&folder.path(""), &["irectory"]);
    on_wall(&folder.write("unknown.toml", WALL.replace("rows", "rosw")), &["line 3", "rosw"]);
    let mirrored = format!("eye = [0.0, 0.0, -3.0]\n{WALL}");
    on_wall(&folder.write("mirrored.toml", mirrored), &["line 1", "mirrored"]);
    on_wall(&folder.write("negative.toml", WALL.replace("[64,", "[-64,")), &["line 4", "-64"]);
    on_wall(&folder.write("prose.toml", "# a wall\nfour panels, please\n"), &["line 2"]);
    on_wall(&folder.write("binary.toml", [0xff, 0xfe, 0, 1]), &["UTF-8"]);
}

#[test]
fn arguments_that_cannot_be() {
    let folder = Folder::new();
    let (scene, wall) = (folder.path("good.gltf"), folder.path("good.toml"));
    refused(&["cull", &scene, "--wall", &wall, "--eye", "0,0,-1"], &["--eye", "mirrored"]);
    refused(&["cull", &scene, "--wall", &wall, "--eye", "0,0"], &["--eye", "X,Y,Z"]);
    refused(&["cull", &scene, "--wall", &wall, "--algorithm", "fast"], &["--algorithm", "adaptive"]);
    refused(&["demo", "--grid", "0x4", "--out", &folder.path("demo")], &["--grid", "0x4"]);
    refused(&["demo", "--grid", "four", "--out", &folder.path("demo")], &["--grid", "four"]);
    refused(&["verify", "pixels", &scene, "--grids", "2x2,7x1"], &["7x1"]);
    refused(&["serve", &wall, &scene, "--rate", "-1", "--listen", "127.0.0.1:0"], &["--rate"]);
    refused(&["serve", &wall, &scene, "--rate=-1", "--listen", "127.0.0.1:0"], &["--rate"]);
    for share in ["0", "1.5", "-0.1", "NaN", "much"] {
        refused(&["serve", &wall, &scene, "--adaptive", share, "--listen", "127.0.0.1:0"], &["--adaptive", share]);
    }
    let listen = ["--listen", "127.0.0.1:0"];
    let budgets = [
        ("triangles", "0"),
        ("percent", "0"),
        ("percent", "100.5"),
        ("percent", "-1"),
        ("percent", "NaN"),
        ("ms", "0"),
        ("ms", "-2"),
    ];
    for (of, budget) in budgets.into_iter().chain([("ms", "soon"), ("ms", "60001")]) {
        let option = format!("--budget-{of}");
        refused(&[&["serve", &wall, &scene, &option, budget][..], &listen].concat(), &[&option, budget]);
    }
    for (a, b) in [("triangles", "ms"), ("percent", "ms"), ("percent", "triangles")] {
        let [a, b] = [a, b].map(|of| format!("--budget-{of}"));
        refused(&[&["serve", &wall, &scene, &a, "5", &b, "6"][..], &listen].concat(), &[&a, &b]);
        refused(&[&["serve", &wall, &scene, &a, "5"][..], &listen].concat(), &[&a, &scene, "no tessellation", "prepare --plp"]);
    }
    let budget = [&["serve", &wall, &scene, "--quality", "budget"][..], &listen].concat();
    let needed = ["--quality budget", &scene, "no tessellation", "mullion prepare --plp"];
    refused(&budget, &[&needed[..], &["--budget-ms"]].concat());
    refused(&[&budget[..], &["--budget-percent", "5"]].concat(), &[&needed[..], &["--budget-percent"]].concat());
    refused(&[&budget[..], &["--rate", "0"]].concat(), &["--quality budget", "--budget-ms"]);
    for pixels in ["-1", "NaN", "inf", "few"] {
        refused(&[&["serve", &wall, &scene, "--pixel-error", pixels][..], &listen].concat(), &["--pixel-error", pixels]);
    }
    refused(&[&["serve", &wall, &scene, "--lod-triangles", "0"][..], &listen].concat(), &["--lod-triangles", "0"]);
    for command in
        [[&["serve", &wall, &scene][..], &listen].concat(), vec!["demo", "--scene", &scene, "--out", &folder.path("demo")]]
    {
        let with = |options: &[&'static str]| [&command[..], options].concat();
        refused(&with(&["--pixel-error", "0"]), &["--pixel-error 0", "--lod-triangles"]);
        refused(&with(&["--no-lod-occlusion"]), &["--no-lod-occlusion", "--pixel-error"]);
        refused(&with(&["--quality", "best"]), &["--quality", "best", "exact"]);
        for given in [["--budget-percent", "5"], ["--budget-ms", "5"], ["--lod-triangles", "900"], ["--pixel-error", "1.0"]] {
            refused(&with(&[&["--quality", "exact"][..], &given].concat()), &["--quality exact", given[0]]);
        }
        let lod = ["--quality lod", &scene, "no hierarchies of detail", "mullion prepare --lod"];
        refused(&with(&["--quality", "lod"]), &[&lod[..], &["--pixel-error"]].concat());
        refused(&with(&["--quality", "lod", "--lod-triangles", "900"]), &[&lod[..], &["--lod-triangles"]].concat());
        refused(&with(&["--quality", "lod", "--pixel-error", "0"]), &["--pixel-error 0", "--lod-triangles"]);
        refused(&with(&["--lod-weight", "plenty"]), &["--lod-weight", "plenty", "nohc", "plp"]);
        for options in [&[][..], &["--pixel-error", "1.0"]] {
            for weight in ["nohc", "plp"] {
                refused(&with(&[options, &["--lod-weight", weight]].concat()), &["--lod-weight", "--lod-triangles"]);
            }
        }
        let blind = ["--lod-triangles", "900", "--no-lod-occlusion", "--lod-weight", "nohc"];
        refused(&with(&blind), &["--lod-weight", "--no-lod-occlusion"]);
        for options in
            [&["--pixel-error", "1.0"][..], &["--lod-triangles", "900"], &["--pixel-error", "0", "--lod-triangles", "900"]]
        {
            refused(&with(options), &[options[0], &scene, "no hierarchies of detail", "mullion prepare --lod"]);
        }
    }
    let weighed = [&["serve", &wall, &scene, "--lod-triangles", "900", "--lod-weight", "plp"][..], &listen].concat();
    refused(&weighed, &["--lod-weight plp", &scene, "no tessellation", "mullion prepare --plp"]);
    refused(&["serve", &wall], &["SCENE"]);
    refused(&["prepare", &scene, "--out", &folder.path("x"), "--leaf-triangles", "0"], &["--leaf-triangles"]);
    refused(&["generate", "village", "--out", &folder.path("x.glb")], &["village", "city"]);
    refused(&["path", "stroll", &scene, "--out", &folder.path("x")], &["stroll", "interior"]);
    refused(&["bench", "cull", &scene, "--grid", "17x1"], &["--grid", "17x1"]);
    refused(&["bench", "cull", &scene, "--frames", "0"], &["--frames"]);
    refused(&["bench", "cull", &scene, "--algorithm", "oh,fast"], &["--algorithm", "fast", "sweep"]);
    refused(&["bench", "cull", &scene, "--algorithm", "oh", "--slack"], &["--slack", "sweep"]);
    refused(&["bench", "cull", &scene, "--scene", &scene], &["two scenes", "good"]);
    refused(&["cull", &scene, "--wall", &wall, "--path", "pan", "--camera", "0,0,0"], &["--path", "--camera"]);
    let out = folder.path("x.glb");
    refused(&["generate", "boxes", "--leaves", "0", "--out", &out], &["--leaves", "1 to 10000000"]);
    refused(&["generate", "boxes", "--shape", "grid", "--out", &out], &["--shape", "grid", "flat, tree"]);
    refused(&["generate", "city", "--leaves", "5", "--out", &out], &["--leaves", "boxes"]);
    refused(&["generate", "plant", "--shape", "tree", "--out", &out], &["--shape", "boxes"]);
    assert!(!Path::new(&out).exists(), "nothing is left behind");
    refused(&["paint"], &["paint"]);
}

#[test]
fn paths_with_mistakes() {
    let folder = Folder::new();
    let (scene, wall) = (folder.path("good.gltf"), folder.path("good.toml"));
    let on_path = |path: &str, words: &[&str]| {
        let mut all = vec!["--path", path];
        all.extend(words);
        refused(&["cull", &scene, "--wall", &wall, "--path", path], &all);
        refused(&["bench", "cull", &scene, "--path", path], &all);
        refused(&["serve", &wall, &scene, "--listen", "127.0.0.1:0", "--path", path], &all);
        refused(&["demo", "--wall", &wall, "--out", &folder.path("demo"), "--scene", &scene, "--path", path], &all);
        assert!(!Path::new(&folder.path("demo")).exists(), "nothing is left behind");
    };
    on_path("stroll", &["stroll", "orbit", "whole", "No such file"]);
    on_path(&folder.path(""), &["directory"]);
    on_path(&folder.write("binary.path", [0xff, 0xfe, 0, 1]), &["UTF-8"]);
    on_path(&folder.write("prose.path", "go left\n"), &["line 1", "mullion-path 1"]);
    on_path(&folder.write("empty.path", "mullion-path 1\n"), &["no frames", "1000000"]);
    on_path(&folder.write("short.path", "mullion-path 1\n# one\n0 0 0 0 0 0 1\n"), &["line 3", "scale", "missing"]);
    on_path(&folder.write("wild.path", "mullion-path 1\n0 0 inf 0 0 0 1 1\n"), &["line 2", "translation z", "inf"]);
}

#[test]
fn files_that_cannot_be_written() {
    let folder = Folder::new();
    let (scene, wall) = (folder.path("good.gltf"), folder.path("good.toml"));
    let below_file = folder.path("good.gltf/out");
    refused(&["prepare", &scene, "--out", &below_file], &[&below_file]);
    refused(&["generate", "city", "--out", &below_file], &[&below_file]);
    refused(&["info", &scene, "--leaves", &below_file], &[&below_file]);
    refused(&["path", "pan", &scene, "--out", &below_file], &[&below_file]);
    refused(&["bench", "cull", &scene, "--json", &below_file], &[&below_file]);
    refused(&["bench", "cull", &scene, "--plots", &below_file], &[&below_file]);
    refused(&["cull", &scene, "--wall", &wall, "--json", &below_file], &[&below_file]);
    refused(&["demo", "--scene", &scene, "--wall", &wall, "--out", &below_file], &[&below_file]);
    let serve = ["serve", &wall, &scene, "--listen", "127.0.0.1:0", "--frames", "1", "--report", &below_file];
    refused(&serve, &[&below_file]);
}

#[test]
fn readers_that_have_had_enough() {
    let folder = Folder::new();
    let (scene, wall) = (folder.path("good.gltf"), folder.path("good.toml"));
    for args in
        [vec!["info", &scene], vec!["info", &scene, "--leaves", "-"], vec!["cull", &scene, "--wall", &wall, "--json", "-"]]
    {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let mut command = Command::new(env!("CARGO_BIN_EXE_mullion"));
        let done = command.args(&args).stdout(writer).output().expect("the binary starts");
        let err = String::from_utf8_lossy(&done.stderr);
        assert_eq!((done.status.code(), &*err), (Some(0), ""), "mullion {}", args.join(" "));
    }
}

#[test]
fn masters_and_tiles_that_do_not_find_each_other() {
    let folder = Folder::new();
    let (scene, wall, out) = (folder.path("good.gltf"), folder.path("good.toml"), folder.path("pictures"));
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("it is bound").to_string();
    refused(&["serve", &wall, &scene, "--listen", &address], &[&address, "in use"]);
    drop(taken);
    if !support::has_gpu() {
        return;
    }
    let alone =
        mullion(&["tile", "t0x0", "--master", &address, "--headless", &out, "--give-up-after", "0.2", "--cache-mib", "0"], LIMIT);
    let lines: Vec<&str> = alone.err.lines().collect();
    assert_eq!(alone.code, Some(2), "{}", alone.err);
    assert!(
        matches!(lines.as_slice(), [first, last] if first.contains("WARN") && last.starts_with("mullion: ")),
        "{}",
        alone.err
    );
    assert!(lines.iter().all(|line| line.contains(&address)), "it says at once, and again when it gives up: {}", alone.err);
    let mut serve = Process::start(&["serve", &wall, &scene, "--listen", "127.0.0.1:0"]);
    let address = support::address_of(&mut serve);
    refused(&["tile", "t9x9", "--master", &address, "--headless", &out, "--cache-mib", "0"], &["t9x9", "t0x0"]);
    assert!(serve.is_running(), "the master goes on");
}
