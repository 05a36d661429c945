//! The swap barrier: when a frame may be shown. Pure; time is a `Duration` since any fixed start.
//!
//! A frame is released once every *live* node is ready with it, or once the wait is over. A live node that is not ready
//! by then is passed over: it is no longer live, nothing waits for it, and it holds the frame that it shows until it is ready with a later
//! one that was released: that one it shows at once, late as it is, so that a node that is always too slow lags instead of standing still. It is live
//! again from the next frame on when it has been ready in time, that is within the wait after the frame began, often
//! enough in a row: once after its first miss, twice after its second, up to [`MAX_PROBATION`]. So a node that
//! goes bad costs the others the wait once, and one that goes bad again and again costs ever less.

use std::collections::VecDeque;
use std::time::Duration;

/// Most frames in a row that a node which missed many must be in time with before it is waited for again.
pub const MAX_PROBATION: u32 = 64;
/// How many frames back a late answer is still understood.
const REMEMBERED_FRAMES: usize = 256;

/// A node's place in the wall's list of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeIndex(pub u16);

/// How long to wait, and for whom at the start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BarrierOptions {
    /// Longest wait for live nodes, from the moment a frame began. More than a frame's time, or a hiccup of the
    /// network makes nodes miss; all nodes stand still for this long once when one dies.
    pub wait: Duration,
    /// Longest wait of the first frame, for the nodes below.
    pub start_wait: Duration,
    /// Nodes that the first frame waits for even before they have connected.
    pub start_nodes: Vec<NodeIndex>,
}

/// What a node is to the barrier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// Not connected.
    Absent,
    /// Connected, not waited for.
    Trying,
    /// Waited for.
    Live,
}

/// A frame that may be shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Release {
    /// Its number.
    pub number: u64,
    /// Time since it began.
    pub waited: Duration,
    /// Nodes that were live and are so no longer.
    pub passed_over: Vec<NodeIndex>,
}

#[derive(Clone, Copy, Debug)]
struct Member {
    standing: Standing,
    /// The last frame it was ready with.
    ready: Option<u64>,
    misses: u32,
    in_time_in_a_row: u32,
    /// The first frame that waits for it, while it is live.
    live_from: u64,
}

impl Member {
    fn is_awaited(&self, frame: u64) -> bool {
        self.standing == Standing::Live && self.live_from <= frame
    }
}

#[derive(Clone, Copy, Debug)]
struct Begun {
    number: u64,
    at: Duration,
    wait: Duration,
    released: bool,
}

/// Who must be ready, who is, and when to release.
#[derive(Debug)]
pub struct SwapBarrier {
    options: BarrierOptions,
    members: Vec<Member>,
    /// The newest last.
    begun: VecDeque<Begun>,
    first: Option<u64>,
}

impl SwapBarrier {
    /// A barrier for so many nodes, none of them there yet.
    pub fn new(node_count: usize, options: BarrierOptions) -> Self {
        let absent = Member { standing: Standing::Absent, ready: None, misses: 0, in_time_in_a_row: 0, live_from: 0 };
        Self { options, members: vec![absent; node_count], begun: VecDeque::with_capacity(REMEMBERED_FRAMES), first: None }
    }

    /// The node has connected.
    pub fn join(&mut self, node: NodeIndex) {
        let member = self.member(node);
        (member.standing, member.ready, member.in_time_in_a_row) = (Standing::Trying, None, 0);
    }

    /// The node has gone: nothing waits for it any more.
    pub fn leave(&mut self, node: NodeIndex) {
        let member = self.member(node);
        (member.standing, member.ready) = (Standing::Absent, None);
    }

    /// The node cannot draw what comes, and is not to blame: nothing waits for it until it has been in time again.
    pub fn hold_back(&mut self, node: NodeIndex) {
        let member = self.member(node);
        if member.standing == Standing::Live {
            (member.standing, member.in_time_in_a_row) = (Standing::Trying, 0);
        }
    }

    /// What a node is now.
    pub fn standing(&self, node: NodeIndex) -> Standing {
        self.members[usize::from(node.0)].standing
    }

    /// Whether the node is ready with the newest frame.
    pub fn is_ready(&self, node: NodeIndex) -> bool {
        let member = &self.members[usize::from(node.0)];
        member.ready.is_some() && member.ready == self.begun.back().map(|b| b.number)
    }

    /// A frame begins, and takes the place of the one before, released or not. Numbers ascend.
    pub fn begin(&mut self, number: u64, now: Duration) {
        self.begin_patiently(number, Duration::ZERO, now);
    }

    /// The same, and live nodes are waited for at least so long: for a frame that is known to take its time.
    pub fn begin_patiently(&mut self, number: u64, at_least: Duration, now: Duration) {
        debug_assert!(self.begun.back().is_none_or(|b| b.number < number), "frames ascend");
        if self.begun.len() == REMEMBERED_FRAMES {
            self.begun.pop_front();
        }
        let is_first = *self.first.get_or_insert(number) == number;
        let starting = is_first && !self.options.start_nodes.is_empty();
        let start_wait = if starting { self.options.start_wait } else { Duration::ZERO };
        let wait = self.options.wait.max(start_wait).max(at_least);
        self.begun.push_back(Begun { number, at: now, wait, released: false });
    }

    /// A node says that it is ready with a frame. `None` where no such frame can be meant: the node lies. Otherwise whether it may show
    /// that frame at once, because it was released.
    pub fn ready(&mut self, node: NodeIndex, number: u64, now: Duration) -> Option<ShowNow> {
        let newest = *self.begun.back()?;
        if number > newest.number {
            return None;
        }
        let begun = self.begun.iter().rev().find(|b| b.number == number).copied();
        let in_time = begun.is_some_and(|begun| now.saturating_sub(begun.at) <= begun.wait);
        let member = self.member(node);
        if member.standing == Standing::Absent || member.ready.is_some_and(|ready| ready >= number) {
            return Some(ShowNow::No); // said before
        }
        member.ready = Some(number);
        if member.standing == Standing::Trying {
            member.in_time_in_a_row = if in_time { member.in_time_in_a_row + 1 } else { 0 };
            let probation = 1u32.checked_shl(member.misses.saturating_sub(1)).unwrap_or(MAX_PROBATION).min(MAX_PROBATION);
            if member.in_time_in_a_row >= probation {
                member.standing = Standing::Live;
                member.live_from = newest.number + 1;
            }
        }
        Some(if begun.is_some_and(|begun| begun.released) { ShowNow::Yes } else { ShowNow::No })
    }

    /// The newest frame, if it may be shown now and was not before.
    pub fn poll(&mut self, now: Duration) -> Option<Release> {
        let newest = *self.begun.back()?;
        if newest.released {
            return None;
        }
        let waited = now.saturating_sub(newest.at);
        let over = waited >= newest.wait;
        if !over && !self.all_ready(newest.number) {
            return None;
        }
        let mut passed_over = Vec::new();
        for (i, member) in self.members.iter_mut().enumerate() {
            if member.is_awaited(newest.number) && member.ready != Some(newest.number) {
                member.standing = Standing::Trying;
                member.misses = member.misses.saturating_add(1);
                member.in_time_in_a_row = 0;
                passed_over.push(NodeIndex(i as u16));
            }
        }
        if let Some(begun) = self.begun.back_mut() {
            begun.released = true;
        }
        Some(Release { number: newest.number, waited, passed_over })
    }

    /// When [`SwapBarrier::poll`] releases the newest frame at the latest.
    pub fn deadline(&self) -> Option<Duration> {
        let newest = self.begun.back().filter(|b| !b.released)?;
        Some(newest.at + newest.wait)
    }

    fn all_ready(&self, number: u64) -> bool {
        for (i, member) in self.members.iter().enumerate() {
            let at_start = self.first == Some(number) && self.options.start_nodes.contains(&NodeIndex(i as u16));
            if (at_start || member.is_awaited(number)) && member.ready != Some(number) {
                return false;
            }
        }
        // Where nobody is live, frames keep to the wait instead of racing ahead of those that are coming.
        self.members.iter().any(|m| m.ready == Some(number))
    }

    fn member(&mut self, node: NodeIndex) -> &mut Member {
        &mut self.members[usize::from(node.0)]
    }
}

/// Whether a node that is ready late may show the frame without further ado.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum ShowNow {
    Yes,
    No,
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: NodeIndex = NodeIndex(0);
    const B: NodeIndex = NodeIndex(1);
    const WAIT_MS: u64 = 20;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn barrier(start_nodes: Vec<NodeIndex>) -> SwapBarrier {
        SwapBarrier::new(2, BarrierOptions { wait: ms(WAIT_MS), start_wait: ms(1000), start_nodes })
    }

    /// Both nodes are live from frame 1 on, which begins at 1000 ms.
    fn running() -> SwapBarrier {
        let mut barrier = barrier(vec![A, B]);
        barrier.join(A);
        barrier.join(B);
        barrier.begin(0, ms(0));
        barrier.ready(A, 0, ms(500));
        assert_eq!(barrier.poll(ms(999)), None, "the start gate waits for B");
        barrier.ready(B, 0, ms(999));
        assert!(barrier.poll(ms(999)).is_some_and(|r| r.passed_over.is_empty()));
        barrier.begin(1, ms(1000));
        barrier
    }

    #[test]
    fn a_frame_is_released_when_the_last_live_node_is_ready() {
        let mut barrier = running();
        barrier.ready(A, 1, ms(1003));
        assert_eq!(barrier.poll(ms(1004)), None);
        barrier.ready(B, 1, ms(1005));
        assert_eq!(barrier.poll(ms(1005)), Some(Release { number: 1, waited: ms(5), passed_over: vec![] }));
        assert_eq!(barrier.poll(ms(1006)), None, "once only");
    }

    #[test]
    fn a_node_that_misses_costs_the_wait_once_and_comes_back_at_a_frame_boundary() {
        let mut barrier = running();
        barrier.ready(A, 1, ms(1003));
        assert_eq!(barrier.deadline(), Some(ms(1020)));
        assert_eq!(barrier.poll(ms(1019)), None);
        assert_eq!(barrier.poll(ms(1020)).unwrap().passed_over, [B]);
        for frame in 2..10 {
            let start = 1000 + 20 * frame;
            barrier.begin(frame, ms(start));
            barrier.ready(A, frame, ms(start + 3));
            assert_eq!(barrier.poll(ms(start + 3)).unwrap().waited, ms(3), "nothing waits for B");
        }
        barrier.ready(B, 9, ms(1189));
        assert_eq!(barrier.standing(B), Standing::Live);
        barrier.begin(10, ms(1200));
        barrier.ready(A, 10, ms(1203));
        assert_eq!(barrier.poll(ms(1203)), None, "B is waited for again");
    }

    #[test]
    fn a_node_that_misses_again_and_again_must_prove_itself_longer() {
        let mut barrier = running();
        let mut frame = 1;
        let mut now = 1000;
        let mut proofs = Vec::new();
        for _ in 0..9 {
            barrier.ready(A, frame, ms(now));
            now += WAIT_MS;
            assert_eq!(barrier.poll(ms(now)).unwrap().passed_over, [B]);
            let mut proof = 0;
            while barrier.standing(B) != Standing::Live {
                frame += 1;
                barrier.begin(frame, ms(now));
                barrier.ready(A, frame, ms(now));
                assert!(barrier.poll(ms(now)).is_some());
                barrier.ready(B, frame, ms(now + 1));
                proof += 1;
                now += 2;
            }
            proofs.push(proof);
            frame += 1;
            barrier.begin(frame, ms(now));
        }
        assert_eq!(proofs, [1, 2, 4, 8, 16, 32, 64, 64, 64]);
    }

    #[test]
    fn a_late_node_shows_at_once_what_all_others_show_and_is_not_live() {
        let mut barrier = running();
        barrier.ready(A, 1, ms(1001));
        assert!(barrier.poll(ms(1020)).is_some());
        assert_eq!(barrier.ready(B, 1, ms(1021)), Some(ShowNow::Yes));
        assert_eq!(barrier.standing(B), Standing::Trying);
    }

    #[test]
    fn a_slower_joiner_gets_in_though_the_others_never_wait_for_it() {
        let mut barrier = running();
        barrier.leave(B);
        barrier.join(B);
        for frame in 1..5 {
            if frame > 1 {
                barrier.begin(frame, ms(1000 + frame));
            }
            barrier.ready(A, frame, ms(1000 + frame));
            assert!(barrier.poll(ms(1000 + frame)).is_some());
        }
        assert_eq!(barrier.ready(B, 2, ms(1012)), Some(ShowNow::Yes), "late, but later than what it shows");
        assert_eq!(barrier.standing(B), Standing::Live, "ten milliseconds are in time");
    }

    #[test]
    fn a_node_that_is_always_too_slow_shows_what_it_draws_and_holds_nobody_up() {
        let mut barrier = running();
        for frame in 1..50 {
            let start = 1000 + 20 * (frame - 1);
            if frame > 1 {
                barrier.begin(frame, ms(start));
                // It began with the frame before while that one ran, and needs longer than a frame.
                assert_eq!(barrier.ready(B, frame - 1, ms(start + 10)), Some(ShowNow::Yes));
            }
            barrier.ready(A, frame, ms(start + 1));
            let release = barrier.poll(ms(start + 20)).unwrap();
            assert_eq!(release.passed_over, if frame == 1 { vec![B] } else { vec![] });
        }
        assert_eq!(barrier.standing(B), Standing::Trying);
        barrier.begin(50, ms(2000));
        assert_eq!(barrier.ready(B, 50, ms(2001)), Some(ShowNow::No), "nobody shows it yet");
    }

    #[test]
    fn a_frame_that_takes_its_time_is_waited_for() {
        let mut barrier = running();
        barrier.begin_patiently(2, ms(500), ms(1100));
        assert_eq!(barrier.ready(A, 2, ms(1103)), Some(ShowNow::No));
        assert_eq!((barrier.poll(ms(1599)), barrier.deadline()), (None, Some(ms(1600))));
        assert_eq!(barrier.ready(B, 2, ms(1599)), Some(ShowNow::No));
        assert_eq!(barrier.poll(ms(1599)), Some(Release { number: 2, waited: ms(499), passed_over: vec![] }));
        barrier.begin(3, ms(1600));
        assert_eq!(barrier.ready(A, 3, ms(1603)), Some(ShowNow::No));
        assert_eq!(barrier.poll(ms(1600 + WAIT_MS)).map(|release| release.passed_over), Some(vec![B]), "that one only");
    }

    #[test]
    fn who_is_held_back_is_not_waited_for_until_it_was_in_time_again() {
        let mut barrier = running();
        barrier.hold_back(B);
        barrier.ready(A, 1, ms(1001));
        assert_eq!(barrier.poll(ms(1001)).unwrap().passed_over, [], "it is not to blame");
        assert_eq!(barrier.standing(B), Standing::Trying);
        barrier.ready(B, 1, ms(1002));
        assert_eq!(barrier.standing(B), Standing::Live);
        barrier.leave(B);
        barrier.hold_back(B);
        assert_eq!(barrier.standing(B), Standing::Absent);
    }

    #[test]
    fn who_leaves_is_not_waited_for_and_who_lies_is_found_out() {
        let mut barrier = running();
        barrier.ready(A, 1, ms(1001));
        barrier.leave(B);
        assert!(barrier.poll(ms(1001)).is_some_and(|r| r.passed_over.is_empty()));
        assert_eq!(barrier.ready(A, 2, ms(1002)), None, "frame 2 has not begun");
    }

    #[test]
    fn who_is_ready_is_so_with_the_newest_frame_and_while_it_is_there() {
        let mut barrier = barrier(vec![]);
        barrier.join(B);
        assert!(!barrier.is_ready(B), "nothing has begun");
        barrier.begin(0, ms(0));
        barrier.ready(B, 0, ms(1));
        assert!(barrier.is_ready(B));
        barrier.leave(B);
        assert!(!barrier.is_ready(B));
        barrier.join(B);
        barrier.ready(B, 0, ms(2));
        barrier.join(B); // by another connection, before the first was seen to end
        assert!(!barrier.is_ready(B));
        barrier.ready(B, 0, ms(3));
        barrier.begin(1, ms(4));
        assert!(!barrier.is_ready(B), "that was another frame");
    }

    /// B has missed two frames and must be in time with two in a row; frame 4 has begun.
    fn on_probation() -> SwapBarrier {
        let mut barrier = running();
        for frame in 1..=3 {
            let start = 1000 * frame;
            if frame > 1 {
                barrier.begin(frame, ms(start));
            }
            barrier.ready(A, frame, ms(start));
            let release = barrier.poll(ms(start + WAIT_MS)).unwrap();
            assert_eq!(release.passed_over.is_empty(), frame == 2);
            if frame == 2 {
                barrier.ready(B, frame, ms(start + WAIT_MS));
                assert_eq!(barrier.standing(B), Standing::Live, "one frame in time, and within the wait");
            }
        }
        barrier.begin(4, ms(4000));
        barrier
    }

    #[test]
    fn a_frame_counts_once_however_often_it_is_acknowledged() {
        let mut barrier = on_probation();
        for _ in 0..3 {
            assert_eq!(barrier.ready(B, 4, ms(4001)), Some(ShowNow::No));
            assert_eq!(barrier.standing(B), Standing::Trying);
        }
        barrier.begin(5, ms(4020));
        barrier.ready(B, 5, ms(4021));
        assert_eq!(barrier.standing(B), Standing::Live);
    }

    #[test]
    fn who_comes_back_proves_itself_anew_and_who_is_gone_proves_nothing() {
        let mut barrier = on_probation();
        barrier.ready(B, 4, ms(4001));
        barrier.join(B);
        barrier.begin(5, ms(4020));
        barrier.ready(B, 5, ms(4021));
        assert_eq!(barrier.standing(B), Standing::Trying, "what it did before it came back does not count");
        barrier.leave(B);
        barrier.begin(6, ms(4040));
        assert_eq!(barrier.ready(B, 6, ms(4041)), Some(ShowNow::No));
        assert!(!barrier.is_ready(B));
        assert_eq!(barrier.standing(B), Standing::Absent);
    }

    #[test]
    fn who_becomes_live_is_waited_for_from_the_next_frame_on() {
        let mut barrier = running();
        barrier.leave(B);
        barrier.join(B);
        barrier.ready(A, 1, ms(1001));
        assert!(barrier.poll(ms(1001)).is_some());
        barrier.begin(2, ms(1002));
        barrier.ready(B, 1, ms(1003)); // in time, but another frame runs by now
        assert_eq!(barrier.standing(B), Standing::Live);
        barrier.ready(A, 2, ms(1004));
        assert_eq!(barrier.poll(ms(1004)).unwrap().passed_over, [], "nobody waits for B yet");
        barrier.begin(3, ms(1010));
        barrier.ready(A, 3, ms(1011));
        assert_eq!(barrier.poll(ms(1012)), None, "now they do");
    }

    #[test]
    fn with_nobody_live_frames_keep_to_the_wait_and_the_first_ready_releases() {
        let mut barrier = barrier(vec![]);
        barrier.begin(0, ms(0));
        assert_eq!(barrier.poll(ms(WAIT_MS - 1)), None);
        assert!(barrier.poll(ms(WAIT_MS)).is_some());
        barrier.join(A);
        barrier.begin(1, ms(30));
        barrier.ready(A, 1, ms(31));
        assert_eq!(barrier.poll(ms(31)).unwrap().waited, ms(1));
    }

    #[test]
    fn the_start_gate_ends() {
        let mut barrier = barrier(vec![A, B]);
        barrier.begin(0, ms(0));
        assert_eq!(barrier.deadline(), Some(ms(1000)));
        assert_eq!(barrier.poll(ms(999)), None);
        assert!(barrier.poll(ms(1000)).is_some());
        barrier.begin(1, ms(1001));
        assert_eq!(barrier.deadline(), Some(ms(1021)));
    }
}
