//! What a sequence says: JSON, a table and a page.

use retina_report::{Page, Section};
use serde_json::{Value, json};

use super::figures::{Shown, figure_15, figure_errors, figure_filter};
use super::filter::FilterResult;
use super::sequence::{FrameResult, SequenceSummary};
use super::source::{ImageKind, Source};
use retina_navigation::limb::Mapping;

/// What the paper says of its Fig. 15; it prints no numbers.
pub const PAPER: &str = "the paper (Fig. 15, no numbers in its text): the error along Z is greater than along X and Y; \
    facility images give results like ideal ones";

/// A sequence with its results.
pub struct Sequence {
    /// Its name.
    pub label: String,
    /// Its frames.
    pub frames: Vec<FrameResult>,
    /// Rates and distributions.
    pub summary: SequenceSummary,
    /// The filter, or why there is none.
    pub filter: Result<FilterResult, String>,
}

impl Sequence {
    /// As figures take it.
    pub fn shown(&self) -> Shown<'_> {
        Shown { label: &self.label, frames: &self.frames, filter: self.filter.as_ref().ok() }
    }

    fn json(&self, frames: bool) -> Value {
        let filter = match &self.filter {
            Ok(filter) => json!(filter),
            Err(why) => json!({"none": why}),
        };
        let mut out = json!({"name": self.label, "summary": self.summary, "filter": filter});
        if frames {
            out["frames"] = json!(self.frames);
            if let Ok(filter) = &self.filter {
                out["filter"]["steps"] = json!(filter.steps);
            }
        }
        out
    }
}

/// The document of `navigate full-disk DIR --json`, schema `retina.navigation-full-disk/1`.
pub fn document(source: &Source, sequence: &Sequence) -> Value {
    let kind = match source.kind {
        ImageKind::Screen => "screen",
        ImageKind::Camera => "camera",
    };
    let mapping = match source.camera.mapping {
        Mapping::Pinhole => "pinhole",
        Mapping::Downstream(_) => "downstream",
        Mapping::Screen(_) => "screen",
        Mapping::Stars(_) => "stars",
    };
    let mut out = sequence.json(true);
    out["schema"] = json!("retina.navigation-full-disk/1");
    out["kind"] = json!(kind);
    out["mapping"] = json!(mapping);
    out["silhouette"] = json!(source.choice.silhouette);
    out["limb_height_m"] = json!(source.choice.limb.limb_height_m);
    out["limb_height_sigma_m"] = json!(source.choice.limb.limb_height_sigma_m);
    out["pointing_sigma_arcsec"] = json!(source.choice.pointing_sigma_rad.to_degrees() * 3600.0);
    out["notes"] = json!(source.notes);
    out
}

/// The document of a scenario, schema `retina.full-disk-result/1`; frames stand in the kinds' own files.
pub fn scenario_document(sequences: &[Sequence]) -> Value {
    json!({
        "schema": "retina.full-disk-result/1",
        "paper": PAPER,
        "kinds": sequences.iter().map(|sequence| sequence.json(false)).collect::<Vec<_>>(),
    })
}

fn three(values: [f64; 3]) -> String {
    let cell = |v: f64| match v.abs() {
        size if size.is_nan() => "-".to_owned(),
        // Of asteroids metres count.
        size if size < 0.1 => format!("{v:.4}"),
        size if size < 10.0 => format!("{v:.2}"),
        _ => format!("{v:.1}"),
    };
    format!("{}, {}, {}", cell(values[0]), cell(values[1]), cell(values[2]))
}

/// What a sequence's figures say is wrong with it.
pub fn warnings(sequences: &[Sequence]) -> Vec<String> {
    let mut out = Vec::new();
    for sequence in sequences {
        let (label, s) = (&sequence.label, &sequence.summary);
        if s.solved > 0 && s.nees_ratio > crate::MOST_NEES_RATIO {
            out.push(format!(
                "{label}: errors are {:.0} times what their covariances allow (NEES / 3 = {:.1}; Z off by {:.0} km on \
                 average, the limb by {:.0} m): images, setup, calibration and body do not belong together. Photographs \
                 that hold the facility's distortion need the calibration that was measured on that facility (of the \
                 virtual bench: `retina simulate points --images`, `retina calibrate geometry`; the ones that ship are \
                 not its own); compensated ones, one like it when they are rendered",
                s.nees_ratio.sqrt(),
                s.nees_ratio,
                s.bias_km[2],
                s.height_m[0],
            ));
        }
        if let Ok(filter) = &sequence.filter
            && !(filter.nis_bounds[0]..=filter.nis_bounds[1]).contains(&filter.nis_mean)
        {
            let [low, high] = filter.nis_bounds;
            let why = if filter.nis_mean > high {
                "measurements scatter more than the filter expects: their covariance or the unknown acceleration is too small"
            } else {
                "measurements scatter less than the filter expects: their covariance or the unknown acceleration is too large"
            };
            out.push(format!(
                "{label}: the filter's mean NIS of {:.2} is outside its 99 % bounds, {low:.2} to {high:.2}: {why}",
                filter.nis_mean
            ));
        }
    }
    out
}

const HEADINGS: [&str; 10] = [
    "images",
    "solved",
    "refused",
    "single frames: bias X, Y, Z (km)",
    "rms (km)",
    "limb height (m)",
    "NEES / 3",
    "filter: rms X, Y, Z (km)",
    "within 3 sigma",
    "NIS",
];

fn rows(sequences: &[Sequence]) -> Vec<Vec<String>> {
    sequences
        .iter()
        .map(|sequence| {
            let s = &sequence.summary;
            let refused: Vec<String> = s.refused.iter().map(|(why, n)| format!("{n} {why}")).collect();
            let mut row = vec![
                sequence.label.clone(),
                format!("{} of {}", s.solved, s.frames),
                if refused.is_empty() { "0".to_owned() } else { refused.join(", ") },
                three(s.bias_km),
                three(s.rms_km),
                if s.solved == 0 {
                    "-".into()
                } else {
                    format!("{:.0} +- {:.0}", s.height_m[0], s.height_m[1])
                },
                if s.solved == 0 { "-".into() } else { format!("{:.2}", s.nees_ratio) },
            ];
            match &sequence.filter {
                Ok(f) => row.extend([
                    three(f.rms_km),
                    f.within_three_sigma.map(|v| format!("{:.0} %", 100.0 * v)).join(", "),
                    format!("{:.2} ({:.2} to {:.2})", f.nis_mean, f.nis_bounds[0], f.nis_bounds[1]),
                ]),
                Err(_) => row.extend(std::iter::repeat_n("-".to_owned(), 3)),
            }
            row
        })
        .collect()
}

/// Why sequences have no filter.
fn without_filter(sequences: &[Sequence]) -> impl Iterator<Item = String> {
    let why = |sequence: &Sequence| Some((sequence.label.clone(), sequence.filter.as_ref().err()?.clone()));
    sequences.iter().filter_map(why).map(|(label, why)| format!("{label}: no filter: {why}"))
}

/// The table as lines of text.
pub fn lines(sequences: &[Sequence]) -> Vec<String> {
    let rows = rows(sequences);
    let mut out = Vec::new();
    for (at, heading) in HEADINGS.iter().enumerate() {
        let cells: Vec<String> = rows.iter().map(|row| format!("{:<30}", row[at])).collect();
        out.push(format!("{heading:<34}{}", cells.join("")).trim_end().to_owned());
    }
    out.extend(without_filter(sequences));
    out.push(PAPER.to_owned());
    out
}

/// The page of one sequence or of a scenario's.
pub fn page(title: &str, sequences: &[Sequence], notes: &[String]) -> Page {
    let shown: Vec<Shown<'_>> = sequences.iter().map(Sequence::shown).collect();
    let mut result = Section::new("Errors of the position")
        .table(&HEADINGS, &rows(sequences))
        .text(PAPER)
        .text(
            "X is right, Y down, Z along the boresight. The limb's height is the range's error as a height of the \
             whole limb above the reference surface, mean and standard deviation over the frames.",
        )
        .list(&notes.iter().cloned().chain(without_filter(sequences)).collect::<Vec<_>>());
    if sequences.iter().any(|sequence| sequence.filter.is_ok()) {
        result = result.figure(
            &figure_15(&shown, true),
            "The filter's errors along the camera's axes after it has settled: densities and cumulative distributions \
             (Fig. 15 of the paper).",
        );
    }
    result = result
        .figure(&figure_15(&shown, false), "The same of single frames, without a filter.")
        .figure(&figure_errors(&shown), "Single frames against phase angle and distance.");
    let mut page = Page::new("navigate full-disk", title).section(result);
    for sequence in sequences {
        if let Ok(filter) = &sequence.filter {
            let o = &filter.options;
            let text = format!(
                "{} updates. Unknown acceleration {:.1e} m/s^2 over {:.0} h (the truth's, against Moon, Earth, Sun and sunlight: {}); \
                 errors that frames share decay over {}. NEES within the central 99 % of chi-square in {:.0} % of the \
                 steps, NIS {:.2} (99 % bounds {:.2} to {:.2}).",
                filter.updates,
                o.acceleration_sigma_m_s2,
                o.acceleration_time_h,
                filter.unmodelled_m_s2.map_or("not known".to_owned(), |v| format!("{v:.1e} m/s^2 rms")),
                match o.terrain_time_h {
                    Some(hours) => format!("{hours:.0} h"),
                    None => format!(
                        "{:.0} deg of the line of sight on the body and {:.0} deg of the lit side",
                        o.terrain_tilt_deg, o.terrain_roll_deg
                    ),
                },
                100.0 * filter.nees_within,
                filter.nis_mean,
                filter.nis_bounds[0],
                filter.nis_bounds[1],
            );
            page = page.section(
                Section::new(&format!("Filter over {} images", sequence.label)).text(&text).figure(
                    &figure_filter(filter),
                    "Errors with three sigma over time, and the filter's consistency.",
                ),
            );
        }
    }
    page
}
