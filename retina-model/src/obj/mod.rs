//! Loading: an OBJ file into one [`Body`].

mod parse;

use std::collections::HashMap;
use std::path::Path;

use glam::{DVec3, Vec2, Vec3};
use retina_files::{InputError, read_bytes};

use crate::body::{Body, Surface, Vertex};
use crate::kind::LoadedMesh;
use crate::paint::Layout;
use parse::{Corner, Text, parse};

/// Loads an OBJ file: `v`, `vt`, `vn` and `f` with all its forms of corners, indices also counted
/// backwards; polygons are cut into fans, which is right for convex ones.
///
/// Coordinates are taken as body-fixed metres, without a turn. Faces whose corners have normals
/// are shaded with them; others smoothly where a smoothing group is on (`s`), flat elsewhere.
/// Triangles without area are dropped. Both sides of a face are seen, as other programs show them. A
/// closed mesh whose faces wind clockwise is turned inside out, with a note. Materials (`usemtl`,
/// `mtllib`) are not read: a texture comes from the caller.
///
/// # Errors
/// The file cannot be read, a statement does not fit its form, a face names what does not exist
/// (with the line); no triangle has an area.
pub fn load_obj(path: &Path) -> Result<LoadedMesh, InputError> {
    from_text(path, &parse(path, &read_bytes(path)?)?)
}

/// A mesh of positions and triangles alone, as an OBJ file that holds nothing else.
pub(crate) fn plain_mesh(
    path: &Path,
    positions_m: Vec<DVec3>,
    triangles: &[[u32; 3]],
) -> Result<LoadedMesh, InputError> {
    let corner = |position: u32| Corner { position, texture: None, normal: None };
    let triangle =
        |corners: &[u32; 3]| parse::Triangle { corners: corners.map(corner), smooth: false, line: 0 };
    let triangles = triangles.iter().map(triangle).collect();
    from_text(path, &Text { positions_m, triangles, ..Text::default() })
}

fn from_text(path: &Path, text: &Text) -> Result<LoadedMesh, InputError> {
    let layout = layout(path, text)?;
    let mut notes = notes(text);
    let (mut body, position_of) = assemble(path, text)?;
    if body.volume_m3() < 0.0 && body.is_closed() {
        body.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        notes.push("the faces wind clockwise seen from outside; they are taken the other way round".into());
    }
    derive_normals(&mut body, &position_of, text.positions_m.len());
    Ok(LoadedMesh { body, layout, notes })
}

/// By `vt` if every corner has one.
fn layout(path: &Path, text: &Text) -> Result<Layout, InputError> {
    let has = |triangle: &&parse::Triangle| triangle.corners.iter().all(|corner| corner.texture.is_some());
    let with = text.triangles.iter().filter(has).count();
    if with == text.triangles.len() {
        return Ok(Layout::Coordinates);
    }
    if with == 0 && !text.triangles.iter().flat_map(|t| t.corners).any(|corner| corner.texture.is_some()) {
        return Ok(Layout::LongitudeLatitude);
    }
    let first = text.triangles.iter().find(|triangle| !has(triangle)).map_or(0, |triangle| triangle.line);
    Err(InputError::new(path, "some corners have texture coordinates and others have none")
        .line(first)
        .found(format!("{with} of {} triangles have them", text.triangles.len()))
        .expected("all or none")
        .help("export the mesh with its UV map, or without"))
}

fn notes(text: &Text) -> Vec<String> {
    let line_of = |keyword: &str| text.passed_over.iter().find(|(k, _)| k == keyword).map(|(_, line)| line);
    let mut notes = Vec::new();
    if let Some(line) = line_of("mtllib").or_else(|| line_of("usemtl")) {
        notes.push(format!("materials of OBJ files are not read (line {line})"));
    }
    let others: Vec<String> = text
        .passed_over
        .iter()
        .filter(|(keyword, _)| keyword != "mtllib" && keyword != "usemtl")
        .map(|(keyword, line)| format!("`{}` (line {line})", keyword.escape_default()))
        .collect();
    if !others.is_empty() {
        notes.push(format!("statements without a meaning here are passed over: {}", others.join(", ")));
    }
    notes
}

/// The body, and for each of its vertices the file's position. Normals that the file does not give
/// are zero.
fn assemble(path: &Path, text: &Text) -> Result<(Body, Vec<u32>), InputError> {
    let mut body = Body::default();
    let mut known: HashMap<(Corner, bool), u32> = HashMap::new();
    let mut position_of: Vec<u32> = Vec::new();
    let mut surfaces: [Option<u16>; 2] = [None; 2];
    for triangle in &text.triangles {
        let flat = !triangle.smooth && triangle.corners.iter().any(|corner| corner.normal.is_none());
        let corners = triangle.corners.map(|corner| {
            *known.entry((corner, flat)).or_insert_with(|| {
                let normal = corner.normal.map_or(DVec3::ZERO, |n| text.normals[n as usize]);
                body.vertices.push(Vertex {
                    position_m: text.positions_m[corner.position as usize],
                    normal: normal.as_vec3(),
                    uv: corner.texture.map_or(Vec2::ZERO, |t| text.uvs[t as usize]),
                });
                position_of.push(corner.position);
                // At most three for each of MAX_ELEMENTS triangles: within u32.
                (body.vertices.len() - 1) as u32
            })
        });
        body.triangles.push(corners);
        if body.doubled_area_m2(body.triangles.len() - 1) == DVec3::ZERO {
            body.triangles.pop();
            continue;
        }
        let surface = *surfaces[usize::from(flat)].get_or_insert_with(|| {
            body.surfaces.push(Surface {
                name: if flat { "flat faces" } else { "smooth faces" }.into(),
                flat,
                albedo_map: None,
                albedo_factor: 1.0,
                slope_map: None,
                double_sided: true,
            });
            (body.surfaces.len() - 1) as u16
        });
        body.triangle_surface.push(surface);
    }
    if body.triangles.is_empty() {
        return Err(InputError::new(path, "holds no face with an area")
            .found(format!("{} vertices, {} triangles", text.positions_m.len(), text.triangles.len()))
            .expected("faces with three corners or more that are not on a line"));
    }
    Ok((body, position_of))
}

/// Smooth normals where the file gives none: vertices at one of its positions share theirs.
fn derive_normals(body: &mut Body, position_of: &[u32], positions: usize) {
    let mut sums = vec![DVec3::ZERO; positions];
    for triangle in 0..body.triangles.len() {
        body.add_corner_normals(triangle, |v| position_of[v as usize] as usize, &mut sums);
    }
    for (vertex, &position) in body.vertices.iter_mut().zip(position_of) {
        if vertex.normal == Vec3::ZERO {
            // Two facets back to back cancel: any direction does.
            vertex.normal = sums[position as usize].normalize_or(DVec3::Z).as_vec3();
        }
    }
}
