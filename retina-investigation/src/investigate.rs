//! Rounds of the investigation: search in one half, proof in the other, the formula on all data, and what is left.

use std::sync::atomic::AtomicUsize;

use rayon::prelude::*;
use retina_diagnosis::{AddedEffect, Dataset, DiagnoseOptions, Halves, Proof, diagnose_step, fit};
use retina_files::InputError;
use retina_formats::TableKind;

use crate::columns::{Column, Table, columns};
use crate::form::Form;
use crate::outcome::{Investigation, Term, Unproven, WeakEffect};
use crate::rivals::{Choice, inseparable, sum};
use crate::search::{Scored, Search, WEAK, finite, simplest};
use crate::words::words;

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
const LEVEL_RIVAL: f64 = 0.05;
/// A structure weaker than this, rms over noise, is not reported.
const FLOOR: f64 = 0.025;
/// Most known effects that join the model.
const MOST_KNOWN: usize = 4;
/// Share of a formula's square that a catalogued effect has to hold to be called the same.
const ALIKE: f64 = 0.9;
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
        notes: data.notes.clone(),
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

/// What was found so far.
struct Rounds<'a> {
    data: &'a Dataset,
    model: Vec<AddedEffect>,
    known: Vec<&'static str>,
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
    /// A catalogued effect that is nearly the same as the formula that was found.
    Known(&'static str),
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
                self.known.push(id);
            }
        }
        Ok(self.known.len() > before)
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
        let halves = Halves::new(self.data, &self.model).map_err(|few| {
            InputError::new(
                "--data",
                "the table has too few groups: one half looks for a formula, the other judges it",
            )
            .found(format!("{} exposures, series or nights", few.found))
            .expected(format!("at least {}", few.needed))
            .help("measure more of them, or give several tables of one facility together")
        })?;
        let columns = columns(halves.whole());
        let searched = Table::new(halves.searched(), &columns);
        let search = Search {
            kind: self.data.kind,
            columns: &columns,
            table: &searched,
            tried: AtomicUsize::new(0),
            progress: self.progress,
        };
        let found = search.run(&halves);
        self.tried += found.tried;
        (self.progress)("judging", 0.9);
        let Some(first) = found.scored.first() else { return Ok(false) };
        let weights = finite(first.form.evaluate(&searched, &columns));
        let left = halves.search(&weights);
        let Some((chosen, _)) = simplest(&left, &search, &found.scored) else { return Ok(false) };
        let whole = Table::new(halves.whole(), &columns);
        let prove = |scored: &Scored| {
            let amplitudes = left.amplitudes(&finite(scored.form.evaluate(&searched, &columns)));
            let own = finite(scored.form.evaluate(&whole, &columns));
            let predicted = sum(&own, amplitudes.iter().map(|(value, _)| *value));
            halves.prove(&predicted, &own, self.options.seed)
        };
        let chosen = &found.scored[chosen];
        let proof = prove(chosen);
        let number = self.terms.len() + 1;
        if proof.p_value > LEVEL || proof.strength < FLOOR {
            let amplitudes: Vec<f64> = left
                .amplitudes(&finite(chosen.form.evaluate(&searched, &columns)))
                .iter()
                .map(|(value, _)| *value)
                .collect();
            let held = vec![true; chosen.form.shapes()];
            self.unproven = Some(Unproven {
                effect: chosen.form.effect(&columns, self.data.kind, &name(number), &amplitudes, &held),
                covariates: chosen.form.covariates(&columns),
                proof,
            });
            return Ok(false);
        }
        // The formula itself is chosen and fitted on all data; what the other half did not confirm is out.
        let mut judged: Vec<Judged> = found
            .scored
            .par_iter()
            .take(JUDGED)
            .filter(|scored| scored.form != chosen.form)
            .map(|scored| Judged { form: scored.form.clone(), proof: prove(scored) })
            .filter(|judged| judged.proof.p_value <= LEVEL_RIVAL)
            .collect();
        judged.insert(0, Judged { form: chosen.form.clone(), proof });
        let term = self.on_all_data(&halves, &columns, &whole, judged, name(number))?;
        match term {
            Some(Chosen::Formula(term, effect)) => {
                self.terms.push(*term);
                self.model.push(effect);
            }
            Some(Chosen::Known(name)) => {
                self.model.push(AddedEffect::read(name, self.data)?);
                self.known.push(name);
            }
            None => return Ok(false),
        }
        Ok(true)
    }

    /// Chooses among proven forms on all data, and fits.
    fn on_all_data(
        &mut self,
        halves: &Halves,
        columns: &[Column],
        whole: &Table,
        judged: Vec<Judged>,
        name: String,
    ) -> Result<Option<Chosen>, InputError> {
        let search = Search {
            kind: self.data.kind,
            columns,
            table: whole,
            tried: AtomicUsize::new(0),
            progress: self.progress,
        };
        let left = halves.all(&finite(judged[0].form.evaluate(whole, columns)));
        let scored: Vec<Scored> = search.refined_anew(&left, judged.iter().map(|j| j.form.clone()).collect());
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
        if let Some(name) = alike.iter().map(|(name, _)| *name).find(|name| new(name)) {
            return Ok((!self.weak(name, &judged[0].proof)).then_some(Chosen::Known(name)));
        }
        let frozen = inseparable(&left, own, whole, columns, &amplitudes);
        let Some((text, effect)) = self.readable(own, columns, &name, &amplitudes, frozen) else {
            self.notes
                .push(format!("the formula {name} cannot be fitted as a user's effect and is left out"));
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
        let words = words(own, columns, self.data, &amplitudes, strength);
        let covariates = own.covariates(columns);
        let weak_beside = self.weak_beside(rms, proof.strength)?;
        self.forms.push((own.clone(), amplitudes));
        let term =
            Term { name, effect: text, covariates, proof, rms, weak_beside, rivals, alike, words, field };
        Ok(Some(Chosen::Formula(Box::new(term), effect)))
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

fn name(number: usize) -> String {
    format!("found_{number}")
}
