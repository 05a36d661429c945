//! What master and clients say to each other.

pub mod codec;
