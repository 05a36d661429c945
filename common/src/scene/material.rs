//! How a leaf looks.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use super::ChunkId;

/// A material's place in the scene's table of materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Pod, Zeroable)]
#[repr(transparent)]
pub struct MaterialId(pub u32);

/// A base colour with an optional texture, and how its alpha counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Linear RGB and alpha, multiplied into texture and vertex colours.
    pub base_color: [f32; 4],
    /// Base colour texture, sRGB.
    pub texture: Option<TextureRef>,
    /// What alpha means.
    pub alpha: AlphaMode,
    /// Whether back faces are drawn.
    pub double_sided: bool,
}

/// What alpha means.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum AlphaMode {
    /// Nothing.
    Opaque,
    /// Fragments below the cutoff are dropped.
    Mask {
        /// Least alpha that is drawn.
        cutoff: f32,
    },
    /// Drawn over what is behind it, after everything opaque; never an occluder.
    Blend,
}

/// A texture and how it is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TextureRef {
    /// The encoded image (PNG or JPEG).
    pub chunk: ChunkId,
    /// Addressing along u.
    pub wrap_u: Wrap,
    /// Addressing along v.
    pub wrap_v: Wrap,
    /// Magnification.
    pub filter: Filter,
}

/// What lies beyond a texture's border.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[allow(missing_docs)]
pub enum Wrap {
    Repeat,
    Mirror,
    Clamp,
}

/// How a texture is magnified.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[allow(missing_docs)]
pub enum Filter {
    Nearest,
    Linear,
}
