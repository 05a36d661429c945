//! What encloses each node: its vertex, and all that comes of it by splits, down to the triangles of the mesh around.
//!
//! Places are put in a row, each behind the one that it splits from, so that a node is its own place and one piece of the row.

use std::ops::Range;

use glam::Vec3;
use mullion_common::scene::{NodeAxis, NodeExtent, PackedBounds};
use rayon::prelude::*;

use super::order::Ordered;
use super::source::LodMesh;
use super::surface::Surface;

/// Nodes of so few places are enclosed by the triangles themselves; of others, every place by a ball around its triangles.
const FEW_PLACES: usize = 16;
/// Places of the row that large nodes take as one.
const STRETCH: usize = 64;
/// What rounding may add to a length.
pub(super) const SLACK: f32 = 1.0 + 1e-5;

/// The bounds of every node, by its lead; those of followers mean nothing.
pub(super) fn node_bounds(mesh: &LodMesh, ordered: &Ordered) -> Vec<PackedBounds> {
    let row = Row::new(mesh, ordered);
    (ordered.base_count..ordered.count())
        .into_par_iter()
        .map(|lead| {
            if !ordered.is_lead(lead) {
                return PackedBounds::default();
            }
            let extent =
                NodeExtent { error: ordered.error(lead), ..row.extent(ordered.parent(lead), row.nodes[lead as usize].clone()) };
            PackedBounds::new(&extent)
        })
        .collect()
}

/// A place, or several, with the triangles around.
#[derive(Clone, Copy)]
struct Ball {
    center: Vec3,
    radius: f32,
    /// Half the sides of a box about the centre that encloses the triangles, too.
    half_box: Vec3,
    /// The sum of the triangles' normals, each as long as twice its area.
    normal: Vec3,
    /// Least cosine between that direction and a triangle's normal; at most 0 where there is none.
    least_cosine: f32,
}

struct Row<'a> {
    mesh: &'a LodMesh,
    surface: Surface,
    /// The first vertex of each place in the row.
    places: Vec<u32>,
    balls: Vec<Ball>,
    stretches: Vec<Ball>,
    /// By vertex: where its place is in the row.
    own: Vec<u32>,
    /// By lead: the piece of the row that its node is beside its own place.
    nodes: Vec<Range<u32>>,
}

impl<'a> Row<'a> {
    fn new(mesh: &'a LodMesh, ordered: &Ordered) -> Self {
        let surface = Surface::of(mesh);
        let (own, nodes, places) = lay_out(mesh, ordered);
        let balls: Vec<Ball> = places.par_iter().map(|place| ball(mesh, &surface, *place)).collect();
        let stretches = balls.par_chunks(STRETCH).map(joined).collect();
        Self { mesh, surface, places, balls, stretches, own, nodes }
    }

    /// What encloses a vertex's place and a piece of the row.
    fn extent(&self, vertex: u32, piece: Range<u32>) -> NodeExtent {
        let own = self.own[vertex as usize];
        let center = self.mesh.positions[self.places[own as usize] as usize];
        let mut sum = Vec3::ZERO;
        self.for_each(own, piece.clone(), |ball| sum += ball.normal);
        let mut extent = NodeExtent { axis: NodeAxis::along(sum), least_cosine: 1.0, ..NodeExtent::default() };
        let axis = extent.axis.direction();
        if piece.len() < FEW_PLACES {
            let places = std::iter::once(own).chain(piece).map(|at| self.places[at as usize]);
            let wedges = places.flat_map(|place| self.mesh.wedges_of(place));
            for (wedge, (a, b, _)) in wedges.flat_map(|wedge| self.surface.around(wedge).map(move |edge| (wedge, edge))) {
                let [p, a, b] = [wedge, a, b].map(|v| self.mesh.positions[v as usize]);
                [p, a, b].iter().for_each(|corner| extend(&mut extent, axis, *corner - center, 0.0, Vec3::ZERO));
                let normal = (a - p).cross(b - p).normalize_or_zero();
                extent.least_cosine = extent.least_cosine.min(if normal == Vec3::ZERO { 1.0 } else { axis.dot(normal) });
            }
        } else {
            self.for_each(own, piece, |ball| {
                extend(&mut extent, axis, ball.center - center, ball.radius, ball.half_box);
                let cosine = cosine_of_sum(axis.dot(ball.normal.normalize_or_zero()), ball.least_cosine);
                extent.least_cosine = extent.least_cosine.min(cosine);
            });
        }
        // The sphere reaches no further than the box.
        extent.radius = extent.radius.min(extent.half_box.length());
        for length in [&mut extent.radius, &mut extent.cylinder_radius, &mut extent.cylinder_below, &mut extent.cylinder_above] {
            *length *= SLACK;
        }
        extent.half_box *= SLACK;
        extent
    }

    /// The own place and those of a piece, as many together as may be where they are many.
    fn for_each(&self, own: u32, piece: Range<u32>, mut each: impl FnMut(&Ball)) {
        let (start, end) = (piece.start as usize, piece.end as usize);
        each(&self.balls[own as usize]);
        let (first, last) = (start.div_ceil(STRETCH), end / STRETCH);
        if end - start < 64 * STRETCH || first >= last {
            self.balls[start..end].iter().for_each(each);
        } else {
            self.balls[start..first * STRETCH].iter().for_each(&mut each);
            self.stretches[first..last].iter().for_each(&mut each);
            self.balls[last * STRETCH..end].iter().for_each(each);
        }
    }
}

/// Where the place of each vertex is, what piece each lead's node is, and the places.
fn lay_out(mesh: &LodMesh, ordered: &Ordered) -> (Vec<u32>, Vec<Range<u32>>, Vec<u32>) {
    const NONE: u32 = u32::MAX;
    let count = ordered.count();
    let weld = |v: u32| mesh.welds[ordered.source[v as usize] as usize];
    // Children finest first.
    let mut first_child = vec![NONE; count as usize];
    let mut next_child = vec![NONE; count as usize];
    for lead in (ordered.base_count..count).filter(|v| ordered.is_lead(*v)) {
        let parent = ordered.parent(lead) as usize;
        next_child[lead as usize] = first_child[parent];
        first_child[parent] = lead;
    }
    // How many places come of each lead's, itself counted.
    let mut sizes = vec![0u32; count as usize];
    for vertex in (ordered.base_count..count).rev() {
        let lead = if ordered.is_lead(vertex) { vertex } else { vertex - 1 };
        sizes[lead as usize] += u32::from(lead == vertex);
        if lead == vertex {
            let parent = ordered.parent(lead);
            let parent_lead = if parent < ordered.base_count || ordered.is_lead(parent) { parent } else { parent - 1 };
            sizes[parent_lead as usize] += sizes[lead as usize];
        }
    }
    let mut own = vec![NONE; count as usize];
    let mut nodes = vec![0..0; count as usize];
    let mut places = vec![NONE; 0];
    // Vertices of the base that are in one place share it.
    let mut place_of_weld = std::collections::HashMap::new();
    let mut end = 0;
    for vertex in 0..ordered.base_count {
        own[vertex as usize] = *place_of_weld.entry(weld(vertex)).or_insert_with(|| {
            places.push(weld(vertex));
            end += 1;
            end - 1
        });
    }
    places.resize(end as usize, NONE);
    let put = |vertex: u32, mut next: u32, own: &mut Vec<u32>, nodes: &mut Vec<Range<u32>>| {
        let start = next;
        let mut child = first_child[vertex as usize];
        while child != NONE {
            own[child as usize] = next;
            next += sizes[child as usize];
            nodes[child as usize] = start..next;
            child = next_child[child as usize];
        }
        next
    };
    let mut next = end;
    for vertex in 0..ordered.base_count {
        next = put(vertex, next, &mut own, &mut nodes);
    }
    places.resize(next as usize, NONE);
    // Where the children of a place may go, behind those of the lead.
    let mut behind = 0;
    for vertex in ordered.base_count..count {
        let start = if ordered.is_lead(vertex) {
            places[own[vertex as usize] as usize] = weld(vertex);
            own[vertex as usize] + 1
        } else {
            own[vertex as usize] = own[vertex as usize - 1];
            behind
        };
        behind = put(vertex, start, &mut own, &mut nodes);
    }
    (own, nodes, places)
}

fn ball(mesh: &LodMesh, surface: &Surface, place: u32) -> Ball {
    let center = mesh.positions[place as usize];
    let mut ball = Ball { center, radius: 0.0, half_box: Vec3::ZERO, normal: Vec3::ZERO, least_cosine: 1.0 };
    let around = || mesh.wedges_of(place).flat_map(|wedge| surface.around(wedge));
    let normal = |a: u32, b: u32| (mesh.positions[a as usize] - center).cross(mesh.positions[b as usize] - center);
    for (a, b, _) in around() {
        ball.normal += normal(a, b);
        for corner in [a, b] {
            let way = mesh.positions[corner as usize] - center;
            ball.radius = ball.radius.max(way.length());
            ball.half_box = ball.half_box.max(way.abs());
        }
    }
    let axis = ball.normal.normalize_or_zero();
    for (a, b, _) in around() {
        let normal = normal(a, b).normalize_or_zero();
        if normal != Vec3::ZERO {
            ball.least_cosine = ball.least_cosine.min(axis.dot(normal));
        }
    }
    ball
}

fn joined(balls: &[Ball]) -> Ball {
    let (mut low, mut high, mut normal) = (Vec3::INFINITY, Vec3::NEG_INFINITY, Vec3::ZERO);
    for ball in balls {
        low = low.min(ball.center - ball.half_box);
        high = high.max(ball.center + ball.half_box);
        normal += ball.normal;
    }
    let center = low.midpoint(high);
    let axis = normal.normalize_or_zero();
    let half_box = (high - center).max(center - low) * SLACK;
    let reach = balls.iter().map(|ball| ball.center.distance(center) + ball.radius).fold(0.0, f32::max);
    let cosine = |ball: &Ball| cosine_of_sum(axis.dot(ball.normal.normalize_or_zero()), ball.least_cosine);
    let least_cosine = balls.iter().map(cosine).fold(1.0, f32::min);
    Ball { center, radius: reach.min(half_box.length()), half_box, normal, least_cosine }
}

/// Makes an extent reach over a ball and the box in it; `way` is from the centre.
fn extend(extent: &mut NodeExtent, axis: Vec3, way: Vec3, radius: f32, half_box: Vec3) {
    let height = way.dot(axis);
    let across = (way - axis * height).length();
    extent.radius = extent.radius.max(way.length() + radius);
    extent.cylinder_radius = extent.cylinder_radius.max(across + radius);
    extent.cylinder_above = extent.cylinder_above.max(height + radius);
    extent.cylinder_below = extent.cylinder_below.max(radius - height);
    extent.half_box = extent.half_box.max(way.abs() + half_box);
}

/// The cosine of the sum of two angles, or −1 where one of them is no acute one.
pub(super) fn cosine_of_sum(a: f32, b: f32) -> f32 {
    if a <= 0.0 || b <= 0.0 {
        return -1.0;
    }
    let sine = |cosine: f32| (1.0 - cosine * cosine).max(0.0).sqrt();
    a * b - sine(a) * sine(b)
}
