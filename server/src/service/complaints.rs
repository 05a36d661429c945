//! What peers are complained of, and how often.

use std::time::Duration;

/// Warnings of what peers did: a few a second, so that who floods the master does not flood its log.
#[derive(Default)]
pub(super) struct Complaints {
    until: Duration,
    warned: u32,
    unsaid: u64,
}

impl Complaints {
    const PER_SECOND: u32 = 3;

    pub fn warn(&mut self, what: std::fmt::Arguments<'_>, now: Duration) {
        if now >= self.until {
            if self.unsaid > 0 {
                tracing::warn!("{} more connections were closed", self.unsaid);
            }
            *self = Self { until: now + Duration::from_secs(1), warned: 0, unsaid: 0 };
        }
        if self.warned < Self::PER_SECOND {
            self.warned += 1;
            tracing::warn!("{what}");
        } else {
            self.unsaid += 1;
        }
    }
}
