//! One frame of a scene: where camera, bodies and Sun are.

use glam::{DMat3, DQuat, DVec3};
use retina_files::InputError;
use retina_geometry::{Distortion, Pinhole};
use retina_render::{BodyState, FrameState};
use retina_sky::BodyPose;
use retina_sky::ephemeris::{EphemerisError, LIGHT_SPEED_M_S};
use retina_sky::observer::Observer;
use retina_sky::planets::{Planet, seen_planet};

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
    /// The camera, ICRF m in the trajectory's frame.
    pub camera_position_m: DVec3,
    /// The camera's velocity, m/s, where it is given.
    pub camera_velocity_m_s: Option<DVec3>,
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
        let places = self.bodies.iter().map(|body| self.body_pose(index, &body.name));
        let places = places.collect::<Result<Vec<BodyPose>, InputError>>()?;
        let sun_m = self.sun_position_m(index, &places)?;
        let camera_from_inertial = DMat3::from_quat(pose.camera_from_inertial);
        let (mut camera_from_body, mut bodies) = (Vec::new(), Vec::new());
        for BodyPose { position_m, body_from_inertial } in places {
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
            camera_position_m: pose.camera_position_m,
            camera_velocity_m_s: pose.camera_velocity_m_s,
            camera_from_body,
            bodies,
        })
    }

    /// The kernel that turns a body, where one does: a trajectory's columns come first, and a scene without stars takes
    /// no axes from an ephemeris.
    pub(crate) fn axes_by_kernel(&self, name: &str) -> Option<String> {
        let given = self.trajectory.given.get(name).copied().unwrap_or_default();
        let by_ephemeris =
            if given.orientation { self.trajectory.turned_by_ephemeris } else { self.stars.is_some() };
        by_ephemeris.then(|| self.ephemeris.axes_source(name)).flatten()
    }

    /// Where a body is: from the trajectory's columns; without them at the origin, aligned, or, in
    /// a scene with stars, where the ephemeris has it as seen from the camera.
    fn body_pose(&self, index: usize, name: &str) -> Result<BodyPose, InputError> {
        let pose = &self.trajectory.frames[index];
        let given = self.trajectory.given.get(name).copied().unwrap_or_default();
        let at = pose.bodies.get(name).copied();
        let at = at.unwrap_or(BodyPose { position_m: DVec3::ZERO, body_from_inertial: DQuat::IDENTITY });
        if self.stars.is_none() || (given.position && given.orientation) {
            return Ok(at);
        }
        let missing = |problem: String, columns: &str| {
            self.trajectory
                .error_at(index, problem)
                .expected(columns)
                .help("with a table [stars] the origin is the Solar System's barycentre, so a body has its place and axes from columns, or is one whose ephemeris is known")
        };
        let wrong = |error: &dyn std::fmt::Display| self.trajectory.error_at(index, error.to_string());
        let observer =
            Observer::new(&self.ephemeris, pose.time_s, pose.camera_position_m, pose.camera_velocity_m_s)
                .map_err(|error| wrong(&error))?;
        let mut light_time_s = 0.0;
        let position_m = if given.position {
            at.position_m
        } else {
            let planet = Planet::from_name(name).map(|planet| seen_planet(&observer, planet));
            let Some(seen) = planet.transpose().map_err(|error| wrong(&error))?.flatten() else {
                return Err(missing(
                    format!("nothing says where the body `{name}` is"),
                    &format!(
                        "columns {name}_x_m, {name}_y_m, {name}_z_m, or the name of a planet or `moon` that the camera is outside of"
                    ),
                ));
            };
            light_time_s = seen.distance_m / LIGHT_SPEED_M_S;
            pose.camera_position_m + seen.direction * seen.distance_m
        };
        let body_from_inertial = if given.orientation {
            at.body_from_inertial
        } else {
            let known = self.ephemeris.body_from_inertial(name, pose.time_s - light_time_s);
            known.map_err(|error| wrong(&error))?.ok_or_else(|| {
                missing(
                    format!("nothing says how the body `{name}` is turned"),
                    &format!("columns {name}_from_inertial_w, _x, _y, _z, one of moon, earth, mars, saturn, uranus, whose axes are known, or a PCK kernel that has the body"),
                )
            })?
        };
        Ok(BodyPose { position_m, body_from_inertial })
    }

    /// The Sun, ICRF m in the frame of the positions: from the trajectory's columns, or from the
    /// ephemeris where there are stars, or where the Moon or the Earth stands at the origin.
    fn sun_position_m(&self, index: usize, places: &[BodyPose]) -> Result<DVec3, InputError> {
        let pose = &self.trajectory.frames[index];
        if let Some(sun_m) = pose.sun_position_m {
            return Ok(sun_m);
        }
        let no_sun = |error: EphemerisError| {
            self.trajectory
                .error_at(index, error.to_string())
                .help("give the Sun in columns sun_x_m, sun_y_m, sun_z_m")
        };
        if self.stars.is_some() {
            let lit_m = places.first().map_or(pose.camera_position_m, |place| place.position_m);
            return Ok(lit_m + self.ephemeris.solar_system(pose.time_s).map_err(no_sun)?.sun_from_m(lit_m));
        }
        for (body, _) in self.bodies.iter().zip(places).filter(|(_, at)| at.position_m == DVec3::ZERO) {
            if let Some(sun_m) = self.ephemeris.sun_from_body_m(&body.name, pose.time_s).map_err(no_sun)? {
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
