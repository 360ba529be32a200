//! Camera images, and the points of light in them.
//!
//! - [`CameraImage`]: grey digital numbers from PNG, TIFF or FITS, and back.
//! - [`Photograph`]: the light of an ordinary camera's picture, JPEG and colour too, with its EXIF data.
//! - [`Background`]: level and noise of an image on a mesh that follows gradients.
//! - [`detect_points`]: finds points of light and measures each to a small fraction of a pixel.
//!
//! Pixels: x right, y down, the centre of pixel (0, 0) is (0.5, 0.5).
//!
//! ```
//! use retina_image::{CameraImage, DetectOptions, detect_points};
//! let mut image = CameraImage::new(64, 64, 4095.0);
//! for (at, value) in image.values.iter_mut().enumerate() {
//!     let (x, y) = ((at % 64) as f32 + 0.5 - 30.2, (at / 64) as f32 + 0.5 - 20.7);
//!     // Read noise stands in as a fixed pattern.
//!     *value = 100.0 + ((at * 7919) % 13) as f32 * 0.3 + 2000.0 * (-(x * x + y * y) / 4.5).exp();
//! }
//! let found = detect_points(&image, &DetectOptions::default());
//! assert_eq!(found.points.len(), 1);
//! assert!((found.points[0].x_px - 30.2).abs() < 0.01);
//! ```

mod alike;
mod background;
mod camera_image;
mod candidates;
mod centroid;
mod detect;
mod exif;
mod fits;
mod matched;
mod pages;
mod photograph;
mod plateau;
mod raw_files;
mod read;
mod reduce;
mod separable;
mod surroundings;
mod width;
mod width_field;
mod write;

pub use background::Background;
pub use camera_image::{CameraImage, Steps};
pub use centroid::Centroid;
pub use detect::{DetectOptions, Detection, LightPoint, detect_matched_in, detect_points, detect_points_in};
pub use exif::Exif;
pub use photograph::{Coding, Photograph, PhotographOptions};
pub use read::ReadOptions;
pub use reduce::read_mask;
pub use width::WidthMap;
