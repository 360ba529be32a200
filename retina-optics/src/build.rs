//! Systems from parts: a stop, stock lenses in either orientation, gaps, an image.

use std::path::Path;

use retina_files::InputError;

use crate::glass::Medium;
use crate::stock::StockDoublet;
use crate::surface::{Shape, Surface};
use crate::system::{Aiming, Beam, Field, Group, Object, OpticalSystem, Wavelength};

/// Builds a system that begins with its stop (a camera's pupil), object at infinity.
///
/// ```
/// # use retina_optics::{SystemBuilder, stock_doublet};
/// # use std::path::Path;
/// let lens = stock_doublet(Path::new("example"), "AC508-150-A")?;
/// let system = SystemBuilder::new("collimator", 10.0)
///     .gap(100.0)
///     .begin_group("collimator")
///     .lens(lens, true)
///     .end_group()
///     .fields(&[[0.0, 0.0], [0.1, 0.0]])
///     .image_after(140.0)?;
/// assert_eq!(system.surfaces.len(), 5);
/// # Ok::<(), retina_files::InputError>(())
/// ```
#[derive(Debug, Clone)]
pub struct SystemBuilder {
    system: OpticalSystem,
    open_group: Option<(String, usize)>,
}

impl SystemBuilder {
    /// Begins with a stop in air, a plane of this diameter (mm). Defaults: one field on the axis,
    /// the facility's three wavelengths (605, 544, 475 nm) with equal weights, 544 primary.
    pub fn new(name: impl Into<String>, pupil_diameter_mm: f64) -> Self {
        let stop = Surface::new(Shape::PLANE, 0.0, Medium::Air)
            .label("pupil")
            .semi_diameter(pupil_diameter_mm / 2.0);
        Self {
            system: OpticalSystem {
                name: name.into(),
                object: Object::Infinity,
                fields: vec![Field { at: [0.0, 0.0], weight: 1.0 }],
                wavelengths: [605.0, 544.0, 475.0].map(|nm| Wavelength { nm, weight: 1.0 }).to_vec(),
                primary: 1,
                beam: Beam::EntrancePupil(pupil_diameter_mm),
                stop: 0,
                surfaces: vec![stop],
                groups: Vec::new(),
                clear_fraction: 1.0,
                aiming: Aiming::Paraxial,
            },
            open_group: None,
        }
    }

    /// Adds to the gap behind the last surface, mm.
    pub fn gap(mut self, gap_mm: f64) -> Self {
        if let Some(last) = self.system.surfaces.last_mut() {
            last.thickness_mm += gap_mm;
        }
        self
    }

    /// Adds a stock lens; `reversed`: light meets its third radius first.
    pub fn lens(mut self, lens: &StockDoublet, reversed: bool) -> Self {
        self.system.surfaces.extend(lens.surfaces(reversed, 0.0));
        self
    }

    /// Adds any surface; [`SystemBuilder::gap`] adds to its thickness.
    pub fn surface(mut self, surface: Surface) -> Self {
        self.system.surfaces.push(surface);
        self
    }

    /// What follows belongs to a group, until [`SystemBuilder::end_group`].
    pub fn begin_group(mut self, name: impl Into<String>) -> Self {
        self.open_group = Some((name.into(), self.system.surfaces.len()));
        self
    }

    /// Closes the group.
    pub fn end_group(mut self) -> Self {
        if let Some((name, first)) = self.open_group.take() {
            self.system.groups.push(Group::aligned(name, first, self.system.surfaces.len() - 1));
        }
        self
    }

    /// Fields of equal weight: tangents (x, y).
    pub fn fields(mut self, tangents: &[[f64; 2]]) -> Self {
        self.system.fields = tangents.iter().map(|&at| Field { at, weight: 1.0 }).collect();
        self
    }

    /// Wavelengths; the middle one becomes the primary.
    pub fn wavelengths(mut self, wavelengths: &[Wavelength]) -> Self {
        self.system.wavelengths = wavelengths.to_vec();
        self.system.primary = wavelengths.len() / 2;
        self
    }

    /// The part of each clear semi-diameter that light may use.
    pub fn clear_fraction(mut self, fraction: f64) -> Self {
        self.system.clear_fraction = fraction;
        self
    }

    /// Ends with a plane image this far (mm) behind the last surface.
    ///
    /// # Errors
    /// As [`OpticalSystem::check`]; the "file" is the system's name.
    pub fn image_after(self, distance_mm: f64) -> Result<OpticalSystem, InputError> {
        let mut system =
            self.gap(distance_mm).surface(Surface::new(Shape::PLANE, 0.0, Medium::Air).label("image")).system;
        system.groups.retain(|group| group.first <= group.last);
        system.check(Path::new(&system.name))?;
        Ok(system)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stock_doublet;

    #[test]
    fn a_negative_gap_is_refused() {
        let lens = stock_doublet(Path::new("t"), "AC508-150-A").unwrap();
        let error =
            SystemBuilder::new("relay", 10.0).lens(lens, false).gap(-1.0).lens(lens, true).image_after(9.0);
        let text = error.unwrap_err().to_string();
        assert!(text.contains("relay, surface 4: a negative gap") && text.contains("-1 mm"), "{text}");
    }
}
