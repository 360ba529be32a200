//! `power.csv` from the bench: squares of the screen in front of a power meter.

use std::fmt::Write as _;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use retina_bench::{Bench, BenchError, OpticsDetail};

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

/// A reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PowerReading {
    /// `r`, `g`, `b` or `w`.
    pub channel: char,
    /// Digital count.
    pub digital_count: u8,
    /// Side of the lit square.
    pub square_px: u32,
    /// W m^-2 at the camera's pupil.
    pub irradiance_w_m2: f64,
    /// Its standard deviation.
    pub sigma_w_m2: f64,
    /// When, s.
    pub time_s: f64,
    /// Temperature, degC.
    pub temperature_c: f64,
    /// Which series.
    pub series: usize,
}

/// The meter's readings of a campaign; all of each series in one order.
///
/// # Errors
/// The bench cannot be built.
pub fn simulate_power(facility: &Facility, options: &PowerOptions) -> Result<Vec<PowerReading>, BenchError> {
    let bench = facility.bench(OpticsDetail { nodes: [3, 3], lines: 3, half_px: 8 })?;
    let of = |id: &str| facility.effect(id).map(|effect| effect.value());
    let gamma = of("gamma").unwrap_or(facility.setup.response_gamma());
    let black = of("black_level").unwrap_or(facility.setup.optics.black_level);
    let level = |b: u8| (f64::from(b) / 255.0).powf(gamma) * (1.0 - black) + black;
    let full = channel_irradiance_w_m2(&bench);
    let meter_nm =
        facility.effect("meter_wavelength").map(|effect| effect.values.clone()).unwrap_or_default();
    let screen_px = f64::from(facility.setup.screen.width_px) * f64::from(facility.setup.screen.height_px);
    let brightest =
        full.iter().sum::<f64>() * options.squares_px.iter().map(|n| f64::from(n * n)).fold(0.0, f64::max);
    let mut random = ChaCha8Rng::seed_from_u64(facility.seed ^ 0x0070_6f77_6572);
    let mut readings = Vec::new();
    let mut dose_h = 0.0;
    for series in 0..options.series {
        for &square_px in &options.squares_px {
            for channel in ['r', 'g', 'b', 'w'].into_iter().filter(|c| options.white || *c != 'w') {
                // A dark reading is one, whatever the count.
                let counts: &[u8] = if square_px == 0 { &[0] } else { &options.counts };
                for &digital_count in counts {
                    let time_s = readings.len() as f64 * options.interval_s;
                    let lit = square_light(&bench, square_px);
                    let mut light = 0.0;
                    for (c, name) in ['r', 'g', 'b'].into_iter().enumerate() {
                        let on = channel == name || channel == 'w';
                        let drive = if on { level(digital_count) } else { black };
                        // Black shines over the whole screen that the meter sees, the square above it.
                        light += full[c]
                            * ((drive - black) * lit + black * screen_px)
                            * (1.0 + meter_nm.get(c).copied().unwrap_or(0.0));
                    }
                    let share = f64::from(square_px * square_px) / screen_px
                        * if channel == 'w' { 1.0 } else { 1.0 / 3.0 };
                    if let Some(loss) = of("square_loading") {
                        light *= 1.0 - loss * share * level(digital_count);
                    }
                    if let (Some(lent), true) = (of("pixel_crosstalk"), square_px > 0) {
                        // Pixels inside have four lit neighbours, those of the rim three, of the corners two.
                        let n = f64::from(square_px);
                        light *= 1.0 + lent * (n - 1.0) / n;
                    }
                    if let Some(rise) = of("self_heating") {
                        light *= 1.0 + rise * (1.0 - (-time_s / 1200.0).exp());
                    }
                    if let Some(loss) = of("ageing") {
                        light *= 1.0 - loss * dose_h / 1000.0;
                        dose_h += options.interval_s / 3600.0 * level(digital_count);
                    }
                    if let (Some(loss), 'w') = (of("channel_nonadditivity"), channel) {
                        light *= 1.0 - loss;
                    }
                    if let Some(excess) = of("meter_nonlinearity") {
                        light *= 1.0 + excess * light / brightest;
                    }
                    if let (Some(factor), true) = (of("attenuator_not_changed"), series + 1 == options.series)
                    {
                        light *= factor;
                    }
                    light += of("meter_zero").unwrap_or(0.0) / options.meter_area_m2;
                    let sigma =
                        (options.noise_w / options.meter_area_m2).hypot(options.repeatability * light.abs());
                    let noise: f64 = StandardNormal.sample(&mut random);
                    readings.push(PowerReading {
                        channel,
                        digital_count,
                        square_px,
                        irradiance_w_m2: light + sigma * noise,
                        sigma_w_m2: sigma,
                        time_s,
                        temperature_c: options.temperature.at_c(time_s),
                        series,
                    });
                }
            }
        }
    }
    Ok(readings)
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

impl PowerReading {
    /// The readings as `power.csv`.
    pub fn csv(readings: &[Self]) -> String {
        let mut text = String::from(
            "channel,digital_count,square_px,irradiance_w_m2,sigma_w_m2,time_s,temperature_c,series\n",
        );
        for r in readings {
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{},{},{},{:e},{:e},{},{},s{}",
                r.channel,
                r.digital_count,
                r.square_px,
                r.irradiance_w_m2,
                r.sigma_w_m2,
                r.time_s,
                r.temperature_c,
                r.series
            );
        }
        text
    }
}
