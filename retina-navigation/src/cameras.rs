//! What is known of the cameras of star images, and the solvers that follow from it.

use std::collections::BTreeMap;

use retina_formats::Calibration;
use retina_geometry::Setup;
use retina_image::{CameraImage, DetectOptions, Exif};
use retina_sky::ephemeris::EphemerisError;

use crate::image::{ImageContext, ImageResult, solve_image};
use crate::stars::{SolverOptions, StarCamera, StarSolver};

/// What is known of an image's camera.
#[derive(Debug, Clone)]
pub enum KnownCamera {
    /// All of it, with the calibration of a facility whose distortion the image holds.
    Setup(Box<Setup>, Option<Box<Calibration>>),
    /// Least and greatest horizontal field, rad.
    Field([f64; 2]),
    /// Nothing but what the image's EXIF says. Any field is searched if that does not agree with the stars.
    Exif,
}

/// Horizontal fields that are searched where nothing is known, rad: below, the catalogue (to V 8.4) has too few stars; above,
/// lenses are no pinholes any more.
pub const ANY_FIELD_RAD: [f64; 2] = [2.0 * RAD_PER_DEG, 70.0 * RAD_PER_DEG];
const RAD_PER_DEG: f64 = std::f64::consts::PI / 180.0;

/// A 35-mm equivalent is rounded to 1 mm, and the focal length that it comes from to a few per cent.
const EXIF_FOCAL_SLACK: f64 = 0.08;

/// How images are solved.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageSolverOptions {
    /// Uncertainty of the focal length, share of it.
    pub focal_slack: f64,
    /// Highest accepted probability of a false answer, as log10.
    pub log10_bound: f64,
    /// Star patterns (hypotheses) after which the search on an image stops.
    pub most_hypotheses: usize,
    /// Detection threshold of a point's brightest 3 x 3 pixels over the background, standard deviations.
    pub threshold_sigma: f64,
    /// The images are mirror images. An image that turns out to be one is solved all the same.
    pub mirrored: bool,
    /// How many times as high as wide a pixel is, where it is known and no setup says it.
    pub pixel_aspect: Option<f64>,
    /// Epoch of the stars' places, TDB seconds since J2000.
    pub tdb_s: Option<f64>,
}

impl Default for ImageSolverOptions {
    fn default() -> Self {
        Self {
            focal_slack: 0.03,
            log10_bound: -7.0,
            most_hypotheses: SolverOptions::default().most_hypotheses,
            threshold_sigma: DetectOptions::default().threshold_sigma,
            mirrored: false,
            pixel_aspect: None,
            tdb_s: None,
        }
    }
}

/// Size of an image, and the bits of its field of view where no setup says it.
type CameraKey = ([u32; 2], Option<[u64; 2]>);

/// Solves images of one camera, or of cameras of which nothing is known. What it prepares for one image serves the next
/// of the same size and field.
#[derive(Debug)]
pub struct ImageSolver {
    known: KnownCamera,
    options: ImageSolverOptions,
    prepared: BTreeMap<CameraKey, (StarCamera, StarSolver)>,
}

impl ImageSolver {
    /// For images of this camera.
    pub fn new(known: KnownCamera, options: ImageSolverOptions) -> Self {
        Self { known, options, prepared: BTreeMap::new() }
    }

    /// What is known of the camera.
    pub fn known(&self) -> &KnownCamera {
        &self.known
    }

    /// Solves an image by what is known of its camera; by any field of view if its EXIF is all that is known and does
    /// not agree with the stars. `notes` is told what was taken from the EXIF.
    ///
    /// # Errors
    /// The context's epoch is outside the ephemeris.
    pub fn solve(
        &mut self,
        image: &CameraImage,
        exif: &Exif,
        context: &ImageContext,
        notes: &mut Vec<String>,
    ) -> Result<ImageResult, EphemerisError> {
        let field_rad = match &self.known {
            KnownCamera::Setup(..) => return self.by(image, None, context),
            KnownCamera::Field(field_rad) => return self.by(image, Some(*field_rad), context),
            KnownCamera::Exif => exif_field_rad(image, exif),
        };
        let Some(field_rad) = field_rad else { return self.by(image, Some(ANY_FIELD_RAD), context) };
        let first = self.by(image, Some(field_rad), context)?;
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
        self.by(image, Some(ANY_FIELD_RAD), context)
    }

    fn by(
        &mut self,
        image: &CameraImage,
        field_rad: Option<[f64; 2]>,
        context: &ImageContext,
    ) -> Result<ImageResult, EphemerisError> {
        let size = [image.width_px, image.height_px];
        let (known, options) = (&self.known, &self.options);
        let key = (size, field_rad.map(|field_rad| field_rad.map(f64::to_bits)));
        let (camera, solver) =
            self.prepared.entry(key).or_insert_with(|| prepare(known, field_rad, size, options));
        let threshold_sigma = self.options.threshold_sigma;
        let detect = DetectOptions { threshold_sigma, ..DetectOptions::default() };
        solve_image(image, camera, solver, &detect, context)
    }
}

fn prepare(
    known: &KnownCamera,
    field_rad: Option<[f64; 2]>,
    size: [u32; 2],
    asked: &ImageSolverOptions,
) -> (StarCamera, StarSolver) {
    let mut options = SolverOptions {
        focal_ratio: [1.0 - asked.focal_slack, 1.0 + asked.focal_slack],
        log10_bound: asked.log10_bound,
        most_hypotheses: asked.most_hypotheses,
        mirrored_too: true,
        ..SolverOptions::default()
    };
    options.tdb_s = asked.tdb_s.unwrap_or(options.tdb_s);
    let mut camera = match (known, field_rad) {
        (KnownCamera::Setup(setup, calibration), None) => {
            StarCamera::from_setup(setup, calibration.as_deref().cloned())
        }
        (_, field_rad) => {
            let [least, greatest] = field_rad.unwrap_or(ANY_FIELD_RAD);
            let [short, long] = [greatest, least].map(|field| 1.0 / (0.5 * field).tan());
            let middle = (short * long).sqrt();
            options.focal_ratio[0] *= short / middle;
            options.focal_ratio[1] *= long / middle;
            StarCamera::from_field(2.0 * (1.0 / middle).atan(), size)
        }
    };
    if let Some(aspect) = asked.pixel_aspect {
        camera = camera.with_pixel_aspect(aspect);
    }
    camera.mirrored = asked.mirrored;
    let solver = StarSolver::new(&camera, options);
    (camera, solver)
}

/// Least and greatest horizontal field by the 35-mm equivalent, rad; `None` where it is not told, or no pinhole's.
fn exif_field_rad(image: &CameraImage, exif: &Exif) -> Option<[f64; 2]> {
    let focal_px = exif.focal_px([image.width_px, image.height_px])?;
    let field_rad = |share: f64| 2.0 * (0.5 * f64::from(image.width_px) / (share * focal_px)).atan();
    let fields_rad = [field_rad(1.0 + EXIF_FOCAL_SLACK), field_rad(1.0 - EXIF_FOCAL_SLACK)];
    let [least, greatest] = fields_rad.map(f64::to_degrees);
    (least >= 0.1 && greatest < 90.0).then_some(fields_rad)
}
