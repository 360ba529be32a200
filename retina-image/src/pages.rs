//! How many pictures a TIFF holds.

/// Most pages that are looked at; a chain of pages may be a ring.
const MOST_PAGES: usize = 10_000;
/// Tag of the page's kind, whose lowest bit says that it is a small copy of another page (TIFF 6.0, page 36).
const NEW_SUBFILE_TYPE: u64 = 254;

/// The bytes of a TIFF, and how it counts.
struct Tiff<'a> {
    bytes: &'a [u8],
    little_endian: bool,
    /// Bytes of a place in the file, of the number of a page's entries, of an entry.
    place_bytes: u64,
    count_bytes: u64,
    entry_bytes: u64,
}

/// How a file counts, where it is a TIFF.
fn tiff(bytes: &[u8]) -> Option<Tiff<'_>> {
    let little_endian = bytes.starts_with(b"II");
    let small = Tiff { bytes, little_endian, place_bytes: 4, count_bytes: 2, entry_bytes: 12 };
    match small.number(2, 2) {
        Some(42) => Some(small),
        // A big TIFF counts in 8 bytes.
        Some(43) => Some(Tiff { place_bytes: 8, count_bytes: 8, entry_bytes: 20, ..small }),
        _ => None,
    }
}

/// The first four bytes of a tag's value on a TIFF's first page.
pub(crate) fn tiff_tag(bytes: &[u8], tag: u64) -> Option<u64> {
    let tiff = tiff(bytes)?;
    tiff.entry(tiff.number(tiff.place_bytes, tiff.place_bytes)?, tag)
}

/// Whether a TIFF's only page calls itself a small copy of another.
pub(crate) fn is_copy_alone(bytes: &[u8]) -> bool {
    tiff_pages(bytes) == 0 && tiff_tag(bytes, NEW_SUBFILE_TYPE).is_some_and(|kind| kind & 1 == 1)
}

/// The pages of a TIFF that are pictures of their own, without small copies of others; 0 where the bytes are no TIFF.
pub(crate) fn tiff_pages(bytes: &[u8]) -> usize {
    let Some(tiff) = tiff(bytes) else { return 0 };
    let mut pages = 0;
    let mut page = tiff.number(tiff.place_bytes, tiff.place_bytes);
    for _ in 0..MOST_PAGES {
        let Some((is_copy, next)) = page.filter(|&at| at > 0).and_then(|at| tiff.page(at)) else { break };
        pages += usize::from(!is_copy);
        page = next;
    }
    pages
}

impl Tiff<'_> {
    fn number(&self, at: u64, length: u64) -> Option<u64> {
        let word =
            self.bytes.get(usize::try_from(at).ok()?..usize::try_from(at.checked_add(length)?).ok()?)?;
        let join = |sum: u64, byte: &u8| (sum << 8) | u64::from(*byte);
        Some(if self.little_endian { word.iter().rev().fold(0, join) } else { word.iter().fold(0, join) })
    }

    /// The end of the entries of the page at this place.
    fn end(&self, at: u64) -> Option<u64> {
        let entries = self.number(at, self.count_bytes)?;
        let end = entries.checked_mul(self.entry_bytes)?.checked_add(at.checked_add(self.count_bytes)?)?;
        (end <= self.bytes.len() as u64).then_some(end)
    }

    /// The first four bytes of a tag's value on the page at this place.
    fn entry(&self, at: u64, tag: u64) -> Option<u64> {
        let mut places = (at + self.count_bytes..self.end(at)?).step_by(self.entry_bytes as usize);
        let entry = places.find(|&entry| self.number(entry, 2) == Some(tag))?;
        self.number(entry + self.entry_bytes - self.place_bytes, 4)
    }

    /// Whether the page at this place is a small copy of another, and where the next one is.
    fn page(&self, at: u64) -> Option<(bool, Option<u64>)> {
        let end = self.end(at)?;
        let kind = self.entry(at, NEW_SUBFILE_TYPE);
        Some((kind.is_some_and(|kind| kind & 1 == 1), self.number(end, self.place_bytes)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A TIFF of pages that hold their kind alone.
    fn tiff(kinds: &[u32]) -> Vec<u8> {
        let mut bytes = b"II\x2a\0\x08\0\0\0".to_vec();
        for (k, kind) in kinds.iter().enumerate() {
            bytes.extend([1, 0, 254, 0, 4, 0, 1, 0, 0, 0]);
            bytes.extend(kind.to_le_bytes());
            let next = if k + 1 < kinds.len() { bytes.len() as u32 + 4 } else { 0 };
            bytes.extend(next.to_le_bytes());
        }
        bytes
    }

    #[test]
    fn pages_are_counted_without_small_copies() {
        assert_eq!(
            [&[0][..], &[0, 0], &[0, 1], &[1, 0, 2]].map(|kinds| tiff_pages(&tiff(kinds))),
            [1, 2, 1, 2]
        );
        assert_eq!([&b"II*\0\xff\xff\xff\xff"[..], b"", b"II", b"\x89PNG"].map(tiff_pages), [0; 4]);
        // A page that follows itself.
        let mut ring = tiff(&[0]);
        ring[22] = 8;
        assert_eq!(tiff_pages(&ring), MOST_PAGES);
    }
}
