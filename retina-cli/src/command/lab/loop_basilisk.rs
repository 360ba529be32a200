//! `retina lab loop --basilisk`: the bench's camera as the camera of a Basilisk simulation.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use retina::lab::{ClosedLoop, Rig};
use retina_basilisk::{Server, View};
use retina_files::InputError;
use retina_geometry::Setup;
use retina_scene::Scene;
use serde_json::json;

use super::closed_loop::{Arguments, around, check_setup, told};
use crate::command::live::Live;
use crate::failure::Failure;
use crate::output::{print_json_line, tell};

/// How far the simulation's field may be from the camera's.
const FIELD_TOLERANCE: f64 = 2e-3;

/// Renders, shows and photographs what the simulation asks for, and answers with the camera's images. Gives when it began.
pub(super) fn serve(
    arguments: &Arguments,
    setup: &Setup,
    rig: &mut Rig<'_>,
    closed: &mut ClosedLoop,
    stop: &Arc<AtomicBool>,
) -> Result<Instant, Failure> {
    let (listen, port) = (arguments.listening.listen, arguments.basilisk_port);
    let server = Server::bind(listen, port)
        .map_err(|error| Failure::new(format!("cannot listen on TCP {listen}:{port}: {error}")))?;
    let mut scene = Scene::read(&arguments.scene)?;
    check_setup(&scene, arguments, setup)?;
    if scene.bodies.is_empty() {
        return Err(InputError::new(&arguments.scene, "has no body for the simulation to show")
            .expected("[[body]] tables whose names are the simulation's")
            .into());
    }
    scene.allow_empty_frames = true;
    scene.bodies.iter_mut().for_each(|body| body.may_be_behind = true);
    // The simulation's places are not barycentric.
    (scene.stars, scene.flashes) = (None, None);
    let body_names: Vec<String> = scene.bodies.iter().map(|body| body.name.clone()).collect();
    let mut live = Live::open(scene, arguments.radiance_scale, &arguments.rendering)?;
    let address =
        server.address().map_err(|error| Failure::new(format!("the socket has no address: {error}")))?;
    tell!(
        "ready: Basilisk's vizInterface on tcp://{address}; bodies {}; the camera's images",
        body_names.join(", ")
    );
    if arguments.json {
        print_json_line(&json!({ "schema": "retina.lab-loop/1", "basilisk": address.to_string() }))?;
    }
    let start = Instant::now();
    let mut answer = |view: &View| {
        let asked = Instant::now();
        check_camera(view, setup)?;
        let (frame, png) = live.frame(view.frame.clone())?;
        let frame = around(rig, closed, &png, asked, &frame).map_err(|error| error.to_string())?;
        told(&frame);
        // The simulation reads images of 8 bits.
        frame.image.png_of_8_bits().map_err(|error| error.to_string())
    };
    server.run(&body_names, &mut answer, arguments.listening.frames, stop, &|text| tell!("{text}"));
    Ok(start)
}

/// The simulation's camera must be the one of the bench.
fn check_camera(view: &View, setup: &Setup) -> Result<(), String> {
    let own = setup.camera_pinhole();
    let size = [view.image.width_px, view.image.height_px];
    let off = view.image.fx_px / own.fx_px - 1.0;
    if size == [own.width_px, own.height_px] && off.abs() <= FIELD_TOLERANCE {
        return Ok(());
    }
    Err(format!(
        "camera {} of the simulation is not the bench's: {} x {} px with a focal length of {:.1} px; expected {} x {} px \
         and {:.1} px, which is a fieldOfView of {:.6} deg",
        view.camera_id,
        size[0],
        size[1],
        view.image.fx_px,
        own.width_px,
        own.height_px,
        own.fx_px,
        2.0 * (0.5 * f64::from(own.height_px) / own.fy_px).atan().to_degrees()
    ))
}
