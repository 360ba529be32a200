//! Whether the camera's places can be those of the screen's points at all: units, mirrors, another camera.

use glam::{DMat2, DVec2};
use retina_files::InputError;
use retina_formats::{PointRow, PointsTable};
use retina_geometry::Setup;

use super::read::first_file;

/// A scale beyond this, up or down, is one of units.
const UNITS: f64 = 10.0;
/// A scale that is farther from 1 than this is more likely another camera or magnification than K_f's error.
const LIKELY: f64 = 0.05;

/// Fewest rows of a mounting that say its scale.
const FEWEST_ROWS: usize = 10;

/// The linear part of what takes `from` to `to`, by least squares; `None` where the places lie on a line.
fn linear_part(from: &[DVec2], to: &[DVec2]) -> Option<DMat2> {
    let mean = |places: &[DVec2]| places.iter().sum::<DVec2>() / places.len() as f64;
    let (a, b) = (mean(from), mean(to));
    let outer = |u: DVec2, v: DVec2| DMat2::from_cols(u * v.x, u * v.y);
    let (mut square, mut cross) = (DMat2::ZERO, DMat2::ZERO);
    for (u, v) in from.iter().zip(to) {
        square += outer(*u - a, *u - a);
        cross += outer(*v - b, *u - a);
    }
    let trace = square.x_axis.x + square.y_axis.y;
    (square.determinant() > 1e-6 * trace * trace).then(|| cross * square.inverse())
}

/// Refuses places whose scale is that of other units; returns what to tell of the others.
pub(super) fn check_scale(
    table: &PointsTable,
    rows: &[&PointRow],
    displayed: &[DVec2],
    sight: &[DVec2],
    mounting: &[usize],
    setup: &Setup,
) -> Result<Vec<String>, InputError> {
    let mut notes = Vec::new();
    let size = DVec2::new(f64::from(setup.screen.width_px), f64::from(setup.screen.height_px));
    let off = rows.iter().filter(|row| {
        let at = row.screen_px;
        at.cmplt(DVec2::splat(-0.5)).any() || at.cmpgt(size + 0.5).any()
    });
    let off = off.count();
    if off > 0 {
        notes.push(format!(
            "{off} of {} rows were shown off the screen of setup `{}` ({} x {} px): is it the setup of these points?",
            rows.len(),
            setup.name,
            size.x,
            size.y
        ));
    }
    // Each time the camera is mounted it is turned otherwise.
    let of_mounting = |number: usize| -> Option<f64> {
        let rows = || (0..rows.len()).filter(|&row| mounting[row] == number);
        let places = |of: &[DVec2]| rows().map(|row| of[row]).collect::<Vec<_>>();
        (rows().count() >= FEWEST_ROWS)
            .then(|| linear_part(&places(displayed), &places(sight)))
            .flatten()
            .map(|linear| linear.determinant())
    };
    let count = mounting.iter().max().map_or(0, |last| last + 1);
    let mut determinants: Vec<f64> = (0..count).filter_map(of_mounting).collect();
    if determinants.is_empty() {
        return Ok(notes);
    }
    determinants.sort_by(f64::total_cmp);
    let determinant = determinants[determinants.len() / 2];
    let scale = determinant.abs().sqrt();
    if !(1.0 / UNITS..UNITS).contains(&scale) {
        return Err(InputError::new(
            first_file(&table.files),
            "the camera's places do not follow the screen's",
        )
        .at("columns `camera_x_px` and `camera_y_px`")
        .found(format!("{scale:.2e} times as wide as setup `{}` makes them", setup.name))
        .expected("pixels, each of the screen's point in its row")
        .help("are they in millimetres, or are the rows of camera and screen shuffled?"));
    }
    if determinant < 0.0 {
        notes.push(
            "the camera sees the field mirrored: does one of the columns count the other way? All that is found below is of a mirrored field"
                .to_owned(),
        );
    }
    if (scale - 1.0).abs() > LIKELY {
        notes.push(format!(
            "the camera's lines of sight are {scale:.3} times as wide as setup `{}` makes them: another camera, binned pixels or another magnification? Angles below are by the setup's pixels",
            setup.name
        ));
    }
    Ok(notes)
}
