//! The catalogue: physical effects with their columns. An id never changes its meaning.

/// An entry: formula, source, columns, plausible size, what separates it from its class, and its forms. Those of images
/// come with the pixels.
macro_rules! entry {
    ($formula:expr, $source:expr, $covariates:expr, $plausible:expr, $separated_by:expr, $build:expr $(,)?) => {
        Entry {
            formula: $formula,
            source: $source,
            covariates: $covariates,
            plausible: $plausible,
            separated_by: $separated_by,
            forms: super::Forms::Columns($build),
        }
    };
    ($formula:expr, $source:expr, $covariates:expr, $plausible:expr, $separated_by:expr $(,)?) => {
        Entry {
            formula: $formula,
            source: $source,
            covariates: $covariates,
            plausible: $plausible,
            separated_by: $separated_by,
            forms: super::Forms::Pixels,
        }
    };
}

mod frames;
mod phase;
mod point_forms;
mod points;
mod power;
mod traced;
mod wide;

use std::sync::LazyLock;

use retina_formats::{EffectId, TableKind};

use crate::data::{Dataset, Term};

pub(crate) use point_forms::optical_centre_gain;
pub(crate) use traced::{STEADY, depth_mm};
pub(crate) use wide::{later_forms, of_other_lenses, wide};

/// One form of an effect: its shape parameters fixed, linear in its amplitudes.
pub(crate) struct Variant<'a> {
    /// Shape parameters by name.
    pub(crate) shape: Vec<(&'static str, f64)>,
    /// Leading form.
    pub(crate) leading: Vec<Term<'a>>,
    /// What its shape may have beyond the leading form.
    pub(crate) further: Vec<Term<'a>>,
}

impl Variant<'_> {
    /// Whether it is a form of coma that does not depend on the light.
    pub(crate) fn is_steady(&self) -> bool {
        self.shape.iter().any(|(name, _)| *name == STEADY)
    }
}

/// The forms of an effect on a table, or why the table cannot show it.
type Build = for<'a> fn(&'a Dataset) -> Result<Vec<Variant<'a>>, String>;

/// Where an effect's forms come from.
enum Forms {
    /// From the table's columns.
    Columns(Build),
    /// With the pixels.
    Pixels,
}

/// What the catalogue says of an effect.
struct Entry {
    formula: &'static str,
    source: &'static str,
    covariates: &'static [&'static str],
    plausible: &'static str,
    separated_by: Option<(&'static str, &'static str)>,
    forms: Forms,
}

/// A physical effect.
pub struct Effect {
    /// Its id.
    pub id: EffectId,
    /// Effects that one ordinary campaign cannot tell from it, itself included.
    pub class: Vec<EffectId>,
    entry: Entry,
}

impl Effect {
    fn new(id: EffectId) -> Self {
        let entry = match id {
            EffectId::Points(effect) => points::entry(effect),
            EffectId::Power(effect) => power::entry(effect),
            EffectId::Phase(effect) => phase::entry(effect),
            EffectId::Frames(effect) => frames::entry(effect),
        };
        Self { id, class: id.class(), entry }
    }

    /// Its id as text.
    pub fn name(&self) -> &'static str {
        self.id.name()
    }

    /// The table it shows in.
    pub fn kind(&self) -> TableKind {
        self.id.table()
    }

    /// Leading form, in words of the table's columns.
    pub fn formula(&self) -> &'static str {
        self.entry.formula
    }

    /// Where the form comes from.
    pub fn source(&self) -> &'static str {
        self.entry.source
    }

    /// Columns it needs.
    pub fn covariates(&self) -> &'static [&'static str] {
        self.entry.covariates
    }

    /// Plausible size, with its unit.
    pub fn plausible(&self) -> &'static str {
        self.entry.plausible
    }

    /// What separates it from its class: action and value.
    pub fn separated_by(&self) -> Option<(&'static str, &'static str)> {
        self.entry.separated_by
    }

    /// Its forms on these data, or why they cannot show it.
    pub(crate) fn build<'a>(&self, data: &'a Dataset) -> Result<Vec<Variant<'a>>, String> {
        match (&self.entry.forms, self.id) {
            (Forms::Columns(build), _) => build(data),
            (Forms::Pixels, id) => frames::forms(data, id),
        }
    }
}

static CATALOGUE: LazyLock<Vec<Effect>> = LazyLock::new(|| EffectId::all().map(Effect::new).collect());

/// All effects, or those of one table.
pub fn effects(kind: Option<TableKind>) -> Vec<&'static Effect> {
    CATALOGUE.iter().filter(|effect| kind.is_none_or(|kind| effect.kind() == kind)).collect()
}

/// A column that must be there and vary.
pub(super) fn need<'a>(data: &'a Dataset, name: &str) -> Result<&'a [f64], String> {
    match data.covariate(name) {
        None => Err(format!("column `{name}` is missing")),
        Some(c) if !c.varies() => Err(format!("column `{name}` is constant")),
        Some(c) => Ok(&c.values),
    }
}

/// A form without shape parameters.
pub(super) fn plain<'a>(leading: Vec<Term<'a>>) -> Vec<Variant<'a>> {
    vec![Variant { shape: Vec::new(), leading, further: Vec::new() }]
}

/// Whether an effect of the catalogue reads a column of such a table.
pub(crate) fn is_read(kind: TableKind, column: &str) -> bool {
    effects(Some(kind)).iter().any(|effect| effect.covariates().contains(&column))
}

/// Values shifted and scaled to half a range of 1.
pub(crate) fn to_unit(values: &[f64]) -> Vec<f64> {
    let (low, high) =
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    let half = (0.5 * (high - low)).max(f64::MIN_POSITIVE);
    values.iter().map(|v| (v - 0.5 * (low + high)) / half).collect()
}

/// Times between which a step may lie: the middles between the groups' mean times, at most `most` of them.
pub(super) fn step_times(data: &Dataset, time_s: &[f64], most: usize) -> Vec<f64> {
    let mut times: Vec<f64> = data
        .groups
        .iter()
        .map(|group| time_s[group.rows.clone()].iter().sum::<f64>() / group.rows.len() as f64)
        .collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let middles: Vec<f64> = times.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
    // A step before the second or after the last but one exposure is one exposure's own shift.
    let inner = if middles.len() > 6 { &middles[1..middles.len() - 1] } else { &middles[..] };
    let stride = inner.len().div_ceil(most).max(1);
    inner.iter().copied().skip(stride / 2).step_by(stride).collect()
}
