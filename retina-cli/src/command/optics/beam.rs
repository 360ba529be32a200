//! Rays: `trace`, `spots`, `fans`.

use std::path::PathBuf;

use retina_optics::analysis::{self, SpotOptions};
use retina_optics::plot::{self, SpotRow};
use retina_optics::{Launcher, Tracer};
use serde_json::json;

use super::{Document, Output, Quadrature, Reading, failed, pair};
use crate::failure::Failure;

#[derive(clap::Args)]
pub(crate) struct TraceArguments {
    /// Prescription (.toml, .zmx) or name of a shipped design.
    system: PathBuf,
    /// Field point: tangents x,y, or mm for a finite object.
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true, default_value = "0,0")]
    field: [f64; 2],
    /// Pupil point, on the unit disc.
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true, default_value = "0,0")]
    pupil: [f64; 2],
    /// Wavelength, nm [default: the primary one].
    #[arg(long, value_name = "NM")]
    wavelength_nm: Option<f64>,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    document: Document,
}

pub(super) fn trace(arguments: &TraceArguments) -> Result<(), Failure> {
    let system = arguments.reading.system(&arguments.system)?;
    system.check_ray(std::path::Path::new("the command line"), arguments.field, arguments.pupil)?;
    let wavelength_nm = arguments.wavelength_nm.unwrap_or(system.primary_nm());
    let tracer = Tracer::new(&system, wavelength_nm, arguments.reading.clipping()).map_err(failed)?;
    let launcher = Launcher::new(&system).map_err(failed)?;
    let ray = launcher.ray(arguments.field, arguments.pupil).map_err(failed)?;
    let crossings =
        tracer.trace(&ray).map_err(|failure| Failure::new(format!("{}: {failure}", system.name)))?;
    let rows: Vec<_> = crossings
        .iter()
        .map(|crossing| {
            json!({
                "surface": crossing.surface + 1,
                "label": system.surfaces[crossing.surface].label,
                "position_mm": crossing.position_mm.to_array(),
                "local_mm": crossing.local_mm.to_array(),
                "direction": crossing.direction.to_array(),
                "incidence_deg": crossing.incidence_cos.min(1.0).acos().to_degrees(),
                "path_mm": crossing.path_mm,
            })
        })
        .collect();
    let result = json!({
        "system": system.name,
        "wavelength_nm": wavelength_nm,
        "field": arguments.field,
        "pupil": arguments.pupil,
        "crossings": rows,
    });
    arguments.document.print("trace", &result, || {
    let mut lines =
        vec!["surface         x mm           y mm           z mm            l            m            n        path mm".into()];
    lines.extend(crossings.iter().map(|crossing| {
        let (p, d) = (crossing.position_mm, crossing.direction);
        format!(
            "{:7} {:14.9} {:14.9} {:14.9} {:12.9} {:12.9} {:12.9} {:14.9}",
            crossing.surface + 1,
            p.x,
            p.y,
            p.z,
            d.x,
            d.y,
            d.z,
            crossing.path_mm
        )
    }));
    lines
    })
}

#[derive(clap::Args)]
pub(crate) struct SpotArguments {
    /// Prescriptions (.toml, .zmx) or names of shipped designs. Each becomes a row of the drawing.
    #[arg(required = true)]
    systems: Vec<PathBuf>,
    #[command(flatten)]
    quadrature: Quadrature,
    /// Scale from the image to the printed and drawn sizes, for example from screen to sensor.
    #[arg(long, default_value_t = 1.0, value_parser = super::positive, allow_negative_numbers = true)]
    scale: f64,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    output: Output,
}

pub(super) fn spots(arguments: &SpotArguments) -> Result<(), Failure> {
    arguments.output.check()?;
    let clipping = arguments.reading.clipping();
    let options = arguments.quadrature.options(clipping);
    let mut results = Vec::new();
    for source in &arguments.systems {
        let system = arguments.reading.system(source)?;
        let figures = analysis::spots(&system, &options).map_err(failed)?;
        results.push((system, figures));
    }
    arguments.output.draw(|| {
        // The eye wants more rays than the figures do.
        let drawn = results
            .iter()
            .map(|(system, _)| analysis::spots(system, &SpotOptions { rings: 10, arms: 40, clipping }))
            .collect::<Result<Vec<_>, _>>()?;
        let rows: Vec<SpotRow<'_>> = results
            .iter()
            .zip(&drawn)
            .map(|((system, figures), points)| SpotRow { system, points, figures, scale: arguments.scale })
            .collect();
        Ok(plot::spots_figure("Spot diagrams", &rows))
    })?;
    let documents: Vec<_> = results
        .iter()
        .map(|(system, figures)| {
            let fields: Vec<_> = figures
                .fields
                .iter()
                .map(|field| {
                    json!({
                        "field": field.field,
                        "centroid_mm": field.centroid_mm,
                        "rms_um": field.rms_um * arguments.scale,
                        "largest_um": field.largest_um * arguments.scale,
                        "vignetted_fraction": field.vignetted_fraction,
                        "wavelengths": field.wavelengths.iter().map(|wave| json!({
                            "wavelength_nm": wave.wavelength_nm,
                            "centroid_mm": wave.centroid_mm,
                            "rms_um": wave.rms_um * arguments.scale,
                        })).collect::<Vec<_>>(),
                    })
                })
                .collect();
            json!({
                "system": system.name,
                "clipped": figures.clipped,
                "clear_fraction": figures.clear_fraction,
                "scale": arguments.scale,
                "airy_radius_um": figures.airy_radius_um.map(|radius| radius * arguments.scale),
                "fields": fields,
            })
        })
        .collect();
    arguments.output.print("spots", &json!({ "systems": documents }), || {
        let mut lines = Vec::new();
        for (system, figures) in &results {
            let apertures = if figures.clipped {
                format!("apertures {:.0} % clear", 100.0 * figures.clear_fraction)
            } else {
                "apertures open".to_owned()
            };
            lines.push(format!("{} ({apertures})", system.name));
            for field in &figures.fields {
                lines.push(format!(
                    "  field {:9.6}, {:9.6}: RMS {:8.3} um, largest {:8.3} um, vignetted {:5.2} %",
                    field.field[0],
                    field.field[1],
                    field.rms_um * arguments.scale,
                    field.largest_um * arguments.scale,
                    100.0 * field.vignetted_fraction
                ));
            }
        }
        lines
    })
}

#[derive(clap::Args)]
pub(crate) struct FanArguments {
    /// Prescription (.toml, .zmx) or name of a shipped design.
    system: PathBuf,
    /// Number of rays on each side of the chief ray.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u16).range(1..=1000))]
    half: u16,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    output: Output,
}

pub(super) fn fans(arguments: &FanArguments) -> Result<(), Failure> {
    arguments.output.check()?;
    let system = arguments.reading.system(&arguments.system)?;
    let fans =
        analysis::ray_fans(&system, arguments.half.into(), arguments.reading.clipping()).map_err(failed)?;
    arguments.output.draw(|| Ok(plot::fans_figure(&system, &fans)))?;
    arguments.output.print("fans", &fans, || {
        let rim = |points: &[analysis::FanPoint]| {
            points.iter().map(|point| point.error_um.abs()).fold(0.0, f64::max)
        };
        let mut lines = Vec::new();
        for field in &fans.fields {
            for wave in &field.wavelengths {
                lines.push(format!(
                    "field {:9.6}, {:9.6}, {:6.1} nm: largest error {:9.3} um along y, {:9.3} um along x",
                    field.field[0],
                    field.field[1],
                    wave.wavelength_nm,
                    rim(&wave.y_fan),
                    rim(&wave.x_fan)
                ));
            }
        }
        lines
    })
}
