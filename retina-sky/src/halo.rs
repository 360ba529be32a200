//! A LUMIO-like quasi-halo: an Earth-Moon L2 halo orbit corrected to a path of the real forces.
//!
//! The southern L2 halo of the circular problem with the wanted Jacobi constant is carried into
//! the pulsating rotating frame of the ephemeris: x from Earth to Moon, z along the Moon's orbital
//! angular momentum, unit of length the instantaneous distance, time at the sidereal mean motion.
//! Multiple shooting finds the path near it that obeys the forces of Moon, Earth, Sun and sunlight
//! ([`MoonForces`]). The camera looks at the Moon's centre. The geometry is that of the mission's
//! operational orbit (Cipriano et al. 2018, "Orbit design for LUMIO": quasi-halo, C_J = 3.09).

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use thiserror::Error;

use crate::DAY_S;
pub use crate::cr3bp::NoOrbit;
use crate::cr3bp::{self, MU, TOLERANCE, dynamics, southern_l2_halo};
use crate::ephemeris::{Ephemeris, EphemerisError};
use crate::forces::{LUMIO_PRESSURE_AREA_M2_KG, MoonForces};
use crate::ode::integrate;
use crate::shooting::{MoonState, Path as ShotPath};
use crate::trajectory::{BodyPose, FramePose, Trajectory, look_at};

/// Mean motion of the Moon: a turn in a sidereal month of 27.321661 days.
const MEAN_MOTION_RAD_S: f64 = TAU / (27.321_661 * DAY_S);
/// Half-width of the central difference of the pulsating frame: truncation 3e-6 m/s at the
/// camera's distance, rounding of the ephemeris about as much.
const FRAME_DIFFERENCE_S: f64 = 120.0;
/// Longest arc between two nodes of the shooting.
const ARC_S: f64 = DAY_S;
/// The path is corrected for so long beyond both ends of the frames, a quarter of a revolution, so that a
/// short sequence also lies on an orbit that goes on.
const MARGIN_S: f64 = 3.5 * DAY_S;
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
    /// The circular problem's orbit could not be integrated.
    #[error("the halo orbit of the circular problem could not be integrated")]
    Integration,
    /// No path of the forces was found near the orbit of the circular problem.
    #[error(
        "no path of the forces was found near the halo orbit over {days:.1} days; take fewer frames, or a Jacobi \
         constant nearer to 3.09"
    )]
    NoPath {
        /// Length of the span that was asked for, days.
        days: f64,
    },
    /// The frames reach beyond the ephemeris, with the 10 days before and after them that the shooting needs.
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
    /// Reflectivity coefficient times area over mass, for the pressure of sunlight, m^2/kg.
    pub pressure_area_m2_kg: f64,
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
    /// Jacobi constant of the orbit found in the circular problem.
    pub jacobi: f64,
    /// Largest change of the Jacobi constant along that orbit.
    pub jacobi_drift: f64,
    /// Period of the halo orbit, days.
    pub period_days: f64,
    /// What is left of y, vx and vz (largest) half a period from the start, units of the problem.
    pub half_period_residual: f64,
    /// Largest distance of the path from that orbit, at the nodes among the frames, metres.
    pub moved_m: f64,
    /// Largest jumps of position and velocity where two arcs of the path meet, m and m/s.
    pub defects: [f64; 2],
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
             path of the forces within {:.0} km of it, joined to {:.1e} m and {:.1e} m/s; Moon at {:.0} to {:.0} km, phase {:.1} to {:.1} deg, below 90 deg in {:.1} % of the frames",
            self.jacobi,
            self.jacobi_drift,
            self.period_days,
            self.half_period_residual,
            self.moved_m / 1e3,
            self.defects[0],
            self.defects[1],
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
        Self {
            epoch_tdb_s: middle_tdb_s - half_s,
            frames,
            step_s,
            jacobi: 3.09,
            phase_periods: 0.5,
            pressure_area_m2_kg: LUMIO_PRESSURE_AREA_M2_KG,
        }
    }

    /// The frames, Moon-centred on ICRF axes, and what they are like.
    ///
    /// A frame carries the camera's position and velocity relative to the Moon, its attitude (+z
    /// to the Moon's centre, image up towards the Moon's north), the Sun as seen from the Moon
    /// (light-time in it) and the Moon at the origin with its IAU axes.
    ///
    /// # Errors
    /// No frames, numbers that are not finite, a Jacobi constant outside the family, epochs
    /// outside the ephemeris, no path near the orbit.
    pub fn generate(&self, ephemeris: &Ephemeris) -> Result<(Trajectory, HaloSummary), HaloError> {
        if self.frames == 0 {
            return Err(HaloError::NoFrames);
        }
        for (name, found) in [
            ("epoch_tdb_s", self.epoch_tdb_s),
            ("step_s", self.step_s),
            ("phase_periods", self.phase_periods),
            ("jacobi", self.jacobi),
            ("pressure_area_m2_kg", self.pressure_area_m2_kg),
        ] {
            if !found.is_finite() {
                return Err(HaloError::NotFinite { name, found });
            }
        }
        let orbit = southern_l2_halo(self.jacobi)?;
        let times_s: Vec<f64> =
            (0..self.frames).map(|frame| self.epoch_tdb_s + frame as f64 * self.step_s).collect();
        let ends_s = [times_s[0], times_s[self.frames - 1]];
        let among_s = [ends_s[0].min(ends_s[1]), ends_s[0].max(ends_s[1])];
        let span_s = [among_s[0] - MARGIN_S, among_s[1] + MARGIN_S];
        let forces = MoonForces::new(ephemeris, span_s, self.pressure_area_m2_kg)?;
        let arcs = ((span_s[1] - span_s[0]) / ARC_S).ceil();
        let nodes_s: Vec<f64> =
            (0..=arcs as usize).map(|k| span_s[0] + (span_s[1] - span_s[0]) * k as f64 / arcs).collect();
        let circular: Vec<(MoonState, f64)> = nodes_s
            .par_iter()
            .map(|&tdb_s| {
                let turn = self.phase_periods * orbit.period + MEAN_MOTION_RAD_S * (tdb_s - self.epoch_tdb_s);
                // From the corrected crossing, so that the orbit's instability has one period at most to grow
                // rounding in.
                let since = [0.0, turn.rem_euclid(orbit.period)];
                let state = integrate(|_, s| dynamics(s), orbit.start, since, TOLERANCE)
                    .ok_or(HaloError::Integration)?;
                Ok((moon_state(ephemeris, tdb_s, &state)?, cr3bp::jacobi(&state)))
            })
            .collect::<Result<_, HaloError>>()?;
        let wanted: Vec<MoonState> = circular.iter().map(|(state, _)| *state).collect();
        let no_path = || HaloError::NoPath { days: (span_s[1] - span_s[0]) / DAY_S };
        let path = ShotPath::near(&forces, nodes_s, &wanted, 1.0 / MEAN_MOTION_RAD_S).ok_or_else(no_path)?;
        let states = path.states(&times_s).ok_or_else(no_path)?;
        let mut frames: Vec<FramePose> = times_s
            .par_iter()
            .zip(&states)
            .map(|(tdb_s, state)| frame_pose(ephemeris, *tdb_s, state))
            .collect::<Result<_, _>>()?;
        // One sign from frame to frame: interpolation and plots want no jumps.
        for frame in 1..frames.len() {
            let previous = frames[frame - 1].camera_from_inertial;
            let own = &mut frames[frame].camera_from_inertial;
            if previous.dot(*own) < 0.0 {
                *own = -*own;
            }
        }
        let jacobi = cr3bp::jacobi(&orbit.start);
        let mut summary = HaloSummary {
            jacobi,
            jacobi_drift: circular.iter().fold(0.0, |most, (_, other)| most.max((other - jacobi).abs())),
            period_days: orbit.period / MEAN_MOTION_RAD_S / DAY_S,
            half_period_residual: orbit.residual,
            moved_m: path.farthest_from(&wanted, among_s),
            defects: [path.defect_m, path.defect_m_s],
            distance_min_m: f64::INFINITY,
            distance_max_m: 0.0,
            phase_min_rad: f64::INFINITY,
            phase_max_rad: 0.0,
            lit_fraction: 0.0,
        };
        for pose in &frames {
            summary.take(pose);
        }
        summary.lit_fraction /= self.frames as f64;
        let mut made = Trajectory::new(Path::new("lumio-halo"), frames);
        made.turned_by_ephemeris = true;
        Ok((made, summary))
    }
}

impl HaloSummary {
    /// Widens the ranges by a frame.
    fn take(&mut self, pose: &FramePose) {
        let distance_m = pose.camera_position_m.length();
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

/// Position and velocity relative to the Moon at a state of the circular problem.
fn moon_state(ephemeris: &Ephemeris, tdb_s: f64, state: &cr3bp::Phase) -> Result<MoonState, EphemerisError> {
    let from_moon = DVec3::new(state[0] - 1.0 + MU, state[1], state[2]);
    let velocity = DVec3::new(state[3], state[4], state[5]);
    let pulsating = pulsating_frame(ephemeris, tdb_s)?;
    let rate = (pulsating_frame(ephemeris, tdb_s + FRAME_DIFFERENCE_S)?
        - pulsating_frame(ephemeris, tdb_s - FRAME_DIFFERENCE_S)?)
        * (0.5 / FRAME_DIFFERENCE_S);
    let (r, v) = (pulsating * from_moon, pulsating * velocity * MEAN_MOTION_RAD_S + rate * from_moon);
    Ok([r.x, r.y, r.z, v.x, v.y, v.z])
}

/// The frame at a position and velocity relative to the Moon.
fn frame_pose(ephemeris: &Ephemeris, tdb_s: f64, state: &MoonState) -> Result<FramePose, EphemerisError> {
    let position_m = DVec3::from_slice(&state[..3]);
    let moon_from_inertial = ephemeris.body_from_inertial("moon", tdb_s)?.unwrap_or(DQuat::IDENTITY);
    let bodies = ephemeris.solar_system(tdb_s)?;
    Ok(FramePose {
        time_s: tdb_s,
        camera_position_m: position_m,
        camera_from_inertial: look_at(-position_m, moon_from_inertial.inverse() * DVec3::Z),
        camera_velocity_m_s: Some(DVec3::from_slice(&state[3..])),
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
mod tests;
