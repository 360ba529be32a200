//! Position from planets seen at once.

use glam::{DMat3, DVec3};
use retina_sky::ephemeris::{EphemerisTable, LIGHT_SPEED_M_S};
use retina_sky::observer::aberrated;
use retina_sky::planets::Planet;

use super::dynamics::PhaseState;
use super::measurement::{apparent_direction, tangent_axes};

/// A planet's measured line of sight.
#[derive(Debug, Clone, Copy)]
pub struct Beacon {
    /// Which.
    pub planet: Planet,
    /// Apparent direction, unit vector, ICRF axes.
    pub direction: DVec3,
    /// Standard deviation per axis, rad.
    pub sigma_rad: f64,
}

/// A position with its covariance.
#[derive(Debug, Clone, Copy)]
pub struct Fix {
    /// Barycentric ICRF, m.
    pub position_m: DVec3,
    /// m^2.
    pub covariance_m2: DMat3,
    /// Sum of squared weighted residuals; chi-square of 2 n - 3 degrees of freedom.
    pub chi2: f64,
}

/// The position from which planets are seen along the measured lines, by weighted least squares: each line counts by
/// its angular error times its distance (Karimi & Mortari 2015; Henry & Christian 2023), which is found with it, as
/// are light-time and the Sun's deflection. Aberration is that of the velocity given.
///
/// `None` for fewer than two planets or lines that are parallel.
pub fn triangulate(
    ephemeris: &EphemerisTable,
    tdb_s: f64,
    velocity_m_s: DVec3,
    beacons: &[Beacon],
) -> Option<Fix> {
    let beta = velocity_m_s / LIGHT_SPEED_M_S;
    // What one at rest sees: aberration with the opposite velocity, exact to beta^3.
    let lines: Vec<DVec3> = beacons.iter().map(|beacon| aberrated(beacon.direction, -beta)).collect();
    let mut distances_m = vec![2e11; beacons.len()];
    let mut state = PhaseState { position_m: DVec3::ZERO, velocity_m_s };
    // Straight lines to the planets: distances and light-time follow the position.
    for _ in 0..8 {
        let rows = beacons.iter().zip(&lines).zip(&distances_m).map(|((beacon, line), distance_m)| {
            let place = ephemeris.planet(beacon.planet, tdb_s - distance_m / LIGHT_SPEED_M_S);
            (*line, place, 1.0 / (beacon.sigma_rad * distance_m))
        });
        let (information, right) = normal_equations(rows.map(|(line, place, weight)| (line, weight, place)));
        state.position_m = inverse(information)? * right;
        for (beacon, distance_m) in beacons.iter().zip(&mut distances_m) {
            *distance_m = ephemeris.planet(beacon.planet, tdb_s).distance(state.position_m);
        }
    }
    // The lines as they are seen, the Sun's deflection in them: what is left moves the position.
    let (mut covariance_m2, mut chi2) = (DMat3::ZERO, 0.0);
    for round in 0..3 {
        let seen: Vec<(DVec3, f64)> = beacons
            .iter()
            .map(|beacon| apparent_direction(ephemeris, beacon.planet, tdb_s, &state))
            .collect();
        // measured - expected = -(I - u u^T) dr / d: the same equations for dr, in the place of the planet -d times it.
        let rows = beacons.iter().zip(&seen).map(|(beacon, (direction, distance_m))| {
            let off = (beacon.direction - *direction) * -distance_m;
            (*direction, 1.0 / (beacon.sigma_rad * distance_m), off)
        });
        let (information, right) = normal_equations(rows.clone());
        covariance_m2 = inverse(information)?;
        if round < 2 {
            state.position_m += covariance_m2 * right;
        }
        chi2 = rows
            .map(|(line, weight, off)| {
                tangent_axes(line).map(|axis| (axis.dot(off) * weight).powi(2)).iter().sum::<f64>()
            })
            .sum();
    }
    Some(Fix { position_m: state.position_m, covariance_m2, chi2 })
}

/// Sums of w^2 (I - u u^T) and w^2 (I - u u^T) p over lines u, weights w and places p.
fn normal_equations(rows: impl Iterator<Item = (DVec3, f64, DVec3)>) -> (DMat3, DVec3) {
    let (mut information, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (line, weight, place) in rows {
        for axis in tangent_axes(line) {
            let weighted = axis * (weight * weight);
            information += DMat3::from_cols(weighted * axis.x, weighted * axis.y, weighted * axis.z);
            right += weighted * axis.dot(place);
        }
    }
    (information, right)
}

/// The inverse, unless lines are parallel, which leaves one axis without information.
fn inverse(information: DMat3) -> Option<DMat3> {
    let scale = (information.x_axis.x + information.y_axis.y + information.z_axis.z) / 3.0;
    let usable = scale > 0.0 && (information * (1.0 / scale)).determinant().abs() > 1e-12;
    usable.then(|| information.inverse())
}

#[cfg(test)]
mod tests {
    use retina_sky::ephemeris::Ephemeris;

    use super::*;

    fn scene() -> (EphemerisTable, f64, PhaseState) {
        let tdb_s = 8.2e8;
        let state = PhaseState {
            position_m: DVec3::new(1.9e11, -0.7e11, -3e10),
            velocity_m_s: DVec3::new(9e3, 20e3, 8e3),
        };
        (EphemerisTable::new(&Ephemeris::analytic(), [tdb_s, tdb_s + 86_400.0]).unwrap(), tdb_s, state)
    }

    #[test]
    fn exact_lines_give_the_place_they_were_seen_from() {
        let (table, tdb_s, state) = scene();
        let beacon = |planet| Beacon {
            planet,
            direction: apparent_direction(&table, planet, tdb_s, &state).0,
            sigma_rad: 5e-5,
        };
        let two = [Planet::Venus, Planet::Jupiter].map(beacon);
        let fix = triangulate(&table, tdb_s, state.velocity_m_s, &two).unwrap();
        // Rounding of unit vectors, 1e-16 of 1e12 m and what a narrow crossing makes of it.
        let off_m = fix.position_m.distance(state.position_m);
        assert!(off_m < 10.0 && fix.chi2 < 1e-12, "{off_m} {}", fix.chi2);
        assert!(triangulate(&table, tdb_s, state.velocity_m_s, &two[..1]).is_none());
        assert!(triangulate(&table, tdb_s, state.velocity_m_s, &[two[0], two[0]]).is_none());
    }

    #[test]
    fn the_covariance_is_that_of_crossing_lines() {
        // Closed form: two lines at right angles to each other, errors s d each; across both lines the two share.
        let (table, tdb_s, state) = scene();
        let sigma_rad = 5e-5;
        let beacons = [Planet::Venus, Planet::Mars].map(|planet| {
            let (direction, distance_m) = apparent_direction(&table, planet, tdb_s, &state);
            (Beacon { planet, direction, sigma_rad }, distance_m)
        });
        let fix = triangulate(&table, tdb_s, state.velocity_m_s, &beacons.map(|(beacon, _)| beacon)).unwrap();
        let normal = beacons[0].0.direction.cross(beacons[1].0.direction).normalize();
        let along = (fix.covariance_m2 * normal).dot(normal);
        let each = beacons.map(|(_, d)| 1.0 / (sigma_rad * d).powi(2));
        assert!((along * (each[0] + each[1]) - 1.0).abs() < 1e-3);
        // In the plane of the two lines: along the first line's normal its own error alone, as the second says nothing
        // that the first does not say better along it, in the limit of the cross term: variance (s d1)^2.
        let across = normal.cross(beacons[0].0.direction).normalize();
        let in_plane = (fix.covariance_m2 * across).dot(across);
        assert!((in_plane * each[0] - 1.0).abs() < 1e-3, "{}", in_plane * each[0]);
    }
}
