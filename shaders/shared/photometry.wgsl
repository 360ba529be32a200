//! Radiance factor I/F of a surface element. retina-radiometry holds the laws and phase functions; `law_value` and
//! `phase_value`, which choose among them, are generated from its lists.

const PI: f32 = 3.14159265358979;

fn radiance_factor(body: u32, mu0: f32, mu: f32, cos_phase: f32) -> f32 {
    if mu0 <= 0.0 || mu <= 0.0 {
        return 0.0;
    }
    let phase = acos(clamp(cos_phase, -1.0, 1.0));
    return bodies[body].factor * law_value(body, mu0, mu, phase, cos_phase)
        * phase_value(body, phase, cos_phase);
}
