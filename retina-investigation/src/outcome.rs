//! What an investigation says.

use retina_diagnosis::{AddedEffect, Fit, Noise, Proof, effects};

use crate::investigate::LEVEL;
use crate::words::Words;

/// A formula as a user's effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Formula {
    /// Its name.
    pub name: String,
    /// The text of a TOML file.
    pub effect: String,
    /// Columns it depends on.
    pub columns: Vec<String>,
    /// How much there is to say: amplitudes, places and laws.
    pub complexity: usize,
    /// Error of units left out, per component in the table's unit.
    pub heldout_rms: f64,
    /// The known effect that stands for it in the model.
    pub known: Option<&'static str>,
}

/// A formula that the data cannot tell from the one that is given.
#[derive(Debug, Clone)]
pub struct Rival {
    /// As a user's effect: the text of a TOML file.
    pub effect: String,
    /// Columns it depends on.
    pub covariates: Vec<String>,
    /// How much there is to say: amplitudes, places and laws.
    pub complexity: usize,
    /// Error of units left out, per component in the table's unit.
    pub heldout_rms: f64,
    /// Rms of the difference of the two over the table's rows, in the table's unit.
    pub difference_rms: f64,
    /// The row where they differ most: its columns, and the difference.
    pub differs_at: Vec<(String, f64)>,
    /// The difference there, in the table's unit.
    pub differs_by: f64,
    /// By how many standard errors the given one is better on units left out.
    pub beaten_by: f64,
}

/// A formula that was found and proven.
#[derive(Debug, Clone)]
pub struct Term {
    /// Its name.
    pub name: String,
    /// As a user's effect, the text of a TOML file: `--effect FILE` takes it.
    pub effect: String,
    /// Columns it depends on.
    pub covariates: Vec<String>,
    /// How much there is to say: amplitudes, places and laws.
    pub complexity: usize,
    /// Error of units left out, per component in the table's unit.
    pub heldout_rms: f64,
    /// What the half says that the search has not seen.
    pub proof: Proof,
    /// Rms of what it adds, per component in the table's unit, beside the model.
    pub rms: f64,
    /// A formula that was found before and is so much stronger that this one may be only what its laws lack.
    pub weak_beside: Option<String>,
    /// Formulas that the data cannot tell from it, simplest first.
    pub rivals: Vec<Rival>,
    /// Catalogued effects that are nearly the same here, with the share of its square that they hold.
    pub alike: Vec<(&'static str, f64)>,
    /// What it says in words.
    pub words: Words,
    /// What it adds to each row, components side by side, in the table's unit.
    pub field: Vec<f64>,
    /// The vectors of its direction in each row, without its laws.
    pub(crate) along: Vec<f64>,
    /// What it is a function of: its columns, or what follows them with a delay.
    pub(crate) reads: Vec<String>,
}

impl Term {
    /// Name of the k-th of its rivals, counted from 0.
    pub(crate) fn rival_name(&self, k: usize) -> String {
        format!("{}_rival_{}", self.name, k + 1)
    }

    /// The formula itself, then those that the data cannot tell from it.
    pub fn formulas(&self) -> Vec<Formula> {
        let own = Formula {
            name: self.name.clone(),
            effect: self.effect.clone(),
            columns: self.covariates.clone(),
            complexity: self.complexity,
            heldout_rms: self.heldout_rms,
            known: None,
        };
        let rival = |(k, rival): (usize, &Rival)| Formula {
            name: self.rival_name(k),
            effect: rival.effect.clone(),
            columns: rival.covariates.clone(),
            complexity: rival.complexity,
            heldout_rms: rival.heldout_rms,
            known: None,
        };
        std::iter::once(own).chain(self.rivals.iter().enumerate().map(rival)).collect()
    }
}

/// What the search chose and the other half did not confirm.
#[derive(Debug, Clone)]
pub struct Unproven {
    /// As a user's effect.
    pub effect: String,
    /// Columns it depends on.
    pub covariates: Vec<String>,
    /// What the other half said.
    pub proof: Proof,
}

impl Unproven {
    /// Whether it holds on the other half, and is left out for its size alone.
    pub fn holds_but_is_weak(&self) -> bool {
        self.proof.p_value <= LEVEL
    }
}

/// A known effect that was found and belongs to the model.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownEffect {
    /// Its id.
    pub effect: &'static str,
    /// Columns that it depends on here: those of the formula that it stands for, or the catalogue's.
    pub columns: Vec<String>,
    /// The formula that it stands for, where it was found as one.
    pub formula: Option<Formula>,
}

impl KnownEffect {
    /// One with the columns of the catalogue.
    pub fn catalogued(effect: &'static str) -> Self {
        let all = effects(None);
        let columns =
            all.iter().find(|known| known.name() == effect).map_or(&[][..], |known| known.covariates());
        Self { effect, formula: None, columns: columns.iter().map(|column| (*column).to_owned()).collect() }
    }
}

/// A known effect that holds beside the formulas, and may be only what their laws lack. It is not in the model.
#[derive(Debug, Clone, PartialEq)]
pub struct WeakEffect {
    /// Its id.
    pub effect: &'static str,
    /// Its rms over that of the noise, in the half that judges.
    pub strength: f64,
    /// The formula that is so much stronger.
    pub beside: String,
}

/// The outcome.
pub struct Investigation {
    /// Known effects that were found beside the formulas and belong to the model.
    pub known: Vec<KnownEffect>,
    /// Known effects that are too weak beside a formula to belong to the model.
    pub known_weak: Vec<WeakEffect>,
    /// Formulas in the order in which they were found.
    pub terms: Vec<Term>,
    /// The last that was looked for and not confirmed.
    pub unproven: Option<Unproven>,
    /// All effects of the model: those that were given, the known ones, then the formulas.
    pub model: Vec<AddedEffect>,
    /// Model and formulas fitted together, with the ladder of held-out errors.
    pub fit: Fit,
    /// What the measurements scatter by.
    pub noise: Noise,
    /// Forms that were tried in all rounds.
    pub tried: usize,
    /// What the user ought to know.
    pub notes: Vec<String>,
}

impl Investigation {
    /// All formulas: each that was found, after it those that the data cannot tell from it, then those that a known effect
    /// stands for.
    pub fn formulas(&self) -> Vec<Formula> {
        let known = self.known.iter().filter_map(|known| known.formula.clone());
        self.terms.iter().flat_map(Term::formulas).chain(known).collect()
    }
}
