//! Stage 3: listed pixels are sampled by rays, a chunk of pixels at a time. First the triangles that
//! a pixel's rays may meet are gathered, by one walk for a pixel on an edge; then each invocation
//! takes a run of 8 samples among those; then a pixel's runs are summed in their order, so that
//! the sum is the same whatever order they ran in.

struct Chunk {
    list: u32,
    /// Slot of the chunk's first pixel in its list.
    first: u32,
    pixels: u32,
    /// log2 of the samples a pixel.
    samples_log2: u32,
}

/// Sums of runs of samples.
@group(1) @binding(2) var<storage, read_write> runs: array<Sample>;
@group(1) @binding(3) var<uniform> chunk: Chunk;

/// For each pixel of the chunk the number of its triangles, then the triangles.
@group(1) @binding(4) var<storage, read_write> candidates: array<u32>;

@group(1) @binding(5) var visible: texture_2d<u32>;

/// log2 of the samples that one invocation takes.
const RUN_LOG2: u32 = 3u;
/// Places a pixel has in `candidates`; with more triangles its rays walk the hierarchy themselves.
const CANDIDATES: u32 = 64u;

fn pixel_position(pixel: u32) -> vec2<f32> {
    return vec2<f32>(f32(pixel % frame.size_px.x), f32(pixel / frame.size_px.x));
}

/// Inside a body: the triangles that the pixel's first-pass samples and those around it see.
fn gather_visible(pixel: u32, base: u32) -> u32 {
    let at = vec2<u32>(pixel % frame.size_px.x, pixel / frame.size_px.x);
    let grid = i32(frame.grid);
    let corner = vec2<i32>((at - frame.region_origin_px) * frame.grid);
    let limit = vec2<i32>(frame.region_size_px * frame.grid) - 1;
    var found = 0u;
    var last = 0u;
    for (var y = -1; y <= grid; y++) {
        for (var x = -1; x <= grid; x++) {
            let place = clamp(corner + vec2<i32>(x, y), vec2<i32>(0), limit);
            let seen = textureLoad(visible, place, 0).x;
            if seen != 0u && seen != last {
                found++;
                candidates[base + found] = seen - 1u;
            }
            last = seen;
        }
    }
    return found;
}

@compute @workgroup_size(64)
fn gather_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if slot >= chunk.pixels || chunk.first + slot >= atomicLoad(&work.counts[chunk.list]) {
        return;
    }
    let pixel = listed_pixel(chunk.list, chunk.first + slot);
    let base = slot * CANDIDATES;
    if chunk.list == LIST_INNER {
        candidates[base] = gather_visible(pixel, base);
        return;
    }
    let middle = pixel_position(pixel) + 0.5;
    var found = 0u;
    for (var body = 0u; body < frame.body_count; body++) {
        let ray = pixel_ray(body, middle);
        // Half a pixel's diagonal at the body's far side, and some slack for distortion.
        let depth = bodies[body].reference_depth_m + select(
            bodies[body].bounding_radius_m + length(bodies[body].center_camera_m),
            bodies[body].bounding_radius_m,
            bodies[body].reference_depth_m > 0.0,
        );
        let radius = 0.75 * depth * length(ray.direction) / min(frame.intrinsics_px.x, frame.intrinsics_px.y);
        var walk = walk_of(body, ray, radius);
        to_next_leaf(&walk, -bodies[body].reference_depth_m, 3.0e38);
        while walk.count > 0u {
            for (var k = 0u; k < walk.count; k++) {
                if is_near_line(walk.first + k, ray, radius) {
                    found++;
                    if found < CANDIDATES {
                        candidates[base + found] = walk.first + k;
                    }
                }
            }
            to_next_leaf(&walk, -bodies[body].reference_depth_m, 3.0e38);
        }
        cut_short = cut_short || walk.count > 0u;
    }
    candidates[base] = found;
    note_cut_short();
}

/// What the ray of a position meets first, among all triangles.
fn first_hit(position: vec2<f32>) -> Hit {
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
    return nearest;
}

/// What the ray of a position meets first, among the pixel's candidates.
fn first_hit_among(position: vec2<f32>, base: u32, count: u32) -> Hit {
    var nearest = Hit(NONE, 0u, 3.0e38);
    var nearest_depth = 3.0e38;
    var body = NONE;
    var ray = Ray(vec3<f32>(0.0), vec3<f32>(0.0));
    for (var k = 1u; k <= count; k++) {
        let triangle = candidates[base + k];
        let owner = body_of(triangle);
        if owner != body {
            body = owner;
            ray = pixel_ray(body, position);
        }
        let start = bodies[body].reference_depth_m;
        let depth = triangle_parameter(triangle, ray.origin, ray.direction, false);
        if depth > -start && start + depth < nearest_depth {
            nearest = Hit(triangle, body, depth);
            nearest_depth = start + depth;
        }
    }
    return nearest;
}

/// Point k of 2^n_log2 in the unit square: the rank-1 lattice whose multiplier leaves the least rms
/// error in the area beside a straight edge of any direction (found by trying all odd ones: 0.012
/// for 64 points and 0.0043 for 256, where Hammersley's set leaves 0.015 and 0.0054).
fn square_point(k: u32, n_log2: u32) -> vec2<f32> {
    var multiplier = 3u;
    switch n_log2 {
        case 4u: {
            multiplier = 13u;
        }
        case 5u: {
            multiplier = 25u;
        }
        case 6u: {
            multiplier = 27u;
        }
        case 8u: {
            multiplier = 181u;
        }
        default: {}
    }
    let n = 1u << n_log2;
    return (vec2<f32>(f32(k), f32((k * multiplier) & (n - 1u))) + 0.5) / f32(n);
}

/// A turn of the Sun's disc points for each pixel, so that their pattern leaves no bands.
fn pixel_turn(pixel: u32) -> f32 {
    var h = pixel * 0x9e3779b9u;
    h = (h ^ (h >> 16u)) * 0x85ebca6bu;
    h = (h ^ (h >> 13u)) * 0xc2b2ae35u;
    return f32((h ^ (h >> 16u)) >> 8u) * (6.28318531 / 16777216.0);
}

@compute @workgroup_size(64)
fn take_samples(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let invocation = id.y * groups.x * 64u + id.x;
    let n = 1u << chunk.samples_log2;
    let parts_log2 = chunk.samples_log2 - RUN_LOG2;
    let slot = invocation >> parts_log2;
    let part = invocation & ((1u << parts_log2) - 1u);
    if slot >= chunk.pixels || chunk.first + slot >= atomicLoad(&work.counts[chunk.list]) {
        return;
    }
    let pixel = listed_pixel(chunk.list, chunk.first + slot);
    let count = candidates[slot * CANDIDATES];
    var total = sky();
    for (var k = part << RUN_LOG2; k < (part + 1u) << RUN_LOG2; k++) {
        let position = pixel_position(pixel) + square_point(k, chunk.samples_log2);
        var nearest = Hit(NONE, 0u, 3.0e38);
        if count < CANDIDATES {
            nearest = first_hit_among(position, slot * CANDIDATES, count);
        }
        // A small triangle that no sample saw, or too many of them.
        if nearest.triangle == NONE && (count >= CANDIDATES || chunk.list == LIST_INNER) {
            nearest = first_hit(position);
        }
        if nearest.triangle != NONE {
            // One point of the Sun's disc a sample, from all over the disc for neighbouring samples.
            let sunlight = Sunlight((k * 37u) & (n - 1u), n, n, pixel_turn(pixel), SUN_SAMPLED);
            let ray = pixel_ray(nearest.body, position);
            total = sum_of(total, shade(nearest.triangle, ray, inverseSqrt(f32(n)), sunlight));
        }
    }
    runs[invocation] = total;
    note_cut_short();
}

@compute @workgroup_size(64)
fn sum_samples(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if slot >= chunk.pixels || chunk.first + slot >= atomicLoad(&work.counts[chunk.list]) {
        return;
    }
    let parts_log2 = chunk.samples_log2 - RUN_LOG2;
    var total = sky();
    for (var k = 0u; k < 1u << parts_log2; k++) {
        total = sum_of(total, runs[(slot << parts_log2) + k]);
    }
    store_pixel(listed_pixel(chunk.list, chunk.first + slot), total, f32(1u << chunk.samples_log2));
}
