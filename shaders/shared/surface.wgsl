//! One sample: what a ray that hit a triangle sees.

/// true: all layers are stored, else radiance and I/F alone.
override LAYERS: bool = false;

struct Sample {
    /// W m^-2 sr^-1 nm^-1.
    radiance: f32,
    radiance_factor: f32,
    /// 1: a body was hit.
    hit: f32,
    depth_m: f32,
    /// Camera axes.
    normal: vec3<f32>,
    incidence: f32,
    emission: f32,
    phase: f32,
    /// Part of the Sun's disc that is hidden, 0..1.
    shadow: f32,
    /// I/F without the texture.
    untextured: f32,
    /// 1: relief or another body may hide the Sun, which was not looked into.
    in_doubt: f32,
}

fn sky() -> Sample {
    return Sample(0.0, 0.0, 0.0, 0.0, vec3<f32>(0.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
}

/// Point k of n spread evenly over the unit disc (sunflower spiral), turned by `turn`.
fn disc_point(k: u32, n: u32, turn: f32) -> vec2<f32> {
    let angle = 2.39996323 * f32(k) + turn;
    return sqrt((f32(k) + 0.5) / f32(n)) * vec2<f32>(cos(angle), sin(angle));
}

/// The disc's lowest and highest point, its sides, its middle.
fn rim_point(k: u32) -> vec2<f32> {
    let sign = select(1.0, -1.0, (k & 1u) == 0u);
    return select(select(vec2<f32>(sign, 0.0), vec2<f32>(0.0, sign), k < 2u), vec2<f32>(0.0), k == 4u);
}

/// Whether the point, in the axes of `body`, sees the Sun in this direction.
fn sees_sun(body: u32, origin: vec3<f32>, direction: vec3<f32>, own_relief: bool) -> bool {
    if own_relief && is_blocked(body, origin, direction) {
        return false;
    }
    let casters = bodies[body].shadow_casters;
    if casters != 0u {
        let origin_camera = to_camera(body, origin) + bodies[body].center_from_first_m;
        let direction_camera = to_camera(body, direction);
        for (var other = 0u; other < frame.body_count; other++) {
            if (casters >> other & 1u) == 1u {
                let from_other = origin_camera - bodies[other].center_from_first_m;
                if is_blocked(other, to_body(other, from_other), to_body(other, direction_camera)) {
                    return false;
                }
            }
        }
    }
    return true;
}

/// How the Sun is looked at from a point.
struct Sunlight {
    /// Points of the disc that are tried: first, first + step, ... below count.
    first: u32,
    step: u32,
    count: u32,
    /// Turn of their pattern.
    turn: f32,
    /// How it is tried.
    mode: u32,
}

/// Nothing is taken as hiding the Sun, and `Sample.in_doubt` says where something may.
const SUN_ASSUMED: u32 = 0u;
/// The disc's lowest and highest point over the surface; with other bodies about, its sides and
/// its middle too. All seen: the whole disc is; none: nothing of it.
const SUN_PROBED: u32 = 1u;
/// Points all over the disc.
const SUN_SAMPLED: u32 = 2u;

/// Shades the point where `ray` meets the plane of `triangle`.
fn shade(triangle: u32, ray: Ray, sample_size_px: f32, sunlight: Sunlight) -> Sample {
    let corners = triangle_at(triangle);
    let surface = surface_at(corners.w);
    let body = surface.body;
    let origin_a = corner_at(triangle, 0u).xyz;
    let ab = corner_at(triangle, 1u).xyz - origin_a;
    let ac = corner_at(triangle, 2u).xyz - origin_a;
    let area_vector = cross(ab, ac);
    let facing = dot(area_vector, ray.direction);
    let t = dot(area_vector, origin_a - ray.origin) / facing;
    let point = ray.origin + ray.direction * t;
    let area = length(area_vector);
    var geometric = area_vector / area;
    // Weights of b and c; a sample may graze the triangle's edge by the rasteriser's rounding.
    let from_a = point - origin_a;
    let weight_b = clamp(dot(cross(from_a, ac), geometric) / area, 0.0, 1.0);
    let weight_c = clamp(dot(cross(ab, from_a), geometric) / area, 0.0, 1.0 - weight_b);

    let to_observer = -normalize(ray.direction);
    let has_map = surface.albedo_map != NONE || surface.slope_map != NONE;
    var normal = geometric;
    var uv = vec2<f32>(0.0);
    var uv_ab = vec2<f32>(0.0);
    var uv_ac = vec2<f32>(0.0);
    if has_map || (surface.flags & FLAT) == 0u {
        let a = vertex_at(corners.x);
        let b = vertex_at(corners.y);
        let c = vertex_at(corners.z);
        if (surface.flags & FLAT) == 0u {
            normal = normalize(a.normal + (b.normal - a.normal) * weight_b + (c.normal - a.normal) * weight_c);
        }
        uv_ab = vec2<f32>(b.u - a.u, b.v - a.v);
        uv_ac = vec2<f32>(c.u - a.u, c.v - a.v);
        uv = vec2<f32>(a.u, a.v) + uv_ab * weight_b + uv_ac * weight_c;
    }
    if (surface.flags & TWO_SIDED) != 0u && dot(geometric, to_observer) < 0.0 {
        geometric = -geometric;
        normal = -normal;
    }

    let depth = bodies[body].reference_depth_m + t;
    var map_factor = surface.albedo_factor;
    if has_map {
        // Where the plane's point moves when the pixel position does by one sample.
        let step = depth * sample_size_px / frame.intrinsics_px.xy;
        let along = ray.direction / dot(ray.direction, geometric);
        let right = body_x_of_camera(body) * step.x;
        let down = body_y_of_camera(body) * step.y;
        let move_x = right - along * dot(right, geometric);
        let move_y = down - along * dot(down, geometric);
        let footprint = Footprint(
            uv,
            uv_ab * (dot(cross(move_x, ac), geometric) / area) + uv_ac * (dot(cross(ab, move_x), geometric) / area),
            uv_ab * (dot(cross(move_y, ac), geometric) / area) + uv_ac * (dot(cross(ab, move_y), geometric) / area),
        );
        if surface.albedo_map != NONE {
            map_factor *= albedo(surface.albedo_map, footprint);
        }
        if surface.slope_map != NONE {
            // Tangent along growing u, bitangent along falling v (glTF), by the triangle's own uv.
            let turn_sign = sign(uv_ab.x * uv_ac.y - uv_ab.y * uv_ac.x);
            var tangent = (ab * uv_ac.y - ac * uv_ab.y) * turn_sign;
            tangent = normalize(tangent - normal * dot(normal, tangent));
            let bitangent = -cross(normal, tangent) * turn_sign;
            let tilt = slope(surface.slope_map, footprint);
            normal = normalize(normal + tangent * tilt.x + bitangent * tilt.y);
        }
    }

    // What is seen faces the observer, also where the smooth normal of a facet at the limb does not.
    let mu = max(dot(normal, to_observer), 1.0e-3);
    let sun = normalize(bodies[body].sun_direction - point * bodies[body].inverse_sun_distance);
    let cos_phase = dot(sun, to_observer);
    let radius = bodies[body].sun_angular_radius;
    let elevation = dot(normal, sun);
    var value = 0.0;
    var lit = 0.0;
    var in_doubt = 0.0;
    if elevation > -radius && dot(geometric, sun) > -radius {
        let horizon = horizon_at(triangle);
        let own_relief = dot(horizon.xyz, sun) < horizon.w + radius;
        let tracing = own_relief || bodies[body].shadow_casters != 0u;
        if !tracing || sunlight.mode == SUN_ASSUMED {
            value = radiance_factor(body, elevation, mu, cos_phase);
            lit = 1.0;
            in_doubt = select(0.0, 1.0, tracing);
        } else {
            // From the corners: nearer to the triangle's plane than a point found along the ray.
            let start = origin_a + ab * weight_b + ac * weight_c + geometric * bodies[body].ray_offset_m;
            let tan_radius = tan(radius);
            let probing = sunlight.mode == SUN_PROBED;
            // Axes across the Sun's direction; `up` is away from the surface.
            let up = normalize(normal - sun * elevation + 1.0e-6 * bodies[body].sun_across);
            let side = cross(sun, up);
            let points = select(sunlight.count, select(2u, 5u, bodies[body].shadow_casters != 0u), probing);
            var count = 0.0;
            for (var k = select(sunlight.first, 0u, probing); k < points; k += select(sunlight.step, 1u, probing)) {
                var place = rim_point(k);
                if !probing {
                    place = disc_point(k, points, sunlight.turn);
                }
                let direction = normalize(sun + (place.x * side + place.y * up) * tan_radius);
                count += 1.0;
                let mu0 = dot(normal, direction);
                if mu0 > 0.0 && dot(geometric, direction) > 0.0 && sees_sun(body, start, direction, own_relief) {
                    value += radiance_factor(body, mu0, mu, cos_phase);
                    lit += 1.0;
                    // Over relief alone, what sees the lowest point sees the rest.
                    if probing && points == 2u {
                        break;
                    }
                }
            }
            value /= count;
            lit /= count;
        }
    }
    var sample = Sample(
        value * map_factor * bodies[body].sun_irradiance_over_pi,
        value * map_factor,
        1.0,
        depth,
        vec3<f32>(0.0),
        0.0,
        0.0,
        0.0,
        1.0 - lit,
        value,
        in_doubt,
    );
    if LAYERS {
        sample.normal = to_camera(body, normal);
        sample.incidence = acos(clamp(elevation, -1.0, 1.0));
        sample.emission = acos(clamp(mu, -1.0, 1.0));
        sample.phase = acos(clamp(cos_phase, -1.0, 1.0));
    }
    return sample;
}
