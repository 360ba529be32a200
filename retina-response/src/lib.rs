//! The radiometric calibration of the facility (paper, "Radiometric calibration", eqs. 7-10): readings of a
//! power meter at the camera's pupil become the response of each channel with its uncertainty, and that
//! becomes digital counts for magnitudes.
//!
//! - [`PowerReadings`]: the readings by channel, checked.
//! - [`ChannelResponse`]: a pixel's irradiance against digital count, rising, with its uncertainty.
//! - [`Calibrated`]: the three channels fitted, and the record that `calibration.toml` keeps of them.
//! - [`ShownLight`]: magnitudes to digital counts and back; mixtures of channels, several pixels.
//! - [`SpectralForm`]: eq. 8 beside eq. 10.
//! - [`figures`], [`report_page`]: Figs. 6 and 7.

mod calibration;
mod channel;
mod document;
mod file;
mod fit;
mod knots;
mod linear;
mod monotone;
mod noise;
mod plot;
mod readings;
mod series;
mod shown;
mod spectral;
mod spline;

pub use calibration::{Additivity, Calibrated};
pub use channel::{ChannelResponse, Estimate};
pub use document::{json_document, summary};
pub use noise::Noise;
pub use plot::{figures, report_page};
pub use readings::{PowerReadings, Reading};
pub use series::SeriesScatter;
pub use shown::{Shown, ShownLight, Steps};
pub use spectral::{SpectralForm, StarForm};
