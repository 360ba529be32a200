//! From pixel positions to rays, through the distortion where there is one.

/// D(r_u), paper's polynomial mapping: Horner in x of Horner in y.
fn distort(undistorted: vec2<f32>) -> vec2<f32> {
    let degree = frame.distortion_degree;
    var sum = vec2<f32>(0.0);
    var index = (degree + 1u) * (degree + 2u) / 2u;
    for (var i = 0u; i <= degree; i++) {
        var row = vec2<f32>(0.0);
        for (var j = 0u; j <= i; j++) {
            index -= 1u;
            let pair = frame.distortion[index / 2u];
            row = row * undistorted.y + select(pair.xy, pair.zw, (index & 1u) == 1u);
        }
        sum = sum * undistorted.x + row;
    }
    return sum;
}

/// D^-1(r) by Newton's method with the identity for Jacobian: distortions are of some percent, so
/// each step gains more than one digit; it only places vertices, rays use D itself.
fn undistort(distorted: vec2<f32>) -> vec2<f32> {
    var guess = distorted;
    for (var step = 0u; step < 8u; step++) {
        guess -= distort(guess) - distorted;
    }
    return guess;
}

struct Ray {
    origin: vec3<f32>,
    /// Camera-frame depth grows by 1 for each unit of the parameter.
    direction: vec3<f32>,
}

fn to_body(body: u32, vector_camera: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        dot(bodies[body].camera_from_body_x, vector_camera),
        dot(bodies[body].camera_from_body_y, vector_camera),
        dot(bodies[body].camera_from_body_z, vector_camera),
    );
}

/// The camera's x axis in a body's axes.
fn body_x_of_camera(body: u32) -> vec3<f32> {
    return vec3<f32>(
        bodies[body].camera_from_body_x.x,
        bodies[body].camera_from_body_y.x,
        bodies[body].camera_from_body_z.x,
    );
}

/// The camera's y axis in a body's axes.
fn body_y_of_camera(body: u32) -> vec3<f32> {
    return vec3<f32>(
        bodies[body].camera_from_body_x.y,
        bodies[body].camera_from_body_y.y,
        bodies[body].camera_from_body_z.y,
    );
}

fn to_camera(body: u32, vector_body: vec3<f32>) -> vec3<f32> {
    return bodies[body].camera_from_body_x * vector_body.x
        + bodies[body].camera_from_body_y * vector_body.y
        + bodies[body].camera_from_body_z * vector_body.z;
}

/// The ray of a pixel position in a body's axes, starting at the body's reference depth.
fn pixel_ray(body: u32, position_px: vec2<f32>) -> Ray {
    let focal = frame.intrinsics_px.xy;
    var line_of_sight = (position_px - frame.intrinsics_px.zw) / focal;
    let from_center_px = (position_px - vec2<f32>(bodies[body].center_px_whole)) - bodies[body].center_px_part;
    var from_center = from_center_px / focal;
    if frame.distortion_degree > 0u {
        line_of_sight = distort(line_of_sight);
        from_center = line_of_sight - bodies[body].center_line_of_sight;
    }
    let depth = bodies[body].reference_depth_m;
    let start = select(-bodies[body].center_camera_m, vec3<f32>(from_center * depth, 0.0), depth > 0.0);
    return Ray(to_body(body, start), to_body(body, vec3<f32>(line_of_sight, 1.0)));
}
