//! Texture maps: decoding to linear values, wrapping, bilinear sampling.

use std::path::Path;

use glam::Vec2;
use image::DynamicImage;
use rayon::prelude::*;
use retina_files::InputError;

/// How texture coordinates outside 0..1 are read (glTF sampler `wrapS`, `wrapT`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Wrap {
    /// The texture repeats.
    Repeat,
    /// The texture repeats, every other time mirrored.
    Mirror,
    /// The edge texel continues.
    Clamp,
}

impl Wrap {
    /// The texel in `0..size` that stands for texel `i` of the endless texture.
    pub fn texel(self, i: i64, size: usize) -> usize {
        let n = size as i64;
        // Most are inside; a division takes longer than the rest of a sample.
        if (0..n).contains(&i) {
            return i as usize;
        }
        let wrapped = match self {
            Self::Repeat => i.rem_euclid(n),
            Self::Clamp => i.clamp(0, n - 1),
            Self::Mirror => {
                let j = i.rem_euclid(2 * n);
                j.min(2 * n - 1 - j)
            }
        };
        wrapped as usize
    }
}

/// Relative albedo, linear in light, row 0 at v = 0 (the image's top).
///
/// A body's surface has the albedo texel times [`crate::Surface::albedo_factor`]; the texels
/// themselves lie in 0..1 as the image has them, so they may be stored in few bits.
#[derive(Debug, Clone, PartialEq)]
pub struct AlbedoMap {
    /// Texels across.
    pub width: usize,
    /// Texels down.
    pub height: usize,
    /// Wrapping in u.
    pub wrap_u: Wrap,
    /// Wrapping in v.
    pub wrap_v: Wrap,
    /// `width * height` values, row by row.
    pub texels: Vec<f32>,
}

/// Tangent-space slopes of a normal texture, row 0 at v = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct SlopeMap {
    /// Texels across.
    pub width: usize,
    /// Texels down.
    pub height: usize,
    /// Wrapping in u.
    pub wrap_u: Wrap,
    /// Wrapping in v.
    pub wrap_v: Wrap,
    /// (nx/nz, ny/nz) with the texture's scale applied: the tangent runs towards +u, the bitangent
    /// towards -v (up in the image), as the glTF specification has it.
    pub texels: Vec<[f32; 2]>,
}

/// The four texels around (u, v) and their bilinear weights; texel centres lie at half-integers.
fn neighbours(uv: Vec2, size: [usize; 2], wrap: [Wrap; 2]) -> [(usize, f32); 4] {
    let axis = |coordinate: f32, size: usize, wrap: Wrap| {
        // In f64, since f32 at 16 384 texels would leave 1/500 of a texel.
        let at = f64::from(coordinate) * size as f64 - 0.5;
        let low = at.floor();
        // A cast from f64 saturates, so no coordinate can overflow; the clamp leaves room for + 1.
        let i = (low as i64).clamp(i64::MIN / 4, i64::MAX / 4);
        ([wrap.texel(i, size), wrap.texel(i + 1, size)], (at - low) as f32)
    };
    let ([x0, x1], fx) = axis(uv.x, size[0], wrap[0]);
    let ([y0, y1], fy) = axis(uv.y, size[1], wrap[1]);
    let (row0, row1) = (y0 * size[0], y1 * size[0]);
    [
        (row0 + x0, (1.0 - fx) * (1.0 - fy)),
        (row0 + x1, fx * (1.0 - fy)),
        (row1 + x0, (1.0 - fx) * fy),
        (row1 + x1, fx * fy),
    ]
}

impl AlbedoMap {
    /// Bilinear sample at texture coordinates (texel (0, 0) covers [0, 1/width) x [0, 1/height)).
    pub fn sample(&self, uv: Vec2) -> f32 {
        neighbours(uv, [self.width, self.height], [self.wrap_u, self.wrap_v])
            .iter()
            .map(|&(i, weight)| self.texels[i] * weight)
            .sum()
    }
}

impl SlopeMap {
    /// Bilinear sample at texture coordinates.
    pub fn sample(&self, uv: Vec2) -> [f32; 2] {
        let mut slope = [0.0; 2];
        for (i, weight) in neighbours(uv, [self.width, self.height], [self.wrap_u, self.wrap_v]) {
            slope[0] += self.texels[i][0] * weight;
            slope[1] += self.texels[i][1] * weight;
        }
        slope
    }
}

/// Linear light of an sRGB-encoded value, both 0..1 (IEC 61966-2-1).
pub(crate) fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// sRGB encoding of linear light, both 0..1 (IEC 61966-2-1).
pub(crate) fn linear_to_srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Luminance of linear Rec. 709 red, green and blue.
pub(crate) fn luminance(rgb: [f32; 3]) -> f32 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

/// Linear luminance of each pixel, 0..1, from sRGB-encoded samples; 16-bit images keep their depth.
pub(crate) fn linear_luminance(
    path: &Path,
    place: &str,
    image: &DynamicImage,
) -> Result<Vec<f32>, InputError> {
    let table = |size: usize| -> Vec<f32> {
        (0..size).map(|i| srgb_to_linear(i as f64 / (size - 1) as f64) as f32).collect()
    };
    let small = || table(1 << 8);
    let large = || table(1 << 16);
    Ok(match image {
        DynamicImage::ImageLuma8(i) => grey(i.as_raw(), 1, &small()),
        DynamicImage::ImageLumaA8(i) => grey(i.as_raw(), 2, &small()),
        DynamicImage::ImageRgb8(i) => colour(i.as_raw(), 3, &small()),
        DynamicImage::ImageRgba8(i) => colour(i.as_raw(), 4, &small()),
        DynamicImage::ImageLuma16(i) => grey(i.as_raw(), 1, &large()),
        DynamicImage::ImageLumaA16(i) => grey(i.as_raw(), 2, &large()),
        DynamicImage::ImageRgb16(i) => colour(i.as_raw(), 3, &large()),
        DynamicImage::ImageRgba16(i) => colour(i.as_raw(), 4, &large()),
        other => {
            return Err(InputError::new(path, "the image holds samples of a kind that is not read here")
                .at(place)
                .found(format!("{:?}", other.color()))
                .expected("8 or 16 bits a sample"));
        }
    })
}

fn grey<T: Copy + Into<u32> + Sync>(samples: &[T], step: usize, table: &[f32]) -> Vec<f32> {
    samples.par_chunks_exact(step).map(|p| table[p[0].into() as usize]).collect()
}

fn colour<T: Copy + Into<u32> + Sync>(samples: &[T], step: usize, table: &[f32]) -> Vec<f32> {
    let linear = |sample: T| table[sample.into() as usize];
    samples.par_chunks_exact(step).map(|p| luminance([linear(p[0]), linear(p[1]), linear(p[2])])).collect()
}

/// Slopes of a normal texture: n = 2 sample - 1, x and y times `scale` (glTF `normalTexture.scale`).
///
/// A normal that lies in or below the surface (nz <= 0) is an error: it has no slope.
pub(crate) fn slopes(
    path: &Path,
    place: &str,
    image: &DynamicImage,
    scale: f32,
) -> Result<Vec<[f32; 2]>, InputError> {
    let image = image.to_rgb16();
    image
        .as_raw()
        .chunks_exact(3)
        .map(|p| {
            let [x, y, z] = [p[0], p[1], p[2]].map(|s| f32::from(s) / 32767.5 - 1.0);
            // 8-bit maps cannot hold 0 exactly; what is within half a step of the plane is no slope.
            (z > 1.0 / 255.0).then(|| [x * scale / z, y * scale / z])
        })
        .collect::<Option<Vec<_>>>()
        .ok_or_else(|| {
            InputError::new(path, "the normal texture holds normals that do not point outwards")
                .at(place)
                .found("a blue sample at or below the middle")
                .expected("tangent-space normals (blue above 128 of 255)")
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wraps_follow_the_gltf_samplers() {
        let read = |wrap: Wrap| (-3..6).map(|i| wrap.texel(i, 3)).collect::<Vec<_>>();
        assert_eq!(read(Wrap::Repeat), [0, 1, 2, 0, 1, 2, 0, 1, 2]);
        assert_eq!(read(Wrap::Clamp), [0, 0, 0, 0, 1, 2, 2, 2, 2]);
        assert_eq!(read(Wrap::Mirror), [2, 1, 0, 0, 1, 2, 2, 1, 0]);
    }

    #[test]
    fn srgb_matches_the_standards_figures_and_inverts() {
        // IEC 61966-2-1: middle grey 18.4 % is code 119 (0.1845), 0.5 encoded is 0.21404.
        assert!((srgb_to_linear(0.5) - 0.214_041).abs() < 1e-6);
        assert!((srgb_to_linear(119.0 / 255.0) - 0.184_475).abs() < 1e-6);
        for i in 0..=100 {
            let x = f64::from(i) / 100.0;
            assert!((linear_to_srgb(srgb_to_linear(x)) - x).abs() < 1e-7);
        }
    }

    #[test]
    fn samples_are_exact_at_texel_centres_and_linear_between() {
        let map = AlbedoMap {
            width: 2,
            height: 1,
            wrap_u: Wrap::Clamp,
            wrap_v: Wrap::Clamp,
            texels: vec![0.2, 0.6],
        };
        for (u, want) in [(0.25, 0.2), (0.5, 0.4), (0.75, 0.6), (0.0, 0.2), (1e30, 0.6), (-1e30, 0.2)] {
            assert!((map.sample(Vec2::new(u, 0.5)) - want).abs() < 1e-6, "{u}");
        }
        let wrapped = AlbedoMap { wrap_u: Wrap::Repeat, ..map };
        assert!((wrapped.sample(Vec2::new(0.0, 0.5)) - 0.4).abs() < 1e-6);
    }

    #[test]
    fn normal_texture_gives_slopes_upwards_in_the_image() {
        // n = (0.6, 0, 0.8): slope 0.75, doubled by the scale.
        let encode = |x: f32| ((x + 1.0) * 32767.5).round() as u16;
        let pixel = image::Rgb([encode(0.6), encode(0.0), encode(0.8)]);
        let picture = DynamicImage::ImageRgb16(image::ImageBuffer::from_pixel(1, 1, pixel));
        let slope = slopes(Path::new("a.glb"), "x", &picture, 2.0).unwrap()[0];
        assert!((slope[0] - 1.5).abs() < 1e-3 && slope[1].abs() < 1e-3, "{slope:?}");
        let flat = DynamicImage::ImageRgb8(image::ImageBuffer::from_pixel(1, 1, image::Rgb([128, 128, 0])));
        assert!(slopes(Path::new("a.glb"), "x", &flat, 1.0).is_err());
    }
}
