//! Groups of stock lenses, their first-order figures, and whole systems built from them.

use std::path::Path;

use retina_files::InputError;
use serde::{Deserialize, Serialize};

use super::limits::{Excess, Limit};
use super::request::{Configuration, SearchRequest};
use crate::constraints::{Layout, PaperModel};
use crate::system::Wavelength;
use crate::{OpticalSystem, OpticsError, StockDoublet, SystemBuilder, stock_doublet, stock_doublets};

/// A stock lens in one of its two orientations.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Element {
    /// Order number.
    pub part: String,
    /// Light from the camera meets the third radius first.
    pub reversed: bool,
}

/// Lenses in the order in which light from the camera meets them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroupDesign {
    /// The lenses.
    pub elements: Vec<Element>,
    /// Gaps between them, mm.
    pub gaps_mm: Vec<f64>,
}

/// A facility's two groups.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FacilityDesign {
    /// Next to the camera.
    pub collimator: GroupDesign,
    /// Next to the screen.
    pub relay: GroupDesign,
}

/// Most lenses a group.
pub(crate) const MOST_LENSES: usize = 3;

/// A group as indices into a [`Library`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Group {
    pub(crate) elements: [u16; MOST_LENSES],
    pub(crate) count: usize,
    pub(crate) gaps_mm: [f64; MOST_LENSES - 1],
}

impl Group {
    pub(crate) fn elements(&self) -> &[u16] {
        &self.elements[..self.count]
    }

    pub(crate) fn gaps(&self) -> &[f64] {
        &self.gaps_mm[..self.count - 1]
    }
}

/// A lens in one orientation with its indices at the request's wavelengths.
pub(crate) struct Oriented {
    pub(crate) lens: &'static StockDoublet,
    pub(crate) reversed: bool,
    /// 1/mm.
    pub(crate) curvatures: [f64; 3],
    pub(crate) thicknesses_mm: [f64; 2],
    /// Of the two glasses, for each wavelength.
    pub(crate) indices: Vec<[f64; 2]>,
    /// Sag of the first and last surface at the lens's rim, mm; positive towards the light's way.
    pub(crate) rim_sag_mm: [f64; 2],
}

/// The lenses that a search may use: entry 2 k is lens k as catalogued, 2 k + 1 reversed.
pub(crate) struct Library {
    pub(crate) oriented: Vec<Oriented>,
    pub(crate) primary: usize,
}

/// First-order figures of a group, mm.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GroupFigures {
    pub(crate) efl_mm: f64,
    /// Front principal plane from the first vertex.
    pub(crate) front_principal_mm: f64,
    /// Rear principal plane from the last vertex.
    pub(crate) rear_principal_mm: f64,
}

impl Library {
    pub(crate) fn new(request: &SearchRequest, source: &Path) -> Result<Self, InputError> {
        let fits = |lens: &&StockDoublet| {
            let prefixes = &request.part_prefixes;
            lens.diameter_mm >= request.min_diameter_mm
                && (prefixes.is_empty()
                    || prefixes.iter().any(|prefix| lens.part.starts_with(prefix.as_str())))
        };
        let lenses: Vec<&'static StockDoublet> = stock_doublets().iter().filter(fits).collect();
        if lenses.is_empty() {
            return Err(InputError::new(source, "no stock lens is left to search")
                .found(format!(
                    "parts {:?}, {} mm and larger",
                    request.part_prefixes, request.min_diameter_mm
                ))
                .help("allow smaller lenses or other parts"));
        }
        Self::of(lenses, request, source)
    }

    fn of(
        lenses: impl IntoIterator<Item = &'static StockDoublet>,
        request: &SearchRequest,
        source: &Path,
    ) -> Result<Self, InputError> {
        let mut oriented = Vec::new();
        for lens in lenses {
            for reversed in [false, true] {
                oriented.push(Oriented::new(lens, reversed, &request.wavelengths_nm).map_err(|error| {
                    InputError::new(source, format!("{} cannot be used: {error}", lens.part))
                })?);
            }
        }
        Ok(Self { oriented, primary: request.primary() })
    }

    /// A library of a design's lenses alone, and its two groups in it.
    pub(crate) fn of_design(
        design: &FacilityDesign,
        request: &SearchRequest,
        source: &Path,
    ) -> Result<(Self, [Group; 2]), InputError> {
        let mut lenses: Vec<&'static StockDoublet> = Vec::new();
        let mut groups = [Group { elements: [0; MOST_LENSES], count: 0, gaps_mm: [0.0; MOST_LENSES - 1] }; 2];
        for (group, design) in groups.iter_mut().zip([&design.collimator, &design.relay]) {
            let count = design.elements.len();
            if count == 0 || count > MOST_LENSES || design.gaps_mm.len() + 1 != count {
                return Err(InputError::new(source, "a group's lenses and gaps do not fit")
                    .found(format!("{count} lenses and {} gaps", design.gaps_mm.len()))
                    .expected("1 to 3 lenses, and one gap less"));
            }
            group.count = count;
            group.gaps_mm[..count - 1].copy_from_slice(&design.gaps_mm);
            for (slot, element) in group.elements.iter_mut().zip(&design.elements) {
                let lens = stock_doublet(source, &element.part)?;
                let place = lenses.iter().position(|known| known.part == lens.part).unwrap_or_else(|| {
                    lenses.push(lens);
                    lenses.len() - 1
                });
                *slot = (2 * place + usize::from(element.reversed)) as u16;
            }
        }
        Ok((Self::of(lenses, request, source)?, groups))
    }

    pub(crate) fn lens(&self, element: u16) -> &Oriented {
        &self.oriented[usize::from(element)]
    }

    pub(crate) fn design(&self, collimator: &Group, relay: &Group) -> FacilityDesign {
        let group = |group: &Group| GroupDesign {
            elements: group
                .elements()
                .iter()
                .map(|&e| Element { part: self.lens(e).lens.part.clone(), reversed: self.lens(e).reversed })
                .collect(),
            gaps_mm: group.gaps().to_vec(),
        };
        FacilityDesign { collimator: group(collimator), relay: group(relay) }
    }

    /// Calls `surface(curvature, index behind, distance to the next vertex)` along a group; after the
    /// last vertex the distance is 0.
    pub(crate) fn walk(&self, group: &Group, wavelength: usize, mut surface: impl FnMut(f64, f64, f64)) {
        for (i, &element) in group.elements().iter().enumerate() {
            let lens = self.lens(element);
            let [n1, n2] = lens.indices[wavelength];
            let gap = group.gaps().get(i).copied().unwrap_or(0.0);
            surface(lens.curvatures[0], n1, lens.thicknesses_mm[0]);
            surface(lens.curvatures[1], n2, lens.thicknesses_mm[1]);
            surface(lens.curvatures[2], 1.0, gap);
        }
    }

    /// Height and slope behind a group of a ray that meets its first vertex with `y` and `u`.
    fn paraxial(&self, group: &Group, y: f64, u: f64) -> (f64, f64) {
        let (mut y, mut nu, mut before) = (y, u, 1.0);
        self.walk(group, self.primary, |c, after, distance| {
            nu -= y * (after - before) * c;
            before = after;
            y += distance * nu / after;
        });
        (y, nu)
    }

    pub(crate) fn figures(&self, group: &Group) -> GroupFigures {
        let (parallel_y, minus_power) = self.paraxial(group, 1.0, 0.0);
        let (_, slope) = self.paraxial(group, 0.0, 1.0);
        let efl_mm = -1.0 / minus_power;
        GroupFigures {
            efl_mm,
            front_principal_mm: efl_mm * (1.0 - slope),
            rear_principal_mm: efl_mm * (parallel_y - 1.0),
        }
    }

    /// Sets the last gap so that the group has this focal length: its power is linear in each gap.
    /// `None` where no gap within the request's bounds does it, or another gap is out of bounds.
    pub(crate) fn solve(&self, mut group: Group, focal_mm: f64, request: &SearchRequest) -> Option<Group> {
        let last = group.count - 2;
        let mut power = |gap| {
            group.gaps_mm[last] = gap;
            -self.paraxial(&group, 1.0, 0.0).1
        };
        let (at_0, at_1) = (power(0.0), power(1.0));
        group.gaps_mm[last] = (1.0 / focal_mm - at_0) / (at_1 - at_0);
        let fits = |(i, gap): (usize, &f64)| {
            let (before, after) = (self.lens(group.elements[i]), self.lens(group.elements[i + 1]));
            let at_rim = gap - before.rim_sag_mm[1] + after.rim_sag_mm[0];
            gap.min(at_rim) >= request.min_gap_mm && *gap <= request.max_gap_mm
        };
        group.gaps().iter().enumerate().all(fits).then_some(group)
    }

    /// Distances of a configuration for groups with these figures, and what of the bench's limits they
    /// exceed. The least distances hold between principal planes, as in the paper, and between glass, since
    /// a long group's planes lie far inside it.
    pub(crate) fn distances(
        &self,
        figures: &[GroupFigures; 2],
        request: &SearchRequest,
        configuration: &Configuration,
    ) -> (Placement, Vec<Excess>) {
        let layout = layout(request, configuration);
        let bench = &request.bench;
        let [collimator, relay] = figures;
        let placement = Placement {
            pupil_to_first_vertex_mm: request.pupil_collimator_mm - collimator.front_principal_mm,
            collimator_to_relay_mm: layout.inter_lens_mm + collimator.rear_principal_mm
                - relay.front_principal_mm,
            relay_to_screen_mm: layout.screen_relay_mm + relay.rear_principal_mm,
        };
        let lacking_mm = [
            (Limit::TotalLength, layout.total_length_mm - bench.total_length_mm),
            (Limit::ScreenRelayDistance, bench.screen_relay_mm - layout.screen_relay_mm),
            (
                Limit::InterLensDistance,
                bench.inter_lens_mm - layout.inter_lens_mm.min(placement.collimator_to_relay_mm),
            ),
            (Limit::PupilDistance, -placement.pupil_to_first_vertex_mm),
            (Limit::ScreenGap, request.min_screen_gap_mm - placement.relay_to_screen_mm),
        ];
        let excesses = lacking_mm.into_iter().filter(|(_, by)| *by > 0.0);
        (placement, excesses.map(|(limit, by)| Excess { limit, by }).collect())
    }

    /// As [`Library::distances`], where no limit is exceeded; else the first that is.
    pub(crate) fn placement(
        &self,
        figures: &[GroupFigures; 2],
        request: &SearchRequest,
        configuration: &Configuration,
    ) -> Result<Placement, Limit> {
        let (placement, excesses) = self.distances(figures, request, configuration);
        excesses.first().map_or(Ok(placement), |excess| Err(excess.limit))
    }

    /// The traced system, its image `defocus_mm` behind the paraxial screen.
    pub(crate) fn system(
        &self,
        groups: &[Group; 2],
        placement: &Placement,
        defocus_mm: f64,
        request: &SearchRequest,
        configuration: &Configuration,
    ) -> Result<OpticalSystem, OpticsError> {
        let wavelengths: Vec<Wavelength> =
            request.wavelengths_nm.iter().map(|&nm| Wavelength { nm, weight: 1.0 }).collect();
        let mut builder = SystemBuilder::new(configuration.name.clone(), configuration.pupil_mm)
            .wavelengths(&wavelengths)
            .clear_fraction(request.clear_fraction)
            .fields(&configuration.field_tans.iter().map(|&tan| [0.0, tan]).collect::<Vec<_>>())
            .gap(placement.pupil_to_first_vertex_mm);
        for (name, group) in ["collimator", "relay"].into_iter().zip(groups) {
            builder = builder.begin_group(name);
            for (i, &element) in group.elements().iter().enumerate() {
                let lens = self.lens(element);
                builder =
                    builder.lens(lens.lens, lens.reversed).gap(group.gaps().get(i).copied().unwrap_or(0.0));
            }
            builder = builder.end_group();
            if name == "collimator" {
                builder = builder.gap(placement.collimator_to_relay_mm);
            }
        }
        builder
            .image_after(placement.relay_to_screen_mm + defocus_mm)
            .map_err(|error| OpticsError::Undefined(error.to_string()))
    }
}

impl Oriented {
    fn new(lens: &'static StockDoublet, reversed: bool, wavelengths_nm: &[f64]) -> Result<Self, OpticsError> {
        let surfaces = lens.surfaces(reversed, 0.0);
        let index = |surface: usize, nm| Ok::<_, OpticsError>(surfaces[surface].medium.index(nm)?);
        let indices = wavelengths_nm
            .iter()
            .map(|&nm| Ok([index(0, nm)?, index(1, nm)?]))
            .collect::<Result<_, OpticsError>>()?;
        let rim = lens.diameter_mm / 2.0;
        let sag = |surface: usize| {
            surfaces[surface].shape.sag_mm(rim).ok_or_else(|| {
                OpticsError::Undefined(format!("surface {} is a sphere smaller than the lens", surface + 1))
            })
        };
        Ok(Self {
            lens,
            reversed,
            curvatures: [0, 1, 2].map(|i| surfaces[i].shape.vertex_curvature_per_mm()),
            thicknesses_mm: [0, 1].map(|i| surfaces[i].thickness_mm),
            indices,
            rim_sag_mm: [sag(0)?, sag(2)?],
        })
    }
}

/// Eqs. 4-6 at a configuration's magnification.
pub(crate) fn layout(request: &SearchRequest, configuration: &Configuration) -> Layout {
    PaperModel {
        pupil_mm: configuration.pupil_mm,
        pupil_collimator_mm: request.pupil_collimator_mm,
        ..PaperModel::paper(request.collimator_focal_mm, request.relay_focal_mm)
    }
    .layout(configuration.magnification, 0.0)
}

/// Distances between the groups' vertices, mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Placement {
    pub(crate) pupil_to_first_vertex_mm: f64,
    pub(crate) collimator_to_relay_mm: f64,
    /// To the paraxial image of the intermediate image.
    pub(crate) relay_to_screen_mm: f64,
}
