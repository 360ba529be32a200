//! `power.csv` from the bench: squares of the screen in front of a power meter.

use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use retina_bench::{Bench, BenchError, OpticsDetail};
use retina_formats::{Channel, PowerRow, PowerTable};

use crate::{Facility, TemperatureProfile};

/// A campaign of power readings.
#[derive(Debug, Clone, PartialEq)]
pub struct PowerOptions {
    /// Digital counts.
    pub counts: Vec<u8>,
    /// Sides of the lit squares; 0 is a dark reading.
    pub squares_px: Vec<u32>,
    /// Times that all of it is measured: series.
    pub series: usize,
    /// Whether white is measured too.
    pub white: bool,
    /// Between readings, s.
    pub interval_s: f64,
    /// The bench's temperature.
    pub temperature: TemperatureProfile,
    /// The meter's noise, W.
    pub noise_w: f64,
    /// Scatter of readings of the same light.
    pub repeatability: f64,
    /// Area of the meter's detector, m^2 (Thorlabs S130C: 9.5 mm across).
    pub meter_area_m2: f64,
}

impl Default for PowerOptions {
    fn default() -> Self {
        Self {
            // The lowest tell gamma, black and zero apart, where the square is large.
            counts: [4, 8, 12].into_iter().chain((1..=16).map(|k| (k * 16).min(255) as u8)).collect(),
            squares_px: vec![0, 50, 100, 200, 600],
            series: 2,
            white: true,
            interval_s: 10.0,
            temperature: TemperatureProfile::Constant,
            noise_w: 5e-12,
            repeatability: 0.002,
            meter_area_m2: std::f64::consts::PI / 4.0 * 9.5e-3 * 9.5e-3,
        }
    }
}

/// The meter's readings of a campaign; all of each series in one order.
///
/// # Errors
/// The bench cannot be built.
pub fn simulate_power(facility: &Facility, options: &PowerOptions) -> Result<PowerTable, BenchError> {
    let bench = facility.bench(OpticsDetail { nodes: [3, 3], lines: 3, half_px: 8 })?;
    let screen_px = f64::from(facility.setup.screen.width_px) * f64::from(facility.setup.screen.height_px);
    let full_w_m2 = channel_irradiance_w_m2(&bench);
    let largest_px = options.squares_px.iter().map(|n| f64::from(n * n)).fold(0.0, f64::max);
    let brightest_w_m2 = full_w_m2.iter().sum::<f64>() * largest_px;
    let mut meter =
        Meter { facility, options, bench: &bench, screen_px, full_w_m2, brightest_w_m2, dose_h: 0.0 };
    let mut random = ChaCha8Rng::seed_from_u64(facility.seed ^ 0x0070_6f77_6572);
    let mut rows: Vec<PowerRow> = Vec::new();
    for series in 0..options.series {
        let name: Arc<str> = Arc::from(format!("s{series}"));
        for &square_px in &options.squares_px {
            for channel in Channel::ALL.into_iter().filter(|c| options.white || *c != Channel::W) {
                // A dark reading is one, whatever the count.
                let counts: &[u8] = if square_px == 0 { &[0] } else { &options.counts };
                for &count in counts {
                    let time_s = rows.len() as f64 * options.interval_s;
                    let light = meter.reading_w_m2(channel, count, square_px, time_s, series);
                    let sigma =
                        (options.noise_w / options.meter_area_m2).hypot(options.repeatability * light.abs());
                    let noise: f64 = StandardNormal.sample(&mut random);
                    rows.push(PowerRow {
                        channel,
                        digital_count: f64::from(count),
                        square_px: f64::from(square_px),
                        irradiance_w_m2: light + sigma * noise,
                        sigma_w_m2: Some(sigma),
                        time_s: Some(time_s),
                        temperature_c: Some(options.temperature.at_c(time_s)),
                        series: Some(name.clone()),
                        file: 0,
                        line: 0,
                    });
                }
            }
        }
    }
    Ok(PowerTable { rows, ..PowerTable::default() })
}

/// The meter in front of the bench.
struct Meter<'a> {
    facility: &'a Facility,
    options: &'a PowerOptions,
    bench: &'a Bench,
    screen_px: f64,
    /// Of one pixel's red, green, blue at 255.
    full_w_m2: [f64; 3],
    /// The brightest reading of the campaign.
    brightest_w_m2: f64,
    /// What the display has shone so far, hours of full white.
    dose_h: f64,
}

impl Meter<'_> {
    /// What it shows, without noise.
    fn reading_w_m2(
        &mut self,
        channel: Channel,
        count: u8,
        square_px: u32,
        time_s: f64,
        series: usize,
    ) -> f64 {
        let errors = &self.facility.light;
        let gamma = errors.gamma.unwrap_or(self.facility.setup.response_gamma());
        let black = errors.black_level.unwrap_or(self.facility.setup.optics.black_level);
        let level = (f64::from(count) / 255.0).powf(gamma) * (1.0 - black) + black;
        let lit_px = square_light(self.bench, square_px);
        let mut light = 0.0;
        for (c, full) in self.full_w_m2.into_iter().enumerate() {
            let drive = if channel.lit().contains(&c) { level } else { black };
            // Black shines over the whole screen that the meter sees, the square above it.
            light += full
                * ((drive - black) * lit_px + black * self.screen_px)
                * (1.0 + errors.meter_by_channel[c]);
        }
        let share = f64::from(square_px * square_px) / self.screen_px * channel.lit().len() as f64 / 3.0;
        light *= 1.0 - errors.square_loading * share * level;
        if square_px > 0 {
            // Pixels inside have four lit neighbours, those of the rim three, of the corners two.
            let n = f64::from(square_px);
            light *= 1.0 + errors.pixel_crosstalk * (n - 1.0) / n;
        }
        light *= 1.0 + errors.self_heating * (1.0 - (-time_s / 1200.0).exp());
        light *= 1.0 - errors.ageing_per_1000_h * self.dose_h / 1000.0;
        self.dose_h += self.options.interval_s / 3600.0 * level;
        if channel == Channel::W {
            light *= 1.0 - errors.channel_nonadditivity;
        }
        light *= 1.0 + errors.meter_nonlinearity * light / self.brightest_w_m2;
        if let Some(factor) = errors.attenuator_of_last_series
            && series + 1 == self.options.series
        {
            light *= factor;
        }
        light + errors.meter_zero_w / self.options.meter_area_m2
    }
}

/// Irradiance at the pupil of one pixel's channel at 255 on the axis, W m^-2: a third of eq. 10's effective
/// irradiance over the channel's mean efficiency.
fn channel_irradiance_w_m2(bench: &Bench) -> [f64; 3] {
    let efficiency = bench.sensor().efficiency();
    let white = retina_radiometry::irradiance_of_magnitude_w_m2_nm(bench.setup().brightest_magnitude())
        * efficiency.bandwidth_nm();
    let lines = retina_bench::channel_lines(bench.setup(), efficiency, 5);
    // Lines' shares are of electrons; of light, they are those over the efficiency.
    lines.map(|lines| {
        let light: f64 = lines.iter().map(|(nm, share)| share / efficiency.relative(*nm)).sum();
        white / 3.0 * light
    })
}

/// Pixels of a lit square in the middle of the screen, weighed by their light on the axis.
fn square_light(bench: &Bench, square_px: u32) -> f64 {
    if square_px == 0 {
        return 0.0;
    }
    let display = bench.display();
    let middle = display.size_px.map(|size| f64::from(size) / 2.0);
    // The light's fall is a parabola about the axis: five places hold its mean (to fourth order).
    let half = f64::from(square_px) / 2.0 / 3f64.sqrt();
    let at = |x: f64, y: f64| {
        let place = display.mm([middle[0] + x * half, middle[1] + y * half]);
        bench.optics().land(place, 1).map_or(0.0, |(_, light)| light)
    };
    let mean = (at(-1.0, -1.0) + at(1.0, -1.0) + at(-1.0, 1.0) + at(1.0, 1.0)) / 4.0;
    f64::from(square_px * square_px) * mean
}
