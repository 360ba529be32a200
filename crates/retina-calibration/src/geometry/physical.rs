//! Where the distortion's centre lies: shift, rotation, scale and radial distortion about a free centre.

use faer::linalg::solvers::Solve as _;
use faer::{Mat, Side};
use glam::{DMat2, DVec2};
use rayon::prelude::*;

use super::noise::Weights;
use super::observations::Observations;

/// r_u = t + M [(r - c) (1 + k1 q + k2 q^2) + c], q = |r - c|^2, M a rotation times a scale: the physical model beside
/// the polynomial. That the centre is off the boresight and that lenses are decentred gives the same
/// mapping to first order (p = k1 times the shift): the two are one figure here.
#[derive(Debug, Clone, PartialEq)]
pub struct PhysicalFit {
    /// t, tangent plane.
    pub shift: DVec2,
    /// Rotation of the camera's image against the screen, rad, from +x towards +y.
    pub roll_rad: f64,
    /// Standard deviation of the roll, rad.
    pub roll_sigma_rad: f64,
    /// Scale of undistorted over measured lines of sight at the centre: f of K_f is so much too short.
    pub scale: f64,
    /// Standard deviation of the scale.
    pub scale_sigma: f64,
    /// Radial coefficients k1, k2 of D^-1 and their standard deviations.
    pub radial: [(f64, f64); 2],
    /// c, tangent plane.
    pub center: DVec2,
    /// Where c is on the screen from K_f's optical centre, in units of the tangent plane; times f_x, f_y: px.
    pub center_on_screen: DVec2,
    /// Standard deviation of each of its components.
    pub center_sigma: DVec2,
    /// Root of the mean square of the residuals that its 8 parameters leave, arcsec, per axis, weighted.
    pub rms_arcsec: f64,
}

/// Parameters: t_x, t_y, a, b (M = [[a, -b], [b, a]]), k1, k2, c_x, c_y.
const COUNT: usize = 8;
/// Significance of k1 below which no centre can be found.
const LEAST_RADIAL_SIGMAS: f64 = 5.0;

fn model(p: &[f64; COUNT], r: DVec2) -> (DVec2, [DVec2; COUNT]) {
    let m = DMat2::from_cols(DVec2::new(p[2], p[3]), DVec2::new(-p[3], p[2]));
    let center = DVec2::new(p[6], p[7]);
    let u = r - center;
    let q = u.length_squared();
    let gain = 1.0 + p[4] * q + p[5] * q * q;
    let v = u * gain + center;
    let slope = 2.0 * (p[4] + 2.0 * p[5] * q);
    let along = |axis: DVec2| m * (axis * (1.0 - gain) - u * (slope * u.dot(axis)));
    let rows = [
        DVec2::X,
        DVec2::Y,
        v,
        DVec2::new(-v.y, v.x),
        m * u * q,
        m * u * (q * q),
        along(DVec2::X),
        along(DVec2::Y),
    ];
    (DVec2::new(p[0], p[1]) + m * v, rows)
}

impl PhysicalFit {
    /// Fits `target`, undistorted lines of sight without their dependence on irradiance, by Gauss-Newton with the
    /// weights of the polynomial. `None` where it does not converge or the distortion is too weak to have a centre.
    pub(crate) fn fit(observations: &Observations, target: &[DVec2], weights: &Weights) -> Option<Self> {
        let mut p = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let mut covariance = Mat::<f64>::zeros(COUNT, COUNT);
        let (mut squares, mut total) = (0.0, 0.0);
        let mut converged = false;
        for _ in 0..40 {
            let (normal, right, sums) = normal_equations(&p, observations, target, weights);
            (squares, total) = sums;
            // Without distortion yet, the centre has no effect: it is held until there is one.
            let free = if p[4] == 0.0 { 6 } else { COUNT };
            let part = Mat::<f64>::from_fn(free, free, |i, j| normal[(i, j)]);
            let decomposed = part.llt(Side::Lower).ok()?;
            let step = decomposed.solve(&Mat::<f64>::from_fn(free, 1, |i, _| right[i]));
            // A centre outside the field is no centre; steps are kept within a fraction of it.
            let wild = if free == COUNT { step[(6, 0)].hypot(step[(7, 0)]) / 0.05 } else { 0.0 };
            let mut largest = 0.0f64;
            for (i, value) in p.iter_mut().enumerate().take(free) {
                let change = step[(i, 0)] / wild.max(1.0);
                *value += change;
                largest = largest.max(change.abs() / (normal[(i, i)]).powf(-0.5));
            }
            if free == COUNT {
                covariance = decomposed.solve(&Mat::<f64>::identity(COUNT, COUNT));
                if largest < 1e-4 {
                    converged = true;
                    break;
                }
            }
        }
        let sigma = |i: usize| covariance[(i, i)].sqrt();
        if !converged || p[4].abs() < LEAST_RADIAL_SIGMAS * sigma(4) {
            return None;
        }
        let scale = p[2].hypot(p[3]);
        // The image of c is t + M c; its derivatives by the parameters.
        let center = DVec2::new(p[6], p[7]);
        let m = DMat2::from_cols(DVec2::new(p[2], p[3]), DVec2::new(-p[3], p[2]));
        let mut derivative = [DVec2::ZERO; COUNT];
        (derivative[0], derivative[1]) = (DVec2::X, DVec2::Y);
        (derivative[2], derivative[3]) = (center, DVec2::new(-center.y, center.x));
        (derivative[6], derivative[7]) = (m.x_axis, m.y_axis);
        let variance = |axis: usize| -> f64 {
            let mut sum = 0.0;
            for i in 0..COUNT {
                for j in 0..COUNT {
                    sum += derivative[i][axis] * covariance[(i, j)] * derivative[j][axis];
                }
            }
            sum
        };
        Some(Self {
            shift: DVec2::new(p[0], p[1]),
            roll_rad: p[3].atan2(p[2]),
            roll_sigma_rad: sigma(3) / scale,
            scale,
            scale_sigma: sigma(2),
            radial: [(p[4], sigma(4)), (p[5], sigma(5))],
            center,
            center_on_screen: DVec2::new(p[0], p[1]) + m * center,
            center_sigma: DVec2::new(variance(0).sqrt(), variance(1).sqrt()),
            rms_arcsec: (squares / (2.0 * total)).sqrt().to_degrees() * 3600.0,
        })
    }
}

type Normal = (Mat<f64>, [f64; COUNT], (f64, f64));

/// J^T V^-1 J, J^T V^-1 residual, and the sums of the weighted squares and the weights.
fn normal_equations(
    p: &[f64; COUNT],
    observations: &Observations,
    target: &[DVec2],
    weights: &Weights,
) -> Normal {
    let parts: Vec<Normal> = observations
        .exposures
        .par_iter()
        .map(|(_, range)| of_one_exposure(p, observations, range.clone(), target, weights))
        .collect();
    let mut normal = Mat::<f64>::zeros(COUNT, COUNT);
    let mut right = [0.0; COUNT];
    let mut sums = (0.0, 0.0);
    for (part, part_right, (squares, total)) in &parts {
        normal += part;
        for (sum, value) in right.iter_mut().zip(part_right) {
            *sum += value;
        }
        sums = (sums.0 + squares, sums.1 + total);
    }
    for a in 0..COUNT {
        for b in a + 1..COUNT {
            normal[(a, b)] = normal[(b, a)];
        }
    }
    (normal, right, sums)
}

fn of_one_exposure(
    p: &[f64; COUNT],
    observations: &Observations,
    range: std::ops::Range<usize>,
    target: &[DVec2],
    weights: &Weights,
) -> Normal {
    let mut normal = Mat::<f64>::zeros(COUNT, COUNT);
    let mut right = [0.0; COUNT];
    let (mut squares, mut sum) = (0.0, 0.0);
    let mut means = [DVec2::ZERO; COUNT];
    let mut mean = DVec2::ZERO;
    for i in range {
        let weight = weights.inverse_variance[i];
        if weight == 0.0 {
            continue;
        }
        let (at, rows) = model(p, observations.sight[i]);
        let residual = target[i] - at;
        sum += weight;
        mean += weight * residual;
        squares += weight * residual.length_squared();
        for a in 0..COUNT {
            means[a] += weight * rows[a];
            right[a] += weight * rows[a].dot(residual);
            for b in 0..=a {
                normal[(a, b)] += weight * rows[a].dot(rows[b]);
            }
        }
    }
    let taken = weights.jitter_variance / (1.0 + weights.jitter_variance * sum);
    for a in 0..COUNT {
        right[a] -= taken * means[a].dot(mean);
        for b in 0..=a {
            normal[(a, b)] -= taken * means[a].dot(means[b]);
        }
    }
    (normal, right, (squares, sum))
}
