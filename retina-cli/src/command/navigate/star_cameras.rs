//! What is known of the cameras of `retina navigate stars`, and their solvers.

use std::collections::BTreeMap;

use retina_formats::Calibration;
use retina_geometry::Setup;
use retina_image::{DetectOptions, Photograph};
use retina_navigation::image::{ImageContext, ImageResult, solve_image};
use retina_navigation::stars::{SolverOptions, StarCamera, StarSolver};

use super::stars::Arguments;
use crate::failure::Failure;

/// What is known of the camera.
pub(super) enum Optics {
    Setup(Box<Setup>, Option<Box<Calibration>>),
    /// Least and greatest horizontal field, rad.
    Field([f64; 2]),
    /// Nothing but what each image's EXIF says.
    Exif,
}

/// What is known of one image's camera.
#[derive(Clone, Copy)]
pub(super) enum Known<'a> {
    Camera(&'a Setup, Option<&'a Calibration>),
    /// Least and greatest horizontal field, rad.
    Field([f64; 2]),
    /// The same, by the EXIF of a picture that may have been cropped.
    Exif([f64; 2]),
}

/// Horizontal fields that are searched where nothing is known, rad: below, the catalogue (to V 8.4) has too few stars; above,
/// lenses are no pinholes any more.
pub(super) const ANY_FIELD_RAD: [f64; 2] = [2.0 * RAD_PER_DEG, 70.0 * RAD_PER_DEG];
const RAD_PER_DEG: f64 = std::f64::consts::PI / 180.0;

/// A 35-mm equivalent is rounded to 1 mm, and the focal length that it comes from to a few per cent.
const EXIF_FOCAL_SLACK: f64 = 0.08;

/// Size of an image, and the bits of its field of view where no setup says it.
type CameraKey = ([u32; 2], Option<[u64; 2]>);

/// The cameras and solvers of the images so far.
pub(super) struct Solvers<'a> {
    pub(super) arguments: &'a Arguments,
    pub(super) tdb_s: Option<f64>,
    pub(super) prepared: BTreeMap<CameraKey, (StarCamera, StarSolver)>,
}

impl Solvers<'_> {
    /// Solves an image by what is known of its camera; by any field of view if its EXIF is all that is known and does not
    /// agree with the stars.
    pub(super) fn solve(
        &mut self,
        photograph: &Photograph,
        known: &Known<'_>,
        context: &ImageContext,
        notes: &mut Vec<String>,
    ) -> Result<ImageResult, Failure> {
        let (known, any) = match *known {
            Known::Exif(field_rad) => (Known::Field(field_rad), true),
            known => (known, false),
        };
        let first = self.by(photograph, known, context)?;
        if !any {
            return Ok(first);
        }
        let Known::Field(field_rad) = known else { return Ok(first) };
        let [least, greatest] = field_rad.map(f64::to_degrees);
        if first.solution.is_ok() {
            notes.push(format!(
                "horizontal field of view by its EXIF, if it was not cropped: {least:.2} to {greatest:.2} deg"
            ));
            return Ok(first);
        }
        notes.push(format!(
            "the stars do not agree with the field of view by its EXIF ({least:.2} to {greatest:.2} deg): any was tried"
        ));
        self.by(photograph, Known::Field(ANY_FIELD_RAD), context)
    }

    fn by(
        &mut self,
        photograph: &Photograph,
        known: Known<'_>,
        context: &ImageContext,
    ) -> Result<ImageResult, Failure> {
        let image = &photograph.image;
        let size = [image.width_px, image.height_px];
        let field = match known {
            Known::Camera(..) => None,
            Known::Field(field_rad) | Known::Exif(field_rad) => Some(field_rad.map(f64::to_bits)),
        };
        let (arguments, tdb_s) = (self.arguments, self.tdb_s);
        let (camera, solver) =
            self.prepared.entry((size, field)).or_insert_with(|| arguments.prepare(known, size, tdb_s));
        let detect = DetectOptions { threshold_sigma: arguments.threshold_sigma, ..DetectOptions::default() };
        solve_image(image, camera, solver, &detect, context).map_err(|error| Failure::new(error.to_string()))
    }
}

impl Arguments {
    fn prepare(&self, known: Known<'_>, size: [u32; 2], tdb_s: Option<f64>) -> (StarCamera, StarSolver) {
        let slack = self.focal_percent / 100.0;
        let mut options = SolverOptions {
            focal_ratio: [1.0 - slack, 1.0 + slack],
            log10_bound: self.log10_bound,
            most_hypotheses: self.most_hypotheses,
            mirrored_too: true,
            ..SolverOptions::default()
        };
        options.tdb_s = tdb_s.unwrap_or(options.tdb_s);
        let mut camera = match known {
            Known::Camera(setup, calibration) => StarCamera::from_setup(setup, calibration.cloned()),
            Known::Field([least, greatest]) | Known::Exif([least, greatest]) => {
                let [short, long] = [greatest, least].map(|field| 1.0 / (0.5 * field).tan());
                let middle = (short * long).sqrt();
                options.focal_ratio[0] *= short / middle;
                options.focal_ratio[1] *= long / middle;
                StarCamera::from_field(2.0 * (1.0 / middle).atan(), size)
            }
        };
        if let Some(aspect) = self.pixel_aspect {
            camera = camera.with_pixel_aspect(aspect);
        }
        camera.mirrored = self.mirrored;
        let solver = StarSolver::new(&camera, options);
        (camera, solver)
    }
}

/// Least and greatest horizontal field by the 35-mm equivalent, rad; `None` where it is not told, or no pinhole's.
pub(super) fn exif_field_rad(photograph: &Photograph) -> Option<[f64; 2]> {
    let size = [photograph.image.width_px, photograph.image.height_px];
    let focal_px = photograph.exif.focal_px(size)?;
    let field_rad = |share: f64| 2.0 * (0.5 * f64::from(size[0]) / (share * focal_px)).atan();
    let fields_rad = [field_rad(1.0 + EXIF_FOCAL_SLACK), field_rad(1.0 - EXIF_FOCAL_SLACK)];
    let [least, greatest] = fields_rad.map(f64::to_degrees);
    (least >= 0.1 && greatest < 90.0).then_some(fields_rad)
}
