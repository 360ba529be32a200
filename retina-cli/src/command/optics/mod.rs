//! `retina optics`: lens systems, traced exactly.

mod beam;
mod bench;
mod constraints;
mod image;
mod lens;
mod search;

use std::path::{Path, PathBuf};

use retina_files::write_atomic;
use retina_optics::analysis::SpotOptions;
use retina_optics::{Clipping, OpticalSystem, OpticsError, read_system};
use retina_plot::Figure;
use serde::Serialize;
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};

/// A finite number above 0, for an option.
fn positive(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| value.is_finite() && *value > 0.0);
    value.ok_or_else(|| "expected a finite number above 0".into())
}

/// A number from 0 to a limit, for an option.
fn up_to(limit: f64) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| {
        let value = text.parse::<f64>().ok().filter(|value| (0.0..=limit).contains(value));
        value.ok_or_else(|| format!("expected a number from 0 to {limit}"))
    }
}

#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Traces one ray through all surfaces.
    Trace(beam::TraceArguments),
    /// Prints focal lengths, pupils, principal planes and Seidel sums.
    FirstOrder(lens::Arguments),
    /// Computes spot diagrams and their RMS radius.
    Spots(beam::SpotArguments),
    /// Computes transverse ray errors over the pupil.
    Fans(beam::FanArguments),
    /// Computes field curvature, distortion, lateral colour and illumination.
    Field(lens::FieldArguments),
    /// Computes wavefront maps.
    Wavefront(image::WavefrontArguments),
    /// Computes point spread functions and encircled energy.
    Psf(image::PsfArguments),
    /// Computes modulation transfer functions.
    Mtf(image::MtfArguments),
    /// Finds ghosts of two reflections.
    Ghosts(lens::GhostArguments),
    /// Runs a Monte Carlo over mounting and manufacturing errors.
    Tolerance(lens::ToleranceArguments),
    /// Computes spots and focus over temperature.
    Thermal(lens::ThermalArguments),
    /// Draws the layout.
    Layout(lens::LayoutArguments),
    /// Computes the fields that a collimator and a relay allow, and which constraint limits them.
    Constraints(constraints::Arguments),
    /// Computes the distances and margins of the bench for a camera, and its setup.toml.
    Design(bench::Arguments),
    /// Searches stock lenses for the collimator and the relay.
    Search(Box<search::Arguments>),
}

pub(crate) fn run(command: Command) -> Result<(), Failure> {
    match command {
        Command::Trace(arguments) => beam::trace(&arguments),
        Command::FirstOrder(arguments) => lens::first_order(&arguments),
        Command::Spots(arguments) => beam::spots(&arguments),
        Command::Fans(arguments) => beam::fans(&arguments),
        Command::Field(arguments) => lens::field(&arguments),
        Command::Wavefront(arguments) => image::wavefront(&arguments),
        Command::Psf(arguments) => image::psf(&arguments),
        Command::Mtf(arguments) => image::mtf(&arguments),
        Command::Ghosts(arguments) => lens::ghosts(&arguments),
        Command::Tolerance(arguments) => lens::tolerance(&arguments),
        Command::Thermal(arguments) => lens::thermal(&arguments),
        Command::Layout(arguments) => lens::layout(&arguments),
        Command::Constraints(arguments) => constraints::run(&arguments),
        Command::Design(arguments) => bench::run(&arguments),
        Command::Search(arguments) => search::run(&arguments),
    }
}

/// How a system is read.
#[derive(clap::Args)]
pub(crate) struct Reading {
    /// Glass catalogue (AGF) to use besides the embedded glasses. Repeat the flag for more.
    #[arg(long, value_name = "FILE")]
    agf: Vec<PathBuf>,
    /// Fraction of each clear semi-diameter that light may use, for example 0.9 [default: the
    /// file's].
    #[arg(long, value_name = "FRACTION")]
    clear: Option<f64>,
    /// Let no aperture stop a ray.
    #[arg(long, conflicts_with = "clear")]
    unclipped: bool,
}

impl Reading {
    fn system(&self, source: &std::path::Path) -> Result<OpticalSystem, Failure> {
        let mut system = read_system(source, &self.agf)?;
        if let Some(fraction) = self.clear {
            system.clear_fraction = fraction;
            system.check(std::path::Path::new("--clear"))?;
        }
        Ok(system)
    }

    fn clipping(&self) -> Clipping {
        if self.unclipped { Clipping::Off } else { Clipping::On }
    }
}

/// Gaussian quadrature of the pupil.
#[derive(clap::Args)]
pub(crate) struct Quadrature {
    /// Number of Gauss-Legendre rings over the pupil, or over the part that apertures leave open.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u16).range(1..=200))]
    rings: u16,
    /// Number of arms over the pupil.
    #[arg(long, default_value_t = 48, value_parser = clap::value_parser!(u16).range(3..=1000))]
    arms: u16,
}

impl Quadrature {
    fn options(&self, clipping: Clipping) -> SpotOptions {
        SpotOptions { rings: self.rings.into(), arms: self.arms.into(), clipping }
    }
}

/// Where a result is drawn.
#[derive(clap::Args, Clone, Default)]
pub(crate) struct Drawing {
    /// Draw the result into this SVG file.
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Draw the result into this PNG file.
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
}

impl Drawing {
    /// Whether there is one.
    fn is_wanted(&self) -> bool {
        self.svg.is_some() || self.png.is_some()
    }

    /// Refuses a drawing whose folder is not there, before anything is computed.
    fn check(&self) -> Result<(), Failure> {
        self.svg.as_deref().map_or(Ok(()), |file| crate::check_file(file, "svg"))?;
        self.png.as_deref().map_or(Ok(()), |file| crate::check_file(file, "png"))
    }

    /// Writes the drawing, if one is wanted.
    fn draw(&self, figure: impl FnOnce() -> Result<Figure, OpticsError>) -> Result<(), Failure> {
        if !self.is_wanted() {
            return Ok(());
        }
        let svg = figure().map_err(failed)?.to_svg();
        if let Some(path) = &self.svg {
            write_file(path, svg.as_bytes())?;
        }
        if let Some(path) = &self.png {
            let png = retina_plot::png(&svg, PNG_SCALE).map_err(|error| Failure::new(error.to_string()))?;
            write_file(path, &png)?;
        }
        Ok(())
    }
}

/// Pixels of a PNG for each px of the SVG.
const PNG_SCALE: f64 = 2.0;

/// Writes a file whole, and says so.
fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    write_atomic(path, bytes)
        .map_err(|error| Failure::new(format!("{} cannot be written: {error}", path.display())))?;
    tell!("{} written", path.display());
    Ok(())
}

/// How a result is shown.
#[derive(clap::Args)]
pub(crate) struct Output {
    #[command(flatten)]
    drawing: Drawing,
    #[command(flatten)]
    document: Document,
}

impl Output {
    fn check(&self) -> Result<(), Failure> {
        self.drawing.check()
    }

    fn draw(&self, figure: impl FnOnce() -> Result<Figure, OpticsError>) -> Result<(), Failure> {
        self.drawing.draw(figure)
    }

    fn print<T: Serialize>(
        &self,
        schema: &str,
        result: &T,
        lines: impl FnOnce() -> Vec<String>,
    ) -> Result<(), Failure> {
        self.document.print(schema, result, lines)
    }
}

/// How a result is told.
#[derive(clap::Args)]
pub(crate) struct Document {
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

impl Document {
    /// The document of a schema, or lines of text.
    fn print<T: Serialize>(
        &self,
        schema: &str,
        result: &T,
        lines: impl FnOnce() -> Vec<String>,
    ) -> Result<(), Failure> {
        if self.json { print_json(&document(schema, result)?) } else { print_lines(&lines()) }
    }
}

/// `schema` first, then the result's own keys.
fn document<T: Serialize>(schema: &str, result: &T) -> Result<Value, Failure> {
    let mut document = json!({ "schema": format!("retina.optics-{schema}/1") });
    let value = serde_json::to_value(result).map_err(|error| Failure::new(error.to_string()))?;
    match (document.as_object_mut(), value) {
        (Some(document), Value::Object(keys)) => document.extend(keys),
        (Some(document), other) => {
            document.insert("results".into(), other);
        }
        (None, _) => {}
    }
    Ok(document)
}

fn failed(error: OpticsError) -> Failure {
    Failure::new(error.to_string())
}

/// Two numbers with a comma between, for a field or pupil point.
fn pair(text: &str) -> Result<[f64; 2], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok([x, y]) if x.is_finite() && y.is_finite() => Ok([*x, *y]),
        _ => Err("expected two numbers separated by a comma, such as 0,0.1".into()),
    }
}

/// A number of any unit, or "-" where there is none.
fn or_dash(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.4}"))
}
