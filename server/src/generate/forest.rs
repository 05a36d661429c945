//! The forest of Bartz, Meißner and Hüttner 1999 (section 5.1.3, Table 1): twelve trees of 28 500 triangles each before a
//! castle of 110 981, Castel del Monte, 452 981 in all.
//!
//! Nodes: forest, tree or castle, bough or part, spray of leaves. The castle's middle is the origin, its portal looks towards +Z, where an
//! alley of trees leads up to it. The meadow belongs to the castle: its blades of grass are the triangles that the stone
//! leaves.
mod castle;
mod meadow;
mod tree;

use super::glb_writer::{Alpha, Glb, GlbWriter, MaterialId, NodeId, Place, Sides};
use super::random::Random;
use glam::{Vec3, vec3};

const TREES: usize = 12;
const TREE_TRIANGLES: usize = 28_500;
const CASTLE_TRIANGLES: usize = 110_981;

/// Where the alley begins, before the castle's portal, how far its pairs stand apart, and how far from its middle: crowns touch.
const ALLEY_M: f32 = 44.0;
const STRIDE_M: f32 = 5.0;
const ASIDE_M: f32 = 3.0;

struct Materials {
    stone: MaterialId,
    bark: MaterialId,
    leaves: MaterialId,
}

/// The forest as a file.
pub fn generate(seed: u64) -> Glb {
    let mut random = Random::new(seed);
    let mut glb = GlbWriter::default();
    let materials = Materials {
        stone: glb.material("stone", [1.0; 4], None, Alpha::Opaque, Sides::One),
        bark: glb.material("bark", [1.0; 4], None, Alpha::Opaque, Sides::One),
        leaves: glb.material("leaves", [1.0; 4], None, Alpha::Opaque, Sides::Both),
    };
    let forest = glb.node(None, "forest".into(), None, Place::at(Vec3::ZERO));
    let mut roots = Vec::new();
    for k in 0..TREES {
        let mut random = random.fork();
        let at = stand(k, &mut random);
        let place = Place::yawed(at, random.range(-1.0, 1.0));
        let node = glb.node(Some(forest), format!("tree {}", k + 1), None, place);
        tree::build(&mut glb, &materials, node, &mut random);
        roots.push(at);
    }
    castle(&mut glb, &materials, forest, &roots, &mut random.fork());
    glb.finish("mullion generate forest")
}

/// Pairs to both sides of the path.
fn stand(k: usize, random: &mut Random) -> Vec3 {
    let (side, row) = ([-1.0, 1.0][k % 2], (k / 2) as f32);
    let x = side * ASIDE_M + random.range(-0.7, 0.7);
    let z = ALLEY_M + STRIDE_M * row + random.range(-0.7, 0.7);
    vec3(x, meadow::surface(x, z) - 0.1, z)
}

fn castle(glb: &mut GlbWriter, materials: &Materials, forest: NodeId, trees: &[Vec3], random: &mut Random) {
    let before = glb.triangles();
    let node = glb.node(Some(forest), "castle".into(), None, Place::at(Vec3::ZERO));
    castle::build(glb, materials.stone, node);
    meadow::ground(glb, materials.stone, node, &mut random.fork());
    let left = CASTLE_TRIANGLES - (glb.triangles() - before) as usize;
    meadow::grass(glb, materials.leaves, node, trees, left, &mut random.fork());
}
