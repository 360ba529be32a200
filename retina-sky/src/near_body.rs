//! Trajectories about a body whose own orbit does not matter: the body rests at the origin, and the Sun stands still.
//!
//! Directions are inertial. The plane of phase angles holds the Sun's direction s and t = n x s, where n is the normal. A
//! camera at phase angle phi is at cos(phi) s + sin(phi) t, in its distance from the body's centre.

use std::path::Path;

use glam::{DQuat, DVec3};

use crate::orientation::RotationalElements;
use crate::trajectory::{BodyPose, FramePose, Trajectory, look_at};

/// How the camera moves. It always points at the body's centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraPath {
    /// Once around, at a steady rate, about the normal; `start_rad` from the place nearest to the Sun's direction.
    Orbit {
        /// Distance from the centre, m.
        distance_m: f64,
        /// Time of a revolution, s.
        period_s: f64,
        /// Where the first frame is.
        start_rad: f64,
    },
    /// Straight and steady; the middle frame is the nearest.
    Flyby {
        /// Least distance from the centre, m.
        closest_m: f64,
        /// Speed, m s^-1.
        speed_m_s: f64,
        /// Phase angle of the nearest place, where the direction allows it.
        phase_rad: f64,
        /// Unit vector of the motion; along the plane of phase angles where absent.
        direction: Option<DVec3>,
    },
    /// Phase angles one after the other in even steps, at one distance.
    PhaseSweep {
        /// Distance from the centre, m.
        distance_m: f64,
        /// Of the first and the last frame.
        phases_rad: [f64; 2],
    },
    /// Straight towards the body, or away from it, at one phase angle.
    Approach {
        /// Of the first and the last frame, m.
        distances_m: [f64; 2],
        /// Phase angle.
        phase_rad: f64,
    },
}

/// A steady rotation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spin {
    /// Right ascension and declination of the pole, rad.
    pub pole_rad: [f64; 2],
    /// The prime meridian's angle W at the first frame, rad.
    pub w_rad: f64,
    /// Time of a revolution, s; negative: against the pole's sense.
    pub period_s: f64,
}

/// A trajectory about one body.
#[derive(Debug, Clone, PartialEq)]
pub struct NearBody {
    /// Name of the body.
    pub body: String,
    /// How the camera moves.
    pub path: CameraPath,
    /// Number of frames, one at least.
    pub frames: usize,
    /// Time between them, s.
    pub step_s: f64,
    /// Time of the first, TDB seconds since J2000.
    pub epoch_tdb_s: f64,
    /// The Sun from the body's centre, m.
    pub sun_m: DVec3,
    /// Unit normal n, which is also up in the images.
    pub normal: DVec3,
    /// The body's rotation; `None`: its axes are the inertial ones.
    pub spin: Option<Spin>,
}

impl NearBody {
    /// The frames.
    pub fn generate(&self) -> Trajectory {
        let sun = self.sun_m.normalize();
        // Where the Sun is on the normal itself, any direction across will do.
        let across = self.normal.cross(sun).try_normalize().unwrap_or_else(|| sun.any_orthonormal_vector());
        let at_phase = |phase_rad: f64| phase_rad.cos() * sun + phase_rad.sin() * across;
        let last = (self.frames.max(2) - 1) as f64;
        let frames = (0..self.frames)
            .map(|index| {
                let passed_s = index as f64 * self.step_s;
                let share = index as f64 / last;
                let between = |[first, end]: [f64; 2]| first + share * (end - first);
                let camera_m = match self.path {
                    CameraPath::Orbit { distance_m, period_s, start_rad } => {
                        let angle = start_rad + std::f64::consts::TAU * passed_s / period_s;
                        let ahead = across.cross(self.normal).try_normalize().unwrap_or(sun);
                        let side = self.normal.cross(ahead);
                        distance_m * (angle.cos() * ahead + angle.sin() * side)
                    }
                    CameraPath::Flyby { closest_m, speed_m_s, phase_rad, direction } => {
                        let nearest = at_phase(phase_rad);
                        let along =
                            direction.unwrap_or_else(|| at_phase(phase_rad + std::f64::consts::FRAC_PI_2));
                        let nearest = (nearest - nearest.dot(along) * along)
                            .try_normalize()
                            .unwrap_or_else(|| along.any_orthonormal_vector());
                        let middle_s = 0.5 * (self.frames - 1) as f64 * self.step_s;
                        closest_m * nearest + speed_m_s * (passed_s - middle_s) * along
                    }
                    CameraPath::PhaseSweep { distance_m, phases_rad } => {
                        distance_m * at_phase(between(phases_rad))
                    }
                    CameraPath::Approach { distances_m, phase_rad } => {
                        between(distances_m) * at_phase(phase_rad)
                    }
                };
                let body = BodyPose {
                    position_m: DVec3::ZERO,
                    body_from_inertial: self.body_from_inertial(passed_s),
                };
                FramePose {
                    time_s: self.epoch_tdb_s + passed_s,
                    camera_position_m: camera_m,
                    camera_from_inertial: look_at(-camera_m, self.normal),
                    camera_velocity_m_s: None,
                    sun_position_m: Some(self.sun_m),
                    bodies: [(self.body.clone(), body)].into(),
                }
            })
            .collect();
        Trajectory::new(Path::new("trajectory"), frames)
    }

    fn body_from_inertial(&self, passed_s: f64) -> DQuat {
        self.spin.map_or(DQuat::IDENTITY, |spin| {
            let turned_rad = std::f64::consts::TAU * passed_s / spin.period_s;
            let elements = RotationalElements {
                alpha0_rad: spin.pole_rad[0],
                delta0_rad: spin.pole_rad[1],
                w_rad: spin.w_rad + turned_rad,
            };
            elements.body_from_inertial()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(path: CameraPath) -> NearBody {
        NearBody {
            body: "rock".to_owned(),
            path,
            frames: 9,
            step_s: 60.0,
            epoch_tdb_s: 1000.0,
            sun_m: 1.5e11 * DVec3::X,
            normal: DVec3::Z,
            spin: None,
        }
    }

    fn phase_rad(frame: &FramePose) -> f64 {
        frame.camera_position_m.angle_between(frame.sun_position_m.unwrap())
    }

    #[test]
    fn the_camera_looks_at_the_body_with_the_normal_up() {
        for path in [
            CameraPath::Orbit { distance_m: 5e4, period_s: 480.0, start_rad: 0.3 },
            CameraPath::Flyby { closest_m: 2e4, speed_m_s: 50.0, phase_rad: 0.7, direction: None },
            CameraPath::PhaseSweep { distance_m: 1e5, phases_rad: [0.1, 2.5] },
            CameraPath::Approach { distances_m: [1e6, 1e4], phase_rad: 1.0 },
        ] {
            let made = near(path).generate();
            assert_eq!(made.frames.len(), 9);
            for frame in &made.frames {
                let seen = frame.camera_from_inertial * (-frame.camera_position_m);
                assert!(seen.truncate().length() < 1e-6 * seen.z, "{seen}");
                let up = frame.camera_from_inertial * DVec3::Z;
                assert!(up.x.abs() < 1e-9 && up.y < 0.0, "{up}");
            }
        }
    }

    #[test]
    fn each_path_is_its_own_closed_form() {
        let sweep = near(CameraPath::PhaseSweep { distance_m: 1e5, phases_rad: [0.0, 2.4] }).generate();
        for (k, frame) in sweep.frames.iter().enumerate() {
            assert!((phase_rad(frame) - 0.3 * k as f64).abs() < 1e-7, "{k}");
            assert!((frame.camera_position_m.length() - 1e5).abs() < 1e-6);
        }
        let approach = near(CameraPath::Approach { distances_m: [9e5, 1e5], phase_rad: 1.0 }).generate();
        assert!((approach.frames[4].camera_position_m.length() - 5e5).abs() < 1e-6);
        assert!((phase_rad(&approach.frames[8]) - 1.0).abs() < 1e-9);
        let flyby =
            near(CameraPath::Flyby { closest_m: 2e4, speed_m_s: 50.0, phase_rad: 0.7, direction: None })
                .generate();
        for (k, frame) in flyby.frames.iter().enumerate() {
            let along = 50.0 * 60.0 * (k as f64 - 4.0);
            assert!((frame.camera_position_m.length() - along.hypot(2e4)).abs() < 1e-6);
        }
        assert!((phase_rad(&flyby.frames[4]) - 0.7).abs() < 1e-9);
        // Eight steps are one revolution; a quarter of one is ahead of the start by the right hand about the normal.
        let orbit = near(CameraPath::Orbit { distance_m: 5e4, period_s: 480.0, start_rad: 0.0 }).generate();
        let [first, quarter, last] = [0, 2, 8].map(|k| orbit.frames[k].camera_position_m);
        assert!(first.distance(5e4 * DVec3::X) < 1e-6 && first.distance(last) < 1e-6);
        assert!(quarter.distance(5e4 * DVec3::Y) < 1e-6);
        // About the Sun's direction: always half lit.
        let terminator = NearBody {
            normal: DVec3::X,
            ..near(CameraPath::Orbit { distance_m: 5e4, period_s: 480.0, start_rad: 0.0 })
        };
        for frame in terminator.generate().frames {
            assert!((phase_rad(&frame) - std::f64::consts::FRAC_PI_2).abs() < 1e-6);
        }
    }

    #[test]
    fn a_spin_turns_the_prime_meridian_about_the_pole() {
        let spin = Spin { pole_rad: [0.2, 1.1], w_rad: 0.5, period_s: 240.0 };
        let spun = NearBody {
            spin: Some(spin),
            ..near(CameraPath::Approach { distances_m: [1e5, 1e5], phase_rad: 0.0 })
        };
        let frames = spun.generate().frames;
        let pole = DVec3::new(1.1f64.cos() * 0.2f64.cos(), 1.1f64.cos() * 0.2f64.sin(), 1.1f64.sin());
        for frame in &frames {
            assert!((frame.bodies["rock"].body_from_inertial * pole).distance(DVec3::Z) < 1e-12);
        }
        // A quarter of a revolution: the direction that the x axis had is now at -90 deg of longitude.
        let [now, then] = [0, 1].map(|k| frames[k].bodies["rock"].body_from_inertial);
        let x = now.inverse() * DVec3::X;
        assert!((then * x).distance(-DVec3::Y) < 1e-12, "{}", then * x);
    }
}
