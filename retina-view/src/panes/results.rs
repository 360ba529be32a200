//! Results of navigation: documents and lists as they stand in their files.

use std::path::Path;
use std::sync::Arc;

use axum::Router;
use axum::extract::{Query, State};
use axum::routing::get;
use retina_files::{InputError, read_text};
use serde_json::{Value, json};

use super::{At, parse_json, read_json};
use crate::api::{Answer, App, Shared, beside, json_of, within};
use crate::served::RESULTS;
use crate::session::file_name;

pub(super) fn routes() -> Router<Arc<App>> {
    Router::new().route("/api/results", get(results))
}

async fn results(State(app): Shared, Query(at): Query<At>) -> Answer {
    beside(move || {
        let path = app.path(&at.at)?;
        let mut files = vec![path.clone()];
        if path.is_dir() {
            let entries = std::fs::read_dir(&path)
                .map_err(|error| InputError::new(&path, format!("cannot be read: {error}")))?;
            files = entries.flatten().map(|entry| entry.path()).filter(|file| file.is_file()).collect();
            files.retain(|file| within(&path, file.clone()).is_ok());
            files.sort();
        }
        let mut documents = Vec::new();
        for file in files {
            documents.extend(document(&file)?);
        }
        json_of(json!({ "name": file_name(&path), "documents": documents }))
    })
    .await
}

/// A document of results, or a list of lines behind a head; `None` of another file.
fn document(file: &Path) -> Result<Option<Value>, InputError> {
    let extension = file.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let value = match extension {
        "json" => read_json(file)?,
        "jsonl" => {
            let text = read_text(file)?;
            // A line that a killed run did not finish is none.
            let mut lines = text.split_inclusive('\n').filter(|line| line.ends_with('\n'));
            let Some(head) = lines.next() else { return Ok(None) };
            let mut head = parse_json(file, head)?;
            let rows = lines.map(|line| parse_json(file, line)).collect::<Result<Vec<Value>, _>>()?;
            if let Some(head) = head.as_object_mut() {
                head.insert("rows".to_owned(), Value::Array(rows));
            }
            head
        }
        _ => return Ok(None),
    };
    let known = value["schema"].as_str().is_some_and(|schema| RESULTS.contains(&schema));
    Ok(known.then(|| json!({ "file": file_name(file), "document": value })))
}
