//! What a form gains where the scatter of groups is found anew.
//!
//! The scatter of groups is estimated from their levels. While a model lacks a form, that scatter contains what the form
//! would explain. A form of the levels then takes off at most one square a level, however well it fits, and a search
//! among twelve series prefers the simplest form. So the scatter is taken as what the form leaves of it. With S the squares
//! of the n whitened levels and S' what is left of them, the gain is n ln(S / S'). Below the noise of the rows, whose size
//! is known, it grows in proportion to the squares. Squares within groups count as they are.

use faer::{Mat, MatRef};
use glam::DVec2;

use crate::level::Level;
use crate::linear::dot;
use crate::score::Frame;

/// A form's score beside a model.
#[derive(Debug, Clone, PartialEq)]
pub struct FormScore {
    /// By how much it lowers the sum of whitened squares.
    pub statistic: f64,
    /// The same, with the scatter of groups anew: twice the logarithm of the likelihood ratio.
    pub gain: f64,
    /// Number of values that tell its amplitudes: n of the levels, N of all rows, and n^s N^(1 - s) where the levels have a
    /// share s of the form's squares.
    pub values: f64,
    /// Amplitudes of its columns; 0 of those that the model, or the columns before them, have already.
    pub amplitudes: Vec<f64>,
    /// Number of the others.
    pub rank: usize,
}

impl FormScore {
    /// What it takes off the squares less what its amplitudes cost, by the Bayesian information criterion.
    pub fn merit(&self) -> f64 {
        self.gain - self.values.ln() * self.rank as f64
    }
}

/// The levels of the groups as a model leaves them.
pub(crate) struct LevelsLeft {
    /// None where groups do not scatter: tiles of an image, settings of a meter that is told as averages.
    levels: Vec<(Level, DVec2)>,
    /// Their number, each component counted.
    count: f64,
    /// Sum of their squares.
    square: f64,
    /// What that would be if groups did not scatter.
    least: f64,
}

impl LevelsLeft {
    pub(crate) fn of(frame: &Frame<'_>) -> Self {
        let (data, weights) = (frame.data, &frame.weights);
        let levels: Vec<(Level, DVec2)> = data
            .groups
            .iter()
            .filter(|_| data.jitters)
            .map(|group| weights.level(data, group.rows.clone()))
            .filter(Level::counts)
            .map(|level| {
                let left = level.of(data, weights, &frame.error);
                (level, left)
            })
            .collect();
        let n = data.components();
        Self {
            count: (levels.len() * n) as f64,
            square: levels.iter().map(|(_, left)| left.length_squared()).sum(),
            least: levels.iter().map(|(level, _)| level.variance_of_rows(n)).sum(),
            levels,
        }
    }

    /// The score of whitened columns beside the base, those of them that are kept, with L^-1 of their products L L^T.
    pub(crate) fn score(
        &self,
        frame: &Frame<'_>,
        columns: MatRef<'_, f64>,
        kept: &[usize],
        inverse: &Mat<f64>,
    ) -> FormScore {
        let values = |column: usize| {
            columns.col(column).try_as_col_major().map_or(&[][..], |column| column.as_slice())
        };
        let products: Vec<f64> = kept.iter().map(|&column| dot(values(column), &frame.error)).collect();
        let along: Vec<f64> =
            (0..kept.len()).map(|i| (0..=i).map(|k| inverse[(i, k)] * products[k]).sum()).collect();
        let statistic: f64 = along.iter().map(|along| along * along).sum();
        let mut amplitudes = vec![0.0; columns.ncols()];
        for (k, &column) in kept.iter().enumerate() {
            amplitudes[column] = (k..kept.len()).map(|i| inverse[(i, k)] * along[i]).sum();
        }
        let (mut of_levels, mut left) = (0.0, 0.0);
        if !self.levels.is_empty() {
            let mut explained = vec![0.0; frame.error.len()];
            for &column in kept {
                let amplitude = amplitudes[column];
                explained.iter_mut().zip(values(column)).for_each(|(sum, value)| *sum += amplitude * value);
            }
            for (level, error) in &self.levels {
                let own = level.of(frame.data, &frame.weights, &explained);
                of_levels += own.length_squared();
                left += (*error - own).length_squared();
            }
        }
        // What is explained is orthogonal to what is left, so its square is the score.
        let share = (of_levels / statistic.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let values = share * self.count.max(2.0).ln() + (1.0 - share) * frame.components().max(2.0).ln();
        FormScore {
            statistic,
            amplitudes,
            rank: kept.len(),
            gain: self.of_levels(left) + statistic - (self.square - left),
            values: values.exp(),
        }
    }

    /// The gain of what is left of the squares of the levels.
    fn of_levels(&self, left: f64) -> f64 {
        let floor = self.least.min(self.square).max(f64::MIN_POSITIVE);
        let beyond =
            |square: f64| self.count * ((square.max(floor) / floor).ln() + (square.min(floor) / floor));
        beyond(self.square) - beyond(left)
    }
}
