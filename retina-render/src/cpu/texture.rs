//! The CPU renderer's textures: f64 bilinear reads of the halving nearest below the footprint,
//! averaged over the footprint.

use std::ops::{Add, Mul};

use glam::DVec2;
use retina_model::{AlbedoMap, SlopeMap, Wrap};

/// A map and its halvings.
pub(crate) struct Pyramid<T> {
    levels: Vec<(usize, usize, Vec<T>)>,
    wrap: (Wrap, Wrap),
}

impl Pyramid<f64> {
    pub(crate) fn of_albedo(map: &AlbedoMap) -> Self {
        let texels = map.texels.iter().map(|&v| f64::from(v)).collect();
        Self::new(map.width, map.height, texels, (map.wrap_u, map.wrap_v))
    }
}

impl Pyramid<DVec2> {
    pub(crate) fn of_slopes(map: &SlopeMap) -> Self {
        let texels = map.texels.iter().map(|s| DVec2::new(f64::from(s[0]), f64::from(s[1]))).collect();
        Self::new(map.width, map.height, texels, (map.wrap_u, map.wrap_v))
    }
}

impl<T: Copy + Default + Add<Output = T> + Mul<f64, Output = T>> Pyramid<T> {
    fn new(width: usize, height: usize, texels: Vec<T>, wrap: (Wrap, Wrap)) -> Self {
        let mut levels = vec![(width, height, texels)];
        while let Some((w, h, last)) = levels.last()
            && *w > 2
            && *h > 2
        {
            let (w, h) = (*w, *h);
            let mut next = Vec::with_capacity(w / 2 * (h / 2));
            for y in 0..h / 2 {
                for x in 0..w / 2 {
                    let row = 2 * y * w + 2 * x;
                    next.push((last[row] + last[row + 1] + last[row + w] + last[row + w + 1]) * 0.25);
                }
            }
            levels.push((w / 2, h / 2, next));
        }
        Self { levels, wrap }
    }

    /// Mean over a square footprint of this area in uv about `uv`.
    pub(crate) fn value(&self, uv: DVec2, footprint_uv2: f64) -> T {
        let (width, height, _) = &self.levels[0];
        let side_texels = (footprint_uv2 * (width * height) as f64).sqrt();
        let level = (side_texels.log2().floor().max(0.0) as usize).min(self.levels.len() - 1);
        let side = side_texels / f64::from(1u32 << level);
        if side <= 1.0 {
            return self.bilinear(level, uv, DVec2::ZERO);
        }
        let offsets = [-0.25, 0.25].map(|f| f * side);
        let mut sum = T::default();
        for dy in offsets {
            for dx in offsets {
                sum = sum + self.bilinear(level, uv, DVec2::new(dx, dy)) * 0.25;
            }
        }
        sum
    }

    fn bilinear(&self, level: usize, uv: DVec2, offset_texels: DVec2) -> T {
        let (width, height, texels) = &self.levels[level];
        let place = uv * DVec2::new(*width as f64, *height as f64) - 0.5 + offset_texels;
        let whole = place.floor();
        let part = place - whole;
        let texel = |dx: i64, dy: i64| {
            let x = self.wrap.0.texel(whole.x as i64 + dx, *width);
            let y = self.wrap.1.texel(whole.y as i64 + dy, *height);
            texels[y * width + x]
        };
        let top = texel(0, 0) * (1.0 - part.x) + texel(1, 0) * part.x;
        let bottom = texel(0, 1) * (1.0 - part.x) + texel(1, 1) * part.x;
        top * (1.0 - part.y) + bottom * part.y
    }
}
