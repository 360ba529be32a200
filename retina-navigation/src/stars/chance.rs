//! How likely it is that a wrong attitude would have matched as many stars.

/// Base-10 logarithm of the chance that at least `matched` of `points` hits fall by chance, each with probability `p`:
/// the upper tail of the binomial distribution. Points whose probabilities differ have a tail not larger than that of
/// their mean, where `matched` is above the expected number by one (Hoeffding 1956).
pub fn log10_binomial_tail(points: usize, matched: usize, p: f64) -> f64 {
    if matched == 0 || p >= 1.0 {
        return 0.0;
    }
    if matched > points || p <= 0.0 {
        return f64::NEG_INFINITY;
    }
    // ln C(n, k) p^k (1 - p)^(n - k), from k upwards: each term from the one before.
    let (n, k) = (points as f64, matched as f64);
    let mut ln_first = k * p.ln() + (n - k) * (-p).ln_1p();
    for i in 0..matched {
        ln_first += ((n - i as f64) / (i as f64 + 1.0)).ln();
    }
    let (mut sum, mut term) = (1.0, 1.0);
    for i in matched..points {
        let i = i as f64;
        term *= (n - i) / (i + 1.0) * p / (1.0 - p);
        sum += term;
    }
    ((ln_first + f64::ln(sum)) / std::f64::consts::LN_10).min(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_of_small_numbers_by_hand() {
        // Three throws of a coin: at least two heads 1/2, three heads 1/8.
        assert!((log10_binomial_tail(3, 2, 0.5) - 0.5f64.log10()).abs() < 1e-12);
        assert!((log10_binomial_tail(3, 3, 0.5) - 0.125f64.log10()).abs() < 1e-12);
        assert_eq!(log10_binomial_tail(3, 0, 0.1), 0.0);
        assert_eq!(log10_binomial_tail(3, 4, 0.1), f64::NEG_INFINITY);
        // scipy 1.17: binom.sf(9, 60, 0.004).
        let tail = 10f64.powf(log10_binomial_tail(60, 10, 0.004));
        assert!((tail / 6.590_067_149_560_43e-14 - 1.0).abs() < 1e-10, "{tail}");
    }
}
