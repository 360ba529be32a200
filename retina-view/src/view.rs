//! The server: bound, then run.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;

use crate::api::{self, App};
use crate::failure::ViewError;
use crate::guard::Guard;
use crate::job::STACK_BYTES;
use crate::panes::Held;
use crate::served::{Kind, Served};
use crate::store::{Inputs, Store};

/// What a server is to do.
#[derive(Debug, Clone, Default)]
pub struct ViewOptions {
    /// Files and folders that may be read. A setup and tables among the files are opened.
    pub paths: Vec<PathBuf>,
    /// The port; 0 takes any free one.
    pub port: u16,
    /// Folder in which the sessions are kept.
    pub state_folder: PathBuf,
}

/// A server that listens on 127.0.0.1, and on no other address.
pub struct View {
    listener: std::net::TcpListener,
    address: SocketAddr,
    app: Arc<App>,
    opened: Option<String>,
}

/// Where sessions are kept if nothing else is said: in the folder that the system has for a program's state.
pub fn default_state_folder() -> Option<PathBuf> {
    Some(retina_files::user_folder("XDG_STATE_HOME", ".local/state")?.join("view"))
}

/// The pane that shows a given path.
fn fragment(kind: Kind, number: usize) -> Option<String> {
    let pane = match kind {
        Kind::Sequence => "sequence",
        Kind::Results => "results",
        Kind::Scene => "scene",
        Kind::System | Kind::Designs => "optics",
        Kind::Setup => "bench",
        Kind::Calibration | Kind::Table => return None,
    };
    Some(format!("{pane}={number}/"))
}

impl View {
    /// Checks the paths, opens the session that they name, and takes the port.
    ///
    /// # Errors
    /// A path does not fit, the port is taken, the folder of the sessions cannot be made.
    pub fn bind(options: &ViewOptions) -> Result<Self, ViewError> {
        let served = Served::new(&options.paths)?;
        let mut inputs = Inputs::default();
        let mut pane = None;
        for (number, path, kind) in served.given()? {
            // A setup among others belongs to them.
            if kind != Kind::Setup || options.paths.len() == 1 {
                pane = pane.or_else(|| fragment(kind, number));
            }
            if kind.is_measured() {
                inputs.put(kind, path)?;
            }
        }
        let store = Store::new(options.state_folder.clone());
        if let (None, Some(table), true) = (&inputs.setup, inputs.tables.first(), served.is_files_alone()) {
            return Err(retina_files::InputError::new(table, "comes without its setup")
                .expected("a table together with a setup (schema retina.setup/1), or a folder that has one")
                .help("retina view SETUP.toml TABLE.csv")
                .into());
        }
        std::fs::create_dir_all(&options.state_folder)
            .map_err(|source| ViewError::State { folder: options.state_folder.clone(), source })?;
        let named = inputs.setup.is_some() && !inputs.tables.is_empty();
        let opened = match named.then(|| store.open(inputs)).transpose() {
            Ok(session) => session.map(|session| session.id.clone()),
            Err(refusal) => {
                let text = refusal.body()["problem"].as_str().unwrap_or_default().to_owned();
                return Err(retina_files::InputError::new(&options.state_folder, text).into());
            }
        };
        let first = opened.as_ref().map(|id| format!("session={id}")).or(pane);
        let wanted = SocketAddr::from((Ipv4Addr::LOCALHOST, options.port));
        let refused = |source| ViewError::Listen { address: wanted, source };
        let listener = std::net::TcpListener::bind(wanted).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let guard = Guard::new(address.port())?;
        Ok(Self {
            listener,
            address,
            app: Arc::new(App { guard, served, store, first, panes: Held::default() }),
            opened,
        })
    }

    /// The address to open, the token in it.
    pub fn address(&self) -> String {
        format!("http://{}/?token={}", self.address, self.app.guard.token())
    }

    /// The session that the given paths are, if they are one.
    pub fn session(&self) -> Option<&str> {
        self.opened.as_deref()
    }

    /// Serves until the process ends. What the sessions keep is on the disk after every step.
    ///
    /// # Errors
    /// The system refuses threads or the socket.
    pub fn serve(self) -> Result<(), ViewError> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .thread_stack_size(STACK_BYTES)
            .enable_all()
            .build()
            .map_err(ViewError::Server)?;
        runtime.block_on(async move {
            let listener = tokio::net::TcpListener::from_std(self.listener).map_err(ViewError::Server)?;
            axum::serve(listener, api::router(self.app)).await.map_err(ViewError::Server)
        })
    }
}
