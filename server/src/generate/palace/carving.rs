//! Carved stone: columns with brackets, arches, pierced screens, domes, small pavilions. Metres, Y up.
use super::Stone;
use crate::generate::solid::{Geometry, ring};
use glam::{Vec3, vec3};

/// An arch's outline has so many stretches at the most.
const FINEST_ARCH: usize = 64;

/// A column of `height`, its foot around `base`: square base, turned shaft of eight sides, capital, four brackets: 436
/// triangles.
pub fn column(g: &mut Geometry, base: Vec3, height: f32, stone: &Stone) {
    let scale = height / 4.0;
    let at = |x: f32, y: f32, z: f32| base + vec3(x, y, z) * scale;
    g.block(base, vec3(0.62, 0.3, 0.62) * scale, stone.dark);
    let profile: [(f32, f32); 14] = [
        (0.3, 0.3),
        (0.3, 0.36),
        (0.24, 0.44),
        (0.28, 0.52),
        (0.21, 0.62),
        (0.21, 1.3),
        (0.25, 1.36),
        (0.21, 1.42),
        (0.19, 2.5),
        (0.25, 2.58),
        (0.2, 2.66),
        (0.27, 2.8),
        (0.32, 2.95),
        (0.32, 3.0),
    ];
    let profile = profile.map(|(radius, y)| (radius * scale, y * scale));
    g.lathe(base, &profile, 8, stone.red);
    g.block(at(0.0, 3.0, 0.0), vec3(0.6, 0.16, 0.6) * scale, stone.dark);
    g.block(at(0.0, 3.16, 0.0), vec3(0.46, 0.84, 0.46) * scale, stone.red);
    for side in ring(4) {
        let out = vec3(side.x, 0.0, side.y) * scale;
        for step in 0..4 {
            let (low, reach) = (3.2 + 0.2 * step as f32, 0.42 + 0.2 * step as f32);
            let from = at(0.0, low + 0.1, 0.0) + out * 0.2;
            g.bar(from, at(0.0, low + 0.1, 0.0) + out * reach, [0.22 * scale, 0.2 * scale], stone.red);
        }
    }
}

/// Where and how large an arch is: a panel of a wall whose front is at z = 0, with an opening of pointed outline.
pub struct Arch {
    /// Low corner of the panel.
    pub corner: Vec3,
    /// Width and height of the panel.
    pub size: [f32; 2],
    /// Width of the opening, height where the curve starts, height of its point.
    pub opening: [f32; 3],
    /// The wall goes from z = 0 back to −`depth`.
    pub depth: f32,
    /// Stretches of the outline, even, [`FINEST_ARCH`] at the most.
    pub segments: usize,
}

/// Whether one sees through an arch.
#[derive(Clone, Copy, PartialEq)]
pub enum Back {
    Open,
    Closed,
}

impl Arch {
    /// The outline of the opening, left to right. Round at the sides, pointed in the middle, without trigonometry.
    fn outline(&self) -> Vec<Vec3> {
        let segments = self.segments.min(FINEST_ARCH);
        let [width, spring, rise] = [self.opening[0], self.opening[1], self.opening[2] - self.opening[1]];
        let middle = self.corner + vec3(self.size[0] / 2.0, 0.0, 0.0);
        (0..=segments)
            .map(|k| {
                let t = 2.0 * k as f32 / segments as f32 - 1.0;
                // Denser towards the sides, where the curve is steep.
                let u = t * (1.5 - 0.5 * t * t);
                let y = 0.72 * (1.0 - u * u).max(0.0).sqrt() + 0.28 * (1.0 - u.abs());
                middle + vec3(u * width / 2.0, spring + rise * y, 0.0)
            })
            .collect()
    }

    /// Front, reveal, a moulding of four sides along the outline, and either the back face or what closes the niche: 14
    /// triangles a stretch.
    pub fn build(&self, g: &mut Geometry, stone: &Stone, back: Back) {
        let outline = self.outline();
        let [width, height] = self.size;
        let (low, high) = (self.corner, self.corner + vec3(width, height, 0.0));
        let behind = vec3(0.0, 0.0, -self.depth);
        let (first, last) = (outline[0], outline[outline.len() - 1]);
        let (left, right) = (vec3(first.x, low.y, low.z), vec3(last.x, low.y, low.z));
        let mut face = |offset: Vec3, corners: [Vec3; 4]| {
            let corners = corners.map(|corner| corner + offset);
            match offset == Vec3::ZERO {
                true => g.polygon(&corners, stone.red),
                false => g.polygon(&[corners[1], corners[0], corners[3], corners[2]], stone.red),
            }
        };
        let sides: &[Vec3] = if back == Back::Open { &[Vec3::ZERO, behind] } else { &[Vec3::ZERO] };
        for offset in sides {
            face(*offset, [low, left, vec3(left.x, high.y, low.z), vec3(low.x, high.y, low.z)]);
            face(*offset, [right, vec3(high.x, low.y, low.z), high, vec3(right.x, high.y, low.z)]);
            for pair in outline.windows(2) {
                let top = |p: Vec3| vec3(p.x, high.y, p.z);
                face(*offset, [pair[0], pair[1], top(pair[1]), top(pair[0])]);
            }
        }
        let mut path = vec![left];
        path.extend(&outline);
        path.push(right);
        for pair in path.windows(2) {
            g.polygon(&[pair[0], pair[0] + behind, pair[1] + behind, pair[1]], stone.dark);
        }
        if back == Back::Closed {
            for pair in outline.windows(2) {
                let foot = |p: Vec3| vec3(p.x, low.y, p.z) + behind;
                g.polygon(&[foot(pair[0]), foot(pair[1]), pair[1] + behind, pair[0] + behind], stone.pale);
            }
        }
        let moulding: Vec<Vec3> = path.iter().map(|p| *p + vec3(0.0, 0.0, 0.03)).collect();
        g.tube(&moulding, 0.035 * self.opening[0].min(4.0), 4, stone.pale);
    }
}

/// A merlon of the parapets, pointed, 0.9 m high: 16 triangles. It stands along X on `foot`.
pub fn merlon(g: &mut Geometry, foot: Vec3, stone: &Stone) {
    let outline = [(-0.35, 0.0), (0.35, 0.0), (0.4, 0.45), (0.0, 0.9), (-0.4, 0.45)];
    let front = outline.map(|(x, y)| foot + vec3(x, y, 0.12));
    let rear = outline.map(|(x, y)| foot + vec3(x, y, -0.12));
    g.polygon(&front, stone.red);
    g.polygon(&[rear[4], rear[3], rear[2], rear[1], rear[0]], stone.red);
    for k in 0..5 {
        let next = (k + 1) % 5;
        g.polygon(&[front[next], front[k], rear[k], rear[next]], stone.dark);
    }
}

/// A pierced screen along X, `width` by `height`, of diagonal bars with a rosette where they cross, in a frame.
pub fn jali(g: &mut Geometry, corner: Vec3, [width, height]: [f32; 2], [columns, rows]: [usize; 2], stone: &Stone) {
    let (dx, dy) = (width / columns as f32, height / rows as f32);
    for k in 0..columns * rows {
        let low = corner + vec3((k % columns) as f32 * dx, (k / columns) as f32 * dy, 0.0);
        let (right, up) = (vec3(dx, 0.0, 0.0), vec3(0.0, dy, 0.0));
        let thickness = [0.05, 0.16 * dx];
        g.bar(low, low + right + up, thickness, stone.pale);
        g.bar(low + up, low + right, thickness, stone.pale);
        let middle = low + (right + up) / 2.0;
        g.tube(&[middle - vec3(0.0, 0.0, 0.04), middle + vec3(0.0, 0.0, 0.04)], 0.22 * dx, 8, stone.pale);
    }
    let far = corner + vec3(width, height, 0.0);
    for y in [corner.y, far.y] {
        g.bar(vec3(corner.x, y, corner.z), vec3(far.x, y, corner.z), [0.2, 0.16], stone.red);
    }
    for x in [corner.x, far.x] {
        g.bar(vec3(x, corner.y, corner.z), vec3(x, far.y, corner.z), [0.2, 0.16], stone.red);
    }
}

/// A dome on a drum with a finial, `radius` wide, its drum's foot around `base`.
pub fn dome(g: &mut Geometry, base: Vec3, radius: f32, [sides, bands]: [usize; 2], stone: &Stone) {
    let drum = [(1.08, 0.0), (1.08, 0.06), (1.0, 0.1), (1.0, 0.34), (1.06, 0.38), (1.06, 0.42), (1.0, 0.45)];
    g.lathe(base, &drum.map(|(r, y)| (r * radius, y * radius)), sides, stone.dark);
    // A little wider than a half sphere, and pointed.
    let shell: Vec<(f32, f32)> = (0..=bands)
        .map(|k| {
            let t = k as f32 / bands as f32;
            let u = t * (1.5 - 0.5 * t * t);
            let bulge = 1.0 + 0.16 * u * (1.0 - u);
            let r = if k == bands { 0.0 } else { (1.0 - u * u).max(0.0).sqrt() * bulge };
            (r * radius, (0.45 + 1.02 * u + 0.1 * u * u) * radius)
        })
        .collect();
    g.lathe(base, &shell, sides, stone.pale);
    let finial = [
        (0.3, 1.46),
        (0.34, 1.5),
        (0.2, 1.58),
        (0.06, 1.62),
        (0.12, 1.7),
        (0.12, 1.74),
        (0.04, 1.8),
        (0.08, 1.86),
        (0.03, 1.92),
        (0.0, 2.1),
    ];
    g.lathe(base, &finial.map(|(r, y)| (r * radius, y * radius)), 16, stone.gilt);
}

/// A pavilion on four columns under a dome, 4 m square.
pub fn chhatri(g: &mut Geometry, base: Vec3, stone: &Stone) {
    g.block(base, vec3(4.0, 0.3, 4.0), stone.dark);
    for (x, z) in [(-1.5, -1.5), (1.5, -1.5), (1.5, 1.5), (-1.5, 1.5)] {
        column(g, base + vec3(x, 0.3, z), 2.8, stone);
    }
    g.block(base + vec3(0.0, 3.1, 0.0), vec3(3.8, 0.3, 3.8), stone.red);
    // The eaves slope outwards.
    let eaves = [(2.4, 3.4), (3.4, 3.15), (3.45, 3.22), (2.3, 3.65)];
    g.lathe(base, &eaves, 16, stone.dark);
    dome(g, base + vec3(0.0, 3.5, 0.0), 1.75, [24, 20], stone);
}
