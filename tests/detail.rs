//! Goal: a wall draws in one detail, whoever is its master, and whoever comes late; nodes read all of its hierarchies and fetch no leaf of them.
//! Method: masters are processes of their own, nodes are threads that read what they are given and draw nothing. The scene is prepared by the binary.

mod support;

use std::collections::BTreeMap;
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Instant;

use mullion_client::node::{self, NodeError, NodeOptions, NodeReport, PaintError};
use mullion_client::tile_session::FrameToDraw;
use mullion_common::scene::{Hierarchy, LodForm, ObjectId, Package, VertexHierarchy};
use mullion_common::wall::WallConfig;
use mullion_common::wire::{Detail, DetailWeight};
use mullion_server::service::{ServiceError, Show, ShowOptions, run as run_show};
use support::masters::{LIMIT, NODES, serve};
use support::mullion;
use support::painter::{Blank, Witness};
use tokio::sync::watch;

const OPTIONS: [&str; 6] = ["--pixel-error", "1.5", "--lod-triangles", "9000", "--lod-weight", "nohc"];
const DETAIL: Detail = Detail { triangles: Some(9000), least_pixels: 1.5, hides: true, weight: DetailWeight::Nohc };
const WALL: &str = "[grid]\ncolumns = 2\nrows = 2\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
/// Frames after which none of a master that was killed is on its way.
const SURELY_OF_THE_NEXT: usize = 30;

/// Reads hierarchies, and tells of each frame how many of their vertices there are.
struct Reader {
    hierarchies: BTreeMap<u32, VertexHierarchy>,
    frames: Sender<(FrameToDraw, u32)>,
}

impl Witness for Reader {
    fn takes(&mut self, number: u32, objects: &[ObjectId], blob: &[u8]) -> Option<u64> {
        assert!(!objects.is_empty());
        match self.hierarchies.get_mut(&number) {
            Some(hierarchy) => hierarchy.decode_block(blob).expect("a block"),
            None => drop(self.hierarchies.insert(number, VertexHierarchy::decode_base(blob, 1000).expect("a base"))),
        }
        Some(blob.len() as u64)
    }

    fn draws(&mut self, frame: &FrameToDraw) -> Result<(), PaintError> {
        let vertices = self.hierarchies.values().map(VertexHierarchy::vertex_count).sum();
        let _ = self.frames.send((frame.clone(), vertices)); // nobody looks any more
        Ok(())
    }
}

struct Node {
    frames: Receiver<(FrameToDraw, u32)>,
    stop: watch::Sender<bool>,
    thread: JoinHandle<Result<NodeReport, NodeError>>,
}

impl Node {
    fn start(name: &str, masters: &[&str]) -> Self {
        let ((tell, frames), (stop, stopped)) = (channel(), watch::channel(false));
        let masters = masters.iter().map(|master| (*master).to_owned()).collect();
        let options = NodeOptions { masters, stop: Some(stopped), ..NodeOptions::plain(name, String::new()) };
        let mut painter = Blank(Reader { hierarchies: BTreeMap::new(), frames: tell });
        Self { frames, stop, thread: std::thread::spawn(move || node::run(options, &mut painter)) }
    }

    fn next(&self) -> (FrameToDraw, u32) {
        let (frame, vertices) = self.frames.recv_timeout(LIMIT).expect("a frame");
        assert_eq!(frame.detail, Some(DETAIL));
        assert_eq!(frame.primary.as_ref().map(|primary| primary.planes.len()), Some(5));
        assert!(frame.views[0].missing.is_empty(), "its base stands for it");
        assert!(frame.views[0].leaves.is_empty() || vertices > 0);
        (frame, vertices)
    }

    fn reads(&self, vertices: u32) {
        let deadline = Instant::now() + LIMIT;
        while self.next().1 < vertices {
            assert!(Instant::now() < deadline);
        }
    }

    fn end(self) -> NodeReport {
        self.stop.send_replace(true);
        self.thread.join().expect("no panic").expect("it was stopped")
    }
}

#[test]
fn the_detail_outlives_the_master_and_is_for_those_who_come_late_too() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let done = |args: &[&str]| assert_eq!(mullion(args, LIMIT).code, Some(0), "{args:?}");
    done(&["generate", "planet", "--vertices", "40000", "--out", &path("planet.glb")]);
    done(&["prepare", &path("planet.glb"), "--lod=clusters,vertices", "--out", &path("palace.glb")]);
    std::fs::write(folder.path().join("wall.toml"), WALL).expect("written");
    let package = Package::read(&std::fs::read(path("palace.glb")).expect("it was written")).expect("a package");
    assert!(package.scene.hierarchies.of(LodForm::Clusters).is_some(), "of these a budget of triangles needs nothing");
    let table = package.scene.hierarchies.of(LodForm::Vertices).expect("it has hierarchies");
    let hierarchies = (0..table.entries().len()).map(|at| table.decode(at, &package.scene.manifest).expect("a hierarchy"));
    let vertices: u32 = hierarchies.filter_map(Hierarchy::into_vertices).map(|hierarchy| hierarchy.vertex_count()).sum();

    let mut master = serve(folder.path(), "127.0.0.1:0", &OPTIONS);
    let address = support::address_of(&mut master);
    let mut standby = serve(folder.path(), "127.0.0.1:0", &[&OPTIONS[..], &["--standby-of", &address]].concat());
    let heir = support::address_of(&mut standby);
    master.error_line(&["standby joined"], 0, LIMIT);
    let nodes = [NODES[0], NODES[1]].map(|name| {
        let node = Node::start(name, &[&address, &heir]);
        node.reads(vertices);
        node
    });
    master.kill();
    let of_hierarchies: usize = (0..table.entries().len()).flat_map(|at| table.blobs(at)).map(<[u8]>::len).sum();
    for node in nodes {
        while node.frames.try_recv().is_ok() {}
        for _ in 0..SURELY_OF_THE_NEXT {
            assert_eq!(node.next().1, vertices, "what was read stays");
        }
        let report = node.end();
        let chunks: u64 = package.scene.manifest.chunks.iter().map(|chunk| u64::from(chunk.length)).sum();
        let fetched = report.blob_bytes;
        assert!(
            (of_hierarchies as u64..of_hierarchies as u64 + chunks).contains(&fetched),
            "{fetched} bytes: once, and no leaves"
        );
    }
}

#[test]
fn a_show_whose_detail_cannot_be_does_not_begin() {
    let wall = Arc::new(WallConfig::parse(WALL).expect("a wall"));
    let refused = |detail: Detail| {
        let show = Show {
            options: ShowOptions { detail: Some(detail), frames: Some(1), ..ShowOptions::for_wall(&wall) },
            wall: Arc::clone(&wall),
            package: Arc::default(),
            camera: Box::new(|_| panic!("there is no frame")),
            cull: Box::new(|_, _| ()),
            observer: Box::new(|_| ()),
            node_observer: Box::new(|_| ()),
            shown_observer: Box::new(|_, _| ()),
            stop: None,
        };
        match run_show(TcpListener::bind("127.0.0.1:0").expect("a port"), show) {
            Err(error @ (ServiceError::Detail(_) | ServiceError::NoHierarchies | ServiceError::NoEstimates)) => error.to_string(),
            other => panic!("{other:?}"),
        }
    };
    let refusal = |triangles, least_pixels| refused(Detail { triangles, least_pixels, ..Detail::default() });
    assert_eq!(refusal(Some(0), 1.0), "detail: 0 triangles; there must be more");
    for (pixels, text) in [(f32::NAN, "NaN"), (-1.0, "-1"), (f32::INFINITY, "inf")] {
        assert_eq!(refusal(Some(5), pixels), format!("detail: {text} pixels; it must be 0 or more"));
    }
    assert_eq!(refusal(None, 0.0), "detail: 0 pixels and any number of triangles; that is all there is");
    let none = "detail: the scene has no hierarchies of detail; prepare it with --lod";
    assert_eq!([refusal(None, 1.0), refusal(Some(5), 0.0)], [none; 2]);
    for detail in [Detail { triangles: None, ..DETAIL }, Detail { hides: false, ..DETAIL }] {
        assert_eq!(refused(detail), "detail: weight nohc; it needs a number of triangles, and what hides others");
    }
    let weighed = refused(Detail { weight: DetailWeight::Plp, ..DETAIL });
    assert_eq!(weighed, "detail: the scene has no tessellation to weigh objects by; prepare it with --plp");
}
