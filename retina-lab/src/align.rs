//! Alignment: the bench's misalignment as numbers for each screw, over and over while a person turns.

mod fit;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use glam::DVec2;
use retina_bench::{Display, OpticsDetail, ScreenImage};
use retina_calibration::geometry::{Pattern, PatternOptions};
use retina_campaign::screen_image;
use retina_files::{InputError, write_atomic};
use retina_geometry::Setup;

use crate::spots::{COARSE, FINE, Spot, model_spots, photographed_spots};
use crate::{LabError, Rig, Screw, Turns, find_exposure};
use fit::{Pair, Slopes};

/// A number and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Its standard deviation, as far as the model of the facility holds.
    pub sigma: f64,
}

/// How the alignment is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct AlignOptions {
    /// Exposures of a round.
    pub exposures: usize,
    /// Points of the pattern.
    pub points: usize,
    /// First trial of the exposure time, s.
    pub first_exposure_s: f64,
    /// Whether the relay's lenses may be off, too: within the tolerances of their mounts.
    pub relay: bool,
}

impl Default for AlignOptions {
    fn default() -> Self {
        Self { exposures: 12, points: 400, first_exposure_s: 0.01, relay: false }
    }
}

/// What a round found.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// The misalignment now, by screw. The screen's turn about the axis looks like the camera's roll, and is in it.
    pub screws: BTreeMap<Screw, Estimate>,
    /// How far each screw is to be turned next.
    pub turn: Turns,
    /// Points that were used.
    pub points: usize,
    /// Median width of the spots (standard deviation), camera px.
    pub width_px: f64,
    /// RMS of the centroids about the model, camera px an axis.
    pub rms_px: f64,
}

/// The screws that are fitted, with the step of their derivatives, deg or mm.
const FITTED: [(Screw, f64); 12] = [
    (Screw::ScreenTiltX, 0.1),
    (Screw::ScreenTiltY, 0.1),
    (Screw::ScreenShiftX, 0.1),
    (Screw::ScreenShiftY, 0.1),
    (Screw::ScreenFocus, 0.05),
    (Screw::RelayShiftX, 0.05),
    (Screw::RelayShiftY, 0.05),
    (Screw::RelayTiltX, 0.05),
    (Screw::RelayTiltY, 0.05),
    (Screw::CameraPointingX, 0.1),
    (Screw::CameraPointingY, 0.1),
    (Screw::CameraRoll, 0.1),
];
/// Steps by which a guess is mended.
const MOST_STEPS: usize = 6;
/// The guess is good enough where every screw's step is below this, deg or mm.
const SMALL_STEP: f64 = 0.01;
/// The model's derivatives are taken anew where a screw's step is above this, deg or mm.
const LARGE_STEP: f64 = 0.05;
/// No screw is believed to be farther off, deg or mm.
const MOST_OFF: f64 = 10.0;
/// Fewest points.
const FEWEST: usize = 50;

/// Measures a bench round by round.
pub struct Aligner {
    setup: Setup,
    options: AlignOptions,
    pattern: Pattern,
    image: ScreenImage,
    exposure_s: Option<f64>,
    /// How the screws stand, as far as it is known.
    guess: Turns,
    round: usize,
}

impl Aligner {
    /// Makes the pattern in `folder/pattern`.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn new(setup: &Setup, options: AlignOptions, folder: &Path) -> Result<Self, LabError> {
        let wanted = PatternOptions {
            points: options.points,
            screens: Some(1),
            // The brightest points have the least noise.
            counts: vec![255],
            ..PatternOptions::default()
        };
        let pattern = Pattern::make(setup, &wanted)?;
        pattern.write(&folder.join("pattern"), setup, wanted.seed)?;
        Ok(Self {
            setup: setup.clone(),
            options,
            image: screen_image(&pattern.screens[0], setup.screen.width_px, setup.screen.height_px),
            pattern,
            exposure_s: None,
            guess: Turns::default(),
            round: 0,
        })
    }

    /// Photographs the pattern and says how the bench stands. `turned` is how far the screws were turned since the
    /// round before. The spots go to `folder/round_NN.csv`.
    ///
    /// # Errors
    /// A device fails, the user wants an end, or the pattern is not found in the images.
    pub fn round(
        &mut self,
        rig: &mut Rig<'_>,
        turned: &Turns,
        folder: &Path,
        progress: impl FnMut(usize, usize),
    ) -> Result<Alignment, LabError> {
        // Wide spots are dim: the exposure is looked for anew.
        let trial_s = self.exposure_s.unwrap_or(self.options.first_exposure_s);
        let exposure_s = find_exposure(rig, &self.image, trial_s)?;
        self.exposure_s = Some(exposure_s);
        let (shown, exposures) = ((&self.pattern, &self.image), (self.options.exposures, exposure_s));
        let spots = photographed_spots(rig, shown, &self.setup, exposures, progress)?;
        let spots = spots.ok_or_else(|| lost(folder, 0))?;
        self.guess = self.guess.and(turned);
        self.round += 1;
        self.write(&spots, &folder.join(format!("round_{:02}.csv", self.round)))?;
        let mut widths: Vec<f64> = spots.iter().flatten().map(|spot| spot.variance_px2.sqrt()).collect();
        widths.sort_by(f64::total_cmp);
        let mut screws = Vec::new();
        let (mut points, mut rms_px) = (0, 0.0);
        let mut slopes = self.slopes()?;
        for _ in 0..MOST_STEPS {
            rig.go_on()?;
            let pairs = self.pairs(&spots, &slopes)?;
            points = pairs.len();
            let fit = fit::fit(&pairs, &self.guess).filter(|_| points >= FEWEST);
            let Some(fit) = fit else { return Err(lost(folder, points)) };
            (screws, rms_px) = (fit.screws, fit.rms_px);
            let mut largest = 0f64;
            for (screw, estimate) in &screws {
                let most = screw.range().min(MOST_OFF);
                largest = largest.max((estimate.value - self.guess.get(*screw)).abs());
                self.guess.set(*screw, estimate.value.clamp(-most, most));
            }
            if largest < SMALL_STEP {
                break;
            }
            if largest > LARGE_STEP {
                slopes = self.slopes()?;
            }
        }
        let mut alignment = Alignment {
            screws: BTreeMap::new(),
            turn: Turns::default(),
            points,
            width_px: widths[widths.len() / 2],
            rms_px,
        };
        for (screw, estimate) in screws.into_iter().filter(|(screw, _)| self.is_fitted(*screw)) {
            alignment.screws.insert(screw, estimate);
            if !screw.is_built_in() {
                alignment.turn.set(screw, -estimate.value);
            }
        }
        Ok(alignment)
    }

    fn is_fitted(&self, screw: Screw) -> bool {
        self.options.relay || !screw.is_built_in()
    }

    /// The model's photograph with the screws turned; no spots where it shows nothing that is recognised.
    fn model(&self, turns: &Turns, detail: OpticsDetail) -> Result<Vec<Option<Spot>>, LabError> {
        let spots = model_spots(&self.setup, &self.pattern, &self.image, turns, detail)?;
        Ok(spots.unwrap_or_else(|| vec![None; self.pattern.screens[0].points.len()]))
    }

    /// The model's derivatives at the guess, by point; `None` where a point leaves the field.
    fn slopes(&self) -> Result<Vec<Option<Slopes>>, LabError> {
        let guess = self.guess;
        let base = self.model(&guess, COARSE)?;
        let mut moved = Vec::with_capacity(FITTED.len());
        for (screw, step) in FITTED {
            if !self.is_fitted(screw) {
                // Where the design has it: nothing depends on it.
                moved.push(base.clone());
                continue;
            }
            let mut turns = guess;
            turns.set(screw, guess.get(screw) + step);
            moved.push(self.model(&turns, COARSE)?);
        }
        let of = |place: usize| {
            let base = base[place]?;
            let mut slopes: Slopes = [(DVec2::ZERO, 0.0); FITTED.len()];
            for ((slope, (_, step)), moved) in slopes.iter_mut().zip(FITTED).zip(&moved) {
                let moved = moved[place]?;
                *slope = ((moved.at_px - base.at_px) / step, (moved.variance_px2 - base.variance_px2) / step);
            }
            Some(slopes)
        };
        Ok((0..base.len()).map(of).collect())
    }

    /// Measured spots beside the model's at the guess.
    fn pairs(&self, seen: &[Option<Spot>], slopes: &[Option<Slopes>]) -> Result<Vec<Pair>, LabError> {
        let model = self.model(&self.guess, FINE)?;
        let camera = self.setup.camera_pinhole();
        let display = Display::new(&self.setup, 0);
        let pair = |place: usize| {
            let (seen, model, slopes) = (seen[place]?, model[place]?, slopes[place]?);
            let screen_px = self.pattern.screens[0].points[place].screen_px();
            Some(Pair {
                seen,
                model,
                slopes,
                field: camera.line_of_sight(model.at_px),
                focal_px: camera.fx_px,
                screen_mm: DVec2::from_array(display.mm(screen_px.to_array())),
            })
        };
        Ok((0..seen.len()).filter_map(pair).collect())
    }

    fn write(&self, spots: &[Option<Spot>], path: &Path) -> Result<(), LabError> {
        let mut text = String::from("screen_x_px,screen_y_px,camera_x_px,camera_y_px,variance_px2\n");
        for (point, spot) in self.pattern.screens[0].points.iter().zip(spots) {
            let Some(spot) = spot else { continue };
            let (shown, at) = (point.screen_px(), spot.at_px);
            let _ = writeln!(text, "{},{},{},{},{}", shown.x, shown.y, at.x, at.y, spot.variance_px2);
        }
        write_atomic(path, text.as_bytes())
            .map_err(|error| InputError::new(path, format!("cannot be written: {error}")).into())
    }
}

fn lost(folder: &Path, points: usize) -> LabError {
    InputError::new(folder, "the pattern is not found in the images, or the model does not follow it")
        .found(format!("{points} points in common"))
        .expected(format!("{FEWEST} or more"))
        .help(
            "does the camera see the whole screen, nearly in focus? Turn the focus by hand until it sees spots; and does \
             the setup name the lenses that are there?",
        )
        .into()
}
