//! How the noise of power readings follows the light, before it is known how large it is.
//!
//! A meter's readings scatter by a share of the light and by a floor that is the same in the dark:
//! sigma^2 = share^2 + (floor / light)^2, relative to the light. Where the dimmest readings are below the floor this
//! changes by decades within one group of like brightness, and a level for the group would call them outliers.

use retina_formats::TableKind;

use crate::data::Dataset;
use crate::noise::{MEDIAN_LENGTH, OUTLIER_SIGMAS};
use crate::series::median;

/// Lights at which floor and share are equal are tried at this ratio of one another.
const RATIO: f64 = 1.5;
/// ln of the likelihood by which a floor has to be likelier than none: a parameter's two standard errors.
const LEAST_GAIN: f64 = 2.0;

/// The noise that is expected of each row, in units that all rows share; 1 where the table holds no readings of a power
/// meter. `length` are the sizes of the rows' errors. Errors beyond the limit of outliers all count alike.
pub(crate) fn expected(data: &Dataset, length: &[f64], outlier: &[bool]) -> Vec<f64> {
    if data.kind != TableKind::Power {
        return vec![1.0; data.len()];
    }
    if let Some(stated) = &data.stated {
        let level = median(stated);
        return stated.iter().map(|sigma| sigma / level).collect();
    }
    let dark = data.values("per_irradiance");
    let mut rows: Vec<usize> = (0..data.len()).filter(|&row| !outlier[row]).collect();
    if rows.is_empty() {
        rows = (0..data.len()).collect();
    }
    let brightest = dark.iter().copied().fold(f64::INFINITY, f64::min);
    let dimmest = dark.iter().copied().fold(0.0, f64::max);
    let shape = |equal: f64, row: usize| 1.0_f64.hypot(dark[row] / equal);
    let loss = |equal: f64| -> f64 {
        let scaled: Vec<f64> = rows.iter().map(|&row| length[row] / shape(equal, row)).collect();
        let sigma = (median(&scaled) / MEDIAN_LENGTH[0]).max(data.least_noise());
        let each = |(&row, scaled): (&usize, &f64)| {
            shape(equal, row).ln() + sigma.ln() + 0.5 * (scaled / sigma).min(OUTLIER_SIGMAS).powi(2)
        };
        rows.iter().zip(&scaled).map(each).sum()
    };
    let mut best = (f64::INFINITY, loss(f64::INFINITY) - LEAST_GAIN);
    let mut equal = dimmest * RATIO;
    while equal > brightest / RATIO {
        let tried = loss(equal);
        if tried < best.1 {
            best = (equal, tried);
        }
        equal /= RATIO;
    }
    (0..data.len()).map(|row| shape(best.0, row)).collect()
}
