//! Hapke's law; see hapke.rs. Parameters: w, b, c, B_S0; h_S, B_C0, h_C, roughness in rad; porosity factor K.

fn hapke_h(x: f32, w: f32) -> f32 {
    let gamma = sqrt(1.0 - w);
    let r0 = (1.0 - gamma) / (1.0 + gamma);
    return 1.0 / (1.0 - w * x * (r0 + 0.5 * (1.0 - 2.0 * r0 * x) * log((1.0 + x) / x)));
}

fn hapke_lobe(b: f32, cosine: f32) -> f32 {
    let d = 1.0 - 2.0 * b * cosine + b * b;
    return (1.0 - b * b) / (d * sqrt(d));
}

struct HapkeRough {
    mu0: f32,
    mu: f32,
    shadowing: f32,
}

fn hapke_e1(cot_theta: f32, c: f32, s: f32) -> f32 {
    return exp(-2.0 / PI * cot_theta * c / s);
}

fn hapke_e2(cot_theta: f32, c: f32, s: f32) -> f32 {
    let x = cot_theta * c / s;
    return exp(-x * x / PI);
}

fn hapke_roughness(theta: f32, mu0: f32, mu: f32, cos_phase: f32) -> HapkeRough {
    if theta < 1.0e-6 {
        return HapkeRough(mu0, mu, 1.0);
    }
    let tan_theta = tan(theta);
    let cot = 1.0 / tan_theta;
    let chi = 1.0 / sqrt(1.0 + PI * tan_theta * tan_theta);
    let sin_i = sqrt(max(1.0 - mu0 * mu0, 1.0e-12));
    let sin_e = sqrt(max(1.0 - mu * mu, 1.0e-12));
    let cos_psi = clamp((cos_phase - mu0 * mu) / (sin_i * sin_e), -1.0, 1.0);
    let psi = acos(cos_psi);
    let sin2_half = 0.5 * (1.0 - cos_psi);
    let swapped = mu0 < mu;
    let c_low = max(mu0, mu);
    let c_high = min(mu0, mu);
    let s_low = select(sin_i, sin_e, swapped);
    let s_high = select(sin_e, sin_i, swapped);
    let e1_low = hapke_e1(cot, c_low, s_low);
    let e1_high = hapke_e1(cot, c_high, s_high);
    let e2_low = hapke_e2(cot, c_low, s_low);
    let e2_high = hapke_e2(cot, c_high, s_high);
    let eta_low = chi * (c_low + s_low * tan_theta * e2_low / (2.0 - e1_low));
    let eta_high = chi * (c_high + s_high * tan_theta * e2_high / (2.0 - e1_high));
    let denominator = 2.0 - e1_high - psi / PI * e1_low;
    let low = chi * (c_low + s_low * tan_theta * (cos_psi * e2_high + sin2_half * e2_low) / denominator);
    let high = chi * (c_high + s_high * tan_theta * (e2_high - sin2_half * e2_low) / denominator);
    let f = exp(-2.0 * sqrt(max((1.0 - cos_psi) / (1.0 + cos_psi + 1.0e-12), 0.0)));
    let mue = select(high, low, swapped);
    let eta_i = select(eta_low, eta_high, swapped);
    let eta_e = select(eta_high, eta_low, swapped);
    let shadowing = mue / eta_e * mu0 / eta_i * chi / (1.0 - f + f * chi * c_low / eta_low);
    return HapkeRough(select(low, high, swapped), mue, shadowing);
}

fn law_hapke(body: u32, mu0: f32, mu: f32, phase: f32, cos_phase: f32) -> f32 {
    let a = bodies[body].law_parameters[0];
    let b = bodies[body].law_parameters[1];
    let porosity = bodies[body].law_parameters[2].x;
    let rough = hapke_roughness(b.w, mu0, mu, cos_phase);
    let tan_half = tan(0.5 * phase);
    let p = 0.5 * (1.0 + a.z) * hapke_lobe(a.y, cos_phase)
        + 0.5 * (1.0 - a.z) * hapke_lobe(a.y, -cos_phase);
    let shoe = a.w / (1.0 + tan_half / b.x);
    let x = tan_half / b.z;
    let decay = select(1.0, (1.0 - exp(-x)) / x, x > 1.0e-4);
    let cboe = b.y * 0.5 * (1.0 + decay) / ((1.0 + x) * (1.0 + x));
    let multiple = hapke_h(rough.mu0 / porosity, a.x) * hapke_h(rough.mu / porosity, a.x) - 1.0;
    return porosity * a.x / 4.0 * rough.mu0 / (rough.mu0 + rough.mu)
        * (p * (1.0 + shoe) + multiple) * (1.0 + cboe) * rough.shadowing;
}
