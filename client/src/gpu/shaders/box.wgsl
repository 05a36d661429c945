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
    // Not 0: the draw waits for what comes of this.
    is_late: u32,
    unused: vec2u,
}

