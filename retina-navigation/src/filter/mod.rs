//! Position and velocity from lines of sight to planets.
//!
//! - [`triangulate`]: position from two or more planets seen at once.
//! - [`Dynamics`]: how a spacecraft moves: Sun, planets, solar radiation pressure, relativity.
//! - [`Filter`]: an extended Kalman filter over both.

mod dynamics;
mod ekf;
mod matrix;
mod measurement;
mod triangulation;

pub use dynamics::{Dynamics, PhaseState, runge_kutta};
pub use ekf::{Filter, Innovation};
pub use matrix::{Matrix6, Vector6, cholesky, product, product_transposed, quadratic_form_inverse};
pub use measurement::{apparent_direction, tangent_axes};
pub use triangulation::{Beacon, Fix, triangulate};
