//! One page.

use std::fmt::Write as _;
use std::path::Path;

use retina_files::{InputError, write_atomic};

// Figures keep white paper in the dark: their inks are made for it.
const STYLE: &str = ":root{--ink:#222;--paper:#fff;--shade:#f6f6f6;--line:#ddd;--faint:#555}\
    @media(prefers-color-scheme:dark){:root{--ink:#ddd;--paper:#181818;--shade:#242424;--line:#444;--faint:#aaa}\
    figure svg,figure img{background:#fff}}\
    body{font:15px/1.5 sans-serif;max-width:1400px;margin:2em auto;padding:0 1em;color:var(--ink);background:var(--paper)}\
    pre{background:var(--shade);padding:1em;overflow-x:auto}svg,img{max-width:100%;height:auto}\
    .wide{overflow-x:auto}table{border-collapse:collapse}\
    th,td{padding:.2em .8em;border-bottom:1px solid var(--line);text-align:right}\
    th:first-child,td:first-child{text-align:left}figcaption{color:var(--faint);max-width:60em}figure{margin:1em 0}\
    .card{border:1px solid var(--line);border-left:.5em solid #0072b2;background:var(--shade);padding:.6em 1em;margin:1em 0}\
    .card h2{margin:.1em 0 .4em}.card dl{display:grid;grid-template-columns:max-content 1fr;gap:.2em 1em;margin:0}\
    .card dt{color:var(--faint)}.card dd{margin:0}\
    @media(max-width:600px){.card dl{display:block}.card dd{margin:0 0 .4em}}\
    article+article{border-top:2px solid var(--line);margin-top:3em}";

/// What stands around the part of a page that [`crate::join`] takes over.
pub(crate) const BEGIN: &str = "<!-- retina.report/1 ";
pub(crate) const END: &str = "<!-- end of retina.report/1 -->";

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

    /// A table; its first column is text, the others are figures.
    #[must_use]
    pub fn table(mut self, headings: &[&str], rows: &[Vec<String>]) -> Self {
        let cells = |tag: &str, cells: &mut dyn Iterator<Item = &str>| -> String {
            cells.map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect()
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
            "<figure>\n{}\n<figcaption>{}</figcaption></figure>",
            svg.trim(),
            escape(caption)
        );
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
        assert!(html.contains("&quot;q&quot;") && html.contains("<title>a &lt; b</title>"));
    }
}
