//! Standing by: following another master's show until that master is gone.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use futures_util::StreamExt;
use mullion_common::scene::{ObjectId, Presence, Transform};
use mullion_common::tls::describe;
use mullion_common::wall::Wall;
use mullion_common::wire::{
    ALIVE_EVERY, Bye, ByeCode, Course, MAX_TILE_SECTION_BYTES, MAX_TO_TILE_BYTES, Moved, Opening, StandbyHello, Stats, Steering,
    ToMaster, ToStandby, WireError,
};
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::connection::{framed, write_all};
use super::grown::Grown;
use super::network::{Connector, Listener, Socket, Writer};
use super::scenes::{Entry, Scene, Scenes};
use super::transport::{Security, connect};
use super::{Heritage, Inherited, NodeEvent, Rate, ServiceError, Show, stopped};
use crate::master::{LastWords, TELL_STANDBYS_EVERY};

/// How long a master may say nothing before it counts as gone.
const SILENCE: Duration = Duration::from_secs(1);
const _: () = assert!(SILENCE.as_millis() >= 4 * TELL_STANDBYS_EVERY.as_millis(), "a few lost signs of life are no death");
/// How long a lost connection is tried to be made again before the master counts as gone, so that a hiccup of the network makes no two
/// masters.
const TRY_AGAIN_FOR: Duration = Duration::from_millis(150);
/// How long a first master is waited for between attempts.
const TRY_EVERY: Duration = Duration::from_millis(30);
/// The same where another master stands by already.
const TRY_AGAIN_LATER: Duration = Duration::from_secs(1);
/// How long a master that stepped back waits for the first word of the one that it stepped back for, before it takes the show up again.
const FIRST_WORD_LIMIT: Duration = Duration::from_secs(3);

/// Most objects that a scene may have grown to.
const MAX_OBJECTS: usize = MAX_TILE_SECTION_BYTES as usize / size_of::<Transform>();

/// How a connection to the master ended.
enum Parting {
    Lost(String),
    Bye(Bye),
}

/// What a standby goes on from.
pub(super) struct Inheritance {
    /// The last that was heard of, with all that moved, came or went.
    pub course: Course,
    pub scene: Scene,
}

/// Stands by until it is this master's turn. `None`: the show ended, or was stopped, before that. A master that stepped back knows a
/// course already, of the scene that it showed.
///
/// Nodes that come meanwhile are turned away by closing their connections: they try their other masters.
pub(super) async fn stand_by(
    listener: &impl Listener,
    master: &str,
    show: &mut Show,
    hello: &StandbyHello,
    (scenes, course): (Scenes, Option<Course>),
) -> Result<Option<Inheritance>, ServiceError> {
    let mut known = Known::new(&show.wall, scenes);
    let objects = known.scenes.shown().objects();
    course.map_or(Ok(()), |course| known.note(course, objects, Instant::now())).map_err(std::io::Error::other)?;
    let mut stop = show.stop.clone();
    let (connector, security) = (show.options.connector.clone(), show.options.security.clone());
    show.options.succession.stand_by();
    (show.node_observer)(&NodeEvent::StandingBy { master: master.to_owned() });
    let reason = tokio::select! {
        biased;
        parting = follow((&connector, &security), master, hello, &mut known) => match parting {
            Parting::Bye(bye) if bye.code == ByeCode::EndOfShow => return Ok(None),
            Parting::Bye(bye) => return Err(ServiceError::Standby(bye)),
            Parting::Lost(reason) => reason,
        },
        () = turn_away(listener) => unreachable!("it has no end"),
        () = stopped(&mut stop) => return Ok(None),
    };
    let Some(inheritance) = known.inheritance(show.options.rate) else { return Ok(None) };
    let Inheritance { course, scene } = &inheritance;
    (show.node_observer)(&NodeEvent::TookOver { master: master.to_owned(), frame: course.number + 1, reason });
    show.options.succession.take_over(Heritage { course: course.clone(), package: Arc::clone(scene.grown.package()) });
    Ok(Some(inheritance))
}

/// What the first frame begins with of a master that may have driven the show before; `own` is the course of that. Where the scene is still
/// the same, what it moved, took or brought back itself is undone first, so that its cull and its nodes agree.
pub(super) fn handed_on(own: Option<Course>, Inheritance { mut course, scene }: Inheritance, grown: &mut Grown) -> Inherited {
    *grown = scene.grown;
    if let Some(own) = own.filter(|_| scene.fresh.is_none()) {
        let manifest = &grown.package().scene.manifest;
        let rest = |object: ObjectId| Moved { object, transform: manifest.transforms[object.0 as usize] };
        course.moved.splice(..0, own.moved.iter().map(|moved| rest(moved.object)));
        course.presence.splice(..0, own.presence.iter().map(|(object, _)| (*object, Presence::There)));
    }
    Inherited { course, fresh: scene.fresh }
}

async fn turn_away(listener: &impl Listener) {
    loop {
        if listener.accept().await.is_err() {
            sleep(TRY_EVERY).await; // out of descriptors, most often
        }
    }
}

/// Where the show stands, as far as it was heard.
struct Known {
    views: usize,
    scenes: Scenes,
    /// Whether the master that is followed has told of its show.
    is_followed: bool,
    /// But for what it says of objects, which is below; and when it was heard of.
    newest: Option<(Course, Instant)>,
    moved: BTreeMap<ObjectId, Moved>,
    presence: LastWords,
}

impl Known {
    fn new(wall: &Wall, scenes: Scenes) -> Self {
        let views = wall.views().len();
        Self { views, scenes, is_followed: false, newest: None, moved: BTreeMap::new(), presence: LastWords::default() }
    }

    /// Takes a course that the master sent, unless it is not one of this wall and scene; whether it is of use.
    fn take(&mut self, course: Course, heard: Instant) -> Result<bool, &'static str> {
        self.is_followed = true;
        let objects = match self.scenes.enter(course.epoch) {
            None => return Err("a course of a scene that it did not tell of"),
            Some(Entry::Apart) => return Ok(false),
            Some(Entry::Behind) => MAX_OBJECTS,
            Some(Entry::Here) => self.scenes.shown().objects(),
        };
        self.note(course, objects, heard)?;
        Ok(true)
    }

    /// Takes a course of a scene with so many objects.
    fn note(&mut self, mut course: Course, objects: usize, heard: Instant) -> Result<(), &'static str> {
        let is_known = |object: ObjectId| (object.0 as usize) < objects;
        if course.eyes.len() != self.views || ![0, self.views].contains(&course.budgets.len()) {
            return Err("a course of another wall");
        }
        if !course.moved.iter().all(|moved| is_known(moved.object))
            || !course.presence.iter().all(|(object, _)| is_known(*object))
        {
            return Err("a course of another scene");
        }
        if course.base.is_none() {
            self.moved.clear(); // all that moved, came or went is in it
            self.presence.clear();
        }
        self.moved.extend(course.moved.drain(..).map(|moved| (moved.object, moved)));
        course.presence.drain(..).for_each(|(object, presence)| self.presence.say(object, presence, course.number));
        self.newest = Some((course, heard));
        Ok(())
    }

    fn forget(&mut self) {
        (self.is_followed, self.newest) = (false, None);
        self.moved.clear();
        self.presence.clear();
    }

    /// The newest course, as one that stands on nothing, and its scene. Frames are counted on for the time since it was heard of: the
    /// master may have shown more, unheard, before it was gone.
    fn inheritance(self, rate: Rate) -> Option<Inheritance> {
        let (mut course, heard) = self.newest?;
        if let Rate::Hz(hz) = rate {
            count_on(&mut course, (heard.elapsed().as_secs_f64() * hz).ceil() as u64);
        }
        course.base = None;
        course.moved = self.moved.into_values().collect();
        self.presence.since(None, &mut course.presence);
        let scene = self.scenes.into_shown();
        // What is said of objects that have not come waits for nobody.
        let is_here = |object: ObjectId| (object.0 as usize) < scene.grown.objects();
        course.moved.retain(|moved| is_here(moved.object));
        course.presence.retain(|(object, _)| is_here(*object));
        Some(Inheritance { course, scene })
    }
}

/// What became of a course while so many frames went by: time passes as it would have.
fn count_on(course: &mut Course, frames: u64) {
    course.number += frames;
    let Steering { path_frame, held_after, .. } = &mut course.steering;
    let passed = held_after.map_or(frames, |left| frames.min(u64::from(left)));
    *path_frame += passed;
    *held_after = held_after.map(|left| left - passed as u32);
}

/// Follows the master until it says goodbye, or is gone. A master that was never there is waited for: the standby may be started first.
async fn follow(network: (&Connector, &Security), master: &str, hello: &StandbyHello, known: &mut Known) -> Parting {
    let mut lost: Option<(Instant, String)> = None;
    let mut last_complaint = String::new();
    let mut complain = |what: String| {
        if what != last_complaint {
            tracing::warn!("{what}"); // once for each reason, not for each attempt
            last_complaint = what;
        }
    };
    loop {
        // A master that hangs still takes connections: its first word on a new one counts.
        let limit = if lost.is_some() && known.is_followed { TRY_AGAIN_FOR } else { SILENCE };
        let parting = match timeout(limit, connect(master, network)).await {
            Ok(Ok(socket)) => converse(socket, hello, known, (&mut lost, limit)).await,
            Ok(Err(error)) => Parting::Lost(describe(&error)),
            Err(_) => Parting::Lost("no answer".into()),
        };
        match parting {
            Parting::Bye(bye) if matches!(bye.code, ByeCode::EndOfShow | ByeCode::VersionMismatch | ByeCode::Refused) => {
                return Parting::Bye(bye);
            }
            Parting::Bye(bye) if bye.code == ByeCode::Failed && known.newest.is_some() => return Parting::Lost(bye.to_string()),
            Parting::Bye(bye) => {
                lost = None; // it is there
                complain(format!("{master}: {bye}; trying again"));
                if matches!(bye.code, ByeCode::OtherMaster | ByeCode::TooMany) {
                    known.forget(); // it stands by, too, or another one for it: its place is not this one's to take
                }
                if bye.code == ByeCode::TooMany {
                    sleep(TRY_AGAIN_LATER).await;
                }
            }
            Parting::Lost(reason) => {
                complain(format!("{master}: {reason}; trying again"));
                let (since, first_reason) = lost.get_or_insert_with(|| (Instant::now(), reason));
                let patience = if known.is_followed { TRY_AGAIN_FOR } else { FIRST_WORD_LIMIT };
                if known.newest.is_some() && since.elapsed() >= patience {
                    return Parting::Lost(std::mem::take(first_reason));
                }
            }
        }
        sleep(TRY_EVERY).await;
    }
}

/// One connection. `lost` is emptied once the master has said something on it, for which it has `first_word_limit`.
async fn converse(
    socket: Socket,
    hello: &StandbyHello,
    known: &mut Known,
    (lost, first_word_limit): (&mut Option<(Instant, String)>, Duration),
) -> Parting {
    let gone = |error: std::io::Error| Parting::Lost(describe(&error));
    let Socket { reader, mut writer } = socket;
    let mut bodies = framed(reader, MAX_TO_TILE_BYTES);
    let mut buffer = Vec::new();
    let hello = Opening::Standby(*hello);
    if let Err(error) = write(&mut writer, &mut buffer, |out| hello.encode(out)).await {
        return gone(error);
    }
    let mut beat = tokio::time::interval(ALIVE_EVERY);
    let mut silent_at = Instant::now() + first_word_limit;
    known.scenes.greet();
    loop {
        let answer = tokio::select! {
            biased;
            _ = beat.tick() => ToMaster::Stats(Stats::default()),
            answer = known.scenes.answer() => answer,
            body = timeout_at(silent_at, bodies.next()) => {
                let body = match body {
                    Ok(Some(Ok(body))) => body,
                    Ok(Some(Err(error))) => return gone(error),
                    Ok(None) => return Parting::Lost("the master closed the connection".into()),
                    Err(_) => return Parting::Lost("the master is silent".into()),
                };
                *lost = None;
                silent_at = Instant::now() + SILENCE;
                match ToStandby::decode(&body) {
                    Ok(ToStandby::Course(course)) => {
                        let frame = course.number;
                        match known.take(*course, Instant::now()) {
                            Ok(true) => ToMaster::Ready { frame, draw_us: 0, is_cut: false, shown: None },
                            Ok(false) => continue,
                            Err(problem) => return Parting::Lost(format!("the master sent {problem}")),
                        }
                    }
                    Ok(ToStandby::Insertions(insertions)) => {
                        known.scenes.want(insertions);
                        continue;
                    }
                    Ok(ToStandby::Alive) => continue,
                    Ok(ToStandby::Bye(bye)) => return Parting::Bye(bye),
                    Err(error) => return Parting::Lost(format!("the master sent what is no message: {error}")),
                }
            }
        };
        if let Err(error) = write(&mut writer, &mut buffer, |out| answer.encode(out)).await {
            return gone(error);
        }
    }
}

/// Whether a master drives the show: it tells of its scene, or another one stands by for it.
pub(super) async fn drives(master: &str, network: (&Connector, &Security), hello: &StandbyHello) -> bool {
    let ask = async {
        let Socket { reader, mut writer } = connect(master, network).await.ok()?;
        let hello = Opening::Standby(*hello);
        write(&mut writer, &mut Vec::new(), |out| hello.encode(out)).await.ok()?;
        let mut bodies = framed(reader, MAX_TO_TILE_BYTES);
        loop {
            match ToStandby::decode(&bodies.next().await?.ok()?).ok()? {
                ToStandby::Insertions(_) | ToStandby::Course(_) => return Some(true),
                ToStandby::Alive => {}
                ToStandby::Bye(bye) => return Some(bye.code == ByeCode::TooMany),
            }
        }
    };
    timeout(SILENCE, ask).await.ok().flatten().unwrap_or(false)
}

pub(super) async fn write(
    writer: &mut Writer,
    buffer: &mut Vec<u8>,
    encode: impl FnOnce(&mut Vec<u8>) -> Result<(), WireError>,
) -> std::io::Result<()> {
    encode(buffer).map_err(std::io::Error::other)?;
    write_all(writer, buffer).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_nobody_heard_of_pass_as_time_was_held() {
        let after = |held_after, frames| {
            let steering = Steering { path_frame: 100, held_after, is_off_path: false };
            let mut course = Course { number: 7, steering, ..Course::default() };
            count_on(&mut course, frames);
            (course.number, course.steering.path_frame, course.steering.held_after)
        };
        assert_eq!(after(None, 5), (12, 105, None), "time passes");
        assert_eq!(after(Some(0), 5), (12, 100, Some(0)), "a pause holds");
        assert_eq!(after(Some(3), 5), (12, 103, Some(0)), "a step ends");
        assert_eq!(after(Some(9), 5), (12, 105, Some(4)));
    }
}
