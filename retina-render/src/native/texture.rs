//! Textures, filtered as the shaders do it (shaders/shared/texture.wgsl): reads of one mip level, spread over a
//! sample's footprint.

use glam::Vec2;
use half::f16;

use crate::arrays::Map;

/// The parallelogram of texture coordinates that a sample covers.
#[derive(Clone, Copy, Default)]
pub(crate) struct Footprint {
    pub along_x: Vec2,
    pub along_y: Vec2,
}

/// One mip level of a map, ready to be read.
#[derive(Clone, Copy, Default)]
pub(crate) struct Taps {
    first: usize,
    width: i32,
    height: i32,
    wrap_u: u32,
    wrap_v: u32,
    /// What one unit of a word stands for.
    scale_of_word: f32,
    count: u32,
}

const MOST_TAPS: f32 = 12.0;

impl Taps {
    /// The level whose texels are as fine as the footprint is narrow, and as many reads as it takes to cover the
    /// footprint's length: towards the limb footprints are long and narrow.
    #[inline(always)]
    pub(crate) fn of(map: &Map, footprint: &Footprint) -> Self {
        let size = Vec2::new(map.width as f32, map.height as f32);
        let (a, b) = (footprint.along_x * size, footprint.along_y * size);
        let longest = (a + b).length_squared().max((a - b).length_squared()).sqrt();
        let narrow = a.perp_dot(b).abs() / longest.max(1e-6);
        let texel = narrow.max(longest / MOST_TAPS).max(1.0);
        // The exponent of a number from 1 on is the whole part of its logarithm.
        let level = ((texel.to_bits() >> 23).wrapping_sub(127)).min(map.levels.wrapping_sub(1));
        let (mut first, mut width, mut height) = (map.first as usize, map.width, map.height);
        for _ in 0..level {
            first += width as usize * height as usize;
            width = (width / 2).max(1);
            height = (height / 2).max(1);
        }
        let reads = 1.2 * longest / (1u32 << level.min(31)) as f32;
        let count = if reads <= 1.0 { 1 } else { reads.min(MOST_TAPS).ceil() as u32 };
        Self {
            first,
            width: width as i32,
            height: height as i32,
            wrap_u: map.wrap_u,
            wrap_v: map.wrap_v,
            scale_of_word: map.scale / 65_535.0,
            count,
        }
    }

    /// Mean relative albedo over a footprint about `uv`.
    #[inline(always)]
    pub(crate) fn albedo(&self, texels: &[u32], footprint: &Footprint, uv: Vec2) -> f32 {
        if self.count == 1 {
            return self.albedo_at(texels, uv);
        }
        let mut sum = 0.0;
        for k in 0..self.count {
            sum += self.albedo_at(texels, self.place(footprint, uv, k));
        }
        sum / self.count as f32
    }

    /// Reads about a place, times `factor`, where texture coordinates are `uv` and grow by `along` over a pixel; `None`
    /// where the pixel's footprints touch the map's edge.
    #[inline(always)]
    pub(crate) fn grid(
        &self,
        footprint: &Footprint,
        uv: Vec2,
        along: [Vec2; 2],
        factor: f32,
    ) -> Option<Grid> {
        let size = Vec2::new(self.width as f32, self.height as f32);
        let middle = uv * size - 0.5;
        let [right, down] = along.map(|step| step * size);
        let mut offsets = [Vec2::ZERO; MOST_TAPS as usize];
        let mut reach = Vec2::ZERO;
        if self.count > 1 {
            for (k, offset) in (0..self.count).zip(&mut offsets) {
                *offset = self.place(footprint, Vec2::ZERO, k) * size;
            }
            reach = size * (footprint.along_x.abs() + footprint.along_y.abs());
        }
        // A hundredth of a texel for roundings.
        let range = 0.5 * (right.abs() + down.abs() + reach) + 0.01;
        let (low, high) = (middle - range, middle + range);
        let inside = low.min_element() >= 0.0 && high.x < size.x && high.y < size.y - 1.0;
        inside.then_some(Grid {
            first: self.first,
            width: self.width as usize,
            middle,
            right,
            down,
            offsets,
            count: self.count as usize,
            share: factor * self.scale_of_word / self.count as f32,
        })
    }

    /// Mean tangent-space slopes over a footprint: the mean of a relief's normals is its mean slope.
    pub(crate) fn slope(&self, texels: &[u32], footprint: &Footprint, uv: Vec2) -> Vec2 {
        let mut sum = Vec2::ZERO;
        for k in 0..self.count {
            sum += self.slope_at(texels, self.place(footprint, uv, k));
        }
        sum / self.count as f32
    }

    /// Read k: a golden-section lattice over the parallelogram, symmetric about its middle, so that the mean is not
    /// shifted.
    #[inline(always)]
    fn place(&self, footprint: &Footprint, uv: Vec2, k: u32) -> Vec2 {
        let from_middle = k as f32 - 0.5 * (self.count - 1) as f32;
        let x = from_middle / self.count as f32;
        let y = fract(0.5 + 0.618_034 * from_middle) - 0.5;
        uv + footprint.along_x * x + footprint.along_y * y
    }

    /// Whole texel and what is left, along each axis.
    #[inline(always)]
    fn texel_place(&self, uv: Vec2) -> ([i32; 2], Vec2) {
        let x = folded(uv.x, self.wrap_u) * self.width as f32 - 0.5;
        let y = folded(uv.y, self.wrap_v) * self.height as f32 - 0.5;
        let (whole_x, whole_y) = (floor(x), floor(y));
        ([whole_x, whole_y], Vec2::new(x - whole_x as f32, y - whole_y as f32))
    }

    /// Bilinear. Each word holds a texel and its right neighbour. Away from the map's edges [`Grid`] is quicker.
    fn albedo_at(&self, texels: &[u32], uv: Vec2) -> f32 {
        let ([whole_x, whole_y], part) = self.texel_place(uv);
        let x = wrapped(whole_x, self.width, self.wrap_u);
        let y0 = wrapped(whole_y, self.height, self.wrap_v);
        let y1 = wrapped(whole_y + 1, self.height, self.wrap_v);
        // Left of an edge that does not repeat both texels are the first one.
        let fraction = if self.wrap_u != 0 && whole_x < 0 { 0.0 } else { part.x };
        let row = |y: i32| {
            let word = texels[self.first + y as usize * self.width as usize + x as usize];
            let (left, right) = ((word & 0xffff) as f32, (word >> 16) as f32);
            left + (right - left) * fraction
        };
        let (top, bottom) = (row(y0), row(y1));
        (top + (bottom - top) * part.y) * self.scale_of_word
    }

    fn slope_at(&self, texels: &[u32], uv: Vec2) -> Vec2 {
        let ([x, y], part) = self.texel_place(uv);
        let texel = |dx: i32, dy: i32| {
            let column = wrapped(x + dx, self.width, self.wrap_u);
            let row = wrapped(y + dy, self.height, self.wrap_v);
            let word = texels[self.first + row as usize * self.width as usize + column as usize];
            let value = |bits: u32| f16::from_bits(bits as u16).to_f32();
            Vec2::new(value(word & 0xffff), value(word >> 16))
        };
        let top = texel(0, 0).lerp(texel(1, 0), part.x);
        let bottom = texel(0, 1).lerp(texel(1, 1), part.x);
        top.lerp(bottom, part.y)
    }
}

/// A mip level's texels in a pixel, away from the map's edges.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    first: usize,
    width: usize,
    /// In texels, from the first one's middle: in the pixel's middle, and how it grows over a pixel.
    middle: Vec2,
    right: Vec2,
    down: Vec2,
    /// Where a footprint is read, from its middle, and how often.
    offsets: [Vec2; MOST_TAPS as usize],
    count: usize,
    /// What one unit of a word stands for, over the number of reads.
    share: f32,
}

impl Grid {
    /// Albedo at a place, from the pixel's middle.
    #[inline(always)]
    pub(crate) fn albedo(&self, texels: &[u32], [s, t]: [f32; 2]) -> f32 {
        let place = self.middle + self.right * s + self.down * t;
        if self.count == 1 {
            return self.word(texels, place) * self.share;
        }
        let reads = self.offsets.iter().take(self.count);
        reads.map(|&offset| self.word(texels, place + offset)).sum::<f32>() * self.share
    }

    /// Bilinear. Each word holds a texel and its right neighbour.
    #[inline(always)]
    fn word(&self, texels: &[u32], place: Vec2) -> f32 {
        let (whole_x, whole_y) = (place.x as i32, place.y as i32);
        let (x, y) = (place.x - whole_x as f32, place.y - whole_y as f32);
        let at = self.first + whole_y as usize * self.width + whole_x as usize;
        let (top, bottom) = (texels[at], texels[at + self.width]);
        let row = |word: u32| {
            let left = (word & 0xffff) as f32;
            left + ((word >> 16) as f32 - left) * x
        };
        let (top, bottom) = (row(top), row(bottom));
        top + (bottom - top) * y
    }
}

/// floor without a call: places are far smaller than i32 holds.
#[inline(always)]
fn floor(value: f32) -> i32 {
    let whole = value as i32;
    whole - i32::from(whole as f32 > value)
}

#[inline(always)]
fn fract(value: f32) -> f32 {
    value - floor(value) as f32
}

/// Texture coordinate brought into 0..1.
#[inline(always)]
fn folded(place: f32, mode: u32) -> f32 {
    match mode {
        0 => fract(place),
        1 => place.clamp(-1.0, 2.0),
        _ => 1.0 - (1.0 - 2.0 * fract(0.5 * place)).abs(),
    }
}

/// A texel index at most one step outside 0..size, as the wrap mode continues it.
#[inline(always)]
fn wrapped(index: i32, size: i32, mode: u32) -> i32 {
    let repeated = if index < 0 {
        index + size
    } else if index >= size {
        index - size
    } else {
        index
    };
    if mode == 0 { repeated.clamp(0, size - 1) } else { index.clamp(0, size - 1) }
}
