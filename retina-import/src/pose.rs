//! The pose of a flat board from its corners in one image, for a camera whose lens is known.
//!
//! The corners' directions are taken back through the lens (Newton). A homography to the plane across their mean direction
//! gives a first pose (Z. Zhang, IEEE PAMI 22, 2000, section 3.1), which Levenberg-Marquardt refines on pixels.

use glam::{DMat3, DVec2, DVec3};
use retina_geometry::Lens;

use crate::mrcal::RigidMotion;

const TURNS: usize = 60;

/// Solves a square system (row-major) by elimination with pivots; `None` where it is singular.
fn solved<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> Option<[f64; N]> {
    for k in 0..N {
        let pivot = (k..N).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs()))?;
        a.swap(k, pivot);
        b.swap(k, pivot);
        if a[k][k].abs() < 1e-300 || !a[k][k].is_finite() {
            return None;
        }
        for i in k + 1..N {
            let factor = a[i][k] / a[k][k];
            for j in k..N {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    let mut out = [0.0; N];
    for k in (0..N).rev() {
        let known: f64 = (k + 1..N).map(|j| a[k][j] * out[j]).sum();
        out[k] = (b[k] - known) / a[k][k];
    }
    out.iter().all(|v| v.is_finite()).then_some(out)
}

/// The unit direction that a lens puts at a pixel.
fn direction(lens: &Lens, px: DVec2) -> Option<DVec3> {
    let seen = (px - lens.centre_px) / lens.focal_px;
    let theta = seen.length().min(1.5);
    let mut d = (seen.normalize_or_zero() * theta.sin()).extend(theta.cos());
    for _ in 0..TURNS {
        let image = lens.image(d).ok()?;
        let off = seen - image.normalised;
        // Two directions across d.
        let first = d.any_orthonormal_vector();
        let second = d.cross(first);
        let [gx, gy] = image.gradient;
        let step =
            solved([[gx.dot(first), gx.dot(second)], [gy.dot(first), gy.dot(second)]], off.to_array())?;
        // No further than the lens is smooth.
        let size = step[0].hypot(step[1]);
        let held = if size > 0.3 { 0.3 / size } else { 1.0 };
        d = (d + (first * step[0] + second * step[1]) * held).normalize();
        if size < 1e-13 {
            break;
        }
    }
    (lens.pixel(d).ok()?.distance(px) < 1e-6).then_some(d)
}

/// camera_from_board for a board's points (z = 0) and where they were seen; `None` where no pose fits.
pub(crate) fn pose(lens: &Lens, board: &[DVec3], seen_px: &[DVec2]) -> Option<RigidMotion> {
    if board.len() < 6 || board.len() != seen_px.len() {
        return None;
    }
    let directions: Vec<DVec3> = seen_px.iter().map(|px| direction(lens, *px)).collect::<Option<_>>()?;
    let mean = directions.iter().sum::<DVec3>().normalize();
    let first = mean.any_orthonormal_vector();
    let camera_from_mean = DMat3::from_cols(first, mean.cross(first), mean);
    let middle = board.iter().sum::<DVec3>() / board.len() as f64;
    let scale = board.iter().map(|p| (*p - middle).length()).fold(0.0, f64::max);
    if scale.is_nan() || scale <= 0.0 {
        return None;
    }
    // H with its last entry 1, by least squares.
    let (mut normal, mut right) = ([[0.0; 8]; 8], [0.0; 8]);
    for (point, direction) in board.iter().zip(&directions) {
        let d = camera_from_mean.transpose() * *direction;
        if d.z <= 0.05 {
            return None;
        }
        let (u, v) = (d.x / d.z, d.y / d.z);
        let p = (*point - middle) / scale;
        for (row, value) in [
            ([p.x, p.y, 1.0, 0.0, 0.0, 0.0, -u * p.x, -u * p.y], u),
            ([0.0, 0.0, 0.0, p.x, p.y, 1.0, -v * p.x, -v * p.y], v),
        ] {
            for i in 0..8 {
                right[i] += row[i] * value;
                for j in 0..8 {
                    normal[i][j] += row[i] * row[j];
                }
            }
        }
    }
    let h = solved(normal, right)?;
    let (a, b, t) = (DVec3::new(h[0], h[3], h[6]), DVec3::new(h[1], h[4], h[7]), DVec3::new(h[2], h[5], 1.0));
    let size = 0.5 * (a.length() + b.length());
    let x = a.normalize();
    let y = (b - x * x.dot(b)).normalize();
    let mut found = RigidMotion {
        rotation: camera_from_mean * DMat3::from_cols(x, y, x.cross(y)),
        translation: camera_from_mean * t * (scale / size),
    };
    found.translation -= found.rotation * middle;
    (found.rotation.is_finite() && found.translation.is_finite()).then_some(())?;
    refined(lens, board, seen_px, found, scale)
}

/// Levenberg-Marquardt on the six numbers of the pose.
fn refined(
    lens: &Lens,
    board: &[DVec3],
    seen_px: &[DVec2],
    start: RigidMotion,
    scale: f64,
) -> Option<RigidMotion> {
    let cost_of = |motion: &RigidMotion| -> Option<f64> {
        let square =
            |(p, px): (&DVec3, &DVec2)| Some(lens.pixel(motion.apply(*p)).ok()?.distance_squared(*px));
        board.iter().zip(seen_px).map(square).sum()
    };
    let mut found = start;
    let mut cost = cost_of(&found)?;
    let mut damping = 1e-3;
    for _ in 0..TURNS {
        let (mut normal, mut right) = ([[0.0; 6]; 6], [0.0; 6]);
        for (point, px) in board.iter().zip(seen_px) {
            let turned = found.rotation * *point;
            let image = lens.image(turned + found.translation).ok()?;
            let off = *px - lens.pixel_of(&image);
            for axis in 0..2 {
                let gradient = image.gradient[axis] * lens.focal_px[axis];
                // A turn w moves the point by w x turned.
                let by_turn = turned.cross(gradient);
                let by_step = gradient * scale;
                let row = [by_turn.x, by_turn.y, by_turn.z, by_step.x, by_step.y, by_step.z];
                for i in 0..6 {
                    right[i] += row[i] * off[axis];
                    for j in 0..6 {
                        normal[i][j] += row[i] * row[j];
                    }
                }
            }
        }
        for (k, row) in normal.iter_mut().enumerate() {
            row[k] *= 1.0 + damping;
        }
        let step = solved(normal, right)?;
        let turn = DVec3::new(step[0], step[1], step[2]);
        let rotation = if turn.length() > 0.0 {
            DMat3::from_axis_angle(turn.normalize(), turn.length())
        } else {
            DMat3::IDENTITY
        };
        let trial = RigidMotion {
            rotation: rotation * found.rotation,
            translation: found.translation + DVec3::new(step[3], step[4], step[5]) * scale,
        };
        match cost_of(&trial) {
            Some(next) if next <= cost => {
                let done = cost - next <= 1e-12 * cost;
                (found, cost) = (trial, next);
                damping = (damping * 0.1).max(1e-12);
                if done {
                    break;
                }
            }
            _ => {
                damping *= 10.0;
                if damping > 1e8 {
                    break;
                }
            }
        }
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use retina_geometry::LensModel;

    #[test]
    fn poses_are_found_through_every_lens() {
        let board: Vec<DVec3> =
            (0..30).map(|k| DVec3::new(f64::from(k % 6) * 0.05, f64::from(k / 6) * 0.05, 0.0)).collect();
        // In front, tilted; and, for a fisheye, beyond 90 degrees to the side.
        let near = RigidMotion::of(&[0.3, -0.4, 1.2, -0.1, 0.05, 0.6]);
        let aside = RigidMotion::of(&[0.1, 1.5, 0.2, 0.7, 0.1, -0.05]);
        for model in LensModel::ALL {
            let mut lens = Lens::new(model, DVec2::new(500.0, 510.0), DVec2::new(640.0, 480.0));
            if model == LensModel::Rational {
                lens.coefficients = [0.1, -0.05, 0.001, -0.002, 0.004, 0.2, 0.0, 0.0];
            }
            let behind = !matches!(model, LensModel::Pinhole | LensModel::Rational);
            for truth in [Some(near), behind.then_some(aside)].into_iter().flatten() {
                let seen: Vec<DVec2> = board.iter().map(|p| lens.pixel(truth.apply(*p)).unwrap()).collect();
                let found = pose(&lens, &board, &seen).unwrap();
                let off = board.iter().map(|p| found.apply(*p).distance(truth.apply(*p))).fold(0.0, f64::max);
                assert!(off < 1e-8, "{model:?}: {off}");
            }
        }
        assert_eq!(
            pose(&Lens::new(LensModel::Pinhole, DVec2::ONE, DVec2::ZERO), &board[..4], &[DVec2::ZERO; 4]),
            None
        );
    }
}
