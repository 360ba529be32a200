//! `retina navigate flashes`.

use std::path::{Path, PathBuf};

use retina_batch::{FrameRange, Selection, Shard};
use retina_files::InputError;
use retina_navigation::experiment::Watcher as _;
use retina_navigation::flashes::{
    CameraLight, FlashFrame, FlashOptions, FlashScenario, figure_rates, report, run_scenario, summarise,
    watch_sequence,
};
use retina_navigation::full_disk::{ImageKind, Source, SourceChoice};
use retina_navigation::limb::LimbOptions;
use serde_json::Value;

use super::steps::{Steps, results_folder, results_name, write};
use crate::command::Backend;
use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};

/// Width of a spot that is not given, px.
const SPOT_SIGMA_PX: f64 = 1.0;
/// Width of bins that is not given.
const BIN_MAGNITUDES: f64 = 0.5;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A folder that `retina render` wrote, or a scenario, schema retina.flashes/1: the whole experiment.
    #[arg(value_name = "DIR|SCENARIO.toml")]
    input: PathBuf,
    /// Camera images of the folder's screens, as `retina simulate frames` writes them.
    #[arg(long, value_name = "FOLDER")]
    images: Option<PathBuf>,
    /// The facility, schema retina.setup/1.
    #[arg(long, value_name = "FILE")]
    setup: Option<PathBuf>,
    /// The facility's calibration: of camera images that hold its distortion, or the one that the screen images were
    /// rendered with.
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// The body [default: the only one].
    #[arg(long, value_name = "NAME")]
    body: Option<String>,
    /// Only frames A to B, counted from 0, B excluded.
    #[arg(long, value_name = "A..B", allow_hyphen_values = true)]
    frames: Option<FrameRange>,
    /// Only the frames whose number is I modulo N.
    #[arg(long, value_name = "I/N", allow_hyphen_values = true)]
    shard: Option<Shard>,
    /// Magnitude whose light is one DN of the camera's images in their exposure; without it magnitudes are not measured
    /// there.
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    zero_point_magnitude: Option<f64>,
    /// Standard deviation of a point's spot in the camera's images, px [default: 1].
    #[arg(long, value_name = "PX")]
    spot_sigma_px: Option<f64>,
    /// False detections that normal noise gives in a frame: sets the threshold.
    #[arg(long, value_name = "N", default_value_t = FlashOptions::default().false_alarms_per_frame)]
    false_alarms_per_frame: f64,
    /// Nothing is looked for so near to the limb, px.
    #[arg(long, value_name = "PX", default_value_t = FlashOptions::default().limb_margin_px)]
    limb_margin_px: f64,
    /// Nor so near to what may be lit, px.
    #[arg(long, value_name = "PX", default_value_t = FlashOptions::default().terminator_margin_px)]
    terminator_margin_px: f64,
    /// Highest relief over its surroundings, over the body's radius: summits beyond the terminator may be lit.
    #[arg(long, value_name = "SHARE", default_value_t = FlashOptions::default().relief)]
    relief: f64,
    /// Width of the bins of the detection rates.
    #[arg(long, value_name = "MAG", default_value_t = BIN_MAGNITUDES)]
    bin_magnitudes: f64,
    /// What renders a scenario.
    #[arg(long, value_enum, default_value_t)]
    backend: Backend,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
    /// Also write a page with plots.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Folder for the results; frames that are in it are not measured again.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.report.as_ref().map_or(Ok(()), |path| crate::check_file(path, "html"))?;
    if arguments.input.extension().is_some_and(|extension| extension == "toml") {
        return scenario(arguments);
    }
    let options = FlashOptions {
        false_alarms_per_frame: arguments.false_alarms_per_frame,
        limb_margin_px: arguments.limb_margin_px,
        terminator_margin_px: arguments.terminator_margin_px,
        relief: arguments.relief,
        ..FlashOptions::default()
    };
    options.check(Path::new("the command line"), |key| format!("--{}", key.replace('_', "-")))?;
    let light = arguments.light()?;
    let kind = if arguments.images.is_some() { ImageKind::Camera } else { ImageKind::Screen };
    let source = Source::open(SourceChoice {
        dir: arguments.input.clone(),
        images: arguments.images.clone(),
        kind: Some(kind),
        setup: arguments.setup.clone(),
        calibration: arguments.calibration.clone(),
        body: arguments.body.clone(),
        selection: Selection { range: arguments.frames, every: None, shard: arguments.shard },
        limb: LimbOptions::default(),
        pointing_sigma_rad: 0.0,
    })?;
    let mut notes = source.notes.clone();
    if kind == ImageKind::Camera && arguments.spot_sigma_px.is_none() {
        notes.push(format!(
            "no --spot-sigma-px: spots are taken to be {SPOT_SIGMA_PX} px wide (standard deviation)"
        ));
    }
    if kind == ImageKind::Camera && arguments.zero_point_magnitude.is_none() {
        notes.push(
            "no --zero-point-magnitude: the camera's light is not known, magnitudes are not measured"
                .to_owned(),
        );
    }
    notes.iter().for_each(|note| tell!("{note}"));
    let list = match &arguments.out {
        None => None,
        Some(out) => {
            results_folder(out, &arguments.input)?;
            Some(out.join("frames.jsonl"))
        }
    };
    let mut steps = Steps::new();
    steps.step("looking for flashes");
    let all = source.frames.len();
    let frames =
        watch_sequence(&source, &light, &options, list.as_deref(), &mut |done| steps.done(done, all));
    steps.finish();
    let frames = frames?;
    for note in nothing_to_see(&frames) {
        tell!("{note}");
        notes.push(note);
    }
    let label = arguments.input.file_name().map_or("images".into(), |name| name.to_string_lossy());
    let watched = report::Watched {
        label: label.clone().into_owned(),
        light: (kind == ImageKind::Camera).then_some(light),
        summary: summarise(&frames, arguments.bin_magnitudes, options.false_alarms_per_frame),
        frames,
    };
    let document = report::document(&watched, &options, &notes);
    let sequences = [watched];
    if let Some(out) = &arguments.out {
        let name = results_name("flashes", arguments.frames, arguments.shard);
        write(out, &format!("{name}.json"), &format!("{document:#}\n"))?;
        write(out, &format!("{name}.svg"), &figure_rates(&sequences))?;
    }
    if let Some(path) = &arguments.report {
        report::page(&format!("Flashes: {label}"), &sequences, &notes).write(path)?;
    }
    print(arguments, &document, &sequences)
}

/// Rates of nothing are no rates: why there are none.
fn nothing_to_see(frames: &[FlashFrame]) -> Vec<String> {
    let mut out = Vec::new();
    if frames.iter().all(|frame| frame.flashes.is_empty()) {
        out.push("the truth holds no flash (the scene had no [flashes], or none during an exposure): candidates are all false, rates say nothing".to_owned());
    }
    let blind = frames.iter().filter(|frame| frame.watched_px == 0).count();
    if blind > 0 {
        out.push(format!(
            "in {blind} of {} frames no pixel is left to look at: the night side is within --limb-margin-px, \
             --terminator-margin-px and --relief of its edges, or off the field",
            frames.len()
        ));
    }
    out
}

fn scenario(arguments: &Arguments) -> Result<(), Failure> {
    let options = FlashOptions::default();
    let named = [
        ("--images", arguments.images.is_some()),
        ("--setup", arguments.setup.is_some()),
        ("--calibration", arguments.calibration.is_some()),
        ("--body", arguments.body.is_some()),
        ("--frames", arguments.frames.is_some()),
        ("--shard", arguments.shard.is_some()),
        ("--zero-point-magnitude", arguments.zero_point_magnitude.is_some()),
        ("--spot-sigma-px", arguments.spot_sigma_px.is_some()),
        ("--false-alarms-per-frame", arguments.false_alarms_per_frame != options.false_alarms_per_frame),
        ("--limb-margin-px", arguments.limb_margin_px != options.limb_margin_px),
        ("--terminator-margin-px", arguments.terminator_margin_px != options.terminator_margin_px),
        ("--relief", arguments.relief != options.relief),
        ("--bin-magnitudes", arguments.bin_magnitudes != BIN_MAGNITUDES),
    ];
    if let Some((flag, _)) = named.iter().find(|(_, given)| *given) {
        return Err(InputError::new(Path::new(flag), "belongs to a folder of frames")
            .found(arguments.input.display())
            .help("write it into the scenario")
            .into());
    }
    let scenario = FlashScenario::read(&arguments.input)?;
    let Some(out) = &arguments.out else {
        return Err(Failure::new("a scenario needs --out: the folder for its frames and results"));
    };
    let mut steps = Steps::new();
    let result = run_scenario(&scenario, out, arguments.backend.into(), &mut steps);
    steps.finish();
    let sequences = result?;
    write(out, "flashes.svg", &figure_rates(&sequences))?;
    let document = report::scenario_document(&sequences, &scenario.detector);
    write(out, "flashes.json", &format!("{document:#}\n"))?;
    let page = arguments.report.clone().unwrap_or_else(|| out.join("flashes.html"));
    report::page("Flashes of impacts", &sequences, &[]).write(&page)?;
    print(arguments, &document, &sequences)
}

fn print(arguments: &Arguments, document: &Value, sequences: &[report::Watched]) -> Result<(), Failure> {
    if arguments.json { print_json(document) } else { print_lines(&report::lines(sequences)) }
}

impl Arguments {
    fn light(&self) -> Result<CameraLight, InputError> {
        let spot_sigma_px = self.spot_sigma_px.unwrap_or(SPOT_SIGMA_PX);
        let zero_point = self.zero_point_magnitude.unwrap_or(0.0);
        for (flag, value, fits, expected) in [
            ("--spot-sigma-px", spot_sigma_px, (0.3..=10.0).contains(&spot_sigma_px), "0.3 to 10"),
            ("--zero-point-magnitude", zero_point, zero_point.is_finite(), "a finite number"),
            (
                "--bin-magnitudes",
                self.bin_magnitudes,
                (0.01..=10.0).contains(&self.bin_magnitudes),
                "0.01 to 10",
            ),
        ] {
            if !fits {
                return Err(InputError::new(Path::new(flag), "the value does not fit")
                    .found(value)
                    .expected(expected));
            }
        }
        Ok(CameraLight { zero_point_magnitude: self.zero_point_magnitude, spot_sigma_px })
    }
}
