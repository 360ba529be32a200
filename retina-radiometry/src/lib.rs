//! Magnitudes, irradiance, photometric functions of bodies, and the response of the screen.
//!
//! Spectral quantities are at 550 nm (V band), W m^-2 nm^-1 and W m^-2 sr^-1 nm^-1.
//!
//! - [`Photometry`]: radiance factor I/F of a surface element, a [`Law`] times a [`PhaseFunction`]. Both are enums of
//!   a register, [`Registered::ALL`]: a law is one Rust file and one WGSL file in `src/laws`, and a line there.
//! - Sunlight: [`sun_irradiance_w_m2_nm`], [`sun_angular_radius_rad`].
//! - [`irradiance_of_magnitude_w_m2_nm`] and its inverse (paper, eq. 7).
//! - [`QuantumEfficiency`]: the sensor over wavelength (paper, eqs. 8-10).
//! - [`ScreenResponse`]: digital count to irradiance at the pupil and back (paper, eqs. 7-10).

mod efficiency;
mod laws;
mod magnitude;
pub mod phase_functions;
mod photometry;
mod registry;
mod response;

pub use efficiency::QuantumEfficiency;
pub use laws::{
    Akimov, Hapke, Lambert, Law, LommelSeeliger, LunarLambert, Minnaert, OrenNayar, Reflectance, Rolo,
};
pub use magnitude::{
    AU_M, SUN_IRRADIANCE_1AU_W_M2_NM, SUN_RADIUS_M, ZERO_MAGNITUDE_W_M2_NM, irradiance_of_magnitude_w_m2_nm,
    magnitude_of_irradiance, sun_angular_radius_rad, sun_irradiance_w_m2_nm,
};
pub use phase_functions::{PhaseCurve, PhaseFunction};
pub use photometry::{Geometry, Photometry};
pub use registry::{Definition, Key, KeyDefault, Kind, LAW_PARAMETERS, PHASE_PARAMETERS, Registered};
pub use response::{DigitalCounts, ScreenResponse};
