//! TOML with errors that point at the place and suggest the nearest known key.

use std::path::Path;

use serde::de::DeserializeOwned;

use crate::{InputError, Place, Snippet, read_text};

/// Reads a TOML file into `T`; types should carry `#[serde(deny_unknown_fields)]`.
///
/// # Errors
/// The file cannot be read, is not TOML, or does not fit `T`: with line, column and, for an
/// unknown key or variant, the nearest known name.
pub fn read_toml<T: DeserializeOwned>(path: &Path) -> Result<T, InputError> {
    parse_toml(path, &read_text(path)?)
}

/// As [`read_toml`], from text already in memory; `path` only names it in errors.
pub fn parse_toml<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, InputError> {
    toml::from_str(text).map_err(|error| {
        let message = error.message().lines().next().unwrap_or("not valid TOML").trim();
        let mut out = InputError::new(path, message);
        out.help = suggestion(message);
        if let Some(span) = error.span() {
            let before = &text[..span.start.min(text.len())];
            let line = before.matches('\n').count() + 1;
            let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
            out.place = Place::LineColumn(line, column);
            out.snippet = Some(Snippet {
                text: text.to_owned(),
                offset: span.start,
                length: span.end.saturating_sub(span.start).max(1),
            });
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
    fn missing_key_is_named() {
        let error = parse_toml::<Screen>(Path::new("a.toml"), "").unwrap_err();
        assert!(error.to_string().contains("width_px"), "{error}");
    }
}
