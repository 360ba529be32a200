//! Henyey's and Greenstein's phase function; see henyey_greenstein.rs. Parameter: g.

fn phase_henyey_greenstein(body: u32, phase: f32, cos_phase: f32) -> f32 {
    let g = bodies[body].phase_parameters.x;
    let ratio = (1.0 + g) * (1.0 + g) / (1.0 + 2.0 * g * cos_phase + g * g);
    return ratio * sqrt(ratio);
}
