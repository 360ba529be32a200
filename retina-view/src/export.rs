//! What leaves the page: documents, and the command lines that do the same.

use std::path::Path;

use retina_diagnosis::{
    Dataset, Diagnosis, diagnose_json, diagnose_page, effects, fit_page, predictions_text,
    unexplained_shapes, write_model,
};
use retina_files::{InputError, read_text};
use retina_formats::Measurements;
use serde_json::{Value, json};

use crate::failure::Refusal;
use crate::session::Session;

/// The most that a p-value says against chance, as odds: 1 / (-e p ln p), 1 above p = 1/e (T. Sellke, M. J. Bayarri,
/// J. O. Berger, The American Statistician 55, 2001). It is an upper limit.
pub(crate) fn odds_against_chance(p: f64) -> f64 {
    let e = std::f64::consts::E;
    if p <= 0.0 || p >= 1.0 / e { 1.0 } else { -1.0 / (e * p * p.ln()) }
}

/// The diagnosis as `retina diagnose --json` prints it; each candidate also with its odds, its form, and the effects
/// that look like it.
pub(crate) fn diagnosis_json(data: &Dataset, diagnosis: &Diagnosis) -> Value {
    let mut out = diagnose_json(data, diagnosis);
    let catalogue = effects(Some(data.kind));
    if let Some(candidates) = out["candidates"].as_array_mut() {
        for (candidate, own) in candidates.iter_mut().zip(&diagnosis.candidates) {
            candidate["odds_at_most"] = json!(odds_against_chance(own.p_value));
            if let Some(effect) = catalogue.iter().find(|effect| effect.name() == own.effect) {
                candidate["formula"] = json!(effect.formula());
                candidate["source"] = json!(effect.source());
                candidate["class"] = effect.class.iter().map(|id| id.name()).collect();
            }
        }
    }
    out
}

/// The page that `retina fit --report` writes.
pub(crate) fn fit_report(session: &Session) -> Result<String, Refusal> {
    let (material, model) = (session.material()?, session.state().model().clone());
    let added = session.added(&model, &material)?;
    Ok(fit_page(&material.data, &added, &*session.fit_of(&model)?).html())
}

/// The page that `retina diagnose --report` writes.
pub(crate) fn diagnosis_report(session: &Session) -> Result<String, Refusal> {
    let found = session.diagnosis().ok_or_else(|| Refusal::conflict("the candidates are not known yet"))?;
    let (material, model) = (session.material()?, session.state().model().clone());
    let added = session.added(&model, &material)?;
    let shapes = unexplained_shapes(&material.data, &added, &found)?;
    Ok(diagnose_page(&material.data, &added, &found, &shapes).html())
}

/// The calibration that `retina fit --out` writes.
pub(crate) fn model_file(session: &Session) -> Result<String, Refusal> {
    let (material, model) = (session.material()?, session.state().model().clone());
    let Measurements::Points(table) = &material.tables else {
        return Err(InputError::new(
            Path::new("model.toml"),
            "is a geometric calibration, which only tables of points give",
        )
        .help("the report of the fit holds its parameters")
        .into());
    };
    let added = session.added(&model, &material)?;
    let fit = session.fit_of(&model)?;
    let path = session.folder.join("model.toml");
    write_model(&path, &material.data, &fit, &added, &material.setup, table, material.calibration.as_ref())?;
    Ok(read_text(&path)?)
}

/// The table that `retina fit --predictions` writes.
pub(crate) fn predictions(session: &Session) -> Result<String, Refusal> {
    let material = session.material()?;
    let fit = session.fit_of(session.state().model())?;
    Ok(predictions_text(Path::new("predictions.csv"), &material.data, &fit)?)
}

/// The commands that do the same, one a line.
pub(crate) fn commands(session: &Session) -> Vec<String> {
    let state = session.state();
    let mut inputs = format!(" --setup {}", quoted(&state.setup.display().to_string()));
    for table in &state.tables {
        inputs.push_str(&format!(" --data {}", quoted(&table.display().to_string())));
    }
    if let Some(calibration) = &state.calibration {
        inputs.push_str(&format!(" --calibration {}", quoted(&calibration.display().to_string())));
    }
    if state.baseline != "physical" {
        inputs.push_str(&format!(" --baseline {}", quoted(&state.baseline)));
    }
    for effect in state.model() {
        inputs.push_str(&format!(" --effect {}", quoted(&session.effect_text(effect))));
    }
    let mut out =
        vec![format!("retina compare{inputs}"), format!("retina diagnose{inputs} --report diagnosis.html")];
    if !state.model().is_empty() {
        out.push(format!(
            "retina fit{inputs} --out model.toml --predictions predictions.csv --report fit.html"
        ));
    }
    out
}

/// A word as a POSIX shell takes it.
fn quoted(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+:=,".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper's table 1.
    #[test]
    fn odds_are_those_of_the_paper() {
        for (p, odds) in [(0.1, 1.6), (0.05, 2.5), (0.01, 8.0), (0.001, 53.0)] {
            let found = odds_against_chance(p);
            assert!((found / odds - 1.0).abs() < 0.03, "{p}: {found}");
        }
        assert_eq!(odds_against_chance(0.9), 1.0);
    }

    #[test]
    fn words_are_quoted_for_the_shell() {
        assert_eq!(quoted("a/b.csv"), "a/b.csv");
        assert_eq!(quoted("it's here.csv"), r"'it'\''s here.csv'");
        assert_eq!(quoted("$(x)"), "'$(x)'");
    }
}
