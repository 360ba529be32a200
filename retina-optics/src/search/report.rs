//! A search's result as the machine interface states it, schema `retina.optics-search/1`.

use serde::Serialize;

use super::candidate::{Group, Library};
use super::exact::{ConfigurationResult, ScreenFocus, evaluate};
use super::limits::{Excess, Limit, Removed, count};
use super::refit::Candidate;
use super::request::SearchRequest;
use super::run::REPORTED;
use super::{FacilityDesign, GroupDesign};
use crate::OpticsError;
use crate::constraints::BenchLimits;

/// Designs, best first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SearchReport {
    /// s_cam, camera pupil to the collimator's principal plane, mm.
    pub pupil_collimator_mm: f64,
    /// Designs within all limits.
    pub designs: Vec<SearchedDesign>,
    /// How many candidates each limit ruled out on the way.
    pub removed: Vec<Removed>,
    /// Where no design keeps all limits: the one that misses them by least.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nearest_miss: Option<NearestMiss>,
}

/// A design beyond the limits.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NearestMiss {
    /// The design, as if nothing limited it.
    pub design: SearchedDesign,
    /// What it exceeds, largest over the configurations.
    pub exceeds: Vec<Excess>,
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
        pairs: &[[Group; 2]],
        mut removed: Vec<Removed>,
    ) -> Result<Self, OpticsError> {
        let mut designs = Vec::new();
        let mut nearest: Option<NearestMiss> = None;
        for candidate in best.iter().take(REPORTED) {
            let [collimator, relay] = &candidate.groups;
            let design = SearchedDesign::new(library.design(collimator, relay), request)?;
            let by = design.vignetted_fraction() - request.max_vignetted;
            if by <= 0.0 {
                designs.push(design);
                continue;
            }
            count(&mut removed, Limit::Vignetting, 1);
            if nearest.as_ref().is_none_or(|nearest| by < nearest.exceeds[0].by) {
                let exceeds = vec![Excess { limit: Limit::Vignetting, by }];
                nearest = Some(NearestMiss { design, exceeds });
            }
        }
        designs.sort_by(|a, b| a.worst_rms_um.total_cmp(&b.worst_rms_um));
        if best.is_empty() {
            nearest = nearest_of_pairs(library, request, pairs);
        }
        let nearest_miss = nearest.filter(|_| designs.is_empty());
        Ok(Self { pupil_collimator_mm: request.pupil_collimator_mm, designs, removed, nearest_miss })
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

/// Pairs that are looked through for the nearest miss, best ranked first.
const LOOKED_THROUGH: usize = 500;

/// Of the ranked pairs, none of which stands within the bench's limits, the one that exceeds them by the
/// least sum of lengths; of equal ones the best ranked. `None` where the rays of all of them fail.
fn nearest_of_pairs(library: &Library, request: &SearchRequest, pairs: &[[Group; 2]]) -> Option<NearestMiss> {
    let exceeds = |groups: &[Group; 2]| {
        let figures = groups.map(|group| library.figures(&group));
        let mut worst: Vec<Excess> = Vec::new();
        for configuration in &request.configurations {
            for excess in library.distances(&figures, request, configuration).1 {
                match worst.iter_mut().find(|known| known.limit == excess.limit) {
                    Some(known) => known.by = known.by.max(excess.by),
                    None => worst.push(excess),
                }
            }
        }
        worst
    };
    let mut ordered: Vec<(f64, Vec<Excess>, &[Group; 2])> = pairs
        .iter()
        .take(LOOKED_THROUGH)
        .map(|groups| {
            let exceeds = exceeds(groups);
            (exceeds.iter().map(|excess| excess.by).sum(), exceeds, groups)
        })
        .collect();
    ordered.sort_by(|a, b| a.0.total_cmp(&b.0));
    let unlimited = SearchRequest {
        bench: BenchLimits {
            total_length_mm: f64::INFINITY,
            screen_relay_mm: f64::NEG_INFINITY,
            inter_lens_mm: f64::NEG_INFINITY,
        },
        min_screen_gap_mm: f64::NEG_INFINITY,
        ..request.clone()
    };
    ordered.into_iter().find_map(|(_, exceeds, [collimator, relay])| {
        let design = SearchedDesign::new(library.design(collimator, relay), &unlimited).ok()?;
        Some(NearestMiss { design, exceeds })
    })
}

impl SearchedDesign {
    /// Largest share of a field's beam that is cut, over the configurations.
    pub fn vignetted_fraction(&self) -> f64 {
        let fields = self.configurations.iter().flat_map(|configuration| &configuration.fields);
        fields.map(|field| field.vignetted_fraction).fold(0.0, f64::max)
    }

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
