// Which leaves have a pixel in a picture of leaf ids: each is noted with the picture's number.

struct Glance {
    // Of the picture.
    size_px: vec2u,
    number: u32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> glance: Glance;
@group(0) @binding(1) var<storage, read_write> last_seen: array<u32>;
// Leaves plus one; 0 where there is none.
@group(0) @binding(2) var ids: texture_2d<u32>;

// So many pixels of a row are one thread's, which notes a leaf once for neighbours.
const RUN_PX: u32 = 8u;

@compute @workgroup_size(8, 8)
fn look(@builtin(global_invocation_id) id: vec3u) {
    if id.y >= glance.size_px.y {
        return;
    }
    var last = 0u;
    let begin = id.x * RUN_PX;
    let end = min(begin + RUN_PX, glance.size_px.x);
    for (var x = begin; x < end; x += 1u) {
        let leaf = textureLoad(ids, vec2u(x, id.y), 0).x;
        if leaf != last && leaf != 0u {
            last_seen[leaf - 1u] = glance.number;
        }
        last = leaf;
    }
}
