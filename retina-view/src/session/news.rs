//! A session as a window shows it.

use retina_investigation::investigation_json;
use serde_json::{Value, json};

use super::{Session, effect_name, file_name, is_own, lock};
use crate::failure::Refusal;
use crate::state::Model;

impl Session {
    /// All that a window shows of the session beside rows and fits.
    pub(crate) fn json(&self) -> Value {
        let diagnosis = self.diagnosis();
        let can_measure = self.can_measure();
        let revision = *self.revision.borrow();
        let material = lock(&self.inner).material.clone();
        let formulas = match (self.investigation(), &material) {
            (Some(found), Some(material)) => investigation_json(&material.data, &found, None),
            _ => Value::Null,
        };
        let inner = lock(&self.inner);
        let phase = match (&inner.material, &inner.problem) {
            (_, Some(_)) => "failed",
            (None, None) => "loading",
            (Some(_), None) => "ready",
        };
        let state = &inner.state;
        let effects = |model: &Model| -> Value {
            model
                .iter()
                .map(|text| json!({ "text": text, "name": effect_name(text), "own": is_own(text) }))
                .collect()
        };
        let found = match (&diagnosis, &inner.material) {
            (Some(diagnosis), Some(material)) => crate::export::diagnosis_json(&material.data, diagnosis),
            _ => Value::Null,
        };
        json!({
            "id": self.id,
            "name": state.name,
            "revision": revision,
            "phase": phase,
            "problem": inner.problem.as_ref().map(Refusal::body),
            "job": inner.job.as_ref().map(|job| json!({ "kind": job.kind.name(), "done": job.done, "total": job.total })),
            "inputs": {
                "setup": file_name(&state.setup),
                "tables": state.tables.iter().map(|table| file_name(table)).collect::<Vec<_>>(),
                "calibration": state.calibration.as_ref().map(|path| file_name(path)),
                "baseline": state.baseline,
                "bench": state.campaign.is_some(),
            },
            "models": state.models.iter().map(effects).collect::<Vec<_>>(),
            "at": state.at,
            "diagnosis": found,
            "investigation": formulas,
            "can_measure": can_measure,
        })
    }
}
