//! Whether what an effect of time or temperature explains follows another column of the table more closely.
//!
//! A mount that swells with the humidity moves whole exposures. A knock, a drift or a mount that warms up does so too, and
//! one of them always fits best. But the table has the humidity. If a displacement in proportion to it predicts exposures
//! that were left out clearly better, the effect is not what happened.

use std::f64::consts::PI;

use rayon::prelude::*;
use retina_formats::{EffectId, PointsEffect};

use crate::catalogue::{Effect, is_read, to_unit};
use crate::data::Dataset;
use crate::patterns::{LINEAR, PATTERNS, Pattern, TILTS, products};
use crate::score::{Frame, HeldOut};
use crate::screens::screened;

/// Columns whose effects are asked.
const CONDITIONS: [&str; 2] = ["time_s", "temperature_c"];
/// A displacement depends on another column by a polynomial of this degree, and on time, where a step is asked, by this.
const DEGREE: i32 = 2;
const DEGREE_OF_TIME: i32 = 5;
/// Half periods of the fastest swing in time that a step is held against, and exposures that each of them takes.
const HALF_PERIODS: usize = 6;
const EXPOSURES_EACH: usize = 3;
/// Standard errors of the held-out error by which another column has to be better before an effect is not named.
const CLEARLY: f64 = 2.5;
/// And before one of both cannot be told.
const ALIKE: f64 = 1.0;
/// Parts of a displacement that is the same for all points of an exposure but for rounding.
const ROUNDING: f64 = 1e-9;

/// A column that what an effect explains follows.
pub(crate) struct Follows {
    /// Its name.
    pub(crate) column: String,
    /// Standard errors by which it is better on what is left out.
    pub(crate) sigmas: f64,
}

impl Follows {
    /// The column that one of an effect's forms, the `variant`, is beaten by most. Its held-out errors are `own`.
    pub(crate) fn find(
        frame: &Frame<'_>,
        effect: &Effect,
        forms: &[Vec<Vec<f64>>],
        variant: usize,
        own: &HeldOut,
    ) -> Option<Self> {
        let columns = &forms[variant];
        let data = frame.data;
        if data.pixels().is_some() || !effect.covariates().iter().all(|name| CONDITIONS.contains(name)) {
            return None;
        }
        let patterns: Vec<Pattern> =
            columns.iter().map(|column| pattern(data, column)).collect::<Option<_>>()?;
        let others =
            screened(data).into_iter().filter(|name| !is_read(data.kind, name) && steady(data, name));
        let of_own = |name: &str, degree: i32| {
            let columns = products(data, &patterns, &powers(data, name, degree));
            Self { column: name.to_owned(), sigmas: own.beaten_by(&frame.held_out(&columns)) }
        };
        let step = effect.id == EffectId::Points(PointsEffect::Knock);
        let of_points = data.components() == 2;
        let mut found: Vec<Self> = if step { vec![of_own("time_s", DEGREE_OF_TIME)] } else { Vec::new() };
        if step && of_points {
            found.extend(Self::a_swing(frame, forms, own));
        }
        for name in others {
            found.push(of_own(name, DEGREE));
            if of_points {
                let whole = products(data, &[&LINEAR[..], &patterns].concat(), &powers(data, name, DEGREE));
                found.extend(Self::with_all_of_the_field(frame, whole, columns, name, own));
            }
        }
        found.into_iter().filter(|found| found.sigmas > ALIKE).max_by(|a, b| a.sigmas.total_cmp(&b.sigmas))
    }

    /// Something may swing in time instead of stepping: a shift, what is linear in the place, or a keystone. It counts only
    /// where no step at any time lowers the held-out error beside it.
    fn a_swing(frame: &Frame<'_>, steps: &[Vec<Vec<f64>>], own: &HeldOut) -> Option<Self> {
        let data = frame.data;
        let swinging = frame.with(&products(data, &[&LINEAR[..], &TILTS[..]].concat(), &swings(data)));
        let held_out = swinging.held_out(&[]);
        let sigmas = own.beaten_by(&held_out);
        if sigmas <= CLEARLY {
            return None;
        }
        let deviate = |columns: &Vec<Vec<f64>>| swinging.score(columns).deviate();
        let deviates: Vec<f64> = steps.par_iter().map(deviate).collect();
        let best = (0..steps.len()).max_by(|&a, &b| deviates[a].total_cmp(&deviates[b]))?;
        // The best of many steps: by chance it may be a little better.
        let beside = held_out.beaten_by(&swinging.held_out(&steps[best]));
        (beside <= CLEARLY).then(|| Self { column: "time_s".to_owned(), sigmas })
    }

    /// The effect of a column may change over the field. Then several effects of the catalogue each fit a part of it. So the
    /// `whole` of it is tried: displacements over the field times functions of the column. It counts only where the
    /// catalogue's effect does not lower the held-out error beside it.
    fn with_all_of_the_field(
        frame: &Frame<'_>,
        mut whole: Vec<Vec<f64>>,
        columns: &[Vec<f64>],
        name: &str,
        own: &HeldOut,
    ) -> Option<Self> {
        let held_out = frame.held_out(&whole);
        let sigmas = own.beaten_by(&held_out);
        whole.extend(columns.iter().cloned());
        let beside = held_out.beaten_by(&frame.held_out(&whole));
        (sigmas > CLEARLY && beside <= ALIKE).then(|| Self { column: name.to_owned(), sigmas })
    }

    /// Why an effect was not named.
    pub(crate) fn in_place_of(&self, effect: &str) -> String {
        format!(
            "{effect} is not named: what it would explain follows `{}` more closely, by {:.1} standard errors of the held-out error",
            self.column, self.sigmas
        )
    }

    /// Why an effect that was named is not the only one.
    pub(crate) fn as_well_as(&self, effect: &str) -> String {
        format!(
            "{effect}: what it explains follows `{}` as closely; these data do not tell which of the two is behind it. Change one of them alone",
            self.column
        )
    }

    /// Whether the effect is not what happened; else one of both cannot be told.
    pub(crate) fn clearly(&self) -> bool {
        self.sigmas > CLEARLY
    }
}

/// The powers of a column, from the first on.
fn powers(data: &Dataset, name: &str, degree: i32) -> Vec<Vec<f64>> {
    let values = to_unit(data.values(name));
    (1..=degree).map(|power| values.iter().map(|v| v.powi(power)).collect()).collect()
}

/// A constant (a swing need not have a mean of nothing), time, and cosines of it whose slope is nothing at its ends.
fn swings(data: &Dataset) -> Vec<Vec<f64>> {
    let time = to_unit(data.values("time_s"));
    let count = HALF_PERIODS.min(data.groups.len() / EXPOSURES_EACH);
    let cosine = |k: usize| time.iter().map(|t| (k as f64 * PI * (t + 1.0) / 2.0).cos()).collect();
    [vec![1.0; time.len()], time.clone()].into_iter().chain((1..=count).map(cosine)).collect()
}

/// The displacement that a column is, in each exposure times a number.
fn pattern(data: &Dataset, column: &[f64]) -> Option<Pattern> {
    if data.components() == 1 {
        return Some(PATTERNS[0]);
    }
    let largest = column.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    PATTERNS.into_iter().find(|pattern| {
        data.groups.iter().all(|group| {
            let (mut product, mut square) = (0.0, 0.0);
            for row in group.rows.clone() {
                let [u, v] = pattern(data, row);
                product += u * column[2 * row] + v * column[2 * row + 1];
                square += u * u + v * v;
            }
            let size = if square > 0.0 { product / square } else { 0.0 };
            group.rows.clone().all(|row| {
                let [u, v] = pattern(data, row);
                (column[2 * row] - size * u).abs().max((column[2 * row + 1] - size * v).abs())
                    <= ROUNDING * largest
            })
        })
    })
}

/// Whether a column is known everywhere and, of points, the same for all of an exposure.
fn steady(data: &Dataset, name: &str) -> bool {
    let known = data.values(name).iter().all(|v| v.is_finite());
    known && (data.components() == 1 || data.one_a_group(name).is_some())
}
