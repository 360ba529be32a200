//! Where things stand: the lenses for a setup's camera, the camera, and what changes from exposure to
//! exposure.

use std::path::Path;

use glam::{DAffine2, DMat2, DMat3, DVec2, DVec3};
use retina_files::InputError;
use retina_geometry::{Pinhole, Setup};
use retina_optics::constraints::BenchLimits;
use retina_optics::design::{BenchLenses, Camera, MatchBy, Screen, bench_design};
use retina_optics::search::{
    Configuration, Element, FacilityDesign, GroupDesign, ScreenFocus, SearchRequest, evaluate,
};
use retina_optics::{OpticalSystem, read_system};

use crate::imperfections::Objective;
use crate::{BenchError, Imperfections};

/// Lenses of the default facility (a reference design, s_cam = 1.3 f_c): part, reversed.
const COLLIMATOR: [(&str, bool); 3] = [("AC508-250-A", true), ("AC508-750-A", false), ("AC508-150-A", false)];
const COLLIMATOR_GAPS_MM: [f64; 2] = [8.0, 1.680_166_981_984_285_7];
const RELAY: [(&str, bool); 2] = [("AC508-180-A", true), ("AC508-150-A", false)];
const RELAY_GAPS_MM: [f64; 1] = [2.175_024_303_956_519];
/// s_cam over f_c of that design.
const PUPIL_FACTOR: f64 = 1.3;

/// The traced system of a setup: the one it names, or the default lenses placed for its camera at the
/// magnification of eq. 13, the screen at the best common focus.
///
/// # Errors
/// The file does not fit; the bench has no room for the camera.
pub fn facility_system(setup: &Setup) -> Result<OpticalSystem, BenchError> {
    if let Some(path) = setup.optics_system() {
        let system = read_system(&path, &[])?;
        check_magnification(setup, &path, &system)?;
        return Ok(system);
    }
    let camera = Camera {
        width_px: setup.camera.width_px,
        height_px: setup.camera.height_px,
        pixel_um: setup.camera.pixel_um,
        focal_mm: setup.camera.focal_mm,
        f_number: setup.camera.f_number,
    };
    let screen = Screen {
        width_px: setup.screen.width_px,
        height_px: setup.screen.height_px,
        width_mm: setup.screen.width_mm,
        height_mm: setup.screen.height_mm,
    };
    let mut request = SearchRequest::paper(PUPIL_FACTOR);
    let lenses = BenchLenses {
        collimator_focal_mm: request.collimator_focal_mm,
        relay_focal_mm: request.relay_focal_mm,
        diameter_mm: 50.8,
        pupil_collimator_mm: request.pupil_collimator_mm,
    };
    let bench = bench_design(&camera, &screen, &lenses, &BenchLimits::PAPER, MatchBy::Height);
    request.match_by = MatchBy::Height;
    request.configurations = vec![Configuration::of_camera(&setup.name, &camera, bench.layout.magnification)];
    let group = |lenses: &[(&str, bool)], gaps_mm: &[f64]| GroupDesign {
        elements: lenses
            .iter()
            .map(|&(part, reversed)| Element { part: part.to_owned(), reversed })
            .collect(),
        gaps_mm: gaps_mm.to_vec(),
    };
    let design = FacilityDesign {
        collimator: group(&COLLIMATOR, &COLLIMATOR_GAPS_MM),
        relay: group(&RELAY, &RELAY_GAPS_MM),
    };
    let (_, mut systems) = evaluate(&design, &request, ScreenFocus::Best)?;
    Ok(systems.swap_remove(0))
}

/// A prescription may differ so much from the setup: its distortion, and lenses that are made so.
const MAGNIFICATION_SHARE: f64 = 0.02;

/// Refuses a prescription whose magnification is not the setup's: f_c / |M| is the focal length from the camera to the
/// screen, and K_f's f_y in millimetres of the screen.
fn check_magnification(setup: &Setup, path: &Path, system: &OpticalSystem) -> Result<(), BenchError> {
    let system_mm = 1.0 / retina_optics::paraxial::Paraxial::primary(system)?.power().abs();
    let pixel_mm = setup.screen.height_mm / f64::from(setup.screen.height_px);
    let setup_mm = setup.facility_pinhole().fy_px * pixel_mm;
    if (system_mm / setup_mm - 1.0).abs() <= MAGNIFICATION_SHARE {
        return Ok(());
    }
    let mend = match (setup.facility.intrinsics, setup.facility.observed_rows_px) {
        (None, Some(rows_px)) => {
            format!("set observed_rows_px = {:.1}", rows_px * system_mm / setup_mm)
        }
        _ => format!("set intrinsics of f_y {:.1} px", system_mm / pixel_mm),
    };
    Err(InputError::new(&setup.file, "the lenses have another magnification than the setup")
        .at("key `optics.system`")
        .found(format!("`{}`, of f_c / |M| {system_mm:.3} mm from the camera to the screen", path.display()))
        .expected(format!("{setup_mm:.3} mm within 2 %, as table `facility` has it (eq. 13)"))
        .help(format!(
            "{mend}, or name lenses that were designed for this camera and screen, matched by the height"
        ))
        .into())
}

/// Half extents of the part of the display that the camera can see, with a margin, mm.
pub(super) fn half_screen_mm(
    system: &OpticalSystem,
    setup: &Setup,
    camera: &CameraPose,
) -> Result<[f64; 2], BenchError> {
    let focal_mm = 1.0 / retina_optics::paraxial::Paraxial::primary(system)?.power().abs();
    let pinhole = setup.camera_pinhole();
    let (w, h) = (f64::from(pinhole.width_px), f64::from(pinhole.height_px));
    let corners = [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)];
    let mut half: [f64; 2] = [0.0; 2];
    for (x, y) in corners {
        let seen = camera.line_of_sight(DVec2::new(x, y));
        half = [half[0].max(seen.x.abs()), half[1].max(seen.y.abs())];
    }
    // 4 % for distortion.
    Ok(half.map(|tan| 1.04 * (1.0 + BEYOND) * focal_mm * tan))
}

/// Kernels are computed as far beyond the sensor, in parts of its half extents: the light of spots that land beside it
/// reaches it.
pub(super) const BEYOND: f64 = 0.02;

/// How the camera stands, and its objective's geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPose {
    /// C, the ideal pinhole.
    pub pinhole: Pinhole,
    /// The camera's axes from the facility's.
    pub camera_from_facility: DMat3,
    /// Turn about the boresight, rad.
    pub roll_rad: f64,
    objective: Objective,
}

impl CameraPose {
    /// The setup's camera with a bench's imperfections.
    pub fn new(setup: &Setup, wrong: &Imperfections) -> Self {
        let [px, py] = wrong.pointing_rad;
        let aside = DMat3::from_rotation_x(py) * DMat3::from_rotation_y(-px);
        Self {
            pinhole: setup.camera_pinhole(),
            camera_from_facility: DMat3::from_rotation_z(wrong.camera_roll_rad) * aside,
            roll_rad: wrong.camera_roll_rad,
            objective: wrong.objective,
        }
    }

    /// Where a direction of the facility (tangents) lands on the sensor, px.
    pub fn pixel(&self, at: [f64; 2]) -> DVec2 {
        let seen = self.camera_from_facility * DVec3::new(at[0], at[1], 1.0);
        let ideal = DVec2::new(seen.x, seen.y) / seen.z;
        let r2 = ideal.length_squared();
        let Objective { radial_r4, prism: [a, b], decentring: [p1, p2], .. } = self.objective;
        let (x, y) = (ideal.x, ideal.y);
        let bent = ideal * (1.0 + radial_r4 * r2 * r2)
            + DVec2::new(a, b) * r2
            + DVec2::new(
                p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y,
                2.0 * p1 * x * y + p2 * (r2 + 2.0 * y * y),
            );
        self.pinhole.pixel(bent)
    }

    /// The direction of the facility (tangents) that an ideal objective shows at a pixel.
    pub fn line_of_sight(&self, at_px: DVec2) -> DVec2 {
        let seen = self.camera_from_facility.transpose() * self.pinhole.line_of_sight(at_px).extend(1.0);
        DVec2::new(seen.x, seen.y) / seen.z
    }
}

/// What one exposure adds: the camera's mount moves, its focal length breathes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExposurePose {
    /// Shift of the image, px.
    pub shift_px: DVec2,
    /// Turn of the image about the principal point, rad.
    pub roll_rad: f64,
    /// Scale of the image about it.
    pub scale: f64,
}

impl Default for ExposurePose {
    fn default() -> Self {
        Self { shift_px: DVec2::ZERO, roll_rad: 0.0, scale: 1.0 }
    }
}

impl ExposurePose {
    /// The moved position.
    pub fn apply(&self, at_px: DVec2, camera: &CameraPose) -> DVec2 {
        self.map(camera).transform_point2(at_px)
    }

    /// What [`ExposurePose::apply`] does to every position.
    pub(super) fn map(&self, camera: &CameraPose) -> DAffine2 {
        let centre = DVec2::new(camera.pinhole.cx_px, camera.pinhole.cy_px);
        let turn = DMat2::from_angle(self.roll_rad) * self.scale;
        DAffine2 { matrix2: turn, translation: centre + self.shift_px - turn * centre }
    }
}
