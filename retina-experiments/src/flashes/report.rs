//! What a sequence says: JSON, a table and a page.

use retina_report::{Page, Section};
use serde_json::{Value, json};

use super::figures::figure_rates;
use super::sequence::{CameraLight, FlashFrame, SCHEMA};
use super::summary::FlashSummary;
use retina_navigation::flashes::FlashOptions;

/// A sequence with its results.
pub struct Watched {
    /// Its name.
    pub label: String,
    /// What is known of its light; of screen images the setup says it.
    pub light: Option<CameraLight>,
    /// Its frames.
    pub frames: Vec<FlashFrame>,
    /// Rates and errors.
    pub summary: FlashSummary,
}

impl Watched {
    fn json(&self) -> Value {
        let zero = self.light.and_then(|light| light.zero_point);
        json!({
            "name": self.label,
            "zero_point_magnitude": zero.map(|zero| zero.magnitude),
            "zero_point_corner_magnitude": zero.map(|zero| zero.corner_magnitude),
            "zero_point_bend_magnitude": zero.map(|zero| zero.bend_magnitude),
            "zero_point_sigma_magnitude": zero.map(|zero| zero.sigma_magnitude),
            "spot_sigma_px": self.light.map(|light| light.spot_sigma_px),
            "summary": self.summary,
        })
    }

    /// Why there are no rates, or rates of little: those of nothing are none.
    pub fn nothing_to_see(&self) -> Vec<String> {
        let mut out = Vec::new();
        if self.frames.iter().all(|frame| frame.flashes.is_empty()) {
            out.push(
                "the truth holds no flash (the scene had no [flashes], or none during an exposure): candidates are all \
                 false, rates say nothing"
                    .to_owned(),
            );
        }
        let blind = self.frames.iter().filter(|frame| frame.watched_px == 0).count();
        if blind > 0 {
            out.push(format!(
                "in {blind} of {} frames no pixel is left to look at: the night side is within the margins to the limb, \
                 the terminator and what relief may light (limb_margin_px, terminator_margin_px, relief), or off the \
                 field",
                self.frames.len()
            ));
        }
        out
    }
}

/// What must be said of a scenario's sequences, each by its name.
pub fn scenario_notes(sequences: &[Watched]) -> Vec<String> {
    let named = |sequence: &Watched| {
        let notes = sequence.nothing_to_see().into_iter();
        notes.map(|note| format!("{}: {note}", sequence.label)).collect::<Vec<_>>()
    };
    sequences.iter().flat_map(named).collect()
}

/// The document of `navigate flashes DIR --json`, schema `retina.navigation-flashes/1`.
pub fn document(watched: &Watched, options: &FlashOptions, notes: &[String]) -> Value {
    let mut out = watched.json();
    out["schema"] = json!(SCHEMA);
    out["detector"] = json!(options);
    out["frames"] = json!(watched.frames);
    out["notes"] = json!(notes);
    out
}

/// The document of a scenario, schema `retina.flashes-result/1`; frames stand in the kinds' own files.
pub fn scenario_document(sequences: &[Watched], options: &FlashOptions, notes: &[String]) -> Value {
    json!({
        "schema": "retina.flashes-result/1",
        "detector": options,
        "kinds": sequences.iter().map(Watched::json).collect::<Vec<_>>(),
        "notes": notes,
    })
}

const HEADINGS: [&str; 10] = [
    "images",
    "frames",
    "night side (px)",
    "flashes: all, hidden, in the margins",
    "watched, found",
    "half are found at V",
    "false detections a frame (expected)",
    "magnitude: error, scatter",
    "its chi-square",
    "place: 50, 95 % (km); px",
];

fn or_none(text: Option<String>) -> String {
    text.unwrap_or_else(|| "-".to_owned())
}

fn rows(sequences: &[Watched]) -> Vec<Vec<String>> {
    sequences
        .iter()
        .map(|sequence| {
            let s = &sequence.summary;
            let half = s.logistic.map(|fit| match fit.sigma_50 {
                Some(sigma) => format!("{:.2} +- {sigma:.2}", fit.magnitude_50),
                None => format!("{:.2} (a step)", fit.magnitude_50),
            });
            let place = s
                .place_percentiles_m
                .zip(s.rms_px)
                .map(|(m, px)| format!("{:.1}, {:.1}; {px:.2}", m[0] * 1e-3, m[2] * 1e-3));
            vec![
                sequence.label.clone(),
                s.frames.to_string(),
                format!("{:.0}", s.watched_px),
                format!("{}, {}, {}", s.flashes, s.hidden, s.outside),
                format!("{}, {}", s.watched, s.found),
                half.unwrap_or_else(|| {
                    match (s.watched, s.found) {
                        (0, _) => "-",
                        (_, 0) => "none is found",
                        _ => "all are found",
                    }
                    .to_owned()
                }),
                format!("{:.3} ({})", s.false_per_frame, s.expected_false_per_frame),
                or_none(s.magnitude_error.map(|[mean, sigma]| format!("{mean:+.3}, {sigma:.3}"))),
                or_none(s.magnitude_chi2.map(|chi2| format!("{chi2:.2}"))),
                or_none(place),
            ]
        })
        .collect()
}

/// The table as lines of text, then the rates.
pub fn lines(sequences: &[Watched]) -> Vec<String> {
    let rows = rows(sequences);
    let mut out = Vec::new();
    for (at, heading) in HEADINGS.iter().enumerate() {
        let cells: Vec<String> = rows.iter().map(|row| format!("{:<24}", row[at])).collect();
        out.push(format!("{heading:<40}{}", cells.join("")).trim_end().to_owned());
    }
    for sequence in sequences {
        for bin in &sequence.summary.rates {
            out.push(format!(
                "{}: V {:.2} to {:.2}: {} of {} found, {:.0} % ({:.0} to {:.0} %)",
                sequence.label,
                bin.magnitudes[0],
                bin.magnitudes[1],
                bin.found,
                bin.flashes,
                100.0 * bin.rate,
                100.0 * bin.interval[0],
                100.0 * bin.interval[1],
            ));
        }
    }
    out
}

/// The page of one sequence or of a scenario's.
pub fn page(title: &str, sequences: &[Watched], notes: &[String]) -> Page {
    let section = Section::new("Flashes on the night side")
        .table(&HEADINGS, &rows(sequences))
        .text(
            "Rates are of flashes that nothing hides, on the night side within the margins. Magnitudes are means over the \
             exposure: a flash that shines for half of it is 0.75 mag fainter. False detections are candidates with no \
             flash within 3 px, or within two standard deviations of the spot if that is more; expected are those that \
             noise gives above the threshold.",
        )
        .list(notes)
        .figure(
            &figure_rates(sequences),
            "Detection rate against magnitude with Wilson's intervals of 95 % and a logistic curve; errors of magnitude and \
             of the place on the surface.",
        );
    Page::new("navigate flashes", title).section(section)
}
