//! The text of an OBJ file as numbers: positions, texture coordinates, normals, triangles.

use std::path::Path;

use glam::{DVec3, Vec2};
use retina_files::InputError;

use crate::load::{MAX_COORDINATE_M, MAX_ELEMENTS};

/// A corner of a triangle: indices from 0 into the file's lists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Corner {
    pub(super) position: u32,
    pub(super) texture: Option<u32>,
    pub(super) normal: Option<u32>,
}

/// A triangle of a face, with what held where the face stands.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triangle {
    pub(super) corners: [Corner; 3],
    /// A smoothing group is on (`s 1` and the like).
    pub(super) smooth: bool,
    /// Line of the face, from 1.
    pub(super) line: usize,
}

/// An OBJ file's content.
#[derive(Debug, Default)]
pub(super) struct Text {
    pub(super) positions_m: Vec<DVec3>,
    /// v downwards from the image's top, as glTF has it; the file counts it upwards.
    pub(super) uvs: Vec<Vec2>,
    pub(super) normals: Vec<DVec3>,
    pub(super) triangles: Vec<Triangle>,
    /// Statements that were passed over: keyword and line of the first, in the file's order; [`MOST_NOTED`] at most.
    pub(super) passed_over: Vec<(String, usize)>,
}

/// What names and groups parts of the mesh, without a meaning here.
const SILENT: [&str; 2] = ["o", "g"];

/// Most kinds of statement that are named as passed over.
const MOST_NOTED: usize = 32;

/// Most corners of a face: the slivers of a larger fan meet every ray that comes near it.
const MOST_CORNERS: usize = 1000;

/// Parses the file's text.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Text, InputError> {
    // Names and comments may be in any encoding; everything that is read is ASCII.
    let text = String::from_utf8_lossy(bytes);
    let mut reader = Reader { path, out: Text::default(), smooth: false, line: 0 };
    let mut joined = String::new();
    for (number, raw) in text.lines().enumerate() {
        let raw = raw.split('#').next().unwrap_or_default().trim();
        if joined.is_empty() {
            reader.line = number + 1;
        }
        if let Some(begun) = raw.strip_suffix('\\') {
            joined.push_str(begun);
            joined.push(' ');
            continue;
        }
        if joined.is_empty() {
            reader.statement(raw)?;
        } else {
            joined.push_str(raw);
            reader.statement(&std::mem::take(&mut joined))?;
        }
    }
    if !joined.is_empty() {
        reader.statement(&joined)?;
    }
    reader.check_references()?;
    Ok(reader.out)
}

struct Reader<'a> {
    path: &'a Path,
    out: Text,
    smooth: bool,
    line: usize,
}

impl Reader<'_> {
    fn error(&self, problem: impl Into<String>) -> InputError {
        InputError::new(self.path, problem).line(self.line)
    }

    fn statement(&mut self, text: &str) -> Result<(), InputError> {
        let mut words = text.split_ascii_whitespace();
        let Some(keyword) = words.next() else { return Ok(()) };
        match keyword {
            "v" => {
                // A weight or a colour may follow; both are of no use here.
                let [x, y, z] = self.numbers(keyword, words, 3..=8)?;
                let position_m = DVec3::new(x, y, z);
                if position_m.abs().max_element() > MAX_COORDINATE_M {
                    return Err(self
                        .error("the vertex is too far out")
                        .found(position_m)
                        .expected(format!("metres, at most {MAX_COORDINATE_M:e} from the origin")));
                }
                // Adding zero turns a negative zero into a positive one: see `Vertex::position_m`.
                self.out.positions_m.push(position_m + 0.0);
                self.check_count(self.out.positions_m.len(), "vertices")
            }
            "vt" => {
                let [u, v] = self.texture_coordinates(words)?;
                self.out.uvs.push(Vec2::new(u as f32, (1.0 - v) as f32));
                self.check_count(self.out.uvs.len(), "texture coordinates")
            }
            "vn" => {
                let normal = DVec3::from_array(self.numbers(keyword, words, 3..=3)?);
                let Some(normal) = normal.try_normalize() else {
                    return Err(self
                        .error("the normal has no length")
                        .found(normal)
                        .help("recompute the normals, or export without them"));
                };
                self.out.normals.push(normal);
                self.check_count(self.out.normals.len(), "normals")
            }
            "f" | "fo" => self.face(words),
            "s" => {
                self.smooth = !matches!(words.next(), None | Some("off" | "0"));
                Ok(())
            }
            _ => {
                let known = &mut self.out.passed_over;
                if known.len() < MOST_NOTED
                    && !SILENT.contains(&keyword)
                    && !known.iter().any(|(k, _)| k == keyword)
                {
                    known.push((keyword.chars().take(40).collect(), self.line));
                }
                Ok(())
            }
        }
    }

    fn check_count(&self, count: usize, what: &str) -> Result<(), InputError> {
        if count <= MAX_ELEMENTS {
            return Ok(());
        }
        Err(self
            .error("the body is larger than it may be")
            .found(format!("{count} {what} up to here"))
            .expected(format!("at most {MAX_ELEMENTS}"))
            .help("use a coarser mesh"))
    }

    fn number(&self, keyword: &str, word: &str) -> Result<f64, InputError> {
        word.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| {
            self.error(format!("`{keyword}` holds what is not a finite number"))
                .found(format!("`{}`", word.escape_default()))
                .expected("numbers, parted by blanks")
        })
    }

    /// The first N of a statement's numbers, which may be as many as `allowed` says.
    fn numbers<'w, const N: usize>(
        &self,
        keyword: &str,
        words: impl Iterator<Item = &'w str>,
        allowed: std::ops::RangeInclusive<usize>,
    ) -> Result<[f64; N], InputError> {
        let mut values = [0.0; N];
        let mut count = 0;
        for word in words {
            let value = self.number(keyword, word)?;
            if let Some(slot) = values.get_mut(count) {
                *slot = value;
            }
            count += 1;
        }
        if allowed.contains(&count) {
            return Ok(values);
        }
        Err(self
            .error(format!("`{keyword}` has another number of values than it should"))
            .found(count)
            .expected(if allowed.start() == allowed.end() {
                allowed.start().to_string()
            } else {
                format!("{} to {}", allowed.start(), allowed.end())
            }))
    }

    /// u and v; v is 0 where it is left out.
    fn texture_coordinates<'w>(&self, words: impl Iterator<Item = &'w str>) -> Result<[f64; 2], InputError> {
        let [u, v] = self.numbers("vt", words, 1..=3)?;
        Ok([u, v])
    }

    fn face<'w>(&mut self, words: impl Iterator<Item = &'w str>) -> Result<(), InputError> {
        let corners: Vec<Corner> = words.map(|word| self.corner(word)).collect::<Result<_, _>>()?;
        if corners.len() < 3 {
            return Err(self
                .error("the face has too few corners")
                .found(corners.len())
                .expected("at least 3"));
        }
        if corners.len() > MOST_CORNERS {
            return Err(self
                .error("the face has too many corners")
                .found(corners.len())
                .expected(format!("at most {MOST_CORNERS}"))
                .help("export the mesh in triangles"));
        }
        for pair in corners[1..].windows(2) {
            let corners = [corners[0], pair[0], pair[1]];
            self.out.triangles.push(Triangle { corners, smooth: self.smooth, line: self.line });
        }
        self.check_count(self.out.triangles.len(), "triangles")
    }

    /// A corner `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, word: &str) -> Result<Corner, InputError> {
        let mut parts = word.split('/');
        let position = parts.next().unwrap_or_default();
        let (texture, normal) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
        if parts.next().is_some() || position.is_empty() {
            return Err(self.corner_error(word));
        }
        let optional = |part: &str, count: usize| match part {
            "" => Ok(None),
            part => self.index(word, part, count).map(Some),
        };
        Ok(Corner {
            position: self.index(word, position, self.out.positions_m.len())?,
            texture: optional(texture, self.out.uvs.len())?,
            normal: optional(normal, self.out.normals.len())?,
        })
    }

    /// An index counted from 1, or backwards from the newest entry, as one from 0.
    fn index(&self, word: &str, part: &str, count: usize) -> Result<u32, InputError> {
        let value: i64 = part.parse().map_err(|_| self.corner_error(word))?;
        let from_zero = match value {
            1.. => Some(value - 1),
            0 => None,
            _ => Some(count as i64 + value).filter(|index| *index >= 0),
        };
        from_zero.and_then(|index| u32::try_from(index).ok()).ok_or_else(|| {
            self.error("a face names an entry that does not exist")
                .found(format!("`{}`", word.escape_default()))
                .expected(format!("1 to {count}, or -1 to -{count} counted backwards"))
        })
    }

    fn corner_error(&self, word: &str) -> InputError {
        self.error("a face's corner cannot be read")
            .found(format!("`{}`", word.escape_default()))
            .expected("v, v/vt, v//vn or v/vt/vn, whole numbers")
    }

    /// Entries may stand behind the faces that name them, so this is known at the end only.
    fn check_references(&mut self) -> Result<(), InputError> {
        for triangle in &self.out.triangles {
            for corner in triangle.corners {
                let lists = [
                    ("vertex", Some(corner.position), self.out.positions_m.len()),
                    ("texture coordinate", corner.texture, self.out.uvs.len()),
                    ("normal", corner.normal, self.out.normals.len()),
                ];
                for (what, index, count) in lists {
                    if let Some(index) = index.filter(|&index| index as usize >= count) {
                        return Err(InputError::new(
                            self.path,
                            format!("a face names a {what} that does not exist"),
                        )
                        .line(triangle.line)
                        .found(format!("{what} {}", u64::from(index) + 1))
                        .expected(format!("1 to {count}")));
                    }
                }
            }
        }
        Ok(())
    }
}
