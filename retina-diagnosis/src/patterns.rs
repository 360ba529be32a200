//! Displacements over the field, and what they are times functions of time or of a column.

use crate::data::Dataset;

/// A displacement over the field.
pub(crate) type Pattern = fn(&Dataset, usize) -> [f64; 2];

/// Shifts, a scale, a roll and tilts.
pub(crate) const PATTERNS: [Pattern; 6] = [
    |_, _| [1.0, 0.0],
    |_, _| [0.0, 1.0],
    |data, row| [data.values("x")[row], data.values("y")[row]],
    |data, row| [-data.values("y")[row], data.values("x")[row]],
    |data, row| [data.values("x")[row].powi(2), data.values("x")[row] * data.values("y")[row]],
    |data, row| [data.values("x")[row] * data.values("y")[row], data.values("y")[row].powi(2)],
];

/// Shifts, and what is linear in the place.
pub(crate) const LINEAR: [Pattern; 6] = [
    |_, _| [1.0, 0.0],
    |_, _| [0.0, 1.0],
    |data, row| [data.values("x")[row], 0.0],
    |data, row| [data.values("y")[row], 0.0],
    |data, row| [0.0, data.values("x")[row]],
    |data, row| [0.0, data.values("y")[row]],
];

/// Tilts of the screen or the camera.
pub(crate) const TILTS: [Pattern; 2] = [PATTERNS[4], PATTERNS[5]];

/// Each pattern times each function of a row.
pub(crate) fn products(data: &Dataset, patterns: &[Pattern], functions: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n = data.components();
    let of_pattern = |pattern: &Pattern| {
        let field: Vec<f64> =
            (0..data.len()).flat_map(|row| pattern(data, row).into_iter().take(n)).collect();
        let times = |function: &Vec<f64>| -> Vec<f64> {
            field.iter().enumerate().map(|(i, part)| part * function[i / n]).collect()
        };
        functions.iter().map(times).collect::<Vec<Vec<f64>>>()
    };
    patterns.iter().flat_map(of_pattern).collect()
}
