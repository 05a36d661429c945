//! A master that took another's place asks whether that one drives the wall after all: one of the two is to stand by.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use futures_util::StreamExt;
use mullion_common::wire::{Bye, ByeCode, MAX_TO_TILE_BYTES, Opening, RivalHello, StandbyHello, ToStandby};
use tokio::time::{sleep, timeout};

use super::connection::{Event, framed};
use super::network::{Connector, Socket};
use super::standby::{drives, write};
use super::transport::{Security, connect};
use super::{NodeEvent, Service};
use crate::master::PeerId;

/// How often the other master is asked.
const ASK_EVERY: Duration = Duration::from_millis(750);
/// By how much that varies, so that two who ask each other do not step back at once.
const VARIES_BY: Duration = Duration::from_millis(500);
/// How long it may take to answer.
const ANSWER_LIMIT: Duration = Duration::from_secs(1);

/// Asks the master whose place this one took again and again. Returns that one and the reason once this one is to step back. `random` are
/// the bytes by which the pauses vary.
pub(super) async fn watch(
    other: Option<String>,
    network: (&Connector, &Security),
    (show, live_nodes, port): (StandbyHello, &AtomicU32, u16),
    random: [u8; 32],
) -> (String, String) {
    let Some(other) = other else { return std::future::pending().await };
    for byte in random.iter().cycle() {
        let share = 4 * u32::from(*byte);
        sleep(ASK_EVERY + VARIES_BY * share / 1024).await;
        let hello = RivalHello { show, live_nodes: live_nodes.load(Ordering::Relaxed), port };
        match timeout(ANSWER_LIMIT, ask(&other, network, hello)).await {
            Ok(Some(bye)) if bye.code == ByeCode::OtherMaster => return (other, bye.reason),
            Ok(Some(bye)) => tracing::debug!("{other}: {bye}"),
            Ok(None) | Err(_) => {} // it is gone, or stands by
        }
    }
    std::future::pending().await
}

async fn ask(other: &str, network: (&Connector, &Security), hello: RivalHello) -> Option<Bye> {
    let Socket { reader, mut writer } = connect(other, network).await.ok()?;
    let hello = Opening::Rival(hello);
    write(&mut writer, &mut Vec::new(), |out| hello.encode(out)).await.ok()?;
    match ToStandby::decode(&framed(reader, MAX_TO_TILE_BYTES).next().await?.ok()?).ok()? {
        ToStandby::Bye(bye) => Some(bye),
        ToStandby::Insertions(_) | ToStandby::Course(_) | ToStandby::Alive => None,
    }
}

impl Service {
    /// Whether this master may stand by for another one: not while nodes prepare for what they are to see next.
    pub(super) fn may_step_back(&self) -> bool {
        self.stands_by_for.is_none() && self.offered.is_none()
    }

    /// Sends all to another master, and is to stand by for it.
    pub(super) fn step_back(&mut self, master: String, reason: String) {
        if !self.is_finished {
            (self.show.node_observer)(&NodeEvent::SteppedBack { master: master.clone(), reason });
            self.show.options.succession.stand_by(); // what is sent from now on is for another one
            self.stands_by_for = Some(master);
            self.master.handle_shutdown(&Bye::new(ByeCode::OtherMaster, "another master drives the wall"));
        }
    }

    /// Asks a master that says that it has more live nodes whether it drives the show: what it says alone ends no show.
    pub(super) fn ask_rival(&mut self, peer: PeerId, port: u16) {
        let Some(link) = self.links.get(&peer).filter(|_| !self.is_asking) else { return };
        self.is_asking = true;
        let master = SocketAddr::new(link.address.ip(), port).to_string();
        let (connector, security) = (self.show.options.connector.clone(), self.show.options.security.clone());
        let (events, identity) = (self.events.clone(), self.identity);
        self.tasks.spawn(async move {
            let drives = drives(&master, (&connector, &security), &identity).await;
            let _ = events.send(Event::Rival { drives: drives.then_some(master) }).await; // the loop is gone: nobody to tell
        });
    }
}
