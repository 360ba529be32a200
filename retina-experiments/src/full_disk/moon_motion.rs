//! How a spacecraft moves near the Moon as the filter has it: under the known forces, and an acceleration that is not
//! modelled.

use glam::DVec3;
use retina_navigation::filter::runge_kutta;
use retina_sky::forces::MoonForces;

/// Position, velocity, unknown acceleration: 3 each.
pub(super) const MOTION: usize = 9;
/// Longest step, s: at 30 000 km of the Moon the direction turns by 0.01 rad in it.
const STEP_S: f64 = 900.0;

/// A covariance or transition of position, velocity and acceleration.
pub(super) type Matrix9 = [[f64; MOTION]; MOTION];

/// Forces, and what is known of the one that is not modelled: a first-order Gauss-Markov acceleration.
#[derive(Debug, Clone)]
pub(super) struct MoonMotion {
    /// Moon, Earth, Sun and sunlight.
    pub forces: MoonForces,
    /// Its standard deviation per axis, m/s^2.
    pub acceleration_sigma_m_s2: f64,
    /// Its correlation time, s.
    pub acceleration_time_s: f64,
}

impl MoonMotion {
    /// Position, velocity and unknown acceleration at another instant, their transition, and the covariance that the
    /// unknown acceleration's changes add.
    pub(super) fn carry(
        &self,
        state: [f64; MOTION],
        from_s: f64,
        to_s: f64,
    ) -> ([f64; MOTION], Matrix9, Matrix9) {
        const N: usize = MOTION * (1 + 2 * MOTION);
        let mut start = [0.0; N];
        start[..MOTION].copy_from_slice(&state);
        for i in 0..MOTION {
            start[MOTION + i * (MOTION + 1)] = 1.0;
        }
        let driving = 2.0 * self.acceleration_sigma_m_s2.powi(2) / self.acceleration_time_s;
        let rate = |t: f64, y: &[f64; N]| {
            let field = self.forces.at(t, DVec3::new(y[0], y[1], y[2]));
            let (pull, gradient) = (field.acceleration_m_s2, field.gradient_s2);
            // A of d(state)/dt = A state, row by row.
            let mut a = [[0.0; MOTION]; MOTION];
            for row in 0..3 {
                a[row][row + 3] = 1.0;
                for column in 0..3 {
                    a[row + 3][column] = gradient.col(column)[row];
                }
                a[row + 3][row + 6] = 1.0;
                a[row + 6][row + 6] = -1.0 / self.acceleration_time_s;
            }
            let mut out = [0.0; N];
            for k in 0..3 {
                out[k] = y[k + 3];
                out[k + 3] = pull[k] + y[k + 6];
                out[k + 6] = -y[k + 6] / self.acceleration_time_s;
            }
            let q = |i: usize, j: usize| y[MOTION + MOTION * MOTION + i * MOTION + j];
            for i in 0..MOTION {
                for j in 0..MOTION {
                    // Phi' = A Phi; Q' = A Q + Q A^T + G.
                    let (mut phi, mut added) = (0.0, 0.0);
                    for k in 0..MOTION {
                        phi += a[i][k] * y[MOTION + k * MOTION + j];
                        added += a[i][k] * q(k, j) + a[j][k] * q(i, k);
                    }
                    if i == j && i >= 6 {
                        added += driving;
                    }
                    out[MOTION + i * MOTION + j] = phi;
                    out[MOTION + MOTION * MOTION + i * MOTION + j] = added;
                }
            }
            out
        };
        let end = runge_kutta(rate, start, from_s, to_s, STEP_S);
        let square = |first: usize| -> Matrix9 {
            std::array::from_fn(|i| std::array::from_fn(|j| end[first + i * MOTION + j]))
        };
        (std::array::from_fn(|i| end[i]), square(MOTION), square(MOTION * (1 + MOTION)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retina_sky::ephemeris::Ephemeris;

    const START_S: f64 = 8.7e8;

    fn motion(sigma: f64) -> MoonMotion {
        let span_s = [START_S, START_S + 20.0 * 86_400.0];
        let forces = MoonForces::new(&Ephemeris::analytic(), span_s, 0.02).unwrap();
        MoonMotion { forces, acceleration_sigma_m_s2: sigma, acceleration_time_s: 86_400.0 }
    }

    #[test]
    fn the_transition_is_the_difference_of_neighbours_and_the_noise_is_the_integral() {
        let motion = motion(1e-5);
        let state = [3e7, -4e7, 2e7, 50.0, 80.0, -30.0, 1e-6, 0.0, -2e-6];
        let to_s = START_S + 2.0 * 86_400.0;
        let (_, transition, noise) = motion.carry(state, START_S, to_s);
        for column in 0..MOTION {
            let step = [1e3, 1e-2, 1e-8][column / 3];
            let at = |sign: f64| {
                let mut moved = state;
                moved[column] += sign * step;
                motion.carry(moved, START_S, to_s).0
            };
            let (above, below) = (at(1.0), at(-1.0));
            for row in 0..MOTION {
                // What a step of this size changes, in units of what such steps are.
                let unit = [1e3, 1e-2, 1e-8];
                let off = (above[row] - below[row]) / (2.0 * step) - transition[row][column];
                assert!(off.abs() * unit[column / 3] / unit[row / 3] < 1e-3, "{row} {column} {off}");
            }
        }
        // Closed form of a Gauss-Markov process: variance s^2 (1 - exp(-2 t / T)).
        let expected = 1e-10 * (1.0 - (-4.0f64).exp());
        assert!((noise[6][6] / expected - 1.0).abs() < 1e-6, "{} {expected}", noise[6][6]);
        assert!(noise[0][0] > 0.0 && (noise[0][3] - noise[3][0]).abs() < 1e-9 * noise[0][3].abs());
    }
}
