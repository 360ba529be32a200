//! An extended Kalman filter over position and velocity, with lines of sight to planets as measurements.

use glam::{DMat2, DMat3, DVec2, DVec3};
use retina_sky::ephemeris::LIGHT_SPEED_M_S;
use retina_sky::planets::Planet;

use super::dynamics::{Dynamics, PhaseState};
use super::matrix::{Matrix6, product, product_transposed};
use super::measurement::{apparent_direction, tangent_axes};

/// A state with its covariance.
#[derive(Debug, Clone)]
pub struct Filter {
    /// Epoch, TDB seconds since J2000.
    pub tdb_s: f64,
    /// Estimate.
    pub state: PhaseState,
    /// Its covariance: m^2, m^2/s, m^2/s^2.
    pub covariance: Matrix6,
    /// Standard deviation per axis of an acceleration that the model does not know, constant between updates, m/s^2.
    pub acceleration_sigma_m_s2: f64,
}

/// What a measurement brought.
#[derive(Debug, Clone, Copy)]
pub struct Innovation {
    /// Normalised innovation squared; chi-square of two degrees of freedom where all is modelled.
    pub nis: f64,
    /// Distance of the planet, m.
    pub distance_m: f64,
}

impl Filter {
    /// Carries estimate and covariance to another instant: P = Phi P Phi^T + Q, with Q of an acceleration that is
    /// constant over the interval (piecewise white; Bar-Shalom, Li & Kirubarajan 2001, section 6.3.2).
    pub fn predict(&mut self, dynamics: &Dynamics, to_s: f64) {
        let dt = to_s - self.tdb_s;
        let (state, transition) = dynamics.propagate_with_transition(self.state, self.tdb_s, to_s);
        let carried = product(&transition, &self.covariance);
        self.covariance = product_transposed(&carried, &transition);
        let gain = [0.5 * dt * dt, dt];
        let q = self.acceleration_sigma_m_s2 * self.acceleration_sigma_m_s2;
        for axis in 0..3 {
            for (i, a) in gain.iter().enumerate() {
                for (j, b) in gain.iter().enumerate() {
                    self.covariance[axis + 3 * i][axis + 3 * j] += q * a * b;
                }
            }
        }
        (self.state, self.tdb_s) = (state, to_s);
    }

    /// Takes in a measured apparent direction (unit vector, ICRF axes) of a planet, with its covariance (rad^2, ICRF axes;
    /// what it holds along the direction does not matter). Joseph's form keeps the filter's covariance symmetric and
    /// positive. `None`: the covariance is not positive definite across the direction, nothing was taken in.
    pub fn update(
        &mut self,
        dynamics: &Dynamics,
        planet: Planet,
        measured: DVec3,
        covariance_rad2: DMat3,
    ) -> Option<Innovation> {
        let (expected, distance_m) = apparent_direction(&dynamics.ephemeris, planet, self.tdb_s, &self.state);
        let axes = tangent_axes(expected);
        let innovation = DVec2::new(measured.dot(axes[0]), measured.dot(axes[1]));
        // d(direction) = -(I - u u^T) dr / d + (I - u u^T) dv / c.
        let h: [[f64; 6]; 2] = axes.map(|axis| {
            let (r, v) = (-axis / distance_m, axis / LIGHT_SPEED_M_S);
            [r.x, r.y, r.z, v.x, v.y, v.z]
        });
        let ph = product_transposed(&self.covariance, &h);
        let noise: [[f64; 2]; 2] =
            std::array::from_fn(|i| std::array::from_fn(|j| axes[i].dot(covariance_rad2 * axes[j])));
        if !(noise[0][0] > 0.0 && noise[0][0] * noise[1][1] > noise[0][1] * noise[1][0]) {
            return None;
        }
        let s = product(&h, &ph);
        let column = |j: usize| DVec2::new(s[0][j] + noise[0][j], s[1][j] + noise[1][j]);
        let s = DMat2::from_cols(column(0), column(1));
        let inverse = s.inverse();
        let gain: [[f64; 2]; 6] = std::array::from_fn(|i| {
            let row = inverse.transpose() * DVec2::new(ph[i][0], ph[i][1]);
            [row.x, row.y]
        });
        let mut state = self.state.to_array();
        for (value, row) in state.iter_mut().zip(&gain) {
            *value += row[0] * innovation.x + row[1] * innovation.y;
        }
        self.state = PhaseState::from_array(state);
        let kh = product(&gain, &h);
        let left: Matrix6 =
            std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j)) - kh[i][j]));
        let kept = product_transposed(&product(&left, &self.covariance), &left);
        let added = product_transposed(&product(&gain, &noise), &gain);
        self.covariance = std::array::from_fn(|i| std::array::from_fn(|j| kept[i][j] + added[i][j]));
        Some(Innovation { nis: innovation.dot(inverse * innovation), distance_m })
    }

    /// Three standard deviations of position (m) and velocity (m/s), all axes together: 3 sqrt(trace).
    pub fn three_sigma(&self) -> [f64; 2] {
        [0, 3].map(|first| 3.0 * (first..first + 3).map(|i| self.covariance[i][i]).sum::<f64>().sqrt())
    }
}

#[cfg(test)]
mod tests {
    use retina_sky::ephemeris::EphemerisTable;

    use super::*;

    /// Two parts of a covariance, one along each axis of the tangent plane, taken in one after the other as scalars in the
    /// textbook's form (Bierman 1977, chapter V) give what the joint update gives; noise along one axis leaves the other
    /// as it was.
    #[test]
    fn a_joint_update_is_two_scalar_ones() {
        let tdb_s = 1.0e9;
        let dynamics = Dynamics {
            ephemeris: EphemerisTable::new(
                &retina_sky::ephemeris::Ephemeris::analytic(),
                [tdb_s, tdb_s + 86_400.0],
            )
            .unwrap(),
            pressure_area_m2_kg: 0.0,
        };
        let state = PhaseState {
            position_m: DVec3::new(1.8e11, -0.9e11, -3e10),
            velocity_m_s: DVec3::new(9e3, 20e3, 8e3),
        };
        let mut covariance = [[0.0; 6]; 6];
        for (i, row) in covariance.iter_mut().enumerate() {
            row[i] = if i < 3 { (1e7 * (1.0 + i as f64)).powi(2) } else { 900.0 };
        }
        let before = Filter { tdb_s, state, covariance, acceleration_sigma_m_s2: 0.0 };
        let (direction, distance_m) = apparent_direction(&dynamics.ephemeris, Planet::Earth, tdb_s, &state);
        let axes = tangent_axes(direction);
        let measured = (direction + axes[0] * 4e-5 - axes[1] * 7e-5).normalize();
        let outer = |a: DVec3| DMat3::from_cols(a * a.x, a * a.y, a * a.z);
        let update = |sigmas: [f64; 2]| {
            let mut filter = before.clone();
            let noise = outer(axes[0]) * sigmas[0].powi(2) + outer(axes[1]) * sigmas[1].powi(2);
            let innovation = filter.update(&dynamics, Planet::Earth, measured, noise);
            (filter, innovation)
        };
        let sigmas = [2e-5, 9e-4];
        let (joint, innovation) = update(sigmas);
        // By hand, on the differences from the state before.
        let (mut off, mut p, mut nis) = ([0.0; 6], covariance, 0.0);
        for (axis, sigma) in axes.iter().zip(sigmas) {
            let (r, v) = (-*axis / distance_m, *axis / LIGHT_SPEED_M_S);
            let h = [r.x, r.y, r.z, v.x, v.y, v.z];
            let ph: [f64; 6] = std::array::from_fn(|i| (0..6).map(|j| p[i][j] * h[j]).sum());
            let variance = sigma * sigma + (0..6).map(|i| h[i] * ph[i]).sum::<f64>();
            let left = measured.dot(*axis) - (0..6).map(|i| h[i] * off[i]).sum::<f64>();
            for i in 0..6 {
                off[i] += ph[i] * left / variance;
                for j in 0..6 {
                    p[i][j] -= ph[i] * ph[j] / variance;
                }
            }
            nis += left * left / variance;
        }
        assert!((innovation.unwrap().nis / nis - 1.0).abs() < 1e-9);
        let moved = joint.state.minus(state);
        for i in 0..6 {
            assert!(
                (moved[i] - off[i]).abs() < 1e-6 * moved[i].abs().max(1.0),
                "{i}: {} {}",
                moved[i],
                off[i]
            );
            assert!((joint.covariance[i][i] / p[i][i] - 1.0).abs() < 1e-9, "{i}");
        }
        // A negative variance; of none at all, rounding decides the sign.
        let noise = outer(axes[0]) * 4e-10 - outer(axes[1]) * 1e-12;
        assert!(before.clone().update(&dynamics, Planet::Earth, measured, noise).is_none());
    }
}
