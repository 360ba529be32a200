//! From a camera image to its attitude and planets.

use std::time::Instant;

use retina_image::{CameraImage, DetectOptions, detect_points, detect_points_in};
use retina_sky::ephemeris::EphemerisError;
use retina_sky::observer::Observer;
use serde_json::{Value, json};

use crate::planets::{PlanetSight, PriorPosition, identify_planets};
use crate::seen::Seen;
use crate::stars::{Refusal, StarCamera, StarPoint, StarSolution, StarSolver};

/// Centroids of stars in focus are good to a fifth of a pixel, faint ones included.
const POOR_FIT_PX: f64 = 0.35;

/// What is known of an image before it is solved.
#[derive(Debug, Clone, Default)]
pub struct ImageContext {
    /// Epoch, place and velocity: places of stars to the epoch, parallax and aberration.
    pub observer: Option<Observer>,
    /// Where the camera is, for planets.
    pub prior: Option<PriorPosition>,
    /// Pixels (row by row) in which points are looked for; all where absent.
    pub mask: Option<Vec<bool>>,
}

/// What an image gave.
#[derive(Debug, Clone)]
pub struct ImageResult {
    /// Points found, brightest first; of a mirrored image flipped left to right.
    pub points: Vec<StarPoint>,
    /// What was seen of them and tried.
    pub seen: Seen,
    /// The attitude, or why there is none.
    pub solution: Result<StarSolution, Refusal>,
    /// Planets among the points.
    pub planets: Vec<PlanetSight>,
    /// Pixels to points, ms.
    pub detect_ms: f64,
    /// Points to attitude and planets, ms.
    pub solve_ms: f64,
}

/// Solves an image: points of light, attitude, planets. An image that is refused is tried again with a finer background,
/// and then with fainter points and single pixels too, before it is.
///
/// # Errors
/// The prior's epoch is outside the ephemeris.
pub fn solve_image(
    image: &CameraImage,
    camera: &StarCamera,
    solver: &StarSolver,
    detect: &DetectOptions,
    context: &ImageContext,
) -> Result<ImageResult, EphemerisError> {
    let mut first: Option<ImageResult> = None;
    let (mut hypotheses, mut times_ms) = (0, [0.0; 2]);
    for options in attempts(detect) {
        let start = Instant::now();
        let detection = match &context.mask {
            Some(mask) => detect_points_in(image, mask, &options),
            None => detect_points(image, &options),
        };
        times_ms[0] += ms(start);
        let points = camera.points(&detection.points);
        let seen = Seen::of(image, &detection, &points, &options);
        let result = solved(points, seen, camera, solver, context, hypotheses)?;
        times_ms[1] += result.solve_ms;
        hypotheses += match &result.solution {
            Err(Refusal::NoMatch { hypotheses, .. }) => *hypotheses,
            _ => 0,
        };
        let again = matches!(result.solution, Err(Refusal::NoMatch { .. } | Refusal::TooFewPoints { .. }));
        if !again {
            let attempts = first.map_or(1, |first| first.seen.attempts + 1);
            let seen = Seen { attempts, ..result.seen };
            return Ok(ImageResult { seen, detect_ms: times_ms[0], solve_ms: times_ms[1], ..result });
        }
        match &mut first {
            None => first = Some(result),
            Some(first) => first.seen.attempts += 1,
        }
    }
    // What the first attempt saw is what there is to see.
    let first = first.unwrap_or_else(|| unreachable!("there is an attempt"));
    Ok(ImageResult { detect_ms: times_ms[0], solve_ms: times_ms[1], ..first })
}

/// Side of the cells of a background that follows steep gradients, px.
const FINE_MESH_PX: usize = 16;
/// Threshold of the last attempt, of the one asked for.
const LOWER_THRESHOLD: f64 = 0.7;

/// Ways to find points, one after the other.
fn attempts(asked: &DetectOptions) -> [DetectOptions; 3] {
    let fine = DetectOptions { mesh_px: asked.mesh_px.min(FINE_MESH_PX), ..asked.clone() };
    let faint = DetectOptions {
        threshold_sigma: LOWER_THRESHOLD * asked.threshold_sigma,
        single_pixels: true,
        ..fine.clone()
    };
    [asked.clone(), fine, faint]
}

/// As [`solve_image`], from points that were found already.
///
/// # Errors
/// As [`solve_image`].
pub fn solve_points(
    points: Vec<StarPoint>,
    camera: &StarCamera,
    solver: &StarSolver,
    context: &ImageContext,
) -> Result<ImageResult, EphemerisError> {
    let seen = Seen { points: points.len(), attempts: 1, ..Seen::default() };
    solved(points, seen, camera, solver, context, 0)
}

fn solved(
    points: Vec<StarPoint>,
    seen: Seen,
    camera: &StarCamera,
    solver: &StarSolver,
    context: &ImageContext,
    hypotheses_before: usize,
) -> Result<ImageResult, EphemerisError> {
    let start = Instant::now();
    let solution = solver.solve_again(&points, context.observer.as_ref(), hypotheses_before);
    let mirrored = solution.as_ref().is_ok_and(|solution| solution.mirrored);
    let points = if mirrored { points.iter().map(StarPoint::flipped).collect() } else { points };
    let planets = match (&solution, &context.prior) {
        (Ok(solution), Some(prior)) => identify_planets(solution, &points, prior, camera.half_field().0)?,
        _ => Vec::new(),
    };
    Ok(ImageResult { points, seen, solution, planets, detect_ms: 0.0, solve_ms: ms(start) })
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

impl ImageResult {
    /// The entry of `images` of `navigate stars --json`; `file` names the image.
    pub fn json(&self, file: &str, camera: &StarCamera, list_stars: bool) -> Value {
        let times = json!({"points": self.points.len(), "detect_ms": self.detect_ms, "solve_ms": self.solve_ms, "seen": self.seen});
        let mut out = match &self.solution {
            Err(refusal) => json!({
                "file": file, "solved": false, "reason": refusal.reason(), "message": self.refusal(refusal),
                "ra_deg": null, "dec_deg": null, "roll_deg": null, "matches": 0, "rms_arcsec": null, "planets": [],
            }),
            Ok(solution) => self.solved_json(solution, file, camera, list_stars),
        };
        if let (Value::Object(out), Value::Object(times)) = (&mut out, times) {
            out.extend(times);
        }
        out
    }

    /// Why there is no answer, what was seen, and what to try.
    pub fn refusal(&self, refusal: &Refusal) -> String {
        format!("{refusal}. {}", self.seen.sentence(refusal))
    }

    /// What a solution's figures do not say by themselves: that the camera's model does not fit.
    pub fn warning(&self, camera: &StarCamera) -> Option<String> {
        let rms_px = self.solution.as_ref().ok()?.rms_rad * camera.pinhole.fx_px;
        (rms_px > POOR_FIT_PX).then(|| {
            format!(
                "residuals of {rms_px:.2} px rms: the sky is found, but the camera's model does not fit it (distortion, \
                 pixels that are not square, trails, blur), which the attitude's sigma does not cover"
            )
        })
    }

    fn solved_json(
        &self,
        solution: &StarSolution,
        file: &str,
        camera: &StarCamera,
        list_stars: bool,
    ) -> Value {
        let [ra, dec, roll] = solution.ra_dec_roll_rad().map(f64::to_degrees);
        let q = solution.camera_from_inertial();
        let c = solution.attitude_covariance_rad2;
        let focal_px = camera.pinhole.fx_px * solution.fit.focal_ratio;
        let field = |px: u32| 2.0 * (0.5 * f64::from(px) / focal_px).atan().to_degrees();
        let mut out = json!({
            "file": file, "solved": true, "ra_deg": ra, "dec_deg": dec, "roll_deg": roll,
            "matches": solution.matches.len(), "rms_arcsec": arcsec(solution.rms_rad),
            "planets": self.planets.iter().map(|sight| self.planet_json(sight)).collect::<Vec<_>>(),
            "camera_from_inertial": [q.w, q.x, q.y, q.z],
            "attitude_sigma_arcsec": {
                "cross_x": arcsec(c.x_axis.x.sqrt()), "cross_y": arcsec(c.y_axis.y.sqrt()),
                "about": arcsec(c.z_axis.z.sqrt()),
            },
            "attitude_covariance_rad2": c.to_cols_array_2d(),
            "focal_px": focal_px, "focal_sigma_px": camera.pinhole.fx_px * solution.focal_ratio_sigma,
            "fov_deg": [field(camera.pinhole.width_px), field(camera.pinhole.height_px)],
            "k1": solution.k1_sigma.map(|_| solution.fit.k1), "k1_sigma": solution.k1_sigma,
            "warning": self.warning(camera),
            "mirrored": solution.mirrored, "hypotheses": solution.hypotheses,
            "log10_false_probability": solution.log10_false_probability,
            "zero_point_magnitude": solution.zero_point_magnitude,
        });
        if list_stars {
            let stars: Vec<Value> = solution
                .matches
                .iter()
                .map(|matched| {
                    let pixel = self.points[matched.point].pixel;
                    json!({
                        "id": matched.star.id.to_string(), "magnitude": matched.magnitude,
                        "camera_px": [pixel.x, pixel.y],
                        "residual_arcsec": matched.residual_rad.to_array().map(arcsec),
                    })
                })
                .collect();
            out["stars"] = stars.into();
        }
        out
    }

    fn planet_json(&self, sight: &PlanetSight) -> Value {
        let pixel = self.points[sight.point].pixel;
        let [ra, dec] = [
            sight.direction.y.atan2(sight.direction.x).rem_euclid(std::f64::consts::TAU),
            sight.direction.z.asin(),
        ];
        json!({
            "name": sight.planet.name(), "camera_px": [pixel.x, pixel.y],
            "ra_deg": ra.to_degrees(), "dec_deg": dec.to_degrees(),
            "line_of_sight": sight.line_of_sight.to_array(),
            "covariance_rad2": sight.covariance_rad2.to_cols_array_2d(),
            "magnitude": sight.magnitude, "expected_magnitude": sight.expected.magnitude,
            "off_arcsec": arcsec(sight.direction.angle_between(sight.expected.direction)),
            "saturated": self.points[sight.point].saturated,
        })
    }
}

fn arcsec(angle_rad: f64) -> f64 {
    angle_rad.to_degrees() * 3600.0
}
