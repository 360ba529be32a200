//! Integration of ordinary differential equations: Gragg-Bulirsch-Stoer extrapolation.
//!
//! The modified midpoint rule with 2, 4, ... 16 substeps, extrapolated in the square of the
//! substep (Aitken-Neville) to order 16; the step follows the difference of the last two
//! columns (Hairer, Norsett & Wanner, Solving ODEs I, II.9). It is as sharp as the high-order
//! Runge-Kutta pairs and has no table of coefficients to get wrong.

/// Columns of the extrapolation; the order is twice that.
const COLUMNS: usize = 8;
/// Exponent that takes an error ratio to a ratio of steps.
const ERROR_EXPONENT: f64 = 1.0 / (2 * COLUMNS - 1) as f64;
/// The steps an integration may take before it is given up.
const STEPS_MAX: usize = 100_000;

/// Integrates y' = f(t, y) from one t to another (either may be the later one) from `start`, to a
/// relative error of `tolerance` a step in each component (absolute below 1). `None` where the
/// solution runs away or the step shrinks to nothing.
pub(crate) fn integrate<const N: usize>(
    f: impl Fn(f64, &[f64; N]) -> [f64; N],
    start: [f64; N],
    [from, to]: [f64; 2],
    tolerance: f64,
) -> Option<[f64; N]> {
    let span = to - from;
    let mut y = start;
    let mut left = span;
    let mut step = span;
    for _ in 0..STEPS_MAX {
        if left == 0.0 {
            return Some(y);
        }
        if step.abs() >= left.abs() {
            step = left;
        }
        let (next, error) = extrapolate(&f, to - left, &y, step);
        let ratio =
            (0..N).fold(0.0_f64, |worst, i| worst.max(error[i].abs() / (tolerance * (1.0 + y[i].abs()))));
        // Comparisons with NaN are false: a step into the singularity counts as too long.
        let grow = if ratio.is_finite() { 0.9 * ratio.max(1e-12).powf(-ERROR_EXPONENT) } else { 0.1 };
        if ratio <= 1.0 && next.iter().all(|v| v.is_finite()) {
            y = next;
            left -= step;
        } else if step.abs() < 1e-12 * span.abs() {
            return None;
        }
        step *= grow.clamp(0.1, 4.0);
    }
    None
}

/// One extrapolated step: the solution, and the difference to the column before.
fn extrapolate<const N: usize>(
    f: &impl Fn(f64, &[f64; N]) -> [f64; N],
    t: f64,
    y: &[f64; N],
    step: f64,
) -> ([f64; N], [f64; N]) {
    let slope = f(t, y);
    // Row j of the tableau overwrites row j - 1 from the left; `row[k]` holds T(j, k).
    let mut row = [[0.0; N]; COLUMNS];
    let mut error = [f64::INFINITY; N];
    for j in 0..COLUMNS {
        let mut entry = midpoint(f, t, y, &slope, step, 2 * (j + 1));
        for k in 0..j {
            let above = std::mem::replace(&mut row[k], entry);
            let ratio = (j + 1) as f64 / (j - k) as f64;
            let weight = 1.0 / (ratio * ratio - 1.0);
            for i in 0..N {
                error[i] = (entry[i] - above[i]) * weight;
                entry[i] += error[i];
            }
        }
        row[j] = entry;
    }
    (row[COLUMNS - 1], error)
}

/// Gragg's midpoint rule; with an even number of substeps its error is a series in their square.
fn midpoint<const N: usize>(
    f: &impl Fn(f64, &[f64; N]) -> [f64; N],
    t: f64,
    y: &[f64; N],
    slope: &[f64; N],
    step: f64,
    substeps: usize,
) -> [f64; N] {
    let h = step / substeps as f64;
    let mut before = *y;
    let mut now: [f64; N] = std::array::from_fn(|i| y[i] + h * slope[i]);
    for substep in 1..substeps {
        let slope = f(t + substep as f64 * h, &now);
        let next = std::array::from_fn(|i| before[i] + 2.0 * h * slope[i]);
        before = std::mem::replace(&mut now, next);
    }
    now
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Kepler's problem with unit mass: (x, y, vx, vy).
    fn kepler(_: f64, s: &[f64; 4]) -> [f64; 4] {
        let r3 = (s[0] * s[0] + s[1] * s[1]).powf(1.5);
        [s[2], s[3], -s[0] / r3, -s[1] / r3]
    }

    #[test]
    fn an_eccentric_ellipse_closes_and_runs_backwards() {
        // e = 0.6, a = 1: from pericentre (0.4, 0) at speed 2, period 2 pi, half of it to apocentre.
        let start = [0.4, 0.0, 0.0, 2.0];
        let half = integrate(kepler, start, [0.0, std::f64::consts::PI], 1e-13).unwrap();
        let whole = integrate(kepler, half, [0.0, std::f64::consts::PI], 1e-13).unwrap();
        let back = integrate(kepler, half, [std::f64::consts::PI, 0.0], 1e-13).unwrap();
        for (got, expected) in [(half, [-1.6, 0.0, 0.0, -0.5]), (whole, start), (back, start)] {
            for i in 0..4 {
                assert!((got[i] - expected[i]).abs() < 1e-11, "{got:?} {expected:?}");
            }
        }
    }

    #[test]
    fn the_order_is_that_of_the_last_column() {
        // y' = y: halving the step divides the error of one step by about 2^17.
        let off = |h: f64| {
            let (y, estimate) = extrapolate(&|_, y: &[f64; 1]| *y, 0.0, &[1.0], h);
            ((y[0] / h.exp() - 1.0).abs(), (estimate[0] / h.exp()).abs())
        };
        let (coarse, fine) = (off(3.0), off(1.5));
        let order = (coarse.0 / fine.0).log2();
        assert!((15.0..18.0).contains(&order), "{coarse:?} {fine:?}");
        assert!(fine.0 < fine.1, "the estimate is on the safe side: {fine:?}");
    }

    #[test]
    fn a_rate_may_depend_on_the_time() {
        // y' = -2 t y from t = -1: y = exp(1 - t^2).
        let end = integrate(|t, y: &[f64; 1]| [-2.0 * t * y[0]], [1.0], [-1.0, 2.5], 1e-13).unwrap();
        assert!((end[0] / (1.0f64 - 6.25).exp() - 1.0).abs() < 1e-10, "{end:?}");
    }

    #[test]
    fn a_fall_into_the_singularity_is_given_up() {
        assert_eq!(integrate(kepler, [1.0, 0.0, 0.0, 0.0], [0.0, 3.0], 1e-13), None);
    }
}
