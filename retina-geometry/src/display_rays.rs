//! What the facility's lenses make of the display's depth and of coma, from its prescription.

use crate::cubic_shares;

/// Places at which dr/dz is tabulated, from the axis to the largest line of sight.
pub const DEPTH_KNOTS: usize = 17;
/// Comas whose effect is tabulated, mm at half the camera's width.
pub const COMAS_MM: [f64; 6] = [-1e-3, -3e-4, -1e-4, 1e-4, 3e-4, 1e-3];

/// Where lines of sight meet the display, and what its depth does to them, of a facility that is symmetric about its
/// axis. With r the tangent of the line of sight and z the depth away from the lenses: height X(r) = r (h_0 + h_1 r^2 +
/// h_2 r^4), and dr/dz is r times a table.
///
/// Lines of sight are those that a detector finds, by a window as wide as the spot. Neither the chief ray nor the mean of
/// the light moves as the bright core of a blurred spot with coma does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisplayRays {
    /// h_0, h_1, h_2, mm; the display's axes are those of the lines of sight, so h_0 is positive.
    pub height_mm: [f64; 3],
    /// The largest line of sight's tangent.
    pub half_tan: f64,
    /// (dr/dz) / r at equal steps of r from 0 to `half_tan`, 1/mm.
    pub tangent_per_depth: [f64; DEPTH_KNOTS],
    /// What coma that grows with the line of sight adds to it, over r / u and the coma, at the same steps, for each of
    /// [`COMAS_MM`] at u, half the camera's width: tangents per mm. Coma is path at the pupil's rim, of Zernike's
    /// term (3 rho^2 - 2) rho cos phi. Bright cores do not move in proportion to it.
    pub tangent_per_coma: [[f64; DEPTH_KNOTS]; COMAS_MM.len()],
    /// What depth adds to that, 1/mm^2.
    pub coma_per_depth: [[f64; DEPTH_KNOTS]; COMAS_MM.len()],
    /// What weak coma that is the same all over the field adds, along the radius and across it: tangents per mm.
    pub tangent_per_even_coma: [[f64; DEPTH_KNOTS]; 2],
}

impl DisplayRays {
    /// Height over the tangent r of the line of sight, mm.
    pub fn height_over_tangent_mm(&self, r: f64) -> f64 {
        even(self.height_mm, r)
    }

    /// What a millimetre of depth adds to a line of sight of tangent r, over r: cubic between the table's places (Catmull
    /// and Rom's slopes), its last value beyond them.
    pub fn tangent_per_depth(&self, r: f64) -> f64 {
        self.joined(&self.tangent_per_depth, r)
    }

    /// What one of [`COMAS_MM`] adds to the line of sight at the tangent r, over r / u and the coma; joined alike.
    pub fn tangent_per_coma(&self, coma: usize, r: f64) -> f64 {
        self.joined(&self.tangent_per_coma[coma], r)
    }

    /// What a millimetre of depth adds to that; joined alike.
    pub fn coma_per_depth(&self, coma: usize, r: f64) -> f64 {
        self.joined(&self.coma_per_depth[coma], r)
    }

    /// What even coma adds along the radius and across it; joined alike.
    pub fn tangent_per_even_coma(&self, r: f64) -> [f64; 2] {
        self.tangent_per_even_coma.each_ref().map(|table| self.joined(table, r))
    }

    fn joined(&self, table: &[f64; DEPTH_KNOTS], r: f64) -> f64 {
        let last = DEPTH_KNOTS - 1;
        let at = (r.abs() / self.half_tan * last as f64).min(last as f64);
        let cell = (at as usize).min(last - 1);
        // Even in r, and straight at the end.
        let value = |k: isize| match k {
            k if k < 0 => table[k.unsigned_abs()],
            k if k as usize > last => 2.0 * table[last] - table[last - 1],
            k => table[k as usize],
        };
        let shares = cubic_shares(at - cell as f64);
        shares.iter().zip(cell as isize - 1..).map(|(share, k)| share * value(k)).sum()
    }

    /// The line of sight's tangent of what a pinhole of the same focal length would show at u: the r with r h(r) = u h(0).
    /// Heights grow with the tangent in any lens of use; a few steps of Newton's method settle.
    pub fn tangent_of_displayed(&self, u: f64) -> f64 {
        let h0 = self.height_mm[0];
        let mut r = u;
        for _ in 0..8 {
            r -= (r * even(self.height_mm, r) - u * h0) / self.height_per_tangent_mm(r);
        }
        r
    }

    /// What a shift of the display moves lines of sight by, at the displayed place u (tangents): dr/du, by columns.
    pub fn sight_per_displayed(&self, u: [f64; 2]) -> [[f64; 2]; 2] {
        let length = u[0].hypot(u[1]);
        let r = self.tangent_of_displayed(length);
        let along = self.height_mm[0] / self.height_per_tangent_mm(r);
        if length == 0.0 {
            return [[along, 0.0], [0.0, along]];
        }
        let across = r / length;
        let [a, b] = u.map(|c| c / length);
        let more = along - across;
        [[across + more * a * a, more * a * b], [more * a * b, across + more * b * b]]
    }

    /// d(r h(r)) / dr, mm.
    fn height_per_tangent_mm(&self, r: f64) -> f64 {
        let [h0, h1, h2] = self.height_mm;
        let r2 = r * r;
        h0 + r2 * (3.0 * h1 + 5.0 * r2 * h2)
    }

    /// What a tilt adds near the axis: a display turned by tau moves u (tangents) by k tau (u . e) u, with this k; -1 for
    /// a pinhole (Hartley and Zisserman, Multiple View Geometry, sec. 2.3: X = f r on a plane at f + dz).
    pub fn tilt_gain(&self) -> f64 {
        self.height_mm[0] * self.tangent_per_depth(0.0)
    }
}

fn even([a, b, c]: [f64; 3], r: f64) -> f64 {
    let r2 = r * r;
    a + r2 * (b + r2 * c)
}

#[cfg(test)]
mod tests {
    use super::{COMAS_MM, DEPTH_KNOTS, DisplayRays};

    /// Against differences of the mapping itself, r h(r) = u h(0), solved by bisection.
    #[test]
    fn a_shift_moves_lines_of_sight_as_the_mapping_does() {
        let lens = DisplayRays {
            height_mm: [50.0, -30.0, 200.0],
            half_tan: 0.2,
            tangent_per_depth: [-0.02; DEPTH_KNOTS],
            tangent_per_coma: [[0.0; DEPTH_KNOTS]; COMAS_MM.len()],
            coma_per_depth: [[0.0; DEPTH_KNOTS]; COMAS_MM.len()],
            tangent_per_even_coma: [[0.0; DEPTH_KNOTS]; 2],
        };
        let seen = |[x, y]: [f64; 2]| {
            let u = x.hypot(y);
            let (mut low, mut high) = (0.0f64, 1.0);
            for _ in 0..60 {
                let r = 0.5 * (low + high);
                if r * (50.0 - 30.0 * r * r + 200.0 * r.powi(4)) < 50.0 * u { low = r } else { high = r }
            }
            [x, y].map(|c| c * low / u)
        };
        let h = 1e-5;
        for u in [[0.001, 0.0], [0.05, -0.08], [0.13, 0.15]] {
            let found = lens.sight_per_displayed(u);
            for axis in 0..2 {
                let (mut up, mut down) = (u, u);
                up[axis] += h;
                down[axis] -= h;
                let (up, down) = (seen(up), seen(down));
                for k in 0..2 {
                    let slope = (up[k] - down[k]) / (2.0 * h);
                    assert!((found[axis][k] - slope).abs() < 1e-6, "{u:?}: {found:?}, {slope}");
                }
            }
        }
    }

    /// A parabola in r is joined exactly, but for the last step.
    #[test]
    fn the_table_of_depths_is_joined_smoothly() {
        let half_tan = 0.2;
        let of = |r: f64| -0.01 + 0.3 * r * r;
        let tangent_per_depth = std::array::from_fn(|k| of(half_tan * k as f64 / (DEPTH_KNOTS - 1) as f64));
        let lens = DisplayRays {
            height_mm: [50.0, 0.0, 0.0],
            half_tan,
            tangent_per_depth,
            tangent_per_coma: [[0.0; DEPTH_KNOTS]; COMAS_MM.len()],
            coma_per_depth: [[0.0; DEPTH_KNOTS]; COMAS_MM.len()],
            tangent_per_even_coma: [[0.0; DEPTH_KNOTS]; 2],
        };
        for r in [0.0, 0.003, 0.0125, 0.111, 0.18] {
            assert!((lens.tangent_per_depth(r) - of(r)).abs() < 1e-12, "{r}");
            assert_eq!(lens.tangent_per_depth(r), lens.tangent_per_depth(-r));
        }
        assert_eq!(lens.tangent_per_depth(0.3), of(half_tan));
    }
}
