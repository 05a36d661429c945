//! Lines of pipe: long runs along the racks, then elbows, valves and flanges on their way to somewhere on the level.
use super::pipe_parts::{BEND_RADII, FLANGES_RADII, PipeParts, VALVE_RADII};
use super::{AREA_M, HALF_WIDTH_M};
use crate::generate::glb_writer::{GlbWriter, NodeId, Place};
use crate::generate::random::Random;
use glam::{Vec3, vec3};

/// A node that gets lines: its x axis runs along the rack from the area's start.
pub struct Rack {
    pub node: NodeId,
}

/// Least and most lines of a rack, and parts of a line.
const LINES: [usize; 2] = [2, 14];
const PARTS: [usize; 2] = [2, 12];
/// Lines lie on the rack in two tiers, so far apart.
const SLOT_M: f32 = 0.62;
/// Pipes come in these radii.
const RADII_M: [f32; 6] = [0.05, 0.08, 0.11, 0.16, 0.22, 0.3];
const SHORTEST_M: f32 = 0.4;

/// Adds exactly so many leaves in exactly so many groups (lines) to the racks.
pub fn fill(glb: &mut GlbWriter, pipes: &[PipeParts], racks: &[Rack], [leaves, groups]: [usize; 2], random: &mut Random) {
    let lines = deal(groups, racks.len(), LINES, random);
    let mut parts = deal(leaves, groups, PARTS, random).into_iter();
    for (rack, lines) in racks.iter().zip(lines) {
        let mut random = random.fork();
        for (slot, parts) in parts.by_ref().take(lines).enumerate() {
            let service = random.pick(pipes);
            let (place, run_m) = start(slot, &mut random);
            let line = glb.node(Some(rack.node), format!("{} line {}", service.service, slot + 1), None, place);
            Line::new(service, line, &mut random).lay(glb, parts, run_m, &mut random);
        }
    }
}

/// `total` in `hands` parts of `low` to `high`, some far larger than others.
fn deal(total: usize, hands: usize, [low, high]: [usize; 2], random: &mut Random) -> Vec<usize> {
    assert!((hands * low..=hands * high).contains(&total), "{total} cannot be {hands} parts of {low} to {high}");
    let mut dealt = vec![low; hands];
    let mut left = total - hands * low;
    while left > 0 {
        let hand = random.below(hands);
        let more = random.below(4).min(high - dealt[hand]).min(left);
        dealt[hand] += more;
        left -= more;
    }
    dealt
}

/// Where a line starts, and how far it runs until something is on it. Most lines lie in the rack; some cross the level
/// at an angle, some fall towards a drain.
fn start(slot: usize, random: &mut Random) -> (Place, f32) {
    let (column, tier) = ((slot / 2) as f32 - 3.0, (slot % 2) as f32);
    let at = vec3(0.0, tier * 0.7, column * SLOT_M);
    match random.below(10) {
        0 | 1 => {
            let at = at + vec3(random.range(4.0, 12.0), random.range(-1.5, 0.0), 0.0);
            (Place::yawed(at, random.range(-0.5, 0.5)), random.range(3.0, 9.0))
        }
        2 => {
            let fall = vec3(1.0, random.range(-0.12, -0.04), random.range(-0.05, 0.05));
            (Place::between(at, at + fall, [1.0, 1.0]).scaled(Vec3::ONE), random.range(8.0, AREA_M - 4.0))
        }
        3 | 4 => (Place::at(at), random.range(6.0, AREA_M - 2.0)),
        _ => (Place::at(at), AREA_M - 0.8),
    }
}

/// A line on its way.
struct Line<'a> {
    pipes: &'a PipeParts,
    node: NodeId,
    radius_m: f32,
    at: Vec3,
    along: Vec3,
}

impl<'a> Line<'a> {
    fn new(pipes: &'a PipeParts, node: NodeId, random: &mut Random) -> Line<'a> {
        let radius_m = *random.pick(&RADII_M);
        Line { pipes, node, radius_m, at: Vec3::ZERO, along: Vec3::X }
    }

    /// Pipes and fittings in turn, beginning with the long run.
    fn lay(mut self, glb: &mut GlbWriter, parts: usize, run_m: f32, random: &mut Random) {
        let mut length_m = run_m;
        for part in 0..parts {
            if part % 2 == 0 {
                self.straight(glb, length_m);
                length_m = random.range(SHORTEST_M, 4.0);
            } else {
                match random.below(20) {
                    0..=8 => length_m = self.turn(glb, random),
                    9..=15 => self.valve(glb),
                    _ => self.flanges(glb),
                }
            }
        }
    }

    fn straight(&mut self, glb: &mut GlbWriter, length_m: f32) {
        let scale = vec3(length_m, self.radius_m, self.radius_m);
        glb.node(Some(self.node), "pipe".into(), Some(self.pipes.straight), self.place(self.upwards()).scaled(scale));
        self.at += self.along * length_m;
    }

    /// A right angle towards somewhere on this level; gives the length of the way there.
    fn turn(&mut self, glb: &mut GlbWriter, random: &mut Random) -> f32 {
        let target = vec3(random.range(1.0, AREA_M - 1.0), random.range(-3.8, 1.0), random.range(-0.3, 0.3) * HALF_WIDTH_M);
        let way = (target - self.at).reject_from_normalized(self.along);
        let axis = way.abs().max_position();
        let mut to = Vec3::ZERO;
        to[axis] = if way[axis] < 0.0 { -1.0 } else { 1.0 };
        glb.node(Some(self.node), "elbow".into(), Some(self.pipes.elbow), self.fitting(to));
        self.at += (self.along + to) * BEND_RADII * self.radius_m;
        self.along = to;
        way[axis].abs().max(SHORTEST_M)
    }

    fn valve(&mut self, glb: &mut GlbWriter) {
        glb.node(Some(self.node), "valve".into(), Some(self.pipes.valve), self.fitting(self.upwards()));
        self.at += self.along * VALVE_RADII * self.radius_m;
    }

    fn flanges(&mut self, glb: &mut GlbWriter) {
        glb.node(Some(self.node), "flanges".into(), Some(self.pipes.flanges), self.fitting(self.upwards()));
        self.at += self.along * FLANGES_RADII * self.radius_m;
    }

    /// Where handwheels point.
    fn upwards(&self) -> Vec3 {
        if self.along.y == 0.0 { Vec3::Y } else { Vec3::Z }
    }

    fn fitting(&self, up: Vec3) -> Place {
        self.place(up).scaled(Vec3::splat(self.radius_m))
    }

    fn place(&self, up: Vec3) -> Place {
        Place::facing(self.at, self.along, up)
    }
}
