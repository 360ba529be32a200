//! The circular restricted three-body problem of Earth and Moon, and its L2 halo orbits.
//!
//! Rotating frame, unit distance, unit mean motion, origin at the barycentre: Earth at (-mu, 0, 0),
//! Moon at (1 - mu, 0, 0). Halo orbits cross the xz plane at right angles twice a period, so half
//! a period is corrected to end in a right-angled crossing (Howell 1984, "Three-dimensional,
//! periodic, halo orbits") with the Jacobi constant held as a fourth condition.

use glam::{DMat4, DVec4};

use crate::ode::integrate;

/// Mass of the Moon over that of Earth and Moon.
pub(crate) const MU: f64 = 0.012_150_585_609_624;
/// Relative error a step of the integrations.
pub(crate) const TOLERANCE: f64 = 1e-13;

/// x, y, z, vx, vy, vz in the rotating frame.
pub(crate) type Phase = [f64; 6];

/// Distances to Earth and Moon.
fn distances(s: &Phase) -> (f64, f64) {
    let off_axis = s[1] * s[1] + s[2] * s[2];
    let (to_earth, to_moon) = (s[0] + MU, s[0] - 1.0 + MU);
    ((to_earth * to_earth + off_axis).sqrt(), (to_moon * to_moon + off_axis).sqrt())
}

/// Gradient of the effective potential (x^2 + y^2) / 2 + (1 - mu) / r1 + mu / r2.
fn gradient(s: &Phase) -> [f64; 3] {
    let (r1, r2) = distances(s);
    let (earth, moon) = ((1.0 - MU) / r1.powi(3), MU / r2.powi(3));
    let pull = earth + moon;
    [s[0] - earth * (s[0] + MU) - moon * (s[0] - 1.0 + MU), s[1] * (1.0 - pull), -s[2] * pull]
}

/// Time derivative of the state.
pub(crate) fn dynamics(s: &Phase) -> Phase {
    let [gx, gy, gz] = gradient(s);
    [s[3], s[4], s[5], gx + 2.0 * s[4], gy - 2.0 * s[3], gz]
}

/// The Jacobi constant x^2 + y^2 + 2 (1 - mu) / r1 + 2 mu / r2 - v^2 (without mu (1 - mu)).
pub(crate) fn jacobi(s: &Phase) -> f64 {
    let (r1, r2) = distances(s);
    let speed2 = s[3] * s[3] + s[4] * s[4] + s[5] * s[5];
    s[0] * s[0] + s[1] * s[1] + 2.0 * (1.0 - MU) / r1 + 2.0 * MU / r2 - speed2
}

/// State and, row by row behind it, state-transition matrix.
type Variational = [f64; 42];

/// Time derivative of the state and of the state-transition matrix: Phi' = A Phi.
fn variational(s: &Variational) -> Variational {
    let state: Phase = std::array::from_fn(|i| s[i]);
    let (r1, r2) = distances(&state);
    let (k1, k2) = ((1.0 - MU) / r1.powi(3), MU / r2.powi(3));
    let (e, m) = (3.0 * (1.0 - MU) / r1.powi(5), 3.0 * MU / r2.powi(5));
    let (x1, x2, y, z) = (state[0] + MU, state[0] - 1.0 + MU, state[1], state[2]);
    let (xy, xz, yz) = ((e * x1 + m * x2) * y, (e * x1 + m * x2) * z, (e + m) * y * z);
    let hessian = [
        [1.0 - k1 - k2 + e * x1 * x1 + m * x2 * x2, xy, xz],
        [xy, 1.0 - k1 - k2 + (e + m) * y * y, yz],
        [xz, yz, -k1 - k2 + (e + m) * z * z],
    ];
    let mut rate = [0.0; 42];
    rate[..6].copy_from_slice(&dynamics(&state));
    let phi = |row: usize, column: usize| s[6 + 6 * row + column];
    for c in 0..6 {
        for r in 0..3 {
            rate[6 + 6 * r + c] = phi(r + 3, c);
            rate[6 + 6 * (r + 3) + c] = (0..3).map(|k| hessian[r][k] * phi(k, c)).sum();
        }
        rate[6 + 18 + c] += 2.0 * phi(4, c);
        rate[6 + 24 + c] -= 2.0 * phi(3, c);
    }
    rate
}

/// The state after `span`, and the state-transition matrix to it.
fn propagate_with_stm(start: &Phase, span: f64) -> Option<(Phase, [[f64; 6]; 6])> {
    let mut both = [0.0; 42];
    both[..6].copy_from_slice(start);
    for i in 0..6 {
        both[6 + 7 * i] = 1.0;
    }
    let end = integrate(|_, s| variational(s), both, [0.0, span], TOLERANCE)?;
    let stm = std::array::from_fn(|r| std::array::from_fn(|c| end[6 + 6 * r + c]));
    Some((std::array::from_fn(|i| end[i]), stm))
}

/// A periodic orbit: where it crosses the xz plane at right angles, and its period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PeriodicOrbit {
    /// State at the crossing: (x, 0, z, 0, vy, 0).
    pub(crate) start: Phase,
    /// Period, units of the rotating frame (2 pi is a sidereal month).
    pub(crate) period: f64,
    /// What is left of y, vx and vz (largest) at half a period.
    pub(crate) residual: f64,
}

/// What picks one member of the family.
#[derive(Clone, Copy)]
enum Member {
    /// Height of the starting crossing.
    Height(f64),
    /// Jacobi constant.
    Jacobi(f64),
}

/// Unknowns x, z, vy at the crossing, and half the period.
type Unknowns = DVec4;

fn phase_of(u: Unknowns) -> Phase {
    [u.x, 0.0, u.y, 0.0, u.z, 0.0]
}

/// Newton's method on a right-angled crossing after half a period and on `member`.
fn correct(mut unknowns: Unknowns, member: Member) -> Option<PeriodicOrbit> {
    let mut last = f64::INFINITY;
    for _ in 0..20 {
        let start = phase_of(unknowns);
        let (end, stm) = propagate_with_stm(&start, unknowns.w)?;
        let rate = dynamics(&end);
        let row = |i: usize| DVec4::new(stm[i][0], stm[i][2], stm[i][4], rate[i]);
        let [gx, _, gz] = gradient(&start);
        let (miss, slope) = match member {
            Member::Height(z) => (unknowns.y - z, DVec4::Y),
            Member::Jacobi(c) => (jacobi(&start) - c, DVec4::new(2.0 * gx, 2.0 * gz, -2.0 * start[4], 0.0)),
        };
        let residual = DVec4::new(end[1], end[3], end[5], miss);
        let size = residual.abs().max_element();
        // Converged where a further step no longer helps, which is at rounding.
        if size < 1e-11 && size >= 0.5 * last {
            let crossing = residual.truncate().abs().max_element();
            return Some(PeriodicOrbit { start, period: 2.0 * unknowns.w, residual: crossing });
        }
        last = size;
        let step = DMat4::from_cols(row(1), row(3), row(5), slope).transpose().inverse() * residual;
        if !step.is_finite() {
            return None;
        }
        unknowns -= step;
    }
    None
}

/// The family of southern L2 halos has no such member within reach.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "no southern L2 halo orbit with a Jacobi constant of {jacobi} (the family was followed to {reached}; it spans \
     3.016 to 3.152)"
)]
pub struct NoOrbit {
    /// The constant asked for.
    pub jacobi: f64,
    /// The last constant at which there was an orbit.
    pub reached: f64,
}

/// The southern L2 halo orbit of a Jacobi constant, from its crossing far from the Moon.
///
/// From the planar orbits (C = 3.152) towards the Moon the constant falls to a minimum of about
/// 3.015 and rises again along the near-rectilinear orbits; the members before the minimum are found.
///
/// # Errors
/// The family has no member that the continuation reaches with this constant.
pub(crate) fn southern_l2_halo(wanted: f64) -> Result<PeriodicOrbit, NoOrbit> {
    // Where the family leaves the planar orbits: x = 1.1809, vy = -0.1559, period 3.415 (Howell &
    // Campbell 1999, "Three-dimensional periodic solutions that bifurcate from halo families").
    const BIFURCATION: Unknowns = DVec4::new(1.1809, -0.02, -0.1559, 1.7078);
    const JACOBI_AT_BIFURCATION: f64 = 3.152;
    const STEP: f64 = 0.004;
    let lost = |at: f64| NoOrbit { jacobi: wanted, reached: at };
    let unknowns = |orbit: &PeriodicOrbit| {
        DVec4::new(orbit.start[0], orbit.start[2], orbit.start[4], orbit.period / 2.0)
    };
    let mut orbit =
        correct(BIFURCATION, Member::Height(BIFURCATION.y)).ok_or_else(|| lost(JACOBI_AT_BIFURCATION))?;
    let mut at = jacobi(&orbit.start);
    // The second member gives the secant its direction.
    let mut slope = DVec4::ZERO;
    while at != wanted {
        let next = at + (wanted - at).clamp(-STEP, STEP);
        let guess = unknowns(&orbit) + slope * (next - at);
        let found = correct(guess, Member::Jacobi(next))
            // Not the planar orbits, the northern mirror image or another family.
            .filter(|found| {
                found.start[2] < -0.005 && (1.0..1.25).contains(&found.start[0]) && found.period > 1.5
            })
            .ok_or_else(|| lost(at))?;
        slope = (unknowns(&found) - unknowns(&orbit)) / (next - at);
        (orbit, at) = (found, next);
    }
    Ok(orbit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn l2_is_the_root_of_its_quintic() {
        let mut g = (MU / 3.0).cbrt();
        for _ in 0..30 {
            let quintic = |g: f64| {
                g.powi(5) + (3.0 - MU) * g.powi(4) + (3.0 - 2.0 * MU) * g.powi(3)
                    - MU * g * g
                    - 2.0 * MU * g
                    - MU
            };
            g -= quintic(g) * 2e-7 / (quintic(g + 1e-7) - quintic(g - 1e-7));
        }
        let l2 = 1.0 - MU + g;
        assert!((l2 - 1.155_682).abs() < 1e-6, "{l2}");
        let at_rest = dynamics(&[l2, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(at_rest.iter().all(|v| v.abs() < 1e-12), "{at_rest:?}");
        // Jacobi constant of L2 in the literature (without mu (1 - mu)): 3.17216.
        assert!((jacobi(&[l2, 0.0, 0.0, 0.0, 0.0, 0.0]) - 3.172_16).abs() < 1e-5);
    }

    #[test]
    fn the_transition_matrix_is_that_of_finite_differences() {
        let start = [1.12, 0.02, -0.07, 0.01, -0.2, 0.03];
        let (end, stm) = propagate_with_stm(&start, 0.6).unwrap();
        for column in 0..6 {
            let moved = |by: f64| {
                let mut s = start;
                s[column] += by;
                integrate(|_, s| dynamics(s), s, [0.0, 0.6], TOLERANCE).unwrap()
            };
            // Five points: the third derivatives near the Moon are too large for two.
            let h = 3e-5;
            let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|k| moved(k * h));
            for r in 0..6 {
                let slope = (a[r] - d[r] + 8.0 * (c[r] - b[r])) / (12.0 * h);
                let ours = stm[r][column];
                assert!((ours - slope).abs() < 1e-7 * (1.0 + slope.abs()), "{r} {column}: {ours} {slope}");
            }
        }
        let alone = integrate(|_, s| dynamics(s), start, [0.0, 0.6], TOLERANCE).unwrap();
        assert!((0..6).all(|i| (end[i] - alone[i]).abs() < 1e-10));
        // Liouville: the flow keeps volumes.
        assert!((determinant(stm) - 1.0).abs() < 1e-9);
    }

    fn determinant(mut m: [[f64; 6]; 6]) -> f64 {
        let mut product = 1.0;
        for k in 0..6 {
            let pivot = (k..6).max_by(|&a, &b| m[a][k].abs().total_cmp(&m[b][k].abs())).unwrap();
            if pivot != k {
                m.swap(pivot, k);
                product = -product;
            }
            product *= m[k][k];
            for r in k + 1..6 {
                let factor = m[r][k] / m[k][k];
                for c in k..6 {
                    m[r][c] -= factor * m[k][c];
                }
            }
        }
        product
    }

    #[test]
    fn the_halo_closes_after_a_period_and_keeps_its_jacobi_constant() {
        let orbit = southern_l2_halo(3.09).unwrap();
        assert!(orbit.residual < 1e-11);
        let mut state = orbit.start;
        let mut lowest = 0.0_f64;
        let mut highest = 0.0_f64;
        for _ in 0..100 {
            state = integrate(|_, s| dynamics(s), state, [0.0, orbit.period / 100.0], TOLERANCE).unwrap();
            assert!((jacobi(&state) - 3.09).abs() < 1e-10);
            (lowest, highest) = (lowest.min(state[2]), highest.max(state[2]));
        }
        for i in 0..6 {
            assert!((state[i] - orbit.start[i]).abs() < 1e-8, "{state:?} {orbit:?}");
        }
        assert!(-lowest > highest, "a southern halo reaches farther south: {lowest} {highest}");
    }

    #[test]
    fn published_members_of_the_family_are_met() {
        // x, z, vy, period: first L2 halo of JPL's Three-Body Periodic Orbits, and the 9:2 near-rectilinear
        // halo of the Gateway as used in the literature (Lee 2019, for mu = 1 / 82.30059). Newton starts
        // beside them; height alone picks the member, so that the rest is a test.
        for (x, z, vy, period) in [
            (1.180_898_549_789_92, -1.029_505_407_524e-4, -0.155_856_313_939_812, 3.415_530_806_562_845),
            (1.022_021_512_735_817, -0.182_096_761_524_240, -0.103_256_341_062_794, 1.511_111_111_111_111),
        ] {
            let beside = DVec4::new(x + 1e-4, z, vy + 1e-4, period / 2.0 - 1e-4);
            let orbit = correct(beside, Member::Height(z)).unwrap();
            let off = DVec4::new(
                orbit.start[0] - x,
                orbit.start[2] - z,
                orbit.start[4] - vy,
                orbit.period - period,
            );
            assert!(off.abs().max_element() < 1e-6, "{off}");
        }
    }

    #[test]
    fn the_family_is_followed_between_its_ends_only() {
        for within in [3.016, 3.05, 3.1, 3.15] {
            assert!((jacobi(&southern_l2_halo(within).unwrap().start) - within).abs() < 1e-11);
        }
        for beyond in [3.2, 3.153, 3.01, 2.5, f64::NAN, f64::INFINITY] {
            assert!(matches!(southern_l2_halo(beyond), Err(NoOrbit { .. })), "{beyond}");
        }
    }
}
