//! First-order ghosts: light reflected at one surface and again at an earlier one.

use serde::Serialize;

use crate::OpticsError;
use crate::launch::Launcher;
use crate::paraxial::Paraxial;
use crate::pupil::gaussian;
use crate::surface::Shape;
use crate::system::OpticalSystem;
use crate::trace::{Clipping, Tracer};

/// A ghost of the axial beam, primary wavelength.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ghost {
    /// The surface that reflects light forward again, counted from 1.
    pub first: usize,
    /// The surface that reflects it back, counted from 1.
    pub second: usize,
    /// Product of the two reflectances.
    pub reflectance: f64,
    /// Where the ghost is in focus, from the last vertex before the image, mm; `None` at infinity.
    pub focus_mm: Option<f64>,
    /// Paraxial radius of the beam on the image surface, mm.
    pub paraxial_radius_mm: f64,
    /// RMS radius of the traced rays on the image about their centroid, mm; `None` if none arrives.
    pub rms_radius_mm: Option<f64>,
    /// Share of the beam that arrives, apertures clipping (without the reflectances).
    pub transmitted: f64,
    /// Mean irradiance over a disc of sqrt(2) times the RMS radius, for a beam of unit power, 1/mm^2.
    pub irradiance_per_mm2: Option<f64>,
}

/// All ghosts of first order, the densest on the image first. Surfaces between air and glass reflect
/// `coating` (a reflectance; `None`: uncoated, Fresnel at normal incidence); cemented ones by Fresnel.
///
/// # Errors
/// As [`Launcher::new`].
pub fn ghosts(system: &OpticalSystem, coating: Option<f64>) -> Result<Vec<Ghost>, OpticsError> {
    let launcher = Launcher::new(system)?;
    let paraxial = Paraxial::primary(system)?;
    let indices = paraxial.indices();
    let points = gaussian(8, 16, 0.0);
    let launched = super::launch(&launcher, [0.0, 0.0], &points)?;
    let before = |i: usize| if i == 0 { 1.0 } else { indices[i - 1] };
    let reflectance = |i: usize| {
        let (a, b) = (before(i), indices[i]);
        let fresnel = ((a - b) / (a + b)).powi(2);
        if a == 1.0 || b == 1.0 { coating.unwrap_or(fresnel) } else { fresnel }
    };
    let reflecting: Vec<usize> = (0..system.image())
        .filter(|&i| before(i) != indices[i] && !matches!(system.surfaces[i].shape, Shape::IdealLens { .. }))
        .collect();
    let mut ghosts = Vec::new();
    for (k, &second) in reflecting.iter().enumerate() {
        for &first in &reflecting[..k] {
            let tracer = Tracer::ghost(system, system.primary_nm(), Clipping::On, first, second)?;
            let mut rays = launched.clone();
            tracer.trace_batch(&mut rays);
            let (mut weight, mut x, mut y, mut square) = (0.0, 0.0, 0.0, 0.0);
            for (i, point) in points.iter().enumerate().filter(|(i, _)| rays.arrived(*i)) {
                weight += point.weight;
                x += point.weight * rays.x_mm[i];
                y += point.weight * rays.y_mm[i];
                square += point.weight * (rays.x_mm[i].powi(2) + rays.y_mm[i].powi(2));
            }
            let rms = (weight > 0.0).then(|| {
                let (x, y) = (x / weight, y / weight);
                (square / weight - x * x - y * y).max(0.0).sqrt()
            });
            let (height, slope) = paraxial_ghost(system, &paraxial, first, second);
            let reflectance = reflectance(first) * reflectance(second);
            let focus = -height / slope;
            ghosts.push(Ghost {
                first: first + 1,
                second: second + 1,
                reflectance,
                focus_mm: focus.is_finite().then_some(focus),
                paraxial_radius_mm: (height + slope * system.surfaces[system.image() - 1].thickness_mm).abs(),
                rms_radius_mm: rms,
                transmitted: weight,
                irradiance_per_mm2: rms
                    .map(|rms| reflectance * weight / (std::f64::consts::TAU * rms * rms))
                    .filter(|e| e.is_finite()),
            });
        }
    }
    ghosts
        .sort_by(|a, b| b.irradiance_per_mm2.unwrap_or(0.0).total_cmp(&a.irradiance_per_mm2.unwrap_or(0.0)));
    Ok(ghosts)
}

/// Height (mm) and slope of the marginal ray behind the last surface before the image. Light that runs
/// back sees negative indices and distances, so reduced distances stay positive.
fn paraxial_ghost(system: &OpticalSystem, paraxial: &Paraxial, first: usize, second: usize) -> (f64, f64) {
    let indices = paraxial.indices();
    let marginal = paraxial.marginal();
    let left = |i: usize| if i == 0 { 1.0 } else { indices[i - 1] };
    let curvature = |i: usize| system.surfaces[i].shape.vertex_curvature_per_mm();
    let power = |i: usize, from: f64, to: f64| match system.surfaces[i].shape {
        Shape::IdealLens { focal_mm } => 1.0 / focal_mm,
        _ => (to - from) * curvature(i),
    };
    let gap = |i: usize| system.surfaces[i].thickness_mm / indices[i];
    let mut y = marginal[second].y_mm;
    let mut nu = left(second) * marginal[second].u_before;
    nu -= y * power(second, left(second), -left(second));
    for i in (first..second).rev() {
        y += gap(i) * nu;
        let to = if i == first { indices[i] } else { -left(i) };
        nu -= y * power(i, -indices[i], to);
    }
    for i in first + 1..system.image() {
        y += gap(i - 1) * nu;
        nu -= y * power(i, left(i), indices[i]);
    }
    (y, nu / indices[system.image() - 1])
}
