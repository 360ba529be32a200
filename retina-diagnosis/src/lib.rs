//! What a model leaves unexplained in measurements, and which physical effect explains it.
//!
//! - [`Dataset`]: points, power or phase tables as residuals with groups and covariates; [`Pixels`]: those of frames.
//! - [`compare`]: errors against the noise, and what they depend on.
//! - [`diagnose`]: which effect is missing, and which ones this data cannot tell apart.
//! - [`fit`]: effects estimated with the baseline; [`AddedEffect`]: catalogued, formulas in a file, or an [`OwnEffect`].
//! - [`Rivals`]: models that rival each other, judged, and told apart by exposures that are planned.
//! - [`effects`]: the catalogue.

mod added;
mod balance;
mod catalogue;
mod cells;
mod chance;
mod compare;
mod data;
mod decode;
mod diagnose;
mod doubts;
mod edge;
mod effect_file;
mod estimate;
mod field;
mod figure;
mod fit;
mod flips;
mod floor;
mod following;
mod form_error;
mod formula;
mod headline;
mod json;
mod kept;
mod lags;
mod level;
mod level_columns;
mod levels;
mod levels_left;
mod linear;
mod model_file;
mod next;
mod noise;
mod other_columns;
mod output;
mod own;
mod pairs;
mod parts;
mod patterns;
mod physical;
mod pixel_noise;
mod ranking;
mod remainder;
mod report;
mod retraced;
mod rivals;
mod scatter;
mod score;
mod screens;
mod search;
mod series;
mod step;
mod sufficient;
mod together;
mod uncertainty;
mod unexplained;
mod units;
mod verdict;
mod wander;
mod whitening;

pub use added::{AddedEffect, check_effects};
pub use catalogue::{Effect, effects};
pub use compare::{Comparison, Dependence, WorstGroup, compare};
pub use data::{
    Baseline, Covariate, Dataset, FittedLens, Group, MOST_PIXELS, Measure, PixelColumn, PixelEffect,
    PixelForm, PixelPart, Pixels, Placement, Source, lens_of_fit,
};
pub use decode::{Decoded, Reading, decode};
pub use diagnose::{Candidate, DiagnoseOptions, Diagnosis, NotTestable, diagnose, diagnose_step};
pub use estimate::{Implausible, Parameter, implausible};
pub use figure::{axis_label, figure_svg, write_figure};
pub use fit::{Fit, fit};
pub use following::lag_name;
pub use formula::{column_text, unit_of_column};
pub use headline::headline;
pub use json::{compare_json, diagnose_json, effects_json, fit_json};
pub use kept::{KeptEffect, KeptFormula, diagnose_with_kept, kept_effects};
pub use levels_left::FormScore;
pub use model_file::write_model;
pub use next::NextMeasurement;
pub use output::{compare_text, diagnose_text, effects_text, fit_text, predictions_text, write_predictions};
pub use own::{OwnEffect, OwnParameter, difference_step};
pub use parts::{Halves, Part, Proof, TooFew};
pub use physical::Physical;
pub use pixel_noise::{Neighbours, White, white_noise};
pub use remainder::{LeftOut, Remainder};
pub use report::{
    Shape, compare_page, diagnose_page, effects_page, fit_page, fit_page_under, followed_svg, signature_svgs,
    unexplained_shapes,
};
pub use rivals::{Apart, DesignRows, Judgement, Rival, Rivals};
pub use scatter::Noise;
pub use step::Step;
pub use unexplained::Unexplained;
pub use verdict::{Findings, Verdict, too_many_outliers};
