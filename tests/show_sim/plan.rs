//! What happens in a show: drawn from its seed, before it begins.

use std::time::Duration;

use crate::session_support::random::Random;

/// When faults may begin: by then all nodes show frames, and a standby follows.
const FIRST_STRIKE: Duration = Duration::from_millis(600);
/// When all faults are over at the latest.
pub const LAST_STRIKE: Duration = Duration::from_millis(3000);
/// Between two faults of one node, at least.
const APART: Duration = Duration::from_millis(150);

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// A fault of one host and its links.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blow {
    /// A node's process dies.
    Crash(usize),
    /// What a node and the masters say to each other is held back.
    Hold(usize),
    /// What they say to each other is lost, and with it their connections, though neither is told.
    Partition(usize),
    /// A node's machine is gone, and says no word.
    Vanish(usize),
    /// What they say to each other takes so long.
    Delay(usize, Duration),
    /// The process of the master that runs the show dies.
    MasterDies,
    /// Its machine is gone, and says no word.
    MasterVanishes,
    /// What master and standby say to each other is held back.
    HoldStandby,
}

impl Blow {
    /// Whom it hits, if that is a node.
    pub fn node(self) -> Option<usize> {
        match self {
            Self::Crash(node) | Self::Hold(node) | Self::Partition(node) | Self::Vanish(node) | Self::Delay(node, _) => {
                Some(node)
            }
            Self::MasterDies | Self::MasterVanishes | Self::HoldStandby => None,
        }
    }

    /// Whether connections break that neither side knows are broken.
    pub fn is_silent(self) -> bool {
        matches!(self, Self::Partition(_) | Self::Vanish(_) | Self::MasterVanishes)
    }
}

/// A fault, from when to when.
#[derive(Clone, Copy, Debug)]
pub struct Strike {
    pub blow: Blow,
    pub from: Duration,
    pub until: Duration,
}

impl Strike {
    fn overlaps(&self, other: &Self) -> bool {
        self.from < other.until + APART && other.from < self.until + APART
    }
}

/// A whole show.
#[derive(Clone, Debug)]
pub struct Plan {
    pub seed: u64,
    /// Columns and rows of the wall.
    pub grid: [u32; 2],
    pub has_standby: bool,
    pub spares: usize,
    /// Whether the wall's last place is held by one who means harm.
    pub is_last_hostile: bool,
    /// Those who have no place and mean harm.
    pub strangers: usize,
    pub strikes: Vec<Strike>,
}

impl Plan {
    /// Every second show has a standby, one in three each has one or two spares, one in three is quiet but for peers that mean harm.
    pub fn of(seed: u64, grid: [u32; 2]) -> Self {
        let mut rng = Random(seed ^ 0x51e0);
        let nodes = (grid[0] * grid[1]) as usize;
        let has_standby = seed % 2 == 1;
        let mut plan = Self {
            seed,
            grid,
            has_standby,
            spares: (seed / 2 % 3) as usize,
            is_last_hostile: rng.chance(2),
            strangers: rng.within(0, 3) as usize,
            strikes: Vec::new(),
        };
        if seed % 3 == 2 {
            (plan.is_last_hostile, plan.strangers) = (true, plan.strangers + 1);
            return plan;
        }
        plan.strike_masters(&mut rng);
        for _ in 0..rng.within(2, 3 + nodes as u64 / 2) {
            plan.strike_node(rng.within(0, plan.honest() as u64) as usize, &mut rng);
        }
        plan.strikes.sort_by_key(|strike| strike.from);
        plan
    }

    /// A second's peace, then faults that follow one on the other, each with how long it takes.
    pub fn with(seed: u64, grid: [u32; 2], blows: &[(Blow, Duration)]) -> Self {
        let mut from = ms(1000);
        let strike = |(blow, takes): &(Blow, Duration)| {
            let strike = Strike { blow: *blow, from, until: from + *takes };
            from = strike.until;
            strike
        };
        let strikes = blows.iter().map(strike).collect();
        Self { seed, grid, has_standby: true, spares: 1, is_last_hostile: false, strangers: 0, strikes }
    }

    /// A step of the simulation: hosts run so long one after the other. A step of a large wall takes long.
    pub fn tick(&self) -> Duration {
        if self.places() <= 16 { ms(2) } else { ms(4) }
    }

    /// Places of the wall.
    pub fn places(&self) -> usize {
        (self.grid[0] * self.grid[1]) as usize
    }

    /// Places whose node means no harm: the first so many.
    pub fn honest(&self) -> usize {
        self.places() - usize::from(self.is_last_hostile)
    }

    /// The last moment at which something is done to the show.
    pub fn calm_from(&self) -> Duration {
        let strikes = self.strikes.iter().map(|strike| strike.until).max().unwrap_or_default();
        if self.is_last_hostile || self.strangers > 0 { strikes.max(LAST_STRIKE) } else { strikes }
    }

    fn strike_masters(&mut self, rng: &mut Random) {
        let mut at = FIRST_STRIKE + ms(rng.within(0, 500));
        while at < ms(2200) {
            let blow = match rng.within(0, 6) {
                0 | 1 => Blow::MasterDies,
                2 => Blow::MasterVanishes,
                3 if self.has_standby => Blow::HoldStandby,
                4 if self.has_standby => {
                    // The standby lags behind when the master goes, and never hears the last that was said.
                    let until = at + ms(rng.within(100, 600));
                    self.strikes.push(Strike { blow: Blow::HoldStandby, from: at, until });
                    at = until;
                    Blow::MasterVanishes
                }
                _ => return,
            };
            let longest = match blow {
                Blow::MasterVanishes => 1500, // the standby waits for a second
                Blow::HoldStandby => 800,     // and less than that must not make it a master
                _ => 700,
            };
            let shortest = if blow == Blow::MasterVanishes { 1400 } else { 50 };
            let until = at + ms(rng.within(shortest, longest));
            if until > LAST_STRIKE {
                return;
            }
            self.strikes.push(Strike { blow, from: at, until });
            at = until + ms(rng.within(700, 1200));
        }
    }

    fn strike_node(&mut self, node: usize, rng: &mut Random) {
        let from = FIRST_STRIKE + ms(rng.within(0, 1900));
        let (blow, longest) = match rng.within(0, 6) {
            0 | 1 => (Blow::Crash(node), if self.spares > 0 { 1800 } else { 900 }),
            2 => (Blow::Hold(node), 1500),
            3 => (Blow::Partition(node), 800),
            4 => (Blow::Vanish(node), 1500),
            _ => (Blow::Delay(node, ms(rng.within(6, 40))), 600),
        };
        let until = (from + ms(rng.within(100, longest))).min(LAST_STRIKE);
        let strike = Strike { blow, from, until };
        // Links have one state each: what holds them and what cuts them must not meet.
        let meets =
            |other: &Strike| other.overlaps(&strike) && (other.blow.node() == Some(node) || other.blow == Blow::MasterVanishes);
        if until > from + ms(50) && !self.strikes.iter().any(meets) {
            self.strikes.push(strike);
        }
    }
}
