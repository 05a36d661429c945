// Lets those draws through that waited and are seen; and once all is drawn, tells which leaves have a pixel.

// index_count, instance_count, first_index, base_vertex, first_instance
const WORDS: u32 = 5u;

@group(0) @binding(0) var<storage, read> boxes: array<Box>;
@group(0) @binding(1) var<storage, read_write> is_seen: array<u32>;
@group(0) @binding(2) var<storage, read_write> arguments: array<u32>;
@group(0) @binding(3) var<uniform> work: Work;
@group(0) @binding(4) var<storage, read> last_seen: array<u32>;

@compute @workgroup_size(64)
fn release(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= work.boxes {
        return;
    }
    let tested = boxes[id.x];
    if tested.waits == DRAW_WAITS {
        arguments[tested.draw * WORDS + 1u] = is_seen[tested.draw];
    }
}

const HAS_PIXEL: u32 = 2u;

@compute @workgroup_size(64)
fn note(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= work.boxes {
        return;
    }
    let tested = boxes[id.x];
    if tested.waits != ASKED && last_seen[tested.leaf] == work.picture {
        is_seen[tested.draw] |= HAS_PIXEL;
    }
}
