// Whether anything of a leaf's box is seen beyond what was drawn first: one word for each draw.

@group(0) @binding(0) var<storage, read> clip_from_local: array<mat4x4f>;
@group(0) @binding(1) var<storage, read> boxes: array<Box>;
@group(0) @binding(2) var<storage, read_write> is_seen: array<u32>;
@group(1) @binding(0) var first_depth: texture_depth_2d;

// Interpolated depths of a box and of what it holds differ by the last bits, and steep faces by more: a box that is hidden by less than
// what its depth changes by in half a pixel, and by less than this share of it, is seen.
const SLACK: f32 = 1.0 + 1.0 / 16384.0;

struct Fragment {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) draw: u32,
}

// Corners of the faces, as bits x, y, z, counterclockwise from outside.
const CORNERS: array<u32, 36> = array<u32, 36>(
    0u, 4u, 6u, 0u, 6u, 2u,
    1u, 3u, 7u, 1u, 7u, 5u,
    0u, 1u, 5u, 0u, 5u, 4u,
    2u, 6u, 7u, 2u, 7u, 3u,
    0u, 2u, 3u, 0u, 3u, 1u,
    4u, 5u, 7u, 4u, 7u, 6u,
);

@vertex
fn vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) instance: u32) -> Fragment {
    let bounds = boxes[instance];
    let turned = index - index % 3u + 2u - index % 3u;
    var corners = CORNERS;
    let corner = corners[select(index, turned, bounds.is_mirrored != 0u)];
    let far = vec3<bool>((corner & 1u) != 0u, (corner & 2u) != 0u, (corner & 4u) != 0u);
    let position = select(bounds.min, bounds.max, far);
    return Fragment(clip_from_local[bounds.record] * vec4f(position, 1.0), bounds.draw);
}

@fragment
fn fragment(in: Fragment) -> @location(0) vec4f {
    let nearest = (in.position.z + 0.5 * fwidth(in.position.z)) * SLACK;
    if nearest >= textureLoad(first_depth, vec2i(in.position.xy), 0) {
        is_seen[in.draw] = 1u;
    }
    return vec4f();
}
