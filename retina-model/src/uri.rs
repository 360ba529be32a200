//! URIs of buffers and images: data URIs, and relative paths that stay below the model's folder.

use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use retina_files::{InputError, read_bytes};

/// Takes what exporters write: padded or not, whatever the last letter's unused bits.
const READER: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// The bytes that a URI names: decoded from a data URI, or read from a file beside the model.
pub(crate) fn read_external(model: &Path, place: &str, uri: &str) -> Result<Vec<u8>, InputError> {
    match resolve_uri(model, place, uri)? {
        Some(file) => read_bytes(&file).map_err(|error| {
            InputError::new(model, format!("names a file that {}", error.problem))
                .at(place)
                .found(file.display())
                .help("put the file beside the model, or export a .glb that holds everything")
        }),
        None => decode_data_uri(uri).ok_or_else(|| {
            InputError::new(model, "holds a data URI that does not decode")
                .at(place)
                .expected("data:[<type>];base64,<base64 text>")
        }),
    }
}

/// The file that a URI names, `None` for a data URI.
///
/// # Errors
/// Remote URIs, absolute paths and paths with `..`: a model may read only from its own folder
/// downwards.
pub(crate) fn resolve_uri(model: &Path, place: &str, uri: &str) -> Result<Option<PathBuf>, InputError> {
    if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
        return Ok(None);
    }
    let refuse = |problem: &str| {
        let shown: String = uri.chars().take(120).collect();
        InputError::new(model, problem)
            .at(place)
            .found(format!("`{}`", shown.escape_default()))
            .expected("a relative path below the model's folder")
    };
    let first = uri.split(['/', '?', '#']).next().unwrap_or("");
    if first.contains(':') {
        return Err(refuse("names a remote or absolute URI, which is not fetched"));
    }
    let Some(relative) = percent_decode(uri) else {
        return Err(refuse("names a URI whose percent escapes do not decode"));
    };
    let outside = relative.starts_with(['/', '\\'])
        || relative.contains(['\0', ':'])
        || relative.split(['/', '\\']).any(|part| part == "..");
    if outside || relative.is_empty() {
        return Err(refuse("names a file outside the model's folder"));
    }
    Ok(Some(model.parent().unwrap_or(Path::new("")).join(relative)))
}

fn percent_decode(text: &str) -> Option<String> {
    let mut out = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(byte) = bytes.next() {
        if byte == b'%' {
            let high = char::from(bytes.next()?).to_digit(16)?;
            let low = char::from(bytes.next()?).to_digit(16)?;
            out.push(u8::try_from(high * 16 + low).ok()?);
        } else {
            out.push(byte);
        }
    }
    String::from_utf8(out).ok()
}

fn decode_data_uri(uri: &str) -> Option<Vec<u8>> {
    let (head, text) = uri.split_once(',')?;
    if !head.to_ascii_lowercase().ends_with(";base64") {
        return None;
    }
    READER.decode(text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_uris_with_and_without_padding_are_read() {
        let read = |text: &str| decode_data_uri(&format!("data:;base64,{text}"));
        // RFC 4648, sec. 10.
        for text in ["Zm9vYg==", "Zm9vYg", "Zm9vYh=="] {
            assert_eq!(read(text).as_deref(), Some(&b"foob"[..]), "{text}");
        }
        assert_eq!(read("Zm9vY"), None);
        assert_eq!(read("Zm!v"), None);
    }

    #[test]
    fn only_paths_below_the_model_are_read() {
        let model = Path::new("folder/body.gltf");
        let resolve = |uri| resolve_uri(model, "image 0", uri);
        assert_eq!(resolve("maps/a%20b.png").unwrap(), Some(PathBuf::from("folder/maps/a b.png")));
        assert_eq!(resolve("data:;base64,AA==").unwrap(), None);
        for bad in [
            "http://x/a.png",
            "file:///etc/passwd",
            "../a.png",
            "a/%2e%2e/b",
            "/a",
            "C:\\a",
            "a%00",
            "",
            "%zz",
        ] {
            assert!(resolve(bad).is_err(), "{bad}");
        }
    }
}
