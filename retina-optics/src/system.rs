//! What a lens system is: surfaces in the order in which light meets them, and how it is used.
//!
//! Frame: z along the axis and the light (+z), x right, y down; the origin is the vertex of the
//! first surface before any tilt. Lengths in mm. A radius is positive when its centre lies to the
//! right (+z) of the vertex. Light starts in air and runs towards +z.

use std::path::Path;

use glam::{DMat3, DVec3};
use retina_files::InputError;

use crate::surface::{Surface, check_surface};

/// Consecutive surfaces that move as one.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Its name.
    pub name: String,
    /// First surface, index from 0.
    pub first: usize,
    /// Last surface, index from 0, included.
    pub last: usize,
    /// The pivot on the axis, mm from the vertex of the first surface of the group.
    pub pivot_mm: f64,
    /// Right-handed turns about x, y and z through the pivot, rad; applied z first, then y, then x.
    pub tilt_rad: DVec3,
    /// Displacement, mm, after the turn.
    pub decentre_mm: DVec3,
}

impl Group {
    /// A group that is where it was designed to be.
    pub fn aligned(name: impl Into<String>, first: usize, last: usize) -> Self {
        Self {
            name: name.into(),
            first,
            last,
            pivot_mm: 0.0,
            tilt_rad: DVec3::ZERO,
            decentre_mm: DVec3::ZERO,
        }
    }
}

/// Where the object is, and so what a field's two numbers mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Object {
    /// At infinity. A field is the tangents (x, y) of the direction in which light travels.
    Infinity,
    /// A plane this far before the first vertex, mm. A field is a point (x, y) on it, mm.
    Distance(f64),
}

/// A field point: tangents or mm, see [`Object`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// x and y.
    pub at: [f64; 2],
    /// Weight in means over the field.
    pub weight: f64,
}

/// A wavelength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wavelength {
    /// nm, in air.
    pub nm: f64,
    /// Weight in polychromatic figures.
    pub weight: f64,
}

/// What fixes the size of the beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Beam {
    /// Diameter of the paraxial entrance pupil, mm.
    EntrancePupil(f64),
    /// Diameter at the stop, mm.
    Stop(f64),
    /// Paraxial f-number in image space, for an object at infinity: EFL / entrance pupil.
    FNumber(f64),
    /// Numerical aperture in object space, for a finite object.
    ObjectNa(f64),
}

/// How rays are aimed at the pupil.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Aiming {
    /// At the paraxial entrance pupil: exact when nothing stands before the stop.
    #[default]
    Paraxial,
    /// At the stop itself, by iteration: pupil aberration and tilts before the stop included.
    Stop,
}

/// Longest distance, radius of an aperture, decentre or beam of a system, mm: a kilometre. Beyond it f64
/// has no nanometre left, and no bench has it.
pub(crate) const LONGEST_MM: f64 = 1e6;
/// Largest tangent of a field: 89.4 degrees.
pub(crate) const LARGEST_TAN: f64 = 100.0;
/// Wavelengths that lenses are made for and far beyond, nm: extreme ultraviolet to a millimetre.
const WAVELENGTHS_NM: std::ops::RangeInclusive<f64> = 10.0..=1e6;

/// A lens system: the last surface is the image surface.
#[derive(Debug, Clone, PartialEq)]
pub struct OpticalSystem {
    /// Its name.
    pub name: String,
    /// Where the object is.
    pub object: Object,
    /// Fields, at least one.
    pub fields: Vec<Field>,
    /// Wavelengths, at least one.
    pub wavelengths: Vec<Wavelength>,
    /// Index of the wavelength of first-order figures.
    pub primary: usize,
    /// Beam size.
    pub beam: Beam,
    /// Index of the stop surface.
    pub stop: usize,
    /// Surfaces, image last.
    pub surfaces: Vec<Surface>,
    /// Tilts and decentres, applied in this order: a later group turns what earlier ones have moved.
    pub groups: Vec<Group>,
    /// The part of every clear semi-diameter that light may use: 1, or 0.9 for mounted lenses.
    pub clear_fraction: f64,
    /// Ray aiming.
    pub aiming: Aiming,
}

/// Position and attitude of a surface: global = rotation * local + vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Global from local axes.
    pub rotation: DMat3,
    /// The vertex, mm.
    pub vertex_mm: DVec3,
}

impl OpticalSystem {
    /// The index of the image surface.
    pub fn image(&self) -> usize {
        self.surfaces.len() - 1
    }

    /// The wavelength of first-order figures, nm.
    pub fn primary_nm(&self) -> f64 {
        self.wavelengths[self.primary].nm
    }

    /// z of each vertex before tilts, mm; the first is 0.
    pub fn vertices_mm(&self) -> Vec<f64> {
        let mut z = 0.0;
        self.surfaces
            .iter()
            .map(|surface| {
                let here = z;
                z += surface.thickness_mm;
                here
            })
            .collect()
    }

    /// Position and attitude of every surface, groups applied.
    pub fn poses(&self) -> Vec<Pose> {
        let z = self.vertices_mm();
        let mut poses: Vec<Pose> = z
            .iter()
            .map(|&z| Pose { rotation: DMat3::IDENTITY, vertex_mm: DVec3::new(0.0, 0.0, z) })
            .collect();
        for group in &self.groups {
            let pivot = DVec3::new(0.0, 0.0, z[group.first] + group.pivot_mm);
            let turn = DMat3::from_rotation_x(group.tilt_rad.x)
                * DMat3::from_rotation_y(group.tilt_rad.y)
                * DMat3::from_rotation_z(group.tilt_rad.z);
            for pose in &mut poses[group.first..=group.last] {
                pose.rotation = turn * pose.rotation;
                pose.vertex_mm = pivot + group.decentre_mm + turn * (pose.vertex_mm - pivot);
            }
        }
        poses
    }

    /// The group of this name.
    pub fn group_mut(&mut self, name: &str) -> Option<&mut Group> {
        self.groups.iter_mut().find(|group| group.name == name)
    }

    /// The same system with all groups where they were designed to be.
    pub fn aligned(&self) -> Self {
        let mut system = self.clone();
        for group in &mut system.groups {
            group.tilt_rad = DVec3::ZERO;
            group.decentre_mm = DVec3::ZERO;
        }
        system
    }

    /// Checks what every trace relies on; `file` is named in errors. Surfaces are counted from 1 there.
    ///
    /// # Errors
    /// No surface, field or wavelength; a stop, primary wavelength or group that is not among
    /// them; numbers that are not finite; a negative gap; a beam without extent; weights of sum 0;
    /// an index that no medium has; a glass used outside its range.
    pub fn check(&self, file: &Path) -> Result<(), InputError> {
        let error = |at: String, problem: &str| InputError::new(file, problem).at(at);
        let count = self.surfaces.len();
        if count < 2 {
            return Err(error("surfaces".into(), "a system needs a surface and an image").found(count));
        }
        if self.stop >= count - 1 {
            return Err(error("stop".into(), "the stop is no surface before the image").found(self.stop + 1));
        }
        for (i, wavelength) in self.wavelengths.iter().enumerate() {
            if !WAVELENGTHS_NM.contains(&wavelength.nm) {
                let error =
                    error(format!("wavelength {}", i + 1), "this is no wavelength of light in nanometres")
                        .found(wavelength.nm)
                        .expected(format!("{} to {} nm", WAVELENGTHS_NM.start(), WAVELENGTHS_NM.end()));
                let micrometres = (0.1..10.0).contains(&wavelength.nm);
                return Err(if micrometres { error.help("micrometres? Multiply by 1000") } else { error });
            }
        }
        for (i, surface) in self.surfaces.iter().enumerate() {
            check_surface(file, i, surface, i + 1 == count)?;
            for wavelength in &self.wavelengths {
                if let Err(bad) = surface.medium.index(wavelength.nm) {
                    return Err(error(format!("surface {}", i + 1), &bad.to_string()));
                }
            }
        }
        if self.fields.is_empty() || self.fields.iter().any(|f| !f.at.iter().all(|v| v.is_finite())) {
            return Err(error("fields".into(), "a system needs at least one field, of finite numbers"));
        }
        for (i, field) in self.fields.iter().enumerate() {
            self.check_field(field.at).map_err(|(found, expected)| {
                error(format!("field {}", i + 1), "the field is beyond what is traced")
                    .found(found)
                    .expected(expected)
            })?;
        }
        if self.primary >= self.wavelengths.len() {
            return Err(
                error("wavelengths".into(), "there is no such primary wavelength").found(self.primary + 1)
            );
        }
        let sums = [
            self.fields.iter().map(|f| f.weight).sum(),
            self.wavelengths.iter().map(|w| w.weight).sum::<f64>(),
        ];
        let negative = self
            .fields
            .iter()
            .map(|f| f.weight)
            .chain(self.wavelengths.iter().map(|w| w.weight))
            .any(|w| w < 0.0);
        if negative || sums.iter().any(|&sum: &f64| !(sum > 0.0 && sum.is_finite())) {
            return Err(error(
                "weights".into(),
                "weights must not be negative, and their sum must be positive",
            ));
        }
        if let Object::Distance(distance) = self.object
            && !(distance > 0.0 && distance <= LONGEST_MM)
        {
            return Err(error("object".into(), "the object must stand before the first surface")
                .found(format!("{distance} mm"))
                .expected(format!("above 0, at most {LONGEST_MM:e} mm"))
                .help("leave the table out for an object at infinity"));
        }
        let (Beam::EntrancePupil(size) | Beam::Stop(size) | Beam::FNumber(size) | Beam::ObjectNa(size)) =
            self.beam;
        if !(size > 0.0 && size <= LONGEST_MM) {
            let problem =
                if size > 0.0 { "the beam is wider than any bench" } else { "the beam has no extent" };
            return Err(error("beam".into(), problem)
                .found(size)
                .expected(format!("above 0, at most {LONGEST_MM:e}")));
        }
        match (self.beam, self.object) {
            (Beam::FNumber(_), Object::Distance(_)) => {
                return Err(error("beam".into(), "an f-number fixes the beam of an object at infinity only")
                    .help("give the entrance pupil, the stop or the object's numerical aperture"));
            }
            (Beam::ObjectNa(na), object) if object == Object::Infinity || na >= 1.0 => {
                return Err(error(
                    "beam".into(),
                    "a numerical aperture needs a finite object, and is below 1",
                ));
            }
            _ => {}
        }
        if !(self.clear_fraction > 0.0 && self.clear_fraction <= 1.0) {
            return Err(error("clear_fraction".into(), "must lie in (0, 1]").found(self.clear_fraction));
        }
        for group in &self.groups {
            if group.first > group.last || group.last >= count {
                return Err(error(format!("group {}", group.name), "holds surfaces that do not exist"));
            }
            let numbers = [group.tilt_rad.to_array(), group.decentre_mm.to_array()];
            if !group.pivot_mm.is_finite() || numbers.iter().flatten().any(|v| !v.is_finite()) {
                return Err(error(format!("group {}", group.name), "tilt and decentre must be finite"));
            }
            let longest = numbers[1].iter().fold(group.pivot_mm.abs(), |most, v| most.max(v.abs()));
            if longest > LONGEST_MM {
                return Err(error(format!("group {}", group.name), "pivot or decentre is beyond any bench")
                    .found(format!("{longest} mm"))
                    .expected(format!("at most {LONGEST_MM:e} mm")));
            }
        }
        Ok(())
    }

    /// What is wrong with a field, as (found, expected).
    fn check_field(&self, at: [f64; 2]) -> Result<(), (String, String)> {
        let (limit, unit) = match self.object {
            Object::Infinity => (LARGEST_TAN, "tangents of"),
            Object::Distance(_) => (LONGEST_MM, "points (mm) of"),
        };
        if at.iter().all(|v| v.abs() <= limit) {
            return Ok(());
        }
        Err((format!("{}, {}", at[0], at[1]), format!("{unit} at most {limit:e} in size")))
    }

    /// Checks a field and a point of the pupil that do not come from the system itself; `file` is named in
    /// errors.
    ///
    /// # Errors
    /// A field beyond the limits of [`OpticalSystem::check`]; a point outside the unit pupil.
    pub fn check_ray(&self, file: &Path, field: [f64; 2], pupil: [f64; 2]) -> Result<(), InputError> {
        self.check_field(field).map_err(|(found, expected)| {
            InputError::new(file, "the field is beyond what is traced")
                .at("field")
                .found(found)
                .expected(expected)
        })?;
        let radius = pupil[0].hypot(pupil[1]);
        // A rim point that was rounded to decimals may lie outside by their last digit.
        if radius <= 1.0 + 1e-6 {
            return Ok(());
        }
        Err(InputError::new(file, "the point lies outside the pupil: the beam has no such ray")
            .at("pupil")
            .found(format!("{}, {}, at radius {radius}", pupil[0], pupil[1]))
            .expected("a point of the unit disc")
            .help("the pupil's rim is at radius 1"))
    }
}
