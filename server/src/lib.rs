//! Mullion's master. Never links wgpu.
pub mod control;
pub mod cull;
pub mod enroll;
pub mod generate;
pub mod library;
pub mod master;
pub mod metrics;
pub mod prepare;
pub mod record;
pub mod service;
pub mod swap_barrier;
pub mod tree;
