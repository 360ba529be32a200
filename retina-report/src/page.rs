//! One page.

use std::fmt::Write as _;
use std::path::Path;

use retina_files::{InputError, write_atomic};

use crate::style::STYLE;

/// What stands around the part of a page that [`crate::join`] takes over.
pub(crate) const BEGIN: &str = "<!-- retina.report/1 ";
pub(crate) const END: &str = "<!-- end of retina.report/1 -->";

/// A cell of a table with more characters than this is no figure.
const LONGEST_FIGURE: usize = 24;

/// Text as it may stand in HTML.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A page: a heading and sections.
#[derive(Debug, Clone, PartialEq)]
pub struct Page {
    /// What kind of step it reports, "calibrate geometry": joined pages stand in the order of the work.
    kind: String,
    title: String,
    sections: Vec<Section>,
}

/// A part of a page under its heading.
#[derive(Debug, Clone, PartialEq)]
pub struct Section {
    body: String,
}

impl Section {
    /// An empty section.
    pub fn new(heading: &str) -> Self {
        let mut body = String::new();
        if !heading.is_empty() {
            let _ = writeln!(body, "<h2>{}</h2>", escape(heading));
        }
        Self { body }
    }

    /// What a reader in a hurry takes along: a heading, and short answers under their names. Answers that are empty are
    /// left out.
    #[must_use]
    pub fn card(mut self, heading: &str, answers: &[(&str, String)]) -> Self {
        let _ = writeln!(self.body, "<div class=\"card\"><h2>{}</h2><dl>", escape(heading));
        for (name, answer) in answers.iter().filter(|(_, answer)| !answer.is_empty()) {
            let _ = writeln!(self.body, "<dt>{}</dt><dd>{}</dd>", escape(name), escape(answer));
        }
        self.body.push_str("</dl></div>\n");
        self
    }

    /// A paragraph.
    #[must_use]
    pub fn text(mut self, text: &str) -> Self {
        let _ = writeln!(self.body, "<p>{}</p>", escape(text));
        self
    }

    /// Lines as they would stand in a terminal.
    #[must_use]
    pub fn lines<T: AsRef<str>>(mut self, lines: &[T]) -> Self {
        let lines: Vec<String> = lines.iter().map(|line| escape(line.as_ref())).collect();
        let _ = writeln!(self.body, "<pre>{}</pre>", lines.join("\n"));
        self
    }

    /// Points of a list; nothing where there are none.
    #[must_use]
    pub fn list<T: AsRef<str>>(mut self, points: &[T]) -> Self {
        if !points.is_empty() {
            let points: String =
                points.iter().map(|point| format!("<li>{}</li>\n", escape(point.as_ref()))).collect();
            let _ = writeln!(self.body, "<ul>\n{points}</ul>");
        }
        self
    }

    /// A table; its first column is text, the others are figures unless their cells are long.
    #[must_use]
    pub fn table(mut self, headings: &[&str], rows: &[Vec<String>]) -> Self {
        // A column of long cells is text whatever its place.
        let is_text = |k: usize| {
            rows.iter().any(|row| row.get(k).is_some_and(|cell| cell.chars().count() > LONGEST_FIGURE))
        };
        let class: Vec<&str> =
            (0..headings.len()).map(|k| if is_text(k) { " class=\"text\"" } else { "" }).collect();
        let cells = |tag: &str, cells: &mut dyn Iterator<Item = &str>| -> String {
            let class = |k: usize| class.get(k).copied().unwrap_or_default();
            cells
                .enumerate()
                .map(|(k, cell)| format!("<{tag}{}>{}</{tag}>", class(k), escape(cell)))
                .collect()
        };
        let _ = writeln!(
            self.body,
            "<div class=\"wide\"><table>\n<tr>{}</tr>",
            cells("th", &mut headings.iter().copied())
        );
        for row in rows {
            let _ = writeln!(self.body, "<tr>{}</tr>", cells("td", &mut row.iter().map(String::as_str)));
        }
        self.body.push_str("</table></div>\n");
        self
    }

    /// A figure as SVG, with what it shows beneath it.
    #[must_use]
    pub fn figure(mut self, svg: &str, caption: &str) -> Self {
        let _ = writeln!(
            self.body,
            "<figure>\n<div class=\"wide\">{}</div>\n<figcaption>{}</figcaption></figure>",
            svg.trim(),
            escape(caption)
        );
        self
    }

    /// Panels as SVGs of their own, as many beside each other as the page's width takes, with what they show beneath them;
    /// nothing where there are none.
    #[must_use]
    pub fn figures<T: AsRef<str>>(mut self, svgs: &[T], caption: &str) -> Self {
        if !svgs.is_empty() {
            let svgs: Vec<&str> = svgs.iter().map(|svg| svg.as_ref().trim()).collect();
            let _ = writeln!(
                self.body,
                "<figure>\n<div class=\"figures\">\n{}\n</div>\n<figcaption>{}</figcaption></figure>",
                svgs.join("\n"),
                escape(caption)
            );
        }
        self
    }

    /// Files and their hashes: what the step was made from.
    #[must_use]
    pub fn files<'a>(self, files: impl IntoIterator<Item = (&'a Path, &'a str)>) -> Self {
        let name =
            |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let lines: Vec<String> =
            files.into_iter().map(|(path, hash)| format!("{hash}  {}", name(path))).collect();
        self.lines(&lines)
    }
}

impl Page {
    /// An empty page of a step, as its command is called: "calibrate geometry", "diagnose".
    pub fn new(kind: &str, title: &str) -> Self {
        Self { kind: kind.to_owned(), title: title.to_owned(), sections: Vec::new() }
    }

    /// With one more section.
    #[must_use]
    pub fn section(mut self, section: Section) -> Self {
        self.sections.push(section);
        self
    }

    /// The page with a section right after its first, the card.
    #[must_use]
    pub fn after_card(mut self, section: Section) -> Self {
        self.sections.insert(self.sections.len().min(1), section);
        self
    }

    /// As HTML.
    pub fn html(&self) -> String {
        let sections: String = self.sections.iter().map(|section| section.body.as_str()).collect();
        let title = escape(&self.title);
        let article = format!("<article>\n<h1>{title}</h1>\n{sections}</article>");
        document(&self.title, &format!("{BEGIN}{} -->\n{article}\n{END}", escape(&self.kind)))
    }

    /// Writes it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), InputError> {
        write_page(path, &self.html())
    }
}

pub(crate) fn write_page(path: &Path, html: &str) -> Result<(), InputError> {
    write_atomic(path, html.as_bytes())
        .map_err(|error| InputError::new(path, format!("cannot be written: {error}")))
}

/// A whole document about `body`.
pub(crate) fn document(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>{}</title>\n<style>{STYLE}</style></head>\
         <body>\n{body}\n</body></html>\n",
        escape(title)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_become_markup() {
        let page = Page::new("compare", "a < b")
            .section(Section::new("x & y").text("<script>").list(&["<li>"]).lines(&["<pre>"]))
            .section(Section::new("").table(&["name", "<th>"], &[vec!["\"q\"".into(), "1".into()]]));
        let html = page.html();
        for wrong in ["<script>", "a < b", "x & y", "<li><li>", "<pre><pre>", "<th><th>"] {
            assert!(!html.contains(wrong), "{wrong}");
        }
        assert!(!html.contains("class=\"text\""));
        assert!(html.contains("&quot;q&quot;") && html.contains("<title>a &lt; b</title>"));
    }

    /// Panels lie in a grid of their own; a long cell makes its column, and no other, one of text.
    #[test]
    fn panels_and_text_have_their_places() {
        let long = "a = 1.00 \u{b1} 0.01; b = 2.00 \u{b1} 0.02";
        let page = Page::new("fit", "t").section(
            Section::new("")
                .figures(&["<svg>1</svg>", "<svg>2</svg>"], "two")
                .figures::<&str>(&[], "none")
                .table(&["name", "p", "parameters"], &[vec!["n".into(), "0.1".into(), long.into()]]),
        );
        let html = page.html();
        assert!(html.contains("<div class=\"figures\">\n<svg>1</svg>\n<svg>2</svg>\n</div>"));
        assert!(!html.contains("none</figcaption>"));
        assert!(html.contains("<td>n</td><td>0.1</td><td class=\"text\">a = 1.00"));
        assert_eq!(html.matches("class=\"text\"").count(), 2);
    }
}
