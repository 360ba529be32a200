//! Poses that are rendered one after another as they come, over the sockets of CORTO's closed loop.

use std::net::{IpAddr, SocketAddr};
use std::path::Path;
use std::time::Instant;

use retina_batch::{AdapterName, LiveRenderer};
use retina_corto::{Pose, Server, World};
use retina_files::InputError;
use retina_radiometry::AU_M;
use retina_scene::{FrameChecks, RadianceScale, Scene, SceneFrame};
use retina_sky::{FramePose, Trajectory};

use super::Rendering;
use crate::failure::Failure;
use crate::output::tell;

/// Where poses come from and images go.
#[derive(clap::Args)]
pub(super) struct Listening {
    /// Address to listen on.
    ///
    /// Anyone who can reach it can request images.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    pub(super) listen: IpAddr,
    /// UDP port for poses; 0 takes any free port.
    #[arg(long, value_name = "PORT", default_value_t = 51_001)]
    pose_port: u16,
    /// TCP port for images; 0 takes any free port.
    #[arg(long, value_name = "PORT", default_value_t = 30_001)]
    image_port: u16,
    /// Stop after N images.
    #[arg(long, value_name = "N")]
    pub(super) frames: Option<usize>,
}

impl Listening {
    /// Takes the ports.
    pub(super) fn bind(&self) -> Result<Server, Failure> {
        Server::bind(self.listen, self.pose_port, self.image_port).map_err(|error| {
            Failure::new(format!(
                "cannot listen on UDP {0}:{1} or TCP {0}:{2}: {error}",
                self.listen, self.pose_port, self.image_port
            ))
        })
    }
}

/// Addresses of poses and of images.
pub(super) fn addresses(server: &Server) -> Result<[SocketAddr; 2], Failure> {
    let address = |found: std::io::Result<SocketAddr>| {
        found.map_err(|error| Failure::new(format!("a socket has no address: {error}")))
    };
    Ok([address(server.pose_address())?, address(server.image_address())?])
}

/// The scene without its frames, and what turns poses into them.
pub(super) fn scene_of_poses(file: &Path, scale_m_per_bu: f64) -> Result<(Scene, World), Failure> {
    let mut scene = Scene::read(file)?;
    one_body(file, scene.bodies.len())?;
    scene.allow_empty_frames = true;
    scene.bodies.iter_mut().for_each(|body| body.may_be_behind = true);
    if !(scale_m_per_bu.is_finite() && scale_m_per_bu > 0.0) {
        return Err(InputError::new("--scale-m-per-bu", "the value is out of range")
            .found(scale_m_per_bu)
            .expected("metres above 0")
            .into());
    }
    let body_names = scene.bodies.iter().map(|body| body.name.clone()).collect();
    Ok((scene, World { scale_m_per_bu, sun_distance_m: AU_M, body_names }))
}

/// Refuses a scene that the protocol cannot carry.
pub(super) fn one_body(file: &Path, bodies: usize) -> Result<(), InputError> {
    if bodies == 1 {
        return Ok(());
    }
    Err(InputError::new(file, "the protocol of the closed loop carries the pose of one body")
        .found(format!("a scene of {bodies} bodies"))
        .expected("one body"))
}

/// A renderer that is asked for one frame after another.
pub(super) struct Live {
    pub(super) scene: Scene,
    live: LiveRenderer,
    checks: FrameChecks,
    /// Images so far, and the time that they took, s.
    pub(super) frames: usize,
    pub(super) seconds: f64,
}

impl Live {
    pub(super) fn open(
        mut scene: Scene,
        radiance_scale: Option<f64>,
        rendering: &Rendering,
    ) -> Result<Self, Failure> {
        if let Some(scale) = radiance_scale {
            if !(scale.is_finite() && scale > 0.0) {
                return Err(InputError::new("--radiance-scale", "the value is out of range")
                    .found(scale)
                    .expected("a number above 0")
                    .into());
            }
            scene.radiance_scale = RadianceScale::Value(scale);
        }
        let quality = rendering.quality().unwrap_or(scene.quality);
        let (live, fallback) = LiveRenderer::open(&scene, rendering.backend.into(), quality)?;
        if let Some(reason) = fallback {
            tell!("rendering on the processor's cores: {reason}");
        }
        let checks = FrameChecks::of(&scene);
        Ok(Self { scene, live, checks, frames: 0, seconds: 0.0 })
    }

    /// What renders.
    pub(super) fn name(&self) -> AdapterName {
        self.live.name().clone()
    }

    /// The frame of a pose, and its image as a PNG.
    pub(super) fn pose(&mut self, world: &World, pose: &Pose) -> Result<(SceneFrame, Vec<u8>), String> {
        self.frame(world.frame(pose))
    }

    /// A frame that is given as it is, and its image as a PNG.
    pub(super) fn frame(&mut self, pose: FramePose) -> Result<(SceneFrame, Vec<u8>), String> {
        self.scene.trajectory = Trajectory::new(Path::new("the pose"), vec![pose]);
        let frame = self.scene.frame(0).map_err(|error| error.to_string())?;
        let frame = SceneFrame { index: self.frames, ..frame };
        let png = self.png(&frame)?;
        Ok((frame, png))
    }

    /// The image of a frame as a PNG.
    pub(super) fn png(&mut self, frame: &SceneFrame) -> Result<Vec<u8>, String> {
        let start = Instant::now();
        self.checks.check(&self.scene, frame).map_err(|error| error.to_string())?;
        let png = self.live.png(frame).map_err(|error| error.to_string())?;
        self.frames += 1;
        self.seconds += start.elapsed().as_secs_f64();
        Ok(png)
    }
}
