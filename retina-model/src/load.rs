//! Loading: scene graph and primitives of a glTF document into one [`Body`].

use std::path::Path;

use glam::{DMat3, DMat4, DQuat, DVec3, Vec2, Vec3};
use gltf::json;
use gltf::json::mesh::{Mode, Semantic};
use gltf::json::validation::Checked;
use retina_files::{InputError, read_bytes};

use crate::body::{Body, Surface, Vertex};
use crate::document::{Document, Elements};
use crate::textures::{Material, Textures};

/// Extensions that a file may require. Quantised attributes are read like any others.
const SUPPORTED_EXTENSIONS: [&str; 2] = ["KHR_texture_transform", "KHR_mesh_quantization"];

/// Most vertices, and most triangles, of a body: 1 GB in memory, beyond what is rendered here.
/// Without a bound instancing could multiply a small file without end.
pub(crate) const MAX_ELEMENTS: usize = 1 << 24;

/// Largest coordinate, metres: beyond the Sun's radius a thousandfold; areas and volumes stay finite.
pub(crate) const MAX_COORDINATE_M: f64 = 1e12;

/// Loads a body from a glTF file, with its buffers and images wherever they are (embedded, data
/// URIs, files beside it).
///
/// Read are the default scene (without one, all root nodes), triangles, strips and fans, the base
/// colour and the normal texture. Coordinates are taken as body-fixed metres, without a y-up turn.
/// Triangles without area are dropped. Alpha is not used: bodies are opaque. Texture filters are
/// taken as linear. The albedo's mean over the surface becomes 1.
///
/// # Errors
/// The file cannot be read or is damaged; it needs what is not supported (other primitive modes,
/// sparse accessors, skins, morphed meshes, coloured vertices, a required extension); it holds no
/// triangle, or its albedo is black. Each with the part of the file in which it lies.
pub(crate) fn load_gltf(path: &Path) -> Result<Body, InputError> {
    let bytes = read_bytes(path)?;
    let document = Document::parse(path, &bytes)?;
    for extension in &document.root.extensions_required {
        if !SUPPORTED_EXTENSIONS.contains(&extension.as_str()) {
            return Err(document
                .error("extensionsRequired", "requires an extension that is not supported")
                .found(format!("`{}`", extension.escape_default()))
                .expected(SUPPORTED_EXTENSIONS.join(" or "))
                .help("export the file without it (for compressed meshes: uncompressed)"));
        }
    }
    let placed = placed_meshes(&document)?;
    check_size(&document, &placed)?;
    let mut loader = Loader {
        document: &document,
        body: Body::default(),
        textures: Textures::default(),
        keys: Vec::new(),
    };
    for (mesh, transform) in placed {
        let entry = document.item(&document.root.meshes, mesh, "mesh", "nodes")?;
        if entry.weights.iter().flatten().any(|&w| w != 0.0) {
            return Err(document
                .error(&format!("mesh {mesh}"), "is morphed by weights, which is not supported")
                .help("apply the shape before the export"));
        }
        for (i, primitive) in entry.primitives.iter().enumerate() {
            loader.primitive(primitive, transform, &format!("mesh {mesh} primitive {i}"))?;
        }
    }
    let Loader { mut body, textures, .. } = loader;
    if body.triangles.is_empty() {
        return Err(InputError::new(path, "holds no triangle with an area in its scene")
            .help("check that the mesh is part of the default scene"));
    }
    body.albedo_maps = textures.albedo_maps;
    body.slope_maps = textures.slope_maps;
    body.normalise_albedo(path, "baseColorTexture and baseColorFactor")?;
    let one_sided = body.surfaces.iter().any(|surface| !surface.double_sided);
    if one_sided && body.volume_m3() < 0.0 && body.is_closed() {
        return Err(InputError::new(path, "is inside out: its outside would be black")
            .found("a closed mesh whose triangles wind clockwise seen from outside")
            .expected("counter-clockwise, as glTF has it")
            .help("turn the faces round before the export (Blender: Mesh, Normals, Recalculate Outside)"));
    }
    Ok(body)
}

/// The meshes of the scene with their transforms into the scene's axes, in the document's order.
fn placed_meshes(document: &Document<'_>) -> Result<Vec<(usize, DMat4)>, InputError> {
    let root = &document.root;
    let mut roots: Vec<usize> = match root.scene {
        Some(scene) => {
            let scene = document.item(&root.scenes, scene.value(), "scene", "scene")?;
            scene.nodes.iter().map(json::Index::value).collect()
        }
        None => {
            let mut child = vec![false; root.nodes.len()];
            for index in root.nodes.iter().flat_map(|n| n.children.iter().flatten()) {
                if let Some(flag) = child.get_mut(index.value()) {
                    *flag = true;
                }
            }
            (0..root.nodes.len()).filter(|&i| !child[i]).collect()
        }
    };
    roots.reverse();
    let mut stack: Vec<(usize, DMat4)> = roots.into_iter().map(|i| (i, DMat4::IDENTITY)).collect();
    let mut seen = vec![false; root.nodes.len()];
    let mut placed = Vec::new();
    while let Some((index, parent)) = stack.pop() {
        let place = format!("node {index}");
        let node = document.item(&root.nodes, index, "node", "scene graph")?;
        if std::mem::replace(&mut seen[index], true) {
            return Err(document
                .error(&place, "stands in the scene graph more than once")
                .expected("a tree: one parent for each node"));
        }
        let transform = parent * local_transform(node);
        if let Some(mesh) = node.mesh {
            if node.skin.is_some() || node.weights.iter().flatten().any(|&w| w != 0.0) {
                return Err(document
                    .error(&place, "its mesh is skinned or morphed, which is not supported")
                    .help("apply the deformation before the export"));
            }
            placed.push((mesh.value(), transform));
        }
        stack.extend(node.children.iter().flatten().rev().map(|child| (child.value(), transform)));
    }
    Ok(placed)
}

/// Refuses bodies of too many vertices or triangles before memory is taken for them.
fn check_size(document: &Document<'_>, placed: &[(usize, DMat4)]) -> Result<(), InputError> {
    let (mut vertices, mut triangles) = (0, 0);
    for &(mesh, _) in placed {
        let entry = document.item(&document.root.meshes, mesh, "mesh", "nodes")?;
        for (i, primitive) in entry.primitives.iter().enumerate() {
            let place = format!("mesh {mesh} primitive {i}");
            let count = |accessor: &json::Index<json::Accessor>, part: &str| {
                Ok(document.elements(accessor.value(), &format!("{place} {part}"))?.count)
            };
            let positions = match primitive.attributes.get(&Checked::Valid(Semantic::Positions)) {
                Some(accessor) => count(accessor, "POSITION")?,
                None => 0,
            };
            let corners = primitive.indices.as_ref().map_or(Ok(positions), |a| count(a, "indices"))?;
            let shared = if primitive.mode == Checked::Valid(Mode::Triangles) { 3 } else { 1 };
            vertices += positions;
            triangles += corners / shared;
            if vertices > MAX_ELEMENTS || triangles > MAX_ELEMENTS {
                return Err(document
                    .error(&place, "makes the body larger than it may be")
                    .found(format!("{vertices} vertices, {triangles} triangles up to here"))
                    .expected(format!("at most {MAX_ELEMENTS} of each, instances included"))
                    .help("use a coarser mesh"));
            }
        }
    }
    Ok(())
}

fn local_transform(node: &json::Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return DMat4::from_cols_array(&matrix.map(f64::from));
    }
    let vector = |v: Option<[f32; 3]>, default: f64| {
        v.map_or(DVec3::splat(default), |v| DVec3::from_array(v.map(f64::from)))
    };
    let rotation =
        node.rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q.0.map(f64::from)).normalize());
    DMat4::from_scale_rotation_translation(vector(node.scale, 1.0), rotation, vector(node.translation, 0.0))
}

/// What a primitive's attributes are called in messages.
fn semantic_name(semantic: &Semantic) -> String {
    match semantic {
        Semantic::Positions => "POSITION".into(),
        Semantic::Normals => "NORMAL".into(),
        Semantic::TexCoords(n) => format!("TEXCOORD_{n}"),
        Semantic::Colors(n) => format!("COLOR_{n}"),
        other => format!("{other:?}"),
    }
}

struct Loader<'d, 'a> {
    document: &'d Document<'a>,
    body: Body,
    textures: Textures,
    /// Material and flatness of each surface, to share one among primitives.
    keys: Vec<(Option<usize>, bool)>,
}

impl Loader<'_, '_> {
    fn attribute(
        &self,
        primitive: &json::mesh::Primitive,
        semantic: Semantic,
        place: &str,
    ) -> Result<Option<(Elements<'_>, String)>, InputError> {
        let place = format!("{place} {}", semantic_name(&semantic));
        match primitive.attributes.get(&Checked::Valid(semantic)) {
            None => Ok(None),
            Some(accessor) => Ok(Some((self.document.elements(accessor.value(), &place)?, place))),
        }
    }

    /// Vectors of an attribute, one for each vertex: floats, or integers where the format allows.
    fn vectors<const N: usize>(
        &self,
        (elements, place): (Elements<'_>, String),
        vertices: Option<usize>,
        fraction_allowed: bool,
    ) -> Result<Vec<[f32; N]>, InputError> {
        let quantised = self.document.root.extensions_used.iter().any(|e| e == "KHR_mesh_quantization");
        let kind_fits =
            elements.is_float() || quantised || (fraction_allowed && elements.is_unsigned_fraction());
        if elements.components != N || !kind_fits {
            return Err(self
                .document
                .error(&place, "is of another type than the attribute has")
                .found(elements.describe())
                .expected(format!("{N} components of F32")));
        }
        if let Some(expected) = vertices.filter(|&n| n != elements.count) {
            return Err(self
                .document
                .error(&place, "does not have one element for each vertex")
                .found(elements.count)
                .expected(expected));
        }
        let values: Vec<[f32; N]> = (0..elements.count).map(|i| elements.vector(i)).collect();
        match values.iter().position(|v| v.iter().any(|c| !c.is_finite())) {
            None => Ok(values),
            Some(i) => Err(self
                .document
                .error(&place, format!("element {i} is not finite"))
                .found(format!("{:?}", values[i]))),
        }
    }

    /// Vertex colours multiply the base colour in glTF; only white ones can be left out unharmed.
    fn refuse_vertex_colours(
        &self,
        primitive: &json::mesh::Primitive,
        place: &str,
    ) -> Result<(), InputError> {
        let Some((colours, place)) = self.attribute(primitive, Semantic::Colors(0), place)? else {
            return Ok(());
        };
        if (0..colours.count).any(|i| colours.vector::<3>(i).iter().any(|&c| (c - 1.0).abs() > 1e-3)) {
            return Err(self
                .document
                .error(&place, "holds vertex colours, which are not supported")
                .help("bake the colours into a base-colour texture, or remove them"));
        }
        Ok(())
    }

    fn primitive(
        &mut self,
        primitive: &json::mesh::Primitive,
        transform: DMat4,
        place: &str,
    ) -> Result<(), InputError> {
        let document = self.document;
        let determinant = DMat3::from_mat4(transform).determinant();
        if !transform.is_finite() || !determinant.is_normal() {
            return Err(document
                .error(place, "is placed by a transform that has no inverse")
                .found(format!("determinant {determinant:e}"))
                .help("check the scale of the nodes above the mesh"));
        }
        let mirrored = determinant < 0.0;

        let position = self
            .attribute(primitive, Semantic::Positions, place)?
            .ok_or_else(|| document.error(&format!("{place} POSITION"), "the primitive has no positions"))?;
        let first = self.body.vertices.len();
        let positions: Vec<[f32; 3]> = self.vectors(position, None, false)?;
        let count = positions.len();
        let corners = self.corner_indices(primitive, count, place)?;
        self.refuse_vertex_colours(primitive, place)?;

        let material_index = primitive.material.map(|m| m.value());
        let material = self.textures.material(document, material_index, place)?;
        let uvs = self.texture_coordinates(primitive, &material, count, place)?;
        let normals: Option<Vec<[f32; 3]>> = match self.attribute(primitive, Semantic::Normals, place)? {
            None => None,
            Some(normal) => Some(self.vectors(normal, Some(count), false)?),
        };

        let normal_matrix = DMat3::from_mat4(transform).inverse().transpose();
        for (i, p) in positions.iter().enumerate() {
            // Adding zero turns a negative zero into a positive one: see `Vertex::position_m`.
            let position_m = transform.transform_point3(DVec3::from_array(p.map(f64::from))) + 0.0;
            if !position_m.is_finite() || position_m.abs().max_element() > MAX_COORDINATE_M {
                return Err(document
                    .error(&format!("{place} POSITION"), format!("vertex {i} is too far out"))
                    .found(position_m)
                    .expected(format!("metres, at most {MAX_COORDINATE_M:e} from the origin")));
            }
            let normal = normals.as_ref().map_or(Vec3::ZERO, |n| {
                (normal_matrix * DVec3::from_array(n[i].map(f64::from))).normalize_or_zero().as_vec3()
            });
            self.body.vertices.push(Vertex { position_m, normal, uv: uvs[i] });
        }
        let first_triangle = self.body.triangles.len();
        let surface = self.surface(material_index, &material, normals.is_none(), place)?;
        for [a, b, c] in triangles(primitive.mode, &corners) {
            // Vertices are at most MAX_ELEMENTS, so the sums stay within u32.
            let offset = first as u32;
            let triangle = if mirrored { [a, c, b] } else { [a, b, c] }.map(|v| v + offset);
            self.body.triangles.push(triangle);
            if self.body.doubled_area_m2(self.body.triangles.len() - 1) == DVec3::ZERO {
                self.body.triangles.pop();
                continue;
            }
            self.body.triangle_surface.push(surface);
        }
        if normals.is_none() {
            self.derive_normals(first, first_triangle);
        }
        let lacking = |v: &&u32| self.body.vertices[**v as usize].normal == Vec3::ZERO;
        if let Some(&v) = self.body.triangles[first_triangle..].iter().flatten().find(lacking) {
            return Err(document
                .error(&format!("{place} NORMAL"), "a normal has no length")
                .found(format!("vertex {}", v as usize - first))
                .help("recompute the normals, or export without them"));
        }
        Ok(())
    }

    /// Smooth normals for the vertices from `first` on, of the triangles from `first_triangle` on.
    fn derive_normals(&mut self, first: usize, first_triangle: usize) {
        let mut sums = vec![DVec3::ZERO; self.body.vertices.len() - first];
        for t in first_triangle..self.body.triangles.len() {
            self.body.add_corner_normals(t, |v| v as usize - first, &mut sums);
        }
        for (vertex, sum) in self.body.vertices[first..].iter_mut().zip(sums) {
            // Two facets back to back cancel: any direction does, since the surface is flat-shaded.
            vertex.normal = sum.normalize_or(DVec3::Z).as_vec3();
        }
    }

    fn surface(
        &mut self,
        material_index: Option<usize>,
        material: &Material,
        flat: bool,
        place: &str,
    ) -> Result<u16, InputError> {
        let key = (material_index, flat);
        let known = self.keys.iter().position(|&k| k == key);
        let index = known.unwrap_or(self.keys.len());
        let narrow = u16::try_from(index).map_err(|_| {
            self.document.error(place, "the body has too many materials").expected("at most 65536")
        })?;
        if known.is_none() {
            let name = match (&material.name, material_index) {
                (Some(name), _) => name.clone(),
                (None, Some(i)) => format!("material {i}"),
                (None, None) => "default material".into(),
            };
            self.keys.push(key);
            self.body.surfaces.push(Surface {
                name,
                flat,
                albedo_map: material.albedo_map,
                albedo_factor: material.albedo_factor,
                slope_map: material.slope_map,
                double_sided: material.double_sided,
            });
        }
        Ok(narrow)
    }

    fn texture_coordinates(
        &self,
        primitive: &json::mesh::Primitive,
        material: &Material,
        count: usize,
        place: &str,
    ) -> Result<Vec<Vec2>, InputError> {
        let Some(coordinates) = &material.coordinates else { return Ok(vec![Vec2::ZERO; count]) };
        let semantic = Semantic::TexCoords(coordinates.set);
        let attribute = self.attribute(primitive, semantic, place)?.ok_or_else(|| {
            self.document
                .error(
                    &format!("{place} TEXCOORD_{}", coordinates.set),
                    "the texture's coordinates are missing",
                )
                .help("export the mesh with its UV map, or the material without a texture")
        })?;
        let where_ = attribute.1.clone();
        let uvs: Vec<[f32; 2]> = self.vectors(attribute, Some(count), true)?;
        let uvs: Vec<Vec2> = uvs.into_iter().map(|uv| Vec2::from_array(coordinates.apply(uv))).collect();
        if uvs.iter().all(|uv| uv.is_finite()) {
            Ok(uvs)
        } else {
            Err(self.document.error(&where_, "the texture transform leads to infinite coordinates"))
        }
    }

    /// The primitive's vertex indices in drawing order, all below `count`.
    fn corner_indices(
        &self,
        primitive: &json::mesh::Primitive,
        count: usize,
        place: &str,
    ) -> Result<Vec<u32>, InputError> {
        let document = self.document;
        let mode = match primitive.mode {
            Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => mode,
            Checked::Valid(other) => {
                return Err(document
                    .error(place, "is drawn in a mode without triangles")
                    .found(format!("{other:?}"))
                    .expected("Triangles, TriangleStrip or TriangleFan"));
            }
            Checked::Invalid => {
                return Err(document.error(place, "has an unknown mode").expected("4, 5 or 6"));
            }
        };
        let place = format!("{place} indices");
        let corners: Vec<u32> = match primitive.indices {
            None => (0..count as u32).collect(),
            Some(accessor) => {
                let elements = document.elements(accessor.value(), &place)?;
                if !elements.is_index() {
                    return Err(document
                        .error(&place, "are of a type that indices cannot have")
                        .found(elements.describe())
                        .expected("1 component of U8, U16 or U32"));
                }
                (0..elements.count).map(|i| elements.index(i)).collect()
            }
        };
        if let Some(&wrong) = corners.iter().find(|&&v| v as usize >= count) {
            return Err(document
                .error(&place, "name a vertex that does not exist")
                .found(format!("vertex {wrong}"))
                .expected(format!("below {count}")));
        }
        if corners.len() < 3 || (mode == Mode::Triangles && !corners.len().is_multiple_of(3)) {
            return Err(document
                .error(&place, "do not make whole triangles")
                .found(format!("{} indices", corners.len()))
                .expected("3 for each triangle"));
        }
        Ok(corners)
    }
}

/// Triangles of a list, a strip or a fan in the corner order that the glTF specification gives
/// (3.7.2.1): every other triangle of a strip is turned so that all wind the same way.
fn triangles(mode: Checked<Mode>, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Checked::Valid(Mode::TriangleStrip) => corners
            .windows(3)
            .enumerate()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] })
            .collect(),
        Checked::Valid(Mode::TriangleFan) => {
            corners[1..].windows(2).map(|w| [w[0], w[1], corners[0]]).collect()
        }
        _ => corners.chunks_exact(3).map(|w| [w[0], w[1], w[2]]).collect(),
    }
}
