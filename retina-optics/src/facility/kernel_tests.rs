use super::super::tangents;
use super::super::tests::reference_wide;
use super::super::{ImagingOptions, PupilSlopes, SpotMoments};
use std::f64::consts::PI;

use super::*;
use crate::glass::Medium;
use crate::pupil::gaussian;
use crate::surface::{Shape, Surface};
use crate::system::{Beam, Field, Object, Wavelength};
use crate::{Aiming, OpticalSystem};

const WIDE_PX: f64 = 25.0 / 3.45e-3;
const GRID: KernelGrid = KernelGrid { focal_px: WIDE_PX, per_px: 4, half_px: 24 };

/// An objective without aberration.
fn clear(_: f64) -> [f64; WAVEFRONT_TERMS] {
    [0.0; WAVEFRONT_TERMS]
}

fn frame(reference: [f64; 2]) -> KernelFrame {
    KernelFrame { reference, roll_rad: 0.0 }
}

/// A pupil of 8 mm in the front focal plane of an ideal lens of 50 mm, the screen in the back one: the
/// camera sees every point at infinity without aberration.
fn ideal() -> OpticalSystem {
    let lens = Surface::new(Shape::IdealLens { focal_mm: 50.0 }, 50.0, Medium::Air);
    OpticalSystem {
        name: "ideal".into(),
        object: Object::Infinity,
        fields: vec![Field { at: [0.0; 2], weight: 1.0 }],
        wavelengths: vec![Wavelength { nm: 544.0, weight: 1.0 }],
        primary: 0,
        beam: Beam::EntrancePupil(8.0),
        stop: 0,
        surfaces: vec![
            Surface::new(Shape::PLANE, 50.0, Medium::Air),
            lens,
            Surface::new(Shape::PLANE, 0.0, Medium::Air),
        ],
        groups: Vec::new(),
        clear_fraction: 1.0,
        aiming: Aiming::Paraxial,
    }
}

/// Without aberration: Airy's pattern. Its peak is A / lambda^2 per unit of direction cosines, its first
/// dark ring lies at 1.21967 lambda / d.
#[test]
fn an_ideal_facility_shows_airys_pattern() {
    let imaging = Imaging::new(&ideal(), ImagingOptions::new([4.0, 4.0])).unwrap();
    assert!(imaging.errors().direction_rad < 1e-9, "{:?}", imaging.errors());
    let grid = KernelGrid { per_px: 8, half_px: 6, ..GRID };
    let nm = 600.0;
    let kernel = imaging.kernel([0.0; 2], &[(nm, 1.0)], 0.0, frame([0.0; 2]), grid, clear).unwrap();
    let middle = kernel.values[kernel.values.len() / 2];
    let area = PI * 16.0;
    let peak = area / (nm * 1e-6f64).powi(2) / WIDE_PX.powi(2);
    assert!((f64::from(middle) / peak - 1.0).abs() < 2e-3, "{middle} {peak}");
    let side = grid.side();
    let ring_px = 1.21967 * nm * 1e-6 / 8.0 * WIDE_PX;
    let at = |x: usize| f64::from(kernel.values[side / 2 * side + side / 2 + x]);
    let darkest = (1..8).min_by(|&a, &b| at(a).total_cmp(&at(b))).unwrap();
    assert!((darkest as f64 / 8.0 - ring_px).abs() < 0.07, "{darkest} {ring_px}");
    // About 2 / (pi v) of the light lies beyond a circle of v = pi d r / lambda, less beyond a square; the
    // mean over cells that the rim cuts scatters 0.7 % of it farther at this coarse a pupil.
    let v = PI * 8.0 / (nm * 1e-6) * 6.0 / WIDE_PX;
    assert!((0.5..1.3).contains(&(kernel.beyond / (2.0 / (PI * v)))), "{}", kernel.beyond);
}

/// The centroid of a diffraction image is the mean of grad V over the pupil, whatever the aberrations, and
/// its second moments contain those of the traced spot.
#[test]
fn the_image_has_the_spots_centroid_and_width() {
    let system = reference_wide();
    let imaging = Imaging::new(&system, ImagingOptions::new([8.2, 6.1])).unwrap();
    let errors = imaging.errors();
    // 0.02 arcsec, and a hundredth of a wave over the pupil's 9 mm.
    assert!(errors.direction_rms_rad < 1e-7 && errors.direction_rad < 1e-6, "{errors:?}");
    for screen in [[0.0, 0.0], [5.0, -3.0], [-7.8, 5.8]] {
        let wavefront = imaging.wavefront(screen, 544.0, 0.0);
        let reference = wavefront.reference_tangents();
        let mut kernel = imaging.kernel(screen, &[(544.0, 1.0)], 0.0, frame(reference), GRID, clear).unwrap();
        assert!((0.0..0.02).contains(&kernel.beyond), "{screen:?}: {}", kernel.beyond);
        let points = gaussian(12, 24, 0.0);
        let spot: Vec<[f64; 2]> = PupilSlopes::new(points.iter().map(|p| p.at))
            .directions(&wavefront)
            .into_iter()
            .map(|to| [0, 1].map(|k| (tangents(to)[k] - reference[k]) * WIDE_PX))
            .collect();
        let mean = [0, 1].map(|k| points.iter().zip(&spot).map(|(p, s)| p.weight * s[k]).sum::<f64>());
        let centroid = tangents(wavefront.centroid());
        for k in 0..2 {
            assert!(((centroid[k] - reference[k]) * WIDE_PX - mean[k]).abs() < 2e-3, "{centroid:?} {mean:?}");
        }
        let got = kernel.centroid_px();
        assert!((got[0] - mean[0]).hypot(got[1] - mean[1]) < 0.02, "{screen:?}: {got:?} {mean:?}");
        // A camera turned by a right angle sees the image turned: +x of the facility is +y of its own, for
        // (x, y) -> (-y, x).
        let turned = KernelFrame { reference, roll_rad: std::f64::consts::FRAC_PI_2 };
        let turned = imaging.kernel(screen, &[(544.0, 1.0)], 0.0, turned, GRID, clear).unwrap();
        let (side, peak) = (GRID.side(), kernel.values.iter().copied().fold(0.0, f32::max));
        for (x, y) in [(0, 0), (40, -17), (-23, 60)] {
            let at = |x: i32, y: i32| ((side as i32 / 2 + y) * side as i32 + side as i32 / 2 + x) as usize;
            assert!((turned.values[at(-y, x)] - kernel.values[at(x, y)]).abs() < 2e-3 * peak);
        }
        // A pixel's box keeps the light.
        let before = 1.0 - kernel.beyond;
        kernel.spread([1.0, 1.0]);
        assert!((kernel.energy() - before).abs() < 3e-3, "{} {before}", kernel.energy());
    }
}

/// Two tables of one system, made independently in the two directions of light: lines of sight agree.
#[test]
fn both_directions_of_light_agree() {
    let system = reference_wide();
    let imaging = Imaging::new(&system, ImagingOptions::new([8.2, 6.1])).unwrap();
    let options = super::super::FacilityOptions {
        transmission_intervals: 4,
        ..super::super::FacilityOptions::new([0.142, 0.107], 1.0)
    };
    let facility = super::super::FacilityOptics::new(&system, options).unwrap();
    for screen in [[0.0, 0.0], [5.0, -3.0], [-7.3, 5.5]] {
        // The chief ray of either: the spot's centroid differs by coma, in the two directions alike to 2 %
        // of the spot.
        let los = facility.line_of_sight(screen, 1).unwrap();
        let wavefront = imaging.wavefront(screen, 544.0, 0.0);
        let points = gaussian(12, 24, 0.0);
        let rays = PupilSlopes::new(points.iter().map(|p| p.at)).directions(&wavefront);
        let weighted = |k: usize| points.iter().zip(&rays).map(move |(p, to)| p.weight * tangents(*to)[k]);
        let mean = [0, 1].map(|k| weighted(k).sum::<f64>());
        let miss = (los[0] - mean[0]).hypot(los[1] - mean[1]);
        let spot: SpotMoments = facility.spot(los, 1, 0.0);
        assert!(miss < 0.05 * spot.rms_mm() / 55.4, "{screen:?}: {miss} {}", spot.rms_mm() / 55.4);
    }
}

/// A cut pupil passes as much as its open share.
#[test]
fn apertures_cut_the_image() {
    let mut system = reference_wide();
    system.clear_fraction = 0.8;
    let imaging = Imaging::new(&system, ImagingOptions::new([8.2, 6.1])).unwrap();
    let screen = [7.7, 5.7];
    let wavefront = imaging.wavefront(screen, 544.0, 0.0);
    let mask = imaging.pupil_mask(&wavefront, 544.0, 256).unwrap().unwrap();
    let open = |x: usize, y: usize| {
        let at = |i: usize| 2.0 * (i as f64 + 0.5) / 256.0 - 1.0;
        at(x).hypot(at(y)) < 1.0
    };
    let inside: Vec<bool> = (0..256 * 256).filter(|i| open(i % 256, i / 256)).map(|i| mask[i]).collect();
    let share = inside.iter().filter(|passes| **passes).count() as f64 / inside.len() as f64;
    assert!(share < 0.97, "{share}");
    let reference = wavefront.reference_tangents();
    let kernel = imaging.kernel(screen, &[(544.0, 1.0)], 0.0, frame(reference), GRID, clear).unwrap();
    let on_grid: f64 = kernel.values.iter().map(|v| f64::from(*v)).sum::<f64>() / 16.0;
    assert!((on_grid + kernel.beyond - share).abs() < 0.01, "{on_grid} {share}");
}

/// The pupil's own aperture cuts none of the rays that pass through its rim, whatever rounding makes of them: a facility
/// that overfills the camera loses nothing.
#[test]
fn the_pupils_rim_cuts_nothing_of_an_overfilled_camera() {
    let imaging = Imaging::new(&reference_wide(), ImagingOptions::new([8.0, 5.0])).unwrap();
    for (nm, y) in [(450.0, 0.0), (475.0, 1.0), (544.0, 2.0), (605.0, -1.5), (640.0, 0.5)] {
        let wavefront = imaging.wavefront([0.3 * y, y], nm, 0.0);
        assert!(imaging.pupil_mask(&wavefront, nm, 96).unwrap().is_none(), "{nm} nm");
    }
}
