//! Where pictures go: files or a window.

pub mod headless;
pub mod window;
