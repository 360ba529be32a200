//! A body's constants in text PCK kernels: radii, pole and prime meridian (NAIF, PCK Required Reading).

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use retina_files::InputError;

use super::text::Pool;
use crate::orientation::RotationalElements;
use crate::{CENTURY_D, DAY_S};

/// Most terms of a body's series: pck00011.tpc has 18 of Jupiter's and 13 of the Moon's.
const MOST_TERMS: usize = 1000;
/// Julian date of J2000, the epoch of the constants.
const EPOCH_JD: f64 = crate::time::J2000_JD;

/// A body's north pole and prime meridian as polynomials and series, degrees.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Turning {
    /// Right ascension and declination of the pole in centuries, the prime meridian in days: 1, T, T^2.
    polynomials: [Vec<f64>; 3],
    /// What each angle adds: right ascension by its sine, declination by its cosine, meridian by its sine.
    amplitudes: [Vec<f64>; 3],
    /// The angles, polynomials in centuries.
    angles: Vec<Vec<f64>>,
}

/// What text kernels say of a body.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Constants {
    pub(super) radii_km: Option<[f64; 3]>,
    pub(super) turning: Option<Turning>,
}

/// The constants of all bodies in the pool, by NAIF's number.
///
/// # Errors
/// A variable does not fit, or a body's pole and meridian are not complete.
pub(super) fn constants(pool: &Pool) -> Result<BTreeMap<i32, Constants>, InputError> {
    let mut found: BTreeMap<i32, Constants> = BTreeMap::new();
    for name in pool.variables.keys() {
        let Some((body, item)) = name.strip_prefix("BODY").and_then(|rest| rest.split_once('_')) else {
            continue;
        };
        let Ok(body) = body.parse::<i32>() else { continue };
        let own = found.entry(body).or_default();
        match item {
            "RADII" => own.radii_km = Some(radii_km(pool, name)?),
            "POLE_RA" | "POLE_DEC" | "PM" if own.turning.is_none() => {
                own.turning = Some(turning(pool, body, name)?);
            }
            _ => {}
        }
    }
    found.retain(|_, own| *own != Constants::default());
    Ok(found)
}

fn radii_km(pool: &Pool, name: &str) -> Result<[f64; 3], InputError> {
    // SPICE takes what is left out as the last one.
    let radii = pool.numbers(name, 1..=3)?.unwrap_or_default();
    let all: [f64; 3] = std::array::from_fn(|axis| radii[axis.min(radii.len() - 1)]);
    // 1e-6 km is a millimetre, 1e7 km more than any star's near us.
    if all.iter().all(|radius| (1e-6..=1e7).contains(radius)) {
        return Ok(all);
    }
    Err(pool.variables[name].error(name, "no radii").found(format!("{all:?} km")).expected("1e-6 to 1e7 km"))
}

fn turning(pool: &Pool, body: i32, because_of: &str) -> Result<Turning, InputError> {
    let of = |item: &str| format!("BODY{body}_{item}");
    let complete = |item: &str, counts: RangeInclusive<usize>| {
        pool.numbers(&of(item), counts)?.ok_or_else(|| {
            pool.variables[because_of]
                .error(because_of, "the body's pole and meridian are not complete")
                .found(format!("no {}", of(item)))
                .expected(format!("{}, {} and {}", of("POLE_RA"), of("POLE_DEC"), of("PM")))
        })
    };
    let polynomials = [complete("POLE_RA", 1..=3)?, complete("POLE_DEC", 1..=3)?, complete("PM", 1..=3)?];
    let system = system_of(body);
    for owner in [body, system] {
        let epoch = format!("BODY{owner}_CONSTANTS_JED_EPOCH");
        if pool.numbers(&epoch, 1..=1)?.is_some_and(|found| found[0] != EPOCH_JD) {
            return Err(pool.variables[&epoch]
                .error(&epoch, "constants of another epoch are not read")
                .expected(EPOCH_JD));
        }
        let frame = format!("BODY{owner}_CONSTANTS_REF_FRAME");
        if pool.integer(&frame)?.is_some_and(|found| found != super::bpc::J2000) {
            return Err(pool.variables[&frame]
                .error(&frame, "constants along other axes are not read")
                .expected("1, J2000"));
        }
    }
    let amplitudes = ["NUT_PREC_RA", "NUT_PREC_DEC", "NUT_PREC_PM"]
        .map(|item| pool.numbers(&of(item), 1..=MOST_TERMS).map(Option::unwrap_or_default));
    let [ra, dec, pm] = amplitudes;
    let amplitudes = [ra?, dec?, pm?];
    let degree_name = format!("BODY{system}_MAX_PHASE_DEGREE");
    let degree = pool.integer(&degree_name)?.unwrap_or(1);
    let Some(each) = usize::try_from(degree).ok().filter(|degree| (1..=3).contains(degree)).map(|n| n + 1)
    else {
        return Err(pool.variables[&degree_name]
            .error(&degree_name, "no degree")
            .found(degree)
            .expected("1 to 3"));
    };
    let angles_name = format!("BODY{system}_NUT_PREC_ANGLES");
    let flat = pool.numbers(&angles_name, 1..=MOST_TERMS * each)?.unwrap_or_default();
    if !flat.len().is_multiple_of(each) {
        return Err(pool.variables[&angles_name]
            .error(&angles_name, "the angles are not complete")
            .found(format!("{} numbers", flat.len()))
            .expected(format!("{each} for each angle")));
    }
    let angles: Vec<Vec<f64>> = flat.chunks_exact(each).map(<[f64]>::to_vec).collect();
    for (item, own) in ["NUT_PREC_RA", "NUT_PREC_DEC", "NUT_PREC_PM"].iter().zip(&amplitudes) {
        if own.len() > angles.len() {
            return Err(pool.variables[&of(item)]
                .error(&of(item), "there are more terms than angles")
                .found(own.len())
                .expected(format!("{} at most, the angles of {angles_name}", angles.len())));
        }
    }
    Ok(Turning { polynomials, amplitudes, angles })
}

/// Whose angles a body's series go with: its planet's system's, or its own (PCK Required Reading).
fn system_of(body: i32) -> i32 {
    match body {
        100..=999 => body / 100,
        10_000..=99_999 => body / 10_000,
        _ => body,
    }
}

impl Turning {
    /// The elements at an epoch, TDB seconds since J2000.
    pub(super) fn elements(&self, tdb_s: f64) -> RotationalElements {
        let days = tdb_s / DAY_S;
        let centuries = days / CENTURY_D;
        let polynomial =
            |own: &[f64], x: f64| own.iter().rev().fold(0.0, |sum, coefficient| coefficient + x * sum);
        let angles: Vec<f64> =
            self.angles.iter().map(|angle| polynomial(angle, centuries).to_radians()).collect();
        let series = |own: &[f64], wave: fn(f64) -> f64| -> f64 {
            own.iter().zip(&angles).map(|(amplitude, angle)| amplitude * wave(*angle)).sum()
        };
        let [ra, dec, pm] = &self.polynomials;
        let [ra_terms, dec_terms, pm_terms] = &self.amplitudes;
        RotationalElements::from_degrees(
            polynomial(ra, centuries) + series(ra_terms, f64::sin),
            polynomial(dec, centuries) + series(dec_terms, f64::cos),
            polynomial(pm, days) + series(pm_terms, f64::sin),
        )
    }
}
