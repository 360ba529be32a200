//! The builder: an even mesh of a body from a relief and an albedo map, as a compact `.glb`.

use std::borrow::Cow;
use std::path::PathBuf;

use glam::DVec3;
use image::codecs::{jpeg::JpegEncoder, png::PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use rayon::prelude::*;
use retina_files::InputError;
use serde_json::{Value, json};

use crate::cube::{FACES, Face, cell_triangles, grid};
use crate::maps::linear_to_srgb;
use crate::plate::PlateCarree;

/// What to build.
#[derive(Debug, Clone, PartialEq)]
pub struct BuildSpec {
    /// The body's name.
    pub name: String,
    /// Radius of the reference sphere, metres.
    pub radius_m: f64,
    /// Heights above the reference sphere; without it the body is a sphere.
    pub relief: Option<Relief>,
    /// Albedo; without it the body is of one grey.
    pub albedo: Option<AlbedoSource>,
    /// Mesh cells along each edge of a cube face, 1 to 2048: a cell spans 90 degrees / cells.
    pub cells: u32,
    /// Texture pixels along each edge of a cube face, 2 to 8192.
    pub texels: u32,
    /// JPEG quality of the textures, 1 to 100; `None` stores them as PNG.
    pub jpeg_quality: Option<u8>,
    /// Where the maps come from, for `asset.extras.sources`.
    pub sources: Vec<String>,
    /// For `asset.copyright`.
    pub copyright: Option<String>,
}

/// A relief map: plate carree, grey, 8 or 16 bits, PNG or TIFF, north up.
#[derive(Debug, Clone, PartialEq)]
pub struct Relief {
    /// The image.
    pub path: PathBuf,
    /// Metres of height for one unit of the sample.
    pub metres_per_unit: f64,
    /// Height of sample 0, metres.
    pub offset_m: f64,
    /// East longitude of the image's left edge, degrees: usually -180 or 0.
    pub longitude_left_deg: f64,
}

/// An albedo map: plate carree, sRGB-encoded, PNG, JPEG or TIFF, north up; relative values do.
#[derive(Debug, Clone, PartialEq)]
pub struct AlbedoSource {
    /// The image.
    pub path: PathBuf,
    /// East longitude of the image's left edge, degrees: usually -180 or 0.
    pub longitude_left_deg: f64,
}

/// A built body.
#[derive(Debug, Clone, PartialEq)]
pub struct BuiltBody {
    /// The `.glb` file, the same bytes for the same input.
    pub glb: Vec<u8>,
    /// What it holds.
    pub report: BuildReport,
}

/// Figures of a built body.
#[derive(Debug, Clone, PartialEq)]
pub struct BuildReport {
    /// Vertices in the file (those on face edges counted on both faces).
    pub vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Lowest vertex above the reference sphere, metres.
    pub min_height_m: f64,
    /// Highest vertex above the reference sphere, metres.
    pub max_height_m: f64,
    /// Largest triangle's area over the smallest one's, before the relief.
    pub area_ratio: f64,
    /// Longest edge over the shortest, before the relief.
    pub edge_ratio: f64,
    /// Longest edge seen from the body's centre, radians.
    pub max_edge_rad: f64,
    /// Size of the file, bytes.
    pub bytes: usize,
}

const MAX_CELLS: u32 = 2048;
const MAX_TEXELS: u32 = 8192;

fn check(spec: &BuildSpec) -> Result<(), InputError> {
    let refuse = |key: &str, found: String, expected: String| {
        Err(InputError::new("body specification", "has a value that does not fit")
            .at(key)
            .found(found)
            .expected(expected))
    };
    if !(spec.radius_m.is_finite() && spec.radius_m > 0.0 && spec.radius_m <= 1e12) {
        return refuse("radius_m", spec.radius_m.to_string(), "metres above 0, at most 1e12".into());
    }
    if !(1..=MAX_CELLS).contains(&spec.cells) {
        return refuse("cells", spec.cells.to_string(), format!("1 to {MAX_CELLS}"));
    }
    if spec.albedo.is_some() && !(2..=MAX_TEXELS).contains(&spec.texels) {
        return refuse("texels", spec.texels.to_string(), format!("2 to {MAX_TEXELS}"));
    }
    if let Some(quality) = spec.jpeg_quality.filter(|q| !(1..=100).contains(q)) {
        return refuse("jpeg_quality", quality.to_string(), "1 to 100".into());
    }
    let relief = spec.relief.iter().flat_map(|r| {
        [
            ("relief.metres_per_unit", r.metres_per_unit),
            ("relief.offset_m", r.offset_m),
            ("relief.longitude_left_deg", r.longitude_left_deg),
        ]
    });
    let albedo = spec.albedo.iter().map(|a| ("albedo.longitude_left_deg", a.longitude_left_deg));
    for (key, value) in relief.chain(albedo) {
        if !value.is_finite() {
            return refuse(key, value.to_string(), "a finite number".into());
        }
    }
    Ok(())
}

/// Builds a body: an equiangular cube-sphere displaced by the relief, with one texture a face.
///
/// Relief and albedo are averaged over a mesh cell and a texture pixel where the maps are finer,
/// and interpolated where they are coarser; albedo in linear light. The mesh is free of cracks:
/// points on face edges are equal bit by bit on both faces. Texture borders hold texel centres, so
/// that both faces read the same albedo there. There are no normals in the file: readers take
/// [`crate::Body::smooth_normals`].
///
/// # Errors
/// A value of the specification is out of range; a map cannot be read or is not global; the relief
/// reaches below the body's centre.
pub fn build_body(spec: &BuildSpec) -> Result<BuiltBody, InputError> {
    check(spec)?;
    let relief = match &spec.relief {
        None => None,
        Some(r) => Some((r, PlateCarree::relief(&r.path, r.longitude_left_deg)?)),
    };
    let albedo = match &spec.albedo {
        None => None,
        Some(a) => Some(PlateCarree::albedo(&a.path, a.longitude_left_deg)?),
    };
    let cell_rad = std::f64::consts::FRAC_PI_2 / f64::from(spec.cells);
    let height_m = |direction: DVec3| {
        relief.as_ref().map_or(0.0, |(r, map)| map.mean(direction, cell_rad) * r.metres_per_unit + r.offset_m)
    };
    let faces: Vec<Vec<(DVec3, f64)>> =
        FACES.iter().map(|face| face_vertices(face, spec.cells, height_m)).collect();
    let (mut min_height_m, mut max_height_m) = (f64::INFINITY, f64::NEG_INFINITY);
    for &(_, height) in faces.iter().flatten() {
        min_height_m = min_height_m.min(height);
        max_height_m = max_height_m.max(height);
    }
    if spec.radius_m + min_height_m <= 0.0 {
        return Err(InputError::new("body specification", "the relief reaches below the body's centre")
            .at("relief")
            .found(format!("height {min_height_m} m"))
            .expected(format!("above {} m", -spec.radius_m))
            .help("check metres_per_unit and offset_m"));
    }
    let triangles = cell_triangles(spec.cells);
    let evenness = Evenness::of(&faces[0], &triangles);

    let mut glb = GlbWriter::default();
    let indices = glb.indices(&triangles, faces[0].len());
    let uv = albedo.as_ref().map(|_| glb.face_uv(spec.cells, spec.texels));
    let mut primitives = Vec::new();
    let mut materials = Vec::new();
    let mut images = Vec::new();
    for (f, (face, vertices)) in FACES.iter().zip(&faces).enumerate() {
        let positions: Vec<[f32; 3]> = vertices
            .iter()
            .map(|(direction, height)| (*direction * (spec.radius_m + height)).as_vec3().to_array())
            .collect();
        let mut attributes = json!({ "POSITION": glb.positions(&positions) });
        let mut material = json!({
            "name": face.name,
            "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 1 },
        });
        if let (Some(map), Some(uv)) = (&albedo, uv) {
            attributes["TEXCOORD_0"] = json!(uv);
            material["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": f });
            let (bytes, kind) = encode_texture(face, map, spec)?;
            images.push(json!({ "name": face.name, "bufferView": glb.view(&bytes, None), "mimeType": kind }));
        }
        materials.push(material);
        primitives.push(json!({ "attributes": attributes, "indices": indices, "material": f }));
    }
    let glb = glb.finish(spec, primitives, materials, images)?;
    let report = BuildReport {
        vertices: FACES.len() * faces[0].len(),
        triangles: FACES.len() * triangles.len(),
        min_height_m,
        max_height_m,
        area_ratio: evenness.area_ratio,
        edge_ratio: evenness.edge_ratio,
        max_edge_rad: evenness.max_edge_rad,
        bytes: glb.len(),
    };
    Ok(BuiltBody { glb, report })
}

/// Direction and height of each vertex of a face, s fastest.
fn face_vertices(face: &Face, cells: u32, height_m: impl Fn(DVec3) -> f64 + Sync) -> Vec<(DVec3, f64)> {
    let tan = grid(cells);
    tan.par_iter()
        .flat_map_iter(|&t| tan.iter().map(move |&s| face.direction(s, t)))
        .map(|direction| (direction, height_m(direction)))
        .collect()
}

/// How even the triangles are; all faces are congruent, so one tells.
struct Evenness {
    area_ratio: f64,
    edge_ratio: f64,
    max_edge_rad: f64,
}

impl Evenness {
    fn of(vertices: &[(DVec3, f64)], triangles: &[[u32; 3]]) -> Self {
        let (mut area, mut edge) = ([f64::INFINITY, 0.0], [f64::INFINITY, 0.0]);
        let widen = |range: &mut [f64; 2], value: f64| {
            *range = [range[0].min(value), range[1].max(value)];
        };
        for triangle in triangles {
            let [a, b, c] = triangle.map(|v| vertices[v as usize].0);
            widen(&mut area, (b - a).cross(c - a).length());
            for length in [a.distance(b), b.distance(c), c.distance(a)] {
                widen(&mut edge, length);
            }
        }
        Self {
            area_ratio: area[1] / area[0],
            edge_ratio: edge[1] / edge[0],
            max_edge_rad: 2.0 * (0.5 * edge[1]).asin(),
        }
    }
}

/// A face's albedo texture, encoded: texel centres at its borders lie on the face's edges; row 0 is
/// at t = 1.
fn encode_texture(
    face: &Face,
    map: &PlateCarree,
    spec: &BuildSpec,
) -> Result<(Vec<u8>, &'static str), InputError> {
    let tan = grid(spec.texels - 1);
    let texel_rad = std::f64::consts::FRAC_PI_2 / f64::from(spec.texels - 1);
    let pixels: Vec<u8> = tan
        .par_iter()
        .rev()
        .flat_map_iter(|&t| tan.iter().map(move |&s| face.direction(s, t)))
        .map(|direction| {
            // Bicubic interpolation may overshoot black and white.
            let linear = map.mean(direction, texel_rad).clamp(0.0, 1.0);
            (255.0 * linear_to_srgb(linear)).round() as u8
        })
        .collect();
    let mut bytes = Vec::new();
    let (done, kind) = match spec.jpeg_quality {
        Some(quality) => (
            JpegEncoder::new_with_quality(&mut bytes, quality).write_image(
                &pixels,
                spec.texels,
                spec.texels,
                ExtendedColorType::L8,
            ),
            "image/jpeg",
        ),
        None => (
            PngEncoder::new(&mut bytes).write_image(&pixels, spec.texels, spec.texels, ExtendedColorType::L8),
            "image/png",
        ),
    };
    done.map_err(|error| {
        InputError::new("body specification", format!("the texture cannot be encoded: {error}")).at("texels")
    })?;
    Ok((bytes, kind))
}

const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const CLAMP_TO_EDGE: u32 = 33071;

/// Gathers the binary chunk and its views and accessors.
#[derive(Default)]
struct GlbWriter {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl GlbWriter {
    fn pad(&mut self) {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
    }

    /// Adds bytes as a buffer view; returns its index.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let mut view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bin.extend_from_slice(bytes);
        self.pad();
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// The indices, in 16 bits where they fit (65535 itself would restart the primitive).
    fn indices(&mut self, triangles: &[[u32; 3]], vertices: usize) -> usize {
        let corners = triangles.iter().flatten();
        let (bytes, kind): (Vec<u8>, u32) = if vertices <= usize::from(u16::MAX) {
            (corners.flat_map(|&v| (v as u16).to_le_bytes()).collect(), UNSIGNED_SHORT)
        } else {
            (corners.flat_map(|v| v.to_le_bytes()).collect(), UNSIGNED_INT)
        };
        let view = self.view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
        self.accessor(json!({
            "bufferView": view, "componentType": kind, "count": 3 * triangles.len(), "type": "SCALAR",
        }))
    }

    fn positions(&mut self, positions: &[[f32; 3]]) -> usize {
        let bytes: Vec<u8> = positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        let bound = |pick: fn(f32, f32) -> f32, start: f32| -> [f64; 3] {
            std::array::from_fn(|c| f64::from(positions.iter().map(|p| p[c]).fold(start, pick)))
        };
        self.accessor(json!({
            "bufferView": view, "componentType": FLOAT, "count": positions.len(), "type": "VEC3",
            "min": bound(f32::min, f32::INFINITY), "max": bound(f32::max, f32::NEG_INFINITY),
        }))
    }

    /// The texture coordinates that all faces share: from the first texel's centre to the last's.
    fn face_uv(&mut self, cells: u32, texels: u32) -> usize {
        let axis = |k: u32| {
            let texel = 0.5 + f64::from(texels - 1) * f64::from(k) / f64::from(cells);
            (texel / f64::from(texels) * f64::from(u16::MAX)).round() as u16
        };
        let bytes: Vec<u8> = (0..=cells)
            .flat_map(|j| (0..=cells).map(move |i| [axis(i), axis(cells - j)]))
            .flatten()
            .flat_map(u16::to_le_bytes)
            .collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        self.accessor(json!({
            "bufferView": view, "componentType": UNSIGNED_SHORT, "normalized": true,
            "count": (cells as usize + 1).pow(2), "type": "VEC2",
        }))
    }

    fn finish(
        self,
        spec: &BuildSpec,
        primitives: Vec<Value>,
        materials: Vec<Value>,
        images: Vec<Value>,
    ) -> Result<Vec<u8>, InputError> {
        let mut asset = json!({ "version": "2.0", "generator": "retina-model" });
        if let Some(copyright) = &spec.copyright {
            asset["copyright"] = json!(copyright);
        }
        asset["extras"] = json!({
            "schema": "retina.body/1",
            "radius_m": spec.radius_m,
            "units": "metre",
            "frame": "body-fixed, x prime meridian, z north",
            "sources": spec.sources,
        });
        let mut document = json!({
            "asset": asset,
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "name": spec.name, "mesh": 0 }],
            "meshes": [{ "name": spec.name, "primitives": primitives }],
            "materials": materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "byteLength": self.bin.len() }],
        });
        if !images.is_empty() {
            let textures: Vec<Value> =
                (0..images.len()).map(|i| json!({ "source": i, "sampler": 0 })).collect();
            document["images"] = Value::from(images);
            document["textures"] = Value::from(textures);
            document["samplers"] = json!([{ "wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE }]);
        }
        let glb = gltf::binary::Glb {
            // The writer sets the length itself.
            header: gltf::binary::Header { magic: *b"glTF", version: 2, length: 0 },
            json: Cow::Owned(document.to_string().into_bytes()),
            bin: Some(Cow::Owned(self.bin)),
        };
        glb.to_vec().map_err(|error| {
            InputError::new("body specification", format!("the file cannot be written: {error}"))
        })
    }
}
