// Positions that a matrix of their instance places: of cuts, and of solids around their nodes.

// By how much depths are taken nearer.
override DEPTH_SLACK: f32 = 1.0;

@vertex
fn vertex(
    @location(0) position: vec3f,
    @location(1) column_x: vec4f,
    @location(2) column_y: vec4f,
    @location(3) column_z: vec4f,
    @location(4) column_w: vec4f,
) -> @builtin(position) vec4f {
    let placed = mat4x4f(column_x, column_y, column_z, column_w) * vec4f(position, 1.0);
    return vec4f(placed.xy, placed.z * DEPTH_SLACK, placed.w);
}
