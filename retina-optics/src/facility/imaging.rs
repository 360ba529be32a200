//! What the camera receives of a point of the screen: direction and wavefront at the camera's pupil,
//! tabulated over the screen, wavelength and defocus.
//!
//! Paths are reversible. For a point of the screen and points of the pupil, the rays between them are
//! found on the traced system; their direction cosines at the pupil are the gradient of the eikonal V
//! there, which is fitted by Zernike polynomials. Its coefficients are smooth in the point, the wavelength
//! and the defocus: Chebyshev products over the screen, Chebyshev points in the other two. Everything a
//! camera can see of the point follows from V: where it stands (the tilts), the geometric spot (grad V)
//! and, by one Fourier sum, the diffraction image ([`super::Kernel`]).
//!
//! Screen points are in the display's axes (see [`super`]), mm from the axis.

use std::sync::{Arc, PoisonError, RwLock};

use rayon::prelude::*;
use serde::Serialize;

use super::Chebyshev2;
use super::zernike::{self, Polynomial, PupilSlopes, SIDE, SlopeFit, WAVEFRONT_TERMS, horner};
use crate::pupil::gaussian;
use crate::{Clipping, Launcher, OpticalSystem, OpticsError, RayBatch, Tracer};

/// How finely the wavefronts are tabulated.
#[derive(Debug, Clone, PartialEq)]
pub struct ImagingOptions {
    /// Half extents of the part of the screen that is tabulated, mm.
    pub half_screen_mm: [f64; 2],
    /// Chebyshev nodes along each axis of the screen.
    pub nodes: usize,
    /// Range of wavelengths, nm.
    pub wavelengths_nm: [f64; 2],
    /// Nodes in it.
    pub wavelength_nodes: usize,
    /// The screen may stand this far before or behind the image surface, mm; 0 for no range.
    pub defocus_mm: f64,
}

impl ImagingOptions {
    /// 12 nodes an axis, 8 wavelengths from 420 to 700 nm, no range of defocus.
    pub fn new(half_screen_mm: [f64; 2]) -> Self {
        Self {
            half_screen_mm,
            nodes: 12,
            wavelengths_nm: [420.0, 700.0],
            wavelength_nodes: 8,
            defocus_mm: 0.0,
        }
    }
}

/// Largest differences between table and trace, at places between the nodes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ImagingErrors {
    /// Direction of a single ray through the pupil, rad.
    pub direction_rad: f64,
    /// The same, RMS over the pupil, rad.
    pub direction_rms_rad: f64,
}

/// The eikonal at the camera's pupil of the light of one screen point: V = sum of coefficients times
/// Zernike polynomials of the pupil point over its radius, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wavefront {
    /// Coefficients, mm; the tilts along x and y first.
    pub coefficients_mm: [f64; WAVEFRONT_TERMS],
    /// Radius of the pupil, mm.
    pub pupil_radius_mm: f64,
}

impl Wavefront {
    /// Direction cosines (towards the screen point, the camera's axes) of the tilts: the reference of a
    /// PSF. The centroid of the light differs from it by what coma adds.
    pub fn reference(&self) -> [f64; 2] {
        [self.coefficients_mm[0] / self.pupil_radius_mm, self.coefficients_mm[1] / self.pupil_radius_mm]
    }

    /// The reference as tangents.
    pub fn reference_tangents(&self) -> [f64; 2] {
        tangents(self.reference())
    }

    /// Direction cosines of the centroid of the light, the pupil being clear: the mean of grad V over the
    /// disc. By Gauss's theorem it is that of the first harmonic on the rim, where each term is 1.
    pub fn centroid(&self) -> [f64; 2] {
        [0, 1].map(|axis| {
            let sum: f64 = zernike::first_harmonics(axis).map(|k| self.coefficients_mm[k]).sum();
            sum / self.pupil_radius_mm
        })
    }

    /// With coefficients of another surface's making added, mm.
    pub fn plus(mut self, added_mm: &[f64; WAVEFRONT_TERMS]) -> Self {
        self.coefficients_mm.iter_mut().zip(added_mm).for_each(|(c, a)| *c += a);
        self
    }
}

/// Tangents (x, y) of direction cosines.
pub fn tangents([l, m]: [f64; 2]) -> [f64; 2] {
    let n = (1.0 - l * l - m * m).sqrt();
    [l / n, m / n]
}

/// The camera's side of the facility, tabulated.
#[derive(Debug, Clone)]
pub struct Imaging {
    system: OpticalSystem,
    options: ImagingOptions,
    pupil_radius_mm: f64,
    /// Index: defocus node * wavelength nodes + wavelength node.
    tables: Vec<Table>,
    lines: Lines,
    errors: ImagingErrors,
}

/// Wavefronts over the screen.
type Table = Chebyshev2<WAVEFRONT_TERMS>;

/// Tables of wavelengths that were asked for, each one a defocus node: a source has few lines, and is looked at in many
/// places.
#[derive(Debug, Clone, Default)]
struct Lines(Arc<RwLock<Vec<Line>>>);

/// A wavelength, nm, with its tables.
type Line = (f64, Arc<Vec<Table>>);

/// Wavelengths whose tables are kept.
const MOST_LINES: usize = 64;

/// Solves for the rays that join pupil points with screen points.
struct Joiner<'a> {
    launcher: &'a Launcher,
    tracer: Tracer,
}

/// Distance from the wanted point of the screen at which a ray has arrived, mm.
const ARRIVED_MM: f64 = 1e-11;

/// A ray on its way to a screen point.
#[derive(Clone, Copy)]
struct Joined {
    /// Its tangents at the pupil.
    tan: [f64; 2],
    /// Their last step, and by how much the ray missed before it, mm.
    step: [f64; 2],
    miss: [f64; 2],
    /// Derivatives of the tangents by the landing place.
    inverse: [[f64; 2]; 2],
}

/// A matrix times a vector.
fn times([[a, b], [c, d]]: [[f64; 2]; 2], [x, y]: [f64; 2]) -> [f64; 2] {
    [a * x + b * y, c * x + d * y]
}

impl Joined {
    /// A step towards the screen point that is missed. What the last step did corrects the derivatives: with s the step,
    /// y the way on the screen and B the derivatives, B becomes B + (s - B y) s^T B / (s^T B y).
    fn advance(&mut self, miss: [f64; 2], stepped: bool) {
        if stepped {
            let [s, way] = [self.step, [self.miss[0] - miss[0], self.miss[1] - miss[1]]];
            let predicted = times(self.inverse, way);
            let [[a, b], [c, d]] = self.inverse;
            let row = [s[0] * a + s[1] * c, s[0] * b + s[1] * d];
            let by = row[0] * way[0] + row[1] * way[1];
            if by != 0.0 {
                let off = [(s[0] - predicted[0]) / by, (s[1] - predicted[1]) / by];
                self.inverse = [0, 1].map(|i| [0, 1].map(|j| self.inverse[i][j] + off[i] * row[j]));
            }
        }
        self.step = times(self.inverse, miss);
        self.miss = miss;
        self.tan = [self.tan[0] + self.step[0], self.tan[1] + self.step[1]];
    }
}

impl Joiner<'_> {
    /// Where the rays land, in the display's axes.
    fn land(&self, pupil: &[[f64; 2]], tans: &[[f64; 2]]) -> Result<Vec<[f64; 2]>, OpticsError> {
        let mut rays = RayBatch::with_capacity(pupil.len());
        for (at, tan) in pupil.iter().zip(tans) {
            rays.push(&self.launcher.ray(*tan, *at)?);
        }
        self.tracer.trace_batch(&mut rays);
        (0..pupil.len())
            .map(|i| match rays.failure(i) {
                None => Ok([-rays.x_mm[i], -rays.y_mm[i]]),
                Some(failure) => Err(OpticsError::Ray {
                    what: format!("line of sight ({:.4}, {:.4})", tans[i][0], tans[i][1]),
                    failure,
                }),
            })
            .collect()
    }

    /// Tangents at the pupil points of the rays to a screen point, by Broyden's method from the derivatives of the chief
    /// ray (C. G. Broyden, Mathematics of Computation 19, 1965).
    fn join(&self, pupil: &[[f64; 2]], screen_mm: [f64; 2]) -> Result<Vec<[f64; 2]>, OpticsError> {
        let h = 1e-4;
        let slope = |tan: [f64; 2]| {
            let landed = self.land(&[[0.0; 2]; 3], &[tan, [tan[0] + h, tan[1]], [tan[0], tan[1] + h]])?;
            let [a, c] = [0, 1].map(|k| (landed[1][k] - landed[0][k]) / h);
            let [b, d] = [0, 1].map(|k| (landed[2][k] - landed[0][k]) / h);
            Ok::<_, OpticsError>((landed[0], [[a, b], [c, d]]))
        };
        let inverse = |[[a, b], [c, d]]: [[f64; 2]; 2]| {
            let det = a * d - b * c;
            [[d / det, -b / det], [-c / det, a / det]]
        };
        let mut chief = [0.0; 2];
        let mut jacobian = [[0.0; 2]; 2];
        for _ in 0..4 {
            let (landed, here) = slope(chief)?;
            let d = times(inverse(here), [screen_mm[0] - landed[0], screen_mm[1] - landed[1]]);
            chief = [chief[0] + d[0], chief[1] + d[1]];
            jacobian = here;
        }
        let mut rays: Vec<Joined> =
            vec![
                Joined { tan: chief, step: [0.0; 2], miss: [0.0; 2], inverse: inverse(jacobian) };
                pupil.len()
            ];
        for iteration in 0..40 {
            let mut worst: f64 = 0.0;
            let tans: Vec<[f64; 2]> = rays.iter().map(|ray| ray.tan).collect();
            for (ray, landed) in rays.iter_mut().zip(self.land(pupil, &tans)?) {
                let miss = [screen_mm[0] - landed[0], screen_mm[1] - landed[1]];
                let square = miss[0] * miss[0] + miss[1] * miss[1];
                worst = worst.max(square);
                // Where a ray has arrived, a step is rounding and says nothing of derivatives.
                if square >= ARRIVED_MM * ARRIVED_MM {
                    ray.advance(miss, iteration > 0);
                }
            }
            if worst < ARRIVED_MM * ARRIVED_MM {
                return Ok(rays.into_iter().map(|ray| ray.tan).collect());
            }
        }
        Err(OpticsError::Undefined(format!(
            "no rays join the pupil with the screen point ({:.3}, {:.3}) mm",
            screen_mm[0], screen_mm[1]
        )))
    }

    /// Direction cosines, x and y in turn.
    fn slopes(&self, pupil: &[[f64; 2]], screen_mm: [f64; 2]) -> Result<Vec<f64>, OpticsError> {
        let tans = self.join(pupil, screen_mm)?;
        Ok(tans
            .into_iter()
            .flat_map(|[x, y]| {
                let n = 1.0 / (1.0 + x * x + y * y).sqrt();
                [x * n, y * n]
            })
            .collect())
    }
}

/// Radius of the rays along the pupil's rim: rounding must not decide whether the pupil's own aperture cuts them.
const RIM: f64 = 1.0 - 1e-9;

/// Chebyshev points of the first kind in `[low, high]`; one point is the middle.
fn nodes_in([low, high]: [f64; 2], count: usize) -> Vec<f64> {
    (0..count)
        .map(|k| {
            let angle = std::f64::consts::PI * (k as f64 + 0.5) / count as f64;
            0.5 * (low + high) - 0.5 * (high - low) * angle.cos()
        })
        .collect()
}

/// Lagrange's weights of the nodes at `at`.
fn weights(nodes: &[f64], at: f64) -> Vec<f64> {
    (0..nodes.len())
        .map(|i| {
            let others = nodes.iter().enumerate().filter(|&(k, _)| k != i);
            others.map(|(_, node)| (at - node) / (nodes[i] - node)).product()
        })
        .collect()
}

fn defocused(system: &OpticalSystem, defocus_mm: f64) -> OpticalSystem {
    let mut system = system.clone();
    let last = system.image() - 1;
    system.surfaces[last].thickness_mm += defocus_mm;
    system
}

impl Imaging {
    /// Tabulates a system that begins with the camera's pupil and ends with the screen, apertures open.
    ///
    /// # Errors
    /// Options that are not usable; rays that do not arrive from some point of the screen.
    pub fn new(system: &OpticalSystem, options: ImagingOptions) -> Result<Self, OpticsError> {
        let [low_nm, high_nm] = options.wavelengths_nm;
        let extents = [options.half_screen_mm[0], options.half_screen_mm[1], low_nm, high_nm - low_nm];
        let real = extents.iter().all(|v| *v > 0.0 && v.is_finite())
            && options.defocus_mm >= 0.0
            && options.defocus_mm.is_finite();
        if !real || options.nodes < 4 || options.wavelength_nodes < 2 {
            return Err(OpticsError::Undefined(
                "imaging needs a screen and a range of wavelengths of positive extent, 4 nodes and 2 \
                 wavelengths at least"
                    .into(),
            ));
        }
        let launcher = Launcher::new(system)?;
        let pupil_radius_mm = launcher.ray([0.0; 2], [1.0, 0.0])?.position_mm.x;
        let points: Vec<[f64; 2]> = gaussian(9, 22, 0.0).iter().map(|p| p.at).collect();
        let fit = SlopeFit::new(&points);
        let mut imaging = Self {
            system: system.clone(),
            options,
            pupil_radius_mm,
            tables: Vec::new(),
            lines: Lines::default(),
            errors: Default::default(),
        };
        let cells: Vec<(f64, f64)> = imaging
            .defocus_nodes()
            .into_iter()
            .flat_map(|z| imaging.wavelength_nodes().into_iter().map(move |nm| (z, nm)))
            .collect();
        imaging.tables = cells
            .into_par_iter()
            .map(|(defocus_mm, nm)| {
                let system = defocused(system, defocus_mm);
                let joiner = Joiner { launcher: &launcher, tracer: Tracer::new(&system, nm, Clipping::Off)? };
                Chebyshev2::new(imaging.options.half_screen_mm, imaging.options.nodes, |at| {
                    let slopes = joiner.slopes(&points, at)?;
                    Ok::<_, OpticsError>(fit.wavefront(&slopes, pupil_radius_mm).coefficients_mm)
                })
            })
            .collect::<Result<_, _>>()?;
        imaging.errors = imaging.measure(&launcher)?;
        Ok(imaging)
    }

    fn wavelength_nodes(&self) -> Vec<f64> {
        nodes_in(self.options.wavelengths_nm, self.options.wavelength_nodes)
    }

    fn defocus_nodes(&self) -> Vec<f64> {
        let z = self.options.defocus_mm;
        nodes_in([-z, z], if z > 0.0 { 5 } else { 1 })
    }

    /// Table against trace between the nodes, over screen, wavelengths and defocus.
    fn measure(&self, launcher: &Launcher) -> Result<ImagingErrors, OpticsError> {
        let points: Vec<[f64; 2]> = gaussian(5, 9, 0.0).iter().map(|p| p.at).chain([[0.0, 1.0]]).collect();
        let slopes = PupilSlopes::new(points.iter().copied());
        let [low, high] = self.options.wavelengths_nm;
        let side = 7;
        let cases: Vec<(usize, f64, f64)> = [0.03, 0.37, 0.71, 0.98]
            .iter()
            .flat_map(|share| [-0.9, 0.45].map(|z| (low + share * (high - low), z * self.options.defocus_mm)))
            .flat_map(|(nm, z)| (0..side * side).map(move |i| (i, nm, z)))
            .collect();
        let found: Vec<ImagingErrors> = cases
            .into_par_iter()
            .map(|(i, nm, z)| {
                let system = defocused(&self.system, z);
                let joiner = Joiner { launcher, tracer: Tracer::new(&system, nm, Clipping::Off)? };
                let at = [i % side, i / side];
                let screen = [0, 1].map(|k| {
                    self.options.half_screen_mm[k] * (2.0 * at[k] as f64 / (side as f64 - 1.0) - 1.0) * 0.99
                });
                let wavefront = self.wavefront(screen, nm, z);
                let exact = joiner.slopes(&points, screen)?;
                let mut errors = ImagingErrors::default();
                let mut square = 0.0;
                for (got, exact) in slopes.directions(&wavefront).into_iter().zip(exact.chunks_exact(2)) {
                    let miss = (got[0] - exact[0]).hypot(got[1] - exact[1]);
                    errors.direction_rad = errors.direction_rad.max(miss);
                    square += miss * miss / points.len() as f64;
                }
                errors.direction_rms_rad = square.sqrt();
                Ok(errors)
            })
            .collect::<Result<_, OpticsError>>()?;
        Ok(found.into_iter().fold(ImagingErrors::default(), |worst, error| ImagingErrors {
            direction_rad: worst.direction_rad.max(error.direction_rad),
            direction_rms_rad: worst.direction_rms_rad.max(error.direction_rms_rad),
        }))
    }

    /// The system behind the tables.
    pub fn system(&self) -> &OpticalSystem {
        &self.system
    }

    /// Largest errors of the tables, measured between their nodes.
    pub fn errors(&self) -> ImagingErrors {
        self.errors
    }

    /// Whether a screen point is tabulated.
    pub fn contains(&self, screen_mm: [f64; 2]) -> bool {
        (0..2).all(|k| screen_mm[k].abs() <= self.options.half_screen_mm[k])
    }

    /// The wavefront of a screen point at a wavelength (nm), the screen standing `defocus_mm` behind the
    /// system's image surface. Outside the tabulated ranges the result has no meaning.
    pub fn wavefront(&self, screen_mm: [f64; 2], wavelength_nm: f64, defocus_mm: f64) -> Wavefront {
        let tables = self.line(wavelength_nm);
        let depths = weights(&self.defocus_nodes(), defocus_mm);
        let mut coefficients_mm = [0.0; WAVEFRONT_TERMS];
        for (table, weight) in tables.iter().zip(depths) {
            let values = table.at(screen_mm);
            coefficients_mm.iter_mut().zip(values).for_each(|(c, v)| *c += weight * v);
        }
        Wavefront { coefficients_mm, pupil_radius_mm: self.pupil_radius_mm }
    }

    /// The tables of a wavelength.
    fn line(&self, wavelength_nm: f64) -> Arc<Vec<Table>> {
        let find = |known: &[Line]| {
            known.iter().find(|(nm, _)| *nm == wavelength_nm).map(|(_, tables)| Arc::clone(tables))
        };
        if let Some(known) = find(&self.lines.0.read().unwrap_or_else(PoisonError::into_inner)) {
            return known;
        }
        let colours = weights(&self.wavelength_nodes(), wavelength_nm);
        let of_depth = |tables: &[Table]| Table::weighted_sum(tables, &colours);
        let made = Arc::new(self.tables.chunks(colours.len()).map(of_depth).collect());
        let mut known = self.lines.0.write().unwrap_or_else(PoisonError::into_inner);
        if find(&known).is_none() && known.len() < MOST_LINES {
            known.push((wavelength_nm, Arc::clone(&made)));
        }
        made
    }

    /// Which cells of the pupil the apertures leave to a wavefront of this system, on a grid of `side` cells
    /// over the square about the unit disc, row by row; `None` where nothing is cut.
    ///
    /// # Errors
    /// As [`Tracer::new`].
    pub fn pupil_mask(
        &self,
        wavefront: &Wavefront,
        wavelength_nm: f64,
        side: usize,
    ) -> Result<Option<Vec<bool>>, OpticsError> {
        let launcher = Launcher::new(&self.system)?;
        let tracer = Tracer::new(&self.system, wavelength_nm, Clipping::On)?;
        let slopes = Polynomial::of_terms(&wavefront.coefficients_mm).gradient();
        let arrive = |points: &[[f64; 2]]| -> Result<Vec<bool>, OpticsError> {
            let mut rays = RayBatch::with_capacity(points.len());
            // Points of one row follow one another, and share what depends on y alone.
            let mut row = (f64::NAN, [[0.0; SIDE]; 2]);
            for &[x, y] in points {
                if y != row.0 {
                    row = (y, [0, 1].map(|k| slopes[k].on_row(y)));
                }
                let direction = row.1.map(|line| horner(&line, x) / wavefront.pupil_radius_mm);
                rays.push(&launcher.ray(tangents(direction), [x, y])?);
            }
            tracer.trace_batch(&mut rays);
            Ok((0..points.len()).map(|i| rays.arrived(i)).collect())
        };
        // An aperture cuts from the rim inwards, an obstruction anywhere.
        let scouts: Vec<[f64; 2]> = (0..48)
            .map(|k| {
                let angle = std::f64::consts::TAU * f64::from(k) / 48.0;
                [RIM * angle.cos(), RIM * angle.sin()]
            })
            .chain(super::sunflower(60).into_iter().map(|point| point.at))
            .collect();
        if arrive(&scouts)?.into_iter().all(|passes| passes) {
            return Ok(None);
        }
        let at = |i: usize| 2.0 * (i as f64 + 0.5) / side as f64 - 1.0;
        let inside = |[x, y]: [f64; 2]| {
            let shrink = (RIM / (x * x + y * y).sqrt()).min(1.0);
            [x * shrink, y * shrink]
        };
        let grid: Vec<[f64; 2]> = (0..side * side).map(|i| inside([at(i % side), at(i / side)])).collect();
        arrive(&grid).map(Some)
    }
}
