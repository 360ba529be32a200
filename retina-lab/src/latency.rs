//! From a frame to its image: how long the screen, the camera and what lies between them take.
//!
//! No clock is common to the program, the glass and the sensor. So a frame is changed in the middle of an exposure: the
//! part s of the exposure E that sees the new frame says when its light came. With L_s the time from the return of
//! [`Screen::show`](crate::Screen::show) to the light on the glass, L_t from the call of
//! [`LabCamera::take`](crate::LabCamera::take) to the begin of the exposure, and L_x from the exposure's end to the image
//! in hand, the program's clock gives
//!
//! - take's duration = L_t + E + L_x
//! - image in hand - show's return = L_s + s E + L_x
//!
//! so L_t + L_x, L_s + L_x and L_s - L_t are found; each of the three alone is not.

use std::time::{Duration, Instant};

use retina_bench::ScreenImage;
use retina_image::CameraImage;

use crate::exposure::{peak, saturates};
use crate::{LabError, Rig};

/// How latencies are measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatencyOptions {
    /// Frames that are changed in the middle of an exposure.
    pub trials: usize,
    /// Exposure time, s: longer than what the screen and the camera differ by.
    pub exposure_s: f64,
    /// Side of the square that is lit, screen px.
    pub square_px: u32,
    /// Largest digital count of the square.
    pub most_count: u8,
}

impl Default for LatencyOptions {
    fn default() -> Self {
        Self { trials: 60, exposure_s: 0.2, square_px: 200, most_count: 255 }
    }
}

/// A frame that was changed in the middle of an exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatencyTrial {
    /// Part of the exposure that saw the new frame.
    pub share: f64,
    /// How long the call that shows a frame lasts, s.
    pub show_s: f64,
    /// L_t + L_x, s: what taking an image lasts beyond its exposure.
    pub camera_s: f64,
    /// L_s + L_x, s: from the frame's being shown to the image that has its light, without the exposure.
    pub show_to_image_s: f64,
    /// L_s - L_t, s: how long to wait between showing and taking, so that the whole exposure sees the frame.
    pub settle_s: f64,
}

/// What was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Latency {
    /// The trials.
    pub trials: Vec<LatencyTrial>,
    /// Exposure time that the camera used, s.
    pub exposure_s: f64,
    /// Digital count of the square.
    pub digital_count: u8,
    /// Images that came torn or not at all, and were taken again; such trials are not counted.
    pub lost: u32,
}

/// Quantiles of a latency, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantiles {
    /// Smallest.
    pub least: f64,
    /// Half of the trials lie below.
    pub median: f64,
    /// 95 % lie below.
    pub within_95_percent: f64,
    /// Largest.
    pub most: f64,
}

impl Latency {
    /// Quantiles of one of the trials' times.
    pub fn quantiles(&self, of: impl Fn(&LatencyTrial) -> f64) -> Quantiles {
        let mut values: Vec<f64> = self.trials.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[(share * (values.len() - 1) as f64).round() as usize];
        Quantiles { least: at(0.0), median: at(0.5), within_95_percent: at(0.95), most: at(1.0) }
    }
}

/// Shares that tell the time of the light: the rest is noise, or saw all or nothing.
const TELLING: std::ops::RangeInclusive<f64> = 0.1..=0.9;
/// Trials in a row that may see all or nothing before it is told.
const MOST_BLIND: usize = 40;
/// Changes of the square's count until it fits into the camera's range.
const MOST_COUNTS: usize = 8;
/// Images of the dark and of the lit square that shares are counted by.
const REFERENCES: usize = 3;
/// Steps of the wait before a trial: the golden ratio fills a refresh evenly, whatever its length.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// Measures latencies. The screen is dark at the end. `progress` is told how many of how many trials are there.
///
/// # Errors
/// A device fails, the user wants an end; the square is too dim or too bright at every count; the light comes later than
/// an exposure lasts.
pub fn measure_latency(
    rig: &mut Rig<'_>,
    size_px: [u32; 2],
    options: &LatencyOptions,
    mut progress: impl FnMut(usize, usize),
) -> Result<Latency, LabError> {
    let dark = ScreenImage::dark(size_px[0], size_px[1]);
    let (lit, digital_count) = lit_square(rig, size_px, options)?;
    let scale = Scale::measure(rig, &dark, &lit, options.exposure_s)?;
    let mut trials = Vec::new();
    let (mut blind, mut lost, mut exposure_s) = (0, 0, options.exposure_s);
    // From the call of take to that of show; moved until the change falls into the exposure.
    let mut offset_s = 0.4 * options.exposure_s;
    let mut number = 0f64;
    while trials.len() < options.trials {
        progress(trials.len(), options.trials);
        number += 1.0;
        rig.show(&dark)?;
        std::thread::sleep(Duration::from_secs_f64(0.05 * (number * GOLDEN).fract()));
        rig.go_on()?;
        let jitter_s = 0.3 * options.exposure_s * ((number * GOLDEN).fract() - 0.5);
        let wait = Duration::from_secs_f64((offset_s + jitter_s).max(0.0));
        let (screen, camera) = (&mut *rig.screen, &mut *rig.camera);
        let (shown, taken, took) = std::thread::scope(|scope| {
            let start = Instant::now();
            let show = scope.spawn(|| {
                std::thread::sleep(wait);
                let called = Instant::now();
                screen.show(&lit)?;
                Ok::<_, LabError>((called, Instant::now()))
            });
            let taken = camera.take();
            let end = Instant::now();
            let shown = show.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            (shown, taken, (start, end))
        });
        let ((called, returned), taken, (start, end)) = (shown?, taken?, took);
        let share = scale.share(&taken.image);
        if taken.lost > 0 || !TELLING.contains(&share) {
            lost += taken.lost;
            blind += 1;
            if share > 0.9 {
                offset_s += 0.25 * options.exposure_s;
            } else if share < 0.1 {
                offset_s = (offset_s - 0.25 * options.exposure_s).max(0.0);
            }
            if blind > MOST_BLIND {
                return Err(blind_error(rig, share));
            }
            continue;
        }
        blind = 0;
        exposure_s = taken.exposure_s;
        let seconds = |from: Instant, to: Instant| to.saturating_duration_since(from).as_secs_f64();
        let after_s = seconds(returned, end) - seconds(end, returned);
        let camera_s = seconds(start, end) - exposure_s;
        let show_to_image_s = after_s - share * exposure_s;
        trials.push(LatencyTrial {
            share,
            show_s: seconds(called, returned),
            camera_s,
            show_to_image_s,
            settle_s: show_to_image_s - camera_s,
        });
    }
    rig.screen.show(&dark)?;
    Ok(Latency { trials, exposure_s, digital_count, lost })
}

fn blind_error(rig: &Rig<'_>, share: f64) -> LabError {
    LabError::Camera {
        camera: rig.camera.name(),
        problem: format!(
            "does not see the frame change within an exposure: the last one saw the new frame for {:.0} % of its time. \
             Is the screen or the camera later than an exposure lasts? Give a longer --exposure-s",
            100.0 * share
        ),
    }
}

/// A square in the middle whose light fits into the camera's range, and its count.
fn lit_square(
    rig: &mut Rig<'_>,
    size_px: [u32; 2],
    options: &LatencyOptions,
) -> Result<(ScreenImage, u8), LabError> {
    rig.show(&ScreenImage::dark(size_px[0], size_px[1]))?;
    let dark = rig.take(options.exposure_s)?.image;
    let mut count = options.most_count;
    let mut filled = 0.0;
    for _ in 0..MOST_COUNTS {
        let image = square(size_px, options.square_px, count);
        rig.show(&image)?;
        let lit = rig.take(options.exposure_s)?.image;
        filled = peak(&lit, &dark);
        if !saturates(&lit, &dark) {
            if filled < 0.05 {
                break;
            }
            return Ok((image, count));
        }
        count = (f64::from(count) * 0.6) as u8;
    }
    let problem = if filled < 0.05 {
        format!(
            "sees too little of a square of count {count}: {:.1} % of its range. Give a longer --exposure-s",
            100.0 * filled
        )
    } else {
        format!("is saturated by a square of count {count}. Give a shorter --exposure-s")
    };
    Err(LabError::Camera { camera: rig.camera.name(), problem })
}

/// A grey square in the middle of a black screen.
pub(crate) fn square([width, height]: [u32; 2], side: u32, count: u8) -> ScreenImage {
    let mut image = ScreenImage::dark(width, height);
    let middle = |at: u32, size: u32| (2 * at + 1).abs_diff(size) <= side;
    for row in 0..height {
        for column in 0..width {
            if middle(row, height) && middle(column, width) {
                image.counts[(row * width + column) as usize] = [count; 3];
            }
        }
    }
    image
}

/// What an exposure is that saw none, and one that saw all of the square's light.
struct Scale {
    /// Pixels that the square lights.
    pixels: Vec<usize>,
    dark_dn: f64,
    lit_dn: f64,
}

impl Scale {
    fn measure(
        rig: &mut Rig<'_>,
        dark: &ScreenImage,
        lit: &ScreenImage,
        exposure_s: f64,
    ) -> Result<Self, LabError> {
        let mut mean = |frame: &ScreenImage| -> Result<CameraImage, LabError> {
            rig.show(frame)?;
            let mut sum = rig.take(exposure_s)?.image;
            for _ in 1..REFERENCES {
                let next = rig.take(exposure_s)?.image;
                sum.values.iter_mut().zip(&next.values).for_each(|(sum, value)| *sum += value);
            }
            sum.values.iter_mut().for_each(|sum| *sum /= REFERENCES as f32);
            Ok(sum)
        };
        let (without, with) = (mean(dark)?, mean(lit)?);
        let half = 0.5 * (peak(&with, &without) as f32) * with.full_scale_dn;
        let lights = |&pixel: &usize| with.values[pixel] - without.values[pixel] > half;
        let pixels: Vec<usize> = (0..with.values.len()).filter(lights).collect();
        let sum = |image: &CameraImage| pixels.iter().map(|&pixel| f64::from(image.values[pixel])).sum();
        let (dark_dn, lit_dn) = (sum(&without), sum(&with));
        Ok(Self { pixels, dark_dn, lit_dn })
    }

    fn share(&self, image: &CameraImage) -> f64 {
        let sum: f64 = self.pixels.iter().map(|&pixel| f64::from(image.values[pixel])).sum();
        (sum - self.dark_dn) / (self.lit_dn - self.dark_dn)
    }
}

#[cfg(test)]
mod tests;
