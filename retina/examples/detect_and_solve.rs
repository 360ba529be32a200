//! Points of light in a camera image, and the attitude that they tell. The image is made here; `CameraImage::read` takes
//! one from a file.
//!
//! `cargo run --release -p retina --example detect_and_solve`

use std::error::Error;

use retina::glam::{DQuat, DVec2, DVec3};
use retina::navigation::synthetic::sources;
use retina::prelude::*;
use retina::sky::ephemeris::{ASTRONOMICAL_UNIT_M, Ephemeris};
use retina::sky::observer::Observer;

const SIZE_PX: [u32; 2] = [1024, 768];
/// Standard deviation of a spot, px, and light of a star of magnitude 0, DN.
const SPOT_PX: f64 = 1.2;
const LIGHT_V0_DN: f64 = 400_000.0;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let camera = StarCamera::from_field(16f64.to_radians(), SIZE_PX);
    let place = DVec3::X * ASTRONOMICAL_UNIT_M;
    let observer = Observer::new(&Ephemeris::analytic(), 8.0e8, place, None)?;
    let truth = DQuat::from_xyzw(0.3, -0.5, 0.2, 0.8).normalize();

    // Stars to magnitude 7 as Gaussian spots on a level of 100 DN with a fixed pattern for noise.
    let mut image = CameraImage::new(SIZE_PX[0], SIZE_PX[1], 4095.0);
    for (at, value) in image.values.iter_mut().enumerate() {
        *value = 100.0 + ((at * 7919) % 17) as f32;
    }
    for source in sources(&observer, truth, &camera.pinhole, 7.0)? {
        let at = camera.pinhole.pixel(source.line_of_sight);
        let light = LIGHT_V0_DN * 10f64.powf(-0.4 * source.magnitude)
            / (2.0 * std::f64::consts::PI * SPOT_PX * SPOT_PX);
        for y in (at.y as i64 - 6)..=(at.y as i64 + 6) {
            for x in (at.x as i64 - 6)..=(at.x as i64 + 6) {
                if (0..i64::from(SIZE_PX[0])).contains(&x) && (0..i64::from(SIZE_PX[1])).contains(&y) {
                    let off = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - at;
                    let value = &mut image.values[(y * i64::from(SIZE_PX[0]) + x) as usize];
                    let more = light * (-0.5 * off.length_squared() / (SPOT_PX * SPOT_PX)).exp();
                    *value = (*value + more as f32).min(4095.0);
                }
            }
        }
    }

    let found = detect_points(&image, &DetectOptions::default());
    let solver = StarSolver::new(&camera, SolverOptions::default());
    let solution = solver.solve(&camera.points(&found.points), Some(&observer))?;
    let [ra, dec, roll] = solution.ra_dec_roll_rad().map(f64::to_degrees);
    let boresight = |camera_from_inertial: DQuat| camera_from_inertial.inverse() * DVec3::Z;
    let error_rad = boresight(solution.camera_from_inertial()).angle_between(boresight(truth));
    println!(
        "{} points; right ascension {ra:.4} deg, declination {dec:.4} deg, roll {roll:.4} deg",
        found.points.len()
    );
    println!("boresight off by {:.2} arcsec", error_rad.to_degrees() * 3600.0);
    if error_rad.to_degrees() * 3600.0 > 10.0 {
        return Err("the attitude is wrong".into());
    }
    Ok(())
}
