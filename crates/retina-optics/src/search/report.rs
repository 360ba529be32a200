//! A search's result as the machine interface states it, schema `retina.optics-search/1`.

use serde::Serialize;

use super::candidate::Library;
use super::exact::{ConfigurationResult, ScreenFocus, evaluate};
use super::refit::Candidate;
use super::request::SearchRequest;
use super::run::REPORTED;
use super::{FacilityDesign, GroupDesign};
use crate::OpticsError;

/// Designs, best first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SearchReport {
    /// s_cam, camera pupil to the collimator's principal plane, mm.
    pub pupil_collimator_mm: f64,
    /// Designs within all limits.
    pub designs: Vec<SearchedDesign>,
}

/// A design.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SearchedDesign {
    /// Largest RMS over fields and configurations, um on the sensor, apertures open.
    pub worst_rms_um: f64,
    /// Focal length of the relay at the middle wavelength, mm.
    pub relay_efl_mm: f64,
    /// Focal length of the collimator, mm.
    pub collimator_efl_mm: f64,
    /// First vertex of the collimator to the screen in the longest configuration, mm.
    pub length_mm: f64,
    /// Part of the semi-diameters that light may use.
    pub clear_aperture_fraction: f64,
    /// From the camera to the screen.
    pub lenses: Vec<SearchedLens>,
    /// The configurations.
    pub configurations: Vec<SearchedConfiguration>,
    /// The design itself.
    #[serde(skip)]
    pub design: FacilityDesign,
}

/// A configuration of a design.
pub type SearchedConfiguration = ConfigurationResult;

/// A lens of a design.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SearchedLens {
    /// Order number.
    pub part: String,
    /// R3 is met first.
    pub reversed: bool,
    /// Gap to the next lens of the group, mm; `None` behind the last lens of a group, where the
    /// configurations say it.
    pub gap_after_mm: Option<f64>,
}

impl SearchReport {
    pub(crate) fn new(
        library: &Library,
        request: &SearchRequest,
        best: &[Candidate],
    ) -> Result<Self, OpticsError> {
        let mut designs = Vec::new();
        for candidate in best.iter().take(REPORTED) {
            let [collimator, relay] = &candidate.groups;
            let design = SearchedDesign::new(library.design(collimator, relay), request)?;
            let lost = |c: &ConfigurationResult| {
                c.fields.iter().any(|f| f.vignetted_fraction > request.max_vignetted)
            };
            if !design.configurations.iter().any(lost) {
                designs.push(design);
            }
        }
        designs.sort_by(|a, b| a.worst_rms_um.total_cmp(&b.worst_rms_um));
        Ok(Self { pupil_collimator_mm: request.pupil_collimator_mm, designs })
    }

    /// Indices of the designs that no other beats in both spot and length, best spot first.
    pub fn pareto(&self) -> Vec<usize> {
        let mut shortest = f64::INFINITY;
        (0..self.designs.len())
            .filter(|&i| {
                let leads = self.designs[i].length_mm < shortest;
                shortest = shortest.min(self.designs[i].length_mm);
                leads
            })
            .collect()
    }
}

impl SearchedDesign {
    /// A design evaluated at its best focus.
    ///
    /// # Errors
    /// As [`evaluate`].
    pub fn new(design: FacilityDesign, request: &SearchRequest) -> Result<Self, OpticsError> {
        let (configurations, systems) = evaluate(&design, request, ScreenFocus::Best)?;
        let source = std::path::Path::new("the design");
        let (library, groups) = Library::of_design(&design, request, source)
            .map_err(|error| OpticsError::Undefined(error.to_string()))?;
        let [collimator, relay] = groups.map(|group| library.figures(&group).efl_mm);
        let length_mm = configurations
            .iter()
            .zip(&systems)
            .map(|(c, system)| {
                system.vertices_mm().last().copied().unwrap_or(0.0) - c.pupil_to_first_vertex_mm
            })
            .fold(0.0, f64::max);
        let lenses = |group: &GroupDesign| {
            group
                .elements
                .iter()
                .enumerate()
                .map(|(i, element)| SearchedLens {
                    part: element.part.clone(),
                    reversed: element.reversed,
                    gap_after_mm: group.gaps_mm.get(i).copied(),
                })
                .collect::<Vec<_>>()
        };
        let worst =
            configurations.iter().flat_map(|c| &c.fields).map(|field| field.rms_um).fold(0.0, f64::max);
        Ok(Self {
            worst_rms_um: worst,
            relay_efl_mm: relay,
            collimator_efl_mm: collimator,
            length_mm,
            clear_aperture_fraction: request.clear_fraction,
            lenses: [lenses(&design.collimator), lenses(&design.relay)].concat(),
            configurations,
            design,
        })
    }
}
