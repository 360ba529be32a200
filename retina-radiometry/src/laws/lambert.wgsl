//! Lambert's law; see lambert.rs.

fn law_lambert(body: u32, mu0: f32, mu: f32, phase: f32, cos_phase: f32) -> f32 {
    return mu0;
}
