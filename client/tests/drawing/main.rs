//! Drawing on whatever GPU there is, software included. Without one these tests say so and pass.

mod boxes;
mod chunks;
mod culling;
mod fixture;
mod looks;
mod occlusion;
mod parts;
mod several;
mod sleeping;
mod unit;
