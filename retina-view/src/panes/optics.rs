//! Lens systems: layout, spots and contrast, as gaps and tilts are changed; the designs of a search.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use axum::extract::{Query, State};
use axum::routing::{get, post};
use axum::{Json, Router};
use glam::DVec3;
use retina_files::InputError;
use retina_optics::analysis::{Mtf, SpotOptions, mtf, spots};
use retina_optics::glass::Medium;
use retina_optics::plot::{SpotRow, layout_figure, mtf_figure, spots_figure};
use retina_optics::{Clipping, OpticalSystem, OpticsError, parse_prescription, read_system, shipped_design};
use serde::Deserialize;
use serde_json::{Value, json};

use super::{At, read_json};
use crate::api::{Answer, App, Shared, beside, json_of};
use crate::failure::Refusal;

/// Rings and arms of the rays that are counted and drawn.
const RINGS: usize = 10;
const ARMS: usize = 36;
/// Points of the pupil a side: as few as the wavefront allows. And the highest frequency of the contrast, cycles/mm.
const MTF_PUPIL: [usize; 3] = [64, 128, 256];
const MTF_HIGHEST_PER_MM: f64 = 100.0;
const MTF_POINTS: usize = 60;

pub(super) fn routes() -> Router<Arc<App>> {
    Router::new().route("/api/optics", post(system)).route("/api/optics/designs", get(designs))
}

impl From<OpticsError> for Refusal {
    fn from(error: OpticsError) -> Self {
        Self::new(axum::http::StatusCode::UNPROCESSABLE_ENTITY, error.to_string())
    }
}

/// How a group stands beside its design.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
struct Offset {
    tilt_deg: [f64; 2],
    shift_mm: [f64; 2],
}

#[derive(Debug, Clone, Deserialize)]
struct Asked {
    /// A shipped design, a prescription, or the document of a search.
    at: String,
    /// Of a search: the design's number, from 0, and its configuration.
    design: Option<usize>,
    configuration: Option<String>,
    /// Gaps in the place of the design's, mm, by the number of the surface before them.
    #[serde(default)]
    gaps_mm: BTreeMap<usize, f64>,
    #[serde(default)]
    groups: BTreeMap<String, Offset>,
}

fn document(app: &App, at: &str) -> Result<Value, Refusal> {
    Ok(read_json(&app.path(at)?)?)
}

fn source(app: &App, asked: &Asked) -> Result<OpticalSystem, Refusal> {
    if let Some(number) = asked.design {
        let document = document(app, &asked.at)?;
        let prescriptions = &document["designs"][number]["prescriptions"];
        let name = asked.configuration.as_deref().unwrap_or_default();
        let text = prescriptions[name].as_str().ok_or_else(|| {
            Refusal::conflict(
                "the document of the search has no prescription of this design; make it anew with `retina optics search --json`",
            )
        })?;
        return Ok(parse_prescription(Path::new(name), text)?);
    }
    match shipped_design(&asked.at) {
        Some(system) => Ok(system?),
        None => Ok(read_system(&app.path(&asked.at)?, &[])?),
    }
}

/// Air behind a surface, but not before the first or behind the last.
fn gaps(system: &OpticalSystem) -> Vec<usize> {
    let air = |i: &usize| matches!(system.surfaces[*i].medium, Medium::Air);
    (0..system.image()).filter(air).collect()
}

fn names(system: &OpticalSystem, gap: usize) -> String {
    let group = |at: usize| {
        system
            .groups
            .iter()
            .find(|group| (group.first..=group.last).contains(&at))
            .map(|group| group.name.as_str())
    };
    let name = |at: usize| match (system.surfaces[at].label.as_str(), group(at)) {
        ("", Some(group)) => format!("{group} (surface {})", at + 1),
        ("", None) if at == system.image() => "image".to_owned(),
        ("", None) => format!("surface {}", at + 1),
        (label, Some(group)) if !label.contains(group) => format!("{group} {label}"),
        (label, _) => label.to_owned(),
    };
    format!("{} to {}", name(gap), name(gap + 1))
}

fn contrast(system: &OpticalSystem) -> Result<Vec<Mtf>, OpticsError> {
    let with = |pupil: usize| -> Result<Vec<Mtf>, OpticsError> {
        let of = |at| mtf(system, at, pupil, MTF_HIGHEST_PER_MM, MTF_POINTS, Clipping::On);
        system.fields.iter().map(|field| of(field.at)).collect()
    };
    let [few, more, most] = MTF_PUPIL;
    with(few).or_else(|_| with(more)).or_else(|_| with(most))
}

async fn system(State(app): Shared, Json(asked): Json<Asked>) -> Answer {
    beside(move || {
        let designed = source(&app, &asked)?;
        let mut system = designed.clone();
        for (surface, gap_mm) in &asked.gaps_mm {
            if !gaps(&designed).contains(surface) {
                return Err(Refusal::not_found("such gap"));
            }
            system.surfaces[*surface].thickness_mm = *gap_mm;
        }
        for (name, offset) in &asked.groups {
            let group = system.group_mut(name).ok_or_else(|| Refusal::not_found("such group"))?;
            let [tilt_x, tilt_y] = offset.tilt_deg.map(f64::to_radians);
            group.tilt_rad += DVec3::new(tilt_x, tilt_y, 0.0);
            group.decentre_mm += DVec3::new(offset.shift_mm[0], offset.shift_mm[1], 0.0);
        }
        system.check(Path::new("the system"))?;
        let options = SpotOptions { rings: RINGS, arms: ARMS, clipping: Clipping::On };
        let found = spots(&system, &options)?;
        let row = SpotRow { system: &system, points: &found, figures: &found, scale: 1.0 };
        // Far out of focus no pupil is fine enough: the layout and the spots are shown all the same.
        let (contrast, no_contrast) = match contrast(&system) {
            Ok(curves) => (Some(mtf_figure(&system, &curves).to_svg()), None),
            Err(error) => (None, Some(error.to_string())),
        };
        let gap_list: Vec<Value> = gaps(&designed)
            .into_iter()
            .map(|at| {
                json!({
                    "surface": at,
                    "between": names(&designed, at),
                    "designed_mm": designed.surfaces[at].thickness_mm,
                    "gap_mm": system.surfaces[at].thickness_mm,
                })
            })
            .collect();
        let fields: Vec<Value> = found
            .fields
            .iter()
            .map(|field| {
                json!({
                    "field": field.field, "rms_um": field.rms_um, "vignetted_fraction": field.vignetted_fraction,
                    "centroid_mm": field.centroid_mm,
                })
            })
            .collect();
        json_of(json!({
            "name": system.name,
            "airy_radius_um": found.airy_radius_um,
            "fields": fields,
            "gaps": gap_list,
            "groups": system.groups.iter().map(|group| &group.name).collect::<Vec<_>>(),
            "length_mm": system.vertices_mm().last(),
            "layout": layout_figure("", &[&system])?.to_svg(),
            "spots": spots_figure("", &[row]).to_svg(),
            "contrast": contrast,
            "no_contrast": no_contrast,
        }))
    })
    .await
}

async fn designs(State(app): Shared, Query(at): Query<At>) -> Answer {
    beside(move || {
        let document = document(&app, &at.at)?;
        if document["schema"] != "retina.optics-search/1" || !document["designs"].is_array() {
            return Err(InputError::new(Path::new(&at.at), "is no document of a lens search")
                .expected("what `retina optics search --json` prints")
                .into());
        }
        json_of(document)
    })
    .await
}
