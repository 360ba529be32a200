//! Materials and their textures: which maps a primitive uses, each decoded once.

use gltf::json;
use gltf::json::texture::WrappingMode;
use gltf::json::validation::Checked;
use image::{DynamicImage, ImageFormat};
use retina_files::{InputError, decode_image};

use crate::document::{Document, image_bytes};
use crate::maps::{AlbedoMap, SlopeMap, Wrap, linear_luminance, luminance, slopes};

/// Which texture coordinates a primitive needs, and the affine map on them (KHR_texture_transform).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coordinates {
    pub(crate) set: u32,
    /// Offset, rotation in radians, scale.
    transform: ([f32; 2], f32, [f32; 2]),
}

impl Coordinates {
    /// uv' = offset + R (scale uv), R turning from +u towards -v by the angle (the extension's
    /// own matrix: [cos, sin; -sin, cos]).
    pub(crate) fn apply(&self, uv: [f32; 2]) -> [f32; 2] {
        let (offset, angle_rad, scale) = self.transform;
        let (sin, cos) = angle_rad.sin_cos();
        let (u, v) = (uv[0] * scale[0], uv[1] * scale[1]);
        [offset[0] + cos * u + sin * v, offset[1] - sin * u + cos * v]
    }
}

/// A material as far as it matters here.
#[derive(Debug, Clone)]
pub(crate) struct Material {
    pub(crate) name: Option<String>,
    pub(crate) albedo_factor: f32,
    pub(crate) albedo_map: Option<usize>,
    pub(crate) slope_map: Option<usize>,
    pub(crate) coordinates: Option<Coordinates>,
    pub(crate) double_sided: bool,
}

/// Most pixels of a body's textures together, 16 384 x 8 192: half a gigabyte once linear.
pub(crate) const MAX_PIXELS: u64 = 1 << 27;

/// Image index and wrapping: two textures that agree in these share a map.
type Key = (usize, Wrap, Wrap);

/// The maps decoded so far.
#[derive(Default)]
pub(crate) struct Textures {
    pub(crate) albedo_maps: Vec<AlbedoMap>,
    pub(crate) slope_maps: Vec<SlopeMap>,
    albedo_keys: Vec<Key>,
    slope_keys: Vec<(Key, u32)>,
    pixels: u64,
}

impl Textures {
    /// Reads a material with its textures; `None` is glTF's default material.
    pub(crate) fn material(
        &mut self,
        document: &Document<'_>,
        index: Option<usize>,
        primitive: &str,
    ) -> Result<Material, InputError> {
        let Some(index) = index else {
            return Ok(Material {
                name: None,
                albedo_factor: 1.0,
                albedo_map: None,
                slope_map: None,
                coordinates: None,
                double_sided: false,
            });
        };
        let material = document.item(&document.root.materials, index, "material", primitive)?;
        let place = format!("material {index}");
        let base = &material.pbr_metallic_roughness;
        let [r, g, b, _] = base.base_color_factor.0;
        if [r, g, b].iter().any(|f| !(0.0..=1.0).contains(f)) {
            return Err(document
                .error(&format!("{place} baseColorFactor"), "is not a colour")
                .found(format!("{:?}", base.base_color_factor.0))
                .expected("components from 0 to 1"));
        }
        let mut coordinates: Option<Coordinates> = None;
        let albedo_map = match &base.base_color_texture {
            None => None,
            Some(info) => {
                coordinates = Some(base_coordinates(info));
                Some(self.albedo(document, info.index.value(), &format!("{place} baseColorTexture"))?)
            }
        };
        let slope_map = match &material.normal_texture {
            None => None,
            Some(info) => {
                let place = format!("{place} normalTexture");
                let own = normal_coordinates(document, info, &place)?;
                // A vertex carries one pair of coordinates.
                if coordinates.is_some_and(|c| c != own) {
                    return Err(document
                        .error(
                            &place,
                            "has other texture coordinates than the base colour, which is not supported",
                        )
                        .help("lay both textures by the same texCoord and transform"));
                }
                coordinates = Some(own);
                Some(self.slopes(document, info, &place)?)
            }
        };
        Ok(Material {
            name: material.name.clone(),
            albedo_factor: luminance([r, g, b]),
            albedo_map,
            slope_map,
            coordinates,
            double_sided: material.double_sided,
        })
    }

    fn albedo(&mut self, document: &Document<'_>, texture: usize, place: &str) -> Result<usize, InputError> {
        let key = texture_key(document, texture, place)?;
        if let Some(known) = self.albedo_keys.iter().position(|&k| k == key) {
            return Ok(known);
        }
        let image = self.decode(document, key.0, place)?;
        self.albedo_maps.push(AlbedoMap {
            width: image.width() as usize,
            height: image.height() as usize,
            wrap_u: key.1,
            wrap_v: key.2,
            texels: linear_luminance(document.path, place, &image)?,
        });
        self.albedo_keys.push(key);
        Ok(self.albedo_maps.len() - 1)
    }

    fn slopes(
        &mut self,
        document: &Document<'_>,
        info: &json::material::NormalTexture,
        place: &str,
    ) -> Result<usize, InputError> {
        if !info.scale.is_finite() {
            return Err(document.error(place, "has a scale that is not finite").found(info.scale));
        }
        let key = (texture_key(document, info.index.value(), place)?, info.scale.to_bits());
        if let Some(known) = self.slope_keys.iter().position(|&k| k == key) {
            return Ok(known);
        }
        let image = self.decode(document, key.0.0, place)?;
        self.slope_maps.push(SlopeMap {
            width: image.width() as usize,
            height: image.height() as usize,
            wrap_u: key.0.1,
            wrap_v: key.0.2,
            texels: slopes(document.path, place, &image, info.scale)?,
        });
        self.slope_keys.push(key);
        Ok(self.slope_maps.len() - 1)
    }

    /// Decodes an image; all maps of a body together may have [`MAX_PIXELS`].
    fn decode(
        &mut self,
        document: &Document<'_>,
        image: usize,
        place: &str,
    ) -> Result<DynamicImage, InputError> {
        let bytes = image_bytes(document, image, place)?;
        let formats = [ImageFormat::Png, ImageFormat::Jpeg];
        let decoded = decode_image(document.path, place, &bytes, &formats, MAX_PIXELS - self.pixels)?;
        self.pixels += u64::from(decoded.width()) * u64::from(decoded.height());
        Ok(decoded)
    }
}

fn texture_key(document: &Document<'_>, texture: usize, place: &str) -> Result<Key, InputError> {
    let entry = document.item(&document.root.textures, texture, "texture", place)?;
    let image = entry.source.value();
    document.item(&document.root.images, image, "image", place)?;
    let Some(sampler) = entry.sampler else { return Ok((image, Wrap::Repeat, Wrap::Repeat)) };
    let sampler = document.item(&document.root.samplers, sampler.value(), "sampler", place)?;
    let wrap = |mode: Checked<WrappingMode>, name: &str| match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Ok(Wrap::Clamp),
        Checked::Valid(WrappingMode::MirroredRepeat) => Ok(Wrap::Mirror),
        Checked::Valid(WrappingMode::Repeat) => Ok(Wrap::Repeat),
        Checked::Invalid => Err(document
            .error(place, format!("its sampler has an unknown {name}"))
            .expected("33071 (clamp), 33648 (mirror) or 10497 (repeat)")),
    };
    Ok((image, wrap(sampler.wrap_s, "wrapS")?, wrap(sampler.wrap_t, "wrapT")?))
}

const UNCHANGED: ([f32; 2], f32, [f32; 2]) = ([0.0; 2], 0.0, [1.0; 2]);

fn base_coordinates(info: &json::texture::Info) -> Coordinates {
    match info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref()) {
        None => Coordinates { set: info.tex_coord, transform: UNCHANGED },
        Some(t) => Coordinates {
            set: t.tex_coord.unwrap_or(info.tex_coord),
            transform: (t.offset.0, t.rotation.0, t.scale.0),
        },
    }
}

/// The JSON types hold no texture transform for normal textures: it is read from the raw value.
fn normal_coordinates(
    document: &Document<'_>,
    info: &json::material::NormalTexture,
    place: &str,
) -> Result<Coordinates, InputError> {
    let raw = info.extensions.as_ref().and_then(|e| e.others.get("KHR_texture_transform"));
    let Some(raw) = raw else { return Ok(Coordinates { set: info.tex_coord, transform: UNCHANGED }) };
    let transform: json::extensions::texture::TextureTransform = json::deserialize::from_value(raw.clone())
        .map_err(|error| {
        document.error(place, format!("its KHR_texture_transform cannot be read: {error}"))
    })?;
    Ok(Coordinates {
        set: transform.tex_coord.unwrap_or(info.tex_coord),
        transform: (transform.offset.0, transform.rotation.0, transform.scale.0),
    })
}
