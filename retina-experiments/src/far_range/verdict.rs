//! How right an image's planet is.

use glam::{DQuat, DVec3};
use retina_sky::planets::Planet;

use super::poses::ARCSEC;
use retina_navigation::image::ImageResult;
use retina_navigation::planets::PlanetSight;
use retina_navigation::stars::StarCamera;
use retina_navigation::synthetic::Source;

/// A planet's point is the right one within this distance of where the planet is shown, px; or, where it is saturated,
/// within so many of its standard deviations, since a plateau of saturated pixels may be 20 px wide.
const SAME_POINT_PX: f64 = 4.0;
const SAME_POINT_SIGMAS: f64 = 3.0;

/// A planet that was looked for, beside what the image shows.
pub(super) struct PlanetVerdict<'a> {
    /// `found`, `missed`, or `wrong`: another point was taken for it.
    pub(super) outcome: &'static str,
    /// What was taken for it.
    pub(super) sight: Option<&'a PlanetSight>,
    /// Where it was found: the truth.
    pub(super) found: Option<FoundPlanet>,
}

/// A planet that was found.
pub(super) struct FoundPlanet {
    /// Its true direction, inertial axes, as seen.
    pub(super) direction: DVec3,
    /// Error of the line of sight, arcsec.
    pub(super) error_arcsec: f64,
    /// Its point is saturated.
    pub(super) saturated: bool,
}

/// Compares with what was shown under the true attitude.
pub(super) fn planet_verdict<'a>(
    result: &'a ImageResult,
    planet: Planet,
    camera: &StarCamera,
    shown: &[Source],
    camera_from_inertial: DQuat,
) -> PlanetVerdict<'a> {
    let Some(sight) = result.planets.iter().find(|sight| sight.planet == planet) else {
        return PlanetVerdict { outcome: "missed", sight: None, found: None };
    };
    let point = &result.points[sight.point];
    let truth = shown.iter().find(|source| source.planet == Some(planet));
    let sigma_px = if point.saturated { point.sigma_rad * camera.pinhole.fx_px } else { 0.0 };
    let reach_px = SAME_POINT_PX.max(SAME_POINT_SIGMAS * sigma_px);
    let right =
        truth.filter(|truth| camera.pinhole.pixel(truth.line_of_sight).distance(point.pixel) < reach_px);
    let found = right.map(|truth| {
        let direction = camera_from_inertial.inverse() * truth.line_of_sight.extend(1.0).normalize();
        let error_arcsec = sight.direction.angle_between(direction) / ARCSEC;
        FoundPlanet { direction, error_arcsec, saturated: point.saturated }
    });
    PlanetVerdict { outcome: if found.is_some() { "found" } else { "wrong" }, sight: Some(sight), found }
}
