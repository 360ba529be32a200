//! Random numbers of one row of an exposure, many at a time.
//!
//! Sixteen generators run side by side, so that the compiler makes vectors of them. The arithmetic is the same with any
//! vector instructions, to the bit.

use std::f32::consts::{FRAC_1_SQRT_2, LN_2};

use retina_simd::{floor, sine_and_cosine, whole_number};

use crate::hash;

/// Means from here on are drawn by an expansion; below, by going through the counts one by one.
const MANY: f32 = 10.0;

/// Generators side by side.
const LANES: usize = 16;

type Lanes = [u32; LANES];
type Lane = [f32; LANES];

/// Xoshiro128++ (D. Blackman and S. Vigna, "Scrambled linear pseudorandom number generators", ACM TOMS 47(4), 36,
/// 2021), one a lane.
#[derive(Debug, Clone)]
struct Generators([Lanes; 4]);

impl Generators {
    fn new(seed: u64) -> Self {
        let word = |i: usize, lane: usize| hash::mix(seed ^ hash::mix((i * LANES + lane) as u64)) as u32;
        Self(std::array::from_fn(|i| std::array::from_fn(|lane| word(i, lane))))
    }

    #[inline(always)]
    fn next(&mut self) -> Lanes {
        let [a, b, c, d] = &mut self.0;
        let mut out = [0; LANES];
        for k in 0..LANES {
            out[k] = a[k].wrapping_add(d[k]).rotate_left(7).wrapping_add(a[k]);
            let shifted = b[k] << 9;
            c[k] ^= a[k];
            d[k] ^= b[k];
            b[k] ^= c[k];
            a[k] ^= d[k];
            c[k] ^= shifted;
            d[k] = d[k].rotate_left(11);
        }
        out
    }
}

/// A stream of shot and read noise.
#[derive(Debug, Clone)]
pub(crate) struct Noise {
    lanes: Generators,
}

impl Noise {
    pub(crate) fn new(seed: u64) -> Self {
        Self { lanes: Generators::new(seed) }
    }

    /// Fills `out` with normal numbers of mean 0 and variance 1, by G. Box and M. Muller's method (1958). None lies
    /// beyond 6.7: the uniform numbers have 32 bits.
    #[inline(always)]
    pub(crate) fn normals(&mut self, out: &mut [f32]) {
        for out in out.chunks_mut(2 * LANES) {
            let (u, v) = (self.lanes.next(), self.lanes.next());
            let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
            for k in 0..LANES {
                let radius = radius(u[k]);
                let (sine, cosine) = sine_and_cosine(turns(v[k]));
                first[k] = radius * cosine;
                second[k] = radius * sine;
            }
            let split = out.len().min(LANES);
            let rest = out.len() - split;
            out[..split].copy_from_slice(&first[..split]);
            out[split..].copy_from_slice(&second[..rest]);
        }
    }

    /// Replaces means by Poisson numbers of them; 0 where a mean is not positive.
    #[inline(always)]
    pub(crate) fn poisson(&mut self, means: &mut [f32]) {
        for means in means.chunks_mut(LANES) {
            let mut lanes = [0.0; LANES];
            lanes[..means.len()].copy_from_slice(means);
            let first = self.lanes.next();
            let many = lanes.iter().fold(0, |any, &m| any | u32::from(m >= MANY));
            if many == 0 {
                few(&mut lanes, &first);
            } else {
                self.many(&mut lanes, &first);
            }
            means.copy_from_slice(&lanes[..means.len()]);
        }
    }

    /// As [`Noise::poisson`], where some means are not small: a normal number through the expansion of the Poisson
    /// distribution's quantiles (M. B. Giles, "Algorithm 955: approximation of the inverse Poisson cumulative distribution
    /// function", ACM TOMS 42(1), 7, 2016, there Q_N2 and the term after it):
    /// m + m^1/2 z + (1/3 + z^2/6) - m^-1/2 (z/36 + z^3/72) + m^-1 (-8/405 + 7 z^2/810 + z^4/270), rounded down.
    #[inline(always)]
    fn many(&mut self, means: &mut Lane, first: &Lanes) {
        let second = self.lanes.next();
        let mut small = [0.0; LANES];
        for k in 0..LANES {
            small[k] = if means[k] < MANY { means[k] } else { 0.0 };
        }
        few(&mut small, first);
        for k in 0..LANES {
            let m = means[k];
            let (_, cosine) = sine_and_cosine(turns(second[k]));
            let z = radius(first[k]) * cosine;
            let (z2, root) = (z * z, if m > MANY { m } else { MANY }.sqrt());
            let third = -z * (1.0 / 36.0 + z2 * (1.0 / 72.0));
            let fourth = -8.0 / 405.0 + z2 * (7.0 / 810.0 + z2 * (1.0 / 270.0));
            let place = m + root * z + (1.0 / 3.0 + z2 * (1.0 / 6.0)) + (third + fourth / root) / root;
            let counts = floor(place);
            let counts = if counts > 0.0 { counts } else { 0.0 };
            means[k] = if m >= MANY { counts } else { small[k] };
        }
    }
}

/// Poisson numbers of means below [`MANY`], by going through the counts one by one.
#[inline(always)]
fn few(means: &mut Lane, random: &Lanes) {
    let (mut left, mut share, mut counts) = ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
    let mut open = 0;
    for k in 0..LANES {
        // No light, or none known: the first count takes all.
        let mean = if means[k] > 0.0 { means[k] } else { 0.0 };
        means[k] = mean;
        left[k] = uniform(random[k]);
        share[k] = exp_of_minus(mean);
        open |= u32::from(left[k] >= share[k]);
    }
    // Beyond it nothing is left of a uniform number of 23 bits.
    const LAST: u16 = 40;
    for count in 1..=LAST {
        if open == 0 {
            break;
        }
        let inverse = 1.0 / f32::from(count);
        open = 0;
        for k in 0..LANES {
            let more = left[k] >= share[k];
            left[k] -= if more { share[k] } else { 0.0 };
            counts[k] += if more { 1.0 } else { 0.0 };
            share[k] *= if more { means[k] * inverse } else { 1.0 };
            open |= u32::from(left[k] >= share[k]);
        }
    }
    *means = counts;
}

/// A number between 0 and 1, neither of them, of 23 bits.
#[inline(always)]
fn uniform(random: u32) -> f32 {
    ((random >> 9) as f32 + 0.5) * 2f32.powi(-23)
}

/// exp(-x) for x from 0 to 80, to 2e-7 of it: a power of two, and the series of the rest.
#[inline(always)]
fn exp_of_minus(x: f32) -> f32 {
    let halvings = whole_number(x * std::f32::consts::LOG2_E);
    let whole = halvings as f32;
    // ln 2 in two parts, so that the difference keeps its digits.
    let rest = (whole * 0.693_359_4 - x) - whole * 2.121_944_4e-4;
    let series = 1.0
        + rest
            * (1.0
                + rest
                    * (1.0 / 2.0
                        + rest * (1.0 / 6.0 + rest * (1.0 / 24.0 + rest * (1.0 / 120.0 + rest / 720.0)))));
    series * f32::from_bits(127u32.wrapping_sub(halvings) << 23)
}

/// A part of the full turn, -1/2 to 1/2.
#[inline(always)]
fn turns(random: u32) -> f32 {
    random.cast_signed() as f32 * 2f32.powi(-32)
}

/// A normal number's distance from 0 in Box and Muller's plane.
#[inline(always)]
fn radius(random: u32) -> f32 {
    (-2.0 * ln((random as f32 + 0.5) * 2f32.powi(-32))).sqrt()
}

/// Natural logarithm of a positive normal number, to 1e-7 of it or of 1: exponent, and the series of
/// ln m = 2 artanh((m - 1) / (m + 1)) for m within sqrt(1/2) to sqrt(2).
#[inline(always)]
fn ln(x: f32) -> f32 {
    let bits = x.to_bits().wrapping_sub(FRAC_1_SQRT_2.to_bits());
    let exponent = (bits as i32) >> 23;
    let m = f32::from_bits((bits & 0x007f_ffff).wrapping_add(FRAC_1_SQRT_2.to_bits()));
    let t = (m - 1.0) / (m + 1.0);
    let t2 = t * t;
    let series = 2.0 + t2 * (2.0 / 3.0 + t2 * (2.0 / 5.0 + t2 * (2.0 / 7.0 + t2 * (2.0 / 9.0))));
    exponent as f32 * LN_2 + t * series
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and variance of a Poisson number are its parameter; so is its third central moment.
    #[test]
    fn moments_of_the_shot_noise() {
        let mut noise = Noise::new(5);
        for mean in [0.03, 0.6, 4.0, 9.9, 10.1, 30.0, 700.0, 2e4] {
            let count = 400_000;
            let mut values = vec![mean as f32; count];
            noise.poisson(&mut values);
            let count = count as f64;
            let average = values.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
            let moment = |p: i32| values.iter().map(|&v| (f64::from(v) - mean).powi(p)).sum::<f64>() / count;
            let sigma = (mean / count).sqrt();
            assert!((average - mean).abs() < 5.0 * sigma, "{mean}: {average}");
            assert!((moment(2) / mean - 1.0).abs() < 0.05, "{mean}: {}", moment(2));
            if mean < 10.0 {
                assert!((moment(3) / mean - 1.0).abs() < 0.2, "{mean}: {}", moment(3));
            }
        }
    }

    /// Each count of a Poisson number comes as often as its formula says, also where most are 0 at once.
    #[test]
    fn frequencies_of_the_shot_noise() {
        let count = 2_000_000;
        for mean in [0.001f64, 0.05, 0.9, 2.5] {
            let mut values = vec![mean as f32; count];
            Noise::new(11).poisson(&mut values);
            let mut expected = (-mean).exp() * count as f64;
            for k in 0..4u32 {
                let found = values.iter().filter(|&&v| v == k as f32).count() as f64;
                assert!(
                    (found - expected).abs() < 5.0 * expected.sqrt().max(1.0),
                    "{mean}, {k}: {found}, {expected}"
                );
                expected *= mean / f64::from(k + 1);
            }
        }
    }

    /// So it does of larger means, about the mean and in the tails.
    #[test]
    fn frequencies_of_many_counts() {
        let count = 4_000_000;
        let ln_factorial = |k: f64| (2..=k as u32).map(|i| f64::from(i).ln()).sum::<f64>();
        for mean in [10.0f64, 23.7, 400.0] {
            let mut values = vec![mean as f32; count];
            Noise::new(17).poisson(&mut values);
            let sigma = mean.sqrt();
            for place in [-3.0, -1.5, -0.5, 0.0, 0.7, 2.0, 3.5] {
                let k = (mean + place * sigma).round();
                let expected = (k * mean.ln() - mean - ln_factorial(k)).exp() * count as f64;
                let found = values.iter().filter(|&&v| f64::from(v) == k).count() as f64;
                assert!((found - expected).abs() < 5.0 * expected.sqrt(), "{mean}, {k}: {found}, {expected}");
            }
        }
    }

    struct Drawn<'a>(&'a mut [f32]);

    impl retina_simd::Kernel for Drawn<'_> {
        type Output = ();

        #[inline(always)]
        fn run(self) {
            let mut noise = Noise::new(29);
            let (counts, normals) = self.0.split_at_mut(self.0.len() / 2);
            noise.poisson(counts);
            noise.normals(normals);
        }
    }

    /// All vector instructions give the same bits.
    #[test]
    fn the_same_noise_on_every_processor() {
        let drawn = |level: retina_simd::Level| {
            let mut values: Vec<f32> = (0..4000u16).map(|i| f32::from(i).powi(2) * 1e-4).collect();
            level.run(Drawn(&mut values));
            values.iter().map(|value| value.to_bits()).collect::<Vec<u32>>()
        };
        let portable = drawn(retina_simd::Level::PORTABLE);
        for level in retina_simd::InstructionSet::ALL.into_iter().filter_map(retina_simd::Level::of) {
            assert!(drawn(level) == portable, "{}", level.set().name());
        }
    }

    /// Nothing comes of no light, of less, or of none known.
    #[test]
    fn no_light_no_counts() {
        let mut values = [0.0, -3.0, f32::NAN, -0.0];
        Noise::new(1).poisson(&mut values);
        assert_eq!(values, [0.0; 4]);
    }

    /// Moments of a normal number, and the shares beyond 1, 3 and 4.5 sigma (2 (1 - Phi)).
    #[test]
    fn moments_and_tails_of_the_read_noise() {
        let count = 10_000_000;
        let mut values = vec![0f32; count];
        Noise::new(7).normals(&mut values);
        let moment = |p: i32| values.iter().map(|&v| f64::from(v).powi(p)).sum::<f64>() / count as f64;
        for (power, expected, slack) in [(1, 0.0, 0.0015), (2, 1.0, 0.0025), (3, 0.0, 0.006), (4, 3.0, 0.016)]
        {
            assert!((moment(power) - expected).abs() < slack, "{power}: {}", moment(power));
        }
        for (beyond, share) in [(1.0, 0.317_310_5), (3.0, 2.699_8e-3), (4.5, 6.795e-6)] {
            let found = values.iter().filter(|v| v.abs() > beyond).count() as f64;
            let expected = share * count as f64;
            assert!((found - expected).abs() < 5.0 * expected.sqrt(), "{beyond}: {found}, {expected}");
        }
        let product: f64 = values.windows(2).map(|v| f64::from(v[0] * v[1])).sum();
        assert!((product / count as f64).abs() < 0.0016, "{product}");
    }

    #[test]
    fn functions_are_as_exact_as_they_say() {
        for k in 1..100_000u32 {
            let x = k as f32 * 1.7e-5;
            let exact = f64::from(x).ln();
            assert!((f64::from(ln(x)) - exact).abs() < 2e-7 * exact.abs().max(1.0), "{x}");
            let x = x * 10.0;
            let exact = f64::from(-x).exp();
            assert!((f64::from(exp_of_minus(x)) - exact).abs() < 3e-7 * exact, "{x}");
        }
    }

    /// Rows next to each other have nothing in common.
    #[test]
    fn streams_are_independent() {
        let row = |y: u64| -> Vec<f32> {
            let mut values = vec![0.0; 100_000];
            Noise::new(hash::mix(y)).normals(&mut values);
            values
        };
        let (a, b) = (row(0), row(1));
        let product = a.iter().zip(&b).map(|(a, b)| a * b).sum::<f32>() / a.len() as f32;
        assert!(product.abs() < 0.016, "{product}");
        assert!((a.iter().map(|v| v * v).sum::<f32>() / a.len() as f32 - 1.0).abs() < 0.025);
    }
}
