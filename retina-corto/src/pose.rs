//! Poses as CORTO gives them: Blender units, the world's axes, quaternions from an object to the world.

use glam::{DQuat, DVec3};
use retina_sky::{BodyPose, FramePose};

/// How far a quaternion's norm may be off 1; CORTO's own tolerance for the camera's.
pub(crate) const NORM_TOLERANCE: f64 = 1e-4;
/// The camera's axes of RETINA (x right, y down, z boresight) from Blender's (x right, y up, -z
/// boresight): half a turn about x.
const CAMERA_FROM_BLENDER_CAMERA: DQuat = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);

/// Where an object is and how it is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObjectPose {
    /// Blender units, the world's axes.
    pub position_bu: DVec3,
    /// Unit quaternion, Blender's `rotation_quaternion`.
    pub world_from_object: DQuat,
}

impl Default for ObjectPose {
    fn default() -> Self {
        Self { position_bu: DVec3::ZERO, world_from_object: DQuat::IDENTITY }
    }
}

/// One frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// CORTO knows no time: the frame's number, or a point cloud's first column.
    pub time_s: f64,
    /// Where the Sun lamp stands; only its direction from the world's origin counts.
    pub sun_position_bu: DVec3,
    /// The camera; it looks along its own -z with +y up.
    pub camera: ObjectPose,
    /// The bodies, in the order of `body_1` to `body_n`.
    pub bodies: Vec<ObjectPose>,
}

/// What turns poses into a trajectory's frames.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    /// Metres in a Blender unit.
    pub scale_m_per_bu: f64,
    /// Distance at which the Sun's disc has the wanted angle, m.
    pub sun_distance_m: f64,
    /// The bodies' names.
    pub body_names: Vec<String>,
}

impl World {
    /// The frame of a pose. The Sun stands in its direction from the first body, so that its light
    /// comes from the same direction wherever the body is, as a Sun lamp's does.
    pub fn frame(&self, pose: &Pose) -> FramePose {
        let scale = self.scale_m_per_bu;
        let from = pose.bodies.first().map_or(DVec3::ZERO, |body| body.position_bu * scale);
        // A lamp at the origin is not turned: it shines along the world's -z.
        let towards_sun = pose.sun_position_bu.try_normalize().unwrap_or(DVec3::Z);
        let bodies = self.body_names.iter().zip(&pose.bodies).map(|(name, body)| {
            let pose = BodyPose {
                position_m: body.position_bu * scale,
                body_from_inertial: body.world_from_object.inverse(),
            };
            (name.clone(), pose)
        });
        FramePose {
            time_s: pose.time_s,
            camera_position_m: pose.camera.position_bu * scale,
            camera_from_inertial: CAMERA_FROM_BLENDER_CAMERA * pose.camera.world_from_object.inverse(),
            camera_velocity_m_s: None,
            sun_position_m: Some(from + towards_sun * self.sun_distance_m),
            bodies: bodies.collect(),
        }
    }
}

/// A unit quaternion from (w, x, y, z); `None` where its norm is too far from 1.
pub(crate) fn unit_quaternion([w, x, y, z]: [f64; 4]) -> Option<DQuat> {
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    ((quaternion.length() - 1.0).abs() <= NORM_TOLERANCE).then(|| quaternion.normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_looks_along_blenders_minus_z_with_y_up() {
        // Blender's camera without a turn, at (0, 0, 5), sees (1, 2, 0) five units ahead, to the
        // right and above.
        let pose = Pose {
            time_s: 0.0,
            sun_position_bu: DVec3::new(0.0, 3.0, 0.0),
            camera: ObjectPose { position_bu: DVec3::new(0.0, 0.0, 5.0), ..ObjectPose::default() },
            bodies: vec![ObjectPose { position_bu: DVec3::new(1.0, 2.0, 0.0), ..ObjectPose::default() }],
        };
        let world = World { scale_m_per_bu: 10.0, sun_distance_m: 1e6, body_names: vec!["body".into()] };
        let frame = world.frame(&pose);
        let seen = frame.camera_from_inertial * (frame.bodies["body"].position_m - frame.camera_position_m);
        assert!((seen - DVec3::new(10.0, -20.0, 50.0)).length() < 1e-12, "{seen}");
        assert_eq!(frame.sun_position_m, Some(DVec3::new(10.0, 1e6 + 20.0, 0.0)));
    }

    #[test]
    fn bodies_turn_from_their_axes_to_the_world() {
        // A quarter turn about z takes the body's x to the world's y.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let turned = ObjectPose {
            world_from_object: unit_quaternion([half, 0.0, 0.0, half]).unwrap(),
            ..ObjectPose::default()
        };
        let pose = Pose {
            time_s: 0.0,
            sun_position_bu: DVec3::ZERO,
            camera: ObjectPose::default(),
            bodies: vec![turned],
        };
        let world = World { scale_m_per_bu: 1.0, sun_distance_m: 2.0, body_names: vec!["a".into()] };
        let frame = world.frame(&pose);
        let body_y_in_body = frame.bodies["a"].body_from_inertial * DVec3::Y;
        assert!((body_y_in_body - DVec3::X).length() < 1e-12);
        assert_eq!(frame.sun_position_m, Some(DVec3::new(0.0, 0.0, 2.0)));
        assert!(unit_quaternion([1.0002, 0.0, 0.0, 0.0]).is_none());
    }
}
