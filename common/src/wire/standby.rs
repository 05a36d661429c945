//! What a master tells the one that stands by to take its place: the course of the show, frame by frame.

use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};

use super::frame::{put_moved, take_head, take_moved};
use super::message::{put_bye, split_tag, tag, take_bye};
use super::{Bye, MAX_TO_TILE_BYTES, MAX_WALL_VIEWS, Moved, SectionRef, ViewSpec, WireError, codec, framed, within};
use crate::scene::ChunkHash;
use crate::wall::Wall;

/// A standby's greeting on its only connection. Both sides must have the same wall and the same scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StandbyHello {
    /// Of its wall: BLAKE3 of every node's name and views, as welcomes have them.
    pub wall: ChunkHash,
    /// Of its scene: BLAKE3 of the hashes of the manifest's sections.
    pub scene: ChunkHash,
}

impl StandbyHello {
    /// Of a master with this wall and these sections.
    ///
    /// # Errors
    /// When a node has more views than a welcome takes.
    pub fn of(wall: &Wall, sections: &[SectionRef]) -> Result<Self, WireError> {
        let mut bytes = Vec::new();
        for node in wall.nodes() {
            let views = node.tiles.iter().flat_map(|tile| wall.views_of(*tile)).map(|view| ViewSpec::of(wall, view));
            codec::encode_into(&(&node.name, views.collect::<Vec<_>>()), &mut bytes)?;
        }
        let hashes: Vec<u8> = sections.iter().flat_map(|section| section.hash.0).collect();
        Ok(Self { wall: ChunkHash::of(&bytes), scene: ChunkHash::of(&hashes) })
    }
}

/// Where the show stands at a frame.
///
/// As bytes after the tag: number u64, scene time f64, `world_from_room` 12 × f64, base `Option<u64>`, count of eyes u32, count of moved
/// objects u32; for each eye 3 × f64; for each moved object: id u32, 12 × f64.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Course {
    /// The frame's number.
    pub number: u64,
    /// Time in the scene, seconds.
    pub scene_time_s: f64,
    /// Where the room is in the world.
    pub world_from_room: DAffine3,
    /// A course that the standby has said Ready for; `None`: the manifest.
    pub base: Option<u64>,
    /// Where each view's eye is, room space, metres; by `ViewId`.
    pub eyes: Vec<DVec3>,
    /// Every object that moved since the base.
    pub moved: Vec<Moved>,
}

/// From the master to its standby.
#[derive(Clone, Debug, PartialEq)]
pub enum ToStandby {
    /// Where the show stands.
    Course(Course),
    /// The master is there and has nothing to say.
    Alive,
    /// The master ends the connection. At the show's end, nobody takes its place.
    Bye(Bye),
}

#[derive(Serialize, Deserialize)]
struct Head {
    number: u64,
    scene_time_s: f64,
    world_from_room: [f64; 12],
    base: Option<u64>,
    eyes: u32,
    moved: u32,
}

const EYE_BYTES: usize = size_of::<[f64; 3]>();

impl Course {
    /// Writes the whole message to `out`, which it empties first. Allocates only where `out` must grow.
    ///
    /// # Errors
    /// When the course passes a cap.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        within("views", self.eyes.len(), MAX_WALL_VIEWS)?;
        framed(out, tag::COURSE, MAX_TO_TILE_BYTES, |out| {
            let head = Head {
                number: self.number,
                scene_time_s: self.scene_time_s,
                world_from_room: self.world_from_room.to_cols_array(),
                base: self.base,
                eyes: self.eyes.len() as u32,
                moved: self.moved.len() as u32,
            };
            codec::encode_into(&head, out)?;
            for eye in &self.eyes {
                out.extend_from_slice(bytemuck::bytes_of(&eye.to_array()));
            }
            put_moved(out, &self.moved);
            Ok(())
        })
    }

    fn decode(mut bytes: &[u8]) -> Result<Self, WireError> {
        let head: Head = take_head(&mut bytes)?;
        within("views", head.eyes as usize, MAX_WALL_VIEWS)?;
        let (eyes, rest) = bytes.split_at_checked(head.eyes as usize * EYE_BYTES).ok_or(WireError::Bulk { what: "eyes" })?;
        let eyes = eyes.chunks_exact(EYE_BYTES).map(|bytes| DVec3::from(bytemuck::pod_read_unaligned::<[f64; 3]>(bytes)));
        let course = Self {
            number: head.number,
            scene_time_s: head.scene_time_s,
            world_from_room: DAffine3::from_cols_array(&head.world_from_room),
            base: head.base,
            eyes: eyes.collect(),
            moved: take_moved(rest, head.moved)?,
        };
        let places_are_finite = course.world_from_room.is_finite() && course.eyes.iter().all(|eye| eye.is_finite());
        if !course.scene_time_s.is_finite() || !places_are_finite {
            return Err(WireError::NotFinite { what: "a number of the course" });
        }
        if course.base.is_some_and(|base| base >= course.number) {
            return Err(WireError::Bulk { what: "base" });
        }
        Ok(course)
    }
}

impl ToStandby {
    /// Writes the whole message to `out`, which it empties first.
    ///
    /// # Errors
    /// When a part passes its cap.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        match self {
            Self::Course(course) => course.encode(out),
            Self::Alive => framed(out, tag::ALIVE, MAX_TO_TILE_BYTES, |_| Ok(())),
            Self::Bye(bye) => framed(out, tag::BYE, MAX_TO_TILE_BYTES, |out| put_bye(out, bye)),
        }
    }

    /// Reads a body.
    ///
    /// # Errors
    /// When it is no such message, a part passes its cap, or a number that places something is not finite.
    pub fn decode(body: &[u8]) -> Result<Self, WireError> {
        let (tag, rest) = split_tag(body, MAX_TO_TILE_BYTES)?;
        match tag {
            tag::COURSE => Ok(Self::Course(Course::decode(rest)?)),
            tag::ALIVE if rest.is_empty() => Ok(Self::Alive),
            tag::BYE => Ok(Self::Bye(take_bye(rest)?)),
            tag => Err(WireError::Tag { tag }),
        }
    }
}
