//! A Moon as the narrow configuration's screen would show it, rendered on the CPU.
//!
//! `cargo run --release -p retina --example render_a_frame [BODY.glb] [OUT.pgm]`

use std::error::Error;
use std::path::PathBuf;

use retina::glam::{DMat3, DVec3};
use retina::model::load_body;
use retina::prelude::*;
use retina::radiometry::{AU_M, LunarLambert, PhaseFunction};

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1).filter(|text| !text.starts_with("--")).map(PathBuf::from);
    let own = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../assets/bodies/moon.glb");
    let mut shape = load_body(&arguments.next().filter(|path| path.exists()).unwrap_or(own))?;
    shape.smooth_normals();

    let law = LunarLambert { decay_rad: 60f64.to_radians() };
    let photometry = Photometry::new(law, PhaseFunction::CONSTANT, Some(0.12));
    let moon = BodyModel { name: "moon".into(), shape, photometry };

    // 60 000 km away, the Sun at the right: K_f of the setup, every eighth pixel to be quick.
    let setup = Setup::parse(retina::assets::NARROW_FOV_SETUP, "narrow-fov.toml".as_ref())?;
    let k_f = setup.facility_pinhole();
    let image = Pinhole {
        fx_px: k_f.fx_px / 8.0,
        fy_px: k_f.fy_px / 8.0,
        cx_px: k_f.cx_px / 8.0,
        cy_px: k_f.cy_px / 8.0,
        width_px: k_f.width_px / 8,
        height_px: k_f.height_px / 8,
    };
    let state = BodyState {
        position_camera_m: DVec3::new(0.0, 0.0, 6e7),
        camera_from_body: DMat3::IDENTITY,
        sun_position_body_m: DVec3::new(1.0, 0.0, -1.0).normalize() * AU_M,
    };
    let renderer = CpuRenderer::new(vec![moon], Quality::Draft.into(), Planes::Radiance);
    let radiance = renderer.render(&FrameState { image, distortion: None, bodies: vec![state] });

    let brightest = radiance.radiance().iter().copied().fold(0.0, f32::max);
    let lit = radiance.radiance().iter().filter(|value| **value > 0.0).count();
    println!(
        "{lit} of {} pixels are lit, the brightest is {brightest:.3e} W m^-2 sr^-1 nm^-1",
        image.width_px * image.height_px
    );
    if let Some(out) = arguments.next() {
        let mut pgm = format!("P5\n{} {}\n255\n", image.width_px, image.height_px).into_bytes();
        pgm.extend(radiance.radiance().iter().map(|value| (255.0 * value / brightest) as u8));
        std::fs::write(&out, pgm)?;
        println!("{}", out.display());
    }
    Ok(())
}
