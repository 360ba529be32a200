//! Stage 2: shades the first-pass samples of each pixel as if no relief stood before the Sun, and
//! lists the pixels that need more: those on an edge of visibility, those whose samples differ,
//! and those where the relief or another body may hide the Sun.

/// What is known of each pixel's light.
const NO_BODY: u32 = 0u;
const IN_LIGHT: u32 = 1u;
const IN_DARK: u32 = 2u;

@group(1) @binding(2) var<storage, read_write> light: array<u32>;
@group(1) @binding(3) var visible: texture_2d<u32>;

/// Triangle + 1 at a first-pass sample, 0 outside the region.
fn seen(sample: vec2<i32>) -> u32 {
    let limit = vec2<i32>(frame.region_size_px * frame.grid);
    if any(sample < vec2<i32>(0)) || any(sample >= limit) {
        return 0u;
    }
    return textureLoad(visible, sample, 0).x;
}

fn first_pass_position(at: vec2<u32>, cell: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(at) + (vec2<f32>(cell) + 0.5) / f32(frame.grid);
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
    let first_seen = seen(corner);
    var body = NONE;
    var range = vec2<u32>(0u, 1u);
    if first_seen != 0u {
        body = body_of(first_seen - 1u);
        range = vec2<u32>(bodies[body].triangle_first + 1u, bodies[body].triangle_end - bodies[body].triangle_first);
    }
    // Samples of the pixel and the ring around it: an edge may run between two pixels' samples.
    var edge = false;
    for (var y = -1; y <= grid; y++) {
        for (var x = -1; x <= grid; x++) {
            edge = edge || seen(corner + vec2<i32>(x, y)) - range.x >= range.y;
        }
    }
    // A body of a few pixels may slip between all samples.
    for (var small = 0u; small < frame.body_count; small++) {
        let disc = bodies[small].small_disc_px;
        edge = edge || distance(vec2<f32>(at) + 0.5, disc.xy) < disc.z;
    }
    if edge {
        list_pixel(LIST_EDGE, pixel);
        return;
    }
    if body == NONE {
        return;
    }
    var total = sky();
    // With and without the texture, which is filtered and so may vary four times as much.
    var least = vec2<f32>(3.0e38);
    var most = vec2<f32>(0.0);
    for (var y = 0u; y < frame.grid; y++) {
        for (var x = 0u; x < frame.grid; x++) {
            let cell = vec2<u32>(x, y);
            let triangle = seen(corner + vec2<i32>(cell)) - 1u;
            let ray = pixel_ray(body, first_pass_position(at, cell));
            let sample = shade(triangle, ray, 1.0 / f32(frame.grid), Sunlight(0u, 1u, 1u, 0.0, SUN_ASSUMED));
            total = sum_of(total, sample);
            least = min(least, vec2<f32>(sample.untextured, 0.25 * sample.radiance_factor));
            most = max(most, vec2<f32>(sample.untextured, 0.25 * sample.radiance_factor));
        }
    }
    let count = f32(frame.grid * frame.grid);
    store_pixel(pixel, total, count);
    light[pixel] = select(IN_LIGHT, IN_DARK, total.shadow == count);
    if any(most - least > vec2<f32>(bodies[body].contrast)) {
        list_pixel(LIST_INNER, pixel);
    } else if total.in_doubt > 0.0 {
        list_pixel(LIST_SHADOW, pixel);
    }
}

/// Rays from one place of each pixel in doubt to the rim of the Sun.
@compute @workgroup_size(64)
fn probe_shadows(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= atomicLoad(&work.counts[LIST_SHADOW]) {
        return;
    }
    let pixel = listed_pixel(LIST_SHADOW, id.x);
    let at = vec2<u32>(pixel % frame.size_px.x, pixel / frame.size_px.x);
    let corner = vec2<i32>((at - frame.region_origin_px) * frame.grid);
    let triangle = seen(corner) - 1u;
    let body = body_of(triangle);
    let ray = pixel_ray(body, first_pass_position(at, vec2<u32>(0u)));
    let sample = shade(triangle, ray, 1.0 / f32(frame.grid), Sunlight(0u, 1u, 1u, 0.0, SUN_PROBED));
    light[pixel] = select(IN_LIGHT | IN_DARK, select(IN_LIGHT, IN_DARK, sample.shadow == 1.0), fract(sample.shadow) == 0.0);
    note_cut_short();
}

/// A pixel in doubt whose surroundings are all in the light or all in the dark is so too; the
/// others lie on a shadow's edge and are refined.
@compute @workgroup_size(64)
fn settle_shadows(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= atomicLoad(&work.counts[LIST_SHADOW]) {
        return;
    }
    let pixel = listed_pixel(LIST_SHADOW, id.x);
    let at = vec2<i32>(i32(pixel % frame.size_px.x), i32(pixel / frame.size_px.x));
    let size = vec2<i32>(frame.size_px);
    var found = 0u;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let place = clamp(at + vec2<i32>(x, y), vec2<i32>(0), size - 1);
            found |= light[u32(place.y * size.x + place.x)];
        }
    }
    if found == IN_DARK {
        darken_pixel(pixel);
    } else if found != IN_LIGHT {
        list_pixel(LIST_INNER, pixel);
    }
}
