//! What goes wrong: to the caller as [`ViewError`], to the page as a status and a JSON document.

use std::net::SocketAddr;
use std::path::PathBuf;

use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use retina_bench::BenchError;
use retina_files::InputError;
use serde_json::{Value, json};

/// What keeps the server from running.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The port is taken, or the machine has no loopback address.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// The address that was tried.
        address: SocketAddr,
        /// What the system says.
        source: std::io::Error,
    },
    /// A folder for the sessions cannot be made.
    #[error("{}: the folder for the sessions cannot be made: {source}", folder.display())]
    State {
        /// The folder.
        folder: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The system gives no random numbers for the token.
    #[error("the system gives no random numbers: {0}")]
    Random(String),
    /// The server ended.
    #[error("the server ended: {0}")]
    Server(std::io::Error),
    /// A file does not fit.
    #[error(transparent)]
    Input(#[from] InputError),
}

/// A refusal, as the page is told of it.
#[derive(Debug, Clone)]
pub(crate) struct Refusal {
    status: StatusCode,
    body: Value,
}

impl Refusal {
    pub(crate) fn new(status: StatusCode, problem: impl Into<String>) -> Self {
        Self { status, body: json!({ "problem": problem.into() }) }
    }

    pub(crate) fn not_found(what: &str) -> Self {
        Self::new(StatusCode::NOT_FOUND, format!("there is no {what}"))
    }

    pub(crate) fn conflict(problem: impl Into<String>) -> Self {
        Self::new(StatusCode::CONFLICT, problem)
    }

    pub(crate) fn body(&self) -> &Value {
        &self.body
    }
}

/// Every part of the error by itself, so that the page can point at the place.
impl From<InputError> for Refusal {
    fn from(error: InputError) -> Self {
        // The file's name alone: the page shows no paths of this machine where one word will do.
        let text = error.to_string();
        let snippet = error.snippet.as_ref().map(|s| json!({ "offset": s.offset, "length": s.length }));
        Self {
            status: StatusCode::UNPROCESSABLE_ENTITY,
            body: json!({
                "problem": text,
                "what": error.problem,
                "found": error.found,
                "expected": error.expected,
                "help": error.help,
                "snippet": snippet,
            }),
        }
    }
}

impl From<BenchError> for Refusal {
    fn from(error: BenchError) -> Self {
        match error {
            BenchError::Input(error) => error.into(),
            error => Self::new(StatusCode::UNPROCESSABLE_ENTITY, error.to_string()),
        }
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.status, axum::Json(self.body)).into_response()
    }
}
