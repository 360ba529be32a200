//! CORTO's scenario folders and its closed-loop protocol.
//!
//! CORTO (Pugliatti, Buonagura and Topputo, "CORTO: The Celestial Object Rendering TOol at DART Lab",
//! Sensors 2023, 23, 9595) renders with Blender. This crate takes its files as they are:
//!
//! - [`Scenario`]: `scene.json`, `geometry.json` and the bodies' files, with a sidecar for what CORTO
//!   keeps in scripts; every guess and replacement is noted.
//! - [`Scenario::scene`]: the same as a [`retina_scene::Scene`], seen by CORTO's camera or shown in
//!   a facility.
//! - [`Products`]: by-products under CORTO's names.
//! - [`Server`]: the closed loop, poses in by UDP and images out by TCP; [`decode_pose`]: its datagrams.

mod convert;
mod datagram;
mod folder;
mod geometry;
mod node;
mod pose;
mod products;
mod scenario;
mod server;
mod settings;
mod shape;
mod sidecar;

pub use convert::Shown;
pub use datagram::{PoseError, decode_pose};
pub use geometry::{default_pose, read_geometry};
pub use pose::{ObjectPose, Pose, World};
pub use products::{Product, Products, parse_products, row};
pub use scenario::Scenario;
pub use server::{Ended, Server};
pub use settings::Settings;
