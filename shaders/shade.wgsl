//! Stage 2: shades the first-pass samples of each pixel and lists the pixels that need more:
//! those on an edge of visibility, and those whose samples differ.

@group(1) @binding(2) var visible: texture_2d<u32>;

/// Triangle + 1 at a first-pass sample, 0 outside the region.
fn seen(sample: vec2<i32>) -> u32 {
    let limit = vec2<i32>(frame.region_size_px * frame.grid);
    if any(sample < vec2<i32>(0)) || any(sample >= limit) {
        return 0u;
    }
    return textureLoad(visible, sample, 0).x;
}

/// Body + 1 of what a sample sees, 0 for the sky.
fn body_seen(triangle_plus_one: u32) -> u32 {
    if triangle_plus_one == 0u {
        return 0u;
    }
    return surface_at(triangle_at(triangle_plus_one - 1u).w).body + 1u;
}

/// A turn of the Sun's disc points for each pixel, so that their pattern leaves no bands.
fn pixel_turn(pixel: u32) -> f32 {
    var h = pixel * 0x9e3779b9u;
    h = (h ^ (h >> 16u)) * 0x85ebca6bu;
    h = (h ^ (h >> 13u)) * 0xc2b2ae35u;
    return f32((h ^ (h >> 16u)) >> 8u) * (6.28318531 / 16777216.0);
}

@compute @workgroup_size(8, 8)
fn shade_pixels(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.region_size_px) {
        return;
    }
    let at = id.xy + frame.region_origin_px;
    let pixel = at.y * frame.size_px.x + at.x;
    let grid = i32(frame.grid);
    let corner = vec2<i32>(id.xy) * grid;
    let first_body = body_seen(seen(corner));
    // Samples of the pixel and the ring around it: an edge may run between two pixels' samples.
    var edge = false;
    for (var y = -1; y <= grid; y++) {
        for (var x = -1; x <= grid; x++) {
            edge = edge || body_seen(seen(corner + vec2<i32>(x, y))) != first_body;
        }
    }
    if first_body == 0u && !edge {
        return;
    }
    if edge {
        let slot = atomicAdd(&work.count, 1u);
        work.pixels[slot] = pixel;
        return;
    }
    let body = first_body - 1u;
    let count = frame.grid * frame.grid;
    let turn = pixel_turn(pixel);
    var total = sky();
    var least = 3.0e38;
    var most = 0.0;
    for (var k = 0u; k < count; k++) {
        let cell = vec2<u32>(k & 1u, k >> 1u);
        let triangle = seen(corner + vec2<i32>(cell)) - 1u;
        let position = vec2<f32>(at) + (vec2<f32>(cell) + 0.5) / f32(frame.grid);
        let sample = shade(triangle, pixel_ray(body, position), 1.0 / f32(frame.grid), k, count, 4u * count, turn);
        total = sum_of(total, sample);
        least = min(least, sample.radiance_factor);
        most = max(most, sample.radiance_factor);
    }
    if most - least > bodies[body].contrast {
        let slot = atomicAdd(&work.count, 1u);
        work.pixels[slot] = pixel;
    }
    store_pixel(pixel, total, f32(count));
    if cut_short {
        atomicAdd(&work.cut_short, 1u);
    }
}
