//! A painter that draws nothing, for tests of what nodes are told.

use std::sync::Arc;

use mullion_client::node::{PaintError, Painter};
use mullion_client::tile_session::{DrawStats, FrameToDraw};
use mullion_common::scene::{ChunkId, ObjectId, SceneManifest};
use mullion_common::wire::{Moved, ViewSpec};

/// Who is told what a painter would do.
pub trait Witness {
    /// It is to draw these views.
    fn opens(&mut self, _views: &[ViewSpec]) {}

    /// It draws a frame, unless the witness says that it cannot.
    fn draws(&mut self, _frame: &FrameToDraw) -> Result<(), PaintError> {
        Ok(())
    }

    /// It takes a hierarchy's next blob, and gives how many bytes that takes; none unless the witness says otherwise.
    fn takes(&mut self, _number: u32, _objects: &[ObjectId], _blob: &[u8]) -> Option<u64> {
        None
    }

    /// It shows a frame.
    fn shows(&mut self, _frame: u64) {}
}

/// Draws nothing, and tells a witness.
pub struct Blank<W>(pub W);

impl<W: Witness> Painter for Blank<W> {
    fn open_scene(&mut self, _: &Arc<SceneManifest>, views: &[ViewSpec]) -> Result<(), PaintError> {
        self.0.opens(views);
        Ok(())
    }

    fn grow_scene(&mut self, _: &Arc<SceneManifest>) -> Result<(), PaintError> {
        Ok(())
    }

    fn take_hierarchy(&mut self, number: u32, objects: &[ObjectId], blob: &[u8]) -> Result<Option<u64>, PaintError> {
        Ok(self.0.takes(number, objects, blob))
    }

    fn upload(&mut self, _: ChunkId, bytes: &[u8]) -> Result<u64, PaintError> {
        Ok(bytes.len() as u64)
    }

    fn evict(&mut self, _: ChunkId) -> Result<(), PaintError> {
        Ok(())
    }

    fn set_transform(&mut self, _: &Moved) -> Result<(), PaintError> {
        Ok(())
    }

    fn draw(&mut self, frame: &FrameToDraw) -> Result<DrawStats, PaintError> {
        self.0.draws(frame)?;
        Ok(DrawStats { draw_us: 1, leaves: frame.views[0].leaves.len(), triangles: 1, is_cut: false })
    }

    fn show(&mut self, frame: u64) -> Result<(), PaintError> {
        self.0.shows(frame);
        Ok(())
    }
}
