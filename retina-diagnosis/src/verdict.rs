//! What a diagnosis comes to.

use crate::data::Dataset;

/// The outcome.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// No effect and no structure beyond noise.
    Adequate,
    /// Each accepted effect is the only one that fits.
    Named,
    /// This data cannot separate several.
    Confounded,
    /// Structure that no effect of the catalogue explains.
    Unknown,
    /// Nothing was found, and these data could not have shown it.
    Undecided,
}

/// What a verdict is made of.
#[derive(Debug, Clone, Copy)]
pub struct Findings {
    /// Structure is left.
    pub structure: bool,
    /// No effect was accepted.
    pub nothing: bool,
    /// An accepted effect has rivals.
    pub several: bool,
    /// Too many rows are outliers.
    pub outliers: bool,
    /// These data cannot say whether something is left.
    pub too_little: bool,
}

/// Share of outliers above which a model does not describe the table, whatever it leaves of the other rows.
const MOST_OUTLIERS: f64 = 0.2;

/// Whether so many rows are outliers that nothing said of the others speaks for the table.
pub fn too_many_outliers(data: &Dataset, outliers: usize) -> bool {
    outliers as f64 > MOST_OUTLIERS * data.len() as f64
}

impl Verdict {
    /// From what was found.
    pub fn of(found: Findings) -> Self {
        if found.structure || (found.nothing && found.outliers) {
            return Self::Unknown;
        }
        match (found.nothing, found.too_little, found.several) {
            (true, true, _) => Self::Undecided,
            (true, false, _) => Self::Adequate,
            (false, _, true) => Self::Confounded,
            (false, _, false) => Self::Named,
        }
    }

    /// Its name in JSON.
    pub fn name(self) -> &'static str {
        ["adequate", "named", "confounded", "unknown", "undecided"][self as usize]
    }
}
