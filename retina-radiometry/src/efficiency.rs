//! The sensor's spectral efficiency (paper, eqs. 8-10).

/// Quantum efficiency of the paper's camera (BFS-U3-31S4M, Sony IMX265): nm, electrons per photon. Read from
/// the validation data of github.com/andrepiz/abram (Politecnico di Milano).
const PAPER_CAMERA: [[f64; 2]; 16] = [
    [297.0, 0.046335],
    [347.0, 0.21472],
    [397.0, 0.46362],
    [447.0, 0.63806],
    [497.0, 0.66967],
    [547.0, 0.68317],
    [597.0, 0.62862],
    [647.0, 0.56362],
    [697.0, 0.46565],
    [747.0, 0.35428],
    [797.0, 0.26281],
    [847.0, 0.16923],
    [897.0, 0.10733],
    [947.0, 0.057816],
    [997.0, 0.028469],
    [1047.0, 0.011971],
];

/// Planck's constant times the speed of light, J m (SI, exact).
const HC_J_M: f64 = 6.626_070_15e-34 * 299_792_458.0;

/// A quantum efficiency curve: straight lines between its points, 0 beyond them.
#[derive(Debug, Clone, PartialEq)]
pub struct QuantumEfficiency {
    points: Vec<[f64; 2]>,
    /// max of Q_e lambda, nm.
    peak_nm: f64,
}

impl QuantumEfficiency {
    /// Of points [nm, electrons per photon] of rising wavelength, at least two, not all 0.
    pub fn new(points: Vec<[f64; 2]>) -> Self {
        // Q_e lambda is a parabola between points: its vertex may lie inside.
        let mut peak_nm: f64 = points.iter().map(|[nm, qe]| nm * qe).fold(0.0, f64::max);
        for pair in points.windows(2) {
            let [[x0, y0], [x1, y1]] = [pair[0], pair[1]];
            let slope = (y1 - y0) / (x1 - x0);
            let vertex = (slope * x0 - y0) / (2.0 * slope);
            if slope != 0.0 && vertex > x0 && vertex < x1 {
                peak_nm = peak_nm.max(vertex * (y0 + slope * (vertex - x0)));
            }
        }
        Self { points, peak_nm }
    }

    /// That of the paper's camera.
    pub fn paper_camera() -> Self {
        Self::new(PAPER_CAMERA.to_vec())
    }

    /// Electrons per photon at a wavelength, nm.
    pub fn at(&self, nm: f64) -> f64 {
        let above = self.points.partition_point(|point| point[0] <= nm);
        match (above.checked_sub(1).map(|i| self.points[i]), self.points.get(above)) {
            (Some([x0, y0]), Some(&[x1, y1])) => y0 + (y1 - y0) * (nm - x0) / (x1 - x0),
            (Some([x, y]), None) if x == nm => y,
            _ => 0.0,
        }
    }

    /// eta(lambda) = Q_e lambda / max(Q_e lambda), the relative energetic efficiency (eq. 9).
    pub fn relative(&self, nm: f64) -> f64 {
        self.at(nm) * nm / self.peak_nm
    }

    /// First and last wavelength of the curve, nm.
    pub fn range_nm(&self) -> [f64; 2] {
        [self.points[0][0], self.points[self.points.len() - 1][0]]
    }

    /// The integral of `weight(lambda) eta(lambda)` over the curve, nm times the weight's unit: Simpson's
    /// rule on steps of 1 nm or less, split at the points.
    pub fn integral(&self, weight: impl Fn(f64) -> f64) -> f64 {
        let mut sum = 0.0;
        for pair in self.points.windows(2) {
            let (from, to) = (pair[0][0], pair[1][0]);
            let steps = ((to - from).ceil() as usize).max(1);
            let h = (to - from) / steps as f64;
            for i in 0..steps {
                let x = from + i as f64 * h;
                let f = |nm: f64| weight(nm) * self.relative(nm.clamp(from, to));
                sum += h / 6.0 * (f(x) + 4.0 * f(x + h / 2.0) + f(x + h));
            }
        }
        sum
    }

    /// The effective bandwidth, the integral of eta, nm (417 in the paper).
    pub fn bandwidth_nm(&self) -> f64 {
        self.integral(|_| 1.0)
    }

    /// Electrons per joule of light where eta is 1: an effective irradiance (eq. 10) times this, the pupil's
    /// area and the exposure is a charge.
    pub fn electrons_per_joule(&self) -> f64 {
        self.peak_nm * 1e-9 / HC_J_M
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper gives 0.994, 0.979, 0.813 at 605, 544 and 475 nm, and 417 nm; its curve was read from a
    /// datasheet, ours is another reading of the same sensor.
    #[test]
    fn the_papers_weights() {
        let qe = QuantumEfficiency::paper_camera();
        for (nm, expected) in [(605.0, 0.994), (544.0, 0.979), (475.0, 0.813)] {
            assert!((qe.relative(nm) - expected).abs() < 0.03, "{nm}: {}", qe.relative(nm));
        }
        assert!((qe.bandwidth_nm() - 417.0).abs() < 20.0, "{}", qe.bandwidth_nm());
        assert_eq!((qe.at(200.0), qe.at(1100.0)), (0.0, 0.0));
        assert_eq!(qe.at(1047.0), 0.011971);
    }

    /// For a flat Q_e from 400 to 800 nm, eta = lambda / 800: its integral is 300 nm, and a joule at 800 nm
    /// is 4.027e18 photons.
    #[test]
    fn closed_forms() {
        let qe = QuantumEfficiency::new(vec![[400.0, 0.5], [800.0, 0.5]]);
        assert!((qe.bandwidth_nm() - 300.0).abs() < 1e-9);
        assert!((qe.electrons_per_joule() / (0.5 * 4.0273e18) - 1.0).abs() < 1e-4);
        // Falling linearly from 1 to 0 over 400..800: Q_e lambda peaks inside, at 400 (half way) nm * 1.
        let qe = QuantumEfficiency::new(vec![[100.0, 1.0], [900.0, 0.0]]);
        assert!((qe.relative(450.0) - 1.0).abs() < 1e-12, "{}", qe.relative(450.0));
    }
}
