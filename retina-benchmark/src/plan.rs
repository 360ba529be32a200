//! Which sets a benchmark has: each is told by the benchmark's seed and its own number.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::forms::{FORMULA, KNOWN, OUTSIDE, needs_colours};
use crate::formulas::Formula;
use crate::points::{Campaign, Chamber, Hidden, nature};
use crate::power_formulas::PowerFormula;
use crate::readings::{PHASE, POWER};

/// What a set tries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    /// Points without an effect.
    Null,
    /// One effect on points.
    Single,
    /// One that the catalogue does not have.
    Outside,
    /// Two of different classes.
    Pair,
    /// One that a campaign cannot tell from another, and the follow-ups that could.
    Confounded,
    /// Power readings.
    Power,
    /// A phase curve.
    Phase,
    /// A formula that nobody knows; half of the sets have none.
    Formula,
    /// The same of power readings.
    FormulaPower,
}

impl Kind {
    /// Its name.
    pub(crate) fn name(self) -> &'static str {
        ["null", "single", "outside", "pair", "confounded", "power", "phase", "formula", "formula-power"]
            [self as usize]
    }
}

/// A set's truth.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Plan {
    pub(crate) set: usize,
    pub(crate) kind: Kind,
    pub(crate) hidden: Vec<Hidden>,
    /// Columns that an outside effect depends on.
    pub(crate) covariates: Vec<String>,
    pub(crate) campaign: Campaign,
}

/// Kinds within a round of forty sets.
const ROUND: [(Kind, usize); 7] = [
    (Kind::Single, 16),
    (Kind::Null, 12),
    (Kind::Outside, 3),
    (Kind::Pair, 2),
    (Kind::Confounded, 2),
    (Kind::Power, 3),
    (Kind::Phase, 2),
];
const STRENGTHS: [f64; 5] = [1.0, 0.3, 3.0, 10.0, 0.1];
/// A centroid that is off by most of a pixel is none.
const LARGEST_PHASE: f64 = 1.0;

/// Classes that one campaign cannot separate, from the table of effects.
pub(crate) const CLASSES: [&[&str]; 4] = [
    &["screen_tilt", "camera_pointing", "decentering", "optical_centre", "thin_prism"],
    &["thermal_boresight", "drift"],
    &["background_gradient", "flux_shift"],
    &["colour_wedge", "subpixel_offset"],
];

/// The class of an effect; alone where it is in none.
pub(crate) fn class_of(id: &str) -> Vec<&str> {
    CLASSES.iter().find(|class| class.contains(&id)).map_or_else(|| vec![id], |class| class.to_vec())
}

/// Strengths of formulas.
const FORMULA_STRENGTHS: [f64; 4] = [1.0, 3.0, 10.0, 0.3];

/// The plan of a set of formulas: every second has one, the others a known effect, honest noise or nothing at all.
pub(crate) fn formula_plan(seed: u64, set: usize) -> Plan {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(1_000_000 + set as u64);
    let mut campaign = Campaign {
        rows: 2000,
        exposures: 40,
        jitter: (random.random_range(0..31) as f64) / 100.0,
        outliers: (random.random_range(0..9) as f64) / 100.0,
        colours: false,
        chamber: Chamber::Hunting,
        roll_deg: 0.0,
        seed: random.random(),
        wander: 0.0,
    };
    let number = set / 2;
    let one = |id: &str, strength: f64| Hidden { id: id.to_owned(), strength };
    let (mut hidden, mut covariates) = (Vec::new(), Vec::new());
    if set.is_multiple_of(2) {
        covariates = Formula::of(nature(campaign.seed, 0).seed).columns();
        hidden.push(one(FORMULA, FORMULA_STRENGTHS[number % FORMULA_STRENGTHS.len()]));
    } else {
        match number % 3 {
            0 => {}
            1 => {
                campaign.jitter = 0.5 + 0.5 * (random.random_range(0..101) as f64) / 100.0;
                campaign.wander = 0.3 + 0.5 * (random.random_range(0..101) as f64) / 100.0;
            }
            _ => {
                let id = KNOWN[number / 3 % KNOWN.len()];
                campaign.colours = needs_colours(id);
                let strength = STRENGTHS[number / 3 % STRENGTHS.len()];
                hidden.push(one(
                    id,
                    if id.ends_with("_pixel_phase") { strength.min(LARGEST_PHASE) } else { strength },
                ));
            }
        }
    }
    Plan { set, kind: Kind::Formula, hidden, covariates, campaign }
}

/// The plan of a set of power readings with formulas: every second has one, the others a known effect, a meter that
/// repeats badly, or nothing at all.
pub(crate) fn formula_power_plan(seed: u64, set: usize) -> Plan {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(2_000_000 + set as u64);
    let mut campaign = Campaign {
        rows: 480,
        exposures: 24,
        jitter: 0.25,
        outliers: 0.0,
        colours: true,
        chamber: Chamber::Hunting,
        roll_deg: 0.0,
        seed: random.random(),
        wander: 0.0,
    };
    let number = set / 2;
    let (mut hidden, mut covariates) = (Vec::new(), Vec::new());
    if set.is_multiple_of(2) {
        covariates = PowerFormula::of(nature(campaign.seed, 0).seed).columns();
        let strength = FORMULA_STRENGTHS[number % FORMULA_STRENGTHS.len()];
        hidden.push(Hidden { id: FORMULA.to_owned(), strength });
    } else {
        match number % 3 {
            0 => {}
            1 => campaign.jitter = 1.5,
            _ => hidden.push(Hidden {
                id: POWER[number / 3 % POWER.len()].to_owned(),
                strength: STRENGTHS[number / 3 % STRENGTHS.len()],
            }),
        }
    }
    Plan { set, kind: Kind::FormulaPower, hidden, covariates, campaign }
}

/// The plan of a set.
pub(crate) fn plan(seed: u64, set: usize) -> Plan {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(set as u64);
    // Forty and seven have no common divisor: every round mixes its kinds.
    let mut place = set * 7 % 40;
    let round = set / 40;
    let (mut kind, mut number) = (Kind::Null, 0);
    for (k, count) in ROUND {
        if place < count {
            (kind, number) = (k, round * count + place);
            break;
        }
        place -= count;
    }
    let at = |list: usize| number % list;
    let strength = |list: usize| STRENGTHS[(number / list + number) % STRENGTHS.len()];
    let rows = match random.random_range(0..100) {
        0..30 => 500,
        30..97 => 2000,
        _ => 20_000,
    };
    let mut campaign = Campaign {
        rows,
        exposures: 40,
        jitter: (random.random_range(0..31) as f64) / 100.0,
        outliers: (random.random_range(0..9) as f64) / 100.0,
        colours: random.random_range(0..10) < 3,
        chamber: Chamber::Hunting,
        roll_deg: 0.0,
        seed: random.random(),
        wander: 0.0,
    };
    let mut covariates = Vec::new();
    let one = |id: &str, strength: f64| Hidden {
        id: id.to_owned(),
        strength: if id.ends_with("_pixel_phase") { strength.min(LARGEST_PHASE) } else { strength },
    };
    let hidden = match kind {
        Kind::Null => {
            campaign.jitter = (random.random_range(0..101) as f64) / 100.0;
            Vec::new()
        }
        Kind::Single => vec![one(KNOWN[at(KNOWN.len())], strength(KNOWN.len()))],
        Kind::Outside => {
            let (id, columns) = OUTSIDE[at(OUTSIDE.len())];
            covariates = columns.iter().map(|c| (*c).to_owned()).collect();
            vec![one(id, [0.3, 1.0, 3.0][number / OUTSIDE.len() % 3])]
        }
        Kind::Pair => {
            let first = KNOWN[random.random_range(0..KNOWN.len())];
            let second = loop {
                let other = KNOWN[random.random_range(0..KNOWN.len())];
                if !class_of(first).contains(&other) {
                    break other;
                }
            };
            let s = [0.3, 1.0, 3.0][number % 3];
            vec![one(first, s), one(second, s)]
        }
        Kind::Confounded => {
            let id = ["screen_tilt", "thermal_boresight", "camera_pointing", "drift"][at(4)];
            if at(2) == 1 {
                campaign.chamber = Chamber::WarmUp;
            }
            vec![one(id, [0.3, 1.0, 3.0][number / 4 % 3])]
        }
        Kind::Power => match number % (POWER.len() + 3) {
            k if k < POWER.len() => vec![one(POWER[k], [1.0, 3.0, 0.3][number / (POWER.len() + 3) % 3])],
            _ => Vec::new(),
        },
        Kind::Phase => match number % (PHASE.len() + 2) {
            k if k < PHASE.len() => vec![one(PHASE[k], [1.0, 3.0, 0.3][number / (PHASE.len() + 2) % 3])],
            _ => Vec::new(),
        },
        Kind::Formula => return formula_plan(seed, set),
        Kind::FormulaPower => return formula_power_plan(seed, set),
    };
    campaign.colours |= hidden.iter().any(|h| needs_colours(&h.id));
    Plan { set, kind, hidden, covariates, campaign }
}
