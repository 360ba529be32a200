//! Paraxial design and exact tracing of the facility's optics.
//!
//! This crate is the reserved place of the optical design (sections "Facility design" and
//! "Optical design" of the paper). It holds nothing yet: the scene and screen side of RETINA
//! takes the facility's distortion from a calibration file and needs no traced lens.
