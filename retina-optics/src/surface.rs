//! A surface of a lens system: its figure, its clear aperture, and what follows it.
//!
//! Lengths in mm; the frame is that of [`crate::OpticalSystem`].

use std::path::Path;

use retina_files::InputError;

use crate::glass::Medium;
use crate::system::LONGEST_MM;

/// Largest index of a medium: germanium has 4.
const LARGEST_INDEX: f64 = 10.0;

/// The figure of a surface; `curvature_per_mm` is 1 / radius, 0 for a plane.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A conic of revolution: c (r^2 + (1 + k) z^2) = 2 z; a sphere for k = 0, a plane for c = 0.
    Conic {
        /// c, 1/mm.
        curvature_per_mm: f64,
        /// k (0 sphere, -1 paraboloid).
        conic: f64,
    },
    /// A conic plus even powers: z += a_2 r^2 + a_4 r^4 + ..., r in mm.
    EvenAsphere {
        /// c, 1/mm.
        curvature_per_mm: f64,
        /// k.
        conic: f64,
        /// a_2, a_4, a_6, ... (at most eight), mm^(1 - power).
        coefficients: Vec<f64>,
    },
    /// An ideal thin lens in air: tangents of the ray change by -x/f and -y/f, nothing else. Its
    /// optical path images an object at infinity without aberration.
    IdealLens {
        /// f, mm.
        focal_mm: f64,
    },
}

impl Shape {
    /// A plane.
    pub const PLANE: Self = Self::Conic { curvature_per_mm: 0.0, conic: 0.0 };

    /// A sphere of this radius (signed, mm; infinite for a plane).
    pub fn sphere(radius_mm: f64) -> Self {
        Self::Conic { curvature_per_mm: 1.0 / radius_mm, conic: 0.0 }
    }

    /// Vertex curvature, 1/mm, with the r^2 term of an asphere; 0 for an ideal lens.
    pub fn vertex_curvature_per_mm(&self) -> f64 {
        match self {
            Self::Conic { curvature_per_mm, .. } => *curvature_per_mm,
            Self::EvenAsphere { curvature_per_mm, coefficients, .. } => {
                curvature_per_mm + 2.0 * coefficients.first().copied().unwrap_or(0.0)
            }
            Self::IdealLens { .. } => 0.0,
        }
    }

    /// Sag z(r), mm; `None` where the surface does not reach r.
    pub fn sag_mm(&self, r_mm: f64) -> Option<f64> {
        let conic_sag = |c: f64, k: f64| {
            let root = 1.0 - (1.0 + k) * c * c * r_mm * r_mm;
            (root >= 0.0).then(|| c * r_mm * r_mm / (1.0 + root.sqrt()))
        };
        match self {
            Self::Conic { curvature_per_mm, conic } => conic_sag(*curvature_per_mm, *conic),
            Self::EvenAsphere { curvature_per_mm, conic, coefficients } => {
                let r2 = r_mm * r_mm;
                let polynomial = coefficients.iter().rev().fold(0.0, |sum, a| (sum + a) * r2);
                Some(conic_sag(*curvature_per_mm, *conic)? + polynomial)
            }
            Self::IdealLens { .. } => Some(0.0),
        }
    }
}

/// The clear ring of a surface: light passes where inner <= r <= outer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aperture {
    /// Radius of a central obstruction, mm; 0 for none.
    pub inner_mm: f64,
    /// Clear semi-diameter, mm; infinite for none.
    pub outer_mm: f64,
}

impl Aperture {
    /// No limit.
    pub const OPEN: Self = Self { inner_mm: 0.0, outer_mm: f64::INFINITY };

    /// A circular aperture of this semi-diameter, mm.
    pub fn circle(semi_diameter_mm: f64) -> Self {
        Self { inner_mm: 0.0, outer_mm: semi_diameter_mm }
    }
}

/// A surface and what follows it.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// For messages and drawings; may be empty.
    pub label: String,
    /// Its figure.
    pub shape: Shape,
    /// Distance along the axis to the next vertex, mm; of no meaning for the last surface.
    pub thickness_mm: f64,
    /// The medium behind it.
    pub medium: Medium,
    /// Its clear aperture.
    pub aperture: Aperture,
}

impl Surface {
    /// A surface without aperture or label.
    pub fn new(shape: Shape, thickness_mm: f64, medium: Medium) -> Self {
        Self { label: String::new(), shape, thickness_mm, medium, aperture: Aperture::OPEN }
    }

    /// With this clear semi-diameter, mm.
    pub fn semi_diameter(mut self, semi_diameter_mm: f64) -> Self {
        self.aperture.outer_mm = semi_diameter_mm;
        self
    }

    /// With this label.
    pub fn label(mut self, label: impl Into<String>) -> Self {
        self.label = label.into();
        self
    }
}

/// Whether the surface of this index can be traced.
pub(crate) fn check_surface(
    file: &Path,
    i: usize,
    surface: &Surface,
    is_image: bool,
) -> Result<(), InputError> {
    let error = |problem: &str| InputError::new(file, problem).at(format!("surface {}", i + 1));
    let thickness = surface.thickness_mm;
    if !is_image && (thickness.is_nan() || thickness > LONGEST_MM) {
        return Err(error("the distance to the next surface is beyond what is traced")
            .found(format!("{thickness} mm"))
            .expected(format!("at most {LONGEST_MM:e} mm")));
    }
    if !is_image && thickness < 0.0 {
        let what = if surface.medium == Medium::Air { "a negative gap" } else { "a negative thickness" };
        return Err(error(&format!("{what}: the next surface would stand before this one"))
            .found(format!("{thickness} mm"))
            .expected("0 mm or more")
            .help("give the surfaces in the order in which light meets them"));
    }
    let finite = match &surface.shape {
        Shape::Conic { curvature_per_mm, conic } => curvature_per_mm.is_finite() && conic.is_finite(),
        Shape::EvenAsphere { curvature_per_mm, conic, coefficients } => {
            if coefficients.len() > crate::trace::MAX_ASPHERIC_TERMS {
                return Err(error("too many aspheric terms")
                    .found(coefficients.len())
                    .expected(format!("at most {}", crate::trace::MAX_ASPHERIC_TERMS)));
            }
            curvature_per_mm.is_finite() && conic.is_finite() && coefficients.iter().all(|a| a.is_finite())
        }
        Shape::IdealLens { focal_mm } => focal_mm.is_finite() && *focal_mm != 0.0,
    };
    if !finite {
        return Err(error(
            "the surface's figure has numbers that are not finite, or a radius or focal length of 0",
        ));
    }
    if let Medium::Index(n) = surface.medium
        && !(1.0..=LARGEST_INDEX).contains(&n)
    {
        return Err(error("no medium has this index")
            .found(n)
            .expected(format!("1 to {LARGEST_INDEX}, relative to air")));
    }
    let Aperture { inner_mm, outer_mm } = surface.aperture;
    if !(inner_mm >= 0.0 && outer_mm > inner_mm) {
        return Err(error("the clear aperture is empty")
            .found(format!("{inner_mm} to {outer_mm} mm"))
            .expected("0 <= inner < outer"));
    }
    Ok(())
}
