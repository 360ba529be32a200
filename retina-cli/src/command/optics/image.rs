//! Diffraction: `wavefront`, `psf`, `mtf`.

use std::path::PathBuf;

use retina_optics::analysis::{self, PsfGridChoice};
use retina_optics::plot;
use serde_json::json;

use super::{Drawing, Output, Reading, failed};

use crate::failure::Failure;
use crate::output::tell;

#[derive(clap::Args)]
pub(crate) struct WavefrontArguments {
    /// Prescription (.toml, .zmx) or name of a shipped design.
    system: PathBuf,
    /// Wavelength, nm [default: the primary one].
    #[arg(long, value_name = "NM")]
    wavelength_nm: Option<f64>,
    /// Number of pupil points per side.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u16).range(4..=512))]
    pupil: u16,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    output: Output,
}

pub(super) fn wavefront(arguments: &WavefrontArguments) -> Result<(), Failure> {
    arguments.output.check()?;
    let system = arguments.reading.system(&arguments.system)?;
    let nm = arguments.wavelength_nm.unwrap_or(system.primary_nm());
    let clipping = arguments.reading.clipping();
    let maps = system
        .fields
        .iter()
        .map(|field| analysis::wavefront(&system, field.at, nm, arguments.pupil.into(), clipping))
        .collect::<Result<Vec<_>, _>>()
        .map_err(failed)?;
    arguments.output.draw(|| Ok(plot::wavefront_figure(&system, &maps)))?;
    arguments.output.print("wavefront", &json!({ "system": system.name, "fields": maps }), || {
        maps.iter()
            .map(|map| {
                format!(
                    "field {:9.6}, {:9.6}, {nm:.1} nm: {:9.4} waves RMS, {:9.4} peak to valley",
                    map.field[0], map.field[1], map.rms_waves, map.peak_to_valley_waves
                )
            })
            .collect()
    })
}

/// Share of the light below which a grid is warned of.
const ENOUGH_LIGHT: f64 = 0.99;

#[derive(clap::Args)]
pub(crate) struct PsfArguments {
    /// Prescription (.toml, .zmx) or name of a shipped design.
    system: PathBuf,
    /// Number of pupil points per side [default: enough to keep the repetitions of the PSF apart].
    #[arg(long, value_parser = clap::value_parser!(u16).range(8..=1024))]
    pupil: Option<u16>,
    /// Number of pixels per side of the PSF [default: with the pitch, enough for 99 % of the
    /// light].
    #[arg(long, value_parser = clap::value_parser!(u16).range(8..=1024))]
    pixels: Option<u16>,
    /// Pixel pitch, um [default: chosen with the number of pixels].
    #[arg(long, value_name = "UM", value_parser = super::positive, allow_negative_numbers = true)]
    pitch_um: Option<f64>,
    /// Draw the encircled energy into this SVG file.
    #[arg(long, value_name = "FILE")]
    energy_svg: Option<PathBuf>,
    /// Draw the encircled energy into this PNG file.
    #[arg(long, value_name = "FILE")]
    energy_png: Option<PathBuf>,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    output: Output,
}

pub(super) fn psf(arguments: &PsfArguments) -> Result<(), Failure> {
    arguments.output.check()?;
    let second = Drawing { svg: arguments.energy_svg.clone(), png: arguments.energy_png.clone() };
    second.check()?;
    let system = arguments.reading.system(&arguments.system)?;
    let clipping = arguments.reading.clipping();
    let choice = PsfGridChoice {
        pupil_side: arguments.pupil.map(usize::from),
        side: arguments.pixels.map(usize::from),
        pitch_um: arguments.pitch_um,
    };
    let grid = analysis::psf_grid(&system, choice, clipping).map_err(failed)?;
    let psfs = system
        .fields
        .iter()
        .map(|field| {
            analysis::psf_polychromatic(
                &system,
                field.at,
                grid.pupil_side,
                grid.side,
                grid.pitch_um,
                clipping,
            )
        })
        .collect::<Result<Vec<_>, _>>()
        .map_err(failed)?;
    let energy: Vec<_> = psfs.iter().map(|psf| analysis::encircled_energy(psf, 64)).collect();
    arguments.output.draw(|| Ok(plot::psf_figure(&system, &psfs)))?;
    second.draw(|| Ok(plot::encircled_energy_figure(&system, &energy)))?;
    let held = psfs.iter().map(|psf| psf.energy_on_grid).fold(1.0, f64::min);
    if held < ENOUGH_LIGHT {
        tell!(
            "warning: the grid of {} pixels of {:.4} um holds only {:.1} % of a field's light",
            grid.side,
            grid.pitch_um,
            100.0 * held
        );
    }
    let document = json!({ "system": system.name, "grid": grid, "fields": psfs, "encircled_energy": energy });
    arguments.output.print("psf", &document, || {
        psfs.iter()
            .zip(&energy)
            .map(|(psf, energy)| {
                let radius = first_reaching(&energy.radius_um, &energy.fraction, |share| share - 0.8)
                    .map_or("beyond the grid".to_owned(), |radius| format!("{radius:.2} um"));
                format!(
                    "field {:9.6}, {:9.6}: peak {:.4} of the diffraction limit, {:.1} % of the light on the grid, 80 % \
                     of it all within {radius}",
                    psf.field[0],
                    psf.field[1],
                    psf.peak(),
                    100.0 * psf.energy_on_grid
                )
            })
            .collect()
    })
}

#[derive(clap::Args)]
pub(crate) struct MtfArguments {
    /// Prescription (.toml, .zmx) or name of a shipped design.
    system: PathBuf,
    /// Number of pupil points per side.
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u16).range(8..=512))]
    pupil: u16,
    /// Highest spatial frequency, cycles/mm.
    #[arg(long, default_value_t = 100.0)]
    highest_per_mm: f64,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    output: Output,
}

/// The first place at which a sampled curve's `above` is no longer negative, on the straight line between samples.
fn first_reaching(at: &[f64], values: &[f64], above: impl Fn(f64) -> f64) -> Option<f64> {
    let i = values.iter().position(|&value| above(value) >= 0.0)?;
    let Some(before) = i.checked_sub(1) else { return Some(at[i]) };
    let (low, high) = (above(values[before]), above(values[i]));
    Some(at[before] + (at[i] - at[before]) * low / (low - high))
}

/// Beyond it light has no contrast in any lens, cycles/mm.
const MOST_PER_MM: f64 = 1e6;

pub(super) fn mtf(arguments: &MtfArguments) -> Result<(), Failure> {
    arguments.output.check()?;
    if !(arguments.highest_per_mm > 0.0 && arguments.highest_per_mm <= MOST_PER_MM) {
        return Err(Failure::new(format!(
            "--highest-per-mm must be above 0 and at most {MOST_PER_MM:e} (found {:e})",
            arguments.highest_per_mm
        )));
    }
    let system = arguments.reading.system(&arguments.system)?;
    let clipping = arguments.reading.clipping();
    let curves = system
        .fields
        .iter()
        .map(|field| {
            analysis::mtf(&system, field.at, arguments.pupil.into(), arguments.highest_per_mm, 100, clipping)
        })
        .collect::<Result<Vec<_>, _>>()
        .map_err(failed)?;
    arguments.output.draw(|| Ok(plot::mtf_figure(&system, &curves)))?;
    arguments.output.print("mtf", &json!({ "system": system.name, "fields": curves }), || {
        let half = |values: &[f64], at: &[f64]| match first_reaching(at, values, |contrast| 0.5 - contrast) {
            Some(at) => format!("below 0.5 from {at:.1} /mm"),
            None => format!("0.5 or more up to {:.1} /mm", arguments.highest_per_mm),
        };
        curves
            .iter()
            .map(|mtf| {
                format!(
                    "field {:9.6}, {:9.6}: contrast along y {}, along x {}",
                    mtf.field[0],
                    mtf.field[1],
                    half(&mtf.y, &mtf.frequency_per_mm),
                    half(&mtf.x, &mtf.frequency_per_mm)
                )
            })
            .collect()
    })
}
