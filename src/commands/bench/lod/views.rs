//! The views that are measured: the paper's, on what there is of its models.

use std::path::PathBuf;

use anyhow::{Context, Result};
use glam::{DAffine3, DQuat, DVec3};
use mullion_common::scene::LodForm;
use mullion_server::prepare::PrepareOptions;

use crate::commands::prepare::simplify;
use crate::files::open_named_scene;
use crate::lod::{Look, Subject};

/// A scene from one side, and how it goes on from there.
#[derive(Clone, Copy, Debug)]
pub struct View {
    pub name: &'static str,
    /// A file of the folder that `MULLION_MODELS` names, and a generated scene for where there is none.
    scene: (Option<&'static str>, &'static str),
    /// How many stand behind each other.
    pub copies: u32,
    /// The eye and what it looks at, in radii of the scene from its middle.
    eye: [f64; 3],
    at: [f64; 3],
    motion: Motion,
}

/// How the eye goes on, by half a degree a frame, and back again.
#[derive(Clone, Copy, Debug)]
enum Motion {
    /// Around what it looks at.
    Orbit,
    /// It stays and looks around.
    Turn,
}

const DEGREES_A_FRAME: f64 = 0.5;
/// So many frames to one side.
const AMPLITUDE: u64 = 40;

/// The views, by their names.
pub const VIEWS: [View; 6] = [
    View {
        name: "armadillo",
        scene: (Some("scan_armadillo_loop_346k.glb"), "organic"),
        copies: 1,
        // Its hand is between: as many triangles are seen without occlusion as in the paper.
        eye: [0.71, 0.5225, 0.45],
        at: [0.0, 0.1, 0.0],
        motion: Motion::Orbit,
    },
    View {
        name: "armadillo-open",
        scene: (Some("scan_armadillo_loop_346k.glb"), "organic"),
        copies: 1,
        eye: [0.0, 0.1, 2.4],
        at: [0.0, 0.0, 0.0],
        motion: Motion::Orbit,
    },
    View {
        name: "armadillo-group",
        scene: (Some("scan_armadillo_loop_346k.glb"), "organic"),
        copies: 3,
        eye: [0.0, 0.3, -2.0],
        at: [0.0, 0.0, 0.0],
        motion: Motion::Orbit,
    },
    View {
        name: "dragon",
        scene: (Some("scan_dragon_871k.glb"), "organic"),
        copies: 1,
        // Behind its head.
        eye: [0.3, 1.0, 0.0],
        at: [-0.5, 0.0, 0.0],
        motion: Motion::Orbit,
    },
    View {
        name: "planet-full",
        scene: (None, "planet"),
        copies: 1,
        eye: [0.0, 0.4, 2.1],
        at: [0.0, 0.0, 0.0],
        motion: Motion::Orbit,
    },
    View {
        name: "planet-near",
        scene: (None, "planet"),
        copies: 1,
        // Behind a hill.
        eye: [0.0, 0.59, 0.0],
        at: [0.0, 0.55, -0.5],
        motion: Motion::Turn,
    },
];

impl View {
    /// The eye's way into a scene that is none of the paper's.
    pub const OTHER: Self =
        Self { name: "scene", scene: (None, ""), copies: 1, eye: [0.7, 0.5, 2.0], at: [0.0, 0.0, 0.0], motion: Motion::Orbit };

    /// A view with the eye elsewhere.
    pub fn from(self, eye: Option<DVec3>, at: Option<DVec3>) -> Self {
        Self { eye: eye.map_or(self.eye, DVec3::into), at: at.map_or(self.at, DVec3::into), ..self }
    }

    /// The scene that is named, or the view's own.
    pub fn scene(&self, named: Option<&str>) -> String {
        let folder = std::env::var_os("MULLION_MODELS").map(PathBuf::from);
        let model = self.scene.0.zip(folder).map(|(file, folder)| folder.join(file)).filter(|path| path.exists());
        match (named, model) {
            (Some(named), _) => named.to_owned(),
            (None, Some(model)) => model.display().to_string(),
            (None, None) => self.scene.1.to_owned(),
        }
    }

    /// What is seen of a scene, as hierarchies of a form; without one, as the package has them.
    pub fn open(&self, scene: &str, options: &PrepareOptions, form: Option<LodForm>) -> Result<Subject> {
        let mut package = open_named_scene(scene, options)?;
        let wanted = form.unwrap_or_default();
        if form.map_or(package.scene.hierarchies.is_empty(), |form| package.scene.hierarchies.of(form).is_none()) {
            simplify(&mut package, wanted).with_context(|| scene.to_owned())?;
        }
        Subject::new(package, wanted, (self.copies, self.step()))
    }

    /// From one copy to the next: away from the eye.
    fn step(&self) -> DVec3 {
        const RADII: f64 = 1.2;
        -self.way_to_eye() * RADII
    }

    /// All of it from above, as a bird sees it from behind the eye.
    pub fn above(&self, subject: &Subject, height_px: u32) -> Look {
        self.whole(subject, self.way_to_eye() * 1.6 + DVec3::Y * 2.0, height_px)
    }

    /// All of it from the side: what the eye sees, and what is hidden from it.
    pub fn aside(&self, subject: &Subject, height_px: u32) -> Look {
        self.whole(subject, DVec3::Y.cross(self.way_to_eye()) * 2.4 + DVec3::Y * 0.3, height_px)
    }

    fn way_to_eye(&self) -> DVec3 {
        (DVec3::from(self.eye) - DVec3::from(self.at)).with_y(0.0).normalize_or(DVec3::Z)
    }

    /// All copies, from so many of their radii away.
    fn whole(&self, subject: &Subject, from: DVec3, height_px: u32) -> Look {
        let radius_m = subject.bounds.size().length() / 2.0;
        let last = self.step() * radius_m * f64::from(self.copies - 1) / 2.0;
        let (middle, reach) = (subject.bounds.center() + last, radius_m + last.length());
        Look::new(middle + from * reach, middle, radius_m * 1e-3, height_px)
    }

    /// A frame of its way.
    pub fn look(&self, subject: &Subject, frame: u64, height_px: u32) -> Look {
        let radius_m = subject.bounds.size().length() / 2.0;
        let place = |radii: [f64; 3]| subject.bounds.center() + DVec3::from(radii) * radius_m;
        let (eye, at) = (place(self.eye), place(self.at));
        let there = frame % (2 * AMPLITUDE);
        let steps = there.min(2 * AMPLITUDE - there);
        let turn = DAffine3::from_quat(DQuat::from_rotation_y((steps as f64 * DEGREES_A_FRAME).to_radians()));
        let around = |middle: DVec3, p: DVec3| middle + turn.transform_vector3(p - middle);
        let (eye, at) = match self.motion {
            Motion::Orbit => (around(at, eye), at),
            Motion::Turn => (eye, around(eye, at)),
        };
        Look::new(eye, at, radius_m * 1e-3, height_px)
    }
}

/// The views of these names.
pub fn named(names: &[String]) -> Result<Vec<View>> {
    let known = || VIEWS.iter().map(|view| view.name).collect::<Vec<_>>().join(", ");
    let of = |name: &String| {
        let found = VIEWS.iter().find(|view| view.name == name).copied();
        found.with_context(|| format!("--view: there is no {name:?}; there are {}", known()))
    };
    names.iter().map(of).collect()
}
