// The Occlusion Unit: counts pixels of boxes, and those in which nothing is nearer. occlusion/unit.rs does the same on the CPU, to the bit.

// Constants that it shares with the rest stand before it when it is compiled: MAX_CORNERS, GUARD_STEPS, LEAST_DEPTH.

// Depth over the plane of a face: change from pixel to pixel, and where it begins.
struct Front {
    right: f32,
    down: f32,
    at_anchor: f32,
    zero: u32,
}

struct Shape {
    // Of a convex polygon, in steps of a pixel.
    corners: array<vec2i, MAX_CORNERS>,
    fronts: array<Front, 3>,
    anchor_px: vec2i,
    nearest: f32,
    corner_count: u32,
}

// All begin at 0 and only grow: the first column and row are kept as how far they are from the greatest number.
struct Count {
    projected: atomic<u32>,
    visible: atomic<u32>,
    // Of positive numbers the bits ascend as they do.
    closest: atomic<u32>,
    before_first: array<atomic<u32>, 2>,
    last: array<atomic<u32>, 2>,
    unused: u32,
}

@group(0) @binding(0) var<storage, read> shapes: array<Shape>;
@group(0) @binding(1) var<storage, read_write> counts: array<Count>;
@group(0) @binding(2) var depth: texture_depth_2d;
// The viewport's edges are powers of two, so that every step that leads from corners to the GPU's own is exact.
@group(0) @binding(3) var<uniform> ndc_per_step: vec2f;

// What fragments need to know of their shape comes with them: software GPUs are slow to read it from the buffer for each.
struct Fragment {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) shape: u32,
    @location(1) @interpolate(flat) zero: u32,
    @location(2) @interpolate(flat) anchor_px: vec2i,
    @location(3) @interpolate(flat) nearest: f32,
    // Each front's right, down, at_anchor.
    @location(4) @interpolate(flat) front_0: vec3f,
    @location(5) @interpolate(flat) front_1: vec3f,
    @location(6) @interpolate(flat) front_2: vec3f,
}

// A fan of triangles around the first corner. Those beyond the last one have no area.
@vertex
fn vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) number: u32) -> Fragment {
    let shape = &shapes[number];
    let of_triangle = index % 3u;
    let last = max((*shape).corner_count, 1u) - 1u;
    let corner = select(min(index / 3u + of_triangle, last), 0u, of_triangle == 0u);
    let steps = vec2f((*shape).corners[corner] + vec2i(GUARD_STEPS));
    let from_top_left = steps * ndc_per_step;
    let position = vec4f(from_top_left.x - 1.0, 1.0 - from_top_left.y, 0.0, 1.0);
    let fronts = &(*shape).fronts;
    return Fragment(position, number, (*fronts)[0].zero, (*shape).anchor_px, (*shape).nearest,
        numbers((*fronts)[0]), numbers((*fronts)[1]), numbers((*fronts)[2]));
}

fn numbers(front: Front) -> vec3f {
    return vec3f(front.right, front.down, front.at_anchor);
}

// Rounds a number before it goes on: what is 0 only once it is read keeps compilers from joining a product and a sum into one step, which
// would round once.
fn rounded(number: f32, zero: u32) -> f32 {
    return bitcast<f32>(bitcast<u32>(number) ^ zero);
}

fn front_depth(front: vec3f, steps: vec2f, zero: u32) -> f32 {
    let right = rounded(front.x * steps.x, zero);
    let down = rounded(front.y * steps.y, zero);
    return rounded(right + down, zero) + front.z;
}

fn depth_at(in: Fragment, pixel: vec2i) -> f32 {
    let steps = vec2f(pixel - in.anchor_px);
    let depth_0 = front_depth(in.front_0, steps, in.zero);
    let depth_1 = front_depth(in.front_1, steps, in.zero);
    let depth_2 = front_depth(in.front_2, steps, in.zero);
    return max(min(min(in.nearest, depth_0), min(depth_1, depth_2)), LEAST_DEPTH);
}

@fragment
fn fragment(in: Fragment) -> @location(0) vec4f {
    let pixel = vec2i(in.position.xy);
    let here = depth_at(in, pixel);
    let count = &counts[in.shape];
    atomicAdd(&(*count).projected, 1u);
    if here >= textureLoad(depth, pixel, 0) {
        atomicAdd(&(*count).visible, 1u);
        atomicMax(&(*count).closest, bitcast<u32>(here));
        for (var axis = 0; axis < 2; axis++) {
            atomicMax(&(*count).before_first[axis], ~u32(pixel[axis]));
            atomicMax(&(*count).last[axis], u32(pixel[axis]));
        }
    }
    return vec4f();
}
