//! Lines on standard output, for which nobody may be left to read them: `mullion info … | head -1` is no error, and a
//! show goes on when its terminal is gone.

use std::fmt::Arguments;
use std::io::Write;

/// Prints a line; does nothing where it cannot be written.
pub fn line(text: Arguments<'_>) {
    let _ = writeln!(std::io::stdout().lock(), "{text}"); // nobody reads on
}

/// `println!` that does not panic when the reader has gone.
macro_rules! say {
    ($($text:tt)*) => { $crate::say::line(format_args!($($text)*)) };
}
pub(crate) use say;
