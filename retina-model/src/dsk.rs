//! Shapes in SPICE's DSK kernels: segments of type 2, triangular plates.
//!
//! Layout: NAIF, DAS, DLA and DSK Required Reading. A DAS file holds characters, doubles and integers, each with
//! addresses of their own, in clusters of records; a DLA file parts those addresses into segments.

use std::path::Path;

use glam::DVec3;
use retina_files::{InputError, read_bytes};

use crate::kind::LoadedMesh;
use crate::load::{MAX_COORDINATE_M, MAX_ELEMENTS};
use crate::obj::plain_mesh;

const RECORD_BYTES: usize = 1024;
/// Words of a record: characters, doubles, integers.
const RECORD_WORDS: [usize; 3] = [1024, 128, 256];
/// Indices into [`RECORD_WORDS`].
const DOUBLES: usize = 1;
const INTEGERS: usize = 2;
const KM: f64 = 1e3;
/// Integers of a segment's descriptor in a DLA file, and what ends their list.
const DESCRIPTOR_INTEGERS: usize = 8;
const LIST_END: i32 = -1;
/// Doubles before a segment's vertices (its descriptor, bounds, and the voxel grid), integers before its plates.
const VERTICES_AT: usize = 34;
const PLATES_AT: usize = 10;
const TYPE_PLATES: f64 = 2.0;

/// Loads all plates of a DSK kernel: kilometres become body-fixed metres, axes are used as they are.
///
/// # Errors
/// The file is no little-endian DSK kernel or is damaged; it has a segment of another type, or several bodies.
pub(crate) fn load_dsk(path: &Path) -> Result<LoadedMesh, InputError> {
    let bytes = read_bytes(path)?;
    let file = Das::open(path, &bytes)?;
    let (mut positions_m, mut triangles) = (Vec::new(), Vec::new());
    let mut center = None;
    // Its address 1 is a version; 2 and 3 say where the first and the last segment are.
    let mut at = file.integers(2, 1)?[0];
    for segment in 1.. {
        if at == LIST_END {
            break;
        }
        if segment > file.words[INTEGERS] / DESCRIPTOR_INTEGERS {
            return Err(file.damaged("segments in a ring"));
        }
        let address = usize::try_from(at).map_err(|_| file.damaged(format!("a segment at {at}")))?;
        let descriptor = file.integers(address, DESCRIPTOR_INTEGERS)?;
        let [next, integer_base, double_base] = [descriptor[1], descriptor[2], descriptor[4]];
        let [integer_base, double_base] = [integer_base, double_base].map(usize::try_from);
        let (Ok(integer_base), Ok(double_base)) = (integer_base, double_base) else {
            return Err(file.damaged(format!("a segment at {descriptor:?}")));
        };
        let about = file.doubles(double_base + 1, VERTICES_AT)?;
        let place = format!("segment {segment}");
        if about[3] != TYPE_PLATES {
            return Err(InputError::new(path, "the type of a segment is not read")
                .at(place)
                .found(format!("type {}", about[3]))
                .expected("type 2, plates"));
        }
        if *center.get_or_insert(about[1]) != about[1] {
            return Err(InputError::new(path, "the kernel has the shapes of several bodies")
                .at(place)
                .found(format!("NAIF {} after {}", about[1], center.unwrap_or_default()))
                .expected("one body")
                .help("part the kernel with NAIF's program `dlacat` or `dskbrief` and `dskexp`"));
        }
        let head = file.integers(integer_base + 1, PLATES_AT)?;
        let counts = [head[0], head[1]].map(|count| usize::try_from(count).unwrap_or(0));
        if counts.contains(&0)
            || positions_m.len() + counts[0] > MAX_ELEMENTS
            || triangles.len() + counts[1] > MAX_ELEMENTS
        {
            return Err(InputError::new(path, "the body is larger or smaller than it may be")
                .at(place)
                .found(format!("{} vertices and {} plates", head[0], head[1]))
                .expected(format!("1 to {MAX_ELEMENTS} of each")));
        }
        let first = positions_m.len() as u32;
        for vertex in file.doubles(double_base + 1 + VERTICES_AT, 3 * counts[0])?.chunks_exact(3) {
            let position_m = DVec3::from_slice(vertex) * KM + 0.0;
            // The largest element of a vector says nothing of what is no number in it.
            if !position_m.is_finite() || position_m.abs().max_element() > MAX_COORDINATE_M {
                return Err(file.damaged(format!("a vertex at {vertex:?} km")).at(place));
            }
            positions_m.push(position_m);
        }
        for plate in file.integers(integer_base + 1 + PLATES_AT, 3 * counts[1])?.chunks_exact(3) {
            if plate.iter().any(|&corner| !(1..=counts[0] as i32).contains(&corner)) {
                return Err(file
                    .damaged(format!("a plate of the vertices {plate:?}"))
                    .at(place)
                    .expected(format!("1 to {}", counts[0])));
            }
            triangles.push([0, 1, 2].map(|k| first + plate[k] as u32 - 1));
        }
        at = next;
    }
    plain_mesh(path, positions_m, &triangles)
}

/// A DAS file and where its words are.
struct Das<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    /// Clusters of each kind of word: how many words are before it, and its first record's byte.
    clusters: [Vec<(usize, usize)>; 3],
    /// Words of each kind that the clusters have room for.
    words: [usize; 3],
}

impl<'a> Das<'a> {
    fn open(path: &'a Path, bytes: &'a [u8]) -> Result<Self, InputError> {
        if !bytes.starts_with(b"DAS/DSK ") || bytes.len() < RECORD_BYTES {
            return Err(InputError::new(path, "is no DSK kernel")
                .found(format!(
                    "{} bytes that begin with `{}`",
                    bytes.len(),
                    bytes[..bytes.len().min(8)].escape_ascii()
                ))
                .expected("a binary kernel, which begins with `DAS/DSK `"));
        }
        let order = &bytes[84..92];
        if order != b"LTL-IEEE" {
            return Err(InputError::new(path, "the kernel's byte order is not read")
                .found(format!("`{}`", order.escape_ascii()))
                .expected("`LTL-IEEE`")
                .help("NAIF's program `bingo` converts it"));
        }
        let mut file = Self { path, bytes, clusters: Default::default(), words: [0; 3] };
        let number = |at: usize| i32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        // Records before the first directory: this one, reserved ones and comments.
        let before = [number(68), number(76)].map(|count| usize::try_from(count).unwrap_or(usize::MAX / 4));
        let mut directory = before[0].saturating_add(before[1]).saturating_add(1);
        for _ in 0..=bytes.len() / RECORD_BYTES {
            let start = directory.saturating_mul(RECORD_BYTES);
            if start.saturating_add(RECORD_BYTES) > bytes.len() {
                return Err(file.cut(start.saturating_add(RECORD_BYTES)));
            }
            let entry = |index: usize| number(start + 4 * index);
            let mut kind = usize::try_from(entry(8)).ok().filter(|kind| (1..=3).contains(kind));
            let mut record = directory + 1;
            for index in 9..RECORD_BYTES / 4 {
                let count = entry(index);
                if count == 0 {
                    break;
                }
                // The sign says which kind follows: characters, doubles, integers, and so on, or the other way.
                if index > 9 {
                    kind = kind.map(|kind| if count > 0 { kind % 3 + 1 } else { (kind + 1) % 3 + 1 });
                }
                let Some(own) = kind.map(|kind| kind - 1) else {
                    return Err(file.damaged(format!("words of kind {}", entry(8))));
                };
                file.clusters[own].push((file.words[own], record.saturating_mul(RECORD_BYTES)));
                file.words[own] += count.unsigned_abs() as usize * RECORD_WORDS[own];
                record = record.saturating_add(count.unsigned_abs() as usize);
            }
            match usize::try_from(entry(1)) {
                Ok(0) | Err(_) => return Ok(file),
                Ok(next) => directory = next - 1,
            }
        }
        Err(file.damaged("directories in a ring"))
    }

    fn damaged(&self, what: impl Into<String>) -> InputError {
        InputError::new(self.path, "the kernel is damaged").found(what.into()).help("fetch the file again")
    }

    fn cut(&self, needed: usize) -> InputError {
        InputError::new(self.path, "the kernel is cut short")
            .found(format!("{} bytes", self.bytes.len()))
            .expected(format!("{needed} bytes at least"))
            .help("fetch the file again")
    }

    /// The bytes of words of a kind from an address (from 1).
    fn words(&self, kind: usize, size: usize, from: usize, count: usize) -> Result<Vec<u8>, InputError> {
        let end = (from.max(1) - 1).saturating_add(count);
        if from < 1 || end > self.words[kind] {
            return Err(self.damaged(format!("words {from} to {end} of {}", self.words[kind])));
        }
        let mut found = Vec::new();
        let mut at = from - 1;
        while at < end {
            let own = self.clusters[kind].partition_point(|(before, _)| *before <= at) - 1;
            let (before, byte) = self.clusters[kind][own];
            let until =
                self.clusters[kind].get(own + 1).map_or(self.words[kind], |(before, _)| *before).min(end);
            let [start, stop] = [at, until].map(|word| byte.saturating_add((word - before) * size));
            found.extend_from_slice(self.bytes.get(start..stop).ok_or_else(|| self.cut(stop))?);
            at = until;
        }
        Ok(found)
    }

    fn doubles(&self, from: usize, count: usize) -> Result<Vec<f64>, InputError> {
        let bytes = self.words(DOUBLES, 8, from, count)?;
        Ok(bytes.chunks_exact(8).map(|word| word.try_into().map_or(f64::NAN, f64::from_le_bytes)).collect())
    }

    fn integers(&self, from: usize, count: usize) -> Result<Vec<i32>, InputError> {
        let bytes = self.words(INTEGERS, 4, from, count)?;
        Ok(bytes.chunks_exact(4).map(|word| word.try_into().map_or(0, i32::from_le_bytes)).collect())
    }
}
