//! `retina lab loop`.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use retina::lab::{ClosedLoop, LoopFrame, LoopOptions, Rig};
use retina_campaign::screen_of_png;
use retina_corto::Pose;
use retina_files::InputError;
use retina_geometry::Setup;
use retina_scene::{Display, Scene, SceneFrame};
use serde_json::json;

use super::{DeviceArguments, loop_basilisk};
use crate::command::Rendering;
use crate::command::live::{Listening, Live, addresses, scene_of_poses};
use crate::failure::Failure;
use crate::output::{print_json_line, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Scene, schema retina.scene/1, for the facility of --setup.
    pub(super) scene: PathBuf,
    #[command(flatten)]
    devices: DeviceArguments,
    #[command(flatten)]
    pub(super) listening: Listening,
    /// Take the poses from the scene's own trajectory, instead of listening for them.
    #[arg(long, conflicts_with = "basilisk")]
    play: bool,
    /// Answer the image requests of a Basilisk simulation (its vizInterface) with photographs, instead of CORTO's
    /// protocol.
    #[arg(long)]
    pub(super) basilisk: bool,
    /// TCP port for the simulation.
    #[arg(long, value_name = "PORT", default_value_t = 5556, requires = "basilisk")]
    pub(super) basilisk_port: u16,
    /// Rate that is wanted, Hz: a frame that takes longer is late. With --play, frames begin at this rate.
    #[arg(long, value_name = "HZ")]
    rate_hz: Option<f64>,
    /// Folder for images/ and loop.csv, with the truth and the times of each frame [default: nothing is kept].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Length of one unit of the poses' positions, m.
    #[arg(long, value_name = "M", default_value_t = 1.0)]
    scale_m_per_bu: f64,
    /// Radiance scale, displayed over true radiance, if the scene's is automatic.
    #[arg(long, value_name = "SCALE")]
    pub(super) radiance_scale: Option<f64>,
    #[command(flatten)]
    pub(super) rendering: Rendering,
    /// Print JSON documents, one a line: first the ports, at the end a summary.
    #[arg(long)]
    pub(super) json: bool,
}

/// Columns of a frame's truth: the camera and the body beside it.
const TRUTH: [&str; 12] = [
    "time_s",
    "camera_from_inertial_w",
    "camera_from_inertial_x",
    "camera_from_inertial_y",
    "camera_from_inertial_z",
    "camera_x_m",
    "camera_y_m",
    "camera_z_m",
    "camera_from_body_w",
    "camera_from_body_x",
    "camera_from_body_y",
    "camera_from_body_z",
];

fn truth(frame: &SceneFrame) -> Vec<f64> {
    let turn = frame.camera_from_inertial;
    let at = frame.camera_position_m;
    let mut values = vec![frame.time_s, turn.w, turn.x, turn.y, turn.z, at.x, at.y, at.z];
    let body = frame.camera_from_body.first();
    values.extend(body.map_or([f64::NAN; 4], |body| [body.w, body.x, body.y, body.z]));
    values
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(rate) = arguments.rate_hz.filter(|rate| !(*rate > 0.0 && *rate <= 1000.0)) {
        return Err(InputError::new(Path::new("--rate-hz"), "is out of range")
            .found(rate)
            .expected("more than 0, at most 1000")
            .into());
    }
    let exposure_s = match arguments.devices.exposures_s.as_slice() {
        [] => None,
        [one] => Some(*one),
        several => {
            return Err(InputError::new(Path::new("--exposure-s"), "takes one exposure time here")
                .found(format!("{} of them", several.len()))
                .into());
        }
    };
    let options =
        LoopOptions { exposure_s, most_s: arguments.rate_hz.map(f64::recip), out: arguments.out.clone() };
    let mut devices = arguments.devices.open()?;
    let stop = devices.stop.clone();
    let mut closed = ClosedLoop::open(options, &TRUTH)?;
    let start = devices.with(|setup, rig| {
        if arguments.play {
            play(arguments, setup, rig, &mut closed)
        } else if arguments.basilisk {
            loop_basilisk::serve(arguments, setup, rig, &mut closed, &stop)
        } else {
            serve(arguments, setup, rig, &mut closed, &stop)
        }
    })?;
    let [frames, late] = closed.counts();
    let rate_hz = frames as f64 / start.elapsed().as_secs_f64();
    tell!("{frames} frames, {late} of them late; {rate_hz:.2} a second");
    if arguments.json {
        print_json_line(&json!({
            "schema": "retina.lab-loop-summary/1", "frames": frames, "late": late, "rate_hz": rate_hz,
        }))?;
    }
    Ok(())
}

/// Renders, shows and photographs the scene's own frames. Gives when the first began.
fn play(
    arguments: &Arguments,
    setup: &Setup,
    rig: &mut Rig<'_>,
    closed: &mut ClosedLoop,
) -> Result<Instant, Failure> {
    let scene = Scene::read(&arguments.scene)?;
    check_setup(&scene, arguments, setup)?;
    let frames = scene.frame_count().min(arguments.listening.frames.unwrap_or(usize::MAX));
    let mut live = Live::open(scene, arguments.radiance_scale, &arguments.rendering)?;
    let start = Instant::now();
    for index in 0..frames {
        if let Some(rate) = arguments.rate_hz {
            let due = start + Duration::from_secs_f64(index as f64 / rate);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        rig.go_on()?;
        let asked = Instant::now();
        let frame = live.scene.frame(index)?;
        let png = live.png(&frame).map_err(Failure::new)?;
        told(&around(rig, closed, &png, asked, &frame)?);
    }
    Ok(start)
}

/// Renders, shows and photographs the poses that come, and sends the camera's images back.
fn serve(
    arguments: &Arguments,
    setup: &Setup,
    rig: &mut Rig<'_>,
    closed: &mut ClosedLoop,
    stop: &std::sync::atomic::AtomicBool,
) -> Result<Instant, Failure> {
    let server = arguments.listening.bind()?;
    let (scene, world) = scene_of_poses(&arguments.scene, arguments.scale_m_per_bu)?;
    check_setup(&scene, arguments, setup)?;
    let mut live = Live::open(scene, arguments.radiance_scale, &arguments.rendering)?;
    let [poses, images] = addresses(&server)?;
    tell!("ready: poses by UDP on {poses}, the camera's images by TCP on {images}");
    if arguments.json {
        print_json_line(&json!({
            "schema": "retina.lab-loop/1", "poses": poses.to_string(), "images": images.to_string(),
        }))?;
    }
    let start = Instant::now();
    let mut answer = |pose: &Pose| {
        let asked = Instant::now();
        let (frame, png) = live.pose(&world, pose)?;
        let frame = around(rig, closed, &png, asked, &frame).map_err(|error| error.to_string())?;
        told(&frame);
        frame.image.png().map_err(|error| error.to_string())
    };
    server.run(&mut answer, arguments.listening.frames, stop, &|text| tell!("{text}"));
    Ok(start)
}

pub(super) fn around(
    rig: &mut Rig<'_>,
    closed: &mut ClosedLoop,
    png: &[u8],
    asked: Instant,
    frame: &SceneFrame,
) -> Result<LoopFrame, retina::lab::LabError> {
    let screen = screen_of_png(Path::new("the rendered frame"), png)?;
    closed.photograph(rig, &screen, asked, &truth(frame))
}

pub(super) fn told(frame: &LoopFrame) {
    let late = if frame.late { ", late" } else { "" };
    tell!(
        "frame {}: rendered {:.3} s, shown {:.3} s, photographed {:.3} s, in all {:.3} s{late}",
        frame.index,
        frame.render_s,
        frame.show_s,
        frame.take_s,
        frame.whole_s
    );
}

/// The scene's images are meant for the facility that shows them.
pub(super) fn check_setup(scene: &Scene, arguments: &Arguments, setup: &Setup) -> Result<(), Failure> {
    let found = match &scene.display {
        Display::Facility(own) if own.name == setup.name => return Ok(()),
        Display::Facility(own) => format!("the facility `{}`", own.name),
        Display::Plain(_) => "a camera of the scene's own".to_owned(),
    };
    Err(InputError::new(&arguments.scene, "is meant for another facility than --setup")
        .found(found)
        .expected(format!("the facility `{}`", setup.name))
        .help("give the scene's `setup` to --setup, or the scene another one")
        .into())
}
