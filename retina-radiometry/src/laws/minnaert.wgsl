//! Minnaert's law; see minnaert.rs. Parameter: k.

fn law_minnaert(body: u32, mu0: f32, mu: f32, phase: f32, cos_phase: f32) -> f32 {
    let k = bodies[body].law_parameters[0].x;
    return pow(mu0, k) * pow(mu, k - 1.0);
}
