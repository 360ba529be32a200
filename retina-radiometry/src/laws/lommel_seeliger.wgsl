//! Lommel's and Seeliger's law; see lommel_seeliger.rs.

fn law_lommel_seeliger(body: u32, mu0: f32, mu: f32, phase: f32, cos_phase: f32) -> f32 {
    return 2.0 * mu0 / (mu0 + mu);
}
