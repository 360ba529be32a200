//! What is known of the frames whatever model is asked for: the noise of their pixels, and where the bodies are. Both come
//! from a prediction that is as good as these frames allow.

use retina_diagnosis::{Neighbours, White, white_noise};
use retina_formats::FramesEffect;

use crate::FrameSet;
use crate::form::{Change, catalogue};
use crate::model::Part;
use crate::predicted::Predicted;
use crate::solve;

/// Effects that images of a body have as a rule.
const USUAL: [FramesEffect; 6] = [
    FramesEffect::Relief,
    FramesEffect::AlbedoMap,
    FramesEffect::PhotometricFunction,
    FramesEffect::Defocus,
    FramesEffect::VeilingGlare,
    FramesEffect::DetectorNonlinearity,
];

impl FrameSet {
    /// The present state with the usual effects, each in its best form.
    pub(crate) fn best(&self) -> Predicted {
        let mut state = self.state.clone();
        for (id, forms) in catalogue(&self.abilities()) {
            let Some(forms) = forms.ok().filter(|_| USUAL.contains(&id)) else { continue };
            // The map as it is, to begin with.
            let plain = forms.iter().find(|form| form.change == Change::Map { power: 1.0 });
            let Some(form) = plain.or(forms.first()) else { continue };
            let blur = form.change == Change::Blur;
            let values = vec![if blur { form.probe } else { 0.0 }; form.change.names().len()];
            state.parts.push(Part { id, form: form.clone(), values });
        }
        let parameters = self.parameters(&state);
        let fitted = solve::fit(self.view(), Predicted::of(self.view(), state), &parameters);
        let settled = self.settled(fitted);
        Predicted::of(self.view(), settled)
    }

    /// The noise of the pixels beside the best prediction.
    pub(crate) fn white_noise(&self, best: &Predicted) -> Option<White> {
        let key = self.rows.noise_key(&self.sights, best);
        let fitted = self.parameters(&best.state).len();
        let left = solve::sigmas(&self.rows, &key, &best.error(self.view()), fitted);
        white_noise(Neighbours {
            measured: &self.rows.measured,
            predicted: &best.dn,
            place: &self.places(),
            pitch_px: self.pitch_px(),
            left: Some(&left),
            shared_within_px: self.shared_within_px,
            least_noise: self.rows.least_noise,
        })
    }
}
