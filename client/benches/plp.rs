//! The traversal of Prioritized-Layered Projection on one core: cells a second over a whole block without triangles, and of one with
//! triangles to 5 % of them. `mullion bench plp` measures what it finds, on scenes.

#![allow(missing_docs)] // of what criterion's macro makes

#[allow(dead_code)] // the tests use more of it
#[path = "../src/plp/tests/block.rs"]
mod block;

use std::hint::black_box;

use block::{Block, ORIGIN, size_m};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mullion_client::plp::{Frame, Sight, Solidity, Traversal};

/// 82 944 cells.
const CUBES: [usize; 3] = [32, 18, 24];
const LEAVES: u32 = 3000;
const SEED: u64 = 7;

fn traverse(block: &Block, traversal: &mut Traversal, solidity: Solidity, budget: u32) -> u32 {
    let eye = ORIGIN + (size_m(CUBES) * 0.4).as_dvec3();
    let sight = Sight { eye, planes: &[], pixels_per_radian: 1000.0 };
    let frame = Frame { tessellation: &block.tessellation, scene: &block.scene, sight };
    traversal.begin(&frame, solidity);
    traversal.project(&frame, budget).cells
}

fn benches(criterion: &mut Criterion) {
    for (name, leaves, share) in [("alone", 0, 1), ("to 5 %", LEAVES, 20)] {
        let block = block::block(SEED, CUBES, leaves);
        let budget = if leaves == 0 { u32::MAX } else { block.tessellation.slot_count() / share };
        let mut group = criterion.benchmark_group(name);
        for solidity in Solidity::ALL {
            let mut traversal = Traversal::new();
            let cells = traverse(&block, &mut traversal, solidity, budget);
            assert!(leaves > 0 || cells as usize == block.tessellation.cells().len(), "every cell is reached");
            group.throughput(Throughput::Elements(cells.into()));
            group.bench_function(solidity.name(), |bencher| {
                bencher.iter(|| black_box(traverse(&block, &mut traversal, solidity, budget)));
            });
        }
        group.finish();
    }
}

criterion_group!(all, benches);
criterion_main!(all);
