//! A wall of sixteen processes: one tile is killed in the middle of the show and started again.
//!
//! Goal: the show goes on to its end without the tile, and the tile that comes back shows the last frame, pixel for
//! pixel as it would have without the mishap. Method: two shows of the same walk over loopback sockets, one undisturbed.

mod support;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use image::RgbaImage;
use support::Process;

const COLUMNS: usize = 4;
const ROWS: usize = 4;
const FRAMES: u64 = 120;
/// Slow enough that a debug build on two cores keeps up, so that the tile comes back well before the end.
const RATE_HZ: &str = "10";
/// How long a frame waits for a node that is late but alive: a busy machine must not decide the outcome.
const BARRIER_MS: &str = "5000";
const LIMIT: Duration = Duration::from_secs(90);
const VICTIM: &str = "t1x1";

/// Boxes in rows, each a node with a mesh of its own colour, so that every tile has something of its own to show.
fn scene(folder: &Path) -> PathBuf {
    let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2].map(|bit| bit as f32 - 0.5);
    let faces: [u16; 36] =
        [0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5];
    let mut bytes: Vec<u8> = (0..8).flat_map(corner).flat_map(f32::to_le_bytes).collect();
    bytes.extend(faces.iter().flat_map(|i| i.to_le_bytes()));
    let materials = (0..6).map(|m| {
        let [r, g, b] = [m & 1, m >> 1 & 1, m >> 2].map(|bit| 0.2 + 0.7 * f64::from(bit));
        serde_json::json!({"pbrMetallicRoughness": {"baseColorFactor": [r, g, b, 1.0]}})
    });
    let meshes =
        (0..6).map(|m| serde_json::json!({"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": m}]}));
    let nodes: Vec<_> = (0..10 * 10)
        .map(|i| {
            let [x, z] = [f64::from(i % 10), f64::from(i / 10)];
            let height = 1.0 + f64::from(i * 7 % 5);
            serde_json::json!({"mesh": i % 6, "translation": [2.0 * x, height * 0.5, 2.0 * z], "scale": [1.0, height, 1.0]})
        })
        .collect();
    let roots: Vec<usize> = (0..nodes.len()).collect();
    let gltf = serde_json::json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": roots}], "nodes": nodes,
        "meshes": meshes.collect::<Vec<_>>(), "materials": materials.collect::<Vec<_>>(),
        "buffers": [{"byteLength": bytes.len(), "uri": "boxes.bin"}],
        "bufferViews": [{"buffer": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 72}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [-0.5, -0.5, -0.5], "max": [0.5, 0.5, 0.5]},
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
    });
    let path = folder.join("boxes.gltf");
    fs::write(folder.join("boxes.bin"), bytes).expect("written");
    fs::write(&path, gltf.to_string()).expect("written");
    path
}

fn wall(folder: &Path) -> PathBuf {
    let path = folder.join("wall.toml");
    let text = format!("[grid]\ncolumns = {COLUMNS}\nrows = {ROWS}\ntile_px = [48, 32]\ntile_m = [0.48, 0.32]\n");
    fs::write(&path, text).expect("written");
    path
}

fn tile_names() -> Vec<String> {
    (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| format!("t{column}x{row}"))).collect()
}

/// A show under way.
struct Show {
    serve: Process,
    address: String,
    pictures: PathBuf,
    report: PathBuf,
    tiles: Vec<(String, Process)>,
}

impl Show {
    fn start(folder: &Path, name: &str) -> Self {
        let (scene, wall) = (scene(folder), wall(folder));
        let (pictures, report) = (folder.join(name), folder.join(format!("{name}.json")));
        let frames = FRAMES.to_string();
        let files = [&wall, &scene, &report].map(|p| p.display().to_string());
        let [wall, scene, report_arg] = &files;
        let args = [
            "serve",
            wall,
            scene,
            "--listen",
            "127.0.0.1:0",
            "--frames",
            &frames,
            "--rate",
            RATE_HZ,
            "--barrier",
            BARRIER_MS,
            "--wait",
            "60",
            "--report",
            report_arg,
        ];
        let mut serve = Process::start(&args);
        let address = support::address_of(&mut serve);
        let mut show = Self { serve, address, pictures, report, tiles: Vec::new() };
        for tile in tile_names() {
            let process = show.start_tile(&tile);
            show.tiles.push((tile, process));
        }
        show
    }

    fn start_tile(&self, name: &str) -> Process {
        let pictures = self.pictures.display().to_string();
        Process::start(&[
            "tile",
            name,
            "--master",
            &self.address,
            "--headless",
            &pictures,
            "--give-up-after",
            "20",
            "--cache-mib",
            "0",
            "--missing",
            "hold",
        ])
    }

    /// Waits until the master says that so many frames were shown.
    fn reaches(&mut self, frame: u64) {
        let number = |line: &str| -> Option<u64> { line.strip_prefix("frame ")?.split_once(" of ")?.0.parse().ok() };
        self.serve.until(&format!("frame {frame}"), LIMIT, |serve| {
            serve.err.lines().iter().filter_map(|line| number(line)).any(|shown| shown >= frame)
        });
    }

    /// Waits for the end and gives the report and each tile's last picture.
    fn end(mut self) -> (serde_json::Value, Vec<(String, RgbaImage)>) {
        assert_eq!(self.serve.wait(LIMIT), Some(0), "{}", self.serve.err.text());
        for (name, tile) in &mut self.tiles {
            assert_eq!(tile.wait(LIMIT), Some(0), "{name}: {}", tile.err.text());
        }
        let report = fs::read(&self.report).expect("the report is there");
        let picture = |name: String| {
            let path = self.pictures.join(format!("{name}.png"));
            let picture = image::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            (name, picture.into_rgba8())
        };
        (serde_json::from_slice(&report).expect("it is JSON"), tile_names().into_iter().map(picture).collect())
    }
}

fn passed_over(report: &serde_json::Value, tile: &str) -> u64 {
    let tiles = report["tiles"].as_array().expect("a list");
    let found = tiles.iter().find(|t| t["tile"] == tile).expect("every tile is listed");
    found["passed_over"].as_u64().expect("a count")
}

#[test]
fn a_killed_tile_stops_nobody_and_comes_back_in_the_picture() {
    if !support::has_gpu() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let (calm_report, calm) = Show::start(folder.path(), "calm").end();
    assert_eq!(calm_report["frames"], FRAMES);

    let mut show = Show::start(folder.path(), "disturbed");
    for tile in tile_names() {
        show.serve.error_line(&[&format!("node {tile} joined")], 0, LIMIT);
    }
    show.reaches(FRAMES / 4);
    let at = tile_names().iter().position(|name| name == VICTIM).expect("it is a tile");
    show.tiles[at].1.kill();
    let (left, line) = show.serve.error_line(&[&format!("node {VICTIM} left")], 0, LIMIT);
    assert!(line.contains("connection lost"), "{line}");
    assert!(!show.pictures.join(format!("{VICTIM}.png")).exists(), "it had no time to write its picture");
    show.reaches(FRAMES / 2);
    show.tiles[at].1 = show.start_tile(VICTIM);
    show.serve.error_line(&[&format!("node {VICTIM} joined")], left, LIMIT);

    let (report, pictures) = show.end();
    assert_eq!(report["frames"], FRAMES, "the show went on to its end");
    assert!(passed_over(&report, VICTIM) <= 2, "its death holds up the wall once at most, and so does its return: {report}");
    for tile in tile_names().iter().filter(|name| *name != VICTIM) {
        assert_eq!(passed_over(&report, tile), 0, "{tile} did nothing wrong: {report}");
    }
    for ((name, calm), (_, picture)) in calm.iter().zip(&pictures) {
        assert!(calm.pixels().any(|p| p != calm.get_pixel(0, 0)), "{name} shows nothing");
        assert!(calm == picture, "{name}: its last frame differs from that of the undisturbed show");
    }
}
