//! What is no limb, or not enough of one, is refused by name.

use crate::common::{Disc, add_noise, draws};
use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use rayon::prelude::*;
use retina_geometry::{LimbEllipse, Pinhole};
use retina_image::CameraImage;
use retina_navigation::limb::{LimbBody, LimbCamera, LimbOptions, LimbSolution, Refusal, solve_limb};

const SIZE: [u32; 2] = [240, 200];

fn solve(image: &CameraImage) -> Result<LimbSolution, Refusal> {
    // So narrow a field that a sphere off the axis is a circle, as it is drawn here.
    let camera = LimbCamera::pinhole(Pinhole::centred(100_000.0, SIZE));
    solve_limb(image, &camera, &LimbBody::sphere(1.7374e6), &LimbOptions::default())
}

/// A disc with noise, or what the options make of it.
fn disc(center: [f64; 2], radius_px: f64, phase_deg: f64, light_dn: f64) -> CameraImage {
    let limb = LimbEllipse { center_px: center.into(), semi_axes_px: [radius_px; 2], angle_rad: 0.0 };
    let disc = Disc {
        limb,
        phase_rad: phase_deg.to_radians(),
        sun_rad: 0.4,
        light_dn,
        psf_px: 0.8,
        shading: 0.0,
        lambert: false,
    };
    let mut image = disc.draw(SIZE);
    add_noise(&mut image, 6.0, &mut ChaCha8Rng::seed_from_u64(3));
    image
}

#[test]
fn half_out_of_the_frame_is_solved_and_a_sliver_refused() {
    let solution = solve(&disc([2.0, 100.0], 70.0, 0.0, 2000.0)).unwrap();
    assert!((solution.ellipse.center_px - DVec2::new(2.0, 100.0)).length() < 0.1, "{:?}", solution.ellipse);
    let refusal = solve(&disc([-62.0, 100.0], 70.0, 0.0, 2000.0)).unwrap_err();
    assert!(["cut_by_frame", "no_body", "thin_crescent"].contains(&refusal.reason()), "{refusal}");
}

#[test]
fn thin_crescent_eclipse_and_saturation_are_refused() {
    let refusal = solve(&disc([120.0, 100.0], 70.0, 165.0, 2000.0)).unwrap_err();
    assert!(["thin_crescent", "no_body"].contains(&refusal.reason()), "{refusal}");
    assert_eq!(solve(&disc([120.0, 100.0], 70.0, 0.0, 0.0)).unwrap_err().reason(), "no_body");
    assert_eq!(solve(&disc([120.0, 100.0], 70.0, 0.0, 9000.0)).unwrap_err().reason(), "saturated");
}

/// Discs at 24 turns of an oblate outline or of a smear: what comes of each.
fn outcomes(change: impl Fn(f64) -> CameraImage) -> Vec<&'static str> {
    let outcomes = (0..24).map(|turn| solve(&change(f64::from(turn) * 0.26)));
    outcomes.map(|outcome| outcome.map_or_else(|refusal| refusal.reason(), |_| "solved")).collect()
}

#[test]
fn a_flattened_body_is_no_sphere() {
    let outline = |semi_axes_px: [f64; 2], angle_rad| {
        let limb = LimbEllipse { center_px: DVec2::new(120.0, 100.0), semi_axes_px, angle_rad };
        let disc = Disc {
            limb,
            phase_rad: 0.9,
            sun_rad: 0.4,
            light_dn: 2000.0,
            psf_px: 0.8,
            shading: 0.0,
            lambert: false,
        };
        let mut image = disc.draw(SIZE);
        add_noise(&mut image, 6.0, &mut ChaCha8Rng::seed_from_u64(3));
        image
    };
    assert_eq!(outcomes(|turn| outline([72.0, 68.0], turn)), ["other_outline"; 24]);
    assert_eq!(outcomes(|turn| outline([70.0, 70.0], turn)), ["solved"; 24]);
}

#[test]
fn a_smeared_limb_is_refused() {
    let sharp = disc([120.0, 100.0], 70.0, 50.0, 2000.0);
    let smeared = |length_px: f64, angle_rad: f64| {
        let mut image = sharp.clone();
        let steps: Vec<DVec2> =
            (-20..=20).map(|k| DVec2::from_angle(angle_rad) * (f64::from(k) * length_px / 40.0)).collect();
        for (k, value) in image.values.iter_mut().enumerate() {
            let at = DVec2::new((k % 240) as f64, (k / 240) as f64);
            let sum: f32 = steps
                .iter()
                .map(|step| {
                    let from = (at + step).round().clamp(DVec2::ZERO, DVec2::new(239.0, 199.0));
                    sharp.values[from.y as usize * 240 + from.x as usize]
                })
                .sum();
            *value = sum / steps.len() as f32;
        }
        image
    };
    // Where the lit arc shows too little of the sharp directions, what the smear makes of the outline is seen.
    let found = outcomes(|angle| smeared(8.0, angle));
    let named = found.iter().filter(|outcome| **outcome == "smeared").count();
    assert!(named >= 20 && !found.contains(&"solved"), "{found:?}");
    assert_eq!(outcomes(|angle| smeared(0.0, angle)), ["solved"; 24]);
}

/// Noise, stars of several widths up to 12 px, clouds, stripes.
fn without_body(seed: u64) -> CameraImage {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut unit = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let mut image = CameraImage::new(SIZE[0], SIZE[1], 4095.0);
    let spots = (unit() * 40.0) as usize;
    let spread = [1.2, 4.0, 12.0, 40.0][(seed % 4) as usize];
    for _ in 0..spots {
        let at = DVec2::new(unit() * 240.0, unit() * 200.0);
        let (width, light) = (0.8 + unit() * spread, 20.0 * 1000f64.powf(unit()));
        for (k, value) in image.values.iter_mut().enumerate() {
            let off = DVec2::new((k % 240) as f64 + 0.5, (k / 240) as f64 + 0.5) - at;
            *value += (light * (-0.5 * off.length_squared() / (width * width)).exp()) as f32;
        }
    }
    if seed.is_multiple_of(5) {
        let (edge, slope) = (unit() * 200.0, unit() - 0.5);
        for (k, value) in image.values.iter_mut().enumerate() {
            *value += if (k / 240) as f64 > edge + slope * (k % 240) as f64 { 900.0 } else { 0.0 };
        }
    }
    add_noise(&mut image, 1.0 + 30.0 * unit(), &mut random);
    image
}

#[test]
fn no_frame_without_a_body_is_accepted() {
    let accepted: Vec<u64> =
        (0..draws(500)).into_par_iter().filter(|&seed| solve(&without_body(seed)).is_ok()).collect();
    assert!(accepted.is_empty(), "{}: {:?}", accepted.len(), &accepted[..accepted.len().min(12)]);
}
