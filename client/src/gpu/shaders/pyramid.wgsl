// The farthest depth of ever larger squares of pixels (Greene, Kass, Miller 1993): a texel of level k stands for 2^k by 2^k pixels, those
// along the right and the lower edge for what is left there. Depth is reversed: the farthest is the least.

struct Step {
    // Where the level below begins, its width and its height; of the first level the picture's, and no beginning.
    below: vec3u,
    unused: u32,
    // The same of the level that is made.
    made: vec3u,
}

@group(0) @binding(0) var<uniform> reduction: Step;
@group(0) @binding(1) var<storage, read_write> levels: array<f32>;
@group(1) @binding(0) var first_depth: texture_depth_2d;

// Whether the level below is the picture.
override of_picture: bool = false;

fn texel(at: vec2u) -> f32 {
    if of_picture {
        return textureLoad(first_depth, vec2i(at), 0);
    }
    return levels[reduction.below.x + at.y * reduction.below.y + at.x];
}

@compute @workgroup_size(8, 8)
fn reduce(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= reduction.made.yz) {
        return;
    }
    let begin = id.xy * 2u;
    let end = min(begin + 1u, reduction.below.yz - 1u);
    let farthest = min(min(texel(begin), texel(vec2u(end.x, begin.y))), min(texel(vec2u(begin.x, end.y)), texel(end)));
    levels[reduction.made.x + id.y * reduction.made.y + id.x] = farthest;
}
