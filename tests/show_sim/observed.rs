//! What is seen of a show from outside, and what it is held against.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use mullion_client::protocol_node::Step;
use mullion_client::tile_session::FrameToDraw;
use mullion_server::master::MAX_WAITING;
use mullion_server::service::{FrameReport, NodeEvent, ShowOptions, ShowReport};
use mullion_server::swap_barrier::Standing;
use tokio::sync::watch;

use crate::BACK_WITHIN;
use crate::cast::{BUDGET_TRIANGLES, LEAVES, MASTERS, RATE_HZ, wall};
use crate::plan::{Blow, Plan, Strike};
use crate::session_support::visible;

/// How long messages of a fault may still be on their way when it is over.
const AFTERMATH: Duration = Duration::from_millis(100);
/// How old the newest picture of a node may be.
const FRESH: Duration = Duration::from_millis(100);
/// A timer of tokio's ends with the millisecond.
const TIMER: Duration = Duration::from_millis(1);

pub type Shared = Arc<Mutex<Observed>>;

/// One run of a master.
#[derive(Default)]
struct Reign {
    /// Where a standby took over.
    takes_over_at: Option<u64>,
    released: BTreeMap<u64, Duration>,
    /// Places that said that they are ready, by frame.
    acknowledged: BTreeMap<u64, BTreeSet<usize>>,
    /// As of the newest frame's release.
    standings: Vec<Standing>,
}

struct Connection {
    reign: usize,
    at: Duration,
    /// The newest frame shown, and when.
    shown: Option<(u64, Duration)>,
    first_shown: Option<Duration>,
    /// The place whose frames it gets.
    place: usize,
}

/// A node or a spare; its processes, one after the other.
#[derive(Default)]
struct Player {
    connection: Option<Connection>,
    /// The newest frame that any process of it showed, and under whom.
    shown: Option<(usize, u64)>,
    has_left: bool,
}

/// What is seen, and what was seen first that must not be.
pub struct Observed {
    pub seed: u64,
    pub stop: watch::Receiver<bool>,
    /// The first promise that was broken.
    pub broken: Option<String>,
    /// By host: whether its process is dead.
    pub is_dead: [bool; 2],
    plan: Plan,
    /// Connections that the master has, when it released the newest frame.
    open: usize,
    barrier_wait: Duration,
    reigns: Vec<Reign>,
    reign_of: [usize; 2],
    /// Who released the newest frame.
    ruling: Option<usize>,
    players: Vec<Player>,
    pub shows: u64,
    pub takeovers: u64,
    pub stand_ins: u64,
    pub passed_over: u64,
    pub refused: u64,
    /// The master that ran the show has ended it.
    has_ended: bool,
    /// Longest time from the strike on a master to the first frame that a node shows of the next one.
    pub longest_gap: Duration,
    /// When each place last showed a frame.
    lit: Vec<Option<Duration>>,
    /// Longest time between two frames that one place showed.
    pub longest_dark: Duration,
    pub trace: u64,
}

fn now() -> Duration {
    turmoil::sim_elapsed().expect("in a simulation")
}

impl Observed {
    pub fn new(plan: &Plan, stop: watch::Receiver<bool>) -> Self {
        let barrier_wait = ShowOptions::for_wall(&wall(plan.grid)).barrier_wait;
        let players = (0..plan.places() + plan.spares).map(|_| Player::default()).collect();
        Self {
            seed: plan.seed,
            stop,
            broken: None,
            is_dead: [false; 2],
            plan: plan.clone(),
            open: 0,
            barrier_wait,
            reigns: Vec::new(),
            reign_of: [0; 2],
            ruling: None,
            players,
            shows: 0,
            takeovers: 0,
            stand_ins: 0,
            passed_over: 0,
            refused: 0,
            has_ended: false,
            longest_gap: Duration::ZERO,
            lit: vec![None; plan.places()],
            longest_dark: Duration::ZERO,
            trace: 0,
        }
    }

    /// The host of the master that runs the show.
    pub fn ruling_host(&self) -> usize {
        let ruling = self.ruling.expect("a show that has begun");
        (0..2).find(|host| self.reign_of[*host] == ruling).expect("a master's host")
    }

    /// How long after `until` a node has a connection again at the latest.
    pub fn back_after(plan: &Plan, player: usize) -> Duration {
        let touches = |blow: Blow| blow.is_silent() && blow.node().is_none_or(|node| node == player);
        let silence = match plan.strikes.iter().any(|strike| touches(strike.blow)) {
            true if plan.has_standby => Duration::from_secs(3), // a node's patience with the first of several masters; a name's, too
            true => Duration::from_secs(10),                    // with the only one
            false => Duration::ZERO,
        };
        let pause = Duration::from_secs(1); // the longest between two attempts
        silence + pause + Duration::from_millis(200)
    }

    fn note(&mut self, what: u64) {
        self.trace = self.trace.wrapping_mul(31).wrapping_add(what ^ now().as_nanos() as u64);
    }

    fn hold(&mut self, is_kept: bool, promise: impl FnOnce() -> String) {
        if !is_kept && self.broken.is_none() {
            self.broken = Some(format!("{:?}: {}", now(), promise()));
        }
    }

    /// A master's process has started.
    pub fn begin_reign(&mut self, host: usize) -> usize {
        self.reigns.push(Reign::default());
        self.is_dead[host] = false;
        self.reign_of[host] = self.reigns.len() - 1;
        self.reign_of[host]
    }

    /// The show has ended for a master.
    pub fn ended(&mut self, host: usize, report: &ShowReport) -> turmoil::Result {
        let is_over = *self.stop.borrow();
        self.hold(is_over, || format!("{} ended the show: {report:?}", MASTERS[host]));
        self.refused += report.refused;
        self.has_ended |= report.frames > 0;
        Ok(())
    }

    /// A process of a player has started: what it showed before nobody knows.
    pub fn starts(&mut self, player: usize) {
        self.players[player] = Player::default();
    }

    /// A player has been told that the show is over.
    pub fn leaves(&mut self, player: usize) {
        let is_over = *self.stop.borrow();
        self.hold(is_over, || format!("player {player} left the show"));
        self.players[player].has_left = true;
    }

    pub fn have_all_left(&self) -> bool {
        self.has_ended && self.honest().all(|player| self.players[player].has_left)
    }

    fn honest(&self) -> impl Iterator<Item = usize> + use<> {
        (0..self.plan.honest()).chain(self.plan.places()..self.plan.places() + self.plan.spares)
    }

    pub fn step(&mut self, player: usize, step: &Step<'_>) {
        self.note((player as u64) << 48);
        match step {
            Step::Connected(master) => {
                let host = MASTERS.iter().position(|host| master.starts_with(host)).expect("a master");
                let reign = self.reign_of[host];
                self.players[player].connection =
                    Some(Connection { reign, at: now(), shown: None, first_shown: None, place: player });
            }
            Step::Applied(frame) => self.applied(player, frame),
            Step::Shown(number) => self.shown(player, *number),
            Step::Left(bye) => self.hold(false, || format!("player {player} leaves: {bye}")),
        }
    }

    fn applied(&mut self, player: usize, frame: &FrameToDraw) {
        let (number, view) = (frame.number, usize::from(frame.views[0].view.0));
        self.note(number << 8 | 1);
        let is_its_own = view == player || player >= self.plan.places();
        self.hold(is_its_own, || format!("player {player} is to draw view {view}"));
        let is_the_masters = frame.views[0].leaves == visible(self.seed, number, view, LEAVES);
        self.hold(is_the_masters, || format!("player {player}, frame {number}: another set than the master's"));
        self.hold(frame.dropped.is_empty(), || {
            format!("player {player}, frame {number}: nobody counted, and something is dropped")
        });
        let order = frame.estimate.zip(frame.primary.as_ref());
        let order = order.map(|(order, primary)| (order.triangles, order.is_complete, primary.planes.len()));
        self.hold(order == Some((BUDGET_TRIANGLES, false, 5)), || format!("player {player}, frame {number}: to {order:?}"));
        let is_in_time = (frame.scene_time_s - number as f64 / RATE_HZ).abs() < 1e-9;
        self.hold(is_in_time, || format!("player {player}, frame {number}: scene time {}", frame.scene_time_s));
        let connection = self.players[player].connection.as_mut().expect("it is connected");
        connection.place = view;
        self.reigns[connection.reign].acknowledged.entry(number).or_default().insert(view);
    }

    fn shown(&mut self, player: usize, number: u64) {
        self.note(number << 8 | 2);
        self.shows += 1;
        let connection = self.players[player].connection.as_mut().expect("it is connected");
        let reign = connection.reign;
        let before = connection.shown.replace((number, now()));
        let is_first = before.is_none();
        connection.first_shown.get_or_insert(now());
        let lit = self.lit[connection.place].replace(now());
        self.longest_dark = self.longest_dark.max(lit.map_or(Duration::ZERO, |lit| now() - lit));
        let shown = self.players[player].shown.replace((reign, number));
        let is_released = self.reigns[reign].released.contains_key(&number);
        self.hold(is_released, || format!("player {player} shows frame {number}, which was not released"));
        if let Some((before, at)) = before {
            let is_next = number == before + 1 || (number > before && self.is_excused(player, at));
            self.hold(is_next, || format!("player {player} shows frame {number} after {before}"));
        }
        if let Some((last_reign, last)) = shown {
            let goes_on = reign == last_reign || self.reigns[reign].takes_over_at.is_some();
            let is_newer = number > last || (reign == last_reign && is_first && number == last);
            self.hold(!goes_on || is_newer, || format!("player {player} goes back from frame {last} to {number}"));
            if reign != last_reign {
                self.longest_gap = self.longest_gap.max(now() - self.master_struck_at());
            }
        }
    }

    /// When the last fault of a master began.
    fn master_struck_at(&self) -> Duration {
        let of_masters = self.plan.strikes.iter().filter(|strike| strike.blow.node().is_none());
        of_masters.map(|strike| strike.from).filter(|from| *from <= now()).max().unwrap_or_default()
    }

    /// Whether a fault of its own is why a player, since a moment, did not do as the others.
    fn is_excused(&self, player: usize, since: Duration) -> bool {
        let is_hostile = (self.plan.honest()..self.plan.places()).contains(&player);
        let is_why =
            |strike: &Strike| strike.blow.node() == Some(player) && strike.from <= now() && since <= strike.until + AFTERMATH;
        is_hostile || self.plan.strikes.iter().any(is_why)
    }

    pub fn node_event(&mut self, reign: usize, event: &NodeEvent) {
        match event {
            NodeEvent::TookOver { frame, reason, .. } => {
                self.note(*frame << 8 | 3);
                self.takeovers += 1;
                self.reigns[reign].takes_over_at = Some(*frame);
                let host = (0..2).find(|host| self.reign_of[*host] == reign).expect("a master's host");
                let is_gone = self.is_dead[1 - host] || self.ruling != Some(self.reign_of[1 - host]);
                self.hold(is_gone, || format!("{} takes over from one that lives: {reason}", MASTERS[host]));
            }
            NodeEvent::StoodIn { .. } => self.stand_ins += 1,
            NodeEvent::Joined { .. } | NodeEvent::Left { .. } | NodeEvent::StandingBy { .. } => self.note(4),
            NodeEvent::SteppedBack { reason, .. } => self.hold(false, || format!("a master steps back: {reason}")),
        }
    }

    pub fn released(&mut self, reign: usize, frame: &FrameReport) {
        let number = frame.number;
        self.note(number << 8 | 5);
        self.check_order(reign, number);
        self.check_waits(reign, frame);
        self.passed_over += frame.passed_over.len() as u64;
        for place in frame.passed_over.iter().map(|node| usize::from(node.0)) {
            let is_excused = self.is_excused(place, now());
            self.hold(is_excused, || format!("place {place}, to which nothing happened, is passed over at frame {number}"));
        }
        // Those that were waited for: live when the frame before was released, and now.
        let before = std::mem::replace(&mut self.reigns[reign].standings, frame.standings.clone());
        let acknowledged = self.reigns[reign].acknowledged.get(&number);
        let is_live = |place: &usize| [&before, &frame.standings].iter().all(|s| s.get(*place) == Some(&Standing::Live));
        let is_late = |place: &usize| acknowledged.is_none_or(|places| !places.contains(place));
        let late = (0..self.plan.honest()).filter(is_live).find(is_late);
        self.hold(late.is_none(), || format!("frame {number} is released, and place {late:?} is live and has not drawn it"));
        self.reigns[reign].released.insert(number, now());
        self.ruling = Some(reign);
        let waiting = frame.longest_queue as usize;
        self.hold(waiting <= MAX_WAITING, || format!("{waiting} messages wait for one peer"));
        self.open = frame.open as usize;
    }

    fn check_order(&mut self, reign: usize, number: u64) {
        let is_only_one = self.ruling.is_none_or(|ruling| ruling <= reign);
        self.hold(is_only_one, || "two masters run the show".into());
        let this = &self.reigns[reign];
        let newest_before = self.ruling.and_then(|ruling| self.reigns[ruling].released.keys().next_back());
        let (expected, newest_before) = (this.released.keys().next_back().map(|newest| newest + 1), newest_before.copied());
        let first = this.takes_over_at.unwrap_or(0);
        let is_next = number == expected.unwrap_or(first);
        self.hold(is_next, || format!("frame {number} is released; {expected:?} was next, or {first}"));
        if expected.is_none() && first > 0 {
            let goes_on = newest_before.is_none_or(|newest| number > newest);
            self.hold(goes_on, || format!("after a takeover frame {number} follows on {newest_before:?}"));
        }
    }

    fn check_waits(&mut self, reign: usize, frame: &FrameReport) {
        let longest = self.barrier_wait + TIMER + self.plan.tick();
        self.hold(frame.waited <= longest, || format!("frame {} waited for {:?}", frame.number, frame.waited));
        let period = Duration::from_secs_f64(1.0 / RATE_HZ) + TIMER;
        if let Some((_, before)) = self.reigns[reign].released.last_key_value() {
            let took = now() - *before;
            self.hold(took <= period + longest, || format!("frame {} came {took:?} after the one before", frame.number));
        }
    }

    /// When all is over: every node shows the newest frames, and has since a second after it could.
    pub fn finish(&mut self, end: Duration) -> Result<(), String> {
        let ruling = self.ruling.ok_or("no frame was released")?;
        let calm = self.plan.calm_from();
        for player in 0..self.plan.honest() {
            let connection =
                self.players[player].connection.as_ref().ok_or_else(|| format!("player {player} never connected"))?;
            let Connection { reign, at, shown, first_shown, .. } = connection;
            let latest = calm + Self::back_after(&self.plan, player);
            if *reign != ruling || *at > latest {
                return Err(format!(
                    "player {player} connected at {at:?} to reign {reign}; {latest:?} and {ruling} were promised"
                ));
            }
            let latest = calm.max(*at) + BACK_WITHIN;
            if first_shown.is_none_or(|first| first > latest) {
                return Err(format!("player {player} shows nothing till {first_shown:?}; {latest:?} was promised"));
            }
            if shown.is_none_or(|(_, at)| at + FRESH < end) {
                return Err(format!("player {player} shows {shown:?} at {end:?}"));
            }
        }
        // What is written to one who vanished is waited for, 10 s each.
        let stale = self.plan.strikes.iter().filter(|strike| strike.blow.is_silent()).count();
        let most = self.honest().count() + usize::from(self.plan.has_standby) + stale;
        if self.open > most {
            return Err(format!("{} connections are open; {most} have a reason", self.open));
        }
        Ok(())
    }
}
