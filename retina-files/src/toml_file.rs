//! TOML with errors that point at the place and suggest the nearest known key.

use std::path::Path;

use serde::de::DeserializeOwned;

use crate::write::read_text_within;
use crate::{InputError, Place, Snippet};

/// Most bytes of a TOML file.
const MOST_BYTES: u64 = 64 << 20;

/// Reads a TOML file into `T`; types should carry `#[serde(deny_unknown_fields)]`.
///
/// # Errors
/// The file cannot be read, is not TOML, or does not fit `T`: with line, column and, for an
/// unknown key or variant, the nearest known name.
pub fn read_toml<T: DeserializeOwned>(path: &Path) -> Result<T, InputError> {
    parse_toml(path, &read_text_within(path, MOST_BYTES)?)
}

/// Reads a TOML file of a schema into `T`, which takes the key `schema` and ignores it; `what` names the kind of file
/// ("a scene"). Another schema is said before any key of it is looked at.
///
/// # Errors
/// As [`read_toml`]; the file's key `schema` is absent or another.
pub fn read_schema<T: DeserializeOwned>(path: &Path, schema: &str, what: &str) -> Result<T, InputError> {
    parse_schema(path, &read_text_within(path, MOST_BYTES)?, schema, what)
}

/// As [`read_schema`], from text already in memory.
///
/// # Errors
/// As there.
pub fn parse_schema<T: DeserializeOwned>(
    path: &Path,
    text: &str,
    schema: &str,
    what: &str,
) -> Result<T, InputError> {
    #[derive(serde::Deserialize)]
    struct Head {
        schema: Option<toml::Value>,
    }
    let head: Head = parse_toml(path, text)?;
    if head.schema.as_ref().and_then(toml::Value::as_str) != Some(schema) {
        let error = InputError::new(path, format!("is not {what}")).at("key `schema`");
        let error = match head.schema {
            Some(toml::Value::String(other)) => error.found(format!("`{}`", other.escape_default())),
            Some(other) => error.found(other),
            None => error.found("nothing"),
        };
        return Err(error.expected(format!("`{schema}`")));
    }
    parse_toml(path, text)
}

/// As [`read_toml`], from text already in memory; `path` only names it in errors.
pub fn parse_toml<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, InputError> {
    toml::from_str(text).map_err(|error| {
        let message = error.message().lines().next().unwrap_or("not valid TOML").trim();
        let mut out = InputError::new(path, in_plain_words(message));
        out.help = suggestion(message);
        if let Some(span) = error.span() {
            let before = &text[..span.start.min(text.len())];
            let line = before.matches('\n').count() + 1;
            let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
            out.place = Place::LineColumn(line, column);
            out.snippet = Some(Snippet::new(text, span.start, span.end.saturating_sub(span.start).max(1)));
        }
        out
    })
}

/// The candidate nearest to `name`, if any is near enough to be a slip of the pen.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|candidate| (strsim::normalized_damerau_levenshtein(name, candidate), candidate))
        .filter(|(likeness, _)| *likeness >= 0.5)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}

/// serde names Rust's types; a user knows numbers, lists and tables.
fn in_plain_words(message: &str) -> String {
    let Some((found, expected)) = message.rsplit_once(", expected ") else { return message.to_owned() };
    let plain = match expected {
        "f64" | "f32" => "a number".to_owned(),
        "usize" | "u64" | "u32" | "u8" => "a whole number, not negative".to_owned(),
        "i64" | "i32" => "a whole number".to_owned(),
        "a sequence" => "a list [..]".to_owned(),
        "a boolean" => "true or false".to_owned(),
        _ => match (expected.strip_prefix("struct "), expected.strip_prefix("a tuple of size ")) {
            (Some(_), _) => "a table { .. }".to_owned(),
            (_, Some(size)) => format!("a list of {size}"),
            _ => expected
                .strip_prefix("an array of length ")
                .map_or_else(|| expected.to_owned(), |size| format!("a list of {size}")),
        },
    };
    format!("{found}, expected {plain}")
}

/// serde words its message "unknown field `a`, expected one of `b`, `c`": the names are in ticks.
fn suggestion(message: &str) -> Option<String> {
    if !message.starts_with("unknown field") && !message.starts_with("unknown variant") {
        return None;
    }
    let mut names = message.split('`').skip(1).step_by(2);
    let unknown = names.next()?;
    let near = nearest(unknown, names)?;
    Some(format!("did you mean `{near}`?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Screen {
        #[allow(dead_code, reason = "only the parser's complaint is of interest")]
        width_px: u32,
    }

    #[test]
    fn unknown_key_is_pointed_at_and_the_nearest_suggested() {
        let error = parse_toml::<Screen>(Path::new("a.toml"), "# x\nwidht_px = 3\n").unwrap_err();
        assert_eq!(error.place, Place::LineColumn(2, 1));
        assert_eq!(error.help.as_deref(), Some("did you mean `width_px`?"));
    }

    #[test]
    fn types_are_named_in_plain_words() {
        let error = parse_toml::<Screen>(Path::new("a.toml"), "width_px = \"wide\"\n").unwrap_err();
        assert!(error.to_string().contains("expected a whole number, not negative"), "{error}");
        assert_eq!(
            in_plain_words("invalid length 2, expected an array of length 3"),
            "invalid length 2, expected a list of 3"
        );
        assert_eq!(in_plain_words("missing field `setup`"), "missing field `setup`");
    }

    #[test]
    fn a_file_of_another_schema_is_said_before_its_keys() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Screen {
            #[serde(rename = "schema")]
            _schema: serde::de::IgnoredAny,
            #[serde(rename = "width_px")]
            _width_px: u32,
        }
        for (text, found) in
            [("schema = \"b/1\"\nheight = 1", "`b/1`"), ("height = 1", "nothing"), ("schema = 1", "1")]
        {
            let error = parse_schema::<Screen>(Path::new("a.toml"), text, "a/1", "a screen").unwrap_err();
            assert_eq!(error.place, Place::Named("key `schema`".into()));
            let said = error.to_string();
            assert!(
                said.contains("is not a screen") && said.contains("`a/1`") && said.contains(found),
                "{said}"
            );
        }
        let error =
            parse_schema::<Screen>(Path::new("a.toml"), "schema = \"a/1\"\nwidht_px = 1", "a/1", "a screen");
        assert_eq!(error.unwrap_err().place, Place::LineColumn(2, 1));
    }

    #[test]
    fn missing_key_is_named() {
        let error = parse_toml::<Screen>(Path::new("a.toml"), "").unwrap_err();
        assert!(error.to_string().contains("width_px"), "{error}");
    }
}
