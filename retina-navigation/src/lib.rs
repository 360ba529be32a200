//! Methods of optical navigation. They take images, points and times, and need neither renderer nor bench.
//!
//! - [`stars`]: attitude from the stars of one image, lost in space.
//! - [`planets`]: planets among an image's points, and their lines of sight.
//! - [`cameras`]: what is known of an image's camera, and the solvers that follow from it.
//! - [`image`]: the two together, from pixels; [`seen`]: what there is to be seen in them.
//! - [`products`]: a solved image as a table, a FITS header, a picture.
//! - [`filter`]: position by triangulation, position and velocity by an extended Kalman filter.
//! - [`limb`]: position of a resolved body from its limb.
//! - [`flashes`]: flashes of impacts on a body's night side.
//! - [`synthetic`]: points of light that a camera in deep space would measure, for tests and studies.
//!
//! The paper's experiments, which join these with rendered scenes and the virtual bench, are in `retina-experiments`.

pub mod cameras;
pub mod filter;
pub mod flashes;
pub mod image;
pub mod limb;
pub mod planets;
pub mod products;
pub mod seen;
pub mod stars;
pub mod synthetic;
