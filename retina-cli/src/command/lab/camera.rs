//! `retina lab camera`.

use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use retina::gige::Camera;
use retina::lab::{BenchCamera, ScreenAddress, open_view};
use serde_json::json;

use super::{BenchArguments, interrupted};
use crate::failure::Failure;
use crate::output::{print_json_line, tell};
use crate::setup::read_setup;

/// Between two looks at what the camera has done.
const LOOK: Duration = Duration::from_millis(200);

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Screen that it photographs: x11:DISPLAY for an X server, or folder:DIR for the image that was written last into
    /// a folder.
    #[arg(long, value_name = "x11:DISPLAY|folder:DIR")]
    screen: String,
    /// IPv4 address of this machine at which the camera is found.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    interface: Ipv4Addr,
    #[command(flatten)]
    bench: BenchArguments,
    /// Serial number that the camera tells.
    #[arg(long, default_value = "RETINA-1", value_parser = serial)]
    serial: String,
    /// Print a line of JSON on standard output when the camera is ready, and one at its end.
    #[arg(long)]
    json: bool,
}

fn serial(text: &str) -> Result<String, String> {
    if (1..16).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_graphic()) {
        return Ok(text.to_owned());
    }
    Err("a serial number has 1 to 15 letters, digits and signs".into())
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let address: ScreenAddress = arguments.screen.parse()?;
    let setup = read_setup(&arguments.setup)?;
    let facility = arguments.bench.facility(&setup)?;
    let view = open_view(&address, [setup.screen.width_px, setup.screen.height_px])?;
    let stop = interrupted()?;
    let bench = BenchCamera::new(facility, view, arguments.bench.options())?;
    let info = bench.info(&arguments.serial);
    let camera = Camera::start(info.clone(), Box::new(bench), arguments.interface)?;
    if arguments.json {
        print_json_line(&json!({
            "schema": "retina.lab-camera/1",
            "address": arguments.interface.to_string(),
            "vendor": "RETINA",
            "model": info.model,
            "serial": info.serial,
            "screen": address.to_string(),
        }))?;
    }
    tell!(
        "{} is a GigE Vision camera at {} and photographs {address}. Press Ctrl-C to end it",
        info.model,
        arguments.interface
    );
    let (mut told, mut controller) = (0, None);
    while !stop.load(Ordering::Acquire) {
        std::thread::sleep(LOOK);
        if controller != camera.controller() {
            controller = camera.controller();
            match controller {
                Some(client) => tell!("{client} controls the camera"),
                None => tell!("nobody controls the camera"),
            }
        }
        let statistics = camera.statistics();
        if let Some(failure) = statistics.last_failure.filter(|_| statistics.failed > told) {
            told = statistics.failed;
            tell!("an exposure failed: {failure}");
        }
    }
    let statistics = camera.statistics();
    tell!(
        "{} images taken, {} sent, {} packets sent again",
        statistics.taken,
        statistics.sent,
        statistics.resent_packets
    );
    if arguments.json {
        print_json_line(&json!({
            "schema": "retina.lab-camera/1",
            "taken": statistics.taken,
            "sent": statistics.sent,
            "failed": statistics.failed,
            "resent_packets": statistics.resent_packets,
            "unavailable_packets": statistics.unavailable_packets,
        }))?;
    }
    Ok(())
}
