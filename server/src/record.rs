//! All that came into a show, frame by frame, and the digest of what each view saw: enough to cull it again, bit for bit.
//!
//! ```text
//! "MULLREC\x01"  version u32
//! per record: length u32, kind u8 (0 header, 1 frame, 2 end), a value through the codec
//! ```
//! One header comes first. A file without an end was cut off: its whole frames count.

use std::io::{self, Read, Write};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};

use glam::{DAffine3, DVec3};
use mullion_common::scene::{ChunkHash, ObjectId, Package, PackageError};
use mullion_common::visible_set::VisibleSet;
use mullion_common::wall::Wall;
use mullion_common::wire::codec::{self, CodecError};
use mullion_common::wire::{Budget, Insertion, MAX_VIEWS, Moved, Steering};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::control::MAX_QUEUED;
use crate::library::content_hash;
use crate::service::Pose;
use crate::tree::Presence;

const MAGIC: [u8; 8] = *b"MULLREC\x01";
/// Version of the file. A reader takes only its own.
pub const RECORD_VERSION: u32 = 3;
/// Most bytes of a record.
const MAX_RECORD_BYTES: usize = 64 << 20;
/// Most bytes of a header: two hashes and two names.
const MAX_HEADER_BYTES: usize = 16 << 10;
/// Bytes of an object and its transform.
const MOVE_BYTES: usize = 100;
const _: () = assert!(MAX_QUEUED * MOVE_BYTES + MAX_VIEWS * 64 + 2048 <= MAX_RECORD_BYTES, "a frame of a full queue fits");
/// Frames that wait for the disk; beyond, recording stops.
const MAX_WAITING: usize = 64;

const HEADER: u8 = 0;
const FRAME: u8 = 1;
const END: u8 = 2;

/// What was shown, where, and how it was culled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Of the scene's sections.
    pub scene: [u8; 32],
    /// Of the wall's tiles, views and eyes.
    pub wall: [u8; 32],
    /// The algorithm's name.
    pub algorithm: String,
    /// Frames a second that the show aimed at; 0: as many as nodes could show.
    pub rate_hz: f64,
    /// The camera path, as the user named it.
    pub path: String,
}

/// How recording ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Ending {
    /// With the show.
    Complete,
    /// The disk fell behind, or a frame was too large: later frames are missing.
    GivenUp,
}

/// One frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecordedFrame {
    /// Its number.
    pub number: u64,
    /// All that came in, but for the scenes that came with it.
    pub pose: Pose,
    /// What had been inserted into the scene that the frame begins with, where it was another master's.
    pub begins_with: Option<Vec<Insertion>>,
    /// What was inserted into that.
    pub insertion: Option<Insertion>,
    /// Digest of each view's set, by `ViewId`.
    pub digests: Vec<u64>,
}

/// A frame as it is written; lists take no memory for what they claim.
#[derive(Serialize, Deserialize)]
struct Frame {
    number: u64,
    scene_time_s: f64,
    world_from_room: [f64; 12],
    eyes: codec::List<[f64; 3]>,
    moved: codec::List<(u32, [f64; 12])>,
    presence: codec::List<(ObjectId, Presence)>,
    budgets: codec::List<Budget>,
    begins_with: Option<codec::List<Insertion>>,
    insertion: Option<Insertion>,
    grows: bool,
    digests: codec::List<u64>,
}

/// Why a file is no record, or cannot be read.
#[derive(Debug, Error)]
#[allow(missing_docs)]
pub enum RecordError {
    #[error("not a record of a show: it does not start with MULLREC")]
    Magic,
    #[error("record version {found}; this program reads version {RECORD_VERSION}")]
    Version { found: u32 },
    #[error("record {place}: {length} bytes, at most {MAX_RECORD_BYTES} are allowed")]
    TooLong { place: u64, length: u32 },
    #[error("record {place}: {problem}")]
    Malformed { place: u64, problem: String },
    #[error("{0}")]
    Codec(#[from] CodecError),
    #[error("{0}")]
    Package(#[from] PackageError),
    #[error("{0}")]
    Io(#[from] io::Error),
}

impl Header {
    /// For a show.
    ///
    /// # Errors
    /// When the scene has sections that cannot be written: never, for a checked one.
    pub fn of(wall: &Wall, package: &Package, algorithm: &str, rate_hz: f64, path: &str) -> Result<Self, RecordError> {
        let mut room: Vec<u8> = wall.near_m().to_le_bytes().to_vec();
        let mut put = |numbers: &[DVec3]| numbers.iter().for_each(|n| room.extend_from_slice(bytemuck::bytes_of(&n.to_array())));
        wall.tiles().iter().for_each(|tile| put(&tile.corners));
        put(&wall.default_eyes());
        for (tile, view) in wall.views().iter().map(|view| (view.tile, view)) {
            room.extend_from_slice(wall.tile(tile).name.as_bytes());
            codec::encode_into(view, &mut room)?;
        }
        Ok(Self {
            scene: content_hash(package)?.0,
            wall: ChunkHash::of(&room).0,
            algorithm: algorithm.to_owned(),
            rate_hz,
            path: path.to_owned(),
        })
    }

    /// Whether a record with this header is of the same scene and wall.
    ///
    /// # Errors
    /// Names what differs.
    pub fn check_same(&self, other: &Self) -> Result<(), String> {
        match (self.scene == other.scene, self.wall == other.wall) {
            (false, _) => Err("the record is of another scene, or of one that was prepared otherwise".to_owned()),
            (_, false) => Err("the record is of another wall".to_owned()),
            _ => Ok(()),
        }
    }
}

fn framed(out: &mut Vec<u8>, kind: u8, value: &impl Serialize) -> Result<(), CodecError> {
    out.clear();
    out.extend_from_slice(&[0, 0, 0, 0, kind]);
    codec::encode_into(value, out)?;
    let length = out.len() - 4;
    if length > MAX_RECORD_BYTES {
        return Err(CodecError::TooLarge { len: length, cap: MAX_RECORD_BYTES });
    }
    out[..4].copy_from_slice(&(length as u32).to_le_bytes());
    Ok(())
}

/// Writes a show down, on a thread of its own: a frame never waits for the disk.
pub struct Recorder {
    number: u64,
    to_disk: Option<SyncSender<Vec<u8>>>,
    free: Receiver<Vec<u8>>,
    is_given_up: bool,
    thread: Option<JoinHandle<()>>,
}

impl Recorder {
    /// Begins a record.
    ///
    /// # Errors
    /// When the header is too large or cannot be written, or the system gives no thread.
    pub fn start(mut out: impl Write + Send + 'static, header: &Header) -> Result<Self, RecordError> {
        let mut bytes = Vec::new();
        framed(&mut bytes, HEADER, header)?;
        if bytes.len() > MAX_HEADER_BYTES {
            return Err(CodecError::TooLarge { len: bytes.len(), cap: MAX_HEADER_BYTES }.into());
        }
        out.write_all(&MAGIC)?;
        out.write_all(&RECORD_VERSION.to_le_bytes())?;
        out.write_all(&bytes)?;
        out.flush()?;
        let (to_disk, frames) = sync_channel::<Vec<u8>>(MAX_WAITING);
        let (give_back, free) = sync_channel(MAX_WAITING);
        let write = move || {
            for bytes in frames {
                if let Err(error) = out.write_all(&bytes) {
                    // The channel closes: the show sees it with its next frame.
                    return tracing::warn!("recording stopped: {error}");
                }
                let _ = give_back.try_send(bytes); // enough are waiting, or the show is over
            }
            if let Err(error) = out.flush() {
                tracing::warn!("the end of the record is missing: {error}");
            }
        };
        let thread = thread::Builder::new().name("record".to_owned()).spawn(write)?;
        Ok(Self { number: 0, to_disk: Some(to_disk), free, is_given_up: false, thread: Some(thread) })
    }

    /// Writes a frame down: the first is number 0.
    pub fn note(&mut self, pose: &Pose, sets: &[VisibleSet]) {
        let number = self.number;
        self.number += 1;
        let Some(to_disk) = self.to_disk.as_ref().filter(|_| !self.is_given_up) else { return };
        let mut bytes = self.free.try_recv().unwrap_or_default();
        let frame = Frame {
            number,
            scene_time_s: pose.scene_time_s,
            world_from_room: pose.world_from_room.to_cols_array(),
            eyes: codec::List(pose.eyes.iter().map(DVec3::to_array).collect()),
            moved: codec::List(pose.moved.iter().map(|m| (m.object.0, m.transform.affine().to_cols_array())).collect()),
            presence: codec::List(pose.presence.clone()),
            budgets: codec::List(pose.budgets.clone()),
            begins_with: pose.begins_with.as_ref().map(|fresh| codec::List(fresh.insertions().to_vec())),
            insertion: pose.offer.as_ref().map(|offer| offer.insertion().clone()),
            grows: pose.grows,
            digests: codec::List(sets.iter().map(VisibleSet::digest).collect()),
        };
        let problem = match framed(&mut bytes, FRAME, &frame) {
            Err(error) => error.to_string(),
            Ok(()) => match to_disk.try_send(bytes) {
                Ok(()) => return,
                Err(TrySendError::Full(_)) => format!("the disk is {MAX_WAITING} frames behind"),
                Err(TrySendError::Disconnected(_)) => "the file cannot be written".to_owned(),
            },
        };
        tracing::warn!("recording stopped before frame {number}: {problem}");
        self.is_given_up = true;
    }
}

impl Drop for Recorder {
    /// Writes the end, and waits until all is on its way to the disk.
    fn drop(&mut self) {
        let ending = if self.is_given_up { Ending::GivenUp } else { Ending::Complete };
        let mut bytes = Vec::new();
        if let (Some(to_disk), Ok(())) = (self.to_disk.take(), framed(&mut bytes, END, &ending)) {
            let _ = to_disk.send(bytes); // the writer is gone, and has said why
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // it panicked: it is over, too
        }
    }
}

/// Reads a record, frame by frame.
pub struct Reader<R> {
    input: R,
    place: u64,
    next_frame: u64,
    header: Header,
    ending: Option<Ending>,
}

impl<R: Read> Reader<R> {
    /// Reads the header.
    ///
    /// # Errors
    /// When it is no record, or of another version.
    pub fn open(mut input: R) -> Result<Self, RecordError> {
        let mut start = [0; 12];
        input.read_exact(&mut start).map_err(|_| RecordError::Magic)?;
        let (magic, version) = start.split_at(8);
        if magic != MAGIC {
            return Err(RecordError::Magic);
        }
        let found = u32::from_le_bytes([version[0], version[1], version[2], version[3]]);
        if found != RECORD_VERSION {
            return Err(RecordError::Version { found });
        }
        let header = match next_record(&mut input, 0)? {
            Some((HEADER, bytes)) => codec::decode::<Header, MAX_HEADER_BYTES>(&bytes)?,
            _ => return Err(RecordError::Malformed { place: 0, problem: "no header".to_owned() }),
        };
        Ok(Self { input, place: 1, next_frame: 0, header, ending: None })
    }

    /// What was recorded.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// How the recording ended, once all frames are read; none: it was cut off.
    pub fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }

    /// The next frame; none after the last whole one.
    ///
    /// # Errors
    /// When the file is damaged.
    pub fn next_frame(&mut self) -> Result<Option<RecordedFrame>, RecordError> {
        if self.ending.is_some() {
            return Ok(None);
        }
        let place = self.place;
        let malformed = |problem: String| RecordError::Malformed { place, problem };
        let Some((kind, bytes)) = next_record(&mut self.input, place)? else { return Ok(None) };
        self.place += 1;
        match kind {
            FRAME => {
                let frame = codec::decode::<Frame, MAX_RECORD_BYTES>(&bytes).map_err(|e| malformed(e.to_string()))?;
                if frame.number != self.next_frame {
                    return Err(malformed(format!("frame {} where {} is due", frame.number, self.next_frame)));
                }
                self.next_frame += 1;
                let moved = frame.moved.0.into_iter().map(|(object, transform)| Moved {
                    object: ObjectId(object),
                    transform: DAffine3::from_cols_array(&transform).into(),
                });
                let pose = Pose {
                    number: frame.number,
                    steering: Steering::default(),
                    scene_time_s: frame.scene_time_s,
                    world_from_room: DAffine3::from_cols_array(&frame.world_from_room),
                    eyes: frame.eyes.0.into_iter().map(DVec3::from).collect(),
                    moved: moved.collect(),
                    presence: frame.presence.0,
                    budgets: frame.budgets.0,
                    offer: None,
                    grows: frame.grows,
                    begins_with: None,
                };
                let Frame { number, insertion, .. } = frame;
                let begins_with = frame.begins_with.map(|list| list.0);
                Ok(Some(RecordedFrame { number, pose, begins_with, insertion, digests: frame.digests.0 }))
            }
            END => {
                self.ending = Some(codec::decode::<Ending, 16>(&bytes).map_err(|e| malformed(e.to_string()))?);
                Ok(None)
            }
            other => Err(malformed(format!("no record has kind {other} here"))),
        }
    }
}

/// The kind and bytes of the next record; none where the file ends, within it, too.
fn next_record(input: &mut impl Read, place: u64) -> Result<Option<(u8, Vec<u8>)>, RecordError> {
    let mut head = [0; 5];
    let mut bytes = Vec::new();
    if (&mut *input).take(4).read_to_end(&mut bytes)? < 4 {
        return Ok(None);
    }
    head[..4].copy_from_slice(&bytes);
    let length = u32::from_le_bytes([head[0], head[1], head[2], head[3]]);
    if length == 0 || length as usize > MAX_RECORD_BYTES {
        return Err(RecordError::TooLong { place, length });
    }
    bytes.clear();
    // Memory grows with what is there.
    if input.take(u64::from(length)).read_to_end(&mut bytes)? < length as usize {
        return Ok(None);
    }
    let kind = bytes.remove(0);
    Ok(Some((kind, bytes)))
}
