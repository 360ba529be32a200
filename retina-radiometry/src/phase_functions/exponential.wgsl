//! An exponential phase function; see exponential.rs. Parameter: the scale, rad.

fn phase_exponential(body: u32, phase: f32, cos_phase: f32) -> f32 {
    return exp(-phase / bodies[body].phase_parameters.x);
}
