//! What a mapping does ring by ring about its centre, where polynomials do not follow it.

use glam::{DMat2, DVec2};

/// Cubic B-splines of the distance from a centre, about the distances 2 h, 3 h, ... radius + h, with h = radius /
/// intervals. Those about 0 and h are left out: with them a constant and the distance's square could be made, which with
/// the place relative to the centre are polynomials of degree 1 and 3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rings {
    /// The centre, a line of sight.
    pub center: DVec2,
    /// The last knot's distance, on the tangent plane; farther out the splines keep their values.
    pub radius: f64,
    /// Intervals of width h between knots, and number of splines.
    pub intervals: u32,
}

/// Splines that are not zero in one interval.
const AT_ONCE: usize = 4;
/// Splines about the centre and the first knot.
const LEFT_OUT: usize = 2;

impl Rings {
    /// Number of columns: two a spline.
    pub fn columns(&self) -> usize {
        2 * self.intervals as usize
    }

    /// The splines that are not zero at the place `from_center` relative to the centre: index, B, and dB/d(distance).
    fn splines(&self, from_center: DVec2) -> impl Iterator<Item = (usize, f64, f64)> + use<> {
        let per_radian = f64::from(self.intervals) / self.radius;
        let along = from_center.length() * per_radian;
        let last = f64::from(self.intervals);
        let held = along.min(last);
        let cell = held.floor().min(last - 1.0);
        let t = held - cell;
        let (u, t2) = (1.0 - t, t * t);
        let values = [u * u * u, 4.0 - 6.0 * t2 + 3.0 * t2 * t, 1.0 + 3.0 * (t + t2 - t2 * t), t2 * t]
            .map(|v| v / 6.0);
        let slope = if along > last { 0.0 } else { per_radian };
        let slopes = [-u * u, t * (3.0 * t - 4.0), 1.0 + 2.0 * t - 3.0 * t2, t2].map(|v| 0.5 * slope * v);
        // In a cell the splines about the knots before, at, after and two after it are not zero.
        let of = move |i: usize| Some(((cell as usize + i).checked_sub(1 + LEFT_OUT)?, values[i], slopes[i]));
        (0..AT_ONCE).filter_map(of)
    }

    /// The columns at a line of sight: for each spline (x - c_x) B / radius and (y - c_y) B / radius, into
    /// `out`, which holds [`Self::columns`].
    pub fn fill(&self, line_of_sight: DVec2, out: &mut [f64]) {
        let from_center = line_of_sight - self.center;
        let place = from_center / self.radius;
        out.fill(0.0);
        for (spline, value, _) in self.splines(from_center) {
            out[2 * spline] += place.x * value;
            out[2 * spline + 1] += place.y * value;
        }
    }

    /// Sum of the columns times `coefficients` (of x, of y; in the order of [`Self::fill`]).
    pub fn value(&self, line_of_sight: DVec2, coefficients: &[DVec2]) -> DVec2 {
        let from_center = line_of_sight - self.center;
        let of = |(spline, value, _): (usize, f64, f64)| pair(coefficients, spline) * (from_center * value);
        self.splines(from_center).map(of).sum::<DVec2>() / self.radius
    }

    /// Derivative of [`Self::value`]: columns are those along x and along y.
    pub fn jacobian(&self, line_of_sight: DVec2, coefficients: &[DVec2]) -> DMat2 {
        let from_center = line_of_sight - self.center;
        let outwards = from_center.normalize_or_zero();
        let mut sum = DMat2::ZERO;
        for (spline, value, slope) in self.splines(from_center) {
            let matrix = pair(coefficients, spline);
            let steeper = matrix * from_center * slope;
            sum += matrix * value + DMat2::from_cols(steeper * outwards.x, steeper * outwards.y);
        }
        sum * (1.0 / self.radius)
    }
}

/// Coefficients of a spline's two columns as a matrix.
fn pair(coefficients: &[DVec2], spline: usize) -> DMat2 {
    DMat2::from_cols(coefficients[2 * spline], coefficients[2 * spline + 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rings() -> (Rings, Vec<DVec2>) {
        let rings = Rings { center: DVec2::new(0.01, -0.02), radius: 0.2, intervals: 8 };
        let wild = |i: usize| ((i * 37 % 17) as f64 - 8.0) / 8.0;
        let coefficients = (0..rings.columns()).map(|i| DVec2::new(wild(i), wild(i + 5))).collect();
        (rings, coefficients)
    }

    #[test]
    fn equal_rings_are_a_linear_mapping() {
        let (rings, _) = rings();
        // B-splines of equal knots add up to 1, where none is left out: from the third knot on.
        let coefficients: Vec<DVec2> =
            (0..rings.columns()).map(|i| if i % 2 == 0 { DVec2::new(3.0, 1.0) } else { DVec2::Y }).collect();
        for at in [DVec2::new(0.013, 0.1), DVec2::new(-0.15, 0.05), DVec2::new(0.4, 0.3)] {
            let place = (at - rings.center) / rings.radius;
            let expected = DVec2::new(3.0 * place.x, place.x + place.y);
            assert!((rings.value(at, &coefficients) - expected).length() < 1e-14);
        }
    }

    #[test]
    fn columns_values_and_slopes_belong_together() {
        let (rings, coefficients) = rings();
        let mut columns = vec![0.0; rings.columns()];
        for at in
            [DVec2::new(0.012, -0.019), DVec2::new(0.05, 0.07), DVec2::new(-0.12, 0.1), DVec2::new(0.3, 0.1)]
        {
            rings.fill(at, &mut columns);
            let value = rings.value(at, &coefficients);
            let by_columns: DVec2 = columns.iter().zip(&coefficients).map(|(v, c)| *c * *v).sum();
            assert!((by_columns - value).length() < 1e-14);
            let jacobian = rings.jacobian(at, &coefficients);
            for axis in [DVec2::X, DVec2::Y] {
                let step = 1e-6 * axis;
                let slope =
                    (rings.value(at + step, &coefficients) - rings.value(at - step, &coefficients)) / 2e-6;
                assert!((jacobian * axis - slope).length() < 1e-7, "{at}: {} {slope}", jacobian * axis);
            }
        }
    }

    #[test]
    fn a_spline_reaches_over_four_intervals() {
        let (rings, _) = rings();
        let mut columns = vec![0.0; rings.columns()];
        // In the middle of the fourth interval: B(1/2) = 23/48, B(3/2) = 1/48 (C. de Boor, A Practical Guide to Splines).
        rings.fill(rings.center + DVec2::X * 3.5 * 0.025, &mut columns);
        let place = 3.5 / 8.0;
        for (knot, expected) in [(2, 1.0), (3, 23.0), (4, 23.0), (5, 1.0), (6, 0.0)] {
            assert!((columns[2 * (knot - 2)] - place * expected / 48.0).abs() < 1e-15);
        }
    }
}
