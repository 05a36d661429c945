//! `mullion bench`, `mullion path` and pictures from above as users run them: the right files with the right counts. Times are never
//! looked at.

mod support;

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::time::Duration;

use mullion_common::camera_path::CameraPath;
use serde_json::Value;
use support::mullion;
use tempfile::TempDir;

/// Generous for a debug build on a busy machine; a hang is longer.
const LIMIT: Duration = Duration::from_secs(60);

const CORNERS: u32 = 3;

/// Nine triangles in a row, each a node of its own: nine leaves.
fn row_of_triangles(folder: &Path) -> String {
    let corners: [f32; 9] = [0.0, 0.0, -2.0, 1.0, 0.0, -2.0, 0.0, 1.0, -2.5];
    let bytes: Vec<u8> = corners.iter().flat_map(|c| c.to_le_bytes()).collect();
    fs::write(folder.join("row.bin"), &bytes).expect("written");
    let nodes: Vec<String> = (0..9).map(|i| format!("{{\"mesh\":0,\"translation\":[{},0,{}]}}", i * 2, i % 2)).collect();
    let gltf = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1,2,3,4,5,6,7,8]}}],"nodes":[{}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":{CORNERS},"type":"VEC3","min":[0,0,-2.5],"max":[1,1,-2]}}],
"bufferViews":[{{"buffer":0,"byteLength":36}}],"buffers":[{{"byteLength":36,"uri":"row.bin"}}]}}"#,
        nodes.join(",")
    );
    let path = folder.join("row.gltf");
    fs::write(&path, gltf).expect("written");
    path.display().to_string()
}

/// Runs a command that must succeed; gives what it printed.
#[track_caller]
fn done(args: &[&str]) -> String {
    let outcome = mullion(args, LIMIT);
    assert_eq!((outcome.code, outcome.err.as_str()), (Some(0), ""), "mullion {}", args.join(" "));
    outcome.out
}

#[test]
fn every_algorithm_is_measured_on_every_wall() {
    let folder = TempDir::new().expect("a folder");
    let scene = row_of_triangles(folder.path());
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (json, plots) = (at("bench.json"), at("plots"));
    let out = done(&[
        "bench",
        "cull",
        &scene,
        "--grid",
        "1x1,3x2",
        "--frames",
        "5",
        "--threads",
        "1,2",
        "--slack",
        "--json",
        &json,
        "--plots",
        &plots,
    ]);
    let names = ["naive", "oh-plain", "fh", "oh", "adaptive", "adaptive-grouped", "sweep", "sweep/2", "sweep+slack"];
    let report: Value = serde_json::from_str(&fs::read_to_string(&json).expect("it was written")).expect("JSON");
    assert!(report["machine"]["cores"].as_u64().is_some_and(|n| n > 0) && report["machine"]["cpu"].is_string(), "{report}");
    let tables = report["tables"].as_array().expect("tables");
    let walls: Vec<_> = tables.iter().map(|t| (t["grid"].as_str().expect("a grid"), t["tiles"].as_u64())).collect();
    assert_eq!(walls, [("1x1", Some(1)), ("3x2", Some(6))]);
    for table in tables {
        assert_eq!((table["scene"].as_str(), table["path"].as_str()), (Some("row"), Some("whole")));
        assert_eq!((table["leaves"].as_u64(), table["frames"].as_u64()), (Some(9), Some(5)));
        let rows = table["rows"].as_array().expect("rows");
        let found: Vec<_> = rows.iter().map(|row| row["name"].as_str().expect("a name")).collect();
        assert_eq!(found, names);
        for row in rows {
            let number = |key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key}: {row}"));
            assert_eq!(row["frame_us"].as_array().map(Vec::len), Some(5));
            assert!(number("leaf_tile_pairs") >= 9.0, "the whole scene is in view: {row}");
            assert!(number("ranges") >= 1.0 && number("nodes_visited") >= 1.0 && number("plane_tests") >= 1.0, "{row}");
            assert!(number("median_over_oh") > 0.0 && number("median_over_adaptive") > 0.0, "{row}");
            assert!(number("excess_percent") >= 0.0, "{row}");
        }
        let of = |name: &str| rows.iter().find(|row| row["name"] == *name).map(|row| &row["leaf_tile_pairs"]);
        assert_eq!(of("naive"), of("oh"), "they make the same tests");
        assert_eq!(of("sweep"), of("sweep+slack"), "slack gives the same sets");
        assert_eq!(of("sweep"), of("sweep/2"));
    }
    assert!(names.iter().all(|name| out.contains(name)) && out.contains("median µs"), "{out}");
    let files = fs::read_dir(&plots).expect("a folder").map(|entry| entry.expect("an entry").file_name().into_string());
    let files: BTreeSet<String> = files.map(|name| name.expect("UTF-8")).collect();
    assert_eq!(files.into_iter().collect::<Vec<_>>(), ["row-1x1-frames.svg", "row-3x2-frames.svg", "row-tiles.svg"]);
}

#[test]
fn chosen_algorithms_alone_are_measured() {
    let folder = TempDir::new().expect("a folder");
    let scene = row_of_triangles(folder.path());
    let out =
        done(&["bench", "cull", "--scene", &scene, "--grid", "2x2", "--algorithm", "sweep,fh", "--frames", "2", "--json", "-"]);
    let report: Value = serde_json::from_str(&out).expect("JSON and nothing else");
    let rows = report["tables"][0]["rows"].as_array().expect("rows");
    assert_eq!(rows.iter().map(|row| row["name"].as_str()).collect::<Vec<_>>(), [Some("sweep"), Some("fh")]);
    assert!(rows.iter().all(|row| row["median_over_oh"].is_null() && row["median_over_adaptive"].is_null()));
}

#[test]
fn a_written_path_is_walked_again() {
    let folder = TempDir::new().expect("a folder");
    let scene = row_of_triangles(folder.path());
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (path, wall) = (at("pan.path"), at("wall.toml"));
    fs::write(&wall, "[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [1.0, 0.75]\n").expect("written");
    let out = done(&["path", "pan", &scene, "--wall", &wall, "--frames", "4", "--out", &path]);
    assert!(out.contains("4 frames"), "{out}");
    let text = fs::read_to_string(&path).expect("it was written");
    assert_eq!(CameraPath::parse(&text).expect("a path").poses().len(), 4);
    assert_eq!(done(&["path", "pan", &scene, "--wall", &wall, "--frames", "4", "--out", "-"]), text);
    let eye = |path: &str, frame: &str| {
        let out = done(&["cull", &scene, "--wall", &wall, "--path", path, "--frame", frame, "--json", "-"]);
        let report: Value = serde_json::from_str(&out).expect("JSON");
        report["views"][0]["bottom_left"].clone()
    };
    assert_eq!(eye(&path, "2"), eye("pan", "2"), "the file is the walk");
    assert_eq!(eye(&path, "6"), eye(&path, "2"), "past its end it begins anew");
    assert_ne!(eye(&path, "1"), eye(&path, "2"));
    let report: Value = serde_json::from_str(&done(&[
        "bench",
        "cull",
        &scene,
        "--path",
        &path,
        "--grid",
        "1x1",
        "--algorithm",
        "oh",
        "--json",
        "-",
    ]))
    .expect("JSON");
    assert_eq!(report["tables"][0]["frames"].as_u64(), Some(4), "as many as the file has");
}

/// Pixels that are as yellow as what is left out; and all of them.
fn yellow(file: &Path) -> (usize, usize) {
    let picture = image::open(file).unwrap_or_else(|e| panic!("{}: {e}", file.display())).into_rgb8();
    let is_yellow = |[red, green, blue]: [u8; 3]| red > 150 && green > 120 && blue < green / 2;
    (picture.pixels().filter(|pixel| is_yellow(pixel.0)).count(), picture.pixels().len())
}

#[test]
fn what_is_left_out_is_yellow_from_above() {
    if !support::has_gpu() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let picture = |name: &str, scenes: &str, mode: &str| {
        let file = folder.path().join(name);
        let shown = file.display().to_string();
        let args = ["--path", "interior", "--size", "64x48", "--frames", "2", "--scene", scenes, "--mode", mode];
        let out = done(&[&["bench", "occlusion", "--birdseye", &shown], &args[..]].concat());
        (file, out)
    };
    let (file, out) = picture("plain.png", "boxes:500", "frustum");
    let (plain, pixels) = yellow(&file);
    assert!(plain == 0 && pixels > 500_000, "{plain} of {pixels}");
    assert!(out.contains(": 0 of the "), "{out}");
    // Of two scenes, each has its own.
    let (file, out) = picture("culled.png", "boxes:500,boxes:300", "paper,hiz");
    assert!(!file.exists() && out.contains("occlusion culling hiz"), "{out}");
    for scene in ["500", "300"] {
        let (culled, _) = yellow(&folder.path().join(format!("culled-boxes-{scene}.png")));
        assert!(culled > 100, "{culled}");
    }
}

#[test]
fn a_show_is_seen_from_above() {
    if !support::has_gpu() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    for (way, is_culled) in [("none", false), ("hiz", true)] {
        let (file, out) = (at(&format!("{way}.png")), at(way));
        let args = ["--scene", "boxes:500", "--path", "interior", "--frames", "3", "--grid", "2x1", "--out", &out];
        let said = done(&[&["demo", "--occlusion", way, "--birdseye", &file], &args[..]].concat());
        let (pixels, _) = yellow(Path::new(&file));
        assert_eq!((pixels > 100, said.contains(&file)), (is_culled, true), "{pixels} with {way}: {said}");
    }
}

#[test]
fn a_picture_that_has_nowhere_to_go_ends_the_work_before_it_begins() {
    let folder = TempDir::new().expect("a folder");
    let (nowhere, out) =
        (folder.path().join("none/x.png").display().to_string(), folder.path().join("demo").display().to_string());
    for args in [&["bench", "occlusion", "--scene", "boxes:1000"][..], &["demo", "--out", &out]] {
        for (file, why) in [(nowhere.as_str(), nowhere.as_str()), ("-", "not to standard output")] {
            let outcome = mullion(&[args, &["--birdseye", file]].concat(), LIMIT);
            assert!(
                outcome.code != Some(0) && outcome.err.contains("--birdseye") && outcome.err.contains(why),
                "{}",
                outcome.err
            );
            assert_eq!(outcome.out, "", "it had not begun");
        }
    }
}

#[test]
fn ways_to_cull_what_is_hidden_are_held_against_frustum_culling() {
    if !support::has_gpu() {
        return;
    }
    let folder = TempDir::new().expect("a folder");
    let plots = folder.path().join("plots");
    let (json, shown) = (folder.path().join("figures.json"), plots.display().to_string());
    let json_shown = json.display().to_string();
    let scene = ["--scene", "boxes:500", "--path", "interior", "--size", "96x80", "--frames", "4"];
    let rest = ["--threshold", "0,0.05", "--json", &json_shown, "--plots", &shown];
    let out = done(&[&["bench", "occlusion"], &scene[..], &rest[..]].concat());
    let figures: Value = serde_json::from_slice(&fs::read(&json).expect("figures")).expect("JSON");
    let rows = figures["tables"][0]["rows"].as_array().expect("rows");
    let value = |mode: &str, key: &str| {
        let row = rows.iter().find(|row| row["mode"] == mode).unwrap_or_else(|| panic!("{mode} in {out}"));
        row[key].as_f64().unwrap_or_else(|| panic!("{mode}: {key}"))
    };
    for mode in ["perfect", "paper", "cost-adaptive", "query", "hiz"] {
        assert_eq!(value(mode, "wrong_pixels"), 0.0, "{mode}: {out}");
    }
    for mode in ["paper", "query", "hiz"] {
        assert!(value(mode, "culled_percent") > value("frustum", "culled_percent"), "{mode}: {out}");
        assert!(value(mode, "culled_percent") <= value("perfect", "culled_percent"), "{mode}: {out}");
        assert!(value(mode, "tests") > 0.0, "{mode}: {out}");
    }
    // What contributes nothing is hidden; more goes, and shows, the more may.
    assert_eq!(value("adaptive 0", "wrong_pixels"), 0.0, "{out}");
    assert!(value("adaptive 0.05", "wrong_pixels") > 0.0, "{out}");
    assert!(value("adaptive 0.05", "culled_percent") > value("adaptive 0", "culled_percent"), "{out}");
    for figure in ["frame-rate", "culled", "threshold"] {
        let file = plots.join(format!("boxes-500-{figure}.svg"));
        assert!(fs::read_to_string(&file).expect("a figure").contains("<svg"), "{}", file.display());
    }
    let refused = mullion(&["bench", "occlusion", "--mode", "hizz"], LIMIT);
    assert!(refused.code != Some(0) && refused.err.contains("hiz"), "{}", refused.err);
}

#[test]
fn level_of_detail_is_measured_without_occlusion_and_with() {
    let report =
        level_of_detail("organic", &["--triangles", "2000", "--size", "128", "--frames", "2", "--bounds", "link,cylinder"]);
    let table = &report["tables"][0];
    assert_eq!((table["triangles"].as_u64(), table["budget"].as_u64()), (Some(345_944), Some(2000)));
    let ways = table["ways"].as_array().expect("ways");
    assert_eq!(
        ways.iter().map(|way| way["name"].as_str()).collect::<Vec<_>>(),
        [Some("without"), Some("link"), Some("cylinder")]
    );
    let first = |way: usize, key: &str| ways[way][key][0].as_u64().unwrap_or_else(|| panic!("{key}: {table}"));
    for way in 0..3 {
        assert!((1980..=2000).contains(&first(way, "triangles")) && first(way, "visible") > 200, "{way}: {table}");
        assert_eq!(first(way, "questions") > 0, way > 0);
    }
    assert!(first(1, "visible") > first(0, "visible") && first(2, "visible") > first(0, "visible"), "it hides itself");
    let off = &table["fine"]["error"];
    assert!(off["all"]["p99_px"].as_f64().is_some_and(|px| px < 1.5), "{off}");
    assert_eq!(off["all"], off["simplified"], "there is nothing else");
}

/// A scene without a tessellation gets one, and a budget goes where more is likely seen: in a row, to the first.
#[test]
fn level_of_detail_by_estimates_is_measured() {
    let visible = |weight: &str| {
        let view = ["--view", "armadillo-group", "--triangles", "2000", "--size", "256", "--frames", "1", "--bounds", "link"];
        let report = level_of_detail("organic", &[&view[..], &["--lod-weight", weight]].concat());
        report["tables"][0]["ways"][1]["visible"][0].as_u64().expect("a number")
    };
    let [alike, by_estimates] = ["none", "plp"].map(visible);
    assert!(by_estimates > alike, "{alike}, {by_estimates}");
}

#[test]
fn queries_say_what_is_hidden_beside_depths() {
    for options in [["--no-gpu", "--frames", "1"], ["--lod-weight", "nohc", "--no-gpu"]] {
        let refused = mullion(&[&["bench", "lod", "--scene", "organic", "--answers", "queries"], &options[..]].concat(), LIMIT);
        let option = if options.contains(&"nohc") { "--lod-weight" } else { "--answers" };
        assert!(refused.code != Some(0) && refused.err.contains(option), "{}", refused.err);
    }
    if !support::has_gpu() {
        return;
    }
    let options =
        ["--triangles", "2000", "--size", "128", "--frames", "2", "--bounds", "cylinder,link", "--answers", "depths,queries"];
    let folder = TempDir::new().expect("a folder");
    let plots = folder.path().to_str().expect("a name");
    let out = done(&[&["bench", "lod", "--scene", "organic", "--json", "-", "--plots", plots], &options[..]].concat());
    let report: Value = serde_json::from_str(&out).expect("JSON and nothing else");
    for (way, from) in [("without", ""), ("link", ""), ("link", "-above"), ("cylinder-queries", "-aside")] {
        let picture = image::open(folder.path().join(format!("scene-{way}{from}.png"))).expect("a picture").to_rgb8();
        assert_eq!(picture.dimensions(), (128, 128));
        let background = picture.get_pixel(0, 0);
        assert!(picture.pixels().filter(|pixel| *pixel != background).count() > 500, "{way}{from} shows something");
    }
    let ways = report["tables"][0]["ways"].as_array().expect("ways");
    let names: Vec<_> = ways.iter().filter_map(|way| way["name"].as_str()).collect();
    assert_eq!(names, ["without", "cylinder", "link", "cylinder-queries", "link-queries"]);
    let of = |way: usize, key: &str, frame: usize| ways[way][key][frame].as_u64().unwrap_or_else(|| panic!("{key}: {out}"));
    for (way, frame) in (1..5).flat_map(|way| [(way, 0), (way, 1)]) {
        assert!((1980..=2000).contains(&of(way, "triangles", frame)), "{}: {out}", names[way]);
        assert!(of(way, "visible", frame) > of(0, "visible", frame), "{}: {out}", names[way]);
    }
    assert!((3..5).all(|way| of(way, "questions", 1) > 100), "each frame asks anew: {out}");
}

/// Refined until surfaces are wrong by a pixel at most, pictures are off by little more, whatever the model and the form.
#[test]
fn pictures_are_as_good_as_the_pixels_that_are_asked_for() {
    let files = [
        "cad_2cylinder_engine.glb",
        "bim_clinic.glb",
        "city_linz_centre.glb",
        "city_denhaag.glb",
        "forest_black_forest.glb",
        "scan_armadillo_86k.glb",
    ];
    let scenes = support::models(&files).into_iter().map(|path| path.display().to_string()).chain(["hills".to_owned()]);
    let (mut well_seen, mut all) = (0, 0);
    for scene in scenes {
        let report =
            level_of_detail(&scene, &["--frames", "1", "--bounds", "link", "--size", "1024", "--form", "vertices,clusters"]);
        let tables = report["tables"].as_array().expect("tables");
        assert_eq!(tables.len(), 2);
        all += tables.len();
        for table in tables {
            let fine = &table["fine"];
            assert!(fine["triangles"].as_u64().is_some_and(|triangles| triangles > 500), "{}: {fine}", table["scene"]);
            assert!(fine["error"]["all"]["p99_px"].as_f64().is_some_and(|px| px <= 1.5), "{}: {fine}", table["scene"]);
            // Of few pixels a percentile says little.
            let of = &fine["error"]["simplified"];
            if of["pixels"].as_u64().is_some_and(|pixels| pixels >= 1000) {
                assert!(of["p99_px"].as_f64().is_some_and(|px| px <= 1.5), "{}: {fine}", table["scene"]);
                well_seen += 1;
            }
        }
    }
    assert!(well_seen * 4 >= all * 3, "what is simplified is seen in {well_seen} of {all}");
}

#[test]
fn pictures_of_nothing_drawn_are_refused() {
    let folder = TempDir::new().expect("a folder");
    let plots = folder.path().join("plots");
    let refused = mullion(&["bench", "lod", "--scene", "hills", "--no-gpu", "--plots", plots.to_str().expect("a name")], LIMIT);
    assert!(refused.code != Some(0) && refused.err.contains("--plots"), "{}", refused.err);
}

fn level_of_detail(scene: &str, options: &[&str]) -> Value {
    let out = done(&[&["bench", "lod", "--scene", scene, "--no-gpu", "--json", "-"], options].concat());
    serde_json::from_str(&out).expect("JSON and nothing else")
}
