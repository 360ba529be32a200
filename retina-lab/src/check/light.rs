//! Light: the dark, the flat field, the display's response, its refresh.

use std::path::Path;

use retina_bench::ScreenImage;
use retina_geometry::Setup;
use retina_image::CameraImage;

use super::{Finding, Grade, median, pixels_in_words, write};
use crate::latency::square;
use crate::{LabError, Rig, find_exposure};

/// Images of the dark and of the flat field.
const IMAGES: usize = 4;
/// A pixel stands out by so many standard deviations, and by this part of its surroundings' light.
const OUTSTANDING: f32 = 8.0;
const DIP: f32 = 0.04;
/// Surroundings of a pixel, px either way.
const REACH: usize = 6;
/// Count of the evenly lit screen, where the display's limits allow it.
const EVEN_COUNT: u8 = 200;
/// Counts at which the response is measured, of a display that shows 255.
const COUNTS: [u8; 6] = [64, 96, 128, 160, 208, 255];
/// Side of the square that shows them, screen px.
const SQUARE_PX: u32 = 300;
/// Exposures that tell a flicker, and how long they are: shorter than a refresh.
const FLICKER_IMAGES: usize = 20;
const FLICKER_EXPOSURE_S: f64 = 0.004;

/// Means over images, and their scatter from one to the next.
struct Mean {
    values: Vec<f32>,
    sigma_dn: f64,
}

impl Mean {
    fn take(rig: &mut Rig<'_>, exposure_s: f64) -> Result<(Self, CameraImage), LabError> {
        let first = rig.take(exposure_s)?.image;
        let mut values = first.values.clone();
        let mut scatter = Vec::new();
        let mut last = first.values.clone();
        for _ in 1..IMAGES {
            let next = rig.take(exposure_s)?.image;
            let differences = next.values.iter().zip(&last).map(|(a, b)| f64::from((a - b).abs()));
            scatter.push(differences.sum::<f64>() / last.len() as f64);
            values.iter_mut().zip(&next.values).for_each(|(sum, value)| *sum += value);
            last = next.values;
        }
        values.iter_mut().for_each(|value| *value /= IMAGES as f32);
        // Mean absolute difference of two normal values: 2 sigma / sqrt(pi).
        let sigma_dn = median(scatter.into_iter()) * std::f64::consts::PI.sqrt() / 2.0;
        Ok((Self { values, sigma_dn }, first))
    }
}

/// The dark screen and the evenly lit one.
pub(super) struct Light {
    size: [usize; 2],
    dark: Mean,
    flat: Mean,
}

impl Light {
    pub(super) fn measure(setup: &Setup, rig: &mut Rig<'_>, out: &Path) -> Result<Self, LabError> {
        let (width, height) = (setup.screen.width_px, setup.screen.height_px);
        let even = setup.screen.limits.most_even_count(setup.response_gamma()).min(EVEN_COUNT);
        let white = ScreenImage {
            width_px: width,
            height_px: height,
            counts: vec![[even; 3]; (width * height) as usize],
        };
        let exposure_s = find_exposure(rig, &white, 0.005)?;
        rig.show(&white)?;
        let (flat, image) = Mean::take(rig, exposure_s)?;
        write(&image, &out.join("flat.png"))?;
        rig.show(&ScreenImage::dark(width, height))?;
        let (dark, image) = Mean::take(rig, exposure_s)?;
        write(&image, &out.join("dark.png"))?;
        let size = [image.width_px as usize, image.height_px as usize];
        Ok(Self { size, dark, flat })
    }

    /// Level and noise of the dark, and the pixels that shine.
    pub(super) fn dark(&self, setup: &Setup) -> Vec<Finding> {
        let noise = &setup.noise;
        let largest_dn = f64::from((1u32 << setup.camera.bits) - 1);
        let gain = noise.gain_e_per_dn.unwrap_or(noise.full_well_e / (largest_dn - noise.offset_dn).max(1.0));
        let wanted_dn = (noise.read_noise_e / gain).hypot(1.0 / 12f64.sqrt());
        let level_dn = median(self.dark.values.iter().map(|&value| f64::from(value)));
        let (sigma_dn, ratio) = (self.dark.sigma_dn, self.dark.sigma_dn / wanted_dn);
        let off_dn = (level_dn - noise.offset_dn).abs();
        let level = Finding::new(
            "dark level",
            Grade::of(off_dn, 3.0 + 0.1 * noise.offset_dn, 0.2 * largest_dn),
            format!("{level_dn:.1} DN, the setup says {:.1}", noise.offset_dn),
            "set `noise.offset_dn` of the setup; or is there light in the room, or a black level in the camera?",
        )
        .with(&[("level_dn", level_dn), ("expected_dn", noise.offset_dn)]);
        let scatter = Finding::new(
            "noise of the dark",
            if (0.7..=1.5).contains(&ratio) { Grade::Good } else { Grade::Look },
            format!("{sigma_dn:.2} DN from image to image, the setup says {wanted_dn:.2}"),
            "set `noise.read_noise_e` and `noise.gain_e_per_dn` of the setup, or the camera's gain",
        )
        .with(&[("sigma_dn", sigma_dn), ("expected_dn", wanted_dn)]);
        let limit = OUTSTANDING * self.mean_sigma(&self.dark).max(0.5);
        let (single, wide) = self.outstanding(&self.dark.values, |value, around| value - around > limit);
        let hot = Finding::new(
            "hot camera pixels",
            Grade::of(single.len() as f64, 1e-3 * self.dark.values.len() as f64, f64::INFINITY),
            format!("{}{}", single.len(), pixels_in_words(&single)),
            "cool the camera, or give its mask to `retina navigate`",
        )
        .with(&[("pixels", single.len() as f64)]);
        let shining = Finding::new(
            "light on a dark screen",
            Grade::of(wide.len() as f64, 0.0, 20.0),
            format!("{} places{}", wide.len(), pixels_in_words(&wide)),
            "pixels of the screen that are stuck, a pointer or another window on it, a reflection, or light from the room",
        )
        .with(&[("places", wide.len() as f64)]);
        vec![level, scatter, hot, shining]
    }

    /// Evenness of the flat field, and what is dark in it.
    pub(super) fn flat(&self) -> Vec<Finding> {
        // Not the dark image itself: where it shines, the difference would be a dark speck.
        let level = quantile(&self.dark.values, 0.5);
        let light: Vec<f32> = self.flat.values.iter().map(|flat| flat - level).collect();
        let brightest = f64::from(quantile(&light, 0.99));
        let lit = light.iter().filter(|&&value| f64::from(value) > 0.1 * brightest).count();
        let part = lit as f64 / light.len() as f64;
        let [width, height] = self.size;
        let corner = |x: usize, y: usize| {
            let near = (0..20).flat_map(|dy| (0..20).map(move |dx| (dx, dy)));
            let value = |(dx, dy)| {
                let (x, y) =
                    (if x == 0 { dx } else { width - 1 - dx }, if y == 0 { dy } else { height - 1 - dy });
                f64::from(light[y * width + x]) / brightest
            };
            median(near.map(value))
        };
        let corners = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        let [least, most] =
            [corners.iter().copied().fold(1.0, f64::min), corners.iter().copied().fold(0.0, f64::max)];
        let covered = Finding::new(
            "screen in the field",
            Grade::of(0.2 - part, 0.0, 0.1),
            format!("it lights {:.0} % of the camera's pixels", 100.0 * part),
            "is the camera pointed at the lenses, and is the frame over the whole output?",
        )
        .with(&[("part", part)]);
        let even = Finding::new(
            "light at the corners",
            Grade::of(most - least, 0.15, 0.6),
            format!("{:.0} to {:.0} % of the brightest", 100.0 * least, 100.0 * most),
            "corners differ: centre the camera's pupil on the lenses, and look at `retina lab align`",
        )
        .with(&[("least", least), ("most", most)]);
        let limit = OUTSTANDING * self.mean_sigma(&self.flat);
        let floor = 0.3 * brightest as f32;
        let (single, wide) = self.outstanding(&light, |value, around| {
            around > floor && around - value > limit && around - value > DIP * around
        });
        let dead = Finding::new(
            "dead camera pixels",
            Grade::of(single.len() as f64, 1e-3 * light.len() as f64, f64::INFINITY),
            format!("{}{}", single.len(), pixels_in_words(&single)),
            "give the camera's mask to `retina navigate`",
        )
        .with(&[("pixels", single.len() as f64)]);
        let specks = Finding::new(
            "dark specks",
            Grade::of(wide.len() as f64, 0.0, 50.0),
            format!("{} places{}", wide.len(), pixels_in_words(&wide)),
            "dead pixels of the screen, or dust: dust on the sensor stays where it is when the camera is turned",
        )
        .with(&[("places", wide.len() as f64)]);
        vec![covered, even, dead, specks]
    }

    /// Noise of a mean image's pixel, DN.
    fn mean_sigma(&self, mean: &Mean) -> f32 {
        (mean.sigma_dn / (IMAGES as f64).sqrt()) as f32
    }

    /// Places that differ from their surroundings: single pixels, and such that reach over several. One place for each
    /// speck.
    fn outstanding(
        &self,
        values: &[f32],
        differs: impl Fn(f32, f32) -> bool,
    ) -> (Vec<[u32; 2]>, Vec<[u32; 2]>) {
        let [width, height] = self.size;
        let mut found: Vec<[usize; 2]> = Vec::new();
        let mut around = Vec::new();
        for y in REACH..height - REACH {
            for x in REACH..width - REACH {
                // Four points far enough away are enough to know that nothing is here.
                let value = values[y * width + x];
                let cross = [(x - REACH, y), (x + REACH, y), (x, y - REACH), (x, y + REACH)];
                if !cross.iter().any(|&(x, y)| differs(value, values[y * width + x])) {
                    continue;
                }
                around.clear();
                for dy in 0..=2 * REACH {
                    let from = (y + dy - REACH) * width + x - REACH;
                    around.extend_from_slice(&values[from..=from + 2 * REACH]);
                }
                let middle = around.len() / 2;
                let (_, median, _) = around.select_nth_unstable_by(middle, f32::total_cmp);
                if differs(value, *median) {
                    found.push([x, y]);
                }
            }
        }
        // Pixels that lie near each other are of one speck.
        let near =
            |a: [usize; 2], b: [usize; 2]| a[0].abs_diff(b[0]) <= REACH && a[1].abs_diff(b[1]) <= REACH;
        let mut specks: Vec<Vec<[usize; 2]>> = Vec::new();
        for at in found {
            match specks.iter_mut().find(|speck| speck.iter().any(|&known| near(known, at))) {
                Some(speck) => speck.push(at),
                None => specks.push(vec![at]),
            }
        }
        let (mut single, mut wide) = (Vec::new(), Vec::new());
        for speck in specks {
            let middle = speck[speck.len() / 2].map(|at| at as u32);
            if speck.len() == 1 { single.push(middle) } else { wide.push(middle) }
        }
        (single, wide)
    }
}

fn quantile(values: &[f32], share: f64) -> f32 {
    let mut values = values.to_vec();
    let at = (share * (values.len() - 1) as f64) as usize;
    *values.select_nth_unstable_by(at, f32::total_cmp).1
}

/// The display's response, and the camera's: light over count, and over exposure time.
pub(super) fn response(setup: &Setup, rig: &mut Rig<'_>) -> Result<Vec<Finding>, LabError> {
    let size_px = [setup.screen.width_px, setup.screen.height_px];
    let most = setup.screen.limits.most_count;
    let exposure_s = find_exposure(rig, &square(size_px, SQUARE_PX, most), 0.005)?;
    let dark = ScreenImage::dark(size_px[0], size_px[1]);
    let mut seen = |count: u8, exposure_s: f64| -> Result<CameraImage, LabError> {
        rig.show(&if count == 0 { dark.clone() } else { square(size_px, SQUARE_PX, count) })?;
        Ok(rig.take(exposure_s)?.image)
    };
    let without = seen(0, exposure_s)?;
    let full = seen(most, exposure_s)?;
    let brightest = quantile(&full.values, 0.999) - quantile(&without.values, 0.5);
    let lit: Vec<usize> = (0..full.values.len())
        .filter(|&pixel| full.values[pixel] - without.values[pixel] > 0.7 * brightest)
        .collect();
    let of = |image: &CameraImage, dark: &CameraImage| {
        let sum: f64 = lit.iter().map(|&pixel| f64::from(image.values[pixel] - dark.values[pixel])).sum();
        sum / lit.len().max(1) as f64
    };
    let mut light = Vec::new();
    for count in COUNTS {
        let count = (f64::from(count) * f64::from(most) / 255.0).round() as u8;
        light.push((f64::from(count) / 255.0, of(&seen(count, exposure_s)?, &without)));
    }
    let rises = light.windows(2).all(|pair| pair[1].1 > pair[0].1);
    // ln light = gamma ln (B / 255) + c.
    let logs: Vec<[f64; 2]> = light.iter().map(|(count, light)| [count.ln(), light.max(1e-9).ln()]).collect();
    let mean = |k: usize| logs.iter().map(|at| at[k]).sum::<f64>() / logs.len() as f64;
    let (x, y) = (mean(0), mean(1));
    let gamma = logs.iter().map(|at| (at[0] - x) * (at[1] - y)).sum::<f64>()
        / logs.iter().map(|at| (at[0] - x).powi(2)).sum::<f64>();
    let wanted = setup.response_gamma();
    let screen = Finding::new(
        "response of the screen",
        if rises { Grade::of((gamma - wanted).abs(), 0.1, 0.5) } else { Grade::Bad },
        if rises {
            format!("light goes with the count to the power of {gamma:.2}; the setup says {wanted:.2}")
        } else {
            "light does not rise with the count".to_owned()
        },
        "switch the display's contrast enhancement, local dimming, night light and colour profile off; then \
         `retina lab calibrate radiometry`",
    )
    .with(&[("gamma", gamma), ("expected_gamma", wanted)]);
    let half_dark = seen(0, 0.5 * exposure_s)?;
    let ratio = of(&seen(most, 0.5 * exposure_s)?, &half_dark) / of(&full, &without);
    let camera = Finding::new(
        "response of the camera",
        Grade::of((ratio / 0.5 - 1.0).abs(), 0.02, 0.1),
        format!("half the exposure time gives {:.1} % of the light", 100.0 * ratio),
        "switch the camera's gamma, automatic exposure and automatic gain off; does the display flicker?",
    )
    .with(&[("part", ratio)]);
    Ok(vec![screen, camera])
}

/// Whether short exposures see the same light.
pub(super) fn refresh(setup: &Setup, rig: &mut Rig<'_>) -> Result<Finding, LabError> {
    let what = "flicker";
    let size_px = [setup.screen.width_px, setup.screen.height_px];
    rig.show(&ScreenImage::dark(size_px[0], size_px[1]))?;
    let dark = match rig.take(FLICKER_EXPOSURE_S) {
        Ok(taken) => taken.image,
        Err(LabError::Camera { problem, .. }) => {
            return Ok(Finding::new(what, Grade::Look, format!("not measured: the camera {problem}"), ""));
        }
        Err(error) => return Err(error),
    };
    let mut sums = Vec::new();
    rig.show(&square(size_px, SQUARE_PX, setup.screen.limits.most_count))?;
    for k in 0..FLICKER_IMAGES {
        // Other phases of the refresh, whatever the camera's rate.
        std::thread::sleep(std::time::Duration::from_micros(1700 * (k as u64 % 7)));
        let image = rig.take(FLICKER_EXPOSURE_S)?.image;
        let light: f64 = image.values.iter().zip(&dark.values).map(|(lit, dark)| f64::from(lit - dark)).sum();
        sums.push(light);
    }
    let mean = sums.iter().sum::<f64>() / sums.len() as f64;
    let scatter =
        (sums.iter().map(|sum| (sum - mean).powi(2)).sum::<f64>() / sums.len() as f64).sqrt() / mean;
    Ok(Finding::new(
        what,
        Grade::of(scatter, 0.01, 0.1),
        format!(
            "the light of exposures of {} ms scatters by {:.2} %",
            1e3 * FLICKER_EXPOSURE_S,
            100.0 * scatter
        ),
        "expose for whole refreshes of the display, or many of them (0.2 s and more)",
    )
    .with(&[("scatter", scatter)]))
}
