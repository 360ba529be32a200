//! Text kernels: assignments between `\begindata` and `\begintext` (NAIF, Kernel Required Reading).
//!
//! As in SPICE, the variables of all text kernels are one pool: a later `=` replaces a variable, `+=` adds to it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use retina_files::InputError;

/// A value of a variable.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    Number(f64),
    Text(String),
    /// A date, without its `@`.
    Date(String),
}

/// A variable of the pool, and the file and line of its last assignment.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Variable {
    pub(crate) values: Vec<Value>,
    pub(crate) file: PathBuf,
    pub(crate) line: usize,
}

impl Variable {
    /// An error about this variable.
    pub(crate) fn error(&self, name: &str, problem: &str) -> InputError {
        InputError::new(&self.file, format!("`{name}`: {problem}")).line(self.line)
    }
}

/// The variables of text kernels by name.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Pool {
    pub(crate) variables: BTreeMap<String, Variable>,
}

impl Pool {
    /// Adds what a text kernel assigns.
    ///
    /// # Errors
    /// The text is not UTF-8 within its data, or an assignment does not read.
    pub(crate) fn read(&mut self, path: &Path, bytes: &[u8]) -> Result<(), InputError> {
        let mut tokens = tokens(path, bytes)?.into_iter().peekable();
        while let Some((line, token)) = tokens.next() {
            let error = |problem: &str, found: &Token| {
                InputError::new(path, problem.to_owned()).line(line).found(found.shown())
            };
            let Token::Word(name) = token else {
                return Err(error("an assignment has no variable's name", &token).expected("NAME = value"));
            };
            let adds = match tokens.next() {
                Some((_, Token::Equals)) => false,
                Some((_, Token::PlusEquals)) => true,
                other => {
                    let found =
                        other.map_or(Token::Word("the end of the data".to_owned()), |(_, token)| token);
                    return Err(error(&format!("`{name}` is not assigned"), &found)
                        .expected("`=` or `+=` after the name")
                        .help("text between assignments belongs behind `\\begintext`"));
                }
            };
            let is_list = tokens.next_if(|(_, token)| *token == Token::Open).is_some();
            let mut values = Vec::new();
            loop {
                match tokens.next() {
                    Some((_, Token::Close)) if is_list => break,
                    Some((line, Token::Word(word))) => values.push(number_or_date(path, line, &name, &word)?),
                    Some((_, Token::Text(text))) => values.push(Value::Text(text)),
                    other => {
                        let found =
                            other.map_or(Token::Word("the end of the data".to_owned()), |(_, token)| token);
                        return Err(error(&format!("the value of `{name}` does not read"), &found).expected(
                            "a number, a text in single quotes, or a list of them in parentheses",
                        ));
                    }
                }
                if !is_list {
                    break;
                }
            }
            if values.is_empty() {
                return Err(InputError::new(path, format!("`{name}` has no value"))
                    .line(line)
                    .found("()")
                    .expected("one value at least"));
            }
            match self.variables.get_mut(&name) {
                Some(variable) if adds => variable.values.append(&mut values),
                _ => {
                    let variable = Variable { values, file: path.to_path_buf(), line };
                    self.variables.insert(name, variable);
                }
            }
        }
        Ok(())
    }

    /// A variable's numbers, if there is such a variable.
    ///
    /// # Errors
    /// It has a value that is no number, or not so many.
    pub(crate) fn numbers(
        &self,
        name: &str,
        counts: std::ops::RangeInclusive<usize>,
    ) -> Result<Option<Vec<f64>>, InputError> {
        let Some(variable) = self.variables.get(name) else { return Ok(None) };
        let numbers: Option<Vec<f64>> = variable
            .values
            .iter()
            .map(|value| if let Value::Number(number) = value { Some(*number) } else { None })
            .collect();
        let expected = || match (counts.start(), counts.end()) {
            (least, most) if least == most => format!("{least} of them"),
            (least, &usize::MAX) => format!("{least} or more"),
            (least, most) => format!("{least} to {most} of them"),
        };
        match numbers {
            Some(numbers) if counts.contains(&numbers.len()) => Ok(Some(numbers)),
            Some(numbers) => Err(variable
                .error(name, "the count of numbers is wrong")
                .found(numbers.len())
                .expected(expected())),
            None => Err(variable
                .error(name, "a value is no number")
                .found("a text or a date")
                .expected(format!("numbers, {}", expected()))),
        }
    }

    /// A variable's one whole number, if there is such a variable.
    ///
    /// # Errors
    /// It is no whole number of 32 bits.
    pub(crate) fn integer(&self, name: &str) -> Result<Option<i32>, InputError> {
        let Some(numbers) = self.numbers(name, 1..=1)? else { return Ok(None) };
        let number = numbers[0];
        if number.fract() == 0.0 && number.abs() <= f64::from(i32::MAX) {
            return Ok(Some(number as i32));
        }
        Err(self.variables[name].error(name, "is no whole number").found(number).expected("a whole number"))
    }

    /// A variable's texts, if there is such a variable.
    ///
    /// # Errors
    /// It has a value that is no text.
    pub(crate) fn texts(&self, name: &str) -> Result<Option<Vec<&str>>, InputError> {
        let Some(variable) = self.variables.get(name) else { return Ok(None) };
        let texts: Option<Vec<&str>> = variable
            .values
            .iter()
            .map(|value| if let Value::Text(text) = value { Some(text.as_str()) } else { None })
            .collect();
        texts.map(Some).ok_or_else(|| {
            variable.error(name, "a value is no text").found("a number").expected("texts in single quotes")
        })
    }

    /// A variable's one text, if there is such a variable.
    ///
    /// # Errors
    /// It is no single text.
    pub(crate) fn text(&self, name: &str) -> Result<Option<&str>, InputError> {
        let Some(texts) = self.texts(name)? else { return Ok(None) };
        match texts[..] {
            [text] => Ok(Some(text.trim())),
            _ => Err(self.variables[name]
                .error(name, "has several texts")
                .found(texts.len())
                .expected("one text")),
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Word(String),
    Text(String),
    Open,
    Close,
    Equals,
    PlusEquals,
}

impl Token {
    fn shown(&self) -> String {
        match self {
            Self::Word(word) | Self::Text(word) => word.clone(),
            Self::Open => "(".to_owned(),
            Self::Close => ")".to_owned(),
            Self::Equals => "=".to_owned(),
            Self::PlusEquals => "+=".to_owned(),
        }
    }
}

/// The tokens of a kernel's data, each with its line from 1.
fn tokens(path: &Path, bytes: &[u8]) -> Result<Vec<(usize, Token)>, InputError> {
    let (mut found, mut is_data) = (Vec::new(), false);
    // NAIF's kernels end lines by LF, by CR LF and, on old systems, by CR.
    let lines = bytes
        .split(|&byte| byte == b'\n')
        .flat_map(|line| line.strip_suffix(b"\r").unwrap_or(line).split(|&byte| byte == b'\r'));
    for (index, line) in lines.enumerate() {
        let number = index + 1;
        match line.trim_ascii() {
            marker if marker.starts_with(b"\\begindata") => is_data = true,
            marker if marker.starts_with(b"\\begintext") => is_data = false,
            _ if !is_data => {}
            line => {
                let line = std::str::from_utf8(line).map_err(|_| {
                    InputError::new(path, "the data are no text")
                        .line(number)
                        .found("bytes that are not UTF-8")
                        .expected("assignments such as BODY301_RADII = ( 1737.4 1737.4 1737.4 )")
                })?;
                line_tokens(path, number, line, &mut found)?;
            }
        }
    }
    Ok(found)
}

fn line_tokens(
    path: &Path,
    number: usize,
    line: &str,
    found: &mut Vec<(usize, Token)>,
) -> Result<(), InputError> {
    let mut rest = line;
    while let Some(first) = rest.chars().next() {
        let (token, length) = match first {
            _ if first.is_whitespace() || first == ',' => {
                rest = &rest[first.len_utf8()..];
                continue;
            }
            '(' => (Token::Open, 1),
            ')' => (Token::Close, 1),
            '=' => (Token::Equals, 1),
            '+' if rest[1..].starts_with('=') => (Token::PlusEquals, 2),
            '\'' => {
                let (text, length) = quoted(rest).ok_or_else(|| {
                    InputError::new(path, "a text does not end on its line")
                        .line(number)
                        .found(rest)
                        .expected("a closing single quote")
                })?;
                (Token::Text(text), length)
            }
            _ => {
                let end = rest
                    .char_indices()
                    .find(|&(at, char)| {
                        char.is_whitespace()
                            || ",()='".contains(char)
                            || (char == '+' && rest[at + 1..].starts_with('='))
                    })
                    .map_or(rest.len(), |(at, _)| at);
                (Token::Word(rest[..end].to_owned()), end)
            }
        };
        found.push((number, token));
        rest = &rest[length..];
    }
    Ok(())
}

/// A text in single quotes, and its length with them; a quote in it is written twice.
fn quoted(from: &str) -> Option<(String, usize)> {
    let (mut text, mut at) = (String::new(), 1);
    loop {
        let end = at + from[at..].find('\'')?;
        text.push_str(&from[at..end]);
        if !from[end + 1..].starts_with('\'') {
            return Some((text, end + 1));
        }
        text.push('\'');
        at = end + 2;
    }
}

fn number_or_date(path: &Path, line: usize, name: &str, word: &str) -> Result<Value, InputError> {
    if let Some(date) = word.strip_prefix('@') {
        return Ok(Value::Date(date.to_owned()));
    }
    // Fortran's exponents; Rust's words for what is no number are none here.
    let plain = word.replace(['D', 'd'], "E");
    let is_numeric = plain.bytes().all(|byte| byte.is_ascii_digit() || b"+-.eE".contains(&byte));
    plain.parse::<f64>().ok().filter(|number| is_numeric && number.is_finite()).map(Value::Number).ok_or_else(
        || {
            InputError::new(path, format!("a value of `{name}` does not read"))
                .line(line)
                .found(word)
                .expected("a number, a date such as @1972-JAN-1, or a text in single quotes")
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pool(text: &str) -> Result<Pool, String> {
        let mut pool = Pool::default();
        pool.read(Path::new("k.tpc"), text.as_bytes()).map_err(|error| error.to_string())?;
        Ok(pool)
    }

    #[test]
    fn assignments_are_read_as_spice_reads_them() {
        let read = pool(
            "KPL/PCK\nBODY1_IGNORED = ( 1 )\n\\begindata\r\n A = 1.5D2\nB=( 1, 2.0e0\n\t-3 ) C = 'it''s'\n\
             \\begintext\nA = 7\n  \\begindata\nC += ( 'two' )\nD = @1972-JAN-1\nA += 4\nB = 9\n",
        )
        .unwrap();
        assert_eq!(read.numbers("A", 2..=2).unwrap(), Some(vec![150.0, 4.0]));
        assert_eq!(read.integer("B").unwrap(), Some(9));
        assert_eq!(read.texts("C").unwrap(), Some(vec!["it's", "two"]));
        assert_eq!(read.variables["D"].values, [Value::Date("1972-JAN-1".into())]);
        assert_eq!(read.numbers("BODY1_IGNORED", 1..=1).unwrap(), None);
        let said = read.numbers("A", 3..=3).unwrap_err().to_string();
        assert!(said.contains("k.tpc, line 4: `A`: the count of numbers is wrong (found 2"), "{said}");
        assert!(read.integer("C").unwrap_err().to_string().contains("is no number"));
        assert!(read.text("C").unwrap_err().to_string().contains("has several texts"));
    }

    #[test]
    fn what_does_not_read_is_refused_with_its_line() {
        for (data, said) in [
            ("A 3", "line 2: `A` is not assigned (found 3, expected `=` or `+=`"),
            ("A = ", "the value of `A` does not read"),
            ("A = ( 1", "the value of `A` does not read (found the end of the data"),
            ("A = ()", "`A` has no value"),
            ("A = 'open", "line 2: a text does not end on its line"),
            ("A = nan", "a value of `A` does not read (found nan"),
            ("A = 1e999", "does not read (found 1e999"),
            ("= 3", "has no variable's name"),
        ] {
            let error = pool(&format!("\\begindata\n{data}")).unwrap_err();
            assert!(error.contains(said), "{data}: {error}");
        }
    }
}
