//! The noise of images whose values are few, or alike.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Imager, add_spot, random};
use retina_image::{Background, CameraImage, DetectOptions, detect_points};

const WIDTH: usize = 512;

fn sky(read_noise_dn: f64, stars: usize) -> CameraImage {
    let mut plane = vec![0.0; WIDTH * 384];
    for k in 0..stars {
        add_spot(
            &mut plane,
            WIDTH,
            [40.3 + 43.0 * (k % 11) as f64, 50.7 + 60.0 * (k / 11) as f64],
            200.0,
            1.3,
        );
    }
    // Between two digital numbers: most pixels are 13.
    Imager { read_noise_dn, gain_e_per_dn: 0.0, ground_dn: [13.2, 0.0, 0.0] }.expose(
        &plane,
        WIDTH,
        &mut random(8),
    )
}

#[test]
fn a_sky_of_two_values_has_the_noise_of_rounding() {
    for read_noise_dn in [0.0, 0.1, 0.15, 0.2, 0.3] {
        let image = sky(read_noise_dn, 55);
        let noise = Background::estimate(&image, 64).median_dn()[1];
        assert!((0.28..0.6).contains(&noise), "{read_noise_dn}: {noise}");
        let found = detect_points(&image, &DetectOptions::default()).points.len();
        assert!((55..=70).contains(&found), "{read_noise_dn}: {found}");
    }
}

#[test]
fn neighbours_that_err_alike_are_no_points() {
    // Means over 3 x 3: the sums' noise is 2.1 times that of independent pixels of the same scatter.
    let of = |image: &CameraImage| {
        let mut out = image.clone();
        for y in 1..383 {
            for x in 1..WIDTH - 1 {
                let near = (y - 1..=y + 1).flat_map(|r| (x - 1..=x + 1).map(move |c| [c, r]));
                out.values[y * WIDTH + x] = near.map(|[c, r]| image.at(c, r)).sum::<f32>() / 9.0;
            }
        }
        out
    };
    let (sharp, smooth) = (sky(6.0, 0), of(&sky(6.0, 0)));
    assert_eq!(Background::estimate(&sharp, 64).alike(), 1.0);
    let alike = Background::estimate(&smooth, 64).alike();
    assert!((1.9..2.4).contains(&alike), "{alike}");
    assert!(detect_points(&smooth, &DetectOptions::default()).points.len() <= 2);
}
