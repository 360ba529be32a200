//! `retina navigate limb`.

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use retina_files::{InputError, write_atomic};
use retina_formats::Calibration;
use retina_geometry::Pinhole;
use retina_image::{Coding, Photograph, PhotographOptions, read_mask};
use retina_navigation::cameras::{ImageSolver, ImageSolverOptions, KnownCamera};
use retina_navigation::limb::{
    AmongStars, BodyError, KnownBody, LimbCamera, LimbQuestion, Mapping, StarsEpoch,
};
use retina_navigation::products::limb_picture;
use retina_plot::png;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::observer::Observer;
use retina_sky::planets::{Planet, SeenPlanet, seen_planet};
use retina_sky::site::Site;
use retina_sky::time::parse_epoch;
use serde_json::{Value, json};

use super::limb_text::{among_text, text};
use super::stars::{SampleCoding, vector};
use crate::failure::Failure;
use crate::output::{print_json, print_lines};
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Photograph of the body: PNG, TIFF, FITS or JPEG.
    #[arg(value_name = "PHOTO")]
    photo: PathBuf,
    /// Setup with the camera, schema retina.setup/1.
    ///
    /// Without it, `--focal-mm` and `--fov-deg`, the focal length is that of a JPEG's or TIFF's EXIF data.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["focal_mm", "fov_deg"])]
    setup: Option<PathBuf>,
    /// Calibration of the facility, for an image that contains its distortion.
    #[arg(long, value_name = "FILE", requires = "setup")]
    calibration: Option<PathBuf>,
    /// Focal length of the camera, mm.
    #[arg(
        long,
        value_name = "F",
        allow_negative_numbers = true,
        requires = "pixel_um",
        conflicts_with = "fov_deg"
    )]
    focal_mm: Option<f64>,
    /// Size of a pixel, um.
    #[arg(long, value_name = "P", allow_negative_numbers = true, requires = "focal_mm")]
    pixel_um: Option<f64>,
    /// Horizontal field of view, degrees.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    fov_deg: Option<f64>,
    /// Uncertainty of the focal length (1 sigma), per cent [default: 0.5; 4 for an EXIF focal length].
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    focal_percent: Option<f64>,
    /// The body: `moon`, a planet, or a mesh (.glb, .gltf, .obj, .icq, .bds).
    ///
    /// In a known attitude the silhouette of a mesh is fitted, otherwise the outline of its ellipsoid.
    #[arg(long, default_value = "moon", value_name = "NAME|FILE")]
    body: String,
    /// Semi-axes of a body of no name, m: one number, or A,B,C.
    #[arg(long, value_name = "R|A,B,C", conflicts_with = "body")]
    radii_m: Option<String>,
    /// Mesh of the body (.glb, .gltf, .obj, .icq, .bds) in its own axes: its silhouette is fitted, terrain included.
    ///
    /// The attitude must be known: `--camera-from-body`, or `--stars` with `--time`.
    #[arg(long, value_name = "MESH")]
    silhouette: Option<PathBuf>,
    /// Attitude of the body, a quaternion that turns its axes into the camera's: W,X,Y,Z.
    ///
    /// Only a body that is not nearly round needs it.
    #[arg(long, value_name = "W,X,Y,Z", allow_hyphen_values = true)]
    camera_from_body: Option<String>,
    /// Mean height of the seen limb above the body's reference surface, m [default: the body's].
    #[arg(long, value_name = "H", allow_hyphen_values = true)]
    limb_height_m: Option<f64>,
    /// Uncertainty (1 sigma) of that height, and of the limb's first degree, m [default: the body's].
    #[arg(long, value_name = "SIGMA", allow_negative_numbers = true)]
    limb_height_sigma_m: Option<f64>,
    /// Position angle of the Sun in the image, degrees: 0 is up, 90 is left [default: found from the lit shape].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    sun_deg: Option<f64>,
    /// Epoch of the photograph, ISO 8601; without `Z`, `UTC` or an offset such as `+02:00` at its end it is TDB.
    #[arg(long, value_name = "EPOCH")]
    time: Option<String>,
    /// Place on the Earth (WGS 84): latitude and east longitude in degrees, height in m.
    ///
    /// With the time it gives the phase angle, and the range and radius that are expected.
    #[arg(long, value_name = "LAT,LON,HEIGHT", requires = "time", allow_hyphen_values = true)]
    site: Option<String>,
    /// Position of the camera, barycentric ICRF, m, instead of a place on the Earth.
    #[arg(
        long,
        value_name = "X,Y,Z",
        requires = "time",
        conflicts_with = "site",
        allow_hyphen_values = true
    )]
    position_m: Option<String>,
    /// Find the stars beside the body, too: they give attitude, focal length and the camera's place.
    ///
    /// With `--time` they also say how the body is turned and where the Sun is.
    #[arg(long)]
    stars: bool,
    /// SPICE kernel for places, axes and radii of bodies [default: analytical theories].
    ///
    /// SPK, text and binary PCK, frame, leap-second or meta-kernel. Repeat the flag for more kernels. If
    /// several contain the same body, the last one named is used.
    #[arg(long, value_name = "KERNEL", requires = "time")]
    ephemeris: Vec<PathBuf>,
    /// Bits of the camera's digital numbers, where they are linear [default: the setup's, or those of
    /// the file].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16))]
    bits: Option<u32>,
    /// How samples stand for light [default: sRGB for JPEG and colour of 8 bits, otherwise linear].
    #[arg(long, value_enum)]
    coding: Option<SampleCoding>,
    /// Dark frame of the same exposure, subtracted from the photograph.
    #[arg(long, value_name = "FILE")]
    dark: Option<PathBuf>,
    /// Flat field by which the photograph is divided, of any brightness.
    #[arg(long, value_name = "FILE")]
    flat: Option<PathBuf>,
    /// Picture of the photograph's size: pixels that are 0 are ignored, such as a tree or a cloud beside the body.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// Draw the photograph with the fitted outline, and the residuals along the limb.
    #[arg(long, value_name = "FILE.png")]
    annotate: Option<PathBuf>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.check()?;
    let ephemeris = Ephemeris::read(&arguments.ephemeris)?;
    let body = arguments.body(&ephemeris)?;
    let expected = arguments.expected(&body, &ephemeris)?;
    let (photograph, camera, focal_share) = arguments.read()?;
    let question = LimbQuestion {
        camera,
        focal_sigma_share: arguments.focal_percent.map_or(focal_share, |percent| percent / 100.0),
        body,
        sun_angle_rad: arguments.sun_deg.map(f64::to_radians),
        phase_rad: None,
        expected,
        tone_sigma_share: if photograph.linearised { LimbQuestion::TONE_SIGMA_SHARE } else { 0.0 },
    };
    let size = [photograph.image.width_px, photograph.image.height_px];
    let mask = arguments.mask.as_ref().map(|path| read_mask(path, size)).transpose()?;
    let seen = match &mask {
        None => photograph.image.clone(),
        Some(mask) => photograph.image.clone().seen_in(mask),
    };
    let mut notes = photograph.notes();
    let (question, answer, among) = if arguments.stars {
        let among = arguments.among_stars(&question, &photograph, mask.as_deref(), &ephemeris, &mut notes)?;
        (among.question.clone(), among.answer.clone(), Some(among))
    } else {
        (question.clone(), question.solve(&seen), None)
    };
    let file = arguments.photo.display().to_string();
    if let Some(path) = &arguments.annotate {
        let title = arguments.photo.file_name().map_or(file.clone(), |name| name.to_string_lossy().into());
        let svg = limb_picture(&answer, &photograph.image, &title).to_svg();
        let bytes = png(&svg, 1.0).map_err(|error| Failure::new(error.to_string()))?;
        write_atomic(path, &bytes)
            .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))?;
    }
    if question.tone_sigma_share > 0.0 {
        notes.push(format!(
            "a camera's own tone curve may shift the limb by {} of its blur, which is in sigma",
            question.tone_sigma_share
        ));
    }
    if let Some(mask) = &mask {
        let share = mask.iter().filter(|seen| **seen).count() as f64 / mask.len().max(1) as f64;
        notes.push(format!("the mask leaves {:.1} % of the photograph", 100.0 * share));
    }
    notes.extend(question.doubts(&answer));
    if arguments.json {
        let mut document = question.json(&answer);
        document["file"] = json!(file);
        document["notes"] = json!(notes);
        if let (Value::Object(document), Some(Value::Object(more))) =
            (&mut document, among.map(|among| among.json(&file)))
        {
            document.extend(more);
        }
        return print_json(&document);
    }
    let mut lines = text(&file, &question, &answer);
    lines.extend(among.iter().flat_map(among_text));
    lines.extend(notes.iter().map(|note| format!("  note: {note}")));
    print_lines(&lines)
}

impl Arguments {
    /// Refuses values out of range and outputs that would overwrite inputs.
    fn check(&self) -> Result<(), Failure> {
        let ranges: [(&str, Option<f64>, std::ops::RangeInclusive<f64>, &str); 7] = [
            ("--focal-mm", self.focal_mm, 0.1..=1e5, "0.1 to 100000"),
            ("--pixel-um", self.pixel_um, 0.1..=1e3, "0.1 to 1000"),
            ("--fov-deg", self.fov_deg, 0.01..=120.0, "0.01 to 120"),
            ("--focal-percent", self.focal_percent, 0.0..=20.0, "0 to 20"),
            ("--sun-deg", self.sun_deg, -360.0..=360.0, "-360 to 360"),
            ("--limb-height-m", self.limb_height_m, -1e8..=1e8, "-1e8 to 1e8"),
            ("--limb-height-sigma-m", self.limb_height_sigma_m, 0.0..=1e8, "0 to 1e8"),
        ];
        for (flag, value, range, expected) in ranges {
            if let Some(found) = value.filter(|value| !range.contains(value)) {
                return Err(InputError::new(Path::new(flag), "the value is out of range")
                    .found(found)
                    .expected(expected)
                    .into());
            }
        }
        if let Some(path) = &self.annotate {
            crate::check_file(path, "png")?;
        }
        let inputs = [&self.setup, &self.calibration, &self.dark, &self.flat, &self.mask, &self.silhouette];
        if let (Some(mesh), None, false) =
            (&self.silhouette, &self.camera_from_body, self.stars && self.time.is_some())
        {
            return Err(InputError::new(mesh, "a silhouette depends on the attitude, which is not known")
                .expected("--camera-from-body W,X,Y,Z, or --stars with --time")
                .help("give one of these, or leave --silhouette out")
                .into());
        }
        let mesh = PathBuf::from(&self.body);
        let inputs = std::iter::once(&self.photo)
            .chain(std::iter::once(&mesh))
            .chain(&self.ephemeris)
            .chain(inputs.into_iter().flatten());
        crate::check_apart(inputs, [self.annotate.as_ref()], None)
    }

    fn body(&self, ephemeris: &Ephemeris) -> Result<KnownBody, Failure> {
        let camera_from_body = self.camera_from_body.as_deref().map(rotation).transpose()?;
        let flag = if self.radii_m.is_some() { "--radii-m" } else { "--body" };
        let refused = |error: BodyError| match error {
            BodyError::Mesh(error) => error,
            error @ BodyError::Axes { .. } => InputError::new(Path::new(flag), error.to_string())
                .help("give one radius, or three semi-axes with commas between, in metres"),
            error @ BodyError::Attitude { .. } => InputError::new(Path::new(flag), error.to_string())
                .help("give the body's attitude (--camera-from-body W,X,Y,Z)"),
        };
        let body = if let Some(text) = &self.radii_m {
            KnownBody::ellipsoid("body", radii_m(text)?, camera_from_body).map_err(refused)?
        } else if let Some(planet) = Planet::from_name(&self.body) {
            KnownBody::planet_of(ephemeris, planet, camera_from_body).map_err(refused)?
        } else if Path::new(&self.body).extension().is_some() {
            KnownBody::mesh(Path::new(&self.body), camera_from_body).map_err(refused)?
        } else {
            return Err(InputError::new(Path::new("--body"), "is no body that is known here")
                .found(format!("`{}`", self.body))
                .expected("`moon`, a planet such as `earth`, or a mesh (.glb, .gltf, .obj, .icq, .bds)")
                .help("give the semi-axes of another body (--radii-m)")
                .into());
        };
        let body = match &self.silhouette {
            None => body,
            Some(mesh) => body.with_silhouette(mesh).map_err(refused)?,
        };
        Ok(body.with_given_limb(self.limb_height_m, self.limb_height_sigma_m))
    }

    fn among_stars(
        &self,
        question: &LimbQuestion,
        photograph: &Photograph,
        mask: Option<&[bool]>,
        ephemeris: &Ephemeris,
        notes: &mut Vec<String>,
    ) -> Result<AmongStars, Failure> {
        let failure = |error: &dyn std::fmt::Display| Failure::new(error.to_string());
        let size = [photograph.image.width_px, photograph.image.height_px];
        let known = match &self.setup {
            Some(path) => {
                let setup = read_setup(path)?;
                let calibration =
                    self.calibration.as_ref().map(|path| Calibration::read(path, &setup)).transpose()?;
                KnownCamera::Setup(Box::new(setup), calibration.map(Box::new))
            }
            None if self.fov_deg.is_some() || self.focal_mm.is_some() => {
                let half = 0.5 * f64::from(size[0]) / question.camera.pinhole.fx_px;
                KnownCamera::Field([2.0 * half.atan(); 2])
            }
            None => KnownCamera::Exif,
        };
        let tdb_s = self.time.as_deref().map(epoch_s).transpose()?;
        let epoch = tdb_s.map(|tdb_s| StarsEpoch { tdb_s, ephemeris });
        let mut solver =
            ImageSolver::new(known, ImageSolverOptions { tdb_s, ..ImageSolverOptions::default() });
        question
            .solve_among_stars(&photograph.image, &photograph.exif, mask, &mut solver, epoch, notes)
            .map_err(|error| failure(&error))
    }

    /// The body as the ephemeris has it, where time and place are given.
    fn expected(&self, body: &KnownBody, ephemeris: &Ephemeris) -> Result<Option<SeenPlanet>, Failure> {
        let failure = |error: &dyn std::fmt::Display| Failure::new(error.to_string());
        if self.site.is_none() && self.position_m.is_none() {
            return match &self.time {
                None => Ok(None),
                Some(_) if self.stars => Ok(None),
                Some(_) => Err(InputError::new(Path::new("--time"), "says nothing without a place")
                    .help("give --site LAT,LON,HEIGHT or --position-m X,Y,Z, or leave --time out")
                    .into()),
            };
        }
        let Some(planet) = body.planet else {
            return Err(InputError::new(Path::new("--body"), "has no ephemeris")
                .found(format!("`{}`", body.name))
                .expected("`moon` or a planet, where a time and a place are given")
                .help("leave --time, --site and --position-m out")
                .into());
        };
        let time = self.time.as_deref().unwrap_or_default();
        let tdb_s = epoch_s(time)?;
        let (position_m, velocity_m_s) = match (&self.site, &self.position_m) {
            (Some(text), _) => {
                let (position_m, velocity_m_s) =
                    site(text)?.state(ephemeris, tdb_s).map_err(|error| failure(&error))?;
                (position_m, Some(velocity_m_s))
            }
            (None, text) => (vector("--position-m", text.as_deref().unwrap_or_default())?, None),
        };
        let observer =
            Observer::new(ephemeris, tdb_s, position_m, velocity_m_s).map_err(|error| failure(&error))?;
        let seen = seen_planet(&observer, planet).map_err(|error| failure(&error))?;
        // From the Earth's surface its own centre is less than a radius away.
        seen.map(Some).ok_or_else(|| {
            InputError::new(Path::new("--body"), "the camera is inside the body, or on it")
                .found(planet.name())
                .help("check the body and the place")
                .into()
        })
    }

    /// The photograph, its camera, and the uncertainty of the focal length, share of it.
    fn read(&self) -> Result<(Photograph, LimbCamera, f64), Failure> {
        let setup = self.setup.as_ref().map(|path| read_setup(path)).transpose()?;
        let options = PhotographOptions {
            bits: self.bits.or(setup.as_ref().map(|setup| setup.camera.bits)),
            coding: self.coding.map_or(Coding::ByKind, SampleCoding::coding),
            // A setup counts pixels as the sensor does, however a viewer turns them.
            upright: setup.is_none(),
        };
        let mut photograph = Photograph::read(&self.photo, options)?;
        photograph.image = {
            let frame = |path: &Option<PathBuf>| {
                let read = |path: &PathBuf| {
                    Ok::<_, InputError>((path.clone(), Photograph::read(path, options)?.image))
                };
                path.as_ref().map(read).transpose()
            };
            let (dark, flat) = (frame(&self.dark)?, frame(&self.flat)?);
            photograph.image.clone().reduced(
                dark.as_ref().map(|(path, image)| (path.as_path(), image)),
                flat.as_ref().map(|(path, image)| (path.as_path(), image)),
            )?
        };
        let size = [photograph.image.width_px, photograph.image.height_px];
        if let (Some(setup), Some(path)) = (&setup, &self.setup) {
            let expected = [setup.camera.width_px, setup.camera.height_px];
            if size != expected {
                return Err(InputError::new(
                    &self.photo,
                    "the image does not have the size of the setup's camera",
                )
                .found(format!("{} x {} pixels", size[0], size[1]))
                .expected(format!("{} x {}, as {} has it", expected[0], expected[1], path.display()))
                .help("give the setup of this camera, or --focal-mm and --pixel-um instead")
                .into());
            }
            let pinhole = setup.camera_pinhole();
            let mapping = match &self.calibration {
                None => Mapping::Pinhole,
                Some(path) => Mapping::Downstream(Box::new(Calibration::read(path, setup)?)),
            };
            return Ok((photograph, LimbCamera { pinhole, mapping }, LimbQuestion::FOCAL_SIGMA_SHARE));
        }
        let width = f64::from(size[0]);
        let (focal_px, share) = match (self.focal_mm, self.pixel_um, self.fov_deg) {
            (Some(focal_mm), Some(pixel_um), _) => {
                (1e3 * focal_mm / pixel_um, LimbQuestion::FOCAL_SIGMA_SHARE)
            }
            (_, _, Some(deg)) => {
                (0.5 * width / (0.5 * deg.to_radians()).tan(), LimbQuestion::FOCAL_SIGMA_SHARE)
            }
            _ => {
                let focal_px = photograph.exif.focal_px(size).ok_or_else(|| {
                    InputError::new(&self.photo, "the camera's focal length is not known")
                        .found("no 35-mm equivalent in the file's EXIF data")
                        .expected("--setup FILE, --focal-mm F with --pixel-um P, or --fov-deg DEG")
                        .help("give one of these")
                })?;
                (focal_px, LimbQuestion::EXIF_FOCAL_SIGMA_SHARE)
            }
        };
        Ok((photograph, LimbCamera::pinhole(Pinhole::centred(focal_px, size)), share))
    }
}

fn epoch_s(time: &str) -> Result<f64, Failure> {
    parse_epoch(time).map_err(|error| Failure::new(format!("--time: {error}")))
}

/// `LAT,LON,HEIGHT`: degrees, degrees, m.
fn site(text: &str) -> Result<Site, Failure> {
    let wrong = || {
        InputError::new(Path::new("--site"), "is no place on the Earth")
            .found(format!("`{text}`"))
            .expected("three numbers, LAT,LON,HEIGHT: degrees, degrees, metres")
    };
    let place = vector("--site", text).map_err(|_| wrong())?;
    let [latitude_deg, longitude_deg, altitude_m] = place.to_array();
    if latitude_deg.abs() > 90.0 || longitude_deg.abs() > 360.0 || altitude_m.abs() > 1e5 {
        return Err(wrong()
            .expected("latitude -90 to 90 deg, east longitude -360 to 360 deg, height -100000 to 100000 m")
            .into());
    }
    Ok(Site {
        latitude_rad: latitude_deg.to_radians(),
        longitude_rad: longitude_deg.to_radians(),
        altitude_m,
    })
}

/// One radius, or three semi-axes, m.
fn radii_m(text: &str) -> Result<DVec3, Failure> {
    if text.contains(',') {
        return vector("--radii-m", text);
    }
    match text.trim().parse::<f64>() {
        Ok(radius_m) => Ok(DVec3::splat(radius_m)),
        Err(_) => Err(InputError::new(Path::new("--radii-m"), "is no radius")
            .found(format!("`{text}`"))
            .expected("a number of metres, or three, A,B,C")
            .into()),
    }
}

/// A quaternion, scalar first, of any length above 0.
fn rotation(text: &str) -> Result<DMat3, Failure> {
    let numbers: Vec<f64> = text.split(',').map(|part| part.trim().parse().unwrap_or(f64::NAN)).collect();
    if let [w, x, y, z] = numbers[..] {
        let turn = DQuat::from_xyzw(x, y, z, w);
        if turn.is_finite() && turn.length() > 1e-6 {
            return Ok(DMat3::from_quat(turn.normalize()));
        }
    }
    Err(InputError::new(Path::new("--camera-from-body"), "is no rotation")
        .found(format!("`{text}`"))
        .expected("four numbers, W,X,Y,Z, not all 0")
        .into())
}
