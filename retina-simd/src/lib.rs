//! Hot loops compiled for the vector instructions that the processor has, chosen at run time.
//!
//! A loop is written once, in portable Rust, as a [`Kernel`]. [`Level::run`] calls it compiled for wider registers where the
//! processor has them. The arithmetic is the same in each, to the bit: sums and products lane by lane, never fused.
//!
//! ```
//! use retina_simd::{Kernel, Level};
//!
//! struct Doubled<'a>(&'a mut [f32]);
//!
//! impl Kernel for Doubled<'_> {
//!     type Output = ();
//!
//!     #[inline(always)]
//!     fn run(self) {
//!         self.0.iter_mut().for_each(|value| *value *= 2.0);
//!     }
//! }
//!
//! let mut values = [1.0, 2.0];
//! Level::detect().run(Doubled(&mut values));
//! assert_eq!(values, [2.0, 4.0]);
//! ```

mod lanes;

pub use lanes::{clamp, floor, max, min, nearest, sine_and_cosine, whole_number};

/// Vector instructions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InstructionSet {
    /// What every processor of the target has (x86-64: SSE2).
    Portable,
    /// AVX2: 256 bits.
    Avx2,
    /// AVX-512 with its extensions F, VL, BW and DQ: 512 bits, masks for lanes.
    Avx512,
}

impl InstructionSet {
    /// All of them, the narrowest first.
    pub const ALL: [Self; 3] = [Self::Portable, Self::Avx2, Self::Avx512];

    /// Whether this processor has it.
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "AVX2",
            Self::Avx512 => "AVX-512",
        }
    }
}

/// An instruction set that this processor has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Level(InstructionSet);

impl Level {
    /// What every processor of the target has.
    pub const PORTABLE: Self = Self(InstructionSet::Portable);

    /// The widest that this processor has.
    pub fn detect() -> Self {
        InstructionSet::ALL.into_iter().rev().find_map(Self::of).unwrap_or(Self::PORTABLE)
    }

    /// `None` where this processor does not have it.
    pub fn of(set: InstructionSet) -> Option<Self> {
        set.is_available().then_some(Self(set))
    }

    /// Which one it is.
    pub fn set(self) -> InstructionSet {
        self.0
    }

    /// Runs a kernel, compiled for these instructions.
    #[inline]
    #[allow(
        unsafe_code,
        reason = "a function compiled for more instructions than the target's own can only be called so; rays through lenses \
                  run 2.2 times as fast with AVX2 and 4.4 times with AVX-512"
    )]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self.0 {
            InstructionSet::Portable => kernel.run(),
            // SAFETY: the function is safe Rust. The one condition for calling it is that the processor has its
            // instructions, and a `Level` is made by `of` alone, after it has asked the processor for exactly these.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => unsafe { with_avx2(kernel) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => unsafe { with_avx512(kernel) },
            #[cfg(not(target_arch = "x86_64"))]
            _ => kernel.run(),
        }
    }
}

/// A hot loop that is compiled for each level. `run` and what it calls must be `inline(always)`: what is not inlined
/// keeps the target's own instructions. A closure would not do: the compiler inlines one only if it likes.
pub trait Kernel {
    /// What it gives.
    type Output;
    /// Does the work.
    fn run(self) -> Self::Output;
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512vl,avx512bw,avx512dq")]
fn with_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f32]);

    impl Kernel for Sum<'_> {
        type Output = [f32; 16];

        #[inline(always)]
        fn run(self) -> [f32; 16] {
            let mut sums = [0.0; 16];
            for values in self.0.chunks_exact(16) {
                for k in 0..16 {
                    sums[k] += values[k] * 1.1 + values[15 - k];
                }
            }
            sums
        }
    }

    /// All sets give the same bits; the widest available one is detected.
    #[test]
    fn the_same_bits_with_every_set() {
        let values: Vec<f32> = (0..1600u16).map(|i| f32::from(i).sin()).collect();
        let expected = Level::PORTABLE.run(Sum(&values)).map(f32::to_bits);
        let available: Vec<Level> = InstructionSet::ALL.into_iter().filter_map(Level::of).collect();
        for level in &available {
            assert_eq!(level.run(Sum(&values)).map(f32::to_bits), expected, "{}", level.set().name());
        }
        assert_eq!(available.last(), Some(&Level::detect()));
    }
}
