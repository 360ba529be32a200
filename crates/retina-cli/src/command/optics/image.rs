//! Diffraction: `wavefront`, `psf`, `mtf`.

use std::path::PathBuf;

use retina_optics::analysis;
use retina_optics::plot;
use serde_json::json;

use super::{Output, Reading, failed};
use crate::failure::Failure;

#[derive(clap::Args)]
pub(crate) struct WavefrontArguments {
    /// A prescription (.toml, .zmx) or the name of a design that ships.
    system: PathBuf,
    /// Wavelength, nm; the primary one if not given.
    #[arg(long, value_name = "NM")]
    wavelength_nm: Option<f64>,
    /// Pupil points a side.
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

#[derive(clap::Args)]
pub(crate) struct PsfArguments {
    /// A prescription (.toml, .zmx) or the name of a design that ships.
    system: PathBuf,
    /// Pupil points a side.
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u16).range(8..=1024))]
    pupil: u16,
    /// Pixels a side of the PSF.
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u16).range(8..=1024))]
    pixels: u16,
    /// Pixel pitch, um.
    #[arg(long, default_value_t = 0.5)]
    pitch_um: f64,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    output: Output,
}

pub(super) fn psf(arguments: &PsfArguments) -> Result<(), Failure> {
    arguments.output.check()?;
    if !(arguments.pitch_um > 0.0 && arguments.pitch_um.is_finite()) {
        return Err(Failure::new(format!("--pitch-um must be positive (found {})", arguments.pitch_um)));
    }
    let system = arguments.reading.system(&arguments.system)?;
    let clipping = arguments.reading.clipping();
    let (pupil, pixels) = (arguments.pupil.into(), arguments.pixels.into());
    let psfs = system
        .fields
        .iter()
        .map(|field| {
            analysis::psf_polychromatic(&system, field.at, pupil, pixels, arguments.pitch_um, clipping)
        })
        .collect::<Result<Vec<_>, _>>()
        .map_err(failed)?;
    let energy: Vec<_> = psfs.iter().map(|psf| analysis::encircled_energy(psf, 64)).collect();
    arguments.output.draw(|| Ok(plot::psf_figure(&system, &psfs)))?;
    let document = json!({ "system": system.name, "fields": psfs, "encircled_energy": energy });
    arguments.output.print("psf", &document, || {
        psfs.iter()
            .zip(&energy)
            .map(|(psf, energy)| {
                let radius = energy.radius_um.iter().zip(&energy.fraction).find(|(_, share)| **share >= 0.8);
                let radius = radius.map_or("beyond the grid".to_owned(), |(radius, _)| format!("{radius:.2} um"));
                format!(
                    "field {:9.6}, {:9.6}: peak {:.4} of the diffraction limit, {:.1} % of the energy on the grid, 80 % \
                     within {radius}",
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
    /// A prescription (.toml, .zmx) or the name of a design that ships.
    system: PathBuf,
    /// Pupil points a side.
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

pub(super) fn mtf(arguments: &MtfArguments) -> Result<(), Failure> {
    arguments.output.check()?;
    if !(arguments.highest_per_mm > 0.0 && arguments.highest_per_mm.is_finite()) {
        return Err(Failure::new(format!(
            "--highest-per-mm must be positive (found {})",
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
        let half = |values: &[f64], at: &[f64]| {
            values.iter().position(|&v| v < 0.5).map_or("never".to_owned(), |i| format!("{:.1} /mm", at[i]))
        };
        curves
            .iter()
            .map(|mtf| {
                format!(
                    "field {:9.6}, {:9.6}: contrast below 0.5 from {} (y), {} (x)",
                    mtf.field[0],
                    mtf.field[1],
                    half(&mtf.y, &mtf.frequency_per_mm),
                    half(&mtf.x, &mtf.frequency_per_mm)
                )
            })
            .collect()
    })
}
