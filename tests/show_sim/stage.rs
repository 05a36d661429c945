//! A show from its beginning to its end, with all that its plan has in store.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use mullion_common::wire::Part;
use tokio::sync::watch;
use turmoil::Sim;

use crate::cast::{self, MASTERS, Order, wall};
use crate::observed::{Observed, Shared};
use crate::plan::{Blow, Plan, Strike};
use crate::{BACK_WITHIN, villains};

/// A message's way. There and back, and a tick for each, is within the barrier's wait.
const QUICKEST: Duration = Duration::from_millis(1);
const SLOWEST: Duration = Duration::from_millis(5);
/// Segments that a connection takes before its reader takes any.
const SEGMENTS: usize = 128;
/// How long the show takes to be over for all.
const LAST_WORDS: Duration = Duration::from_secs(3);

/// What happened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    pub shows: u64,
    pub takeovers: u64,
    pub stand_ins: u64,
    pub passed_over: u64,
    pub refused: u64,
    /// Longest time from the strike on a master to the first frame that a node shows of the next one.
    pub longest_gap: Duration,
    /// Longest time between two frames that one place showed.
    pub longest_dark: Duration,
    pub trace: u64,
}

impl Outcome {
    pub fn add(&mut self, other: &Self) {
        self.shows += other.shows;
        self.takeovers += other.takeovers;
        self.stand_ins += other.stand_ins;
        self.passed_over += other.passed_over;
        self.refused += other.refused;
        self.longest_gap = self.longest_gap.max(other.longest_gap);
        self.longest_dark = self.longest_dark.max(other.longest_dark);
        self.trace ^= other.trace;
    }
}

struct Stage<'a> {
    sim: Sim<'a>,
    plan: &'a Plan,
    /// Of the nodes by their places; spares have others.
    names: Vec<String>,
    orders: [watch::Sender<Order>; 2],
    /// Which master a strike hit.
    hit: Vec<usize>,
    observed: Shared,
}

/// Plays the plan, and holds the show to its promises.
pub fn play(plan: &Plan) -> Result<Outcome, String> {
    let (stop, stopped) = watch::channel(false);
    let observed = Arc::new(Mutex::new(Observed::new(plan, stopped)));
    let mut stage = Stage::set(plan, Arc::clone(&observed));
    let mut turns: Vec<(Duration, usize, bool)> = Vec::new();
    for (strike, Strike { from, until, .. }) in plan.strikes.iter().enumerate() {
        turns.extend([(*from, strike, true), (*until, strike, false)]);
    }
    turns.sort();
    for (at, strike, is_beginning) in turns {
        stage.run_until(at)?;
        if is_beginning { stage.strike(strike) } else { stage.mend(strike) }
    }
    let back_after = (0..plan.honest()).map(|player| Observed::back_after(plan, player)).max().unwrap_or_default();
    let end = plan.calm_from() + back_after + BACK_WITHIN + Duration::from_millis(100);
    stage.run_until(end)?;
    stage.observed().finish(stage.sim.elapsed())?;
    stop.send_replace(true);
    while !stage.observed().have_all_left() {
        if stage.sim.elapsed() > end + LAST_WORDS {
            return Err(format!("not all have left {LAST_WORDS:?} after the show's end"));
        }
        stage.step()?;
    }
    let seen = stage.observed();
    Ok(Outcome {
        shows: seen.shows,
        takeovers: seen.takeovers,
        stand_ins: seen.stand_ins,
        passed_over: seen.passed_over,
        refused: seen.refused,
        longest_gap: seen.longest_gap,
        longest_dark: seen.longest_dark,
        trace: seen.trace,
    })
}

impl<'a> Stage<'a> {
    fn set(plan: &'a Plan, observed: Shared) -> Self {
        let mut sim = turmoil::Builder::new()
            .rng_seed(plan.seed)
            .tick_duration(plan.tick())
            .simulation_duration(Duration::from_secs(60))
            .min_message_latency(QUICKEST)
            .max_message_latency(SLOWEST)
            .tcp_capacity(SEGMENTS)
            .build();
        let wall = wall(plan.grid);
        let masters = 1 + usize::from(plan.has_standby);
        let orders = [Order::Begin, if plan.has_standby { Order::StandBy } else { Order::Nothing }];
        let orders = orders.map(watch::Sender::new);
        for (host, orders) in orders.iter().enumerate().take(masters) {
            let (wall, orders, observed) = (Arc::clone(&wall), orders.clone(), Arc::clone(&observed));
            let master = move || cast::master(host, Arc::clone(&wall), orders.subscribe(), Arc::clone(&observed));
            sim.host(MASTERS[host], master);
        }
        let mut names: Vec<String> = wall.nodes().iter().map(|node| node.name.clone()).collect();
        names.extend((0..plan.spares).map(|spare| format!("spare{spare}")));
        for (player, name) in names.iter().enumerate() {
            if (plan.honest()..plan.places()).contains(&player) {
                villains::take_place(&mut sim, plan, name, masters);
                continue;
            }
            let part = if player < plan.places() { Part::Own } else { Part::Spare };
            let (node, observed) = (name.clone(), Arc::clone(&observed));
            sim.host(name.as_str(), move || cast::node(player, node.clone(), part, masters, Arc::clone(&observed)));
        }
        for stranger in 0..plan.strangers {
            villains::come_by(&mut sim, plan, stranger, &names[..plan.honest()], masters);
        }
        let hit = vec![0; plan.strikes.len()];
        Self { sim, plan, names, orders, hit, observed }
    }

    fn observed(&self) -> std::sync::MutexGuard<'_, Observed> {
        self.observed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn run_until(&mut self, at: Duration) -> Result<(), String> {
        while self.sim.elapsed() < at {
            self.step()?;
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), String> {
        let result = self.sim.step();
        match self.observed().broken.take() {
            Some(broken) => Err(broken),
            None => result.map(drop).map_err(|error| error.to_string()),
        }
    }

    /// The hosts of masters that there are.
    fn masters(&self) -> &'static [&'static str] {
        &MASTERS[..1 + usize::from(self.plan.has_standby)]
    }

    /// All other hosts than a master's.
    fn others(&self, master: usize) -> Vec<String> {
        let strangers = (0..self.plan.strangers).map(villains::name);
        let masters = self.masters().iter().filter(|host| **host != MASTERS[master]).map(ToString::to_string);
        self.names.iter().cloned().chain(strangers).chain(masters).collect()
    }

    fn strike(&mut self, strike: usize) {
        let name = |node: usize| self.names[node].as_str();
        match self.plan.strikes[strike].blow {
            Blow::Crash(node) => self.sim.crash(name(node)),
            Blow::Hold(node) => self.masters().iter().for_each(|master| self.sim.hold(name(node), *master)),
            Blow::Partition(node) => self.masters().iter().for_each(|master| self.sim.partition(name(node), *master)),
            Blow::Vanish(node) => {
                self.masters().iter().for_each(|master| self.sim.partition(name(node), *master));
                self.sim.crash(name(node));
            }
            Blow::Delay(node, delay) => {
                self.masters().iter().for_each(|master| self.sim.set_link_latency(name(node), *master, delay))
            }
            Blow::HoldStandby => self.sim.hold(MASTERS[0], MASTERS[1]),
            Blow::MasterDies | Blow::MasterVanishes => {
                let host = self.observed().ruling_host();
                self.hit[strike] = host;
                self.observed().is_dead[host] = true;
                if self.plan.strikes[strike].blow == Blow::MasterVanishes {
                    self.others(host).iter().for_each(|other| self.sim.partition(other.as_str(), MASTERS[host]));
                }
                self.orders[host].send_replace(Order::Nothing);
            }
        }
    }

    fn mend(&mut self, strike: usize) {
        let name = |node: usize| self.names[node].as_str();
        match self.plan.strikes[strike].blow {
            Blow::Crash(node) => self.sim.bounce(name(node)),
            Blow::Hold(node) => self.masters().iter().for_each(|master| self.sim.release(name(node), *master)),
            Blow::Partition(node) => self.masters().iter().for_each(|master| self.sim.repair(name(node), *master)),
            Blow::Vanish(node) => {
                self.masters().iter().for_each(|master| self.sim.repair(name(node), *master));
                self.sim.bounce(name(node));
            }
            Blow::Delay(node, _) => {
                self.masters().iter().for_each(|master| self.sim.set_link_latency(name(node), *master, SLOWEST - QUICKEST));
            }
            Blow::HoldStandby => self.sim.release(MASTERS[0], MASTERS[1]),
            Blow::MasterDies | Blow::MasterVanishes => {
                let host = self.hit[strike];
                if self.plan.strikes[strike].blow == Blow::MasterVanishes {
                    self.others(host).iter().for_each(|other| self.sim.repair(other.as_str(), MASTERS[host]));
                }
                let order = if self.plan.has_standby { Order::StandBy } else { Order::Begin };
                self.orders[host].send_replace(order);
            }
        }
    }
}
