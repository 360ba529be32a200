//! The outline of a body's own shape: the silhouette of its mesh from where the camera is.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use retina_files::InputError;
use retina_model::{Body, load_body};

use super::LimbCamera;
use super::edge::{Node, node_count};

/// Position angles at which a silhouette is looked up.
const ANGLES: usize = 5760;
/// Sectors in which the outermost vertices are found first.
const SECTORS: usize = 360;
/// An edge is looked at where one end is beyond this share of the outermost vertices about it.
const NEAR_RIM: f64 = 0.97;
/// Places that a piece of the outline is the mean of.
const PLACES: usize = 8;
/// An outline that runs nearly towards its middle is a jump from one part of the body to another, cosine.
const LEAST_COS_OUTWARD: f64 = 0.3;

/// A closed mesh whose silhouette is a body's outline.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyShape {
    vertices_m: Vec<DVec3>,
    /// Ends of each edge, once.
    edges: Vec<[u32; 2]>,
}

/// A place of a silhouette.
#[derive(Debug, Clone, Copy)]
struct Rim {
    /// On the tangent plane.
    at: DVec2,
    /// The body's point that is seen there, relative to the body's origin, camera frame, m.
    offset_m: DVec3,
}

/// Pieces of a silhouette in the image, and what of the body is seen there.
#[derive(Debug, Clone, Default)]
pub(super) struct RimPieces {
    pub nodes: Vec<Node>,
    /// By the nodes' index: relative to the body's origin, camera frame, m.
    pub offsets_m: Vec<DVec3>,
}

impl BodyShape {
    /// A mesh in the axes of its [`LimbBody`](super::LimbBody), m. Its origin must be inside.
    pub fn new(vertices_m: Vec<DVec3>, triangles: &[[u32; 3]]) -> Self {
        let mut edges: Vec<[u32; 2]> =
            triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        edges.iter_mut().for_each(|edge| edge.sort_unstable());
        edges.sort_unstable();
        edges.dedup();
        Self { vertices_m, edges }
    }

    /// The shape of a mesh file, in the body's own axes.
    ///
    /// # Errors
    /// The mesh cannot be read.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Ok(Self::of(&load_body(path)?, DMat3::IDENTITY))
    }

    /// The shape of a mesh, in axes that `axes_from_body` takes the mesh's to.
    pub fn of(mesh: &Body, axes_from_body: DMat3) -> Self {
        let vertices_m = mesh.vertices.iter().map(|vertex| axes_from_body * vertex.position_m).collect();
        Self::new(vertices_m, &mesh.triangles)
    }

    /// Mean length of the edges, m: how finely the shape is known.
    pub fn mean_edge_m(&self) -> f64 {
        let length =
            |[from, to]: &[u32; 2]| self.vertices_m[*from as usize].distance(self.vertices_m[*to as usize]);
        self.edges.iter().map(length).sum::<f64>() / self.edges.len().max(1) as f64
    }

    /// The outermost places at [`ANGLES`] position angles about the projected origin; `None` where the camera is inside,
    /// or the origin is not.
    fn silhouette(&self, position_m: DVec3, camera_from_body: DMat3, scale: f64) -> Option<Vec<Rim>> {
        let middle = position_m.truncate() / position_m.z;
        let seen: Vec<(DVec3, DVec2)> = self
            .vertices_m
            .iter()
            .map(|vertex| {
                let offset_m = camera_from_body * *vertex * scale;
                let at = position_m + offset_m;
                (offset_m, at.truncate() / at.z - middle)
            })
            .collect();
        if seen.iter().any(|(offset_m, _)| offset_m.z + position_m.z <= 0.0) {
            return None;
        }
        let polar: Vec<[f64; 2]> = seen.iter().map(|(_, at)| [at.y.atan2(at.x), at.length()]).collect();
        let sector = |angle: f64| (((angle + PI) / TAU * SECTORS as f64) as usize).min(SECTORS - 1);
        let mut outermost = vec![0.0f64; SECTORS];
        for [angle, radius] in &polar {
            let most = &mut outermost[sector(*angle)];
            *most = most.max(*radius);
        }
        let floors: Vec<f64> = (0..SECTORS)
            .map(|k| {
                let about = [k + SECTORS - 1, k, k + 1].map(|k| outermost[k % SECTORS]);
                NEAR_RIM * about.into_iter().fold(f64::INFINITY, f64::min)
            })
            .collect();
        let floor = |angle: f64| floors[sector(angle)];
        let near = |[angle, radius]: [f64; 2]| radius >= floor(angle);
        let rim = self.outermost(&seen, &polar, position_m, |[a, b]| near(a) || near(b));
        // What is further in than the edges that were left out may be wrong.
        let angle = |k: usize| (k as f64 + 0.5) / ANGLES as f64 * TAU - PI;
        let settled = |rim: &[Option<Rim>]| {
            rim.iter()
                .enumerate()
                .all(|(k, place)| place.is_some_and(|place| place.at.length() >= floor(angle(k))))
        };
        let rim = if settled(&rim) { rim } else { self.outermost(&seen, &polar, position_m, |_| true) };
        let rim: Option<Vec<Rim>> = rim.into_iter().collect();
        rim.map(|rim| rim.into_iter().map(|place| Rim { at: place.at + middle, ..place }).collect())
    }

    /// Of the edges that are looked at, the outermost crossing of each position angle.
    fn outermost(
        &self,
        seen: &[(DVec3, DVec2)],
        polar: &[[f64; 2]],
        position_m: DVec3,
        looked_at: impl Fn([[f64; 2]; 2]) -> bool,
    ) -> Vec<Option<Rim>> {
        let directions: Vec<DVec2> =
            (0..ANGLES).map(|k| DVec2::from_angle((k as f64 + 0.5) / ANGLES as f64 * TAU - PI)).collect();
        let mut rim: Vec<Option<Rim>> = vec![None; ANGLES];
        for [from, to] in &self.edges {
            let (from, to) = (*from as usize, *to as usize);
            if !looked_at([polar[from], polar[to]]) {
                continue;
            }
            // From the first end counter-clockwise to the second, by the shorter way.
            let turn = (polar[to][0] - polar[from][0] + PI).rem_euclid(TAU) - PI;
            let (from, to) = if turn < 0.0 { (to, from) } else { (from, to) };
            let place = |angle: f64| (angle + PI) / TAU * ANGLES as f64 - 0.5;
            let first = place(polar[from][0]).ceil() as i64;
            let last = (place(polar[from][0]) + turn.abs() / TAU * ANGLES as f64).floor() as i64;
            let (start, end) = (seen[from].1, seen[to].1);
            for k in first..=last {
                let bin = k.rem_euclid(ANGLES as i64) as usize;
                let [a, b] = [start, end].map(|at| directions[bin].perp_dot(at));
                let part = if a == b { 0.0 } else { (a / (a - b)).clamp(0.0, 1.0) };
                let at = start + (end - start) * part;
                if rim[bin].is_none_or(|other| at.length_squared() > other.at.length_squared()) {
                    // A share of the projected edge is another share of the edge itself.
                    let [z_start, z_end] = [from, to].map(|k| seen[k].0.z + position_m.z);
                    let share = part * z_start / (z_end - part * (z_end - z_start));
                    let offset_m = seen[from].0.lerp(seen[to].0, share);
                    rim[bin] = Some(Rim { at, offset_m });
                }
            }
        }
        rim
    }

    /// The silhouette's furthest reach in each direction, on the tangent plane, with the body's origin at `position_m`.
    pub(super) fn supports(
        &self,
        position_m: DVec3,
        camera_from_body: DMat3,
        directions: &[DVec2],
    ) -> Option<Vec<f64>> {
        let rim = self.silhouette(position_m, camera_from_body, 1.0)?;
        let middle = position_m.truncate() / position_m.z;
        let reach = |direction: &DVec2| {
            rim.iter().map(|place| direction.dot(place.at - middle)).fold(f64::MIN, f64::max)
        };
        Some(directions.iter().map(reach).collect())
    }

    /// The silhouette in the image, in pieces of about 5 px.
    pub(super) fn pieces(
        &self,
        position_m: DVec3,
        camera_from_body: DMat3,
        scale: f64,
        camera: &LimbCamera,
    ) -> Option<RimPieces> {
        let rim = self.silhouette(position_m, camera_from_body, scale)?;
        let pixels: Option<Vec<DVec2>> = rim.iter().map(|place| camera.pixel(place.at)).collect();
        let pixels = pixels?;
        let middle = camera.pixel(position_m.truncate() / position_m.z)?;
        // The polygon's length up to each corner.
        let mut lengths = vec![0.0];
        for k in 0..ANGLES {
            lengths.push(lengths[k] + pixels[k].distance(pixels[(k + 1) % ANGLES]));
        }
        let whole = lengths[ANGLES];
        let count = node_count(whole / TAU);
        let step = whole / count as f64;
        let mut corner = 0;
        let mut means = Vec::with_capacity(count);
        let mut offsets_m = Vec::with_capacity(count);
        for k in 0..count {
            let (mut at, mut offset_m) = (DVec2::ZERO, DVec3::ZERO);
            for part in 0..PLACES {
                let along = (k as f64 + (part as f64 + 0.5) / PLACES as f64) * step;
                while corner + 1 < ANGLES && lengths[corner + 1] < along {
                    corner += 1;
                }
                let next = (corner + 1) % ANGLES;
                let share = (along - lengths[corner]) / (lengths[corner + 1] - lengths[corner]).max(1e-12);
                at += pixels[corner].lerp(pixels[next], share.clamp(0.0, 1.0));
                offset_m += rim[corner].offset_m.lerp(rim[next].offset_m, share.clamp(0.0, 1.0));
            }
            means.push(at / PLACES as f64);
            offsets_m.push(offset_m / PLACES as f64);
        }
        // Curvature over a longer arc than a hill is wide.
        let wide = (count / 24).max(2);
        let nodes = (0..count).filter_map(|index| {
            let about = |off: usize| [means[(index + count - off) % count], means[(index + off) % count]];
            let [before, after] = about(1);
            let chord = after - before;
            let normal = DVec2::new(chord.y, -chord.x).normalize_or_zero();
            let [far_before, far_after] = about(wide);
            let half = 0.5 * far_before.distance(far_after);
            let sagitta = (means[index] - 0.5 * (far_before + far_after)).dot(normal);
            let straight = if sagitta < 0.0 { -1e-6 } else { 1e-6 };
            let sagitta = if sagitta.abs() < 1e-6 { straight } else { sagitta };
            let curvature_radius_px = (half * half + sagitta * sagitta) / (2.0 * sagitta);
            let half_length_px = 0.25 * chord.length();
            let outward = (means[index] - middle).normalize_or_zero();
            (normal.dot(outward) > LEAST_COS_OUTWARD).then(|| Node {
                index,
                // The mean of an arc lies inside its middle.
                at: means[index] + normal * (half_length_px.powi(2) / (6.0 * curvature_radius_px)),
                normal,
                curvature_radius_px,
                half_length_px,
            })
        });
        Some(RimPieces { nodes: nodes.collect(), offsets_m })
    }
}
