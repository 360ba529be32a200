//! Text files of other programs: UTF-8, UTF-16 or Latin-1, and their numbers.

use std::path::Path;

use retina_files::{InputError, read_bytes};

/// Reads text in UTF-16 (with its mark), UTF-8, or, where it is neither, Latin-1.
pub(crate) fn read_text_any(path: &Path) -> Result<String, InputError> {
    let bytes = read_bytes(path)?;
    let utf16 = |join: fn([u8; 2]) -> u16| {
        let (pairs, rest) = bytes[2..].as_chunks::<2>();
        if !rest.is_empty() {
            return Err(InputError::new(path, "is not whole UTF-16 text").found("an odd number of bytes"));
        }
        String::from_utf16(&pairs.iter().map(|&pair| join(pair)).collect::<Vec<_>>())
            .map_err(|_| InputError::new(path, "is not UTF-16 text, though it begins with its mark"))
    };
    match bytes.as_slice() {
        [0xff, 0xfe, ..] => utf16(u16::from_le_bytes),
        [0xfe, 0xff, ..] => utf16(u16::from_be_bytes),
        _ => Ok(match std::str::from_utf8(&bytes) {
            Ok(text) => text.trim_start_matches('\u{feff}').to_owned(),
            Err(_) => bytes.iter().map(|&byte| byte as char).collect(),
        }),
    }
}

/// A finite number.
pub(crate) fn number(path: &Path, line: usize, word: &str) -> Result<f64, InputError> {
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(InputError::new(path, "not a finite number").line(line).found(format!("`{word}`"))),
    }
}
