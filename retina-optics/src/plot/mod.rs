//! Drawings of the analyses, as [`retina_plot::Figure`]s.

mod curves;
mod layout;
mod maps;

pub use curves::{
    encircled_energy_figure, fans_figure, field_curves_figure, ghosts_figure, illumination_figure,
    mtf_figure, thermal_figure,
};
pub use layout::layout_figure;
pub use maps::{SpotRow, psf_figure, spots_figure, tolerance_figure, wavefront_figure};

use crate::system::{Object, OpticalSystem};

/// A field as people name it: an angle for an object at infinity, else a height.
pub(crate) fn field_label(object: Object, at: [f64; 2]) -> String {
    let one = |radius: f64| match object {
        Object::Infinity => format!("{:.2}\u{b0}", radius.atan().to_degrees()),
        Object::Distance(_) => format!("{radius:.2} mm"),
    };
    match at {
        [0.0, y] => one(y),
        [x, 0.0] => format!("x {}", one(x)),
        [x, y] => format!("({}, {})", one(x), one(y)),
    }
}

/// The field radius of a curve in the unit of its axis, and that axis's label.
pub(crate) fn field_axis(system: &OpticalSystem) -> (&'static str, fn(f64) -> f64) {
    match system.object {
        Object::Infinity => ("field (deg)", |radius: f64| radius.atan().to_degrees()),
        Object::Distance(_) => ("field (mm)", |radius: f64| radius),
    }
}
