//! How many knots the held-out readings justify.

use crate::fit::{Fit, huber};
use crate::readings::Reading;
use crate::spline::{Basis, COUNTS};

const CANDIDATES: [usize; 7] = [3, 4, 5, 6, 8, 10, 12];
const FOLDS: usize = 5;
/// A finer curve must predict held-out counts better than the power law by this many standard errors.
const CLEARLY: f64 = 2.0;

/// The power law, or the coarsest spline that is as good as the best at counts left out, where that is
/// clearly better than the power law. All readings of a count are left out together; the lowest and the
/// highest count stay, since beyond them nothing is known. Curves that fall anywhere are passed over.
pub(crate) fn choose(readings: &[Reading], sigma: &[f64], power_law: &Fit, counts: &[usize]) -> Fit {
    let straight = held_out(readings, sigma, power_law, counts);
    let mut tried: Vec<(Fit, Vec<f64>)> = Vec::new();
    for knots in CANDIDATES.into_iter().filter(|&knots| 2 * knots <= counts.len()) {
        let start = power_law.on_basis(Basis::spline(knots, counts), counts);
        let fit = start.and_then(|start| start.refine(readings, sigma)).filter(rises);
        if let (Some(fit), Some(_)) = (fit, &straight) {
            let losses = held_out(readings, sigma, &fit, counts);
            tried.extend(losses.map(|losses| (fit, losses)));
        }
    }
    let total = |losses: &[f64]| losses.iter().sum::<f64>();
    let best = tried.iter().min_by(|a, b| total(&a.1).total_cmp(&total(&b.1)));
    let (Some(straight), Some((_, best))) = (straight, best) else { return power_law.clone() };
    for (fit, losses) in &tried {
        let (gain, error) = difference(&straight, losses);
        let (behind, behind_error) = difference(losses, best);
        if gain > CLEARLY * error && behind <= behind_error {
            return fit.clone();
        }
    }
    power_law.clone()
}

/// Whether the curve rises at every count.
fn rises(fit: &Fit) -> bool {
    (1..COUNTS).all(|count| fit.pixel(count) > fit.pixel(count - 1))
}

/// Sum of a - b and its standard error.
fn difference(a: &[f64], b: &[f64]) -> (f64, f64) {
    let n = a.len() as f64;
    let each: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    let mean = each.iter().sum::<f64>() / n;
    let variance = each.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean * n, (variance * n).sqrt())
}

/// Huber's loss at each inner count when it was left out; `None` where a fold cannot be fitted.
fn held_out(readings: &[Reading], sigma: &[f64], fit: &Fit, counts: &[usize]) -> Option<Vec<f64>> {
    let inner = &counts[1..counts.len() - 1];
    let mut losses = vec![0.0; inner.len()];
    for fold in 0..FOLDS.min(inner.len()) {
        let left_out: Vec<usize> = inner.iter().copied().skip(fold).step_by(FOLDS).collect();
        let kept: Vec<usize> = (0..readings.len())
            .filter(|&i| !readings[i].is_lit() || !left_out.contains(&readings[i].count))
            .collect();
        let some: Vec<Reading> = kept.iter().map(|&i| readings[i].clone()).collect();
        let some_sigma: Vec<f64> = kept.iter().map(|&i| sigma[i]).collect();
        let trained = fit.clone().refine(&some, &some_sigma)?;
        for (i, reading) in readings.iter().enumerate().filter(|(_, r)| r.is_lit()) {
            if let Some(place) = inner.iter().position(|&count| count == reading.count)
                && left_out.contains(&reading.count)
            {
                losses[place] += huber((reading.irradiance_w_m2 - trained.predicted(reading)) / sigma[i]);
            }
        }
    }
    Some(losses)
}
