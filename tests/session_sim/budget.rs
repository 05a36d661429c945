//! Walls that draw to a budget: by the seed of time, of triangles, or none. Every node has the tessellation before it draws, and the same order.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use mullion_client::tile_session::FrameToDraw;
use mullion_common::geometry::Plane;
use mullion_common::scene::{ChunkHash, Package, SectionKind, Tessellation, TessellationParts};
use mullion_common::wire::{Estimate, SectionRef};
use mullion_server::master::{EstimateOptions, WallBudget};

/// Of the sim's frames.
pub const PRIMARY: [Plane; 2] = [Plane { normal: DVec3::Y, offset_m: 4.0 }, Plane { normal: DVec3::X, offset_m: 0.5 }];
const SCENE_TRIANGLES: u32 = 100_000;
/// Nodes take from less than one to nine milliseconds.
const TIME_US: u32 = 5_000;
const TRIANGLES: u32 = 777;

pub fn of_seed(seed: u64) -> Option<EstimateOptions> {
    let budget = [None, Some(WallBudget::TimeUs(TIME_US)), Some(WallBudget::Triangles(TRIANGLES))][(seed / 2 % 3) as usize];
    budget.map(|budget| EstimateOptions { budget, scene_triangles: SCENE_TRIANGLES, completes: true })
}

/// A tessellation that covers nothing: its name, its bytes.
pub fn tessellation(package: &Package) -> (SectionRef, Vec<u8>) {
    let parts = TessellationParts { origin: DVec3::X, ..TessellationParts::default() };
    let bytes = Tessellation::new(parts, &package.scene.manifest).expect("it names nothing").encode();
    (SectionRef { kind: SectionKind::Tessellation, hash: ChunkHash::of(&bytes), length: bytes.len() as u64 }, bytes)
}

/// What was ordered, by frame of this master, as the first node that draws it has it.
pub type Orders = BTreeMap<u64, Option<Estimate>>;

pub fn check(orders: &mut Orders, asked: Option<&EstimateOptions>, frame: &FrameToDraw, taken: Option<&Arc<Tessellation>>) {
    let order = orders.entry(frame.number).or_insert(frame.estimate);
    assert_eq!(frame.estimate, *order, "frame {}", frame.number);
    assert_eq!(order.is_some(), asked.is_some(), "frame {}", frame.number);
    let (Some(order), Some(asked)) = (order, asked) else { return };
    assert_eq!(taken.map(|tessellation| tessellation.origin()), Some(DVec3::X));
    match asked.budget {
        WallBudget::Triangles(triangles) => assert_eq!(order.triangles, triangles),
        WallBudget::TimeUs(_) => assert!((1..=SCENE_TRIANGLES).contains(&order.triangles), "{order:?}"),
    }
    assert!(!order.is_complete, "the room moves with every frame");
    assert_eq!(frame.primary.as_ref().map(|primary| &primary.planes[..]), Some(&PRIMARY[..]));
}
