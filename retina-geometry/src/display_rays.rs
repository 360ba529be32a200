//! What the facility's lenses make of the display's depth, from its prescription.

/// Where lines of sight meet the display, and what its depth does to them, of a facility that is symmetric about its
/// axis. With r the tangent of the line of sight and z the depth away from the lenses: height X(r) = r (h_0 + h_1 r^2 +
/// h_2 r^4), and dr/dz = r (d_0 + d_1 r^2 + d_2 r^4).
///
/// dr/dz is that of the light's centroid: the mean over the pupil of -(dX/dz) / (dX/dr), each ray with its own. The chief
/// ray alone has another one, since a blurred spot with coma moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisplayRays {
    /// h_0, h_1, h_2, mm; the display's axes are those of the lines of sight, so h_0 is positive.
    pub height_mm: [f64; 3],
    /// d_0, d_1, d_2, 1/mm.
    pub tangent_per_depth: [f64; 3],
}

impl DisplayRays {
    /// Height over the tangent r of the line of sight, mm.
    pub fn height_over_tangent_mm(&self, r: f64) -> f64 {
        even(self.height_mm, r)
    }

    /// What a millimetre of depth adds to a line of sight of tangent r, over r.
    pub fn tangent_per_depth(&self, r: f64) -> f64 {
        even(self.tangent_per_depth, r)
    }

    /// What a tilt adds near the axis: a display turned by tau moves u (tangents) by k tau (u . e) u, with this k; -1 for
    /// a pinhole (Hartley and Zisserman, Multiple View Geometry, sec. 2.3: X = f r on a plane at f + dz).
    pub fn tilt_gain(&self) -> f64 {
        self.height_mm[0] * self.tangent_per_depth[0]
    }
}

fn even([a, b, c]: [f64; 3], r: f64) -> f64 {
    let r2 = r * r;
    a + r2 * (b + r2 * c)
}
