//! First-order optics: paraxial rays, cardinal points, pupils.
//!
//! Tilts and decentres are ignored here: figures are those of the aligned system.

use serde::Serialize;

use crate::OpticsError;
use crate::surface::Shape;
use crate::system::{Beam, Object, OpticalSystem};
use crate::trace::indices_behind;

/// Height and angles of a paraxial ray at a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Height {
    /// Height, mm.
    pub y_mm: f64,
    /// Slope before the surface.
    pub u_before: f64,
    /// Slope behind it.
    pub u_after: f64,
}

/// First-order figures at one wavelength. `None`: at infinity or not defined. Lengths in mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FirstOrder {
    /// The wavelength, nm.
    pub wavelength_nm: f64,
    /// Effective focal length.
    pub efl_mm: Option<f64>,
    /// Rear focal point from the last vertex before the image, positive to the right.
    pub bfl_mm: Option<f64>,
    /// Front focal point from the first vertex, positive to the right.
    pub ffl_mm: Option<f64>,
    /// Front principal plane from the first vertex.
    pub front_principal_mm: Option<f64>,
    /// Rear principal plane from the last vertex before the image.
    pub rear_principal_mm: Option<f64>,
    /// Entrance pupil from the first vertex.
    pub entrance_pupil_mm: f64,
    /// Entrance pupil's diameter.
    pub entrance_pupil_diameter_mm: f64,
    /// Exit pupil from the last vertex before the image.
    pub exit_pupil_mm: Option<f64>,
    /// Exit pupil's diameter.
    pub exit_pupil_diameter_mm: Option<f64>,
    /// Paraxial image from the last vertex before the image.
    pub image_mm: Option<f64>,
    /// The image surface from the last vertex before it.
    pub image_surface_mm: f64,
    /// 1 / (2 |u'|) of the marginal ray in image space.
    pub working_f_number: Option<f64>,
    /// Transverse magnification of a finite object at the paraxial image.
    pub magnification: Option<f64>,
    /// Lagrange invariant for the largest field: n (u_bar y - u y_bar), mm.
    pub lagrange_mm: f64,
    /// First vertex to image surface.
    pub track_mm: f64,
}

/// A system's paraxial model at one set of indices.
#[derive(Debug, Clone)]
pub struct Paraxial {
    wavelength_nm: f64,
    object: Object,
    stop: usize,
    field_max: f64,
    powers: Vec<f64>,
    gaps: Vec<f64>,
    indices: Vec<f64>,
    /// Position and radius of the entrance pupil, mm.
    pupil: (f64, f64),
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Powers (n' - n) c or 1/f of the surfaces, 1/mm.
fn powers(system: &OpticalSystem, indices: &[f64]) -> Vec<f64> {
    system
        .surfaces
        .iter()
        .enumerate()
        .map(|(i, surface)| match surface.shape {
            Shape::IdealLens { focal_mm } => 1.0 / focal_mm,
            _ => {
                let before = if i == 0 { 1.0 } else { indices[i - 1] };
                (indices[i] - before) * surface.shape.vertex_curvature_per_mm()
            }
        })
        .collect()
}

impl Paraxial {
    /// At the primary wavelength.
    ///
    /// # Errors
    /// As [`Paraxial::new`].
    pub fn primary(system: &OpticalSystem) -> Result<Self, OpticsError> {
        Self::new(system, system.primary_nm())
    }

    /// At a wavelength, nm. The beam's size is fixed at this wavelength.
    ///
    /// # Errors
    /// A glass without an index there; an entrance pupil at infinity; a beam that an f-number
    /// cannot fix because the system is afocal.
    pub fn new(system: &OpticalSystem, wavelength_nm: f64) -> Result<Self, OpticsError> {
        Self::with_indices(system, wavelength_nm, indices_behind(system, wavelength_nm)?)
    }

    /// As [`Paraxial::new`], with the index behind each surface handed over.
    ///
    /// # Errors
    /// As [`Paraxial::new`].
    pub fn with_indices(
        system: &OpticalSystem,
        wavelength_nm: f64,
        indices: Vec<f64>,
    ) -> Result<Self, OpticsError> {
        let field_max = system.fields.iter().map(|field| field.at[0].hypot(field.at[1])).fold(0.0, f64::max);
        let mut model = Self {
            wavelength_nm,
            object: system.object,
            stop: system.stop,
            field_max,
            powers: powers(system, &indices),
            gaps: system.surfaces.iter().map(|surface| surface.thickness_mm).collect(),
            indices,
            pupil: (0.0, 0.0),
        };
        // Height at the stop of a ray that enters as (y, u) at the first vertex: a y + b u.
        let at_stop = |y, u| model.trace(y, u, model.stop + 1)[model.stop].y_mm;
        let (a, b) = (at_stop(1.0, 0.0), at_stop(0.0, 1.0));
        if a.abs() < 1e-12 {
            return Err(OpticsError::Undefined(
                "the entrance pupil lies at infinity (telecentric in object space): rays cannot be aimed at it".into(),
            ));
        }
        let position = b / a;
        let radius = match system.beam {
            Beam::EntrancePupil(diameter) => diameter / 2.0,
            Beam::Stop(diameter) => diameter / 2.0 / a.abs(),
            Beam::FNumber(f_number) => {
                let efl = 1.0 / model.power();
                if !efl.is_finite() {
                    return Err(OpticsError::Undefined("an afocal system has no f-number".into()));
                }
                efl.abs() / f_number / 2.0
            }
            Beam::ObjectNa(na) => {
                let Object::Distance(distance) = system.object else {
                    return Err(OpticsError::Undefined(
                        "an object at infinity has no numerical aperture".into(),
                    ));
                };
                (distance + position).abs() * (na / (1.0 - na * na).sqrt())
            }
        };
        model.pupil = (position, radius);
        Ok(model)
    }

    /// Position (from the first vertex) and radius of the entrance pupil, mm.
    pub fn entrance_pupil_mm(&self) -> (f64, f64) {
        self.pupil
    }

    /// The indices behind the surfaces.
    pub fn indices(&self) -> &[f64] {
        &self.indices
    }

    /// A ray that arrives at the first vertex with height y (mm) and slope u, through `count` surfaces.
    pub fn trace(&self, y_mm: f64, u: f64, count: usize) -> Vec<Height> {
        let (mut y, mut u, mut before) = (y_mm, u, 1.0);
        (0..count)
            .map(|i| {
                if i > 0 {
                    y += self.gaps[i - 1] * u;
                }
                let after = self.indices[i];
                let u_before = u;
                u = (before * u - y * self.powers[i]) / after;
                before = after;
                Height { y_mm: y, u_before, u_after: u }
            })
            .collect()
    }

    /// The marginal ray of the axial beam, at every surface.
    pub fn marginal(&self) -> Vec<Height> {
        let (position, radius) = self.pupil;
        let (y, u) = match self.object {
            Object::Infinity => (radius, 0.0),
            Object::Distance(distance) => {
                let u = radius / (distance + position);
                (u * distance, u)
            }
        };
        self.trace(y, u, self.gaps.len())
    }

    /// The chief ray of the largest field, at every surface.
    pub fn chief(&self) -> Vec<Height> {
        let (position, _) = self.pupil;
        let u = match self.object {
            Object::Infinity => self.field_max,
            // From the object point at height +field through the centre of the pupil.
            Object::Distance(distance) => -self.field_max / (distance + position),
        };
        self.trace(-position * u, u, self.gaps.len())
    }

    /// Power of the whole system, 1/mm.
    pub fn power(&self) -> f64 {
        let last = self.gaps.len() - 2;
        -self.trace(1.0, 0.0, last + 1)[last].u_after * self.indices[last]
    }

    /// The cardinal points and pupils.
    pub fn first_order(&self) -> FirstOrder {
        let last = self.gaps.len() - 2;
        let n_last = self.indices[last];
        let power = self.power();
        let parallel = self.trace(1.0, 0.0, last + 1)[last];
        let unit = self.trace(0.0, 1.0, last + 1)[last];
        // Matrix of the system: y' = a y + b u, n' u' = -power y + d u.
        let (a, d) = (parallel.y_mm, unit.u_after * n_last);
        let efl = finite(1.0 / power);
        let bfl = finite(n_last * a / power);
        let ffl = finite(-d / power);
        let (marginal, chief) = (self.marginal(), self.chief());
        let (y, u) = (marginal[last].y_mm, marginal[last].u_after);
        // With all fields on the axis any ray through the centre of the stop finds the exit pupil.
        let (position, radius) = self.pupil;
        let centre = self.trace(-position, 1.0, last + 1)[last];
        let exit = finite(-centre.y_mm / centre.u_after);
        let edge = self.trace(radius, 0.0, last + 1)[last];
        let image = finite(-y / u);
        FirstOrder {
            wavelength_nm: self.wavelength_nm,
            efl_mm: efl,
            bfl_mm: bfl,
            ffl_mm: ffl,
            front_principal_mm: ffl.zip(efl).map(|(ffl, efl)| ffl + efl),
            rear_principal_mm: bfl.zip(efl).map(|(bfl, efl)| bfl - n_last * efl),
            entrance_pupil_mm: position,
            entrance_pupil_diameter_mm: 2.0 * radius,
            exit_pupil_mm: exit,
            exit_pupil_diameter_mm: exit.map(|z| 2.0 * (edge.y_mm + z * edge.u_after).abs()),
            image_mm: image,
            image_surface_mm: self.gaps[last],
            working_f_number: finite(1.0 / (2.0 * u.abs())),
            magnification: match self.object {
                Object::Infinity => None,
                Object::Distance(_) => finite(marginal[0].u_before / (n_last * u)),
            },
            lagrange_mm: chief[0].u_before * marginal[0].y_mm - marginal[0].u_before * chief[0].y_mm,
            track_mm: self.gaps[..=last].iter().sum(),
        }
    }
}

/// Effective focal length (mm) of the surfaces `first..=last` alone, in air; `None` where they are afocal.
///
/// # Errors
/// A glass without an index at the wavelength.
pub fn efl_of_mm(
    system: &OpticalSystem,
    first: usize,
    last: usize,
    wavelength_nm: f64,
) -> Result<Option<f64>, OpticsError> {
    let indices = indices_behind(system, wavelength_nm)?;
    let powers = powers(system, &indices);
    let (mut y, mut nu) = (1.0, 0.0);
    for i in first..=last {
        nu -= y * powers[i];
        if i < last {
            y += system.surfaces[i].thickness_mm * nu / indices[i];
        }
    }
    Ok(finite(-1.0 / nu))
}
