//! `retina navigate stars`.

use std::path::{Path, PathBuf};

use glam::DVec3;
use retina_files::{InputError, write_atomic};
use retina_formats::Calibration;
use retina_image::{CameraImage, Coding, Photograph, PhotographOptions, read_mask};
use retina_navigation::cameras::{ImageSolver, ImageSolverOptions, KnownCamera};
use retina_navigation::image::{ImageContext, ImageResult};
use retina_navigation::planets::PAPER_POSITION_SIGMA_M;
use retina_navigation::products::{annotated, matches_csv, wcs_header};
use retina_navigation::stars::SolverOptions;
use retina_plot::png;
use retina_sky::ephemeris::{Ephemeris, State};
use retina_sky::observer::Observer;
use retina_sky::time::parse_epoch;
use serde_json::{Value, json};

use super::star_text::text;
use crate::failure::Failure;
use crate::output::{print_json, print_lines};
use crate::progress::counter;
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Star images: PNG, TIFF, FITS or JPEG.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// Setup with the camera, schema retina.setup/1.
    ///
    /// Without it and `--fov-deg`, the field of view is that of a JPEG's or TIFF's EXIF data; if the
    /// stars do not agree with it, or there is none, fields of 2 to 70 deg are searched.
    #[arg(long, value_name = "FILE")]
    setup: Option<PathBuf>,
    /// Calibration of the facility, for images that contain its distortion.
    #[arg(long, value_name = "FILE", requires = "setup", conflicts_with = "fov_deg")]
    calibration: Option<PathBuf>,
    /// Horizontal field of view, degrees, instead of a setup: 11.4, or a range such as 10..13.
    ///
    /// A range costs hardly more time than a value.
    #[arg(long, value_name = "DEG|DEG..DEG", conflicts_with = "setup")]
    fov_deg: Option<String>,
    /// Uncertainty of the focal length, per cent.
    #[arg(long, default_value_t = 3.0, value_name = "PERCENT")]
    focal_percent: f64,
    /// Epoch of the images, ISO 8601 [default: star positions of J2020.0].
    #[arg(long, value_name = "EPOCH")]
    time: Option<String>,
    /// Position of the camera, barycentric ICRF, m: X,Y,Z or `earth`.
    ///
    /// With it, planets are searched for.
    #[arg(long, value_name = "X,Y,Z|earth", requires = "time", allow_hyphen_values = true)]
    position_m: Option<String>,
    /// Velocity of the camera, barycentric ICRF, m/s [default with `earth`: the Earth's].
    ///
    /// With it, the attitude is corrected for aberration.
    #[arg(long, value_name = "X,Y,Z", requires = "position_m", allow_hyphen_values = true)]
    velocity_m_s: Option<String>,
    /// SPICE kernel for places, axes and radii of bodies [default: analytical theories].
    ///
    /// SPK, text and binary PCK, frame, leap-second or meta-kernel. Repeat the flag for more kernels. If
    /// several contain the same body, the last one named is used.
    #[arg(long, value_name = "KERNEL", requires = "position_m")]
    ephemeris: Vec<PathBuf>,
    /// Uncertainty of the position (3 sigma), km.
    #[arg(long, default_value_t = 3e-3 * PAPER_POSITION_SIGMA_M)]
    position_3_sigma_km: f64,
    /// Highest accepted probability of a false answer, as log10.
    #[arg(long, default_value_t = -7.0, allow_negative_numbers = true)]
    log10_bound: f64,
    /// Number of star patterns (hypotheses) after which the search on an image stops.
    ///
    /// No ordinary image comes near the default.
    #[arg(long, default_value_t = SolverOptions::default().most_hypotheses, value_name = "N")]
    most_hypotheses: usize,
    /// Detection threshold of a point's brightest 3 x 3 pixels over the background, standard
    /// deviations.
    #[arg(long, default_value_t = 5.0)]
    threshold_sigma: f64,
    /// Bits of the camera's digital numbers, where they are linear [default: the setup's, or those of
    /// the file].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16))]
    bits: Option<u32>,
    /// How samples stand for light [default: sRGB for JPEG and colour of 8 bits, otherwise linear].
    #[arg(long, value_enum)]
    coding: Option<SampleCoding>,
    /// Colour images are always taken; older command lines ask for it.
    #[arg(long = "colour", hide = true)]
    _colour: bool,
    /// Treat the images as mirror images.
    ///
    /// Images are also solved if they turn out to be mirrored; the answer says so.
    #[arg(long)]
    mirrored: bool,
    /// How many times as high as wide a pixel is, such as 1.93 for a field of interlaced video.
    ///
    /// Without it and `--setup`, pixels that are not square are tried before an image is refused.
    #[arg(long, value_name = "RATIO", conflicts_with = "setup")]
    pixel_aspect: Option<f64>,
    /// Dark frame of the same exposure, subtracted from each image.
    #[arg(long, value_name = "FILE")]
    dark: Option<PathBuf>,
    /// Flat field by which each image is divided, of any brightness.
    #[arg(long, value_name = "FILE")]
    flat: Option<PathBuf>,
    /// Picture of the image's size: pixels that are 0 are ignored.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// Draw the image with stars, planets, names and coordinates.
    ///
    /// For one image only, as are `--wcs` and `--csv`.
    #[arg(long, value_name = "FILE.png")]
    annotate: Option<PathBuf>,
    /// Write the world coordinates as a FITS header (TAN-SIP).
    #[arg(long, value_name = "FILE.fits")]
    wcs: Option<PathBuf>,
    /// Write the matched stars as a table.
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// List the matched stars in the JSON document.
    #[arg(long, requires = "json")]
    stars: bool,
    /// Exit with code 1 if an image is refused.
    #[arg(long)]
    all: bool,
    /// Exit with code 1 if a solution's residuals exceed this, arcsec rms.
    #[arg(long)]
    rms_arcsec: Option<f64>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum SampleCoding {
    /// In proportion to light.
    Linear,
    /// By the sRGB curve.
    Srgb,
}

impl SampleCoding {
    pub(super) fn coding(self) -> Coding {
        match self {
            Self::Linear => Coding::Linear,
            Self::Srgb => Coding::Srgb,
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let optics = arguments.optics()?;
    arguments.check_products()?;
    let ephemeris = Ephemeris::read(&arguments.ephemeris)?;
    let (tdb_s, context) = arguments.context(&ephemeris)?;
    let options = ImageSolverOptions {
        focal_slack: arguments.focal_percent / 100.0,
        log10_bound: arguments.log10_bound,
        most_hypotheses: arguments.most_hypotheses,
        threshold_sigma: arguments.threshold_sigma,
        mirrored: arguments.mirrored,
        pixel_aspect: arguments.pixel_aspect,
        tdb_s,
    };
    let mut solver = ImageSolver::new(optics, options);
    let (mut documents, mut refused, mut worst_arcsec) = (Vec::new(), 0, 0.0f64);
    let mut unreadable: Vec<Failure> = Vec::new();
    let bar = counter(arguments.images.len() as u64, "images");
    for path in bar.wrap_iter(arguments.images.iter()) {
        let file = path.display().to_string();
        let (photograph, context) = match arguments.read(path, solver.known(), &context) {
            Ok(read) => read,
            // What other images say is not lost for it.
            Err(error) => {
                documents.push(json!({
                    "file": file, "solved": false, "reason": "unreadable", "message": error.to_string(),
                    "ra_deg": null, "dec_deg": null, "roll_deg": null, "matches": 0, "rms_arcsec": null, "planets": [],
                }));
                unreadable.push(error);
                continue;
            }
        };
        let mut notes = photograph.notes();
        let result = solver
            .solve(&photograph.image, &photograph.exif, &context, &mut notes)
            .map_err(|error| Failure::new(error.to_string()))?;
        match &result.solution {
            Err(_) => refused += 1,
            Ok(solution) => worst_arcsec = worst_arcsec.max(solution.rms_rad.to_degrees() * 3600.0),
        }
        arguments.write_products(&file, &photograph.image, &result)?;
        if arguments.json {
            let mut document = result.json(&file, arguments.stars);
            document["notes"] = json!(notes);
            documents.push(document);
        } else {
            let mut lines = text(&file, &result);
            lines.extend(notes.iter().map(|note| format!("  note: {note}")));
            bar.suspend(|| print_lines(&lines))?;
        }
    }
    bar.finish_and_clear();
    if arguments.json {
        print_json(&json!({
            "schema": "retina.navigation-stars/1",
            "images": documents,
            "aberration_corrected": arguments.velocity(&ephemeris)?.is_some(),
            "ephemeris": context.observer.map(|observer| observer.ephemeris().name()),
            "epoch": arguments.time.clone().map_or(json!("J2020.0 (assumed)"), Value::from),
        }))?;
    }
    // Each says its own reason; the last one ends the command.
    if let Some(last) = unreadable.pop() {
        unreadable.iter().for_each(Failure::show);
        return Err(last);
    }
    if arguments.all && refused > 0 {
        return Err(Failure::exceeded(format!(
            "{refused} of {} images were refused",
            arguments.images.len()
        )));
    }
    match arguments.rms_arcsec {
        Some(limit) if worst_arcsec > limit => Err(Failure::exceeded(format!(
            "the residuals of a solution are {worst_arcsec:.2} arcsec rms, at most {limit} were asked for"
        ))),
        _ => Ok(()),
    }
}

impl Arguments {
    fn optics(&self) -> Result<KnownCamera, Failure> {
        if let Some(text) = &self.fov_deg {
            return Ok(KnownCamera::Field(field_rad(text)?));
        }
        let Some(path) = &self.setup else {
            return Ok(KnownCamera::Exif);
        };
        let setup = read_setup(path)?;
        let calibration =
            self.calibration.as_ref().map(|path| Calibration::read(path, &setup)).transpose()?;
        Ok(KnownCamera::Setup(Box::new(setup), calibration.map(Box::new)))
    }

    /// A picture, and what is known of its pixels.
    fn read(
        &self,
        path: &Path,
        optics: &KnownCamera,
        context: &ImageContext,
    ) -> Result<(Photograph, ImageContext), Failure> {
        let setup_bits = match optics {
            KnownCamera::Setup(setup, _) => Some(setup.camera.bits),
            KnownCamera::Field(_) | KnownCamera::Exif => None,
        };
        let options = PhotographOptions {
            bits: self.bits.or(setup_bits),
            coding: self.coding.map_or(Coding::ByKind, SampleCoding::coding),
            // A setup counts pixels as the sensor does, however a viewer turns them.
            upright: !matches!(optics, KnownCamera::Setup(..)),
        };
        let mut photograph = Photograph::read(path, options)?;
        let size = [photograph.image.width_px, photograph.image.height_px];
        let frame = |path: &Option<PathBuf>| {
            let read =
                |path: &PathBuf| Ok::<_, InputError>((path.clone(), Photograph::read(path, options)?.image));
            path.as_ref().map(read).transpose()
        };
        let (dark, flat) = (frame(&self.dark)?, frame(&self.flat)?);
        photograph.image = photograph.image.reduced(
            dark.as_ref().map(|(path, image)| (path.as_path(), image)),
            flat.as_ref().map(|(path, image)| (path.as_path(), image)),
        )?;
        let mask = self.mask.as_ref().map(|path| read_mask(path, size)).transpose()?;
        let square = self.pixel_aspect.is_some() || matches!(optics, KnownCamera::Setup(..));
        let context = ImageContext {
            mask,
            find_pixel_aspect: !square,
            field_given: self.fov_deg.is_some(),
            aspect_given: self.pixel_aspect.is_some(),
            ..context.clone()
        };
        let image = &photograph.image;
        if let KnownCamera::Setup(setup, _) = optics {
            let (found, expected) =
                ([image.width_px, image.height_px], [setup.camera.width_px, setup.camera.height_px]);
            if found != expected {
                return Err(InputError::new(path, "the image does not have the size of the setup's camera")
                    .found(format!("{} x {} pixels", found[0], found[1]))
                    .expected(format!("{} x {}", expected[0], expected[1]))
                    .help("give the setup of this camera, or --fov-deg instead")
                    .into());
            }
        }
        Ok((photograph, context))
    }

    /// Refuses files of one image for several.
    fn check_products(&self) -> Result<(), Failure> {
        let products = [
            ("--annotate", &self.annotate, "png"),
            ("--wcs", &self.wcs, "fits"),
            ("--csv", &self.csv, "csv"),
        ];
        for (flag, path, extension) in products {
            path.as_ref().map_or(Ok(()), |path| crate::check_file(path, extension))?;
            if path.is_some() && self.images.len() > 1 {
                return Err(InputError::new(Path::new(flag), "is for one image")
                    .found(format!("{} images", self.images.len()))
                    .expected("one")
                    .help("run the command for each image, with a file of its own")
                    .into());
            }
        }
        let inputs = [&self.setup, &self.calibration, &self.dark, &self.flat, &self.mask];
        let inputs = self.images.iter().chain(&self.ephemeris).chain(inputs.into_iter().flatten());
        crate::check_apart(inputs, products.iter().map(|(_, path, _)| path.as_ref()), None)
    }

    /// Writes what was asked for of an image. Of one that is not solved there is a picture of what was found, and no
    /// coordinates.
    fn write_products(&self, file: &str, image: &CameraImage, result: &ImageResult) -> Result<(), Failure> {
        let store = |path: &Path, bytes: &[u8]| {
            write_atomic(path, bytes)
                .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
        };
        if let Some(path) = &self.annotate {
            let title =
                Path::new(file).file_name().map_or_else(|| file.into(), |name| name.to_string_lossy());
            let svg = annotated(result, image, &title).to_svg();
            let bytes = png(&svg, 1.0).map_err(|error| Failure::new(error.to_string()))?;
            store(path, &bytes)?;
        }
        if let (Some(path), Ok(_)) = (&self.csv, &result.solution) {
            store(path, matches_csv(result).as_bytes())?;
        }
        if let (Some(path), Some(bytes)) = (&self.wcs, wcs_header(result)) {
            store(path, &bytes)?;
        }
        Ok(())
    }

    /// The epoch, and what goes with a position.
    fn context(&self, ephemeris: &Ephemeris) -> Result<(Option<f64>, ImageContext), Failure> {
        let (rms_arcsec, aspect) = (self.rms_arcsec.unwrap_or(1.0), self.pixel_aspect.unwrap_or(1.0));
        for (flag, value, fits, expected) in [
            ("--focal-percent", self.focal_percent, (0.0..=20.0).contains(&self.focal_percent), "0 to 20"),
            ("--position-3-sigma-km", self.position_3_sigma_km, self.position_3_sigma_km > 0.0, "above 0"),
            ("--threshold-sigma", self.threshold_sigma, self.threshold_sigma > 0.0, "above 0"),
            ("--log10-bound", self.log10_bound, self.log10_bound <= 0.0, "0 or less"),
            ("--most-hypotheses", self.most_hypotheses as f64, self.most_hypotheses > 0, "1 or more"),
            ("--rms-arcsec", rms_arcsec, rms_arcsec > 0.0, "above 0"),
            ("--pixel-aspect", aspect, (0.2..=5.0).contains(&aspect), "0.2 to 5"),
        ] {
            if !(fits && value.is_finite()) {
                return Err(InputError::new(Path::new(flag), "the value is out of range")
                    .found(value)
                    .expected(expected)
                    .into());
            }
        }
        let Some(time) = &self.time else { return Ok((None, ImageContext::default())) };
        let tdb_s = parse_epoch(time).map_err(|error| Failure::new(format!("--time: {error}")))?;
        // Proper motions are linear, and so are the ephemerides' centuries.
        if tdb_s.abs() > 100.0 * 365.25 * 86_400.0 {
            return Err(InputError::new(Path::new("--time"), "is out of range")
                .found(time)
                .expected("the years 1900 to 2100")
                .into());
        }
        // Without a position there is no parallax, no deflection and no aberration, only proper motion.
        let position = match self.position_m.as_deref() {
            None => return Ok((Some(tdb_s), ImageContext::default())),
            Some("earth") => earth(ephemeris, tdb_s)?.position_m,
            Some(text) => vector("--position-m", text)?,
        };
        let observer = Observer::new(ephemeris, tdb_s, position, self.velocity(ephemeris)?)
            .map_err(|error| Failure::new(error.to_string()))?;
        Ok((Some(tdb_s), ImageContext::at(observer, 1e3 * self.position_3_sigma_km / 3.0)))
    }

    fn velocity(&self, ephemeris: &Ephemeris) -> Result<Option<DVec3>, Failure> {
        match (self.velocity_m_s.as_deref(), self.position_m.as_deref(), &self.time) {
            (Some(text), ..) => vector("--velocity-m-s", text).map(Some),
            (None, Some("earth"), Some(time)) => {
                let tdb_s = parse_epoch(time).map_err(|error| Failure::new(format!("--time: {error}")))?;
                Ok(Some(earth(ephemeris, tdb_s)?.velocity_m_s))
            }
            _ => Ok(None),
        }
    }
}

fn earth(ephemeris: &Ephemeris, tdb_s: f64) -> Result<State, Failure> {
    Ok(ephemeris.solar_system(tdb_s).map_err(|error| Failure::new(error.to_string()))?.earth)
}

/// `11.4` or `10..13`, degrees.
fn field_rad(text: &str) -> Result<[f64; 2], Failure> {
    let (least, greatest) = text.split_once("..").unwrap_or((text, text));
    let parsed = [least, greatest].map(|part| part.trim().parse::<f64>().unwrap_or(f64::NAN));
    if !(parsed[0] > 0.0 && parsed[0] <= parsed[1] && parsed[1] < 90.0) {
        return Err(InputError::new(Path::new("--fov-deg"), "is not a field of view")
            .found(format!("`{text}`"))
            .expected("degrees above 0 and below 90, or a range such as 10..13")
            .into());
    }
    Ok(parsed.map(f64::to_radians))
}

/// Three finite numbers.
pub(super) fn vector(flag: &str, text: &str) -> Result<DVec3, Failure> {
    let numbers: Vec<f64> = text.split(',').map(|part| part.trim().parse().unwrap_or(f64::NAN)).collect();
    match numbers[..] {
        [x, y, z] if [x, y, z].iter().all(|v| v.is_finite()) => Ok(DVec3::new(x, y, z)),
        _ => Err(InputError::new(Path::new(flag), "is not a vector")
            .found(format!("`{text}`"))
            .expected("three numbers, X,Y,Z")
            .into()),
    }
}
