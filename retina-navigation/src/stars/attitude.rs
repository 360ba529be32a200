//! Attitude from directions that are known in two frames: Wahba's problem.

use faer::{Mat, Side};
use glam::{DMat3, DQuat, DVec3};

/// A direction measured in the camera's frame and known along inertial axes, with its weight (1 / variance).
#[derive(Debug, Clone, Copy)]
pub struct DirectionPair {
    /// Unit vector, camera frame.
    pub camera: DVec3,
    /// Unit vector, inertial axes.
    pub inertial: DVec3,
    /// Weight, 1 / rad^2 or any common scale.
    pub weight: f64,
}

/// The rotation `camera_from_inertial` that minimises the weighted sum of squared differences, by Davenport's
/// q-method (Davenport 1968; Markley & Crassidis 2014, eq. 5.24): the eigenvector of the largest eigenvalue of K.
///
/// `None` for fewer than two pairs, or directions that are all along one line.
pub fn wahba(pairs: &[DirectionPair]) -> Option<DQuat> {
    if pairs.len() < 2 {
        return None;
    }
    let mut b = DMat3::ZERO;
    for pair in pairs {
        let weighted = pair.camera * pair.weight;
        b += DMat3::from_cols(
            weighted * pair.inertial.x,
            weighted * pair.inertial.y,
            weighted * pair.inertial.z,
        );
    }
    // Column-major: b.col(c)[r] is B_rc.
    let at = |r: usize, c: usize| b.col(c)[r];
    let trace = at(0, 0) + at(1, 1) + at(2, 2);
    let z = [at(1, 2) - at(2, 1), at(2, 0) - at(0, 2), at(0, 1) - at(1, 0)];
    let k = Mat::from_fn(4, 4, |r, c| match (r, c) {
        (3, 3) => trace,
        (3, c) => z[c],
        (r, 3) => z[r],
        (r, c) => at(r, c) + at(c, r) - if r == c { trace } else { 0.0 },
    });
    let eigen = k.self_adjoint_eigen(Side::Lower).ok()?;
    let values = eigen.S();
    // Rising order; an eigenvalue that is double leaves the rotation about a line open.
    let (largest, second) = (values[3], values[2]);
    let scale = pairs.iter().map(|pair| pair.weight).sum::<f64>();
    if largest - second <= 1e-14 * scale {
        return None;
    }
    let q = eigen.U().col(3);
    // Davenport's quaternion turns axes; v_target = q v_source q* turns vectors: its vector part has the other sign.
    Some(DQuat::from_xyzw(-q[0], -q[1], -q[2], q[3]).normalize())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit() -> impl Strategy<Value = DVec3> {
        (-1.0_f64..1.0, 0.0_f64..std::f64::consts::TAU)
            .prop_map(|(z, a)| DVec3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z))
    }

    #[test]
    fn a_quarter_turn_about_z() {
        // CONTRACT: q = (sqrt(1/2), 0, 0, sqrt(1/2)) takes (1, 0, 0) to (0, 1, 0).
        let pair = |camera, inertial| DirectionPair { camera, inertial, weight: 1.0 };
        let q = wahba(&[pair(DVec3::Y, DVec3::X), pair(DVec3::Z, DVec3::Z)]).unwrap();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!((q.w.abs() - half).abs() < 1e-12 && (q.z * q.w.signum() - half).abs() < 1e-12, "{q}");
    }

    #[test]
    fn one_line_of_directions_is_no_attitude() {
        let pair = |v| DirectionPair { camera: v, inertial: v, weight: 1.0 };
        assert!(wahba(&[pair(DVec3::X)]).is_none());
        assert!(wahba(&[pair(DVec3::X), pair(DVec3::X)]).is_none());
    }

    proptest! {
        /// Exact directions give the rotation that made them.
        #[test]
        fn rotations_come_back(axis in unit(), angle in -3.1_f64..3.1, a in unit(), b in unit(), w in 0.1_f64..10.0) {
            prop_assume!(a.cross(b).length() > 0.05);
            let truth = DQuat::from_axis_angle(axis, angle);
            let pair = |v: DVec3, weight| DirectionPair { camera: truth * v, inertial: v, weight };
            let found = wahba(&[pair(a, 1.0), pair(b, w)]).unwrap();
            prop_assert!((found * a - truth * a).length() < 1e-10);
            prop_assert!((found * b - truth * b).length() < 1e-10);
            prop_assert!((found * a.cross(b) - truth * a.cross(b)).length() < 1e-10);
        }
    }
}
