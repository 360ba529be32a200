//! Exact tracing of lens systems: what the facility's optics do to light.
//!
//! How the pieces fit:
//!
//! 1. A system is described by [`OpticalSystem`]: surfaces, media, apertures, groups, fields,
//!    wavelengths. It comes from a prescription ([`read_system`]: the project's own TOML or a
//!    sequential Zemax `.zmx`), from stock lenses ([`SystemBuilder`], [`StockDoublet`]), or from a
//!    design that ships ([`shipped_design`]).
//! 2. Media are [`glass::Medium`]s; glasses come from the embedded [`GlassCatalogue`] and from AGF files.
//! 3. [`Launcher`] turns a field and a pupil point into a [`Ray`]; [`Tracer`] (a system compiled for
//!    one wavelength) follows it: [`Tracer::trace`] one ray with all its crossings,
//!    [`Tracer::trace_batch`] many of them. [`paraxial`] has the first-order figures that aiming needs.
//! 4. [`analysis`] asks the questions of an optical engineer: plain data (serialisable) from library
//!    calls. [`plot`] draws them.
//!
//! Frame and signs: light along +z, x right, y down (the facility's frame), lengths in mm, radii
//! positive with the centre to the right, the origin at the first vertex. Facility systems are
//! traced from the camera's pupil to the screen: the pupil is the stop and the first surface, so
//! that aiming is exact and vignetting is met where it happens; the screen is the image.

pub mod analysis;
mod build;
pub mod constraints;
pub mod design;
mod error;
pub mod facility;
pub mod glass;
mod launch;
pub mod paraxial;
pub mod plot;
mod prescription;
pub mod pupil;
pub mod search;
mod stock;
mod surface;
mod system;
mod text;
mod trace;
mod zmx;

pub use build::SystemBuilder;
pub use error::OpticsError;
pub use glass::GlassCatalogue;
pub use launch::Launcher;
pub use prescription::{parse_prescription, read_system, shipped_design, shipped_designs};
pub use stock::{StockDoublet, stock_doublet, stock_doublets};
pub use surface::{Aperture, Shape, Surface};
pub use system::{Aiming, Beam, Field, Group, Object, OpticalSystem, Pose, Wavelength};
pub use trace::{Clipping, Crossing, Ray, RayBatch, RayFailure, Tracer};
pub use zmx::parse_zmx;
