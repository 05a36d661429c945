//! Steers a running Mullion wall.
