//! The `setup.toml` of a design, schema `retina.setup/1`.

use std::fmt::Write as _;

use super::{BenchDesign, Camera, Screen};

/// The setup as TOML text: screen, camera and eq. 13's n_v; the distances stand in comments, for the one
/// who sets up the bench. `camera_bits` is the depth of the camera's digital numbers.
pub fn setup_toml(
    name: &str,
    design: &BenchDesign,
    camera: &Camera,
    screen: &Screen,
    camera_bits: u32,
) -> String {
    let layout = &design.layout;
    let quoted = name.replace('\\', "\\\\").replace('"', "\\\"");
    let mut text = String::new();
    // Writing into a String cannot fail.
    let _ = write!(
        text,
        "# M = {:.4}, camera and screen matched by {}; distances between principal planes in mm: screen to relay {:.3}, relay to intermediate image\n\
         # {:.3}, relay to collimator {:.3}, screen to collimator {:.3}, camera pupil to collimator {:.3}.\n\
         schema = \"retina.setup/1\"\n\
         name = \"{quoted}\"\n\n\
         [screen]\nwidth_px = {}\nheight_px = {}\nwidth_mm = {:?}\nheight_mm = {:?}\nbits = 8\n\
         wavelength_nm = {{ r = 605.0, g = 544.0, b = 475.0 }}\n\n\
         [camera]\nwidth_px = {}\nheight_px = {}\npixel_um = {:?}\nfocal_mm = {:?}\nf_number = {:?}\nbits = {camera_bits}\n\n\
         [facility]\nobserved_rows_px = {:?}\n",
        layout.magnification,
        design.match_by.words(),
        layout.screen_relay_mm,
        layout.relay_image_mm,
        layout.inter_lens_mm,
        layout.total_length_mm,
        design.pupil_collimator_mm,
        screen.width_px,
        screen.height_px,
        screen.width_mm,
        screen.height_mm,
        camera.width_px,
        camera.height_px,
        camera.pixel_um,
        camera.focal_mm,
        camera.f_number,
        design.observed_rows_px,
    );
    text
}
