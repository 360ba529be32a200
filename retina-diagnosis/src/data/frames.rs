//! Pixels of frames as data. Which light a pixel ought to have is predicted elsewhere (`retina-frames`): here are
//! columns alone, in digital numbers.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use retina_files::InputError;

use retina_formats::{Channel, EffectId, FramesEffect, TableKind};

use super::{Baseline, Covariate, Dataset, DisplayDepth, Flip, Group, RowFrame, Term};
use crate::pixel_noise::{Neighbours, White, white_noise};

/// A named column over the pixels, DN per unit of its amplitude.
#[derive(Debug, Clone)]
pub struct PixelColumn {
    /// Name of its amplitude, with the unit.
    pub name: String,
    /// A value for each pixel.
    pub values: Vec<f64>,
    /// Amplitudes that something real may have, where there are bounds.
    pub plausible: Option<[f64; 2]>,
}

/// One form of an effect, linear in its amplitudes.
#[derive(Debug, Clone)]
pub struct PixelForm {
    /// Shape parameters by name.
    pub shape: Vec<(&'static str, f64)>,
    /// Its columns.
    pub leading: Vec<PixelColumn>,
}

/// An effect of the catalogue on these pixels.
#[derive(Debug, Clone)]
pub struct PixelEffect {
    /// Its id.
    pub id: FramesEffect,
    /// Its forms, or why these frames cannot show it.
    pub forms: Result<Vec<PixelForm>, String>,
}

/// An effect that is part of the prediction, at its fitted parameters.
#[derive(Debug, Clone)]
pub struct PixelPart {
    /// Its id.
    pub id: FramesEffect,
    /// What it adds to the prediction with the parts before it, DN.
    pub adds: Vec<f64>,
    /// Derivatives of the whole prediction by its parameters, with the parameters' values.
    pub tangents: Vec<(PixelColumn, f64)>,
    /// Shape parameters that were chosen from a list.
    pub shape: Vec<(&'static str, f64)>,
}

/// Pixels of frames, measured and predicted; rows are sorted by group.
#[derive(Debug, Clone, Default)]
pub struct Pixels {
    /// Measured, DN.
    pub measured: Vec<f64>,
    /// Predicted without the parts, DN.
    pub predicted: Vec<f64>,
    /// For each pixel: frame (from 0), x and y in the camera's image, px.
    pub place: Vec<[f64; 3]>,
    /// Distance of neighbours, px.
    pub pitch_px: f64,
    /// Name and number of pixels of each group: contiguous tiles.
    pub groups: Vec<(String, usize)>,
    /// What errors may depend on.
    pub covariates: Vec<Covariate>,
    /// Pixels nearer than this share noise, px: of pictures that were compressed or interpolated.
    pub shared_within_px: f64,
    /// ln of a quantity that the noise depends on.
    pub noise_key: Vec<f64>,
    /// Smallest standard deviation that a pixel can have, DN: that of its rounding.
    pub least_noise: f64,
    /// Noise of each pixel by itself, where it is known already: one image has one noise, whatever is predicted.
    pub white: Option<White>,
    /// What is always fitted: derivatives of the prediction by its own parameters, with the parameters' values.
    pub baseline: Vec<(PixelColumn, f64)>,
    /// Where each image's body is, in the present state.
    pub placements: Vec<Placement>,
    /// The catalogue's effects that are no parts.
    pub effects: Vec<PixelEffect>,
    /// Effects that are parts of the prediction, in their order.
    pub parts: Vec<PixelPart>,
    /// Pixels left out as saturated.
    pub saturated: usize,
    /// The files.
    pub files: Vec<PathBuf>,
    /// What the user ought to know.
    pub notes: Vec<String>,
}

/// A number with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measure {
    /// The number.
    pub value: f64,
    /// Its standard deviation under the model that was fitted.
    pub sigma: f64,
}

/// Where the body of an image is seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    /// The image's file name.
    pub image: String,
    /// The body's middle as the table predicts it, px.
    pub predicted_px: [f64; 2],
    /// The same as it is seen, px.
    pub seen_px: [Measure; 2],
    /// By how much it is turned, rad.
    pub roll_rad: Measure,
    /// Its relative change of size.
    pub scale: Measure,
}

/// Most pixels that are taken at once.
pub const MOST_PIXELS: usize = 50_000;
/// Fewest pixels that anything can be said of.
const FEWEST_PIXELS: usize = 64;

impl Dataset {
    /// Pixels as data. Noise that is not known is estimated from neighbours.
    ///
    /// # Errors
    /// Too few or too many of them.
    pub fn of_pixels(mut pixels: Pixels) -> Result<Self, InputError> {
        let rows = pixels.measured.len();
        let file = pixels.files.first().cloned().unwrap_or_default();
        if !(FEWEST_PIXELS..=MOST_PIXELS).contains(&rows) {
            return Err(InputError::new(file, "the number of pixels does not fit")
                .found(format!("{rows} usable pixels"))
                .expected(format!("{FEWEST_PIXELS} to {MOST_PIXELS}"))
                .help(
                    "look at the mask, the exposure (saturated and dark pixels are left out), and the scene",
                ));
        }
        pixels.white = pixels.white.take().or_else(|| {
            white_noise(Neighbours {
                measured: &pixels.measured,
                predicted: &pixels.predicted,
                place: &pixels.place,
                pitch_px: pixels.pitch_px,
                left: None,
                shared_within_px: pixels.shared_within_px,
                least_noise: pixels.least_noise,
            })
        });
        let in_table = |value: f64| RowFrame { measured: [value, 0.0], to_table: [[1.0, 0.0], [0.0, 0.0]] };
        Ok(Self {
            kind: TableKind::Frames,
            y: pixels.measured.iter().zip(&pixels.predicted).map(|(m, p)| m - p).collect(),
            groups: Group::in_order(pixels.groups.iter().cloned()),
            order: (0..rows).collect(),
            table_rows: rows,
            in_part: false,
            saturated: pixels.saturated,
            covariates: pixels.covariates.clone(),
            noise_key: pixels.noise_key.clone(),
            isotropic_from_error: None,
            // Noise of pixels is their own: tiles have no common error.
            jitters: false,
            flip: Flip::Groups,
            wander: 0.0,
            stated: None,
            channel: vec![Channel::W; rows],
            white_share: [1.0 / 3.0; 3],
            mounting: vec![0; rows],
            roll_rad: vec![0.0],
            half_tan: 1.0,
            half_height: 1.0,
            display: None,
            default_lenses: false,
            display_depth: DisplayDepth::default(),
            form_error: Arc::default(),
            tracer: None,
            found_coma: None,
            found_gamma: None,
            screen_pixel_arcsec: 0.0,
            frame: pixels.measured.iter().map(|m| in_table(*m)).collect(),
            baseline: Baseline::Physical,
            held: None,
            field: OnceLock::new(),
            files: pixels.files.clone(),
            notes: pixels.notes.clone(),
            pixels: Some(Arc::new(pixels)),
            lens: None,
        })
    }

    /// The pixels, of a table of frames.
    pub fn pixels(&self) -> Option<&Pixels> {
        self.pixels.as_deref()
    }

    /// The part of the prediction that an effect is.
    pub(crate) fn part(&self, id: EffectId) -> Option<&PixelPart> {
        self.pixels()?.parts.iter().find(|part| EffectId::Frames(part.id) == id)
    }

    /// The values that the baseline's coefficients are counted from.
    pub(crate) fn baseline_values(&self) -> Vec<f64> {
        if let Some(lens) = &self.lens {
            return super::lens::values(lens, self.roll_rad.len());
        }
        let of_pixels = |pixels: &Pixels| pixels.baseline.iter().map(|(_, value)| *value).collect();
        self.pixels().map_or_else(|| vec![0.0; self.baseline_terms().len()], of_pixels)
    }

    /// Smallest standard deviation that a row can have.
    pub(crate) fn least_noise(&self) -> f64 {
        self.pixels().map_or(1e-9, |pixels| pixels.least_noise)
    }
}

/// A column as a term.
pub(crate) fn term(column: &PixelColumn) -> Term<'_> {
    Term { plausible: column.plausible, ..Term::new(column.name.clone(), |row| [column.values[row], 0.0]) }
}

pub(super) fn baseline(data: &Dataset) -> Vec<Term<'_>> {
    data.pixels()
        .map_or_else(Vec::new, |pixels| pixels.baseline.iter().map(|(column, _)| term(column)).collect())
}
