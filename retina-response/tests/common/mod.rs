//! Made-up campaigns of a known response.
#![allow(dead_code, clippy::unwrap_used, reason = "each test file takes what it needs")]

use std::path::Path;

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use retina_formats::{Channel, SourceFile};
use retina_response::{ChannelResponse, Reading};

/// I_full [(1 - b) (B/255)^gamma exp(bend(ln(B/255))) + b], and a meter.
#[derive(Clone, Copy)]
pub(crate) struct Truth {
    pub(crate) full_w_m2: f64,
    pub(crate) gamma: f64,
    pub(crate) black: f64,
    pub(crate) zero_w_m2: f64,
    pub(crate) floor_w_m2: f64,
    pub(crate) proportional: f64,
    /// Departure from the power law: ln I gains `bend` sin(pi ln(B/255) / ln(8/255)).
    pub(crate) bend: f64,
}

/// About the paper's: white at 255 is magnitude -1.44, 5.8e-8 W m^-2 over three channels.
pub(crate) const TRUTH: Truth = Truth {
    full_w_m2: 2.0e-8,
    gamma: 2.2,
    black: 2e-4,
    zero_w_m2: 5e-6,
    floor_w_m2: 1e-7,
    proportional: 0.004,
    bend: 0.0,
};

impl Truth {
    pub(crate) fn pixel_w_m2(&self, count: usize) -> f64 {
        if count == 0 {
            return self.full_w_m2 * self.black;
        }
        let x = count as f64 / 255.0;
        let bend = self.bend * (std::f64::consts::PI * x.ln() / (8.0f64 / 255.0).ln()).sin();
        self.full_w_m2 * ((1.0 - self.black) * x.powf(self.gamma) * bend.exp() + self.black)
    }

    pub(crate) fn sigma_w_m2(&self, pixels: f64, count: usize) -> f64 {
        self.floor_w_m2.hypot(self.proportional * pixels * self.pixel_w_m2(count))
    }
}

/// Squares and counts of a campaign: count 0 and 30 counts from 2 to 255, each with two squares (400 and 800
/// pixels a side at the low counts, 100 and 200 at the high ones), and six dark readings.
pub(crate) fn plan() -> Vec<(usize, f64)> {
    let mut plan = vec![(0, 0.0); 6];
    for step in 0..=30 {
        let count =
            if step == 0 { 0 } else { (255.0 * (f64::from(step) / 30.0).powf(1.42)).round() as usize };
        let squares = if count < 40 { [400.0, 800.0] } else { [100.0, 200.0] };
        plan.extend(squares.map(|square| (count, square)));
    }
    plan
}

pub(crate) fn readings(truth: &Truth, plan: &[(usize, f64)], seed: u64, stated: bool) -> Vec<Reading> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let each = |(line, &(count, square_px)): (usize, &(usize, f64))| {
        let pixels = square_px * square_px;
        let sigma = truth.sigma_w_m2(pixels, count);
        let normal: f64 = StandardNormal.sample(&mut random);
        Reading {
            count,
            square_px,
            irradiance_w_m2: pixels * truth.pixel_w_m2(count) + truth.zero_w_m2 + sigma * normal,
            sigma_w_m2: stated.then_some(sigma),
            place: (0, line + 2),
            series: None,
            gain: 1.0,
        }
    };
    plan.iter().enumerate().map(each).collect()
}

pub(crate) fn fit(readings: &[Reading]) -> Result<ChannelResponse, retina_files::InputError> {
    ChannelResponse::fit(Channel::G, readings, &[SourceFile::new("power.csv", String::new())])
}

/// The three channels' readings as a table.
pub(crate) fn write_table(path: &Path, channels: [&[Reading]; 3]) {
    let mut text = String::from("channel,digital_count,square_px,irradiance_w_m2,sigma_w_m2\n");
    for (letter, readings) in ["r", "g", "b"].iter().zip(channels) {
        for r in readings {
            let sigma = r.sigma_w_m2.map_or(String::new(), |s| s.to_string());
            text += &format!("{letter},{},{},{},{sigma}\n", r.count, r.square_px, r.irradiance_w_m2);
        }
    }
    std::fs::write(path, text).unwrap();
}
