//! The bodies that a photograph may show.

use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use retina_files::InputError;
use retina_model::load_body;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::planets::Planet;
use thiserror::Error;

use super::{BodyShape, LimbBody};

/// Axes that differ by more than this share of their mean need the attitude: the outline depends on it.
const MOST_UNKNOWN_FLATTENING: f64 = 0.02;
/// What a mesh may be wrong by where nothing is said of it, share of its edges' mean length: the shipped Moon's facets of
/// 11 km are off its map by 199 m rms (`validation/moon_shape.py`).
const MODEL_SIGMA_SHARE: f64 = 0.02;
const MODEL_SIGMA_SOURCE: &str = "an allowance for the mesh: a fiftieth of the mean length of its edges";

/// A body whose limb is looked for, and what is known of its limb.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownBody {
    /// Its name in files.
    pub name: String,
    /// What is fitted: an ellipsoid's outline or a mesh's silhouette.
    pub body: LimbBody,
    /// Mean height of the seen limb above the ellipsoid, m.
    pub limb_height_m: f64,
    /// Standard deviation of the limb's mean height and first degree, m.
    pub limb_height_sigma_m: f64,
    /// Where that comes from, in words.
    pub limb_height_source: String,
    /// Its ephemeris.
    pub planet: Option<Planet>,
    /// Its attitude was given; otherwise it counts as a sphere.
    pub attitude_given: bool,
    /// Shape whose silhouette is fitted once the attitude is known.
    silhouette: Option<Arc<BodyShape>>,
    /// Height of the limb and its standard deviation, m, where they were given.
    given_limb_m: [Option<f64>; 2],
    /// Semi-axes along the body's axes, m: those of `body` are a sphere's where no attitude is known.
    axes_m: DVec3,
}

/// A body whose outline cannot be known.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum BodyError {
    /// An axis is no length.
    #[error("a body's semi-axes must be finite and above 0 m (found {found_m})")]
    Axes {
        /// The semi-axes found, m.
        found_m: DVec3,
    },
    /// A mesh cannot be read, or has no volume.
    #[error(transparent)]
    Mesh(#[from] InputError),
    /// The outline depends on an attitude that is not known.
    #[error(
        "the body's semi-axes differ by {percent:.1} % of their mean: its outline depends on its attitude, which is not \
         known"
    )]
    Attitude {
        /// Difference of the greatest and the least semi-axis, % of their mean.
        percent: f64,
    },
}

impl KnownBody {
    /// A planet or the Moon. Its limb heights are known.
    ///
    /// # Errors
    /// It is too flat for an unknown attitude.
    pub fn planet(planet: Planet, camera_from_body: Option<DMat3>) -> Result<Self, BodyError> {
        Self::planet_of(&Ephemeris::analytic(), planet, camera_from_body)
    }

    /// As [`KnownBody::planet`], with the radii that an ephemeris' kernels give.
    ///
    /// # Errors
    /// As there.
    pub fn planet_of(
        ephemeris: &Ephemeris,
        planet: Planet,
        camera_from_body: Option<DMat3>,
    ) -> Result<Self, BodyError> {
        let [equator_m, pole_m] = ephemeris.radii_m(planet);
        let axes_m = DVec3::new(equator_m, equator_m, pole_m);
        let ([height_m, sigma_m], source) = limb_heights_m(planet);
        let plain = Self::ellipsoid(planet.name(), axes_m, camera_from_body)?;
        Ok(Self { planet: Some(planet), ..plain.with_limb(height_m, sigma_m, source) })
    }

    /// An ellipsoid of semi-axes (m) along the body's axes. Without an attitude one that is nearly round counts as a
    /// sphere of its outlines' mean radius, and by how much that may be wrong is in the limb's height.
    ///
    /// # Errors
    /// The axes are no lengths, or differ too much for an unknown attitude.
    pub fn ellipsoid(
        name: &str,
        semi_axes_m: DVec3,
        camera_from_body: Option<DMat3>,
    ) -> Result<Self, BodyError> {
        if !(semi_axes_m.is_finite() && semi_axes_m.min_element() > 0.0) {
            return Err(BodyError::Axes { found_m: semi_axes_m });
        }
        let mut axes_m = semi_axes_m.to_array();
        axes_m.sort_by(f64::total_cmp);
        let [least_m, middle_m, greatest_m] = axes_m;
        let flattening = 3.0 * (greatest_m - least_m) / (least_m + middle_m + greatest_m);
        let round = flattening == 0.0;
        let (body, sigma_m, source) = match camera_from_body {
            Some(turn) => {
                (LimbBody::ellipsoid(semi_axes_m, turn), 0.0, "none was given for this body".to_owned())
            }
            None if flattening > MOST_UNKNOWN_FLATTENING => {
                return Err(BodyError::Attitude { percent: 100.0 * flattening });
            }
            // An outline has semi-axes of least to middle and of middle to greatest.
            None => (
                LimbBody::sphere(0.25 * (least_m + 2.0 * middle_m + greatest_m)),
                0.25 * (greatest_m - least_m),
                if round { "none was given for this body" } else { "the flattening, in an unknown attitude" }
                    .to_owned(),
            ),
        };
        Ok(Self {
            name: name.to_owned(),
            body,
            limb_height_m: 0.0,
            limb_height_sigma_m: sigma_m,
            limb_height_source: source,
            planet: None,
            attitude_given: camera_from_body.is_some(),
            silhouette: None,
            given_limb_m: [None; 2],
            axes_m: semi_axes_m,
        })
    }

    /// The body of a mesh (`.glb`, `.gltf`, `.obj`). In a known attitude its silhouette is fitted, and its place is the
    /// origin of its axes; otherwise its ellipsoid's outline, if that is nearly round, and its place is the centre of
    /// figure.
    ///
    /// # Errors
    /// The mesh cannot be read, is open, or is not round enough for an unknown attitude.
    pub fn mesh(path: &Path, camera_from_body: Option<DMat3>) -> Result<Self, BodyError> {
        let mesh = load_body(path)?;
        let ellipsoid = mesh.ellipsoid(path)?;
        let name = path.file_stem().map_or_else(|| "body".into(), |stem| stem.to_string_lossy());
        let axes_m = ellipsoid.semi_axes_m;
        let Some(turn) = camera_from_body else {
            return Ok(Self::ellipsoid(&name, axes_m, None)?.with_limb(
                0.0,
                ellipsoid.rms_height_m,
                "the mesh's height above its ellipsoid, rms",
            ));
        };
        let shape = BodyShape::of(&mesh, ellipsoid.body_from_axes.transpose());
        let mut known = Self::ellipsoid(&name, axes_m, Some(turn * ellipsoid.body_from_axes))?.with_limb(
            0.0,
            MODEL_SIGMA_SHARE * shape.mean_edge_m(),
            MODEL_SIGMA_SOURCE,
        );
        known.body.shape = Some(Arc::new(shape));
        Ok(known)
    }

    /// With the silhouette of a mesh in the body's own axes, to be fitted where the attitude is known.
    ///
    /// # Errors
    /// The mesh cannot be read.
    pub fn with_silhouette(mut self, path: &Path) -> Result<Self, BodyError> {
        self.silhouette = Some(Arc::new(BodyShape::read(path)?));
        if self.attitude_given {
            let turn = self.body.camera_from_body;
            return Ok(self.turned(turn));
        }
        Ok(self)
    }

    /// In a known attitude: with its own axes, and its silhouette if it has one.
    #[must_use]
    pub fn turned(mut self, camera_from_body: DMat3) -> Self {
        self.body = LimbBody::ellipsoid(self.axes_m, camera_from_body);
        self.attitude_given = true;
        if let Some(shape) = &self.silhouette {
            self.body.shape = Some(Arc::clone(shape));
            self.limb_height_m = 0.0;
            self.limb_height_sigma_m = MODEL_SIGMA_SHARE * shape.mean_edge_m();
            MODEL_SIGMA_SOURCE.clone_into(&mut self.limb_height_source);
        }
        let [height_m, sigma_m] = self.given_limb_m;
        self.with_given_limb(height_m, sigma_m)
    }

    /// With the limb's mean height and its standard deviation (m) where they are given.
    #[must_use]
    pub fn with_given_limb(mut self, height_m: Option<f64>, sigma_m: Option<f64>) -> Self {
        self.given_limb_m = [height_m, sigma_m];
        self.limb_height_m = height_m.unwrap_or(self.limb_height_m);
        if let Some(sigma_m) = sigma_m {
            self.limb_height_sigma_m = sigma_m;
            "as given".clone_into(&mut self.limb_height_source);
        }
        self
    }

    /// With a limb of this mean height and standard deviation, m; the flattening's part of the latter stays.
    #[must_use]
    pub fn with_limb(self, height_m: f64, sigma_m: f64, source: &str) -> Self {
        let flattening = self.limb_height_sigma_m > 0.0;
        let source =
            if flattening { format!("{source}; {}", self.limb_height_source) } else { source.to_owned() };
        Self {
            limb_height_m: height_m,
            limb_height_sigma_m: self.limb_height_sigma_m.hypot(sigma_m),
            limb_height_source: source,
            ..self
        }
    }
}

/// Mean height of the seen limb above the reference ellipsoid and its standard deviation, m, with its source. The Moon's
/// is measured on its relief; those of the others are allowances for relief, haze and cloud tops.
fn limb_heights_m(planet: Planet) -> ([f64; 2], &'static str) {
    match planet {
        Planet::Moon => (MOON_LIMB_M, "the terrain of the Moon's limb, by its relief"),
        Planet::Mercury => ([0.0, 1e3], "an allowance for terrain"),
        Planet::Venus => ([75e3, 10e3], "an allowance for cloud tops and haze"),
        Planet::Earth => ([10e3, 20e3], "an allowance for cloud tops and haze"),
        Planet::Mars => ([5e3, 10e3], "an allowance for terrain and haze"),
        Planet::Jupiter | Planet::Saturn | Planet::Uranus | Planet::Neptune => {
            ([0.0, 150e3], "an allowance for clouds and haze")
        }
    }
}

/// The Moon's limb above 1737.4 km: what circles through half limbs of random views measure (validation/moon_shape.py).
const MOON_LIMB_M: [f64; 2] = [700.0, 2500.0];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_attitude_counts_as_height_and_a_flat_body_needs_one() {
        // An oblate spheroid's outline is a by c to a: mean radii from (a + c) / 2 to a.
        let earth = KnownBody::planet(Planet::Earth, None).unwrap();
        let [a, c] = [6_378_136.6, 6_356_751.9];
        assert!((earth.body.mean_radius_m() - (3.0 * a + c) / 4.0).abs() < 1.0);
        assert!((earth.limb_height_sigma_m - 20e3f64.hypot((a - c) / 4.0)).abs() < 1.0);
        let error = KnownBody::planet(Planet::Jupiter, None).unwrap_err().to_string();
        assert!(error.contains("differ by 6.6 %") && error.contains("attitude"), "{error}");
        assert!(KnownBody::planet(Planet::Jupiter, Some(DMat3::IDENTITY)).is_ok());
        assert!(KnownBody::ellipsoid("rock", DVec3::new(1.0, -1.0, 1.0), None).is_err());
    }
}
