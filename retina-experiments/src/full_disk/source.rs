//! Where a sequence's images come from, and how each is looked at.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use retina_batch::{Selection, read_exr};
use retina_files::{InputError, hash_bytes, hash_file, read_text};
use retina_formats::{Calibration, MeasuredResponse, measured_or_power_law};
use retina_geometry::Setup;
use retina_image::{CameraImage, ReadOptions, Steps};
use retina_radiometry::ScreenResponse;
use serde::{Deserialize, Serialize};

use super::truth::FrameTruth;
use retina_navigation::limb::{BodyShape, LimbBody, LimbCamera, LimbOptions, Mapping};

/// What an image is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImageKind {
    /// What the screen shows: digital counts, or the radiance beside them.
    Screen,
    /// What the camera saw of it.
    Camera,
}

/// What is asked for.
#[derive(Debug, Clone)]
pub struct SourceChoice {
    /// The folder that `retina render` wrote.
    pub dir: PathBuf,
    /// The folder of camera images, as `retina simulate frames` wrote it.
    pub images: Option<PathBuf>,
    /// What the images are; by default the camera's where a folder of them is given.
    pub kind: Option<ImageKind>,
    /// The facility.
    pub setup: Option<PathBuf>,
    /// The facility's calibration.
    pub calibration: Option<PathBuf>,
    /// The body; by default the only one.
    pub body: Option<String>,
    /// Which frames.
    pub selection: Selection,
    /// What is known of the limb.
    pub limb: LimbOptions,
    /// Mesh of the body, whose silhouette is fitted; without, the reference ellipsoid's outline is.
    pub silhouette: Option<PathBuf>,
    /// Standard deviation per axis of the known attitude in an image, rad.
    pub pointing_sigma_rad: f64,
}

/// A sequence, checked: every image has its truth and the size that it must have.
pub struct Source {
    /// What is asked for.
    pub choice: SourceChoice,
    /// What the images are.
    pub kind: ImageKind,
    /// Their camera.
    pub camera: LimbCamera,
    /// The frames' numbers, rising.
    pub frames: Vec<usize>,
    /// Hash of all that decides a frame's result, but the frame's own files.
    pub hash: String,
    /// What the user should know.
    pub notes: Vec<String>,
    /// Linear light of each digital count over that of the largest; of screen images.
    light: Vec<f32>,
    /// Light of the largest count, where the facility is known; of screen images, W m^-2 nm^-1 at the pupil.
    pub(crate) full_w_m2_nm: Option<f64>,
    pub(crate) setup: Option<Setup>,
    /// Of the photographs, where their list says it.
    pub(crate) exposure_s: Option<f64>,
    shape: Option<Arc<BodyShape>>,
}

/// A line of `manifest.jsonl`, as far as it is needed.
#[derive(Deserialize)]
struct ManifestLine {
    index: usize,
    inputs: BTreeMap<String, String>,
    outputs: BTreeMap<String, String>,
}

/// Digital numbers that linearised light is given in: its rounding is far below any noise.
pub(crate) const LINEAR_FULL_SCALE_DN: f32 = 65_535.0;

fn number(path: &Path) -> Option<usize> {
    path.file_stem()?.to_str()?.parse().ok()
}

/// Numbers of the files of a folder with an extension; empty where there is no such folder.
fn numbers(folder: &Path, extensions: &[&str]) -> Result<BTreeSet<usize>, InputError> {
    if !folder.is_dir() {
        return Ok(BTreeSet::new());
    }
    let entries = std::fs::read_dir(folder)
        .map_err(|error| InputError::new(folder, format!("cannot be read: {error}")))?;
    Ok(entries
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| path.extension().and_then(|e| e.to_str()).is_some_and(|e| extensions.contains(&e)))
        .filter_map(|path| number(&path))
        .collect())
}

impl Source {
    /// Looks at the folders and refuses what does not fit together.
    ///
    /// # Errors
    /// No truth, images without truth or of another folder's screen, a calibration that the screen was not rendered
    /// with, sizes that do not fit.
    pub fn open(choice: SourceChoice) -> Result<Self, InputError> {
        let kind = choice.kind.unwrap_or(match choice.images {
            Some(_) => ImageKind::Camera,
            None => ImageKind::Screen,
        });
        let truths = numbers(&choice.dir.join("truth"), &["json"])?;
        let Some(&first) = truths.iter().next() else {
            return Err(InputError::new(choice.dir.join("truth"), "there is no truth to compare with")
                .expected("truth/NNNNNN.json, as `retina render` writes it")
                .help("give the folder that `retina render --out` was given"));
        };
        let mut notes = Vec::new();
        let folder = images_folder(&choice, kind)?;
        let images = numbers(&folder, if kind == ImageKind::Screen { &["png", "exr"] } else { &["png"] })?;
        if let Some(missing) = images.difference(&truths).next() {
            return Err(InputError::new(&folder, "an image has no truth")
                .found(format!(
                    "image {missing:06} and no truth/{missing:06}.json in {}",
                    choice.dir.display()
                ))
                .expected("the images and the truth of one sequence"));
        }
        let last = truths.iter().next_back().map_or(0, |last| last + 1);
        let wanted: BTreeSet<usize> = choice.selection.frames(last)?.into_iter().collect();
        let frames: Vec<usize> = truths.intersection(&wanted).copied().collect();
        if frames.is_empty() {
            return Err(InputError::new(&choice.dir, "holds none of the frames that are asked for")
                .found(format!("frames {first} to {}", last - 1)));
        }
        if let Some(missing) = frames.iter().find(|frame| !images.contains(frame)) {
            return Err(InputError::new(&folder, "an image is missing")
                .found(format!("{} images, none of frame {missing:06}", images.len()))
                .expected(format!("an image of each of the {} frames", frames.len()))
                .help("finish the images, or choose frames by --frames"));
        }
        let truth = FrameTruth::read(&truth_path(&choice.dir, frames[0]), choice.body.as_deref())?;
        check_manifest(&choice, &frames, truth.compensated, kind, &mut notes)?;
        let exposure_s = match kind {
            ImageKind::Camera => check_screens(&choice, &folder, &mut notes)?,
            ImageKind::Screen => None,
        };
        let setup = choice.setup.as_ref().map(|path| Setup::named(path, Path::new(""))).transpose()?;
        let (camera, calibration) = camera(&choice, kind, &truth, setup.as_ref(), &mut notes)?;
        let (light, full_w_m2_nm) = match kind {
            ImageKind::Screen => linear_light(&choice, setup.as_ref(), calibration.as_deref(), &mut notes)?,
            ImageKind::Camera => (Vec::new(), None),
        };
        let mut text =
            format!("{kind:?} {:?} {} {:?} {camera:?}", choice.limb, choice.pointing_sigma_rad, choice.body);
        if let (Some(setup), Some(name)) = (&setup, &choice.setup) {
            text.push_str(&setup.hash_of_named(name, Path::new(""))?);
        }
        if let Some(path) = &calibration {
            text.push_str(&read_text(path)?);
        }
        let shape = match &choice.silhouette {
            None => None,
            Some(path) => {
                text.push_str(&hash_file(path)?);
                Some(Arc::new(BodyShape::read(path)?))
            }
        };
        let hash = hash_bytes(text.as_bytes());
        Ok(Self { kind, camera, frames, hash, notes, light, full_w_m2_nm, setup, exposure_s, shape, choice })
    }

    /// The body of a frame as the limb's fit takes it.
    pub fn limb_body(&self, truth: &FrameTruth) -> LimbBody {
        LimbBody { shape: self.shape.clone(), ..truth.limb_body() }
    }

    /// A frame's truth.
    ///
    /// # Errors
    /// It does not fit, or is another frame's.
    pub fn truth(&self, frame: usize) -> Result<FrameTruth, InputError> {
        let path = truth_path(&self.choice.dir, frame);
        let truth = FrameTruth::read(&path, self.choice.body.as_deref())?;
        if truth.frame != frame {
            return Err(InputError::new(&path, "is the truth of another frame")
                .at("key `frame`")
                .found(truth.frame)
                .expected(frame));
        }
        Ok(truth)
    }

    /// Hash of a frame's image and truth.
    ///
    /// # Errors
    /// One of them cannot be read.
    pub fn frame_hash(&self, frame: usize) -> Result<String, InputError> {
        let image = hash_file(&self.image_path(frame)?)?;
        let truth = hash_file(&truth_path(&self.choice.dir, frame))?;
        Ok(hash_bytes(format!("{image} {truth}").as_bytes()))
    }

    pub(crate) fn image_path(&self, frame: usize) -> Result<PathBuf, InputError> {
        let folder = images_folder(&self.choice, self.kind)?;
        let exr = folder.join(format!("{frame:06}.exr"));
        let png = folder.join(format!("{frame:06}.png"));
        Ok(if self.kind == ImageKind::Screen && !png.is_file() { exr } else { png })
    }

    /// A frame's image, linear in light.
    ///
    /// # Errors
    /// It cannot be read, or has not the size that its camera gives.
    pub fn image(&self, frame: usize) -> Result<CameraImage, InputError> {
        let path = self.image_path(frame)?;
        let image = match self.kind {
            ImageKind::Camera => {
                let bits = self.setup.as_ref().map(|setup| setup.camera.bits);
                CameraImage::read(&path, ReadOptions { bits, colour_to_grey: false })?
            }
            ImageKind::Screen if path.extension().is_some_and(|e| e == "exr") => radiance(&path)?,
            ImageKind::Screen => {
                let read = CameraImage::read(&path, ReadOptions { bits: Some(8), colour_to_grey: true });
                let mut image = read.map_err(|error| {
                    error.help("a screen image has 8 bits: --kind camera and --setup are for photographs")
                })?;
                for value in &mut image.values {
                    *value = LINEAR_FULL_SCALE_DN * self.light[*value as usize];
                }
                image.full_scale_dn = LINEAR_FULL_SCALE_DN;
                image
            }
        };
        let expected = &self.camera.pinhole;
        if [image.width_px, image.height_px] != [expected.width_px, expected.height_px] {
            return Err(InputError::new(&path, "the image has another size than its camera")
                .found(format!("{} x {} pixels", image.width_px, image.height_px))
                .expected(format!("{} x {}", expected.width_px, expected.height_px))
                .help("check --setup and --kind"));
        }
        Ok(image)
    }
}

pub(crate) fn truth_path(dir: &Path, frame: usize) -> PathBuf {
    dir.join(format!("truth/{frame:06}.json"))
}

fn images_folder(choice: &SourceChoice, kind: ImageKind) -> Result<PathBuf, InputError> {
    match (&choice.images, kind) {
        (None, ImageKind::Screen) => Ok(choice.dir.join("frames")),
        (None, ImageKind::Camera) => {
            Err(InputError::new(&choice.dir, "camera images are asked for and none are named")
                .help("give their folder by --images; `retina simulate frames` makes it"))
        }
        (Some(folder), _) => {
            let below = ["images", "frames"].map(|name| folder.join(name));
            Ok(below.into_iter().find(|path| path.is_dir()).unwrap_or_else(|| folder.clone()))
        }
    }
}

/// The manifest knows the files' hashes: truth and images that were put there from elsewhere, and another calibration,
/// show.
fn check_manifest(
    choice: &SourceChoice,
    frames: &[usize],
    compensated: bool,
    kind: ImageKind,
    notes: &mut Vec<String>,
) -> Result<(), InputError> {
    let path = choice.dir.join("manifest.jsonl");
    if !path.is_file() {
        notes.push(format!(
            "{}: there is no manifest.jsonl: whether images and truth are of one rendering is not known",
            choice.dir.display()
        ));
        return Ok(());
    }
    let text = read_text(&path)?;
    let lines: BTreeMap<usize, ManifestLine> = text
        .lines()
        .filter_map(|line| serde_json::from_str::<ManifestLine>(line).ok())
        .map(|line| (line.index, line))
        .collect();
    // Of camera images, and of a folder that was named, the manifest says nothing.
    let own_images = kind == ImageKind::Screen && choice.images.is_none();
    for &frame in frames {
        let Some(line) = lines.get(&frame) else { continue };
        let image = own_images.then(|| format!("frames/{frame:06}.png"));
        for name in [Some(format!("truth/{frame:06}.json")), image].into_iter().flatten() {
            let Some(expected) = line.outputs.get(&name) else { continue };
            let file = choice.dir.join(&name);
            let found = hash_file(&file)?;
            if found != *expected {
                let what = if name.starts_with("truth") { "truth" } else { "image" };
                return Err(InputError::new(
                    &file,
                    format!("is not the {what} that was rendered into this folder"),
                )
                .found(format!("hash {}", &found[..12.min(found.len())]))
                .expected(format!("{} (manifest.jsonl)", &expected[..12.min(expected.len())]))
                .help("render the frame again, or give the folder that the file comes from"));
            }
        }
    }
    let used = lines.values().next().and_then(|line| line.inputs.get("calibration"));
    if let (true, ImageKind::Screen, Some(own), Some(used)) = (compensated, kind, &choice.calibration, used) {
        let found = hash_file(own)?;
        if found != *used {
            return Err(InputError::new(
                own,
                "is not the calibration that the screen images were rendered with",
            )
            .found(format!("hash {}", &found[..12.min(found.len())]))
            .expected(format!("{} (manifest.jsonl)", &used[..12.min(used.len())])));
        }
    }
    Ok(())
}

/// `frames.csv` beside camera images says of which screens they are, and of which exposure.
fn check_screens(
    choice: &SourceChoice,
    folder: &Path,
    notes: &mut Vec<String>,
) -> Result<Option<f64>, InputError> {
    let Some(list) = folder.parent().map(|above| above.join("frames.csv")).filter(|list| list.is_file())
    else {
        notes.push(format!(
            "{}: no frames.csv says which screen images these are photographs of",
            folder.display()
        ));
        return Ok(None);
    };
    let text = read_text(&list)?;
    let mut lines = text.lines();
    let exposure = lines.next().and_then(|head| head.split(',').position(|name| name == "exposure_s"));
    let Some(row) = lines.next().map(|line| line.split(',').collect::<Vec<_>>()) else { return Ok(None) };
    let exposure_s = exposure.and_then(|at| row.get(at)?.parse().ok());
    let Ok(shown) = Path::new(row[0]).canonicalize() else {
        notes.push(format!("{}: the screen images that it names are gone", list.display()));
        return Ok(exposure_s);
    };
    let own = choice.dir.join("frames");
    let own = own.canonicalize().unwrap_or(own);
    if shown.parent() != Some(own.as_path()) {
        return Err(InputError::new(&list, "the images are photographs of another folder's screens")
            .found(shown.parent().unwrap_or(&shown).display())
            .expected(own.display())
            .help("give the folder of truth that belongs to them"));
    }
    Ok(exposure_s)
}

/// The camera, and the calibration that was used.
fn camera(
    choice: &SourceChoice,
    kind: ImageKind,
    truth: &FrameTruth,
    setup: Option<&Setup>,
    notes: &mut Vec<String>,
) -> Result<(LimbCamera, Option<PathBuf>), InputError> {
    let need_setup = |why: &str| {
        InputError::new(Path::new("--setup"), format!("is not given: {why}"))
            .expected("the setup that the frames were rendered with")
    };
    let read = |path: &PathBuf| -> Result<Box<Calibration>, InputError> {
        let setup = setup.ok_or_else(|| need_setup("a calibration belongs to a setup"))?;
        Ok(Box::new(Calibration::read(path, setup)?))
    };
    match kind {
        ImageKind::Screen => {
            if let Some(setup) = setup {
                let own = setup.facility_pinhole();
                if (own.fx_px / truth.image.fx_px - 1.0).abs() > 1e-9
                    || [own.width_px, own.height_px] != [truth.image.width_px, truth.image.height_px]
                {
                    return Err(InputError::new(
                        &setup.file,
                        "is not the setup that the frames were rendered with",
                    )
                    .found(format!("{} x {} pixels, f_x {}", own.width_px, own.height_px, own.fx_px))
                    .expected(format!(
                        "{} x {} pixels, f_x {} (truth)",
                        truth.image.width_px, truth.image.height_px, truth.image.fx_px
                    )));
                }
            }
            if !truth.compensated {
                return Ok((LimbCamera::pinhole(truth.image), None));
            }
            let path = choice
                .calibration
                .clone()
                .or_else(|| setup.and_then(Setup::calibration_path))
                .ok_or_else(|| need_setup("compensated screen images are read through a calibration"))?;
            let mapping = Mapping::Screen(read(&path)?);
            Ok((LimbCamera { pinhole: truth.image, mapping }, Some(path)))
        }
        ImageKind::Camera => {
            let setup = setup.ok_or_else(|| need_setup("camera images have the camera's focal length"))?;
            let pinhole = setup.camera_pinhole();
            match (&choice.calibration, truth.compensated) {
                (None, _) => {
                    if !truth.compensated {
                        notes.push(
                            "no calibration is given: the images hold the facility's distortion".to_owned(),
                        );
                    }
                    Ok((LimbCamera::pinhole(pinhole), None))
                }
                (Some(path), false) => {
                    let mapping = Mapping::Downstream(read(path)?);
                    Ok((LimbCamera { pinhole, mapping }, Some(path.clone())))
                }
                (Some(path), true) => Err(InputError::new(
                    path,
                    "the screen was compensated: its photographs hold no distortion",
                )
                .found("--calibration")
                .expected("none for camera images of compensated screens")),
            }
        }
    }
}

/// Linear light of each digital count, and that of the largest where it is known: the response measured with the calibration, or the setup's power law.
fn linear_light(
    choice: &SourceChoice,
    setup: Option<&Setup>,
    calibration: Option<&Path>,
    notes: &mut Vec<String>,
) -> Result<(Vec<f32>, Option<f64>), InputError> {
    let named = calibration.or(choice.calibration.as_deref());
    let measured = match (setup, named) {
        (Some(setup), Some(path)) => MeasuredResponse::read(path, setup)?.map(|measured| measured.curve),
        _ => None,
    };
    if let (None, Some(path)) = (&measured, named) {
        notes.push(format!(
            "{}: has no response of the screen beside it: the setup's power law is taken for its light",
            path.display()
        ));
    }
    let response = measured.unwrap_or_else(|| match setup {
        Some(setup) => measured_or_power_law(None, setup),
        None => {
            notes.push("no setup is given: the screen's response is taken for (B / 255)^2.2".to_owned());
            ScreenResponse::power_law(2.2, 0.0)
        }
    });
    let full = response.brightest_w_m2_nm();
    let light = (0..=255u8).map(|count| (response.irradiance_w_m2_nm([count; 3]) / full) as f32).collect();
    Ok((light, setup.map(|_| full)))
}

/// The channel `Y` of a linear EXR, scaled to digital numbers.
fn radiance(path: &Path) -> Result<CameraImage, InputError> {
    let (channels, _) = read_exr(path)?;
    let Some((_, values)) = channels.channels.iter().find(|(name, _)| name == "Y") else {
        return Err(InputError::new(path, "has no radiance").expected("a channel `Y`"));
    };
    let most = values.iter().copied().fold(0.0, f32::max);
    if let Some(at) = values.iter().position(|value| !value.is_finite()) {
        return Err(InputError::new(path, "a pixel is not finite").found(values[at]));
    }
    // The brightest pixel stays below full scale: light has none.
    let scale = if most > 0.0 { 0.9 * LINEAR_FULL_SCALE_DN / most } else { 0.0 };
    Ok(CameraImage {
        width_px: channels.width_px as u32,
        height_px: channels.height_px as u32,
        values: values.iter().map(|value| value * scale).collect(),
        full_scale_dn: LINEAR_FULL_SCALE_DN,
        steps: Steps::Fine,
    })
}
