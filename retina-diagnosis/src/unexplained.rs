//! What is left when all effects have been tried: the columns on which errors still depend.

use crate::flips::{Flips, p_values};
use crate::lags;
use crate::level_columns::level_column;
use crate::pairs::{Look, Shared, look};
use crate::score::Frame;
use crate::screens::{columns_of, screen_p_values, screens};

/// Errors that are left.
#[derive(Debug, Clone)]
pub struct Unexplained {
    /// Smallest p-value of the screens, corrected for their number.
    pub p_value: f64,
    /// Columns on which the errors depend.
    pub covariates: Vec<String>,
    /// Widest cells within which neighbours share an error, where that is what was found: px of the screen, of images px
    /// of the camera.
    pub width_px: Option<f64>,
    /// Ripples that would have been found with 95 %: their wavelength in the same pixels, and their amplitude in the
    /// table's unit.
    pub visible: Vec<[f64; 2]>,
    /// What neighbours share significantly, and yet so little that it does not count.
    pub weak: Option<Weak>,
}

/// Structure far below the noise.
#[derive(Debug, Clone)]
pub struct Weak {
    /// The columns of the cells.
    pub covariates: Vec<String>,
    /// Width of the cells in pixels of the screen.
    pub width_px: Option<f64>,
    /// Its rms over that of the noise.
    pub strength: f64,
}

/// What neighbours share counts from this part of the noise on: every facility has fixed patterns of its pixels far
/// below its noise. Weaker ones are told of in a note.
const FLOOR_SHARED: f64 = 0.4;

/// Seed of the draws of the neighbours' test.
const PAIRS_SEED: u64 = 2;
/// Wavelengths of ripples for which the test's power is told, px of the screen.
const WAVELENGTHS_PX: [f64; 4] = [50.0, 100.0, 200.0, 400.0];

/// Screens of what is left, significant at `level`; the strongest is taken out before further ones are looked for at
/// the level `later`. None weaker than `floor`, rms over noise, counts.
pub(crate) fn unexplained(
    frame: &Frame<'_>,
    [level, later]: [f64; 2],
    floor: f64,
    flips: &Flips,
) -> Unexplained {
    let data = frame.data;
    let tested = || {
        let all = screens(frame);
        let p = screen_p_values(&all, flips);
        (all, p)
    };
    let neighbours = || look(frame, PAIRS_SEED, &WAVELENGTHS_PX, FLOOR_SHARED);
    let ((all, p), (levels, Look { mut shared, mut visible })) =
        rayon::join(tested, || rayon::join(|| level_column(frame), neighbours));
    // Two tests, of pixels and of levels one more, the smallest p-value of which counts: it is corrected for their number
    // (Z. Sidak, JASA 62, 1967).
    let tests = 2.0 + f64::from(u8::from(data.pixels().is_some())) + f64::from(u8::from(levels.is_some()));
    let of_all = |p: f64| -(tests * (-p).ln_1p()).exp_m1();
    let p: Vec<f64> = p.into_iter().map(of_all).collect();
    if let Some(pixels) = data.pixels() {
        let near = lags::look(frame, pixels, FLOOR_SHARED);
        shared.extend(near.shared);
        shared.sort_by(|a, b| a.p_value.total_cmp(&b.p_value).then(b.deviate.total_cmp(&a.deviate)));
        visible = near.visible;
    }
    let components = frame.components();
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by(|&a, &b| all[b].score.deviate().total_cmp(&all[a].score.deviate()));
    let counts = |shared: &&Shared| shared.strength >= FLOOR_SHARED;
    let least_shared = shared.iter().find(counts).map_or(1.0, |shared| of_all(shared.p_value));
    let of_levels = levels.as_ref().map_or(1.0, |levels| of_all(levels.p_value));
    let p_value = p.iter().copied().fold(1.0, f64::min).min(least_shared).min(of_levels);
    let mut width_px = None;
    let mut covariates: Vec<String> = Vec::new();
    let first = order.iter().find(|&&i| p[i] <= level && all[i].score.strength(components) >= floor);
    if let Some(&first) = first {
        covariates.extend(all[first].covariates.iter().cloned());
        if depends_on_place(frame, &all[first].covariates, level, floor, flips) {
            covariates.extend(["x".to_owned(), "y".to_owned()]);
        }
        // What remains beside the strongest names further columns.
        let wider = frame.with(&columns_of(data, &all[first].covariates));
        let rest = screens(&wider);
        let p = screen_p_values(&rest, flips);
        for (screen, _) in
            rest.iter().zip(&p).filter(|(s, p)| **p <= later && s.score.strength(components) >= 2.0 * floor)
        {
            for name in &screen.covariates {
                if screen.covariates.len() == 1 && !covariates.contains(name) {
                    covariates.push(name.clone());
                }
            }
        }
    } else if let Some(levels) = levels.filter(|_| of_levels <= level) {
        covariates.push(levels.name);
    } else if let Some(found) = shared.iter().find(|shared| of_all(shared.p_value) <= level && counts(shared))
    {
        covariates.extend(found.covariates.iter().cloned());
        // Wide cells hold less of a pattern's strength; what is significant in them is shared all the same.
        let same = |s: &&Shared| s.covariates == found.covariates && of_all(s.p_value) <= level;
        width_px = shared.iter().filter(same).filter_map(|s| s.width_px).reduce(f64::max);
    }
    let weak = shared
        .iter()
        .filter(|s| covariates.is_empty() && of_all(s.p_value) <= level)
        .max_by(|a, b| a.strength.total_cmp(&b.strength))
        .map(|s| Weak { covariates: s.covariates.clone(), width_px: s.width_px, strength: s.strength });
    Unexplained { p_value, covariates, width_px, visible, weak }
}

/// Whether what depends on one column also points along or across the radius, and not the same way everywhere.
fn depends_on_place(frame: &Frame<'_>, covariates: &[String], level: f64, floor: f64, flips: &Flips) -> bool {
    if frame.data.components() == 1 || covariates.len() > 1 {
        return false;
    }
    // Columns along one axis are the same all over the field.
    let (same, placed): (Vec<_>, Vec<_>) = columns_of(frame.data, covariates)
        .into_iter()
        .partition(|column| (0..2).any(|axis| column.chunks(2).all(|row| row[axis] == 0.0)));
    if placed.is_empty() {
        return false;
    }
    let beside = frame.with(&same);
    let score = beside.score(&placed);
    score.rank() > 0
        && score.strength(frame.components()) >= floor
        && p_values(&[vec![&score]], flips)[0] <= level
}
