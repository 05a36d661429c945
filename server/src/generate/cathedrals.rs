//! The cathedrals of Bartz, Meißner and Hüttner 1999 (section 5.1.1, Table 1): eight of them on a grid of two by two by two,
//! of 416 763 triangles each, 3 334 104 in all.
//!
//! Nodes: cathedral, part (nave, choir, …), bay, member. X runs from the west front to the apse, the crossing's floor is
//! y = 0; all eight share their meshes. Seen from inside a cathedral is closed: its windows are opaque glass, its doors
//! shut. The pavement of the nave has the triangles that the stone leaves.
mod bay;
mod choir;
mod fittings;
mod fronts;
mod plan;
mod tower;

use super::glb_writer::{Alpha, Glb, GlbWriter, MaterialId, MeshId, NodeId, Place, Sides};
use super::gothic::Stones;
use super::random::Random;
use super::solid::{Color, Geometry, srgb};
use glam::{Vec3, vec3};

/// Triangles of each.
const TRIANGLES: usize = 416_763;
/// From one to the next along X, Y and Z.
const PITCH_M: Vec3 = vec3(150.0, 105.0, 90.0);

/// What a cathedral is built of: each seed has its own quarry and its own glass.
struct Palette {
    stone: [Color; 4],
    trim: Color,
    dark: Color,
    web: [Color; 3],
    slate: [Color; 3],
    floor: [Color; 3],
    wood: [Color; 2],
    gilt: Color,
    panes: Vec<Color>,
}

impl Palette {
    fn draw(random: &mut Random) -> Palette {
        let tone = random.range(0.94, 1.04);
        let warm = random.range(0.94, 1.02);
        let tint = |r: f32, g: f32, b: f32| srgb((r * tone) as u8, (g * tone) as u8, (b * tone * warm) as u8);
        let mut pane = |r: f32, g: f32, b: f32| {
            let glow = random.range(0.85, 1.1);
            srgb((r * glow).min(255.0) as u8, (g * glow).min(255.0) as u8, (b * glow).min(255.0) as u8)
        };
        let panes = vec![
            pane(40.0, 70.0, 190.0),
            pane(60.0, 100.0, 220.0),
            pane(30.0, 50.0, 150.0),
            pane(190.0, 40.0, 50.0),
            pane(220.0, 180.0, 70.0),
            pane(60.0, 140.0, 90.0),
            pane(140.0, 70.0, 150.0),
            pane(200.0, 210.0, 220.0),
        ];
        Palette {
            stone: [tint(214.0, 204.0, 184.0), tint(208.0, 198.0, 176.0), tint(220.0, 210.0, 192.0), tint(202.0, 190.0, 168.0)],
            trim: tint(228.0, 220.0, 204.0),
            dark: tint(166.0, 154.0, 136.0),
            web: [tint(222.0, 212.0, 190.0), tint(216.0, 204.0, 180.0), tint(226.0, 218.0, 200.0)],
            slate: [srgb(92, 104, 118), srgb(86, 96, 112), srgb(100, 112, 124)],
            floor: [srgb(196, 186, 166), srgb(122, 112, 104), srgb(162, 120, 98)],
            wood: [srgb(116, 78, 50), srgb(98, 66, 42)],
            gilt: srgb(208, 168, 80),
            panes,
        }
    }
}

/// The workshop: makes meshes and places them.
struct Lodge {
    glb: GlbWriter,
    stone: MaterialId,
    glass: MaterialId,
    palette: Palette,
    random: Random,
}

/// A mesh in the making.
struct Work<'a> {
    stone: Geometry,
    glass: Geometry,
    stones: Stones,
    panes: Stones,
    palette: &'a Palette,
}

impl Lodge {
    /// A mesh of stone and of glass; either may stay empty.
    fn mesh(&mut self, name: &str, build: impl FnOnce(&mut Work)) -> MeshId {
        let stones = Stones::new(&self.palette.stone, self.random.fork());
        let panes = Stones::new(&self.palette.panes, self.random.fork());
        let (stone, glass) = (Geometry::default(), Geometry::default());
        let mut work = Work { stone, glass, stones, panes, palette: &self.palette };
        build(&mut work);
        let Work { stone, glass, .. } = work;
        self.glb.mesh(name, &[(&stone, self.stone), (&glass, self.glass)])
    }

    fn group(&mut self, parent: NodeId, name: impl Into<String>, place: Place) -> NodeId {
        self.glb.node(Some(parent), name.into(), None, place)
    }

    fn leaf(&mut self, parent: NodeId, name: &str, mesh: MeshId, place: Place) {
        self.glb.node(Some(parent), name.into(), Some(mesh), place);
    }
}

/// The cathedrals as a file.
pub fn generate(seed: u64) -> Glb {
    let mut random = Random::new(seed);
    let mut glb = GlbWriter::default();
    let stone = glb.material("stone", [1.0; 4], None, Alpha::Opaque, Sides::One);
    let glass = glb.material("glass", [1.0; 4], None, Alpha::Opaque, Sides::Both);
    let palette = Palette::draw(&mut random.fork());
    let mut lodge = Lodge { glb, stone, glass, palette, random: random.fork() };
    let members = plan::Members::new(&mut lodge);
    let cathedrals: Vec<NodeId> = (0..8)
        .map(|k| {
            let cell = vec3((k & 1) as f32, (k >> 2 & 1) as f32, (k >> 1 & 1) as f32) - 0.5;
            let cathedral = lodge.glb.node(None, format!("cathedral {}", k + 1), None, Place::at(cell * PITCH_M));
            plan::build(&mut lodge, cathedral, &members);
            cathedral
        })
        .collect();
    let left = TRIANGLES - lodge.glb.triangles() as usize / cathedrals.len();
    let pavement = fittings::pavement(&mut lodge, left);
    for cathedral in cathedrals {
        lodge.leaf(cathedral, "nave pavement", pavement, Place::at(Vec3::ZERO));
    }
    lodge.glb.finish("mullion generate cathedrals")
}
