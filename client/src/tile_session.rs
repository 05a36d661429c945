//! tile_session
