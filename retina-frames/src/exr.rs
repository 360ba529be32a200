//! A prediction from a linear EXR, laid upon the camera's cells.

use std::path::{Path, PathBuf};

use glam::DVec2;
use retina_batch::read_exr;
use retina_files::InputError;
use retina_formats::Calibration;
use retina_geometry::{Distortion, Pinhole, Setup};
use retina_radiometry::{Lambert, PhaseFunction, Photometry};

use crate::grid::Grid;
use crate::layers::{Layers, Ratios, angles};
use crate::measured::largest_patch_above;
use crate::window::{Pose, Window};

/// Share of the brightest light above which a pixel without a mask belongs to the body.
const FAINTEST: f32 = 0.01;

/// An EXR with what its pixels are.
pub(crate) struct ExrOrigin {
    file: PathBuf,
    light: Grid,
    mask: Option<Grid>,
    angles_deg: Option<[Grid; 3]>,
    pinhole: Pinhole,
    /// D, where the image is that of a screen which shows it through the facility.
    distortion: Option<Distortion>,
}

impl ExrOrigin {
    /// Reads one: of the size of the setup's camera, or of its screen.
    ///
    /// # Errors
    /// No EXR, no channel of light, another size, values that are not finite.
    pub(crate) fn read(
        path: &Path,
        setup: &Setup,
        calibration: Option<&Calibration>,
    ) -> Result<Self, InputError> {
        let (image, metadata) = read_exr(path)?;
        let size = [image.width_px, image.height_px];
        let (camera, screen) = (setup.camera_pinhole(), setup.facility_pinhole());
        let of = |p: &Pinhole| [p.width_px as usize, p.height_px as usize];
        let pinhole = if size == of(&camera) {
            camera
        } else if size == of(&screen) {
            screen
        } else {
            return Err(InputError::new(
                path,
                "the prediction is neither the camera's image nor the screen's",
            )
            .found(format!("{} x {} px", size[0], size[1]))
            .expected(format!("{:?} (camera) or {:?} (screen)", of(&camera), of(&screen))));
        };
        let channel = |name: &str| {
            let (_, values) = image.channels.iter().find(|(n, _)| n == name)?;
            Some(Grid { columns: size[0], rows: size[1], values: values.clone() })
        };
        let Some(light) = channel("IF").or_else(|| channel("Y")) else {
            let names: Vec<&str> = image.channels.iter().map(|(name, _)| name.as_str()).collect();
            return Err(InputError::new(path, "holds no light")
                .found(format!("channels {}", names.join(", ")))
                .expected("`Y` or `IF`"));
        };
        if let Some(at) = light.values.iter().position(|v| !v.is_finite()) {
            return Err(InputError::new(path, "a pixel is not finite")
                .at(format!("pixel ({}, {})", at % size[0], at / size[0]))
                .found(light.values[at]));
        }
        let angles_deg = match ["incidence_deg", "emission_deg", "phase_deg"].map(channel) {
            [Some(i), Some(e), Some(p)] => Some([i, e, p]),
            _ => None,
        };
        // An undistorted image was resampled for the screen, so that the camera sees it as it is.
        let undistorted = metadata.is_some_and(|text| text.contains("undistorted K_f image"));
        let distortion = calibration.filter(|_| !undistorted).map(|c| c.distortion.clone());
        Ok(Self { file: path.to_path_buf(), light, mask: channel("mask"), angles_deg, pinhole, distortion })
    }

    /// The file.
    pub(crate) fn file(&self) -> &Path {
        &self.file
    }

    /// Where the EXR's pixels are that a camera's pixel position sees.
    fn source(&self, camera: &Pinhole, at_px: DVec2) -> DVec2 {
        let sight = camera.line_of_sight(at_px);
        // Beyond the calibrated field D has no inverse: the image is left as it is there.
        let sight = self.distortion.as_ref().map_or(sight, |d| d.undistort(sight).unwrap_or(sight));
        self.pinhole.pixel(sight)
    }

    /// The body in the camera's pixels, by its mask, or where there is none its patch of light down to the faintest parts:
    /// middle and half of its box's longer side.
    pub(crate) fn outline(&self, camera: &Pinhole) -> Option<(DVec2, f64)> {
        let patch = match &self.mask {
            Some(mask) => largest_patch_above(mask, 0.0)?,
            None => largest_patch_above(
                &self.light,
                FAINTEST * self.light.values.iter().copied().fold(0.0, f32::max),
            )?,
        };
        let [left, top, right, bottom] = patch.bounds;
        let scale = camera.fx_px / self.pinhole.fx_px;
        let middle = self.pinhole.line_of_sight(DVec2::new(0.5 * (left + right), 0.5 * (top + bottom)));
        Some((camera.pixel(middle), 0.5 * scale * (right - left).max(bottom - top)))
    }

    fn laid(&self, grid: &Grid, camera: &Pinhole, window: &Window, pose: &Pose) -> Grid {
        // A cell wider than the source's pixels takes the mean of several places.
        let step = self.pinhole.fx_px / camera.fx_px / window.cells_per_px();
        let points = step.ceil().clamp(1.0, 8.0) as usize;
        let spline = grid.spline();
        let (columns, rows) = (window.columns * window.fine, window.rows * window.fine);
        Grid::from_fn(columns, rows, |x, y| {
            let mut sum = 0.0;
            for k in 0..points * points {
                let inner = DVec2::new((k % points) as f64 + 0.5, (k / points) as f64 + 0.5) / points as f64;
                let at = window.px(DVec2::new(x as f64, y as f64) + inner);
                let from = self.source(camera, pose.source_px(at));
                let outside =
                    from.x < 0.0 || from.y < 0.0 || from.x > grid.columns as f64 || from.y > grid.rows as f64;
                sum += if outside { 0.0 } else { spline.at(from) };
            }
            (sum / (points * points) as f64) as f32
        })
    }

    /// The light alone.
    pub(crate) fn preview(&self, camera: &Pinhole, window: &Window, pose: &Pose) -> Grid {
        self.laid(&self.light, camera, window, pose)
    }

    /// All layers.
    pub(crate) fn layers(&self, camera: &Pinhole, window: &Window, pose: &Pose) -> Layers {
        let laid = |grid: &Grid| self.laid(grid, camera, window, pose);
        let light = laid(&self.light);
        let coverage = self.mask.as_ref().map(laid);
        let angles = self.angles_deg.as_ref().zip(coverage.as_ref()).map(|(layers, coverage)| {
            // Beside the body angles are 0, which must not be mixed in.
            let on_body = |v: &f32| f32::from(*v > 0.0);
            let mask = self.mask.as_ref().map_or_else(Vec::new, |m| m.values.iter().map(on_body).collect());
            let mask = Grid { values: mask, ..self.light };
            let part = laid(&mask);
            let inside = layers.each_ref().map(|layer| {
                laid(&layer.map2(&mask, |value, part| value * part)).map2(&part, |value, part| {
                    if part > 0.05 { (value / part).clamp(0.0, 180.0) } else { 90.0 }
                })
            });
            angles(inside.each_ref().map(|layer| &layer.values[..]), &coverage.values)
        });
        let law = angles.as_ref().map(|_| Photometry::new(Lambert, PhaseFunction::CONSTANT, Some(1.0)));
        Layers {
            light,
            coverage,
            angles,
            law,
            place_rad: None,
            map: None,
            mesh: None,
            ratios: Ratios::default(),
        }
    }
}
