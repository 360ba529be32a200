//! Which source position an output pixel reads, upstream and downstream (CONTRACT conventions).

use glam::DVec2;

use crate::{Distortion, Pinhole};

/// The two ways of undoing the facility's distortion (paper, "Projection model").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WarpDirection {
    /// The screen image is corrected beforehand: screen pixel R reads the scene at D(K_f^-1 R).
    Upstream,
    /// The camera image is corrected afterwards: pixel u reads the camera image at C(D(C^-1 u)).
    Downstream,
}

/// A resampling of one image through D; source and output share one pinhole (K_f upstream, C
/// downstream), so both directions are u -> K D(K^-1 u).
#[derive(Debug, Clone)]
pub struct WarpMap {
    /// K_f upstream, C downstream.
    pub pinhole: Pinhole,
    /// D.
    pub distortion: Distortion,
}

impl WarpMap {
    /// The source position that the output position `pixel` reads, pixels.
    pub fn source_of(&self, pixel: DVec2) -> DVec2 {
        self.pinhole.pixel(self.distortion.distort(self.pinhole.line_of_sight(pixel)))
    }
}
