//! Magnitudes to digital counts and back: equal counts, mixtures of channels, several pixels.

use retina_formats::RadiometricCalibration;
use retina_radiometry::{DigitalCounts, irradiance_of_magnitude_w_m2_nm, magnitude_of_irradiance};

/// Counts by which the channels of a mixture may differ.
const SPREAD: u8 = 3;

/// Counts and what they show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Of each lit pixel.
    pub counts: DigitalCounts,
    /// Pixels with these counts.
    pub pixels: u32,
    /// Magnitude of all of them together.
    pub magnitude: f64,
}

/// Distances between neighbouring magnitudes that can be shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// Their median, mag.
    pub median_mag: f64,
    /// The largest, mag.
    pub largest_mag: f64,
}

/// All that one pixel can show, by light: equal counts, and triples whose channels differ by at most 3.
#[derive(Debug, Clone)]
pub struct ShownLight {
    grey: Vec<(f64, DigitalCounts)>,
    mixed: Vec<(f64, DigitalCounts)>,
}

impl ShownLight {
    /// Tables of a calibration.
    pub fn new(calibration: &RadiometricCalibration) -> Self {
        let light = |counts: DigitalCounts| (calibration.irradiance_w_m2_nm(counts), counts);
        let grey = (1..=255).map(|count| light([count; 3])).collect();
        let mut mixed = Vec::new();
        for lowest in 0..=255u8 {
            let reach = || lowest..=lowest.saturating_add(SPREAD);
            for r in reach() {
                for g in reach() {
                    mixed.extend(
                        reach().map(|b| [r, g, b]).filter(|c| c.contains(&lowest) && *c != [0; 3]).map(light),
                    );
                }
            }
        }
        mixed.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Self { grey, mixed }
    }

    /// One pixel at equal counts whose light is nearest to a magnitude's.
    pub fn grey(&self, magnitude: f64) -> Shown {
        shown(nearest(&self.grey, irradiance_of_magnitude_w_m2_nm(magnitude)), 1)
    }

    /// One pixel whose channels may differ, nearest to a magnitude's light.
    pub fn mixed(&self, magnitude: f64) -> Shown {
        shown(nearest(&self.mixed, irradiance_of_magnitude_w_m2_nm(magnitude)), 1)
    }

    /// As few pixels of equal counts as reach a magnitude.
    pub fn pixels(&self, magnitude: f64) -> Shown {
        let wanted = irradiance_of_magnitude_w_m2_nm(magnitude);
        let brightest = self.grey[self.grey.len() - 1].0;
        // A hair's breadth above a whole number of pixels is that number.
        let pixels = (wanted / brightest * (1.0 - 1e-9)).ceil().max(1.0);
        shown(nearest(&self.grey, wanted / pixels), pixels as u32)
    }

    /// Steps of equal counts between two magnitudes.
    pub fn grey_steps(&self, brighter: f64, fainter: f64) -> Option<Steps> {
        steps(&self.grey, brighter, fainter)
    }

    /// Steps of mixtures between two magnitudes.
    pub fn mixed_steps(&self, brighter: f64, fainter: f64) -> Option<Steps> {
        steps(&self.mixed, brighter, fainter)
    }
}

fn nearest(table: &[(f64, DigitalCounts)], wanted: f64) -> (f64, DigitalCounts) {
    let above = table.partition_point(|entry| entry.0 < wanted).min(table.len() - 1);
    let below = above.saturating_sub(1);
    if wanted - table[below].0 < table[above].0 - wanted { table[below] } else { table[above] }
}

fn shown((light, counts): (f64, DigitalCounts), pixels: u32) -> Shown {
    Shown { counts, pixels, magnitude: magnitude_of_irradiance(light * f64::from(pixels)) }
}

/// Of the entries between two magnitudes, with the first beyond each end; `None` where there is no step.
fn steps(table: &[(f64, DigitalCounts)], brighter: f64, fainter: f64) -> Option<Steps> {
    let at = |magnitude: f64| {
        let light = irradiance_of_magnitude_w_m2_nm(magnitude);
        table.partition_point(|entry| entry.0 < light)
    };
    let range = at(fainter).saturating_sub(1)..(at(brighter) + 1).min(table.len());
    let mut each: Vec<f64> = table[range]
        .windows(2)
        .filter(|pair| pair[0].0 > 0.0)
        .map(|pair| 2.5 * (pair[1].0 / pair[0].0).log10())
        .collect();
    each.sort_unstable_by(f64::total_cmp);
    let largest_mag = *each.last()?;
    Some(Steps { median_mag: 0.5 * (each[(each.len() - 1) / 2] + each[each.len() / 2]), largest_mag })
}
