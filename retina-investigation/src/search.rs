//! The search: forms of growing complexity, the best of which are varied and refined.

use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use retina_diagnosis::{Halves, LeftOut, Part, Remainder};
use retina_formats::TableKind;

use crate::columns::{Column, Content, PIXEL, Table};
use crate::direction::Direction;
use crate::form::{Factor, Family, Form};
use crate::law::Law;

/// Families that are varied in a generation.
const BEAM: usize = 8;
/// Families that are refined in a generation.
const REFINED: usize = 24;
/// Generations after the first.
const GENERATIONS: usize = 3;
/// Most laws in a form.
const MOST_LAWS: usize = 2;
/// Most amplitudes of a form.
const MOST_AMPLITUDES: usize = 8;
/// Parts of a column in which a direction has amplitudes of its own.
const BINS: usize = 6;
/// Directions with a column that changes them whose laws are tried.
const MODULATED: usize = 6;
/// Forms that are scored at a time, so that their columns stay in memory.
const BATCH: usize = 64;

/// A form that the search has looked at.
#[derive(Clone)]
pub(crate) struct Scored {
    pub(crate) form: Form,
    /// What it takes off the sum of squares, less what as many columns and shapes take off noise.
    pub(crate) merit: f64,
    /// What it takes off the sum of squares.
    pub(crate) statistic: f64,
    pub(crate) amplitudes: Vec<f64>,
}

/// What was found: families with their best shapes, best first.
pub(crate) struct Found {
    pub(crate) scored: Vec<Scored>,
    /// Forms that were tried.
    pub(crate) tried: usize,
}

/// What a search works on.
pub(crate) struct Search<'a> {
    pub(crate) kind: TableKind,
    pub(crate) columns: &'a [Column],
    /// The rows in which forms are looked for.
    pub(crate) part: Part,
    pub(crate) table: &'a Table,
    pub(crate) tried: AtomicUsize,
    pub(crate) progress: &'a (dyn Fn(&str, f64) + Sync),
}

impl Search<'_> {
    /// Looks for forms of what is left: among all of them, or among those that come near to `near`.
    pub(crate) fn run(&self, halves: &Halves, near: Option<Vec<Form>>) -> Found {
        let mut best: HashMap<Family, Scored> = HashMap::new();
        let mut seen: HashSet<String> = HashSet::new();
        let mut grown: HashSet<Family> = HashSet::new();
        let mut weights: Vec<Vec<f64>> = Vec::new();
        let everywhere = near.is_none();
        let mut forms = near.unwrap_or_else(|| self.first());
        for generation in 0..=GENERATIONS {
            (self.progress)("searching", generation as f64 / (GENERATIONS + 1) as f64);
            let left = halves.left_unrejected(self.part, &weights);
            // What was scored under other weights is scored again.
            let before: Vec<Form> = best.drain().map(|(_, scored)| scored.form).collect();
            forms.retain(|form| seen.insert(format!("{form:?}")));
            let all = before.into_iter().chain(forms).collect::<Vec<_>>();
            for scored in self.scored(&left, all) {
                keep(&mut best, scored);
            }
            let mut promising = leading(&best, REFINED);
            if generation == 0 {
                // A confined or wavy field scores little until it is where the data want it.
                promising.extend(self.shaped().iter().filter_map(|d| best.get(&(*d, Vec::new())).cloned()));
            }
            for scored in self.refined(&left, promising) {
                keep(&mut best, scored);
            }
            let top = leading(&best, BEAM);
            // Noise, outliers and the groups' levels once more, without what the best form explains.
            weights = top.first().map_or_else(Vec::new, |s| s.form.evaluate(self.table, self.columns));
            forms = top
                .iter()
                .filter(|scored| grown.insert(scored.form.family()))
                .flat_map(|scored| self.neighbours(&scored.form))
                .collect();
            if generation == 0 && everywhere {
                forms.extend(self.modulated(&left));
            }
            if forms.is_empty() {
                break;
            }
        }
        let left = halves.left(self.part, &weights);
        let mut all: Vec<Form> = leading(&best, REFINED).into_iter().map(|scored| scored.form).collect();
        for simpler in all.first().map_or_else(Vec::new, without_one_law) {
            if self.possible(&simpler) && !all.iter().any(|form| form.family() == simpler.family()) {
                all.push(simpler);
            }
        }
        let again = self.scored(&left, all);
        let mut scored = self.refined(&left, again);
        sort(&mut scored);
        Found { scored, tried: self.tried.load(Ordering::Relaxed) }
    }

    /// Forms of one direction and at most one law, and the products of two columns.
    fn first(&self) -> Vec<Form> {
        let mut out = Vec::new();
        let points = self.kind == TableKind::Points;
        let directions: &[Direction] = if points { &Direction::FIRST } else { &[Direction::Value] };
        if points {
            out.extend(Direction::PLAIN.into_iter().flat_map(|d| without_laws(d, d.starts())));
        }
        out.extend(self.shaped().iter().flat_map(|d| without_laws(*d, d.close_starts())));
        for &direction in directions {
            for factor in self.factors() {
                out.push(Form { direction, place: Vec::new(), factors: vec![factor] });
            }
            for a in 0..self.columns.len() {
                for b in 0..a {
                    out.extend(self.product(direction, a, b));
                }
            }
        }
        out.retain(|form| self.possible(form));
        out
    }

    /// Directions that are confined or wavy; those of images need the pixels' places.
    fn shaped(&self) -> &'static [Direction] {
        let placed = PIXEL.iter().all(|&name| self.columns.iter().any(|column| column.name == name));
        match self.kind == TableKind::Frames && !placed {
            true => &[],
            false => Direction::shaped(self.kind),
        }
    }

    /// Every law of every column at each shape that a search begins at.
    fn factors(&self) -> Vec<Factor> {
        (0..self.columns.len()).flat_map(|column| self.factors_of(column)).collect()
    }

    fn factors_of(&self, column: usize) -> Vec<Factor> {
        Law::ALL
            .iter()
            .flat_map(|&law| {
                law.starts(&self.columns[column]).into_iter().map(move |shape| Factor { column, law, shape })
            })
            .collect()
    }

    /// Laws of a column, of what it follows, and of all that follows the same.
    fn factors_of_source(&self, column: usize) -> Vec<Factor> {
        let source = self.columns[column].source();
        let alike = |&other: &usize| self.columns[other].source() == source;
        (0..self.columns.len()).filter(alike).flat_map(|column| self.factors_of(column)).collect()
    }

    /// Straight lines in two columns multiplied, each about its middle: what no law of one of them shows.
    fn product(&self, direction: Direction, a: usize, b: usize) -> Option<Form> {
        let factor = |column: usize| {
            let of = &self.columns[column];
            match of.content {
                Content::Phase | Content::Lagged => None,
                Content::Switch => Some(Factor { column, law: Law::Linear, shape: Vec::new() }),
                _ => Some(Factor { column, law: Law::Linear, shape: vec![of.middle()] }),
            }
        };
        Some(Form { direction, place: Vec::new(), factors: vec![factor(a)?, factor(b)?] })
    }

    /// Laws of columns times those confined or wavy directions whose amplitude changes most with the column, whatever the
    /// law: a wave that swings about zero shows in no form without a law.
    fn modulated(&self, left: &Remainder<'_>) -> Vec<Form> {
        // What lags has its source's parts, nearly.
        let columns: Vec<usize> =
            (0..self.columns.len()).filter(|&k| self.columns[k].content != Content::Lagged).collect();
        let bins: Vec<Vec<usize>> = columns.iter().map(|&column| self.bins(column)).collect();
        let charge = left.components().ln();
        let mut all: Vec<(f64, usize, Form)> = self
            .shaped()
            .iter()
            .flat_map(|d| without_laws(*d, d.starts()))
            .collect::<Vec<_>>()
            .into_par_iter()
            .flat_map_iter(|form| {
                let binned: Vec<Vec<Vec<f64>>> = bins.iter().map(|bins| self.binned(&form, bins)).collect();
                left.scores(&binned)
                    .into_iter()
                    .zip(columns.iter().copied())
                    .map(|(score, column)| (column, score))
                    .map(|(column, score)| {
                        (score.statistic - charge * score.rank as f64, column, form.clone())
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        self.tried.fetch_add(all.len(), Ordering::Relaxed);
        all.retain(|(merit, ..)| *merit > 0.0);
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        all.truncate(MODULATED);
        let of = |(_, column, form): (f64, usize, Form)| {
            self.factors_of_source(column)
                .into_iter()
                .map(move |factor| Form { factors: vec![factor], ..form.clone() })
        };
        all.into_iter().flat_map(of).filter(|form| self.possible(form)).collect()
    }

    /// For each row the part of a column's sorted values that it is in.
    fn bins(&self, column: usize) -> Vec<usize> {
        let values = self.table.column(column);
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let limits: Vec<f64> = (1..BINS).map(|k| sorted[k * sorted.len() / BINS]).collect();
        values.iter().map(|value| limits.partition_point(|limit| limit <= value)).collect()
    }

    /// A form's columns, one for each part of the rows.
    fn binned(&self, form: &Form, bins: &[usize]) -> Vec<Vec<f64>> {
        let whole = form.evaluate(self.table, self.columns);
        let n = self.table.components;
        let part = |column: &[f64], bin: usize| -> Vec<f64> {
            column.iter().enumerate().map(|(k, v)| if bins[k / n] == bin { *v } else { 0.0 }).collect()
        };
        (0..BINS).flat_map(|bin| whole.iter().map(move |column| part(column, bin))).collect()
    }

    /// Forms that differ in the direction, in a law, by a law more or by one less.
    fn neighbours(&self, form: &Form) -> Vec<Form> {
        let mut out = Vec::new();
        let plain = if self.kind == TableKind::Points { &Direction::PLAIN[..] } else { &[Direction::Value] };
        for &direction in plain {
            out.push(Form { direction, place: Vec::new(), factors: form.factors.clone() });
        }
        if !form.factors.is_empty() {
            for &direction in self.shaped() {
                let of = |place| Form { direction, place, factors: form.factors.clone() };
                out.extend(direction.starts().into_iter().map(of));
            }
        }
        if let Some((direction, place)) = form.direction.twin(&form.place) {
            out.push(Form { direction, place, factors: form.factors.clone() });
        }
        for k in 0..form.factors.len() {
            for factor in self.factors_of_source(form.factors[k].column) {
                let mut other = form.clone();
                other.factors[k] = factor;
                out.push(other);
            }
        }
        out.extend(without_one_law(form));
        if form.factors.len() < MOST_LAWS {
            for factor in self.factors() {
                let mut more = form.clone();
                more.factors.push(factor);
                out.push(more);
            }
        }
        out.retain(|form| self.possible(form));
        out
    }

    /// Whether a form says something: not too much, and not one thing twice.
    fn possible(&self, form: &Form) -> bool {
        let named = |name: &str| form.factors.iter().any(|f| self.columns[f.column].name == name);
        let turns = form.direction != Direction::FixedInCamera
            || self.table.roll_rad.iter().any(|roll| (roll - self.table.roll_rad[0]).abs() > 1e-6);
        let nothing = form.direction == Direction::Value && form.factors.is_empty();
        // r is in x and y already, and the logarithm of the light in the light.
        let twice = form.factors.len() == 2
            && (self.columns[form.factors[0].column].source()
                == self.columns[form.factors[1].column].source()
                || (named("r") && (named("x") || named("y"))));
        form.width() <= MOST_AMPLITUDES && turns && !nothing && !twice && form.allowed(self.columns)
    }

    pub(crate) fn scored(&self, left: &Remainder<'_>, forms: Vec<Form>) -> Vec<Scored> {
        self.tried.fetch_add(forms.len(), Ordering::Relaxed);
        // Of as many laws the best takes off as much by chance.
        let choices: usize = (0..self.columns.len()).map(|column| self.factors_of(column).len()).sum();
        let charge_of_law = 2.0 * (choices.max(1) as f64).ln();
        forms
            .par_chunks(BATCH)
            .flat_map_iter(|batch| {
                let columns: Vec<Vec<Vec<f64>>> =
                    batch.iter().map(|form| finite(form.evaluate(self.table, self.columns))).collect();
                let scores = left.scores(&columns);
                batch
                    .iter()
                    .zip(scores)
                    .filter(|(_, score)| score.rank > 0)
                    .map(|(form, score)| Scored {
                        form: form.clone(),
                        merit: score.merit()
                            - score.values.ln() * form.free_shapes() as f64
                            - charge_of_law * form.factors.len() as f64,
                        statistic: score.statistic,
                        amplitudes: score.amplitudes,
                    })
                    .collect::<Vec<_>>()
            })
            .collect()
    }

    /// Forms under other weights, or on other rows, with their shapes moved to where these want them: the best of each family.
    pub(crate) fn refined_anew(&self, left: &Remainder<'_>, forms: Vec<Form>) -> Vec<Scored> {
        let mut out = self.refined(left, self.scored(left, forms));
        sort(&mut out);
        let mut families = HashSet::new();
        out.retain(|scored| families.insert(scored.form.family()));
        out
    }
}

/// Forms of a direction alone, one for each place.
fn without_laws(direction: Direction, places: Vec<Vec<f64>>) -> Vec<Form> {
    places.into_iter().map(|place| Form { direction, place, factors: Vec::new() }).collect()
}

/// A form with one law less, each of its laws in turn.
fn without_one_law(form: &Form) -> Vec<Form> {
    let less = |k| {
        let mut less = form.clone();
        less.factors.remove(k);
        less
    };
    (0..form.factors.len()).map(less).collect()
}

/// Largest value of a column that lies beside all rows, but for its skirts.
const SKIRTS: f64 = 1e-4;

/// Columns without what is no number, and without those whose laws have no row where they are large: such columns explain
/// nothing.
pub(crate) fn finite(mut columns: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    for column in &mut columns {
        let largest = column.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        if largest < SKIRTS || column.iter().any(|value| !value.is_finite()) {
            column.fill(0.0);
        }
    }
    columns
}

fn keep(best: &mut HashMap<Family, Scored>, scored: Scored) {
    match best.get_mut(&scored.form.family()) {
        Some(known) if known.merit >= scored.merit => {}
        Some(known) => *known = scored,
        None => {
            best.insert(scored.form.family(), scored);
        }
    }
}

/// Best first; equals in the order of their families, so that the same seed gives the same answer.
fn sort(scored: &mut [Scored]) {
    scored.sort_by(|a, b| b.merit.total_cmp(&a.merit).then_with(|| a.form.family().cmp(&b.form.family())));
}

fn leading(best: &HashMap<Family, Scored>, count: usize) -> Vec<Scored> {
    let mut all: Vec<Scored> = best.values().cloned().collect();
    sort(&mut all);
    all.truncate(count);
    all
}

/// Part of a formula's rms below which something more is as likely what its laws lack: no form is known to be better.
pub(crate) const WEAK: f64 = 0.15;

/// The simplest form whose error on units left out is within a standard error of that of the first (L. Breiman et al.,
/// Classification and Regression Trees, 1984, sec. 3.4.3), which has the most merit; with all those errors. A form with
/// fewer laws is also taken where all else is weak.
pub(crate) fn simplest(
    left: &Remainder<'_>,
    search: &Search<'_>,
    found: &[Scored],
) -> Option<(usize, Vec<LeftOut>)> {
    let errors: Vec<LeftOut> = found
        .par_iter()
        .map(|scored| left.left_out(&finite(scored.form.evaluate(search.table, search.columns))))
        .collect();
    let first = errors.first()?;
    let before = left.left_out(&[]).total();
    let nearly = |k: usize| {
        let explained = |errors: &LeftOut| before - errors.total();
        found[k].form.factors.len() < found[0].form.factors.len()
            && explained(&errors[k]) >= (1.0 - WEAK * WEAK) * explained(first)
    };
    let simplest = (0..errors.len())
        .filter(|&k| errors[k].beaten_by(first) <= 1.0 || nearly(k))
        .min_by_key(|&k| (found[k].form.complexity(), k))?;
    Some((simplest, errors))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bump of a hundredth of a row's distance has 1e-16 there, and any amplitude.
    #[test]
    fn laws_that_are_large_beside_the_rows_explain_nothing() {
        let columns = vec![vec![1e-16, 3e-7], vec![0.0, 0.2], vec![f64::NAN, 1.0]];
        assert_eq!(finite(columns), [[0.0, 0.0], [0.0, 0.2], [0.0, 0.0]]);
    }
}
