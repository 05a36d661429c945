//! What masters say to each other: the course of the show, frame by frame, and which of two is to drive the wall.

use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};

use super::frame::{put_moved, take_head, take_moved};
use super::message::{put_bye, split_tag, tag, take_bye};
use super::{
    Budget, Bye, MAX_PACKAGE_NAME_BYTES, MAX_PARTS, MAX_TO_TILE_BYTES, MAX_WALL_VIEWS, Moved, SectionRef, ViewSpec, WireError,
    codec, framed, within,
};
use crate::scene::{ChunkHash, ObjectId, Presence};
use crate::wall::Wall;

/// A standby's greeting on its only connection. Both sides must have the same wall, and have begun with the same scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StandbyHello {
    /// Of its wall: BLAKE3 of every node's name and views, as welcomes have them.
    pub wall: ChunkHash,
    /// Of the scene that it began with: BLAKE3 of the hashes of the manifest's sections.
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

/// The greeting of a master that took another's place, to that other one, on a connection of its own: who has fewer live nodes is to
/// stand by, and where both have as many, who greets. The answer is a [`Bye`]: [`OtherMaster`](super::ByeCode::OtherMaster) where the
/// one that greets is to stand by, [`Leaving`](super::ByeCode::Leaving) where the one that is greeted does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RivalHello {
    /// Of its wall and scene.
    pub show: StandbyHello,
    /// Nodes that its frames wait for.
    pub live_nodes: u32,
    /// Where it listens, at the address that the connection comes from.
    pub port: u16,
}

/// What is inserted into a scene, and where.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Insertion {
    /// The package's name in a library.
    #[serde(deserialize_with = "codec::text")]
    pub package: String,
    /// What it holds: made of the hashes of its tables.
    pub hash: ChunkHash,
    /// The object that it becomes part of.
    pub under: Option<ObjectId>,
    /// Where the package's world is in the scene's: three columns, then the translation.
    pub world_from_root: [f64; 12],
}

/// What a scene grew by, from the one that the show began with. Comes first, and again when there is more.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Insertions {
    /// How many of them are in the scene that is shown. Its epoch is one more.
    pub entered: u32,
    /// In order: those of the scene that is shown, and the one that is to come next.
    #[serde(deserialize_with = "codec::list")]
    pub list: Vec<Insertion>,
}

impl Insertions {
    fn check(&self) -> Result<(), WireError> {
        within("insertions", self.list.len(), MAX_PARTS - 1)?;
        within("insertions that are shown", self.entered as usize, self.list.len())?;
        for insertion in &self.list {
            within("bytes of a package's name", insertion.package.len(), MAX_PACKAGE_NAME_BYTES)?;
            if !insertion.world_from_root.iter().all(|number| number.is_finite()) {
                return Err(WireError::NotFinite { what: "where a package is inserted" });
            }
        }
        Ok(())
    }
}

/// How a show is steered, apart from where everything is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Steering {
    /// The frame's place on the camera's path and in the scene's time, frames.
    pub path_frame: u64,
    /// Frames after which time is held, 0: it is held; `None`: it passes.
    pub held_after: Option<u32>,
    /// Whether the room is where it was put, not on its path.
    pub is_off_path: bool,
}

/// Where the show stands at a frame.
///
/// As bytes after the tag: number u64, epoch u32, scene time f64, `world_from_room` 12 × f64, base `Option<u64>`, path frame u64, held after
/// `Option<u32>`, off path u8, counts of eyes, budgets, presences and moved objects, each u32; for each eye 3 × f64; for each budget
/// `Option<u32>` triangles, `Option<u32>` microseconds; for each presence: object u32, u8 (0 there, 1 away); for each moved object: id u32,
/// 12 × f64.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Course {
    /// The frame's number.
    pub number: u64,
    /// Which scene it is of.
    pub epoch: u32,
    /// Time in the scene, seconds.
    pub scene_time_s: f64,
    /// Where the room is in the world.
    pub world_from_room: DAffine3,
    /// A course that the standby has said Ready for; `None`: the manifest.
    pub base: Option<u64>,
    /// How commands hold time and room.
    pub steering: Steering,
    /// Where each view's eye is, room space, metres; by `ViewId`.
    pub eyes: Vec<DVec3>,
    /// What each view may spend, by `ViewId`; empty: nothing is limited.
    pub budgets: Vec<Budget>,
    /// Objects that came or went with all below them since the base, each once, in the order in which the last word on each was said.
    pub presence: Vec<(ObjectId, Presence)>,
    /// Every object that moved since the base.
    pub moved: Vec<Moved>,
}

/// From the master to its standby.
#[derive(Clone, Debug, PartialEq)]
pub enum ToStandby {
    /// What the scene grew by.
    Insertions(Insertions),
    /// Where the show stands.
    Course(Box<Course>),
    /// The master is there and has nothing to say.
    Alive,
    /// The master ends the connection. At the show's end, nobody takes its place.
    Bye(Bye),
}

#[derive(Serialize, Deserialize)]
struct Head {
    number: u64,
    epoch: u32,
    scene_time_s: f64,
    world_from_room: [f64; 12],
    base: Option<u64>,
    steering: Steering,
    eyes: u32,
    budgets: u32,
    presence: u32,
    moved: u32,
}

/// Largest number of a frame that a standby goes on from: what is counted on from there never overflows.
const MAX_FRAME: u64 = 1 << 48;
/// Longest list of insertions.
const MAX_INSERTIONS_BYTES: usize = 1 << 20;
const INSERTION_BYTES: usize = 8 + MAX_PACKAGE_NAME_BYTES + 32 + 5 + 12 * 8;
const _: () = assert!(4 + 8 + MAX_PARTS * INSERTION_BYTES <= MAX_INSERTIONS_BYTES, "a full list fits its cap");
const EYE_BYTES: usize = size_of::<[f64; 3]>();
const PRESENCE_BYTES: usize = 4 + 1;

impl Course {
    /// Writes the whole message to `out`, which it empties first. Allocates only where `out` must grow.
    ///
    /// # Errors
    /// When the course passes a cap.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        within("views", self.eyes.len().max(self.budgets.len()), MAX_WALL_VIEWS)?;
        framed(out, tag::COURSE, MAX_TO_TILE_BYTES, |out| {
            let head = Head {
                number: self.number,
                epoch: self.epoch,
                scene_time_s: self.scene_time_s,
                world_from_room: self.world_from_room.to_cols_array(),
                base: self.base,
                steering: self.steering,
                eyes: self.eyes.len() as u32,
                budgets: self.budgets.len() as u32,
                presence: self.presence.len() as u32,
                moved: self.moved.len() as u32,
            };
            codec::encode_into(&head, out)?;
            for eye in &self.eyes {
                out.extend_from_slice(bytemuck::bytes_of(&eye.to_array()));
            }
            for budget in &self.budgets {
                codec::encode_into(budget, out)?;
            }
            for (object, presence) in &self.presence {
                out.extend_from_slice(&object.0.to_le_bytes());
                out.push(u8::from(*presence == Presence::Away));
            }
            put_moved(out, &self.moved);
            Ok(())
        })
    }

    fn decode(mut bytes: &[u8]) -> Result<Self, WireError> {
        let head: Head = take_head(&mut bytes)?;
        within("views", head.eyes.max(head.budgets) as usize, MAX_WALL_VIEWS)?;
        let (eyes, mut rest) = bytes.split_at_checked(head.eyes as usize * EYE_BYTES).ok_or(WireError::Bulk { what: "eyes" })?;
        let budgets = (0..head.budgets).map(|_| take_head(&mut rest)).collect::<Result<Vec<Budget>, _>>()?;
        let presence_bytes = (head.presence as usize).saturating_mul(PRESENCE_BYTES);
        let (presence, rest) = rest.split_at_checked(presence_bytes).ok_or(WireError::Bulk { what: "presences" })?;
        let eyes = eyes.chunks_exact(EYE_BYTES).map(|bytes| DVec3::from(bytemuck::pod_read_unaligned::<[f64; 3]>(bytes)));
        let course = Self {
            number: head.number,
            epoch: head.epoch,
            scene_time_s: head.scene_time_s,
            world_from_room: DAffine3::from_cols_array(&head.world_from_room),
            base: head.base,
            steering: head.steering,
            eyes: eyes.collect(),
            budgets,
            presence: presence.chunks_exact(PRESENCE_BYTES).map(presence_of).collect::<Result<_, _>>()?,
            moved: take_moved(rest, head.moved)?,
        };
        let places_are_finite = course.world_from_room.is_finite() && course.eyes.iter().all(|eye| eye.is_finite());
        if !course.scene_time_s.is_finite() || !places_are_finite {
            return Err(WireError::NotFinite { what: "a number of the course" });
        }
        let latest = course.number.max(course.steering.path_frame);
        if latest > MAX_FRAME {
            return Err(WireError::Limit { what: "a frame's number", value: latest, cap: MAX_FRAME });
        }
        if course.base.is_some_and(|base| base >= course.number) {
            return Err(WireError::Bulk { what: "base" });
        }
        Ok(course)
    }
}

fn presence_of(bytes: &[u8]) -> Result<(ObjectId, Presence), WireError> {
    let (object, presence) = bytes.split_at(4);
    let presence = match presence {
        [0] => Presence::There,
        [1] => Presence::Away,
        _ => return Err(WireError::Bulk { what: "presences" }),
    };
    Ok((ObjectId(bytemuck::pod_read_unaligned(object)), presence))
}

impl ToStandby {
    /// Writes the whole message to `out`, which it empties first.
    ///
    /// # Errors
    /// When a part passes its cap.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        match self {
            Self::Insertions(insertions) => {
                insertions.check()?;
                framed(out, tag::INSERTIONS, MAX_TO_TILE_BYTES, |out| Ok(codec::encode_into(insertions, out)?))
            }
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
            tag::INSERTIONS => {
                let insertions: Insertions = codec::decode::<_, MAX_INSERTIONS_BYTES>(rest)?;
                insertions.check().map(|()| Self::Insertions(insertions))
            }
            tag::COURSE => Ok(Self::Course(Box::new(Course::decode(rest)?))),
            tag::ALIVE if rest.is_empty() => Ok(Self::Alive),
            tag::BYE => Ok(Self::Bye(take_bye(rest)?)),
            tag => Err(WireError::Tag { tag }),
        }
    }
}
