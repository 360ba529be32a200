//! Rays against a body's triangles.

struct Hit {
    /// NONE: nothing was hit.
    triangle: u32,
    body: u32,
    /// Ray parameter: depth beyond the reference depth, m.
    depth: f32,
}

/// Set where a walk was cut short before the end of the hierarchy. Mesa's llvmpipe gives an
/// invocation 65535 loop turns in all and then leaves every loop without a word.
var<private> cut_short: bool = false;

/// Largest and smallest parameter where the ray is inside the box; empty when y < x.
fn box_span(low: vec3<f32>, high: vec3<f32>, origin: vec3<f32>, inverse: vec3<f32>) -> vec2<f32> {
    let a = (low - origin) * inverse;
    let b = (high - origin) * inverse;
    let near = min(a, b);
    let far = max(a, b);
    return vec2<f32>(max(max(near.x, near.y), near.z), min(min(far.x, far.y), far.z));
}

/// Ray parameter at which a triangle is hit, or -3e38. Edge functions of shared edges are exact
/// negatives of each other, so no ray slips between two triangles.
fn triangle_parameter(triangle: u32, origin: vec3<f32>, direction: vec3<f32>, any_side: bool) -> f32 {
    let first = corner_at(triangle, 0u);
    let a = first.xyz - origin;
    let b = corner_at(triangle, 1u).xyz - origin;
    let c = corner_at(triangle, 2u).xyz - origin;
    let u = dot(direction, cross(b, c));
    let v = dot(direction, cross(c, a));
    let w = dot(direction, cross(a, b));
    let from_front = max(u, max(v, w)) <= 0.0;
    let from_behind = min(u, min(v, w)) >= 0.0;
    let sum = u + v + w;
    if !(from_front || (from_behind && (any_side || first.w == 1.0))) || sum == 0.0 {
        return -3.0e38;
    }
    let point = (a * u + b * v + c * w) / sum;
    return dot(point, direction) / dot(direction, direction);
}

/// Reciprocal with zeros made tiny, so that boxes are never missed for a 0 * inf.
fn safe_inverse(direction: vec3<f32>) -> vec3<f32> {
    let tiny = vec3<f32>(1.0e-20);
    return 1.0 / select(direction, tiny, abs(direction) < tiny);
}

/// Whether a triangle that may be seen from the front lies within `radius` of the ray's line.
fn is_near_line(triangle: u32, ray: Ray, radius: f32) -> bool {
    let first = corner_at(triangle, 0u);
    let a = first.xyz - ray.origin;
    let b = corner_at(triangle, 1u).xyz - ray.origin;
    let c = corner_at(triangle, 2u).xyz - ray.origin;
    let two_sided = first.w == 1.0;
    let towards = dot(cross(b - a, c - a), ray.direction);
    if towards > 0.0 && !two_sided {
        return false;
    }
    // Distances of the line from the edges' lines, positive outside.
    let side = select(1.0, -1.0, towards > 0.0);
    let beyond_bc = side * dot(ray.direction, cross(b, c)) > radius * length(cross(ray.direction, c - b));
    let beyond_ca = side * dot(ray.direction, cross(c, a)) > radius * length(cross(ray.direction, a - c));
    let beyond_ab = side * dot(ray.direction, cross(a, b)) > radius * length(cross(ray.direction, b - a));
    return !(beyond_bc || beyond_ca || beyond_ab);
}

/// The nearest triangle of `body` that faces the ray, from parameter `from_depth` on.
fn nearest_hit(body: u32, ray: Ray, from_depth: f32) -> Hit {
    var hit = Hit(NONE, body, 3.0e38);
    let start = (ray.origin - bodies[body].box_low_m) / bodies[body].box_step_m;
    let inverse = safe_inverse(ray.direction / bodies[body].box_step_m);
    let end = bodies[body].node_end;
    var node = bodies[body].node_first;
    while node < end {
        let here = node_at(node);
        let span = box_span(here.low, here.high, start, inverse);
        let missed = span.x > min(span.y, hit.depth) || span.y < from_depth;
        if here.is_leaf && !missed {
            for (var k = 0u; k < here.count; k++) {
                let depth = triangle_parameter(here.first + k, ray.origin, ray.direction, false);
                if depth > from_depth && depth < hit.depth {
                    hit.depth = depth;
                    hit.triangle = here.first + k;
                }
            }
        }
        node = select(node + 1u, here.escape, missed && !here.is_leaf);
    }
    cut_short = cut_short || node < end;
    return hit;
}

/// Whether anything of `body` stands in a ray's way.
fn is_blocked(body: u32, origin: vec3<f32>, direction: vec3<f32>) -> bool {
    let start = (origin - bodies[body].box_low_m) / bodies[body].box_step_m;
    let inverse = safe_inverse(direction / bodies[body].box_step_m);
    let end = bodies[body].node_end;
    var node = bodies[body].node_first;
    var blocked = false;
    while node < end && !blocked {
        let here = node_at(node);
        let span = box_span(here.low, here.high, start, inverse);
        let missed = span.x > span.y || span.y < 0.0;
        if here.is_leaf && !missed {
            for (var k = 0u; k < here.count && !blocked; k++) {
                blocked = triangle_parameter(here.first + k, origin, direction, true) > 0.0;
            }
        }
        node = select(node + 1u, here.escape, missed && !here.is_leaf);
    }
    cut_short = cut_short || (node < end && !blocked);
    return blocked;
}
