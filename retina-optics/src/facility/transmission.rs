//! A function with kinks on a regular grid, linear between its points.

use rayon::prelude::*;

/// Values on a grid over a rectangle about the origin.
#[derive(Debug, Clone)]
pub struct TransmissionGrid {
    half: [f64; 2],
    intervals: usize,
    values: Vec<f64>,
}

impl TransmissionGrid {
    /// Samples `function` on `|x| <= half[0]`, `|y| <= half[1]`.
    ///
    /// # Errors
    /// The first of `function`'s.
    pub fn new<E: Send>(
        half: [f64; 2],
        intervals: usize,
        function: impl Fn([f64; 2]) -> Result<f64, E> + Sync,
    ) -> Result<Self, E> {
        let at = |i: usize, half: f64| half * (2.0 * i as f64 / intervals as f64 - 1.0);
        let side = intervals + 1;
        let values = (0..side * side)
            .into_par_iter()
            .map(|i| function([at(i % side, half[0]), at(i / side, half[1])]))
            .collect::<Result<_, E>>()?;
        Ok(Self { half, intervals, values })
    }

    /// The value at a point; beyond the rectangle, that of its edge.
    pub fn at(&self, at: [f64; 2]) -> f64 {
        let place = |k: usize| {
            let u = ((at[k] / self.half[k] + 1.0) / 2.0 * self.intervals as f64)
                .clamp(0.0, self.intervals as f64);
            let i = (u as usize).min(self.intervals - 1);
            (i, u - i as f64)
        };
        let ((i, s), (j, t)) = (place(0), place(1));
        let row = |j: usize| {
            let start = j * (self.intervals + 1) + i;
            self.values[start] * (1.0 - s) + self.values[start + 1] * s
        };
        row(j) * (1.0 - t) + row(j + 1) * t
    }
}
