//! A resolved body among stars: attitude and position from one photograph.
//!
//! 1. The body is found without an attitude, and its disc is masked.
//! 2. The stars beside it give the attitude, the focal length and the lens' distortion.
//! 3. With a time, the attitude and an ephemeris say how the body is turned and where the Sun is.
//! 4. The limb is measured again with all of that. Its position, turned by the attitude, is the camera's place.
//!
//! The camera's velocity need not be known. Aberration turns the body and the stars about it alike, so what is wrong in
//! the attitude for want of it goes out again with the direction; the attitude alone is off by 0.7 arcsec for each km/s
//! between camera and body.

use glam::{DMat3, DQuat, DVec2, DVec3};
use retina_image::{CameraImage, Exif};
use retina_sky::ephemeris::{Ephemeris, EphemerisError, LIGHT_SPEED_M_S};
use retina_sky::observer::{Observer, ObserverError, aberrated};
use serde_json::{Value, json};
use thiserror::Error;

use super::photograph::{LimbAnswer, LimbQuestion, LimbSight};
use super::{LimbCamera, Mapping, StarLens};
use crate::cameras::ImageSolver;
use crate::image::{ImageContext, ImageResult};
use crate::stars::StarSolution;

/// Stars are looked for beyond so many radii of the body, and so many pixels.
const DISC_MARGIN: (f64, f64) = (1.1, 12.0);
/// Half the interval over which the body's velocity is taken, s.
const VELOCITY_STEP_S: f64 = 60.0;

/// When a photograph was taken, and by what ephemeris.
#[derive(Debug, Clone, Copy)]
pub struct StarsEpoch<'a> {
    /// TDB seconds since J2000.
    pub tdb_s: f64,
    /// Where Sun and body are taken from.
    pub ephemeris: &'a Ephemeris,
}

/// What a photograph of a body among stars gave.
#[derive(Debug, Clone)]
pub struct AmongStars {
    /// The question as the stars have it: camera, attitude of the body, Sun. The first question where they were not found.
    pub question: LimbQuestion,
    /// The limb.
    pub answer: LimbAnswer,
    /// The stars.
    pub stars: ImageResult,
    /// Where the camera is, where both were found.
    pub place: Option<CameraPlace>,
}

/// Where a camera is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPlace {
    /// Relative to the body, ICRF axes, m: to where it is at the epoch, by its ephemeris; without these, to where it was when
    /// the light left it. The Moon moves by 4 km while its light goes 40 000 km.
    pub from_body_m: DVec3,
    /// Its covariance, m^2: the limb's, and the attitude's.
    pub covariance_m2: DMat3,
    /// Barycentric, ICRF axes, m; with an epoch, of a body with an ephemeris.
    pub barycentric_m: Option<DVec3>,
}

/// Why a photograph among stars could not be asked.
#[derive(Debug, Error)]
pub enum AmongStarsError {
    /// The epoch is outside the ephemeris.
    #[error(transparent)]
    Ephemeris(#[from] EphemerisError),
    /// So is the body's place.
    #[error(transparent)]
    Observer(#[from] ObserverError),
}

/// The body as the ephemeris has it.
struct Known {
    position_m: DVec3,
    velocity_m_s: DVec3,
    sun_m: DVec3,
}

impl LimbQuestion {
    /// Asks a photograph for the body and the stars beside it. `mask` (row by row, where given) is true where pixels
    /// count. `notes` is told what was taken for what.
    ///
    /// # Errors
    /// The epoch is outside the ephemeris.
    pub fn solve_among_stars(
        &self,
        image: &CameraImage,
        exif: &Exif,
        mask: Option<&[bool]>,
        solver: &mut ImageSolver,
        epoch: Option<StarsEpoch<'_>>,
        notes: &mut Vec<String>,
    ) -> Result<AmongStars, AmongStarsError> {
        let seen = mask.map_or_else(|| image.clone(), |mask| image.clone().seen_in(mask));
        let first = self.solve(&seen);
        let known = match (epoch, self.body.planet) {
            (Some(StarsEpoch { tdb_s, ephemeris }), Some(planet)) => {
                let at = |off_s: f64| ephemeris.position_m(planet, tdb_s + off_s);
                Some(Known {
                    position_m: at(0.0)?,
                    velocity_m_s: (at(VELOCITY_STEP_S)? - at(-VELOCITY_STEP_S)?) / (2.0 * VELOCITY_STEP_S),
                    sun_m: ephemeris.solar_system(tdb_s)?.sun.position_m,
                })
            }
            _ => None,
        };
        let velocity_m_s = known.as_ref().map(|known| known.velocity_m_s);
        let observer = match epoch {
            None => None,
            Some(StarsEpoch { tdb_s, ephemeris }) => {
                let position_m = known.as_ref().map_or(DVec3::ZERO, |known| known.position_m);
                Some(Observer::new(ephemeris, tdb_s, position_m, velocity_m_s)?)
            }
        };
        let context = ImageContext {
            observer,
            mask: Some(beside_disc(image, mask, &first)),
            ..ImageContext::default()
        };
        let stars = solver.solve(image, exif, &context, notes)?;
        let solution = match &stars.solution {
            Ok(solution) if !solution.mirrored => solution,
            Ok(_) => {
                notes.push("the stars say that this is a mirror image: flip it first".to_owned());
                return Ok(AmongStars { question: self.clone(), answer: first, stars, place: None });
            }
            Err(refusal) => {
                notes.push(format!("no attitude by the stars: {}", stars.refusal(refusal)));
                return Ok(AmongStars { question: self.clone(), answer: first, stars, place: None });
            }
        };
        let camera_from_inertial = solution.camera_from_inertial();
        let question = self.with_stars(&stars, solution, epoch, known.as_ref(), &first)?;
        let answer = question.solve(&seen);
        let beta = velocity_m_s.map_or(DVec3::ZERO, |velocity| velocity / LIGHT_SPEED_M_S);
        let place = answer.sight.as_ref().ok().map(|sight| {
            let place = CameraPlace::new(sight, camera_from_inertial, solution, beta);
            let Some(known) = &known else { return place };
            let light_s = sight.range_m[0] / LIGHT_SPEED_M_S;
            let from_body_m = place.from_body_m - known.velocity_m_s * light_s;
            CameraPlace { from_body_m, barycentric_m: Some(known.position_m + from_body_m), ..place }
        });
        Ok(AmongStars { question, answer, stars, place })
    }

    /// With the camera that the stars gave, and with how the body is turned and lit at that epoch.
    fn with_stars(
        &self,
        stars: &ImageResult,
        solution: &StarSolution,
        epoch: Option<StarsEpoch<'_>>,
        known: Option<&Known>,
        first: &LimbAnswer,
    ) -> Result<Self, EphemerisError> {
        let camera_from_inertial = solution.camera_from_inertial();
        let mut question = self.clone();
        question.camera = LimbCamera {
            pinhole: StarLens::pinhole(&stars.camera, &solution.fit),
            mapping: Mapping::Stars(Box::new(StarLens::new(stars.camera.clone(), solution.fit))),
        };
        question.focal_sigma_share = solution.focal_ratio_sigma / solution.fit.focal_ratio;
        let Some(StarsEpoch { tdb_s, ephemeris }) = epoch else { return Ok(question) };
        if !self.body.attitude_given
            && let Some(turn) = ephemeris.body_from_inertial(&self.body.name, tdb_s)?
        {
            question.body = self.body.clone().turned(DMat3::from_quat(camera_from_inertial * turn.inverse()));
        }
        if let Some(known) = known {
            let to_sun = camera_from_inertial * (known.sun_m - known.position_m).normalize();
            let center = first.sight.as_ref().map(|sight| sight.center_px).ok();
            let center = center.or(first.look.map(|look| look.center_px));
            let along = center
                .and_then(|pixel| question.camera.line_of_sight(pixel))
                .map_or(DVec3::Z, |place| place.extend(1.0).normalize());
            let across = (to_sun - along * to_sun.dot(along)).truncate();
            question.phase_rad = Some((-along).dot(to_sun).clamp(-1.0, 1.0).acos());
            if question.sun_angle_rad.is_none() && across.length() > LEAST_ACROSS {
                question.sun_angle_rad = Some((-across.x).atan2(-across.y));
            }
        }
        Ok(question)
    }
}

/// The Sun has a direction in the image where it is a degree from the line of sight.
const LEAST_ACROSS: f64 = 0.0175;

/// Where stars are looked for: beside the body's disc, or the circle about it.
fn beside_disc(image: &CameraImage, mask: Option<&[bool]>, first: &LimbAnswer) -> Vec<bool> {
    let disc = match (&first.sight, &first.look) {
        (Ok(sight), _) => {
            let reach = sight.solution.outline_px.iter().map(|place| place.distance(sight.center_px));
            Some((sight.center_px, reach.fold(0.0, f64::max)))
        }
        (Err(_), Some(look)) => Some((look.center_px, look.radius_px)),
        (Err(_), None) => None,
    };
    let width = image.width_px as usize;
    (0..image.values.len())
        .map(|k| {
            let pixel = DVec2::new((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
            let beside = disc.is_none_or(|(center, radius)| {
                pixel.distance(center) > DISC_MARGIN.0 * radius + DISC_MARGIN.1
            });
            beside && mask.is_none_or(|mask| mask[k])
        })
        .collect()
}

impl CameraPlace {
    fn new(sight: &LimbSight, camera_from_inertial: DQuat, solution: &StarSolution, beta: DVec3) -> Self {
        let inertial_from_camera = camera_from_inertial.inverse();
        let position_m = sight.solution.position_camera_m;
        let direction = inertial_from_camera * position_m.normalize();
        // What the camera's motion does to the direction is undone by the opposite motion.
        let from_body_m = -aberrated(direction, -beta) * position_m.length();
        // An attitude that is off by a rotation vector t (camera axes) moves the position by P x t.
        let cross = DMat3::from_cols(
            DVec3::new(0.0, position_m.z, -position_m.y),
            DVec3::new(-position_m.z, 0.0, position_m.x),
            DVec3::new(position_m.y, -position_m.x, 0.0),
        );
        let camera_m2 = sight.covariance_m2 + cross * solution.attitude_covariance_rad2 * cross.transpose();
        let turn = DMat3::from_quat(inertial_from_camera);
        Self { from_body_m, covariance_m2: turn * camera_m2 * turn.transpose(), barycentric_m: None }
    }

    /// Standard deviations along the axes, m.
    pub fn sigma_m(&self) -> DVec3 {
        let c = self.covariance_m2;
        DVec3::new(c.x_axis.x, c.y_axis.y, c.z_axis.z).map(f64::sqrt)
    }
}

impl AmongStars {
    /// The keys `stars` and `place` of the document of `navigate limb --json`.
    pub fn json(&self, file: &str) -> Value {
        json!({
            "stars": self.stars.json(file, false),
            "place": self.place.map(|place| json!({
                "position_from_body_m": place.from_body_m.to_array(),
                "sigma_m": place.sigma_m().to_array(),
                "covariance_m2": place.covariance_m2.to_cols_array_2d(),
                "position_barycentric_m": place.barycentric_m.map(|at| at.to_array()),
            })),
        })
    }
}
