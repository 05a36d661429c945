//! prepare
pub mod gltf;
