//! `retina view`.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use retina_view::{View, ViewError, ViewOptions, default_state_folder};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json_line, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Files and folders that the page may read.
    ///
    /// Files and folders are told apart by their content. A setup with its tables is opened in the
    /// workbench at once; a rendered folder, a scene, a setup, a lens system or results of navigation
    /// in their panes. Of other folders the page lists what lies in them. Without a path it starts
    /// with the shipped examples.
    #[arg(value_name = "PATH")]
    paths: Vec<PathBuf>,
    /// Port on 127.0.0.1; 0 takes any free port.
    #[arg(long, default_value_t = 0)]
    port: u16,
    /// Print the address, and open no browser.
    #[arg(long)]
    no_browser: bool,
    /// Folder in which the sessions are kept [default: the system's folder for the state of programs].
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Print the address as a JSON document on one line.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let state_folder = arguments.state.clone().or_else(default_state_folder).ok_or_else(|| {
        Failure::new(
            "there is no folder for the sessions: neither HOME nor XDG_STATE_HOME is set; give --state DIR",
        )
    })?;
    let options = ViewOptions { paths: arguments.paths.clone(), port: arguments.port, state_folder };
    let view = View::bind(&options)?;
    let address = view.address();
    if arguments.json {
        print_json_line(
            &json!({ "schema": "retina.view/1", "address": address, "session": view.session() }),
        )?;
    } else {
        crate::output::tell_result(format_args!("the page is at {address}"));
        tell!("Ctrl-C ends it; sessions are kept in {}", options.state_folder.display());
    }
    if !arguments.no_browser && !open_browser(&address) {
        tell!("no browser could be started: open the address in one");
    }
    Ok(view.serve()?)
}

/// Asks the system to open an address. What the browser prints is not ours.
fn open_browser(address: &str) -> bool {
    let program: &[&str] = if cfg!(target_os = "macos") {
        &["open"]
    } else if cfg!(target_os = "windows") {
        &["rundll32", "url.dll,FileProtocolHandler"]
    } else {
        &["xdg-open"]
    };
    let mut command = Command::new(program[0]);
    command.args(&program[1..]).arg(address);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().is_ok()
}

impl From<ViewError> for Failure {
    fn from(error: ViewError) -> Self {
        match error {
            ViewError::Input(error) => error.into(),
            ViewError::Listen { .. } => Self::new(format!("{error}; --port 0 takes any free port")),
            error => Self::new(error.to_string()),
        }
    }
}
