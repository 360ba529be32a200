//! A sequence of frames: flashes found on each, and which of them were there.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use retina_files::{InputError, hash_bytes, read_text};
use retina_image::Steps;
use retina_radiometry::magnitude_of_irradiance;
use serde::{Deserialize, Serialize};

use crate::frame_lines::{FrameLine, measure_frames};
use crate::full_disk::source::{LINEAR_FULL_SCALE_DN, truth_path};
use crate::full_disk::{FrameTruth, ImageKind, Source};
use crate::lines::Line;
use retina_navigation::flashes::BodyPose;
use retina_navigation::flashes::{
    Candidate, FlashOptions, Light, NightSide, Spot, ZeroPoint, detect_flashes,
};
use retina_navigation::limb::Mapping;

/// Schema of the lists of frames and of the document.
pub(super) const SCHEMA: &str = "retina.navigation-flashes/1";

/// A candidate this near to where a flash is is that flash, px.
const SAME_PX: f64 = 3.0;
/// Or so many standard deviations of its spot: that of a faint one's place is a quarter of the spot's and more.
const SAME_SPOTS: f64 = 2.0;

/// What is known of a camera's light; of screen images the setup says it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraLight {
    /// Magnitude of one DN of a point's light in these images.
    pub zero_point: Option<ZeroPoint>,
    /// Standard deviation of a point's spot, px.
    pub spot_sigma_px: f64,
}

/// A flash that was there, and whether it was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlashOutcome {
    /// Its name in the truth.
    pub id: String,
    /// V, mean over the exposure.
    pub magnitude: f64,
    /// Where it is in the image; `None` off the field.
    pub px: Option<[f64; 2]>,
    /// Planetocentric, deg.
    pub latitude_deg: f64,
    /// East, deg.
    pub longitude_deg: f64,
    /// A body is before it.
    pub hidden: bool,
    /// It is where flashes are looked for.
    pub watched: bool,
    /// Which of the frame's candidates it is.
    pub candidate: Option<usize>,
    /// Of that candidate from here, px.
    pub error_px: Option<[f64; 2]>,
    /// The same on the surface, great circle, m.
    pub error_m: Option<f64>,
    /// Measured less true magnitude.
    pub error_magnitude: Option<f64>,
}

/// What one frame gave: a line of the list.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlashFrame {
    /// Its number.
    pub frame: usize,
    /// TDB seconds since J2000.
    pub time_s: f64,
    /// Sun, body, camera, deg.
    pub phase_deg: f64,
    /// To the body's centre, m.
    pub distance_m: f64,
    /// Pixels of the night side that are looked at.
    pub watched_px: usize,
    /// The threshold.
    pub threshold_sigma: f64,
    /// Typical level, DN.
    pub background_dn: f64,
    /// Typical noise of a pixel, DN.
    pub noise_dn: f64,
    /// What was found, the brightest first.
    pub candidates: Vec<Candidate>,
    /// Candidates that are no flash of the truth.
    pub false_candidates: Vec<usize>,
    /// What was there.
    pub flashes: Vec<FlashOutcome>,
    /// Hash of its image and truth.
    pub inputs: String,
}

impl Line for FlashFrame {
    const SCHEMA: &str = SCHEMA;
    const OF: &str = "sequence";
    const WHAT: &str = "frames";

    fn number(&self) -> usize {
        self.frame
    }
}

impl FrameLine for FlashFrame {
    fn inputs(&self) -> &str {
        &self.inputs
    }
}

/// The truth's flashes.
#[derive(Deserialize)]
struct TruthFile {
    radiance_scale: f64,
    exposure_s: Option<f64>,
    flashes: Option<Vec<TruthFlash>>,
}

#[derive(Deserialize)]
struct TruthFlash {
    id: String,
    body: String,
    latitude_deg: f64,
    longitude_deg: f64,
    line_of_sight: Option<[f64; 2]>,
    mean_magnitude: f64,
    hidden: bool,
}

impl TruthFile {
    fn read(path: &Path) -> Result<Self, InputError> {
        serde_json::from_str(&read_text(path)?)
            .map_err(|error| InputError::new(path, format!("its flashes cannot be read: {error}")))
    }
}

/// The place of a frame's body as the detector takes it.
fn pose_of(truth: &FrameTruth) -> BodyPose {
    BodyPose {
        position_camera_m: truth.position_camera_m,
        camera_from_body: DMat3::from_quat(truth.camera_from_body),
        semi_axes_m: truth.semi_axes_m,
        sun_direction_camera: truth.sun_direction_camera,
    }
}

/// What is known of the images' light: of screens by the setup's response and the scale at which true light is shown.
fn light_of(source: &Source, camera: &CameraLight, radiance_scale: f64) -> Light {
    // What is shown is the true light times the scale.
    let scaled = 2.5 * radiance_scale.log10();
    match source.kind {
        ImageKind::Screen => Light {
            zero_point: source.full_w_m2_nm.map(|full| {
                ZeroPoint::constant(magnitude_of_irradiance(full / f64::from(LINEAR_FULL_SCALE_DN)) + scaled)
            }),
            gain_e_per_dn: None,
            spot: Spot::Pixels,
        },
        ImageKind::Camera => Light {
            zero_point: camera
                .zero_point
                .map(|zero| ZeroPoint { magnitude: zero.magnitude + scaled, ..zero }),
            gain_e_per_dn: source.setup.as_ref().map(|setup| {
                let (noise, largest) = (&setup.noise, 2f64.powi(setup.camera.bits as i32) - 1.0);
                noise.gain_e_per_dn.unwrap_or(noise.full_well_e / (largest - noise.offset_dn).max(1.0))
            }),
            spot: Spot::Gaussian(camera.spot_sigma_px),
        },
    }
}

/// What the user should know of a source before flashes are looked for on it: photographs of another exposure than the
/// scene's hold another light of each flash, and those that hold the facility's distortion have it elsewhere.
///
/// # Errors
/// The first frame's truth cannot be read.
pub fn flash_notes(source: &Source) -> Result<Vec<String>, InputError> {
    let mut notes = source.notes.clone();
    if source.kind != ImageKind::Camera {
        return Ok(notes);
    }
    let truth = TruthFile::read(&truth_path(&source.choice.dir, source.frames[0]))?;
    if let (Some(taken_s), Some(scene_s)) = (source.exposure_s, truth.exposure_s)
        && (taken_s / scene_s - 1.0).abs() > 0.01
    {
        notes.push(format!(
            "the photographs were exposed for {taken_s} s, the scene's flashes are means over {scene_s} s: the \
             camera took {:.3} of the light that it would have taken then (`simulate frames` has --exposure-s)",
            taken_s / scene_s
        ));
    }
    if matches!(source.camera.mapping, Mapping::Pinhole) && !source.truth(source.frames[0])?.compensated {
        notes.push(format!(
            "without a calibration flashes stand off their places by the facility's distortion; a candidate more than \
             {SAME_PX} px away (two standard deviations of the spot if that is more) counts as false"
        ));
    }
    Ok(notes)
}

/// Looks for flashes on one frame and compares with the truth.
///
/// # Errors
/// Its image or truth do not fit.
pub fn watch_frame(
    source: &Source,
    light: &CameraLight,
    options: &FlashOptions,
    frame: usize,
) -> Result<FlashFrame, InputError> {
    let path = source.image_path(frame)?;
    if path.extension().is_some_and(|extension| extension == "exr") {
        return Err(InputError::new(&path, "holds no points of light: they are in the screen images alone")
            .expected(format!("frames/{frame:06}.png")));
    }
    let (truth, inputs) = (source.truth(frame)?, source.frame_hash(frame)?);
    let there = TruthFile::read(&truth_path(&source.choice.dir, frame))?;
    let pose = pose_of(&truth);
    let light = light_of(source, light, there.radiance_scale);
    let mut image = source.image(frame)?;
    if source.kind == ImageKind::Screen {
        // Counts made linear are no whole numbers: a low count's light is a third of one.
        image.steps = Steps::Fine;
    }
    let night = detect_flashes(&image, &source.camera, &pose, &light, options);
    let flashes = there.flashes.unwrap_or_default();
    let own =
        flashes.iter().filter(|flash| source.choice.body.as_ref().is_none_or(|name| *name == flash.body));
    let mut outcomes: Vec<FlashOutcome> = own.map(|flash| outcome(source, &night, flash)).collect();
    let same_px = match light.spot {
        Spot::Pixels => SAME_PX,
        Spot::Gaussian(sigma_px) => SAME_PX.max(SAME_SPOTS * sigma_px),
    };
    let taken = assign(&night.candidates, &mut outcomes, same_px);
    let radius_m = truth.limb_body().mean_radius_m();
    for outcome in &mut outcomes {
        compare(&night.candidates, outcome, radius_m);
    }
    Ok(FlashFrame {
        frame,
        time_s: truth.time_s,
        phase_deg: truth.phase_rad.to_degrees(),
        distance_m: truth.position_camera_m.length(),
        watched_px: night.watched_px,
        threshold_sigma: night.threshold_sigma,
        background_dn: night.background_dn,
        noise_dn: night.noise_dn,
        false_candidates: (0..night.candidates.len()).filter(|k| !taken.contains_key(k)).collect(),
        candidates: night.candidates,
        flashes: outcomes,
        inputs,
    })
}

/// A flash of the truth in the image.
fn outcome(source: &Source, night: &NightSide, flash: &TruthFlash) -> FlashOutcome {
    let pinhole = &source.camera.pinhole;
    let px = flash.line_of_sight.and_then(|sight| source.camera.pixel(DVec2::from_array(sight)));
    let (width, height) = (f64::from(pinhole.width_px), f64::from(pinhole.height_px));
    let px = px.filter(|p| p.x >= 0.0 && p.y >= 0.0 && p.x < width && p.y < height);
    FlashOutcome {
        id: flash.id.clone(),
        magnitude: flash.mean_magnitude,
        px: px.map(|p| p.to_array()),
        latitude_deg: flash.latitude_deg,
        longitude_deg: flash.longitude_deg,
        hidden: flash.hidden,
        watched: px.is_some_and(|p| is_inside(night, [pinhole.width_px, pinhole.height_px], p)),
        candidate: None,
        error_px: None,
        error_m: None,
        error_magnitude: None,
    }
}

/// Whether a spot here is looked at whole: the pixels about it, too, are the night side's.
fn is_inside(night: &NightSide, [width, height]: [u32; 2], px: DVec2) -> bool {
    let (column, row) = (px.x as usize, px.y as usize);
    let near = |at: usize, size: u32| at.saturating_sub(2)..=(at + 2).min(size as usize - 1);
    near(row, height).all(|y| near(column, width).all(|x| night.mask[y * width as usize + x]))
}

/// Gives each candidate the nearest flash that is not hidden and has none yet, the nearest pairs first; returns the
/// candidates that are flashes.
fn assign(candidates: &[Candidate], outcomes: &mut [FlashOutcome], same_px: f64) -> BTreeMap<usize, usize> {
    let mut pairs = Vec::new();
    for (number, outcome) in outcomes.iter().enumerate().filter(|(_, outcome)| !outcome.hidden) {
        let Some(px) = outcome.px else { continue };
        for (candidate, found) in candidates.iter().enumerate() {
            let off_px = (found.px[0] - px[0]).hypot(found.px[1] - px[1]);
            if off_px < same_px {
                pairs.push((off_px, candidate, number));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut taken = BTreeMap::new();
    for (_, candidate, number) in pairs {
        if !taken.contains_key(&candidate) && outcomes[number].candidate.is_none() {
            taken.insert(candidate, number);
            outcomes[number].candidate = Some(candidate);
        }
    }
    taken
}

fn compare(candidates: &[Candidate], outcome: &mut FlashOutcome, radius_m: f64) {
    let (Some(found), Some(px)) = (outcome.candidate.map(|k| &candidates[k]), outcome.px) else { return };
    let up = |latitude_deg: f64, longitude_deg: f64| {
        let (latitude, longitude) = (latitude_deg.to_radians(), longitude_deg.to_radians());
        DVec3::new(latitude.cos() * longitude.cos(), latitude.cos() * longitude.sin(), latitude.sin())
    };
    let measured = up(found.latitude_deg, found.longitude_deg);
    let angle = measured.angle_between(up(outcome.latitude_deg, outcome.longitude_deg));
    outcome.error_px = Some([found.px[0] - px[0], found.px[1] - px[1]]);
    outcome.error_m = Some(angle * radius_m);
    outcome.error_magnitude = found.magnitude.map(|magnitude| magnitude - outcome.magnitude);
}

/// Looks for flashes on the frames of a source that are not yet in `list`, and returns all of them in order; without a
/// list nothing is kept. `progress` hears how many are done.
///
/// # Errors
/// A frame does not fit; the list is another sequence's or cannot be written.
pub fn watch_sequence(
    source: &Source,
    light: &CameraLight,
    options: &FlashOptions,
    list: Option<&Path>,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<FlashFrame>, InputError> {
    let hash = hash_bytes(format!("{} {light:?} {options:?}", source.hash).as_bytes());
    measure_frames(source, &hash, list, |frame| watch_frame(source, light, options, frame), progress)
}
