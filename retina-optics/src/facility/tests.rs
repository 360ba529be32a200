use super::*;
use crate::analysis::{SpotOptions, spots};
use crate::constraints::BenchLimits;
use crate::design::{BenchLenses, Camera, MatchBy, Screen, bench_design};
use crate::search::{Configuration, Element, GroupDesign};
use crate::system::Field;

/// The reference design of s_cam = 1.3 f_c.
fn design() -> FacilityDesign {
    let group = |lenses: &[(&str, bool)], gaps_mm: &[f64]| GroupDesign {
        elements: lenses
            .iter()
            .map(|&(part, reversed)| Element { part: part.to_owned(), reversed })
            .collect(),
        gaps_mm: gaps_mm.to_vec(),
    };
    FacilityDesign {
        collimator: group(
            &[("AC508-250-A", true), ("AC508-750-A", false), ("AC508-150-A", false)],
            &[8.0, 1.6801669819842857],
        ),
        relay: group(&[("AC508-180-A", true), ("AC508-150-A", false)], &[2.175024303956519]),
    }
}

const HALF_FIELD: [f64; 2] = [0.142, 0.107];

/// Its wide configuration as a traced system.
pub(super) fn reference_wide() -> crate::OpticalSystem {
    evaluate(&design(), &SearchRequest::paper(1.3), ScreenFocus::Best).unwrap().1.swap_remove(0)
}

fn wide() -> FacilityOptics {
    let request = SearchRequest::paper(1.3);
    let options = FacilityOptions { transmission_intervals: 24, ..FacilityOptions::new(HALF_FIELD, 0.99) };
    FacilityOptics::of_design(&design(), &request, 0, options).unwrap()
}

/// The errors that the tables state hold at places of our own, by the analysis of spots.
#[test]
fn tables_agree_with_the_traced_system() {
    let optics = wide();
    let errors = optics.errors();
    assert!(errors.position_mm < 1e-7 && errors.spot_mm < 1e-4, "{errors:?}");
    for los in [[0.0, 0.0], [0.0712, -0.033], [-0.1414, 0.1061]] {
        for defocus_mm in [0.0, 0.4] {
            let mut system = optics.system().clone();
            let last = system.image() - 1;
            system.surfaces[last].thickness_mm += defocus_mm;
            system.fields = vec![Field { at: los, weight: 1.0 }];
            let options = SpotOptions { rings: 8, arms: 16, clipping: Clipping::Off };
            let spot = &spots(&system, &options).unwrap().fields[0];
            for (wavelength, expected) in spot.wavelengths.iter().enumerate() {
                let rms_um = optics.spot(los, wavelength, defocus_mm).rms_mm() * 1e3;
                assert!((rms_um - expected.rms_um).abs() < 2e-3 * expected.rms_um, "{rms_um} {expected:?}");
                if defocus_mm == 0.0 {
                    let got = optics.screen_mm(los, wavelength);
                    let miss = (got[0] + expected.centroid_mm[0]).hypot(got[1] + expected.centroid_mm[1]);
                    assert!(miss < 1e-6, "{los:?}: {got:?} {:?}", expected.centroid_mm);
                }
            }
        }
    }
}

/// Two other programs traced the chief ray of the wide corner (tan 0.176639) to 10.97073 mm on the paraxial
/// screen; the centroid differs from it by coma, less than the distortion of
/// 0.65 % (0.07 mm) that the figure holds.
#[test]
fn distortion_is_that_of_the_reference() {
    let (_, systems) = evaluate(&design(), &SearchRequest::paper(1.3), ScreenFocus::Defocus(0.0)).unwrap();
    let options = FacilityOptions { transmission_intervals: 4, ..FacilityOptions::new(HALF_FIELD, 1.0) };
    let optics = FacilityOptics::new(&systems[0], options).unwrap();
    let corner = optics.screen_mm([0.8 * 0.1766392, 0.6 * 0.1766392], 1);
    let radius = corner[0].hypot(corner[1]);
    assert!(corner[0] > 0.0 && (radius - 10.97073).abs() < 0.03, "{radius} {corner:?}");
}

/// A centred system is a body of revolution: turning the line of sight turns the point.
#[test]
fn an_aligned_facility_is_symmetric_and_its_inverse_is_its_inverse() {
    let optics = wide();
    let at = |angle: f64| optics.screen_mm([0.1 * angle.cos(), 0.1 * angle.sin()], 1);
    let first = at(0.0);
    for angle in [0.3, 1.2, 2.0, 4.4] {
        let got = at(angle);
        let expected = [first[0] * angle.cos(), first[0] * angle.sin()];
        assert!((got[0] - expected[0]).hypot(got[1] - expected[1]) < 1e-6, "{got:?} {expected:?}");
    }
    for los in [[0.0, 0.0], [0.12, -0.1], [-0.03, 0.05], [0.142, 0.107]] {
        let back = optics.line_of_sight(optics.screen_mm(los, 2), 2);
        if los[0] < 0.142 {
            let back = back.unwrap();
            assert!((back[0] - los[0]).hypot(back[1] - los[1]) < 1e-13, "{los:?} {back:?}");
        }
    }
    assert_eq!(optics.line_of_sight([30.0, 0.0], 1), None);
}

/// Ten surfaces between air and glass; nothing is cut on the axis.
#[test]
fn transmission_counts_surfaces_and_apertures() {
    let optics = wide();
    assert!((optics.transmission([0.0; 2], 1) - 0.99f64.powi(10)).abs() < 1e-12);
    let mut system = optics.system().clone();
    system.clear_fraction = 0.8;
    let options = FacilityOptions { transmission_intervals: 48, ..FacilityOptions::new(HALF_FIELD, 1.0) };
    let cut = FacilityOptics::new(&system, options).unwrap();
    assert!(cut.errors().transmission < 0.01, "{:?}", cut.errors());
    let los = [0.141, 0.106];
    system.fields = vec![Field { at: los, weight: 1.0 }];
    let spot =
        &spots(&system, &SpotOptions { rings: 40, arms: 80, clipping: Clipping::On }).unwrap().fields[0];
    let got = (0..3).map(|w| cut.transmission(los, w)).sum::<f64>() / 3.0;
    assert!(spot.vignetted_fraction > 0.03, "{}", spot.vignetted_fraction);
    assert!((got - (1.0 - spot.vignetted_fraction)).abs() < 0.02, "{got} {}", spot.vignetted_fraction);
}

/// By height (eq. 13) the same lenses stand elsewhere, and the focal length is f_c / 1.566, less the 0.7 %
/// by which the best focus lies before the paraxial image.
#[test]
fn a_design_is_refitted_at_the_magnification_of_eq_13() {
    let camera = Camera { width_px: 2048, height_px: 1536, pixel_um: 3.45, focal_mm: 25.0, f_number: 2.8 };
    let lenses = BenchLenses {
        collimator_focal_mm: 86.8,
        relay_focal_mm: 82.8,
        diameter_mm: 50.8,
        pupil_collimator_mm: 1.3 * 86.8,
    };
    let bench = bench_design(&camera, &Screen::PAPER, &lenses, &BenchLimits::PAPER, MatchBy::Height);
    let mut request = SearchRequest::paper(1.3);
    request.configurations = vec![Configuration::of_camera("wide", &camera, bench.layout.magnification)];
    let options = FacilityOptions { transmission_intervals: 4, ..FacilityOptions::new(HALF_FIELD, 1.0) };
    let optics = FacilityOptics::of_design(&design(), &request, 0, options).unwrap();
    assert!((optics.focal_mm(1) - 86.8 / 1.566).abs() < 0.4, "{}", optics.focal_mm(1));
    let error = FacilityOptics::of_design(&design(), &request, 1, options).unwrap_err();
    assert!(error.to_string().contains("no configuration 1"), "{error}");
    for options in
        [FacilityOptions { nodes: 2, ..options }, FacilityOptions { surface_transmission: 0.0, ..options }]
    {
        assert!(FacilityOptics::of_design(&design(), &request, 0, options).is_err());
    }
}

/// The PSF is that of the stated defocus: away from the best focus, here by twice the depth of focus
/// 2 lambda N^2 = 0.1 mm and more, the peak falls on both sides.
#[test]
fn the_psf_follows_the_defocus() {
    let optics = wide();
    let peak = |defocus_mm| optics.psf([0.1, 0.05], 544.0, defocus_mm, [128, 256]).unwrap().peak();
    let at: Vec<f64> = (-8..=8).map(|i| peak(0.25 * f64::from(i))).collect();
    let best = (0..at.len()).max_by(|&a, &b| at[a].total_cmp(&at[b])).unwrap();
    assert!((1..16).contains(&best), "{at:?}");
    assert!(at[0] < 0.5 * at[best] && at[16] < 0.5 * at[best], "{at:?}");
    assert!(at.iter().all(|peak| (0.0..=1.001).contains(peak)), "a Strehl ratio: {at:?}");
}
