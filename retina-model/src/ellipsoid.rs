//! The ellipsoid that a mesh comes to.

use std::path::Path;

use glam::{DMat3, DVec3};
use retina_files::InputError;

use crate::body::Body;

/// Turns of Jacobi's method: each squares what is off the diagonal.
const SWEEPS: usize = 12;

/// The ellipsoid with a body's volume and second moments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid {
    /// Its centre, the body's centre of figure, body-fixed axes, m.
    pub center_m: DVec3,
    /// Semi-axes, least first, m.
    pub semi_axes_m: DVec3,
    /// Turns its axes into body-fixed ones.
    pub body_from_axes: DMat3,
    /// Root mean square of the mesh's height above it, weighted by area, m.
    pub rms_height_m: f64,
}

impl Body {
    /// The ellipsoid with the volume and the second moments of this body. A solid ellipsoid of semi-axis a has the mean
    /// square a^2 / 5 along it.
    ///
    /// # Errors
    /// The mesh is not closed, so that it has no volume; `path` names it.
    pub fn ellipsoid(&self, path: &Path) -> Result<Ellipsoid, InputError> {
        let volume_m3 = self.volume_m3();
        if !self.is_closed() || volume_m3 <= 0.0 {
            return Err(InputError::new(path, "the mesh has no volume")
                .found(if volume_m3 > 0.0 { "a mesh with open edges" } else { "triangles that wind inwards" })
                .expected("a closed mesh, its triangles counter-clockwise seen from outside")
                .help("close the mesh, or give the body's semi-axes"));
        }
        // Tetrahedra from the origin: the integral of x_i x_j is V / 20 (sum of all four corners' products with the sum).
        let mean = |axis: usize| {
            self.sum_triangles(|t| {
                let [a, b, c] = self.corners_m(t);
                a.dot(b.cross(c)) / 24.0 * (a + b + c)[axis]
            }) / volume_m3
        };
        let center_m = DVec3::new(mean(0), mean(1), mean(2));
        let moment = |i: usize, j: usize| {
            self.sum_triangles(|t| {
                let [a, b, c] = self.corners_m(t).map(|corner| corner - center_m);
                let sum = a + b + c;
                a.dot(b.cross(c)) / 120.0 * (sum[i] * sum[j] + a[i] * a[j] + b[i] * b[j] + c[i] * c[j])
            }) / volume_m3
        };
        let [xx, xy, xz, yy, yz, zz] =
            [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|(i, j)| moment(i, j));
        let moments_m2 = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
        let (squares, turn) = eigen(moments_m2);
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| squares[a].total_cmp(&squares[b]));
        let mut body_from_axes = DMat3::from_cols(turn.col(order[0]), turn.col(order[1]), turn.col(order[2]));
        if body_from_axes.determinant() < 0.0 {
            body_from_axes.z_axis = -body_from_axes.z_axis;
        }
        let axes_m = DVec3::from_array(order.map(|k| (5.0 * squares[k]).sqrt()));
        // A mesh that is no ellipsoid has larger moments than one of its volume: the volume counts.
        let scale =
            (0.75 * volume_m3 / std::f64::consts::PI / axes_m.to_array().iter().product::<f64>()).cbrt();
        let semi_axes_m = axes_m * scale;
        let height2 = |t: usize| {
            let [a, b, c] = self.corners_m(t);
            let off = body_from_axes.transpose() * ((a + b + c) / 3.0 - center_m);
            let height_m = off.length() * (1.0 - (off / semi_axes_m).length().recip());
            self.doubled_area_m2(t).length() * height_m * height_m
        };
        let area = self.sum_triangles(|t| self.doubled_area_m2(t).length());
        let rms_height_m = (self.sum_triangles(height2) / area).sqrt();
        Ok(Ellipsoid { center_m, semi_axes_m, body_from_axes, rms_height_m })
    }
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix, by Jacobi's rotations.
fn eigen(matrix: DMat3) -> ([f64; 3], DMat3) {
    let (mut a, mut vectors) = (matrix, DMat3::IDENTITY);
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = a.col(q)[p];
            if off == 0.0 {
                continue;
            }
            let angle = 0.5 * (2.0 * off).atan2(a.col(q)[q] - a.col(p)[p]);
            let (sin, cos) = angle.sin_cos();
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = cos;
            turn.col_mut(q)[q] = cos;
            turn.col_mut(q)[p] = sin;
            turn.col_mut(p)[q] = -sin;
            a = turn.transpose() * a * turn;
            vectors *= turn;
        }
    }
    ([a.x_axis.x, a.y_axis.y, a.z_axis.z], vectors)
}
