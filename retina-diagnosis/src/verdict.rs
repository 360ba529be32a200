//! What a diagnosis comes to.

use crate::data::Dataset;

/// The outcome.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// No effect beyond noise.
    Adequate,
    /// Each accepted effect is the only one that fits.
    Named,
    /// This data cannot separate several.
    Confounded,
    /// Structure that no effect of the catalogue explains.
    Unknown,
}

/// Share of outliers above which a model does not describe the table, whatever it leaves of the other rows.
const MOST_OUTLIERS: f64 = 0.2;

/// Whether so many rows are outliers that nothing said of the others speaks for the table.
pub fn too_many_outliers(data: &Dataset, outliers: usize) -> bool {
    outliers as f64 > MOST_OUTLIERS * data.len() as f64
}

impl Verdict {
    /// From what was found: structure that is left, nothing accepted, a set with several members, too many outliers.
    pub fn of(structure: bool, nothing: bool, several: bool, outliers: bool) -> Self {
        match (structure || (nothing && outliers), nothing, several) {
            (true, ..) => Self::Unknown,
            (false, true, _) => Self::Adequate,
            (false, false, true) => Self::Confounded,
            (false, false, false) => Self::Named,
        }
    }

    /// Its name in JSON.
    pub fn name(self) -> &'static str {
        ["adequate", "named", "confounded", "unknown"][self as usize]
    }
}
