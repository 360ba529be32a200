//! The panes beside the workbench: sequences, live scenes, the bench, lens systems, results. What they show lies in the
//! given paths or ships with the program; nothing of them is kept but in the page's address.

mod bench;
mod live;
mod optics;
mod pose;
mod results;
mod sequence;

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::Router;
use axum::http::{HeaderName, HeaderValue};
use axum::response::{IntoResponse as _, Response};
use retina_files::{InputError, read_text};
use retina_geometry::Setup;
use serde::Deserialize;
use serde_json::Value;

use crate::api::App;
use crate::failure::Refusal;

/// What is held open between requests, because opening it takes longer than using it.
#[derive(Default)]
pub(crate) struct Held {
    live: Mutex<live::Live>,
    benches: Mutex<bench::Benches>,
}

pub(crate) fn routes() -> Router<Arc<App>> {
    Router::new()
        .merge(sequence::routes())
        .merge(results::routes())
        .merge(live::routes())
        .merge(bench::routes())
        .merge(optics::routes())
}

/// A request about a file or folder of the given paths.
#[derive(Debug, Deserialize)]
struct At {
    at: String,
}

/// Work that failed beside leaves what it held as it was between two requests.
fn locked<T>(held: &Mutex<T>) -> MutexGuard<'_, T> {
    held.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The setup that the page names: one that ships, or a file of the given paths.
fn setup_of(app: &App, named: &str) -> Result<Setup, Refusal> {
    match Setup::shipped(Path::new(named)) {
        Some(setup) => Ok(setup),
        None => Ok(Setup::read(&app.path(named)?)?),
    }
}

fn read_json(file: &Path) -> Result<Value, InputError> {
    parse_json(file, &read_text(file)?)
}

fn parse_json(file: &Path, text: &str) -> Result<Value, InputError> {
    serde_json::from_str(text).map_err(|error| InputError::new(file, format!("is no JSON: {error}")))
}

/// Numbers of an image as the page reads them: width and height as little-endian u32, then the values row by row.
fn image_bytes<const N: usize>(
    size_px: [usize; 2],
    values: impl ExactSizeIterator<Item = [u8; N]>,
) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 + N * values.len());
    size_px.iter().for_each(|size| out.extend((*size as u32).to_le_bytes()));
    values.for_each(|value| out.extend(value));
    out
}

/// An image with what is known of it in a header.
fn with_facts(bytes: Vec<u8>, kind: &'static str, facts: &Value) -> Response {
    let mut response = ([(axum::http::header::CONTENT_TYPE, kind)], bytes).into_response();
    response.headers_mut().insert(HeaderName::from_static("x-retina"), ascii_json(facts));
    response
}

/// A document in ASCII, as a header may hold it: JSON has escapes for all else.
fn ascii_json(value: &Value) -> HeaderValue {
    let mut text = String::new();
    for unit in value.to_string().encode_utf16() {
        match u8::try_from(unit) {
            Ok(byte) if byte.is_ascii() => text.push(char::from(byte)),
            _ => text.push_str(&format!("\\u{unit:04x}")),
        }
    }
    // serde_json escapes what controls; nothing is left that a header refuses.
    HeaderValue::from_str(&text).unwrap_or(HeaderValue::from_static("{}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_go_through_a_header_whatever_their_names_are() {
        let facts = serde_json::json!({ "axes": "Mondé \u{1f315}.tf\n", "px": [1.5, -2.0] });
        let header = ascii_json(&facts);
        let again: Value = serde_json::from_str(header.to_str().unwrap()).unwrap();
        assert_eq!(again, facts);
    }
}
