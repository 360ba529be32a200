//! What the facility's lenses make of the display's depth and of coma, from its prescription.

use std::fmt;

use glam::DVec2;

use crate::cubic_shares;

/// Places at which a [`RadialTable`] has values.
pub const RADIAL_KNOTS: usize = 25;
/// Depths of the display whose effect is tabulated, mm: bright cores do not move in proportion to the depth.
pub const DEPTHS_MM: [f64; 4] = [-0.1, -0.02, 0.02, 0.1];
/// Comas whose effect is tabulated, mm at half the camera's width.
pub const COMAS_MM: [f64; 10] = [-1e-3, -6e-4, -3.5e-4, -2e-4, -1e-4, 1e-4, 2e-4, 3.5e-4, 6e-4, 1e-3];

/// What depth of the display and coma of the objective shift spots by, and where lines of sight meet the display, of a
/// facility that is symmetric about its axis. With r the tangent of the line of sight and z the depth away from the lenses:
/// height X(r) = r (h_0 + h_1 r^2 + h_2 r^4), and a depth moves r in proportion to itself, nearly.
///
/// Lines of sight are those that a detector finds, by a window as wide as the spot. Neither the chief ray nor the mean of
/// the light moves as the bright core of a blurred spot with coma does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpotShifts {
    /// h_0, h_1, h_2, mm; the display's axes are those of the lines of sight, so h_0 is positive.
    pub height_mm: [f64; 3],
    /// What each of [`DEPTHS_MM`] adds to r, over r and the depth, 1/mm.
    pub per_depth: [RadialTable; DEPTHS_MM.len()],
    /// What the objective's coma does; `None` where it was not asked for.
    pub coma: Option<ComaShifts>,
}

/// An even function of the line of sight's tangent r, at equal steps of r^2 from 0: what lenses do changes most at the
/// edge of their field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadialTable {
    /// The last tangent.
    pub half_tan: f64,
    /// Values.
    pub values: [f64; RADIAL_KNOTS],
}

/// What the objective's coma does to lines of sight. Coma is path at the pupil's rim, of Zernike's
/// term (3 rho^2 - 2) rho cos phi. Bright cores do not move in proportion to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComaShifts {
    /// Coma that grows with the line of sight, for each of [`COMAS_MM`].
    pub growing: [ComaForm; COMAS_MM.len()],
    /// What weak coma that is the same all over the field adds, along the radius and across it: tangents per mm.
    pub tangent_per_even_coma: [RadialTable; 2],
}

/// What coma that grows with the line of sight does, about one value of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComaForm {
    /// The coma c at u, half the camera's width, mm.
    pub coma_mm: f64,
    /// What it adds to a line of sight, over r / u and c: tangents per mm.
    pub tangent_per_coma: RadialTable,
    /// What depth adds to that, 1/mm^2.
    pub coma_per_depth: RadialTable,
    /// What a little more coma adds beyond its share of `tangent_per_coma`: c times that table's derivative by c.
    pub beyond_proportion: RadialTable,
    /// What sub-pixels side by side add, where several are lit: to `tangent_per_coma`, times the cosine of the place's
    /// azimuth from x and of twice the azimuth; and across the radius (from x towards y), times its sine and that of twice
    /// the azimuth.
    pub round: [RadialTable; 4],
}

impl ComaForm {
    /// What the coma moves a line of sight (tangents) by, times u and over the coma, 1/mm. The coma grows with the line of
    /// sight; what it does to a spot goes by the distance from the axis of the facility's lenses, which may stand aside
    /// (`axis`, tangents).
    pub fn moved(&self, sight: DVec2, axis: DVec2) -> DVec2 {
        let r = (sight - axis).length();
        let [cos, sin] = sight.normalize_or_zero().to_array();
        let [along, along_twice, across, across_twice] = self.round.map(|table| table.at(r));
        let outwards = self.tangent_per_coma.at(r) + along * cos + along_twice * (cos * cos - sin * sin);
        outwards * sight + (across * sin + across_twice * 2.0 * sin * cos) * sight.perp()
    }
}

/// Traces a facility anew with a coma that was found.
pub trait ComaTracer: fmt::Debug + Send + Sync {
    /// Its form at this coma (mm); `None` where the facility's rays do not arrive.
    fn coma_form(&self, coma_mm: f64) -> Option<ComaForm>;
}

impl RadialTable {
    /// Of the function at each place but the first, on the axis.
    pub fn new(half_tan: f64, off_axis: [f64; RADIAL_KNOTS - 1]) -> Self {
        let mut values = [0.0; RADIAL_KNOTS];
        values[1..].copy_from_slice(&off_axis);
        // A parabola in r^2 through the next three.
        values[0] = 3.0 * (values[1] - values[2]) + values[3];
        Self { half_tan, values }
    }

    /// Of another table's values with this one's, place by place.
    #[must_use]
    pub fn with(&self, other: &Self, of: impl Fn(f64, f64) -> f64) -> Self {
        let values = std::array::from_fn(|k| of(self.values[k], other.values[k]));
        Self { half_tan: self.half_tan, values }
    }

    /// Tangent of a place.
    pub fn place(half_tan: f64, knot: usize) -> f64 {
        half_tan * (knot as f64 / (RADIAL_KNOTS - 1) as f64).sqrt()
    }

    /// At the tangent r: cubic between the places (Catmull and Rom's slopes), the last value beyond them.
    pub fn at(&self, r: f64) -> f64 {
        let Self { half_tan, values } = self;
        let last = RADIAL_KNOTS - 1;
        let at = ((r / half_tan).powi(2) * last as f64).min(last as f64);
        let cell = (at as usize).min(last - 1);
        // Straight at both ends.
        let value = |k: isize| match k {
            k if k < 0 => 2.0 * values[0] - values[1],
            k if k as usize > last => 2.0 * values[last] - values[last - 1],
            k => values[k as usize],
        };
        let shares = cubic_shares(at - cell as f64);
        shares.iter().zip(cell as isize - 1..).map(|(share, k)| share * value(k)).sum()
    }
}

impl SpotShifts {
    /// Height over the tangent r of the line of sight, mm.
    pub fn height_over_tangent_mm(&self, r: f64) -> f64 {
        even(self.height_mm, r)
    }

    /// What a depth z (mm) adds to a line of sight of tangent r, over r and z: the cubic in z through the tables, at most
    /// as deep as these go.
    pub fn tangent_per_depth(&self, r: f64, depth_mm: f64) -> f64 {
        let z = depth_mm.clamp(DEPTHS_MM[0], DEPTHS_MM[DEPTHS_MM.len() - 1]);
        let share = |k: usize| -> f64 {
            let others = DEPTHS_MM.iter().enumerate().filter(|(j, _)| *j != k);
            others.map(|(_, other)| (z - other) / (DEPTHS_MM[k] - other)).product()
        };
        self.per_depth.iter().enumerate().map(|(k, table)| share(k) * table.at(r)).sum()
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
        self.height_mm[0] * self.tangent_per_depth(0.0, 0.0)
    }
}

fn even([a, b, c]: [f64; 3], r: f64) -> f64 {
    let r2 = r * r;
    a + r2 * (b + r2 * c)
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::{ComaForm, DEPTHS_MM, RADIAL_KNOTS, RadialTable, SpotShifts};

    /// Against differences of the mapping itself, r h(r) = u h(0), solved by bisection.
    #[test]
    fn a_shift_moves_lines_of_sight_as_the_mapping_does() {
        let lens = SpotShifts {
            height_mm: [50.0, -30.0, 200.0],
            per_depth: [RadialTable { half_tan: 0.2, values: [-0.02; RADIAL_KNOTS] }; 4],
            coma: None,
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

    /// Coma grows from the boresight; what it does to spots goes by the distance from the lenses' axis.
    #[test]
    fn coma_moves_spots_by_their_distance_from_the_lenses_axis() {
        let half_tan = 0.2;
        let of = |r: f64| 3.0 + 40.0 * r * r;
        let table = |of: &dyn Fn(f64) -> f64| {
            RadialTable::new(half_tan, std::array::from_fn(|k| of(RadialTable::place(half_tan, k + 1))))
        };
        let (values, none) = (table(&of), table(&|_| 0.0));
        let form = ComaForm {
            coma_mm: 1e-4,
            tangent_per_coma: values,
            coma_per_depth: none,
            beyond_proportion: none,
            round: [none; 4],
        };
        let axis = DVec2::new(0.01, -0.02);
        for sight in [DVec2::new(0.05, 0.1), DVec2::new(-0.12, 0.03)] {
            let expected = sight * of((sight - axis).length());
            assert!((form.moved(sight, axis) - expected).length() < 1e-9, "{sight}");
        }
    }

    /// A parabola in r is joined exactly; what is smooth in r^2 to the third order.
    #[test]
    fn a_table_is_joined_smoothly() {
        let of = |r: f64| -0.01 + 0.3 * r * r;
        let table = |of: &dyn Fn(f64) -> f64| {
            RadialTable::new(0.2, std::array::from_fn(|k| of(RadialTable::place(0.2, k + 1))))
        };
        let (parabola, wave) = (table(&of), table(&|r: f64| (100.0 * r * r).cos()));
        for r in [0.0, 0.003, 0.0125, 0.111, 0.18, 0.2] {
            assert!((parabola.at(r) - of(r)).abs() < 1e-12, "{r}");
            assert_eq!(parabola.at(r), parabola.at(-r));
            assert!((wave.at(r) - (100.0 * r * r).cos()).abs() < 3e-3, "{r}: {}", wave.at(r));
        }
        assert!((parabola.at(0.3) - of(0.2)).abs() < 1e-12);
    }

    /// A cubic in the depth is joined exactly, and goes no further than the tables.
    #[test]
    fn depths_between_the_tables_are_joined() {
        let of = |z: f64| -0.02 + 0.1 * z - 0.3 * z * z + 2.0 * z.powi(3);
        let per_depth = DEPTHS_MM.map(|z| RadialTable { half_tan: 0.2, values: [of(z); RADIAL_KNOTS] });
        let lens = SpotShifts { height_mm: [50.0, 0.0, 0.0], per_depth, coma: None };
        for z in [-0.1, -0.05, 0.0, 0.013, 0.1] {
            assert!((lens.tangent_per_depth(0.1, z) - of(z)).abs() < 1e-12, "{z}");
        }
        assert!((lens.tangent_per_depth(0.1, 0.4) - of(0.1)).abs() < 1e-12);
    }
}
