//! The scenario: `far-range.toml`, schema `retina.far-range/1`.

use std::path::{Path, PathBuf};

use retina_files::{InputError, hash_bytes, read_schema, read_text};
use retina_formats::Calibration;
use retina_geometry::Setup;
use retina_sky::deep_space::DeepSpace;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::planets::Planet;
use retina_sky::time::parse_epoch;
use serde::{Deserialize, Serialize};

use retina_navigation::synthetic::PointNoise;

/// Where the measurements come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Images {
    /// No pixels: positions with noise, by `[points]`.
    Points,
    /// The sky photographed by a camera with Gaussian spots: the facility left out.
    Ideal,
    /// The sky on the compensated screen of the virtual bench, photographed through its optics.
    Bench,
}

/// Which images a transfer's filter is run on, besides the Monte Carlo.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TransferImages {
    /// None.
    None,
    /// As [`Images::Ideal`].
    Ideal,
    /// As [`Images::Bench`].
    Bench,
}

impl TransferImages {
    /// How they are taken, where there are any.
    pub fn taken(self) -> Option<Images> {
        match self {
            Self::None => None,
            Self::Ideal => Some(Images::Ideal),
            Self::Bench => Some(Images::Bench),
        }
    }
}

/// The file as it is written.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    schema: String,
    setup: PathBuf,
    calibration: Option<PathBuf>,
    #[serde(default)]
    ephemeris: Vec<PathBuf>,
    #[serde(default)]
    seed: u64,
    #[serde(default = "points")]
    images: Images,
    #[serde(default)]
    poses: Poses,
    #[serde(default)]
    points: PointNoise,
    #[serde(default)]
    exposure: ExposureChoice,
    transfer: Option<TransferFile>,
}

fn points() -> Images {
    Images::Points
}

/// Random poses in the Solar System.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Poses {
    /// How many.
    pub count: usize,
    /// Least and greatest distance from the Sun, au.
    pub sun_distance_au: [f64; 2],
    /// Uncertainty of the position that planets are looked for with (3 sigma per axis), km.
    pub position_3_sigma_km: f64,
    /// Faintest star that is shown.
    pub faintest_magnitude: f64,
    /// An attitude counts as found within this error across the boresight, arcsec.
    pub found_within_arcsec: f64,
}

impl Default for Poses {
    /// The paper's.
    fn default() -> Self {
        Self {
            count: 5000,
            sun_distance_au: [0.7, 5.2],
            position_3_sigma_km: 1e5,
            faintest_magnitude: 8.25,
            found_within_arcsec: 60.0,
        }
    }
}

/// How long is exposed.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExposureChoice {
    /// A star of this magnitude fills 60 % of the full well in its brightest pixel.
    pub full_magnitude: f64,
}

impl Default for ExposureChoice {
    fn default() -> Self {
        Self { full_magnitude: 1.5 }
    }
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TransferFile {
    arrival: String,
    days: f64,
    #[serde(default = "ten")]
    session_days: f64,
    #[serde(default = "images")]
    images_per_session: usize,
    #[serde(default = "interval")]
    interval_s: f64,
    #[serde(default = "samples")]
    samples: usize,
    #[serde(default = "none")]
    images: TransferImages,
    #[serde(default = "four")]
    imaged_per_session: usize,
    planets: Vec<String>,
    #[serde(default = "exclusion")]
    sun_exclusion_deg: f64,
    line_of_sight_sigma_arcsec: Option<f64>,
    arrival_offset_km: [f64; 3],
    arrival_velocity_m_s: [f64; 3],
    initial_position_3_sigma_km: f64,
    initial_velocity_3_sigma_m_s: f64,
    pressure_area_m2_kg: f64,
    acceleration_sigma_m_s2: f64,
}

fn ten() -> f64 {
    10.0
}
fn images() -> usize {
    72
}
fn interval() -> f64 {
    100.0
}
fn samples() -> usize {
    100
}
fn none() -> TransferImages {
    TransferImages::None
}
fn four() -> usize {
    4
}
fn exclusion() -> f64 {
    20.0
}

/// A transfer that ends near Mars.
#[derive(Debug, Clone)]
pub struct Transfer {
    /// Epoch at its end, TDB seconds since J2000.
    pub arrival_tdb_s: f64,
    /// Its length, s.
    pub length_s: f64,
    /// Between sessions, s.
    pub session_s: f64,
    /// Images of each session, half of them of either planet.
    pub images_per_session: usize,
    /// Between images, s.
    pub interval_s: f64,
    /// Monte Carlo samples.
    pub samples: usize,
    /// The images of one more run of the filter.
    pub images: TransferImages,
    /// How many of each session's images are taken for it, evenly among them.
    pub imaged_per_session: usize,
    /// Planets that may be looked at.
    pub planets: Vec<Planet>,
    /// Least angle between a planet and the Sun, rad.
    pub sun_exclusion_rad: f64,
    /// Standard deviation of a planet's line of sight per axis, rad; absent: what the random poses gave.
    pub line_of_sight_sigma_rad: Option<f64>,
    /// From Mars to the spacecraft at the end, ICRF, m.
    pub arrival_offset_m: [f64; 3],
    /// Velocity relative to Mars at the end, ICRF, m/s.
    pub arrival_velocity_m_s: [f64; 3],
    /// Standard deviations per axis at the beginning: m, m/s.
    pub initial_sigma: [f64; 2],
    /// Reflectivity coefficient times area over mass, m^2/kg.
    pub pressure_area_m2_kg: f64,
    /// Standard deviation per axis of the unknown acceleration, m/s^2.
    pub acceleration_sigma_m_s2: f64,
}

/// What the caller says in the place of the file.
#[derive(Debug, Clone, Default)]
pub struct Choice {
    /// Where the measurements come from.
    pub images: Option<Images>,
    /// Which images a transfer's filter is run on.
    pub transfer_images: Option<TransferImages>,
    /// Number of random poses.
    pub poses: Option<usize>,
    /// The bench's calibration.
    pub calibration: Option<PathBuf>,
}

/// A scenario with all it names read and checked.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// The facility.
    pub setup: Setup,
    /// Its calibration, for images of the bench.
    pub calibration: Option<Calibration>,
    /// Where Sun and planets are, to the truth and to the filter.
    pub ephemeris: Ephemeris,
    /// Seed of poses and noise.
    pub seed: u64,
    /// Where the measurements come from.
    pub images: Images,
    /// Random poses.
    pub poses: Poses,
    /// Measurements without pixels.
    pub points: PointNoise,
    /// Exposure.
    pub exposure: ExposureChoice,
    /// The transfer, if there is one.
    pub transfer: Option<Transfer>,
    /// Hash of all that decides a pose's result, but the number of poses.
    pub poses_hash: String,
    /// Hash of all that decides what the transfer's images give; empty without any.
    pub transfer_hash: String,
}

impl Scenario {
    /// Reads and checks a scenario; `choice` takes the place of the file's own.
    ///
    /// # Errors
    /// It, or a file that it names, does not fit.
    pub fn read(path: &Path, choice: &Choice) -> Result<Self, InputError> {
        let mut file: File = read_schema(path, "retina.far-range/1", "a far-range scenario")?;
        file.images = choice.images.unwrap_or(file.images);
        file.poses.count = choice.poses.unwrap_or(file.poses.count);
        if let (Some(transfer), Some(images)) = (&mut file.transfer, choice.transfer_images) {
            transfer.images = images;
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let setup = Setup::named(&file.setup, folder).map_err(|error| error.named_by(path, "setup"))?;
        let own = || file.calibration.as_ref().map(|own| folder.join(own));
        let calibration_path = choice.calibration.clone().or_else(own).or_else(|| setup.calibration_path());
        let of_transfer = file.transfer.as_ref().and_then(|transfer| transfer.images.taken());
        let on_bench = [Some(file.images), of_transfer].contains(&Some(Images::Bench));
        if let (Some(unused), false) = (&choice.calibration, on_bench) {
            return Err(InputError::new(unused, "is not used: no image comes from the bench")
                .help("choose images of the bench (`bench`), or name no calibration"));
        }
        let calibration = match (&calibration_path, on_bench) {
            (Some(own), true) => Some(Calibration::read(own, &setup)?),
            (None, true) => {
                return Err(InputError::new(
                    path,
                    "images of the bench need a calibration: the screen is compensated by it",
                )
                .at("key `calibration`")
                .help("name one here or in the setup; `retina calibrate geometry` makes it"));
            }
            _ => None,
        };
        file.check(path)?;
        let transfer = file.transfer.as_ref().map(|transfer| transfer.read(path)).transpose()?;
        let kernels: Vec<PathBuf> = file.ephemeris.iter().map(|own| folder.join(own)).collect();
        let ephemeris = Ephemeris::read(&kernels).map_err(|error| error.named_by(path, "ephemeris"))?;
        if let Some(transfer) = &transfer {
            // A day beyond both ends: light is hours old, and the last session follows the arrival.
            let begin_s = transfer.arrival_tdb_s - transfer.length_s;
            for epoch_s in [begin_s - 86_400.0, transfer.arrival_tdb_s + 86_400.0] {
                ephemeris.solar_system(epoch_s).map_err(|error| {
                    InputError::new(path, error.to_string()).at("keys `transfer.arrival` and `transfer.days`")
                })?;
            }
        }
        let setup_hash = setup.hash_of_named(&file.setup, folder)?;
        let calibration_text = match (&calibration, &calibration_path) {
            (Some(_), Some(own)) => read_text(own)?,
            _ => String::new(),
        };
        let hash = |images: Images, decides: String| {
            let calibration = if images == Images::Bench { calibration_text.as_str() } else { "" };
            let kernels = ephemeris.kernel_files().iter().map(|kernel| kernel.hash.as_str());
            let all = [decides.as_str(), &setup_hash, calibration].into_iter().chain(kernels);
            hash_bytes(all.collect::<String>().as_bytes())
        };
        // What is shown and how it is measured; the number of poses and the transfer change no pose.
        let decides = (&file.images, file.seed, &file.points, &file.exposure, {
            let mut poses = file.poses.clone();
            poses.count = 0;
            poses
        });
        let poses_hash = hash(file.images, serde_json::to_string(&decides).unwrap_or_default());
        let transfer_hash = of_transfer.map_or(String::new(), |images| {
            let mut own = file.transfer.clone();
            // The Monte Carlo's own keys change no image.
            if let Some(own) = &mut own {
                (own.samples, own.line_of_sight_sigma_arcsec) = (0, None);
            }
            let mut poses = file.poses.clone();
            (poses.count, poses.position_3_sigma_km) = (0, 0.0);
            let decides = (own, file.seed, &file.points, &file.exposure, poses);
            hash(images, serde_json::to_string(&decides).unwrap_or_default())
        });
        Ok(Self {
            setup,
            calibration,
            ephemeris,
            seed: file.seed,
            images: file.images,
            poses: file.poses,
            points: file.points,
            exposure: file.exposure,
            transfer,
            poses_hash,
            transfer_hash,
        })
    }

    /// The random poses of the scenario.
    pub fn deep_space(&self) -> DeepSpace {
        let camera = self.setup.camera_pinhole();
        let field = |px: u32, f: f64| 2.0 * (0.5 * f64::from(px) / f).atan();
        DeepSpace {
            frames: self.poses.count,
            seed: self.seed,
            sun_distance_au: self.poses.sun_distance_au,
            field_rad: [field(camera.width_px, camera.fx_px), field(camera.height_px, camera.fy_px)],
            ..DeepSpace::default()
        }
    }
}

/// Farthest pose from the Sun: beyond it the planets are no longer seen.
const FARTHEST_AU: f64 = 1000.0;

fn refuse(path: &Path, key: &str, found: f64, expected: &str) -> InputError {
    InputError::new(path, "the value does not fit").at(format!("key `{key}`")).found(found).expected(expected)
}

impl File {
    fn check(&self, path: &Path) -> Result<(), InputError> {
        let (p, n) = (&self.poses, &self.points);
        let positive = |v: f64| v > 0.0 && v.is_finite();
        for (key, value, fits) in [
            ("poses.count", p.count as f64, (1..=1_000_000).contains(&p.count)),
            ("poses.position_3_sigma_km", p.position_3_sigma_km, positive(p.position_3_sigma_km)),
            ("poses.found_within_arcsec", p.found_within_arcsec, positive(p.found_within_arcsec)),
            ("poses.faintest_magnitude", p.faintest_magnitude, p.faintest_magnitude.is_finite()),
            ("points.limiting_magnitude", n.limiting_magnitude, n.limiting_magnitude.is_finite()),
            ("points.spot_sigma_px", n.spot_sigma_px, positive(n.spot_sigma_px)),
            ("points.systematic_px", n.systematic_px, n.systematic_px >= 0.0 && n.systematic_px < 10.0),
            ("points.false_points", n.false_points, (0.0..=100.0).contains(&n.false_points)),
            ("points.saturation_magnitude", n.saturation_magnitude, n.saturation_magnitude.is_finite()),
            (
                "exposure.full_magnitude",
                self.exposure.full_magnitude,
                self.exposure.full_magnitude.is_finite(),
            ),
        ] {
            if !fits {
                return Err(refuse(path, key, value, "a number within reason, above 0 where it is a size"));
            }
        }
        let [near, far] = p.sun_distance_au;
        if !(near > 0.0 && near <= far && far <= FARTHEST_AU) {
            return Err(InputError::new(path, "the range of distances from the Sun is none")
                .at("key `poses.sun_distance_au`")
                .found(format!("[{near}, {far}]"))
                .expected(format!("the least, then the greatest, above 0 and at most {FARTHEST_AU} au")));
        }
        Ok(())
    }
}

impl TransferFile {
    fn read(&self, path: &Path) -> Result<Transfer, InputError> {
        let arrival_tdb_s = parse_epoch(&self.arrival)
            .map_err(|error| InputError::new(path, error.to_string()).at("key `transfer.arrival`"))?;
        let positive = |v: f64| v > 0.0 && v.is_finite();
        let session_length_s = self.images_per_session as f64 * self.interval_s;
        for (key, value, fits, expected) in [
            ("days", self.days, (1.0..=3650.0).contains(&self.days), "1 to 3650"),
            (
                "session_days",
                self.session_days,
                positive(self.session_days) && self.session_days <= self.days,
                "above 0, at most `days`",
            ),
            ("images_per_session", self.images_per_session as f64, self.images_per_session >= 2, "2 or more"),
            (
                "imaged_per_session",
                self.imaged_per_session as f64,
                (2..=self.images_per_session).contains(&self.imaged_per_session),
                "2 to `images_per_session`",
            ),
            (
                "interval_s",
                self.interval_s,
                positive(self.interval_s) && session_length_s < 86_400.0 * self.session_days,
                "above 0, a session shorter than `session_days`",
            ),
            ("samples", self.samples as f64, (2..=100_000).contains(&self.samples), "2 to 100000"),
            (
                "sun_exclusion_deg",
                self.sun_exclusion_deg,
                (0.0..180.0).contains(&self.sun_exclusion_deg),
                "0 to below 180",
            ),
            (
                "line_of_sight_sigma_arcsec",
                self.line_of_sight_sigma_arcsec.unwrap_or(1.0),
                positive(self.line_of_sight_sigma_arcsec.unwrap_or(1.0)),
                "above 0",
            ),
            (
                "initial_position_3_sigma_km",
                self.initial_position_3_sigma_km,
                positive(self.initial_position_3_sigma_km),
                "above 0",
            ),
            (
                "initial_velocity_3_sigma_m_s",
                self.initial_velocity_3_sigma_m_s,
                positive(self.initial_velocity_3_sigma_m_s),
                "above 0",
            ),
            (
                "pressure_area_m2_kg",
                self.pressure_area_m2_kg,
                (0.0..100.0).contains(&self.pressure_area_m2_kg),
                "0 to 100",
            ),
            (
                "acceleration_sigma_m_s2",
                self.acceleration_sigma_m_s2,
                (0.0..1.0).contains(&self.acceleration_sigma_m_s2),
                "0 to 1",
            ),
        ] {
            if !fits {
                return Err(refuse(path, &format!("transfer.{key}"), value, expected));
            }
        }
        let mut planets = Vec::new();
        for name in &self.planets {
            let Some(planet) = Planet::from_name(name) else {
                return Err(InputError::new(path, "is not a planet")
                    .at("key `transfer.planets`")
                    .found(format!("`{name}`"))
                    .expected(Planet::ALL.map(Planet::name).join(", ")));
            };
            if planets.contains(&planet) {
                return Err(InputError::new(path, "a planet is named twice")
                    .at("key `transfer.planets`")
                    .found(format!("`{name}`")));
            }
            planets.push(planet);
        }
        if planets.len() < 2 {
            return Err(InputError::new(path, "a session looks at two planets")
                .at("key `transfer.planets`")
                .found(planets.len())
                .expected("two names at least"));
        }
        Ok(Transfer {
            arrival_tdb_s,
            length_s: self.days * 86_400.0,
            session_s: self.session_days * 86_400.0,
            images_per_session: self.images_per_session,
            interval_s: self.interval_s,
            samples: self.samples,
            images: self.images,
            imaged_per_session: self.imaged_per_session,
            planets,
            sun_exclusion_rad: self.sun_exclusion_deg.to_radians(),
            line_of_sight_sigma_rad: self.line_of_sight_sigma_arcsec.map(|s| (s / 3600.0).to_radians()),
            arrival_offset_m: self.arrival_offset_km.map(|v| v * 1e3),
            arrival_velocity_m_s: self.arrival_velocity_m_s,
            initial_sigma: [
                self.initial_position_3_sigma_km * 1e3 / 3.0,
                self.initial_velocity_3_sigma_m_s / 3.0,
            ],
            pressure_area_m2_kg: self.pressure_area_m2_kg,
            acceleration_sigma_m_s2: self.acceleration_sigma_m_s2,
        })
    }
}
