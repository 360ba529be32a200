//! A camera image: grey digital numbers.

/// A grey image as the camera gave it: digital numbers (DN), row by row, linear in light.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraImage {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// `width_px * height_px` digital numbers, row by row from the top.
    pub values: Vec<f32>,
    /// The largest digital number that the camera can give, 4095 for 12 bits.
    pub full_scale_dn: f32,
}

impl CameraImage {
    /// A dark image.
    pub fn new(width_px: u32, height_px: u32, full_scale_dn: f32) -> Self {
        let values = vec![0.0; width_px as usize * height_px as usize];
        Self { width_px, height_px, values, full_scale_dn }
    }

    /// One row, left to right.
    pub fn row(&self, row: usize) -> &[f32] {
        let width = self.width_px as usize;
        &self.values[row * width..(row + 1) * width]
    }

    /// The digital number of a pixel; the place must be inside.
    pub fn at(&self, column: usize, row: usize) -> f32 {
        self.values[row * self.width_px as usize + column]
    }
}
