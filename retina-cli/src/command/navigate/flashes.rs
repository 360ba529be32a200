//! `retina navigate flashes`.

use std::path::Path;

use retina_experiments::experiment::Watcher as _;
use retina_experiments::flashes::{
    CameraLight, FlashScenario, figure_rates, flash_notes, report, run_part, run_scenario, summarise,
    watch_sequence,
};
use retina_experiments::full_disk::{ImageKind, Source};
use retina_files::InputError;
use retina_navigation::flashes::{FlashOptions, ZeroPoint};
use retina_navigation::limb::LimbOptions;

use super::frames_folder::FramesFolder;
use super::steps::{Steps, write};
use crate::failure::Failure;
use crate::output::tell;

/// Width of a spot that is not given, px.
const SPOT_SIGMA_PX: f64 = 1.0;
/// Width of bins that is not given.
const BIN_MAGNITUDES: f64 = 0.5;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    folder: FramesFolder,
    /// Magnitude of a source that gives 1 DN in the camera images, at their exposure time.
    ///
    /// Without it, magnitudes are not measured in camera images.
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    zero_point_magnitude: Option<f64>,
    /// Magnitude added to the zero point in the corners of the image.
    ///
    /// Between the middle and the corners it grows with the square of the distance from the middle.
    /// It corrects for the light lost by spots whose width differs from --spot-sigma-px.
    #[arg(long, value_name = "MAG", allow_negative_numbers = true, requires = "zero_point_magnitude")]
    zero_point_corner_magnitude: Option<f64>,
    /// Magnitude added to the zero point between the middle and the corners, times d (1 - d).
    ///
    /// d is the square of the distance from the middle, 1 in the corners.
    #[arg(long, value_name = "MAG", allow_negative_numbers = true, requires = "zero_point_magnitude")]
    zero_point_bend_magnitude: Option<f64>,
    /// Standard deviation of the zero point. It is part of the magnitudes' standard deviations.
    #[arg(long, value_name = "MAG", requires = "zero_point_magnitude")]
    zero_point_sigma_magnitude: Option<f64>,
    /// Standard deviation of a point's spot in the camera images, px [default: 1].
    ///
    /// The detector forms sums matched to this spot.
    #[arg(long, value_name = "PX")]
    spot_sigma_px: Option<f64>,
    /// Expected number of false detections per frame from normal noise. It sets the threshold.
    #[arg(long, value_name = "N", default_value_t = FlashOptions::default().false_alarms_per_frame)]
    false_alarms_per_frame: f64,
    /// Margin to the limb, px. No flash is searched for within it.
    #[arg(long, value_name = "PX", default_value_t = FlashOptions::default().limb_margin_px)]
    limb_margin_px: f64,
    /// Margin to terrain that may be sunlit, px. No flash is searched for within it.
    #[arg(long, value_name = "PX", default_value_t = FlashOptions::default().terminator_margin_px)]
    terminator_margin_px: f64,
    /// Highest relief above its surroundings, divided by the body's radius.
    ///
    /// Such summits beyond the terminator may be sunlit.
    #[arg(long, value_name = "SHARE", default_value_t = FlashOptions::default().relief)]
    relief: f64,
    /// Width of the magnitude bins of the detection rates.
    #[arg(long, value_name = "MAG", default_value_t = BIN_MAGNITUDES)]
    bin_magnitudes: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let folder = &arguments.folder;
    if folder.is_scenario()? {
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
    let kind = if folder.images.is_some() { ImageKind::Camera } else { ImageKind::Screen };
    if let (ImageKind::Screen, Some(flag)) = (kind, arguments.camera_flag()) {
        return Err(InputError::new(Path::new(flag), "belongs to camera images")
            .help("the setup gives the light of screen images; give photographs with --images")
            .into());
    }
    let source = Source::open(folder.choice(Some(kind), LimbOptions::default(), 0.0))?;
    let mut notes = flash_notes(&source)?;
    if kind == ImageKind::Camera && arguments.spot_sigma_px.is_none() {
        notes.push(format!(
            "no --spot-sigma-px: assuming spots with a standard deviation of {SPOT_SIGMA_PX} px"
        ));
    }
    if kind == ImageKind::Camera && arguments.zero_point_magnitude.is_none() {
        notes.push(
            "no --zero-point-magnitude: the camera's zero point is unknown, so magnitudes are not measured"
                .to_owned(),
        );
    }
    notes.iter().for_each(|note| tell!("{note}"));
    let list = folder.frames_list()?;
    let mut steps = Steps::new();
    steps.step("searching for flashes");
    let all = source.frames.len();
    let frames =
        watch_sequence(&source, &light, &options, list.as_deref(), &mut |done| steps.done(done, all));
    steps.finish();
    let frames = frames?;
    let label = folder.label();
    let watched = report::Watched {
        label: label.clone(),
        light: (kind == ImageKind::Camera).then_some(light),
        summary: summarise(&frames, arguments.bin_magnitudes, options.false_alarms_per_frame),
        frames,
    };
    for note in watched.nothing_to_see() {
        tell!("{note}");
        notes.push(note);
    }
    let document = report::document(&watched, &options, &notes);
    let sequences = [watched];
    let (json, rates) = (format!("{document:#}\n"), figure_rates(&sequences));
    folder.write_results("flashes", &[("json", &json), ("svg", &rates)])?;
    if let Some(path) = &folder.report {
        report::page(&format!("Flashes: {label}"), &sequences, &notes).write(path)?;
    }
    folder.print(&document, &report::lines(&sequences))
}

fn scenario(arguments: &Arguments) -> Result<(), Failure> {
    let (folder, options) = (&arguments.folder, FlashOptions::default());
    let out = folder.scenario_out(&[
        ("--zero-point-magnitude", arguments.zero_point_magnitude.is_some()),
        ("--zero-point-corner-magnitude", arguments.zero_point_corner_magnitude.is_some()),
        ("--zero-point-bend-magnitude", arguments.zero_point_bend_magnitude.is_some()),
        ("--zero-point-sigma-magnitude", arguments.zero_point_sigma_magnitude.is_some()),
        ("--spot-sigma-px", arguments.spot_sigma_px.is_some()),
        ("--false-alarms-per-frame", arguments.false_alarms_per_frame != options.false_alarms_per_frame),
        ("--limb-margin-px", arguments.limb_margin_px != options.limb_margin_px),
        ("--terminator-margin-px", arguments.terminator_margin_px != options.terminator_margin_px),
        ("--relief", arguments.relief != options.relief),
        ("--bin-magnitudes", arguments.bin_magnitudes != BIN_MAGNITUDES),
    ])?;
    let scenario = FlashScenario::read(&folder.input)?;
    let mut steps = Steps::new();
    if let Some(part) = folder.shard {
        let frames = run_part(&scenario, out, folder.backend.into(), part, &mut steps);
        steps.finish();
        return folder.print_part(out, part, frames?);
    }
    let result = run_scenario(&scenario, out, folder.backend.into(), &mut steps);
    steps.finish();
    let sequences = result?;
    let notes = report::scenario_notes(&sequences);
    notes.iter().for_each(|note| tell!("{note}"));
    write(out, "flashes.svg", &figure_rates(&sequences))?;
    let document = report::scenario_document(&sequences, &scenario.detector, &notes);
    write(out, "flashes.json", &format!("{document:#}\n"))?;
    let page = folder.report.clone().unwrap_or_else(|| out.join("flashes.html"));
    report::page("Impact flashes", &sequences, &notes).write(&page)?;
    folder.print(&document, &report::lines(&sequences))
}

impl Arguments {
    /// What is given of a camera's light.
    fn camera_flag(&self) -> Option<&'static str> {
        let given = [
            ("--zero-point-magnitude", self.zero_point_magnitude.is_some()),
            ("--spot-sigma-px", self.spot_sigma_px.is_some()),
        ];
        given.iter().find(|(_, given)| *given).map(|(flag, _)| *flag)
    }

    fn light(&self) -> Result<CameraLight, InputError> {
        let spot_sigma_px = self.spot_sigma_px.unwrap_or(SPOT_SIGMA_PX);
        let zero_point = self.zero_point_magnitude.unwrap_or(0.0);
        let corner_magnitude = self.zero_point_corner_magnitude.unwrap_or(0.0);
        let bend_magnitude = self.zero_point_bend_magnitude.unwrap_or(0.0);
        let sigma_magnitude = self.zero_point_sigma_magnitude.unwrap_or(0.0);
        for (flag, value, fits, expected) in [
            ("--spot-sigma-px", spot_sigma_px, (0.3..=10.0).contains(&spot_sigma_px), "0.3 to 10"),
            ("--zero-point-magnitude", zero_point, zero_point.is_finite(), "a finite number"),
            (
                "--zero-point-sigma-magnitude",
                sigma_magnitude,
                (0.0..=10.0).contains(&sigma_magnitude),
                "0 to 10",
            ),
            (
                "--zero-point-corner-magnitude",
                corner_magnitude,
                corner_magnitude.is_finite(),
                "a finite number",
            ),
            ("--zero-point-bend-magnitude", bend_magnitude, bend_magnitude.is_finite(), "a finite number"),
            (
                "--bin-magnitudes",
                self.bin_magnitudes,
                (0.01..=10.0).contains(&self.bin_magnitudes),
                "0.01 to 10",
            ),
        ] {
            if !fits {
                return Err(InputError::new(Path::new(flag), "the value is out of range")
                    .found(value)
                    .expected(expected));
            }
        }
        let zero_point = self.zero_point_magnitude.map(|magnitude| ZeroPoint {
            magnitude,
            corner_magnitude,
            bend_magnitude,
            sigma_magnitude,
        });
        Ok(CameraLight { zero_point, spot_sigma_px })
    }
}
