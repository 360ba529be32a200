//! `retina serve`.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use retina_corto::{Pose, World};
use retina_scene::Scene;

use super::corto::{CortoArguments, tell_notes};
use super::live::{Listening, Live, addresses, one_body, scene_of_poses};
use super::{Rendering, serve_basilisk};
use crate::failure::Failure;
use crate::output::{print_json_line, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Scene, schema retina.scene/1. Its trajectory is not used.
    ///
    /// CORTO's protocol carries the pose of one body; --basilisk takes scenes of several.
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
    #[command(flatten)]
    pub(super) listening: Listening,
    #[command(flatten)]
    pub(super) basilisk: Basilisk,
    #[command(flatten)]
    pub(super) rendering: Rendering,
    /// Print JSON documents, one a line: first the ports, at the end a summary.
    #[arg(long)]
    pub(super) json: bool,
}

/// A simulation by Basilisk instead of CORTO's protocol.
#[derive(clap::Args)]
pub(super) struct Basilisk {
    /// Answer Basilisk's vizInterface instead of CORTO's protocol.
    ///
    /// Resolution, field of view and mounting of each camera are those of the simulation, as are the places of bodies and
    /// Sun. Give bodies of the scene the names that they have there.
    #[arg(long, conflicts_with_all = ["corto", "setup", "sidecar", "radiance_scale", "scale_m_per_bu", "pose_port", "image_port"], requires = "scene")]
    basilisk: bool,
    /// TCP port that the simulation connects to; 0 takes any free port.
    #[arg(long, value_name = "PORT", default_value_t = 5556, requires = "basilisk")]
    pub(super) basilisk_port: u16,
    /// Radiance factor that is white in the simulation's images.
    #[arg(long, value_name = "VALUE", default_value_t = 0.3, requires = "basilisk")]
    pub(super) white_radiance_factor: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let (true, Some(file)) = (arguments.basilisk.basilisk, &arguments.scene) {
        return serve_basilisk::run(arguments, file);
    }
    let start = Instant::now();
    // The ports first: a simulation may send its first pose while the bodies are being loaded.
    let server = arguments.listening.bind()?;
    let (scene, world) = scene(arguments)?;
    let loaded_s = start.elapsed().as_secs_f64();
    let mut live = Live::open(scene, arguments.radiance_scale, &arguments.rendering)?;
    let [poses, images] = addresses(&server)?;
    let name = live.name();
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
    let mut render = |pose: &Pose| live.pose(&world, pose).map(|(_, png)| png);
    let ended = server.run(&mut render, arguments.listening.frames, &stop, &|text| tell!("{text}"));
    let each_s = if live.frames > 0 { live.seconds / live.frames as f64 } else { 0.0 };
    tell_summary(ended.sent, ended.refused, each_s, arguments.json)
}

/// What was served, for people and programs.
pub(super) fn tell_summary(sent: usize, refused: usize, each_s: f64, json: bool) -> Result<(), Failure> {
    tell!("{sent} images sent, {refused} requests refused; {each_s:.3} s of rendering per image");
    if json {
        print_json_line(&serde_json::json!({
            "schema": "retina.serve-summary/1", "images_sent": sent, "requests_refused": refused,
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
    scene_of_poses(file, arguments.scale_m_per_bu)
}
