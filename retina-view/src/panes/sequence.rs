//! Rendered sequences: what a folder holds, and its frames one by one.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use axum::Router;
use axum::extract::{Path as Route, Query, State};
use axum::http::header;
use axum::response::IntoResponse as _;
use axum::routing::get;
use retina_batch::{FolderState, read_exr};
use retina_files::{InputError, read_bytes};
use serde_json::json;

use super::{At, image_bytes, read_json};
use crate::api::{Answer, App, Shared, beside, bytes_of, json_of, within};
use crate::failure::Refusal;
use crate::session::file_name;

pub(super) fn routes() -> Router<Arc<App>> {
    Router::new()
        .route("/api/sequence", get(about))
        .route("/api/sequence/image/{frame}", get(image))
        .route("/api/sequence/truth/{frame}", get(truth))
        .route("/api/sequence/layer/{frame}/{name}", get(layer))
}

/// A file of a frame, of those that a run writes.
fn file_of(dir: &Path, kind: &str, frame: usize, extension: &str) -> Result<PathBuf, Refusal> {
    within(dir, dir.join(kind).join(format!("{frame:06}.{extension}")))
}

/// Frames in which the layers' names are looked for: a damaged one hides nothing of the others.
const LOOKED_AT: usize = 5;

async fn about(State(app): Shared, Query(at): Query<At>) -> Answer {
    beside(move || {
        let dir = app.path(&at.at)?;
        let state = FolderState::read(&dir, false)?
            .ok_or_else(|| InputError::new(&dir, "is no folder that `retina render` wrote"))?;
        let record_file = within(&dir, dir.join("batch.json"))?;
        let record = read_json(&record_file)?;
        let exr = state.done.iter().take(LOOKED_AT).find_map(|&frame| {
            let (image, _) = read_exr(&file_of(&dir, "frames", frame, "exr").ok()?).ok()?;
            Some(image.channels)
        });
        let layers: Vec<String> = exr.unwrap_or_default().into_iter().map(|(name, _)| name).collect();
        json_of(json!({
            "name": file_name(&dir),
            "frames": state.done,
            "torn": state.torn,
            "frames_of_sequence": state.frames_of_sequence,
            "record": record,
            "layers": layers,
        }))
    })
    .await
}

async fn image(State(app): Shared, Route(frame): Route<usize>, Query(at): Query<At>) -> Answer {
    beside(move || {
        let bytes = read_bytes(&file_of(&app.path(&at.at)?, "frames", frame, "png")?)?;
        Ok(([(header::CONTENT_TYPE, "image/png")], bytes).into_response())
    })
    .await
}

async fn truth(State(app): Shared, Route(frame): Route<usize>, Query(at): Query<At>) -> Answer {
    beside(move || json_of(read_json(&file_of(&app.path(&at.at)?, "truth", frame, "json")?)?)).await
}

async fn layer(
    State(app): Shared,
    Route((frame, name)): Route<(usize, String)>,
    Query(at): Query<At>,
) -> Answer {
    beside(move || {
        let (image, _) = read_exr(&file_of(&app.path(&at.at)?, "frames", frame, "exr")?)?;
        let values = image.channels.into_iter().find(|(own, _)| *own == name);
        let (_, values) = values.ok_or_else(|| Refusal::not_found("such layer"))?;
        bytes_of(image_bytes([image.width_px, image.height_px], values.into_iter().map(f32::to_le_bytes)))
    })
    .await
}
