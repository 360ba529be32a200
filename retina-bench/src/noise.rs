//! Random numbers of one row of an exposure.

use rand_distr::{Distribution, Poisson, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

/// Means from here on are drawn by rejection; below, by going through the counts one by one.
const MANY: f32 = 8.0;

/// A stream of shot and read noise.
#[derive(Debug, Clone)]
pub(crate) struct Noise(Xoshiro256PlusPlus);

impl Noise {
    pub(crate) fn new(seed: u64) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    /// Uniform in [0, 1).
    fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A normal number of mean 0 and variance 1.
    pub(crate) fn normal(&mut self) -> f32 {
        StandardNormal.sample(&mut self.0)
    }

    /// A Poisson number of this mean; 0 where the mean is not positive.
    #[inline]
    pub(crate) fn poisson(&mut self, mean: f32) -> f32 {
        if mean.is_nan() || mean <= 0.0 {
            return 0.0;
        }
        if mean >= MANY {
            // Only a mean beyond 1e19 is refused: the pixel is full.
            return Poisson::new(f64::from(mean)).map_or(mean, |counts| counts.sample(&mut self.0) as f32);
        }
        // By inversion; of dark pixels mostly 0 at once: exp(-m) is no less than 1 - m + m^2/2 - m^3/6.
        let mean = f64::from(mean);
        let mut left = self.uniform();
        if left < 1.0 - mean * (1.0 - mean / 2.0 * (1.0 - mean / 3.0)) {
            return 0.0;
        }
        let (mut count, mut share) = (0.0, (-mean).exp());
        while left >= share && count < 100.0 {
            left -= share;
            count += 1.0;
            share *= mean / count;
        }
        count as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and variance of a Poisson number are its parameter; so is its third central moment.
    #[test]
    fn moments_of_the_shot_noise() {
        let mut noise = Noise::new(5);
        for mean in [0.03, 0.6, 4.0, 7.9, 700.0] {
            let count = 400_000;
            let values: Vec<f64> = (0..count).map(|_| f64::from(noise.poisson(mean as f32))).collect();
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

    /// Rows next to each other have nothing in common.
    #[test]
    fn streams_are_independent() {
        let row = |y: u64| -> Vec<f32> {
            let mut noise = Noise::new(crate::hash::mix(y));
            (0..100_000).map(|_| noise.normal()).collect()
        };
        let (a, b) = (row(0), row(1));
        let product = a.iter().zip(&b).map(|(a, b)| a * b).sum::<f32>() / a.len() as f32;
        assert!(product.abs() < 0.016, "{product}");
        assert!((a.iter().map(|v| v * v).sum::<f32>() / a.len() as f32 - 1.0).abs() < 0.025);
    }
}
