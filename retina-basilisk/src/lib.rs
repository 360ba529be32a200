//! A Basilisk simulation's camera: what its `vizInterface` sends becomes frames, and images go back.
//!
//! - [`Simulation`]: the last state that was sent; [`Simulation::view`]: the frame and the projection of one of its cameras.
//! - [`Server`]: the protocol, a reply to each request.

mod message;
mod server;
mod view;
mod zmtp;

pub use server::{Ended, Server};
pub use view::{Simulation, View};
