//! What pixels share with pixels at some distance: structure of any shape, from one pixel to a few dozen.
//!
//! With e_i the whitened errors, T = sum of e_i e_j over the pairs whose distance lies in a ring. The noise of pixels is
//! their own: without structure T has mean 0 and variance sum e_i^2 e_j^2, whatever the noise's shape, and T over its
//! root is a normal deviate (P. Moran, Biometrika 37, 1950, over distances). Pictures that were compressed or interpolated
//! share noise within a few pixels by themselves: [`Pixels::shared_within_px`] says how far.
//!
//! [`Pixels::shared_within_px`]: crate::Pixels::shared_within_px

use crate::data::Pixels;
use crate::pairs::{Look, NINETY_FIVE, Shared};
use crate::pixel_noise::cells;
use crate::score::Frame;

/// Rings by their inner and outer radius, in pixels or bins.
const RINGS: [[f64; 2]; 6] = [[0.9, 1.1], [1.3, 2.3], [2.9, 4.2], [4.9, 8.1], [9.9, 14.1], [19.9, 24.1]];
/// Fewest pairs of a ring.
const FEWEST_PAIRS: f64 = 100.0;
/// Wavelengths of ripples for which the test's power is told, in pixels or bins.
const WAVELENGTHS: [f64; 4] = [8.0, 16.0, 32.0, 64.0];
/// p-value by which the largest of the rings' deviates has to stand out, for the power that is told.
const LEVEL: f64 = 0.005;
/// Rounds in which a ripple's own part in its scatter is found.
const ROUNDS: usize = 8;

struct Ring {
    outer: f64,
    offsets: Vec<[i64; 2]>,
    total: f64,
    sigma: f64,
    pairs: f64,
}

/// Looks at pairs of pixels. Ripples count as visible from `floor` of the noise on.
pub(crate) fn look(frame: &Frame<'_>, pixels: &Pixels, floor: f64) -> Look {
    // Without Tukey's factor, which would take less of a structure than of the noise.
    let full = |row: usize| {
        let weight = frame.weights.weight[row];
        if weight > 0.0 {
            frame.error[row] * (frame.weights.inverse_variance(row) / weight).sqrt()
        } else {
            0.0
        }
    };
    let error: Vec<f64> = (0..pixels.place.len()).map(full).collect();
    let rings = rings(frame, pixels, &error);
    let mean_square = error.iter().map(|e| e * e).sum::<f64>() / frame.weights.kept().max(1) as f64;
    let tests = rings.len() as f64;
    let mut shared: Vec<Shared> = rings
        .iter()
        .map(|ring| {
            let deviate = ring.total / ring.sigma;
            // Part of the errors' square; the rest is noise.
            let part = (ring.total / (ring.pairs * mean_square)).clamp(0.0, 0.99);
            Shared {
                covariates: vec!["camera_x_px".to_owned(), "camera_y_px".to_owned()],
                width_px: Some(ring.outer.floor() * pixels.pitch_px),
                p_value: -(tests * (-upper_tail(deviate)).ln_1p()).exp_m1(),
                strength: (part / (1.0 - part)).sqrt(),
                deviate,
            }
        })
        .collect();
    shared.sort_by(|a, b| a.p_value.total_cmp(&b.p_value).then(b.deviate.total_cmp(&a.deviate)));
    let noise = frame.weights.floor();
    let needed = deviate_of(LEVEL / tests.max(1.0));
    let amplitude = |wavelength: f64| {
        let k = std::f64::consts::TAU / wavelength;
        let of_ring = |ring: &Ring| {
            // Mean over the ring's directions of a ripple's correlation with itself; it runs along a diagonal.
            let along = ring.offsets.iter().map(|[x, y]| (k * (0.6 * *x as f64 + 0.8 * *y as f64)).cos());
            let own = along.sum::<f64>() / ring.offsets.len() as f64;
            let scatter = ring.sigma / (ring.pairs * mean_square);
            // A ripple with S times the noise's variance makes a part own S / (1 + S) of the errors'. Each pixel's noise
            // meets the ripple in all of its m pairs, which widens the sum's scatter by the root of 1 + 2 m own^2 S.
            let least = floor * floor / (1.0 + floor * floor);
            let met = 2.0 * ring.offsets.len() as f64;
            let mut ratio = 0.0;
            for _ in 0..ROUNDS {
                let with = scatter * (1.0 + 2.0 * met * own * own * ratio).sqrt();
                let part = (needed * scatter).max(least) + NINETY_FIVE * with;
                if own <= part {
                    return f64::INFINITY;
                }
                ratio = part / (own - part);
            }
            noise * (2.0 * ratio).sqrt()
        };
        rings.iter().map(of_ring).fold(f64::INFINITY, f64::min)
    };
    let visible = WAVELENGTHS.iter().map(|w| [w * pixels.pitch_px, amplitude(*w)]).collect();
    Look { shared, visible }
}

fn rings(frame: &Frame<'_>, pixels: &Pixels, error: &[f64]) -> Vec<Ring> {
    let (cells, mut rows) = cells(&pixels.place, pixels.pitch_px);
    rows.retain(|_, row| frame.weights.weight[*row] > 0.0);
    RINGS
        .iter()
        .filter(|[inner, _]| inner * pixels.pitch_px > pixels.shared_within_px)
        .filter_map(|&[inner, outer]| {
            let reach = outer as i64;
            let near = |[x, y]: &[i64; 2]| {
                let distance = (*x as f64).hypot(*y as f64);
                // One of two opposite ones.
                (*y > 0 || (*y == 0 && *x > 0)) && (inner..=outer).contains(&distance)
            };
            let all = (0..=reach).flat_map(|y| (-reach..=reach).map(move |x| [x, y]));
            let offsets: Vec<[i64; 2]> = all.filter(near).collect();
            let (mut total, mut squares, mut pairs) = (0.0, 0.0, 0.0);
            // Sums in the rows' order: a map's own order differs from run to run.
            for (row, &(image, x, y)) in cells.iter().enumerate() {
                if frame.weights.weight[row] <= 0.0 {
                    continue;
                }
                for [dx, dy] in &offsets {
                    if let Some(&other) = rows.get(&(image, x + dx, y + dy)) {
                        let product = error[row] * error[other];
                        total += product;
                        squares += product * product;
                        pairs += 1.0;
                    }
                }
            }
            let sigma = f64::sqrt(squares);
            (pairs >= FEWEST_PAIRS && sigma > 0.0).then_some(Ring { outer, offsets, total, sigma, pairs })
        })
        .collect()
}

/// Chance that a normal deviate lies above.
fn upper_tail(deviate: f64) -> f64 {
    0.5 * libm::erfc(deviate * std::f64::consts::FRAC_1_SQRT_2)
}

/// The deviate above which a normal error lies with this chance, by halving.
fn deviate_of(chance: f64) -> f64 {
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if upper_tail(middle) > chance { low = middle } else { high = middle }
    }
    low
}
