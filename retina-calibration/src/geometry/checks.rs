//! What a table must be before anything is fitted to it.

use glam::{DMat2, DVec2};
use retina_files::InputError;
use retina_formats::{PointRow, PointsTable};
use retina_geometry::Setup;

use super::observations::Observations;

/// Fewest unsaturated points.
const FEWEST_POINTS: usize = 20;
/// A similarity leaves this share of the field where the columns belong together: lenses distort by some per cent.
const SIMILARITY_SHARE: f64 = 0.08;
/// Points that the columns are judged by.
const SAMPLE: usize = 5000;
/// Least ratio of the points' extents across and along.
const LEAST_WIDTH: f64 = 0.02;

/// Refuses tables that no calibration can come from, and says why.
///
/// # Errors
/// Too few points, all saturated, outside the screen, on a line, columns that do not belong together.
pub(crate) fn check(
    table: &PointsTable,
    observations: &Observations,
    setup: &Setup,
) -> Result<(), InputError> {
    let file = table.files.first().map(|file| file.path.clone()).unwrap_or_default();
    let error = |problem: &str| InputError::new(&file, problem);
    let roll = |row: &PointRow| row.camera_roll_deg;
    if let Some(other) = table.rows.iter().find(|row| roll(row) != roll(&table.rows[0])) {
        return Err(table
            .refused(other, "the camera was rolled between exposures", "camera_roll_deg")
            .found(roll(other).map_or("an empty cell".to_owned(), |roll| roll.to_string()))
            .expected("one roll of the camera in a table")
            .help("calibrate each roll of the camera by itself: parts of the mapping turn with it"));
    }
    if observations.len() == 0 {
        return Err(error("every point is saturated")
            .found(format!("{} points, all with saturated = 1", table.rows.len()))
            .help("take the images again with shorter exposures"));
    }
    if observations.len() < FEWEST_POINTS {
        return Err(error("there are too few points")
            .found(format!("{} unsaturated points", observations.len()))
            .expected(format!("at least {FEWEST_POINTS}"))
            .help("display more points, or give more tables with --data"));
    }
    for (side, points) in [("screen", &observations.undistorted), ("camera", &observations.sight)] {
        if narrowness(points) < LEAST_WIDTH {
            return Err(error("the points lie on a line")
                .at(format!("columns {side}_x_px, {side}_y_px"))
                .help("a calibration needs points over the whole field"));
        }
    }
    check_similarity(&file, observations)?;
    // Last: a table whose columns are swapped lies outside the sensor, too, and was named above.
    table.check_setup(setup)?;
    table.check_on_screen(setup)
}

/// Extent of points across their main direction over that along it.
fn narrowness(points: &[DVec2]) -> f64 {
    let mean = points.iter().sum::<DVec2>() / points.len() as f64;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in points {
        let d = *p - mean;
        xx += d.x * d.x;
        xy += d.x * d.y;
        yy += d.y * d.y;
    }
    let (middle, half) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
    ((middle - half).max(0.0) / (middle + half).max(1e-300)).sqrt()
}

fn check_similarity(file: &std::path::Path, observations: &Observations) -> Result<(), InputError> {
    let every = observations.len().div_ceil(SAMPLE);
    let sight: Vec<DVec2> = observations.sight.iter().step_by(every).copied().collect();
    let undistorted: Vec<DVec2> = observations.undistorted.iter().step_by(every).copied().collect();
    let mirrored: Vec<DVec2> = sight.iter().map(|r| DVec2::new(r.y, r.x)).collect();
    let (proper, _) = similarity(&sight, &undistorted);
    let (swapped, swapped_matrix) = similarity(&mirrored, &undistorted);
    let extent = {
        let mean = undistorted.iter().sum::<DVec2>() / undistorted.len() as f64;
        let squares: f64 = undistorted.iter().map(|u| (*u - mean).length_squared()).sum();
        (squares / undistorted.len() as f64).sqrt()
    };
    if proper <= SIMILARITY_SHARE * extent {
        return Ok(());
    }
    let share = |residual: f64| format!("{:.1} % of the field", 100.0 * residual / extent);
    let error = InputError::new(file, "screen and camera columns do not belong together")
        .found(format!("a shift, rotation and scale leave {}", share(proper)))
        .expected(format!("less than {:.0} %", 100.0 * SIMILARITY_SHARE));
    if swapped <= SIMILARITY_SHARE * extent {
        let turned = swapped_matrix.x_axis.y.abs() > swapped_matrix.x_axis.x.abs();
        return Err(if turned {
            error.help(format!(
                "mirrored, they fit ({} left): mirror the camera's images and measure them again",
                share(swapped)
            ))
        } else {
            error.help(format!(
                "with x and y of the camera swapped they fit ({} left): swap camera_x_px and camera_y_px, or screen_x_px and screen_y_px",
                share(swapped)
            ))
        });
    }
    Err(error.help("were the points matched wrongly, or does the table belong to another setup?"))
}

/// Shift, rotation and scale that take `from` to `to` with the least sum of distances (re-weighted least squares): the
/// median distance left, and the matrix.
fn similarity(from: &[DVec2], to: &[DVec2]) -> (f64, DMat2) {
    let mut weights = vec![1.0; from.len()];
    let mut matrix = DMat2::IDENTITY;
    let mut distances = vec![0.0; from.len()];
    for _ in 0..12 {
        let total: f64 = weights.iter().sum();
        let mean =
            |points: &[DVec2]| points.iter().zip(&weights).map(|(p, w)| *p * *w).sum::<DVec2>() / total;
        let (from_mean, to_mean) = (mean(from), mean(to));
        let (mut a, mut b, mut squares) = (0.0, 0.0, 0.0);
        for ((f, t), w) in from.iter().zip(to).zip(&weights) {
            let (f, t) = (*f - from_mean, *t - to_mean);
            a += w * f.dot(t);
            b += w * f.perp_dot(t);
            squares += w * f.length_squared();
        }
        (a, b) = (a / squares, b / squares);
        matrix = DMat2::from_cols(DVec2::new(a, b), DVec2::new(-b, a));
        for (i, (f, t)) in from.iter().zip(to).enumerate() {
            distances[i] = (to_mean + matrix * (*f - from_mean) - *t).length();
            weights[i] = 1.0 / distances[i].max(1e-9);
        }
    }
    distances.sort_by(f64::total_cmp);
    (distances[distances.len() / 2], matrix)
}
