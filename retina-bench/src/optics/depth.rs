//! What the display's depth and the objective's coma do to where a detector finds spots.

use glam::{DMat2, DMat3, DVec2, DVec3};
use rayon::prelude::*;
use retina_geometry::{COMAS_MM, ComaShifts, DEPTHS_MM, RADIAL_KNOTS, RadialTable, Setup, SpotShifts};
use retina_optics::facility::{
    COMA, KernelFrame, KernelGrid, SlopeFit, SpectralLine, WAVEFRONT_TERMS, Wavefront, clear_kernel,
};
use retina_optics::pupil::{PupilPoint, gaussian};
use retina_optics::{Clipping, Launcher, OpticsError, RayBatch, Tracer};

use super::facility_system;
use super::windowed::windowed_in;
use crate::{BenchError, Display};

/// Depth over which the response to coma is taken, mm: that of the edge of a display tilted by a tenth of a degree.
const COMA_DEPTH_MM: f64 = 0.02;
/// Half the even coma over which the response is taken, mm of path at the pupil's rim.
const EVEN_COMA_MM: f64 = 1e-4;
/// Rays over the pupil: they determine a wavefront.
const RINGS: usize = 9;
const ARMS: usize = 22;
/// Samples of an image a pixel, and how far it reaches, px.
const PER_PX: usize = 4;
const HALF_PX: usize = 10;
/// Step of a line of sight for its derivatives, tangents.
const STEP: f64 = 1e-4;

/// What a setup's lenses make of the display's depth and of coma, by images of points at the channels' wavelengths, seen
/// by a detector. `half_tan` is the largest line of sight's tangent. Coma takes most of the time, and is left out where it
/// is not wanted.
///
/// # Errors
/// As [`facility_system`]; a ray that does not arrive.
pub fn spot_shifts(setup: &Setup, half_tan: f64, with_coma: bool) -> Result<SpotShifts, BenchError> {
    let system = facility_system(setup)?;
    let launcher = Launcher::new(&system)?;
    let wavelength = &setup.screen.wavelength_nm;
    let fans = [wavelength.r, wavelength.g, wavelength.b]
        .map(|nm| Tracer::new(&system, nm, Clipping::Off).map(|tracer| (nm, tracer)))
        .into_iter()
        .collect::<Result<Vec<_>, _>>()?;
    let pupil = gaussian(RINGS, ARMS, 0.0);
    let spots = Spots {
        pupil_radius_mm: launcher.ray([0.0; 2], [1.0, 0.0])?.position_mm.x,
        launcher,
        fans,
        slopes: SlopeFit::new(&pupil.iter().map(|point| point.at).collect::<Vec<_>>()),
        pupil,
        focal_px: setup.camera_pinhole().fx_px,
        half_width_tan: 0.5 * f64::from(setup.camera.width_px) / setup.camera_pinhole().fx_px,
        display: Display::new(setup, 0),
    };
    let knots = (1..RADIAL_KNOTS)
        .into_par_iter()
        .map(|k| spots.response(RadialTable::place(half_tan, k), with_coma))
        .collect::<Result<Vec<_>, _>>()?;
    let table =
        |of: &dyn Fn(&Response) -> f64| RadialTable::new(half_tan, std::array::from_fn(|k| of(&knots[k])));
    let of_coma = |of: &dyn Fn(&ComaResponse) -> f64| table(&|knot| knot.coma.as_ref().map_or(0.0, of));
    Ok(SpotShifts {
        height_mm: heights(half_tan, &knots),
        per_depth: std::array::from_fn(|k| table(&|knot| knot.per_depth[k])),
        coma: with_coma.then(|| ComaShifts {
            tangent_per_coma: std::array::from_fn(|k| of_coma(&|coma| coma.tangent_per_coma[k])),
            coma_per_depth: std::array::from_fn(|k| of_coma(&|coma| coma.coma_per_depth[k])),
            tangent_per_even_coma: [0, 1].map(|k| of_coma(&|coma| coma.tangent_per_even_coma[k])),
        }),
    })
}

/// What a place of the display shows.
struct Response {
    /// Tangent of the line of sight on which the detector finds it.
    tangent: f64,
    /// Height on the display over it, mm.
    height_over_tangent_mm: f64,
    /// See [`SpotShifts`].
    per_depth: [f64; DEPTHS_MM.len()],
    coma: Option<ComaResponse>,
}

/// See [`ComaShifts`].
struct ComaResponse {
    tangent_per_coma: [f64; COMAS_MM.len()],
    coma_per_depth: [f64; COMAS_MM.len()],
    tangent_per_even_coma: [f64; 2],
}

struct Spots {
    launcher: Launcher,
    /// Wavelengths, and what traces them.
    fans: Vec<(f64, Tracer)>,
    pupil: Vec<PupilPoint>,
    slopes: SlopeFit,
    pupil_radius_mm: f64,
    focal_px: f64,
    /// Half the camera's width.
    half_width_tan: f64,
    display: Display,
}

/// A ray of a line of sight: where it meets the display (mm), its slope there, and what the line of sight moves it by.
struct Meeting {
    at_mm: DVec2,
    slope: DVec2,
    mm_per_tangent: DMat2,
}

impl Spots {
    /// Of the place whose light, on the average, is on the line of sight (r, 0), by Fourier sums over the pupil.
    fn response(&self, r: f64, with_coma: bool) -> Result<Response, OpticsError> {
        let field = DVec2::new(r, 0.0);
        let meetings = self
            .fans
            .iter()
            .map(|(_, tracer)| self.meetings(tracer, field))
            .collect::<Result<Vec<_>, _>>()?;
        let all = || self.fans.iter().zip(&meetings);
        let count = meetings.len() as f64;
        let mean = |of: &dyn Fn(&Meeting) -> DVec2| -> DVec2 {
            let sum = |fan: &[Meeting]| -> DVec2 {
                fan.iter().zip(&self.pupil).map(|(meeting, point)| point.weight * of(meeting)).sum()
            };
            meetings.iter().map(|fan| sum(fan)).sum::<DVec2>() / count
        };
        let place_mm = mean(&|meeting| meeting.at_mm);
        let px_per_mm = self.focal_px / mean(&|meeting| meeting.mm_per_tangent.x_axis).length();
        let emission_px = 12f64.sqrt() * px_per_mm * self.display.emission_sigma_mm();
        // The light of the place at a depth, as the camera's pupil receives it: each ray to first order in the spot's size.
        let waves = |depth_mm: f64| -> Vec<(Wavefront, SpectralLine)> {
            all()
                .map(|((nm, _), fan)| {
                    let cosines: Vec<f64> = fan
                        .iter()
                        .flat_map(|meeting| {
                            let miss_mm = place_mm - meeting.at_mm - depth_mm * meeting.slope;
                            let tangent = field + meeting.mm_per_tangent.inverse() * miss_mm;
                            (tangent / (1.0 + tangent.length_squared()).sqrt()).to_array()
                        })
                        .collect();
                    (self.slopes.wavefront(&cosines, self.pupil_radius_mm), (*nm, 1.0 / count))
                })
                .collect()
        };
        let frame = KernelFrame { reference: field.to_array(), roll_rad: 0.0 };
        let grid = KernelGrid { focal_px: self.focal_px, per_px: PER_PX, half_px: HALF_PX };
        let seen = |waves: &[(Wavefront, SpectralLine)], coma_mm: DVec2| -> Result<DVec2, OpticsError> {
            let mut terms = [0.0; WAVEFRONT_TERMS];
            (terms[COMA[0]], terms[COMA[1]]) = coma_mm.into();
            let with_coma: Vec<_> = waves.iter().map(|(wave, line)| (wave.plus(&terms), *line)).collect();
            let mut image = clear_kernel(&with_coma, frame, grid)?;
            image.spread([1.0; 2]);
            image.spread([emission_px; 2]);
            Ok(field + DVec2::from(windowed_in(&image)) / self.focal_px)
        };
        let still = |waves: &[_]| Ok::<_, OpticsError>(seen(waves, DVec2::ZERO)?.x);
        let (focused, far) = (waves(0.0), waves(COMA_DEPTH_MM));
        let (tangent, far_tangent) = (still(&focused)?, still(&far)?);
        let mut per_depth = [0.0; DEPTHS_MM.len()];
        for (per_depth, depth_mm) in per_depth.iter_mut().zip(DEPTHS_MM) {
            *per_depth = (still(&waves(depth_mm))? - tangent) / (depth_mm * tangent);
        }
        let coma = || -> Result<ComaResponse, OpticsError> {
            let mut tangent_per_coma = [0.0; COMAS_MM.len()];
            let mut coma_per_depth = [0.0; COMAS_MM.len()];
            for (k, coma_mm) in COMAS_MM.into_iter().enumerate() {
                let coma = DVec2::new(coma_mm * r / self.half_width_tan, 0.0);
                let grown = |waves: &[_], without: f64| {
                    Ok::<_, OpticsError>((seen(waves, coma)?.x - without) / coma.x)
                };
                tangent_per_coma[k] = grown(&focused, tangent)?;
                coma_per_depth[k] = (grown(&far, far_tangent)? - tangent_per_coma[k]) / COMA_DEPTH_MM;
            }
            let even = |axis: DVec2| -> Result<f64, OpticsError> {
                let [plus, minus] = [1.0, -1.0].map(|sign| seen(&focused, sign * EVEN_COMA_MM * axis));
                Ok((plus? - minus?).dot(axis) / (2.0 * EVEN_COMA_MM))
            };
            let tangent_per_even_coma = [even(DVec2::X)?, even(DVec2::Y)?];
            Ok(ComaResponse { tangent_per_coma, coma_per_depth, tangent_per_even_coma })
        };
        Ok(Response {
            tangent,
            height_over_tangent_mm: place_mm.x.abs() / tangent,
            per_depth,
            coma: with_coma.then(coma).transpose()?,
        })
    }

    /// The rays of a line of sight through the pupil's points.
    fn meetings(&self, tracer: &Tracer, field: DVec2) -> Result<Vec<Meeting>, OpticsError> {
        let traced = |field: DVec2| -> Result<RayBatch, OpticsError> {
            let mut rays = RayBatch::with_capacity(self.pupil.len());
            for point in &self.pupil {
                rays.push(&self.launcher.ray(field.to_array(), point.at)?);
            }
            tracer.trace_batch(&mut rays);
            match (0..rays.len()).find_map(|i| rays.failure(i)) {
                None => Ok(rays),
                Some(failure) => Err(OpticsError::Ray {
                    what: format!("a ray of the field ({:.4}, {:.4})", field.x, field.y),
                    failure,
                }),
            }
        };
        let steps = [DVec2::X, -DVec2::X, DVec2::Y, -DVec2::Y].map(|axis| traced(field + STEP * axis));
        let [right, left, up, down] = steps;
        let (middle, right, left, up, down) = (traced(field)?, right?, left?, up?, down?);
        let at = |rays: &RayBatch, i: usize| DVec2::new(rays.x_mm[i], rays.y_mm[i]);
        Ok((0..self.pupil.len())
            .map(|i| Meeting {
                at_mm: at(&middle, i),
                slope: DVec2::new(middle.l[i], middle.m[i]) / middle.n[i],
                mm_per_tangent: DMat2::from_cols(
                    (at(&right, i) - at(&left, i)) / (2.0 * STEP),
                    (at(&up, i) - at(&down, i)) / (2.0 * STEP),
                ),
            })
            .collect())
    }
}

/// h_0, h_1, h_2 of the heights over tangents, mm, by least squares.
fn heights(half_tan: f64, knots: &[Response]) -> [f64; 3] {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for knot in knots {
        // Of parts of the largest field so far.
        let part = knot.tangent / half_tan;
        let row = DVec3::new(1.0, part.powi(2), part.powi(4));
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        right += row * knot.height_over_tangent_mm;
    }
    let h2 = half_tan * half_tan;
    let [a, b, c] = (normal.inverse() * right).to_array();
    [a, b / h2, c / (h2 * h2)]
}
