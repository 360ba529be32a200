//! What the page may ask.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{DefaultBodyLimit, Path, Query, State};
use axum::http::{StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router, middleware};
use retina_diagnosis::{effects, effects_json, fit_json, signature_svgs};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::bench::EXAMPLES;
use crate::failure::Refusal;
use crate::guard::{Guard, guarded};
use crate::served::{Kind, Served};
use crate::session::{Session, effect_name};
use crate::store::{Dropped, Inputs, Store};
use crate::{columns, export, page, panes};

/// Largest body: a table of some 150 MB.
const MOST_BODY_BYTES: usize = 160 << 20;
/// How long a window waits for news in one request.
const NEWS_S: u64 = 20;

/// What the server knows.
pub(crate) struct App {
    pub(crate) guard: Guard,
    pub(crate) served: Served,
    pub(crate) store: Store,
    /// What the page opens first: the address's fragment, such as `session=...` or `sequence=0`.
    pub(crate) first: Option<String>,
    pub(crate) panes: panes::Held,
}

impl App {
    /// The file or folder that the page names.
    pub(crate) fn path(&self, named: &str) -> Result<PathBuf, Refusal> {
        self.served.path(named).ok_or_else(|| outside(named))
    }
}

fn outside(named: &str) -> Refusal {
    Refusal::new(
        StatusCode::FORBIDDEN,
        format!("`{named}` is not in the paths that were given to `retina view`"),
    )
}

/// A file of a folder of the given paths (as [`App::path`] gives it). Links that lead out of the folder are refused; of a
/// file that is not there its reader says so.
pub(crate) fn within(folder: &std::path::Path, file: PathBuf) -> Result<PathBuf, Refusal> {
    match file.canonicalize() {
        Ok(whole) if !whole.starts_with(folder) => Err(Refusal::new(
            StatusCode::FORBIDDEN,
            format!("`{}` is a link that leads out of its folder", crate::session::file_name(&file)),
        )),
        _ => Ok(file),
    }
}

pub(crate) type Shared = State<Arc<App>>;
pub(crate) type Answer = Result<Response, Refusal>;

pub(crate) fn router(app: Arc<App>) -> Router {
    let guard = app.guard.clone();
    Router::new()
        .route("/api/start", get(start))
        .route("/api/effects", get(catalogue))
        .route("/api/effects/{id}/{figure}", get(signature))
        .route("/api/sessions/open", post(open))
        .route("/api/sessions/drop", post(drop_in))
        .route("/api/sessions/example", post(example))
        .route("/api/sessions/{id}", get(news).delete(remove))
        .route("/api/sessions/{id}/columns", get(all_columns))
        .route("/api/sessions/{id}/models/{model}", get(model_fit))
        .route("/api/sessions/{id}/models/{model}/rows", get(model_rows))
        .route("/api/sessions/{id}/preview/{effect}", get(preview))
        .route("/api/sessions/{id}/model", post(change_model))
        .route("/api/sessions/{id}/formula", post(formula).get(own_formula))
        .route("/api/sessions/{id}/job/{what}", post(job))
        .route("/api/sessions/{id}/leave-out", post(leave_out))
        .route("/api/sessions/{id}/export/{what}", get(exported))
        .merge(panes::routes())
        .fallback(async |uri: Uri| page::file(uri.path()))
        .layer(DefaultBodyLimit::max(MOST_BODY_BYTES))
        .layer(middleware::from_fn_with_state(guard, guarded))
        .with_state(app)
}

/// Runs what computes or reads files beside the threads that answer.
pub(crate) async fn beside(work: impl FnOnce() -> Answer + Send + 'static) -> Answer {
    // Boxed: of each kind of work the compiler would make the runtime's task anew.
    let work: Box<dyn FnOnce() -> Answer + Send> = Box::new(work);
    tokio::task::spawn_blocking(work).await.unwrap_or_else(|_| {
        let text =
            "the program failed here; its message is where it was started. This is a fault of the program";
        Err(Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, text))
    })
}

pub(crate) fn json_of(value: Value) -> Answer {
    Ok(Json(value).into_response())
}

fn done() -> Answer {
    Ok(StatusCode::NO_CONTENT.into_response())
}

pub(crate) fn bytes_of(bytes: Vec<u8>) -> Answer {
    Ok(([(header::CONTENT_TYPE, "application/octet-stream")], bytes).into_response())
}

fn opened(session: &Session) -> Answer {
    json_of(json!({ "id": session.id }))
}

async fn start(State(app): Shared) -> Answer {
    beside(move || {
        let examples: Vec<Value> =
            EXAMPLES.iter().map(|e| json!({ "id": e.id, "title": e.title, "text": e.text })).collect();
        json_of(json!({
            "version": env!("CARGO_PKG_VERSION"),
            "first": app.first,
            "sessions": app.store.list(),
            "files": app.served.list(),
            "setups": retina_assets::SETUPS.map(|(name, _)| name),
            "systems": retina_optics::shipped_designs().collect::<Vec<_>>(),
            "examples": examples,
        }))
    })
    .await
}

async fn catalogue() -> Answer {
    beside(|| json_of(effects_json(&effects(None)))).await
}

async fn signature(Path((id, figure)): Path<(String, String)>) -> Answer {
    beside(move || {
        let effect = effects(None).into_iter().find(|effect| effect.name() == id);
        let svgs = effect.map(signature_svgs).transpose()?.flatten().unwrap_or_default();
        let number: Option<usize> = figure.strip_suffix(".svg").and_then(|number| number.parse().ok());
        match number.and_then(|number| svgs.get(number)) {
            Some(svg) => Ok(([(header::CONTENT_TYPE, "image/svg+xml")], svg.clone()).into_response()),
            None => Err(Refusal::not_found("such figure")),
        }
    })
    .await
}

#[derive(Deserialize)]
struct Named {
    setup: String,
    tables: Vec<String>,
    calibration: Option<String>,
}

async fn open(State(app): Shared, Json(named): Json<Named>) -> Answer {
    beside(move || {
        let path =
            |name: &String| app.served.path(name).filter(|path| path.is_file()).ok_or_else(|| outside(name));
        let mut inputs = Inputs::default();
        inputs.put(Kind::Setup, path(&named.setup)?)?;
        for table in &named.tables {
            inputs.put(Kind::Table, path(table)?)?;
        }
        if let Some(calibration) = &named.calibration {
            inputs.put(Kind::Calibration, path(calibration)?)?;
        }
        opened(&*app.store.open(inputs)?)
    })
    .await
}

#[derive(Deserialize)]
struct Drop {
    files: Vec<Dropped>,
    beside: Option<String>,
}

async fn drop_in(State(app): Shared, Json(drop): Json<Drop>) -> Answer {
    beside(move || {
        let beside =
            drop.beside.as_deref().map(|id| app.store.get(id)).transpose()?.map(|session| session.state());
        opened(&*app.store.drop_in(&drop.files, beside.as_ref())?)
    })
    .await
}

#[derive(Deserialize)]
struct ExampleId {
    id: String,
}

async fn example(State(app): Shared, Json(asked): Json<ExampleId>) -> Answer {
    beside(move || {
        let example = EXAMPLES.iter().find(|example| example.id == asked.id);
        opened(&*app.store.example(example.ok_or_else(|| Refusal::not_found("such example"))?)?)
    })
    .await
}

async fn remove(State(app): Shared, Path(id): Path<String>) -> Answer {
    beside(move || {
        app.store.remove(&id)?;
        done()
    })
    .await
}

#[derive(Deserialize)]
struct Seen {
    seen: Option<u64>,
}

/// The session; of one that the window has seen, when it has changed.
async fn news(State(app): Shared, Path(id): Path<String>, Query(seen): Query<Seen>) -> Answer {
    let session = app.store.get(&id)?;
    session.wake();
    let mut revision = session.revision();
    if let Some(seen) = seen.seen {
        // Where nothing happens the answer is the same as before.
        let _ =
            tokio::time::timeout(Duration::from_secs(NEWS_S), revision.wait_for(|now| *now != seen)).await;
    }
    beside(move || json_of(session.json())).await
}

async fn all_columns(State(app): Shared, Path(id): Path<String>) -> Answer {
    beside(move || bytes_of(columns::columns(&app.store.get(&id)?.material()?.data))).await
}

fn model_at(session: &Session, model: usize) -> Result<Vec<String>, Refusal> {
    session.state().models.get(model).cloned().ok_or_else(|| Refusal::not_found("such model"))
}

async fn model_fit(State(app): Shared, Path((id, model)): Path<(String, usize)>) -> Answer {
    beside(move || {
        let session = app.store.get(&id)?;
        let fit = session.fit_of(&model_at(&session, model)?)?;
        json_of(fit_json(&session.material()?.data, &fit))
    })
    .await
}

async fn model_rows(State(app): Shared, Path((id, model)): Path<(String, usize)>) -> Answer {
    beside(move || {
        let session = app.store.get(&id)?;
        let fit = session.fit_of(&model_at(&session, model)?)?;
        bytes_of(columns::rows(&session.material()?.data, &fit))
    })
    .await
}

/// What an effect would add to the model: its rows, without going on to it.
async fn preview(State(app): Shared, Path((id, effect)): Path<(String, String)>) -> Answer {
    beside(move || {
        let session = app.store.get(&id)?;
        let mut model = session.state().model().clone();
        let known = effects(None).iter().any(|own| own.name() == effect);
        if !known || model.contains(&effect) {
            return Err(Refusal::not_found("such further effect"));
        }
        model.push(effect);
        let fit = session.fit_of(&model)?;
        bytes_of(columns::rows(&session.material()?.data, &fit))
    })
    .await
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Step {
    /// An effect of the catalogue joins the model.
    Add(String),
    /// An effect leaves it.
    Remove(String),
    /// Back or forth to a model that was tried.
    At(usize),
}

async fn change_model(State(app): Shared, Path(id): Path<String>, Json(step): Json<Step>) -> Answer {
    beside(move || {
        let session = app.store.get(&id)?;
        match step {
            Step::Add(effect) => {
                // A file's name is not taken from the page: formulas come as text.
                if !effects(None).iter().any(|own| own.name() == effect) {
                    return Err(Refusal::not_found("such effect"));
                }
                session.go_on(|model| {
                    if !model.contains(&effect) {
                        model.push(effect);
                    }
                })?;
            }
            Step::Remove(effect) => session.go_on(|model| model.retain(|own| effect_name(own) != effect))?,
            Step::At(at) => session.go_to(at)?,
        }
        json_of(session.json())
    })
    .await
}

#[derive(Deserialize)]
struct Formula {
    text: String,
    add: bool,
}

async fn formula(State(app): Shared, Path(id): Path<String>, Json(formula): Json<Formula>) -> Answer {
    beside(move || {
        let session = app.store.get(&id)?;
        if formula.add {
            session.add_formula(&formula.text)?;
            return json_of(session.json());
        }
        // What is half typed does not fit: that is an answer and no failure.
        match session.check_formula(&formula.text) {
            Ok(name) => json_of(json!({ "name": name, "problem": null })),
            Err(refusal) => json_of(json!({ "name": null, "problem": refusal.body() })),
        }
    })
    .await
}

#[derive(Deserialize)]
struct Own {
    name: String,
}

async fn own_formula(State(app): Shared, Path(id): Path<String>, Query(own): Query<Own>) -> Answer {
    beside(move || {
        let session = app.store.get(&id)?;
        let state = session.state();
        let text = state.model().iter().find(|text| effect_name(text) == own.name);
        let text = text.and_then(|text| session.formula(text));
        json_of(json!({ "text": text.ok_or_else(|| Refusal::not_found("such formula"))? }))
    })
    .await
}

async fn job(State(app): Shared, Path((id, what)): Path<(String, String)>) -> Answer {
    beside(move || {
        let session = app.store.get(&id)?;
        match what.as_str() {
            "diagnose" => session.look_again(),
            "investigate" => session.look_for_formula(),
            "cancel" => session.cancel(),
            "next" => session.measure_next()?,
            _ => return Err(Refusal::not_found("such job")),
        }
        json_of(session.json())
    })
    .await
}

#[derive(Deserialize)]
struct Table {
    table: usize,
}

async fn leave_out(State(app): Shared, Path(id): Path<String>, Json(table): Json<Table>) -> Answer {
    beside(move || {
        let session = app.store.get(&id)?;
        session.leave_out(table.table)?;
        json_of(session.json())
    })
    .await
}

async fn exported(State(app): Shared, Path((id, what)): Path<(String, String)>) -> Answer {
    beside(move || {
        let session = app.store.get(&id)?;
        let (kind, text) = match what.as_str() {
            "fit.html" => ("text/html; charset=utf-8", export::fit_report(&session)?),
            "diagnosis.html" => ("text/html; charset=utf-8", export::diagnosis_report(&session)?),
            "model.toml" => ("application/toml", export::model_file(&session)?),
            "predictions.csv" => ("text/csv; charset=utf-8", export::predictions(&session)?),
            "commands.txt" => ("text/plain; charset=utf-8", export::commands(&session).join("\n") + "\n"),
            _ => return Err(Refusal::not_found("such export")),
        };
        let disposition = format!("attachment; filename=\"{what}\"");
        Ok(([(header::CONTENT_TYPE, kind), (header::CONTENT_DISPOSITION, &disposition)], text)
            .into_response())
    })
    .await
}
