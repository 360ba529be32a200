//! A GigE Vision camera in software.
//!
//! - [`Camera`]: the device on a network address: it answers control packets (GVCP) and streams images (GVSP).
//! - [`Imager`]: where its images come from; [`Shot`] says what is asked of it.
//! - [`CameraInfo`]: name, sensor and knobs of the device: what its GenICam description says.
//!
//! Numbers of the protocol are those of GigE Vision 1.2 and of the Pixel Format Naming Convention 2.

mod acquisition;
mod camera;
mod control;
mod description;
mod features;
mod imager;
mod packet;
mod pixels;
mod registers;
mod stream;

pub use camera::{Camera, GigeError, Statistics};
pub use imager::{CameraInfo, Imager, Knob, Shot};
pub use pixels::PixelFormat;
