//! Which rival is left.

use retina_diagnosis::{Judgement, Rival, Rivals};

/// ln of the odds at which a rival is ruled out: 100 to 1.
pub(crate) const LN_ODDS: f64 = 4.605_170_185_988_092;

/// Of a hundred normal levels the largest is beyond this in one case of 1500.
const MISFIT_SIGMAS: f64 = 4.5;

/// What is known of the rivals.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// What the data say of each.
    pub judgements: Vec<Judgement>,
    /// The likeliest.
    pub best: usize,
    /// Those that are not ruled out, the best first.
    pub left: Vec<usize>,
}

impl Decision {
    /// Judges rivals by their fits: one that is a hundred times less likely than the best is ruled out.
    pub fn of(rivals: &Rivals<'_>) -> Self {
        let judgements = rivals.judgements().to_vec();
        let mut order: Vec<usize> = (0..judgements.len()).collect();
        order.sort_by(|&a, &b| judgements[b].ln_evidence.total_cmp(&judgements[a].ln_evidence));
        let best = order[0];
        order.retain(|&k| judgements[k].ln_odds_against < LN_ODDS);
        Self { judgements, best, left: order }
    }

    /// The only one that is left, if it describes every exposure.
    pub fn decided(&self) -> Option<usize> {
        (self.left.len() == 1 && self.misfit().is_none()).then_some(self.best)
    }

    /// The exposure that the likeliest rival does not describe, as the number of its group, and by how many standard deviations its level is off: then
    /// none of the rivals may be the true one.
    pub fn misfit(&self) -> Option<&(usize, f64)> {
        Some(&self.judgements[self.best].worst_level).filter(|(_, sigmas)| *sigmas > MISFIT_SIGMAS)
    }

    /// Names of those that are left.
    pub fn names<'r>(&self, rivals: &'r [Rival]) -> Vec<&'r str> {
        self.left.iter().map(|&k| rivals[k].name.as_str()).collect()
    }
}
