// A box to be tested: before the shaders that test it and let its draw through.

struct Box {
    min: vec3f,
    // Index in clip_from_local.
    record: u32,
    max: vec3f,
    // Which draw it is of.
    draw: u32,
    // Not 0: the object's transform turns the winding around.
    is_mirrored: u32,
    // Whether its draw waits for what comes of this, or nothing but who asked. 0: nothing does.
    waits: u32,
    leaf: u32,
    unused: u32,
}

const DRAW_WAITS: u32 = 1u;
const ASKED: u32 = 2u;

// Interpolated depths of a box and of what it holds differ by the last bits: a box that is hidden by less than this share is seen.
override DEPTH_SLACK: f32;

// What is known of all boxes.
struct Work {
    boxes: u32,
    // Of how many spans of the picture one is looked at, and from which on.
    every: u32,
    phase: u32,
    // Not 0: boxes of what waits alone are tested, and pixels are looked for in the picture, which has this number.
    picture: u32,
}
