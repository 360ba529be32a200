//! `retina optics design`.

use std::path::{Path, PathBuf};

use retina_bench::Prediction;
use retina_files::InputError;
use retina_geometry::Setup;
use retina_optics::constraints::{BenchLimits, PaperModel};
use retina_optics::design::{
    BenchDesign, BenchLenses, Camera, Margins, MatchBy, Screen, bench_design, bench_figure, setup_toml,
};

use super::constraints::check;
use super::{Output, write_file};
use crate::failure::Failure;
use crate::output::tell;
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Focal length of the camera's objective, mm.
    #[arg(long, value_name = "MM")]
    camera_focal_mm: f64,
    /// Sensor: columns x rows @ pixel pitch in um.
    #[arg(long, value_name = "WxH@UM", value_parser = sensor, default_value = "2048x1536@3.45")]
    sensor: Sensor,
    /// F-number of the objective.
    #[arg(long, value_name = "N", default_value_t = 2.8)]
    f_number: f64,
    /// Bits of the camera's digital numbers.
    #[arg(long, value_name = "BITS", default_value_t = 12, value_parser = clap::value_parser!(u32).range(1..=32))]
    camera_bits: u32,
    /// Setup whose screen is used [default: the paper's display].
    #[arg(long, value_name = "FILE")]
    screen_of: Option<PathBuf>,
    /// Focal length of the collimator, mm.
    #[arg(long, value_name = "MM")]
    f_c: f64,
    /// Focal length of the relay, mm.
    #[arg(long, value_name = "MM")]
    f_r: f64,
    /// Clear diameter of both lenses, mm.
    #[arg(long, value_name = "MM", default_value_t = PaperModel::LENS_DIAMETER_MM)]
    lens_mm: f64,
    /// Distance from the camera pupil to the collimator, mm [default: 1.3 times f_c].
    #[arg(long, value_name = "MM")]
    s_cam_mm: Option<f64>,
    /// Extent in which the camera's field is matched to the screen.
    #[arg(long, value_enum, default_value_t)]
    match_by: Matching,
    /// Exposure of which the limiting magnitude is told, s.
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    exposure_s: f64,
    /// Name of the configuration.
    #[arg(long, default_value = "camera")]
    name: String,
    /// Setup (setup.toml) to write.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
}

/// `--match-by`.
#[derive(Clone, Copy, Default, clap::ValueEnum)]
pub(super) enum Matching {
    /// Heights (eq. 13).
    #[default]
    Height,
    /// Widths.
    Width,
    /// Diagonals.
    Diagonal,
}

impl From<Matching> for MatchBy {
    fn from(matching: Matching) -> Self {
        match matching {
            Matching::Height => Self::Height,
            Matching::Width => Self::Width,
            Matching::Diagonal => Self::Diagonal,
        }
    }
}

#[derive(Clone, Copy)]
struct Sensor {
    width_px: u32,
    height_px: u32,
    pixel_um: f64,
}

fn sensor(text: &str) -> Result<Sensor, String> {
    let parts = text.split_once('@').and_then(|(size, pitch)| {
        let (width, height) = size.split_once('x')?;
        Some((width.parse().ok()?, height.parse().ok()?, pitch.parse().ok()?))
    });
    match parts {
        Some((width_px, height_px, pixel_um))
            if width_px > 0 && height_px > 0 && pixel_um > 0.0 && pixel_um < 1e4 =>
        {
            Ok(Sensor { width_px, height_px, pixel_um })
        }
        _ => Err("expected columns x rows @ pixel pitch in um, such as 2048x1536@3.45".into()),
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.output.check()?;
    arguments.out.as_deref().map_or(Ok(()), |file| crate::check_file(file, "toml"))?;
    if arguments.name.is_empty() || arguments.name.chars().any(char::is_control) {
        return Err(InputError::new("--name", "the name is not valid")
            .found(format!("{:?}", arguments.name))
            .expected("text without line breaks or other control characters")
            .into());
    }
    let s_cam_mm = arguments.s_cam_mm.unwrap_or(1.3 * arguments.f_c);
    check(&[
        ("--camera-focal-mm", arguments.camera_focal_mm),
        ("--f-number", arguments.f_number),
        ("--f-c", arguments.f_c),
        ("--f-r", arguments.f_r),
        ("--lens-mm", arguments.lens_mm),
        ("--s-cam-mm", s_cam_mm),
        ("--exposure-s", arguments.exposure_s),
    ])?;
    let Sensor { width_px, height_px, pixel_um } = arguments.sensor;
    let camera = Camera {
        width_px,
        height_px,
        pixel_um,
        focal_mm: arguments.camera_focal_mm,
        f_number: arguments.f_number,
    };
    let screen = match &arguments.screen_of {
        None => Screen::PAPER,
        Some(path) => screen_of(&read_setup(path)?),
    };
    let lenses = BenchLenses {
        collimator_focal_mm: arguments.f_c,
        relay_focal_mm: arguments.f_r,
        diameter_mm: arguments.lens_mm,
        pupil_collimator_mm: s_cam_mm,
    };
    let design = bench_design(&camera, &screen, &lenses, &BenchLimits::PAPER, arguments.match_by.into());
    let mut warnings = Vec::new();
    if !design.margins.all_hold() {
        warnings.push(EXCEEDED.to_owned());
    }
    if design.rows_beyond_screen_px > 0.0 {
        warnings.push(format!(
            "the camera sees {:.1} rows and the screen has {}: {:.1} rows at the image's upper and lower edge stay dark; \
             --match-by height avoids it",
            design.observed_rows_px, screen.height_px, design.rows_beyond_screen_px
        ));
    }
    for warning in &warnings {
        tell!("warning: {warning}");
    }
    arguments.output.draw(|| bench_figure(&arguments.name, &design, &lenses, &camera))?;
    let text = setup_toml(&arguments.name, &design, &camera, &screen, arguments.camera_bits);
    // The camera's noise and the display's response are the defaults of a setup.
    let setup = Setup::parse(&text, Path::new("the designed setup"))?;
    let prediction = Prediction::of(&setup, arguments.exposure_s);
    if let Some(path) = &arguments.out {
        write_file(path, text.as_bytes())?;
    }
    let (layout, margins) = (&design.layout, &design.margins);
    arguments.output.print("design", &Told { design: &design, prediction: prediction_json(&prediction), warnings: &warnings }, || {
        vec![
            format!(
                "M     {:10.4}      camera and screen matched by {}; rows of the screen seen {:.1}",
                layout.magnification,
                design.match_by.words(),
                design.observed_rows_px
            ),
            row("s_cam", design.pupil_collimator_mm, None, "camera pupil to collimator"),
            row("s_or", layout.screen_relay_mm, Some(margins.screen_relay_distance_mm), "screen to relay"),
            row("s_ri", layout.relay_image_mm, None, "relay to intermediate image"),
            row("s_rc", layout.inter_lens_mm, Some(margins.inter_lens_distance_mm), "relay to collimator"),
            row("s_oc", layout.total_length_mm, Some(margins.total_length_mm), "screen to collimator"),
            row("r_r", layout.relay_beam_mm, Some(margins.relay_vignetting_mm), "beam's radius at the relay"),
            row(
                "r_c",
                layout.collimator_beam_mm,
                Some(margins.collimator_vignetting_mm),
                "beam's radius at the collimator",
            ),
            format!(
                "A pixel of the screen is {:.2} camera px; a lit one is a spot of {:.2} px (full width at half maximum) by pixels and \
                 diffraction, and the lenses' aberrations add to it.",
                prediction.screen_pixel_camera_px, prediction.spot_fwhm_px
            ),
            format!(
                "One pixel shows magnitudes {:.2} to {:.2} if the response is assumed to be a power of {}; an exposure of {} s sees \
                 to magnitude {:.1} (5 sigma, the camera's noise as assumed).",
                prediction.displayed_magnitudes[0],
                prediction.displayed_magnitudes[1],
                prediction.response_gamma,
                prediction.exposure_s,
                prediction.limiting_magnitude
            ),
        ]
    })?;
    if design.margins.all_hold() { Ok(()) } else { Err(Failure::exceeded(exceeded(&design.margins))) }
}

/// A distance with its margin and what it is.
fn row(symbol: &str, mm: f64, margin_mm: Option<f64>, words: &str) -> String {
    let margin = margin_mm.map_or(String::new(), |margin| format!("margin {margin:8.3} mm"));
    format!("{symbol:<5} {mm:10.3} mm   {margin:<18}   {words}")
}

fn prediction_json(prediction: &Prediction) -> serde_json::Value {
    serde_json::json!({
        "screen_pixel_camera_px": prediction.screen_pixel_camera_px,
        "spot_fwhm_px": prediction.spot_fwhm_px,
        "displayed_magnitudes": prediction.displayed_magnitudes,
        "response_gamma": prediction.response_gamma,
        "exposure_s": prediction.exposure_s,
        "limiting_magnitude": prediction.limiting_magnitude,
    })
}

/// What is warned of where the design does not fit the bench.
const EXCEEDED: &str = "a limit of the bench or a lens's rim is exceeded: see the negative margins";

/// Which limits are exceeded, and by how much.
fn exceeded(margins: &Margins) -> String {
    let negative: Vec<String> = [
        ("s_oc", margins.total_length_mm),
        ("s_or", margins.screen_relay_distance_mm),
        ("s_rc", margins.inter_lens_distance_mm),
        ("r_r", margins.relay_vignetting_mm),
        ("r_c", margins.collimator_vignetting_mm),
    ]
    .into_iter()
    .filter(|(_, margin_mm)| margin_mm.is_nan() || *margin_mm < 0.0)
    .map(|(name, margin_mm)| format!("{name} by {:.3} mm", -margin_mm))
    .collect();
    format!("the design does not fit the bench: {} beyond the limit", negative.join(", "))
}

/// The document: the design's own keys, what a camera will see by it, and what was warned of.
#[derive(serde::Serialize)]
struct Told<'a> {
    #[serde(flatten)]
    design: &'a BenchDesign,
    prediction: serde_json::Value,
    warnings: &'a [String],
}

fn screen_of(setup: &Setup) -> Screen {
    let screen = &setup.screen;
    Screen {
        width_px: screen.width_px,
        height_px: screen.height_px,
        width_mm: screen.width_mm,
        height_mm: screen.height_mm,
    }
}

/// Camera and screen of a setup.
pub(super) fn camera_and_screen(setup: &Setup) -> (Camera, Screen) {
    let camera = &setup.camera;
    let camera = Camera {
        width_px: camera.width_px,
        height_px: camera.height_px,
        pixel_um: camera.pixel_um,
        focal_mm: camera.focal_mm,
        f_number: camera.f_number,
    };
    (camera, screen_of(setup))
}
