//! `retina serve`.

use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use retina_batch::LiveRenderer;
use retina_corto::{Pose, Server, World};
use retina_files::InputError;
use retina_radiometry::AU_M;
use retina_scene::{FrameChecks, RadianceScale, Scene, SceneFrame};
use retina_sky::Trajectory;

use super::Rendering;
use super::corto::{CortoArguments, tell_notes};
use crate::failure::Failure;
use crate::output::{print_json_line, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Scene with one body, schema retina.scene/1. Its trajectory is not used.
    #[arg(required_unless_present = "corto")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    corto: CortoArguments,
    /// Length of one unit of the poses' positions, m.
    ///
    /// This is for a scene. With --corto the sidecar gives it.
    #[arg(long, value_name = "M", default_value_t = 1.0, conflicts_with = "corto")]
    scale_m_per_bu: f64,
    /// Radiance scale, displayed over true radiance, if a facility shows the images.
    #[arg(long, value_name = "SCALE")]
    radiance_scale: Option<f64>,
    /// Address to listen on.
    ///
    /// Anyone who can reach it can request images.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    listen: IpAddr,
    /// UDP port for poses; 0 takes any free port.
    #[arg(long, value_name = "PORT", default_value_t = 51_001)]
    pose_port: u16,
    /// TCP port for images; 0 takes any free port.
    #[arg(long, value_name = "PORT", default_value_t = 30_001)]
    image_port: u16,
    /// Stop after N images.
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    #[command(flatten)]
    rendering: Rendering,
    /// Print JSON documents, one a line: first the ports, at the end a summary.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let start = Instant::now();
    // The ports first: a simulation may send its first pose while the bodies are being loaded.
    let server =
        Server::bind(arguments.listen, arguments.pose_port, arguments.image_port).map_err(|error| {
            Failure::new(format!(
                "cannot listen on UDP {0}:{1} or TCP {0}:{2}: {error}",
                arguments.listen, arguments.pose_port, arguments.image_port
            ))
        })?;
    let (mut scene, world) = scene(arguments)?;
    if let Some(scale) = arguments.radiance_scale {
        if !(scale.is_finite() && scale > 0.0) {
            return Err(InputError::new("--radiance-scale", "the value is out of range")
                .found(scale)
                .expected("a number above 0")
                .into());
        }
        scene.radiance_scale = RadianceScale::Value(scale);
    }
    let loaded_s = start.elapsed().as_secs_f64();
    let quality = arguments.rendering.quality().unwrap_or(scene.quality);
    let (live, fallback) = LiveRenderer::open(&scene, arguments.rendering.backend.into(), quality)?;
    if let Some(reason) = fallback {
        tell!("rendering on the processor's cores: {reason}");
    }
    let address = |found: std::io::Result<std::net::SocketAddr>| {
        found.map_err(|error| Failure::new(format!("a socket has no address: {error}")))
    };
    let (poses, images) = (address(server.pose_address())?, address(server.image_address())?);
    let name = live.name().clone();
    tell!(
        "ready after {:.2} s ({loaded_s:.2} s of it to load the files): poses by UDP on {poses}, images by TCP on {images}; \
         {} ({})",
        start.elapsed().as_secs_f64(),
        name.adapter,
        name.driver
    );
    if arguments.json {
        print_json_line(&serde_json::json!({
            "schema": "retina.serve/1", "poses": poses.to_string(), "images": images.to_string(),
            "seconds": start.elapsed().as_secs_f64(), "adapter": name.adapter, "driver": name.driver,
        }))?;
    }
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Release))
        .map_err(|error| Failure::new(format!("the interrupt handler cannot be installed: {error}")))?;
    let checks = FrameChecks::of(&scene);
    let mut loop_ = Loop { scene, world, live, checks, frames: 0, seconds: 0.0 };
    let mut render = |pose: &Pose| loop_.png(pose);
    let ended = server.run(&mut render, arguments.frames, &stop, &|text| tell!("{text}"));
    let each_s = if loop_.frames > 0 { loop_.seconds / loop_.frames as f64 } else { 0.0 };
    tell!(
        "{} images sent, {} requests refused; {each_s:.3} s of rendering per image",
        ended.sent,
        ended.refused
    );
    if arguments.json {
        print_json_line(&serde_json::json!({
            "schema": "retina.serve-summary/1", "images_sent": ended.sent, "requests_refused": ended.refused,
            "seconds_per_image": each_s,
        }))?;
    }
    Ok(())
}

/// The scene without frames, and what turns poses into them.
fn scene(arguments: &Arguments) -> Result<(Scene, World), Failure> {
    if let Some(folder) = arguments.corto.folder() {
        let scenario = arguments.corto.scenario(folder)?;
        one_body(&scenario.scene_file, scenario.world.body_names.len())?;
        let (scene, notes) = scenario.scene(&arguments.corto.shown(), false)?;
        tell_notes(&notes);
        return Ok((scene, scenario.world));
    }
    let Some(file) = &arguments.scene else {
        return Err(Failure::new("neither a scene nor --corto is given"));
    };
    let mut scene = Scene::read(file)?;
    one_body(file, scene.bodies.len())?;
    scene.allow_empty_frames = true;
    scene.bodies.iter_mut().for_each(|body| body.may_be_behind = true);
    let scale_m_per_bu = arguments.scale_m_per_bu;
    if !(scale_m_per_bu.is_finite() && scale_m_per_bu > 0.0) {
        return Err(InputError::new("--scale-m-per-bu", "the value is out of range")
            .found(scale_m_per_bu)
            .expected("metres above 0")
            .into());
    }
    let body_names = scene.bodies.iter().map(|body| body.name.clone()).collect();
    Ok((scene, World { scale_m_per_bu, sun_distance_m: AU_M, body_names }))
}

fn one_body(file: &std::path::Path, bodies: usize) -> Result<(), InputError> {
    if bodies == 1 {
        return Ok(());
    }
    Err(InputError::new(file, "the protocol of the closed loop carries the pose of one body")
        .found(format!("a scene of {bodies} bodies"))
        .expected("one body"))
}

/// A renderer that is asked for one pose after another.
struct Loop {
    scene: Scene,
    world: World,
    live: LiveRenderer,
    checks: FrameChecks,
    frames: usize,
    seconds: f64,
}

impl Loop {
    fn png(&mut self, pose: &Pose) -> Result<Vec<u8>, String> {
        let start = Instant::now();
        let source = std::path::Path::new("the pose");
        self.scene.trajectory = Trajectory::new(source, vec![self.world.frame(pose)]);
        let frame = self.scene.frame(0).map_err(|error| error.to_string())?;
        let frame = SceneFrame { index: self.frames, ..frame };
        self.checks.check(&self.scene, &frame).map_err(|error| error.to_string())?;
        let png = self.live.png(&frame).map_err(|error| error.to_string())?;
        self.frames += 1;
        self.seconds += start.elapsed().as_secs_f64();
        Ok(png)
    }
}
