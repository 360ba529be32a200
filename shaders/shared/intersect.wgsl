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

/// A walk through a body's hierarchy.
struct Walk {
    start: vec3<f32>,
    inverse: vec3<f32>,
    /// Boxes are taken wider by this, in box steps.
    wider: vec3<f32>,
    node: u32,
    end: u32,
    /// The leaf arrived at; no triangles: the walk is over.
    first: u32,
    count: u32,
}

fn walk_of(body: u32, ray: Ray, radius_m: f32) -> Walk {
    let step = bodies[body].box_step_m;
    return Walk(
        (ray.origin - bodies[body].box_low_m) / step,
        safe_inverse(ray.direction / step),
        radius_m / step,
        bodies[body].node_first,
        bodies[body].node_end,
        0u,
        0u,
    );
}

/// Goes on to the next leaf whose box the ray passes between two parameters. Walking and testing
/// triangles are loops of their own, so that invocations that run side by side test together.
fn to_next_leaf(walk: ptr<function, Walk>, from_depth: f32, to_depth: f32) {
    var state = *walk;
    state.count = 0u;
    while state.node < state.end && state.count == 0u {
        let here = node_at(state.node);
        let span = box_span(here.low - state.wider, here.high + state.wider, state.start, state.inverse);
        let missed = span.x > min(span.y, to_depth) || span.y < from_depth;
        if here.is_leaf && !missed {
            state.first = here.first;
            state.count = here.count;
        }
        state.node = select(state.node + 1u, here.escape, missed && !here.is_leaf);
    }
    cut_short = cut_short || (state.node < state.end && state.count == 0u);
    *walk = state;
}

/// The nearest triangle of `body` that faces the ray, from parameter `from_depth` on.
fn nearest_hit(body: u32, ray: Ray, from_depth: f32) -> Hit {
    var hit = Hit(NONE, body, 3.0e38);
    var walk = walk_of(body, ray, 0.0);
    to_next_leaf(&walk, from_depth, hit.depth);
    while walk.count > 0u {
        for (var k = 0u; k < walk.count; k++) {
            let depth = triangle_parameter(walk.first + k, ray.origin, ray.direction, false);
            if depth > from_depth && depth < hit.depth {
                hit.depth = depth;
                hit.triangle = walk.first + k;
            }
        }
        to_next_leaf(&walk, from_depth, hit.depth);
    }
    cut_short = cut_short || walk.count > 0u;
    return hit;
}

/// Whether anything of `body` stands in a ray's way.
fn is_blocked(body: u32, origin: vec3<f32>, direction: vec3<f32>) -> bool {
    var walk = walk_of(body, Ray(origin, direction), 0.0);
    var blocked = false;
    to_next_leaf(&walk, 0.0, 3.0e38);
    while walk.count > 0u && !blocked {
        for (var k = 0u; k < walk.count && !blocked; k++) {
            blocked = triangle_parameter(walk.first + k, origin, direction, true) > 0.0;
        }
        if !blocked {
            to_next_leaf(&walk, 0.0, 3.0e38);
        }
    }
    cut_short = cut_short || (walk.count > 0u && !blocked);
    return blocked;
}
