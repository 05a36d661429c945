//! Standing by: following another master's show until that master is gone.

use std::collections::BTreeMap;
use std::time::Duration;

use futures_util::StreamExt;
use mullion_common::scene::ObjectId;
use mullion_common::wire::{
    ALIVE_EVERY, Bye, ByeCode, MAX_TO_TILE_BYTES, Moved, Opening, SectionRef, StandbyHello, Stats, ToMaster, ToStandby, WireError,
};
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::connection::{framed, write_all};
use super::network::{Connector, Listener, Socket, Writer};
use super::{NodeEvent, Rate, ServiceError, Show, stopped};
use crate::master::TELL_STANDBYS_EVERY;

/// How long a master may say nothing before it counts as gone.
const SILENCE: Duration = Duration::from_secs(1);
const _: () = assert!(SILENCE.as_millis() >= 4 * TELL_STANDBYS_EVERY.as_millis(), "a few lost signs of life are no death");
/// How long a lost connection is tried to be made again before the master counts as gone, so that a hiccup of the network makes no two
/// masters.
const TRY_AGAIN_FOR: Duration = Duration::from_millis(150);
/// How long a first master is waited for between attempts.
const TRY_EVERY: Duration = Duration::from_millis(30);

/// What the new master takes from the old one.
#[derive(Debug, Default)]
pub(super) struct Inherited {
    /// A frame after all that the old one can have shown.
    pub first_frame: u64,
    /// Objects that are not where the manifest has them.
    pub moved: Vec<Moved>,
}

/// How a connection to the master ended.
enum Parting {
    Lost(String),
    Bye(Bye),
}

/// Stands by until it is this master's turn. `None`: the show ended, or was stopped, before that.
///
/// Nodes that come meanwhile are turned away by closing their connections: they try their other masters.
pub(super) async fn stand_by(
    listener: &impl Listener,
    master: &str,
    show: &mut Show,
    sections: &[SectionRef],
) -> Result<Option<Inherited>, ServiceError> {
    let hello = StandbyHello::of(&show.wall, sections).map_err(std::io::Error::other)?;
    let mut known = Known::default();
    let mut stop = show.stop.clone();
    let connector = show.options.connector.clone();
    (show.node_observer)(&NodeEvent::StandingBy);
    let reason = tokio::select! {
        biased;
        parting = follow(&connector, master, &hello, &mut known) => match parting {
            Parting::Bye(bye) if bye.code == ByeCode::EndOfShow => return Ok(None),
            Parting::Bye(bye) => return Err(ServiceError::Standby(bye)),
            Parting::Lost(reason) => reason,
        },
        () = turn_away(listener) => unreachable!("it has no end"),
        () = stopped(&mut stop) => return Ok(None),
    };
    let inherited = known.inherited(show.options.rate);
    (show.node_observer)(&NodeEvent::TookOver { frame: inherited.first_frame, reason });
    Ok(Some(inherited))
}

async fn turn_away(listener: &impl Listener) {
    loop {
        if listener.accept().await.is_err() {
            sleep(TRY_EVERY).await; // out of descriptors, most often
        }
    }
}

/// Where the show stands, as far as it was heard.
#[derive(Default)]
struct Known {
    /// The newest frame, and when it was heard of.
    newest: Option<(u64, Instant)>,
    moved: BTreeMap<ObjectId, Moved>,
}

impl Known {
    /// Frames are counted on for the time since the newest was heard of: the master may have shown more, unheard, before it was gone.
    fn inherited(self, rate: Rate) -> Inherited {
        let first_frame = self.newest.map_or(0, |(newest, heard)| match rate {
            Rate::AsFastAsPossible => newest + 1,
            Rate::Hz(hz) => newest + 1 + (heard.elapsed().as_secs_f64() * hz).ceil() as u64,
        });
        Inherited { first_frame, moved: self.moved.into_values().collect() }
    }
}

/// Follows the master until it says goodbye, or is gone. A master that was never there is waited for: the standby may be started first.
async fn follow(connector: &Connector, master: &str, hello: &StandbyHello, known: &mut Known) -> Parting {
    let mut lost: Option<(Instant, String)> = None;
    loop {
        let parting = match timeout(SILENCE, connector.connect(master)).await {
            Ok(Ok(socket)) => converse(socket, hello, known, &mut lost).await,
            Ok(Err(error)) => Parting::Lost(error.to_string()),
            Err(_) => Parting::Lost("no answer".into()),
        };
        match parting {
            Parting::Bye(bye) if matches!(bye.code, ByeCode::EndOfShow | ByeCode::VersionMismatch | ByeCode::Refused) => {
                return Parting::Bye(bye);
            }
            Parting::Bye(bye) if bye.code == ByeCode::Failed => return Parting::Lost(bye.to_string()),
            Parting::Bye(bye) => tracing::warn!("{master}: {bye}; trying again"),
            Parting::Lost(reason) => {
                let (since, first_reason) = lost.get_or_insert_with(|| (Instant::now(), reason));
                if known.newest.is_some() && since.elapsed() >= TRY_AGAIN_FOR {
                    return Parting::Lost(std::mem::take(first_reason));
                }
            }
        }
        sleep(TRY_EVERY).await;
    }
}

/// One connection. `lost` is emptied once the master has said something on it.
async fn converse(socket: Socket, hello: &StandbyHello, known: &mut Known, lost: &mut Option<(Instant, String)>) -> Parting {
    let gone = |error: std::io::Error| Parting::Lost(error.to_string());
    let Socket { reader, mut writer } = socket;
    let mut bodies = framed(reader, MAX_TO_TILE_BYTES);
    let mut buffer = Vec::new();
    let hello = Opening::Standby(*hello);
    if let Err(error) = write(&mut writer, &mut buffer, |out| hello.encode(out)).await {
        return gone(error);
    }
    let mut beat = tokio::time::interval(ALIVE_EVERY);
    let mut heard = Instant::now();
    loop {
        let answer = tokio::select! {
            biased;
            _ = beat.tick() => ToMaster::Stats(Stats::default()),
            body = timeout_at(heard + SILENCE, bodies.next()) => {
                heard = Instant::now();
                let body = match body {
                    Ok(Some(Ok(body))) => body,
                    Ok(Some(Err(error))) => return gone(error),
                    Ok(None) => return Parting::Lost("the master closed the connection".into()),
                    Err(_) => return Parting::Lost(format!("the master was silent for {} ms", SILENCE.as_millis())),
                };
                *lost = None;
                match ToStandby::decode(&body) {
                    Ok(ToStandby::Course(course)) => {
                        if course.base.is_none() {
                            known.moved.clear(); // all that moved is in it
                        }
                        known.moved.extend(course.moved.iter().map(|moved| (moved.object, *moved)));
                        known.newest = Some((course.number, heard));
                        ToMaster::Ready { frame: course.number, shown: None }
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

async fn write(
    writer: &mut Writer,
    buffer: &mut Vec<u8>,
    encode: impl FnOnce(&mut Vec<u8>) -> Result<(), WireError>,
) -> std::io::Result<()> {
    encode(buffer).map_err(std::io::Error::other)?;
    write_all(writer, buffer).await
}
