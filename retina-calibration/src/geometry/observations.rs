//! What the fit sees of a table: lines of sight on both sides, L, and which exposure.

use std::ops::Range;

use glam::DVec2;
use retina_formats::{PointRow, PointsTable, log10_irradiance, stated_by_most};
use retina_geometry::Setup;
use retina_radiometry::ScreenResponse;

/// Unsaturated points, sorted by exposure.
#[derive(Debug, Clone)]
pub(crate) struct Observations {
    /// Measured lines of sight C^-1(R^c).
    pub(crate) sight: Vec<DVec2>,
    /// Undistorted lines of sight K_f^-1 R^s (eq. 14).
    pub(crate) undistorted: Vec<DVec2>,
    /// log10 of the irradiance relative to white at full count.
    pub(crate) l: Vec<f64>,
    /// What the centroids' noise is told from: ln of sigma_px, else of 1 / flux, else of 1 / (irradiance, exposure).
    pub(crate) noise_key: Vec<f64>,
    /// What became of rows that state no `sigma_px`, where others do.
    pub(crate) stated_note: Option<String>,
    /// Row of the table.
    pub(crate) row: Vec<usize>,
    /// Exposure id (index into the table's images) and its points.
    pub(crate) exposures: Vec<(usize, Range<usize>)>,
    /// Saturated rows that were left out.
    pub(crate) saturated: usize,
}

impl Observations {
    pub(crate) fn of(table: &PointsTable, setup: &Setup, response: &ScreenResponse) -> Self {
        let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
        let mut order: Vec<usize> = (0..table.rows.len()).filter(|&row| !table.rows[row].saturated).collect();
        order.sort_by_key(|&row| table.rows[row].image);
        let l: Vec<f64> = order
            .iter()
            .map(|&row| log10_irradiance(response, table.rows[row].channel, table.rows[row].digital_count))
            .collect();
        let all = |has: fn(&PointRow) -> bool| order.iter().all(|&row| has(&table.rows[row]));
        let (stated, stated_note) =
            stated_by_most("sigma_px", order.iter().map(|&row| table.rows[row].sigma_px));
        let noise_key: Vec<f64> = if let Some(sigma_px) = stated {
            sigma_px.iter().map(|sigma_px| sigma_px.ln()).collect()
        } else if all(|row| row.flux_dn.is_some_and(|flux| flux > 0.0)) {
            order.iter().map(|&row| -table.rows[row].flux_dn.unwrap_or(1.0).ln()).collect()
        } else {
            let exposure = all(|row| row.exposure_s.is_some());
            let ln_exposure =
                |row: usize| table.rows[row].exposure_s.filter(|_| exposure).unwrap_or(1.0).ln();
            order.iter().zip(&l).map(|(&row, l)| -l * std::f64::consts::LN_10 - ln_exposure(row)).collect()
        };
        let mut exposures: Vec<(usize, Range<usize>)> = Vec::new();
        for (at, &row) in order.iter().enumerate() {
            let image = table.rows[row].image;
            match exposures.last_mut() {
                Some((last, range)) if *last == image => range.end = at + 1,
                _ => exposures.push((image, at..at + 1)),
            }
        }
        Self {
            sight: order.iter().map(|&row| camera.line_of_sight(table.rows[row].camera_px)).collect(),
            undistorted: order.iter().map(|&row| facility.line_of_sight(table.rows[row].screen_px)).collect(),
            l,
            noise_key,
            stated_note,
            saturated: table.rows.len() - order.len(),
            row: order,
            exposures,
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.row.len()
    }
}
