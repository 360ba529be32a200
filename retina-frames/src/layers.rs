//! What a prediction is made of, cell by cell, before any optics.

use std::f64::consts::PI;

use retina_radiometry::{Geometry, Photometry};

use crate::grid::Grid;

/// Angles of a surface element.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Angles {
    pub(crate) mu0: f32,
    pub(crate) mu: f32,
    pub(crate) phase_rad: f32,
}

impl Angles {
    pub(crate) fn geometry(self) -> Geometry {
        Geometry { mu0: f64::from(self.mu0), mu: f64::from(self.mu), phase_rad: f64::from(self.phase_rad) }
    }
}

/// Cells of one prediction.
#[derive(Debug, Clone)]
pub(crate) struct Layers {
    /// Light as predicted at first: radiance factor, or whatever an EXR holds.
    pub(crate) light: Grid,
    /// Part of a cell that the body covers, where known.
    pub(crate) coverage: Option<Grid>,
    /// Angles behind `light`, where known.
    pub(crate) angles: Option<Vec<Angles>>,
    /// The law of `light`, where known.
    pub(crate) law: Option<Photometry>,
    /// East longitude and latitude, rad; NaN off the body.
    pub(crate) place_rad: Option<Vec<[f32; 2]>>,
    /// The body's map, mean 1, where `light` was made without it.
    pub(crate) map: Option<Grid>,
    /// The mesh's own light without shadows, and its shadows, where `light` is that of a smooth body.
    pub(crate) mesh: Option<Mesh>,
}

/// A mesh where the prediction was made of its reference ellipsoid.
#[derive(Debug, Clone)]
pub(crate) struct Mesh {
    pub(crate) light: Grid,
    pub(crate) angles: Vec<Angles>,
    /// Part of the Sun that other parts of the body hide, 0 to 1.
    pub(crate) shadow: Grid,
}

/// Angles from layers in degrees.
pub(crate) fn angles(layers_deg: [&[f32]; 3], mask: &[f32]) -> Vec<Angles> {
    let cosine = |deg: f32| (f64::from(deg).to_radians()).min(PI).cos() as f32;
    (0..mask.len())
        .map(|at| {
            if mask[at] <= 0.0 {
                return Angles::default();
            }
            Angles {
                mu0: cosine(layers_deg[0][at]),
                mu: cosine(layers_deg[1][at]).max(1e-3),
                phase_rad: layers_deg[2][at].to_radians(),
            }
        })
        .collect()
}
