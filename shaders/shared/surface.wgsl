//! One sample: what a ray that hit a triangle sees.

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
}

fn sky() -> Sample {
    return Sample(0.0, 0.0, 0.0, 0.0, vec3<f32>(0.0), 0.0, 0.0, 0.0, 0.0);
}

/// Point k of n spread evenly over the unit disc (sunflower spiral), turned by `turn`.
fn disc_point(k: u32, n: u32, turn: f32) -> vec2<f32> {
    let angle = 2.39996323 * f32(k) + turn;
    return sqrt((f32(k) + 0.5) / f32(n)) * vec2<f32>(cos(angle), sin(angle));
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

/// Shades the point where `ray` meets the plane of `triangle`. The Sun's disc is sampled at
/// points first_sun, first_sun + sun_step, ... below sun_points.
fn shade(triangle: u32, ray: Ray, sample_size_px: f32, first_sun: u32, sun_step: u32, sun_points: u32, turn: f32) -> Sample {
    let corners = triangle_at(triangle);
    let surface = surface_at(corners.w);
    let body = surface.body;
    let a = vertex_at(corners.x);
    let b = vertex_at(corners.y);
    let c = vertex_at(corners.z);
    let ab = b.position - a.position;
    let ac = c.position - a.position;
    let area_vector = cross(ab, ac);
    let facing = dot(area_vector, ray.direction);
    let t = dot(area_vector, a.position - ray.origin) / facing;
    let point = ray.origin + ray.direction * t;
    let area = length(area_vector);
    var geometric = area_vector / area;
    // Weights of b and c; a sample may graze the triangle's edge by the rasteriser's rounding.
    let from_a = point - a.position;
    let weight_b = clamp(dot(cross(from_a, ac), geometric) / area, 0.0, 1.0);
    let weight_c = clamp(dot(cross(ab, from_a), geometric) / area, 0.0, 1.0 - weight_b);
    let weight_a = 1.0 - weight_b - weight_c;

    let to_observer = -normalize(ray.direction);
    var normal = geometric;
    if (surface.flags & FLAT) == 0u {
        normal = normalize(a.normal * weight_a + b.normal * weight_b + c.normal * weight_c);
    }
    if (surface.flags & TWO_SIDED) != 0u && dot(geometric, to_observer) < 0.0 {
        geometric = -geometric;
        normal = -normal;
    }

    let depth = bodies[body].reference_depth_m + t;
    var map_factor = surface.albedo_factor;
    if surface.albedo_map != NONE || surface.slope_map != NONE {
        let uv_ab = vec2<f32>(b.u - a.u, b.v - a.v);
        let uv_ac = vec2<f32>(c.u - a.u, c.v - a.v);
        let uv = vec2<f32>(a.u, a.v) + uv_ab * weight_b + uv_ac * weight_c;
        let across_m = depth * sample_size_px / frame.intrinsics_px.x;
        let uv_area = abs(uv_ab.x * uv_ac.y - uv_ab.y * uv_ac.x);
        let slant = max(abs(dot(geometric, to_observer)), 0.02);
        let footprint_uv2 = across_m * across_m * dot(ray.direction, ray.direction) / slant * uv_area / area;
        if surface.albedo_map != NONE {
            map_factor *= albedo(surface.albedo_map, uv, footprint_uv2);
        }
        if surface.slope_map != NONE {
            // Tangent along growing u, bitangent along falling v (glTF), by the triangle's own uv.
            let turn_sign = sign(uv_ab.x * uv_ac.y - uv_ab.y * uv_ac.x);
            var tangent = (ab * uv_ac.y - ac * uv_ab.y) * turn_sign;
            tangent = normalize(tangent - normal * dot(normal, tangent));
            let bitangent = -cross(normal, tangent) * turn_sign;
            let tilt = slope(surface.slope_map, uv, footprint_uv2);
            normal = normalize(normal + tangent * tilt.x + bitangent * tilt.y);
        }
    }

    let mu = dot(normal, to_observer);
    let sun = normalize(bodies[body].sun_direction - point * bodies[body].inverse_sun_distance);
    let cos_phase = dot(sun, to_observer);
    let radius = bodies[body].sun_angular_radius;
    var value = 0.0;
    var lit = 0.0;
    if dot(normal, sun) > -radius {
        let own_relief = dot(normal, sun) < horizon_at(triangle) + radius;
        if !own_relief && bodies[body].shadow_casters == 0u {
            value = radiance_factor(body, dot(normal, sun), mu, cos_phase);
            lit = 1.0;
        } else {
            let origin = point + geometric * bodies[body].ray_offset_m;
            let tan_radius = tan(radius);
            var count = 0.0;
            for (var k = first_sun; k < sun_points; k += sun_step) {
                let place = disc_point(k, sun_points, turn) * tan_radius;
                let direction = normalize(
                    sun + place.x * bodies[body].sun_across_u + place.y * bodies[body].sun_across_v
                );
                count += 1.0;
                let mu0 = dot(normal, direction);
                if mu0 > 0.0 && dot(geometric, direction) > 0.0 && sees_sun(body, origin, direction, own_relief) {
                    value += radiance_factor(body, mu0, mu, cos_phase);
                    lit += 1.0;
                }
            }
            value /= count;
            lit /= count;
        }
    }
    value *= map_factor;
    return Sample(
        value * bodies[body].sun_irradiance_over_pi,
        value,
        1.0,
        depth,
        to_camera(body, normal),
        acos(clamp(dot(normal, sun), -1.0, 1.0)),
        acos(clamp(mu, -1.0, 1.0)),
        acos(clamp(cos_phase, -1.0, 1.0)),
        1.0 - lit,
    );
}
