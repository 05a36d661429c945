//! Where the room stands in the world: named walks through a scene, and camera paths from files.

mod flythrough;
mod interior;
mod orbit;
mod pan;
mod subject;
mod whole;

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use clap::ValueEnum;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use mullion_common::camera_path::{CameraPath, CameraPose, MAX_PATH_BYTES, MAX_PATH_FRAMES};
use mullion_common::scene::Package;
use mullion_common::wall::Wall;
use mullion_server::prepare::bounded;

pub use subject::Subject;

/// Reads `X,Y,Z`.
pub fn parse_point(text: &str) -> Result<DVec3, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers.as_slice() {
        [x, y, z] if text.matches(',').count() == 2 && numbers.iter().all(|n| n.is_finite()) => Ok(DVec3::new(*x, *y, *z)),
        _ => Err(format!("{text:?} is not three numbers X,Y,Z")),
    }
}

/// The room with its origin at `origin`, its −Z axis towards `look_at` where one is given, Y up as far as that goes.
pub fn place_room(origin: DVec3, look_at: Option<DVec3>) -> DAffine3 {
    let matrix3 = look_at.and_then(|target| (origin - target).try_normalize()).map_or(DMat3::IDENTITY, facing);
    DAffine3 { matrix3, translation: origin }
}

/// A rotation whose Z axis is `back`.
fn facing(back: DVec3) -> DMat3 {
    let right = DVec3::Y.cross(back).try_normalize().unwrap_or(DVec3::X);
    DMat3::from_cols(right, back.cross(right), back)
}

/// Walks that are made for a scene and a wall. The same scene and wall give the same walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Walk {
    /// Round the scene and closer to it, with the whole of it in view at the start.
    Orbit,
    /// Slowly round the scene, all of it in view of the wall at every frame.
    Whole,
    /// Through the scene at walking pace, at eye height.
    Interior,
    /// From outside through the middle of the scene and out again, fast.
    Flythrough,
    /// Standing in the scene, turning one degree a frame.
    Pan,
}

impl Walk {
    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Orbit => "orbit",
            Self::Whole => "whole",
            Self::Interior => "interior",
            Self::Flythrough => "flythrough",
            Self::Pan => "pan",
        }
    }

    /// How long the walk is if nobody says.
    fn default_frames(self, subject: &Subject, wall: &Wall) -> usize {
        match self {
            Self::Orbit => orbit::FRAMES,
            Self::Whole => whole::FRAMES,
            Self::Interior => interior::FRAMES,
            Self::Flythrough => flythrough::frames(subject, wall.rate_hz()),
            Self::Pan => pan::FRAMES,
        }
    }

    /// The walk, of `frames` or its own number of them; at most [`MAX_PATH_FRAMES`].
    ///
    /// # Errors
    /// For scenes so far out that no path leads there.
    pub fn path(self, package: &Package, wall: &Wall, frames: Option<u64>) -> Result<CameraPath> {
        let subject = Subject::of(package);
        let frames = frames.map(|frames| usize::try_from(frames).unwrap_or(MAX_PATH_FRAMES));
        let frames = frames.unwrap_or_else(|| self.default_frames(&subject, wall)).clamp(1, MAX_PATH_FRAMES);
        let stands: Box<dyn Fn(usize) -> Stand> = match self {
            Self::Orbit => Box::new(orbit::walk(&subject, frames)),
            Self::Whole => Box::new(whole::walk(&subject, wall)),
            Self::Interior => Box::new(interior::walk(&subject, wall.rate_hz())),
            Self::Flythrough => Box::new(flythrough::walk(&subject, frames)),
            Self::Pan => Box::new(pan::walk(&subject)),
        };
        let eye_in_room = wall.default_eyes().first().copied().unwrap_or_default();
        let poses = (0..frames).map(|frame| stands(frame).pose(subject.scale(), eye_in_room)).collect();
        CameraPath::new(poses).with_context(|| format!("the walk {self}"))
    }
}

impl fmt::Display for Walk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Where the eye is in the world, and how the room is turned around it.
struct Stand {
    eye: DVec3,
    rotation: DMat3,
}

impl Stand {
    /// At `eye`, the room's −Z axis along `ahead`.
    fn looking(eye: DVec3, ahead: DVec3) -> Self {
        Self { eye, rotation: facing(-ahead.try_normalize().unwrap_or(DVec3::NEG_Z)) }
    }

    fn pose(&self, scale: f64, eye_in_room: DVec3) -> CameraPose {
        let translation = self.eye - self.rotation * eye_in_room * scale;
        let rotation = DQuat::from_mat3(&self.rotation).normalize();
        // Of the two quaternions that turn alike always the same one.
        CameraPose { translation, rotation: if rotation.w < 0.0 { -rotation } else { rotation }, scale }
    }
}

/// What `--path` names.
#[derive(Clone, Debug)]
pub enum PathSource {
    /// To be made for the scene.
    Walk(Walk),
    /// From a file.
    File(PathBuf, CameraPath),
}

impl PathSource {
    /// Takes the name of a walk, or reads a file; a file in this folder that is called like a walk comes first.
    ///
    /// # Errors
    /// When it is neither, or the file holds no camera path.
    pub fn open(choice: &str) -> Result<Self> {
        let path = Path::new(choice);
        match Walk::value_variants().iter().find(|walk| walk.name() == choice) {
            Some(walk) if !path.is_file() => Ok(Self::Walk(*walk)),
            _ => open_path(path).map(|camera| Self::File(path.to_owned(), camera)),
        }
    }

    /// The path for a scene and a wall: a walk of `frames` or its own number of them, or the file's.
    ///
    /// # Errors
    /// As [`Walk::path`].
    pub fn path(&self, package: &Package, wall: &Wall, frames: Option<u64>) -> Result<CameraPath> {
        match self {
            Self::Walk(walk) => walk.path(package, wall, frames),
            Self::File(_, path) => Ok(path.clone()),
        }
    }
}

impl fmt::Display for PathSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Walk(walk) => walk.fmt(f),
            Self::File(path, _) => path.display().fmt(f),
        }
    }
}

fn open_path(path: &Path) -> Result<CameraPath> {
    let shown = path.display();
    let names: Vec<&str> = Walk::value_variants().iter().map(|walk| walk.name()).collect();
    let bytes = bounded::read(path, MAX_PATH_BYTES)
        .with_context(|| format!("{shown}: is none of {}, and no file that can be read", names.join(", ")))?;
    let text = String::from_utf8(bytes).map_err(|_| anyhow!("{shown}: is no text: a camera path is UTF-8"))?;
    CameraPath::parse(&text).map_err(|error| anyhow!("{shown}: {error}"))
}

#[cfg(test)]
mod tests;
