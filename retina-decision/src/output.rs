//! What was decided, for people and programs.

use std::path::PathBuf;

use retina_diagnosis::{AddedEffect, Rival};
use serde_json::{Value, json};

use crate::{Decision, Design};

/// How far one has come.
pub struct Outcome {
    /// The rivals.
    pub rivals: Vec<Rival>,
    /// Effects that all of them have: those that were given, and those that a diagnosis named beside the best.
    pub common: Vec<AddedEffect>,
    /// Names of the exposures, in the order of the data's groups.
    pub exposures: Vec<String>,
    /// What the measurements say of them.
    pub decision: Decision,
    /// Whether the best is a hundred times likelier than none of them.
    pub needed: bool,
    /// Exposures that were made to decide.
    pub used: usize,
    /// Most of them.
    pub budget: usize,
    /// The probability of each rival after each round, the first before any.
    pub history: Vec<Vec<f64>>,
    /// What is to be measured next, and its folder.
    pub next: Option<(Design, PathBuf)>,
    /// A round that was planned before and is not measured yet.
    pub waiting: Option<PathBuf>,
    /// Whether no exposure that may be made would tell those apart that are left.
    pub inseparable: bool,
    /// What is left beside the best, where one is left, or without all of them, where none is needed: the verdict of a
    /// diagnosis and its first line.
    pub beside: Option<(&'static str, String)>,
    /// What the user ought to know.
    pub notes: Vec<String>,
}

impl Outcome {
    /// `decided`, `none_needed`, `none_fits`, `open`, `inseparable` or `budget_spent`.
    pub fn verdict(&self) -> &'static str {
        let spent = self.used >= self.budget;
        match self.decision.left.len() {
            1 if !self.needed => "none_needed",
            1 if self.decision.decided().is_some() => "decided",
            1 => "none_fits",
            _ if (self.inseparable || spent) && !self.needed => "none_needed",
            _ if self.inseparable => "inseparable",
            _ if spent => "budget_spent",
            _ => "open",
        }
    }

    fn exposure(&self, group: usize) -> &str {
        self.exposures.get(group).map_or("", String::as_str)
    }

    fn name(&self, rival: usize) -> &str {
        &self.rivals[rival].name
    }
}

fn sigma(value: f64) -> String {
    if value < 10.0 { format!("{value:.1}") } else { format!("{value:.0}") }
}

/// Lines for people.
pub fn decision_text(outcome: &Outcome) -> Vec<String> {
    let mut out = Vec::new();
    let names = outcome.decision.names(&outcome.rivals).join(", ");
    out.push(match outcome.verdict() {
        "decided" => format!("Decided: {names}"),
        "none_needed" => "None of the rivals is needed: the data are described as well without them".to_owned(),
        "none_fits" => {
            format!("{names} is the likeliest of them, and does not fit: perhaps none of the rivals is the true one")
        }
        "inseparable" => format!("No exposure that may be made tells these apart: {names}"),
        "budget_spent" => format!("The budget of {} exposures is spent; left are: {names}", outcome.budget),
        _ => format!("Left are: {names}"),
    });
    if outcome.verdict() == "open" && !outcome.needed {
        out.push("None of them is needed so far.".to_owned());
    }
    out.push(String::new());
    let width = outcome.rivals.iter().map(|rival| rival.name.chars().count()).max().unwrap_or(0).max(5);
    out.push(format!("{:<width$}   share of probability   error over noise", "rival"));
    for (rival, judgement) in outcome.rivals.iter().zip(&outcome.decision.judgements) {
        out.push(format!(
            "{:<width$}   {:>20}   {:>16.3}",
            rival.name,
            probability(judgement.probability),
            judgement.error_over_noise
        ));
    }
    if let Some((group, sigmas)) = outcome.decision.misfit() {
        out.push(String::new());
        let name = outcome.exposure(*group);
        out.push(format!("Beside the likeliest, exposure {name} is off by {} sigma.", sigma(*sigmas)));
    }
    if let Some((_, text)) = &outcome.beside {
        out.push(String::new());
        let where_from = if outcome.verdict() == "none_needed" { "Without them" } else { "Beside it" };
        out.push(format!("{where_from}: {text}"));
    }
    if let Some((design, folder)) = &outcome.next {
        out.push(String::new());
        out.push(format!("Measure next: {} exposures, in {}", design.planned.len(), folder.display()));
        out.extend(plan_lines(design));
        out.push(String::new());
        for separation in &design.separations {
            let [a, b] = separation.pair.map(|k| outcome.name(k));
            out.push(format!(
                "{a} and {b}: now {} sigma apart, then {}",
                sigma(separation.before),
                sigma(separation.after)
            ));
        }
        out.push(how_to_go_on(folder));
    }
    if let Some(folder) = &outcome.waiting {
        out.push(String::new());
        out.push(format!(
            "Planned, and not measured yet: {}. Options of plans count from the next round on.",
            folder.display()
        ));
        out.push(how_to_go_on(folder));
    }
    out.extend(outcome.notes.iter().map(|note| format!("note: {note}")));
    out
}

fn how_to_go_on(folder: &std::path::Path) -> String {
    format!(
        "Show screens/ as plan.csv says. Put the points into {0}/points.csv, or the photographs with an images.csv into {0}/images, and run the same command again.",
        folder.display()
    )
}

fn probability(value: f64) -> String {
    match value {
        v if v > 0.999 => "> 0.999".to_owned(),
        v if v < 0.001 => "< 0.001".to_owned(),
        v => format!("{v:.3}"),
    }
}

fn plan_lines(design: &Design) -> Vec<String> {
    let cell = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let mut out =
        vec!["screen    time_s  exposure_s  temp_c  roll_deg  mounting  channel  places  counts".to_owned()];
    for planned in &design.planned {
        let exposure = &planned.exposure;
        let counts: Vec<String> = planned.counts.iter().map(u8::to_string).collect();
        out.push(format!(
            "{:<8}  {:>6}  {:>10}  {:>6}  {:>8}  {:>8}  {:<7}  {:<6}  {}",
            exposure.image,
            cell(exposure.time_s, 0),
            exposure.exposure_s.map_or_else(|| "-".to_owned(), |value| format!("{value:.3e}")),
            cell(exposure.temperature_c, 2),
            cell(exposure.camera_roll_deg, 0),
            cell(exposure.mounting, 0),
            planned.channel.letter(),
            planned.layout,
            counts.join(" ")
        ));
    }
    out
}

/// JSON, schema `retina.decision/1`.
pub fn decision_json(outcome: &Outcome) -> Value {
    let rivals =
        outcome.rivals.iter().zip(&outcome.decision.judgements).enumerate().map(|(k, (rival, j))| {
            json!({
                "name": rival.name,
                "effects": rival.effects.iter().map(|effect| effect.name()).collect::<Vec<_>>(),
                "probability": j.probability,
                "ln_evidence": j.ln_evidence,
                "ln_odds_against": j.ln_odds_against,
                "error_over_noise": j.error_over_noise,
                "worst_exposure": { "image": outcome.exposure(j.worst_level.0), "sigmas": j.worst_level.1 },
                "ruled_out": !outcome.decision.left.contains(&k),
            })
        });
    let next = outcome.next.as_ref().map(|(design, folder)| {
        json!({
            "folder": folder,
            "exposures": design.planned.iter().map(|planned| json!({
                "image": planned.exposure.image,
                "time_s": planned.exposure.time_s,
                "exposure_s": planned.exposure.exposure_s,
                "temperature_c": planned.exposure.temperature_c,
                "camera_roll_deg": planned.exposure.camera_roll_deg,
                "mounting": planned.exposure.mounting,
                "channel": planned.channel.letter(),
                "places": planned.layout,
                "counts": planned.counts,
                "points": planned.points.len(),
            })).collect::<Vec<_>>(),
            "separations": design.separations.iter().map(|s| json!({
                "pair": s.pair.map(|k| outcome.name(k)),
                "before_sigma": s.before,
                "after_sigma": s.after,
            })).collect::<Vec<_>>(),
            "sequences_tried": design.tried,
        })
    });
    json!({
        "schema": "retina.decision/1",
        "verdict": outcome.verdict(),
        "needed": outcome.needed,
        "common": outcome.common.iter().map(|effect| effect.name()).collect::<Vec<_>>(),
        "decided": outcome.decision.decided().filter(|_| outcome.needed).map(|k| outcome.name(k)),
        "left": outcome.decision.names(&outcome.rivals),
        "rivals": rivals.collect::<Vec<_>>(),
        "exposures": { "used": outcome.used, "budget": outcome.budget },
        "history": outcome.history,
        "next": next,
        "waiting": outcome.waiting,
        "beside": outcome.beside.as_ref().map(|(verdict, text)| json!({ "verdict": verdict, "text": text })),
        "notes": outcome.notes,
    })
}
