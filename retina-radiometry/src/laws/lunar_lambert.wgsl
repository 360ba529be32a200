//! McEwen's law; see lunar_lambert.rs. Parameter: the decay angle, rad.

fn law_lunar_lambert(body: u32, mu0: f32, mu: f32, phase: f32, cos_phase: f32) -> f32 {
    let l = exp(-phase / bodies[body].law_parameters[0].x);
    return l * 2.0 * mu0 / (mu0 + mu) + (1.0 - l) * mu0;
}
