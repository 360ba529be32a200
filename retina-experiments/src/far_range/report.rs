//! What the experiment says: JSON and figures.

use retina_plot::{Axis, Colour, Figure, PALETTE, Panel, Style};
use serde_json::{Value, json};

use super::imaged::ImagedResult;
use super::poses::{PoseResult, PosesSummary};
use super::scenario::{Images, Scenario};
use super::transfer::TransferResult;

/// The paper's figures, for comparison.
pub const PAPER_ATTITUDE_PERCENT: f64 = 98.22;
/// Planets identified where the attitude was found.
pub const PAPER_PLANET_PERCENT: f64 = 98.82;
/// Position (km) and velocity (m/s) at the end of the transfer, 3 sigma.
pub const PAPER_THREE_SIGMA: [f64; 2] = [5320.0, 0.97];

/// More wrong answers than this share are no chance.
const MOST_WRONG: f64 = 0.05;

/// What a reader of the results should not miss.
pub fn warnings(scenario: &Scenario, poses: &PosesSummary, imaged: Option<&ImagedResult>) -> Vec<String> {
    let mut found = Vec::new();
    let ratio = poses.attitude_nees_ratio;
    if ratio > crate::MOST_NEES_RATIO || poses.attitude_wrong as f64 > MOST_WRONG * poses.poses as f64 {
        let mut what = format!("{} of {} attitudes are wrong", poses.attitude_wrong, poses.poses);
        if ratio > crate::MOST_NEES_RATIO {
            what += &format!(
                ", and those found are off by {:.0} times what their covariances allow (mean squared error over the \
                 covariance's, NEES / 3: {ratio:.1})",
                ratio.sqrt(),
            );
        }
        found.push(format!("{what}: {}", likely_cause(scenario, scenario.images)));
    }
    let images = scenario.transfer.as_ref().and_then(|transfer| transfer.images.taken());
    if let (Some(run), Some(images)) = (imaged, images) {
        let scattered = run.nis.filter(|nis| *nis > run.nis_bounds[1]);
        if scattered.is_some() || run.wrong as f64 > MOST_WRONG * run.images as f64 {
            let nis = scattered.map_or(String::new(), |nis| {
                format!(
                    ", and the NIS of {nis:.2} is above its 99 % bounds, which end at {:.2}",
                    run.nis_bounds[1]
                )
            });
            let cause = likely_cause(scenario, images);
            found.push(format!(
                "on the transfer {} answers of {} images are wrong{nis}: {cause}",
                run.wrong, run.images
            ));
        }
    }
    found
}

/// Why errors may be larger than the covariances say.
fn likely_cause(scenario: &Scenario, images: Images) -> String {
    match images {
        Images::Points => {
            "covariances do not know of `points.systematic_px`; see whether it is as large as you meant"
                .to_owned()
        }
        Images::Ideal => "see whether the setup describes the camera that you meant".to_owned(),
        Images::Bench => {
            let name = scenario
                .calibration_path
                .as_ref()
                .map_or(String::new(), |path| format!(" {}", path.display()));
            format!(
                "the calibration{name} was not measured on this bench, or with too few points. Measure one (`retina simulate \
                 points`, `retina calibrate geometry`) and give it by --calibration; the ones that ship are examples"
            )
        }
    }
}

/// The document of `navigate far-range --json`; `warnings`: what [`warnings`] found.
pub fn document(
    scenario: &Scenario,
    poses: &PosesSummary,
    transfer: Option<&TransferResult>,
    imaged: Option<&ImagedResult>,
    warnings: &[String],
) -> Value {
    let images = match scenario.images {
        Images::Points => "points",
        Images::Ideal => "ideal",
        Images::Bench => "bench",
    };
    let transfer = transfer.map(|result| {
        let last = result.sessions.last();
        json!({
            "sessions": result.sessions.len(),
            "samples": result.samples,
            "line_of_sight_sigma_arcsec": result.line_of_sight_sigma_arcsec,
            "images_used": result.images_used,
            "sun_distance_au": result.sun_distance_au,
            "final_three_sigma_km": last.map(|s| s.three_sigma[0]),
            "final_three_sigma_m_s": last.map(|s| s.three_sigma[1]),
            "final_rms_km": last.map(|s| s.rms[0]),
            "final_rms_m_s": last.map(|s| s.rms[1]),
            "final_within_three_sigma": last.map(|s| s.within),
            "paper_three_sigma_km": PAPER_THREE_SIGMA[0],
            "paper_three_sigma_m_s": PAPER_THREE_SIGMA[1],
            "nees_bounds": result.nees_bounds,
            "nees_sessions_within": result.nees_within,
            "nis": result.nis,
            "nis_bounds": result.nis_bounds,
            "images": scenario.transfer.as_ref().map(|transfer| transfer.images),
            "imaged": imaged,
            "by_session": result.sessions.iter().map(|s| json!({
                "day": s.day, "planets": s.planets, "distances_m": s.distances_m,
                "three_sigma_km": s.three_sigma[0], "three_sigma_m_s": s.three_sigma[1],
                "rms_km": s.rms[0], "rms_m_s": s.rms[1], "nees": s.nees, "nis": s.nis,
                "within_three_sigma": s.within, "triangulation_rms_and_three_sigma_km": s.fix_km,
            })).collect::<Vec<_>>(),
        })
    });
    json!({
        "schema": "retina.far-range-result/1",
        "images": images,
        "ephemeris": scenario.ephemeris.name(),
        "seed": scenario.seed,
        "poses": poses,
        "paper": {"attitude_found_percent": PAPER_ATTITUDE_PERCENT, "planet_found_percent": PAPER_PLANET_PERCENT},
        "transfer": transfer,
        "warnings": warnings,
    })
}

/// Fig. 12: cumulative distributions of the attitude's errors, and of the planets' lines of sight.
pub fn figure_12(results: &[PoseResult]) -> String {
    let mut panel = Panel::new(
        Axis::log("error (arcsec)").range(0.1, 1000.0),
        Axis::linear("fraction of solved poses").range(0.0, 1.0),
    )
    .title("Attitude errors over random poses");
    let found: Vec<&PoseResult> = results.iter().filter(|r| r.outcome == "solved").collect();
    type Pick = fn(&PoseResult) -> Option<f64>;
    let curves: [(&str, Pick); 3] = [
        ("across the boresight", |r| r.cross_arcsec),
        ("about the boresight", |r| r.about_arcsec),
        ("planet's line of sight", |r| r.planet_arcsec),
    ];
    for ((label, pick), colour) in curves.into_iter().zip(PALETTE) {
        let mut values: Vec<f64> = found.iter().filter_map(|r| pick(r)).collect();
        values.sort_by(f64::total_cmp);
        let count = values.len() as f64;
        let step = (values.len() / 400).max(1);
        let line: Vec<[f64; 2]> = values
            .iter()
            .enumerate()
            .step_by(step)
            .map(|(at, value)| [value.clamp(0.1, 1000.0), (at + 1) as f64 / count])
            .collect();
        panel.line(label, &line, Style::line(colour));
    }
    let mut figure = Figure::new("", 1, 1, [520.0, 360.0]);
    figure.put(0, 0, panel);
    figure.to_svg()
}

/// Fig. 13: errors of all samples and of the run on images with the filter's three sigma, and the filter's consistency.
pub fn figure_13(result: &TransferResult, imaged: Option<&ImagedResult>) -> String {
    let imaged = imaged.map_or(&[][..], |run| &run.by_session);
    let days = result.sessions.last().map_or(1.0, |s| s.day);
    let mut figure = Figure::new("", 1, 3, [430.0, 330.0]);
    for (k, (title, label)) in
        [("Position", "error (km)"), ("Velocity", "error (m/s)")].into_iter().enumerate()
    {
        let values = result.sessions.iter().flat_map(|s| s.errors.iter().map(move |e| e[k]));
        let values = values.chain(imaged.iter().map(|s| s.error[k]));
        let (least, most) = values.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
        let bounds = result.sessions.iter().map(|s| s.three_sigma[k]);
        let top = bounds.chain(imaged.iter().map(|s| s.three_sigma[k])).fold(most, f64::max);
        // A decade for the legend where it names two lines more.
        let room = if imaged.is_empty() { 1.3 } else { 10.0 };
        let mut panel = Panel::new(
            Axis::linear("day").range(0.0, days),
            Axis::log(label).range(least.max(top * 1e-5), room * top),
        )
        .title(format!("{title}: {} samples", result.samples));
        for sample in 0..result.samples {
            let line: Vec<[f64; 2]> =
                result.sessions.iter().map(|s| [s.day, s.errors[sample][k].max(top * 1e-5)]).collect();
            panel.line("", &line, Style::thin(PALETTE[1]));
        }
        let bound: Vec<[f64; 2]> = result.sessions.iter().map(|s| [s.day, s.three_sigma[k]]).collect();
        panel.line("3 sigma of the filter", &bound, Style::line(PALETTE[0]).width(2.0));
        if !imaged.is_empty() {
            let error: Vec<[f64; 2]> = imaged.iter().map(|s| [s.day, s.error[k].max(top * 1e-5)]).collect();
            panel.line("one run on images", &error, Style::line(Colour::BLACK).width(2.0));
            let own: Vec<[f64; 2]> = imaged.iter().map(|s| [s.day, s.three_sigma[k]]).collect();
            panel.line("its 3 sigma", &own, Style::line(Colour::BLACK).dashed());
        }
        let paper = [[0.0, PAPER_THREE_SIGMA[k]], [days, PAPER_THREE_SIGMA[k]]];
        panel.line("the paper's, at the end", &paper, Style::line(PALETTE[2]).dashed());
        figure.put(0, k, panel);
    }
    let mut panel =
        Panel::new(Axis::linear("day").range(0.0, days), Axis::linear("mean NEES").range(0.0, 12.0))
            .title("Consistency");
    let line: Vec<[f64; 2]> = result.sessions.iter().map(|s| [s.day, s.nees.min(12.0)]).collect();
    panel.line("mean over samples", &line, Style::line(PALETTE[0]));
    for (at, bound) in result.nees_bounds.into_iter().enumerate() {
        let label = if at == 0 { "99 % bounds" } else { "" };
        panel.line(label, &[[0.0, bound], [days, bound]], Style::line(PALETTE[2]).dashed());
    }
    figure.put(0, 2, panel);
    figure.to_svg()
}
