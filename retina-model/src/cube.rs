//! The equiangular cube-sphere: six square faces whose grid lines are great circles at equal
//! angles (Ronchi, Iacono and Paolucci 1996), so that cells differ in area by a factor of 1.4 only.

use glam::DVec3;

/// One face of the cube.
pub(crate) struct Face {
    /// Name: the axis through its middle.
    pub(crate) name: &'static str,
    /// Outward axis, then the axes of its s and t coordinates: normal = s x t.
    normal: DVec3,
    s: DVec3,
    t: DVec3,
}

/// The six faces.
pub(crate) const FACES: [Face; 6] = [
    Face { name: "+x", normal: DVec3::X, s: DVec3::Y, t: DVec3::Z },
    Face { name: "-x", normal: DVec3::NEG_X, s: DVec3::NEG_Y, t: DVec3::Z },
    Face { name: "+y", normal: DVec3::Y, s: DVec3::NEG_X, t: DVec3::Z },
    Face { name: "-y", normal: DVec3::NEG_Y, s: DVec3::X, t: DVec3::Z },
    Face { name: "+z", normal: DVec3::Z, s: DVec3::Y, t: DVec3::NEG_X },
    Face { name: "-z", normal: DVec3::NEG_Z, s: DVec3::Y, t: DVec3::X },
];

/// Tangents of `steps + 1` equal angles from -45 to 45 degrees, antisymmetric to the last bit:
/// what makes an edge's points equal bit by bit on both of its faces.
pub(crate) fn grid(steps: u32) -> Vec<f64> {
    let half = |k: u32| {
        if k == steps {
            1.0
        } else {
            (std::f64::consts::FRAC_PI_4 * (2.0 * f64::from(k) / f64::from(steps) - 1.0)).tan()
        }
    };
    (0..=steps)
        .map(|k| match (2 * k).cmp(&steps) {
            std::cmp::Ordering::Less => -half(steps - k),
            std::cmp::Ordering::Equal => 0.0,
            std::cmp::Ordering::Greater => half(k),
        })
        .collect()
}

impl Face {
    /// Unit direction of the point whose tangents along s and t are given, each in -1..1.
    pub(crate) fn direction(&self, tan_s: f64, tan_t: f64) -> DVec3 {
        // Sums of signed axes: each component is one of +-1, tan_s, tan_t exactly.
        let point = self.normal + self.s * tan_s + self.t * tan_t;
        // The two faces of an edge hold the same components, and the length must not depend on
        // which axis they stand on: so it is summed in order of size. Zero is made positive.
        let mut squares = (point * point).to_array();
        squares.sort_by(f64::total_cmp);
        point / (squares[0] + squares[1] + squares[2]).sqrt() + 0.0
    }
}

/// The two triangles of each cell of a face, counter-clockwise seen from outside, as indices into
/// its (cells + 1)^2 vertices (s runs fastest). Each cell is cut along its shorter diagonal, which
/// keeps the triangles near the cube's corners even.
pub(crate) fn cell_triangles(cells: u32) -> Vec<[u32; 3]> {
    let across = cells + 1;
    let mut triangles = Vec::with_capacity(2 * (cells as usize).pow(2));
    for j in 0..cells {
        for i in 0..cells {
            let [a, b] = [j * across + i, j * across + i + 1];
            let [c, d] = [a + across, b + across];
            // Three faces meet at a corner of the cube, so the cell there has 120 degrees: its
            // short diagonal starts from that corner, along the line to the face's middle.
            let rising = (2 * i + 1 < cells) == (2 * j + 1 < cells);
            if rising {
                triangles.extend([[a, b, d], [a, d, c]]);
            } else {
                triangles.extend([[a, b, c], [b, d, c]]);
            }
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_are_right_handed_and_cover_the_axes() {
        for face in &FACES {
            assert_eq!(face.s.cross(face.t), face.normal, "{}", face.name);
            assert_eq!(face.direction(0.0, 0.0), face.normal);
        }
    }

    #[test]
    fn cells_are_cut_along_their_shorter_diagonal() {
        let (cells, face) = (8u32, &FACES[0]);
        let tan = grid(cells);
        let at = |v: u32| face.direction(tan[(v % 9) as usize], tan[(v / 9) as usize]);
        for pair in cell_triangles(cells).chunks(2) {
            let shared: Vec<u32> = pair[0].into_iter().filter(|v| pair[1].contains(v)).collect();
            let other: Vec<u32> = pair.iter().flatten().copied().filter(|v| !shared.contains(v)).collect();
            let [cut, kept] = [&shared, &other].map(|d| at(d[0]).distance(at(d[1])));
            assert!(cut <= kept + 1e-12, "{pair:?}: {cut} against {kept}");
        }
    }
}
