//! Functions of one lane that become vector instructions. The language's own check for NaN, and for numbers that no integer
//! can hold. The compiler makes no vectors of these checks, and hot loops do not need them.

/// The smaller one; `b` where either is NaN.
#[inline(always)]
pub fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger one; `b` where either is NaN.
#[inline(always)]
pub fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// `value` held within `low` and `high`; `low` for NaN.
#[inline(always)]
pub fn clamp(value: f32, low: f32, high: f32) -> f32 {
    min(max(value, low), high)
}

/// The nearest whole number, for numbers up to 2^51.
#[inline(always)]
pub fn nearest(value: f64) -> f64 {
    // As below, for f64.
    const ROUNDER: f64 = 6_755_399_441_055_744.0;
    (value + ROUNDER) - ROUNDER
}

/// Numbers near it are whole. Adding it rounds, and leaves the whole number in the last bits.
const ROUNDER: f32 = 12_582_912.0;

/// The whole number below, for numbers up to four millions; beyond it may be off by a few.
#[inline(always)]
pub fn floor(value: f32) -> f32 {
    let whole = (value + ROUNDER) - ROUNDER;
    whole - if whole > value { 1.0 } else { 0.0 }
}

/// The nearest whole number as an integer, from 0 to four millions; of a negative one its low bits in two's complement.
#[inline(always)]
pub fn whole_number(value: f32) -> u32 {
    (value + ROUNDER).to_bits() & 0x003f_ffff
}

/// Sine and cosine of a part of the full turn, up to a thousand turns, to 2e-7: Taylor's series within an eighth of a turn
/// about the nearest quarter.
#[inline(always)]
pub fn sine_and_cosine(turns: f32) -> (f32, f32) {
    let quarters = 4.0 * turns;
    let nearest = (quarters + ROUNDER) - ROUNDER;
    let quarter = (quarters + ROUNDER).to_bits() & 3;
    let x = (quarters - nearest) * std::f32::consts::FRAC_PI_2;
    let x2 = x * x;
    let sine =
        x * (1.0 - x2 * (1.0 / 6.0 - x2 * (1.0 / 120.0 - x2 * (1.0 / 5040.0 - x2 * (1.0 / 362_880.0)))));
    let cosine = 1.0 - x2 * (0.5 - x2 * (1.0 / 24.0 - x2 * (1.0 / 720.0 - x2 * (1.0 / 40320.0))));
    let (a, b) = if quarter & 1 == 0 { (sine, cosine) } else { (cosine, sine) };
    let sign = |negative: bool| if negative { -1.0 } else { 1.0 };
    (a * sign(quarter >= 2), b * sign(quarter == 1 || quarter == 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_as_exact_as_they_say() {
        for k in 0..200_000i32 {
            let turns = (k - 100_000) as f32 * 3.7e-5;
            let angle = std::f64::consts::TAU * f64::from(turns);
            let (sine, cosine) = sine_and_cosine(turns);
            // The turns' own digits, and the series'.
            let slack = 2e-7 + 8e-7 * f64::from(turns.abs());
            assert!((f64::from(sine) - angle.sin()).abs() < slack, "{turns}: {sine}");
            assert!((f64::from(cosine) - angle.cos()).abs() < slack, "{turns}: {cosine}");
        }
    }

    #[test]
    fn whole_numbers_are_those_of_the_language() {
        for k in 0..100_000u32 {
            let value = k as f32 * 0.37;
            assert_eq!(floor(value), value.floor(), "{value}");
            assert_eq!(floor(-value), (-value).floor(), "-{value}");
            assert_eq!(whole_number(value.floor()), value as u32, "{value}");
            let value = f64::from(k) * 0.37 - 2e4;
            assert_eq!(nearest(value), value.round_ties_even(), "{value}");
        }
    }
}
