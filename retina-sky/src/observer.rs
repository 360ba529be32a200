//! From where a source is to where a camera sees it: light deflection by the Sun, then aberration.
//!
//! The chain is SOFA's (`iauLdsun`, `iauAb`; Urban & Seidelmann, Explanatory Supplement, 3rd edition,
//! chapter 7), for an observer anywhere in the Solar System. Left out: deflection by planets (0.02
//! arcsec at Jupiter's limb) and what the Sun's potential does to aberration (below a microarcsecond).

use glam::DVec3;
use sofars::astro::ld;
use thiserror::Error;

use crate::ephemeris::{ASTRONOMICAL_UNIT_M, Ephemeris, EphemerisError, LIGHT_SPEED_M_S, SolarSystem};

/// Least q . (q + e) in the deflection for an observer within 1 au (SOFA's `iauLdsun`): nearer to the
/// Sun's centre than about 5 arcmin, which is within its disc, the deflection falls to zero.
const DEFLECTION_LIMITER: f64 = 1e-6;

/// An observer for whom no sky can be given.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ObserverError {
    /// The epoch is outside the ephemeris.
    #[error(transparent)]
    Ephemeris(#[from] EphemerisError),
    /// A coordinate is no finite number.
    #[error("the observer's {quantity} must be finite (found {found})")]
    NotFinite {
        /// `position` or `velocity`.
        quantity: &'static str,
        /// The vector found.
        found: DVec3,
    },
    /// Faster than light.
    #[error("the observer moves at {found_m_s} m/s, which light does not reach")]
    TooFast {
        /// The speed found, metres a second.
        found_m_s: f64,
    },
}

/// Who looks: when, from where, and how fast they move.
#[derive(Debug, Clone, PartialEq)]
pub struct Observer {
    tdb_s: f64,
    position_m: DVec3,
    /// In units of the speed of light; zero where there is no aberration.
    beta: DVec3,
    bodies: SolarSystem,
    ephemeris: Ephemeris,
}

impl Observer {
    /// An observer at an epoch (TDB seconds since J2000), at a barycentric ICRF position (metres), with
    /// a barycentric velocity (metres a second). Without a velocity there is no aberration. The Sun and all planets
    /// are where the ephemeris has them.
    ///
    /// # Errors
    /// The epoch is outside the ephemeris, a coordinate is not finite, the speed is not below light's.
    pub fn new(
        ephemeris: &Ephemeris,
        tdb_s: f64,
        position_m: DVec3,
        velocity_m_s: Option<DVec3>,
    ) -> Result<Self, ObserverError> {
        let velocity_m_s = velocity_m_s.unwrap_or(DVec3::ZERO);
        for (quantity, found) in [("position", position_m), ("velocity", velocity_m_s)] {
            if !found.is_finite() {
                return Err(ObserverError::NotFinite { quantity, found });
            }
        }
        let beta = velocity_m_s / LIGHT_SPEED_M_S;
        if beta.length() >= 1.0 {
            return Err(ObserverError::TooFast { found_m_s: velocity_m_s.length() });
        }
        let bodies = ephemeris.solar_system(tdb_s)?;
        Ok(Self { tdb_s, position_m, beta, bodies, ephemeris: ephemeris.clone() })
    }

    /// The epoch, TDB seconds since J2000.
    pub fn tdb_s(&self) -> f64 {
        self.tdb_s
    }

    /// The position, barycentric ICRF metres.
    pub fn position_m(&self) -> DVec3 {
        self.position_m
    }

    /// Where the planets are taken from.
    pub fn ephemeris(&self) -> &Ephemeris {
        &self.ephemeris
    }

    /// Sun, Earth and Moon at the epoch.
    pub fn bodies(&self) -> &SolarSystem {
        &self.bodies
    }

    /// The apparent direction of a star: deflection by the Sun, then aberration. `direction` is a unit
    /// vector to where the star is, ICRF axes, and so is the result.
    pub fn apparent_star(&self, direction: DVec3) -> DVec3 {
        // To an observer in the Solar System a star is as far from the Sun as from himself: q = p.
        self.apparent(direction, direction)
    }

    /// As [`Observer::apparent_star`], for a source at a finite distance: `source_m` is the vector to it
    /// (light-time in it).
    pub fn apparent_source(&self, source_m: DVec3) -> DVec3 {
        let direction = source_m.normalize();
        let from_sun_m = self.position_m + source_m - self.bodies.sun.position_m;
        self.apparent(direction, from_sun_m.try_normalize().unwrap_or(direction))
    }

    fn apparent(&self, direction: DVec3, from_sun: DVec3) -> DVec3 {
        let observer_au = (self.position_m - self.bodies.sun.position_m) / ASTRONOMICAL_UNIT_M;
        aberrated(deflected_by_sun(direction, from_sun, observer_au), self.beta)
    }

    /// The most by which deflection and aberration together move a direction, radians.
    pub(crate) fn greatest_shift_rad(&self) -> f64 {
        // tan(theta' / 2) = sqrt((1 - b) / (1 + b)) tan(theta / 2) differs most from theta where both
        // tangents are each other's inverse.
        let b = self.beta.length();
        let tangent = ((1.0 + b) / (1.0 - b)).powf(0.25);
        let aberration_rad = 2.0 * (0.5 * (tangent - 1.0 / tangent)).atan();
        let distance_au = self.bodies.sun.position_m.distance(self.position_m) / ASTRONOMICAL_UNIT_M;
        aberration_rad + greatest_deflection_rad(distance_au)
    }
}

/// The angle between two vectors, 0 to pi, without the loss that a cosine has at small angles.
pub fn separation_rad(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// The most by which [`deflected_by_sun`] moves a direction, radians: where the limiter sets in, the
/// separation s from the Sun's centre is sqrt(2 limit), and the deflection 2 G M s / (c^2 E limit).
fn greatest_deflection_rad(distance_au: f64) -> f64 {
    const TWO_GM_OVER_C2_AU: f64 = 1.974_125_743_36e-8;
    if distance_au == 0.0 {
        return 0.0;
    }
    let limit = deflection_limit(distance_au);
    1.01 * TWO_GM_OVER_C2_AU / distance_au * (2.0 * limit).sqrt() / limit
}

fn deflection_limit(distance_au: f64) -> f64 {
    DEFLECTION_LIMITER / (distance_au * distance_au).max(1.0)
}

/// Light deflection by the Sun: p1 = p + 2 G M / (c^2 E) (p x (e x q)) / max(q . (q + e), limit), with
/// the unit vectors p from the observer to the source, q from the Sun to the source, e from the Sun to
/// the observer, and E their distance (SOFA's `iauLd`; Klioner 2003). `observer_au` is E e.
pub fn deflected_by_sun(direction: DVec3, from_sun: DVec3, observer_au: DVec3) -> DVec3 {
    let distance_au = observer_au.length();
    let Some(e) = observer_au.try_normalize() else { return direction };
    let limit = deflection_limit(distance_au);
    let (p, q, e) = (direction.to_array(), from_sun.to_array(), e.to_array());
    DVec3::from_array(ld(1.0, p, q, e, distance_au, limit)).normalize()
}

/// Aberration: the direction (unit vector) in which an observer with the velocity `beta` (in units of
/// light's) sees what one at rest sees in `direction`:
/// p' = (p / gamma + beta (1 + p . beta / (1 + 1 / gamma))) / (1 + p . beta), exact in special
/// relativity (Explanatory Supplement, 3rd edition, eq. 7.40).
pub fn aberrated(direction: DVec3, beta: DVec3) -> DVec3 {
    let inverse_gamma = (1.0 - beta.length_squared()).sqrt();
    let along = direction.dot(beta);
    // The denominator 1 + p . beta only scales.
    (direction * inverse_gamma + beta * (1.0 + along / (1.0 + inverse_gamma))).normalize()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;

    fn unit() -> impl Strategy<Value = DVec3> {
        (-1.0_f64..1.0, 0.0_f64..std::f64::consts::TAU).prop_map(|(z, longitude)| {
            let radius = (1.0 - z * z).sqrt();
            DVec3::new(radius * longitude.cos(), radius * longitude.sin(), z)
        })
    }

    #[test]
    fn aberration_is_that_of_sofas_published_check_and_of_the_almanac() {
        // t_sofa_c.c, iauAb, whose s = 0.9998 au term moves it by 1e-12 at most.
        let natural =
            DVec3::new(-0.763_219_685_467_379_5, -0.608_694_539_830_603_8, -0.216_764_085_806_398_83);
        let beta =
            DVec3::new(2.104_401_889_365_378_6e-5, -8.910_892_330_442_932e-5, -3.863_371_479_771_657e-5);
        let expected =
            DVec3::new(-0.763_163_109_421_955_6, -0.608_755_308_250_559_1, -0.216_792_626_936_847_13);
        assert!((aberrated(natural, beta) - expected).abs().max_element() < 2e-12);
        // The constant of aberration, 20.49551 arcsec (IAU 1976), for a speed of 29.7889 km/s and a star
        // at right angles.
        let seen = aberrated(DVec3::X, DVec3::Y * (29_788.9 / LIGHT_SPEED_M_S));
        assert!((separation_rad(seen, DVec3::X) / ARCSEC - 20.4955).abs() < 2e-4);
        assert!(seen.y > 0.0, "stars crowd towards the apex");
    }

    #[test]
    fn deflection_is_that_of_sofas_published_check_and_of_the_suns_limb() {
        // t_sofa_c.c, iauLd with bm = 0.00028574 there: the shift is in proportion.
        let p = DVec3::new(-0.763_276_255, -0.608_633_767, -0.216_735_543);
        let e = DVec3::new(0.767_004_21, 0.605_629_598, 0.211_937_094);
        let expected =
            DVec3::new(-0.763_276_254_896_816, -0.608_633_767_082_376_3, -0.216_735_543_132_054_7) - p;
        let shift = deflected_by_sun(p.normalize(), p.normalize(), e * 8.912_769_83) - p.normalize();
        assert!((shift * 0.000_285_74 - expected).length() < 1e-3 * expected.length(), "{shift} {expected}");
        // 1.75 arcsec at the Sun's limb (959.63 arcsec), 4.07 mas at right angles, as seen from 1 au.
        for (from_sun_rad, arcsec) in [(959.63 * ARCSEC, 1.75), (std::f64::consts::FRAC_PI_2, 0.004_07)] {
            let star = DVec3::new(-from_sun_rad.cos(), from_sun_rad.sin(), 0.0);
            let seen = deflected_by_sun(star, star, DVec3::X);
            assert!((separation_rad(seen, star) / ARCSEC / arcsec - 1.0).abs() < 3e-3);
            assert!(seen.y / seen.x.abs() > star.y / star.x.abs() || from_sun_rad > 1.0, "away from the Sun");
        }
    }

    #[test]
    fn observers_that_cannot_be_are_refused() {
        let at = |tdb_s, position, velocity| Observer::new(&Ephemeris::analytic(), tdb_s, position, velocity);
        assert!(matches!(at(4e9, DVec3::X, None), Err(ObserverError::Ephemeris(_))));
        assert!(matches!(
            at(0.0, DVec3::X * f64::NAN, None),
            Err(ObserverError::NotFinite { quantity: "position", .. })
        ));
        let fast = at(0.0, DVec3::X, Some(DVec3::X * 3e8));
        assert!(matches!(fast, Err(ObserverError::TooFast { .. })));
        assert!(fast.unwrap_err().to_string().contains("300000000 m/s"));
    }

    proptest! {
        #[test]
        fn no_velocity_is_no_aberration(star in unit()) {
            prop_assert!((aberrated(star, DVec3::ZERO) - star).length() < 1e-15);
        }

        #[test]
        fn stars_keep_their_order_and_meridian_about_the_apex(a in unit(), b in unit(), speed in 1e-5_f64..0.9) {
            let beta = DVec3::Z * speed;
            let (seen_a, seen_b) = (aberrated(a, beta), aberrated(b, beta));
            // tan(theta' / 2) = sqrt((1 - b) / (1 + b)) tan(theta / 2), Einstein 1905.
            let half = |v: DVec3| (0.5 * separation_rad(v, DVec3::Z)).tan();
            let factor = ((1.0 - speed) / (1.0 + speed)).sqrt();
            prop_assert!((half(seen_a) / (factor * half(a)) - 1.0).abs() < 1e-6);
            prop_assert!(a.z - b.z < 1e-9 || seen_a.z > seen_b.z);
            prop_assert!((seen_a.x * a.y - seen_a.y * a.x).abs() < 1e-12);
            prop_assert!(seen_a.z >= a.z);
        }

        #[test]
        fn nothing_moves_farther_than_the_bound(star in unit(), place in unit(), au in 0.1_f64..6.0,
                                                velocity in unit(), speed_m_s in 0.0_f64..1e6) {
            let observer = Observer::new(&Ephemeris::analytic(), 0.0, place * au * ASTRONOMICAL_UNIT_M, Some(velocity * speed_m_s)).unwrap();
            let moved = separation_rad(observer.apparent_star(star), star);
            prop_assert!(moved <= observer.greatest_shift_rad() + 1e-12, "{} {}", moved, observer.greatest_shift_rad());
        }
    }
}
