//! What is computed of a body's shape before its first frame: the hierarchy that rays walk, and bounds on the relief.
//!
//! A body of 750 000 triangles takes seconds of processor time. A program may name a folder in which the result is kept from
//! one run to the next ([`keep_bodies_in`]). A file there has the name of a hash of the shape and of the code that
//! works on it, so that it never answers for another one. It begins with a hash of what follows; a file that is damaged is
//! made again. Files are written whole and then renamed, so that programs may share the folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::SystemTime;

use bytemuck::Pod;
use glam::Vec3A;
use rayon::prelude::*;
use retina_files::{hash_bytes, read_bytes, write_atomic};

use super::bvh::{self, Node};
use super::horizon::{self, PATCH};

/// Bodies of fewer triangles are worked out sooner than a file is read and its hash checked.
const WORTH_KEEPING: usize = 50_000;
/// Files that the folder keeps; the oldest ones go. One of the shipped Moon has 20 MB.
const MOST_FILES: usize = 16;
/// How a file's name ends.
const EXTENSION: &str = "body";
/// A hash in letters.
const HASH: usize = 64;
/// Whatever changes what is computed changes the names of the files.
const CODE: [&[u8]; 3] =
    [include_bytes!("bvh.rs"), include_bytes!("horizon.rs"), include_bytes!("prepared.rs")];

static FOLDER: OnceLock<PathBuf> = OnceLock::new();

/// Names the folder in which this program keeps what it computes of large bodies' shapes, and from which it reads it. The
/// first call counts. What cannot be written is computed again next time.
pub fn keep_bodies_in(folder: PathBuf) {
    let _ = FOLDER.set(folder);
}

/// Of one body; nodes count triangles from its first one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Prepared {
    pub(crate) nodes: Vec<Node>,
    /// The order in which its triangles are stored.
    pub(crate) order: Vec<u32>,
    /// For each patch of triangles: see `horizon`.
    pub(crate) horizons: Vec<[f32; 4]>,
}

impl Prepared {
    /// From the folder, where it is there.
    pub(crate) fn of(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let folder = FOLDER.get().filter(|_| triangles.len() >= WORTH_KEEPING);
        match folder {
            Some(folder) => Self::kept_in(folder, positions, triangles),
            None => Self::new(positions, triangles),
        }
    }

    fn kept_in(folder: &Path, positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let path = folder.join(format!("{}.{EXTENSION}", key(positions, triangles)));
        let kept = path.is_file().then(|| read_bytes(&path).ok()).flatten();
        if let Some(kept) = kept.and_then(|bytes| Self::from_bytes(&bytes, triangles.len())) {
            return kept;
        }
        let made = Self::new(positions, triangles);
        let written = fs::create_dir_all(folder).and_then(|()| write_atomic(&path, &made.bytes()));
        if written.is_ok() {
            leave_newest(folder);
        }
        made
    }

    fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let bvh::Hierarchy { nodes, order } = bvh::build(positions, triangles);
        let corners = |&triangle: &u32| {
            triangles[triangle as usize].map(|corner| Vec3A::from_array(positions[corner as usize]))
        };
        let mut ordered: Vec<[Vec3A; 3]> = order.par_iter().map(corners).collect();
        if let Some(&last) = ordered.last() {
            ordered.resize(ordered.len().next_multiple_of(PATCH), last);
        }
        let horizons = horizon::horizons(&ordered, &nodes);
        Self { nodes, order, horizons }
    }

    /// A hash, the number of nodes, and the three lists.
    fn bytes(&self) -> Vec<u8> {
        let nodes = self.nodes.len() as u64;
        let lists: [&[u8]; 4] = [
            bytemuck::bytes_of(&nodes),
            bytemuck::cast_slice(&self.nodes),
            bytemuck::cast_slice(&self.order),
            bytemuck::cast_slice(&self.horizons),
        ];
        let content = lists.concat();
        [hash_bytes(&content).as_bytes(), content.as_slice()].concat()
    }

    /// `None` where a file is not what was written.
    fn from_bytes(bytes: &[u8], triangles: usize) -> Option<Self> {
        let (hash, content) = bytes.split_at_checked(HASH)?;
        if hash != hash_bytes(content).as_bytes() {
            return None;
        }
        let (count, mut rest) = content.split_first_chunk()?;
        let nodes = usize::try_from(u64::from_ne_bytes(*count)).ok()?;
        let found = Self {
            nodes: list(&mut rest, nodes)?,
            order: list(&mut rest, triangles)?,
            horizons: list(&mut rest, triangles.div_ceil(PATCH))?,
        };
        rest.is_empty().then_some(found)
    }
}

/// The next `count` elements.
fn list<T: Pod>(rest: &mut &[u8], count: usize) -> Option<Vec<T>> {
    let (own, after) = rest.split_at_checked(count.checked_mul(size_of::<T>())?)?;
    *rest = after;
    Some(bytemuck::pod_collect_to_vec(own))
}

fn key(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> String {
    let order: &[u8] = if cfg!(target_endian = "big") { b"big" } else { b"little" };
    let shape: [&[u8]; 2] = [bytemuck::cast_slice(positions), bytemuck::cast_slice(triangles)];
    hash_bytes(&[&CODE[..], &[order], &shape].concat().concat())
}

/// Removes the oldest files beyond [`MOST_FILES`]. What cannot be removed stays.
fn leave_newest(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let mut files: Vec<(SystemTime, PathBuf)> = entries
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let ours = path.extension().is_some_and(|extension| extension == EXTENSION);
            ours.then(|| Some((fs::metadata(&path).ok()?.modified().ok()?, path))).flatten()
        })
        .collect();
    files.sort();
    for (_, path) in files.iter().rev().skip(MOST_FILES) {
        let _ = fs::remove_file(path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sphere of 2 x 40 x 20 triangles.
    fn sphere() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let at = |i: u32, j: u32| {
            let (longitude, latitude) = (
                i as f32 / 40.0 * std::f32::consts::TAU,
                (0.05 + 0.9 * j as f32 / 20.0) * std::f32::consts::PI,
            );
            let (sin, cos) = latitude.sin_cos();
            [sin * longitude.cos(), sin * longitude.sin(), cos]
        };
        let index = |i: u32, j: u32| j * 40 + i % 40;
        let positions = (0..=20).flat_map(|j| (0..40).map(move |i| at(i, j))).collect();
        let triangles = (0..20)
            .flat_map(|j| (0..40).map(move |i| (i, j)))
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [index(i, j), index(i, j + 1), index(i + 1, j + 1), index(i + 1, j)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        (positions, triangles)
    }

    #[test]
    fn what_is_kept_is_what_was_made_and_a_damaged_file_is_made_again() {
        let (positions, triangles) = sphere();
        let folder = tempfile::tempdir().unwrap();
        let below = folder.path().join("below");
        let made = Prepared::new(&positions, &triangles);
        assert_eq!(Prepared::kept_in(&below, &positions, &triangles), made);
        let files = || -> Vec<PathBuf> { fs::read_dir(&below).unwrap().map(|f| f.unwrap().path()).collect() };
        let [path] = &files()[..] else { panic!("{:?}", files()) };
        let whole = fs::read(path).unwrap();
        // What is in the file is what is given, if its hash is right.
        let other = Prepared { horizons: vec![[0.5; 4]; made.horizons.len()], ..made.clone() };
        fs::write(path, other.bytes()).unwrap();
        assert_eq!(Prepared::kept_in(&below, &positions, &triangles), other);
        let mut flipped = whole.clone();
        flipped[2000] ^= 1;
        for damaged in [&flipped[..], &whole[..whole.len() - 1], &whole[..40], &[]] {
            fs::write(path, damaged).unwrap();
            assert_eq!(Prepared::kept_in(&below, &positions, &triangles), made);
            assert_eq!(fs::read(path).unwrap(), whole);
        }
        // Another shape has a file of its own.
        let mut moved = positions.clone();
        moved[7][0] += 1e-3;
        assert_ne!(Prepared::kept_in(&below, &moved, &triangles), made);
        assert_eq!(files().len(), 2);
    }

    #[test]
    fn the_oldest_files_go() {
        let folder = tempfile::tempdir().unwrap();
        for number in 0..MOST_FILES + 3 {
            let path = folder.path().join(format!("{number}.{EXTENSION}"));
            fs::write(&path, []).unwrap();
            let age = std::time::Duration::from_secs(1000 - number as u64);
            fs::File::options()
                .write(true)
                .open(&path)
                .unwrap()
                .set_modified(SystemTime::now() - age)
                .unwrap();
        }
        fs::write(folder.path().join("notes.txt"), []).unwrap();
        leave_newest(folder.path());
        assert!(!folder.path().join(format!("2.{EXTENSION}")).exists());
        assert!(folder.path().join(format!("3.{EXTENSION}")).exists());
        assert!(folder.path().join("notes.txt").exists());
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_no_obstacle() {
        let (positions, triangles) = sphere();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, []).unwrap();
        let made = Prepared::kept_in(&file.join("below"), &positions, &triangles);
        assert_eq!(made, Prepared::new(&positions, &triangles));
    }
}
