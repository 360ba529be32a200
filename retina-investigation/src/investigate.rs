//! Rounds of the investigation: search in one half, proof in the other, the formula on all data, and what is left.

use rayon::prelude::*;
use retina_diagnosis::{
    AddedEffect, Dataset, DiagnoseOptions, Halves, LeftOut, Part, Proof, Remainder, column_text,
    diagnose_step, effects, fit,
};
use retina_files::InputError;
use retina_formats::TableKind;

use crate::columns::{Column, Table, columns};
use crate::delays::{with_all_delays, with_finer_delays};
use crate::form::Form;
use crate::half::{InHalf, Judge, Sought};
use crate::outcome::{Formula, Investigation, KnownEffect, Term, Unproven, WeakEffect};
use crate::rivals::{Choice, TOLD_APART, inseparable, sum};
use crate::search::{Scored, WEAK, finite, simplest};
use crate::words::{short, words};

/// What is asked of an investigation.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Seed of the sign flips.
    pub seed: u64,
    /// Most formulas that are looked for, one beside the other.
    pub most_terms: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { seed: 1, most_terms: 3 }
    }
}

/// Level at which a formula is taken for proven, and a known effect for holding in the half that judges.
pub(crate) const LEVEL: f64 = 0.01;
/// Families that are judged beside the first.
const JUDGED: usize = 12;
/// Level at which another form may take the place of the one that the search chose.
const LEVEL_RIVAL: f64 = 0.1;
/// A structure weaker than this, rms over noise, is not reported.
const FLOOR: f64 = 0.025;
/// Most known effects that join the model.
const MOST_KNOWN: usize = 4;
/// Share of a formula's square that a catalogued effect has to hold to be called the same.
const ALIKE: f64 = 0.9;
/// Share of which it is the same, whatever else can be told: the rest is what its form has of another shape.
const SURELY: f64 = 0.99;
/// A fit in which an amplitude grows by more than this has run along a valley: two formulas nearly cancel there.
const MOST_GROWTH: f64 = 5.0;

/// Looks for formulas of what the model leaves: the baseline, the `added` effects, and those that a diagnosis names.
///
/// `progress` is told what is being done and the share of it that is finished.
///
/// # Errors
/// The table has too few groups to be halved, is one of frames, or an added effect does not fit it.
pub fn investigate(
    data: &Dataset,
    added: &[AddedEffect],
    options: &Options,
    progress: &(dyn Fn(&str, f64) + Sync),
) -> Result<Investigation, InputError> {
    let mut out = Rounds {
        data,
        model: added.to_vec(),
        known: Vec::new(),
        known_weak: Vec::new(),
        terms: Vec::new(),
        forms: Vec::new(),
        unproven: None,
        tried: 0,
        notes: data.notes.iter().cloned().chain(unwritten(data)).collect(),
        options,
        progress,
    };
    // Known effects whose forms no formula comes near to are the diagnosis's to find. It comes second: beside what is
    // unknown it takes known effects for it.
    loop {
        while out.terms.len() < options.most_terms && out.known.len() < MOST_KNOWN && out.round()? {}
        if !out.diagnosed()? {
            break;
        }
    }
    let mut model = out.known_effects();
    for term in &out.terms {
        model.push(AddedEffect::of_text(&term.name, &term.effect, data)?);
    }
    let fit = fit(data, &model)?;
    Ok(Investigation {
        known: out.known,
        known_weak: out.known_weak,
        noise: fit.noise.clone(),
        terms: out.terms,
        unproven: out.unproven,
        fit,
        model,
        tried: out.tried,
        notes: out.notes,
    })
}

/// Columns whose names no formula can have.
fn unwritten(data: &Dataset) -> Option<String> {
    let names: Vec<&str> =
        data.screened_columns().into_iter().filter(|name| column_text(name).is_none()).collect();
    (!names.is_empty()).then(|| format!("not looked at, for a backquote in the name: {}", names.join(", ")))
}

/// What was found so far.
struct Rounds<'a> {
    data: &'a Dataset,
    model: Vec<AddedEffect>,
    known: Vec<KnownEffect>,
    known_weak: Vec<WeakEffect>,
    terms: Vec<Term>,
    /// Their forms, with amplitudes.
    forms: Vec<(Form, Vec<f64>)>,
    unproven: Option<Unproven>,
    tried: usize,
    notes: Vec<String>,
    options: &'a Options,
    progress: &'a (dyn Fn(&str, f64) + Sync),
}

/// What a round adds to the model.
enum Chosen {
    /// A catalogued effect that the data do not tell from the formula that was found.
    Known(KnownEffect),
    Formula(Box<Term>, AddedEffect),
}

/// A form with what both halves say of it.
struct Judged {
    form: Form,
    proof: Proof,
}

impl Rounds<'_> {
    /// Adds what a diagnosis of what is left accepts; false where it accepts nothing.
    fn diagnosed(&mut self) -> Result<bool, InputError> {
        (self.progress)("looking for known effects", 0.95);
        // Where nothing was found it would only say again what `diagnose` says, with its own rate of false alarms. Effects
        // of images change the prediction, which is made anew with each: the caller's to do.
        let nothing = self.model.is_empty() || self.data.kind == TableKind::Frames;
        if nothing || self.known.len() >= MOST_KNOWN {
            return Ok(false);
        }
        let options = DiagnoseOptions { seed: self.options.seed, ..DiagnoseOptions::default() };
        let found = diagnose_step(self.data, &self.model, &options, !self.model.is_empty());
        let before = self.known.len();
        for &id in &found.accepted {
            let effect = AddedEffect::read(id, self.data)?;
            let Some(proof) = self.holds(&effect) else { continue };
            if !self.weak(id, &proof) && self.fits_with(&effect) {
                self.model.push(effect);
                self.known.push(KnownEffect::catalogued(id));
            }
        }
        if self.known.len() == before {
            return Ok(false);
        }
        self.leave_out_what_was_known();
        Ok(true)
    }

    /// Takes out formulas that do not hold beside the known effects: they were a part of these.
    fn leave_out_what_was_known(&mut self) {
        for k in (0..self.terms.len()).rev() {
            let name = self.terms[k].name.clone();
            let others: Vec<AddedEffect> =
                self.model.iter().filter(|effect| effect.name() != name).cloned().collect();
            let Ok(halves) = Halves::new(self.data, &others) else { continue };
            let columns = columns(halves.data(Part::Whole));
            let whole = Table::new(halves.data(Part::Whole), &columns);
            let form = finite(self.forms[k].0.evaluate(&whole, &columns));
            let seed = self.options.seed;
            let holds = |halves: &Halves| stands(&halves.prove_columns(&form, seed));
            if !holds(&halves) && !holds(&halves.exchanged()) {
                self.model = others;
                self.terms.remove(k);
                self.forms.remove(k);
            }
        }
    }

    /// Whether a known effect is so weak beside a formula that it may be only what the laws of that lack; notes it then.
    fn weak(&mut self, effect: &'static str, proof: &Proof) -> bool {
        let strength = proof.strength;
        self.known_weak.retain(|weak| weak.effect != effect);
        let Some(formula) = self.much_stronger(strength) else { return false };
        let beside = formula.name.clone();
        self.known_weak.push(WeakEffect { effect, strength, beside });
        true
    }

    /// The proof of a catalogued effect that, fitted to one half, holds in the other: the diagnosis has seen both.
    fn holds(&self, effect: &AddedEffect) -> Option<Proof> {
        let (AddedEffect::Catalogued(known), Ok(halves)) = (effect, Halves::new(self.data, &self.model))
        else {
            return None;
        };
        halves.prove_known(known, self.options.seed).filter(|proof| proof.p_value <= LEVEL)
    }

    /// Looks for one more formula; false where none is proven.
    fn round(&mut self) -> Result<bool, InputError> {
        let mut halves = Halves::new(self.data, &self.model).map_err(|few| {
            InputError::new(
                "--data",
                "the table has too few groups: one half looks for a formula, the other judges it",
            )
            .found(format!("{} exposures, series or nights", few.found))
            .expected(format!("at least {}", few.needed))
            .help("measure more of them, or give several tables of one facility together")
        })?;
        let columns = columns(halves.data(Part::Whole));
        let whole = Table::new(halves.data(Part::Whole), &columns);
        let (data, seed, progress) = (self.data, self.options.seed, self.progress);
        let sought = Sought { data, columns: &columns, whole: &whole, seed, progress };
        let Some(mut found) = sought.in_half(&halves, &mut self.tried) else { return Ok(false) };
        if !stands(&found.proof) && self.terms.is_empty() && self.known.is_empty() {
            // A half may be too small to tell which form it is: the other one is another chance.
            halves = halves.exchanged();
            match sought.in_half(&halves, &mut self.tried) {
                Some(other) if other.proof.p_value < found.proof.p_value => found = other,
                _ => {}
            }
        }
        let name = self.free_name();
        let InHalf { scored, chosen, amplitudes, proof } = found;
        if !stands(&proof) {
            let held = vec![true; chosen.shapes()];
            self.unproven = Some(Unproven {
                effect: chosen.effect(&columns, self.data.kind, &name, &amplitudes, &held),
                covariates: chosen.covariates(&columns),
                proof,
            });
            return Ok(false);
        }
        // Delays were tried in coarse steps.
        let columns = with_finer_delays(
            halves.data(Part::Whole),
            &columns,
            scored.iter().take(JUDGED).map(|scored| &scored.form).chain([&chosen]),
        );
        let whole = Table::new(halves.data(Part::Whole), &columns);
        let sought = Sought { columns: &columns, whole: &whole, ..sought };
        // There is something, and half of the groups may have been too few to tell which formula. So the search goes on from
        // there on all data; what one half says has to hold in the other all the same.
        let near = scored.iter().map(|scored| scored.form.clone()).collect();
        let again = sought.search(Part::Whole, &whole).run(&halves, Some(near));
        self.tried += again.tried;
        let both = scored.iter().take(JUDGED).chain(again.scored.iter().take(JUDGED));
        let judge = Judge::new(sought, &halves, &scored[0].form);
        let mut judged: Vec<Judged> = both
            .map(|scored| &scored.form)
            .filter(|form| **form != chosen)
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|form| Judged { form: form.clone(), proof: judge.prove(form) })
            .filter(|judged| judged.proof.p_value <= LEVEL_RIVAL)
            .collect();
        judged.insert(0, Judged { form: chosen, proof });
        let term = self.on_all_data(&halves, sought, judged, name)?;
        match term {
            Some(Chosen::Formula(term, effect)) => {
                self.terms.push(*term);
                self.model.push(effect);
            }
            Some(Chosen::Known(known)) => {
                self.model.push(AddedEffect::read(known.effect, self.data)?);
                self.known.push(known);
                self.leave_out_what_was_known();
            }
            None => return Ok(false),
        }
        Ok(true)
    }

    /// Chooses among proven forms on all data, and fits.
    fn on_all_data(
        &mut self,
        halves: &Halves,
        sought: Sought<'_>,
        judged: Vec<Judged>,
        name: String,
    ) -> Result<Option<Chosen>, InputError> {
        let Sought { columns, whole, .. } = sought;
        let search = sought.search(Part::Whole, whole);
        let left = halves.left(Part::Whole, &finite(judged[0].form.evaluate(whole, columns)));
        let forms = with_all_delays(judged.iter().map(|judged| judged.form.clone()).collect(), columns);
        let scored: Vec<Scored> = search.refined_anew(&left, forms);
        let Some((best, errors)) = simplest(&left, &search, &scored) else { return Ok(None) };
        let own = &scored[best].form;
        let evaluated = finite(own.evaluate(whole, columns));
        let amplitudes: Vec<f64> = left.amplitudes(&evaluated).iter().map(|(value, _)| *value).collect();
        let field = sum(&evaluated, amplitudes.iter().copied());
        let alike: Vec<(&'static str, f64)> =
            left.alike(&field).into_iter().filter(|(_, share)| *share >= ALIKE).collect();
        let new = |name: &&'static str| {
            self.data.kind != TableKind::Frames
                && !self.model.iter().any(|effect| effect.name() == *name)
                && AddedEffect::read(name, self.data).is_ok_and(|effect| self.fits_with(&effect))
        };
        let known = alike
            .iter()
            .find(|(name, share)| {
                new(name) && (*share >= SURELY || same(&left, name, &scored[best], &errors[best]))
            })
            .map(|(name, _)| *name);
        if let Some(effect) = known {
            let name = format!("formula_of_{effect}");
            let held = vec![true; own.shapes()];
            let formula = Formula {
                effect: own.effect(columns, self.data.kind, &name, &amplitudes, &held),
                columns: own.covariates(columns),
                complexity: own.complexity(),
                heldout_rms: errors[best].rms(),
                known: Some(effect),
                name,
            };
            let columns = formula.columns.clone();
            let known = KnownEffect { effect, columns, formula: Some(formula) };
            return Ok((!self.weak(effect, &judged[0].proof)).then_some(Chosen::Known(known)));
        }
        let frozen = inseparable(&left, own, whole, columns, &amplitudes);
        let Some((text, effect)) = self.readable(own, columns, &name, &amplitudes, frozen) else {
            self.notes
                .push(format!("a formula of {} holds, and cannot be fitted as a user's effect: it is left out. Look whether two columns say the same, or a column has values of very different sizes", own.covariates(columns).join(", ")));
            return Ok(None);
        };
        let choice =
            Choice { left: &left, scored: &scored, errors: &errors, best, columns, whole, field: &field };
        let rivals = choice.rivals(self.data, &name);
        let proof = judged
            .iter()
            .find(|judged| judged.form.family() == own.family())
            .map_or(judged[0].proof, |judged| judged.proof);
        let beside = left.beside(&field);
        let rms = (field.iter().map(|v| v * v).sum::<f64>() / field.len().max(1) as f64).sqrt();
        let strength = (beside.iter().map(|v| v * v).sum::<f64>() / left.components()).sqrt();
        let mut words = words(own, columns, self.data, &amplitudes, strength);
        if let Some([shortest, longest]) = choice.delays_s() {
            words.says.push(format!(
                "These data do not tell time constants from {} to {} s apart.",
                short(shortest),
                short(longest)
            ));
        }
        let covariates = own.covariates(columns);
        let weak_beside = self.weak_beside(rms, proof.strength)?;
        let (along, reads) = (own.along(whole, columns, &amplitudes), own.reads(columns));
        self.forms.push((own.clone(), amplitudes));
        let term = Term {
            name,
            effect: text,
            covariates,
            complexity: own.complexity(),
            heldout_rms: errors[best].rms(),
            proof,
            rms,
            weak_beside,
            rivals,
            alike,
            words,
            field,
            along,
            reads,
        };
        Ok(Some(Chosen::Formula(Box::new(term), effect)))
    }

    /// The first of `found_1`, `found_2`, ... that the model does not have.
    fn free_name(&self) -> String {
        let mut number = 1;
        while self.model.iter().any(|effect| effect.name() == format!("found_{number}")) {
            number += 1;
        }
        format!("found_{number}")
    }

    /// The first formula that is so much stronger that what has this strength may be only what its laws lack.
    fn much_stronger(&self, strength: f64) -> Option<&Term> {
        self.terms.iter().find(|term| strength < WEAK * term.proof.strength)
    }

    /// What of the model is so much stronger than a formula of this rms, and strength beside the model, that it may be only what that lacks.
    fn weak_beside(&self, rms: f64, strength: f64) -> Result<Option<String>, InputError> {
        if let Some(before) = self.much_stronger(strength) {
            return Ok(Some(before.name.clone()));
        }
        let known = self.known_effects();
        if known.is_empty() {
            return Ok(None);
        }
        let size = fit(self.data, &known)?.effect_rms();
        let names: Vec<&str> = known.iter().map(AddedEffect::name).collect();
        Ok((rms < WEAK * size).then(|| names.join(" + ")))
    }

    /// What the model has beside the formulas.
    fn known_effects(&self) -> Vec<AddedEffect> {
        let formula = |effect: &&AddedEffect| self.terms.iter().any(|term| term.name == effect.name());
        self.model.iter().filter(|effect| !formula(effect)).cloned().collect()
    }

    /// Whether the workbench can fit the model with one more effect.
    fn fits_with(&self, effect: &AddedEffect) -> bool {
        let mut model = self.model.clone();
        model.push(effect.clone());
        fit(self.data, &model).is_ok()
    }

    /// The form as an effect that the workbench takes. Shape parameters that it refuses are held, and those of the formulas
    /// before it where two of one kind would run away from each other.
    fn readable(
        &mut self,
        form: &Form,
        columns: &[Column],
        name: &str,
        amplitudes: &[f64],
        frozen: Vec<bool>,
    ) -> Option<(String, AddedEffect)> {
        let of = |name: &str, form: &Form, amplitudes: &[f64], frozen: &[bool]| {
            let text = form.effect(columns, self.data.kind, name, amplitudes, frozen);
            AddedEffect::of_text(name, &text, self.data).ok().map(|effect| (text, effect))
        };
        let all = vec![true; frozen.len()];
        for frozen in [frozen, all.clone()] {
            let Some((text, effect)) = of(name, form, amplitudes, &frozen) else { continue };
            if self.fits_well(&effect, &self.model) {
                return Some((text, effect));
            }
        }
        let (text, effect) = of(name, form, amplitudes, &all)?;
        let mut model = self.model.clone();
        let mut held = Vec::new();
        for (term, (form, amplitudes)) in self.terms.iter().zip(&self.forms) {
            let (text, effect) = of(&term.name, form, amplitudes, &vec![true; form.shapes()])?;
            model.iter_mut().filter(|own| own.name() == term.name).for_each(|own| *own = effect.clone());
            held.push(text);
        }
        if !self.fits_well(&effect, &model) {
            return None;
        }
        self.model = model;
        self.terms.iter_mut().zip(held).for_each(|(term, text)| term.effect = text);
        Some((text, effect))
    }

    /// Whether a model with one more effect can be fitted, and the formulas' amplitudes stay near those of the search.
    fn fits_well(&self, effect: &AddedEffect, model: &[AddedEffect]) -> bool {
        let model: Vec<AddedEffect> = model.iter().chain([effect]).cloned().collect();
        let Ok(fitted) = fit(self.data, &model) else { return false };
        let near = |effect: &AddedEffect| {
            let AddedEffect::Own(own) = effect else { return true };
            let amplitudes = || own.parameters().iter().filter(|p| p.name.starts_with("amplitude_"));
            let value = |name: &str| {
                let name = format!("{}.{name}", own.name());
                fitted.parameters.iter().find(|p| p.name == name).map_or(0.0, |p| p.value.abs())
            };
            let start = amplitudes().map(|p| p.start.abs()).fold(0.0, f64::max);
            amplitudes().all(|p| value(&p.name) <= MOST_GROWTH * start)
        };
        let ours = |own: &&AddedEffect| {
            own.name() == effect.name() || self.terms.iter().any(|term| term.name == own.name())
        };
        model.iter().filter(ours).all(near)
    }
}

/// Whether a catalogued effect does as well as a formula: units left out do not tell them apart, or the formula's merit is
/// no larger. The formula was chosen among many laws, and its shapes were fitted.
fn same(left: &Remainder<'_>, effect: &str, formula: &Scored, of_formula: &LeftOut) -> bool {
    effects(Some(left.data().kind))
        .into_iter()
        .find(|known| known.name() == effect)
        .and_then(|known| left.known(known))
        .is_some_and(|(score, errors)| {
            errors.beaten_by(of_formula) <= TOLD_APART || score.merit() >= formula.merit
        })
}

/// Whether a formula that was judged has its place in the model.
fn stands(proof: &Proof) -> bool {
    proof.p_value <= LEVEL && proof.strength >= FLOOR
}
