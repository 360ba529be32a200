//! Numpy's archives of arrays (npz: a zip of npy files), from the text that mrcal keeps them in.
//!
//! Zip: PKWARE, APPNOTE.TXT 6.3.10, sections 4.3 and 4.4. npy: NumPy Enhancement Proposal 1. Base 85: Python's
//! `base64.b85encode`, RFC 1924's alphabet over groups of four bytes.

use std::path::Path;

use retina_files::InputError;

use crate::literal::{Literal, parse};

/// Most bytes of an array once it is unpacked.
const MOST_BYTES: usize = 256 << 20;
/// Most arrays.
const MOST_ENTRIES: usize = 256;

/// An array, its last index the fastest.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Array {
    /// Numbers of any type.
    Numbers { shape: Vec<usize>, values: Vec<f64> },
    /// Anything else: text.
    Other,
}

const ALPHABET: &[u8; 85] =
    b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%&()*+-;<=>?@^_`{|}~";

/// Bytes of a text of base 85; `None` where it is none.
pub(crate) fn base85(text: &str) -> Option<Vec<u8>> {
    let mut digit = [255u8; 256];
    ALPHABET.iter().zip(0u8..).for_each(|(&c, value)| digit[usize::from(c)] = value);
    let mut out = Vec::with_capacity(text.len() / 5 * 4 + 4);
    for group in text.as_bytes().chunks(5) {
        // A short group is filled with the last digit, and as many bytes are dropped.
        let mut value = 0u64;
        for k in 0..5 {
            let digit = group.get(k).map_or(84, |&c| digit[usize::from(c)]);
            if digit == 255 {
                return None;
            }
            value = value * 85 + u64::from(digit);
        }
        let bytes = u32::try_from(value).ok()?.to_be_bytes();
        out.extend_from_slice(&bytes[..group.len() - 1]);
    }
    Some(out)
}

/// Little-endian fields of the zip.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn slice(&self, at: usize, length: usize) -> Option<&'a [u8]> {
        self.0.get(at..at.checked_add(length)?)
    }

    fn number(&self, at: usize, length: usize) -> Option<usize> {
        let value = self.slice(at, length)?.iter().rev().fold(0u64, |sum, &b| sum << 8 | u64::from(b));
        usize::try_from(value).ok()
    }
}

/// Arrays of an archive by name, in its order. `at` names the archive in errors.
pub(crate) fn arrays(path: &Path, at: &str, archive: &[u8]) -> Result<Vec<(String, Array)>, InputError> {
    let damaged = |problem: &str, found: String| {
        InputError::new(path, problem)
            .at(at.to_owned())
            .found(found)
            .expected("a whole archive of numpy (npz)")
            .help("the file is damaged; take it anew from mrcal")
    };
    let bytes = Bytes(archive);
    // The end record: it has 22 bytes and a comment of at most 65535.
    let first = archive.len().saturating_sub(22 + 0xffff);
    let end =
        (first..archive.len().saturating_sub(21)).rev().find(|&at| archive[at..].starts_with(b"PK\x05\x06"));
    let directory = end.and_then(|end| Some((bytes.number(end + 10, 2)?, bytes.number(end + 16, 4)?)));
    let Some((count, mut here)) = directory else {
        return Err(damaged(
            "holds an archive that cannot be opened",
            format!("{} bytes without a directory", archive.len()),
        ));
    };
    if count > MOST_ENTRIES {
        return Err(damaged("holds an archive of too many arrays", format!("{count} arrays")));
    }
    let mut out = Vec::new();
    for number in 0..count {
        let entry = entry(&bytes, here);
        let Some(Entry { name, packed, size, crc, deflated, next }) = entry else {
            return Err(damaged(
                "holds an archive whose directory is damaged",
                format!("entry {}", number + 1),
            ));
        };
        here = next;
        let shown = format!("array `{}`", name.escape_default());
        if size > MOST_BYTES {
            return Err(damaged("holds an array that is too large", format!("{shown}, {size} bytes")));
        }
        let unpacked = match deflated {
            false => Some(packed.to_vec()),
            true => miniz_oxide::inflate::decompress_to_vec_with_limit(packed, size).ok(),
        };
        let Some(content) = unpacked.filter(|c| c.len() == size && crc32(c) == crc) else {
            return Err(damaged("holds an array that cannot be unpacked", shown));
        };
        let Some(array) = npy(path, &content) else {
            return Err(damaged("holds an array that cannot be read", shown));
        };
        out.push((name.trim_end_matches(".npy").to_owned(), array));
    }
    Ok(out)
}

struct Entry<'a> {
    name: String,
    packed: &'a [u8],
    size: usize,
    crc: usize,
    deflated: bool,
    next: usize,
}

/// The entry of the directory at `at`.
fn entry<'a>(bytes: &Bytes<'a>, at: usize) -> Option<Entry<'a>> {
    if bytes.slice(at, 4)? != b"PK\x01\x02" {
        return None;
    }
    let field = |offset, length| bytes.number(at + offset, length);
    let deflated = match field(10, 2)? {
        0 => false,
        8 => true,
        _ => return None,
    };
    let (crc, packed, size) = (field(16, 4)?, field(20, 4)?, field(24, 4)?);
    let (name, extra, comment) = (field(28, 2)?, field(30, 2)?, field(32, 2)?);
    let local = field(42, 4)?;
    let name_text = String::from_utf8_lossy(bytes.slice(at + 46, name)?).into_owned();
    let data = local + 30 + bytes.number(local + 26, 2)? + bytes.number(local + 28, 2)?;
    Some(Entry {
        name: name_text,
        packed: bytes.slice(data, packed)?,
        size,
        crc,
        deflated,
        next: at + 46 + name + extra + comment,
    })
}

/// CRC-32 of the zip (polynomial 0xedb88320, reflected).
fn crc32(bytes: &[u8]) -> usize {
    let mut crc = u32::MAX;
    for &byte in bytes {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = crc >> 1 ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 };
        }
    }
    !crc as usize
}

/// An npy file.
fn npy(path: &Path, content: &[u8]) -> Option<Array> {
    let bytes = Bytes(content);
    if bytes.slice(0, 6)? != b"\x93NUMPY" {
        return None;
    }
    let (length, start) = match bytes.number(6, 1)? {
        1 => (bytes.number(8, 2)?, 10),
        2 | 3 => (bytes.number(8, 4)?, 12),
        _ => return None,
    };
    let header = std::str::from_utf8(bytes.slice(start, length)?).ok()?;
    let header = parse(path, header).ok()?;
    let Literal::Text(kind) = header.get("descr")?.1 else { return None };
    let shape: Option<Vec<usize>> = header
        .get("shape")?
        .1
        .numbers()?
        .into_iter()
        .map(|side| (side >= 0.0 && side.fract() == 0.0 && side < 1e9).then_some(side as usize))
        .collect();
    let shape = shape?;
    let read: fn(&[u8]) -> Option<f64> = match kind.as_str() {
        "<f8" => |b| Some(f64::from_le_bytes(b.try_into().ok()?)),
        "<f4" => |b| Some(f64::from(f32::from_le_bytes(b.try_into().ok()?))),
        "<i8" => |b| Some(i64::from_le_bytes(b.try_into().ok()?) as f64),
        "<i4" => |b| Some(f64::from(i32::from_le_bytes(b.try_into().ok()?))),
        "|b1" | "|u1" => |b| b.first().map(|&b| f64::from(b)),
        _ => return Some(Array::Other),
    };
    if header.get("fortran_order")?.1 != &Literal::Bool(false) {
        return None;
    }
    let width: usize = kind[2..].parse().ok()?;
    let count = shape.iter().try_fold(1usize, |product, side| product.checked_mul(*side))?;
    let data = content.get(start + length..)?;
    if count.checked_mul(width)? != data.len() {
        return None;
    }
    let values: Option<Vec<f64>> = data.chunks_exact(width).map(read).collect();
    Some(Array::Numbers { shape, values: values? })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Python: `base64.b85encode(b"retina-import")`, and of shorter texts.
    #[test]
    fn base85_is_pythons() {
        for (text, bytes) in TEXTS {
            assert_eq!(base85(text).as_deref(), Some(*bytes), "{text}");
        }
        assert_eq!(base85("abc\"d"), None);
        // 85^5 - 1 is more than 32 bits.
        assert_eq!(base85("~~~~~"), None);
    }

    const TEXTS: &[(&str, &[u8])] =
        &[("a%FUBZecBHZE$aLbN", b"retina-import"), ("as", b"r"), ("a%B", b"re"), ("a%FS", b"ret"), ("", b"")];

    /// The check value of CRC-32 (ISO-HDLC).
    #[test]
    fn crc_of_the_check_string() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    }
}
