//! `retina lab devices`.

use retina::lab::{find_cameras, find_screens};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, print_lines};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// X11 display whose outputs are listed [default: $DISPLAY].
    #[arg(long, value_name = "DISPLAY")]
    display: Option<String>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let cameras = find_cameras();
    let asked =
        arguments.display.clone().or_else(|| std::env::var("DISPLAY").ok().filter(|name| !name.is_empty()));
    let screens = match &asked {
        Some(display) => find_screens(display)?,
        None => Vec::new(),
    };
    if arguments.json {
        let camera =
            |found: &retina::lab::FoundCamera| json!({"camera": found.spec, "address": found.address});
        let screen =
            |found: &retina::lab::FoundScreen| json!({"screen": found.spec, "size_px": found.size_px});
        return print_json(&json!({
            "schema": "retina.lab-devices/1",
            "aravis": cameras.is_some(),
            "cameras": cameras.unwrap_or_default().iter().map(camera).collect::<Vec<_>>(),
            "screens": screens.iter().map(screen).collect::<Vec<_>>(),
        }));
    }
    let mut lines = Vec::new();
    match cameras {
        None => lines.push("cameras: this program was built without Aravis (--features aravis)".to_owned()),
        Some(found) if found.is_empty() => lines.push("cameras: Aravis finds none".to_owned()),
        Some(found) => {
            lines.extend(
                found.iter().map(|camera| format!("--camera '{}'  at {}", camera.spec, camera.address)),
            );
        }
    }
    if asked.is_none() {
        lines.push("screens: $DISPLAY is not set".to_owned());
    }
    let line = |found: &retina::lab::FoundScreen| {
        format!("--screen {}  {} x {} px", found.spec, found.size_px[0], found.size_px[1])
    };
    lines.extend(screens.iter().map(line));
    print_lines(&lines)
}
