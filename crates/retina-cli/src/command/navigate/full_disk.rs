//! `retina navigate full-disk`.

use std::path::{Path, PathBuf};

use retina_batch::{FrameRange, Selection, Shard};
use retina_files::InputError;
use retina_navigation::experiment::Watcher as _;
use retina_navigation::full_disk::{
    FilterOptions, FullDiskScenario, ImageKind, Source, SourceChoice, figure_15, navigate, report,
    run_scenario,
};
use retina_navigation::limb::LimbOptions;
use retina_sky::ephemeris::Ephemeris;
use serde_json::Value;

use super::steps::{Steps, results_folder, results_name, write};
use crate::command::Backend;
use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};

#[derive(Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// What the screen shows.
    Screen,
    /// What the camera saw of it.
    Camera,
}

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A folder that `retina render` wrote, or a scenario, schema retina.full-disk/1: the whole experiment.
    #[arg(value_name = "DIR|SCENARIO.toml")]
    input: PathBuf,
    /// Camera images of the folder's screens, as `retina simulate frames` writes them.
    #[arg(long, value_name = "FOLDER")]
    images: Option<PathBuf>,
    /// What the images are [default: the camera's with --images, otherwise the screen's].
    #[arg(long, value_enum)]
    kind: Option<Kind>,
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
    /// Mean height of the seen limb above the reference surface, m.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    limb_height_m: f64,
    /// Its standard deviation, m.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = not_negative)]
    limb_height_sigma_m: f64,
    /// Standard deviation per axis of the known attitude, arcsec [default: the setup's jitter for camera images, 0 for
    /// the screen's].
    #[arg(long, allow_negative_numbers = true, value_parser = not_negative)]
    pointing_sigma_arcsec: Option<f64>,
    /// SPK kernel that says where the filter takes Sun, Earth and Moon to be; may be repeated, of those that have a body
    /// the last counts [default: analytical theories].
    #[arg(long, value_name = "FILE.bsp")]
    ephemeris: Vec<PathBuf>,
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

/// A standard deviation.
fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("a standard deviation is a finite number, 0 or more".to_owned()),
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.report.as_ref().map_or(Ok(()), |path| crate::check_file(path, "html"))?;
    if arguments.input.extension().is_some_and(|extension| extension == "toml") {
        return scenario(arguments);
    }
    let ephemeris = Ephemeris::read(&arguments.ephemeris)?;
    let source = Source::open(arguments.choice()?)?;
    let list = match &arguments.out {
        None => None,
        Some(out) => {
            results_folder(out, &arguments.input)?;
            Some(out.join("frames.jsonl"))
        }
    };
    for note in &source.notes {
        tell!("{note}");
    }
    let mut steps = Steps::new();
    let label = arguments.input.file_name().map_or("images".into(), |name| name.to_string_lossy());
    steps.step("navigating");
    let options = FilterOptions::default();
    let sequence = navigate(&source, &label, list.as_deref(), Some(&options), &ephemeris, &mut steps)?;
    steps.finish();
    let document = report::document(&source, &sequence);
    if let Some(out) = &arguments.out {
        let name = results_name("full-disk", arguments.frames, arguments.shard);
        write(out, &format!("{name}.json"), &format!("{document:#}\n"))?;
    }
    let sequences = [sequence];
    report::warnings(&sequences).iter().for_each(|warning| tell!("{warning}"));
    if let Some(path) = &arguments.report {
        report::page(&format!("Full-disk navigation: {label}"), &sequences, &source.notes).write(path)?;
    }
    print(arguments, &document, &sequences)
}

fn scenario(arguments: &Arguments) -> Result<(), Failure> {
    let named = [
        ("--images", arguments.images.is_some()),
        ("--kind", arguments.kind.is_some()),
        ("--setup", arguments.setup.is_some()),
        ("--calibration", arguments.calibration.is_some()),
        ("--body", arguments.body.is_some()),
        ("--frames", arguments.frames.is_some()),
        ("--shard", arguments.shard.is_some()),
        ("--pointing-sigma-arcsec", arguments.pointing_sigma_arcsec.is_some()),
        ("--ephemeris", !arguments.ephemeris.is_empty()),
        ("--limb-height-m", arguments.limb_height_m != 0.0),
        ("--limb-height-sigma-m", arguments.limb_height_sigma_m != 0.0),
    ];
    if let Some((flag, _)) = named.iter().find(|(_, given)| *given) {
        return Err(InputError::new(Path::new(flag), "belongs to a folder of frames")
            .found(arguments.input.display())
            .help("write it into the scenario or its scene")
            .into());
    }
    let scenario = FullDiskScenario::read(&arguments.input)?;
    let Some(out) = &arguments.out else {
        return Err(Failure::new("a scenario needs --out: the folder for its frames and results"));
    };
    let mut steps = Steps::new();
    let result = run_scenario(&scenario, out, arguments.backend.into(), &mut steps);
    steps.finish();
    let sequences = result?;
    report::warnings(&sequences).iter().for_each(|warning| tell!("{warning}"));
    let shown: Vec<_> = sequences.iter().map(report::Sequence::shown).collect();
    write(out, "figure-15.svg", &figure_15(&shown, true))?;
    let document = report::scenario_document(&sequences);
    write(out, "full-disk.json", &format!("{document:#}\n"))?;
    let page = arguments.report.clone().unwrap_or_else(|| out.join("full-disk.html"));
    report::page("LUMIO full-disk navigation", &sequences, &[]).write(&page)?;
    print(arguments, &document, &sequences)
}

fn print(arguments: &Arguments, document: &Value, sequences: &[report::Sequence]) -> Result<(), Failure> {
    if arguments.json { print_json(document) } else { print_lines(&report::lines(sequences)) }
}

impl Arguments {
    fn choice(&self) -> Result<SourceChoice, Failure> {
        let pointing_arcsec = self.pointing_sigma_arcsec.unwrap_or(0.0);
        for (flag, value, fits) in [
            ("--limb-height-m", self.limb_height_m, self.limb_height_m.is_finite()),
            (
                "--limb-height-sigma-m",
                self.limb_height_sigma_m,
                (0.0..1e9).contains(&self.limb_height_sigma_m),
            ),
            ("--pointing-sigma-arcsec", pointing_arcsec, (0.0..3600.0).contains(&pointing_arcsec)),
        ] {
            if !fits {
                return Err(InputError::new(Path::new(flag), "the value does not fit")
                    .found(value)
                    .expected("a finite number, 0 or more where it is a standard deviation")
                    .into());
            }
        }
        let kind = self.kind.map(|kind| match kind {
            Kind::Screen => ImageKind::Screen,
            Kind::Camera => ImageKind::Camera,
        });
        let camera = kind.map_or(self.images.is_some(), |kind| kind == ImageKind::Camera);
        let jitter_arcsec = match (&self.setup, camera) {
            (Some(setup), true) => retina_geometry::Setup::read(setup)?.noise.jitter_arcsec,
            _ => 0.0,
        };
        Ok(SourceChoice {
            dir: self.input.clone(),
            images: self.images.clone(),
            kind,
            setup: self.setup.clone(),
            calibration: self.calibration.clone(),
            body: self.body.clone(),
            selection: Selection { range: self.frames, every: None, shard: self.shard },
            limb: LimbOptions {
                limb_height_m: self.limb_height_m,
                limb_height_sigma_m: self.limb_height_sigma_m,
                ..LimbOptions::default()
            },
            pointing_sigma_rad: (self.pointing_sigma_arcsec.unwrap_or(jitter_arcsec) / 3600.0).to_radians(),
        })
    }
}
