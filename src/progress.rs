//! Progress bars on standard error; silent where that is no terminal.

use std::io::Write;
use std::sync::Mutex;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// One bar that goes through named stages.
pub struct Progress {
    bar: ProgressBar,
    stage: Mutex<&'static str>,
}

impl Progress {
    /// A bar, not yet shown.
    pub fn new() -> Self {
        let bar = ProgressBar::new(0);
        let style =
            ProgressStyle::with_template("{msg:24} {wide_bar} {pos}/{len} {elapsed}").unwrap_or(ProgressStyle::default_bar());
        bar.set_style(style);
        bar.enable_steady_tick(Duration::from_millis(250));
        Self { bar, stage: Mutex::new("") }
    }

    /// Shows how far a stage has come.
    pub fn show(&self, stage: &'static str, done: u64, total: u64) {
        if let Ok(mut current) = self.stage.lock()
            && *current != stage
        {
            *current = stage;
            self.bar.set_message(stage);
        }
        self.bar.set_length(total);
        self.bar.set_position(done);
    }

    /// Whether there is a bar to see: standard error is a terminal.
    pub fn is_visible(&self) -> bool {
        !self.bar.is_hidden()
    }

    /// Prints a line above the bar, or where it would be.
    pub fn line(&self, text: &str) {
        if self.bar.is_hidden() {
            let _ = writeln!(std::io::stderr().lock(), "{text}"); // a show goes on without a log
        } else {
            self.bar.println(text);
        }
    }

    /// Takes the bar off the screen.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
