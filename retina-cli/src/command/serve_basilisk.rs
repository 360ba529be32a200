//! `retina serve --basilisk`: the camera of a Basilisk simulation.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use retina_basilisk::{Server, View};
use retina_files::InputError;
use retina_geometry::Pinhole;
use retina_scene::{Compensation, Display, RadianceScale, Scene};
use retina_screen::{PlainDisplay, Transfer};

use super::Rendering;
use super::live::Live;
use super::serve::{Arguments, tell_summary};
use crate::failure::Failure;
use crate::output::{print_json_line, tell};

pub(super) fn run(arguments: &Arguments, file: &Path) -> Result<(), Failure> {
    let basilisk = &arguments.basilisk;
    let listen = arguments.listening.listen;
    // The port first: a simulation may ask while the bodies are being loaded.
    let server = Server::bind(listen, basilisk.basilisk_port).map_err(|error| {
        Failure::new(format!("cannot listen on TCP {listen}:{}: {error}", basilisk.basilisk_port))
    })?;
    let mut cameras = Cameras {
        scene: scene(file, basilisk.white_radiance_factor)?,
        rendering: &arguments.rendering,
        open: Vec::new(),
        seconds: 0.0,
    };
    let body_names: Vec<String> = cameras.scene.bodies.iter().map(|body| body.name.clone()).collect();
    let address =
        server.address().map_err(|error| Failure::new(format!("the socket has no address: {error}")))?;
    tell!("ready: Basilisk's vizInterface on tcp://{address}; bodies {}", body_names.join(", "));
    if arguments.json {
        print_json_line(&serde_json::json!({ "schema": "retina.serve/1", "basilisk": address.to_string() }))?;
    }
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Release))
        .map_err(|error| Failure::new(format!("the interrupt handler cannot be installed: {error}")))?;
    let ended = server.run(
        &body_names,
        &mut |view| cameras.render(view),
        arguments.listening.frames,
        &stop,
        &|text| tell!("{text}"),
    );
    let each_s = if ended.sent > 0 { cameras.seconds / ended.sent as f64 } else { 0.0 };
    tell_summary(ended.sent, ended.refused, each_s, arguments.json)
}

/// The scene's bodies before a camera of the simulation's own: no facility, and no stars, whose light has no radiance factor.
fn scene(file: &Path, white_radiance_factor: f64) -> Result<Scene, Failure> {
    if !(white_radiance_factor.is_finite() && white_radiance_factor > 0.0) {
        return Err(InputError::new("--white-radiance-factor", "the value is out of range")
            .found(white_radiance_factor)
            .expected("a radiance factor above 0")
            .into());
    }
    let mut scene = Scene::read(file)?;
    scene.allow_empty_frames = true;
    scene.bodies.iter_mut().for_each(|body| body.may_be_behind = true);
    let gain = 1.0 / white_radiance_factor;
    scene.display = Display::Plain(PlainDisplay { gain, transfer: Transfer::Linear, bits: 8, channels: 1 });
    scene.radiance_scale = RadianceScale::Value(1.0);
    scene.compensation = Compensation::None;
    (scene.distortion, scene.inverse, scene.response) = (None, None, None);
    (scene.stars, scene.flashes) = (None, None);
    Ok(scene)
}

/// A renderer holds the bodies' meshes: of so many projections one is kept.
const MOST_RENDERERS: usize = 4;

/// A renderer for each projection, made when its first image is asked for; the latest used is the last.
struct Cameras<'a> {
    scene: Scene,
    rendering: &'a Rendering,
    open: Vec<(Pinhole, Live)>,
    seconds: f64,
}

impl Cameras<'_> {
    fn render(&mut self, view: &View) -> Result<Vec<u8>, String> {
        let known = self.open.iter().position(|(image, _)| *image == view.image);
        let mut live = match known {
            Some(at) => self.open.remove(at).1,
            None => self.opened(view)?,
        };
        let before = live.seconds;
        let made = live.frame(view.frame.clone());
        self.seconds += live.seconds - before;
        self.open.push((view.image, live));
        Ok(made?.1)
    }

    fn opened(&mut self, view: &View) -> Result<Live, String> {
        if self.open.len() == MOST_RENDERERS {
            self.open.remove(0);
        }
        let mut scene = self.scene.clone();
        scene.image = view.image;
        let live = Live::open(scene, None, self.rendering).map_err(|failure| failure.to_string())?;
        let name = live.name();
        let Pinhole { width_px, height_px, .. } = view.image;
        tell!("camera {}: {width_px} x {height_px} px; {} ({})", view.camera_id, name.adapter, name.driver);
        Ok(live)
    }
}
