//! A JSON document walked key by key; errors name the path of keys.

use std::path::Path;

use retina_files::{InputError, nearest, read_text};
use serde_json::{Map, Value};

/// The keys of `camera_settings`.
pub(crate) const CAMERA_KEYS: [&str; 10] = [
    "fov",
    "res_x",
    "res_y",
    "film_exposure",
    "sensor",
    "K",
    "clip_start",
    "clip_end",
    "bit_encoding",
    "viewtransform",
];
/// CORTO's other keys that a file may have beside one that is missing.
const OTHER_KEYS: [&str; 8] = [
    "camera_settings",
    "sun_settings",
    "body_settings",
    "rendering_settings",
    "angle",
    "energy",
    "position",
    "orientation",
];

/// Reads a JSON file.
///
/// # Errors
/// The file cannot be read or is not JSON, with line and column.
pub(crate) fn read_json(file: &Path) -> Result<Value, InputError> {
    let text = read_text(file)?;
    serde_json::from_str(&text).map_err(|error| {
        // The message ends with its own " at line L column C".
        let message = error.to_string();
        let message = message.split(" at line ").next().unwrap_or_default();
        let mut out = InputError::new(file, format!("is not valid JSON: {message}"))
            .help("JSON knows no NaN, no Infinity, no comments and no comma before a closing bracket");
        out.place = retina_files::Place::LineColumn(error.line(), error.column());
        out
    })
}

/// A value and where it stands.
#[derive(Debug, Clone)]
pub(crate) struct Node<'a> {
    pub(crate) file: &'a Path,
    /// Such as `camera_settings.fov` or `camera.position[3]`; empty for the whole document.
    pub(crate) path: String,
    value: &'a Value,
}

impl<'a> Node<'a> {
    pub(crate) fn root(file: &'a Path, value: &'a Value) -> Self {
        Self { file, path: String::new(), value }
    }

    /// An error about this value.
    pub(crate) fn error(&self, problem: impl Into<String>) -> InputError {
        let error = InputError::new(self.file, problem);
        if self.path.is_empty() { error } else { error.at(format!("key `{}`", self.path)) }
    }

    fn wrong(&self, expected: &str) -> InputError {
        self.error("the value is of another kind than it should be")
            .found(describe(self.value))
            .expected(expected)
    }

    fn table(&self) -> Result<&'a Map<String, Value>, InputError> {
        self.value.as_object().ok_or_else(|| self.wrong("a table { ... }"))
    }

    fn child(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Whether there is such a key.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.value.get(key).is_some()
    }

    /// The keys of the table, in the file's order.
    pub(crate) fn keys(&self) -> Result<Vec<&'a str>, InputError> {
        Ok(self.table()?.keys().map(String::as_str).collect())
    }

    pub(crate) fn optional(&self, key: &str) -> Result<Option<Self>, InputError> {
        let value = self.table()?.get(key);
        Ok(value.map(|value| Self { file: self.file, path: self.child(key), value }))
    }

    /// The value of a key that must be there; `expected` says what it holds.
    pub(crate) fn key(&self, key: &str, expected: &str) -> Result<Self, InputError> {
        let table = self.table()?;
        match self.optional(key)? {
            Some(node) => Ok(node),
            None => {
                let error = InputError::new(self.file, format!("the key `{}` is missing", self.child(key)))
                    .expected(expected);
                // A key that CORTO knows is no slip of the pen for another.
                let strangers = table
                    .keys()
                    .map(String::as_str)
                    .filter(|key| !CAMERA_KEYS.contains(key) && !OTHER_KEYS.contains(key));
                let near = nearest(key, strangers);
                Err(match near {
                    Some(near) => error.help(format!("is `{}` meant?", near.escape_default())),
                    None => error,
                })
            }
        }
    }

    pub(crate) fn number(&self) -> Result<f64, InputError> {
        self.value.as_f64().filter(|value| value.is_finite()).ok_or_else(|| self.wrong("a number"))
    }

    /// A number of a range.
    pub(crate) fn within(&self, range: std::ops::RangeInclusive<f64>) -> Result<f64, InputError> {
        let value = self.number()?;
        if range.contains(&value) {
            return Ok(value);
        }
        Err(self.error("the value is out of its range").found(value).expected(format!(
            "{} to {}",
            range.start(),
            range.end()
        )))
    }

    pub(crate) fn positive(&self) -> Result<f64, InputError> {
        let value = self.number()?;
        if value > 0.0 {
            return Ok(value);
        }
        Err(self.error("the value is out of its range").found(value).expected("a number above 0"))
    }

    /// A whole number of a range.
    pub(crate) fn integer(&self, range: std::ops::RangeInclusive<i64>) -> Result<i64, InputError> {
        let value = self.value.as_i64().ok_or_else(|| self.wrong("a whole number"))?;
        if range.contains(&value) {
            return Ok(value);
        }
        Err(self.error("the value is out of its range").found(value).expected(format!(
            "{} to {}",
            range.start(),
            range.end()
        )))
    }

    pub(crate) fn text(&self) -> Result<&'a str, InputError> {
        self.value.as_str().ok_or_else(|| self.wrong("a text in quotation marks"))
    }

    pub(crate) fn list(&self, expected: &str) -> Result<Vec<Self>, InputError> {
        let values = self.value.as_array().ok_or_else(|| self.wrong(expected))?;
        let node = |(i, value)| Self { file: self.file, path: format!("{}[{i}]", self.path), value };
        Ok(values.iter().enumerate().map(node).collect())
    }

    /// A list of N numbers.
    pub(crate) fn vector<const N: usize>(&self) -> Result<[f64; N], InputError> {
        let expected = format!("a list of {N} numbers");
        let entries = self.list(&expected)?;
        if entries.len() != N {
            return Err(self
                .error("the list has another length than it should")
                .found(format!("{} entries", entries.len()))
                .expected(expected));
        }
        let mut values = [0.0; N];
        for (value, entry) in values.iter_mut().zip(&entries) {
            *value = entry.number()?;
        }
        Ok(values)
    }

    /// Adds a note for each key that is not among the known ones.
    pub(crate) fn name_unknown(&self, known: &[&str], notes: &mut Vec<String>) -> Result<(), InputError> {
        for key in self.keys()? {
            if !known.contains(&key) {
                let file = self.file.file_name().unwrap_or_default().to_string_lossy();
                notes.push(format!("{file}: the key `{}` is not known and not used", self.child(key)));
            }
        }
        Ok(())
    }
}

/// A value in words, short.
fn describe(value: &Value) -> String {
    match value {
        Value::Null => "null".into(),
        Value::Bool(value) => value.to_string(),
        Value::Number(value) => format!("the number {value}"),
        Value::String(text) => {
            let short: String = text.chars().take(40).collect();
            format!("the text \"{}\"", short.escape_default())
        }
        Value::Array(values) => format!("a list of {} entries", values.len()),
        Value::Object(_) => "a table".into(),
    }
}
