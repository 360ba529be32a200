//! Stage 1: which triangle each first-pass sample sees, by rasterisation. Stores the triangle's
//! index + 1, 0 for the sky.

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) triangle_first: u32,
}

@vertex
fn vertex(@location(0) position: vec3<f32>, @builtin(instance_index) body: u32) -> Corner {
    let turned = to_camera(body, position);
    let point = turned + bodies[body].center_camera_m;
    let focal = frame.intrinsics_px.xy;
    let w = point.z;
    // Pixel position times w, from the projected centre where the body is far: keeps the digits.
    var scaled_px = focal * point.xy + frame.intrinsics_px.zw * w;
    var origin_px = vec2<f32>(frame.region_origin_px);
    if frame.distortion_degree > 0u {
        scaled_px = (focal * undistort(point.xy / w) + frame.intrinsics_px.zw) * w;
    } else if bodies[body].reference_depth_m > 0.0 {
        let across = turned.xy - bodies[body].center_line_of_sight * turned.z;
        let whole = bodies[body].center_px_whole - vec2<i32>(frame.region_origin_px);
        scaled_px = focal * across + (vec2<f32>(whole) + bodies[body].center_px_part) * w;
        origin_px = vec2<f32>(0.0);
    }
    let ndc_w = 2.0 * (scaled_px - origin_px * w) / vec2<f32>(frame.region_size_px) - w;
    // Reversed depth without a far plane: depth = near / w.
    return Corner(vec4<f32>(ndc_w.x, -ndc_w.y, frame.near_m, w), bodies[body].triangle_first);
}

@fragment
fn fragment(corner: Corner, @builtin(primitive_index) index: u32) -> @location(0) u32 {
    return corner.triangle_first + index + 1u;
}
