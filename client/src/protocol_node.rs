//! A node that takes part in a show without drawing: it applies every frame, holds every set against the master's digest, is ready, and
//! tells when it was let to show. Hundreds run on one thread: they are for loading a master.

use std::time::Duration;

use futures_util::StreamExt;
use mullion_common::wire::{ALIVE_EVERY, Bye, MAX_TO_TILE_BYTES, Opening, ToMaster, ToTile};
use tokio::sync::Mutex;
use tokio::time::{Instant, timeout_at};

use crate::connection::{End, framed, keep_connected, stopped, write_message};
use crate::master_clock::{MasterClock, PING_EVERY};
use crate::node::{NodeError, NodeOptions};
use crate::tile_session::{Action, DrawStats, EndedBy, FrameToDraw, TileSession};
use crate::transport::{Stream, Writer, describe};

/// What such a node did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProtocolReport {
    /// Frames applied, every set of which was the master's.
    pub applied: u64,
    /// Frames that it was let to show.
    pub shown: u64,
    /// Connections that were made.
    pub connections: u32,
    /// Connections that it left because what came was not to be believed: a set that is not the master's, most of all.
    pub left: u32,
    /// Bytes of frames.
    pub frame_bytes: u64,
    /// How far its estimate of the master's clock was off at most, when the last connection ended.
    pub uncertainty: Option<Duration>,
}

/// What such a node does.
#[derive(Clone, Copy, Debug)]
pub enum Step<'a> {
    /// It has a connection to this master, and greets.
    Connected(&'a str),
    /// It has applied a frame, every set of which is the master's, and says that it is ready.
    Applied(&'a FrameToDraw),
    /// It was let to show this frame.
    Shown(u64),
    /// It leaves, because what came was not to be believed.
    Left(&'a Bye),
}

/// Runs such a node until the show ends, its `stop` turns true, or the master refuses it for good.
///
/// # Errors
/// When the master refuses the node for good or stays out of reach.
pub async fn run(options: NodeOptions) -> Result<ProtocolReport, NodeError> {
    run_observed(options, |_| {}).await
}

/// The same, and tells of every step, as it is taken.
///
/// # Errors
/// As [`run`].
pub async fn run_observed(options: NodeOptions, observe: impl FnMut(Step<'_>)) -> Result<ProtocolReport, NodeError> {
    let session = TileSession::without_scene(options.node.clone(), options.credentials.clone()).taking_part_as(options.part);
    let (report, clock) = (ProtocolReport::default(), MasterClock::default());
    let node = Mutex::new(Node { session, clock, report, started: Instant::now(), patience: options.patience(), observe });
    let stop = options.stop.clone();
    let converse = async |stream, master: &str| node.lock().await.converse(stream, master).await;
    let result = tokio::select! {
        biased;
        () = stopped(stop) => Ok(()),
        result = keep_connected(&options, std::future::pending, converse) => result,
    };
    result.map(|()| node.into_inner().report)
}

struct Node<F> {
    session: TileSession,
    clock: MasterClock,
    report: ProtocolReport,
    started: Instant,
    patience: Duration,
    observe: F,
}

impl<F: FnMut(Step<'_>)> Node<F> {
    async fn converse(&mut self, stream: Stream, master: &str) -> End {
        (self.observe)(Step::Connected(master));
        self.report.connections += 1;
        self.session.connected();
        let end = self.exchange(stream).await.unwrap_or_else(|end| end);
        self.report.uncertainty = self.clock.uncertainty();
        self.clock.forget();
        self.session.disconnected();
        end
    }

    async fn exchange(&mut self, stream: Stream) -> Result<End, End> {
        let Stream { reader, mut writer } = stream;
        let mut bodies = framed(reader, MAX_TO_TILE_BYTES);
        let mut buffer = Vec::new();
        let lost = |error: std::io::Error| End::Lost(describe(&error));
        let hello = Opening::Control(self.session.hello());
        write_message(&mut writer, &mut buffer, |out| hello.encode(out)).await.map_err(lost)?;
        let mut beat = tokio::time::interval(ALIVE_EVERY);
        let mut ask = tokio::time::interval(PING_EVERY);
        let mut heard = Instant::now();
        loop {
            tokio::select! {
                biased;
                _ = beat.tick() => {
                    let stats = ToMaster::Stats(self.session.stats());
                    write_message(&mut writer, &mut buffer, |out| stats.encode(out)).await.map_err(lost)?;
                }
                _ = ask.tick() => {
                    let ping = ToMaster::Ping(MasterClock::ping(self.started.elapsed()));
                    write_message(&mut writer, &mut buffer, |out| ping.encode(out)).await.map_err(lost)?;
                }
                body = timeout_at(heard + self.patience, bodies.next()) => {
                    heard = Instant::now();
                    let body = match body {
                        Ok(Some(body)) => body.map_err(lost)?,
                        Ok(None) => return Err(End::Lost("the master closed the connection".into())),
                        Err(_) => return Err(End::Lost(format!("the master was silent for {} s", self.patience.as_secs()))),
                    };
                    match ToTile::decode(&body) {
                        Ok(ToTile::Bye(bye)) => return Ok(End::Bye(bye)),
                        Ok(ToTile::Pong(pong)) => self.clock.take(&pong, self.started.elapsed()),
                        Ok(message) => {
                            if let ToTile::Frame(_) = message {
                                self.report.frame_bytes += body.len() as u64;
                            }
                            self.session.handle_message(message);
                        }
                        Err(error) => return Err(End::Lost(format!("the master sent what is no message: {error}"))),
                    }
                    self.act(&mut writer, &mut buffer).await?;
                }
            }
        }
    }

    /// Does what the session says.
    async fn act(&mut self, writer: &mut Writer, buffer: &mut Vec<u8>) -> Result<(), End> {
        while let Some(action) = self.session.poll_action() {
            match action {
                Action::Send(message) => {
                    let written = write_message(writer, buffer, |out| message.encode(out)).await;
                    written.map_err(|error| End::Lost(error.to_string()))?;
                }
                Action::Draw(frame) => {
                    self.report.applied += 1;
                    (self.observe)(Step::Applied(&frame));
                    let leaves = frame.views.iter().map(|view| view.leaves.len()).sum();
                    self.session.drawn(frame.number, DrawStats { leaves, ..DrawStats::default() });
                }
                Action::Show { frame } => {
                    self.report.shown += 1;
                    (self.observe)(Step::Shown(frame));
                    if let Some(at_us) = self.clock.master_us(self.started.elapsed()) {
                        self.session.note_shown(frame, at_us);
                    }
                }
                Action::Close { bye, by } => {
                    if by == EndedBy::Node {
                        self.report.left += 1;
                        (self.observe)(Step::Left(&bye));
                        let message = ToMaster::Bye(bye.clone());
                        let _ = write_message(writer, buffer, |out| message.encode(out)).await; // it ends either way
                    }
                    return Err(End::Lost(bye.to_string()));
                }
                // Of the scene, nothing is fetched, and nothing counted.
                Action::Count(..)
                | Action::Fetch(_)
                | Action::OpenScene(..)
                | Action::TakeTessellation(_)
                | Action::TakeHierarchy { .. }
                | Action::ForgetHierarchy(_)
                | Action::GrowScene(_) => {}
                Action::Upload { .. } | Action::Evict(_) | Action::SetTransform(_) => {}
            }
        }
        Ok(())
    }
}
