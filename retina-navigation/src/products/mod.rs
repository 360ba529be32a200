//! What a solved image is handed on as: a table of its stars, a FITS header, a picture with names; of a body, one with
//! its limb.

mod limb_picture;
mod picture;
mod table;
mod wcs;

pub use limb_picture::limb_picture;
pub use picture::annotated;
pub use table::matches_csv;
pub use wcs::wcs_header;
