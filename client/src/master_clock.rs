//! What time it is at the master, from questions and answers on the control connection.
//!
//! As in NTP: an answer is assumed to have been given halfway between question and receipt. What that is off by is half the way there and
//! back at most, so that of the last answers the quickest one counts.

use std::time::Duration;

use mullion_common::wire::{Ping, Pong};

/// How often to ask: no multiple of a frame's time at a usual rate, lest every question meets the master at the same point of its work.
pub const PING_EVERY: Duration = Duration::from_millis(487);

/// Answers that are remembered, eight seconds' worth: clocks drift apart by less than the way there and back in that time.
const REMEMBERED: usize = 16;

/// One answer.
#[derive(Clone, Copy, Debug)]
struct Answer {
    /// Way there and back.
    round_trip: Duration,
    /// Master's clock less this node's, microseconds.
    offset_us: i64,
}

/// The master's clock as a node estimates it. Times are `Duration`s since any fixed start.
#[derive(Debug, Default)]
pub struct MasterClock {
    answers: [Option<Answer>; REMEMBERED],
    next: usize,
}

impl MasterClock {
    /// The question, asked at `now`.
    pub fn ping(now: Duration) -> Ping {
        Ping { at_us: micros(now) }
    }

    /// Takes an answer that came in at `now`. One to a question of the future is left over.
    pub fn take(&mut self, pong: &Pong, now: Duration) {
        let Some(round_trip_us) = micros(now).checked_sub(pong.at_us) else {
            return;
        };
        let halfway_us = pong.at_us + round_trip_us / 2;
        let offset_us = pong.master_us.wrapping_sub(halfway_us).cast_signed();
        self.answers[self.next] = Some(Answer { round_trip: Duration::from_micros(round_trip_us), offset_us });
        self.next = (self.next + 1) % REMEMBERED;
    }

    /// What the master's clock shows at `now`, microseconds; `None` before the first answer.
    pub fn master_us(&self, now: Duration) -> Option<u64> {
        self.best().map(|answer| micros(now).saturating_add_signed(answer.offset_us))
    }

    /// How far [`MasterClock::master_us`] may be off, but for the clocks' drift.
    pub fn uncertainty(&self) -> Option<Duration> {
        self.best().map(|answer| answer.round_trip / 2)
    }

    /// Forgets everything: another master may count its time anew.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    fn best(&self) -> Option<&Answer> {
        self.answers.iter().flatten().min_by_key(|answer| answer.round_trip)
    }
}

fn micros(at: Duration) -> u64 {
    at.as_micros() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_estimate_is_off_by_no_more_than_it_says(
            offset_us in 0..1_000_000_000u64,
            ways in proptest::collection::vec((0..9_000u64, 0..9_000u64), 1..40),
        ) {
            let mut clock = MasterClock::default();
            prop_assert_eq!(clock.master_us(Duration::ZERO), None);
            for (second, (there_us, back_us)) in (1..).zip(ways) {
                let sent_us = second * 1_000_000;
                let ping = MasterClock::ping(Duration::from_micros(sent_us));
                let pong = Pong { at_us: ping.at_us, master_us: sent_us + there_us + offset_us };
                clock.take(&pong, Duration::from_micros(sent_us + there_us + back_us));
                let now_us = sent_us + 500_000;
                let estimate = clock.master_us(Duration::from_micros(now_us)).expect("there was an answer");
                let uncertainty = clock.uncertainty().expect("there was an answer");
                prop_assert!(uncertainty.as_micros() as u64 <= (there_us + back_us) / 2);
                prop_assert!(estimate.abs_diff(now_us + offset_us) <= uncertainty.as_micros() as u64 + 1);
            }
        }
    }

    #[test]
    fn a_master_whose_clock_is_behind_and_an_answer_of_the_future() {
        let mut clock = MasterClock::default();
        clock.take(&Pong { at_us: 900, master_us: 5 }, Duration::from_micros(800));
        assert_eq!(clock.master_us(Duration::from_micros(1000)), None, "asked later than answered");
        clock.take(&Pong { at_us: 900, master_us: 5 }, Duration::from_micros(902));
        assert_eq!(clock.master_us(Duration::from_micros(1000)), Some(104));
        assert_eq!(clock.master_us(Duration::ZERO), Some(0), "no time before the master's start");
        clock.forget();
        assert_eq!(clock.master_us(Duration::from_micros(1000)), None);
    }
}
