//! Rows of points that are no measurements: repeated, constant, copied from other exposures.

use std::collections::HashMap;

use glam::DVec2;
use retina_files::InputError;
use retina_formats::{PointRow, PointsTable};

use super::read::{bits, bits_of, first_file, repeated};

/// A point of an exposure is there once.
pub(super) fn refuse_repeated(table: &PointsTable) -> Result<(), InputError> {
    let cells = |at: usize| {
        let row = &table.rows[at];
        let mut cells = vec![
            bits_of(&table.images[row.image]),
            bits_of(&row.series),
            row.channel as u64,
            u64::from(row.saturated),
        ];
        let [screen, camera] = [row.screen_px, row.camera_px];
        cells.extend([screen.x, screen.y, row.digital_count, camera.x, camera.y].map(f64::to_bits));
        cells.extend(bits([row.sigma_px, row.time_s, row.temperature_c, row.row_load]));
        cells.extend(bits([row.exposure_s, row.flux_dn, row.camera_roll_deg, row.mounting]));
        cells.extend(table.extra.iter().map(|column| column.values[at].to_bits()));
        cells
    };
    let repeated = repeated(table.rows.len(), cells);
    let Some(&(again, before)) = repeated.first() else { return Ok(()) };
    let (again, before) = (&table.rows[again], &table.rows[before]);
    let file = |row: &PointRow| table.files.get(row.file).map_or(first_file(&table.files), |file| &file.path);
    Err(InputError::new(file(again), "the row repeats another in every cell")
        .line(again.line)
        .found(format!("{} such rows in all", repeated.len()))
        .expected("each point of an exposure once")
        .help(format!("delete the copies; the first is line {} of {}", before.line, file(before).display())))
}

/// Exposures: their images' names, and their rows in the table.
pub(super) type Exposures = Vec<(String, Vec<usize>)>;

/// Exposures without saturated rows, and the number of those.
pub(super) fn exposures(table: &PointsTable) -> (Exposures, usize) {
    let mut groups: Exposures = Vec::new();
    let mut of_image: HashMap<usize, usize> = HashMap::new();
    let mut saturated = 0;
    for (at, row) in table.rows.iter().enumerate() {
        if row.saturated {
            saturated += 1;
            continue;
        }
        let next = groups.len();
        let group = *of_image.entry(row.image).or_insert(next);
        if group == next {
            groups.push((table.images[row.image].clone(), Vec::new()));
        }
        groups[group].1.push(at);
    }
    // The order of a table's rows must not matter.
    for (_, rows) in &mut groups {
        rows.sort_by(|&a, &b| {
            let [a, b] = [a, b].map(|at| &table.rows[at]);
            let by = |of: fn(&PointRow) -> f64| of(a).total_cmp(&of(b));
            by(|row| row.screen_px.y)
                .then(by(|row| row.screen_px.x))
                .then(by(|row| row.digital_count))
                .then((a.channel as u8).cmp(&(b.channel as u8)))
        });
    }
    (groups, saturated)
}

/// Fewest rows of which a constant coordinate is not by chance, and fewest points that make exposures copies.
const BY_CHANCE: usize = 10;
const FEWEST_POINTS: usize = 3;

/// A line of points on the screen is seen as a line, bent by less than this part of its length.
const BENT: f64 = 0.1;

/// A camera coordinate that is the same everywhere was not measured. Nor was a screen coordinate, unless the camera sees a line.
pub(super) fn refuse_constant(table: &PointsTable) -> Result<(), InputError> {
    let Some(first) = table.rows.first() else { return Ok(()) };
    let constant = |of: &dyn Fn(&PointRow) -> f64| table.rows.iter().all(|row| of(row) == of(first));
    let shown_in_a_line =
        [0, 1].iter().any(|&axis| constant(&|row| row.screen_px[axis])) || table.rows.len() < BY_CHANCE;
    let refused = |column: &str, value: f64, expected: &str| {
        InputError::new(first_file(&table.files), "a coordinate is the same in all rows")
            .at(format!("column `{column}`"))
            .found(format!("{value} in all {} rows", table.rows.len()))
            .expected(expected)
            .help("look at what wrote the table: a column was filled with one value")
    };
    for (axis, column) in ["camera_x_px", "camera_y_px"].into_iter().enumerate() {
        if !shown_in_a_line && constant(&|row| row.camera_px[axis]) {
            let expected = "places that differ, as those on the screen do";
            return Err(refused(column, first.camera_px[axis], expected));
        }
    }
    let own = table.rows.iter().filter(|row| row.image == first.image);
    let seen: Vec<DVec2> = own.map(|row| row.camera_px).collect();
    let in_a_line = seen.len() < BY_CHANCE || width_of_line(&seen) <= BENT;
    for (axis, column) in ["screen_x_px", "screen_y_px"].into_iter().enumerate() {
        if !in_a_line && constant(&|row| row.screen_px[axis]) {
            let expected = "points that lie in a line in the camera as well, or places that differ";
            return Err(refused(column, first.screen_px[axis], expected));
        }
    }
    Ok(())
}

/// How wide points lie across the direction in which they lie longest, over that length (standard deviations).
fn width_of_line(points: &[DVec2]) -> f64 {
    let mean = points.iter().sum::<DVec2>() / points.len() as f64;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for point in points {
        let d = *point - mean;
        (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
    }
    let (middle, off) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    if middle + off > 0.0 { ((middle - off).max(0.0) / (middle + off)).sqrt() } else { 0.0 }
}

/// Leaves out exposures in which every point is where another exposure has it, to the last digit: they are copies, and
/// would be counted as measurements. Returns what to tell.
pub(super) fn leave_out_copies(table: &PointsTable, groups: &mut Exposures) -> Option<String> {
    let places = |rows: &[usize]| -> Vec<[u64; 5]> {
        let mut places: Vec<[u64; 5]> = rows
            .iter()
            .map(|&at| {
                let row = &table.rows[at];
                let [screen, camera] = [row.screen_px, row.camera_px];
                let [a, b, c, d] = [screen.x, screen.y, camera.x, camera.y].map(f64::to_bits);
                [a, b, c, d, row.channel as u64]
            })
            .collect();
        places.sort_unstable();
        places
    };
    let all = groups.len();
    let mut seen: HashMap<Vec<[u64; 5]>, String> = HashMap::new();
    let mut example: Option<[String; 2]> = None;
    groups.retain(|(name, rows)| {
        if rows.len() < FEWEST_POINTS {
            return true;
        }
        let known = seen.entry(places(rows)).or_insert_with(|| name.clone());
        if known != name {
            example.get_or_insert_with(|| [name.clone(), known.clone()]);
        }
        known == name
    });
    let [copy, of] = example?;
    Some(format!(
        "{} of {all} exposures are copies of others and are left out: `{copy}` has every point where `{of}` has it, to the last digit",
        all - groups.len()
    ))
}
