//! A pose of the closed loop: one datagram of big-endian f64.

use glam::DVec3;

use crate::pose::{ObjectPose, Pose, unit_quaternion};

/// Values without and with a quaternion for the Sun.
const COUNTS: [usize; 2] = [17, 21];

/// A datagram that is no pose.
#[derive(Debug, Clone, PartialEq)]
pub enum PoseError {
    /// Its size.
    Size(usize),
    /// A value that is not finite: its number, from 0.
    NotFinite(usize),
    /// The quaternion of an object has another norm than 1.
    NotUnit(&'static str, f64),
}

impl std::fmt::Display for PoseError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Size(size) => write!(
                f,
                "the datagram is no pose (found {size} bytes, expected 136 or 168: 17 or 21 big-endian f64)"
            ),
            Self::NotFinite(index) => write!(f, "value {index} of the pose is not finite"),
            Self::NotUnit(object, norm) => {
                write!(
                    f,
                    "the quaternion of the {object} is not unit (found a norm of {norm:.6}, expected 1)"
                )
            }
        }
    }
}

impl std::error::Error for PoseError {}

/// Decodes a pose: Sun position, (Sun quaternion,) camera position and quaternion, body position
/// and quaternion; big-endian, Blender units, quaternions w, x, y, z. The Sun's quaternion is
/// not used: its position gives the direction.
///
/// # Errors
/// Another size, a value that is not finite, a quaternion that is not unit.
pub fn decode_pose(bytes: &[u8]) -> Result<Pose, PoseError> {
    let (chunks, rest) = bytes.as_chunks::<8>();
    if !COUNTS.contains(&chunks.len()) || !rest.is_empty() {
        return Err(PoseError::Size(bytes.len()));
    }
    let values: Vec<f64> = chunks.iter().map(|chunk| f64::from_be_bytes(*chunk)).collect();
    if let Some(index) = values.iter().position(|value| !value.is_finite()) {
        return Err(PoseError::NotFinite(index));
    }
    let position = |first: usize| DVec3::new(values[first], values[first + 1], values[first + 2]);
    let object = |name: &'static str, first: usize| {
        let q = [values[first + 3], values[first + 4], values[first + 5], values[first + 6]];
        let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        let world_from_object = unit_quaternion(q).ok_or(PoseError::NotUnit(name, norm))?;
        Ok(ObjectPose { position_bu: position(first), world_from_object })
    };
    let camera = values.len() - 14;
    Ok(Pose {
        time_s: 0.0,
        sun_position_bu: position(0),
        camera: object("camera", camera)?,
        bodies: vec![object("body", camera + 7)?],
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bytes(values: &[f64]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_be_bytes()).collect()
    }

    /// Laid out by hand as CORTO's server unpacks it: 0..3 Sun, 3..10 camera, 10..17 body.
    const SHORT: [f64; 17] = [7., 8., 9., 1., 2., 3., 0., 1., 0., 0., 4., 5., 6., 0., 0., 0., 1.];

    #[test]
    fn both_lengths_hold_the_same_pose() {
        let pose = decode_pose(&bytes(&SHORT)).unwrap();
        assert_eq!(pose.sun_position_bu, DVec3::new(7.0, 8.0, 9.0));
        assert_eq!(pose.camera.position_bu, DVec3::new(1.0, 2.0, 3.0));
        assert_eq!(pose.camera.world_from_object.x, 1.0);
        assert_eq!(pose.bodies[0].position_bu, DVec3::new(4.0, 5.0, 6.0));
        assert_eq!(pose.bodies[0].world_from_object.z, 1.0);
        let long = [&SHORT[..3], &[1., 0., 0., 0.], &SHORT[3..]].concat();
        assert_eq!(decode_pose(&bytes(&long)).unwrap(), pose);
    }

    #[test]
    fn what_is_no_pose_is_told_apart() {
        for size in [0, 1, 135, 137, 144, 160, 169, 1000] {
            assert_eq!(decode_pose(&vec![0; size]).unwrap_err(), PoseError::Size(size));
        }
        let with = |index: usize, value: f64| {
            let mut values = SHORT;
            values[index] = value;
            decode_pose(&bytes(&values)).unwrap_err().to_string()
        };
        assert!(with(5, f64::NAN).contains("value 5"));
        assert!(with(0, f64::INFINITY).contains("value 0"));
        assert!(with(7, 2.0).contains("quaternion of the camera is not unit (found a norm of 2.0"));
        assert!(with(16, 0.9).contains("quaternion of the body"));
    }

    proptest! {
        #[test]
        fn no_datagram_panics(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = decode_pose(&bytes);
        }
    }
}
