//! A photometric law at a fragment's phase angle. Where a law is a mixture of Lambert's and Lommel and Seeliger's, its shares
//! are tabulated once a frame: phase angles differ little over a body, and each fragment has its own.

use retina_radiometry::{Geometry, Photometry};

/// The law at one phase angle.
#[derive(Clone, Copy)]
pub(crate) enum Law {
    /// a mu0 + b mu0 / (mu0 + mu).
    Mixture([f32; 2]),
    /// Any other.
    Whole(f64),
}

impl Law {
    /// What has no light.
    pub(crate) const DARK: Self = Self::Mixture([0.0; 2]);

    fn of(photometry: &Photometry, phase_rad: f64) -> Self {
        shares(photometry, phase_rad).map_or(Self::Whole(phase_rad), Self::Mixture)
    }

    /// I/F without the texture, at cosines of incidence and emission.
    #[inline(always)]
    pub(crate) fn radiance_factor(&self, photometry: &Photometry, mu0: f32, mu: f32) -> f32 {
        if mu0 <= 0.0 {
            return 0.0;
        }
        match *self {
            Self::Mixture([a, b]) => a * mu0 + b * mu0 / (mu0 + mu),
            Self::Whole(phase_rad) => {
                let geometry = Geometry { mu0: f64::from(mu0), mu: f64::from(mu), phase_rad };
                photometry.radiance_factor(geometry) as f32
            }
        }
    }
}

/// Shares of the two laws, with the phase function and the factor in them.
fn shares(photometry: &Photometry, phase_rad: f64) -> Option<[f32; 2]> {
    let shares = photometry.law.lambert_and_seeliger(phase_rad)?;
    let factor = photometry.factor * photometry.phase_function.value(phase_rad);
    Some(shares.map(|share| (share * factor) as f32))
}

/// Distance of the table's places, in sin(phase / 2).
const STEP: f64 = 2e-4;
/// Between its places a table may be off by this part; laws that change faster are computed each time.
const SLACK: f32 = 1e-5;

/// The law at phase angles about a body's own.
pub(crate) struct Laws<'a> {
    photometry: &'a Photometry,
    first: f32,
    /// At sin(phase / 2) = `first` + k `STEP`. Of the phase's own functions this one is smooth at 0, and cheap.
    table: Vec<[f32; 2]>,
}

impl<'a> Laws<'a> {
    /// For phase angles of `phase_rad` within `spread_rad`.
    pub(crate) fn new(photometry: &'a Photometry, phase_rad: f64, spread_rad: f64) -> Self {
        let [low, high] = [phase_rad - spread_rad, phase_rad + spread_rad]
            .map(|phase| (0.5 * phase.clamp(0.0, std::f64::consts::PI)).sin());
        let places = ((high - low) / STEP) as usize + 3;
        let at = |place: f64| {
            let half_sine = (low + (place - 1.0) * STEP).clamp(0.0, 1.0);
            shares(photometry, 2.0 * half_sine.asin())
        };
        let mut table: Vec<[f32; 2]> = (0..places).map_while(|k| at(k as f64)).collect();
        let smooth = table.windows(2).enumerate().all(|(k, pair)| {
            let close = |exact: [f32; 2]| {
                let scale = exact[0].abs() + exact[1].abs();
                (0..2).all(|i| (0.5 * (pair[0][i] + pair[1][i]) - exact[i]).abs() <= SLACK * scale)
            };
            at(k as f64 + 0.5).is_some_and(close)
        });
        if !smooth {
            table.clear();
        }
        Self { photometry, first: (low - STEP) as f32, table }
    }

    #[inline(always)]
    pub(crate) fn at(&self, cos_phase: f32) -> Law {
        let half_sine = (0.5 - 0.5 * cos_phase.clamp(-1.0, 1.0)).sqrt();
        let place = (half_sine - self.first) * (1.0 / STEP) as f32;
        let (below, part) = (place as usize, place.fract());
        match (self.table.get(below), self.table.get(below + 1)) {
            (Some(a), Some(b)) if place >= 0.0 => {
                Law::Mixture(std::array::from_fn(|k| a[k] + part * (b[k] - a[k])))
            }
            _ => Law::of(self.photometry, f64::from(cos_phase.clamp(-1.0, 1.0)).acos()),
        }
    }
}

#[cfg(test)]
mod tests {
    use retina_radiometry::phase_functions::Exponential;
    use retina_radiometry::{Lambert, LunarLambert, PhaseFunction};

    use super::*;

    /// The table follows laws with a steep opposition surge, gives way where they are steeper, and what lies beyond it is the
    /// law itself.
    #[test]
    fn a_tabulated_law_is_the_law() {
        let moon = LunarLambert { decay_rad: 60f64.to_radians() };
        let scale = |deg: f64| Exponential { scale_rad: deg.to_radians() };
        for (photometry, tabulated) in [
            (Photometry::new(moon, scale(5.0), Some(0.12)), true),
            (Photometry::new(moon, scale(0.01), Some(0.12)), false),
            (Photometry::new(Lambert, PhaseFunction::CONSTANT, Some(0.3)), true),
        ] {
            let laws = Laws::new(&photometry, 0.3, 0.5);
            assert_eq!(!laws.table.is_empty(), tabulated);
            for k in 1..2900u32 {
                let phase = f64::from(k) * 1e-3;
                let cosine = phase.cos() as f32;
                // What the cosine's own digits leave of the angle.
                let seen = f64::from(cosine).acos();
                let [found, exact] = [laws.at(cosine), Law::of(&photometry, seen)]
                    .map(|law| law.radiance_factor(&photometry, 0.6, 0.7));
                assert!((found - exact).abs() <= 2.5e-5 * exact, "{phase}: {found} {exact}");
            }
        }
    }
}
