//! One page of all pages in a folder.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use retina_files::{InputError, read_bytes};

use crate::page::{BEGIN, END, document, write_page};

/// The order of the work; other kinds come last, by name.
const ORDER: [&str; 9] = [
    "optics",
    "calibrate radiometry",
    "simulate sky",
    "calibrate geometry",
    "compare",
    "diagnose",
    "fit",
    "navigate stars",
    "navigate",
];

/// Writes one page that holds all pages of this kind in `folder` and the folders within, in the order of the work, then of their names. Returns the files that went in. `out` itself is not one of them.
///
/// # Errors
/// The folder cannot be read or has no such page; the page cannot be written.
pub fn join(folder: &Path, out: &Path) -> Result<Vec<PathBuf>, InputError> {
    let mut files = Vec::new();
    pages_in(folder, 0, &mut files)?;
    let mut parts = Vec::new();
    for path in files.into_iter().filter(|path| !same(path, out)) {
        // Pages of others may have any encoding; ours are UTF-8.
        for (kind, body) in articles(&String::from_utf8_lossy(&read_bytes(&path)?)) {
            let rank = ORDER.iter().position(|known| *known == kind).unwrap_or(ORDER.len());
            parts.push((rank, kind, path.clone(), body));
        }
    }
    parts.sort_by(|a, b| (a.0, &a.1, &a.2).cmp(&(b.0, &b.1, &b.2)));
    if parts.is_empty() {
        return Err(InputError::new(folder, "holds no page of a report")
            .expected("pages that retina's commands write with --report FILE.html")
            .help("run them with --report into this folder first"));
    }
    let title = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut contents = String::from("<nav><ol>\n");
    let mut body = String::new();
    for (number, (_, kind, _, part)) in parts.iter().enumerate() {
        let heading = heading(part).unwrap_or(kind);
        let _ = writeln!(contents, "<li><a href=\"#part-{number}\">{heading}</a></li>");
        let part = part.replacen("<article>", &format!("<article id=\"part-{number}\">"), 1);
        let _ = writeln!(body, "{part}");
    }
    contents.push_str("</ol></nav>\n");
    write_page(out, &document(&format!("RETINA: {title}"), &(contents + &body)))?;
    let mut joined: Vec<PathBuf> = parts.into_iter().map(|part| part.2).collect();
    joined.dedup();
    Ok(joined)
}

/// Folders within folders are looked into so deep.
const DEEPEST: usize = 6;

fn pages_in(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<(), InputError> {
    let unreadable = |error: std::io::Error| InputError::new(folder, format!("cannot be read: {error}"));
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.is_dir() && depth < DEEPEST {
            pages_in(&path, depth + 1, files)?;
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("html")) && path.is_file() {
            files.push(path);
        }
    }
    Ok(())
}

fn same(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    }
}

/// The parts of a page, with their kinds. A page that was joined has none: it would come in twice.
fn articles(html: &str) -> Vec<(String, String)> {
    let mut rest = html;
    let mut out = Vec::new();
    while let Some((_, after)) = rest.split_once(BEGIN) {
        let Some((kind, after)) = after.split_once(" -->") else { break };
        let Some((body, after)) = after.split_once(END) else { break };
        out.push((kind.to_owned(), body.trim().to_owned()));
        rest = after;
    }
    out
}

fn heading(part: &str) -> Option<&str> {
    Some(part.split_once("<h1>")?.1.split_once("</h1>")?.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Page, Section};

    #[test]
    fn pages_join_in_the_order_of_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for (name, kind) in
            [("a.html", "fit"), ("b.html", "calibrate geometry"), ("c.html", "calibrate radiometry")]
        {
            Page::new(kind, kind)
                .section(Section::new("figures").figure("<svg/>", name))
                .write(&at(name))
                .unwrap();
        }
        std::fs::write(at("other.html"), b"<html>of someone else \xff</html>").unwrap();
        std::fs::create_dir(at("within")).unwrap();
        std::fs::rename(at("c.html"), at("within/c.html")).unwrap();
        for _ in 0..2 {
            // The second time the joined page stands there too.
            let joined = join(folder.path(), &at("report.html")).unwrap();
            assert_eq!(joined, ["within/c.html", "b.html", "a.html"].map(at));
            let html = std::fs::read_to_string(at("report.html")).unwrap();
            assert_eq!(html.matches("<article").count(), 3);
            assert!(!html.contains("someone else"));
            assert!(html.find("radiometry</h1>") < html.find("geometry</h1>"));
        }
    }

    #[test]
    fn a_folder_without_pages_is_refused_and_nothing_written() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("report.html");
        assert!(join(folder.path(), &out).is_err());
        assert!(!out.exists());
    }
}
