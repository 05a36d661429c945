//! One file a command: its options, and thin glue over the crates.

pub mod bench;
pub mod budget;
pub mod cull;
pub mod demo;
pub mod detail;
pub mod enroll;
pub mod generate;
pub mod info;
pub mod load_nodes;
pub mod loadtest;
pub mod path;
pub mod prepare;
pub mod quality;
pub mod replay;
pub mod serve;
pub mod steering;
pub mod tile;
pub mod verify;
