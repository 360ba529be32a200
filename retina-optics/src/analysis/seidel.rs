//! Seidel sums (W. T. Welford, Aberrations of Optical Systems).

use serde::Serialize;

use crate::OpticsError;
use crate::paraxial::Paraxial;
use crate::surface::Shape;
use crate::system::OpticalSystem;

/// Seidel coefficients of a surface or of a system, mm, as Welford defines them: at the rim of the pupil
/// (r = 1) and the largest field the wavefront aberration is W = S_I r^4 / 8 + S_II r^3 cos / 2 +
/// S_III r^2 cos^2 / 2 + (S_III + S_IV) r^2 / 4 + S_V r cos / 2.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SeidelTerm {
    /// S_I, spherical aberration, mm.
    pub spherical_mm: f64,
    /// S_II, coma, mm.
    pub coma_mm: f64,
    /// S_III, astigmatism, mm.
    pub astigmatism_mm: f64,
    /// S_IV, Petzval curvature, mm.
    pub petzval_mm: f64,
    /// S_V, distortion, mm.
    pub distortion_mm: f64,
    /// C_I, axial colour between the extreme wavelengths, mm.
    pub axial_colour_mm: f64,
    /// C_II, lateral colour between the extreme wavelengths, mm.
    pub lateral_colour_mm: f64,
}

/// Seidel sums at the primary wavelength.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Seidel {
    /// The wavelength, nm.
    pub wavelength_nm: f64,
    /// Surfaces before the image.
    pub surfaces: Vec<SeidelTerm>,
    /// Their sum.
    pub sum: SeidelTerm,
}

/// Seidel coefficients for the beam's rim and the largest field; ideal lenses contribute nothing.
///
/// # Errors
/// As [`Paraxial::new`].
pub fn seidel_sums(system: &OpticalSystem) -> Result<Seidel, OpticsError> {
    let paraxial = Paraxial::primary(system)?;
    let indices = paraxial.indices();
    let extreme = |pick: fn(f64, f64) -> f64| {
        system.wavelengths.iter().map(|w| w.nm).reduce(pick).unwrap_or(system.primary_nm())
    };
    let blue = crate::trace::indices_behind(system, extreme(f64::min))?;
    let red = crate::trace::indices_behind(system, extreme(f64::max))?;
    let (marginal, chief) = (paraxial.marginal(), paraxial.chief());
    let surfaces: Vec<SeidelTerm> = (0..system.image())
        .map(|i| {
            let shape = &system.surfaces[i].shape;
            if matches!(shape, Shape::IdealLens { .. }) {
                return SeidelTerm::default();
            }
            let before = |values: &[f64], air: f64| if i == 0 { air } else { values[i - 1] };
            let (n, n2) = (before(indices, 1.0), indices[i]);
            let dispersion_before = before(&blue, 1.0) - before(&red, 1.0);
            let dispersion_after = blue[i] - red[i];
            let c = shape.vertex_curvature_per_mm();
            let (y, y_bar) = (marginal[i].y_mm, chief[i].y_mm);
            let a = n * (marginal[i].u_before + y * c);
            let a_bar = n * (chief[i].u_before + y_bar * c);
            let lagrange = a * y_bar - a_bar * y;
            let step = marginal[i].u_after / n2 - marginal[i].u_before / n;
            let inverse = 1.0 / n2 - 1.0 / n;
            let inverse2 = 1.0 / (n2 * n2) - 1.0 / (n * n);
            // (A-bar / A)(S_III + S_IV), rearranged so that A may be 0.
            let distortion =
                -a_bar.powi(3) * y * inverse2 + a_bar * y_bar * (2.0 * a_bar * y - a * y_bar) * c * inverse;
            // What the figure's r^4 term has beyond that of the sphere of its vertex curvature.
            let g = fourth_order(shape) - c.powi(3) / 8.0;
            let aspheric = 8.0 * g * (n2 - n);
            let colour = dispersion_after / n2 - dispersion_before / n;
            SeidelTerm {
                spherical_mm: -a * a * y * step + aspheric * y.powi(4),
                coma_mm: -a * a_bar * y * step + aspheric * y.powi(3) * y_bar,
                astigmatism_mm: -a_bar * a_bar * y * step + aspheric * y * y * y_bar * y_bar,
                petzval_mm: -lagrange * lagrange * c * inverse,
                distortion_mm: distortion + aspheric * y * y_bar.powi(3),
                axial_colour_mm: a * y * colour,
                lateral_colour_mm: a_bar * y * colour,
            }
        })
        .collect();
    let sum = surfaces.iter().fold(SeidelTerm::default(), |s, t| SeidelTerm {
        spherical_mm: s.spherical_mm + t.spherical_mm,
        coma_mm: s.coma_mm + t.coma_mm,
        astigmatism_mm: s.astigmatism_mm + t.astigmatism_mm,
        petzval_mm: s.petzval_mm + t.petzval_mm,
        distortion_mm: s.distortion_mm + t.distortion_mm,
        axial_colour_mm: s.axial_colour_mm + t.axial_colour_mm,
        lateral_colour_mm: s.lateral_colour_mm + t.lateral_colour_mm,
    });
    Ok(Seidel { wavelength_nm: system.primary_nm(), surfaces, sum })
}

/// The coefficient of r^4 in the sag, 1/mm^3.
fn fourth_order(shape: &Shape) -> f64 {
    match shape {
        Shape::Conic { curvature_per_mm: c, conic } => (1.0 + conic) * c.powi(3) / 8.0,
        Shape::EvenAsphere { curvature_per_mm: c, conic, coefficients } => {
            (1.0 + conic) * c.powi(3) / 8.0 + coefficients.get(1).copied().unwrap_or(0.0)
        }
        Shape::IdealLens { .. } => 0.0,
    }
}
