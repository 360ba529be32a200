//! `retina lab camera`.

use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use retina::gige::Camera;
use retina::lab::{BenchCamera, BenchCameraOptions, ScreenAddress, open_view};
use retina_campaign::{Effect, Facility};
use retina_formats::TableKind;
use serde_json::json;

use crate::command::simulate::Profile;
use crate::failure::Failure;
use crate::output::{print_json_line, tell};
use crate::setup::read_setup;

/// Time from the start after half of which a `knock` comes, s.
const KNOCK_AFTER_S: f64 = 600.0;
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
    /// Effect and its size, for example screen_tilt=0.1deg. Repeat the flag for more. A knock comes 300 s after the
    /// start.
    #[arg(long = "effect", value_name = "ID=VALUE")]
    effects: Vec<String>,
    /// Temperature of the bench from the start on.
    #[arg(long, value_enum, default_value = "constant")]
    temperature: Profile,
    /// Seed of the bench's fixed patterns and of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
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
    let effects: Vec<Effect> =
        arguments.effects.iter().map(|text| Effect::parse(text)).collect::<Result<_, _>>()?;
    let facility = Facility::new(&setup, &effects, TableKind::Frames, KNOCK_AFTER_S, arguments.seed)?;
    let view = open_view(&address, [setup.screen.width_px, setup.screen.height_px])?;
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Release))
        .map_err(|error| Failure::new(format!("interrupts cannot be caught: {error}")))?;
    let options =
        BenchCameraOptions { temperature: arguments.temperature.into(), ..BenchCameraOptions::default() };
    let bench = BenchCamera::new(facility, view, options)?;
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
