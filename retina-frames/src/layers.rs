//! What a prediction is made of, cell by cell, before any optics.

use std::f64::consts::PI;
use std::sync::{Arc, Mutex, PoisonError};

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
#[derive(Debug)]
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
    /// What other laws make of `light`.
    pub(crate) ratios: Ratios,
}

/// Ratios of laws beyond this are those of slivers without light.
const LARGEST_RATIO: f64 = 20.0;

/// The light under other laws over that under the prediction's own, cell by cell, made when first asked for: a law takes
/// longer than all the rest of a prediction.
#[derive(Debug, Default)]
pub(crate) struct Ratios(Mutex<Vec<Known>>);

#[derive(Debug)]
struct Known {
    law: Photometry,
    of_mesh: bool,
    ratios: Arc<Vec<f32>>,
}

impl Layers {
    /// Ratios of a law on the body, or on the mesh's own surface; `None` where the prediction's law is not known.
    pub(crate) fn ratios(&self, law: &Photometry, of_mesh: bool) -> Option<Arc<Vec<f32>>> {
        let (own, angles) = (self.law.as_ref()?, self.angles.as_ref()?);
        let mesh = self.mesh.as_ref().filter(|_| of_mesh);
        let mut known = self.ratios.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = known.iter().find(|k| k.law == *law && k.of_mesh == mesh.is_some());
        if let Some(found) = found {
            return Some(Arc::clone(&found.ratios));
        }
        let ratio = |a: &Angles| -> f32 {
            let before = own.radiance_factor(a.geometry());
            if before <= 0.0 {
                1.0
            } else {
                (law.radiance_factor(a.geometry()) / before).min(LARGEST_RATIO) as f32
            }
        };
        let angles = mesh.map_or(angles, |mesh| &mesh.angles);
        let ratios: Arc<Vec<f32>> = Arc::new(angles.iter().map(ratio).collect());
        known.push(Known { law: *law, of_mesh: mesh.is_some(), ratios: Arc::clone(&ratios) });
        Some(ratios)
    }
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
