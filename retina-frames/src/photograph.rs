//! What the files of measured images say of their pixels.

use retina_image::Photograph;

use crate::place::Placed;

/// Side of the blocks in which JPEG keeps an image, px.
const JPEG_BLOCK_PX: f64 = 8.0;
/// Colours are interpolated from photosites so far away, px.
const COLOUR_PX: f64 = 2.0;

/// Pixels of a photograph nearer than this share noise, px; 0 where each has its own.
pub(crate) fn shared_within_px(photograph: &Photograph) -> f64 {
    match (photograph.lossy, photograph.colour) {
        (true, _) => JPEG_BLOCK_PX,
        (false, true) => COLOUR_PX,
        (false, false) => 0.0,
    }
}

/// The distance within which pixels share noise in any of the images, px. Notes say what was made of each.
pub(crate) fn told(placed: &[Placed], notes: &mut Vec<String>) -> f64 {
    for frame in placed {
        notes.extend(frame.measured.notes.iter().map(|note| format!("{}: {note}", frame.name)));
    }
    let shared_px = placed.iter().map(|frame| frame.measured.shared_within_px).fold(0.0, f64::max);
    if shared_px > 0.0 {
        let why = if shared_px >= JPEG_BLOCK_PX {
            "JPEG keeps images in blocks of 8 x 8"
        } else {
            "colours are interpolated between photosites"
        };
        notes.push(format!(
            "pixels within {shared_px} px of each other share noise ({why}): what errors share so near is not taken for \
             structure"
        ));
    }
    shared_px
}

/// Exposure times, s: the table's; where it has none, those of EXIF if every image has one; otherwise 1.
pub(crate) fn exposures_s(placed: &[Placed], notes: &mut Vec<String>) -> Vec<f64> {
    if placed.iter().all(|frame| frame.exposure_s.is_none()) {
        let own: Vec<f64> = placed.iter().filter_map(|frame| frame.measured.exposure_s).collect();
        if own.len() == placed.len() {
            notes.push(
                "the table has no `exposure_s`: exposure times are those of the images' EXIF".to_owned(),
            );
            return own;
        }
        if !own.is_empty() {
            notes.push(format!(
                "{} of {} images have an exposure time in their EXIF: none is used; give the column `exposure_s`",
                own.len(),
                placed.len()
            ));
        }
    }
    placed.iter().map(|frame| frame.exposure_s.unwrap_or(1.0)).collect()
}
