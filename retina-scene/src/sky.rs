//! The point sources of a frame: stars and planets in the field that no body hides.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use retina_files::InputError;
use retina_sky::catalogue::StarCatalogue;
use retina_sky::observer::Observer;
use retina_sky::planets::planets_in_cone;

use crate::checks::Field;
use crate::occult::Occulter;
use crate::{Scene, SceneFrame};

/// Which point sources a scene shows.
#[derive(Debug, Clone)]
pub struct Stars {
    /// The user's own catalogue; otherwise the embedded one.
    pub catalogue: Option<Arc<StarCatalogue>>,
    /// The faintest V magnitude.
    pub faintest_magnitude: f64,
    /// Planets too, but those that are bodies of the scene.
    pub planets: bool,
}

/// A point source as the camera sees it: proper motion, parallax, light-time, deflection and, where
/// the camera's velocity is given, aberration are in its direction.
#[derive(Debug, Clone, PartialEq)]
pub struct SkyPoint {
    /// `HIP 32349`, `mars`.
    pub id: String,
    /// Line of sight r = (x, y), camera axes, tangent plane.
    pub line_of_sight: DVec2,
    /// V.
    pub magnitude: f64,
    /// What is known of a planet besides.
    pub planet: Option<PlanetPoint>,
}

/// A planet that is shown as a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanetPoint {
    /// As seen, light-time in it, m.
    pub distance_m: f64,
    /// Sun - planet - camera, rad.
    pub phase_rad: f64,
    /// Of its disc, which is shown as a point of equal light, rad.
    pub angular_radius_rad: f64,
    /// The magnitude is outside what its formula was fitted to.
    pub magnitude_extrapolated: bool,
}

/// A point source on the screen, for the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct ShownPoint {
    /// What is meant.
    pub point: SkyPoint,
    /// Where on the screen: K_f D^-1(r), px.
    pub screen_px: DVec2,
    /// Magnitude that the screen is to show: the radiance scale is in it.
    pub wanted_magnitude: f64,
    /// What the counts show; `None` where it is too dim for the least count.
    pub displayed: Option<DisplayedPoint>,
}

/// What the counts of a point source show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisplayedPoint {
    /// Barycentre of the light of its pixels, px.
    pub barycentre_px: DVec2,
    /// Magnitude of all its light at the camera's pupil.
    pub magnitude: f64,
    /// Pixels lit.
    pub pixels: usize,
    /// Some of the pixels carry other light too, which is not in these figures.
    pub blended: bool,
}

impl Scene {
    /// The stars and planets in the field of a frame, the brightest first; none without a table
    /// `[stars]`.
    ///
    /// # Errors
    /// The epoch is outside the ephemerides.
    pub fn sky(&self, frame: &SceneFrame) -> Result<Vec<SkyPoint>, InputError> {
        let Some(stars) = &self.stars else { return Ok(Vec::new()) };
        let observer = self.observer(frame)?;
        let field = Field::of(self);
        let camera_from_inertial = DMat3::from_quat(frame.camera_from_inertial);
        let boresight = camera_from_inertial.transpose() * DVec3::Z;
        let in_field = |direction: DVec3, distance_m: f64| {
            let seen = camera_from_inertial * direction;
            let sight = DVec2::new(seen.x, seen.y) / seen.z;
            (seen.z > 0.0 && field.shows(sight) && !self.hidden(frame, seen, distance_m)).then_some(sight)
        };
        let catalogue = stars.catalogue.as_deref().unwrap_or_else(|| StarCatalogue::embedded());
        let half_angle_rad = field.corner_rad().min(PI / 2.0);
        let mut points: Vec<SkyPoint> = catalogue
            .in_cone(&observer, boresight, half_angle_rad, stars.faintest_magnitude)
            .into_iter()
            .filter_map(|seen| {
                Some(SkyPoint {
                    id: seen.star.id.to_string(),
                    line_of_sight: in_field(seen.direction, f64::INFINITY)?,
                    magnitude: seen.magnitude,
                    planet: None,
                })
            })
            .collect();
        if stars.planets {
            let planets = planets_in_cone(&observer, boresight, half_angle_rad)
                .map_err(|error| self.sky_error(frame, &error))?;
            points.extend(planets.into_iter().filter_map(|seen| {
                let id = seen.planet.name().to_string();
                let shown = !self.bodies.iter().any(|body| body.name == id)
                    && seen.magnitude <= stars.faintest_magnitude;
                let line_of_sight = shown.then(|| in_field(seen.direction, seen.distance_m)).flatten()?;
                let planet = PlanetPoint {
                    distance_m: seen.distance_m,
                    phase_rad: seen.phase_angle_rad,
                    angular_radius_rad: seen.angular_radius_rad,
                    magnitude_extrapolated: seen.magnitude_extrapolated,
                };
                Some(SkyPoint { id, line_of_sight, magnitude: seen.magnitude, planet: Some(planet) })
            }));
            points.sort_by(|a, b| a.magnitude.total_cmp(&b.magnitude));
        }
        Ok(points)
    }

    /// Who sees the sky of a frame.
    ///
    /// # Errors
    /// The epoch is outside the ephemerides, or the camera's state is not finite.
    pub(crate) fn observer(&self, frame: &SceneFrame) -> Result<Observer, InputError> {
        Observer::new(&self.ephemeris, frame.time_s, frame.camera_position_m, frame.camera_velocity_m_s)
            .map_err(|error| self.sky_error(frame, &error))
    }

    fn sky_error(&self, frame: &SceneFrame, error: &dyn std::fmt::Display) -> InputError {
        self.trajectory
            .error_at(frame.index, error.to_string())
            .help("with a table [stars], time_s is TDB seconds since J2000 and positions are barycentric, m; `planets = false` in it shows stars alone")
    }

    fn hidden(&self, frame: &SceneFrame, direction_camera: DVec3, distance_m: f64) -> bool {
        let mut bodies = self.occulters.iter().zip(&frame.bodies);
        bodies.any(|(body, at)| body.hides(at, direction_camera, distance_m))
    }

    /// The bodies' outlines, where there is a sky or a flash for them to hide.
    pub(crate) fn find_occulters(&mut self) {
        if self.stars.is_some() || self.flashes.is_some() {
            let outlines = self.models.iter().zip(&self.bodies);
            self.occulters =
                outlines.map(|(model, body)| Occulter::of(&model.shape, body.bounding_radius_m)).collect();
        }
    }
}
