//! A palace city of red sandstone of the size that the paper culls (Nirnimesh, Harish, Narayanan 2006, section 5): the
//! node tree of its Fatehpur Sikri, 288 inner nodes over 482 leaves, 1.6 million triangles.
//!
//! Nodes: palace, quarter, court or building, side, run. X is east, +Z south; the mosque stands on the ridge in the
//! west, the courts step down to the east. Every leaf is one mesh of about 3300 triangles, used many times. What the
//! monuments leave of both numbers goes to the houses of the town.
mod buildings;
mod carving;
mod masonry;

use super::glb_writer::{Alpha, Glb, GlbWriter, MaterialId, MeshId, NodeId, Place, Sides};
use super::random::Random;
use super::solid::{Color, Geometry, srgb};
use glam::{Vec3, vec3};
use masonry::{COLONNADE_M, HOUSE_M, Masonry, RUN_M};

/// Nodes without a mesh, and nodes with one.
const GROUPS: usize = 288;
const LEAVES: usize = 482;

/// The quarry's tints: each seed has its own.
struct Stone {
    red: Color,
    dark: Color,
    worn: Color,
    pale: Color,
    gilt: Color,
    water: Color,
    earth: Color,
    dust: Color,
    scrub: Color,
}

impl Stone {
    fn draw(random: &mut Random) -> Stone {
        let mut tint = |r: f32, g: f32, b: f32| {
            let tone = random.range(0.95, 1.05);
            srgb((r * tone) as u8, (g * tone) as u8, (b * tone) as u8)
        };
        Stone {
            red: tint(186.0, 108.0, 82.0),
            dark: tint(154.0, 82.0, 62.0),
            worn: tint(200.0, 126.0, 98.0),
            pale: tint(222.0, 196.0, 168.0),
            gilt: tint(206.0, 164.0, 78.0),
            water: tint(86.0, 126.0, 116.0),
            earth: tint(176.0, 148.0, 112.0),
            dust: tint(184.0, 156.0, 120.0),
            scrub: tint(160.0, 142.0, 100.0),
        }
    }
}

/// Adds leaves and groups to the tree.
struct Builder {
    glb: GlbWriter,
    paint: MaterialId,
    stone: Stone,
    masonry: Masonry,
}

impl Builder {
    fn group(&mut self, parent: NodeId, name: impl Into<String>, place: Place) -> NodeId {
        self.glb.node(Some(parent), name.into(), None, place)
    }

    fn leaf(&mut self, parent: NodeId, name: &str, mesh: MeshId, place: Place) {
        self.glb.node(Some(parent), name.into(), Some(mesh), place);
    }

    /// A mesh that is used once.
    fn own_leaf(&mut self, parent: NodeId, name: &str, place: Place, build: impl Fn(&mut Geometry, &Stone)) {
        let mut geometry = Geometry::default();
        build(&mut geometry, &self.stone);
        let mesh = self.glb.mesh(name, &[(&geometry, self.paint)]);
        self.leaf(parent, name, mesh, place);
    }
}

/// The palace as a file.
pub fn generate(seed: u64) -> Glb {
    let mut random = Random::new(seed);
    let mut glb = GlbWriter::default();
    let paint = glb.material("sandstone", [1.0; 4], None, Alpha::Opaque, Sides::One);
    let stone = Stone::draw(&mut random.fork());
    let masonry = Masonry::new(&mut glb, paint, &stone);
    let palace = glb.node(None, "palace".into(), None, Place::at(Vec3::ZERO));
    let mut b = Builder { glb, paint, stone, masonry };
    b.own_leaf(palace, "land", Place::at(Vec3::ZERO), masonry::land);
    mosque_quarter(&mut b, palace);
    palace_quarter(&mut b, palace);
    buildings::walls(&mut b, palace);
    town(&mut b, palace, &mut random.fork());
    b.glb.finish("mullion generate palace")
}

fn mosque_quarter(b: &mut Builder, palace: NodeId) {
    let quarter = b.group(palace, "mosque quarter", Place::at(vec3(-110.0, 10.0, 30.0)));
    let arcade = b.masonry.arcade;
    let court = Court { size: [4, 3], height_m: 10.0, side: arcade, roof_y_m: 6.3 };
    court.build(b, quarter, "court of the mosque", Vec3::ZERO);
    buildings::prayer_hall(b, quarter, vec3(-46.0, 0.0, 0.0));
    buildings::great_gate(b, quarter, vec3(0.0, 0.0, 50.0));
    buildings::tomb(b, quarter, "tomb of the saint", vec3(4.0, 0.0, -18.0));
    buildings::tomb(b, quarter, "tomb of the viceroy", vec3(30.0, 0.0, -20.0));
}

fn palace_quarter(b: &mut Builder, palace: NodeId) {
    let quarter = b.group(palace, "palace quarter", Place::at(Vec3::ZERO));
    let side = b.masonry.colonnade;
    let roof_y_m = COLONNADE_M[0] + 0.3;
    let court = |b: &mut Builder, name: &str, at: Vec3, size: [usize; 2]| {
        let node = b.group(quarter, name, Place::at(at));
        Court { size, height_m: at.y, side, roof_y_m }.build(b, node, "court", Vec3::ZERO);
        node
    };
    let private = court(b, "private court", vec3(30.0, 4.0, -10.0), [3, 4]);
    buildings::five_storeys(b, private, vec3(-22.0, 0.0, 0.0));
    buildings::private_audience(b, private, vec3(14.0, 0.0, -30.0));
    buildings::pool(b, private, vec3(14.0, 0.0, 24.0));
    let public = court(b, "court of public audience", vec3(125.0, 4.0, -10.0), [3, 3]);
    buildings::pavilion(b, public, "hall of public audience", vec3(-20.0, 0.0, 0.0));
    let zenana = court(b, "zenana", vec3(20.0, 4.0, 88.0), [2, 2]);
    buildings::corner_domes(b, zenana, vec3(24.0, 0.0, 24.0));
    let minister = court(b, "minister's house", vec3(-60.0, 4.0, -65.0), [2, 2]);
    buildings::pavilion(b, minister, "minister's hall", vec3(0.0, 0.0, 0.0));
    court(b, "elephants' court", vec3(-135.0, 4.0, -75.0), [2, 3]);
    let inn = court(b, "caravanserai", vec3(125.0, 2.0, 90.0), [3, 3]);
    buildings::pavilion(b, inn, "well house", vec3(0.0, 0.0, 0.0));
}

/// A paved court between four sides of runs, on a terrace, a chhatri at each corner.
struct Court {
    /// Squares of paving along X and Z.
    size: [usize; 2],
    /// Of the terrace below the court.
    height_m: f32,
    side: MeshId,
    roof_y_m: f32,
}

impl Court {
    fn build(&self, b: &mut Builder, parent: NodeId, name: &str, at: Vec3) {
        let court = b.group(parent, name, Place::at(at));
        let [columns, rows] = self.size;
        let half = vec3(columns as f32, 0.0, rows as f32) * RUN_M / 2.0;
        let terrace = vec3(2.0 * half.x + 14.0, self.height_m, 2.0 * half.z + 14.0);
        b.own_leaf(court, "terrace", Place::at(Vec3::ZERO), |g, stone| masonry::terrace(g, terrace, stone));
        let pavement = b.group(court, "pavement", Place::at(Vec3::ZERO));
        for row in 0..rows {
            let z = (row as f32 + 0.5) * RUN_M - half.z;
            let strip = b.group(pavement, format!("strip {}", row + 1), Place::at(vec3(0.0, 0.0, z)));
            for column in 0..columns {
                let x = (column as f32 + 0.5) * RUN_M - half.x;
                b.leaf(strip, "paving", b.masonry.paving, Place::at(vec3(x, 0.0, 0.0)));
            }
        }
        let sides = b.group(court, "sides", Place::at(Vec3::ZERO));
        for (k, name) in ["north side", "west side", "south side", "east side"].into_iter().enumerate() {
            let (runs, depth) = if k % 2 == 0 { (columns, half.z) } else { (rows, half.x) };
            let side = b.group(sides, name, Place::turned(Vec3::ZERO, k));
            for run in 0..runs {
                let x = (run as f32 - runs as f32 / 2.0) * RUN_M;
                let node = b.group(side, format!("run {}", run + 1), Place::at(vec3(x, 0.0, -depth)));
                b.leaf(node, "colonnade", self.side, Place::at(Vec3::ZERO));
                b.leaf(node, "roof", b.masonry.roof, Place::at(vec3(0.0, self.roof_y_m, 0.0)));
            }
        }
        let corners = b.group(court, "corners", Place::at(vec3(0.0, 0.0, 0.0)));
        for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let at = vec3(x * (half.x + 3.0), 0.3, z * (half.z + 3.0));
            b.leaf(corners, "chhatri", b.masonry.chhatri, Place::at(at).scaled(vec3(1.2, 1.5, 1.2)));
        }
    }
}

/// Streets of houses, with and without a pavilion on the roof, that use up both numbers exactly.
fn town(b: &mut Builder, palace: NodeId, random: &mut Random) {
    let town = b.group(palace, "town", Place::at(Vec3::ZERO));
    // Start and direction of each street.
    let streets: [([f32; 2], [f32; 2]); 8] = [
        ([-190.0, 130.0], [1.0, 0.04]),
        ([-30.0, 140.0], [1.0, 0.0]),
        ([-190.0, 160.0], [1.0, 0.03]),
        ([-40.0, 168.0], [1.0, -0.03]),
        ([-20.0, -95.0], [1.0, 0.05]),
        ([-20.0, -122.0], [1.0, 0.02]),
        ([-30.0, -150.0], [1.0, -0.02]),
        ([-40.0, -178.0], [1.0, 0.03]),
    ];
    let [leaves, groups] = b.glb.leaves_and_groups();
    let (leaves, groups) = (LEAVES - leaves, GROUPS - groups - streets.len());
    // A house with a pavilion is two groups and three leaves, one without is one group and two leaves.
    let (with_pavilion, without) = (2 * groups - leaves, 2 * leaves - 3 * groups);
    let houses = with_pavilion + without;
    for (k, ([x, z], [dx, dz])) in streets.into_iter().enumerate() {
        let street = b.group(town, format!("street {}", k + 1), Place::at(vec3(x, 0.0, z)));
        for (place, house) in (k * houses / streets.len()..(k + 1) * houses / streets.len()).enumerate() {
            let along = 24.0 * place as f32;
            let at = vec3(dx * along, -0.2, dz * along + random.range(-2.0, 2.0));
            let node = b.group(street, format!("house {}", house + 1), Place::yawed(at, random.range(-0.15, 0.15)));
            b.leaf(node, "walls", b.masonry.house, Place::at(Vec3::ZERO));
            // Spread evenly over the town.
            let has_pavilion = (house + 1) * with_pavilion / houses > house * with_pavilion / houses;
            let roof = Place::at(vec3(0.0, HOUSE_M[1], 0.0));
            if has_pavilion {
                let top = b.group(node, "top", roof);
                b.leaf(top, "roof", b.masonry.house_roof, Place::at(Vec3::ZERO));
                let at = vec3(random.range(-2.5, 2.5), 0.1, random.range(-2.5, 2.5));
                b.leaf(top, "chhatri", b.masonry.chhatri, Place::at(at));
            } else {
                b.leaf(node, "roof", b.masonry.house_roof, roof);
            }
        }
    }
}
