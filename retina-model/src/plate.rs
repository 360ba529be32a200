//! Global maps in plate carree: sampling by direction, averaged over a footprint.

use std::path::Path;

use glam::DVec3;
use image::{DynamicImage, ImageFormat};
use retina_files::{InputError, decode_image, read_bytes};

use crate::maps::linear_luminance;

/// Most pixels of a map to build from: 64 pixels a degree (23 040 x 11 520) just fit.
const MAX_PIXELS: u64 = 1 << 28;

/// A global map: longitude from left to right, latitude from +90 degrees at the top to -90.
pub(crate) struct PlateCarree {
    width: usize,
    height: usize,
    values: Vec<f32>,
    longitude_left_rad: f64,
}

fn read_image(path: &Path) -> Result<DynamicImage, InputError> {
    let bytes = read_bytes(path)?;
    let formats = [ImageFormat::Png, ImageFormat::Tiff, ImageFormat::Jpeg];
    let image = decode_image(path, "image", &bytes, &formats, MAX_PIXELS)?;
    if image.width() != 2 * image.height() {
        return Err(InputError::new(path, "is not a global plate carree map")
            .found(format!("{} x {} pixels", image.width(), image.height()))
            .expected("twice as wide as high: 360 by 180 degrees")
            .help("reproject or pad the map to the whole globe"));
    }
    Ok(image)
}

impl PlateCarree {
    fn new(image: &DynamicImage, values: Vec<f32>, longitude_left_deg: f64) -> Self {
        Self {
            width: image.width() as usize,
            height: image.height() as usize,
            values,
            longitude_left_rad: longitude_left_deg.to_radians(),
        }
    }

    /// Reads a relief map: grey, 8 or 16 bits; values are the samples themselves.
    pub(crate) fn relief(path: &Path, longitude_left_deg: f64) -> Result<Self, InputError> {
        let image = read_image(path)?;
        let values = match &image {
            DynamicImage::ImageLuma8(i) => i.as_raw().iter().map(|&s| f32::from(s)).collect(),
            DynamicImage::ImageLuma16(i) => i.as_raw().iter().map(|&s| f32::from(s)).collect(),
            other => {
                return Err(InputError::new(path, "holds samples that cannot be heights")
                    .found(format!("{:?}", other.color()))
                    .expected("one grey sample a pixel, 8 or 16 bits")
                    .help("convert the relief to a 16-bit grey PNG or TIFF"));
            }
        };
        Ok(Self::new(&image, values, longitude_left_deg))
    }

    /// Reads an albedo map, sRGB-encoded: values are linear luminance, 0..1.
    pub(crate) fn albedo(path: &Path, longitude_left_deg: f64) -> Result<Self, InputError> {
        let image = read_image(path)?;
        let values = linear_luminance(path, "image", &image)?;
        Ok(Self::new(&image, values, longitude_left_deg))
    }

    /// Angle of a pixel, radians.
    fn pixel_rad(&self) -> f64 {
        std::f64::consts::PI / self.height as f64
    }

    /// A pixel, with longitude wrapped; rows beyond a pole continue on the other side of it.
    fn pixel(&self, x: i64, y: i64) -> f64 {
        let (w, h) = (self.width as i64, self.height as i64);
        let (x, y) = match y {
            y if y < 0 => (x + w / 2, -1 - y),
            y if y >= h => (x + w / 2, 2 * h - 1 - y),
            y => (x, y),
        };
        f64::from(self.values[(y * w + x.rem_euclid(w)) as usize])
    }

    /// Continuous pixel coordinates of a direction; pixel (0, 0) covers [0, 1) x [0, 1).
    fn place(&self, direction: DVec3) -> (f64, f64) {
        let longitude_rad = direction.y.atan2(direction.x);
        // atan2 rather than asin: exact at the poles, where asin loses half of the digits.
        let latitude_rad = direction.z.atan2(direction.x.hypot(direction.y));
        let turn = (longitude_rad - self.longitude_left_rad).rem_euclid(std::f64::consts::TAU);
        let x = turn / std::f64::consts::TAU * self.width as f64;
        let y = (0.5 - latitude_rad / std::f64::consts::PI) * self.height as f64;
        (x, y)
    }

    fn bilinear(&self, direction: DVec3) -> f64 {
        let (x, y) = self.place(direction);
        let (x0, y0) = ((x - 0.5).floor(), (y - 0.5).floor());
        let (fx, fy) = (x - 0.5 - x0, y - 0.5 - y0);
        let (i, j) = (x0 as i64, y0 as i64);
        let row = |j: i64| self.pixel(i, j) * (1.0 - fx) + self.pixel(i + 1, j) * fx;
        row(j) * (1.0 - fy) + row(j + 1) * fy
    }

    /// Catmull-Rom interpolation (Keys 1981, a = -1/2): no facets where the map is coarse.
    fn bicubic(&self, direction: DVec3) -> f64 {
        let (x, y) = self.place(direction);
        let (x0, y0) = ((x - 0.5).floor(), (y - 0.5).floor());
        let weights = |f: f64| {
            let (f2, f3) = (f * f, f * f * f);
            [
                -0.5 * f3 + f2 - 0.5 * f,
                1.5 * f3 - 2.5 * f2 + 1.0,
                -1.5 * f3 + 2.0 * f2 + 0.5 * f,
                0.5 * f3 - 0.5 * f2,
            ]
        };
        let (wx, wy) = (weights(x - 0.5 - x0), weights(y - 0.5 - y0));
        let mut sum = 0.0;
        for (j, wj) in wy.iter().enumerate() {
            for (i, wi) in wx.iter().enumerate() {
                sum += wi * wj * self.pixel(x0 as i64 + i as i64 - 1, y0 as i64 + j as i64 - 1);
            }
        }
        sum
    }

    /// The map averaged over a square of `footprint_rad` around a direction; where its pixels are
    /// coarser than that, interpolated.
    ///
    /// It depends on the direction alone, so that points that two cube faces share get the same
    /// value from both.
    pub(crate) fn mean(&self, direction: DVec3, footprint_rad: f64) -> f64 {
        let n = (footprint_rad / self.pixel_rad()).ceil().max(1.0);
        if n <= 1.0 {
            return self.bicubic(direction);
        }
        let (east, north) = direction.any_orthonormal_pair();
        let step = footprint_rad / n;
        let count = n as u32;
        let mut sum = 0.0;
        for j in 0..count {
            for i in 0..count {
                let offset = |k: u32| (f64::from(k) + 0.5) * step - 0.5 * footprint_rad;
                sum += self.bilinear(direction + east * offset(i) + north * offset(j));
            }
        }
        sum / (n * n)
    }
}
