//! Literals of Python: what a `.cameramodel` and the header of an npy array are written in.
//!
//! Dicts, lists, tuples, strings, byte strings, numbers, True, False, None; comments from `#` to the end of a line. No
//! escapes within strings: neither file has any.

use std::path::Path;

use retina_files::InputError;

/// Lists within lists, at most.
const MOST_DEPTH: usize = 16;
/// Keys of a dict, at most.
const MOST_KEYS: usize = 1000;

/// A literal, with the line it begins on where that is asked for.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Literal {
    None,
    Bool(bool),
    Number(f64),
    Text(String),
    Bytes(String),
    List(Vec<Self>),
    /// Keys, with their lines.
    Dict(Vec<(String, usize, Self)>),
}

impl Literal {
    pub(crate) fn get(&self, key: &str) -> Option<(usize, &Self)> {
        let Self::Dict(entries) = self else { return None };
        entries.iter().find(|entry| entry.0 == key).map(|entry| (entry.1, &entry.2))
    }

    /// Numbers of a list.
    pub(crate) fn numbers(&self) -> Option<Vec<f64>> {
        let Self::List(items) = self else { return None };
        items.iter().map(|item| if let Self::Number(v) = item { Some(*v) } else { None }).collect()
    }
}

/// A text for an error, without control characters.
pub(crate) fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

struct Reader<'a> {
    path: &'a Path,
    text: &'a str,
    at: usize,
}

/// Parses one literal that fills the text.
pub(crate) fn parse(path: &Path, text: &str) -> Result<Literal, InputError> {
    let mut reader = Reader { path, text, at: 0 };
    let out = reader.value(0)?;
    reader.skip();
    match reader.rest().chars().next() {
        None => Ok(out),
        Some(_) => Err(reader.wrong("goes on after its end", "nothing after the last bracket")),
    }
}

impl<'a> Reader<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn line(&self) -> usize {
        self.text[..self.at].matches('\n').count() + 1
    }

    fn wrong(&self, problem: &str, expected: &str) -> InputError {
        let found: String = self.rest().chars().take(20).collect();
        InputError::new(self.path, problem)
            .line(self.line())
            .found(if found.is_empty() { "the end".to_owned() } else { format!("`{}`", printable(&found)) })
            .expected(expected)
            .help("the file is damaged, or edited by hand; take it anew from the program that wrote it")
    }

    /// White space and comments.
    fn skip(&mut self) {
        loop {
            let rest = self.rest();
            self.at += rest.len() - rest.trim_start().len();
            if !self.rest().starts_with('#') {
                return;
            }
            self.at += self.rest().find('\n').unwrap_or(self.rest().len());
        }
    }

    fn eat(&mut self, mark: char) -> bool {
        self.skip();
        let there = self.rest().starts_with(mark);
        self.at += if there { mark.len_utf8() } else { 0 };
        there
    }

    fn quoted(&mut self) -> Result<String, InputError> {
        let Some(quote) = self.rest().chars().next().filter(|c| *c == '\'' || *c == '"') else {
            return Err(self.wrong("lacks a string", "a string in quotes"));
        };
        let inside = &self.rest()[1..];
        let Some(end) = inside.find(quote) else {
            return Err(self.wrong("has a string without an end", "a closing quote"));
        };
        self.at += end + 2;
        Ok(inside[..end].to_owned())
    }

    fn value(&mut self, depth: usize) -> Result<Literal, InputError> {
        self.skip();
        if depth > MOST_DEPTH {
            return Err(self.wrong("is nested too deeply", "at most 16 brackets within each other"));
        }
        let rest = self.rest();
        match rest.chars().next() {
            Some('{') => self.dict(depth),
            Some('[') => self.list('[', ']', depth),
            Some('(') => self.list('(', ')', depth),
            Some('\'' | '"') => Ok(Literal::Text(self.quoted()?)),
            Some('b') if rest[1..].starts_with(['\'', '"']) => {
                self.at += 1;
                Ok(Literal::Bytes(self.quoted()?))
            }
            _ => self.word(),
        }
    }

    fn word(&mut self) -> Result<Literal, InputError> {
        let rest = self.rest();
        let inside = |c: char| c.is_ascii_alphanumeric() || "+-._".contains(c);
        let word = &rest[..rest.find(|c| !inside(c)).unwrap_or(rest.len())];
        let out = match word {
            "None" => Literal::None,
            "True" => Literal::Bool(true),
            "False" => Literal::Bool(false),
            _ => match word.parse::<f64>() {
                Ok(value) if value.is_finite() => Literal::Number(value),
                _ => {
                    return Err(
                        self.wrong("has a value that is none of Python's", "a number, string, list or dict")
                    );
                }
            },
        };
        self.at += word.len();
        Ok(out)
    }

    fn list(&mut self, open: char, close: char, depth: usize) -> Result<Literal, InputError> {
        self.eat(open);
        let mut items = Vec::new();
        while !self.eat(close) {
            items.push(self.value(depth + 1)?);
            if !self.eat(',') {
                if self.eat(close) {
                    break;
                }
                return Err(self.wrong("has a list that does not go on", "a comma or the closing bracket"));
            }
        }
        Ok(Literal::List(items))
    }

    fn dict(&mut self, depth: usize) -> Result<Literal, InputError> {
        self.eat('{');
        let mut entries: Vec<(String, usize, Literal)> = Vec::new();
        while !self.eat('}') {
            self.skip();
            if entries.len() == MOST_KEYS {
                return Err(self.wrong("has a dict of too many keys", "at most 1000 keys"));
            }
            let line = self.line();
            let key = self.quoted()?;
            if !self.eat(':') {
                return Err(self.wrong("has a key without a value", "a colon"));
            }
            if entries.iter().any(|entry| entry.0 == key) {
                return Err(InputError::new(self.path, "has a key twice")
                    .line(line)
                    .found(format!("`{}`", key.escape_default()))
                    .expected("each key once"));
            }
            entries.push((key, line, self.value(depth + 1)?));
            if !self.eat(',') {
                if self.eat('}') {
                    break;
                }
                return Err(self.wrong("has a dict that does not go on", "a comma or the closing brace"));
            }
        }
        Ok(Literal::Dict(entries))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Literal, InputError> {
        parse(Path::new("a.cameramodel"), text)
    }

    #[test]
    fn a_header_of_npy_and_a_dict_with_comments() {
        let found = read("{'descr': '<f8', 'fortran_order': False, 'shape': (8, 6,), }  \n").unwrap();
        assert_eq!(found.get("shape").unwrap().1.numbers().unwrap(), [8.0, 6.0]);
        assert_eq!(found.get("fortran_order").unwrap().1, &Literal::Bool(false));
        let found = read("# a\n{ 'x': b'#no{comment', # it's\n 'y': [ -1e3, ] }").unwrap();
        assert_eq!(found.get("x"), Some((2, &Literal::Bytes("#no{comment".into()))));
        assert_eq!(found.get("y").unwrap(), (3, &Literal::List(vec![Literal::Number(-1e3)])));
    }

    #[test]
    fn damage_is_told_with_its_line() {
        for (text, said) in [
            ("{'a': 1\n 'b': 2}", "a.cameramodel, line 2: has a dict that does not go on (found `'b': 2}`"),
            ("{'a': [1,\n2", "line 2: has a list that does not go on (found the end"),
            ("{'a': nan}", "line 1: has a value that is none of Python's"),
            ("{'a': 'x", "has a string without an end"),
            ("{'a': 1, 'a': 2}", "has a key twice (found `a`"),
            ("{} {}", "goes on after its end"),
            ("", "(found the end"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
        assert!(read(&"[".repeat(100_000)).unwrap_err().to_string().contains("nested too deeply"));
    }
}
