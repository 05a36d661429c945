//! What stands along the streets: trees, lamp posts, cars, all shared meshes.
use crate::generate::glb_writer::{GlbWriter, MaterialId, MeshId};
use crate::generate::random::Random;
use crate::generate::solid::{Color, Geometry, srgb};
use glam::{Vec2, Vec3, vec3};

pub struct Furniture {
    pub trees: Vec<MeshId>,
    pub lamp_post: MeshId,
    pub cars: Vec<MeshId>,
}

impl Furniture {
    pub fn new(glb: &mut GlbWriter, paint: MaterialId, leaves: MaterialId, glass: MaterialId, random: &mut Random) -> Furniture {
        let trees = (0..3).map(|k| tree(glb, paint, leaves, 5.5 + 1.4 * k as f32, random)).collect();
        let mut post = Geometry::default();
        lamp_post(&mut post);
        let lamp_post = glb.mesh("lamp post", &[(&post, paint)]);
        let lacquers = [srgb(168, 40, 36), srgb(226, 224, 216), srgb(44, 72, 110), srgb(70, 74, 78), srgb(214, 158, 48)];
        let cars = lacquers.iter().map(|lacquer| car(glb, paint, glass, *lacquer)).collect();
        Furniture { trees, lamp_post, cars }
    }
}

/// A trunk, two crowns, and cards of leaves cut out by an alpha mask.
fn tree(glb: &mut GlbWriter, paint: MaterialId, leaves: MaterialId, height: f32, random: &mut Random) -> MeshId {
    let mut trunk = Geometry::default();
    trunk.prism(Vec3::ZERO, 0.22, 0.12, height * 0.62, 6, srgb(98, 76, 56));
    let mut crown = Geometry::default();
    let middle = vec3(0.0, height * 0.68, 0.0);
    let radius = height * 0.22;
    let tone = 0.85 + 0.3 * random.unit();
    let green = srgb((62.0 * tone) as u8, (98.0 * tone) as u8, (42.0 * tone) as u8);
    crown.ball(middle, vec3(radius, radius * 1.15, radius), green);
    let mut cards = Geometry::default();
    for _ in 0..14 {
        let out = loop {
            let v = vec3(random.range(-1.0, 1.0), random.range(-0.8, 1.0), random.range(-1.0, 1.0));
            if v.length() > 0.2 && v.length() < 1.0 {
                break v.normalize();
            }
        };
        let across = out.cross(vec3(random.range(-1.0, 1.0), 0.3, 1.7)).normalize();
        let (u, v) = (across * radius * 0.95, out.cross(across).normalize() * radius * 0.95);
        let center = middle + out * radius * 0.86;
        cards.textured(
            [center - u - v, center + u - v, center + u + v, center - u + v],
            Vec2::new(0.0, 1.0),
            Vec2::new(1.0, 0.0),
        );
    }
    glb.mesh("tree", &[(&trunk, paint), (&crown, paint), (&cards, leaves)])
}

fn lamp_post(g: &mut Geometry) {
    let iron = srgb(52, 60, 58);
    g.prism(Vec3::ZERO, 0.16, 0.12, 0.5, 8, iron);
    g.prism(vec3(0.0, 0.5, 0.0), 0.06, 0.05, 4.6, 6, iron);
    g.cuboid(vec3(-0.04, 5.0, -0.04), vec3(1.1, 5.08, 0.04), iron);
    g.cuboid(vec3(0.7, 4.9, -0.12), vec3(1.15, 5.0, 0.12), srgb(250, 232, 180));
}

fn car(glb: &mut GlbWriter, paint: MaterialId, glass: MaterialId, lacquer: Color) -> MeshId {
    let mut body = Geometry::default();
    body.cuboid(vec3(-0.86, 0.3, -2.1), vec3(0.86, 0.85, 2.1), lacquer);
    body.cuboid(vec3(-0.74, 1.38, -1.0), vec3(0.74, 1.44, 0.7), lacquer);
    body.cuboid(vec3(-0.7, 0.85, -0.6), vec3(0.7, 1.0, 0.4), srgb(50, 46, 44));
    for (x, z) in [(-0.8, -1.35), (0.8, -1.35), (0.8, 1.3), (-0.8, 1.3)] {
        body.cuboid(vec3(x - 0.1, 0.0, z - 0.32), vec3(x + 0.1, 0.64, z + 0.32), srgb(30, 30, 32));
    }
    for x in [-0.6, 0.6] {
        body.cuboid(vec3(x - 0.15, 0.58, 2.08), vec3(x + 0.15, 0.72, 2.13), srgb(250, 244, 220));
        body.cuboid(vec3(x - 0.15, 0.58, -2.13), vec3(x + 0.15, 0.72, -2.08), srgb(190, 24, 20));
    }
    // The cabin: four leaning panes between the body and the roof.
    let low = [vec3(-0.84, 0.85, -1.5), vec3(0.84, 0.85, -1.5), vec3(0.84, 0.85, 1.25), vec3(-0.84, 0.85, 1.25)];
    let high = [vec3(-0.74, 1.38, -1.0), vec3(0.74, 1.38, -1.0), vec3(0.74, 1.38, 0.7), vec3(-0.74, 1.38, 0.7)];
    let mut panes = Geometry::default();
    for k in 0..4 {
        let next = (k + 1) % 4;
        panes.polygon(&[low[next], low[k], high[k], high[next]], [255; 4]);
    }
    panes.colors.clear();
    glb.mesh("car", &[(&body, paint), (&panes, glass)])
}
