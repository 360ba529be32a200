//! Upstream compensation by resampling: each screen pixel reads the undistorted radiance at
//! D(K_f^-1 R). Lanczos-3, normalised, so that a constant stays constant, and held between
//! 0 and the sum of the least and the most of the 4 x 4 pixels about: a dark edge's undershoot
//! cannot be shown, and cutting it alone would add light. Radiance is interpolated, without a Jacobian (optics conserve it).

struct Warp {
    /// Where the source canvas' corner lies in screen pixels (negative: a margin).
    source_origin_px: vec2<i32>,
    source_size_px: vec2<u32>,
}

@group(1) @binding(0) var<storage, read> source: array<f32>;
@group(1) @binding(1) var<storage, read_write> screen: array<f32>;
@group(1) @binding(2) var<uniform> warp: Warp;

fn lanczos3(x: f32) -> f32 {
    let pi_x = 3.14159265358979 * x;
    if abs(pi_x) < 1.0e-3 {
        return 1.0;
    }
    return 3.0 * sin(pi_x) * sin(pi_x / 3.0) / (pi_x * pi_x);
}

@compute @workgroup_size(8, 8)
fn resample(@builtin(global_invocation_id) id: vec3<u32>) {
    // frame.size_px is the screen here, frame.intrinsics_px its K_f.
    if any(id.xy >= frame.size_px) {
        return;
    }
    let focal = frame.intrinsics_px.xy;
    let pixel = vec2<f32>(id.xy) + 0.5;
    let line_of_sight = (pixel - frame.intrinsics_px.zw) / focal;
    // Displacement first: small against the position, so f32 keeps a thousandth of a pixel.
    let place = pixel + (distort(line_of_sight) - line_of_sight) * focal - vec2<f32>(warp.source_origin_px) - 0.5;
    let whole = floor(place);
    let part = place - whole;
    var sum = 0.0;
    var weights = 0.0;
    var least = 3.0e38;
    var most = 0.0;
    for (var j = -2; j <= 3; j++) {
        let weight_y = lanczos3(f32(j) - part.y);
        let y = clamp(i32(whole.y) + j, 0, i32(warp.source_size_px.y) - 1);
        for (var i = -2; i <= 3; i++) {
            let weight = weight_y * lanczos3(f32(i) - part.x);
            let x = clamp(i32(whole.x) + i, 0, i32(warp.source_size_px.x) - 1);
            let value = source[u32(y) * warp.source_size_px.x + u32(x)];
            sum += weight * value;
            weights += weight;
            if max(abs(f32(i) - 0.5), abs(f32(j) - 0.5)) < 2.0 {
                least = min(least, value);
                most = max(most, value);
            }
        }
    }
    screen[id.y * frame.size_px.x + id.x] = clamp(sum / weights, 0.0, most + least);
}
