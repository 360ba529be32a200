//! Whole files or none, and their hashes.

use std::io::Write as _;
use std::path::Path;

use crate::InputError;

/// Writes `bytes` to `path` so that the file exists whole or not at all, whenever the process
/// is killed: into a temporary file in the same folder, then renamed over `path`.
///
/// # Errors
/// Whatever the file system says.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
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
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Reads a file, or says which one could not be read and why.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, InputError> {
    std::fs::read(path).map_err(|error| {
        InputError::new(path, format!("cannot be read: {error}")).help("check the path and the permissions")
    })
}

/// Reads a UTF-8 text file, or says why not.
pub fn read_text(path: &Path) -> Result<String, InputError> {
    String::from_utf8(read_bytes(path)?).map_err(|error| {
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
