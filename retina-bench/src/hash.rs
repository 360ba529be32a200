//! Fixed patterns: a number for each place that is the same whenever it is asked for.

/// SplitMix64's finaliser (G. Steele et al., "Fast splittable pseudorandom number generators", OOPSLA 2014).
pub(crate) fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Uniform in [0, 1).
pub(crate) fn uniform(seed: u64, place: u64) -> f64 {
    (mix(seed ^ mix(place)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Nearly normal, of mean 0 and variance 1: the sum of four uniform numbers, so never beyond 3.46.
pub(crate) fn normal(seed: u64, place: u64) -> f64 {
    let bits = mix(seed ^ mix(place));
    let sum: u64 = (0..4).map(|k| (bits >> (16 * k)) & 0xffff).sum();
    (sum as f64 / 65_535.0 - 2.0) * 3f64.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_of_the_patterns() {
        let count = 200_000u64;
        let mean = |f: &dyn Fn(u64) -> f64| (0..count).map(f).sum::<f64>() / count as f64;
        assert!(mean(&|i| normal(7, i)).abs() < 0.01);
        assert!((mean(&|i| normal(7, i).powi(2)) - 1.0).abs() < 0.01);
        assert!((mean(&|i| uniform(7, i)) - 0.5).abs() < 0.003);
        assert_ne!(normal(7, 3), normal(8, 3));
    }
}
