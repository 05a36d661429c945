//! The collapses of a mesh, cheapest first, until none may be.

mod regions;

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::Vec3;
use mullion_common::scene::LinkShape;
use rayon::prelude::*;

use super::fitness::{Fitness, Star, Target};
use super::looks;
use super::quadric::Quadric;
use super::source::LodMesh;
use super::surface::{Fan, Surface};

pub(super) use regions::Regions;

/// How much leaving a border or a seam costs, beside leaving a plane.
const BORDER_WEIGHT: f32 = 2.0;
/// How much going somewhere else costs within a plane: so flat parts become coarse evenly, and hierarchies stay low.
const POINT_WEIGHT: f32 = 1e-3;

/// Set beside a key, the sign of a cost: the place has nowhere to go until something changes around it.
const PARKED: u32 = 1 << 31;
/// No key: the place is given up.
const GONE: u32 = u32::MAX;
/// A parked place is asked again once others cost so many times what it did: around what stays, something changes all the time.
const WAIT: f32 = 1.5;

/// The link of a vertex that was given up.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Head {
    pub length: usize,
    pub shape: LinkShape,
    /// Whether it goes together with the next in [`Collapses::vertices`], and splits behind it.
    pub is_follower: bool,
}

/// Collapses in their order: fine to coarse.
#[derive(Default)]
pub(super) struct Collapses {
    /// Vertices that were given up.
    pub vertices: Vec<u32>,
    pub heads: Vec<Head>,
    /// Their links, one behind the other; the vertex that took them is first or last.
    pub links: Vec<u32>,
    /// How far the surface may then be from the mesh, or look off, metres: an estimate. What was given up before and is part of it has no more.
    pub errors: Vec<f32>,
    /// What each cost, or more: none costs less than the one before it in its region.
    costs: Vec<f32>,
    /// What is left.
    pub triangles: Vec<[u32; 3]>,
}

impl Collapses {
    /// Collapses a mesh as far as it goes. The same mesh gives the same collapses.
    pub fn of(mesh: &LodMesh, regions: Regions) -> Self {
        let surface = Surface::of(mesh);
        let (quadrics, normals): (Vec<Quadric>, Vec<Vec3>) =
            (0..mesh.positions.len() as u32).into_par_iter().map(|v| quadric_and_normal(mesh, &surface, v)).unzip();
        let errors = vec![0.0; mesh.positions.len()];
        if mesh.triangles.len() < regions.least_triangles {
            let mut fitness = Fitness::new(mesh, normals);
            let mut queue = Queue::new(mesh, surface, quadrics, errors);
            let mut collapses = Self::default();
            collapses.run(&mut queue, &mut fitness, 0);
            return collapses;
        }
        drop(surface);
        let mut state = State { quadrics, normals, errors };
        let mut collapses = regions::collapse(mesh, &mut state, regions.triangles);
        let surface = Surface::of_triangles(&collapses.triangles, mesh.positions.len());
        let mut fitness = Fitness::new(mesh, state.normals);
        let mut queue = Queue::new(mesh, surface, state.quadrics, state.errors);
        collapses.run(&mut queue, &mut fitness, 0);
        collapses
    }

    /// Collapses what may be, until so few triangles are left.
    fn run(&mut self, queue: &mut Queue<'_>, fitness: &mut Fitness<'_>, least_triangles: usize) {
        let mut left = queue.surface.triangles().count();
        queue.fill(fitness);
        let mut targets = Vec::new();
        while left > least_triangles
            && let Some((place, key)) = queue.pop()
        {
            let Some((star, target, deviation)) = queue.best(fitness, place, &mut targets) else {
                queue.keys[place as usize] = key | PARKED;
                continue;
            };
            if queue.is_too_dear(key, target.cost) {
                queue.push(place, target.cost);
                continue;
            }
            let error = queue.collapse(place, &star, &target, deviation);
            left -= if matches!(star, Star::Border(..)) { 1 } else { 2 };
            self.record(&star, &target, error);
        }
        self.triangles = queue.surface.triangles().collect();
    }

    /// Notes vertices last to first: reversed, the lead comes first.
    fn record(&mut self, star: &Star, target: &Target, error: f32) {
        let cost = target.cost.max(self.costs.last().copied().unwrap_or(0.0));
        let count = star.sides().count();
        let sides: [Option<(u32, &Fan)>; 2] = {
            let mut sides = star.sides();
            [sides.next(), sides.next()]
        };
        for number in (0..count).rev() {
            let Some((vertex, fan)) = sides[number] else { continue };
            let onto = target.onto[number];
            let path = fan.path();
            let at = path.iter().position(|v| *v == onto).unwrap_or(0);
            let shape = match (fan.is_ring(), at) {
                (true, _) => LinkShape::Ring,
                (false, 0) => LinkShape::PathFromParent,
                (false, _) => LinkShape::PathToParent,
            };
            if fan.is_ring() {
                self.links.extend_from_slice(&path[at..]);
                self.links.extend_from_slice(&path[..at]);
            } else {
                self.links.extend_from_slice(path);
            }
            self.vertices.push(vertex);
            self.heads.push(Head { length: path.len(), shape, is_follower: number > 0 });
            self.errors.push(error);
            self.costs.push(cost);
        }
    }
}

/// What is known of places from collapse to collapse.
struct State {
    quadrics: Vec<Quadric>,
    normals: Vec<Vec3>,
    errors: Vec<f32>,
}

/// Places by what giving them up costs. A place's key may be less than that: it is asked anew when it comes first. It may be more, where what is around it
/// looks more alike since: then it comes late.
struct Queue<'a> {
    mesh: &'a LodMesh,
    surface: Surface,
    /// By place.
    quadrics: Vec<Quadric>,
    heap: BinaryHeap<Reverse<(u32, u32)>>,
    /// By place: its key in the heap, as the bits of a cost. Other entries mean nothing.
    keys: Vec<u32>,
    /// By place: how far the surface there may be from the mesh.
    errors: Vec<f32>,
}

impl<'a> Queue<'a> {
    fn new(mesh: &'a LodMesh, surface: Surface, quadrics: Vec<Quadric>, errors: Vec<f32>) -> Self {
        Self { mesh, surface, quadrics, heap: BinaryHeap::new(), keys: Vec::new(), errors }
    }

    fn fill(&mut self, fitness: &Fitness<'_>) {
        let count = self.mesh.positions.len() as u32;
        self.keys = (0..count)
            .into_par_iter()
            .map(|place| {
                let is_fixed = fitness.fixed.get(place as usize).is_some_and(|fixed| *fixed);
                if is_fixed || self.mesh.welds[place as usize] != place {
                    return GONE;
                }
                let star = Fitness::star(self.mesh, &self.surface, place);
                let cost = star.and_then(|star| star.targets().map(|t| self.cost(place, t[0])).reduce(f32::min));
                cost.map_or(PARKED, f32::to_bits)
            })
            .collect();
        let entries: Vec<Reverse<(u32, u32)>> =
            self.keys.iter().zip(0..).filter(|(key, _)| **key < PARKED).map(|(key, place)| Reverse((*key, place))).collect();
        self.heap = BinaryHeap::from(entries);
    }

    fn pop(&mut self) -> Option<(u32, u32)> {
        loop {
            let Reverse((key, place)) = self.heap.pop()?;
            if self.keys[place as usize] == key {
                return Some((place, key));
            }
        }
    }

    fn push(&mut self, place: u32, cost: f32) {
        // Costs are not negative, so their bits are in their order. One that is no number comes last.
        let key = cost.to_bits().min(PARKED - 1);
        self.keys[place as usize] = key;
        self.heap.push(Reverse((key, place)));
    }

    /// Whether another place comes before one that costs more than its key said.
    fn is_too_dear(&self, key: u32, cost: f32) -> bool {
        let cost = cost.to_bits().min(PARKED - 1);
        cost > key && self.heap.peek().is_some_and(|Reverse((next, _))| cost > *next)
    }

    fn cost(&self, place: u32, onto: u32) -> f32 {
        let onto = self.mesh.welds[onto as usize] as usize;
        let way = self.mesh.positions[onto] - self.mesh.positions[place as usize];
        let cost = self.quadrics[place as usize].at(way) + self.quadrics[onto].at(Vec3::ZERO);
        if cost.is_nan() { f32::INFINITY } else { cost }
    }

    /// What it costs to look so far off: as much as to be as far away.
    fn cost_of_looks(&self, star: &Star, looks_off: f32) -> f32 {
        if looks_off == 0.0 {
            return 0.0;
        }
        let position = |v: u32| self.mesh.positions[v as usize];
        let area = |(vertex, fan): (u32, &Fan)| -> f32 {
            let from = position(vertex);
            fan.edges().map(|(a, b)| (position(a) - from).cross(position(b) - from).length() / 2.0).sum()
        };
        let cost = star.sides().map(area).sum::<f32>() / 3.0 * looks_off * looks_off;
        if cost.is_nan() { f32::INFINITY } else { cost }
    }

    /// The cheapest way for a place to go that may be.
    fn best(&self, fitness: &mut Fitness<'_>, place: u32, targets: &mut Vec<Target>) -> Option<(Star, Target, f32)> {
        let star = Fitness::star(self.mesh, &self.surface, place)?;
        targets.clear();
        targets.extend(star.targets().map(|onto| {
            let looks_off = looks::deviation_at_vertex(self.mesh, &star, onto);
            Target { onto, cost: self.cost(place, onto[0]) + self.cost_of_looks(&star, looks_off) }
        }));
        targets.sort_unstable_by_key(|target| (target.cost.to_bits(), target.onto));
        let fit = targets.iter().find_map(|target| Some((*target, fitness.deviation(&self.surface, &star, target)?)));
        fit.map(|(target, deviation)| (star, target, deviation))
    }

    /// Gives a place up; gives back the error of the surface there.
    fn collapse(&mut self, place: u32, star: &Star, target: &Target, deviation: f32) -> f32 {
        for ((vertex, fan), onto) in star.sides().zip(target.onto) {
            self.surface.collapse(vertex, onto);
            // The neighbours of an edge that is gone lost a triangle.
            let at = fan.path().iter().position(|v| *v == onto).unwrap_or(0);
            let length = fan.path().len();
            self.surface.forget_gone(fan.path()[(at + 1) % length]);
            self.surface.forget_gone(fan.path()[(at + length - 1) % length]);
        }
        let onto = self.mesh.welds[target.onto[0] as usize] as usize;
        let way = self.mesh.positions[onto] - self.mesh.positions[place as usize];
        let moved = self.quadrics[place as usize].moved_to(way);
        self.quadrics[onto] += moved;
        self.keys[place as usize] = GONE;
        let error = deviation + self.errors[onto].max(self.errors[place as usize]);
        self.errors[onto] = error;
        for vertex in star.sides().flat_map(|(_, fan)| fan.path()) {
            let around = self.mesh.welds[*vertex as usize];
            let key = self.keys[around as usize];
            if key & PARKED != 0 && key != GONE {
                self.push(around, target.cost.max(f32::from_bits(key & !PARKED) * WAIT));
            }
        }
        error
    }
}

/// What leaving a place costs, and which way the mesh faces there; of the first vertex in a place, for all.
fn quadric_and_normal(mesh: &LodMesh, surface: &Surface, place: u32) -> (Quadric, Vec3) {
    let mut quadric = Quadric::default();
    let mut sum = Vec3::ZERO;
    if mesh.welds[place as usize] != place {
        return (quadric, sum);
    }
    let at = mesh.positions[place as usize];
    let relative = |v: u32| mesh.positions[v as usize] - at;
    for wedge in mesh.wedges_of(place) {
        for (a, b, _) in surface.around(wedge) {
            let normal = relative(a).cross(relative(b));
            sum += normal;
            let area = normal.length() / 2.0;
            quadric += Quadric::plane(normal.normalize_or_zero(), Vec3::ZERO, area / 3.0);
            quadric += Quadric::point(POINT_WEIGHT * area / 3.0);
        }
        if let Some(fan) = surface.fan(wedge).filter(|fan| !fan.is_ring()) {
            let path = fan.path();
            for (end, inside) in [(path[0], path[1]), (path[path.len() - 1], path[path.len() - 2])] {
                let (edge, face) = (relative(end), relative(end).cross(relative(inside)));
                let weight = BORDER_WEIGHT * edge.length_squared();
                quadric += Quadric::plane(face.cross(edge).normalize_or_zero(), Vec3::ZERO, weight);
            }
        }
    }
    let is_seen = |wedge: u32| surface.around(wedge).all(|(a, b, _)| relative(a).cross(relative(b)).dot(sum) > 0.0);
    let is_sound = sum.is_finite() && mesh.wedges_of(place).all(is_seen);
    (quadric, if is_sound { sum.normalize_or_zero() } else { Vec3::ZERO })
}
