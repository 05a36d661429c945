//! The drawing: the only user of wgpu. Executes a [`crate::frame::FramePlan`].
//!
//! ```text
//! Gpu ── shared by ──→ Renderer (one scene, its views) ── show ──→ Shown ──→ Presenter (a window)
//!                        ├ arena      geometry of resident chunks, in a few large buffers
//!                        ├ textures   decoded images with their mipmaps
//!                        ├ pipelines  one for each way that a leaf can be drawn
//!                        ├ cuts       simplified meshes
//!                        ├ draws      a pass as records, instances and batches
//!                        ├ occlusion  which of them are hidden
//!                        └ unit       how much of boxes is seen
//! ```
//! Beside it, [`QueryOccluder`] answers what refinement asks, by occlusion queries.

mod arena;
mod bindings;
mod by_chunk;
mod culled;
mod cuts;
mod device;
mod draws;
mod glance;
mod occlusion;
mod pipelines;
mod present;
mod pyramid;
mod queries;
mod query_occluder;
mod query_passes;
mod readback;
mod renderer;
mod rounds;
mod targets;
mod test_box;
mod textures;
mod timer;
mod unit;
mod upload;

pub use cuts::CutObject;
pub use device::{DisplayHandle, Gpu, GpuError, GpuOptions, Optional};
pub use present::{PresentError, Presenter, TileRect};
pub use query_occluder::QueryOccluder;
pub use renderer::{Renderer, ViewTarget};
pub use targets::{Attachments, Shown};
pub use upload::UploadError;
