//! Whether the levels of whole groups follow a column that has one value in each group: in a bow, or with a period.
//!
//! Screens see such a column beside the scatter of the groups' levels, which contains what the column explains: a
//! dependence that is nearly all of that scatter is still small beside it, and a sine of several periods is no polynomial.
//! Here the levels are set against the column alone. The statistic is the largest part of the levels' squares that a
//! parabola in the column, or a sine of any phase, explains. Its p-value is that of permutations of the levels among the
//! groups (E. J. G. Pitman, Supplement to the Journal of the Royal Statistical Society 4, 1937), which asks for
//! exchangeable levels: a column that follows time is not looked at where levels follow each other, too.

use glam::DVec2;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;

use crate::catalogue::is_read;
use crate::level::Level;
use crate::linear::Basis;
use crate::score::Frame;
use crate::screens::screened;
use crate::units::in_time;

/// Fewest groups whose levels tell a bow from chance.
const FEWEST_GROUPS: usize = 12;
/// Permutations; the smallest p-value is 1 / (this + 1).
const PERMUTATIONS: usize = 1999;
const SEED: u64 = 5;
/// Periods over the column's range: from this many on, in steps of a half, up to one for every four groups. Ever more of
/// them cost time and are ever less likely.
const FEWEST_PERIODS: f64 = 1.5;
const MOST_PERIODS: f64 = 12.0;
const GROUPS_PER_PERIOD: f64 = 4.0;
/// Correlation with the next group in time from which on a column, or the levels, count as following time.
const FOLLOWS_TIME: f64 = 0.4;

/// A column that the levels follow.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LevelColumn {
    pub(crate) name: String,
    /// Corrected for the number of columns.
    pub(crate) p_value: f64,
}

/// The column that the levels of a frame's errors follow best; `None` where no column has one value a group.
pub(crate) fn level_column(frame: &Frame<'_>) -> Option<LevelColumn> {
    let (data, weights) = (frame.data, &frame.weights);
    if !data.jitters {
        return None;
    }
    let kept: Vec<usize> = in_time(data)
        .into_iter()
        .filter(|&g| weights.level(data, data.groups[g].rows.clone()).counts())
        .collect();
    if kept.len() < FEWEST_GROUPS {
        return None;
    }
    let of_group = |&g: &usize| {
        let level: Level = weights.level(data, data.groups[g].rows.clone());
        level.of(data, weights, &frame.error)
    };
    let mut levels: Vec<DVec2> = kept.iter().map(of_group).collect();
    let mean = levels.iter().sum::<DVec2>() / levels.len() as f64;
    levels.iter_mut().for_each(|level| *level -= mean);
    let wander = following(&levels);
    let columns: Vec<(&str, Vec<f64>)> = screened(data)
        .into_iter()
        .filter(|name| !is_read(data.kind, name))
        .filter_map(|name| {
            let of_groups = data.one_a_group(name)?;
            Some((name, kept.iter().map(|&g| of_groups[g]).collect()))
        })
        .filter(|(_, values): &(&str, Vec<f64>)| {
            let own: Vec<DVec2> = values.iter().map(|v| DVec2::new(*v, 0.0)).collect();
            wander.min(following(&own)) < FOLLOWS_TIME
        })
        .collect();
    let found = columns.iter().map(|(name, values)| (*name, by_permutations(values, &levels)));
    let (name, p) = found.min_by(|a, b| a.1.total_cmp(&b.1))?;
    // Z. Sidak, JASA 62, 1967.
    let p_value = -(columns.len() as f64 * (-p).ln_1p()).exp_m1();
    Some(LevelColumn { name: name.to_owned(), p_value })
}

/// Correlation of values about their mean with the next ones.
fn following(values: &[DVec2]) -> f64 {
    let mean = values.iter().sum::<DVec2>() / values.len() as f64;
    let products: f64 = values.windows(2).map(|pair| (pair[0] - mean).dot(pair[1] - mean)).sum();
    let squares: f64 = values.iter().map(|v| (*v - mean).length_squared()).sum();
    if squares > 0.0 { products / squares } else { 0.0 }
}

/// p-value of the largest part of the levels' squares that any form of the column explains.
fn by_permutations(values: &[f64], levels: &[DVec2]) -> f64 {
    let forms = forms(values);
    let most = |levels: &[DVec2]| {
        let explained = |form: &Vec<Vec<f64>>| -> f64 {
            let along =
                |column: &Vec<f64>| -> DVec2 { column.iter().zip(levels).map(|(c, l)| *c * *l).sum() };
            form.iter().map(|column| along(column).length_squared()).sum()
        };
        forms.iter().map(explained).fold(0.0, f64::max)
    };
    let own = most(levels);
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut shuffled = levels.to_vec();
    let reached = (0..PERMUTATIONS)
        .filter(|_| {
            shuffled.shuffle(&mut random);
            most(&shuffled) >= own * (1.0 - 1e-9)
        })
        .count();
    (1 + reached) as f64 / (1 + PERMUTATIONS) as f64
}

/// Two orthonormal columns for each form, beside a constant: a parabola, and sines of each number of periods.
fn forms(values: &[f64]) -> Vec<Vec<Vec<f64>>> {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let range = values.iter().copied().fold(f64::NEG_INFINITY, f64::max) - low;
    if range <= 0.0 {
        return Vec::new();
    }
    let part: Vec<f64> = values.iter().map(|v| (v - low) / range).collect();
    let most = (values.len() as f64 / GROUPS_PER_PERIOD).min(MOST_PERIODS);
    let periods = (0..).map(|k| FEWEST_PERIODS + 0.5 * f64::from(k)).take_while(|periods| *periods <= most);
    let wave = |periods: f64| -> [Vec<f64>; 2] {
        let angle = |t: &f64| std::f64::consts::TAU * periods * t;
        [part.iter().map(|t| angle(t).sin()).collect(), part.iter().map(|t| angle(t).cos()).collect()]
    };
    let bow = [part.clone(), part.iter().map(|t| t * t).collect()];
    let beside_a_constant = |[a, b]: [Vec<f64>; 2]| Basis::of([vec![1.0; part.len()], a, b]).q.split_off(1);
    std::iter::once(bow).chain(periods.map(wave)).map(beside_a_constant).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_of_five_periods_shows_and_chance_does_not() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut drawn = |size: f64| -> Vec<f64> {
            (0..40).map(|_| size * (rand::RngExt::random::<f64>(&mut random) - 0.5)).collect()
        };
        let (stage, noise) = (drawn(20.0), [drawn(1.0), drawn(1.0)]);
        let chance: Vec<DVec2> = noise[0].iter().zip(&noise[1]).map(|(x, y)| DVec2::new(*x, *y)).collect();
        let wave = |v: &f64| DVec2::from((std::f64::consts::TAU * v / 4.0).sin_cos());
        let swung: Vec<DVec2> = stage.iter().zip(&chance).map(|(v, noise)| wave(v) + 0.6 * *noise).collect();
        assert!(by_permutations(&stage, &swung) < 0.001);
        assert!(by_permutations(&stage, &chance) > 0.02);
    }
}
