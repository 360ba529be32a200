//! One frame of a scene: where camera, bodies and Sun are.

use glam::{DMat3, DQuat, DVec3};
use retina_files::InputError;
use retina_geometry::{Distortion, Pinhole};
use retina_render::{BodyState, FrameState};
use retina_sky::ephemeris::sun_from_body_m;

use crate::Scene;

/// Camera, bodies and Sun of one frame.
#[derive(Debug, Clone)]
pub struct SceneFrame {
    /// Number of the frame, from 0.
    pub index: usize,
    /// TDB seconds since J2000.
    pub time_s: f64,
    /// From ICRF to the camera's axes.
    pub camera_from_inertial: DQuat,
    /// From each body's axes to the camera's, as a unit quaternion.
    pub camera_from_body: Vec<DQuat>,
    /// The bodies as the renderer takes them, in the scene's order.
    pub bodies: Vec<BodyState>,
}

impl SceneFrame {
    /// What the renderer is asked for: this frame in an image.
    pub fn state(&self, image: Pinhole, distortion: Option<Distortion>) -> FrameState {
        FrameState { image, distortion, bodies: self.bodies.clone() }
    }
}

impl Scene {
    /// The geometry of frame `index`, from 0.
    ///
    /// # Errors
    /// There is no such frame, or the trajectory does not say where the Sun is.
    pub fn frame(&self, index: usize) -> Result<SceneFrame, InputError> {
        let Some(pose) = self.trajectory.frames.get(index) else {
            return Err(InputError::new(&self.trajectory.source, "there is no such frame")
                .found(format!("frame {index}"))
                .expected(format!("0 to {}", self.frame_count().saturating_sub(1))));
        };
        let sun_m = self.sun_position_m(index)?;
        let camera_from_inertial = DMat3::from_quat(pose.camera_from_inertial);
        let (mut camera_from_body, mut bodies) = (Vec::new(), Vec::new());
        for body in &self.bodies {
            let (position_m, body_from_inertial) = pose
                .bodies
                .get(&body.name)
                .map_or((DVec3::ZERO, DQuat::IDENTITY), |at| (at.position_m, at.body_from_inertial));
            let rotation = DMat3::from_quat(body_from_inertial);
            bodies.push(BodyState {
                position_camera_m: camera_from_inertial * (position_m - pose.camera_position_m),
                camera_from_body: camera_from_inertial * rotation.transpose(),
                sun_position_body_m: rotation * (sun_m - position_m),
            });
            camera_from_body.push(pose.camera_from_inertial * body_from_inertial.inverse());
        }
        Ok(SceneFrame {
            index,
            time_s: pose.time_s,
            camera_from_inertial: pose.camera_from_inertial,
            camera_from_body,
            bodies,
        })
    }

    /// The Sun, ICRF m in the frame of the positions: from the trajectory's columns, or from the
    /// ephemeris where the Moon or the Earth stands at the origin.
    fn sun_position_m(&self, index: usize) -> Result<DVec3, InputError> {
        let pose = &self.trajectory.frames[index];
        if let Some(sun_m) = pose.sun_position_m {
            return Ok(sun_m);
        }
        let at_origin = |name: &str| pose.bodies.get(name).is_none_or(|body| body.position_m == DVec3::ZERO);
        for body in self.bodies.iter().filter(|body| at_origin(&body.name)) {
            let sun_m = sun_from_body_m(&body.name, pose.time_s).map_err(|error| {
                self.trajectory
                    .error_at(index, error.to_string())
                    .help("give the Sun in columns sun_x_m, sun_y_m, sun_z_m")
            })?;
            if let Some(sun_m) = sun_m {
                return Ok(sun_m);
            }
        }
        Err(self
            .trajectory
            .error_at(index, "nothing says where the Sun is")
            .expected("columns sun_x_m, sun_y_m, sun_z_m, or a body `moon` or `earth` at the origin")
            .help("add the three columns: metres, in the frame of the other positions"))
    }
}
