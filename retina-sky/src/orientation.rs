//! Body-fixed axes of the IAU Working Group on Cartographic Coordinates and Rotational Elements.
//!
//! Right ascension and declination of the north pole (alpha0, delta0) and the prime meridian's
//! angle W, in degrees, d days and T Julian centuries of TDB after J2000:
//! the Moon's from Archinal et al. (2018), "Report of the IAU WGCCRE: 2015", table 2, all
//! terms (mean Earth/polar axis, within some 150 m of the integrated DE axes); the Earth's from the
//! 2009 report (no nutation, UT1 or polar motion: about 0.05 deg about the axis). Those of Mars,
//! Saturn and Uranus, of the 2009 report too, serve their magnitudes.

use glam::DQuat;

use crate::{CENTURY_D, DAY_S};

/// One argument E of the Moon's series and what it does: E = `at_j2000` + `per_day` d, degrees.
struct LunarTerm {
    at_j2000: f64,
    per_day: f64,
    /// Amplitudes, degrees: alpha0 and W go with sin E, delta0 with cos E.
    alpha: f64,
    delta: f64,
    w: f64,
}

const fn term(at_j2000: f64, per_day: f64, alpha: f64, delta: f64, w: f64) -> LunarTerm {
    LunarTerm { at_j2000, per_day, alpha, delta, w }
}

/// E1 to E13.
const LUNAR_TERMS: [LunarTerm; 13] = [
    term(125.045, -0.052_992_1, -3.8787, 1.5419, 3.5610),
    term(250.089, -0.105_984_2, -0.1204, 0.0239, 0.1208),
    term(260.008, 13.012_000_9, 0.0700, -0.0278, -0.0642),
    term(176.625, 13.340_715_4, -0.0172, 0.0068, 0.0158),
    term(357.529, 0.985_600_3, 0.0, 0.0, 0.0252),
    term(311.589, 26.405_708_4, 0.0072, -0.0029, -0.0066),
    term(134.963, 13.064_993_0, 0.0, 0.0009, -0.0047),
    term(276.617, 0.328_714_6, 0.0, 0.0, -0.0046),
    term(34.226, 1.748_487_7, 0.0, 0.0, 0.0028),
    term(15.134, -0.158_976_3, -0.0052, 0.0008, 0.0052),
    term(119.743, 0.003_609_6, 0.0, 0.0, 0.0040),
    term(239.961, 0.164_357_3, 0.0, 0.0, 0.0019),
    term(25.053, 12.959_008_8, 0.0043, -0.0009, -0.0044),
];

/// A body's north pole and prime meridian, radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotationalElements {
    /// Right ascension of the north pole, ICRF.
    pub alpha0_rad: f64,
    /// Declination of the north pole, ICRF.
    pub delta0_rad: f64,
    /// Angle along the equator from its ascending node on the ICRF equator to the prime meridian.
    pub w_rad: f64,
}

impl RotationalElements {
    /// The Moon's elements at an epoch (TDB seconds since J2000).
    pub fn moon(tdb_s: f64) -> Self {
        let d = tdb_s / DAY_S;
        let t = d / CENTURY_D;
        let mut alpha0 = 269.9949 + 0.0031 * t;
        let mut delta0 = 66.5392 + 0.0130 * t;
        let mut w = 38.3213 + 13.176_358_15 * d - 1.4e-12 * d * d;
        for term in &LUNAR_TERMS {
            let (sin, cos) = (term.at_j2000 + term.per_day * d).to_radians().sin_cos();
            alpha0 += term.alpha * sin;
            delta0 += term.delta * cos;
            w += term.w * sin;
        }
        Self::from_degrees(alpha0, delta0, w)
    }

    /// The Earth's elements at an epoch (TDB seconds since J2000).
    pub fn earth(tdb_s: f64) -> Self {
        let d = tdb_s / DAY_S;
        let t = d / CENTURY_D;
        Self::from_degrees(-0.641 * t, 90.0 - 0.557 * t, 190.147 + 360.985_623_5 * d)
    }

    /// The elements of Mars at an epoch (TDB seconds since J2000), of the 2009 report (good to 0.1 deg).
    pub fn mars(tdb_s: f64) -> Self {
        let d = tdb_s / DAY_S;
        let t = d / CENTURY_D;
        Self::from_degrees(317.681_43 - 0.1061 * t, 52.886_50 - 0.0609 * t, 176.630 + 350.891_982_26 * d)
    }

    /// The elements of Saturn at an epoch (TDB seconds since J2000); W is that of its radio emission.
    pub fn saturn(tdb_s: f64) -> Self {
        let d = tdb_s / DAY_S;
        let t = d / CENTURY_D;
        Self::from_degrees(40.589 - 0.036 * t, 83.537 - 0.004 * t, 38.90 + 810.793_902_4 * d)
    }

    /// The elements of Uranus at an epoch (TDB seconds since J2000); W is that of its magnetic field.
    pub fn uranus(tdb_s: f64) -> Self {
        Self::from_degrees(257.311, -15.175, 203.81 - 501.160_092_8 * tdb_s / DAY_S)
    }

    pub(crate) fn from_degrees(alpha0: f64, delta0: f64, w: f64) -> Self {
        Self {
            alpha0_rad: alpha0.to_radians(),
            delta0_rad: delta0.to_radians(),
            w_rad: w.rem_euclid(360.0).to_radians(),
        }
    }

    /// The rotation from ICRF axes to the body's: x through the prime meridian, z north.
    pub fn body_from_inertial(&self) -> DQuat {
        // Turning the axes by an angle turns the coordinates back by it: hence the minus signs.
        DQuat::from_rotation_z(-self.w_rad)
            * DQuat::from_rotation_x(self.delta0_rad - std::f64::consts::FRAC_PI_2)
            * DQuat::from_rotation_z(-self.alpha0_rad - std::f64::consts::FRAC_PI_2)
    }
}

/// The rotation from ICRF axes to those of `moon`, `earth`, `mars`, `saturn` or `uranus` (x prime
/// meridian, z north) at an epoch in TDB seconds since J2000; `None` for a body not known here.
pub fn body_from_inertial(name: &str, tdb_s: f64) -> Option<DQuat> {
    let elements = match name {
        "moon" => RotationalElements::moon(tdb_s),
        "earth" => RotationalElements::earth(tdb_s),
        "mars" => RotationalElements::mars(tdb_s),
        "saturn" => RotationalElements::saturn(tdb_s),
        "uranus" => RotationalElements::uranus(tdb_s),
        _ => return None,
    };
    Some(elements.body_from_inertial())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ephemeris::Ephemeris;
    use crate::time::parse_epoch;
    use glam::{DMat3, DVec3};

    /// Selenographic longitude and latitude of the Earth's centre, degrees.
    fn sub_earth_deg(tdb_s: f64) -> (f64, f64) {
        let earth_m = -Ephemeris::analytic().moon_from_earth(tdb_s).unwrap().position_m;
        let seen = body_from_inertial("moon", tdb_s).unwrap() * earth_m.normalize();
        (seen.y.atan2(seen.x).to_degrees(), seen.z.asin().to_degrees())
    }

    #[test]
    fn the_moons_axes_are_those_of_cspice() {
        // sxform('IAU_MOON', 'J2000', 14610 days) with pck00011.tpc: rows of inertial_from_body.
        let expected = DMat3::from_cols_array_2d(&[
            [5.720_547_105_837_333e-1, 8.198_082_524_397_307e-1, -2.584_254_884_248_154_6e-2],
            [-7.610_737_698_623_49e-1, 5.187_960_000_245_592e-1, -3.893_808_253_959_481_5e-1],
            [-3.058_106_030_314_734_5e-1, 2.424_152_214_491_336e-1, 9.207_142_528_946_177e-1],
        ]);
        // Read as columns, those rows are the transpose: body_from_inertial.
        let ours = DMat3::from_quat(body_from_inertial("moon", 14_610.0 * DAY_S).unwrap());
        assert!(ours.abs_diff_eq(expected, 1e-11), "{ours} {expected}");
    }

    #[test]
    fn librations_are_those_of_meeus_and_stay_small() {
        // Meeus (1998), example 53.a: 1992 April 12, 0h TD: l = -1.23 deg, b = +4.20 deg, good to the
        // 0.02 deg by which the principal and the mean Earth axes differ.
        let (longitude_deg, latitude_deg) = sub_earth_deg(parse_epoch("1992-04-12").unwrap());
        assert!(
            (longitude_deg + 1.23).abs() < 0.03 && (latitude_deg - 4.20).abs() < 0.03,
            "{longitude_deg} {latitude_deg}"
        );
        let (mut widest, mut highest) = (0.0_f64, 0.0_f64);
        for day in 0..6800 {
            let (longitude_deg, latitude_deg) = sub_earth_deg(f64::from(day) * DAY_S);
            (widest, highest) = (widest.max(longitude_deg.abs()), highest.max(latitude_deg.abs()));
        }
        assert!((7.5..8.2).contains(&widest) && (6.5..7.0).contains(&highest), "{widest} {highest}");
    }

    #[test]
    fn poles_stand_where_cassini_and_the_calendar_want_them() {
        // The lunar pole keeps 1.54 deg from that of the ecliptic; the Earth's is celestial north.
        let ecliptic_pole = DVec3::new(0.0, -0.397_777_155_9, 0.917_482_062_1);
        for year in 0..40 {
            let tdb_s = f64::from(year) * 365.25 * DAY_S;
            let pole = |name| body_from_inertial(name, tdb_s).unwrap().inverse() * DVec3::Z;
            let tilt_deg = pole("moon").angle_between(ecliptic_pole).to_degrees();
            assert!((tilt_deg - 1.543).abs() < 0.04, "{tilt_deg}");
            assert!(pole("earth").angle_between(DVec3::Z).to_degrees() < 0.3);
        }
        // Sidereal time at Greenwich, 1987 April 10, 19h21m UT: 8h34m57.0896s (Meeus, example 12.b);
        // the hour angle of the J2000 equinox lacks the precession in right ascension.
        let tdb_s = parse_epoch("1987-04-10T19:21Z").unwrap();
        let equinox = body_from_inertial("earth", tdb_s).unwrap() * DVec3::X;
        let precession_deg = 4612.4362 / 3600.0 * tdb_s / DAY_S / CENTURY_D;
        let expected_deg = 128.737_873 - precession_deg;
        let off_deg = (-equinox.y).atan2(equinox.x).to_degrees() - expected_deg;
        assert!(off_deg.abs() < 0.1, "{off_deg}");
        assert!(body_from_inertial("phobos", 0.0).is_none());
    }

    #[test]
    fn poles_of_the_ringed_and_the_tilted_planet_are_skyfields() {
        // Skyfield 1.55, magnitudelib: north poles of Saturn and Uranus after the IAU, ICRF.
        for (elements, expected) in [
            (RotationalElements::saturn(0.0), DVec3::new(0.085_478_83, 0.073_235_76, 0.993_644_75)),
            (RotationalElements::uranus(0.0), DVec3::new(-0.211_999_58, -0.941_559_16, -0.261_768_09)),
        ] {
            let pole = elements.body_from_inertial().inverse() * DVec3::Z;
            assert!((pole - expected).length() < 2e-8, "{pole}");
        }
    }
}
