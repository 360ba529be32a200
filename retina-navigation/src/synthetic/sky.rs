//! What a camera in deep space has in its field.

use glam::{DQuat, DVec2, DVec3};
use retina_geometry::Pinhole;
use retina_sky::catalogue::StarCatalogue;
use retina_sky::ephemeris::EphemerisError;
use retina_sky::observer::Observer;
use retina_sky::planets::{Planet, planets_in_cone};

/// A point source in the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Source {
    /// The planet, if it is one.
    pub planet: Option<Planet>,
    /// Apparent line of sight, camera frame, tangent plane.
    pub line_of_sight: DVec2,
    /// V.
    pub magnitude: f64,
}

/// Stars of the embedded catalogue and planets in a pinhole's field, brightest first; planets are points at their
/// centres, whatever their discs.
///
/// # Errors
/// The epoch is outside the ephemeris.
pub fn sources(
    observer: &Observer,
    camera_from_inertial: DQuat,
    camera: &Pinhole,
    faintest_magnitude: f64,
) -> Result<Vec<Source>, EphemerisError> {
    let axis = camera_from_inertial.inverse() * DVec3::Z;
    let reach = camera.corner_tan().atan() + 1e-3;
    let stars = StarCatalogue::embedded().in_cone(observer, axis, reach, faintest_magnitude);
    let planets = planets_in_cone(observer, axis, reach)?;
    let all = stars
        .iter()
        .map(|star| (None, star.direction, star.magnitude))
        .chain(planets.iter().map(|seen| (Some(seen.planet), seen.direction, seen.magnitude)));
    let mut found: Vec<Source> = all
        .filter_map(|(planet, direction, magnitude)| {
            let pixel = camera.project(camera_from_inertial * direction)?;
            let inside = pixel.cmpge(DVec2::ZERO).all()
                && pixel.x < f64::from(camera.width_px)
                && pixel.y < f64::from(camera.height_px);
            inside.then(|| Source { planet, line_of_sight: camera.line_of_sight(pixel), magnitude })
        })
        .filter(|source| source.magnitude <= faintest_magnitude)
        .collect();
    found.sort_by(|a, b| a.magnitude.total_cmp(&b.magnitude));
    Ok(found)
}
