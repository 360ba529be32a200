//! A phase curve in magnitudes; see magnitudes.rs. Parameters: c1 to c4.

fn phase_magnitudes(body: u32, phase: f32, cos_phase: f32) -> f32 {
    let c = bodies[body].phase_parameters;
    let a = degrees(phase);
    let magnitude = a * (c.x + a * (c.y + a * (c.z + a * c.w)));
    return exp2(-0.4 * 3.32192809 * magnitude);
}
