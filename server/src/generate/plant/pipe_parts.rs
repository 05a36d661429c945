//! The shared meshes of the pipework. Each enters at the origin along +X and is drawn for a pipe of radius 1, so that a
//! node scales it; a straight pipe is one metre long and scaled to its length, too.
use crate::generate::glb_writer::{GlbWriter, MaterialId, MeshId};
use crate::generate::solid::{Color, Geometry, ring, srgb};
use glam::{Vec3, vec3};

/// Radius of an elbow's centre line and length of the fittings, in radii of the pipe.
pub const BEND_RADII: f32 = 3.0;
pub const VALVE_RADII: f32 = 7.0;
pub const FLANGES_RADII: f32 = 1.2;

/// What runs in the pipe, by its colour.
const SERVICES: [(&str, Color); 6] = [
    ("steam", srgb(206, 208, 210)),
    ("water", srgb(70, 146, 96)),
    ("gas", srgb(222, 180, 60)),
    ("air", srgb(112, 168, 206)),
    ("fire water", srgb(186, 52, 42)),
    ("oil", srgb(140, 96, 62)),
];

/// The parts of one service's lines.
pub struct PipeParts {
    pub service: &'static str,
    pub straight: MeshId,
    pub elbow: MeshId,
    pub flanges: MeshId,
    pub valve: MeshId,
}

impl PipeParts {
    /// One for each service.
    pub fn all(glb: &mut GlbWriter, paint: MaterialId) -> Vec<PipeParts> {
        let mut mesh =
            |service: &str, part: &str, geometry: Geometry| glb.mesh(&format!("{service} {part}"), &[(&geometry, paint)]);
        let parts = SERVICES.iter().map(|(service, color)| PipeParts {
            service,
            straight: mesh(service, "pipe", straight(*color)),
            elbow: mesh(service, "elbow", elbow(*color)),
            flanges: mesh(service, "flanges", flanges(0.0, *color)),
            valve: mesh(service, "valve", valve(*color)),
        });
        parts.collect()
    }
}

fn straight(color: Color) -> Geometry {
    let mut g = Geometry::default();
    g.tube(&[Vec3::ZERO, Vec3::X], 1.0, 16, color);
    g
}

/// From +X to +Y.
fn elbow(color: Color) -> Geometry {
    let mut g = Geometry::default();
    // The third quarter of a circle about (0, bend), from its lowest point.
    let circle = ring(32);
    let path: Vec<Vec3> = circle[24..].iter().chain(&circle[..1]).map(|c| vec3(c.x, c.y + 1.0, 0.0) * BEND_RADII).collect();
    g.tube(&path, 1.0, 16, color);
    g
}

/// Two flanges face to face with their bolts, from `x` on.
fn flanges(x: f32, color: Color) -> Geometry {
    let mut upright = Geometry::default();
    let steel = srgb(150, 154, 158);
    for y in [x, x + 0.65] {
        let profile = [(1.0, 0.0), (1.7, 0.05), (1.8, 0.1), (1.8, 0.5), (1.7, 0.55), (1.0, 0.55)];
        upright.lathe(vec3(0.0, y, 0.0), &profile, 24, color);
    }
    upright.lathe(vec3(0.0, x, 0.0), &[(1.3, 0.5), (1.3, 0.7)], 24, steel);
    for corner in ring(8) {
        upright.prism(vec3(corner.x * 1.5, x - 0.15, corner.y * 1.5), 0.16, 0.16, 1.5, 6, steel);
    }
    upright.laid()
}

/// A globe valve with its handwheel upwards.
fn valve(color: Color) -> Geometry {
    let (wheel, steel) = (srgb(170, 44, 38), srgb(150, 154, 158));
    let mut g = flanges(0.0, color);
    let far = flanges(VALVE_RADII - FLANGES_RADII, color);
    g.copy(&far, |p| p);
    let mut body = Geometry::default();
    let profile = [
        (1.0, 0.9),
        (1.1, 1.3),
        (1.5, 1.9),
        (1.9, 2.5),
        (2.1, 3.1),
        (2.15, 3.5),
        (2.1, 3.9),
        (1.9, 4.5),
        (1.5, 5.1),
        (1.1, 5.7),
        (1.0, 6.1),
    ];
    body.lathe(Vec3::ZERO, &profile, 24, color);
    g.copy(&body.laid(), |p| p);
    let middle = vec3(VALVE_RADII / 2.0, 0.0, 0.0);
    let bonnet =
        [(1.3, 1.2), (1.3, 2.6), (1.8, 2.7), (1.8, 3.3), (1.0, 3.4), (0.6, 4.2), (0.5, 5.0), (0.7, 5.1), (0.7, 5.5), (0.0, 5.6)];
    g.lathe(middle, &bonnet, 24, color);
    for corner in ring(8) {
        g.prism(middle + vec3(corner.x * 1.55, 2.55, corner.y * 1.55), 0.14, 0.14, 0.95, 6, steel);
    }
    g.tube(&[middle + vec3(0.0, 5.4, 0.0), middle + vec3(0.0, 8.0, 0.0)], 0.22, 12, steel);
    let hub = middle + vec3(0.0, 7.2, 0.0);
    g.torus(hub, 2.2, 0.2, [32, 8], wheel);
    for spoke in ring(4) {
        let out = vec3(spoke.x, 0.0, spoke.y);
        g.bar(hub + out * 0.2, hub + out * 2.1, [0.22, 0.14], wheel);
    }
    g
}
