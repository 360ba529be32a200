//! Dark frames, flat fields and masks.

use std::path::Path;

use retina_files::InputError;

use crate::{CameraImage, Photograph, PhotographOptions, Steps};

/// Least response of a flat field, of its middle one: a darker pixel sees too little to be corrected.
const LEAST_RESPONSE: f32 = 0.05;
/// Pixels beside a masked one that do not count either: points are measured with their surroundings.
const MASK_MARGIN_PX: usize = 3;

impl CameraImage {
    /// Less a dark frame of the same exposure, over a flat field (of any level; its median counts as 1). Saturated pixels
    /// stay saturated.
    ///
    /// # Errors
    /// A frame of another size, or a flat field without light.
    pub fn reduced(
        mut self,
        dark: Option<(&Path, &Self)>,
        flat: Option<(&Path, &Self)>,
    ) -> Result<Self, InputError> {
        let full = self.full_scale_dn;
        let saturated: Vec<bool> = self.values.iter().map(|value| *value >= full).collect();
        if let Some((path, dark)) = dark {
            same_size(path, dark, &self)?;
            self.values.iter_mut().zip(&dark.values).for_each(|(value, dark)| *value -= dark);
        }
        if let Some((path, flat)) = flat {
            same_size(path, flat, &self)?;
            let mut sorted = flat.values.clone();
            let middle = sorted.len() / 2;
            let middle = *sorted.select_nth_unstable_by(middle, f32::total_cmp).1;
            if middle <= 0.0 {
                return Err(InputError::new(path, "the flat field is dark")
                    .found(format!("a median of {middle}"))
                    .expected("an evenly lit exposure, above 0"));
            }
            for (value, flat) in self.values.iter_mut().zip(&flat.values) {
                *value /= (flat / middle).max(LEAST_RESPONSE);
            }
            self.steps = Steps::Fine;
        }
        for (value, saturated) in self.values.iter_mut().zip(saturated) {
            if saturated {
                *value = full;
            }
        }
        Ok(self)
    }

    /// With pixels that are no number (NaN) where the mask (row by row) is false: what is not seen.
    #[must_use]
    pub fn seen_in(mut self, mask: &[bool]) -> Self {
        self.values.iter_mut().zip(mask).filter(|(_, seen)| !**seen).for_each(|(value, _)| *value = f32::NAN);
        self
    }
}

/// Reads a mask: a picture whose pixels count where they are not 0, but for those within 3 px of one that is.
///
/// # Errors
/// Not a picture, one of another size, or one that leaves nothing.
pub fn read_mask(path: &Path, [width_px, height_px]: [u32; 2]) -> Result<Vec<bool>, InputError> {
    let mask = Photograph::read(path, PhotographOptions::default())?.image;
    same_size(path, &mask, &CameraImage::new(width_px, height_px, 1.0))?;
    let [width, height] = [width_px as usize, height_px as usize];
    let counts = |x: usize, y: usize| {
        let rows = y.saturating_sub(MASK_MARGIN_PX)..(y + MASK_MARGIN_PX + 1).min(height);
        let columns = x.saturating_sub(MASK_MARGIN_PX)..(x + MASK_MARGIN_PX + 1).min(width);
        rows.into_iter().all(|row| mask.row(row)[columns.clone()].iter().all(|value| *value != 0.0))
    };
    let seen: Vec<bool> = (0..width * height).map(|at| counts(at % width, at / width)).collect();
    if !seen.contains(&true) {
        return Err(InputError::new(path, "leaves nothing of the photograph")
            .found("a mask of zeros, but for single pixels")
            .expected("a value other than 0 where the photograph counts")
            .help("if black and white are the wrong way round, invert the mask"));
    }
    Ok(seen)
}

fn same_size(path: &Path, frame: &CameraImage, image: &CameraImage) -> Result<(), InputError> {
    let [found, expected] = [frame, image].map(|i| [i.width_px, i.height_px]);
    if found == expected {
        return Ok(());
    }
    Err(InputError::new(path, "does not have the size of the image")
        .found(format!("{} x {} pixels", found[0], found[1]))
        .expected(format!("{} x {}", expected[0], expected[1])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_what_is_left_of_dark_and_flat() {
        let image = |values: &[f32]| CameraImage { values: values.to_vec(), ..CameraImage::new(4, 1, 100.0) };
        let [dark, flat] = [image(&[10.0, 10.0, 30.0, 90.0]), image(&[40.0, 20.0, 40.0, 40.0])];
        let name = Path::new("frame");
        let light =
            image(&[50.0, 30.0, 70.0, 100.0]).reduced(Some((name, &dark)), Some((name, &flat))).unwrap();
        // (50 - 10) / 1, (30 - 10) / 0.5, (70 - 30) / 1; what is saturated stays so.
        assert_eq!(light.values, [40.0, 40.0, 40.0, 100.0]);
        let other = CameraImage::new(2, 2, 100.0);
        let error = image(&[0.0; 4]).reduced(Some((name, &other)), None).unwrap_err().to_string();
        assert!(error.contains("2 x 2 pixels") && error.contains("4 x 1"), "{error}");
        let black = image(&[0.0; 4]);
        let error = image(&[0.0; 4]).reduced(None, Some((name, &black))).unwrap_err().to_string();
        assert!(error.contains("the flat field is dark"), "{error}");
    }
}
