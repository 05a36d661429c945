// Which boxes need not be drawn to know whether they are seen: those that are behind all of what the pyramid has around them.

@group(0) @binding(0) var<storage, read> clip_from_local: array<mat4x4f>;
@group(0) @binding(1) var<storage, read> boxes: array<Box>;
@group(0) @binding(2) var<uniform> work: Work;
@group(0) @binding(3) var<storage, read_write> chosen: array<u32>;
@group(0) @binding(4) var<storage, read_write> arguments: array<atomic<u32>>;
@group(1) @binding(0) var<storage, read> levels: array<f32>;
@group(1) @binding(1) var<uniform> extent: Extent;

struct Extent {
    // Of the picture.
    size_px: vec2u,
    level_count: u32,
    unused: u32,
    // Where each level begins, its width and its height, from level 1 on.
    table: array<vec4u, 16>,
}

// The texels that a box is held against: at most so many along an edge.
const MOST_TEXELS: u32 = 4u;

fn corner_of(bounds: Box, k: u32) -> vec3f {
    return select(bounds.min, bounds.max, vec3<bool>((k & 1u) != 0u, (k & 2u) != 0u, (k & 4u) != 0u));
}

// The least depth of the pixels from one corner to the other, or of more.
fn farthest(from_px: vec2u, to_px: vec2u) -> f32 {
    var level = 1u;
    while level < extent.level_count && any((to_px >> vec2u(level)) - (from_px >> vec2u(level)) >= vec2u(MOST_TEXELS)) {
        level += 1u;
    }
    let row = extent.table[level - 1u];
    let first = from_px >> vec2u(level);
    let last = to_px >> vec2u(level);
    var least = 1.0;
    for (var y = first.y; y <= last.y; y += 1u) {
        for (var x = first.x; x <= last.x; x += 1u) {
            least = min(least, levels[row.x + y * row.y + x]);
        }
    }
    return least;
}

// Whether no pixel of a box can be seen. The boxes that come here are clear of the near plane.
fn is_hidden(bounds: Box) -> bool {
    let clip = clip_from_local[bounds.record];
    var low = vec2f(1e30);
    var high = vec2f(-1e30);
    var nearest = 0.0;
    for (var k = 0u; k < 8u; k += 1u) {
        let corner = clip * vec4f(corner_of(bounds, k), 1.0);
        let place = corner.xyz / corner.w;
        low = min(low, place.xy);
        high = max(high, place.xy);
        nearest = max(nearest, place.z);
    }
    let size = vec2f(extent.size_px);
    let begin = floor((vec2f(low.x, -high.y) * 0.5 + 0.5) * size);
    let end = floor((vec2f(high.x, -low.y) * 0.5 + 0.5) * size);
    if any(end < vec2f()) || any(begin >= size) {
        return true; // beside the picture
    }
    let last = extent.size_px - 1u;
    let from_px = min(vec2u(max(begin, vec2f())), last);
    let to_px = min(vec2u(max(end, vec2f())), last);
    return nearest * DEPTH_SLACK < farthest(from_px, to_px);
}

@compute @workgroup_size(64)
fn sift(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= work.boxes {
        return;
    }
    let bounds = boxes[id.x];
    if (work.picture == 0u || bounds.waits != 0u) && !is_hidden(bounds) {
        chosen[atomicAdd(&arguments[1], 1u)] = id.x;
    }
}
