//! Gothic building: pointed arches, walls of tinted stones, tracery, ribbed vaults, clustered columns. Metres, Y up. Walls
//! stand along X, their fronts towards +Z.
use super::random::Random;
use super::solid::{Color, Geometry, ring};
use glam::{Vec2, Vec3, vec2, vec3};

/// Stones of a few tints, drawn one after the other.
pub struct Stones {
    tints: Vec<Color>,
    random: Random,
}

impl Stones {
    pub fn new(tints: &[Color], random: Random) -> Stones {
        Stones { tints: tints.to_vec(), random }
    }

    pub fn next(&mut self) -> Color {
        *self.random.pick(&self.tints)
    }
}

/// An arch of two arcs that meet in a point. `rise` is half of `width` at least.
#[derive(Clone, Copy)]
pub struct Pointed {
    pub width: f32,
    pub rise: f32,
}

impl Pointed {
    /// The arcs' centres lie at the ends of the span.
    pub fn equilateral(width: f32) -> Pointed {
        Pointed { width, rise: width * 0.75f32.sqrt() }
    }

    /// Distance of an arc's centre from the middle, and its radius.
    fn arc(self) -> (f32, f32) {
        let radius = (self.width * self.width / 4.0 + self.rise * self.rise) / self.width;
        (radius - self.width / 2.0, radius)
    }

    /// The arch about the same centres whose radius is larger by `by_m`.
    pub fn grown(self, by_m: f32) -> Pointed {
        let (center, radius) = self.arc();
        let radius = radius + by_m;
        Pointed { width: 2.0 * (radius - center), rise: (radius * radius - center * center).sqrt() }
    }

    /// Points from left to right about the middle of the span: `pieces` stretches on either side.
    pub fn outline(self, pieces: usize) -> Vec<Vec2> {
        let (center, radius) = self.arc();
        let (start, end) = (vec2(-1.0, 0.0), vec2(-center, self.rise) / radius);
        let left: Vec<Vec2> = (0..=pieces)
            .map(|k| match k {
                0 => vec2(-self.width / 2.0, 0.0),
                _ if k == pieces => vec2(0.0, self.rise),
                _ => vec2(center, 0.0) + start.lerp(end, k as f32 / pieces as f32).normalize() * radius,
            })
            .collect();
        let right = left.iter().rev().skip(1).map(|p| vec2(-p.x, p.y));
        left.iter().copied().chain(right).collect()
    }
}

/// A window or door: an arch on jambs.
#[derive(Clone, Copy)]
pub struct Opening {
    pub middle: f32,
    pub sill: f32,
    pub spring: f32,
    pub arch: Pointed,
    pub pieces: usize,
}

impl Opening {
    pub fn grown(self, by_m: f32) -> Opening {
        Opening { arch: self.arch.grown(by_m), ..self }
    }

    fn head(&self) -> Vec<Vec2> {
        let at = vec2(self.middle, self.spring);
        self.arch.outline(self.pieces).into_iter().map(|p| at + p).collect()
    }

    /// Up the left jamb, along the arch, down the right jamb.
    fn outline(&self) -> Vec<Vec2> {
        let mut path = self.head();
        let (first, last) = (path[0], path[path.len() - 1]);
        if self.sill < self.spring {
            path.insert(0, vec2(first.x, self.sill));
            path.push(vec2(last.x, self.sill));
        }
        path
    }
}

/// A wall from `low` to `high` between two planes.
#[derive(Clone, Copy)]
pub struct Wall {
    pub low: Vec2,
    pub high: Vec2,
    pub front: f32,
    pub back: f32,
    /// Width and height of a stone.
    pub stone: Vec2,
}

#[derive(Clone, Copy, PartialEq)]
pub enum Face {
    Front,
    Back,
}

impl Wall {
    /// Stones between two corners of one face.
    pub fn stones(&self, g: &mut Geometry, face: Face, [low, high]: [Vec2; 2], stones: &mut Stones) {
        if high.x - low.x < 1e-4 || high.y - low.y < 1e-4 {
            return;
        }
        let count = |length: f32, stone: f32| (length / stone).round().max(1.0) as usize;
        let (columns, rows) = (count(high.x - low.x, self.stone.x), count(high.y - low.y, self.stone.y));
        let x = |k: usize| low.x + (high.x - low.x) * k as f32 / columns as f32;
        let y = |k: usize| low.y + (high.y - low.y) * k as f32 / rows as f32;
        for k in 0..columns * rows {
            let (column, row) = (k % columns, k / columns);
            let corners = [
                vec2(x(column), y(row)),
                vec2(x(column + 1), y(row)),
                vec2(x(column + 1), y(row + 1)),
                vec2(x(column), y(row + 1)),
            ];
            self.face(g, face, corners, stones.next());
        }
    }

    fn face(&self, g: &mut Geometry, face: Face, corners: [Vec2; 4], color: Color) {
        let [a, b, c, d] = corners;
        match face {
            Face::Front => g.polygon(&[a, b, c, d].map(|p| p.extend(self.front)), color),
            Face::Back => g.polygon(&[b, a, d, c].map(|p| p.extend(self.back)), color),
        }
    }

    /// Both faces without openings.
    pub fn closed(&self, g: &mut Geometry, stones: &mut Stones) {
        for face in [Face::Front, Face::Back] {
            self.stones(g, face, [self.low, self.high], stones);
        }
    }

    /// Both faces around an opening, and its reveal. The wall's ends are left open: another wall adjoins.
    pub fn pierced(&self, g: &mut Geometry, opening: &Opening, stones: &mut Stones, reveal: Color) {
        let head = opening.head();
        let (left, right) = (head[0].x, head[head.len() - 1].x);
        for face in [Face::Front, Face::Back] {
            self.stones(g, face, [self.low, vec2(left, self.high.y)], stones);
            self.stones(g, face, [vec2(right, self.low.y), self.high], stones);
            self.stones(g, face, [vec2(left, self.low.y), vec2(right, opening.sill)], stones);
            // One tint: the strips over an arch are no courses.
            let color = stones.next();
            for pair in head.windows(2) {
                let top = |p: Vec2| vec2(p.x, self.high.y);
                self.face(g, face, [pair[0], pair[1], top(pair[1]), top(pair[0])], color);
            }
        }
        let mut path = opening.outline();
        if opening.sill > self.low.y {
            path.push(path[0]);
        }
        for pair in path.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let corners = [from.extend(self.front), from.extend(self.back), to.extend(self.back), to.extend(self.front)];
            g.polygon(&corners, reveal);
        }
    }

    /// Both faces around a round hole, which has to leave room at all sides, and its reveal. `sides` as [`ring`] has
    /// them, a multiple of eight.
    pub fn holed(&self, g: &mut Geometry, middle: Vec2, radius: f32, sides: usize, stones: &mut Stones, reveal: Color) {
        let half = 1.02 * radius;
        let (low, high) = (middle - half, middle + half);
        for face in [Face::Front, Face::Back] {
            self.stones(g, face, [self.low, vec2(self.high.x, low.y)], stones);
            self.stones(g, face, [vec2(self.low.x, high.y), self.high], stones);
            self.stones(g, face, [vec2(self.low.x, low.y), vec2(low.x, high.y)], stones);
            self.stones(g, face, [vec2(high.x, low.y), vec2(self.high.x, high.y)], stones);
        }
        let ring = ring(sides);
        for k in 0..sides {
            let (a, b) = (ring[k], ring[(k + 1) % sides]);
            let edge = |p: Vec2| middle + p / p.abs().max_element() * half;
            let (from, to) = (middle + a * radius, middle + b * radius);
            let color = stones.next();
            self.face(g, Face::Front, [from, edge(a), edge(b), to], color);
            self.face(g, Face::Back, [from, edge(a), edge(b), to], color);
            let corners = [from.extend(self.front), to.extend(self.front), to.extend(self.back), from.extend(self.back)];
            g.polygon(&corners, reveal);
        }
    }
}

/// A round moulding along an opening's jambs and arch, its middle at `z`.
pub fn roll(g: &mut Geometry, opening: &Opening, z: f32, radius: f32, sides: usize, color: Color) {
    let path: Vec<Vec3> = opening.outline().into_iter().map(|p| p.extend(z)).collect();
    g.tube(&path, radius, sides, color);
}

/// A ring that stands upright in the plane of a wall.
pub fn hoop(g: &mut Geometry, middle: Vec3, radius: f32, thickness: f32, sides: [usize; 2], color: Color) {
    let mut lying = Geometry::default();
    lying.torus(Vec3::ZERO, radius, thickness, sides, color);
    g.copy(&lying, |p| middle + vec3(p.x, -p.z, p.y));
}

/// How rich a window's bars are.
#[derive(Clone, Copy, PartialEq)]
pub enum Tracery {
    /// Two lancets below a ring.
    Plain,
    /// With four foils in the ring.
    Foiled,
    /// And plain tracery in either lancet.
    Double,
}

/// Bars of stone in an opening of an equilateral arch, their middle at `z`.
pub fn tracery(g: &mut Geometry, opening: &Opening, z: f32, kind: Tracery, color: Color) {
    let width = opening.arch.width;
    let bar = (0.035 * width).min(0.09);
    for side in [-0.25, 0.25] {
        let lancet = Opening {
            middle: opening.middle + side * width,
            arch: Pointed::equilateral(width / 2.0),
            pieces: (opening.pieces * 2 / 3).max(2),
            ..*opening
        };
        roll(g, &lancet, z, bar, 4, color);
        if kind == Tracery::Double {
            tracery(g, &lancet, z, Tracery::Plain, color);
        }
    }
    // Where a ring touches the arch and both lancets: its middle is √5/4 of the width above the springing.
    let middle = vec3(opening.middle, opening.spring + 0.559 * width, z);
    hoop(g, middle, 0.25 * width - bar, bar, [16, 4], color);
    let foils = if kind == Tracery::Plain { Vec::new() } else { ring(4) };
    for foil in foils {
        let at = middle + vec3(foil.x, foil.y, 0.0) * (0.125 * width);
        hoop(g, at, 0.085 * width, bar * 0.6, [8, 4], color);
    }
}

/// Panes of coloured glass that fill an opening, one sheet at `z`. It reaches a little into the reveal.
pub fn glass(g: &mut Geometry, opening: &Opening, z: f32, pane_m: f32, panes: &mut Stones) {
    let opening = opening.grown(0.04);
    let sill = opening.sill - 0.04;
    for pair in opening.head().windows(2) {
        let flat = pair[0].y.min(pair[1].y);
        let rows = ((flat - sill) / pane_m).round().max(1.0) as usize;
        let y = |row: usize| sill + (flat - sill) * row as f32 / rows as f32;
        for row in 0..rows {
            let (low, high) = (y(row), y(row + 1));
            let corners = [vec3(pair[0].x, low, z), vec3(pair[1].x, low, z), vec3(pair[1].x, high, z), vec3(pair[0].x, high, z)];
            g.polygon(&corners, panes.next());
        }
        let peak = if pair[0].y > pair[1].y { pair[0] } else { pair[1] };
        let corners = [vec3(pair[0].x, flat, z), vec3(pair[1].x, flat, z), peak.extend(z)];
        g.polygon(&corners, panes.next());
    }
}

/// Which ribs a vault has besides its diagonals.
#[derive(Clone, Copy, PartialEq)]
pub enum Ribs {
    Diagonal,
    /// One at its left end, where the next vault adjoins.
    Transverse,
}

/// A ribbed vault of four webs over a field of four corners, counterclockwise from above, at its springing.
pub struct Vault {
    pub corners: [Vec3; 4],
    pub rise: f32,
    /// Stretches of half an arch, and courses of stone from the groin to the side.
    pub pieces: usize,
    pub courses: usize,
}

impl Vault {
    fn at(&self, u: f32, v: f32) -> Vec3 {
        let [a, b, c, d] = self.corners;
        let near = a.lerp(b, (u + 1.0) / 2.0);
        let far = d.lerp(c, (u + 1.0) / 2.0);
        near.lerp(far, (v + 1.0) / 2.0)
    }

    /// Shares of half the span, and heights there, from the middle to the springing.
    fn profile(&self) -> Vec<Vec2> {
        let arch = Pointed { width: 2.0, rise: 1.25 }.outline(self.pieces);
        arch[self.pieces..].iter().map(|p| vec2(p.x, p.y / 1.25 * self.rise)).collect()
    }

    /// The webs as seen from below.
    pub fn webs(&self, g: &mut Geometry, stones: &mut Stones) {
        let profile = self.profile();
        for web in 0..4 {
            // A web from the middle towards its side: `out` runs outwards, `along` to the side.
            let place = |out: f32, along: f32, height: f32| {
                let (u, v) = [(out, along), (-along, out), (-out, -along), (along, -out)][web];
                self.at(u, v) + Vec3::Y * height
            };
            for half in [-1.0, 1.0] {
                for pair in profile.windows(2) {
                    let (p, q) = (pair[0], pair[1]);
                    for course in 0..self.courses {
                        let share = |k: usize, from: f32| from + (1.0 - from) * k as f32 / self.courses as f32;
                        let mut corners = [
                            place(share(course, p.x), half * p.x, p.y),
                            place(share(course + 1, p.x), half * p.x, p.y),
                            place(share(course + 1, q.x), half * q.x, q.y),
                            place(share(course, q.x), half * q.x, q.y),
                        ];
                        if half > 0.0 {
                            corners.reverse();
                        }
                        g.polygon(&corners, stones.next());
                    }
                }
            }
        }
    }

    /// Ribs along both diagonals, one from the last corner to the first where `ribs` wants it, and a boss.
    pub fn ribs(&self, g: &mut Geometry, ribs: Ribs, radius: f32, color: Color) {
        let profile = self.profile();
        let both: Vec<Vec2> = profile.iter().skip(1).rev().map(|p| vec2(-p.x, p.y)).chain(profile.iter().copied()).collect();
        let mut rib = |place: &dyn Fn(f32) -> (f32, f32)| {
            let path: Vec<Vec3> = both
                .iter()
                .map(|p| {
                    let (u, v) = place(p.x);
                    self.at(u, v) + Vec3::Y * (p.y - 0.3 * radius)
                })
                .collect();
            g.tube(&path, radius, 6, color);
        };
        rib(&|s| (s, s));
        rib(&|s| (s, -s));
        if ribs == Ribs::Transverse {
            rib(&|s| (-1.0, s));
        }
        let crown = self.at(0.0, 0.0) + Vec3::Y * (self.rise - 1.4 * radius);
        g.lathe(crown, &[(0.0, -0.1), (1.6 * radius, 0.0), (2.0 * radius, radius), (0.0, 1.5 * radius)], 12, color);
    }
}

/// A column of a core and `shafts` around it, on a base, below a capital with leaves.
pub struct Cluster {
    pub height: f32,
    pub radius: f32,
    pub shafts: usize,
}

impl Cluster {
    pub fn build(&self, g: &mut Geometry, base: Vec3, stone: Color, trim: Color) {
        let Cluster { height, radius, shafts } = *self;
        let capital = 1.3 * radius;
        let foot = [(1.5, 0.0), (1.5, 0.35), (1.25, 0.6), (1.25, 0.75), (1.0, 0.9)];
        g.lathe(base, &foot.map(|(r, y)| (r * radius, y * radius)), 12, trim);
        g.lathe(base, &[(0.86 * radius, 0.9 * radius), (0.86 * radius, height - capital)], 12, stone);
        for out in ring(shafts) {
            let at = base + vec3(out.x, 0.0, out.y) * (0.86 * radius);
            let shaft = [(0.26 * radius, 0.8 * radius), (0.17 * radius, 1.0 * radius), (0.17 * radius, height - capital)];
            g.lathe(at, &shaft, 6, stone);
        }
        let bell = [(0.9, 0.0), (1.05, 0.1), (0.92, 0.2), (1.0, 0.7), (1.35, 1.1), (1.35, 1.3)];
        let at = base + Vec3::Y * (height - capital);
        g.lathe(at, &bell.map(|(r, y)| (r * radius, y * radius)), 12, trim);
        for leaf in ring(shafts) {
            let out = vec3(leaf.x, 0.0, leaf.y) * radius;
            let path = [
                at + out * 0.95 + Vec3::Y * (0.2 * radius),
                at + out * 1.2 + Vec3::Y * (0.75 * radius),
                at + out * 1.42 + Vec3::Y * (0.72 * radius),
            ];
            g.tube(&path, 0.12 * radius, 4, trim);
        }
        let top = at + Vec3::Y * (1.3 * radius - 0.001);
        g.lathe(top, &[(1.42 * radius, -0.12 * radius), (1.42 * radius, 0.0), (0.0, 0.0)], 8, trim);
    }
}

/// A slender pyramid of eight sides with crockets up its edges and a finial, on a short shaft with gables.
pub fn pinnacle(g: &mut Geometry, base: Vec3, radius: f32, height: f32, crockets: usize, colors: [Color; 2]) {
    let [stone, trim] = colors;
    let shaft = 0.3 * height;
    g.lathe(base, &[(radius, 0.0), (radius, shaft), (1.15 * radius, shaft), (1.15 * radius, shaft * 1.06)], 8, stone);
    g.lathe(base, &[(1.15 * radius, shaft * 1.06), (0.12 * radius, height * 0.94), (0.0, height)], 8, stone);
    for edge in ring(8) {
        let out = vec3(edge.x, 0.0, edge.y);
        for k in 0..crockets {
            let share = (k as f32 + 0.5) / crockets as f32;
            let (r, y) = (1.15 * radius * (1.0 - 0.9 * share), shaft * 1.06 + (height * 0.94 - shaft * 1.06) * share);
            let size = 0.16 * radius * (1.2 - 0.7 * share);
            let at = base + out * r + Vec3::Y * y;
            g.tube(&[at - out * size, at + out * (1.5 * size) + Vec3::Y * (0.8 * size)], 0.6 * size, 4, trim);
        }
    }
    let cross = base + Vec3::Y * (height * 0.95);
    g.lathe(
        cross,
        &[(0.1 * radius, 0.0), (0.34 * radius, 0.02 * height), (0.1 * radius, 0.04 * height), (0.0, 0.08 * height)],
        8,
        trim,
    );
}
