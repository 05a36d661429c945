//! Goal: an object that hardly contributes is on neither side of a seam, and on both when it does contribute; all else looks as ever.
//! Method: shows over sockets of a wall of two tiles, each a node of its own that draws and counts. Between two rectangles that are large, a
//! small one lies across the seam; in the middle of some shows it grows. The pictures that they end with are compared with those of shows
//! that drop nothing, and of such as have no small rectangle. `MULLION_PICTURES=DIR` keeps them.

mod support;

use std::net::TcpListener;
use std::path::Path;
use std::sync::{Arc, Mutex, mpsc};
use std::thread;
use std::time::Duration;

use glam::{DAffine3, DVec3};
use image::RgbaImage;
use mullion_client::gpu::{Gpu, GpuOptions};
use mullion_client::gpu_painter::{GpuPainter, Output};
use mullion_client::node::{NodeOptions, Reconnect, run as run_node};
use mullion_client::occlusion::Occlusion;
use mullion_common::geometry::{Aabb, Obb};
use mullion_common::scene::{
    AlphaMode, ChunkHash, ChunkId, ChunkKind, ChunkRecord, GeometryChunk, LeafRecord, LeafSource, Material, MaterialId, Object,
    ObjectHierarchy, ObjectId, OhNode, Package, Scene, SceneManifest, Sources, Transform,
};
use mullion_common::visible_set::LeafRange;
use mullion_common::wall::{Wall, WallConfig};
use mullion_common::wire::Moved;
use mullion_server::service::{Pose, Rate, Show, ShowOptions, run as run_show};

const PATIENCE: Duration = Duration::from_secs(60);
const FRAMES: u64 = 48;
/// When the small rectangle grows, where it does.
const GROWS_AT: u64 = 20;
/// The small one is a fiftieth of the wall, and more than a third when it has grown.
const THRESHOLD: f64 = 0.05;
const SMALL: u32 = 1;

/// Least and greatest x and y, and z, metres; the wall's middle is the origin.
const RECTANGLES: [([f32; 2], [f32; 2], f32); 3] =
    [([-3.0, -2.0], [2.5, 3.0], -2.0), ([-0.03, -0.02], [0.04, 0.05], -0.1), ([0.1, -0.1], [0.3, 0.12], -0.1)];
const COLORS: [[f32; 4]; 3] = [[0.1, 0.2, 0.4, 1.0], [1.0, 0.1, 0.0, 1.0], [0.9, 0.9, 0.2, 1.0]];

fn wall() -> Arc<Wall> {
    let text = "[grid]\ncolumns = 2\nrows = 1\ntile_px = [64, 48]\ntile_m = [0.4, 0.3]\n";
    Arc::new(WallConfig::parse(text).expect("a valid wall"))
}

/// A leaf and an object for each rectangle.
fn package() -> Arc<Package> {
    let (mut manifest, mut data, mut nodes) = (SceneManifest::default(), Vec::new(), Vec::new());
    for (i, ((min, max, z), base_color)) in (0..).zip(RECTANGLES.into_iter().zip(COLORS)) {
        let mesh = GeometryChunk {
            positions: vec![[min[0], min[1], z], [max[0], min[1], z], [max[0], max[1], z], [min[0], max[1], z]],
            vertex_ids: vec![0, 1, 2, 3],
            indices: vec![0, 1, 2, 0, 2, 3],
            ..GeometryChunk::default()
        };
        let bytes = mesh.encode();
        let (at, length) = (data.len() as u64, bytes.len() as u32);
        manifest.chunks.push(ChunkRecord::new(ChunkHash::of(&bytes), at, length, ChunkKind::Geometry));
        data.extend_from_slice(&bytes);
        manifest.materials.push(Material { base_color, texture: None, alpha: AlphaMode::Opaque, double_sided: false });
        manifest.transforms.push(Transform::from(DAffine3::IDENTITY));
        let leaf = LeafRecord {
            object: ObjectId(i),
            chunk: ChunkId(i),
            material: MaterialId(i),
            triangle_count: 2,
            local_min: [min[0], min[1], z],
            local_max: [max[0], max[1], z],
        };
        nodes.push(OhNode { bound: Obb::from(leaf.local_aabb()), subtree_end: i + 2, leaves: LeafRange::new(i, i + 1) });
        manifest.leaves.push(leaf);
    }
    let all = manifest.leaves.iter().map(LeafRecord::local_aabb).fold(Aabb::EMPTY, |all, leaf| all.union(&leaf));
    nodes.insert(0, OhNode { bound: Obb::from(all), subtree_end: 4, leaves: LeafRange::new(0, 3) });
    let object = |i: u32| Object {
        parent: None,
        name: format!("rectangle {i}"),
        source_node: i,
        instance: None,
        parent_from_local: DAffine3::IDENTITY,
        leaves: vec![LeafRange::new(i, i + 1)],
    };
    let scene = Scene {
        hierarchy: Arc::new(ObjectHierarchy::new(nodes).expect("a tree")),
        manifest,
        objects: (0..3).map(object).collect(),
        sources: Sources {
            leaves: (0..3).map(|piece| LeafSource { mesh: 0, primitive: 0, piece }).collect(),
            piece_ends: vec![1, 2, 3],
            triangles: vec![0; 3],
        },
        tessellation: None,
        hierarchies: Default::default(),
    };
    Arc::new(Package::new(scene, data).expect("a valid package"))
}

/// What a show is.
#[derive(Clone, Copy)]
struct Plan {
    adaptive: Option<f64>,
    grows: bool,
    has_small: bool,
    occlusion: Occlusion,
}

/// The two pictures with which a show ends, and how many objects were dropped in each frame.
fn show(gpu: &Arc<Gpu>, plan: Plan) -> ([RgbaImage; 2], Vec<u32>) {
    let wall = wall();
    let [bottom_left, bottom_right, top_left] = wall.screens()[0].corners;
    let middle = bottom_left + (bottom_right - bottom_left + (top_left - bottom_left)) * 0.5;
    let (eyes, names) = (wall.default_eyes(), wall.nodes().iter().map(|node| node.name.clone()).collect::<Vec<_>>());
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let dropped = Arc::new(Mutex::new(Vec::new()));
    let noted = Arc::clone(&dropped);
    let options = ShowOptions {
        rate: Rate::AsFastAsPossible,
        barrier_wait: PATIENCE,
        frames: Some(FRAMES),
        adaptive: plan.adaptive,
        ..ShowOptions::for_wall(&wall)
    };
    let show = Show {
        options: options.starting_together(&wall, PATIENCE),
        wall,
        package: package(),
        camera: Box::new(move |number| {
            let transform = Transform::from(DAffine3::from_scale(DVec3::new(4.0, 4.0, 1.0)));
            let moved = (plan.grows && number == GROWS_AT).then_some(Moved { object: ObjectId(SMALL), transform });
            let world_from_room = DAffine3::from_translation(-middle);
            Pose { world_from_room, eyes: eyes.clone(), moved: moved.into_iter().collect(), ..Pose::default() }
        }),
        cull: Box::new(move |_, sets| {
            let seen = |leaf: &u32| plan.has_small || *leaf != SMALL;
            for set in sets {
                (0..3).filter(seen).for_each(|leaf| set.push(LeafRange::new(leaf, leaf + 1)));
            }
        }),
        observer: Box::new(move |frame| noted.lock().unwrap().push(frame.dropped_objects)),
        node_observer: Box::new(|_| {}),
        shown_observer: Box::new(|_, _| {}),
        stop: None,
    };
    let service = thread::spawn(move || run_show(listener, show));
    let nodes: Vec<_> = names.into_iter().map(|node| (node, Arc::clone(gpu))).collect();
    let nodes: Vec<_> = nodes
        .into_iter()
        .map(|(node, gpu)| thread::spawn(move || draw(node, gpu, address.to_string(), plan.occlusion)))
        .collect();
    let pictures: Vec<RgbaImage> = nodes.into_iter().map(|node| node.join().expect("a node goes on to the end")).collect();
    service.join().unwrap().expect("the show goes on to its end");
    let dropped = dropped.lock().unwrap().clone();
    (pictures.try_into().expect("two tiles"), dropped)
}

/// A node until the show ends; its last picture.
fn draw(node: String, gpu: Arc<Gpu>, master: String, occlusion: Occlusion) -> RgbaImage {
    let mut painter = GpuPainter::new(gpu, Output::Keep).culling(occlusion).always();
    let options = NodeOptions {
        reconnect: Reconnect { give_up_after: Some(Duration::from_secs(5)), ..Reconnect::default() },
        ..NodeOptions::plain(&node, master)
    };
    run_node(options, &mut painter).expect("the node goes on to the end");
    painter.pictures().expect("pictures").remove(0).1
}

/// Pixels in which two pictures differ, by tile.
fn differing(a: &[RgbaImage; 2], b: &[RgbaImage; 2]) -> [usize; 2] {
    [0, 1].map(|tile| a[tile].pixels().zip(b[tile].pixels()).filter(|(a, b)| a != b).count())
}

fn pictures(occlusion: Occlusion) {
    let gpu = Gpu::open(GpuOptions::default()).unwrap();
    let all = Plan { adaptive: None, grows: false, has_small: true, occlusion };
    let (full, none) = show(&gpu, all);
    let (without, _) = show(&gpu, Plan { has_small: false, ..all });
    let (dropping, some) = show(&gpu, Plan { adaptive: Some(THRESHOLD), ..all });
    let (grown, _) = show(&gpu, Plan { grows: true, ..all });
    let (back, back_again) = show(&gpu, Plan { adaptive: Some(THRESHOLD), grows: true, ..all });
    if let Some(kept) = std::env::var_os("MULLION_PICTURES") {
        for (name, pictures) in
            [("full", &full), ("without", &without), ("dropping", &dropping), ("grown", &grown), ("back", &back)]
        {
            for (tile, picture) in pictures.iter().enumerate() {
                picture.save(Path::new(&kept).join(format!("{name}-{occlusion}-{tile}.png"))).expect("saved");
            }
        }
    }
    assert!(
        differing(&full, &without).iter().all(|pixels| *pixels > 20),
        "it is seen on both tiles: {:?}",
        differing(&full, &without)
    );
    assert_eq!(differing(&dropping, &without), [0, 0], "it is on neither");
    assert_eq!(differing(&back, &grown), [0, 0], "it is on both");
    assert!(differing(&grown, &full).iter().all(|pixels| *pixels > 100));
    assert_eq!(none, [0; FRAMES as usize]);
    assert_eq!((some[0], some.last()), (0, Some(&1)));
    assert!(some.is_sorted(), "it does not flicker: {some:?}");
    assert_eq!((back_again[GROWS_AT as usize - 1], back_again.last()), (1, Some(&0)), "{back_again:?}");
}

#[test]
fn what_hardly_contributes_is_on_neither_side_of_a_seam() {
    if !support::has_gpu() {
        return;
    }
    let (done, outcome) = mpsc::channel();
    thread::spawn(move || {
        [Occlusion::Off, Occlusion::Hiz].into_iter().for_each(pictures);
        done.send(())
    });
    outcome.recv_timeout(4 * PATIENCE).expect("pictures are made and compared in time");
}
