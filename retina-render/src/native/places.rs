//! Where a pixel's samples lie, and which points of the Sun's disc they look at.

use glam::Vec2;

/// Point k of 2^n_log2 in the unit square: the rank-1 lattice whose multiplier leaves the least rms error in the area
/// beside a straight edge of any direction (shaders/refine.wgsl).
pub(crate) fn square_point(k: u32, n_log2: u32) -> Vec2 {
    let multiplier = match n_log2 {
        4 => 13,
        5 => 25,
        6 => 27,
        8 => 181,
        _ => 3,
    };
    let n = 1u32 << n_log2;
    Vec2::new(k as f32 + 0.5, (k.wrapping_mul(multiplier) & (n - 1)) as f32 + 0.5) / n as f32
}

/// n points spread evenly over the unit disc (sunflower spiral).
pub(crate) fn disc_points(n: u32) -> Vec<Vec2> {
    let point = |k: u32| Vec2::from_angle(2.399_963_2 * k as f32) * ((k as f32 + 0.5) / n as f32).sqrt();
    (0..n).map(point).collect()
}

/// A turn of the Sun's disc points for each pixel, so that their pattern leaves no bands: cosine and sine.
pub(crate) fn pixel_turn(pixel: u32) -> Vec2 {
    let mut h = pixel.wrapping_mul(0x9e37_79b9);
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    Vec2::from_angle(((h ^ (h >> 16)) >> 8) as f32 * (std::f32::consts::TAU / 16_777_216.0))
}
