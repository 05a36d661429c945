// Leaves: base colour, light by the geometric normal, leaf ids.
//
// What a fragment gets depends on its triangle, its pixel and its view alone, and along a wall's seams both sides
// must come to the same values. Everything that takes derivatives therefore takes them of quantities that are
// affine over a planar triangle's pixels (1/w and products with it), whose derivatives are the same everywhere on
// the triangle, however pixels fall into quads.

// Of a view. Its axes are orthonormal: the first along the picture's rows, the second in its plane, the third into the picture. In them the
// ray through pixel (x, y) is (x r11 + y r12 + r13, y r22 + r23, 1). So few numbers, since to read one costs a software renderer more than
// to reckon with it.
struct View {
    // r11, r12, r13 and the inverse of r11.
    row_1: vec4f,
    // r22, r23, the inverse of r22.
    row_2: vec4f,
    // Away from the sun, SUN long.
    from_sun: vec4f,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> clip_from_local: array<mat4x4f>;
@group(1) @binding(0) var base_color_texture: texture_2d<f32>;
@group(1) @binding(1) var base_color_sampler: sampler;
// Of what was drawn in the first turn, for those of the late one: depth, and leaves plus one.
@group(2) @binding(0) var first_depth: texture_depth_2d;
@group(2) @binding(1) var first_ids: texture_2d<u32>;

const AMBIENT: f32 = 0.25;
const HEAD: f32 = 0.30;
// Below any squared 1/w: what is farther has no normal.
const LEAST_NORMAL: f32 = 1e-36;
// log2 of the squared footprint of a texel below which magnification is certain.
const LEAST_FOOTPRINT: f32 = 1e-12;

struct Vertex {
    @location(0) position: vec3f,
    @location(1) uv: vec2f,
    @location(2) color: vec4f,
    // Per leaf: base colour; index in clip_from_local, and number; with less alpha fragments of masked leaves are dropped.
    @location(3) base_color: vec4f,
    @location(4) leaf: vec2u,
    @location(5) alpha_cutoff: f32,
}

struct Fragment {
    @builtin(position) @invariant position: vec4f,
    @location(0) uv: vec2f,
    // Of the vertex and the leaf.
    @location(1) color: vec4f,
    // Of the leaf: from here all is read from instances, for a lookup in a buffer costs a software renderer a loop over pixels.
    @location(2) @interpolate(flat) leaf: u32,
    @location(3) @interpolate(flat) alpha_cutoff: f32,
}

struct Pixel {
    @location(0) color: vec4f,
    @location(1) id: u32,
    @builtin(frag_depth) depth: f32,
}

@vertex
fn vertex(in: Vertex) -> Fragment {
    let clip = clip_from_local[in.leaf.x] * vec4f(in.position, 1.0);
    return Fragment(clip, in.uv, in.color * in.base_color, in.leaf.y, in.alpha_cutoff);
}

// Share of the light that the fragment's triangle sends back.
//
// The offset from the eye is w times the ray, so that over a plane m·ray = 1/w, where m is along its normal, turned away from the eye.
// As 1/w changes by m1 r11 from a pixel to the next, and by m1 r12 + m2 r22 to the one below, m follows from its derivatives.
fn light(in: Fragment) -> f32 {
    let over_w = in.position.w;
    let at = in.position.xy;
    let m1 = dpdx(over_w) * view.row_1.w;
    let m2 = (dpdy(over_w) - m1 * view.row_1.y) * view.row_2.z;
    let ray = vec3f(at.x * view.row_1.x + at.y * view.row_1.y + view.row_1.z, at.y * view.row_2.x + view.row_2.y, 1.0);
    let away = vec3f(m1, m2, over_w - m1 * ray.x - m2 * ray.y);
    let per_length = inverseSqrt(max(dot(away, away), LEAST_NORMAL));
    let sun = max(dot(away, view.from_sun.xyz) * per_length, 0.0);
    return AMBIENT + sun + HEAD * over_w * per_length * inverseSqrt(dot(ray, ray));
}

// Whether the base colour has a texture.
override is_textured: bool = true;

// Base colour before light. The level of detail is isotropic, of the larger of the two footprints.
fn base_color(in: Fragment) -> vec4f {
    if !is_textured {
        return in.color;
    }
    let uv = in.uv;
    let over_w = in.position.w;
    let w = 1.0 / over_w;
    let uv_over_w = uv * over_w;
    let size = vec2f(textureDimensions(base_color_texture));
    let across = (dpdx(uv_over_w) - uv * dpdx(over_w)) * w * size;
    let down = (dpdy(uv_over_w) - uv * dpdy(over_w)) * w * size;
    let footprint = max(max(dot(across, across), dot(down, down)), LEAST_FOOTPRINT);
    let texel = textureSampleLevel(base_color_texture, base_color_sampler, uv, 0.5 * log2(footprint));
    return texel * in.color;
}

// Depth, no nearer than the triangle, and rounded away from the eye to 1/32768 of itself.
//
// Faces that coincide are common in real files: parts that touch, walls given twice. Their interpolated depths differ by
// the last bits, differently in each tile, and the picture would be torn between the two faces and torn otherwise on the
// other side of a seam. Rounded, they tie but for few pixels, and the strict test gives all of those to the lower leaf.
// 8 bits: in a picture of nothing but faces given twice, 7 % of a wall's pixels differed from one picture of it without
// rounding, 0.2 % with; each bit halves them (client/tests/drawing/culling.rs). On a car of touching bricks it was 1.2 % and
// 0.02 %. The price is that faces closer than 0.3 mm at 10 m are one.
override ROUNDED_BITS: u32;
// How far from its triangle a pixel may be that is given to it: rasterisers round corners to 1/256 pixel. A triangle that is seen edge-on
// changes its depth by any amount over that distance. Its fragments are taken to be farther by as much: none is nearer than all of its
// triangle, and where its box is hidden, it is.
const SNAPPED_PX: f32 = 1.0 / 256.0;

fn rounded_depth(in: Fragment) -> f32 {
    let steepness = abs(dpdx(in.position.z)) + abs(dpdy(in.position.z));
    let depth = max(in.position.z - steepness * SNAPPED_PX, 0.0);
    return bitcast<f32>((bitcast<u32>(depth) >> ROUNDED_BITS) << ROUNDED_BITS);
}

// The lines of this form are replaced where the GPU lets a shader promise that it only moves depth away: then it may
// still drop hidden fragments before they are shaded.
fn opaque_pixel(in: Fragment) -> Pixel {
    return Pixel(vec4f(base_color(in).rgb * light(in), 1.0), in.leaf + 1u, rounded_depth(in));
}

fn masked_pixel(in: Fragment) -> Pixel {
    let depth = rounded_depth(in);
    let color = base_color(in);
    let lit = color.rgb * light(in);
    if color.a < in.alpha_cutoff {
        discard;
    }
    return Pixel(vec4f(lit, 1.0), in.leaf + 1u, depth);
}

// EARLY_DEPTH
@fragment
fn opaque(in: Fragment) -> Pixel {
    return opaque_pixel(in);
}

// EARLY_DEPTH
@fragment
fn masked(in: Fragment) -> Pixel {
    return masked_pixel(in);
}

// A fragment as near as what was drawn before loses to it, unless it is of an earlier leaf: then its depth is the next one, which rounding
// leaves free, for more rounds than there are.
fn late_depth(in: Fragment, depth: f32) -> f32 {
    let at = vec2i(in.position.xy);
    let before = bitcast<u32>(textureLoad(first_depth, at, 0));
    let wins = in.leaf + 1u < textureLoad(first_ids, at, 0).x;
    let ties = bitcast<u32>(depth) == (before >> ROUNDED_BITS) << ROUNDED_BITS;
    return select(depth, bitcast<f32>(before + 1u), ties && wins);
}

@fragment
fn opaque_late(in: Fragment) -> Pixel {
    var pixel = opaque_pixel(in);
    pixel.depth = late_depth(in, pixel.depth);
    return pixel;
}

@fragment
fn masked_late(in: Fragment) -> Pixel {
    var pixel = masked_pixel(in);
    pixel.depth = late_depth(in, pixel.depth);
    return pixel;
}

// EARLY_DEPTH
@fragment
fn blended(in: Fragment) -> Pixel {
    let color = base_color(in);
    return Pixel(vec4f(color.rgb * light(in), color.a), 0u, rounded_depth(in));
}
