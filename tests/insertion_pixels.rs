//! Goal: what is inserted looks as if it had been there from the start, to the pixel.
//! Method: two shows over sockets, each with a node that draws both tiles: one into which half a city is inserted while it runs, one of the
//! same two packages joined beforehand. The pictures that they end with are compared. `MULLION_PICTURES=DIR` keeps them.

mod support;

use std::net::TcpListener;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use glam::{DAffine3, DQuat, DVec3};
use image::RgbaImage;
use mullion_client::gpu::{Gpu, GpuOptions};
use mullion_client::gpu_painter::{GpuPainter, Output};
use mullion_client::node::{NodeOptions, NodeReport, Reconnect, run as run_node};
use mullion_common::scene::Package;
use mullion_common::wall::{Wall, WallConfig};
use mullion_server::control::LiveScene;
use mullion_server::cull::Algorithm;
use mullion_server::generate::{GeneratedScene, write_glb};
use mullion_server::prepare::{PrepareOptions, scene_bounds};
use mullion_server::service::{Offer, Outcome, Pose, Rate, Show, ShowOptions, run as run_show};

const PATIENCE: Duration = Duration::from_secs(120);
/// Frames that are drawn of the whole scene, so that the last is.
const FRAMES_AFTER: u64 = 5;

fn wall() -> Arc<Wall> {
    let text = "[grid]\ncolumns = 2\nrows = 1\ntile_px = [320, 240]\ntile_m = [0.4, 0.3]\n\n[[nodes]]\nname = \"both\"\ntiles = [\"t0x0\", \"t1x0\"]\n";
    Arc::new(WallConfig::parse(text).expect("a valid wall"))
}

fn prepared(folder: &Path, scene: GeneratedScene, name: &str) -> Package {
    let path = folder.join(name);
    write_glb(scene, 1, &path).expect("written");
    support::package(&path, &PrepareOptions::default())
}

/// What the show ends with, and what the node did.
fn show(package: &Arc<Package>, room: DAffine3, mut offer: Option<Arc<Offer>>) -> (Vec<(String, RgbaImage)>, NodeReport) {
    let wall = wall();
    let (eyes, mut scene) = (wall.default_eyes(), LiveScene::new(Algorithm::Sweep, &wall, package));
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = tokio::sync::watch::channel(false);
    // The frame from which all is there; the offer is made once the node is in the picture.
    let whole_from = Arc::new(AtomicU64::new(if offer.is_some() { u64::MAX } else { 0 }));
    let (began, is_in_picture) = (Arc::clone(&whole_from), Arc::new(AtomicU64::new(0)));
    let in_picture = Arc::clone(&is_in_picture);
    let mut shown_whole = 0;
    let show = Show {
        options: ShowOptions { rate: Rate::Hz(60.0), barrier_wait: PATIENCE, ..ShowOptions::for_wall(&wall) }
            .starting_together(&wall, PATIENCE),
        wall,
        package: Arc::clone(package),
        camera: Box::new(move |_| {
            let offer = offer.take_if(|_| in_picture.load(Ordering::SeqCst) > 2);
            Pose { world_from_room: room, eyes: eyes.clone(), offer, ..Pose::default() }
        }),
        cull: Box::new(move |pose, sets| {
            scene.cull(pose, sets);
            if pose.grows {
                began.store(0, Ordering::SeqCst);
            }
        }),
        observer: Box::new(move |frame| {
            is_in_picture.fetch_add(u64::from(frame.shown_by), Ordering::SeqCst);
            shown_whole += u64::from(frame.shown_by == 1 && whole_from.load(Ordering::SeqCst) == 0);
            if shown_whole > FRAMES_AFTER {
                stop.send_replace(true);
            }
        }),
        node_observer: Box::new(|_| {}),
        shown_observer: Box::new(|_, _| {}),
        stop: Some(stopped),
    };
    let service = thread::spawn(move || run_show(listener, show));
    let mut painter = GpuPainter::new(Gpu::open(GpuOptions::default()).unwrap(), Output::Keep);
    let options = NodeOptions {
        reconnect: Reconnect { give_up_after: Some(Duration::from_secs(5)), ..Reconnect::default() },
        ..NodeOptions::plain("both", address.to_string())
    };
    let report = run_node(options, &mut painter).expect("the node goes on to the end");
    service.join().unwrap().expect("the show goes on to its end");
    (painter.pictures().expect("pictures"), report)
}

fn pictures() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = Arc::new(prepared(folder.path(), "boxes:3000".parse().expect("a scene"), "boxes.glb"));
    let added = prepared(folder.path(), GeneratedScene::City, "city.glb");
    let [scene, city] = [&*base, &added].map(|package| scene_bounds(package).expect("leaves"));
    // As large as the scene that it comes into, turned, and in front of its middle.
    let scale = scene.size().max_element() / city.size().max_element();
    let turn = DQuat::from_rotation_y(0.7);
    let place = scene.center() - turn * city.center() * scale;
    let world_from_root = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turn, place);
    let reach_m = scene.size().length();
    let room = DAffine3::from_scale_rotation_translation(
        DVec3::splat(reach_m * 0.7),
        DQuat::from_rotation_x(-0.5),
        scene.center() + DVec3::new(0.0, reach_m * 0.35, reach_m * 0.3),
    );
    let offer = || Offer::new(&base, &added, "city", None, world_from_root).expect("joined");
    let (offered, outcomes) = offer();
    let joined = Arc::clone(offered.package());
    let (inserted, report) = show(&base, room, Some(Arc::new(offered)));
    assert!(matches!(outcomes.try_recv(), Ok(Outcome::Begun(_))));
    let (beforehand, once) = show(&joined, room, None);
    let (without, _) = show(&base, room, None);
    assert_eq!(report.connections, 1);
    if let Some(kept) = std::env::var_os("MULLION_PICTURES") {
        for (name, pictures) in [("inserted", &inserted), ("beforehand", &beforehand), ("without", &without)] {
            for (tile, picture) in pictures {
                picture.save(Path::new(&kept).join(format!("{name}-{tile}.png"))).expect("saved");
            }
        }
    }
    assert_eq!(inserted.len(), 2);
    for (((tile, inserted), (_, beforehand)), (_, without)) in inserted.iter().zip(&beforehand).zip(&without) {
        assert!(inserted == beforehand, "{tile}: another picture than of the scene joined beforehand");
        let changed = inserted.pixels().zip(without.pixels()).filter(|(a, b)| a != b).count();
        assert!(changed > 5_000, "{tile}: {changed} pixels changed: little was inserted where it is seen");
    }
    // The parts' tables, and no chunk more than once: the chunk tables of both shows hold the same chunks.
    let tables = |package: &Package| {
        let bytes = |kind| package.scene.section_bytes(kind).expect("a section").len() as u64;
        mullion_common::scene::SectionKind::FOR_TILES.map(bytes).iter().sum::<u64>()
    };
    assert!(report.blob_bytes <= once.blob_bytes.max(joined.chunk_bytes() + tables(&joined)) + 64, "{report:?} {once:?}");
}

#[test]
fn what_is_inserted_looks_as_if_it_had_always_been_there() {
    if !support::has_gpu() {
        return;
    }
    let (done, outcome) = mpsc::channel();
    thread::spawn(move || {
        pictures();
        done.send(())
    });
    outcome.recv_timeout(4 * PATIENCE).expect("pictures are made and compared in time");
}
