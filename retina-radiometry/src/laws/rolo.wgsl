//! ROLO's law; see rolo.rs. Parameters: C0, C1, nothing, A0; A1 to A4.

fn law_rolo(body: u32, mu0: f32, mu: f32, phase: f32, cos_phase: f32) -> f32 {
    let c = bodies[body].law_parameters[0];
    let p = bodies[body].law_parameters[1];
    let a = degrees(phase);
    let f = c.x * exp(-c.y * a) + c.w + a * (p.x + a * (p.y + a * (p.z + a * p.w)));
    return mu0 / (mu0 + mu) * max(f, 0.0);
}
