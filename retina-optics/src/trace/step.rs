//! One surface, one ray: the arithmetic that the scalar trace and the blocks share.
//!
//! Everything here is branch-free where it can be, so that loops over it become vector code.
//! Failures are values, not control flow: a bad root is left to become NaN and is flagged.

/// Terms a_2 .. a_16 of an even asphere.
pub(crate) const MAX_ASPHERIC_TERMS: usize = 8;

/// Point, direction cosines and optical path of a ray, in the axes of the surface at hand.
#[derive(Clone, Copy)]
pub(super) struct State {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) z: f64,
    pub(super) l: f64,
    pub(super) m: f64,
    pub(super) n: f64,
    pub(super) path: f64,
}

/// Where a ray meets a figure.
#[derive(Clone, Copy)]
pub(super) struct Hit {
    /// Geometric distance from the ray's point, mm.
    pub(super) distance: f64,
    /// The point.
    pub(super) at: [f64; 3],
    /// Unit normal, its z component positive near the vertex.
    pub(super) normal: [f64; 3],
    /// The ray meets the figure.
    pub(super) met: bool,
}

/// A figure that rays can be met with.
pub(super) trait Figure: Copy {
    fn meet(self, s: &State) -> Hit;
}

#[derive(Clone, Copy)]
pub(super) struct Plane;

impl Figure for Plane {
    #[inline(always)]
    fn meet(self, s: &State) -> Hit {
        let distance = -s.z / s.n;
        Hit {
            distance,
            at: [s.x + distance * s.l, s.y + distance * s.m, 0.0],
            normal: [0.0, 0.0, 1.0],
            met: distance.is_finite(),
        }
    }
}

/// The root of A t^2 - 2 B t + C = 0 that belongs to the sheet at the vertex. The point is first
/// slid along the ray by its own height, which brings it near the tangent plane without a division
/// and keeps C from cancelling.
#[inline(always)]
fn meet_conic(c: f64, one_plus_k: f64, s: &State) -> (f64, [f64; 3], f64) {
    let slide = -s.z;
    let x = s.x + slide * s.l;
    let y = s.y + slide * s.m;
    let z = s.z + slide * s.n;
    let a = c * (s.l * s.l + s.m * s.m + one_plus_k * (s.n * s.n));
    let b = s.n - c * (x * s.l + y * s.m + one_plus_k * (z * s.n));
    let q = c * (x * x + y * y + one_plus_k * (z * z)) - 2.0 * z;
    let root = (b * b - a * q).sqrt();
    let t = q / (b + root.copysign(s.n));
    (slide + t, [x + t * s.l, y + t * s.m, z + t * s.n], root)
}

#[derive(Clone, Copy)]
pub(super) struct Sphere {
    pub(super) c: f64,
}

impl Figure for Sphere {
    #[inline(always)]
    fn meet(self, s: &State) -> Hit {
        let (distance, at, root) = meet_conic(self.c, 1.0, s);
        // On the sphere this vector has length 1 by its equation.
        let normal = [-self.c * at[0], -self.c * at[1], 1.0 - self.c * at[2]];
        Hit { distance, at, normal, met: root >= 0.0 }
    }
}

#[derive(Clone, Copy)]
pub(super) struct Conic {
    pub(super) c: f64,
    pub(super) k: f64,
}

impl Figure for Conic {
    #[inline(always)]
    fn meet(self, s: &State) -> Hit {
        let one_plus_k = 1.0 + self.k;
        let (distance, at, root) = meet_conic(self.c, one_plus_k, s);
        let [gx, gy, gz] = [-self.c * at[0], -self.c * at[1], 1.0 - self.c * one_plus_k * at[2]];
        let scale = 1.0 / (gx * gx + gy * gy + gz * gz).sqrt();
        // For k < 0 the other sheet of a hyperboloid solves the equation too: there gz is negative.
        Hit { distance, at, normal: [gx * scale, gy * scale, gz * scale], met: root >= 0.0 && gz > 0.0 }
    }
}

#[derive(Clone, Copy)]
pub(super) struct Asphere {
    pub(super) c: f64,
    pub(super) k: f64,
    pub(super) terms: [f64; MAX_ASPHERIC_TERMS],
}

impl Asphere {
    /// Sag, and d sag / d (r^2), at r^2.
    #[inline(always)]
    fn sag(&self, r2: f64) -> (f64, f64) {
        let root = (1.0 - (1.0 + self.k) * self.c * self.c * r2).sqrt();
        let (mut sum, mut slope) = (0.0, 0.0);
        for &a in self.terms.iter().rev() {
            slope = slope * r2 + sum;
            sum = sum * r2 + a;
        }
        // sum is P with sag = r2 P(r2), slope is dP/dr2.
        (self.c * r2 / (1.0 + root) + r2 * sum, self.c / (2.0 * root) + sum + r2 * slope)
    }
}

impl Figure for Asphere {
    /// Newton's method from the conic's intersection (from the tangent plane where that misses).
    #[inline(always)]
    fn meet(self, s: &State) -> Hit {
        let (start, _, root) = meet_conic(self.c, 1.0 + self.k, s);
        let mut t = if root >= 0.0 { start } else { -s.z / s.n };
        let mut met = false;
        // Quadratic convergence: a start within a millimetre needs four or five turns.
        for _ in 0..32 {
            let (x, y, z) = (s.x + t * s.l, s.y + t * s.m, s.z + t * s.n);
            let (sag, slope) = self.sag(x * x + y * y);
            let error = z - sag;
            let gradient = s.n - 2.0 * slope * (x * s.l + y * s.m);
            let step = error / gradient;
            if !step.is_finite() {
                break;
            }
            t -= step;
            if step.abs() <= 4.0 * f64::EPSILON * (1.0 + t.abs() + z.abs()) {
                met = true;
                break;
            }
        }
        let at = [s.x + t * s.l, s.y + t * s.m, s.z + t * s.n];
        let (_, slope) = self.sag(at[0] * at[0] + at[1] * at[1]);
        let [gx, gy] = [-2.0 * slope * at[0], -2.0 * slope * at[1]];
        let scale = 1.0 / (gx * gx + gy * gy + 1.0).sqrt();
        Hit { distance: t, at, normal: [gx * scale, gy * scale, scale], met }
    }
}

/// Snell's law in vectors (W. T. Welford, Aberrations of Optical Systems): the direction behind
/// the surface, the cosine of incidence, and the radicand, negative at total reflection.
#[inline(always)]
pub(super) fn refract(s: &State, normal: [f64; 3], mu: f64) -> ([f64; 3], f64, f64) {
    let cosine = s.l * normal[0] + s.m * normal[1] + s.n * normal[2];
    let radicand = 1.0 - mu * mu * (1.0 - cosine * cosine);
    let g = radicand.sqrt().copysign(cosine) - mu * cosine;
    ([mu * s.l + g * normal[0], mu * s.m + g * normal[1], mu * s.n + g * normal[2]], cosine, radicand)
}

/// The law of reflection.
#[inline(always)]
pub(super) fn reflect(s: &State, normal: [f64; 3]) -> ([f64; 3], f64) {
    let cosine = s.l * normal[0] + s.m * normal[1] + s.n * normal[2];
    let g = -2.0 * cosine;
    ([s.l + g * normal[0], s.m + g * normal[1], s.n + g * normal[2]], cosine)
}

/// An ideal lens of power p (1/mm) at a point (x, y) of its plane: the new direction, and the
/// optical path it adds so that a plane wave is focused without aberration: the path from the
/// wavefront through the lens centre to the focal point, less the same through (x, y).
#[inline(always)]
pub(super) fn ideal_lens(s: &State, x: f64, y: f64, p: f64) -> ([f64; 3], f64) {
    let (ux, uy) = (s.l / s.n, s.m / s.n);
    let (vx, vy) = (ux - p * x, uy - p * y);
    let n = 1.0 / (vx * vx + vy * vy + 1.0).sqrt();
    let f = 1.0 / p;
    let centre = f * (ux * ux + uy * uy + 1.0).sqrt();
    let edge = f / n;
    ([vx * n, vy * n, n], centre - edge - (s.l * x + s.m * y))
}
