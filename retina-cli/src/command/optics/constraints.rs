//! `retina optics constraints`.

use std::path::Path;

use retina_files::InputError;
use retina_optics::constraints::{BenchLimits, FieldRequirement, PaperModel, field_grid, field_range_figure};
use serde_json::json;

use super::{Output, pair};
use crate::failure::Failure;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Focal length of the collimator, mm.
    #[arg(long, value_name = "MM")]
    f_c: f64,
    /// Focal length of the relay, mm.
    #[arg(long, value_name = "MM")]
    f_r: f64,
    /// Extent of the screen that matches the field, mm; for diagonal fields its diagonal.
    #[arg(long, value_name = "MM", default_value_t = PaperModel::SCREEN_DIAGONAL_MM)]
    screen_mm: f64,
    /// Diameter of the camera's entrance pupil, mm.
    #[arg(long, value_name = "MM", default_value_t = PaperModel::PUPIL_MM)]
    pupil_mm: f64,
    /// Clear diameter of both lenses, mm.
    #[arg(long, value_name = "MM", default_value_t = PaperModel::LENS_DIAMETER_MM)]
    lens_mm: f64,
    /// Distance from the camera pupil to the collimator, mm [default: f_c].
    #[arg(long, value_name = "MM")]
    s_cam_mm: Option<f64>,
    /// Also compute a grid of focal lengths; --svg and --png draw it.
    ///
    /// s_cam keeps its proportion to f_c.
    #[arg(long)]
    grid: bool,
    /// First and last focal length of the grid, mm.
    #[arg(long, value_name = "MM,MM", value_parser = pair, default_value = "40,200")]
    grid_mm: [f64; 2],
    /// Number of grid points along each focal length.
    #[arg(long, value_name = "N", default_value_t = 81, value_parser = clap::value_parser!(u16).range(2..=1000))]
    grid_count: u16,
    #[command(flatten)]
    output: Output,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.output.check()?;
    let s_cam_mm = arguments.s_cam_mm.unwrap_or(arguments.f_c);
    check(&[
        ("--f-c", arguments.f_c),
        ("--f-r", arguments.f_r),
        ("--screen-mm", arguments.screen_mm),
        ("--pupil-mm", arguments.pupil_mm),
        ("--lens-mm", arguments.lens_mm),
        ("--s-cam-mm", s_cam_mm),
        ("--grid-mm", arguments.grid_mm[0]),
        ("--grid-mm", arguments.grid_mm[1] - arguments.grid_mm[0]),
    ])?;
    if arguments.output.drawing.is_wanted() && !arguments.grid {
        return Err(InputError::new("the command line", "--svg and --png draw the grid of focal lengths")
            .help("add --grid")
            .into());
    }
    let bench = BenchLimits::PAPER;
    let model = |f_c: f64, f_r: f64| PaperModel {
        collimator_focal_mm: f_c,
        relay_focal_mm: f_r,
        screen_mm: arguments.screen_mm,
        pupil_mm: arguments.pupil_mm,
        collimator_diameter_mm: arguments.lens_mm,
        relay_diameter_mm: arguments.lens_mm,
        pupil_collimator_mm: s_cam_mm / arguments.f_c * f_c,
    };
    let here = model(arguments.f_c, arguments.f_r);
    let range = here.field_range(&bench);
    let degrees = |pick: fn(&retina_optics::constraints::FieldRange) -> f64| {
        range.as_ref().map(|r| pick(r).to_degrees())
    };
    let limits =
        range.map_or(["none"; 2].map(|none| json!(none)), |r| [json!(r.limit_at_min), json!(r.limit_at_max)]);
    let mut document = json!({
        "field_min_deg": degrees(|r| r.min_rad),
        "field_max_deg": degrees(|r| r.max_rad),
        "limit_at_min": limits[0],
        "limit_at_max": limits[1],
        "model": here,
        "bench": bench,
    });
    if arguments.grid {
        let grid = field_grid(
            arguments.grid_mm,
            arguments.grid_mm,
            usize::from(arguments.grid_count),
            &bench,
            model,
        );
        let required = FieldRequirement::PAPER;
        let mark = Some([arguments.f_c, arguments.f_r]);
        arguments.output.draw(|| Ok(field_range_figure(&grid, &required, mark)))?;
        let value = serde_json::to_value(&grid).map_err(|error| Failure::new(error.to_string()))?;
        if let Some(document) = document.as_object_mut() {
            document.insert("grid".into(), value);
        }
    }
    arguments.output.print("constraints", &document, || match &range {
        None => vec!["no field is within the limits".to_owned()],
        Some(range) => vec![
            format!(
                "smallest diagonal field {:.3} deg, limited by {}",
                range.min_rad.to_degrees(),
                limits[0]
            ),
            format!("largest diagonal field {:.3} deg, limited by {}", range.max_rad.to_degrees(), limits[1]),
        ],
    })
}

/// Longest length that a flag of the bench may have, mm: ten metres.
const LONGEST_MM: f64 = 1e4;

/// Refuses flags that are not positive numbers, or longer than any bench.
pub(super) fn check(flags: &[(&str, f64)]) -> Result<(), InputError> {
    match flags.iter().find(|(_, value)| !(*value > 0.0 && *value <= LONGEST_MM)) {
        None => Ok(()),
        Some((flag, value)) => {
            let problem = match *value > 0.0 {
                true => "the value is longer than any bench",
                false => "the value is not a positive number",
            };
            Err(InputError::new(Path::new("the command line"), problem)
                .at(format!("flag {flag}"))
                .found(value)
                .expected(format!("above 0, at most {LONGEST_MM}")))
        }
    }
}
