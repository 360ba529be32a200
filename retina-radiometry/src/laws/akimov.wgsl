//! Akimov's disc function; see akimov.rs.

fn law_akimov(body: u32, mu0: f32, mu: f32, phase: f32, cos_phase: f32) -> f32 {
    // acos of an f32 is 0 or at least 3.5e-4; at that phase the disc is flat to some 1e-4.
    if phase < 1.0e-4 {
        return 1.0;
    }
    let x = mu * sin(phase);
    let y = mu0 - mu * cos_phase;
    let h = max(atan2(x, y), 1.0e-20);
    let cos_b = min(sqrt(x * x + y * y) / sin(phase), 1.0);
    let rest = PI - phase;
    return cos(0.5 * phase) * max(sin(PI / rest * h), 0.0) / sin(h) * pow(cos_b, phase / rest);
}
