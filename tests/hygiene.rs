//! What the repository promises about itself: the map names what is there, one place names each outside crate, files
//! stay readable, and nothing is left to be done later.

use std::fs;
use std::path::{Path, PathBuf};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const MAX_MAP_LINES: usize = 200;
const MAX_FILE_LINES: usize = 700;

/// Where each outside crate may be named; everywhere else it must not be.
const HOMES: [(&str, &str); 12] = [
    ("bincode", "common/src/wire"),
    ("wgpu", "client/src/gpu"),
    ("obvhs", "server/src/tree/regroup.rs"),
    ("simple_delaunay_lib", "server/src/prepare/plp/delaunay.rs"),
    ("winit", "client/src/output"),
    ("plotters", "src/plot.rs"),
    ("rcgen", "server/src/enroll.rs"),
    ("webpki", "common/src/identity.rs"),
    ("axum", "server/src/control/http.rs"),
    ("hyper", "server/src/control/http.rs"),
    ("tungstenite", "client/control/src/lib.rs"),
    ("prometheus_client", "server/src/metrics.rs"),
];

/// What has two places. TLS is where connections are opened, on either side, and nowhere else, but for what both sides share of it.
const TWO_HOMES: [(&str, [&str; 2]); 3] = [
    ("rustls", ["server/src/service/transport.rs", "common/src/tls.rs"]),
    ("tokio_rustls", ["server/src/service/transport.rs", "client/src/transport.rs"]),
    ("meshopt", ["server/src/prepare/gltf", "server/src/prepare/lod/clusters/meshing.rs"]),
];

/// No runtime in here: cores without sockets and clocks.
const WITHOUT_TOKIO: [&str; 4] = ["common", "server/src/master", "server/src/swap_barrier.rs", "client/src/tile_session"];

/// Folders and files that are no part of the repository.
const OTHERS: [&str; 4] = [".git", "target", "demo", "corpus"];

/// All files of the repository below a path, relative to the root, sorted.
fn files_below(below: &str) -> Vec<PathBuf> {
    let mut open = vec![Path::new(ROOT).join(below)];
    let mut files = Vec::new();
    while let Some(path) = open.pop() {
        if path.is_dir() {
            let entries = fs::read_dir(&path).expect("a readable folder").map(|e| e.expect("a readable entry").path());
            let is_ours = |path: &PathBuf| !path.file_name().is_some_and(|name| OTHERS.iter().any(|other| name == *other));
            open.extend(entries.filter(is_ours));
        } else {
            files.push(path.strip_prefix(ROOT).expect("it is below the root").to_owned());
        }
    }
    files.sort();
    files
}

fn text(path: &Path) -> String {
    String::from_utf8_lossy(&fs::read(Path::new(ROOT).join(path)).expect("a readable file")).into_owned()
}

/// Rust files of the libraries and the binary, without tests, benches and examples.
fn sources() -> Vec<PathBuf> {
    let trees = ["src", "common/src", "server/src", "client/src", "client/control/src"];
    let files = trees.iter().flat_map(|tree| files_below(tree));
    files.filter(|path| path.extension().is_some_and(|e| e == "rs")).collect()
}

/// Lines that name a crate in code, comments aside.
fn lines_naming(name: &str, path: &Path) -> Vec<String> {
    let is_word = |line: &str, at: usize| {
        let edge = |c: Option<char>| c.is_none_or(|c| !(c.is_alphanumeric() || c == '_'));
        edge(line[..at].chars().next_back()) && edge(line[at + name.len()..].chars().next())
    };
    let text = text(path);
    let code = text.lines().enumerate().map(|(i, line)| (i + 1, line.split("//").next().unwrap_or_default()));
    code.filter(|(_, line)| line.match_indices(name).any(|(at, _)| is_word(line, at)))
        .map(|(number, line)| format!("{}:{number}: {}", path.display(), line.trim()))
        .collect()
}

#[test]
fn one_place_names_each_outside_crate() {
    let sources = sources();
    assert!(sources.len() > 50, "the sources were found");
    for (name, home) in HOMES {
        let (at_home, elsewhere): (Vec<_>, Vec<_>) = sources.iter().partition(|path| path.starts_with(home));
        assert!(at_home.iter().any(|path| !lines_naming(name, path).is_empty()), "{home} does not name {name} any more");
        let strangers: Vec<String> = elsewhere.iter().flat_map(|path| lines_naming(name, path)).collect();
        assert!(strangers.is_empty(), "{name} is for {home} alone:\n{}", strangers.join("\n"));
    }
    for (name, homes) in TWO_HOMES {
        let elsewhere = sources.iter().filter(|path| !homes.iter().any(|home| path.starts_with(home)));
        let strangers: Vec<String> = elsewhere.flat_map(|path| lines_naming(name, path)).collect();
        assert!(strangers.is_empty(), "{name} is for {homes:?} alone:\n{}", strangers.join("\n"));
        let is_named = |home: &&str| sources.iter().any(|path| path.starts_with(home) && !lines_naming(name, path).is_empty());
        assert!(homes.iter().all(is_named), "{homes:?}: {name} is gone");
    }
}

#[test]
fn cores_know_no_runtime_and_sides_stay_apart() {
    for place in WITHOUT_TOKIO {
        let files = files_below(place);
        assert!(!files.is_empty(), "{place} is gone: correct this list");
        let rust = files.iter().filter(|path| path.extension().is_some_and(|e| e == "rs" || e == "toml"));
        let naming: Vec<String> = rust.flat_map(|path| lines_naming("tokio", path)).collect();
        assert!(naming.is_empty(), "{place} runs without tokio:\n{}", naming.join("\n"));
    }
    for (manifest, stranger) in [("server/Cargo.toml", "wgpu"), ("server/Cargo.toml", "winit"), ("client/Cargo.toml", "gltf")] {
        assert_eq!(lines_naming(stranger, Path::new(manifest)), [""; 0], "{manifest} has no {stranger}");
    }
}

#[test]
fn the_map_names_what_is_there() {
    let map = fs::read_to_string(Path::new(ROOT).join("ARCHITECTURE.md")).expect("ARCHITECTURE.md is there");
    let lines = map.lines().count();
    assert!(lines < MAX_MAP_LINES, "{lines} lines: a map is shorter than {MAX_MAP_LINES}");
    // Every second part stands between backticks; blocks of code are left out, as are types, crates and commands.
    let prose: String = map.split("```").step_by(2).collect();
    let quoted: Vec<&str> = prose.split('`').skip(1).step_by(2).collect();
    let is_path = |word: &&str| {
        let plain = word.chars().all(|c| c.is_ascii_alphanumeric() || "_-./".contains(c));
        let tops =
            ["common/", "server/", "client/", "src/", "tests/", "configs/", "scripts/", "benches/", ".ci/", "docs/", "fuzz/"];
        let file = [".rs", ".toml", ".md", ".wgsl", ".lock"].iter().any(|end| word.ends_with(end));
        plain && (tops.iter().any(|top| word.starts_with(top)) || file)
    };
    let paths: Vec<&str> = quoted.into_iter().filter(is_path).collect();
    assert!(paths.len() >= 10, "a map names places: {paths:?}");
    let missing: Vec<&str> = paths.into_iter().filter(|path| !Path::new(ROOT).join(path).exists()).collect();
    assert!(missing.is_empty(), "ARCHITECTURE.md names what is not there: {missing:?}");
}

/// Goal: no page links to a place of the project that is not there. Method: of every page what stands between `](` and `)`, but for the web.
#[test]
fn links_lead_somewhere() {
    let mut missing = Vec::new();
    let mut links = 0;
    for path in files_below("").into_iter().filter(|path| path.extension().is_some_and(|end| end == "md")) {
        let page = text(&path);
        let targets = page.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next());
        for target in targets.filter(|target| !target.is_empty() && !target.contains("://")) {
            links += 1;
            let place = path.parent().unwrap_or(Path::new("")).join(target);
            if !Path::new(ROOT).join(&place).exists() {
                missing.push(format!("{}: {target}", path.display()));
            }
        }
    }
    assert!(links >= 10, "pages link to each other: {links}");
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}

#[test]
fn nothing_is_left_to_be_done_later() {
    // Put together here, so that this file does not hold what it looks for.
    let unfinished = ["todo", "unimplemented"].map(|name| format!("{name}!("));
    let elsewhere = ["work", "home", "root"].map(|top| format!("/{top}/"));
    let mut found = Vec::new();
    for path in files_below("") {
        let is_binary = path.extension().is_some_and(|e| ["png", "jpg", "glb", "bin", "mull"].iter().any(|b| e == *b));
        if is_binary {
            continue;
        }
        for (number, line) in text(&path).lines().enumerate() {
            let names_a_machine = elsewhere.iter().any(|top| {
                // A path starts a word; `network/…` or `https://host/home/` do not.
                line.match_indices(top.as_str())
                    .any(|(at, _)| line[..at].chars().next_back().is_none_or(|c| !(c.is_alphanumeric() || "._-/}$".contains(c))))
            });
            if names_a_machine || unfinished.iter().any(|word| line.contains(word.as_str())) {
                found.push(format!("{}:{}: {}", path.display(), number + 1, line.trim()));
            }
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn files_stay_readable() {
    let long = sources().into_iter().map(|path| (text(&path).lines().count(), path));
    let long: Vec<_> = long.filter(|(lines, _)| *lines > MAX_FILE_LINES).collect();
    assert!(long.is_empty(), "more than {MAX_FILE_LINES} lines: {long:?}");
}

#[test]
fn lines_that_name_a_crate_are_found() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    fs::write(file.path(), "// wgpu\nuse wgpu::Device;\nlet my_wgpu = 1; // wgpu\nf(wgpu);\n").expect("written");
    let found = lines_naming("wgpu", file.path());
    let numbers: Vec<&str> = found.iter().map(|l| l.rsplit(".tmp").next().and_then(|l| l.split(':').nth(1)).unwrap()).collect();
    assert_eq!(numbers, ["2", "4"]);
}
