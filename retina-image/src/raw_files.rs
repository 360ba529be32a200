//! Files of camera raw data, which are named and not read.

use std::path::Path;

use retina_files::InputError;

use crate::pages::{is_copy_alone, tiff_tag};

/// Tag of a DNG's version.
const DNG_VERSION: u64 = 50_706;
/// Raw formats that are a TIFF inside, by the file's extension.
const TIFF_INSIDE: [&str; 10] = ["nef", "nrw", "arw", "sr2", "dng", "pef", "srw", "3fr", "iiq", "cr2"];

/// The camera raw format of a file, by its first bytes and, where these are a TIFF's, its extension.
fn raw_format(path: &Path, bytes: &[u8]) -> Option<&'static str> {
    let at = |place: usize, magic: &[u8]| bytes.get(place..).is_some_and(|rest| rest.starts_with(magic));
    let is_tiff = at(0, b"II*\0") || at(0, b"MM\0*");
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    if is_tiff && at(8, b"CR") {
        Some("CR2")
    } else if at(4, b"ftypcrx ") {
        Some("CR3")
    } else if at(0, b"FUJIFILMCCD-RAW") {
        Some("RAF")
    } else if [&b"IIRO"[..], b"IIRS", b"MMOR"].iter().any(|magic| at(0, magic)) {
        Some("ORF")
    } else if at(0, b"IIU\0") {
        Some("RW2")
    } else if is_tiff && tiff_tag(bytes, DNG_VERSION).is_some() {
        Some("DNG")
    } else if is_tiff && TIFF_INSIDE.iter().any(|known| extension.as_deref() == Some(known)) {
        Some("NEF, ARW or the like")
    } else if is_tiff && is_copy_alone(bytes) {
        // Nikon's and others' begin with a small picture for display; the raw data are behind it.
        Some("a TIFF whose first page is a preview")
    } else {
        None
    }
}

/// Refuses camera raw data, and says what to do.
pub(crate) fn refuse_raw(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    match raw_format(path, bytes) {
        None => Ok(()),
        Some(format) => Err(InputError::new(path, "is camera raw data, which are not read here")
            .found(format)
            .expected("a PNG, TIFF or FITS image")
            .help(
                "convert it to a linear 16-bit TIFF: `dcraw -4 -T FILE` (one grey value a photosite: add `-d`), or \
                 RawTherapee with a linear output profile",
            )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn raw_files_are_known_by_bytes_and_extension() {
        let dng = b"II*\0\x08\0\0\0\x01\0\x12\xc6\x01\0\x04\0\0\0\x01\x04\0\0\0\0\0\0";
        let preview = b"MM\0*\0\0\0\x08\0\x01\0\xfe\0\x04\0\0\0\x01\0\0\0\x01\0\0\0\0";
        let plain = b"II*\0\x08\0\0\0\0\0\0\0\0\0";
        for (name, bytes, expected) in [
            ("a.tif", &b"II*\0\x10\0\0\0CR\x02\0"[..], Some("CR2")),
            ("a.cr3", b"\0\0\0\x18ftypcrx \0\0\0\x01", Some("CR3")),
            ("a.raf", b"FUJIFILMCCD-RAW 0201", Some("RAF")),
            ("a.orf", b"IIRO\x08\0\0\0", Some("ORF")),
            ("a.rw2", b"IIU\0\x18\0\0\0", Some("RW2")),
            ("a.tif", dng, Some("DNG")),
            ("a.NEF", plain, Some("NEF, ARW or the like")),
            ("a.tif", preview, Some("a TIFF whose first page is a preview")),
            ("a.tif", plain, None),
            // A picture that has been given the extension of raw data is what its bytes are.
            ("a.nef", b"\x89PNG\r\n\x1a\n", None),
            ("a", b"", None),
        ] {
            assert_eq!(raw_format(Path::new(name), bytes), expected, "{name}");
        }
        let said = refuse_raw(Path::new("a.orf"), b"IIRO").unwrap_err();
        assert!(said.to_string().contains("a.orf: is camera raw data"), "{said}");
        assert!(said.help.unwrap().contains("dcraw -4 -T"));
    }
}
