//! Where in a pixel textures are read.

use glam::Vec2;

/// There are more reads than samples: a map often changes within a pixel.
pub(crate) struct Reads {
    /// From the pixel's middle, pixels; and the sample whose fragment and whose light a read takes: the nearest.
    pub places: Vec<([f32; 2], u32)>,
    /// Mean distance of reads, pixels.
    pub apart_px: f32,
}

impl Reads {
    /// `places` and the samples' own places lie in 0..1.
    pub(crate) fn new(places: &[Vec2], samples: &[Vec2]) -> Self {
        let nearest = |place: Vec2| {
            let distance = |sample: u32| samples[sample as usize].distance_squared(place);
            (0..samples.len() as u32).min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
        };
        Self {
            places: places.iter().map(|&place| ((place - 0.5).to_array(), nearest(place))).collect(),
            apart_px: 1.0 / (places.len() as f32).sqrt(),
        }
    }
}
