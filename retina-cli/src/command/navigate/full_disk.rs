//! `retina navigate full-disk`.

use std::path::{Path, PathBuf};

use retina_experiments::experiment::Watcher as _;
use retina_experiments::full_disk::{
    FilterOptions, FullDiskScenario, ImageKind, Source, SourceChoice, figure_15, navigate, report, run_part,
    run_scenario,
};
use retina_files::InputError;
use retina_navigation::limb::LimbOptions;
use retina_sky::ephemeris::Ephemeris;

use super::frames_folder::FramesFolder;
use super::steps::{Steps, write};
use crate::failure::Failure;
use crate::output::tell;

#[derive(Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// Screen images, as displayed.
    Screen,
    /// Camera images of the screen.
    Camera,
}

/// Twice the height at which an atmosphere of the Earth's kind shows a limb, m.
const HIGHEST_LIMB_M: f64 = 2e5;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    folder: FramesFolder,
    /// Kind of images [default: camera with --images, otherwise screen].
    #[arg(long, value_enum)]
    kind: Option<Kind>,
    /// Mean height of the visible limb above the reference surface, m.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    limb_height_m: f64,
    /// Standard deviation of that height, m.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = not_negative)]
    limb_height_sigma_m: f64,
    /// Mesh of the body (.glb, .gltf, .obj, .icq, .bds): its silhouette is fitted, terrain included.
    ///
    /// Without it, the outline of the reference ellipsoid is fitted.
    #[arg(long, value_name = "MESH")]
    silhouette: Option<PathBuf>,
    /// Standard deviation of the known attitude per axis, arcsec.
    ///
    /// [default: the setup's jitter for camera images, 0 for screen images]
    #[arg(long, allow_negative_numbers = true, value_parser = not_negative)]
    pointing_sigma_arcsec: Option<f64>,
    /// SPICE kernel for the filter's Sun, Earth and Moon [default: analytical theories].
    ///
    /// SPK, text and binary PCK, frame, leap-second or meta-kernel. Repeat the flag for more kernels. If
    /// several contain the same body, the last one named is used.
    #[arg(long, value_name = "KERNEL")]
    ephemeris: Vec<PathBuf>,
}

/// A standard deviation.
fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("a standard deviation is a finite number, 0 or more".to_owned()),
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let folder = &arguments.folder;
    if folder.is_scenario()? {
        return scenario(arguments);
    }
    let ephemeris = Ephemeris::read(&arguments.ephemeris)?;
    let source = Source::open(arguments.choice()?)?;
    let list = folder.frames_list()?;
    for note in &source.notes {
        tell!("{note}");
    }
    let mut steps = Steps::new();
    let label = folder.label();
    steps.step("navigating");
    let plain = FilterOptions::default();
    let options = if arguments.silhouette.is_some() { plain.for_silhouette() } else { plain };
    let sequence = navigate(&source, &label, list.as_deref(), Some(&options), &ephemeris, &mut steps)?;
    steps.finish();
    let document = report::document(&source, &sequence);
    folder.write_results("full-disk", &[("json", &format!("{document:#}\n"))])?;
    let sequences = [sequence];
    report::warnings(&sequences).iter().for_each(|warning| tell!("{warning}"));
    if let Some(path) = &folder.report {
        report::page(&format!("Full-disk navigation: {label}"), &sequences, &source.notes).write(path)?;
    }
    folder.print(&document, &report::lines(&sequences))
}

fn scenario(arguments: &Arguments) -> Result<(), Failure> {
    let folder = &arguments.folder;
    let out = folder.scenario_out(&[
        ("--kind", arguments.kind.is_some()),
        ("--pointing-sigma-arcsec", arguments.pointing_sigma_arcsec.is_some()),
        ("--ephemeris", !arguments.ephemeris.is_empty()),
        ("--silhouette", arguments.silhouette.is_some()),
        ("--limb-height-m", arguments.limb_height_m != 0.0),
        ("--limb-height-sigma-m", arguments.limb_height_sigma_m != 0.0),
    ])?;
    let scenario = FullDiskScenario::read(&folder.input)?;
    let mut steps = Steps::new();
    if let Some(part) = folder.shard {
        let frames = run_part(&scenario, out, folder.backend.into(), part, &mut steps);
        steps.finish();
        return folder.print_part(out, part, frames?);
    }
    let result = run_scenario(&scenario, out, folder.backend.into(), &mut steps);
    steps.finish();
    let sequences = result?;
    report::warnings(&sequences).iter().for_each(|warning| tell!("{warning}"));
    let shown: Vec<_> = sequences.iter().map(report::Sequence::shown).collect();
    write(out, "figure-15.svg", &figure_15(&shown, true))?;
    let document = report::scenario_document(&sequences);
    write(out, "full-disk.json", &format!("{document:#}\n"))?;
    let page = folder.report.clone().unwrap_or_else(|| out.join("full-disk.html"));
    report::page("LUMIO full-disk navigation", &sequences, &[]).write(&page)?;
    folder.print(&document, &report::lines(&sequences))
}

impl Arguments {
    fn choice(&self) -> Result<SourceChoice, Failure> {
        let pointing_arcsec = self.pointing_sigma_arcsec.unwrap_or(0.0);
        for (flag, value, least, most) in [
            ("--limb-height-m", self.limb_height_m, -HIGHEST_LIMB_M, HIGHEST_LIMB_M),
            ("--limb-height-sigma-m", self.limb_height_sigma_m, 0.0, HIGHEST_LIMB_M),
            ("--pointing-sigma-arcsec", pointing_arcsec, 0.0, 3600.0),
        ] {
            if !(least..=most).contains(&value) {
                return Err(InputError::new(Path::new(flag), "the value does not fit")
                    .found(value)
                    .expected(format!("{least} to {most}"))
                    .into());
            }
        }
        let kind = self.kind.map(|kind| match kind {
            Kind::Screen => ImageKind::Screen,
            Kind::Camera => ImageKind::Camera,
        });
        let camera = kind.map_or(self.folder.images.is_some(), |kind| kind == ImageKind::Camera);
        let jitter_arcsec = match (&self.folder.setup, camera) {
            (Some(setup), true) => crate::setup::read_setup(setup)?.noise.jitter_arcsec,
            _ => 0.0,
        };
        let limb = LimbOptions {
            limb_height_m: self.limb_height_m,
            limb_height_sigma_m: self.limb_height_sigma_m,
            ..LimbOptions::default()
        };
        let pointing_arcsec = self.pointing_sigma_arcsec.unwrap_or(jitter_arcsec);
        let choice = self.folder.choice(kind, limb, (pointing_arcsec / 3600.0).to_radians());
        Ok(SourceChoice { silhouette: self.silhouette.clone(), ..choice })
    }
}
