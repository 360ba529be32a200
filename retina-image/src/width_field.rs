//! The widths of spots as a function of their place: a sharpest spot and a defocus that varies over the field.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

/// Terms of the defocus: 1; u, v (a tilt of the sensor); u^2, u v, v^2 (field curvature, astigmatism); r^4.
const DEFOCUS: usize = 7;
const PARAMETERS: usize = DEFOCUS + 2;
/// How well a spot says its log width, at the least: pixels, coma.
const SPOT_SIGMA: f64 = 0.03;
/// Standard deviations beforehand: of the sharpest log width about the narrow spots', of its growth with r^2, and of
/// the defocus' terms in units of the median width. With few spots they keep the field flat.
const PRIOR_SIGMA: [f64; 3] = [0.3, 0.2, 1.0];
/// Squared distances from the centre at which the defocus is tried to change its sign.
const SIGN_CHANGES: [f64; 8] = [0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0, f64::INFINITY];
const MOST_STEPS: usize = 40;

/// Place and log of the standard deviation of one spot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeasuredWidth {
    pub(crate) at_px: [f64; 2],
    pub(crate) log_sigma: f64,
}

/// sigma^2 = exp(2 a + 2 b r^2) + q^2, q = c0 + c1 u + c2 v + c3 u^2 + c4 u v + c5 v^2 + c6 r^4; (u, v) from the centre
/// in halves of the image's larger side, r^2 = u^2 + v^2. A blur by defocus adds to the sharpest spot's variance the
/// square of what is, to the second order, a quadratic form of the field.
#[derive(Debug, Clone)]
pub(crate) struct WidthField {
    parameters: [f64; PARAMETERS],
    /// Of the log width, as measured, with a margin: no polynomial leads beyond.
    range: [f64; 2],
    centre_px: [f64; 2],
    half_px: f64,
}

impl WidthField {
    /// The same everywhere.
    pub(crate) fn constant(sigma_px: f64) -> Self {
        let mut parameters = [0.0; PARAMETERS];
        parameters[0] = sigma_px.ln();
        Self { parameters, range: [sigma_px.ln(); 2], centre_px: [0.0; 2], half_px: 1.0 }
    }

    /// Through three spots or more of an image; `sorted` are their log widths. Merged spots and ghosts, wider than all
    /// their neighbours, count less the farther they are off.
    pub(crate) fn through(size_px: [f64; 2], spots: &[MeasuredWidth], sorted: &[f64]) -> Self {
        let typical = sorted[sorted.len() / 2].exp();
        let mut field = Self::constant(typical);
        field.centre_px = size_px.map(|side| side / 2.0);
        field.half_px = size_px[0].max(size_px[1]) / 2.0;
        let sharpest_log = sorted[sorted.len() / 20];
        let rows: Vec<Row> = spots
            .iter()
            .map(|spot| Row { terms: field.terms(spot.at_px), log_sigma: spot.log_sigma })
            .collect();
        let Some(start) = first_defocus(&rows, sharpest_log) else { return field };
        let mut prior = [(0.0, f64::INFINITY); PARAMETERS];
        prior[0] = (sharpest_log, PRIOR_SIGMA[0]);
        prior[1] = (0.0, PRIOR_SIGMA[1]);
        prior[3..].fill((0.0, PRIOR_SIGMA[2] * typical));
        let mut first = [0.0; PARAMETERS];
        first[0] = sharpest_log;
        first[2..].copy_from_slice(&start);
        field.parameters = refined(&rows, &prior, first);
        let fitted = rows.iter().filter(|row| off(row, &field.parameters).abs() < 5.0 * SPOT_SIGMA);
        let (lo, hi) = fitted.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), row| {
            (lo.min(row.log_sigma), hi.max(row.log_sigma))
        });
        if lo <= hi {
            field.range = [lo - 0.1, hi + 0.1];
        }
        field
    }

    /// Standard deviation of a spot at a place, px.
    pub(crate) fn at_px(&self, at_px: [f64; 2]) -> f64 {
        log_width(&self.terms(at_px), &self.parameters).0.clamp(self.range[0], self.range[1]).exp()
    }

    /// r^2, and the defocus' terms.
    fn terms(&self, at_px: [f64; 2]) -> (f64, [f64; DEFOCUS]) {
        let [u, v] = [0, 1].map(|k| (at_px[k] - self.centre_px[k]) / self.half_px);
        let r2 = u * u + v * v;
        (r2, [1.0, u, v, u * u, u * v, v * v, r2 * r2])
    }
}

struct Row {
    terms: (f64, [f64; DEFOCUS]),
    log_sigma: f64,
}

/// Log width and its derivatives by the parameters.
fn log_width((r2, terms): &(f64, [f64; DEFOCUS]), p: &[f64; PARAMETERS]) -> (f64, [f64; PARAMETERS]) {
    let sharpest = (2.0 * (p[0] + p[1] * r2)).exp();
    let defocus: f64 = terms.iter().zip(&p[2..]).map(|(t, c)| t * c).sum();
    let variance = sharpest + defocus * defocus;
    let mut slopes = [0.0; PARAMETERS];
    slopes[0] = sharpest / variance;
    slopes[1] = r2 * slopes[0];
    for (slope, term) in slopes[2..].iter_mut().zip(terms) {
        *slope = defocus * term / variance;
    }
    (0.5 * variance.ln(), slopes)
}

fn off(row: &Row, p: &[f64; PARAMETERS]) -> f64 {
    row.log_sigma - log_width(&row.terms, p).0
}

/// A start: a width says the defocus but for its sign, which changes at some distance from the centre or nowhere. Of
/// all that are tried the one that the terms follow best.
fn first_defocus(rows: &[Row], sharpest_log: f64) -> Option<[f64; DEFOCUS]> {
    let size = |row: &Row| ((2.0 * row.log_sigma).exp() - (2.0 * sharpest_log).exp()).max(0.0).sqrt();
    let mut normal = Mat::<f64>::from_fn(DEFOCUS, DEFOCUS, |i, j| if i == j { 0.01 } else { 0.0 });
    for row in rows {
        for i in 0..DEFOCUS {
            for j in 0..DEFOCUS {
                normal[(i, j)] += row.terms.1[i] * row.terms.1[j];
            }
        }
    }
    let solver = normal.llt(Side::Lower).ok()?;
    let tried = SIGN_CHANGES.map(|change| {
        let signed = |row: &Row| if row.terms.0 > change { -size(row) } else { size(row) };
        let right =
            Mat::<f64>::from_fn(DEFOCUS, 1, |i, _| rows.iter().map(|row| row.terms.1[i] * signed(row)).sum());
        let found = solver.solve(&right);
        let found: [f64; DEFOCUS] = std::array::from_fn(|i| found[(i, 0)]);
        let value = |row: &Row| row.terms.1.iter().zip(&found).map(|(t, c)| t * c).sum::<f64>();
        let cost: f64 = rows.iter().map(|row| (value(row) - signed(row)).powi(2)).sum();
        (cost, found)
    });
    tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|best| best.1)
}

/// Least squares by Levenberg and Marquardt, of 2 (sqrt(1 + z^2) - 1) for each spot's normalised residual z, beside the
/// prior (mean, sigma) of each parameter.
fn refined(rows: &[Row], prior: &[(f64, f64); PARAMETERS], start: [f64; PARAMETERS]) -> [f64; PARAMETERS] {
    let cost = |p: &[f64; PARAMETERS]| {
        let seen: f64 =
            rows.iter().map(|row| 2.0 * ((1.0 + (off(row, p) / SPOT_SIGMA).powi(2)).sqrt() - 1.0)).sum();
        let known: f64 = prior.iter().zip(p).map(|((mean, sigma), v)| ((v - mean) / sigma).powi(2)).sum();
        seen + known
    };
    let mut p = start;
    let mut best = cost(&p);
    let mut damping = 1e-3;
    for _ in 0..MOST_STEPS {
        let mut normal = Mat::<f64>::zeros(PARAMETERS, PARAMETERS);
        let mut right = Mat::<f64>::zeros(PARAMETERS, 1);
        for row in rows {
            let (value, slopes) = log_width(&row.terms, &p);
            let off = row.log_sigma - value;
            let weight = 1.0 / (SPOT_SIGMA * SPOT_SIGMA * (1.0 + (off / SPOT_SIGMA).powi(2)).sqrt());
            for i in 0..PARAMETERS {
                right[(i, 0)] += weight * slopes[i] * off;
                for j in 0..PARAMETERS {
                    normal[(i, j)] += weight * slopes[i] * slopes[j];
                }
            }
        }
        for (i, (mean, sigma)) in prior.iter().enumerate() {
            normal[(i, i)] += 1.0 / (sigma * sigma);
            right[(i, 0)] += (mean - p[i]) / (sigma * sigma);
        }
        (0..PARAMETERS).for_each(|i| normal[(i, i)] += damping * normal[(i, i)] + 1e-9);
        let Ok(solver) = normal.llt(Side::Lower) else { break };
        let step = solver.solve(&right);
        let next = std::array::from_fn(|i| p[i] + step[(i, 0)]);
        let found = cost(&next);
        if found < best {
            let gained = best - found;
            (p, best, damping) = (next, found, damping * 0.1);
            if gained < 1e-6 * best {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE_PX: [f64; 2] = [2048.0, 1536.0];

    /// Widths of a camera whose focal surface is a bowl about a place off the centre: 1.1 px where it is sharp.
    fn bowl_px(at: [f64; 2]) -> f64 {
        let r2 = ((at[0] - 1000.0).powi(2) + (at[1] - 800.0).powi(2)) / 1024.0f64.powi(2);
        1.1f64.hypot(3.4 * (1.0 - r2 / 0.65))
    }

    /// Places by the additive recurrence of the plastic number: even, and others for each count.
    fn spots(count: usize) -> Vec<MeasuredWidth> {
        (0..count)
            .map(|i| {
                let at_px = [(i as f64 * 0.754_877_666_2).fract(), (i as f64 * 0.569_840_291_0).fract()];
                let at_px = [at_px[0] * SIZE_PX[0], at_px[1] * SIZE_PX[1]];
                // Every tenth is merged with another.
                let merged = if i % 10 == 7 { 0.6 } else { 0.0 };
                MeasuredWidth { at_px, log_sigma: bowl_px(at_px).ln() + merged }
            })
            .collect()
    }

    fn through(spots: &[MeasuredWidth]) -> WidthField {
        let mut logs: Vec<f64> = spots.iter().map(|spot| spot.log_sigma).collect();
        logs.sort_by(f64::total_cmp);
        WidthField::through(SIZE_PX, spots, &logs)
    }

    #[test]
    fn a_curved_field_is_found_whatever_the_number_of_spots() {
        for (count, within) in [(25, 0.08), (50, 0.03), (400, 0.02)] {
            let field = through(&spots(count));
            for (x, y) in [(1024.0, 768.0), (100.0, 100.0), (1900.0, 1400.0), (300.0, 900.0), (1000.0, 200.0)]
            {
                let off = (field.at_px([x, y]) / bowl_px([x, y])).ln();
                assert!(off.abs() < within, "{count} spots at {x}, {y}: {off}");
            }
        }
    }

    #[test]
    fn three_spots_of_one_width_are_a_flat_field() {
        let spots = [[300.0, 300.0], [1500.0, 400.0], [900.0, 1200.0]]
            .map(|at_px| MeasuredWidth { at_px, log_sigma: 1.3f64.ln() });
        let field = through(&spots);
        for at in [[10.0, 10.0], [2000.0, 1500.0], [1024.0, 768.0]] {
            assert!((field.at_px(at) - 1.3).abs() < 0.01);
        }
    }
}
