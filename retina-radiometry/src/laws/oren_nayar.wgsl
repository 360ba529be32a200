//! Oren's and Nayar's law; see oren_nayar.rs. Parameter: B / A.

fn law_oren_nayar(body: u32, mu0: f32, mu: f32, phase: f32, cos_phase: f32) -> f32 {
    let excess = max(cos_phase - mu0 * mu, 0.0) / max(mu0, mu);
    return mu0 * (1.0 + bodies[body].law_parameters[0].x * excess);
}
