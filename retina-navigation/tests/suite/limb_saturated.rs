//! Limbs that are saturated in part: saturated pixels say "at least full scale" and no more.

use crate::common::{Disc, add_noise};
use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use rayon::prelude::*;
use retina_geometry::{LimbEllipse, Pinhole};
use retina_navigation::limb::{LimbBody, LimbCamera, LimbOptions, solve_limb};

const SIZE: [u32; 2] = [128, 128];
const DRAWS: u64 = 60;

/// The oracle is the same image of a camera with a greater full scale, where nothing is saturated.
#[test]
fn a_disc_with_a_third_of_its_limb_saturated_keeps_its_place() {
    let errors: Vec<[f64; 3]> = (0..DRAWS)
        .into_par_iter()
        .map(|seed| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut unit = || f64::from(random.next_u32()) / f64::from(u32::MAX);
            let limb = LimbEllipse {
                center_px: DVec2::new(62.0 + 4.0 * unit(), 62.0 + 4.0 * unit()),
                semi_axes_px: [32.0 + 4.0 * unit(); 2],
                angle_rad: 0.0,
            };
            // Full scale is 4095, the offset 60: the limb itself is at 0.7 of it, three pixels inside is above it.
            let (phase_rad, sun_rad) = (50f64.to_radians(), 6.0 * unit());
            let disc = Disc {
                limb,
                phase_rad,
                sun_rad,
                light_dn: 2900.0,
                psf_px: 0.85,
                shading: 1.3,
                lambert: false,
            };
            let mut whole = disc.draw(SIZE);
            whole.full_scale_dn = 65_535.0;
            add_noise(&mut whole, 6.0, &mut random);
            let mut clipped = whole.clone();
            clipped.full_scale_dn = 4095.0;
            clipped.values.iter_mut().for_each(|value| *value = value.min(4095.0));
            let full = clipped.values.iter().filter(|value| **value >= 4095.0).count();
            assert!(full > 300, "{full} saturated pixels");
            // Of a sphere so small in a camera so long the outline is the disc.
            let camera = LimbCamera::pinhole(Pinhole::centred(2.0e4, SIZE));
            let options =
                LimbOptions { sun_direction_px: Some(DVec2::from_angle(sun_rad)), ..LimbOptions::default() };
            let body = LimbBody::sphere(1.7374e6);
            let [all, some] =
                [&whole, &clipped].map(|image| solve_limb(image, &camera, &body, &options).unwrap());
            let off = some.ellipse.center_px - all.ellipse.center_px;
            let radius = some.radius_px[0] - all.radius_px[0];
            [off.dot(DVec2::from_angle(sun_rad)), radius, radius / some.radius_px[1]]
        })
        .collect();
    let mean = |k: usize| errors.iter().map(|e| e[k]).sum::<f64>() / DRAWS as f64;
    let square = errors.iter().map(|e| e[2] * e[2]).sum::<f64>() / DRAWS as f64;
    println!("bias towards the Sun {:.3} px, of the radius {:.3} px, chi^2 {square:.2}", mean(0), mean(1));
    assert!(mean(0).abs() < 0.05 && mean(1).abs() < 0.05, "{} {}", mean(0), mean(1));
    // 60 chi-squares of one degree: 99 % are below 1.47 on average (table 26.8, 88.38 / 60).
    assert!(square < 1.47, "{square}");
}
