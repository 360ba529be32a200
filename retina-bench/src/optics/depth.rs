//! What the display's depth and the objective's coma do to where a detector finds spots.

use glam::{DMat2, DMat3, DVec2, DVec3};
use rayon::prelude::*;
use retina_geometry::{COMAS_MM, DEPTH_KNOTS, DisplayRays, Setup};
use retina_optics::pupil::PupilPoint;
use retina_optics::{Clipping, Launcher, OpticsError, RayBatch, Tracer};

use super::facility_system;
use super::windowed::{Sampling, pupil_points, windowed_mean};
use crate::{BenchError, Display};

/// Half the depth over which the response is taken, mm: that of the edge of a display tilted by a tenth of a degree.
/// (Cores do not move in proportion to the depth.)
const DEPTH_MM: f64 = 0.02;
/// Half the even coma over which the response is taken, mm of path at the pupil's rim.
const EVEN_COMA_MM: f64 = 1e-4;
/// Step of a line of sight for its derivatives, tangents.
const STEP: f64 = 1e-4;

/// What a setup's lenses make of the display's depth and of coma, by rays over the whole pupil at the channels'
/// wavelengths, seen by a detector. `half_tan` is the largest line of sight's tangent.
///
/// # Errors
/// As [`facility_system`]; a ray that does not arrive.
pub fn display_rays(setup: &Setup, half_tan: f64) -> Result<DisplayRays, BenchError> {
    let system = facility_system(setup)?;
    let launcher = Launcher::new(&system)?;
    let wavelength = &setup.screen.wavelength_nm;
    let fans = [wavelength.r, wavelength.g, wavelength.b]
        .map(|nm| Tracer::new(&system, nm, Clipping::Off).map(|tracer| (nm, tracer)))
        .into_iter()
        .collect::<Result<Vec<_>, _>>()?;
    let spots = Spots {
        pupil_radius_mm: launcher.ray([0.0; 2], [1.0, 0.0])?.position_mm.x,
        launcher,
        fans,
        pupil: pupil_points(),
        focal_px: setup.camera_pinhole().fx_px,
        half_width_tan: 0.5 * f64::from(setup.camera.width_px) / setup.camera_pinhole().fx_px,
        display: Display::new(setup, 0),
    };
    let knots = (1..DEPTH_KNOTS)
        .into_par_iter()
        .map(|k| spots.response(half_tan * k as f64 / (DEPTH_KNOTS - 1) as f64))
        .collect::<Result<Vec<_>, _>>()?;
    let table = |of: &dyn Fn(&Response) -> f64| {
        let mut table = [0.0; DEPTH_KNOTS];
        for (value, knot) in table[1..].iter_mut().zip(&knots) {
            *value = of(knot);
        }
        // Even about the axis: a parabola through the first two.
        table[0] = (4.0 * table[1] - table[2]) / 3.0;
        table
    };
    Ok(DisplayRays {
        height_mm: heights(half_tan, &knots),
        half_tan,
        tangent_per_depth: table(&|knot| knot.tangent_per_depth),
        tangent_per_coma: std::array::from_fn(|k| table(&|knot| knot.tangent_per_coma[k])),
        coma_per_depth: std::array::from_fn(|k| table(&|knot| knot.coma_per_depth[k])),
        tangent_per_even_coma: [0, 1].map(|k| table(&|knot| knot.tangent_per_even_coma[k])),
    })
}

/// What a place of the display shows.
struct Response {
    /// Tangent of the line of sight on which the detector finds it.
    tangent: f64,
    /// Height on the display over it, mm.
    height_over_tangent_mm: f64,
    /// What depth adds to the tangent, over it, 1/mm.
    tangent_per_depth: f64,
    /// See [`DisplayRays`].
    tangent_per_coma: [f64; COMAS_MM.len()],
    coma_per_depth: [f64; COMAS_MM.len()],
    tangent_per_even_coma: [f64; 2],
}

struct Spots {
    launcher: Launcher,
    /// Wavelengths, and what traces them.
    fans: Vec<(f64, Tracer)>,
    pupil: Vec<PupilPoint>,
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
    /// Of the place whose light, on the average, is on the line of sight (r, 0).
    fn response(&self, r: f64) -> Result<Response, OpticsError> {
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
        let emission_px = px_per_mm * self.display.emission_sigma_mm();
        let blur_px = all()
            .map(|((nm, _), _)| Sampling::blur_px(self.focal_px, *nm, self.pupil_radius_mm) / count)
            .sum::<f64>()
            .hypot(emission_px);
        // A direction's cosines per its tangents, along the radius and across it.
        let per_cosine = DVec2::new((1.0 + r * r).powf(1.5), (1.0 + r * r).sqrt());
        // Each ray of the place at a depth, to first order in the spot's size. Coma C (3 rho^2 - 2) (e . p) turns the
        // ray at the pupil's p by its gradient over the pupil's radius.
        let seen = |depth_mm: f64, coma_mm: DVec2| {
            let rays: Vec<_> = all()
                .flat_map(|(_, fan)| fan.iter().zip(&self.pupil))
                .map(|(meeting, point)| {
                    let miss_mm = place_mm - meeting.at_mm - depth_mm * meeting.slope;
                    let p = DVec2::from(point.at);
                    let turn = (3.0 * p.length_squared() - 2.0) * coma_mm + 6.0 * coma_mm.dot(p) * p;
                    let tangent = field
                        + meeting.mm_per_tangent.inverse() * miss_mm
                        + per_cosine * turn / self.pupil_radius_mm;
                    ((tangent * self.focal_px).to_array(), point.weight)
                })
                .collect();
            DVec2::from(windowed_mean(&rays, blur_px)) / self.focal_px
        };
        let deep = |depth_mm: f64| seen(depth_mm, DVec2::ZERO).x;
        let tangent = deep(0.0);
        let part = r / self.half_width_tan;
        let grown = |depth_mm: f64, coma_mm: f64| {
            let coma = DVec2::new(coma_mm * part, 0.0);
            (seen(depth_mm, coma).x - deep(depth_mm)) / (coma_mm * part)
        };
        let even = |axis: DVec2| {
            let [plus, minus] = [1.0, -1.0].map(|sign| seen(0.0, sign * EVEN_COMA_MM * axis));
            (plus - minus).dot(axis) / (2.0 * EVEN_COMA_MM)
        };
        Ok(Response {
            tangent,
            height_over_tangent_mm: place_mm.x.abs() / tangent,
            tangent_per_depth: (deep(DEPTH_MM) - deep(-DEPTH_MM)) / (2.0 * DEPTH_MM * tangent),
            tangent_per_coma: COMAS_MM.map(|coma| grown(0.0, coma)),
            coma_per_depth: COMAS_MM
                .map(|coma| (grown(DEPTH_MM, coma) - grown(-DEPTH_MM, coma)) / (2.0 * DEPTH_MM)),
            tangent_per_even_coma: [DVec2::X, DVec2::Y].map(even),
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
