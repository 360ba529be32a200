//! Where the distortion's centre lies: shift, rotation, scale and radial distortion about a free centre.

use faer::linalg::solvers::Solve as _;
use faer::{Mat, Side};
use glam::{DMat2, DVec2};
use rayon::prelude::*;

use super::noise::Weights;
use super::observations::Observations;

/// r_u = t + M [(r - c) (1 + k1 q + k2 q^2 + k3 q^3 + k4 q^4) + c], q = |r - c|^2, M any matrix, since a display's
/// pixels need not be square: the physical model beside the polynomial. That the centre is off the boresight and that lenses are decentred gives the same
/// mapping to first order (p = k1 times the shift): the two are one figure here.
#[derive(Debug, Clone, PartialEq)]
pub struct PhysicalFit {
    /// t, tangent plane.
    pub shift: DVec2,
    /// Rotation of the camera's image against the screen, rad, from +x towards +y.
    pub roll_rad: f64,
    /// Standard deviation of the roll, rad.
    pub roll_sigma_rad: f64,
    /// Scale of undistorted over measured lines of sight at the centre, the mean of x and y: f of K_f is so much too
    /// short.
    pub scale: f64,
    /// Scale along x over that along y: 1 where K_f has the shape of the display's pixels.
    pub aspect: f64,
    /// Standard deviation of the scale.
    pub scale_sigma: f64,
    /// Radial coefficients k1 to k4 of D^-1 and their standard deviations.
    pub radial: [(f64, f64); RADIAL],
    /// c, tangent plane.
    pub center: DVec2,
    /// Where c is on the screen from K_f's optical centre, in units of the tangent plane; times f_x, f_y: px.
    pub center_on_screen: DVec2,
    /// Standard deviation of each of its components.
    pub center_sigma: DVec2,
    /// Root of the mean square of the residuals that its 12 parameters leave, arcsec, per axis, weighted.
    pub rms_arcsec: f64,
}

/// Radial terms: those of a facility of stock doublets need four.
const RADIAL: usize = 4;
/// Where the first radial term stands among the parameters: t_x, t_y, M's columns, then k1 to k4 of q over [`Q_UNIT`],
/// then c_x, c_y.
const FIRST_RADIAL: usize = 6;
/// Parameters.
const COUNT: usize = FIRST_RADIAL + RADIAL + 2;
/// Where the centre stands among them.
const CENTRE: usize = FIRST_RADIAL + RADIAL;
/// The radial terms' unit of q, so that none is tiny: (8 deg)^2.
const Q_UNIT: f64 = 0.02;
/// A centre that is not known to this (a tenth of the field's half width) is none, tangent plane.
const WIDEST_SIGMA: f64 = 0.02;

fn matrix(p: &[f64; COUNT]) -> DMat2 {
    DMat2::from_cols(DVec2::new(p[2], p[3]), DVec2::new(p[4], p[5]))
}

fn model(p: &[f64; COUNT], r: DVec2) -> (DVec2, [DVec2; COUNT]) {
    let m = matrix(p);
    let center = DVec2::new(p[CENTRE], p[CENTRE + 1]);
    let u = r - center;
    let q = u.length_squared() / Q_UNIT;
    let radial = &p[FIRST_RADIAL..CENTRE];
    // 1 + q (k1 + q (k2 + ...)), and its derivative by q.
    let gain = 1.0 + radial.iter().rev().fold(0.0, |sum, k| (sum + k) * q);
    let by_q: f64 = radial.iter().enumerate().map(|(i, k)| (i + 1) as f64 * k * q.powi(i as i32)).sum();
    let v = u * gain + center;
    let slope = 2.0 * by_q / Q_UNIT;
    let along = |axis: DVec2| m * (axis * (1.0 - gain) - u * (slope * u.dot(axis)));
    let mut rows = [DVec2::ZERO; COUNT];
    rows[..2].copy_from_slice(&[DVec2::X, DVec2::Y]);
    rows[2..FIRST_RADIAL].copy_from_slice(&[DVec2::X * v.x, DVec2::Y * v.x, DVec2::X * v.y, DVec2::Y * v.y]);
    for (i, row) in rows[FIRST_RADIAL..CENTRE].iter_mut().enumerate() {
        *row = m * u * q.powi(i as i32 + 1);
    }
    rows[CENTRE..].copy_from_slice(&[along(DVec2::X), along(DVec2::Y)]);
    (DVec2::new(p[0], p[1]) + m * v, rows)
}

impl PhysicalFit {
    /// Fits `target`, undistorted lines of sight without their dependence on irradiance, by Gauss-Newton with the
    /// weights of the polynomial. `None` where it does not converge or the distortion is too weak to have a centre.
    pub(crate) fn fit(observations: &Observations, target: &[DVec2], weights: &Weights) -> Option<Self> {
        let mut p = [0.0; COUNT];
        (p[2], p[5]) = (1.0, 1.0);
        let mut covariance = Mat::<f64>::zeros(COUNT, COUNT);
        let (mut squares, mut total) = (0.0, 0.0);
        let mut converged = false;
        for _ in 0..40 {
            let (normal, right, sums) = normal_equations(&p, observations, target, weights);
            (squares, total) = sums;
            // Without distortion yet, the centre has no effect: it is held until there is one.
            let free = if p[FIRST_RADIAL] == 0.0 { CENTRE } else { COUNT };
            let part = Mat::<f64>::from_fn(free, free, |i, j| normal[(i, j)]);
            let decomposed = part.llt(Side::Lower).ok()?;
            let step = decomposed.solve(&Mat::<f64>::from_fn(free, 1, |i, _| right[i]));
            // A centre outside the field is no centre; steps are kept within a fraction of it.
            let wild =
                if free == COUNT { step[(CENTRE, 0)].hypot(step[(CENTRE + 1, 0)]) / 0.05 } else { 0.0 };
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
        if !converged || sigma(CENTRE).max(sigma(CENTRE + 1)) > WIDEST_SIGMA {
            return None;
        }
        // The image of c is t + M c; its derivatives by the parameters.
        let center = DVec2::new(p[CENTRE], p[CENTRE + 1]);
        let m = matrix(&p);
        let scale = 0.5 * (m.x_axis.length() + m.y_axis.length());
        // Of independent columns, near enough to a rotation: half of the sum and of the difference.
        let half = |i: usize, j: usize, sign: f64| {
            0.5 * (covariance[(i, i)] + covariance[(j, j)] + 2.0 * sign * covariance[(i, j)]).sqrt()
        };
        let mut derivative = [DVec2::ZERO; COUNT];
        (derivative[0], derivative[1]) = (DVec2::X, DVec2::Y);
        derivative[2..FIRST_RADIAL].copy_from_slice(&[
            DVec2::X * center.x,
            DVec2::Y * center.x,
            DVec2::X * center.y,
            DVec2::Y * center.y,
        ]);
        (derivative[CENTRE], derivative[CENTRE + 1]) = (m.x_axis, m.y_axis);
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
            roll_rad: (p[3] - p[4]).atan2(p[2] + p[5]),
            roll_sigma_rad: half(3, 4, -1.0) / scale,
            scale,
            scale_sigma: half(2, 5, 1.0),
            aspect: m.x_axis.length() / m.y_axis.length(),
            radial: std::array::from_fn(|i| {
                [p[FIRST_RADIAL + i], sigma(FIRST_RADIAL + i)].map(|k| k / Q_UNIT.powi(i as i32 + 1)).into()
            }),
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
