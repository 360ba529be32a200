//! Fourier transforms, compiled once for all crates.
//!
//! `rustfft` is generic in its number type, so that each crate that plans a transform would compile the whole library
//! for itself: half a minute each (VALIDATION.md, "Building"). The planners here have fixed types. Their methods are never
//! inlined, since a caller would compile the library again. All lengths are in samples; no transform is normalised.
//!
//! ```
//! use retina_fourier::{Complex32, ComplexPlanner};
//!
//! let mut values = [Complex32::new(1.0, 0.0); 4];
//! ComplexPlanner::new().forward(4).process(&mut values);
//! assert_eq!(values[0], Complex32::new(4.0, 0.0));
//! ```

use std::sync::Arc;

pub use realfft::{ComplexToReal, RealToComplex};
pub use rustfft::Fft;
pub use rustfft::num_complex::{Complex32, Complex64};

/// Plans transforms of complex numbers of single precision, and keeps the plans.
pub struct ComplexPlanner(rustfft::FftPlanner<f32>);

impl ComplexPlanner {
    /// A planner for the vector instructions of this processor.
    #[inline(never)]
    pub fn new() -> Self {
        Self(rustfft::FftPlanner::new())
    }

    /// The transform with exp(-2 pi i j k / length).
    #[inline(never)]
    pub fn forward(&mut self, length: usize) -> Arc<dyn Fft<f32>> {
        self.0.plan_fft_forward(length)
    }

    /// The transform with exp(2 pi i j k / length).
    #[inline(never)]
    pub fn inverse(&mut self, length: usize) -> Arc<dyn Fft<f32>> {
        self.0.plan_fft_inverse(length)
    }
}

impl Default for ComplexPlanner {
    fn default() -> Self {
        Self::new()
    }
}

/// The transform of complex numbers of double precision with exp(-2 pi i j k / length).
#[inline(never)]
pub fn forward_f64(length: usize) -> Arc<dyn Fft<f64>> {
    rustfft::FftPlanner::new().plan_fft_forward(length)
}

/// The transforms of real numbers of single precision to half a spectrum, and back.
#[inline(never)]
pub fn real_pair(length: usize) -> (Arc<dyn RealToComplex<f32>>, Arc<dyn ComplexToReal<f32>>) {
    let mut planner = realfft::RealFftPlanner::new();
    (planner.plan_fft_forward(length), planner.plan_fft_inverse(length))
}
