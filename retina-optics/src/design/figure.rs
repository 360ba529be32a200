//! The bench as thin lenses, in the style of the paper's Fig. 1.

use retina_plot::Figure;

use super::{BenchDesign, BenchLenses, Camera};
use crate::glass::Medium;
use crate::plot::layout_figure;
use crate::surface::{Shape, Surface};
use crate::{OpticsError, SystemBuilder};

/// The layout with the axial beam and those of 0.7 and 1 times the sensor's corner.
///
/// # Errors
/// Distances at which the system cannot be drawn (one is not positive).
pub fn bench_figure(
    name: &str,
    design: &BenchDesign,
    lenses: &BenchLenses,
    camera: &Camera,
) -> Result<Figure, OpticsError> {
    let corner = camera.half_field_tans()[2];
    let lens = |focal_mm: f64, label: &str| {
        Surface::new(Shape::IdealLens { focal_mm }, 0.0, Medium::Air)
            .semi_diameter(lenses.diameter_mm / 2.0)
            .label(label)
    };
    let system = SystemBuilder::new(name, design.pupil_mm)
        .gap(lenses.pupil_collimator_mm)
        .surface(lens(lenses.collimator_focal_mm, "collimator"))
        .gap(design.layout.inter_lens_mm)
        .surface(lens(lenses.relay_focal_mm, "relay"))
        .fields(&[[0.0, 0.0], [0.0, 0.7 * corner], [0.0, corner]])
        .image_after(design.layout.screen_relay_mm)
        .map_err(|error| OpticsError::Undefined(error.to_string()))?;
    let title = format!(
        "{name}: M = {:.3}, s_or {:.1}, s_ri {:.1}, s_rc {:.1}, s_oc {:.1} mm",
        design.layout.magnification,
        design.layout.screen_relay_mm,
        design.layout.relay_image_mm,
        design.layout.inter_lens_mm,
        design.layout.total_length_mm
    );
    layout_figure(&title, &[&system])
}
