//! What a load test measures: for every frame when it was due, what the master spent on it, and when each tile showed it.

pub mod clients;
pub mod faults;
pub mod hostile;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use mullion_common::wall::MAX_TILES;
use mullion_common::wire::Shown;
use mullion_server::service::FrameReport;
use mullion_server::swap_barrier::NodeIndex;
use serde::Serialize;

use crate::say::say;
use crate::show::Spread;
use faults::{Happened, What};

/// A frame, as it went.
#[derive(Clone, Copy, Debug)]
struct Row {
    due_us: u64,
    /// Cull, diff, encode, send.
    master_us: [f64; 4],
    /// The nodes that showed it, a bit each; when the first and the last of them did, microseconds.
    shown_by: NodeBits,
    first_us: u64,
    last_us: u64,
    passed_over: u32,
}

/// A bit for each node of the largest wall: every node has a tile.
type NodeBits = [u64; MAX_TILES as usize / 64];

impl Row {
    fn shown(&self) -> u32 {
        self.shown_by.iter().map(|bits| bits.count_ones()).sum()
    }
}

/// Takes down what happens while a show runs.
#[derive(Clone)]
pub struct Tally(Arc<Mutex<Data>>);

struct Data {
    /// Nodes that count.
    nodes: u32,
    rows: Vec<Row>,
    /// When each frame was released.
    released: Vec<Instant>,
    /// When it was heard of each node that it had shown a frame: a frame later than it had.
    shows: Vec<Vec<Instant>>,
    /// Shows that were told before their frame's report.
    early: Vec<(u32, Shown)>,
    /// When each node showed its newest picture, microseconds.
    newest_us: Vec<Option<u64>>,
    /// A frame, and for how long a node had shown the picture before it, microseconds.
    held: Vec<(u32, u32)>,
    /// Memory that the process held at times, but for what is taken down here, bytes.
    memory: Vec<u64>,
    /// Of each frame and connected node.
    frame_bytes: Vec<u32>,
    /// Leaves in all sets.
    leaves: u64,
}

impl Tally {
    /// For a wall of so many nodes, of which the first `good` must show what they are told, and so many frames: memory is set aside for all
    /// of them, so that what it takes is known at any time.
    pub fn new(nodes: u32, good: u32, frames: u64) -> Self {
        let (frames, of_nodes) = (frames as usize, frames as usize * nodes as usize);
        Self(Arc::new(Mutex::new(Data {
            nodes: good,
            rows: Vec::with_capacity(frames),
            released: Vec::with_capacity(frames),
            shows: (0..nodes).map(|_| Vec::with_capacity(frames)).collect(),
            early: Vec::new(),
            newest_us: vec![None; nodes as usize],
            held: Vec::with_capacity(of_nodes),
            memory: Vec::new(),
            frame_bytes: Vec::with_capacity(of_nodes),
            leaves: 0,
        })))
    }

    /// Takes down how much memory the process holds.
    pub fn note_memory(&self) {
        let mut data = self.lock();
        let own = data.bytes();
        data.memory.push(status_bytes("VmRSS:").saturating_sub(own));
    }

    /// Memory held at each [`Self::note_memory`], bytes.
    pub fn memory(&self) -> Vec<u64> {
        self.lock().memory.clone()
    }

    /// Takes down how many leaves the sets of a frame hold.
    pub fn note_leaves(&self, leaves: u64) {
        self.lock().leaves += leaves;
    }

    /// Takes down a frame that was released; they come in order.
    pub fn note_frame(&self, frame: &FrameReport) {
        let mut data = self.lock();
        data.released.push(Instant::now());
        let us = |time: Duration| time.as_secs_f64() * 1e6;
        let master_us = [us(frame.cull), us(frame.diff), us(frame.encode), us(frame.send)];
        let passed_over = frame.passed_over.iter().filter(|node| u32::from(node.0) < data.nodes).count() as u32;
        let due_us = frame.due.as_micros() as u64;
        let shown_by = NodeBits::default();
        data.rows.push(Row { due_us, master_us, shown_by, first_us: u64::MAX, last_us: 0, passed_over });
        data.frame_bytes.extend(frame.frame_bytes.iter().filter(|bytes| **bytes > 0));
        for (node, shown) in std::mem::take(&mut data.early) {
            data.note(node, &shown);
        }
    }

    /// Takes down that a node showed a frame.
    pub fn note_shown(&self, node: NodeIndex, shown: &Shown) {
        let mut data = self.lock();
        if u32::from(node.0) >= data.nodes {
            return; // who knows what it says
        }
        data.shows[usize::from(node.0)].push(Instant::now());
        data.note(u32::from(node.0), shown);
    }

    /// How the wall bore what happened.
    pub fn bearing(&self, happened: &[Happened]) -> Bearing {
        let data = self.lock();
        let ms = |from: Instant, to: Instant| (to - from).as_secs_f64() * 1e3;
        let first_from = |times: &[Instant], from: Instant| times.get(times.partition_point(|at| *at < from)).copied();
        let next = happened.iter().filter_map(|h| Some(ms(h.struck, first_from(&data.released, h.struck)?)));
        let back_of = |h: &Happened| {
            let of_nodes = h.nodes.clone().map(|node| Some(ms(h.mended, first_from(&data.shows[node], h.mended)?)));
            of_nodes.reduce(|a, b| Some(a?.max(b?))).flatten()
        };
        let back: Vec<Option<f64>> = happened.iter().map(back_of).collect();
        let gaps = data.released.windows(2).map(|pair| ms(pair[0], pair[1]));
        Bearing {
            kills: happened.iter().filter(|h| h.fault.what == What::Kill).count() as u64,
            hangs: happened.iter().filter(|h| h.fault.what == What::Hang).count() as u64,
            next_frame_ms: Spread::of(next),
            back_ms: Spread::of(back.iter().flatten().copied()),
            never_back: back.iter().filter(|back| back.is_none()).count() as u64,
            longest_gap_ms: gaps.fold(0.0, f64::max),
        }
    }

    /// What it comes to, for a show of so many frames a second. The frames before `from` do not count.
    pub fn verdict(&self, hz: f64, from: usize) -> Verdict {
        let data = self.lock();
        let period_us = (1e6 / hz) as u64;
        // Of the last frame, no node has a later one to tell of it with.
        let counted = data.rows.get(from..data.rows.len().saturating_sub(1)).unwrap_or_default();
        let is_on_time = |row: &&Row| row.shown() == data.nodes && row.last_us <= row.due_us + period_us;
        let on_time = counted.iter().filter(is_on_time).count();
        let all_shown = counted.iter().filter(|row| row.shown() > 1);
        let held = data.held.iter().filter(|(frame, _)| *frame as usize >= from).map(|(_, us)| f64::from(*us));
        // Pictures that no other followed, where one should have.
        let last_due = counted.last().map_or(0, |row| row.due_us);
        let first_due = counted.first().map_or(0, |row| row.due_us);
        let newest = data.newest_us[..data.nodes as usize].iter().map(|newest| newest.unwrap_or(first_due));
        let to_the_end = newest.filter(|newest| newest + 2 * period_us < last_due).map(|newest| (last_due - newest) as f64);
        let part = |k: usize| Spread::of(counted.iter().map(|row| row.master_us[k]));
        let (sent, raw) = (data.frame_bytes.iter().map(|b| u64::from(*b)).sum::<u64>(), data.leaves * size_of::<u32>() as u64);
        Verdict {
            frames: counted.len() as u64,
            on_time_percent: 100.0 * on_time as f64 / counted.len().max(1) as f64,
            passed_over: counted.iter().map(|row| u64::from(row.passed_over)).sum(),
            never_shown: counted.iter().map(|row| u64::from(data.nodes - row.shown())).sum(),
            lateness_us: Spread::of(counted.iter().map(|row| row.last_us.saturating_sub(row.due_us) as f64)),
            skew_us: Spread::of(all_shown.map(|row| (row.last_us - row.first_us) as f64)),
            held_us: Spread::of(held.chain(to_the_end)),
            master_us: Spread::of(counted.iter().map(|row| row.master_us.iter().sum::<f64>())),
            cull_us: part(0),
            diff_us: part(1),
            encode_us: part(2),
            send_us: part(3),
            bytes_per_node_and_frame: Spread::of(data.frame_bytes.iter().map(|bytes| f64::from(*bytes))),
            raw_ratio: raw as f64 / sent.max(1) as f64,
            raw_bytes_per_second: raw as f64 / data.rows.len().max(1) as f64 * hz,
        }
    }

    fn lock(&self) -> MutexGuard<'_, Data> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Data {
    fn note(&mut self, node: u32, shown: &Shown) {
        let released = self.rows.len() as u64;
        match self.rows.get_mut(shown.frame as usize) {
            Some(row) => {
                let (bits, bit) = (&mut row.shown_by[node as usize / 64], 1 << (node % 64));
                if *bits & bit != 0 {
                    return; // told before
                }
                *bits |= bit;
                row.first_us = row.first_us.min(shown.at_us);
                row.last_us = row.last_us.max(shown.at_us);
                let before = self.newest_us[node as usize].replace(shown.at_us);
                let held = before.map(|before| u32::try_from(shown.at_us.saturating_sub(before)).unwrap_or(u32::MAX));
                self.held.extend(held.map(|held| (shown.frame as u32, held)));
            }
            // A node hears of a release before the report is written; nothing further ahead is true.
            None if shown.frame == released => self.early.push((node, *shown)),
            None => {}
        }
    }

    /// Memory that all this takes: it grows with the test, and is not the show's.
    fn bytes(&self) -> u64 {
        let shows: usize = self.shows.iter().map(|times| size_of_val(times.as_slice())).sum();
        let (rows, released) = (size_of_val(self.rows.as_slice()), size_of_val(self.released.as_slice()));
        let (held, frame_bytes) = (size_of_val(self.held.as_slice()), size_of_val(self.frame_bytes.as_slice()));
        (shows + rows + released + held + frame_bytes) as u64
    }
}

/// What a load test found.
#[derive(Clone, Debug, Serialize)]
pub struct Verdict {
    /// Frames that count.
    pub frames: u64,
    /// Frames that every node showed within one period of when they were due.
    pub on_time_percent: f64,
    /// How often a node was passed over.
    pub passed_over: u64,
    /// Times that a node did not show a frame.
    pub never_shown: u64,
    /// From when a frame was due until the last node showed it.
    pub lateness_us: Spread,
    /// From the first node that showed a frame to the last.
    pub skew_us: Spread,
    /// For how long a node showed a picture, until the next.
    pub held_us: Spread,
    /// The master's work on a frame: the four below.
    pub master_us: Spread,
    pub cull_us: Spread,
    pub diff_us: Spread,
    pub encode_us: Spread,
    pub send_us: Spread,
    /// Bytes of a frame's message.
    pub bytes_per_node_and_frame: Spread,
    /// How many times as many bytes the sets would have had as lists of leaf numbers.
    pub raw_ratio: f64,
    /// Bytes a second that would have been.
    pub raw_bytes_per_second: f64,
}

impl Verdict {
    /// Prints it.
    pub fn print(&self) {
        let line = |name: &str, of: &Spread, unit: &str| {
            say!("{name:28} {:10.0} {:10.0} {:10.0} {:10.0}  {unit}", of.median, of.p99, of.p999, of.max);
        };
        say!("frames on time               {:9.2} %  of {}", self.on_time_percent, self.frames);
        say!("passed over, not shown       {:10} {:10}  times", self.passed_over, self.never_shown);
        say!("{:28} {:>10} {:>10} {:>10} {:>10}", "", "median", "p99", "p99.9", "max");
        line("due to shown by the last", &self.lateness_us, "µs");
        line("swap skew between nodes", &self.skew_us, "µs");
        line("a picture, until the next", &self.held_us, "µs");
        line("master's work on a frame", &self.master_us, "µs");
        line("  cull", &self.cull_us, "µs");
        line("  diff", &self.diff_us, "µs");
        line("  encode", &self.encode_us, "µs");
        line("  send", &self.send_us, "µs");
        line("frame message", &self.bytes_per_node_and_frame, "bytes a node");
        let raw_mb = self.raw_bytes_per_second / 1e6;
        say!("leaf numbers instead         {:10.1} times as many bytes, {raw_mb:.0} MB/s", self.raw_ratio);
    }
}

/// How a wall bore faults.
#[derive(Clone, Debug, Serialize)]
pub struct Bearing {
    /// Processes ended and started again.
    pub kills: u64,
    /// Processes stopped that went on later.
    pub hangs: u64,
    /// From a fault to the wall's next frame.
    pub next_frame_ms: Spread,
    /// From the mending until it was heard of all nodes concerned that they show frames again.
    pub back_ms: Spread,
    /// Faults after which a node did not come back before the end.
    pub never_back: u64,
    /// Longest time between two frames of the whole test.
    pub longest_gap_ms: f64,
}

impl Bearing {
    /// Longest wait for the wall's next frame that is borne.
    pub const NEXT_FRAME_MS: f64 = 100.0;
    /// Longest way back into the picture that is borne.
    pub const BACK_MS: f64 = 1000.0;

    /// Prints it.
    pub fn print(&self) {
        let line =
            |name: &str, of: &Spread| say!("{name:28} {:10.0} {:10.0} {:10.0} {:10.0}  ms", of.median, of.p99, of.p999, of.max);
        say!("faults                       {:10} killed, {} hung", self.kills, self.hangs);
        line("  to the wall's next frame", &self.next_frame_ms);
        line("  back in the picture", &self.back_ms);
        say!("  never back                 {:10}", self.never_back);
        say!("  longest gap between frames {:10.0}  ms", self.longest_gap_ms);
    }

    /// Whether the wall bore it as it should.
    pub fn is_good(&self) -> bool {
        self.never_back == 0 && self.next_frame_ms.max <= Self::NEXT_FRAME_MS && self.back_ms.max <= Self::BACK_MS
    }
}

/// Greatest memory that this process has had, bytes; 0 where the system does not tell.
pub fn peak_bytes() -> u64 {
    status_bytes("VmHWM:")
}

fn status_bytes(field: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = status.lines().find_map(|line| line.strip_prefix(field)?.trim().strip_suffix(" kB")?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_on_time_when_every_node_showed_it_within_its_period() {
        let tally = Tally::new(2, 2, 5);
        let frame =
            |due_ms: u64| FrameReport { due: Duration::from_millis(due_ms), frame_bytes: vec![100, 0], ..FrameReport::default() };
        let shown = |node: u16, frame: u64, at_us: u64| tally.note_shown(NodeIndex(node), &Shown { frame, at_us });
        shown(1, 0, 1_000); // before the report
        for due_ms in [0, 100, 200, 300, 400] {
            tally.note_frame(&frame(due_ms));
        }
        shown(0, 0, 99_000);
        shown(1, 1, 150_000); // by one node alone,
        shown(1, 1, 151_000); // however often it says so
        shown(0, 2, 201_000);
        shown(1, 2, 301_000); // too late
        shown(0, 3, 301_000);
        shown(1, 3, 302_500);
        shown(0, 99, 0); // a lie
        tally.note_leaves(1000);
        let verdict = tally.verdict(10.0, 0);
        assert_eq!((verdict.frames, verdict.on_time_percent, verdict.never_shown), (4, 50.0, 1));
        assert_eq!((verdict.skew_us.max, verdict.lateness_us.max), (100_000.0, 101_000.0));
        let last = tally.verdict(10.0, 3);
        assert_eq!((last.skew_us.median, last.held_us.median, last.held_us.max), (1500.0, 100_000.0, 100_000.0));
        assert_eq!(verdict.raw_ratio, 4000.0 / 500.0);
    }

    #[test]
    fn a_fault_is_borne_when_frames_go_on_and_nodes_come_back() {
        let tally = Tally::new(3, 3, 5);
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        {
            let mut data = tally.lock();
            data.released = [0, 20, 75, 90].map(at).to_vec();
            data.shows = vec![[10, 95].map(at).to_vec(), vec![at(10), at(130)], vec![at(5)]];
        }
        let happened = |nodes: std::ops::Range<usize>| {
            let fault = faults::Fault { at_s: 0.0, process: 0, what: What::Kill, for_ms: 0 };
            Happened { fault, nodes, struck: at(30), mended: at(80) }
        };
        let bearing = tally.bearing(&[happened(0..2)]);
        assert_eq!((bearing.next_frame_ms.max, bearing.back_ms.max, bearing.longest_gap_ms), (45.0, 50.0, 55.0));
        assert!(bearing.is_good());
        let bearing = tally.bearing(&[happened(1..3)]);
        assert_eq!(bearing.never_back, 1, "node 2 shows nothing any more");
        assert!(!bearing.is_good());
    }
}
