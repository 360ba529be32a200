//! The lit part of a channel's response: a natural cubic spline of ln I over ln(B / 255).
//!
//! Two knots are a straight line, which is the power law; more follow a display that departs from it. Outside
//! the knots the spline goes on straight, as a power law does.

/// Counts of an 8-bit display.
pub(crate) const COUNTS: usize = 256;

/// Cardinal splines over ln(B / 255): the k-th is 1 at its own knot and 0 at the others.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Basis {
    /// A row a count, of one value a knot; count 0 has no logarithm and a row of zeros.
    rows: Vec<Vec<f64>>,
}

/// ln(B / 255).
pub(crate) fn log_of_count(count: usize) -> f64 {
    (count as f64 / 255.0).ln()
}

impl Basis {
    /// A level and a slope (ln I at full and gamma): the power law.
    pub(crate) fn power_law() -> Self {
        let row = |count: usize| if count == 0 { vec![0.0; 2] } else { vec![1.0, log_of_count(count)] };
        Self { rows: (0..COUNTS).map(row).collect() }
    }

    /// `knots` knots, three or more, at quantiles (in ln B) of the lit counts that were measured, which
    /// rise and are more than the knots.
    pub(crate) fn spline(knots: usize, measured_counts: &[usize]) -> Self {
        let last = measured_counts.len() - 1;
        let at = |k: usize| {
            let place = k as f64 * last as f64 / (knots - 1) as f64;
            let (i, t) = (place as usize, place.fract());
            let (low, high) = (measured_counts[i], measured_counts[(i + 1).min(last)]);
            log_of_count(low) * (1.0 - t) + log_of_count(high) * t
        };
        let places: Vec<f64> = (0..knots).map(at).collect();
        let curvatures: Vec<Vec<f64>> = (0..knots).map(|k| second_derivatives(&places, k)).collect();
        let row = |count: usize| {
            let value = |k: usize| evaluate(&places, k, &curvatures[k], log_of_count(count));
            if count == 0 { vec![0.0; knots] } else { (0..knots).map(value).collect() }
        };
        Self { rows: (0..COUNTS).map(row).collect() }
    }

    /// Parameters.
    pub(crate) fn len(&self) -> usize {
        self.rows[0].len()
    }

    /// The values of the basis at a count.
    pub(crate) fn row(&self, count: usize) -> &[f64] {
        &self.rows[count]
    }

    /// The lit part at a count, in the fit's unit: 0 at count 0.
    pub(crate) fn lit(&self, shape: &[f64], count: usize) -> f64 {
        if count == 0 {
            return 0.0;
        }
        self.rows[count].iter().zip(shape).map(|(b, p)| b * p).sum::<f64>().exp()
    }
}

/// Second derivatives at the knots of the natural spline that is 1 at knot `unit` (Thomas' algorithm on the
/// tridiagonal system of continuous first derivatives).
fn second_derivatives(x: &[f64], unit: usize) -> Vec<f64> {
    let n = x.len();
    let y = |i: usize| f64::from(u8::from(i == unit));
    let mut second = vec![0.0; n];
    let mut above = vec![0.0; n];
    for i in 1..n - 1 {
        let (left, right) = (x[i] - x[i - 1], x[i + 1] - x[i]);
        let slopes = (y(i + 1) - y(i)) / right - (y(i) - y(i - 1)) / left;
        let pivot = 2.0 * (left + right) - left * above[i - 1];
        above[i] = right / pivot;
        second[i] = (6.0 * slopes - left * second[i - 1]) / pivot;
    }
    for i in (1..n - 1).rev() {
        second[i] -= above[i] * second[i + 1];
    }
    second
}

fn evaluate(x: &[f64], unit: usize, second: &[f64], at: f64) -> f64 {
    let y = |i: usize| f64::from(u8::from(i == unit));
    let n = x.len();
    let i = x.partition_point(|&knot| knot <= at).clamp(1, n - 1);
    let h = x[i] - x[i - 1];
    let inside = at.clamp(x[0], x[n - 1]);
    let (a, b) = ((x[i] - inside) / h, (inside - x[i - 1]) / h);
    let value = a * y(i - 1)
        + b * y(i)
        + ((a * a * a - a) * second[i - 1] + (b * b * b - b) * second[i]) * h * h / 6.0;
    let slope = (y(i) - y(i - 1)) / h
        + ((3.0 * b * b - 1.0) * second[i] - (3.0 * a * a - 1.0) * second[i - 1]) * h / 6.0;
    value + slope * (at - inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A natural spline through points of a straight line is that line, also outside its knots; and with
    /// knots 0, 1, 2 and values 0, 1, 0 the middle's second derivative is -3 (by hand), so the value at
    /// 0.5 is 11/16.
    #[test]
    fn closed_forms() {
        let counts: Vec<usize> = (2..=20).map(|k| k * 12).collect();
        let spline = Basis::spline(5, &counts);
        let at_knot = |place: f64| 0.7 + 2.2 * place;
        let last = counts.len() - 1;
        let shape: Vec<f64> = (0..5)
            .map(|k| {
                let place = k as f64 * last as f64 / 4.0;
                let (i, t) = (place as usize, place.fract());
                let high = counts[(i + 1).min(last)];
                at_knot(log_of_count(counts[i]) * (1.0 - t) + log_of_count(high) * t)
            })
            .collect();
        for count in [1, 5, 24, 100, 240, 255] {
            let expected = at_knot(log_of_count(count)).exp();
            assert!((spline.lit(&shape, count) / expected - 1.0).abs() < 1e-12, "{count}");
        }
        assert_eq!(spline.lit(&shape, 0), 0.0);
        let second = second_derivatives(&[0.0, 1.0, 2.0], 1);
        assert!((second[1] + 3.0).abs() < 1e-15);
        assert!((evaluate(&[0.0, 1.0, 2.0], 1, &second, 0.5) - 11.0 / 16.0).abs() < 1e-15);
    }
}
