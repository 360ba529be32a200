//! Time, bodies and trajectories: where the camera, the Sun and the Moon are, and how they are turned.
//!
//! - [`time`]: calendar epochs to and from TDB seconds since J2000.
//! - [`ephemeris`]: Sun, Earth and Moon, in ICRF metres: by theories without a file, 1900-2100, or from SPK kernels.
//! - [`orientation`]: IAU (WGCCRE) body-fixed axes; kernels may replace them.
//! - [`trajectory`]: the trajectory table, one row a frame.
//! - [`observer`]: from a geometric to an apparent direction: light deflection and aberration.
//! - [`catalogue`]: stars, and those in a cone as a camera sees them.
//! - [`planets`]: planets and the Moon as a camera sees them; [`magnitude`]: how bright they are.
//! - [`deep_space`]: random poses among the planets.
//! - [`site`]: places on the Earth, and cameras there.
//! - [`spacecraft`]: a spacecraft's camera as SPICE kernels have it.
//! - [`near_body`]: orbits, flybys, phase sweeps and approaches about one body.
//! - [`forces`]: point masses and sunlight; how a spacecraft moves near the Moon.
//! - [`halo`]: a LUMIO-like quasi-halo about the Earth-Moon L2 point.
//!
//! Lengths are metres, times TDB seconds since J2000, angles radians; inertial axes are ICRF.
//! A quaternion `target_from_source` takes `v_target = q * v_source`.

pub mod catalogue;
mod cr3bp;
pub mod deep_space;
pub mod ephemeris;
pub mod forces;
pub mod halo;
pub mod magnitude;
pub mod near_body;
pub mod observer;
mod ode;
pub mod orientation;
pub mod planets;
mod shooting;
pub mod site;
pub mod spacecraft;
mod spice;
pub mod time;
pub mod trajectory;

pub use trajectory::{BodyColumns, BodyPose, FramePose, Trajectory};

/// Seconds in a day of the uniform time scales.
const DAY_S: f64 = 86_400.0;
/// Days in a Julian century.
const CENTURY_D: f64 = 36_525.0;
