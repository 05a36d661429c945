//! Where pictures go: files or a window.

pub mod headless;
pub(crate) mod layout;
pub mod window;
