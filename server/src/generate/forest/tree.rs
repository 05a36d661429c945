//! A tree: a trunk that forks into boughs, branches and twigs, and leaves along the twigs until its triangles are used.
use super::{Materials, TREE_TRIANGLES};
use crate::generate::glb_writer::{GlbWriter, MaterialId, NodeId, Place};
use crate::generate::random::Random;
use crate::generate::solid::{Color, Geometry, ring, srgb};
use glam::{Quat, Vec3, vec3};

const BOUGHS: usize = 9;
/// Shoots of a bough, a branch.
const BRANCHES: usize = 7;
const TWIGS: usize = 5;
/// How far a shoot turns from one piece to the next, as a tangent.
const STRAY: f32 = 0.14;

/// What the tree's kind decides.
struct Habit {
    height_m: f32,
    bough_m: f32,
    bark: Color,
    leaves: [Color; 4],
    leaf_m: f32,
}

impl Habit {
    fn draw(random: &mut Random) -> Habit {
        let oak = [srgb(74, 112, 48), srgb(86, 126, 54), srgb(62, 98, 44), srgb(104, 140, 62)];
        let beech = [srgb(110, 150, 66), srgb(92, 136, 56), srgb(128, 164, 76), srgb(80, 120, 52)];
        let autumn = [srgb(150, 140, 58), srgb(128, 134, 56), srgb(170, 142, 60), srgb(104, 122, 52)];
        Habit {
            height_m: random.range(9.0, 11.0),
            bough_m: random.range(3.5, 4.2),
            bark: *random.pick(&[srgb(104, 86, 68), srgb(122, 112, 98), srgb(92, 76, 60)]),
            leaves: *random.pick(&[oak, oak, beech, beech, autumn]),
            leaf_m: random.range(0.51, 0.6),
        }
    }
}

/// A growing shoot: its axis from root to tip.
struct Shoot {
    path: Vec<Vec3>,
    root_radius_m: f32,
}

/// Adds the trunk, the wood of each bough and the leaves of each of its branches as meshes of their own.
pub fn build(glb: &mut GlbWriter, materials: &Materials, tree: NodeId, random: &mut Random) {
    let habit = Habit::draw(random);
    let up = vec3(random.range(-0.06, 0.06), 1.0, random.range(-0.06, 0.06));
    let trunk = grow(Vec3::ZERO, up, [habit.height_m * 0.8, 0.36], 6, random);
    let mut wood = Geometry::default();
    taper(&mut wood, &trunk, 12, habit.bark);
    roots(&mut wood, habit.bark, random);
    let boughs: Vec<Bough> = (0..BOUGHS).map(|k| Bough::grow(&habit, &trunk, k, random)).collect();
    let spent = wood.triangles() + boughs.iter().map(|bough| bough.wood.triangles()).sum::<usize>();
    let add = |glb: &mut GlbWriter, parent: NodeId, name: String, part: (&Geometry, MaterialId)| {
        let mesh = glb.mesh(&name, &[part]);
        glb.node(Some(parent), name, Some(mesh), Place::at(Vec3::ZERO))
    };
    add(glb, tree, "trunk".into(), (&wood, materials.bark));
    let (mut left, mut sprays) = (TREE_TRIANGLES - spent, BOUGHS * BRANCHES);
    for (k, bough) in boughs.iter().enumerate() {
        let node = add(glb, tree, format!("bough {}", k + 1), (&bough.wood, materials.bark));
        for twigs in &bough.branches {
            let share = left / sprays;
            (left, sprays) = (left - share, sprays - 1);
            add(glb, node, "spray".into(), (&leaves(&habit, twigs, share, random), materials.leaves));
        }
    }
}

/// A shoot that wanders, and bends upwards where it hangs.
fn grow(from: Vec3, direction: Vec3, [length_m, root_radius_m]: [f32; 2], pieces: usize, random: &mut Random) -> Shoot {
    let mut heading = direction.normalize();
    let mut path = vec![from];
    for _ in 0..pieces {
        let stray = vec3(random.range(-1.0, 1.0), random.range(-0.7, 1.0), random.range(-1.0, 1.0));
        heading = (heading + stray * STRAY + Vec3::Y * 0.05).normalize();
        path.push(path[path.len() - 1] + heading * (length_m / pieces as f32));
    }
    Shoot { path, root_radius_m }
}

impl Shoot {
    /// Place, direction and thickness at a share of the length.
    fn at(&self, share: f32) -> (Vec3, Vec3, f32) {
        let along = share * (self.path.len() - 1) as f32;
        let piece = (along as usize).min(self.path.len() - 2);
        let (from, to) = (self.path[piece], self.path[piece + 1]);
        (from.lerp(to, along - piece as f32), (to - from).normalize(), self.root_radius_m * (1.0 - 0.85 * share))
    }
}

/// A round surface that thins along the shoot, open where it grows from, pointed at its tip.
fn taper(g: &mut Geometry, shoot: &Shoot, sides: usize, color: Color) {
    let ring = if sides == 3 { ring(6).into_iter().step_by(2).collect() } else { ring(sides) };
    let last = shoot.path.len() - 1;
    let mut across = (shoot.path[1] - shoot.path[0]).any_orthogonal_vector();
    let rings: Vec<Vec<Vec3>> = (0..last)
        .map(|k| {
            let (at, along, radius) = shoot.at(k as f32 / last as f32);
            across = (across - along * across.dot(along)).normalize();
            let other = along.cross(across);
            ring.iter().map(|corner| at + (across * corner.x + other * corner.y) * radius).collect()
        })
        .collect();
    for (from, to) in rings.iter().zip(&rings[1..]) {
        for k in 0..sides {
            let next = (k + 1) % sides;
            g.polygon(&[from[k], from[next], to[next], to[k]], color);
        }
    }
    let end = &rings[last - 1];
    for k in 0..sides {
        g.polygon(&[end[k], end[(k + 1) % sides], shoot.path[last]], color);
    }
}

/// The foot of the trunk spreads into the ground.
fn roots(g: &mut Geometry, bark: Color, random: &mut Random) {
    for out in ring(6) {
        let out = vec3(out.x, 0.0, out.y) * random.range(0.8, 1.2);
        let path = vec![Vec3::Y * 0.55, out * 0.32 + Vec3::Y * 0.25, out * 0.7 + Vec3::Y * 0.05, out * 1.1 - Vec3::Y * 0.2];
        taper(g, &Shoot { path, root_radius_m: 0.2 }, 6, bark);
    }
}

/// One bough with its branches and twigs.
struct Bough {
    wood: Geometry,
    /// By branch: itself and its twigs, which bear leaves.
    branches: Vec<Vec<Shoot>>,
}

impl Bough {
    fn grow(habit: &Habit, trunk: &Shoot, k: usize, random: &mut Random) -> Self {
        let mut wood = Geometry::default();
        let mut branches = Vec::new();
        let share = 0.25 + 0.71 * k as f32 / (BOUGHS - 1) as f32;
        let (from, _, thickness) = trunk.at(share);
        // Two fifths of a turn from one to the next, five places of a ring of twelve.
        let out = ring(12)[k * 5 % 12];
        let rise = if k + 1 == BOUGHS { 2.5 } else { random.range(0.2, 0.6) + share * 0.6 };
        let length = habit.bough_m * (1.15 - 0.55 * share);
        let bough = grow(from, vec3(out.x, rise, out.y), [length, (0.7 * thickness).min(0.16)], 7, random);
        taper(&mut wood, &bough, 8, habit.bark);
        for b in 0..BRANCHES {
            let (from, along, thickness) = bough.at(0.25 + 0.72 * b as f32 / (BRANCHES - 1) as f32);
            let turn = Quat::from_array(random.rotation());
            let direction = along + (turn * Vec3::X) * 1.1 + Vec3::Y * 0.15;
            let branch = grow(from, direction, [length * random.range(0.4, 0.55), thickness * 0.6], 4, random);
            taper(&mut wood, &branch, 4, habit.bark);
            let mut twigs = Vec::new();
            for t in 0..TWIGS {
                let (from, along, thickness) = branch.at(0.3 + 0.65 * t as f32 / (TWIGS - 1) as f32);
                let turn = Quat::from_array(random.rotation());
                let direction = along + (turn * Vec3::X) * 1.2;
                let twig = grow(from, direction, [random.range(0.5, 0.8), thickness * 0.6], 2, random);
                taper(&mut wood, &twig, 3, habit.bark);
                twigs.push(twig);
            }
            twigs.push(branch);
            branches.push(twigs);
        }
        Self { wood, branches }
    }
}

/// Leaves of exactly `triangles`: two each, folded along the midrib, the last with one half where the number is odd.
fn leaves(habit: &Habit, twigs: &[Shoot], triangles: usize, random: &mut Random) -> Geometry {
    let mut g = Geometry::default();
    for k in 0..triangles.div_ceil(2) {
        let (at, along, _) = twigs[k % twigs.len()].at(random.range(0.25, 1.0));
        let turn = Quat::from_array(random.rotation());
        let out = (along * 0.5 + turn * Vec3::X + Vec3::Y * 0.2).normalize();
        // Leaves lie rather flat.
        let side = out.cross(Vec3::Y + turn * Vec3::Z * 0.7).normalize();
        let size = habit.leaf_m * random.range(0.8, 1.25);
        let fold = side.cross(out) * 0.08 * size;
        let stem = at + out * 0.03;
        let (tip, belly) = (stem + out * size, stem + out * 0.45 * size + fold);
        let (left, right) = (belly - side * 0.34 * size, belly + side * 0.34 * size);
        let color = *random.pick(&habit.leaves);
        g.polygon(&[stem, right, tip], color);
        if g.triangles() < triangles {
            g.polygon(&[stem, tip, left], color);
        }
    }
    g
}
