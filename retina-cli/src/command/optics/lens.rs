//! The lens as a whole: `first-order`, `field`, `ghosts`, `tolerance`, `thermal`, `layout`.

use std::path::PathBuf;

use retina_optics::analysis::{self, SpotOptions, Tolerances};
use retina_optics::paraxial::{Paraxial, efl_of_mm};
use retina_optics::plot;
use serde_json::json;

use super::{Document, Drawing, Output, Reading, failed, or_dash};
use crate::failure::Failure;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Prescription (.toml, .zmx) or name of a shipped design.
    system: PathBuf,
    /// Wavelength, nm [default: the primary one].
    #[arg(long, value_name = "NM")]
    wavelength_nm: Option<f64>,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    document: Document,
}

pub(super) fn first_order(arguments: &Arguments) -> Result<(), Failure> {
    let system = arguments.reading.system(&arguments.system)?;
    let nm = arguments.wavelength_nm.unwrap_or(system.primary_nm());
    let first = Paraxial::new(&system, nm).map_err(failed)?.first_order();
    let seidel = analysis::seidel_sums(&system).map_err(failed)?;
    let groups = system
        .groups
        .iter()
        .map(|group| {
            Ok((group.name.clone(), efl_of_mm(&system, group.first, group.last, nm).map_err(failed)?))
        })
        .collect::<Result<Vec<_>, Failure>>()?;
    let listed: Vec<_> = groups.iter().map(|(name, efl)| json!({ "name": name, "efl_mm": efl })).collect();
    let result = json!({ "system": system.name, "first_order": first, "groups": listed, "seidel": seidel });
    arguments.document.print("first-order", &result, || {
        let mut lines = vec![
            format!("{}, {nm} nm (mm)", system.name),
            format!("  focal length        {}", or_dash(first.efl_mm)),
            format!("  back focal length   {}", or_dash(first.bfl_mm)),
            format!("  front focal length  {}", or_dash(first.ffl_mm)),
            format!(
                "  principal planes    {} front, {} rear",
                or_dash(first.front_principal_mm),
                or_dash(first.rear_principal_mm)
            ),
            format!(
                "  entrance pupil      {:.4}, diameter {:.4}",
                first.entrance_pupil_mm, first.entrance_pupil_diameter_mm
            ),
            format!(
                "  exit pupil          {}, diameter {}",
                or_dash(first.exit_pupil_mm),
                or_dash(first.exit_pupil_diameter_mm)
            ),
            format!(
                "  paraxial image      {} (surface at {:.4})",
                or_dash(first.image_mm),
                first.image_surface_mm
            ),
            format!("  working f-number    {}", or_dash(first.working_f_number)),
            format!("  magnification       {}", or_dash(first.magnification)),
            format!("  track               {:.4}", first.track_mm),
        ];
        lines.splice(2..2, groups.iter().map(|(name, efl)| format!("    of {name:16} {}", or_dash(*efl))));
        let s = &seidel.sum;
        lines.push(
            "Seidel sums (um): spherical, coma, astigmatism, Petzval, distortion, axial and lateral colour"
                .into(),
        );
        let sums = [
            s.spherical_mm,
            s.coma_mm,
            s.astigmatism_mm,
            s.petzval_mm,
            s.distortion_mm,
            s.axial_colour_mm,
            s.lateral_colour_mm,
        ];
        lines.push(sums.map(|sum| format!("{:11.4}", 1e3 * sum)).concat());
        lines
    })
}

#[derive(clap::Args)]
pub(crate) struct FieldArguments {
    /// Prescription (.toml, .zmx) or name of a shipped design.
    system: PathBuf,
    /// Number of steps from the axis to the largest field.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u16).range(1..=1000))]
    steps: u16,
    /// Draw illumination and vignetting into this SVG file.
    #[arg(long, value_name = "FILE")]
    illumination_svg: Option<PathBuf>,
    /// Draw illumination and vignetting into this PNG file.
    #[arg(long, value_name = "FILE")]
    illumination_png: Option<PathBuf>,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    output: Output,
}

pub(super) fn field(arguments: &FieldArguments) -> Result<(), Failure> {
    arguments.output.check()?;
    let second = Drawing { svg: arguments.illumination_svg.clone(), png: arguments.illumination_png.clone() };
    second.check()?;
    let system = arguments.reading.system(&arguments.system)?;
    let curves = analysis::field_curves(&system, arguments.steps.into()).map_err(failed)?;
    let light = analysis::relative_illumination(&system, arguments.steps.into()).map_err(failed)?;
    arguments.output.draw(|| Ok(plot::field_curves_figure(&system, &curves)))?;
    second.draw(|| Ok(plot::illumination_figure(&system, &light)))?;
    let document = json!({ "system": system.name, "curves": curves, "illumination": light });
    arguments.output.print("field", &document, || {
        let p = curves.primary;
        let mut lines =
            vec!["field      tangential mm  sagittal mm  distortion %  transmitted  irradiance".to_owned()];
        lines.extend(curves.points.iter().zip(&light.points).map(|(point, light)| {
            format!(
                "{:9.6} {:14.4} {:12.4} {:13.4} {:12.4} {:11.4}",
                point.field,
                point.tangential_mm[p],
                point.sagittal_mm[p],
                100.0 * point.distortion,
                light.transmitted,
                light.relative
            )
        }));
        lines
    })
}

#[derive(clap::Args)]
pub(crate) struct GhostArguments {
    /// Prescription (.toml, .zmx) or name of a shipped design.
    system: PathBuf,
    /// Reflectance of surfaces between air and glass, for example 0.005 [default: uncoated].
    #[arg(long, value_name = "R")]
    coating: Option<f64>,
    /// Number of ghosts to list.
    #[arg(long, default_value_t = 20)]
    count: usize,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    output: Output,
}

pub(super) fn ghosts(arguments: &GhostArguments) -> Result<(), Failure> {
    if let Some(r) = arguments.coating
        && !(0.0..=1.0).contains(&r)
    {
        return Err(Failure::new(format!("--coating is a reflectance, 0 to 1 (found {r})")));
    }
    arguments.output.check()?;
    let system = arguments.reading.system(&arguments.system)?;
    let mut ghosts = analysis::ghosts(&system, arguments.coating).map_err(failed)?;
    ghosts.truncate(arguments.count);
    arguments.output.draw(|| Ok(plot::ghosts_figure(&system, &ghosts)))?;
    arguments.output.print("ghosts", &json!({ "system": system.name, "ghosts": ghosts }), || {
        let mut lines = vec![
            "surfaces  reflectance  arrives  focus mm  paraxial radius mm  RMS radius mm  irradiance 1/mm2"
                .into(),
        ];
        lines.extend(ghosts.iter().map(|ghost| {
            format!(
                "{:3} {:3} {:13.3e} {:8.3} {:>9} {:19.4} {:>14} {:>17}",
                ghost.first,
                ghost.second,
                ghost.reflectance,
                ghost.transmitted,
                ghost.focus_mm.map_or("-".into(), |mm| format!("{mm:.2}")),
                ghost.paraxial_radius_mm,
                or_dash(ghost.rms_radius_mm),
                ghost.irradiance_per_mm2.map_or("-".into(), |e| format!("{e:.3e}")),
            )
        }));
        lines
    })
}

#[derive(clap::Args)]
pub(crate) struct ToleranceArguments {
    /// Prescription (.toml, .zmx) or name of a shipped design.
    system: PathBuf,
    /// Tilt of each lens about x and y, arcmin; at most 600.
    #[arg(long, default_value_t = 3.0, value_parser = super::up_to(600.0), allow_negative_numbers = true)]
    tilt_arcmin: f64,
    /// Decentre of each lens along x and y, um; at most 1e5.
    #[arg(long, default_value_t = 50.0, value_parser = super::up_to(1e5), allow_negative_numbers = true)]
    decentre_um: f64,
    /// Error of each air gap, um; at most 1e5.
    #[arg(long, default_value_t = 100.0, value_parser = super::up_to(1e5), allow_negative_numbers = true)]
    gap_um: f64,
    /// Error of each glass's index; at most 0.5.
    #[arg(long, default_value_t = 5e-4, value_parser = super::up_to(0.5), allow_negative_numbers = true)]
    index: f64,
    /// Keep the image plane fixed instead of refocusing.
    #[arg(long)]
    no_refocus: bool,
    /// Number of trials.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    trials: u32,
    /// Seed of the trials.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    output: Output,
}

pub(super) fn tolerance(arguments: &ToleranceArguments) -> Result<(), Failure> {
    arguments.output.check()?;
    let system = arguments.reading.system(&arguments.system)?;
    let tolerances = Tolerances {
        tilt_rad: (arguments.tilt_arcmin / 60.0).to_radians(),
        decentre_mm: arguments.decentre_um * 1e-3,
        gap_mm: arguments.gap_um * 1e-3,
        index: arguments.index,
        refocus: !arguments.no_refocus,
    };
    let report = analysis::tolerance_monte_carlo(
        &system,
        &tolerances,
        arguments.trials as usize,
        arguments.seed,
        arguments.reading.clipping(),
    )
    .map_err(failed)?;
    arguments.output.draw(|| Ok(plot::tolerance_figure(&system, &report)))?;
    arguments.output.print("tolerance", &report, || {
        let nominal = report.nominal.rms_um.iter().copied().fold(0.0, f64::max);
        let (spot, shift) = (&report.worst_rms_um, &report.boresight_mm);
        vec![
            format!(
                "{}: {} trials, seed {}; {} failed{}",
                system.name,
                arguments.trials,
                report.seed,
                report.failed,
                if report.failed > 0 {
                    ": a beam did not arrive; the percentiles are those of the other trials"
                } else {
                    ""
                }
            ),
            format!(
                "worst RMS, um: nominal {nominal:.2}; 50 % {:.2}, 80 % {:.2}, 90 % {:.2}, 98 % {:.2}",
                spot.p50, spot.p80, spot.p90, spot.p98
            ),
            format!(
                "boresight on the image, mm: 50 % {:.4}, 80 % {:.4}, 90 % {:.4}, 98 % {:.4}",
                shift.p50, shift.p80, shift.p90, shift.p98
            ),
        ]
    })
}

/// Optical glass softens before this temperature, degC.
const HOTTEST_C: f64 = 1000.0;
/// Ten times what plastics have, 1e-6/K.
const LARGEST_EXPANSION_1E6_PER_K: f64 = 1000.0;

#[derive(clap::Args)]
pub(crate) struct ThermalArguments {
    /// Prescription (.toml, .zmx) or name of a shipped design.
    system: PathBuf,
    /// Temperatures, degC, separated by commas.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, default_value = "10,15,20,25,30")]
    temperatures_c: Vec<f64>,
    /// Linear expansion of the mount, 1e-6/K; the default is aluminium.
    #[arg(long, default_value_t = 23.6)]
    mount_1e6_per_k: f64,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    output: Output,
}

pub(super) fn thermal(arguments: &ThermalArguments) -> Result<(), Failure> {
    arguments.output.check()?;
    if let Some(bad) = arguments.temperatures_c.iter().find(|t| !(**t > -273.15 && **t <= HOTTEST_C)) {
        return Err(Failure::new(format!(
            "--temperatures-c must be above absolute zero and at most {HOTTEST_C} (found {bad})"
        )));
    }
    let expansion = arguments.mount_1e6_per_k;
    if expansion.is_nan() || expansion.abs() > LARGEST_EXPANSION_1E6_PER_K {
        return Err(Failure::new(format!(
            "--mount-1e6-per-k must lie within {LARGEST_EXPANSION_1E6_PER_K} of 0 (found {expansion})"
        )));
    }
    let system = arguments.reading.system(&arguments.system)?;
    let options = SpotOptions { clipping: arguments.reading.clipping(), ..SpotOptions::default() };
    let points = analysis::thermal_sweep(
        &system,
        &arguments.temperatures_c,
        arguments.mount_1e6_per_k * 1e-6,
        &options,
    )
    .map_err(failed)?;
    arguments.output.draw(|| Ok(plot::thermal_figure(&system, &points)))?;
    arguments.output.print("thermal", &json!({ "system": system.name, "points": points }), || {
        points
            .iter()
            .map(|point| {
                let spots: Vec<String> = point.rms_um.iter().map(|rms| format!("{rms:.2}")).collect();
                format!(
                    "{:6.1} degC: focal length {} mm, defocus {} mm, RMS {} um",
                    point.temperature_c,
                    or_dash(point.efl_mm),
                    or_dash(point.defocus_mm),
                    spots.join(", ")
                )
            })
            .collect()
    })
}

#[derive(clap::Args)]
pub(crate) struct LayoutArguments {
    /// Prescriptions (.toml, .zmx) or names of shipped designs, drawn below one another.
    #[arg(required = true)]
    systems: Vec<PathBuf>,
    #[command(flatten)]
    drawing: Drawing,
    #[command(flatten)]
    reading: Reading,
}

pub(super) fn layout(arguments: &LayoutArguments) -> Result<(), Failure> {
    if !arguments.drawing.is_wanted() {
        return Err(Failure::new("a layout needs an output file: --svg FILE, --png FILE or both"));
    }
    arguments.drawing.check()?;
    let systems = arguments
        .systems
        .iter()
        .map(|source| arguments.reading.system(source))
        .collect::<Result<Vec<_>, Failure>>()?;
    arguments.drawing.draw(|| plot::layout_figure("Layout", &systems.iter().collect::<Vec<_>>()))
}
