//! RETINA: software of a camera-in-the-loop test facility for spaceborne vision sensors.
//!
//! A small display shows a scene; relay and collimator lenses send it to a camera as if from infinity; navigation
//! software is tested on what the camera sees. This crate is one door to the libraries that do the work about it. Each
//! is a module here; [`prelude`] has the names that most programs need.
//!
//! # A tour
//!
//! **A facility** is a [`geometry::Setup`]: screen, camera, and how the one shows on the other. It gives K_f, which takes
//! a line of sight (x, y, 1) to a screen pixel (paper, eqs. 11 to 13).
//!
//! ```
//! use retina::prelude::*;
//! let setup = Setup::parse(retina::assets::WIDE_FOV_SETUP, "wide-fov.toml".as_ref())?;
//! let k_f = setup.facility_pinhole();
//! assert_eq!(k_f.pixel(glam::DVec2::ZERO), glam::DVec2::new(960.0, 600.0));
//! # Ok::<(), retina::files::InputError>(())
//! ```
//!
//! **A scene** is rendered to radiance ([`render`]), by wgpu or by an independent CPU renderer, and turned into the
//! display's digital counts ([`screen`], [`batch`]). `examples/render_a_frame.rs` renders a Moon in ten lines.
//!
//! **The optics** between screen and camera are traced exactly ([`optics`]): `examples/trace_a_lens.rs`.
//!
//! **The virtual bench** ([`mod@bench`]) takes a screen image to a camera image by physics, and [`campaign`] runs whole
//! measurement campaigns on it, with effects by id.
//!
//! **Calibration** ([`calibration`], [`response`]) learns from measurements where the facility shows a line of sight and
//! how bright: `examples/calibrate.rs`.
//!
//! **The workbench** ([`diagnosis`], [`frames`]) compares a model with measurements and names the physical effect that
//! is missing: `examples/diagnose.rs`. [`workbench`] reads what they work on. [`investigation`] looks for a formula where
//! no known effect fits. Calibrations of mrcal and OpenCV become its tables ([`import`]).
//!
//! **Navigation** ([`navigation`]) finds attitude and position in the camera's images: `examples/detect_and_solve.rs`.
//! [`experiments`] repeats the paper's experiments end to end.
//!
//! **The laboratory** ([`lab`]) has real screens and cameras in the loop, or the virtual bench in their place; [`gige`]
//! is a GigE Vision camera in software.
//!
//! **Files** of all kinds are recognised and read by [`check`], without any work done.
//!
//! # Conventions
//!
//! Pixels have x to the right and y down; pixel (0, 0) covers [0, 1) x [0, 1). The camera looks along +z. Lengths and
//! angles carry their unit in the name; a bare angle is in radians. `target_from_source` names a rotation. Input that
//! does not fit gives a [`files::InputError`] that says what, where, what was found, what was expected, and the mend.
//!
//! # Features
//!
//! `gpu` (default): rendering by wgpu. Without it the CPU renderer is left and wgpu is not compiled.
//! `aravis`: GenICam cameras by the system's library Aravis (libaravis-dev).

pub mod check;
pub mod decision;
pub mod starting;
pub mod workbench;

pub use retina_assets as assets;
pub use retina_basilisk as basilisk;
pub use retina_batch as batch;
pub use retina_bench as bench;
pub use retina_calibration as calibration;
pub use retina_campaign as campaign;
pub use retina_cluster as cluster;
pub use retina_corto as corto;
pub use retina_diagnosis as diagnosis;
pub use retina_experiments as experiments;
pub use retina_export as export;
pub use retina_files as files;
pub use retina_formats as formats;
pub use retina_frames as frames;
pub use retina_geometry as geometry;
pub use retina_gige as gige;
pub use retina_image as image;
pub use retina_import as import;
pub use retina_investigation as investigation;
pub use retina_lab as lab;
pub use retina_model as model;
pub use retina_navigation as navigation;
pub use retina_optics as optics;
pub use retina_plot as plot;
pub use retina_radiometry as radiometry;
pub use retina_render as render;
pub use retina_report as report;
pub use retina_response as response;
pub use retina_scene as scene;
pub use retina_screen as screen;
pub use retina_sky as sky;

/// Vectors and rotations, as all modules use them.
pub use glam;

/// The names that most programs need.
pub mod prelude {
    pub use crate::files::InputError;
    pub use crate::formats::{
        Calibration, Channel, Measurements, PhaseTable, PointsTable, PowerTable, RadiometricCalibration,
    };
    pub use crate::geometry::{Distortion, Pinhole, Setup};

    pub use crate::calibration::geometry::{CalibrateOptions, calibrate};
    pub use crate::campaign::{Facility, simulate_points, simulate_power};
    pub use crate::diagnosis::{Baseline, Dataset, DiagnoseOptions, Source, compare, diagnose, fit};
    pub use crate::image::{CameraImage, DetectOptions, detect_points};
    pub use crate::navigation::limb::solve_limb;
    pub use crate::navigation::stars::{SolverOptions, StarCamera, StarSolver};
    pub use crate::optics::{Launcher, OpticalSystem, Tracer, read_system, shipped_design};
    pub use crate::radiometry::{Law, Photometry};
    pub use crate::render::{
        BodyModel, BodyState, CpuRenderer, FrameState, GpuDevice, GpuRenderer, NativeRenderer, Planes,
        Quality,
    };
    pub use crate::scene::Scene;
}
