//! A writer of small GLB files, independent of the crate's own, and a ray through a body.

use glam::{DVec3, Vec2};
use retina_files::InputError;
use retina_model::{Body, load_body};
use serde_json::{Value, json};

/// A glTF document being put together.
#[derive(Clone)]
pub(crate) struct Draft {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
}

pub(crate) const FLOAT: u32 = 5126;

impl Draft {
    /// One node with one mesh of one primitive without attributes yet.
    pub(crate) fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0" },
            "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": {} }] }],
            "accessors": [], "bufferViews": [],
        });
        Self { json, bin: Vec::new() }
    }

    /// A right-angled tetrahedron of volume 1/6, wound outwards; indices of the given type.
    pub(crate) fn tetrahedron(index_type: Option<u32>) -> Self {
        let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let faces = [0u32, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
        let mut draft = Self::new();
        match index_type {
            Some(kind) => {
                draft.attribute("POSITION", &corners);
                draft.indices(&faces, kind);
            }
            None => draft.attribute("POSITION", &faces.map(|i| corners[i as usize])),
        }
        draft
    }

    pub(crate) fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let views = self.json["bufferViews"].as_array_mut().unwrap();
        views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }));
        views.len() - 1
    }

    pub(crate) fn accessor(&mut self, bytes: &[u8], kind: u32, count: usize, shape: &str) -> usize {
        let view = self.view(bytes);
        let accessors = self.json["accessors"].as_array_mut().unwrap();
        accessors.push(json!({ "bufferView": view, "componentType": kind, "count": count, "type": shape }));
        accessors.len() - 1
    }

    pub(crate) fn attribute<const N: usize>(&mut self, name: &str, values: &[[f32; N]]) {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let index = self.accessor(&bytes, FLOAT, values.len(), &format!("VEC{N}"));
        self.primitive()["attributes"][name] = json!(index);
    }

    pub(crate) fn indices(&mut self, indices: &[u32], kind: u32) {
        let size = match kind {
            5121 => 1,
            5123 => 2,
            _ => 4,
        };
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()[..size].to_vec()).collect();
        let index = self.accessor(&bytes, kind, indices.len(), "SCALAR");
        self.primitive()["indices"] = json!(index);
    }

    /// A material with the PNG as its base colour.
    pub(crate) fn texture(&mut self, png: &[u8]) {
        let view = self.view(png);
        self.json["images"] = json!([{ "bufferView": view, "mimeType": "image/png" }]);
        self.json["textures"] = json!([{ "source": 0 }]);
        self.json["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
        self.primitive()["material"] = json!(0);
    }

    pub(crate) fn glb(&self) -> Vec<u8> {
        let mut document = self.json.clone();
        document["buffers"] = json!([{ "byteLength": self.bin.len() }]);
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut out = Vec::new();
        let total = 12 + 8 + text.len() + 8 + self.bin.len();
        for word in [0x4654_6c67, 2, total as u32, text.len() as u32, 0x4e4f_534a] {
            out.extend_from_slice(&u32::to_le_bytes(word));
        }
        out.extend_from_slice(&text);
        for word in [self.bin.len() as u32, 0x004e_4942] {
            out.extend_from_slice(&u32::to_le_bytes(word));
        }
        out.extend_from_slice(&self.bin);
        out
    }

    pub(crate) fn load(&self) -> Result<Body, InputError> {
        load_bytes(&self.glb())
    }
}

/// Loads a file of these bytes.
pub(crate) fn load_bytes(bytes: &[u8]) -> Result<Body, InputError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("body.glb");
    std::fs::write(&path, bytes).unwrap();
    load_body(&path)
}

/// A grey PNG of 8 bits.
pub(crate) fn png8(width: u32, pixels: &[u8]) -> Vec<u8> {
    png(width, pixels, image::ExtendedColorType::L8, pixels.len())
}

/// A grey PNG of 16 bits.
pub(crate) fn png16(width: u32, pixels: &[u16]) -> Vec<u8> {
    let bytes: Vec<u8> = pixels.iter().flat_map(|p| p.to_ne_bytes()).collect();
    png(width, &bytes, image::ExtendedColorType::L16, pixels.len())
}

fn png(width: u32, bytes: &[u8], kind: image::ExtendedColorType, pixels: usize) -> Vec<u8> {
    use image::ImageEncoder as _;
    let mut out = Vec::new();
    image::codecs::png::PngEncoder::new(&mut out)
        .write_image(bytes, width, (pixels / width as usize) as u32, kind)
        .unwrap();
    out
}

/// Unit direction of a longitude and latitude.
pub(crate) fn direction(longitude_deg: f64, latitude_deg: f64) -> DVec3 {
    let (lon, lat) = (longitude_deg.to_radians(), latitude_deg.to_radians());
    DVec3::new(lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin())
}

/// Where the ray from the centre leaves the body: radius in metres, relative albedo.
pub(crate) fn look(body: &Body, ray: DVec3) -> (f64, f64) {
    for (t, triangle) in body.triangles.iter().enumerate() {
        let [a, b, c] = body.corners_m(t);
        let weights = [b.cross(c), c.cross(a), a.cross(b)].map(|n| n.dot(ray));
        let sum: f64 = weights.iter().sum();
        if sum > 0.0 && weights.iter().all(|&w| w >= -1e-9 * sum) {
            let surface = &body.surfaces[usize::from(body.triangle_surface[t])];
            let uv: Vec2 =
                (0..3).map(|k| body.vertices[triangle[k] as usize].uv * (weights[k] / sum) as f32).sum();
            let texel = surface.albedo_map.map_or(1.0, |m| body.albedo_maps[m].sample(uv));
            let normal = (b - a).cross(c - a);
            return (a.dot(normal) / normal.dot(ray), f64::from(texel * surface.albedo_factor));
        }
    }
    panic!("the ray along {ray} leaves through no triangle");
}
