//! Magnitudes and sunlight at 550 nm.

/// Spectral irradiance of a star of magnitude zero, W m^-2 nm^-1 (paper, eq. 7).
pub const ZERO_MAGNITUDE_W_M2_NM: f64 = 3.67e-11;
/// The Sun's spectral irradiance at 1 au and 550 nm, W m^-2 nm^-1 (V = -26.76 on eq. 7's scale).
pub const SUN_IRRADIANCE_1AU_W_M2_NM: f64 = 1.856;
/// The astronomical unit, m (IAU 2012 resolution B2).
pub const AU_M: f64 = 149_597_870_700.0;
/// Nominal solar radius, m (IAU 2015 resolution B3).
pub const SUN_RADIUS_M: f64 = 6.957e8;

/// I = I_0 10^(-m / 2.5) (paper, eq. 7), W m^-2 nm^-1.
pub fn irradiance_of_magnitude_w_m2_nm(magnitude: f64) -> f64 {
    ZERO_MAGNITUDE_W_M2_NM * 10f64.powf(-magnitude / 2.5)
}

/// m = -2.5 log10(I / I_0), the inverse of eq. 7; infinite for no light.
pub fn magnitude_of_irradiance(irradiance_w_m2_nm: f64) -> f64 {
    -2.5 * (irradiance_w_m2_nm / ZERO_MAGNITUDE_W_M2_NM).log10()
}

/// The Sun's spectral irradiance at 550 nm at a distance, by the inverse square, W m^-2 nm^-1.
pub fn sun_irradiance_w_m2_nm(distance_m: f64) -> f64 {
    SUN_IRRADIANCE_1AU_W_M2_NM * (AU_M / distance_m).powi(2)
}

/// Angular radius of the Sun's disc at a distance, rad: asin(R / d).
pub fn sun_angular_radius_rad(distance_m: f64) -> f64 {
    (SUN_RADIUS_M / distance_m).min(1.0).asin()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_is_minus_26_76() {
        assert!((magnitude_of_irradiance(SUN_IRRADIANCE_1AU_W_M2_NM) + 26.76).abs() < 0.001);
        assert!((sun_irradiance_w_m2_nm(2.0 * AU_M) * 4.0 - SUN_IRRADIANCE_1AU_W_M2_NM).abs() < 1e-12);
        // Mean angular diameter of the Sun seen from the Earth: 1919 arcsec.
        assert!((sun_angular_radius_rad(AU_M).to_degrees() * 7200.0 - 1919.0).abs() < 1.0);
    }

    #[test]
    fn a_full_moon_pixel_is_what_the_contract_says() {
        // Radiance 0.12 E / pi, times a pixel of 1 / f^2: -4.45 mag (wide), -2.95 (narrow).
        for (focal_px, magnitude) in [(5661.0, -4.45), (11_322.0, -2.95)] {
            let irradiance = 0.12 * SUN_IRRADIANCE_1AU_W_M2_NM / std::f64::consts::PI / (focal_px * focal_px);
            assert!((magnitude_of_irradiance(irradiance) - magnitude).abs() < 0.01);
        }
    }
}
