//! The facility's optics as the rest of the project uses them: smooth functions of the line of sight.
//!
//! Built from a traced system (camera pupil -> collimator -> relay -> screen; groups may be tilted or
//! decentred). For each wavelength, the traced centroid of the light on the screen and the second moments of the spot are
//! interpolated by products of Chebyshev polynomials of a degree far above any calibration's
//! polynomial, through traced points; the largest error at lines of sight between them is measured and
//! kept. The transmission, which has kinks where an aperture begins to cut, is interpolated linearly on
//! a fine grid instead.
//!
//! Frame: a line of sight is (x, y, 1) in the camera's frame, x right, y down. Light is traced from the
//! camera's pupil to the screen; paths are reversible. The intermediate image is inverted, so a line of
//! sight ends at -f (x, y) in the camera's axes: the display is mounted turned by 180 deg about the axis,
//! and in its own axes (x right, y down, as its pixels count) it shows the line of sight at +f (x, y).
//! Positions on the screen are in the display's axes.

mod chebyshev;
mod imaging;
mod kernel;
mod transmission;
mod zernike;

pub use chebyshev::Chebyshev2;
pub use imaging::{Imaging, ImagingErrors, ImagingOptions, Wavefront, tangents};
pub use kernel::{Kernel, KernelFrame, KernelGrid, SpectralLine, airy_kernel, clear_kernel};
pub use transmission::TransmissionGrid;
pub use zernike::{COMA, PupilSlopes, SlopeFit, TILT, WAVEFRONT_TERMS};

use std::f64::consts::PI;

use rayon::prelude::*;
use serde::Serialize;

use crate::analysis::{Psf, psf};
use crate::glass::Medium;
use crate::pupil::{PupilPoint, gaussian};
use crate::search::{FacilityDesign, ScreenFocus, SearchRequest, evaluate};
use crate::{Clipping, Launcher, OpticalSystem, OpticsError, RayBatch, Tracer};

/// How finely a facility is tabulated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacilityOptions {
    /// Half extents of the field that is tabulated, tangents along x and y.
    pub half_field_tan: [f64; 2],
    /// Chebyshev nodes along each axis.
    pub nodes: usize,
    /// Intervals of the transmission's grid along each axis.
    pub transmission_intervals: usize,
    /// Transmission of each surface between air and glass, 0 to 1: of its coating, which no catalogue of
    /// lens shapes holds.
    pub surface_transmission: f64,
}

impl FacilityOptions {
    /// 12 nodes and 64 intervals over this field.
    pub fn new(half_field_tan: [f64; 2], surface_transmission: f64) -> Self {
        Self { half_field_tan, nodes: 12, transmission_intervals: 64, surface_transmission }
    }
}

/// Largest differences between the tables and the traced system at lines of sight between the nodes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct FacilityErrors {
    /// Position on the screen, mm.
    pub position_mm: f64,
    /// Square root of the difference of second moments, mm.
    pub spot_mm: f64,
    /// Transmitted share.
    pub transmission: f64,
}

/// Second moments of a spot about its centroid, mm^2 on the screen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpotMoments {
    /// `<x x>`.
    pub xx_mm2: f64,
    /// `<x y>`.
    pub xy_mm2: f64,
    /// `<y y>`.
    pub yy_mm2: f64,
}

impl SpotMoments {
    /// RMS radius, mm.
    pub fn rms_mm(&self) -> f64 {
        (self.xx_mm2 + self.yy_mm2).max(0.0).sqrt()
    }
}

/// Functions tabulated for a wavelength: centroid (2), mean slopes (2), then the moments xx, xy, yy of
/// positions, of positions with slopes, and of slopes, from which any defocus follows exactly.
const FUNCTIONS: usize = 13;

/// The facility as smooth functions of the line of sight.
#[derive(Debug, Clone)]
pub struct FacilityOptics {
    system: OpticalSystem,
    options: FacilityOptions,
    tables: Vec<Chebyshev2<FUNCTIONS>>,
    transmission: Vec<TransmissionGrid>,
    errors: FacilityErrors,
}

/// What is traced at one line of sight and wavelength.
fn traced(
    tracer: &Tracer,
    launcher: &Launcher,
    pupil: &[PupilPoint],
    los: [f64; 2],
) -> Result<[f64; FUNCTIONS], OpticsError> {
    let mut rays = RayBatch::with_capacity(pupil.len());
    for point in pupil {
        rays.push(&launcher.ray(los, point.at)?);
    }
    tracer.trace_batch(&mut rays);
    let mut mean = [0.0; 4];
    let mut values = Vec::with_capacity(pupil.len());
    for (i, point) in pupil.iter().enumerate() {
        if let Some(failure) = rays.failure(i) {
            let what = format!("line of sight ({}, {})", los[0], los[1]);
            return Err(OpticsError::Ray { what, failure });
        }
        let value = [rays.x_mm[i], rays.y_mm[i], rays.l[i] / rays.n[i], rays.m[i] / rays.n[i]];
        mean.iter_mut().zip(value).for_each(|(m, v)| *m += point.weight * v);
        values.push((point.weight, value));
    }
    let mut result = [0.0; FUNCTIONS];
    // The turned display: positions and slopes change their signs, their products do not.
    result[..4].iter_mut().zip(mean).for_each(|(r, m)| *r = -m);
    for (weight, value) in values {
        let d: [f64; 4] = std::array::from_fn(|k| value[k] - mean[k]);
        let products = [
            d[0] * d[0],
            d[0] * d[1],
            d[1] * d[1],
            d[0] * d[2],
            0.5 * (d[0] * d[3] + d[1] * d[2]),
            d[1] * d[3],
            d[2] * d[2],
            d[2] * d[3],
            d[3] * d[3],
        ];
        result[4..].iter_mut().zip(products).for_each(|(r, p)| *r += weight * p);
    }
    Ok(result)
}

/// Rays that measure what the apertures take: the share is good to about 0.3 %.
const VIGNETTING_RAYS: usize = 1000;

/// Points of equal weight spread evenly over the unit disc, on Vogel's spiral (H. Vogel, Math. Biosci. 44,
/// 179 (1979)): an edge that moves across takes them one by one.
fn sunflower(count: usize) -> Vec<PupilPoint> {
    let golden_rad = PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|i| {
            let (r, angle) = (((i as f64 + 0.5) / count as f64).sqrt(), i as f64 * golden_rad);
            PupilPoint { at: [r * angle.cos(), r * angle.sin()], weight: 1.0 / count as f64 }
        })
        .collect()
}

impl FacilityOptics {
    /// Tabulates a system that begins with the camera's pupil and ends with the screen.
    ///
    /// # Errors
    /// Options that are not usable; a line of sight of which a ray does not arrive, apertures open.
    pub fn new(system: &OpticalSystem, options: FacilityOptions) -> Result<Self, OpticsError> {
        let [x, y] = options.half_field_tan;
        if !(x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite())
            || options.nodes < 4
            || options.transmission_intervals < 2
        {
            return Err(OpticsError::Undefined(
                "a facility needs a field of positive extent, at least 4 nodes and 2 intervals".into(),
            ));
        }
        if !(options.surface_transmission > 0.0 && options.surface_transmission <= 1.0) {
            return Err(OpticsError::Undefined("the transmission of a surface lies in (0, 1]".into()));
        }
        let pupil = gaussian(6, 12, 0.0);
        let launcher = Launcher::new(system)?;
        let open = crate::analysis::tracers(system, Clipping::Off)?;
        let clipped = crate::analysis::tracers(system, Clipping::On)?;
        let tables = open
            .iter()
            .map(|tracer| {
                Chebyshev2::new(options.half_field_tan, options.nodes, |los| {
                    traced(tracer, &launcher, &pupil, los)
                })
            })
            .collect::<Result<Vec<_>, _>>()?;
        let in_air = |i: usize| system.surfaces[i].medium == Medium::Air;
        let coated = (1..system.surfaces.len()).filter(|&i| in_air(i - 1) != in_air(i)).count();
        let coating = options.surface_transmission.powi(coated as i32);
        let fine = sunflower(VIGNETTING_RAYS);
        let share = |tracer: &Tracer, los: [f64; 2]| {
            let mut rays = RayBatch::with_capacity(fine.len());
            for point in &fine {
                rays.push(&launcher.ray(los, point.at)?);
            }
            tracer.trace_batch(&mut rays);
            Ok::<_, OpticsError>(
                coating * (0..fine.len()).filter(|&i| rays.arrived(i)).map(|i| fine[i].weight).sum::<f64>(),
            )
        };
        let transmission = clipped
            .iter()
            .map(|tracer| {
                let grid = |los| share(tracer, los);
                TransmissionGrid::new(options.half_field_tan, options.transmission_intervals, grid)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let mut optics =
            Self { system: system.clone(), options, tables, transmission, errors: FacilityErrors::default() };
        // Between the nodes: a grid of a prime side, offset from both tables.
        let side = 23;
        let at = |i: usize, half: f64| half * ((2 * i + 1) as f64 / side as f64 - 1.0);
        let errors: Vec<FacilityErrors> = (0..side * side)
            .into_par_iter()
            .map(|i| {
                let los = [at(i % side, x), at(i / side, y)];
                let mut errors = FacilityErrors::default();
                for wavelength in 0..optics.tables.len() {
                    let exact = traced(&open[wavelength], &launcher, &pupil, los)?;
                    let table = optics.tables[wavelength].at(los);
                    errors.position_mm =
                        errors.position_mm.max((exact[0] - table[0]).hypot(exact[1] - table[1]));
                    let spot = (4..7).map(|k| (exact[k] - table[k]).abs()).fold(0.0, f64::max).sqrt();
                    errors.spot_mm = errors.spot_mm.max(spot);
                    let share = share(&clipped[wavelength], los)?;
                    errors.transmission =
                        errors.transmission.max((share - optics.transmission[wavelength].at(los)).abs());
                }
                Ok(errors)
            })
            .collect::<Result<_, OpticsError>>()?;
        for error in errors {
            optics.errors.position_mm = optics.errors.position_mm.max(error.position_mm);
            optics.errors.spot_mm = optics.errors.spot_mm.max(error.spot_mm);
            optics.errors.transmission = optics.errors.transmission.max(error.transmission);
        }
        Ok(optics)
    }

    /// A design's configuration (by index in the request), its screen at the best common focus; the request's
    /// magnifications place its groups.
    ///
    /// # Errors
    /// As [`evaluate`] and [`FacilityOptics::new`]; a configuration that the request does not have.
    pub fn of_design(
        design: &FacilityDesign,
        request: &SearchRequest,
        configuration: usize,
        options: FacilityOptions,
    ) -> Result<Self, OpticsError> {
        let (_, systems) = evaluate(design, request, ScreenFocus::Best)?;
        let system = systems.get(configuration).ok_or_else(|| {
            OpticsError::Undefined(format!(
                "the request has no configuration {configuration}, it has {}",
                systems.len()
            ))
        })?;
        Self::new(system, options)
    }

    /// Largest errors of the tables, measured between their nodes.
    pub fn errors(&self) -> FacilityErrors {
        self.errors
    }

    /// The system behind the tables.
    pub fn system(&self) -> &OpticalSystem {
        &self.system
    }

    /// Whether a line of sight lies in the tabulated field.
    pub fn contains(&self, los: [f64; 2]) -> bool {
        los[0].abs() <= self.options.half_field_tan[0] && los[1].abs() <= self.options.half_field_tan[1]
    }

    /// Where on the screen (mm from the axis) a line of sight is shown, at a wavelength of the system
    /// (by index): the centroid of the light. Outside the tabulated field the result has no meaning.
    pub fn screen_mm(&self, los: [f64; 2], wavelength: usize) -> [f64; 2] {
        let values = self.tables[wavelength].at(los);
        [values[0], values[1]]
    }

    /// d(screen) / d(line of sight), mm: rows x and y of the screen.
    pub fn jacobian_mm(&self, los: [f64; 2], wavelength: usize) -> [[f64; 2]; 2] {
        let [along_x, along_y] = self.tables[wavelength].gradient(los);
        [[along_x[0], along_y[0]], [along_x[1], along_y[1]]]
    }

    /// The line of sight that a point of the screen (mm) shows; `None` where it lies outside the
    /// tabulated field. By Newton's method to rounding.
    pub fn line_of_sight(&self, screen_mm: [f64; 2], wavelength: usize) -> Option<[f64; 2]> {
        let mut los = [0.0; 2];
        for _ in 0..30 {
            let at = self.screen_mm(los, wavelength);
            let miss = [screen_mm[0] - at[0], screen_mm[1] - at[1]];
            let [[a, b], [c, d]] = self.jacobian_mm(los, wavelength);
            let determinant = a * d - b * c;
            let step = [(d * miss[0] - b * miss[1]) / determinant, (a * miss[1] - c * miss[0]) / determinant];
            // A step that leaves the field is cut at its edge: the table means nothing beyond.
            for k in 0..2 {
                let half = 1.000_001 * self.options.half_field_tan[k];
                los[k] = (los[k] + step[k]).clamp(-half, half);
            }
            if step[0].hypot(step[1]) < 1e-15 + 1e-14 * los[0].hypot(los[1]) {
                break;
            }
        }
        let at = self.screen_mm(los, wavelength);
        let arrived = (at[0] - screen_mm[0]).hypot(at[1] - screen_mm[1]) < 1e-9;
        (arrived && self.contains(los)).then_some(los)
    }

    /// The geometric spot of a line of sight when the screen stands `defocus_mm` behind the system's
    /// image surface; exact in the defocus.
    pub fn spot(&self, los: [f64; 2], wavelength: usize, defocus_mm: f64) -> SpotMoments {
        let values = self.tables[wavelength].at(los);
        let moment =
            |k: usize| values[4 + k] + defocus_mm * (2.0 * values[7 + k] + defocus_mm * values[10 + k]);
        SpotMoments { xx_mm2: moment(0), xy_mm2: moment(1), yy_mm2: moment(2) }
    }

    /// The diffraction PSF of a line of sight, traced anew and not tabulated, in the camera's axes on the
    /// screen: `pupil_side` points across the pupil, padded to `side`.
    ///
    /// # Errors
    /// As [`psf`].
    pub fn psf(
        &self,
        los: [f64; 2],
        wavelength_nm: f64,
        defocus_mm: f64,
        [pupil_side, side]: [usize; 2],
    ) -> Result<Psf, OpticsError> {
        let mut system = self.system.clone();
        let last = system.image() - 1;
        system.surfaces[last].thickness_mm += defocus_mm;
        psf(&system, los, wavelength_nm, pupil_side, side, Clipping::On)
    }

    /// Share of the light of a line of sight that reaches the camera's pupil: apertures and surfaces.
    pub fn transmission(&self, los: [f64; 2], wavelength: usize) -> f64 {
        self.transmission[wavelength].at(los)
    }

    /// Focal length of the facility seen from the camera on the axis, mm: d(screen) / d(tangent).
    pub fn focal_mm(&self, wavelength: usize) -> f64 {
        let [[a, b], [c, d]] = self.jacobian_mm([0.0; 2], wavelength);
        (a * d - b * c).abs().sqrt()
    }
}

#[cfg(test)]
mod tests;
