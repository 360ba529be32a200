//! Per-ray agreement with Optiland: frozen vectors, written by `validation/optics_optiland.py --write`.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::path::{Path, PathBuf};

use retina_files::Table;
use retina_optics::{Clipping, Launcher, Tracer, read_system, shipped_design};

/// The agreement asked for; rounding over sixteen surfaces and half a metre is a thousandth of it.
const TOLERANCE_MM: f64 = 1e-9;

#[test]
fn every_frozen_ray_is_met_again() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let table = Table::read(&folder.join("optiland_rays.csv")).unwrap();
    let mut worst = [0.0f64; 3];
    for row in 0..table.len() {
        let name = table.text(row, "system");
        let system = shipped_design(name)
            .unwrap_or_else(|| read_system(&folder.join(PathBuf::from(name).with_extension("toml")), &[]))
            .unwrap();
        let number = |column| table.number(row, column).unwrap();
        let ray = Launcher::new(&system)
            .unwrap()
            .ray([number("field_x"), number("field_y")], [number("pupil_x"), number("pupil_y")])
            .unwrap();
        let tracer = Tracer::new(&system, number("wavelength_nm"), Clipping::Off).unwrap();
        let hit = tracer.trace_to_image(&ray).unwrap();
        let position = (hit.local_mm.x - number("x_mm")).abs().max((hit.local_mm.y - number("y_mm")).abs());
        let direction = [(hit.direction.x, "l"), (hit.direction.y, "m"), (hit.direction.z, "n")];
        let direction =
            direction.iter().map(|(got, column)| (got - number(column)).abs()).fold(0.0, f64::max);
        let path = (hit.path_mm - number("path_mm")).abs();
        assert!(
            position < TOLERANCE_MM && path < TOLERANCE_MM && direction < 1e-11,
            "{name}, row {row}: {position:.1e} mm, {direction:.1e}, {path:.1e} mm"
        );
        worst = [worst[0].max(position), worst[1].max(direction), worst[2].max(path)];
    }
    assert_eq!(table.len(), 360);
    println!("{} rays: worst {:.1e} mm, {:.1e}, path {:.1e} mm", table.len(), worst[0], worst[1], worst[2]);
}
