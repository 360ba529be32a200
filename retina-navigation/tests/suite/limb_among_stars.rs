//! The Moon among stars in one image: attitude, focal length and the camera's place together.

use crate::common::{Disc, add_noise, distance_squared};
use glam::{DMat3, DQuat, DVec2, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use retina_geometry::{Pinhole, limb_ellipse};
use retina_image::{CameraImage, Exif};
use retina_navigation::cameras::{ImageSolver, ImageSolverOptions, KnownCamera};
use retina_navigation::limb::{AmongStars, KnownBody, LimbCamera, LimbQuestion, StarsEpoch};
use retina_navigation::synthetic::sources;
use retina_sky::ephemeris::{Ephemeris, LIGHT_SPEED_M_S};
use retina_sky::observer::{Observer, aberrated};
use retina_sky::planets::Planet;

const SIZE: [u32; 2] = [1024, 768];
const FOCAL_PX: f64 = 4200.0;
const TDB_S: f64 = 27.0 * 365.25 * 86_400.0;
const RADIUS_M: f64 = 1_737_400.0;

struct Scene {
    image: CameraImage,
    camera_from_inertial: DQuat,
    /// Relative to the Moon, and to where it was when the light left it, ICRF, m.
    from_body_m: DVec3,
    from_earlier_m: DVec3,
    barycentric_m: DVec3,
}

/// The camera at `offset` from the Moon (unit vector), 40 000 km away, the Moon beside the middle of the field.
fn scene(offset: DVec3, roll: f64, seed: u64) -> Scene {
    let ephemeris = Ephemeris::analytic();
    let bodies = ephemeris.solar_system(TDB_S).unwrap();
    let from_earlier_m = offset.normalize() * 4e7;
    // The light left 0.13 s ago; the camera moves by 1.5 km/s relative to the Moon.
    let light_s = from_earlier_m.length() / LIGHT_SPEED_M_S;
    let from_body_m = from_earlier_m - bodies.moon.velocity_m_s * light_s;
    let barycentric_m = bodies.moon.position_m + from_body_m;
    let velocity_m_s = bodies.moon.velocity_m_s + DVec3::new(1000.0, -800.0, 800.0);
    let direction = aberrated(-from_earlier_m.normalize(), velocity_m_s / LIGHT_SPEED_M_S);
    let pinhole = Pinhole::centred(FOCAL_PX, SIZE);
    let off = DQuat::from_rotation_arc(
        DVec3::Z,
        pinhole.line_of_sight(DVec2::new(430.0, 330.0)).extend(1.0).normalize(),
    );
    let camera_from_inertial =
        off * DQuat::from_rotation_z(roll) * DQuat::from_rotation_arc(direction, DVec3::Z);
    let observer = Observer::new(&ephemeris, TDB_S, barycentric_m, Some(velocity_m_s)).unwrap();

    let seen_m = camera_from_inertial * direction * from_earlier_m.length();
    let limb = limb_ellipse(&pinhole, seen_m, DMat3::IDENTITY, DVec3::splat(RADIUS_M)).unwrap();
    let to_sun = camera_from_inertial * (bodies.sun.position_m - bodies.moon.position_m).normalize();
    let along = seen_m.normalize();
    let across = (to_sun - along * to_sun.dot(along)).truncate();
    let disc = Disc {
        limb,
        phase_rad: (-along).dot(to_sun).acos(),
        sun_rad: (across.to_angle() - limb.angle_rad).rem_euclid(std::f64::consts::TAU),
        light_dn: 2500.0,
        psf_px: 0.9,
        shading: 0.0,
        lambert: false,
    };
    let mut image = disc.draw(SIZE);
    for source in sources(&observer, camera_from_inertial, &pinhole, 7.5).unwrap() {
        let at = pinhole.pixel(source.line_of_sight);
        // The Moon is among the sources, and stars behind it are hidden.
        if at.distance(limb.center_px) < limb.semi_axes_px[0] {
            continue;
        }
        let light = 30_000.0 * 10f64.powf(0.4 * (3.0 - source.magnitude));
        for y in (at.y - 8.0).max(0.0) as u32..((at.y + 8.0).max(0.0) as u32).min(SIZE[1]) {
            for x in (at.x - 8.0).max(0.0) as u32..((at.x + 8.0).max(0.0) as u32).min(SIZE[0]) {
                let r2 = (DVec2::new(f64::from(x), f64::from(y)) + 0.5 - at).length_squared();
                let share = (-0.5 * r2 / 0.81).exp() / (std::f64::consts::TAU * 0.81);
                image.values[(y * SIZE[0] + x) as usize] += (light * share) as f32;
            }
        }
    }
    add_noise(&mut image, 3.0, &mut ChaCha8Rng::seed_from_u64(seed));
    Scene { image, camera_from_inertial, from_body_m, from_earlier_m, barycentric_m }
}

/// Asked with a focal length that is wrong by 1 %.
fn ask(scene: &Scene, with_time: bool) -> (AmongStars, Vec<String>) {
    let pinhole = Pinhole::centred(1.01 * FOCAL_PX, SIZE);
    let question = LimbQuestion {
        camera: LimbCamera::pinhole(pinhole),
        focal_sigma_share: 0.02,
        body: KnownBody::planet(Planet::Moon, None).unwrap().with_given_limb(Some(0.0), Some(0.0)),
        sun_angle_rad: None,
        phase_rad: None,
        expected: None,
        tone_sigma_share: 0.0,
    };
    let field = 2.0 * (0.5 * f64::from(SIZE[0]) / pinhole.fx_px).atan();
    let options = ImageSolverOptions { tdb_s: with_time.then_some(TDB_S), ..ImageSolverOptions::default() };
    let mut solver = ImageSolver::new(KnownCamera::Field([field; 2]), options);
    let ephemeris = Ephemeris::analytic();
    let epoch = with_time.then_some(StarsEpoch { tdb_s: TDB_S, ephemeris: &ephemeris });
    let mut notes = Vec::new();
    let found = question
        .solve_among_stars(&scene.image, &Exif::default(), None, &mut solver, epoch, &mut notes)
        .unwrap();
    (found, notes)
}

#[test]
fn the_place_is_found_within_its_covariance() {
    let mut sum = 0.0;
    let offsets = [DVec3::new(0.3, -1.0, 0.2), DVec3::new(-1.0, 0.4, 0.5), DVec3::new(0.2, 0.9, -0.4)];
    for (k, offset) in offsets.into_iter().enumerate() {
        let scene = scene(offset, 0.7 * k as f64, k as u64);
        let (found, notes) = ask(&scene, true);
        assert!(notes.is_empty(), "{notes:?}");
        let place =
            found.place.unwrap_or_else(|| panic!("{:?} {:?}", found.answer.sight, found.stars.solution));
        let error_m = place.from_body_m - scene.from_body_m;
        let nees = distance_squared(place.covariance_m2, error_m);
        let stars = found.stars.solution.as_ref().unwrap();
        let turned = stars.camera_from_inertial().angle_between(scene.camera_from_inertial);
        println!(
            "off by {:.1} km (sigma {:.1}), NEES {nees:.2}, attitude {:.2} arcsec, {} stars, focal length {:.2} px",
            1e-3 * error_m.length(),
            1e-3 * place.sigma_m().length(),
            turned.to_degrees() * 3600.0,
            stars.matches.len(),
            found.stars.focal_px().unwrap()
        );
        // A focal length 1 % wrong would be 400 km of range.
        assert!(error_m.length() < 40e3, "{error_m}");
        sum += nees;
        let barycentric_m = place.barycentric_m.unwrap();
        assert!((barycentric_m - scene.barycentric_m - error_m).length() < 100.0);
    }
    // 99.9 % of chi-square with 9 degrees of freedom.
    assert!(sum < 27.9, "{sum}");
}

/// Aberration by 21 arcsec (the Moon's 30 km/s) would be 4 km here: stars and body share it.
#[test]
fn without_a_time_the_place_is_from_where_the_light_left() {
    let scene = scene(DVec3::new(0.3, -1.0, 0.2), 0.3, 7);
    let place = ask(&scene, false).0.place.unwrap();
    let across = |from: DVec3| from.normalize().cross(place.from_body_m).length();
    println!(
        "{:.2} km across, {:.2} from the other",
        1e-3 * across(scene.from_earlier_m),
        1e-3 * across(scene.from_body_m)
    );
    assert!(across(scene.from_earlier_m) < 500.0 && across(scene.from_body_m) > 1500.0);
    assert!(place.barycentric_m.is_none());
}

#[test]
fn without_stars_the_limb_stays_and_the_notes_say_why() {
    let mut scene = scene(DVec3::new(0.3, -1.0, 0.2), 0.3, 7);
    // A night without stars: only the disc is left.
    let center = DVec2::new(430.0, 330.0);
    for (k, value) in scene.image.values.iter_mut().enumerate() {
        let at = DVec2::new((k % 1024) as f64, (k / 1024) as f64);
        if at.distance(center) > 200.0 {
            *value = 60.0 + (k % 3) as f32;
        }
    }
    let (found, notes) = ask(&scene, true);
    assert!(found.answer.sight.is_ok() && found.place.is_none());
    assert!(notes.iter().any(|note| note.contains("no attitude by the stars")), "{notes:?}");
}
