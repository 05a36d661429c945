//! Camera paths: where the room stands in the world, frame by frame, as a text file that people can read and compare.
//!
//! ```text
//! mullion-path 1
//! # translation x y z (m), rotation x y z w, scale
//! 12.5 1.65 -3.0 0.0 0.0 0.0 1.0 1.0
//! 12.5 1.65 -3.0233 0.0 0.0 0.0 1.0 1.0
//! ```
//! A line a frame: `world_from_room` as a translation in metres, a unit quaternion and a uniform scale, which is how many
//! metres of the world a metre of the room covers. A similarity without mirroring, by its form. Empty lines and lines that
//! start with `#` say nothing. Numbers are written with as many digits as bring back the same bits.

use std::fmt;

use glam::{DAffine3, DQuat, DVec3};
use thiserror::Error;

/// Most frames of a path: four and a half hours at 60 Hz.
pub const MAX_PATH_FRAMES: usize = 1_000_000;
/// Most bytes of a path's file.
pub const MAX_PATH_BYTES: u64 = 256 << 20;
/// Most bytes of a number as it is written, with the space after it.
const NUMBER_BYTES: u64 = 25;
const _: () = assert!(MAX_PATH_FRAMES as u64 * FIELDS.len() as u64 * NUMBER_BYTES < MAX_PATH_BYTES);
/// Greatest coordinate, metres.
const MAX_COORDINATE_M: f64 = 1e15;
const SCALES: std::ops::RangeInclusive<f64> = 1e-6..=1e6;
/// How far a quaternion's length may be from 1. People write four digits; what is off is taken off on use.
const UNIT_TOLERANCE: f64 = 1e-3;
const HEADER: &str = "mullion-path 1";
const COLUMNS: &str = "# translation x y z (m), rotation x y z w, scale";
const FIELDS: [&str; 8] =
    ["translation x", "translation y", "translation z", "rotation x", "rotation y", "rotation z", "rotation w", "scale"];

/// Where the room stands in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPose {
    /// Where the room's origin is in the world, metres; coordinates within ±1e15.
    pub translation: DVec3,
    /// How the room is turned; of length 1 within 0.001.
    pub rotation: DQuat,
    /// Metres of the world in a metre of the room, 1e-6 to 1e6.
    pub scale: f64,
}

impl CameraPose {
    /// The pose as a matrix: a similarity to the last bits, also where the quaternion was written with few digits.
    pub fn world_from_room(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(DVec3::splat(self.scale), self.rotation.normalize(), self.translation)
    }

    fn numbers(&self) -> [f64; 8] {
        let (t, r) = (self.translation, self.rotation);
        [t.x, t.y, t.z, r.x, r.y, r.z, r.w, self.scale]
    }

    /// Whether all numbers are within their ranges.
    ///
    /// # Errors
    /// Names the field, its value and what is allowed, in one line.
    pub fn check(&self) -> Result<(), String> {
        let numbers = self.numbers();
        if let Some(k) = (0..3).find(|k| !(-MAX_COORDINATE_M..=MAX_COORDINATE_M).contains(&numbers[*k])) {
            return Err(format!("{}: {} is outside -{MAX_COORDINATE_M:e} to {MAX_COORDINATE_M:e} m", FIELDS[k], numbers[k]));
        }
        let length = self.rotation.length();
        if !(1.0 - UNIT_TOLERANCE..=1.0 + UNIT_TOLERANCE).contains(&length) {
            return Err(format!("rotation: the quaternion's length is {length}; it must be 1 within {UNIT_TOLERANCE}"));
        }
        if !SCALES.contains(&self.scale) {
            return Err(format!("scale: {} is outside {:e} to {:e}", self.scale, SCALES.start(), SCALES.end()));
        }
        Ok(())
    }
}

/// Why text or poses are no camera path.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum CameraPathError {
    #[error("line {line}: {problem}")]
    Line { line: usize, problem: String },
    #[error("frame {frame}: {problem}")]
    Frame { frame: usize, problem: String },
    #[error("no frames: a path has 1 to {MAX_PATH_FRAMES}")]
    Empty,
    #[error("more than {MAX_PATH_FRAMES} frames")]
    TooMany,
}

/// A camera's way, a pose for each frame: at least one, at most [`MAX_PATH_FRAMES`], each within its ranges.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    poses: Vec<CameraPose>,
}

impl CameraPath {
    /// Checks and takes poses.
    ///
    /// # Errors
    /// For none, for too many, and for one that is outside its ranges or not finite.
    pub fn new(poses: Vec<CameraPose>) -> Result<Self, CameraPathError> {
        for (frame, pose) in poses.iter().enumerate() {
            pose.check().map_err(|problem| CameraPathError::Frame { frame, problem })?;
        }
        match poses.len() {
            0 => Err(CameraPathError::Empty),
            1..=MAX_PATH_FRAMES => Ok(Self { poses }),
            _ => Err(CameraPathError::TooMany),
        }
    }

    /// Reads the text of a path; see the module for its form.
    ///
    /// # Errors
    /// With the line, the field, the value and what is allowed.
    pub fn parse(text: &str) -> Result<Self, CameraPathError> {
        let mut lines = text.lines().map(str::trim).zip(1..);
        if lines.next().is_none_or(|(line, _)| line != HEADER) {
            let problem = format!("a camera path starts with {HEADER:?}");
            return Err(CameraPathError::Line { line: 1, problem });
        }
        let mut poses = Vec::new();
        for (text, line) in lines.filter(|(text, _)| !text.is_empty() && !text.starts_with('#')) {
            if poses.len() == MAX_PATH_FRAMES {
                return Err(CameraPathError::TooMany);
            }
            poses.push(parse_pose(text).map_err(|problem| CameraPathError::Line { line, problem })?);
        }
        if poses.is_empty() { Err(CameraPathError::Empty) } else { Ok(Self { poses }) }
    }

    /// `world_from_room` at a frame; past the end the path begins anew.
    pub fn pose(&self, frame: u64) -> DAffine3 {
        self.poses[(frame % self.poses.len() as u64) as usize].world_from_room()
    }

    /// All poses, one or more.
    pub fn poses(&self) -> &[CameraPose] {
        &self.poses
    }
}

/// As [`CameraPath::parse`] reads it, with the same poses to the bit.
impl fmt::Display for CameraPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{HEADER}\n{COLUMNS}")?;
        for pose in &self.poses {
            let [first, rest @ ..] = pose.numbers();
            // `{:?}`, unlike `{}`, writes what is very small or large with an exponent.
            write!(f, "{first:?}")?;
            rest.iter().try_for_each(|number| write!(f, " {number:?}"))?;
            writeln!(f)?;
        }
        Ok(())
    }
}

fn parse_pose(text: &str) -> Result<CameraPose, String> {
    let mut numbers = [0.0; FIELDS.len()];
    let mut words = text.split_whitespace();
    for (k, (number, field)) in numbers.iter_mut().zip(FIELDS).enumerate() {
        let word = words.next().ok_or_else(|| format!("{field}: is missing: {k} numbers of {}", FIELDS.len()))?;
        let finite = word.parse::<f64>().ok().filter(|v| v.is_finite());
        *number = finite.ok_or_else(|| format!("{field}: {:?} is no finite number", shortened(word)))?;
    }
    if let Some(word) = words.next() {
        return Err(format!("{:?} stands after the {} numbers of a frame", shortened(word), FIELDS.len()));
    }
    let [tx, ty, tz, x, y, z, w, scale] = numbers;
    let pose = CameraPose { translation: DVec3::new(tx, ty, tz), rotation: DQuat::from_xyzw(x, y, z, w), scale };
    pose.check().map(|()| pose)
}

/// What fits a message.
fn shortened(word: &str) -> String {
    const SHOWN: usize = 40;
    word.chars().take(SHOWN).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FRAME: &str = "1 -2 3.5 0 0.6 0 0.8 0.25";

    fn pose() -> impl Strategy<Value = CameraPose> {
        let coordinate = || prop_oneof![-MAX_COORDINATE_M..=MAX_COORDINATE_M, -1.0..1.0f64, Just(-f64::MIN_POSITIVE), Just(-0.0)];
        let axis = (-1.0..1.0f64, -1.0..1.0f64, 0.01..1.0f64);
        let place = (coordinate(), coordinate(), coordinate());
        (place, axis, -6.3..6.3f64, 1.0 - 9e-4..1.0 + 9e-4f64, SCALES).prop_map(|(at, axis, angle, length, scale)| CameraPose {
            translation: DVec3::from(at),
            rotation: DQuat::from_axis_angle(DVec3::from(axis).normalize(), angle) * length,
            scale,
        })
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back_to_the_bit(poses in proptest::collection::vec(pose(), 1..20)) {
            let bits = |path: &CameraPath| path.poses.iter().map(|p| p.numbers().map(f64::to_bits)).collect::<Vec<_>>();
            let path = CameraPath::new(poses).expect("they are in range");
            let text = path.to_string();
            prop_assert!(text.split([' ', '\n']).skip_while(|word| *word != "scale").all(|word| word.len() < NUMBER_BYTES as usize));
            let read = CameraPath::parse(&text).expect("it was written by us");
            prop_assert_eq!(bits(&read), bits(&path));
            prop_assert_eq!(read.to_string(), text);
        }

        #[test]
        fn poses_are_similarities_without_mirroring(pose in pose()) {
            let m = pose.world_from_room().matrix3;
            let columns = [m.x_axis, m.y_axis, m.z_axis].map(|c| c / pose.scale);
            for k in 0..3 {
                prop_assert!((columns[k].length() - 1.0).abs() < 1e-12);
                prop_assert!(columns[k].dot(columns[(k + 1) % 3]).abs() < 1e-12);
            }
            prop_assert!(columns[0].cross(columns[1]).dot(columns[2]) > 0.0);
        }

        #[test]
        fn any_text_is_read_or_refused(text in "(mullion-path 1\n)?[-0-9a-f .#\n]{0,200}") {
            if let Ok(path) = CameraPath::parse(&text) {
                prop_assert_eq!(CameraPath::parse(&path.to_string()), Ok(path));
            }
        }
    }

    #[test]
    fn past_its_end_a_path_begins_anew() {
        let text = format!("{HEADER}\r\n# by hand\r\n{FRAME}\r\n\r\n  2\t-2 3.5 0 0.6 0 0.8 0.25  \r\n");
        let path = CameraPath::parse(&text).expect("comments, empty lines and any space are allowed");
        let at = |frame| path.pose(frame).translation.x;
        assert_eq!([0, 1, 2, 3, u64::MAX].map(at), [1.0, 2.0, 1.0, 2.0, 2.0]);
    }

    #[test]
    fn mistakes_are_told_with_line_field_and_rule() {
        let cases = [
            ("".to_owned(), "line 1: a camera path starts with \"mullion-path 1\""),
            (format!("mullion-path 2\n{FRAME}"), "line 1: a camera path starts with \"mullion-path 1\""),
            (format!("{HEADER}\n# nothing\n"), "no frames: a path has 1 to 1000000"),
            (format!("{HEADER}\n{FRAME}\n\n1 2 3\n"), "line 4: rotation x: is missing: 3 numbers of 8"),
            (format!("{HEADER}\n{FRAME} 9\n"), "line 2: \"9\" stands after the 8 numbers of a frame"),
            (format!("{HEADER}\n1 nan 3 0 0 0 1 1\n"), "line 2: translation y: \"nan\" is no finite number"),
            (format!("{HEADER}\n1 2 1e999 0 0 0 1 1\n"), "line 2: translation z: \"1e999\" is no finite number"),
            (format!("{HEADER}\n1 2 2e15 0 0 0 1 1\n"), "line 2: translation z: 2000000000000000 is outside -1e15 to 1e15 m"),
            (
                format!("{HEADER}\n1 2 3 0 0 1 1 1\n"),
                "line 2: rotation: the quaternion's length is 1.4142135623730951; it must be 1 within 0.001",
            ),
            (format!("{HEADER}\n1 2 3 0 0 0 0 1\n"), "line 2: rotation: the quaternion's length is 0; it must be 1 within 0.001"),
            (format!("{HEADER}\n1 2 3 0 0 0 1 -1\n"), "line 2: scale: -1 is outside 1e-6 to 1e6"),
        ];
        for (text, message) in cases {
            assert_eq!(CameraPath::parse(&text).expect_err(message).to_string(), message);
        }
        let long = format!("{HEADER}\n{}", "x".repeat(100_000));
        assert!(CameraPath::parse(&long).expect_err("no number").to_string().len() < 120);
        let good = CameraPose { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: 1.0 };
        let flat = CameraPose { scale: 0.0, ..good };
        let refused = CameraPath::new(vec![good, flat]).expect_err("it has no extent");
        assert_eq!(refused.to_string(), "frame 1: scale: 0 is outside 1e-6 to 1e6");
        assert_eq!(CameraPath::new(vec![good; MAX_PATH_FRAMES + 1]), Err(CameraPathError::TooMany));
    }
}
