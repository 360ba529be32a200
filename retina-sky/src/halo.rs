//! A LUMIO-like quasi-halo: an Earth-Moon L2 halo orbit laid over the real motion of the Moon.
//!
//! The southern L2 halo of the circular problem with the wanted Jacobi constant is carried into
//! the pulsating rotating frame of the ephemeris: x from Earth to Moon, z along the Moon's orbital
//! angular momentum, unit of length the instantaneous distance, time at the sidereal mean motion.
//! The camera looks at the Moon's centre. This is a sequence with the geometry of the mission's
//! operational orbit (Cipriano et al. 2018, "Orbit design for LUMIO": quasi-halo, C_J = 3.09), not
//! a trajectory that forces of the full model would keep.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use thiserror::Error;

use crate::DAY_S;
pub use crate::cr3bp::NoOrbit;
use crate::cr3bp::{self, MU, TOLERANCE, dynamics, southern_l2_halo};
use crate::ephemeris::{Ephemeris, EphemerisError};
use crate::ode::integrate;
use crate::orientation::RotationalElements;
use crate::trajectory::{BodyPose, FramePose, Trajectory, look_at};

/// Mean motion of the Moon: a turn in a sidereal month of 27.321661 days.
const MEAN_MOTION_RAD_S: f64 = TAU / (27.321_661 * DAY_S);
/// Half-width of the central difference of the pulsating frame: truncation 3e-6 m/s at the
/// camera's distance, rounding of the ephemeris about as much.
const FRAME_DIFFERENCE_S: f64 = 120.0;
/// New Moon of 2027 August 2, TDB seconds since J2000 (10:05:11 UT).
const NEW_MOON_TDB_S: f64 = 870_473_180.0;
/// Frames of the default sequence.
const FRAMES: usize = 4321;
/// Time between frames of the default sequence, seconds.
const STEP_S: f64 = 300.0;

/// A halo sequence that cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum HaloError {
    /// No frames.
    #[error("a halo sequence needs one frame at least")]
    NoFrames,
    /// A field is no finite number.
    #[error("{name} of a halo sequence must be a finite number (found {found})")]
    NotFinite {
        /// The field's name.
        name: &'static str,
        /// The value found.
        found: f64,
    },
    /// The family of southern L2 halos has no such member within reach.
    #[error(transparent)]
    NoOrbit(#[from] NoOrbit),
    /// The equations of motion could not be integrated to this time.
    #[error("the halo orbit could not be integrated to frame {frame}")]
    Integration {
        /// The frame.
        frame: usize,
    },
    /// A frame lies outside the ephemeris.
    #[error(transparent)]
    Ephemeris(#[from] EphemerisError),
}

/// What to generate.
#[derive(Debug, Clone, PartialEq)]
pub struct LumioHalo {
    /// Time of the first frame, TDB seconds since J2000.
    pub epoch_tdb_s: f64,
    /// Number of frames.
    pub frames: usize,
    /// Time between frames, seconds.
    pub step_s: f64,
    /// Jacobi constant of the halo orbit, x^2 + y^2 + 2 (1 - mu) / r1 + 2 mu / r2 - v^2, without
    /// the mu (1 - mu) = 0.0120 that some authors add; 3.016 to 3.152.
    pub jacobi: f64,
    /// Where on the orbit the first frame is, in periods from the southernmost crossing of the
    /// xz plane, which is the one far from the Moon.
    pub phase_periods: f64,
}

impl Default for LumioHalo {
    /// 15 days in 4321 frames, new Moon (of 2027 August 2) in the middle: the far side is lit.
    fn default() -> Self {
        Self::centred_on(NEW_MOON_TDB_S, FRAMES, STEP_S)
    }
}

/// What came out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HaloSummary {
    /// Jacobi constant of the orbit found.
    pub jacobi: f64,
    /// Largest change of the Jacobi constant along the frames.
    pub jacobi_drift: f64,
    /// Period of the halo orbit, days.
    pub period_days: f64,
    /// What is left of y, vx and vz (largest) half a period from the start, units of the problem.
    pub half_period_residual: f64,
    /// Least distance to the Moon's centre, metres.
    pub distance_min_m: f64,
    /// Greatest distance to the Moon's centre, metres.
    pub distance_max_m: f64,
    /// Least phase angle (Sun - Moon - camera), radians.
    pub phase_min_rad: f64,
    /// Greatest phase angle, radians.
    pub phase_max_rad: f64,
    /// Share of the frames with a phase angle below a right angle.
    pub lit_fraction: f64,
}

impl fmt::Display for HaloSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "L2 halo with C_J = {:.9} (drift {:.1e}), period {:.4} days, half-period residual {:.1e}; \
             Moon at {:.0} to {:.0} km, phase {:.1} to {:.1} deg, below 90 deg in {:.1} % of the frames",
            self.jacobi,
            self.jacobi_drift,
            self.period_days,
            self.half_period_residual,
            self.distance_min_m / 1e3,
            self.distance_max_m / 1e3,
            self.phase_min_rad.to_degrees(),
            self.phase_max_rad.to_degrees(),
            100.0 * self.lit_fraction,
        )
    }
}

impl LumioHalo {
    /// A sequence whose middle is at `middle_tdb_s`, otherwise as the default; the new Moon to
    /// put there is found by [`Ephemeris::next_new_moon_s`].
    ///
    /// It starts at the crossing near the Moon: half a revolution on, in the middle of 15 days, the
    /// camera drifts past the far one the same way as the Sun does, and sees a lit disc longest.
    pub fn centred_on(middle_tdb_s: f64, frames: usize, step_s: f64) -> Self {
        let half_s = 0.5 * frames.saturating_sub(1) as f64 * step_s;
        Self { epoch_tdb_s: middle_tdb_s - half_s, frames, step_s, jacobi: 3.09, phase_periods: 0.5 }
    }

    /// The frames, Moon-centred on ICRF axes, and what they are like.
    ///
    /// A frame carries the camera's position and velocity relative to the Moon, its attitude (+z
    /// to the Moon's centre, image up towards the Moon's north), the Sun as seen from the Moon
    /// (light-time in it) and the Moon at the origin with its IAU axes.
    ///
    /// # Errors
    /// No frames, numbers that are not finite, a Jacobi constant outside the family, epochs
    /// outside the ephemeris.
    pub fn generate(&self, ephemeris: &Ephemeris) -> Result<(Trajectory, HaloSummary), HaloError> {
        if self.frames == 0 {
            return Err(HaloError::NoFrames);
        }
        for (name, found) in
            [("step_s", self.step_s), ("phase_periods", self.phase_periods), ("jacobi", self.jacobi)]
        {
            if !found.is_finite() {
                return Err(HaloError::NotFinite { name, found });
            }
        }
        let orbit = southern_l2_halo(self.jacobi)?;
        let mut summary = HaloSummary {
            jacobi: cr3bp::jacobi(&orbit.start),
            jacobi_drift: 0.0,
            period_days: orbit.period / MEAN_MOTION_RAD_S / DAY_S,
            half_period_residual: orbit.residual,
            distance_min_m: f64::INFINITY,
            distance_max_m: 0.0,
            phase_min_rad: f64::INFINITY,
            phase_max_rad: 0.0,
            lit_fraction: 0.0,
        };
        let mut frames: Vec<FramePose> = Vec::new();
        let (mut state, mut at) = (orbit.start, 0.0);
        for frame in 0..self.frames {
            let since_start_s = frame as f64 * self.step_s;
            let turn = self.phase_periods * orbit.period + MEAN_MOTION_RAD_S * since_start_s;
            let wanted = turn.rem_euclid(orbit.period);
            // A new revolution starts from the corrected crossing, so that the orbit's instability
            // has one period at most to grow rounding in.
            if wanted < at {
                (state, at) = (orbit.start, 0.0);
            }
            state =
                integrate(dynamics, state, wanted - at, TOLERANCE).ok_or(HaloError::Integration { frame })?;
            at = wanted;
            let previous = frames.last().map(|pose| pose.camera_from_inertial);
            let pose = frame_pose(ephemeris, self.epoch_tdb_s + since_start_s, &state, previous)?;
            summary.take(&pose, (cr3bp::jacobi(&state) - summary.jacobi).abs());
            frames.push(pose);
        }
        summary.lit_fraction /= self.frames as f64;
        Ok((Trajectory::new(Path::new("lumio-halo"), frames), summary))
    }
}

impl HaloSummary {
    /// Widens the ranges by a frame.
    fn take(&mut self, pose: &FramePose, jacobi_drift: f64) {
        let distance_m = pose.camera_position_m.length();
        self.jacobi_drift = self.jacobi_drift.max(jacobi_drift);
        self.distance_min_m = self.distance_min_m.min(distance_m);
        self.distance_max_m = self.distance_max_m.max(distance_m);
        if let Some(sun_m) = pose.sun_position_m {
            let phase_rad = pose.camera_position_m.angle_between(sun_m);
            self.phase_min_rad = self.phase_min_rad.min(phase_rad);
            self.phase_max_rad = self.phase_max_rad.max(phase_rad);
            self.lit_fraction += f64::from(u8::from(phase_rad < std::f64::consts::FRAC_PI_2));
        }
    }
}

/// The frame at a state of the circular problem.
fn frame_pose(
    ephemeris: &Ephemeris,
    tdb_s: f64,
    state: &cr3bp::Phase,
    previous: Option<DQuat>,
) -> Result<FramePose, HaloError> {
    let from_moon = DVec3::new(state[0] - 1.0 + MU, state[1], state[2]);
    let velocity = DVec3::new(state[3], state[4], state[5]);
    let pulsating = pulsating_frame(ephemeris, tdb_s)?;
    let rate = (pulsating_frame(ephemeris, tdb_s + FRAME_DIFFERENCE_S)?
        - pulsating_frame(ephemeris, tdb_s - FRAME_DIFFERENCE_S)?)
        * (0.5 / FRAME_DIFFERENCE_S);
    let position_m = pulsating * from_moon;
    let moon_from_inertial = RotationalElements::moon(tdb_s).body_from_inertial();
    let bodies = ephemeris.solar_system(tdb_s)?;
    let camera_from_inertial = look_at(-position_m, moon_from_inertial.inverse() * DVec3::Z);
    Ok(FramePose {
        time_s: tdb_s,
        camera_position_m: position_m,
        // One sign from frame to frame: interpolation and plots want no jumps.
        camera_from_inertial: match previous {
            Some(previous) if previous.dot(camera_from_inertial) < 0.0 => -camera_from_inertial,
            _ => camera_from_inertial,
        },
        camera_velocity_m_s: Some(pulsating * velocity * MEAN_MOTION_RAD_S + rate * from_moon),
        sun_position_m: Some(bodies.sun_from_m(bodies.moon.position_m)),
        bodies: BTreeMap::from([(
            "moon".to_owned(),
            BodyPose { position_m: DVec3::ZERO, body_from_inertial: moon_from_inertial },
        )]),
    })
}

/// ICRF axes from those of the pulsating rotating frame, times the distance of Earth and Moon in
/// metres: takes dimensionless vectors of the circular problem to metres.
fn pulsating_frame(ephemeris: &Ephemeris, tdb_s: f64) -> Result<DMat3, EphemerisError> {
    let moon = ephemeris.moon_from_earth(tdb_s)?;
    let distance_m = moon.position_m.length();
    let x = moon.position_m / distance_m;
    let z = moon.position_m.cross(moon.velocity_m_s).normalize();
    Ok(DMat3::from_cols(x, z.cross(x), z) * distance_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::parse_epoch;

    #[test]
    fn the_default_sequence_is_lumios() {
        let started = std::time::Instant::now();
        let halo = LumioHalo::default();
        let (trajectory, summary) = halo.generate(&Ephemeris::analytic()).unwrap();
        let took_s = started.elapsed().as_secs_f64();
        assert!(took_s < 2.0 || cfg!(debug_assertions), "{took_s} s");
        assert_eq!(trajectory.frames.len(), 4321);
        let middle = &trajectory.frames[2160];
        let new_moon_s = Ephemeris::analytic().next_new_moon_s(parse_epoch("2027-07-10").unwrap()).unwrap();
        assert!((middle.time_s - new_moon_s).abs() < 5.0, "new Moon at {new_moon_s}");
        assert!(summary.jacobi_drift < 1e-10 && (summary.jacobi - 3.09).abs() < 1e-11);
        assert!((14.1..14.8).contains(&summary.period_days));
        assert!(summary.half_period_residual < 1e-11);
        assert!(summary.distance_min_m > 30e6 && summary.distance_max_m < 90e6);
        assert!(summary.lit_fraction > 0.9);
        for pose in &trajectory.frames {
            let to_moon = (-pose.camera_position_m).normalize();
            let seen = pose.camera_from_inertial * to_moon;
            assert!((seen - DVec3::Z).length() < 1e-12, "{seen}");
            // North is up (-y) and not tilted to either side.
            let moon = &pose.bodies["moon"];
            let north = pose.camera_from_inertial * (moon.body_from_inertial.inverse() * DVec3::Z);
            assert!(north.x.abs() < 1e-12 && north.y < 0.0, "{north}");
            // The far side is what is seen.
            let camera = moon.body_from_inertial * pose.camera_position_m.normalize();
            assert!(camera.x < 0.0);
        }
    }

    #[test]
    fn velocities_are_the_rates_of_the_positions_through_the_next_revolution() {
        let halo = LumioHalo { frames: 400, step_s: 3600.0, phase_periods: 0.9, ..LumioHalo::default() };
        let (trajectory, _) = halo.generate(&Ephemeris::analytic()).unwrap();
        let fine = |frame: usize, off_s: f64| {
            let step_s = frame as f64 * 3600.0 + off_s;
            let halo = LumioHalo { frames: 2, step_s, ..halo.clone() };
            halo.generate(&Ephemeris::analytic()).unwrap().0.frames[1].camera_position_m
        };
        for frame in [1, 60, 250] {
            let rate_m_s = (fine(frame, 100.0) - fine(frame, -100.0)) / 200.0;
            let velocity_m_s = trajectory.frames[frame].camera_velocity_m_s.unwrap();
            assert!((rate_m_s - velocity_m_s).length() < 1e-3, "{rate_m_s} {velocity_m_s}");
        }
        // The orbit is joined to itself without a seam.
        for pair in trajectory.frames.windows(2) {
            let mean_m_s =
                (pair[0].camera_velocity_m_s.unwrap() + pair[1].camera_velocity_m_s.unwrap()) / 2.0;
            let moved_m = pair[1].camera_position_m - pair[0].camera_position_m;
            assert!((moved_m - mean_m_s * 3600.0).length() < 3000.0);
        }
    }

    #[test]
    fn what_cannot_be_made_is_refused() {
        let halo = LumioHalo { frames: 2, ..LumioHalo::default() };
        assert!(matches!(
            LumioHalo { frames: 0, ..halo.clone() }.generate(&Ephemeris::analytic()),
            Err(HaloError::NoFrames)
        ));
        assert!(matches!(
            LumioHalo { step_s: f64::NAN, ..halo.clone() }.generate(&Ephemeris::analytic()),
            Err(HaloError::NotFinite { name: "step_s", .. })
        ));
        assert!(matches!(
            LumioHalo { jacobi: 3.3, ..halo.clone() }.generate(&Ephemeris::analytic()),
            Err(HaloError::NoOrbit(_))
        ));
        assert!(matches!(
            LumioHalo { epoch_tdb_s: 4e9, ..halo }.generate(&Ephemeris::analytic()),
            Err(HaloError::Ephemeris(_))
        ));
    }
}
