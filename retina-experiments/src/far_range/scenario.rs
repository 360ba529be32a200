//! The scenario: `far-range.toml`, schema `retina.far-range/1`.

use std::path::{Path, PathBuf};

use retina_files::{InputError, hash_bytes, read_schema, read_text};
use retina_formats::Calibration;
use retina_geometry::Setup;
use retina_sky::deep_space::DeepSpace;
use retina_sky::ephemeris::Ephemeris;
use serde::{Deserialize, Serialize};

use retina_navigation::synthetic::PointNoise;

use super::transfer_file::{Transfer, TransferFile, TransferImages};

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
    /// Where that was read.
    pub calibration_path: Option<PathBuf>,
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
            calibration_path,
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

pub(super) fn refuse(path: &Path, key: &str, found: f64, expected: &str) -> InputError {
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
