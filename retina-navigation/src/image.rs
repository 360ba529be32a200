//! From a camera image to its attitude and planets.

use std::time::Instant;

use glam::{DVec2, DVec3};
use retina_image::{CameraImage, DetectOptions, detect_points, detect_points_in};
use retina_sky::ephemeris::EphemerisError;
use retina_sky::observer::Observer;
use serde_json::{Value, json};

use crate::planets::{PlanetSight, PlanetVerdict, PriorPosition, identify_planets};
use crate::seen::Seen;
use crate::stars::{ASPECT_STEP, Refusal, StarCamera, StarPoint, StarSolution, StarSolver};

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
    /// Whether pixels that are not square are tried before an image is refused.
    pub find_pixel_aspect: bool,
    /// The field of view, and the shape of the pixels, were given by hand: a refusal says that they may be wrong.
    pub field_given: bool,
    /// See `field_given`.
    pub aspect_given: bool,
}

impl ImageContext {
    /// Of a camera whose epoch, place and velocity are known, the place to this standard deviation, m.
    pub fn at(observer: Observer, position_sigma_m: f64) -> Self {
        let prior = PriorPosition { observer: observer.clone(), sigma_m: position_sigma_m };
        Self { observer: Some(observer), prior: Some(prior), ..Self::default() }
    }
}

/// What an image gave.
#[derive(Debug, Clone)]
pub struct ImageResult {
    /// The camera by which points have lines of sight: the one given, but for the shape of its pixels if that was found.
    pub camera: StarCamera,
    /// Points found, brightest first; of a mirrored image flipped left to right.
    pub points: Vec<StarPoint>,
    /// What was seen of them and tried.
    pub seen: Seen,
    /// The attitude, or why there is none.
    pub solution: Result<StarSolution, Refusal>,
    /// Planets among the points.
    pub planets: Vec<PlanetSight>,
    /// What became of each planet that can be in the field, found or not; none without a position.
    pub planet_verdicts: Vec<PlanetVerdict>,
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
    let mut refused: Vec<ImageResult> = Vec::new();
    let mut detections = Vec::new();
    let mut again = Again::default();
    for options in attempts(detect) {
        let start = Instant::now();
        let detection = match &context.mask {
            Some(mask) => detect_points_in(image, mask, &options),
            None => detect_points(image, &options),
        };
        again.detect_ms += ms(start);
        let points = camera.points(&detection.points);
        let seen = Seen::of(image, &detection, &points, &options, context);
        let result = solved(points, seen, camera, solver, context, again.hypotheses)?;
        if let Some(result) = again.answer(result, &mut refused) {
            return Ok(result);
        }
        detections.push(detection);
    }
    // By the fine background, which has fewer points that are none.
    if context.find_pixel_aspect
        && let Some((detection, seen)) =
            detections.get(1).zip(refused.get(1).map(|result| result.seen.clone()))
        && seen.points - seen.on_edges >= FEWEST_FOR_ASPECT
    {
        for aspect in aspects() {
            let camera = camera.clone().with_pixel_aspect(aspect);
            let solver = solver.of_pixel_aspect(&camera);
            let points = camera.points(&detection.points);
            again.pixel_aspects += 1;
            let result = solved(points, seen.clone(), &camera, &solver, context, again.hypotheses)?;
            if let Some(result) = again.answer(result, &mut refused) {
                return Ok(result);
            }
        }
    }
    // What the first attempt saw is what there is to see.
    let first = refused.swap_remove(0);
    let seen = again.seen(first.seen);
    Ok(ImageResult { seen, detect_ms: again.detect_ms, solve_ms: again.solve_ms, ..first })
}

/// What attempts at an image have cost so far.
#[derive(Debug, Default)]
struct Again {
    /// Ways to find points, and shapes of pixels, by each of which the points were looked up.
    attempts: usize,
    pixel_aspects: usize,
    hypotheses: usize,
    detect_ms: f64,
    solve_ms: f64,
}

impl Again {
    fn seen(&self, seen: Seen) -> Seen {
        Seen { attempts: self.attempts - self.pixel_aspects, pixel_aspects: self.pixel_aspects, ..seen }
    }

    /// The result, if there is nothing more to try; otherwise it is kept as refused.
    fn answer(&mut self, result: ImageResult, refused: &mut Vec<ImageResult>) -> Option<ImageResult> {
        self.attempts += 1;
        self.solve_ms += result.solve_ms;
        match &result.solution {
            Err(Refusal::NoMatch { hypotheses, .. }) => self.hypotheses = *hypotheses,
            Err(Refusal::TooFewPoints { .. }) => {}
            _ => {
                let seen = self.seen(result.seen);
                return Some(ImageResult {
                    seen,
                    detect_ms: self.detect_ms,
                    solve_ms: self.solve_ms,
                    ..result
                });
            }
        }
        refused.push(result);
        None
    }
}

/// Fewest points, none on an edge, from which the shape of the pixels is looked for.
const FEWEST_FOR_ASPECT: usize = 8;
/// Pixels are at most this many times as high as wide, or as wide as high.
const GREATEST_ASPECT: f64 = 2.3;

/// Shapes of pixels, the least unusual first.
fn aspects() -> impl Iterator<Item = f64> {
    let steps = (GREATEST_ASPECT.ln() / ASPECT_STEP) as i32;
    (1..=steps).flat_map(|step| [1, -1].map(|sign| (f64::from(sign * step) * ASPECT_STEP).exp()))
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
    let (planets, planet_verdicts) = match (&solution, &context.prior) {
        (Ok(solution), Some(prior)) => identify_planets(solution, &points, prior, camera.half_field().0)?,
        _ => (Vec::new(), Vec::new()),
    };
    Ok(ImageResult {
        camera: camera.clone(),
        points,
        seen,
        solution,
        planets,
        planet_verdicts,
        detect_ms: 0.0,
        solve_ms: ms(start),
    })
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

impl ImageResult {
    /// The entry of `images` of `navigate stars --json`; `file` names the image.
    pub fn json(&self, file: &str, list_stars: bool) -> Value {
        let times = json!({"points": self.points.len(), "detect_ms": self.detect_ms, "solve_ms": self.solve_ms, "seen": self.seen});
        let mut out = match &self.solution {
            Err(refusal) => json!({
                "file": file, "solved": false, "reason": refusal.reason(), "message": self.refusal(refusal),
                "ra_deg": null, "dec_deg": null, "roll_deg": null, "matches": 0, "rms_arcsec": null, "planets": [],
            }),
            Ok(solution) => self.solved_json(solution, file, list_stars),
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

    /// Horizontal focal length, px.
    pub fn focal_px(&self) -> Option<f64> {
        Some(self.camera.pinhole.fx_px * self.solution.as_ref().ok()?.fit.focal_ratio)
    }

    /// Where in the image a direction (inertial axes, as seen) is; `None` where the image is not solved, or behind the
    /// camera.
    pub fn pixel(&self, direction: DVec3) -> Option<DVec2> {
        let solution = self.solution.as_ref().ok()?;
        let seen = solution.fit.project(direction)?;
        self.camera.pixel(if solution.mirrored { DVec2::new(-seen.x, seen.y) } else { seen })
    }

    /// How many times as high as wide the pixels are.
    pub fn pixel_aspect(&self) -> f64 {
        let fitted = self.solution.as_ref().map_or(1.0, |solution| solution.fit.aspect);
        self.camera.pinhole.fx_px / (self.camera.pinhole.fy_px * fitted)
    }

    /// What a solution's figures do not say by themselves: that the camera's model does not fit.
    pub fn warning(&self) -> Option<String> {
        let rms_px = self.focal_px()? * self.solution.as_ref().ok()?.rms_rad;
        (rms_px > POOR_FIT_PX).then(|| {
            format!(
                "residuals of {rms_px:.2} px rms: the sky is found, but the camera's model does not fit it (distortion, \
                 pixels that are not square, trails, blur), which the attitude's sigma does not cover"
            )
        })
    }

    fn solved_json(&self, solution: &StarSolution, file: &str, list_stars: bool) -> Value {
        let camera = &self.camera;
        let [ra, dec, roll] = solution.ra_dec_roll_rad().map(f64::to_degrees);
        let q = solution.camera_from_inertial();
        let c = solution.attitude_covariance_rad2;
        let focal_px = camera.pinhole.fx_px * solution.fit.focal_ratio;
        let aspect = self.pixel_aspect();
        let field =
            |px: u32, aspect: f64| 2.0 * (0.5 * f64::from(px) * aspect / focal_px).atan().to_degrees();
        let [k2, k3, p1, p2] = solution.fit.higher;
        let mut out = json!({
            "file": file, "solved": true, "ra_deg": ra, "dec_deg": dec, "roll_deg": roll,
            "matches": solution.matches.len(), "rms_arcsec": arcsec(solution.rms_rad),
            "planets": self.planets.iter().map(|sight| self.planet_json(sight)).collect::<Vec<_>>(),
            "planet_verdicts": self.planet_verdicts.iter().map(|verdict| self.verdict_json(verdict)).collect::<Vec<_>>(),
            "camera_from_inertial": [q.w, q.x, q.y, q.z],
            "attitude_sigma_arcsec": {
                "cross_x": arcsec(c.x_axis.x.sqrt()), "cross_y": arcsec(c.y_axis.y.sqrt()),
                "about": arcsec(c.z_axis.z.sqrt()),
            },
            "attitude_covariance_rad2": c.to_cols_array_2d(),
            "focal_px": focal_px, "focal_sigma_px": camera.pinhole.fx_px * solution.focal_ratio_sigma,
            "fov_deg": [field(camera.pinhole.width_px, 1.0), field(camera.pinhole.height_px, aspect)],
            "pixel_aspect": aspect, "pixel_aspect_sigma": solution.aspect_sigma.map(|sigma| sigma * aspect),
            "k1": solution.k1_sigma.map(|_| solution.fit.k1), "k1_sigma": solution.k1_sigma,
            "distortion": solution.higher_sigma.map(|_| json!({"k2": k2, "k3": k3, "p1": p1, "p2": p2})),
            "warning": self.warning(),
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

    fn verdict_json(&self, verdict: &PlanetVerdict) -> Value {
        let pixel = self.pixel(verdict.expected.direction);
        json!({
            "name": verdict.expected.planet.name(), "outcome": verdict.outcome.word(),
            "reason": verdict.outcome.to_string(), "expected_px": pixel.map(|at| at.to_array()),
            "expected_magnitude": verdict.expected.magnitude,
        })
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
