//! Values from a file, cut to what a person reads: a cell may hold megabytes.

use crate::Snippet;

/// Most characters of a value in backticks.
const QUOTED_CHARS: usize = 80;
/// Most characters of one part of an error.
const PART_CHARS: usize = 600;
/// Most bytes of a line of a snippet.
const LINE_BYTES: usize = 240;

/// The first characters of `text`, an ellipsis and the number of all, where it is longer than `most`.
fn cut(text: &str, most: usize) -> Option<(&str, usize)> {
    let (end, _) = text.char_indices().nth(most)?;
    Some((&text[..end], text.chars().count()))
}

/// A part of an error with its long quoted values cut.
pub(crate) fn shortened(text: String) -> String {
    if text.len() <= QUOTED_CHARS {
        return text;
    }
    let mut out = String::new();
    for (i, piece) in text.split('`').enumerate() {
        if i > 0 {
            out.push('`');
        }
        match cut(piece, QUOTED_CHARS).filter(|_| i % 2 == 1) {
            Some((first, count)) => out.push_str(&format!("{first}… ({count} characters)")),
            None => out.push_str(piece),
        }
        if out.len() > 8 * PART_CHARS {
            break;
        }
    }
    match cut(&out, PART_CHARS) {
        Some((first, _)) => format!("{first}… ({} characters)", text.chars().count()),
        None => out,
    }
}

impl Snippet {
    /// The text with a span of it, long lines cut to what is about the span.
    pub fn new(text: &str, offset: usize, length: usize) -> Self {
        if text.lines().all(|line| line.len() <= LINE_BYTES) {
            return Self { text: text.to_owned(), offset, length };
        }
        let mut out = Self { text: String::new(), offset: 0, length: 1 };
        let mut start = 0;
        for line in text.split_inclusive('\n') {
            let end = start + line.len();
            let last = end >= text.len();
            let holds = (start..end).contains(&offset) || (last && offset >= end);
            let kept = if holds { offset.saturating_sub(start).saturating_sub(LINE_BYTES / 3) } else { 0 };
            let from = line.floor_char_boundary(kept);
            let to = line.floor_char_boundary(from.saturating_add(LINE_BYTES).min(line.len()));
            if from > 0 {
                out.text.push('…');
            }
            let at = out.text.len();
            out.text.push_str(&line[from..to]);
            if holds {
                let within = (offset - start).clamp(from, to) - from;
                out.offset = at + within;
                out.length = length.min(to - from - within).max(1);
            }
            if to < line.len() {
                out.text.push_str("…\n");
            }
            start = end;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::{InputError, Table};

    #[test]
    fn a_long_value_is_cut_and_its_length_said() {
        let long = "x".repeat(4_000_000);
        let said = InputError::new("a.csv", format!("`{long}` is wrong"))
            .cell(3, long.clone())
            .found(format!("`{long}`, `short`"))
            .expected(&long);
        let said = said.help(format!("not `{long}`"));
        assert!(said.help.as_ref().is_some_and(|help| help.len() < 200), "{:?}", said.help);
        let said = said.to_string();
        assert!(said.contains("x… (4000000 characters)`, `short`") && said.len() < 2000, "{}", said.len());
        // What is short, or not quoted, stays.
        let plain =
            "columns a, b, c and many words about them that go on for more than eighty characters in all";
        assert_eq!(shortened(plain.to_owned()), plain);
        assert_eq!(shortened("é".repeat(60)), "é".repeat(60));
    }

    #[test]
    fn a_long_key_a_long_line_and_a_long_cell_are_cut() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Screen {
            #[serde(rename = "width_px")]
            _width_px: u32,
        }
        let long = "k".repeat(4_000_000);
        let text = format!("# é\nwidth_px = 1\n{long} = 2\n# end");
        let error = crate::parse_toml::<Screen>(Path::new("a.toml"), &text).unwrap_err();
        assert!(error.to_string().contains("k… (4000000 characters)"), "{}", error.to_string().len());
        let snippet = error.snippet.clone().unwrap();
        assert!(snippet.text.len() < 600 && snippet.text.starts_with("# é\nwidth_px = 1\nkkk"));
        assert!(snippet.text[snippet.offset..].starts_with('k') && snippet.text.ends_with("# end"));

        let text = format!("a = \"{}\"\nwidth_px = [{}'x']\n", "v".repeat(1000), "1,".repeat(3000));
        let error = crate::parse_toml::<Screen>(Path::new("a.toml"), &text).unwrap_err();
        let snippet = error.snippet.unwrap();
        assert!(snippet.text.len() < 600 && snippet.offset + snippet.length <= snippet.text.len());

        let table = Table::parse(Path::new("t.csv"), &format!("a\n{long}\n")).unwrap();
        assert!(table.number(0, "a").unwrap_err().to_string().len() < 300);
        let error = Table::parse(Path::new("t.csv"), &format!("{long}\n1\n")).unwrap().require(&["b"]);
        assert!(error.unwrap_err().to_string().len() < 1000);
    }
}
