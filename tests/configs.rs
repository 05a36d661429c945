//! Every wall file that ships loads; what is wrong in one is told with its line, its key and what is allowed.

use mullion_common::wall::{Wall, WallConfig, WallError};

fn shipped() -> Vec<(String, String)> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/configs");
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .expect("configs/ is there")
        .map(|entry| entry.expect("a readable folder").path())
        .map(|path| (path.display().to_string(), std::fs::read_to_string(&path).expect("a readable file")))
        .collect();
    files.sort();
    files
}

fn wall(file: &str) -> Wall {
    let (_, text) = shipped().into_iter().find(|(path, _)| path.ends_with(file)).expect("the file ships");
    WallConfig::parse(&text).expect("it is a wall")
}

#[test]
fn every_config_loads() {
    let files = shipped();
    assert!(files.len() >= 6, "{files:?}");
    for (path, text) in files {
        WallConfig::parse(&text).unwrap_or_else(|e| panic!("{path}: {e}"));
    }
}

#[test]
fn grids_have_the_tiles_that_they_say() {
    let w = wall("wall_4x4.toml");
    assert_eq!(w.tiles().len(), 16);
    assert_eq!(w.tiles()[0].name, "t0x0");
    assert_eq!(w.tiles()[6].name, "t2x1", "row-major: column 2 of row 1");
    let (first, below, beside) = (&w.tiles()[0], &w.tiles()[4], &w.tiles()[1]);
    assert!(first.corners[0].y > below.corners[0].y, "row 0 is the top row");
    let gap_m = beside.corners[0].x - first.corners[1].x;
    assert!((gap_m - 0.0106).abs() < 1e-9, "a bezel lies between neighbours: {gap_m}");
    let bottom_right = w.tiles()[15].corners[1];
    assert!((bottom_right.x + w.tiles()[0].corners[0].x).abs() < 1e-9, "the wall is centred");
    assert_eq!(wall("wall_8x8.toml").tiles().len(), 64);
    let projectors = wall("projectors_3x2.toml");
    assert_eq!(projectors.nodes().len(), 2);
    assert_eq!(projectors.nodes()[1].tiles.len(), 3);
    let cave = wall("cave_4.toml");
    let names: Vec<_> = cave.tiles().iter().map(|t| t.name.as_str()).collect();
    assert_eq!(names, ["left", "front", "right", "floor"]);
}

/// Measured corners are never exactly square; what is culled and what is drawn must have one shape all the same.
#[test]
fn corners_that_are_nearly_square_are_squared() {
    let skewed = SCREEN.replacen("top_left = [-1.0, 1.0, 0.0]", "top_left = [-0.9992, 1.0, 0.0]", 1);
    let wall = WallConfig::parse(&skewed).expect("it is square enough");
    let [bottom_left, bottom_right, top_left] = wall.tiles()[0].corners;
    assert!((bottom_right - bottom_left).dot(top_left - bottom_left).abs() < 1e-12, "{top_left}");
    assert!((top_left - glam::DVec3::new(-1.0, 1.0, 0.0)).length() < 1e-6, "{top_left}");
}

const GRID: &str = "\n[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [1.0, 0.75]\n";
const SCREEN: &str = "eye = [0.0, 1.0, 2.0]\n[[screens]]\nname = \"a\"\nbottom_left = [-1.0, 0.0, 0.0]\nbottom_right = [1.0, 0.0, 0.0]\ntop_left = [-1.0, 1.0, 0.0]\ntile_px = [64, 48]\n";

fn refused(text: &str) -> WallError {
    WallConfig::parse(text).expect_err("it is no wall")
}

/// Each mistake, the line that it stands on, and words that the message must have.
#[test]
fn mistakes_are_told_with_line_key_and_rule() {
    let cases: &[(&str, &str, &str, usize, &[&str])] = &[
        (GRID, "columns = 2", "colums = 2", 3, &["colums", "columns"]),
        (GRID, "columns = 2\n", "", 2, &["columns", "missing"]),
        (GRID, "columns = 2", "columns = 0", 3, &["grid.columns", "1 to 256"]),
        (GRID, "rows = 1", "rows = 129", 2, &["258 tiles", "256"]),
        (GRID, "rows = 1", "rows = 1000", 4, &["grid.rows", "1 to 256"]),
        (GRID, "[1.0, 0.75]", "[-1.0, 0.75]", 6, &["grid.tile_m", "-1", "0.0001"]),
        (GRID, "[64, 48]", "[64, -48]", 5, &["grid.tile_px", "-48", "16384"]),
        (GRID, "[64, 48]", "\"64x48\"", 5, &["tile_px", "array of length 2"]),
        (GRID, "\n[grid]", "near_m = -1\n[grid]", 1, &["near_m", "0.0001 to 100"]),
        (GRID, "\n[grid]", "rate_hz = nan\n[grid]", 1, &["rate_hz", "1 to 1000"]),
        (GRID, "\n[grid]", "eye = [0.0, 0.0, -3.0]\n[grid]", 1, &["mirrored"]),
        (GRID, "[grid]", "[grid", 2, &["]"]),
        (SCREEN, "eye = [0.0, 1.0, 2.0]\n", "", 1, &["eye", "missing"]),
        (SCREEN, "[1.0, 0.0, 0.0]", "[-3.0, 0.0, 0.0]", 5, &["screens.a.bottom_right", "mirrored"]),
        (SCREEN, "[-1.0, 1.0, 0.0]", "[-0.5, 1.0, 0.0]", 6, &["screens.a.top_left", "right angles"]),
        (SCREEN, "[1.0, 0.0, 0.0]", "[-1.0, 0.0, 0.0]", 5, &["screens.a", "coincide"]),
        (SCREEN, "name = \"a\"", "name = \"a/b\"", 3, &["screens.name", "letters"]),
        (SCREEN, "tile_px", "bezel_m = [3.0, 0.0]\ncolumns = 2\ntile_px", 7, &["bezel_m", "no room"]),
        (
            SCREEN,
            "tile_px = [64, 48]",
            "tile_px = [64, 48]\n[[nodes]]\nname = \"pc\"\ntiles = [\"b\"]",
            10,
            &["nodes.pc.tiles", "\"b\" is no tile", "a"],
        ),
        (
            SCREEN,
            "tile_px = [64, 48]",
            "tile_px = [64, 48]\n[[nodes]]\nname = \"pc\"\ntiles = [\"a\", \"a\"]",
            10,
            &["driven twice"],
        ),
    ];
    for (base, from, to, line, words) in cases {
        assert!(base.contains(from), "the case changes nothing: {from:?}");
        let text = base.replacen(from, to, 1);
        let error = refused(&text);
        assert_eq!(error.line, *line, "{error}\n{text}");
        for word in *words {
            assert!(error.to_string().contains(word), "{word:?} is not in: {error}");
        }
    }
    let twice = format!("{SCREEN}{}", SCREEN.split_once('\n').expect("two lines").1);
    let error = refused(&twice);
    assert!(error.to_string().contains("two screens are called \"a\""), "{error}");
    assert_eq!(error.line, 9);
    assert!(refused("").to_string().contains("[grid]"));
}
