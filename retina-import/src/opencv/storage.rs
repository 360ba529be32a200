//! Files of `cv::FileStorage` as trees of values: JSON, and the part of YAML that it writes.
//!
//! Of YAML: maps and lists by indentation, lists and maps in brackets over several lines, strings in quotes, comments, and
//! tags, which are passed over. Anchors, block strings and several documents are refused or read as text.

use std::path::Path;

use retina_files::{InputError, read_text};
use serde_json::{Map, Number, Value};

use crate::literal::printable;

/// Most bytes of a calibration.
const MOST_BYTES: usize = 64 << 20;
/// Maps and lists within each other, at most.
const MOST_DEPTH: usize = 32;

/// Reads a file as the tree of its values; the top is a map.
pub(crate) fn read(path: &Path) -> Result<Map<String, Value>, InputError> {
    let text = read_text(path)?;
    let text = text.trim_start_matches('\u{feff}');
    if text.len() > MOST_BYTES {
        return Err(InputError::new(path, "is too large for a calibration")
            .found(format!("{} bytes", text.len()))
            .expected(format!("at most {MOST_BYTES} bytes")));
    }
    let first = text.trim_start();
    if first.starts_with("<?xml") {
        return Err(InputError::new(path, "is XML, which is not read")
            .found("`<?xml`")
            .expected("YAML or JSON")
            .help("let OpenCV write it as .yaml or .json"));
    }
    let value = if first.starts_with('{') {
        serde_json::from_str(text).map_err(|error| {
            InputError::new(path, "is no valid JSON")
                .line(error.line())
                .found(error)
                .help("the file is damaged, or edited by hand")
        })?
    } else {
        Yaml::new(path, text).document()?
    };
    match value {
        Value::Object(map) => Ok(map),
        _ => Err(InputError::new(path, "is no calibration")
            .found("no map of names and values")
            .expected("camera_matrix: ...")),
    }
}

/// A line without its comment.
struct Line<'a> {
    number: usize,
    indent: usize,
    text: &'a str,
}

struct Yaml<'a> {
    path: &'a Path,
    lines: Vec<Line<'a>>,
    at: usize,
}

/// A line up to its comment: `#` at its start or after a blank, not in quotes.
fn uncommented(line: &str) -> &str {
    let mut quote = None;
    let mut before = ' ';
    for (at, c) in line.char_indices() {
        match quote {
            Some(q) if c == q => quote = None,
            Some(_) => {}
            None if c == '"' || c == '\'' => quote = Some(c),
            None if c == '#' && before.is_whitespace() => return &line[..at],
            None => {}
        }
        before = c;
    }
    line
}

impl<'a> Yaml<'a> {
    fn new(path: &'a Path, text: &'a str) -> Self {
        let lines = text.lines().enumerate().filter_map(|(k, line)| {
            let whole = uncommented(line).trim_end();
            let text = whole.trim_start();
            let mark = text.starts_with('%') || (whole == text && (text == "---" || text == "..."));
            (!text.is_empty() && !mark).then_some(Line {
                number: k + 1,
                indent: whole.len() - text.len(),
                text,
            })
        });
        Self { path, lines: lines.collect(), at: 0 }
    }

    fn wrong(&self, number: usize, problem: &str, found: &str, expected: &str) -> InputError {
        let found: String = found.chars().take(40).collect();
        InputError::new(self.path, problem)
            .line(number)
            .found(format!("`{}`", printable(&found)))
            .expected(expected)
            .help("only what cv::FileStorage writes is read; JSON may be easier to give")
    }

    fn document(mut self) -> Result<Value, InputError> {
        let out = self.block(0)?;
        match self.lines.get(self.at) {
            None => Ok(out),
            Some(line) => Err(self.wrong(
                line.number,
                "a line is indented like none before it",
                line.text,
                "the indentation of its neighbours",
            )),
        }
    }

    /// The map or list that begins at the current line.
    fn block(&mut self, depth: usize) -> Result<Value, InputError> {
        let Some(first) = self.lines.get(self.at) else { return Ok(Value::Null) };
        if depth > MOST_DEPTH {
            return Err(self.wrong(first.number, "is nested too deeply", first.text, "at most 32 levels"));
        }
        let indent = first.indent;
        if first.text == "-" || first.text.starts_with("- ") {
            return self.items(indent, depth);
        }
        let mut out = Map::new();
        while let Some(line) = self.lines.get(self.at).filter(|line| line.indent == indent) {
            let (number, text) = (line.number, line.text);
            let split = text.find(": ").or_else(|| text.strip_suffix(':').map(str::len));
            let Some(colon) = split else {
                return Err(self.wrong(number, "a line is no name with a value", text, "`name: value`"));
            };
            let key = text[..colon].trim().trim_matches(['"', '\'']).to_owned();
            self.at += 1;
            let value = self.value(untagged(&text[colon + 1..]), number, indent, depth)?;
            if out.insert(key.clone(), value).is_some() {
                return Err(self.wrong(number, "has a name twice", &key, "each name once"));
            }
        }
        Ok(Value::Object(out))
    }

    fn items(&mut self, indent: usize, depth: usize) -> Result<Value, InputError> {
        let mut out = Vec::new();
        while let Some(line) = self.lines.get_mut(self.at) {
            let item = line.text.strip_prefix('-').filter(|rest| rest.is_empty() || rest.starts_with(' '));
            let Some(rest) = item.filter(|_| line.indent == indent) else { break };
            let text = untagged(rest);
            let number = line.number;
            let is_map =
                !text.starts_with(['[', '{', '"', '\'']) && (text.contains(": ") || text.ends_with(':'));
            if is_map || text.starts_with("- ") {
                // The rest of the line is the first line of a block further in.
                line.indent += line.text.len() - text.len();
                line.text = text;
                out.push(self.block(depth + 1)?);
            } else {
                self.at += 1;
                out.push(self.value(text, number, indent, depth)?);
            }
        }
        Ok(Value::Array(out))
    }

    /// What stands behind a name or a dash: on the line, in brackets over lines, or further in.
    fn value(
        &mut self,
        text: &'a str,
        number: usize,
        indent: usize,
        depth: usize,
    ) -> Result<Value, InputError> {
        if text.is_empty() {
            let further = self.lines.get(self.at).is_some_and(|next| {
                next.indent > indent || (next.indent == indent && next.text.starts_with("- "))
            });
            return if further { self.block(depth + 1) } else { Ok(Value::Null) };
        }
        if !text.starts_with(['[', '{']) {
            return Ok(scalar(text));
        }
        // Brackets may close many lines below.
        let mut whole = text.to_owned();
        let mut open = open_brackets(text);
        while open > 0 {
            let Some(next) = self.lines.get(self.at) else {
                return Err(self.wrong(
                    number,
                    "has a bracket that is not closed",
                    text,
                    "a closing bracket",
                ));
            };
            whole.push(' ');
            whole.push_str(next.text);
            open += open_brackets(next.text);
            self.at += 1;
        }
        let mut flow = Flow { text: &whole, at: 0 };
        let found = flow.value(depth);
        match found {
            Some(value) if flow.rest().trim().is_empty() => Ok(value),
            _ => Err(self.wrong(
                number,
                "has a list that cannot be read",
                &whole[flow.at.min(whole.len())..],
                "values with commas between them",
            )),
        }
    }
}

/// A text without the tag (`!!opencv-matrix`) before it.
fn untagged(text: &str) -> &str {
    let text = text.trim();
    match text.strip_prefix('!') {
        Some(tag) => tag.split_once(' ').map_or("", |(_, rest)| rest.trim()),
        None => text,
    }
}

/// Brackets that a line opens less those that it closes.
fn open_brackets(text: &str) -> i64 {
    let mut quote = None;
    text.chars().fold(0, |open, c| match (quote, c) {
        (Some(q), c) => {
            if c == q {
                quote = None;
            }
            open
        }
        (None, '"' | '\'') => {
            quote = Some(c);
            open
        }
        (None, '[' | '{') => open + 1,
        (None, ']' | '}') => open - 1,
        _ => open,
    })
}

fn scalar(text: &str) -> Value {
    if let Some(quoted) = text.strip_prefix('"').and_then(|t| t.strip_suffix('"')) {
        return Value::String(quoted.to_owned());
    }
    if let Some(quoted) = text.strip_prefix('\'').and_then(|t| t.strip_suffix('\'')) {
        return Value::String(quoted.to_owned());
    }
    let number = text.parse::<f64>().ok().filter(|v| v.is_finite()).and_then(Number::from_f64);
    number.map_or_else(|| Value::String(text.to_owned()), Value::Number)
}

/// Lists and maps in brackets.
struct Flow<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Flow<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn skip(&mut self) {
        self.at += self.rest().len() - self.rest().trim_start().len();
    }

    fn eat(&mut self, mark: char) -> bool {
        self.skip();
        let there = self.rest().starts_with(mark);
        self.at += usize::from(there);
        there
    }

    fn value(&mut self, depth: usize) -> Option<Value> {
        if depth > MOST_DEPTH {
            return None;
        }
        if self.eat('[') {
            let mut out = Vec::new();
            while !self.eat(']') {
                out.push(self.value(depth + 1)?);
                if !self.eat(',') {
                    return self.eat(']').then_some(Value::Array(out));
                }
            }
            return Some(Value::Array(out));
        }
        if self.eat('{') {
            let mut out = Map::new();
            while !self.eat('}') {
                let key = self.word(":")?.trim_matches(['"', '\'']).to_owned();
                if !self.eat(':') {
                    return None;
                }
                out.insert(key, self.value(depth + 1)?);
                if !self.eat(',') {
                    return self.eat('}').then_some(Value::Object(out));
                }
            }
            return Some(Value::Object(out));
        }
        self.word(",]}").map(scalar)
    }

    /// Up to one of some marks; quotes hide them.
    fn word(&mut self, marks: &str) -> Option<&'a str> {
        self.skip();
        let rest = self.rest();
        let end = match rest.chars().next()? {
            quote @ ('"' | '\'') => rest[1..].find(quote)? + 2,
            _ => rest.find(|c| marks.contains(c)).unwrap_or(rest.len()),
        };
        self.at += end;
        let word = rest[..end].trim();
        (!word.is_empty()).then_some(word)
    }
}
