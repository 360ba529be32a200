//! The sensor: light to electrons to digital numbers.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, Poisson, StandardNormal};
use rayon::prelude::*;
use retina_geometry::Setup;
use retina_radiometry::QuantumEfficiency;

use crate::{Imperfections, hash};

/// Dark current doubles over so many kelvin.
const DARK_DOUBLING_K: f64 = 6.5;
/// Temperature of the stated dark current, degC.
const DARK_REFERENCE_C: f64 = 20.0;

/// A sensor with its own fixed patterns.
#[derive(Debug, Clone)]
pub struct Sensor {
    size_px: [usize; 2],
    efficiency: QuantumEfficiency,
    /// Electrons a digital number.
    pub gain_e_per_dn: f64,
    full_well_e: f64,
    read_noise_e: f64,
    offset_dn: f64,
    largest_dn: f64,
    /// Response of each pixel, 1 on average.
    response: Vec<f32>,
    /// Offset of each pixel, electrons.
    offset_e: Vec<f32>,
    /// Dark current of each pixel at 20 degC, electrons a second.
    dark_e_s: Vec<f32>,
    nonlinearity: f64,
    blooming: f64,
    stray_e_s: [f64; 3],
}

impl Sensor {
    /// The setup's sensor; `seed` fixes its patterns.
    pub fn new(setup: &Setup, wrong: &Imperfections, seed: u64) -> Self {
        let noise = &setup.noise;
        let size_px = [setup.camera.width_px as usize, setup.camera.height_px as usize];
        let largest_dn = 2f64.powi(setup.camera.bits as i32) - 1.0;
        let count = (size_px[0] * size_px[1]) as u64;
        let pattern = |f: &(dyn Fn(u64) -> f64 + Sync)| -> Vec<f32> {
            (0..count).into_par_iter().map(|i| f(i) as f32).collect()
        };
        let dark = |i: u64| {
            if hash::uniform(seed ^ 0x686f_7400, i) < noise.hot_pixels {
                noise.dark_e_s * 10f64.powf(2.0 + 2.0 * hash::uniform(seed ^ 0x686f_7401, i))
            } else {
                noise.dark_e_s
            }
        };
        let efficiency = match &noise.quantum_efficiency {
            None => QuantumEfficiency::paper_camera(),
            Some(rows) => QuantumEfficiency::new(rows.clone()),
        };
        Self {
            size_px,
            efficiency,
            gain_e_per_dn: noise
                .gain_e_per_dn
                .unwrap_or(noise.full_well_e / (largest_dn - noise.offset_dn).max(1.0)),
            full_well_e: noise.full_well_e,
            read_noise_e: noise.read_noise_e,
            offset_dn: noise.offset_dn,
            largest_dn,
            response: pattern(&|i| 1.0 + noise.prnu * hash::normal(seed ^ 0x7072_6e75, i)),
            offset_e: pattern(&|i| noise.dsnu_e * hash::normal(seed ^ 0x6473_6e75, i)),
            dark_e_s: pattern(&dark),
            nonlinearity: wrong.nonlinearity,
            blooming: wrong.blooming,
            stray_e_s: wrong.stray_e_s,
        }
    }

    /// Its quantum efficiency.
    pub fn efficiency(&self) -> &QuantumEfficiency {
        &self.efficiency
    }

    /// Charge at which a pixel is full, electrons.
    pub fn full_well_e(&self) -> f64 {
        self.full_well_e
    }

    /// Digital number at which a pixel is full or the digitiser ends.
    pub fn saturation_dn(&self) -> f64 {
        let full = self.full_well_e * (1.0 + self.nonlinearity) / self.gain_e_per_dn + self.offset_dn;
        full.min(self.largest_dn)
    }

    /// Largest digital number.
    pub fn largest_dn(&self) -> u16 {
        self.largest_dn as u16
    }

    /// Digital numbers of an exposure in which the light makes these mean electrons. The noise depends on
    /// `seed` and `frame` alone.
    pub fn read(
        &self,
        light_e: &[f32],
        exposure_s: f64,
        temperature_c: f64,
        seed: u64,
        frame: u64,
    ) -> Vec<u16> {
        let [width, height] = self.size_px;
        let warm = exposure_s * 2f64.powf((temperature_c - DARK_REFERENCE_C) / DARK_DOUBLING_K);
        let mut dn = vec![0u16; width * height];
        let [stray, along_x, along_y] = self.stray_e_s.map(|e| e * exposure_s);
        let exposed = |y: usize, random: &mut ChaCha8Rng| -> Vec<f64> {
            let fy = 2.0 * (y as f64 + 0.5) / height as f64 - 1.0;
            (0..width)
                .map(|x| {
                    let i = y * width + x;
                    let fx = 2.0 * (x as f64 + 0.5) / width as f64 - 1.0;
                    let stray = (stray + along_x * fx + along_y * fy).max(0.0);
                    let mean = (f64::from(light_e[i]) + stray) * f64::from(self.response[i])
                        + f64::from(self.dark_e_s[i]) * warm;
                    poisson(mean, random)
                })
                .collect()
        };
        let key = hash::mix(seed ^ hash::mix(frame));
        let row_random = |y: usize| {
            let mut random = ChaCha8Rng::seed_from_u64(key);
            random.set_stream(y as u64);
            random
        };
        let digitise = |charge: f64, i: usize, random: &mut ChaCha8Rng| {
            let linear = charge.min(self.full_well_e);
            let bent = linear * (1.0 + self.nonlinearity * linear / self.full_well_e);
            let read: f64 = StandardNormal.sample(random);
            let volts = bent + f64::from(self.offset_e[i]) + self.read_noise_e * read;
            (volts / self.gain_e_per_dn + self.offset_dn).round().clamp(0.0, self.largest_dn) as u16
        };
        if self.blooming == 0.0 {
            dn.par_chunks_exact_mut(width).enumerate().for_each(|(y, row)| {
                let mut random = row_random(y);
                let charge = exposed(y, &mut random);
                for (x, (dn, charge)) in row.iter_mut().zip(charge).enumerate() {
                    *dn = digitise(charge, y * width + x, &mut random);
                }
            });
            return dn;
        }
        // Charge above full well runs along the column: all rows first.
        let (mut charge, mut randoms): (Vec<Vec<f64>>, Vec<ChaCha8Rng>) = (0..height)
            .into_par_iter()
            .map(|y| {
                let mut random = row_random(y);
                (exposed(y, &mut random), random)
            })
            .unzip();
        for x in 0..width {
            self.bloom(&mut charge, x);
        }
        dn.par_chunks_exact_mut(width).zip(charge).zip(&mut randoms).enumerate().for_each(
            |(y, ((row, charge), random))| {
                for (x, (dn, charge)) in row.iter_mut().zip(charge).enumerate() {
                    *dn = digitise(charge, y * width + x, random);
                }
            },
        );
        dn
    }

    /// Half of what a pixel cannot hold, times `blooming`, goes up the column and half down, until it finds
    /// room.
    fn bloom(&self, charge: &mut [Vec<f64>], x: usize) {
        for downwards in [true, false] {
            let mut carried = 0.0;
            for k in 0..charge.len() {
                let y = if downwards { k } else { charge.len() - 1 - k };
                let own = charge[y][x];
                let excess = (own - self.full_well_e).max(0.0);
                let room = (self.full_well_e - own).max(0.0);
                let taken = room.min(carried);
                charge[y][x] = own + taken;
                carried = carried - taken + 0.5 * self.blooming * excess;
            }
        }
    }
}

/// A Poisson number of this mean.
fn poisson(mean: f64, random: &mut ChaCha8Rng) -> f64 {
    if mean <= 0.0 {
        return 0.0;
    }
    if mean < 1.0 {
        // By inversion; mostly 0 at once.
        let mut left = (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        if left < 1.0 - mean {
            return 0.0;
        }
        let (mut count, mut share) = (0.0, (-mean).exp());
        while left >= share && count < 60.0 {
            left -= share;
            count += 1.0;
            share *= mean / count;
        }
        return count;
    }
    match Poisson::new(mean) {
        Ok(distribution) => distribution.sample(random),
        // Only a mean beyond 1e19 is refused: the pixel is full.
        Err(_) => mean,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and variance of a Poisson number are its parameter; so is its third central moment.
    #[test]
    fn moments_of_the_shot_noise() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for mean in [0.03, 0.6, 4.0, 700.0] {
            let count = 400_000;
            let values: Vec<f64> = (0..count).map(|_| poisson(mean, &mut random)).collect();
            let average = values.iter().sum::<f64>() / f64::from(count);
            let moment = |p: i32| values.iter().map(|v| (v - mean).powi(p)).sum::<f64>() / f64::from(count);
            let sigma = (mean / f64::from(count)).sqrt();
            assert!((average - mean).abs() < 5.0 * sigma, "{mean}: {average}");
            assert!((moment(2) / mean - 1.0).abs() < 0.05, "{mean}: {}", moment(2));
            if mean < 10.0 {
                assert!((moment(3) / mean - 1.0).abs() < 0.2, "{mean}: {}", moment(3));
            }
        }
    }
}
