//! Files in, files out: everything the other crates share about reading input and writing results.
//!
//! - [`InputError`]: one error type for input that does not fit. It says what is wrong, in which
//!   file and place, what was found, what was expected, and how to mend it.
//! - [`read_toml`]: TOML into a type, unknown keys pointed at with the nearest known one; [`read_schema`] where the
//!   file names its schema.
//! - [`Table`]: CSV with a header row and `#` comments, cells read by column name.
//! - [`decode_image`]: PNG, TIFF and JPEG, within limits that are checked first.
//! - [`FitsHeader`]: headers of FITS files.
//! - [`write_atomic`]: a file exists whole or not at all.
//! - [`watch_files`]: who wants to know which files are read and written.
//! - [`user_folder`]: where the system has what a program keeps for its user.
//! - [`hash_bytes`], [`hash_file`]: BLAKE3, for manifests.

mod error;
mod fits;
mod folders;
mod picture;
mod shorten;
mod table;
mod toml_file;
mod watch;
mod write;

pub use error::{InputError, Place, Snippet};
pub use fits::FitsHeader;
pub use folders::user_folder;
pub use picture::{MOST_IMAGE_PIXELS, decode_image};
pub use table::Table;
pub use toml_file::{nearest, parse_schema, parse_toml, read_schema, read_toml};
pub use watch::{Deed, Watcher, watch_files};
pub use write::{hash_bytes, hash_file, read_bytes, read_text, write_atomic, write_new};
