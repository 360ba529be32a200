//! Running a scene: from its frames to files.
//!
//! - [`Batch`]: renders the chosen frames of a scene into a folder: screen images, truth, EXR,
//!   manifest; renders on while finished frames are encoded; resumes and shares a folder.
//! - [`FrameMaker`]: a scene's frames in memory.
//! - [`LiveRenderer`]: single frames from a renderer that stays open.
//! - [`Selection`]: which frames: a range, every so many, a shard.
//! - [`Resampler`]: an image resampled through the distortion in f64, Lanczos-3.
//! - [`warp_file`]: the same from file to file, counts or linear values.
//! - [`Batch::prepare`], [`merge_shards`]: folders of shards, made alike and joined; [`FolderState`]: how far one is.
//! - [`contact_sheet`]: a folder's frames at a glance.

mod digits;
mod error;
mod exr_file;
mod folder;
mod frame_maker;
mod linear_image;
mod live;
mod picture;
mod plan;
mod png_file;
mod resample;
mod run;
mod scale;
mod selection;
mod shards;
mod sheet;
mod side_products;
mod source;
mod stars;
mod state;
mod warp_file;

pub use error::BatchError;
pub use exr_file::{Channels, read_exr, write_exr};
pub use frame_maker::{FrameMaker, MadeFrame, Scaling};
pub use live::LiveRenderer;
pub use picture::screen_png;
pub use plan::ImagePlan;
pub use png_file::{PngShape, png_bytes};
pub use resample::{Canvas, Resampler};
pub use run::{Batch, Observer, Options, Progress, SPOT_PX, Summary};
pub use selection::{FrameRange, Selection, Shard};
pub use shards::{Merged, merge_shards};
pub use sheet::contact_sheet;
pub use side_products::SideProducts;
pub use source::{AdapterName, BackendChoice};
pub use state::FolderState;
pub use warp_file::{WarpReport, warp_file};
