//! Stage 3: listed pixels are sampled by rays, one invocation a sample, a chunk of pixels at a
//! time; then each pixel's samples are summed in their order, so that the sum is the same
//! whatever order they ran in.

@group(1) @binding(2) var<storage, read_write> samples: array<Sample>;
/// First listed pixel of this chunk.
@group(1) @binding(3) var<uniform> chunk_first: vec4<u32>;

/// Point k of n in the unit square: a Hammersley set, even along both axes and both diagonals.
fn square_point(k: u32, n: u32) -> vec2<f32> {
    return vec2<f32>((f32(k) + 0.5) / f32(n), f32(reverseBits(k) >> 8u) / 16777216.0 + 0.5 / f32(n));
}

@compute @workgroup_size(64)
fn take_samples(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let invocation = id.y * groups.x * 64u + id.x;
    let n = frame.refined_samples;
    let slot = invocation / n;
    let k = invocation % n;
    let listed = chunk_first.x + slot;
    if slot >= frame.chunk_pixels || listed >= atomicLoad(&work.count) {
        return;
    }
    let pixel = work.pixels[listed];
    let at = vec2<f32>(f32(pixel % frame.size_px.x), f32(pixel / frame.size_px.x));
    let position = at + square_point(k, n);
    var nearest = Hit(NONE, 0u, 3.0e38);
    var nearest_depth = 3.0e38;
    for (var body = 0u; body < frame.body_count; body++) {
        let start = bodies[body].reference_depth_m;
        let hit = nearest_hit(body, pixel_ray(body, position), -start);
        if hit.triangle != NONE && start + hit.depth < nearest_depth {
            nearest = hit;
            nearest_depth = start + hit.depth;
        }
    }
    var sample = sky();
    if nearest.triangle != NONE {
        // Two points of the Sun's disc a sample, from all over the disc for neighbouring samples.
        let sun = (k * 27u) % n;
        sample = shade(nearest.triangle, pixel_ray(nearest.body, position), inverseSqrt(f32(n)), sun, n, 2u * n, 0.0);
    }
    samples[invocation] = sample;
    if cut_short {
        atomicAdd(&work.cut_short, 1u);
    }
}

@compute @workgroup_size(64)
fn sum_samples(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    let listed = chunk_first.x + slot;
    if slot >= frame.chunk_pixels || listed >= atomicLoad(&work.count) {
        return;
    }
    let n = frame.refined_samples;
    var total = sky();
    for (var k = 0u; k < n; k++) {
        total = sum_of(total, samples[slot * n + k]);
    }
    store_pixel(work.pixels[listed], total, f32(n));
}
