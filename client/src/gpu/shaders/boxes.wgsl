// Whether anything of a leaf's box is seen beyond what was drawn first: one word for each draw, and for each bound.

@group(0) @binding(0) var<storage, read> clip_from_local: array<mat4x4f>;
@group(0) @binding(1) var<storage, read> boxes: array<Box>;
@group(0) @binding(2) var<storage, read_write> is_seen: array<u32>;
@group(0) @binding(3) var<uniform> work: Work;
@group(0) @binding(4) var<storage, read> chosen: array<u32>;
@group(1) @binding(0) var first_depth: texture_depth_2d;

// By how much of what depth changes by from a pixel to the next a box is taken to be nearer: steep faces differ by more than the last bits.
const SLOPE_SLACK: f32 = 1.0;
const SPAN_PX: u32 = 10u;

// Whether those that are chosen are drawn, or all.
override is_sifted: bool = false;

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

fn box_of(instance: u32) -> u32 {
    if is_sifted {
        return chosen[instance];
    }
    return instance;
}

@vertex
fn vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) instance: u32) -> Fragment {
    let bounds = boxes[box_of(instance)];
    let turned = index - index % 3u + 2u - index % 3u;
    var corners = CORNERS;
    let corner = corners[select(index, turned, bounds.is_mirrored != 0u)];
    let far = vec3<bool>((corner & 1u) != 0u, (corner & 2u) != 0u, (corner & 4u) != 0u);
    let position = clip_from_local[bounds.record] * vec4f(select(bounds.min, bounds.max, far), 1.0);
    return Fragment(vec4f(position.xy, position.z * DEPTH_SLACK, position.w), bounds.draw);
}

// Whether a pixel is looked at: of every so many spans of ten pixels one below the other, those in the next column half of that lower
// (Bartz, Meißner, Hüttner 1999, figure 2).
fn is_read(at: vec2u) -> bool {
    let column = at.x / SPAN_PX;
    return (at.y + work.phase + (column % 2u) * (work.every / 2u)) % work.every == 0u;
}

// Behind a depth test that was done before: whatever comes here is seen.
// FORCED_DEPTH
@fragment
fn tested(in: Fragment) -> @location(0) vec4f {
    if is_read(vec2u(in.position.xy)) {
        is_seen[in.draw] = 1u;
    }
    return vec4f();
}

// The same where no depth test can be forced to come first.
@fragment
fn compared(in: Fragment) -> @location(0) vec4f {
    let steepness = max(abs(dpdx(in.position.z)), abs(dpdy(in.position.z)));
    let is_nearer = in.position.z + SLOPE_SLACK * steepness >= textureLoad(first_depth, vec2i(in.position.xy), 0);
    if is_nearer && is_read(vec2u(in.position.xy)) {
        is_seen[in.draw] = 1u;
    }
    return vec4f();
}
