//! Whole files or none, and their hashes.

use std::io::{Read as _, Write as _};
use std::path::Path;

use crate::InputError;
use crate::watch::{Deed, tell};

/// Writes `bytes` to `path` so that the file exists whole or not at all, whenever the process
/// is killed or the power fails: into a temporary file in the same folder, which is brought to the disk and then
/// renamed over `path`.
///
/// # Errors
/// Whatever the file system says.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = folder_of(path);
    written_beside(folder, bytes)?.persist(path).map_err(|error| error.error)?;
    sync_folder(folder)?;
    tell(Deed::Wrote, path, bytes.len());
    Ok(())
}

/// As [`write_atomic`], but leaves a file that is there as it is, also one that another process writes at the same
/// moment. Tells whether the file is ours.
///
/// # Errors
/// Whatever the file system says.
pub fn write_new(path: &Path, bytes: &[u8]) -> std::io::Result<bool> {
    let folder = folder_of(path);
    match written_beside(folder, bytes)?.persist_noclobber(path) {
        Ok(_) => {
            sync_folder(folder)?;
            tell(Deed::Wrote, path, bytes.len());
            Ok(true)
        }
        Err(error) if error.error.kind() == std::io::ErrorKind::AlreadyExists => Ok(false),
        Err(error) => Err(error.error),
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A temporary file in `folder` with `bytes`, on the disk.
fn written_beside(folder: &Path, bytes: &[u8]) -> std::io::Result<tempfile::NamedTempFile> {
    // The error's own text names the temporary file, which is nothing to the user.
    let made = tempfile::Builder::new().prefix(".part-").tempfile_in(folder);
    let mut file = made.map_err(|error| std::io::Error::from(error.kind()))?;
    file.write_all(bytes)?;
    // Temporary files are private by default; results are to be read by others.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        file.as_file().set_permissions(std::fs::Permissions::from_mode(0o644))?;
    }
    file.as_file().sync_data()?;
    Ok(file)
}

/// Brings a new name to the disk: it is in the folder, which has its own place there. Other systems have no such call.
fn sync_folder(folder: &Path) -> std::io::Result<()> {
    if cfg!(unix) {
        std::fs::File::open(folder)?.sync_all()?;
    }
    Ok(())
}

/// Most bytes of a file: the largest ephemeris kernels that are published have 3 GB.
const MOST_BYTES: u64 = 4 << 30;
/// Most bytes of a text: a table of some million rows.
const MOST_TEXT_BYTES: u64 = 1 << 30;

/// Reads a file, or says which one could not be read and why: also where it is no regular file (a device has no end),
/// or larger than 4 GiB.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, InputError> {
    read_within(path, MOST_BYTES)
}

/// Reads a regular file of at most `most_bytes`.
fn read_within(path: &Path, most_bytes: u64) -> Result<Vec<u8>, InputError> {
    let broken = |error: std::io::Error| {
        InputError::new(path, format!("cannot be read: {error}")).help("check the path and the permissions")
    };
    let kind = std::fs::metadata(path).map_err(broken)?;
    if !kind.is_file() {
        return Err(InputError::new(path, "cannot be read: it is no regular file")
            .found(if kind.is_dir() { "a folder" } else { "a device or a pipe" })
            .expected("a file")
            .help("save what is to be read as a file of its own"));
    }
    let file = std::fs::File::open(path).map_err(broken)?;
    let mut bytes = Vec::with_capacity(kind.len().min(most_bytes) as usize);
    // A file can grow while it is read.
    file.take(most_bytes + 1).read_to_end(&mut bytes).map_err(broken)?;
    if bytes.len() as u64 > most_bytes {
        return Err(InputError::new(path, "cannot be read: it is too large")
            .found(format!("{} bytes", kind.len().max(bytes.len() as u64)))
            .expected(format!("at most {most_bytes} bytes")));
    }
    tell(Deed::Read, path, bytes.len());
    Ok(bytes)
}

/// Reads a UTF-8 text file of at most 1 GiB, or says why not.
pub fn read_text(path: &Path) -> Result<String, InputError> {
    read_text_within(path, MOST_TEXT_BYTES)
}

/// As [`read_text`], with a bound of the format's own.
pub(crate) fn read_text_within(path: &Path, most_bytes: u64) -> Result<String, InputError> {
    String::from_utf8(read_within(path, most_bytes)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = error.as_bytes()[..at].iter().filter(|&&b| b == b'\n').count() + 1;
        InputError::new(path, "is not UTF-8 text").line(line).help("save the file as UTF-8")
    })
}

/// BLAKE3 of some bytes, as 64 hexadecimal digits.
pub fn hash_bytes(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// BLAKE3 of a file's content.
pub fn hash_file(path: &Path) -> Result<String, InputError> {
    Ok(hash_bytes(&read_bytes(path)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_no_end_or_is_too_large_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        write_atomic(&path, b"1234567").unwrap();
        assert_eq!(read_within(&path, 7).unwrap(), b"1234567");
        let said = read_within(&path, 6).unwrap_err().to_string();
        assert!(said.ends_with("it is too large (found 7 bytes, expected at most 6 bytes)"), "{said}");
        let said = read_bytes(folder.path()).unwrap_err().to_string();
        assert!(
            said.ends_with("cannot be read: it is no regular file (found a folder, expected a file)"),
            "{said}"
        );
        if cfg!(unix) {
            for read in [read_text, |path: &Path| read_bytes(path).map(|_| String::new())] {
                let said = read(Path::new("/dev/zero")).unwrap_err().to_string();
                assert!(said.contains("found a device or a pipe, expected a file"), "{said}");
            }
        }
    }

    #[test]
    fn a_toml_file_of_many_megabytes_is_refused() {
        let path = tempfile::tempdir().unwrap().keep().join("a.toml");
        let file = std::fs::File::create(&path).unwrap();
        // A hole: it takes no room on the disk.
        file.set_len(65 << 20).unwrap();
        let said = crate::read_toml::<toml::Table>(&path).unwrap_err().to_string();
        assert!(said.contains("it is too large (found 68157440 bytes, expected at most 67108864"), "{said}");
        std::fs::remove_dir_all(path.parent().unwrap()).unwrap();
    }
}
