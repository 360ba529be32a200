//! Rendered frames as data sets that others train on.
//!
//! [`export`] reads a folder of frames with their truth and writes one of the [`Format`]s: images, masks, boxes, keypoints,
//! poses, the camera, a split into training and validation. The result appears whole or not at all.
//!
//! Each module knows one format. What they share is in `frames` (a frame with its truth) and `silhouette` (which pixels a
//! body covers).

mod bop;
mod coco;
mod export;
mod fits;
mod frames;
mod out;
mod png16;
mod silhouette;
mod speedplus;
mod webdataset;

pub use export::{Exported, Format, Options, export};
