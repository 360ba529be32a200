//! Shapes of R. Gaskell's stereophotoclinometry: implicitly connected quadrilaterals (ICQ).
//!
//! The text holds q, then the vertices (x, y, z in km) of six faces of a cube, each with (q + 1)^2 of them, row by row
//! (Gaskell et al. 2008, Meteoritics & Planetary Science 43, 1049). Vertices on edges stand in each face that meets
//! there.

use std::path::Path;

use glam::DVec3;
use retina_files::{InputError, read_bytes};

use crate::kind::LoadedMesh;
use crate::load::{MAX_COORDINATE_M, MAX_ELEMENTS};
use crate::obj::plain_mesh;

const FACES: usize = 6;
const KM: f64 = 1e3;

/// Loads an ICQ shape: kilometres become body-fixed metres, axes are used as they are.
///
/// # Errors
/// The file cannot be read, holds what is no number, or another count of vertices than its q says.
pub(crate) fn load_icq(path: &Path) -> Result<LoadedMesh, InputError> {
    let bytes = read_bytes(path)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let (number, first) = lines.next().ok_or_else(|| {
        InputError::new(path, "the shape is empty").found(format!("{} bytes", bytes.len())).expected(FORM)
    })?;
    let q = first.split_ascii_whitespace().next().and_then(|word| word.parse::<usize>().ok()).filter(|&q| {
        q >= 1
            && q.checked_add(1)
                .and_then(|side| side.checked_pow(2))
                .is_some_and(|face| face <= MAX_ELEMENTS / 12)
    });
    let Some(q) = q else {
        return Err(InputError::new(path, "q does not read").line(number + 1).found(first.trim()).expected(
            format!("a whole number such as 64, so that the body has {MAX_ELEMENTS} triangles at most"),
        ));
    };
    let side = q + 1;
    let expected = FACES * side * side;
    let mut positions_m = Vec::new();
    for (number, line) in lines {
        let error = |problem: &str| InputError::new(path, problem).line(number + 1).found(line.trim());
        if positions_m.len() == expected {
            return Err(
                error("more vertices than q says").expected(format!("{expected} vertices for q = {q}"))
            );
        }
        let values: Option<Vec<f64>> = line
            .split_ascii_whitespace()
            .map(|word| word.replace(['D', 'd'], "E").parse().ok().filter(|value: &f64| value.is_finite()))
            .collect();
        let Some([x, y, z]) = values.and_then(|values| <[f64; 3]>::try_from(values).ok()) else {
            return Err(error("a vertex does not read").expected("x, y and z in km"));
        };
        // Adding zero turns a negative zero into a positive one: see `Vertex::position_m`.
        let position_m = DVec3::new(x, y, z) * KM + 0.0;
        if position_m.abs().max_element() > MAX_COORDINATE_M {
            return Err(error("the vertex is too far out").expected("km"));
        }
        positions_m.push(position_m);
    }
    if positions_m.len() != expected {
        return Err(InputError::new(path, "fewer vertices than q says")
            .found(positions_m.len())
            .expected(format!("{expected} for q = {q}"))
            .help("the file is cut short: fetch it again"));
    }
    let mut triangles = Vec::with_capacity(2 * FACES * q * q);
    for face in 0..FACES {
        let at = |row: usize, column: usize| ((face * side + row) * side + column) as u32;
        let begin = triangles.len();
        for (row, column) in (0..q).flat_map(|row| (0..q).map(move |column| (row, column))) {
            let [a, b] = [at(row, column), at(row, column + 1)];
            let [c, d] = [at(row + 1, column + 1), at(row + 1, column)];
            // The shorter diagonal, as a quadrilateral has no plane of its own.
            let length = |p: u32, r: u32| positions_m[p as usize].distance_squared(positions_m[r as usize]);
            let halves =
                if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
            triangles.extend(halves);
        }
        // Files differ in the sense in which rows and columns run: each face is turned outwards.
        let own = &mut triangles[begin..];
        let volume: f64 = own
            .iter()
            .map(|corners| {
                let [a, b, c] = corners.map(|corner| positions_m[corner as usize]);
                a.dot(b.cross(c))
            })
            .sum();
        if volume < 0.0 {
            own.iter_mut().for_each(|corners| corners.swap(1, 2));
        }
    }
    plain_mesh(path, positions_m, &triangles)
}

const FORM: &str = "q on the first line, then 6 (q + 1)^2 lines of x, y and z in km";
