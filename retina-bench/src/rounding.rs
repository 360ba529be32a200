//! Whole numbers of f32 in vectors: a cast to an integer is none, since it minds numbers that no integer holds.

/// Numbers near it are whole. Adding it rounds, and leaves the whole number in the last bits.
pub(crate) const ROUNDER: f32 = 12_582_912.0;

/// The whole number below, for numbers up to four millions; beyond it may be off by a few.
#[inline(always)]
pub(crate) fn floor(value: f32) -> f32 {
    let whole = (value + ROUNDER) - ROUNDER;
    whole - if whole > value { 1.0 } else { 0.0 }
}

/// A whole number from 0 to four millions as an integer.
#[inline(always)]
pub(crate) fn whole_number(value: f32) -> u32 {
    (value + ROUNDER).to_bits() & 0x003f_ffff
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_those_of_the_language() {
        for k in 0..100_000u32 {
            let value = k as f32 * 0.37;
            assert_eq!(floor(value), value.floor(), "{value}");
            assert_eq!(floor(-value), (-value).floor(), "-{value}");
            assert_eq!(whole_number(value.floor()), value as u32, "{value}");
        }
    }
}
