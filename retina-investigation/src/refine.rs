//! Shapes of forms, moved to where the data want them.
//!
//! Amplitudes are linear, shapes are not. With c_j the columns of a form, a_j their amplitudes and s_k its shapes, the
//! columns sum_j a_j dc_j/ds_k are fitted beside c_j: their amplitudes are a Gauss-Newton step (G. H. Golub, V. Pereyra,
//! SIAM Journal on Numerical Analysis 10, 1973; L. Kaufman, BIT 15, 1975). Such steps find the nearest best place.
//! Larger moves of one shape at a time find others, and the places of laws that have no derivative.

use rayon::prelude::*;
use retina_diagnosis::Remainder;

use crate::form::Form;
use crate::law::Move;
use crate::rivals::sum;
use crate::search::{Scored, Search, finite};

/// Gauss-Newton steps at most, one after the other.
const STEPS: usize = 8;
/// Growth of the merit that is worth a step.
const ENOUGH: f64 = 0.01;
/// Part of a move over which a derivative is taken.
const DIFFERENCE: f64 = 1e-3;
/// Longest step, in moves.
const LONGEST: f64 = 2.0;
/// Parts of a step that are tried.
const PARTS: [f64; 3] = [1.0, 0.5, 0.2];
/// How often moves are divided by 4.
const DIVISIONS: i32 = 3;
/// Turns at most.
const TURNS: usize = 40;

impl Move {
    /// A shape parameter moved by a part of this.
    fn by(self, value: f64, part: f64) -> f64 {
        match self {
            Self::By(step) => value + part * step,
            Self::Times(factor) => value * factor.powf(part),
        }
    }
}

impl Search<'_> {
    /// Moves the shapes of forms as long as their merit grows.
    pub(crate) fn refined(&self, left: &Remainder<'_>, forms: Vec<Scored>) -> Vec<Scored> {
        forms.into_par_iter().map(|scored| self.refine(left, scored)).collect()
    }

    fn refine(&self, left: &Remainder<'_>, mut best: Scored) -> Scored {
        let moves = best.form.moves(self.columns);
        if moves.iter().all(Option::is_none) {
            return best;
        }
        let mut divisions = 0;
        for _ in 0..TURNS {
            best = self.descended(left, best, &moves);
            let size = 0.25_f64.powi(divisions);
            let along = |k: usize| {
                let mut part = vec![0.0; moves.len()];
                part[k] = size;
                part
            };
            let parts: Vec<Vec<f64>> = (0..moves.len())
                .filter(|&k| moves[k].is_some())
                .flat_map(|k| [along(k), along(k).iter().map(|part| -part).collect()])
                .collect();
            match self.better(left, &best, &moves, &parts, 1e-9 * best.merit.abs()) {
                Some(moved) => best = moved,
                None if divisions == DIVISIONS => break,
                None => divisions += 1,
            }
        }
        best
    }

    /// Gauss-Newton steps.
    fn descended(&self, left: &Remainder<'_>, mut best: Scored, moves: &[Option<Move>]) -> Scored {
        for _ in 0..STEPS {
            let Some(step) = self.step(left, &best, moves) else { break };
            let parts = PARTS.map(|part| step.iter().map(|s| part * s).collect());
            match self.better(left, &best, moves, &parts, ENOUGH) {
                Some(next) => best = next,
                None => break,
            }
        }
        best
    }

    /// A Gauss-Newton step of all shapes, in moves; none where there is nothing to gain.
    fn step(&self, left: &Remainder<'_>, from: &Scored, moves: &[Option<Move>]) -> Option<Vec<f64>> {
        let evaluated = |form: &Form| finite(form.evaluate(self.table, self.columns));
        let mut columns = evaluated(&from.form);
        let own = columns.len();
        let here = sum(&columns, from.amplitudes.iter().copied());
        let mut part = vec![0.0; moves.len()];
        for k in 0..moves.len() {
            // Backwards where forwards is not allowed.
            let slope = [DIFFERENCE, -DIFFERENCE].into_iter().find_map(|by| {
                part[k] = by;
                let moved = self.moved(&from.form, moves, &part)?;
                let there = sum(&evaluated(&moved), from.amplitudes.iter().copied());
                Some(there.iter().zip(&here).map(|(there, here)| (there - here) / by).collect::<Vec<f64>>())
            });
            part[k] = 0.0;
            columns.push(slope.unwrap_or_else(|| vec![0.0; here.len()]));
        }
        let with = left.scores(&[columns]).pop()?;
        if with.statistic - from.statistic < ENOUGH {
            return None;
        }
        let step = &with.amplitudes[own..];
        let longest = step.iter().fold(0.0_f64, |longest, s| longest.max(s.abs()));
        Some(step.iter().map(|s| s * (LONGEST / longest).min(1.0)).collect())
    }

    /// The best form that is reached by one of some moves, if its merit is larger by more than `enough`.
    fn better(
        &self,
        left: &Remainder<'_>,
        from: &Scored,
        moves: &[Option<Move>],
        parts: &[Vec<f64>],
        enough: f64,
    ) -> Option<Scored> {
        let trials = parts.iter().filter_map(|part| self.moved(&from.form, moves, part)).collect();
        let best = self.scored(left, trials).into_iter().max_by(|a, b| a.merit.total_cmp(&b.merit))?;
        (best.merit > from.merit + enough).then_some(best)
    }

    /// A form with all its shapes moved, each by a part of its move; none where the columns cannot show it.
    fn moved(&self, form: &Form, moves: &[Option<Move>], parts: &[f64]) -> Option<Form> {
        let of = |((value, step), part): ((f64, &Option<Move>), &f64)| match step {
            Some(step) if *part != 0.0 => step.by(value, *part),
            _ => value,
        };
        let shape: Vec<f64> = form.shape().into_iter().zip(moves).zip(parts).map(of).collect();
        Some(form.with_shape(&shape)).filter(|moved| moved.allowed(self.columns))
    }
}
