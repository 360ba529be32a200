//! The page, built from `page/` and carried in the program.

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

/// Path, type of content and bytes of each file.
const FILES: [(&str, &str, &[u8]); 4] = [
    ("/", "text/html; charset=utf-8", include_bytes!("../page/dist/index.html")),
    ("/view.js", "text/javascript; charset=utf-8", include_bytes!("../page/dist/view.js")),
    ("/view.css", "text/css; charset=utf-8", include_bytes!("../page/dist/view.css")),
    ("/icon.svg", "image/svg+xml", include_bytes!("../page/dist/icon.svg")),
];

/// A file of the page.
pub(crate) fn file(path: &str) -> Response {
    match FILES.iter().find(|(own, ..)| *own == path) {
        Some((_, kind, bytes)) => ([(header::CONTENT_TYPE, *kind)], *bytes).into_response(),
        None => (StatusCode::NOT_FOUND, "there is no such page\n").into_response(),
    }
}
