//! Scenes made from a seed, written as real GLB files, so that generated and foreign scenes take one path.
//!
//! A new scene is a module beside [`city`], a variant of [`GeneratedScene`] and a line in each `match` below.
mod boxes;
mod cars;
mod cathedrals;
mod city;
mod forest;
mod garbage;
mod glb_writer;
mod gothic;
mod hills;
mod noise;
mod organic;
mod palace;
mod planet;
mod plant;
mod random;
mod round;
mod solid;
mod streamed;
mod textures;

pub use boxes::{Boxes, BoxesShape, MAX_BOXES};
pub use glb_writer::GenerateReport;
pub use planet::{MAX_PLANET_VERTICES, Planet};
pub use random::Random;

use glb_writer::Glb;
use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The scenes that can be generated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum GeneratedScene {
    /// 300 furnished buildings of about 3521 triangles each, with streets, trees and lamp posts.
    City,
    /// The same with 144 buildings, as large as the city that is drawn to a budget.
    PlpCity,
    /// Five different cars of more than 160 000 triangles each, most of them in the engine and below the body.
    Cars,
    /// A power plant with the node tree of the UNC plant that the paper culls: 1118 groups over 3919 leaves.
    Plant,
    /// A palace city with the node tree of the paper's Fatehpur Sikri: 288 groups over 482 leaves of 3300 triangles.
    Palace,
    /// Eight gothic cathedrals of 416 763 triangles each, on a grid of two by two by two.
    Cathedrals,
    /// Twelve trees of 28 500 triangles each before a castle of 110 981.
    Forest,
    /// 2500 things of about 2100 triangles each in a can, none fixed to another.
    Garbage,
    /// Clustered boxes, as many as asked for.
    Boxes(Boxes),
    /// A sphere with mountains, as finely divided as asked for: one object.
    Planet(Planet),
    /// A square of land with a border, 524 288 triangles: one object.
    Hills,
    /// A closed creature of 345 944 triangles whose limbs hide it: one object.
    Organic,
}

impl GeneratedScene {
    /// Every scene, in the order in which they are listed to users.
    pub const ALL: &'static [GeneratedScene] = &[
        GeneratedScene::City,
        GeneratedScene::PlpCity,
        GeneratedScene::Cars,
        GeneratedScene::Plant,
        GeneratedScene::Palace,
        GeneratedScene::Cathedrals,
        GeneratedScene::Forest,
        GeneratedScene::Garbage,
        GeneratedScene::Boxes(Boxes::DEFAULT),
        GeneratedScene::Planet(Planet::DEFAULT),
        GeneratedScene::Hills,
        GeneratedScene::Organic,
    ];

    /// The name that a user types.
    pub fn name(self) -> &'static str {
        match self {
            GeneratedScene::City => "city",
            GeneratedScene::PlpCity => "plp-city",
            GeneratedScene::Cars => "cars",
            GeneratedScene::Plant => "plant",
            GeneratedScene::Palace => "palace",
            GeneratedScene::Cathedrals => "cathedrals",
            GeneratedScene::Forest => "forest",
            GeneratedScene::Garbage => "garbage",
            GeneratedScene::Boxes(_) => "boxes",
            GeneratedScene::Planet(_) => "planet",
            GeneratedScene::Hills => "hills",
            GeneratedScene::Organic => "organic",
        }
    }

    /// All names, for messages: `city, …`.
    pub fn names() -> String {
        let names: Vec<_> = Self::ALL.iter().map(|scene| scene.name()).collect();
        names.join(", ")
    }
}

impl fmt::Display for GeneratedScene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for GeneratedScene {
    type Err = GenerateError;

    /// A scene by its name; boxes also as `boxes:LEAVES` and `boxes:LEAVES:SHAPE`, the planet as `planet:VERTICES`.
    fn from_str(name: &str) -> Result<Self, GenerateError> {
        if let Some(vertices) = name.strip_prefix("planet:") {
            let unknown = |_| GenerateError::Unknown { name: name.chars().take(80).collect() };
            return Ok(Self::Planet(Planet::new(vertices.parse().map_err(unknown)?)?));
        }
        if let Some(numbered) = name.strip_prefix("boxes:") {
            let (leaves, shape) = numbered.split_once(':').unwrap_or((numbered, "flat"));
            let unknown = |_| GenerateError::Unknown { name: name.chars().take(80).collect() };
            return Ok(Self::Boxes(Boxes::new(leaves.parse().map_err(unknown)?, shape.parse()?)?));
        }
        let scene = Self::ALL.iter().copied().find(|scene| scene.name() == name);
        scene.ok_or_else(|| GenerateError::Unknown { name: name.chars().take(80).collect() })
    }
}

/// Why a scene could not be generated.
#[derive(Debug, thiserror::Error)]
pub enum GenerateError {
    /// There is no scene of that name.
    #[error("no scene is called {name:?}; there are: {}", GeneratedScene::names())]
    Unknown {
        /// The name that was asked for.
        name: String,
    },
    /// The boxes' shape has no such name.
    #[error("no shape is called {name:?}; there are: flat, tree")]
    UnknownShape {
        /// The name that was asked for.
        name: String,
    },
    /// There cannot be so many boxes.
    #[error("{leaves} leaves, allowed are 1 to {MAX_BOXES}")]
    Leaves {
        /// The number that was asked for.
        leaves: u64,
    },
    /// There cannot be so many vertices.
    #[error("{vertices} vertices, allowed are 6 to {MAX_PLANET_VERTICES}")]
    Vertices {
        /// The number that was asked for.
        vertices: u64,
    },
    /// The file could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// Writes a scene: those of one large mesh as they are computed, others once they are finished.
fn write(scene: GeneratedScene, seed: u64, out: &mut impl Write) -> io::Result<GenerateReport> {
    let glb: Glb = match scene {
        GeneratedScene::City => city::generate(seed, city::Blocks::FIVE_BY_FIVE),
        GeneratedScene::PlpCity => city::generate(seed, city::Blocks::FOUR_BY_THREE),
        GeneratedScene::Cars => cars::generate(seed),
        GeneratedScene::Plant => plant::generate(seed),
        GeneratedScene::Palace => palace::generate(seed),
        GeneratedScene::Cathedrals => cathedrals::generate(seed),
        GeneratedScene::Forest => forest::generate(seed),
        GeneratedScene::Garbage => garbage::generate(seed),
        GeneratedScene::Boxes(boxes) => boxes::generate(boxes, seed),
        GeneratedScene::Planet(planet) => return streamed::write(&planet::Relief::new(planet, seed), out),
        GeneratedScene::Hills => return streamed::write(&hills::Hills::new(seed), out),
        GeneratedScene::Organic => return streamed::write(&organic::Organic::new(seed), out),
    };
    glb.write(out)?;
    Ok(glb.report)
}

/// Generates `scene` as GLB bytes. The same scene and seed give the same bytes.
pub fn glb(scene: GeneratedScene, seed: u64) -> (Vec<u8>, GenerateReport) {
    let mut bytes = Vec::new();
    // Writing to a vector cannot fail.
    let report = write(scene, seed, &mut bytes).expect("memory takes all bytes");
    (bytes, report)
}

/// Generates `scene` and writes it to `out`, as [`glb`] gives it.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_glb(scene: GeneratedScene, seed: u64, out: &Path) -> Result<GenerateReport, GenerateError> {
    let fault = |source| GenerateError::Write { path: out.to_path_buf(), source };
    // Opened first: a wrong name is told at once.
    let mut file = BufWriter::new(File::create(out).map_err(fault)?);
    let report = write(scene, seed, &mut file).map_err(fault)?;
    file.flush().map_err(fault)?;
    Ok(report)
}
