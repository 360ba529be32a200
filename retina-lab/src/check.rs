//! A card of what is wrong with a bench, and what to turn or set.

mod light;
mod places;

use std::path::Path;

use retina_files::InputError;
use retina_geometry::Setup;
use retina_image::CameraImage;

use crate::{LabError, LatencyOptions, Rig, measure_latency};

/// How good a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// As it should be.
    Good,
    /// Not as the setup says; what was measured will still be of use.
    Look,
    /// Nothing that is measured so can be trusted.
    Bad,
}

impl Grade {
    /// One word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Look => "look",
            Self::Bad => "bad",
        }
    }

    /// Good up to a limit, bad from another on.
    fn of(value: f64, look: f64, bad: f64) -> Self {
        if value <= look {
            Self::Good
        } else if value <= bad {
            Self::Look
        } else {
            // Not a number is bad, too.
            Self::Bad
        }
    }
}

/// A line of the card.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What was looked at.
    pub what: &'static str,
    /// How good it is.
    pub grade: Grade,
    /// What was measured, in words.
    pub found: String,
    /// What to do about it; empty where it is good.
    pub mend: String,
    /// The numbers, with their units in their names.
    pub values: Vec<(&'static str, f64)>,
}

impl Finding {
    fn new(what: &'static str, grade: Grade, found: String, mend: &str) -> Self {
        let mend = if grade == Grade::Good { String::new() } else { mend.to_owned() };
        Self { what, grade, found, mend, values: Vec::new() }
    }

    fn with(mut self, values: &[(&'static str, f64)]) -> Self {
        self.values.extend_from_slice(values);
        self
    }
}

/// Steps of a check, for progress.
pub const CHECK_STEPS: usize = 6;
/// Exposures of the latency's measurement.
const LATENCY_TRIALS: usize = 8;
/// A refresh of the display, s.
const REFRESH_S: f64 = 1.0 / 60.0;

/// Looks at the dark, the flat field, the response, the refresh, the places and the times of a bench. The images lie in
/// `out` afterwards. A step that cannot be made is a finding; the others are made all the same.
///
/// # Errors
/// A device is gone, a file cannot be written, or the user wants an end.
pub fn check(
    setup: &Setup,
    rig: &mut Rig<'_>,
    out: &Path,
    mut progress: impl FnMut(usize, usize),
) -> Result<Vec<Finding>, LabError> {
    std::fs::create_dir_all(out)
        .map_err(|error| InputError::new(out, format!("cannot be written: {error}")))?;
    let mut findings = Vec::new();
    let mut step = 0;
    let mut begin = |rig: &Rig<'_>| {
        progress(step, CHECK_STEPS);
        step += 1;
        rig.go_on()
    };
    begin(rig)?;
    let light = light::Light::measure(setup, rig, out)?;
    findings.extend(light.dark(setup));
    begin(rig)?;
    findings.extend(light.flat());
    begin(rig)?;
    findings.extend(light::response(setup, rig)?);
    begin(rig)?;
    findings.push(light::refresh(setup, rig)?);
    begin(rig)?;
    findings.extend(places::places(setup, rig, out)?);
    begin(rig)?;
    findings.push(times(setup, rig)?);
    progress(CHECK_STEPS, CHECK_STEPS);
    Ok(findings)
}

/// Whether the wait between showing and taking is long enough.
fn times(setup: &Setup, rig: &mut Rig<'_>) -> Result<Finding, LabError> {
    let what = "time to the glass";
    let options = LatencyOptions {
        trials: LATENCY_TRIALS,
        most_count: setup.screen.limits.most_count,
        ..LatencyOptions::default()
    };
    let size_px = [setup.screen.width_px, setup.screen.height_px];
    let waited_s = rig.settle_s;
    // Its own references need a screen that has followed for certain.
    rig.settle_s = waited_s.max(0.25);
    let found = measure_latency(rig, size_px, &options, |_, _| {});
    rig.settle_s = waited_s;
    let found = match found {
        Ok(found) => found,
        Err(LabError::Camera { problem, .. }) => {
            return Ok(Finding::new(what, Grade::Look, format!("not measured: the camera {problem}"), ""));
        }
        Err(error) => return Err(error),
    };
    let late_s = found.quantiles(|trial| trial.settle_s).most;
    let wanted_s = (late_s + REFRESH_S).max(0.0);
    let grade = if waited_s >= wanted_s { Grade::Good } else { Grade::Bad };
    let words = format!(
        "the glass is up to {:.0} ms later than the camera's trigger; --settle-s waits {:.0} ms",
        1e3 * late_s,
        1e3 * waited_s
    );
    let mend = format!("give --settle-s {wanted_s:.3} or more to every command");
    Ok(Finding::new(what, grade, words, &mend).with(&[("latest_s", late_s), ("wanted_settle_s", wanted_s)]))
}

fn write(image: &CameraImage, path: &Path) -> Result<(), LabError> {
    Ok(image.write_png(path)?)
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    if values.is_empty() { f64::NAN } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// A few pixels in words.
fn pixels_in_words(pixels: &[[u32; 2]]) -> String {
    const MOST: usize = 5;
    let named: Vec<String> = pixels.iter().take(MOST).map(|[x, y]| format!("({x}, {y})")).collect();
    let rest = pixels.len().saturating_sub(MOST);
    let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    if pixels.is_empty() { String::new() } else { format!(": {}{more}", named.join(", ")) }
}
