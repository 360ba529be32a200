//! What several tests need.

use std::path::Path;

use retina_geometry::Setup;

/// A setup whose display has this size.
pub(crate) fn setup(size_px: [u32; 2]) -> Setup {
    let [width, height] = size_px;
    let text = format!(
        "schema = \"retina.setup/1\"\nname = \"small\"\n[screen]\nwidth_px = {width}\nheight_px = {height}\nwidth_mm = 10\n\
         height_mm = 10\nbits = 8\n[camera]\nwidth_px = 64\nheight_px = 48\npixel_um = 5\nfocal_mm = 10\nf_number = 2\n\
         bits = 12\n[facility]\nobserved_rows_px = {height}\n"
    );
    Setup::parse(&text, Path::new("small.toml")).unwrap()
}
