//! Frames of a spacecraft's camera, as SPICE kernels have it: where it was, how it was turned, and what it saw of bodies.
//!
//! Bodies stand where the camera sees them: light-time, the Sun's deflection and aberration are in their places, as in
//! those of stars. A body's axes are those of the moment at which its light left it, and so is the Sun over it.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use crate::ephemeris::{Ephemeris, EphemerisError, LIGHT_SPEED_M_S};
use crate::observer::{Observer, ObserverError};
use crate::trajectory::{BodyPose, FramePose, Trajectory, look_at};

/// Passes of the light-time: each gains a factor of c over the body's speed, 10^4 and more.
const LIGHT_TIME_PASSES: usize = 3;

/// Nearer to a body's centre there is no direction to it, m: the rounding of barycentric places.
const LEAST_DISTANCE_M: f64 = 0.1;

/// What the camera's axes are.
#[derive(Debug, Clone, PartialEq)]
pub enum Pointing {
    /// A frame of the kernels by name or NAIF's number, and the rotation from its axes to the camera's (+x right, +y
    /// down, +z boresight).
    Frame {
        /// Its name.
        name: String,
        /// The fixed rotation.
        camera_from_frame: DQuat,
    },
    /// At the first body's centre, celestial north up.
    FirstBody,
}

/// The frames that are wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct SpacecraftFrames {
    /// The spacecraft, by name or NAIF's number.
    pub observer: String,
    /// Its camera's axes.
    pub pointing: Pointing,
    /// The bodies that it looks at, by name or NAIF's number.
    pub bodies: Vec<String>,
    /// How many.
    pub frames: usize,
    /// Time between them, s.
    pub step_s: f64,
    /// Time of the first, TDB seconds since J2000.
    pub epoch_tdb_s: f64,
}

/// The rotation from a frame's axes to those of a camera whose right, down and boresight are these axes of the frame, such
/// as `+x`, `-y`; `None` where they are no right-handed three.
pub fn camera_from_axes(right_down_boresight: [&str; 3]) -> Option<DQuat> {
    let axis = |name: &str| {
        let (sign, letter) = match name.strip_prefix('-') {
            Some(letter) => (-1.0, letter),
            None => (1.0, name.strip_prefix('+').unwrap_or(name)),
        };
        let axis = match letter {
            "x" | "X" => DVec3::X,
            "y" | "Y" => DVec3::Y,
            "z" | "Z" => DVec3::Z,
            _ => return None,
        };
        Some(sign * axis)
    };
    let [right, down, boresight] = right_down_boresight.map(axis);
    let rows = DMat3::from_cols(right?, down?, boresight?);
    ((rows.determinant() - 1.0).abs() < 1e-9).then(|| DQuat::from_mat3(&rows.transpose()).normalize())
}

impl SpacecraftFrames {
    /// The frames, barycentric.
    ///
    /// # Errors
    /// The kernels lack the spacecraft, a body, its axes or the camera's at an epoch; there is no body to point at.
    pub fn generate(&self, ephemeris: &Ephemeris) -> Result<Trajectory, EphemerisError> {
        let frames = (0..self.frames)
            .map(|index| self.frame(ephemeris, self.epoch_tdb_s + index as f64 * self.step_s))
            .collect::<Result<Vec<_>, _>>()?;
        let mut made = Trajectory::new(Path::new(&self.observer), frames);
        made.turned_by_ephemeris = true;
        Ok(made)
    }

    fn frame(&self, ephemeris: &Ephemeris, tdb_s: f64) -> Result<FramePose, EphemerisError> {
        let own = ephemeris.state(&self.observer, tdb_s)?;
        let observer =
            Observer::new(ephemeris, tdb_s, own.position_m, Some(own.velocity_m_s)).map_err(|error| {
                match error {
                    ObserverError::Ephemeris(error) => error,
                    error => EphemerisError::Kernel {
                        kernels: ephemeris.name(),
                        body: self.observer.clone(),
                        tdb_s,
                        reason: error.to_string(),
                    },
                }
            })?;
        let mut pose = FramePose {
            time_s: tdb_s,
            camera_position_m: own.position_m,
            camera_from_inertial: DQuat::IDENTITY,
            camera_velocity_m_s: Some(own.velocity_m_s),
            sun_position_m: Some(observer.bodies().sun.position_m),
            bodies: Default::default(),
        };
        for (number, name) in self.bodies.iter().enumerate() {
            let mut light_time_s = 0.0;
            for _ in 0..LIGHT_TIME_PASSES {
                let there_m = ephemeris.state(name, tdb_s - light_time_s)?.position_m;
                light_time_s = there_m.distance(own.position_m) / LIGHT_SPEED_M_S;
            }
            let left_s = tdb_s - light_time_s;
            let there_m = ephemeris.state(name, left_s)?.position_m;
            let from_m = there_m - own.position_m;
            let seen =
                if from_m.length() < LEAST_DISTANCE_M { DVec3::Z } else { observer.apparent_source(from_m) };
            let position_m = own.position_m + seen * from_m.length();
            let turned = ephemeris.body_from_inertial(name, left_s)?;
            let body_from_inertial = turned.ok_or_else(|| EphemerisError::Attitude {
                frame: name.clone(),
                tdb_s: left_s,
                reason: "no kernel turns this body; name one (.tpc, .bpc, or .bc with .tf and .tsc)"
                    .to_owned(),
            })?;
            if number == 0 {
                pose.sun_position_m = Some(position_m + ephemeris.solar_system(left_s)?.sun_from_m(there_m));
            }
            pose.bodies.insert(name.clone(), BodyPose { position_m, body_from_inertial });
        }
        pose.camera_from_inertial = match &self.pointing {
            Pointing::Frame { name, camera_from_frame } => {
                (*camera_from_frame * ephemeris.frame_from_inertial(name, tdb_s)?).normalize()
            }
            Pointing::FirstBody => {
                let first = self.bodies.first().and_then(|name| pose.bodies.get(name));
                let towards = first.ok_or_else(|| EphemerisError::Attitude {
                    frame: "the camera".to_owned(),
                    tdb_s,
                    reason: "there is no body to point at; name a frame".to_owned(),
                })?;
                let towards_m = towards.position_m - own.position_m;
                if towards_m.length() < LEAST_DISTANCE_M {
                    return Err(EphemerisError::Attitude {
                        frame: "the camera".to_owned(),
                        tdb_s,
                        reason: format!(
                            "{} is at the centre of the body that it is to point at",
                            self.observer
                        ),
                    });
                }
                look_at(towards_m, DVec3::Z)
            }
        };
        Ok(pose)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_named_in_a_right_handed_order() {
        assert_eq!(camera_from_axes(["+x", "+y", "+z"]), Some(DQuat::IDENTITY));
        let turned = camera_from_axes(["-Y", "x", "+z"]).unwrap();
        // The frame's x is the camera's down, its y the camera's left.
        assert!((turned * DVec3::X).abs_diff_eq(DVec3::Y, 1e-12));
        assert!((turned * DVec3::Y).abs_diff_eq(-DVec3::X, 1e-12));
        for wrong in [["x", "y", "-z"], ["x", "x", "z"], ["x", "y", "up"], ["", "y", "z"]] {
            assert_eq!(camera_from_axes(wrong), None, "{wrong:?}");
        }
    }
}
