//! Flashes of impacts on a body's surface: which a frame's exposure holds, where, and how bright.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use retina_files::InputError;
use retina_radiometry::irradiance_of_magnitude_w_m2_nm;
use retina_render::BodyState;

use crate::checks::Field;
use crate::{DisplayedPoint, Scene, SceneFrame};

/// The flashes of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Flashes {
    /// A frame shows the mean light over so long from its time on, s.
    pub exposure_s: f64,
    /// Distance at which the magnitudes hold, m; without it they are as the camera sees them.
    pub seen_from_m: Option<f64>,
    /// Those of a table.
    pub listed: Vec<Flash>,
    /// Those drawn for each frame.
    pub random: Option<RandomFlashes>,
}

/// A point source of constant light on a body's surface, alike in all directions.
#[derive(Debug, Clone, PartialEq)]
pub struct Flash {
    /// `flash 3`: its row in the table; `flash 12-3`: the fourth drawn for frame 12.
    pub id: String,
    /// Its begin, TDB seconds since J2000.
    pub time_s: f64,
    /// How long it shines, s.
    pub duration_s: f64,
    /// Index of its body in the scene.
    pub body: usize,
    /// Planetocentric, rad.
    pub latitude_rad: f64,
    /// East, rad.
    pub longitude_rad: f64,
    /// V while it shines: see [`Flashes::seen_from_m`].
    pub magnitude: f64,
}

/// Flashes drawn for each frame, uniform over the night side that it sees, overlapping with its exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomFlashes {
    /// In each frame; fewer where hardly any night side is seen.
    pub number: usize,
    /// Index of the body in the scene.
    pub body: usize,
    /// Uniform between these.
    pub magnitudes: [f64; 2],
    /// Uniform between these, s.
    pub durations_s: [f64; 2],
}

/// A flash that shines during a frame's exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenFlash {
    /// Which.
    pub flash: Flash,
    /// Its place on the mesh, camera axes, m.
    pub position_camera_m: DVec3,
    /// Line of sight r = (x, y), tangent plane; `None` behind the camera.
    pub line_of_sight: Option<DVec2>,
    /// V as the camera sees it, while it shines.
    pub magnitude: f64,
    /// Part of the exposure during which it shines.
    pub share: f64,
    /// Mean over the exposure, at the camera, W m^-2 nm^-1.
    pub mean_irradiance_w_m2_nm: f64,
    /// A body, its own or another, is before it.
    pub hidden: bool,
}

/// A flash and what the screen shows of it, for the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct ShownFlash {
    /// What is meant.
    pub seen: SeenFlash,
    /// Where on the screen: K_f D^-1(r), px; `None` behind the camera.
    pub screen_px: Option<DVec2>,
    /// What the counts show; `None` where it is hidden, off the screen or too dim for the least count.
    pub displayed: Option<DisplayedPoint>,
}

/// An overlap below this is rounding, s.
const TIME_ROUNDING_S: f64 = 1e-6;
/// Draws of a place before a frame is left with fewer flashes: a lune of 1 deg is missed once in 10^5.
const TRIES: usize = 4000;
/// Keeps the flashes' random numbers apart from others of the same seed.
const STREAM: u64 = 0x0066_6c61_7368_6573;

/// Unit vector of a place, body axes.
fn direction(latitude_rad: f64, longitude_rad: f64) -> DVec3 {
    let (sin, cos) = latitude_rad.sin_cos();
    DVec3::new(cos * longitude_rad.cos(), cos * longitude_rad.sin(), sin)
}

/// Length of the overlap of [a, a + b] with [c, c + d].
fn overlap([a, b]: [f64; 2], [c, d]: [f64; 2]) -> f64 {
    // From the difference of the begins: epochs have large numbers.
    let from = c - a;
    ((from + d).min(b) - from.max(0.0)).max(0.0)
}

/// Uniform in 0 <= x < 1: 53 random bits.
fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

fn between(random: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * uniform(random)
}

impl Scene {
    /// The flashes that shine during a frame's exposure, in the table's order, then those drawn for it.
    pub fn flashes_of(&self, frame: &SceneFrame) -> Vec<SeenFlash> {
        let Some(flashes) = &self.flashes else { return Vec::new() };
        let listed =
            flashes.listed.iter().zip(&self.flash_sites_m).map(|(flash, site)| (flash.clone(), *site));
        listed
            .chain(self.drawn(flashes, frame))
            .filter_map(|(flash, site_body_m)| self.seen_flash(flashes, frame, flash, site_body_m))
            .collect()
    }

    fn seen_flash(
        &self,
        flashes: &Flashes,
        frame: &SceneFrame,
        flash: Flash,
        site_body_m: DVec3,
    ) -> Option<SeenFlash> {
        let window = [frame.time_s, flashes.exposure_s];
        let share = overlap(window, [flash.time_s, flash.duration_s]) / flashes.exposure_s;
        // Times of 1e9 s are rounded to 1e-7 s: one that begins where the exposure ends is not in it.
        if share * flashes.exposure_s < TIME_ROUNDING_S {
            return None;
        }
        let at = &frame.bodies[flash.body];
        let position_camera_m = at.position_camera_m + at.camera_from_body * site_body_m;
        let distance_m = position_camera_m.length();
        let nearer = flashes.seen_from_m.map_or(0.0, |from_m| 5.0 * (distance_m / from_m).log10());
        let magnitude = flash.magnitude + nearer;
        Some(SeenFlash {
            position_camera_m,
            line_of_sight: (position_camera_m.z > 0.0)
                .then(|| position_camera_m.truncate() / position_camera_m.z),
            magnitude,
            share,
            mean_irradiance_w_m2_nm: share * irradiance_of_magnitude_w_m2_nm(magnitude),
            hidden: self.is_flash_hidden(frame, flash.body, site_body_m, position_camera_m),
            flash,
        })
    }

    fn is_flash_hidden(&self, frame: &SceneFrame, body: usize, site_body_m: DVec3, at_m: DVec3) -> bool {
        let distance_m = at_m.length();
        self.occulters.iter().zip(&frame.bodies).enumerate().any(|(number, (occulter, at))| {
            if number == body {
                occulter.hides_own(at, site_body_m)
            } else {
                occulter.hides(at, at_m / distance_m, distance_m)
            }
        })
    }

    /// The flashes that are drawn for a frame, from a stream of random numbers of its own, with their places.
    fn drawn(&self, flashes: &Flashes, frame: &SceneFrame) -> Vec<(Flash, DVec3)> {
        let Some(wanted) = flashes.random else { return Vec::new() };
        let mut random = ChaCha8Rng::seed_from_u64(self.seed ^ STREAM);
        random.set_stream(frame.index as u64);
        let at = &frame.bodies[wanted.body];
        let field = Field::of(self);
        let radius_m = self.bodies[wanted.body].bounding_radius_m;
        let mut out = Vec::new();
        for number in 0..wanted.number {
            let magnitude = between(&mut random, wanted.magnitudes);
            let duration_s = between(&mut random, wanted.durations_s);
            let time_s = frame.time_s + between(&mut random, [-duration_s, flashes.exposure_s]);
            let place = (0..TRIES).find_map(|_| {
                let latitude_rad = between(&mut random, [-1.0, 1.0]).asin();
                let longitude_rad = between(&mut random, [0.0, TAU]);
                let up = direction(latitude_rad, longitude_rad);
                shows_night_side(at, up, radius_m, &field).then_some((latitude_rad, longitude_rad, up))
            });
            let Some((latitude_rad, longitude_rad, up)) = place else { continue };
            let Some(radius_m) = self.occulters[wanted.body].surface_m(up) else { continue };
            let id = format!("flash {}-{number}", frame.index);
            let body = wanted.body;
            let flash = Flash { id, time_s, duration_s, body, latitude_rad, longitude_rad, magnitude };
            out.push((flash, up * radius_m));
        }
        out
    }

    /// Finds the places of the listed flashes on the meshes.
    ///
    /// # Errors
    /// A body has no surface there.
    pub(crate) fn find_flash_sites(&mut self) -> Result<(), InputError> {
        let Some(flashes) = &self.flashes else { return Ok(()) };
        let sites = flashes.listed.iter().map(|flash| {
            let up = direction(flash.latitude_rad, flash.longitude_rad);
            let radius_m = self.occulters[flash.body].surface_m(up).ok_or_else(|| {
                let name = &self.bodies[flash.body].name;
                InputError::new(
                    &self.file,
                    format!("the mesh of `{name}` has no surface where {} is", flash.id),
                )
                .at("table `flashes`")
                .expected("a surface that a ray from the body's centre meets")
            })?;
            Ok(up * radius_m)
        });
        self.flash_sites_m = sites.collect::<Result<_, InputError>>()?;
        Ok(())
    }

    /// What a user should know of the scene's flashes: listed ones that no exposure holds.
    pub fn flash_notes(&self) -> Vec<String> {
        let Some(flashes) = &self.flashes else { return Vec::new() };
        let times = || self.trajectory.frames.iter().map(|frame| [frame.time_s, flashes.exposure_s]);
        let missed =
            |flash: &&Flash| times().all(|window| overlap(window, [flash.time_s, flash.duration_s]) == 0.0);
        match flashes.listed.iter().filter(missed).count() {
            0 => Vec::new(),
            missed => vec![format!(
                "{missed} of {} flashes of the table shine during no frame's exposure of {} s: a frame's exposure begins \
                 at its time_s",
                flashes.listed.len(),
                flashes.exposure_s
            )],
        }
    }
}

/// Whether a place (its zenith `up`, on a sphere about the body) is in the night, turned to the camera, and in its field.
fn shows_night_side(at: &BodyState, up: DVec3, radius_m: f64, field: &Field) -> bool {
    let up_camera = at.camera_from_body * up;
    let place_m = at.position_camera_m + up_camera * radius_m;
    let dark = up.dot(at.sun_position_body_m) < 0.0;
    dark && place_m.z > 0.0 && up_camera.dot(place_m) < 0.0 && field.shows(place_m.truncate() / place_m.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlaps_of_an_exposure_and_a_flash() {
        for (flash, expected) in [
            ([0.0, 1.0], 1.0),
            ([-1.0, 10.0], 2.0),
            ([1.5, 1.0], 0.5),
            ([-0.5, 1.0], 0.5),
            ([2.0, 1.0], 0.0),
            ([-1.0, 1.0], 0.0),
        ] {
            assert_eq!(overlap([0.0, 2.0], flash), expected, "{flash:?}");
        }
    }

    #[test]
    fn places_are_planetocentric_and_count_east() {
        let quarter = TAU / 4.0;
        for ((latitude, longitude), expected) in
            [((0.0, 0.0), DVec3::X), ((0.0, quarter), DVec3::Y), ((quarter, 1.0), DVec3::Z)]
        {
            assert!(direction(latitude, longitude).distance(expected) < 1e-12);
        }
    }
}
