//! `retina lab latency`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use retina::lab::{Latency, LatencyOptions, LatencyTrial, Quantiles, measure_latency};
use retina_files::{InputError, write_atomic};
use retina_plot::{Axis, Figure, PALETTE, Panel, Style};
use serde_json::{Value, json};

use super::DeviceArguments;
use crate::failure::Failure;
use crate::output::{print_json, print_lines};
use crate::progress::{advance, counter};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    devices: DeviceArguments,
    /// Number of frames that are changed in the middle of an exposure.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u16).range(3..=10_000))]
    trials: u16,
    /// Folder for latency.csv and latency.svg.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

/// A time that is measured: key, words, value.
type Measured = (&'static str, &'static str, fn(&LatencyTrial) -> f64);

const MEASURED: [Measured; 4] = [
    ("show_s", "showing a frame: the call", |trial| trial.show_s),
    ("show_to_image_s", "shown -> image in hand, without the exposure", |trial| trial.show_to_image_s),
    ("camera_s", "camera: trigger and transfer", |trial| trial.camera_s),
    ("settle_s", "glass later than the trigger", |trial| trial.settle_s),
];
/// A refresh of the display, s: what 60 Hz can add to the latest light that was seen.
const REFRESH_S: f64 = 1.0 / 60.0;

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut devices = arguments.devices.open()?;
    let mut options = LatencyOptions {
        trials: arguments.trials.into(),
        most_count: devices.setup.screen.limits.most_count,
        ..LatencyOptions::default()
    };
    match devices.capture.exposures_s.as_slice() {
        [] => {}
        [one] => options.exposure_s = *one,
        several => {
            return Err(InputError::new(Path::new("--exposure-s"), "takes one exposure time here")
                .found(format!("{} of them", several.len()))
                .into());
        }
    }
    let bar = counter(0, "trials");
    let size_px = [devices.setup.screen.width_px, devices.setup.screen.height_px];
    let found =
        devices.with(|_, rig| measure_latency(rig, size_px, &options, |done, of| advance(&bar, done, of)));
    bar.finish_and_clear();
    let found = found?;
    write(&arguments.out, "latency.csv", &table(&found))?;
    write(&arguments.out, "latency.svg", &figure(&found).to_svg())?;
    let settle_s = (found.quantiles(|trial| trial.settle_s).most + REFRESH_S).max(0.0);
    if arguments.json {
        let times: serde_json::Map<String, Value> = MEASURED
            .iter()
            .map(|(key, _, of)| ((*key).to_owned(), quantiles_json(found.quantiles(of))))
            .collect();
        return print_json(&json!({
            "schema": "retina.lab-latency/1",
            "trials": found.trials.len(),
            "exposure_s": found.exposure_s,
            "digital_count": found.digital_count,
            "lost": found.lost,
            "times": times,
            "wanted_settle_s": settle_s,
        }));
    }
    let mut lines = vec![format!(
        "{} frames changed within exposures of {} ms; milliseconds:",
        found.trials.len(),
        1e3 * found.exposure_s
    )];
    lines.push(format!("{:<46} {:>8} {:>8} {:>8} {:>8}", "", "least", "median", "95 %", "most"));
    for (_, words, of) in MEASURED {
        let of = found.quantiles(of);
        let ms = |value: f64| format!("{:8.1}", 1e3 * value);
        lines.push(format!(
            "{words:<46} {} {} {} {}",
            ms(of.least),
            ms(of.median),
            ms(of.within_95_percent),
            ms(of.most)
        ));
    }
    lines.push(format!(
        "--settle-s {settle_s:.3} lets a whole exposure see the frame: the latest light and a refresh of 60 Hz"
    ));
    print_lines(&lines)
}

fn quantiles_json(of: Quantiles) -> Value {
    json!({"least": of.least, "median": of.median, "within_95_percent": of.within_95_percent, "most": of.most})
}

fn table(found: &Latency) -> String {
    let mut text = String::from("share,show_s,show_to_image_s,camera_s,settle_s\n");
    for trial in &found.trials {
        let LatencyTrial { share, show_s, show_to_image_s, camera_s, settle_s } = trial;
        let _ = writeln!(text, "{share:.6},{show_s:.6},{show_to_image_s:.6},{camera_s:.6},{settle_s:.6}");
    }
    text
}

/// Histograms of the times.
fn figure(found: &Latency) -> Figure {
    let mut figure = Figure::new("Latency", 2, 2, [400.0, 230.0]);
    for (place, (_, words, of)) in MEASURED.into_iter().enumerate() {
        let mut panel =
            Panel::new(Axis::linear("time (ms)"), Axis::linear("trials").range(0.0, most(found, of)))
                .title(words);
        let (low, step, counts) = bins(found, of);
        for (k, count) in counts.iter().enumerate() {
            let (left, right, top) = (low + k as f64 * step, low + (k + 1) as f64 * step, *count as f64);
            let corners = [[left, 0.0], [left, top], [right, top], [right, 0.0]];
            panel.polygon(&corners, Style::line(PALETTE[0]).filled(0.5));
        }
        figure.put(place / 2, place % 2, panel);
    }
    figure
}

/// Lower end and width of the bins, ms, and what they hold.
fn bins(found: &Latency, of: fn(&LatencyTrial) -> f64) -> (f64, f64, Vec<usize>) {
    let quantiles = found.quantiles(of);
    let (low, high) = (1e3 * quantiles.least, 1e3 * quantiles.most);
    let count = (found.trials.len() as f64).sqrt().ceil().max(4.0);
    let step = ((high - low) / count).max(0.1);
    let mut counts = vec![0; count as usize];
    for trial in &found.trials {
        let bin = ((1e3 * of(trial) - low) / step) as usize;
        counts[bin.min(count as usize - 1)] += 1;
    }
    (low, step, counts)
}

fn most(found: &Latency, of: fn(&LatencyTrial) -> f64) -> f64 {
    1.1 * bins(found, of).2.into_iter().max().unwrap_or(1) as f64
}

fn write(folder: &Path, name: &str, text: &str) -> Result<(), Failure> {
    let path = folder.join(name);
    std::fs::create_dir_all(folder)
        .and_then(|()| write_atomic(&path, text.as_bytes()))
        .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")).into())
}
