//! The laboratory: real screens and cameras in the loop, and the virtual bench in their place.
//!
//! - [`Screen`]: shows a frame and knows that it is there: an X11 window, a folder, a command, or the virtual bench.
//! - [`LabCamera`]: takes an image when it is told to: GenICam cameras by Aravis, a folder, a command, the virtual bench.
//! - [`present`]: shows a [`Sequence`] to whoever looks.
//! - [`capture`]: shows a [`Sequence`] and photographs it, resumable; [`calibrate_geometry`]: pattern, images, fit and
//!   check in one piece.
//! - [`Aligner`]: the bench's misalignment as a number for each [`Screw`], round by round.
//! - [`BenchCamera`]: the virtual bench as a camera that photographs a [`ScreenView`], what a screen shows at this
//!   moment, in its own time. `retina_gige` puts it on the network.

mod align;
mod bench_camera;
mod calibrate;
mod capture;
mod check;
mod closed_loop;
mod devices;
mod error;
mod exposure;
mod latency;
mod measure;
mod monitor;
mod power;
mod present;
mod rig;
mod run_command;
mod screws;
mod sequence;
mod show;
mod split;
mod spots;
mod take;
mod view;
mod x11;

pub use align::{AlignOptions, Aligner, Alignment, Estimate};
pub use bench_camera::{BenchCamera, BenchCameraOptions};
pub use calibrate::{LabCalibrated, LabCalibration, Step, calibrate_geometry};
pub use capture::{Before, CaptureOptions, Captured, Upcoming, capture};
pub use check::{CHECK_STEPS, Finding, Grade, check};
pub use closed_loop::{ClosedLoop, LoopFrame, LoopOptions};
pub use devices::{FoundCamera, FoundScreen, find_cameras, find_screens};
pub use error::LabError;
pub use exposure::find_exposure;
pub use latency::{Latency, LatencyOptions, LatencyTrial, Quantiles, measure_latency};
pub use measure::{Condition, measure_round};
pub use monitor::{Monitor, MonitorOptions, MonitorReading, monitor_figure};
pub use power::{CommandMeter, PowerLevel, PowerMeter, PowerReadingOptions, read_power};
pub use present::{PresentOptions, Presented, present};
pub use rig::{Rig, ShownPart};
pub use screws::{Screw, Turns};
pub use sequence::{Planned, Sequence, SequenceFrame, SequenceKind};
pub use show::{BenchScreen, Patch, Screen, ScreenSpec, open_screen};
pub use split::{FramePart, SplitError, SplitWriter, check_shares, read_light, split};
pub use take::{CameraSettings, CameraSpec, LabCamera, Taken, open_camera};
pub use view::{ScreenAddress, ScreenView, open_view};
