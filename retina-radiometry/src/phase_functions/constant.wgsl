//! No phase function; see constant.rs.

fn phase_constant(body: u32, phase: f32, cos_phase: f32) -> f32 {
    return 1.0;
}
