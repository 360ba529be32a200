//! A real photograph of the Moon by the facility's camera model, where its folder is at hand.

use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use retina_geometry::Pinhole;
use retina_image::{CameraImage, ReadOptions};
use retina_navigation::limb::{LimbBody, LimbCamera, LimbOptions, LimbPoint, LimbSolution, solve_limb};

/// By the ephemeris for a focal length of 25 mm (capture.toml, DE421).
const RADIUS_PX: f64 = 33.78;
/// The focal length is nominal: lenses of this kind are off by half a per cent and more.
const FOCAL_SIGMA: f64 = 0.005;

fn photograph() -> Option<CameraImage> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/real/moon_25mm");
    if !folder.is_dir() {
        println!("skipped: the photograph is not at {}", folder.display());
        return None;
    }
    Some(CameraImage::read(&folder.join("photo.png"), ReadOptions::default()).unwrap())
}

fn solve(image: &CameraImage) -> LimbSolution {
    let camera = LimbCamera::pinhole(Pinhole::centred(25.0e3 / 3.45, [2048, 1536]));
    solve_limb(image, &camera, &LimbBody::sphere(1_737_400.0), &LimbOptions::default()).unwrap()
}

/// More than a third of the pixels inside the limb are at full scale.
#[test]
fn the_radius_is_the_ephemeris() {
    let Some(image) = photograph() else { return };
    let solution = solve(&image);
    let [radius, own_sigma] = solution.radius_px;
    let sigma = own_sigma.hypot(FOCAL_SIGMA * RADIUS_PX);
    println!(
        "radius {radius:.3} px +- {own_sigma:.3} (fit) +- {:.3} (focal length)",
        FOCAL_SIGMA * RADIUS_PX
    );
    println!("blur {:.2} px, {} points", solution.blur_sigma_px, solution.points.len());
    assert!(sigma < 0.3, "{sigma}");
    assert!((radius - RADIUS_PX).abs() < 2.0 * sigma, "{radius} +- {sigma}");
}

/// A circle of known radius about points: its centre, by Gauss-Newton with the points' weights.
fn center(points: &[&LimbPoint], radius: f64, start: DVec2) -> DVec2 {
    let mut at = start;
    for _ in 0..20 {
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for point in points {
            let off = point.pixel - at;
            let row = (off / off.length()).extend(0.0);
            let weight = 1.0 / (point.sigma_px.powi(2) + 0.01);
            normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z) * weight;
            right += row * (weight * (off.length() - radius));
        }
        normal.z_axis.z = 1.0;
        at += (normal.inverse() * right).truncate();
    }
    at
}

#[test]
fn the_centre_repeats_when_points_are_left_out_and_when_the_image_is_shifted() {
    let Some(image) = photograph() else { return };
    let whole = solve(&image);
    // Half of the limb's points, drawn at random.
    let points: Vec<&LimbPoint> = whole.points.iter().filter(|point| point.used).collect();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let centers: Vec<DVec2> = (0..200)
        .map(|_| {
            let mut left = points.clone();
            while left.len() > points.len() / 2 {
                left.swap_remove(random.next_u32() as usize % left.len());
            }
            center(&left, whole.radius_px[0], whole.ellipse.center_px)
        })
        .collect();
    let mean = centers.iter().sum::<DVec2>() / 200.0;
    let spread = (centers.iter().map(|c| (*c - mean).length_squared()).sum::<f64>() / 400.0).sqrt();
    println!("centre {mean:.2}, {spread:.3} px per axis over halves of {} points", points.len());
    assert!(spread < 0.1, "{spread}");
    // Whole pixels move everything exactly; the tiles that the sky is found with, and the search, are others.
    let width = image.width_px as usize;
    let mut offs = vec![DVec2::ZERO];
    for (dx, dy) in [(1usize, 0usize), (0, 1), (2, 2), (3, 2), (1, 3), (4, 1), (5, 6), (7, 5), (6, 0), (0, 7)]
    {
        let mut moved = image.clone();
        for row in (dy..image.height_px as usize).rev() {
            for column in (dx..width).rev() {
                moved.values[row * width + column] = image.at(column - dx, row - dy);
            }
        }
        let off =
            solve(&moved).ellipse.center_px - whole.ellipse.center_px - DVec2::new(dx as f64, dy as f64);
        println!("shifted by ({dx}, {dy}): {off:.3}");
        offs.push(off);
    }
    let mean = offs.iter().sum::<DVec2>() / offs.len() as f64;
    let square = offs.iter().map(|off| (*off - mean) * (*off - mean)).sum::<DVec2>() / offs.len() as f64;
    println!("standard deviation over shifts {:.3}, {:.3} px", square.x.sqrt(), square.y.sqrt());
    assert!(square.max_element().sqrt() < 0.1, "{square}");
}
