//! The native module of RETINA's Python package: thin functions over the libraries.
//!
//! What users see is in `python/retina/`: names, documentation, units, and how objects show themselves. Here are the
//! calls: arrays in and out, without the interpreter's lock, errors as one exception.

mod bench;
mod calibrations;
mod command;
mod convert;
mod ephemeris;
mod errors;
mod frames;
mod limb;
mod optics;
mod own_effect;
mod points;
mod setup;
mod stars;
mod tables;
mod work;
mod workbench;

use pyo3::prelude::*;

/// The native module.
#[pymodule]
mod _native {
    use super::*;

    #[pymodule_export]
    use crate::bench::{PyBench, bench_effects, simulate_points_table, simulate_power_table, write_table};
    #[pymodule_export]
    use crate::calibrations::{
        PyCalibration, PyGeometryFit, PyRadiometryFit, calibrate_geometry, calibrate_radiometry,
    };
    #[pymodule_export]
    use crate::command::run_command;
    #[pymodule_export]
    use crate::ephemeris::{PyEphemeris, format_time, parse_time};
    #[pymodule_export]
    use crate::frames::{PyFrameMaker, grey_png_bytes, screen_png_bytes};
    #[pymodule_export]
    use crate::limb::{PyLimbAnswer, PyStarsBeside, fit_limb};
    #[pymodule_export]
    use crate::optics::PyOpticalSystem;
    #[pymodule_export]
    use crate::points::detect;
    #[pymodule_export]
    use crate::setup::PySetup;
    #[pymodule_export]
    use crate::stars::{PyObserver, PyStarAnswer, PyStarSolver};
    #[pymodule_export]
    use crate::tables::read_columns;
    #[pymodule_export]
    use crate::workbench::{PyFindings, effect_list, effect_svgs, investigate};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
