// A shown tile over the viewport. The tile is linear once sampled; the surface may or may not encode it.

@group(0) @binding(0) var tile: texture_2d<f32>;
@group(0) @binding(1) var tile_sampler: sampler;

// Whether the surface takes encoded values as they are.
override encode_srgb: bool = false;

struct Fragment {
    @builtin(position) position: vec4f,
    @location(0) uv: vec2f,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Fragment {
    let corner = vec2f(f32(index & 1u), f32(index >> 1u)) * 2.0;
    return Fragment(vec4f(corner.x * 2.0 - 1.0, 1.0 - corner.y * 2.0, 0.0, 1.0), corner);
}

@fragment
fn fragment(in: Fragment) -> @location(0) vec4f {
    let color = textureSampleLevel(tile, tile_sampler, in.uv, 0.0).rgb;
    let encoded = select(1.055 * pow(color, vec3f(1.0 / 2.4)) - 0.055, 12.92 * color, color <= vec3f(0.0031308));
    return vec4f(select(color, encoded, encode_srgb), 1.0);
}
