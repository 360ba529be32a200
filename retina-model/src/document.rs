//! The glTF container: GLB chunks, JSON, buffers, buffer views and accessors.
//!
//! Every length and index is checked here before it is used. The `gltf` crate's own readers and
//! validation trust the file in places (they index with what it says), so only its JSON types are
//! used.

use std::borrow::Cow;
use std::path::Path;

use gltf::json;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;
use retina_files::{InputError, read_bytes};

use crate::uri::{read_external, resolve_uri};

/// A parsed document with its buffers in memory.
pub(crate) struct Document<'a> {
    pub(crate) path: &'a Path,
    pub(crate) root: json::Root,
    buffers: Vec<Cow<'a, [u8]>>,
}

/// The elements of an accessor as numbers, integers as `u32` or real components as `f32`.
pub(crate) struct Elements<'d> {
    bytes: &'d [u8],
    stride: usize,
    pub(crate) count: usize,
    pub(crate) components: usize,
    component: ComponentType,
    normalized: bool,
}

const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// The JSON and BIN chunks of a GLB, or the whole file as JSON where it does not start as a GLB.
fn split_container<'b>(path: &Path, bytes: &'b [u8]) -> Result<(&'b [u8], Option<&'b [u8]>), InputError> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let word = |at: usize| -> Result<u32, InputError> {
        bytes
            .get(at..at + 4)
            .and_then(|b| b.try_into().ok())
            .map(u32::from_le_bytes)
            .ok_or_else(|| truncated(path, "GLB header", at + 4, bytes.len()))
    };
    let (version, length) = (word(4)?, word(8)? as usize);
    if version != 2 {
        return Err(InputError::new(path, "is a GLB of another version")
            .at("GLB header")
            .found(format!("version {version}"))
            .expected("version 2"));
    }
    if length < HEADER_BYTES || length > bytes.len() {
        return Err(truncated(path, "GLB header", length, bytes.len()));
    }
    let (mut json_chunk, mut bin_chunk) = (None, None);
    let mut at = HEADER_BYTES;
    while at + CHUNK_HEADER_BYTES <= length {
        let (chunk_length, kind) = (word(at)? as usize, word(at + 4)?.to_le_bytes());
        let start = at + CHUNK_HEADER_BYTES;
        let end = start.saturating_add(chunk_length);
        let name = String::from_utf8_lossy(&kind).trim_end_matches('\0').to_owned();
        let Some(chunk) = bytes[..length].get(start..end) else {
            return Err(truncated(path, &format!("GLB chunk `{}`", name.escape_default()), end, length));
        };
        match &kind {
            b"JSON" if json_chunk.is_none() => json_chunk = Some(chunk),
            b"BIN\0" if bin_chunk.is_none() => bin_chunk = Some(chunk),
            // The specification has readers skip chunks of kinds they do not know.
            _ => {}
        }
        at = end;
    }
    let json_chunk = json_chunk
        .ok_or_else(|| InputError::new(path, "the GLB holds no JSON chunk").help("export the file again"))?;
    Ok((json_chunk, bin_chunk))
}

fn truncated(path: &Path, part: &str, needed: usize, there: usize) -> InputError {
    InputError::new(path, "is cut short, or its lengths are wrong")
        .at(part)
        .found(format!("{there} bytes"))
        .expected(format!("{needed} bytes"))
        .help("copy or export the file again")
}

impl<'a> Document<'a> {
    /// Parses a GLB or glTF file's bytes and gathers its buffers, reading external ones.
    pub(crate) fn parse(path: &'a Path, bytes: &'a [u8]) -> Result<Self, InputError> {
        let (json_bytes, bin) = split_container(path, bytes)?;
        let root: json::Root = json::deserialize::from_slice(json_bytes).map_err(|error| {
            InputError::new(path, format!("is not a readable glTF document: {error}"))
                .help("give a .glb or .gltf file of glTF 2.0")
        })?;
        if !root.asset.version.starts_with("2.") {
            return Err(InputError::new(path, "is a glTF of another version")
                .at("asset.version")
                .found(&root.asset.version)
                .expected("2.0"));
        }
        let mut buffers = Vec::with_capacity(root.buffers.len());
        for (i, buffer) in root.buffers.iter().enumerate() {
            let place = format!("buffer {i}");
            let data = match &buffer.uri {
                Some(uri) => Cow::Owned(read_external(path, &place, uri)?),
                None if i == 0 => match bin {
                    Some(chunk) => Cow::Borrowed(chunk),
                    None => {
                        return Err(InputError::new(path, "the buffer has neither a URI nor a BIN chunk")
                            .at(place)
                            .help("export the file again, with its geometry"));
                    }
                },
                None => {
                    return Err(InputError::new(path, "only buffer 0 may be the GLB's BIN chunk").at(place));
                }
            };
            let length = usize::try_from(buffer.byte_length.0).unwrap_or(usize::MAX);
            if length > data.len() {
                return Err(truncated(path, &place, length, data.len()));
            }
            buffers.push(data);
        }
        Ok(Self { path, root, buffers })
    }

    /// An error at a named part of this file.
    pub(crate) fn error(&self, place: &str, problem: impl Into<String>) -> InputError {
        InputError::new(self.path, problem).at(place)
    }

    /// The item that an index names, or an error that says how many there are.
    pub(crate) fn item<'d, T>(
        &self,
        items: &'d [T],
        index: usize,
        what: &str,
        place: &str,
    ) -> Result<&'d T, InputError> {
        items.get(index).ok_or_else(|| {
            self.error(place, format!("names a {what} that does not exist"))
                .found(format!("{what} {index}"))
                .expected(format!("one of {} (from 0)", items.len()))
        })
    }

    /// The bytes of a buffer view.
    pub(crate) fn view_bytes(&self, view: usize, place: &str) -> Result<&[u8], InputError> {
        let entry = self.item(&self.root.buffer_views, view, "buffer view", place)?;
        let buffer = self.item(&self.buffers, entry.buffer.value(), "buffer", place)?;
        let start = usize::try_from(entry.byte_offset.map_or(0, |o| o.0)).unwrap_or(usize::MAX);
        let length = usize::try_from(entry.byte_length.0).unwrap_or(usize::MAX);
        buffer.get(start..start.saturating_add(length)).ok_or_else(|| {
            self.error(place, format!("buffer view {view} reaches beyond its buffer"))
                .found(format!("bytes {start} to {}", start.saturating_add(length)))
                .expected(format!("within {} bytes", buffer.len()))
        })
    }

    /// The elements of an accessor, all within the file.
    ///
    /// Sparse accessors and accessors without a buffer view are refused: the first are rare in
    /// shape models, the second would be a mesh of zeros.
    pub(crate) fn elements(&self, index: usize, place: &str) -> Result<Elements<'_>, InputError> {
        let accessor = self.item(&self.root.accessors, index, "accessor", place)?;
        if accessor.sparse.is_some() {
            return Err(self
                .error(place, format!("accessor {index} is sparse, which is not supported"))
                .help("export the mesh with plain accessors"));
        }
        let (Checked::Valid(component), Checked::Valid(kind)) = (&accessor.component_type, &accessor.type_)
        else {
            return Err(self
                .error(place, format!("accessor {index} has an unknown componentType or type"))
                .help("export the file again"));
        };
        if matches!(kind, Type::Mat2 | Type::Mat3 | Type::Mat4) {
            return Err(self.error(place, "holds matrices").expected("scalars or vectors"));
        }
        let Some(view) = accessor.buffer_view else {
            return Err(self
                .error(place, format!("accessor {index} has no buffer view, so it holds no data"))
                .help("export the file again"));
        };
        let bytes = self.view_bytes(view.value(), place)?;
        let components = kind.multiplicity();
        let element = components * component.0.size();
        let stride = match self.root.buffer_views.get(view.value()).and_then(|v| v.byte_stride) {
            None => element,
            Some(s) if (4..=252).contains(&s.0) && s.0 % 4 == 0 && s.0 >= element => s.0,
            Some(s) => {
                return Err(self
                    .error(place, format!("buffer view {} has a stride that cannot be", view.value()))
                    .found(format!("{} bytes", s.0))
                    .expected(format!("a multiple of 4 from {element} to 252 bytes")));
            }
        };
        let count = usize::try_from(accessor.count.0).unwrap_or(usize::MAX);
        let offset = usize::try_from(accessor.byte_offset.map_or(0, |o| o.0)).unwrap_or(usize::MAX);
        let end = count
            .checked_sub(1)
            .map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(element))
            .and_then(|n| n.checked_add(offset));
        let inside = end.and_then(|end| bytes.get(offset..end));
        let Some(inside) = inside else {
            return Err(self
                .error(place, format!("accessor {index} reaches beyond its buffer view"))
                .found(format!("{count} elements of {element} bytes, stride {stride}, from byte {offset}"))
                .expected(format!("within {} bytes", bytes.len())));
        };
        Ok(Elements {
            bytes: inside,
            stride,
            count,
            components,
            component: component.0,
            normalized: accessor.normalized,
        })
    }
}

impl Elements<'_> {
    fn raw(&self, element: usize, component: usize) -> &[u8] {
        let start = element * self.stride + component * self.component.size();
        self.bytes.get(start..start + self.component.size()).unwrap_or(&[])
    }

    /// Whether the components are 32-bit floats.
    pub(crate) fn is_float(&self) -> bool {
        self.component == ComponentType::F32
    }

    /// Whether the components are unsigned integers that stand for 0..1.
    pub(crate) fn is_unsigned_fraction(&self) -> bool {
        self.normalized && matches!(self.component, ComponentType::U8 | ComponentType::U16)
    }

    /// Whether the components are unsigned integers, as indices are.
    pub(crate) fn is_index(&self) -> bool {
        self.components == 1
            && !self.normalized
            && matches!(self.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32)
    }

    /// What the accessor holds, for messages.
    pub(crate) fn describe(&self) -> String {
        let suffix = if self.normalized { ", normalised" } else { "" };
        format!("{} components of {:?}{suffix}", self.components, self.component)
    }

    /// An unsigned integer element.
    pub(crate) fn index(&self, element: usize) -> u32 {
        match *self.raw(element, 0) {
            [a] => u32::from(a),
            [a, b] => u32::from(u16::from_le_bytes([a, b])),
            [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
            _ => 0,
        }
    }

    /// The first `N` components of an element; normalised integers are scaled as the glTF
    /// specification (3.6.2.2, data types) says. Components that the accessor lacks are 0.
    pub(crate) fn vector<const N: usize>(&self, element: usize) -> [f32; N] {
        std::array::from_fn(|c| if c < self.components { self.real(element, c) } else { 0.0 })
    }

    fn real(&self, element: usize, component: usize) -> f32 {
        let (value, full) = match (self.raw(element, component), self.component) {
            (&[a], ComponentType::U8) => (f32::from(a), 255.0),
            (&[a], _) => (f32::from(a as i8), 127.0),
            (&[a, b], ComponentType::U16) => (f32::from(u16::from_le_bytes([a, b])), 65535.0),
            (&[a, b], _) => (f32::from(i16::from_le_bytes([a, b])), 32767.0),
            (&[a, b, c, d], ComponentType::F32) => return f32::from_le_bytes([a, b, c, d]),
            (&[a, b, c, d], _) => return u32::from_le_bytes([a, b, c, d]) as f32,
            _ => return 0.0,
        };
        if self.normalized { (value / full).max(-1.0) } else { value }
    }
}

/// Reads a whole file that a document names (image or buffer).
pub(crate) fn image_bytes<'d>(
    document: &'d Document<'_>,
    image: usize,
    place: &str,
) -> Result<Cow<'d, [u8]>, InputError> {
    let entry = document.item(&document.root.images, image, "image", place)?;
    match (&entry.uri, entry.buffer_view) {
        (Some(uri), None) => Ok(Cow::Owned(read_external(document.path, place, uri)?)),
        (None, Some(view)) => Ok(Cow::Borrowed(document.view_bytes(view.value(), place)?)),
        _ => Err(document
            .error(place, format!("image {image} must have either a URI or a buffer view"))
            .help("export the file again, with its textures")),
    }
}

/// Every file that a document names beside itself, in the document's order: what a hash of the
/// model must cover.
///
/// # Errors
/// As loading: the document cannot be parsed, or a URI is refused.
pub fn external_files(path: &Path) -> Result<Vec<std::path::PathBuf>, InputError> {
    if crate::ModelKind::of(path)? != crate::ModelKind::Gltf {
        // An OBJ's materials are not read, and the others have none.
        return Ok(Vec::new());
    }
    let bytes = read_bytes(path)?;
    let document = Document::parse(path, &bytes)?;
    let buffers = document.root.buffers.iter().map(|b| ("buffer", &b.uri));
    let images = document.root.images.iter().map(|i| ("image", &i.uri));
    let mut files = Vec::new();
    for (what, uri) in buffers.chain(images) {
        if let Some(uri) = uri
            && let Some(file) = resolve_uri(path, what, uri)?
        {
            files.push(file);
        }
    }
    Ok(files)
}
