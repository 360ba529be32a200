//! What is searched for.

use std::path::Path;

use retina_files::InputError;
use serde::{Deserialize, Serialize};

use crate::constraints::BenchLimits;
use crate::design::{Camera, MatchBy, Screen};

/// Longest length of a request, mm: ten metres.
const LONGEST_MM: f64 = 1e4;

/// Most fields of a configuration.
pub(crate) const MOST_FIELDS: usize = 8;

/// One facility configuration: a camera objective and the magnification that matches it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Configuration {
    /// Its name.
    pub name: String,
    /// Focal length of the camera's objective, mm.
    pub camera_focal_mm: f64,
    /// Diameter of its entrance pupil, mm.
    pub pupil_mm: f64,
    /// M, negative.
    pub magnification: f64,
    /// Tangents of the fields at which spots count, the axis first.
    pub field_tans: Vec<f64>,
}

impl Configuration {
    /// A camera at a magnification M; fields at 0, 0.7 and 1 times the tangent of the sensor's corner.
    pub fn of_camera(name: &str, camera: &Camera, magnification: f64) -> Self {
        let corner_tan = camera.half_field_tans()[2];
        Self {
            name: name.to_owned(),
            camera_focal_mm: camera.focal_mm,
            pupil_mm: camera.pupil_mm(),
            magnification,
            field_tans: [0.0, 0.7, 1.0].map(|share| share * corner_tan).to_vec(),
        }
    }

    /// The paper's camera (2048 x 1536 pixels of 3.45 um) at f/2.8 with an objective of this focal
    /// length (mm), matched by the diagonal of the paper's screen, eq. 3.
    pub fn paper(name: &str, camera_focal_mm: f64, collimator_focal_mm: f64) -> Self {
        let camera = Camera {
            width_px: 2048,
            height_px: 1536,
            pixel_um: 3.45,
            focal_mm: camera_focal_mm,
            f_number: 2.8,
        };
        let corner_tan = camera.half_field_tans()[2];
        let magnification = -2.0 * collimator_focal_mm * corner_tan / Screen::PAPER.diagonal_mm();
        Self::of_camera(name, &camera, magnification)
    }

    /// Focal length of the whole facility seen from the camera, f_c / |M|, mm: a direction (x, y, 1)
    /// lands at -f (x, y) or +f (x, y) on the screen, to first order.
    pub fn facility_focal_mm(&self, collimator_focal_mm: f64) -> f64 {
        collimator_focal_mm / self.magnification.abs()
    }
}

/// What is searched for, and within which limits. Lengths in mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SearchRequest {
    /// Focal length of the collimator at the middle wavelength.
    pub collimator_focal_mm: f64,
    /// Focal length of the relay.
    pub relay_focal_mm: f64,
    /// Doublets of the collimator.
    pub collimator_lenses: usize,
    /// Doublets of the relay.
    pub relay_lenses: usize,
    /// s_cam: camera pupil to the collimator's principal plane.
    pub pupil_collimator_mm: f64,
    /// The configurations served by the same lenses, gaps inside the groups included.
    pub configurations: Vec<Configuration>,
    /// How their magnifications were chosen.
    pub match_by: MatchBy,
    /// Wavelengths of equal weight, nm; first-order figures are held at the middle one.
    pub wavelengths_nm: Vec<f64>,
    /// Distances on the bench between principal planes; s_rc also between vertices.
    pub bench: BenchLimits,
    /// Least distance from the relay's last vertex to the screen.
    pub min_screen_gap_mm: f64,
    /// Least gap between two lenses, on the axis and at their rims.
    pub min_gap_mm: f64,
    /// Largest gap between two lenses of a group.
    pub max_gap_mm: f64,
    /// Part of each lens's semi-diameter that light may use.
    pub clear_fraction: f64,
    /// Largest share of a field's beam that may be lost.
    pub max_vignetted: f64,
    /// Only parts whose number begins with one of these; all for an empty list.
    pub part_prefixes: Vec<String>,
    /// Smallest lens diameter.
    pub min_diameter_mm: f64,
    /// Pairs of groups that are refitted with exact rays.
    pub exact_candidates: usize,
    /// Leaders whose lenses are then swapped one by one.
    pub leaders: usize,
    /// Seed of the random part of the order in which candidates are taken.
    pub seed: u64,
}

impl SearchRequest {
    /// The paper's facility: f_c = 86.8, f_r = 82.8 mm, three and two doublets, the wide and the
    /// narrow camera, matched by the diagonal; s_cam = `pupil_factor` f_c.
    pub fn paper(pupil_factor: f64) -> Self {
        let collimator_focal_mm = 86.8;
        Self {
            collimator_focal_mm,
            relay_focal_mm: 82.8,
            collimator_lenses: 3,
            relay_lenses: 2,
            pupil_collimator_mm: pupil_factor * collimator_focal_mm,
            configurations: vec![
                Configuration::paper("wide-fov", 25.0, collimator_focal_mm),
                Configuration::paper("narrow-fov", 50.0, collimator_focal_mm),
            ],
            match_by: MatchBy::Diagonal,
            wavelengths_nm: vec![605.0, 544.0, 475.0],
            bench: BenchLimits::PAPER,
            min_screen_gap_mm: BenchLimits::PAPER.screen_relay_mm,
            min_gap_mm: 0.5,
            max_gap_mm: 40.0,
            clear_fraction: 1.0,
            max_vignetted: 0.01,
            part_prefixes: Vec::new(),
            min_diameter_mm: 45.0,
            exact_candidates: 20_000,
            leaders: 12,
            seed: 1,
        }
    }

    /// Refuses numbers that no bench can have.
    ///
    /// # Errors
    /// Names the quantity; the "file" is `source`, the command line for one.
    pub fn check(&self, source: &Path) -> Result<(), InputError> {
        let error = |at: &str, found: f64, expected: &str| {
            Err(InputError::new(source, "the search cannot use this number")
                .at(at.to_owned())
                .found(found)
                .expected(expected))
        };
        let positive = [
            ("collimator focal length", self.collimator_focal_mm),
            ("relay focal length", self.relay_focal_mm),
            ("pupil to collimator", self.pupil_collimator_mm),
            ("largest gap", self.max_gap_mm),
            ("least gap to the screen", self.min_screen_gap_mm),
        ];
        for (at, value) in positive {
            if !(value > 0.0 && value <= LONGEST_MM) {
                return error(at, value, "a length above 0, at most 10 000 mm");
            }
        }
        for (at, count) in
            [("collimator lenses", self.collimator_lenses), ("relay lenses", self.relay_lenses)]
        {
            if !(2..=3).contains(&count) {
                return error(at, count as f64, "2 or 3");
            }
        }
        if !(self.min_gap_mm >= 0.0 && self.min_gap_mm < self.max_gap_mm) {
            return error("least gap", self.min_gap_mm, "0 mm or more, below the largest gap");
        }
        if !(self.clear_fraction > 0.0 && self.clear_fraction <= 1.0) {
            return error("clear fraction", self.clear_fraction, "above 0, at most 1");
        }
        if !(0.0..1.0).contains(&self.max_vignetted) {
            return error("vignetted share", self.max_vignetted, "0 to below 1");
        }
        if self.wavelengths_nm.len() != 3 {
            return error(
                "wavelengths",
                self.wavelengths_nm.len() as f64,
                "three, the primary one in the middle",
            );
        }
        if self.configurations.is_empty() {
            return error("configurations", 0.0, "at least one");
        }
        for configuration in &self.configurations {
            let Configuration { magnification, pupil_mm, camera_focal_mm, field_tans, .. } = configuration;
            if !(magnification.is_finite() && *magnification < 0.0) {
                return error("magnification", *magnification, "a negative number (eq. 3)");
            }
            if !(*pupil_mm > 0.0 && *camera_focal_mm > 0.0 && (1..=MOST_FIELDS).contains(&field_tans.len())) {
                return error("camera", *pupil_mm, "a pupil, a focal length and one to eight fields");
            }
        }
        Ok(())
    }

    /// Index of the wavelength of first-order figures.
    pub(crate) fn primary(&self) -> usize {
        self.wavelengths_nm.len() / 2
    }
}
