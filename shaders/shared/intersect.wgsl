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

/// Ray parameter at which a triangle is hit, or -inf. Edge functions of shared edges are exact
/// negatives of each other, so no ray slips between two triangles.
fn triangle_parameter(triangle: u32, origin: vec3<f32>, direction: vec3<f32>, front_only: bool) -> f32 {
    let corners = triangle_at(triangle);
    let a = position_at(corners.x) - origin;
    let b = position_at(corners.y) - origin;
    let c = position_at(corners.z) - origin;
    let u = dot(direction, cross(b, c));
    let v = dot(direction, cross(c, a));
    let w = dot(direction, cross(a, b));
    let one_side = max(u, max(v, w)) <= 0.0;
    let other_side = min(u, min(v, w)) >= 0.0;
    if !(one_side || (other_side && !front_only)) {
        return -3.0e38;
    }
    let sum = u + v + w;
    if sum == 0.0 {
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

/// The nearest triangle of `body` that faces the ray, from parameter `from_depth` on.
fn nearest_hit(body: u32, ray: Ray, from_depth: f32) -> Hit {
    var hit = Hit(NONE, body, 3.0e38);
    let inverse = safe_inverse(ray.direction);
    let end = bodies[body].node_end;
    var node = bodies[body].node_first;
    while node < end {
        let here = node_at(node);
        let span = box_span(here.low, here.high, ray.origin, inverse);
        if span.x > min(span.y, hit.depth) || span.y < from_depth {
            node = here.escape;
            continue;
        }
        let first = here.leaf >> 3u;
        for (var k = 0u; k < (here.leaf & 7u); k++) {
            let front_only = (surface_at(triangle_at(first + k).w).flags & TWO_SIDED) == 0u;
            let depth = triangle_parameter(first + k, ray.origin, ray.direction, front_only);
            if depth > from_depth && depth < hit.depth {
                hit.depth = depth;
                hit.triangle = first + k;
            }
        }
        node = select(here.escape, node + 1u, here.leaf == 0u);
    }
    cut_short = cut_short || node < end;
    return hit;
}

/// Whether anything of `body` stands in a ray's way.
fn is_blocked(body: u32, origin: vec3<f32>, direction: vec3<f32>) -> bool {
    let inverse = safe_inverse(direction);
    let end = bodies[body].node_end;
    var node = bodies[body].node_first;
    while node < end {
        let here = node_at(node);
        let span = box_span(here.low, here.high, origin, inverse);
        if span.x > span.y || span.y < 0.0 {
            node = here.escape;
            continue;
        }
        let first = here.leaf >> 3u;
        for (var k = 0u; k < (here.leaf & 7u); k++) {
            if triangle_parameter(first + k, origin, direction, false) > 0.0 {
                return true;
            }
        }
        node = select(here.escape, node + 1u, here.leaf == 0u);
    }
    cut_short = cut_short || node < end;
    return false;
}
