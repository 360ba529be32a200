//! The light of an exposure on the sensor, a row at a time.
//!
//! An image of it would go through memory at each step: the screen's black, spots, stray light, the sensor. A row stays
//! in the processor's cache.

use retina_simd::{Kernel, Level};

use crate::optics::{Patches, Stray};

/// Mean electrons of each pixel that the screen's light makes.
pub(crate) struct Light {
    pub(crate) focused: Focused,
    pub(crate) stray: Stray,
}

/// What the optics bring to a focus.
pub(crate) enum Focused {
    /// Spots or a scene's tiles on the screen's black.
    Patches { black: f32, patches: Patches },
    /// Everything, row by row.
    Image(Vec<f32>),
}

impl Light {
    /// Row `y`; `line` is work space.
    pub(crate) fn row(&self, y: usize, row: &mut [f32], line: &mut Vec<f32>) {
        Level::detect().run(Row { light: self, y, row, line });
    }
}

struct Row<'a> {
    light: &'a Light,
    y: usize,
    row: &'a mut [f32],
    line: &'a mut Vec<f32>,
}

impl Kernel for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { light, y, row, line } = self;
        match &light.focused {
            Focused::Patches { black, patches } => {
                row.fill(*black);
                patches.add_to_row(y, row);
            }
            Focused::Image(image) => row.copy_from_slice(&image[y * row.len()..(y + 1) * row.len()]),
        }
        light.stray.add_to_row(y, row, line);
        row.iter_mut().for_each(|value| *value = value.max(0.0));
    }
}
