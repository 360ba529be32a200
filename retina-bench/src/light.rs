//! The light of an exposure on the sensor, a row at a time.
//!
//! An image of it would go through memory at each step: the screen's black, spots, stray light, the sensor. A row stays
//! in the processor's cache.

use crate::optics::{Spots, Stray};

/// Mean electrons of each pixel that the screen's light makes.
pub(crate) struct Light {
    pub(crate) focused: Focused,
    pub(crate) stray: Stray,
}

/// What the optics bring to a focus.
pub(crate) enum Focused {
    /// Spots on the screen's black.
    Spots { black: f32, spots: Spots },
    /// Everything, row by row.
    Image(Vec<f32>),
}

impl Light {
    /// Row `y`; `line` is work space.
    pub(crate) fn row(&self, y: usize, row: &mut [f32], line: &mut Vec<f32>) {
        match &self.focused {
            Focused::Spots { black, spots } => {
                row.fill(*black);
                spots.add_to_row(y, row);
            }
            Focused::Image(image) => row.copy_from_slice(&image[y * row.len()..(y + 1) * row.len()]),
        }
        self.stray.add_to_row(y, row, line);
        row.iter_mut().for_each(|value| *value = value.max(0.0));
    }
}
