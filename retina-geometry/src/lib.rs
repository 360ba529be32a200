//! Cameras, the facility's intrinsics K_f, distortion and lines of sight.
//!
//! Conventions: pixels have x to the right and y down, pixel (0, 0) covers [0, 1) x [0, 1); the
//! camera frame has +z along the boresight, +x right, +y down; a line of sight is (x, y, 1) on
//! the tangent plane, here a [`glam::DVec2`] (x, y), dimensionless.
//!
//! - [`Setup`]: one facility configuration, from `setup.toml`.
//! - [`Pinhole`]: intrinsics K and an image size (eqs. 11-13 of the paper).
//! - [`Distortion`]: D, what the facility does to a line of sight, and its inverse.
//! - [`InverseDistortion`]: the calibrated D^-1, which depends on the irradiance of a point.
//! - [`Lens`]: models of wide fields, as OpenCV and mrcal define them.
//! - [`SpotShifts`]: what the display's depth does to a line of sight.
//! - [`WarpMap`]: which source position an output pixel reads, upstream and downstream.
//! - [`ScreenLimits`]: what a display must not be asked to show.
//! - [`limb_ellipse`]: the outline of a sphere or ellipsoid in a pinhole image.

/// Arcseconds in a radian.
pub const ARCSEC_PER_RAD: f64 = 206_264.806_247_096_36;

mod bench_setup;
mod cubic;
mod distortion;
mod inverse;
mod lens_models;
mod limb;
mod limits;
mod pinhole;
mod rings;
mod setup;
mod spot_shifts;
mod warp;

pub use bench_setup::{NoiseSetup, OpticsSetup};
pub use cubic::cubic_shares;
pub use distortion::{Distortion, DistortionError, MAX_DEGREE, term_count};
pub use inverse::{CalibratedField, InverseDistortion, InverseTerm, RingField};
pub use lens_models::{Lens, LensImage, LensModel, MOST_COEFFICIENTS, OutOfDomain};
pub use limb::{LimbEllipse, limb_ellipse};
pub use limits::ScreenLimits;
pub use pinhole::Pinhole;
pub use rings::Rings;
pub use setup::{CameraSetup, FacilitySetup, Intrinsics, ResponseSetup, ScreenSetup, Setup};
pub use spot_shifts::{
    COMAS_MM, ComaForm, ComaShifts, ComaTracer, DEPTHS_MM, RADIAL_KNOTS, RadialTable, SpotShifts,
};
pub use warp::{WarpDirection, WarpMap};
