//! An extended Kalman filter over position and velocity, with lines of sight to planets as measurements.

use glam::{DMat2, DVec2, DVec3};
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

    /// Takes in a measured apparent direction (unit vector, ICRF axes) of a planet, with its standard deviation per
    /// axis (rad). Joseph's form keeps the covariance symmetric and positive. `None`: the innovation's covariance is
    /// singular, nothing was taken in.
    pub fn update(
        &mut self,
        dynamics: &Dynamics,
        planet: Planet,
        measured: DVec3,
        sigma_rad: f64,
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
        let noise = sigma_rad * sigma_rad;
        let s = product(&h, &ph);
        let s = DMat2::from_cols(DVec2::new(s[0][0] + noise, s[1][0]), DVec2::new(s[0][1], s[1][1] + noise));
        if s.determinant() <= 0.0 {
            return None;
        }
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
        let added = product_transposed(&gain, &gain);
        self.covariance = std::array::from_fn(|i| std::array::from_fn(|j| kept[i][j] + noise * added[i][j]));
        Some(Innovation { nis: innovation.dot(inverse * innovation), distance_m })
    }

    /// Three standard deviations of position (m) and velocity (m/s), all axes together: 3 sqrt(trace).
    pub fn three_sigma(&self) -> [f64; 2] {
        [0, 3].map(|first| 3.0 * (first..first + 3).map(|i| self.covariance[i][i]).sum::<f64>().sqrt())
    }
}
