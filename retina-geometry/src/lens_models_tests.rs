//! Closed forms, OpenCV's and mrcal's own pixels, finite differences.

use super::*;
use proptest::prelude::*;

const FOCAL_PX: DVec2 = DVec2::new(800.0, 810.0);
const CENTRE_PX: DVec2 = DVec2::new(640.0, 480.0);
/// As in validation/lens_models_opencv.py.
const DIRECTIONS: [[f64; 3]; 5] =
    [[0.1, -0.2, 1.0], [-0.7, 0.4, 1.0], [1.3, 0.9, 1.0], [2.0, -1.5, 1.0], [0.0, 0.0, 1.0]];

fn lens(model: LensModel) -> Lens {
    let mut out = Lens::new(model, FOCAL_PX, CENTRE_PX);
    match model {
        LensModel::KannalaBrandt => out.coefficients[..4].copy_from_slice(&[-0.02, 0.015, -0.006, 0.001]),
        LensModel::Rational => out.coefficients = [0.30, 0.05, 0.001, -0.002, 0.004, 0.65, 0.12, 0.01],
        _ => {}
    }
    out
}

#[test]
fn names_are_read_back() {
    for model in LensModel::ALL {
        assert_eq!(LensModel::of_name(model.name()), Some(model));
    }
    assert_eq!(LensModel::of_name("fisheye"), Some(LensModel::KannalaBrandt));
    assert_eq!(LensModel::of_name("fisheye:orthographic"), None);
}

/// Radii by hand at 40 and 100 degrees, at an azimuth of 30 degrees.
#[test]
fn radii_are_those_of_the_closed_forms() {
    for theta in [40.0f64.to_radians(), 100.0f64.to_radians()] {
        let azimuth = 30.0f64.to_radians();
        let across = DVec2::from_angle(azimuth) * theta.sin();
        // Of any length.
        let direction = DVec3::new(across.x, across.y, theta.cos()) * 3.7;
        let t = theta;
        let kannala_brandt = t - 0.02 * t.powi(3) + 0.015 * t.powi(5) - 0.006 * t.powi(7) + 0.001 * t.powi(9);
        for (model, radius) in [
            (LensModel::Equidistant, t),
            (LensModel::Equisolid, 2.0 * (0.5 * t).sin()),
            (LensModel::Stereographic, 2.0 * (0.5 * t).tan()),
            (LensModel::KannalaBrandt, kannala_brandt),
        ] {
            let px = lens(model).pixel(direction).unwrap();
            let expected = CENTRE_PX + FOCAL_PX * DVec2::from_angle(azimuth) * radius;
            assert!(px.distance(expected) < 1e-9, "{model:?}: {px} for {expected}");
        }
    }
    let px = lens(LensModel::Pinhole).pixel(DVec3::new(0.5, -0.25, 2.0)).unwrap();
    assert!(px.distance(CENTRE_PX + FOCAL_PX * DVec2::new(0.25, -0.125)) < 1e-12);
}

/// validation/lens_models_opencv.py prints these with OpenCV 5.0.0; stereographic: `mrcal.project` of mrcal 2.2, which
/// prints eight decimals.
#[test]
fn pixels_are_those_of_opencv_and_mrcal() {
    let fisheye = [
        [718.6318249559979, 320.77055446410435],
        [171.79581593967197, 750.8895636349041],
        [1295.6031092626858, 939.5525640889402],
        [1393.2073697531212, -91.96684640627643],
        [640.0, 480.0],
    ];
    let rational = [
        [718.486849836791, 320.9426290804983],
        [175.10796769191285, 748.8980329782505],
        [1258.3047079646017, 918.2366654867257],
        [1374.2071131047742, -80.06977651393777],
        [640.0, 480.0],
    ];
    let stereographic = [
        [719.02424511, 319.97590366],
        [149.74454029, 763.64780169],
        [1364.5294729, 987.86729398],
        [1506.60219063, -178.07603851],
        [640.0, 480.0],
    ];
    for (model, pixels, digits) in [
        (LensModel::KannalaBrandt, fisheye, 1e-9),
        (LensModel::Rational, rational, 1e-9),
        (LensModel::Stereographic, stereographic, 1e-8),
    ] {
        for (direction, px) in DIRECTIONS.iter().zip(pixels) {
            let own = lens(model).pixel(DVec3::from_array(*direction)).unwrap();
            assert!(own.distance(DVec2::from_array(px)) < digits, "{model:?}: {own} for {px:?}");
        }
    }
}

#[test]
fn what_has_no_image_is_refused() {
    let behind = DVec3::new(1.0, 0.0, 0.0);
    for model in [LensModel::Pinhole, LensModel::Rational] {
        assert_eq!(lens(model).pixel(behind), Err(OutOfDomain::BehindTangentPlane(model.name())));
    }
    for model in [LensModel::Equisolid, LensModel::Stereographic, LensModel::Equidistant] {
        assert!(lens(model).pixel(behind).is_ok());
        assert_eq!(lens(model).pixel(DVec3::NEG_Z), Err(OutOfDomain::Opposite));
        assert_eq!(lens(model).pixel(DVec3::ZERO), Err(OutOfDomain::Opposite));
    }
    let mut rational = Lens::new(LensModel::Rational, FOCAL_PX, CENTRE_PX);
    // 1 - r^2 / 4 is 0 at r = 2.
    rational.coefficients[5] = -0.25;
    assert!(rational.pixel(DVec3::new(1.99, 0.0, 1.0)).is_ok());
    assert_eq!(rational.pixel(DVec3::new(2.0, 0.0, 1.0)), Err(OutOfDomain::Denominator));
}

/// theta + k1 theta^3 turns where 1 + 3 k1 theta^2 = 0; r (1 + k1 r^2) where 1 + 3 k1 r^2 = 0.
#[test]
fn turning_points_are_found() {
    let mut bent = Lens::new(LensModel::KannalaBrandt, FOCAL_PX, CENTRE_PX);
    bent.coefficients[0] = -1.0 / 3.0;
    let at = bent.turning_angle_rad(1.5).unwrap();
    assert!((at - 1.0).abs() < 1.5 / 2000.0, "{at}");
    assert_eq!(bent.turning_angle_rad(0.99), None);
    let mut bent = Lens::new(LensModel::Rational, FOCAL_PX, CENTRE_PX);
    bent.coefficients[0] = -1.0 / 3.0;
    let at = bent.turning_angle_rad(1.2).unwrap();
    assert!((at - 1.0f64.atan()).abs() < 1.2 / 2000.0, "{at}");
    for model in [LensModel::Equidistant, LensModel::Equisolid, LensModel::Stereographic] {
        assert_eq!(lens(model).turning_angle_rad(3.0), None);
    }
}

proptest! {
    /// Derivatives against central differences, on the axis too.
    #[test]
    fn derivatives_are_those_of_differences(x in -1.5..1.5f64, y in -1.5..1.5f64, z in 0.6..1.4f64, on_axis in proptest::bool::weighted(0.1)) {
        let direction = if on_axis { DVec3::new(0.0, 0.0, z) } else { DVec3::new(x, y, z) };
        const STEP: f64 = 1e-6;
        for model in LensModel::ALL {
            let own = lens(model);
            let image = own.image(direction).unwrap();
            let close = |found: DVec2, expected: DVec2| {
                // Differences err by STEP^2 and by rounding over STEP; a r^9 makes derivatives large.
                (found - expected).length() < 1e-6 * (1.0 + expected.length())
            };
            for axis in 0..3 {
                let mut step = DVec3::ZERO;
                step[axis] = STEP;
                let at = |d: DVec3| own.image(d).unwrap().normalised;
                let difference = (at(direction + step) - at(direction - step)) / (2.0 * STEP);
                let found = DVec2::new(image.gradient[0][axis], image.gradient[1][axis]);
                prop_assert!(close(found, difference), "{model:?} {axis}: {found} for {difference}");
            }
            for k in 0..model.coefficient_names().len() {
                let at = |by: f64| {
                    let mut moved = own;
                    moved.coefficients[k] += by;
                    moved.image(direction).unwrap().normalised
                };
                let difference = (at(STEP) - at(-STEP)) / (2.0 * STEP);
                prop_assert!(close(image.by_coefficient[k], difference), "{model:?} {k}");
            }
        }
    }

    /// Away from tangential terms the image's radius and its slope are those of the radial law.
    #[test]
    fn the_radial_law_has_its_own_slope(theta in 0.05..1.2f64) {
        for model in LensModel::ALL {
            let mut own = lens(model);
            if model == LensModel::Rational {
                own.coefficients[2..4].fill(0.0);
            }
            let at = |t: f64| own.image(DVec3::new(t.sin(), 0.0, t.cos())).unwrap().normalised.x;
            let (radius, slope) = own.radius(theta);
            let difference = (at(theta + 1e-6) - at(theta - 1e-6)) / 2e-6;
            prop_assert!((radius - at(theta)).abs() < 1e-12 && (slope - difference).abs() < 1e-6 * (1.0 + slope));
        }
    }
}
