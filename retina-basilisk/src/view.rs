//! What a camera of the simulation sees.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3};
use prost::Message as _;
use retina_geometry::Pinhole;
use retina_sky::time::parse_epoch;
use retina_sky::{BodyPose, FramePose};

use crate::message::{CameraConfig, EpochDateTime, VizMessage};

/// Where the Sun is among the simulation's bodies.
const SUN: &str = "sun";
/// Narrowest field of view, deg.
const NARROWEST_DEG: f64 = 1e-5;
/// Most pixels along a side.
const LARGEST_SIDE_PX: i64 = 16_384;
/// Beyond this, modified Rodrigues parameters are whole turns to rounding: no simulation lets them grow beyond 1.
const LARGEST_MRP: f64 = 1e6;
/// Places are within this, m: some ten light years.
const FARTHEST_M: f64 = 1e17;
/// How far a rotation matrix may be off one.
const ROTATION_TOLERANCE: f64 = 1e-6;
/// Unity's axes of a camera (-x boresight, y right, z up) from those of its image (x right, y down, z boresight).
/// `vizInterface` puts this turn, of modified Rodrigues parameters (1, 1, -1) / 3, after the camera's own.
const UNITY_FROM_CAMERA: DMat3 = DMat3::from_cols_array(&[0.0, 1.0, 0.0, 0.0, 0.0, -1.0, -1.0, 0.0, 0.0]);

/// The state that the simulation sent last.
#[derive(Debug, Default)]
pub struct Simulation {
    message: VizMessage,
    /// Is sent once, with the first state.
    epoch: Option<EpochDateTime>,
}

/// A frame, and the image that shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The camera's number in the simulation.
    pub camera_id: i64,
    /// Its projection: square pixels, the principal point in the middle.
    pub image: Pinhole,
    /// The frame. Its origin and axes are the simulation's.
    pub frame: FramePose,
}

impl Simulation {
    /// Takes a state: a serialized `VizMessage`.
    ///
    /// # Errors
    /// The bytes are no such message.
    pub fn update(&mut self, bytes: &[u8]) -> Result<(), String> {
        let message = VizMessage::decode(bytes).map_err(|error| format!("this is no VizMessage: {error}"))?;
        if let Some(epoch) = &message.epoch {
            self.epoch = Some(epoch.clone());
        }
        self.message = message;
        Ok(())
    }

    /// What a camera sees of bodies with these names. A name is that of a celestial body or of a spacecraft, upper or lower
    /// case; what Basilisk adds to names (`_planet_data`, ` barycenter`) does not count.
    ///
    /// # Errors
    /// What is missing in the state, or is no number.
    pub fn view(&self, camera_id: i64, body_names: &[String]) -> Result<View, String> {
        let cameras = &self.message.cameras;
        let Some(camera) = cameras.iter().find(|camera| camera.camera_id == camera_id) else {
            let known = cameras.iter().map(|camera| camera.camera_id.to_string());
            return Err(format!("the simulation has no camera {camera_id}; it has {}", listed(known)));
        };
        if camera.render_mode != 0 {
            return Err(format!("camera {camera_id} asks for depths (renderMode 1); only images are made"));
        }
        let image = projection(camera)?;
        let bodies = self.bodies()?;
        let parent = self.parent(camera, &bodies)?;
        let unity_from_parent = mrp(&camera.camera_dir_b, "cameraDir_B")?;
        let camera_from_parent = DQuat::from_mat3(&UNITY_FROM_CAMERA).inverse() * unity_from_parent;
        let offset = vector(&camera.camera_pos_b, "cameraPos_B")?;
        let Some(sun) = bodies.get(SUN) else {
            return Err(format!(
                "the simulation has no Sun, which lights the scene; it has {}. Add one, for example by gravFactory.createSun()",
                listed(bodies.keys().cloned())
            ));
        };
        let seen = body_names.iter().map(|name| match bodies.get(&plain(name)) {
            Some(pose) => Ok((name.clone(), *pose)),
            None => Err(format!(
                "body `{name}` of the scene is not in the simulation; it has {}",
                listed(bodies.keys().cloned())
            )),
        });
        let frame = FramePose {
            time_s: self.time_s()?,
            camera_position_m: parent.position_m + parent.body_from_inertial.inverse() * offset,
            camera_from_inertial: (camera_from_parent * parent.body_from_inertial).normalize(),
            // Relative to a body of the simulation's choice: no aberration follows from it.
            camera_velocity_m_s: None,
            sun_position_m: Some(sun.position_m),
            bodies: seen.collect::<Result<_, String>>()?,
        };
        Ok(View { camera_id, image, frame })
    }

    /// TDB seconds since J2000.
    fn time_s(&self) -> Result<f64, String> {
        let elapsed_s = self.message.current_time.as_ref().map_or(0.0, |time| time.sim_time_elapsed) * 1e-9;
        let Some(epoch) = &self.epoch else { return Ok(elapsed_s) };
        let EpochDateTime { year, month, day, hours, minutes, seconds } = epoch;
        let text = format!("{year:04}-{month:02}-{day:02}T{hours:02}:{minutes:02}:{seconds:06.3} UTC");
        let start_s = parse_epoch(&text).map_err(|error| format!("the simulation's epoch: {error}"))?;
        Ok(start_s + elapsed_s)
    }

    /// Every body and spacecraft by its plain name; a body goes before a spacecraft of the same.
    fn bodies(&self) -> Result<BTreeMap<String, BodyPose>, String> {
        let mut out = BTreeMap::new();
        for craft in &self.message.spacecraft {
            let pose = BodyPose {
                position_m: vector(&craft.position, &craft.spacecraft_name)?,
                body_from_inertial: mrp(&craft.rotation, &craft.spacecraft_name)?,
            };
            out.insert(plain(&craft.spacecraft_name), pose);
        }
        for body in &self.message.celestial_bodies {
            let pose = BodyPose {
                position_m: vector(&body.position, &body.body_name)?,
                body_from_inertial: rotation(&body.rotation, &body.body_name)?,
            };
            out.insert(plain(&body.body_name), pose);
        }
        Ok(out)
    }

    /// The spacecraft that a camera is on.
    fn parent(&self, camera: &CameraConfig, bodies: &BTreeMap<String, BodyPose>) -> Result<BodyPose, String> {
        let crafts = &self.message.spacecraft;
        let named = crafts.iter().find(|craft| craft.spacecraft_name == camera.parent_name);
        let only = (camera.parent_name.is_empty() && crafts.len() == 1).then(|| &crafts[0]);
        let pose = named.or(only).and_then(|craft| bodies.get(&plain(&craft.spacecraft_name)));
        pose.cloned().ok_or_else(|| {
            format!(
                "camera {} is on `{}`, which is no spacecraft of the simulation; it has {}",
                camera.camera_id,
                camera.parent_name,
                listed(crafts.iter().map(|craft| craft.spacecraft_name.clone()))
            )
        })
    }
}

/// Names one after another, or a word for none.
fn listed(names: impl Iterator<Item = String>) -> String {
    let names: Vec<String> = names.collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// A name without what Basilisk adds to it.
fn plain(name: &str) -> String {
    let name = name.trim().to_lowercase();
    let name = name.strip_suffix("_planet_data").unwrap_or(&name);
    name.strip_suffix(" barycenter").unwrap_or(name).to_owned()
}

fn vector(values: &[f64], of: &str) -> Result<DVec3, String> {
    match values {
        &[x, y, z] if values.iter().all(|v| v.abs() <= FARTHEST_M) => Ok(DVec3::new(x, y, z)),
        other => Err(format!("`{of}` has {other:?} where three numbers up to {FARTHEST_M:e} are expected")),
    }
}

/// Turned axes from those they are turned against, by modified Rodrigues parameters s = e tan(angle / 4) (H. Schaub and
/// J. L. Junkins, Analytical Mechanics of Space Systems, sec. 3.6): a passive rotation.
fn mrp(values: &[f64], of: &str) -> Result<DQuat, String> {
    let s = vector(values, of)?;
    let square = s.length_squared();
    if square > LARGEST_MRP * LARGEST_MRP {
        return Err(format!("`{of}` has {values:?} where modified Rodrigues parameters are expected"));
    }
    let q = s * (2.0 / (1.0 + square));
    Ok(DQuat::from_xyzw(-q.x, -q.y, -q.z, (1.0 - square) / (1.0 + square)).normalize())
}

fn rotation(values: &[f64], of: &str) -> Result<DQuat, String> {
    let &[a, b, c, d, e, f, g, h, i] = values else {
        return Err(format!("the rotation of `{of}` has {} numbers where nine are expected", values.len()));
    };
    let matrix = DMat3::from_cols_array(&[a, d, g, b, e, h, c, f, i]);
    let off = (matrix * matrix.transpose() - DMat3::IDENTITY).to_cols_array();
    if !off.iter().all(|v| v.abs() < ROTATION_TOLERANCE) || matrix.determinant() < 0.0 {
        return Err(format!("the rotation of `{of}` is no rotation: {values:?}"));
    }
    Ok(DQuat::from_mat3(&matrix).normalize())
}

fn projection(camera: &CameraConfig) -> Result<Pinhole, String> {
    let of = format!("camera {}", camera.camera_id);
    let side = |value: i64| (1..=LARGEST_SIDE_PX).contains(&value).then_some(value as u32);
    let (Some(width), Some(height)) =
        (camera.resolution.first().copied().and_then(side), camera.resolution.get(1).copied().and_then(side))
    else {
        return Err(format!(
            "{of} has the resolution {:?} where width and height of 1 to {LARGEST_SIDE_PX} px are expected",
            camera.resolution
        ));
    };
    if !(camera.field_of_view > NARROWEST_DEG && camera.field_of_view < 180.0) {
        return Err(format!(
            "{of} has a field of view of {} deg where more than {NARROWEST_DEG} and less than 180 are expected",
            camera.field_of_view
        ));
    }
    let focal_px = f64::from(height) / 2.0 / (camera.field_of_view.to_radians() / 2.0).tan();
    Ok(Pinhole::centred(focal_px, [width, height]))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::message::{CelestialBody, Spacecraft, TimeStamp};

    /// A probe 1e7 m below the Moon along z, whose axes are the inertial ones, with a camera that looks along its z. The
    /// Moon is turned by 90 deg about z: its x axis is the inertial y.
    pub(crate) fn state() -> VizMessage {
        VizMessage {
            current_time: Some(TimeStamp { sim_time_elapsed: 2.5e9 }),
            celestial_bodies: vec![
                CelestialBody {
                    body_name: "moon_planet_data".to_owned(),
                    position: vec![1.0, 2.0, 3.0],
                    rotation: vec![0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
                },
                CelestialBody {
                    body_name: "Sun".to_owned(),
                    position: vec![1.5e11, 0.0, 0.0],
                    rotation: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                },
            ],
            spacecraft: vec![Spacecraft {
                spacecraft_name: "probe".to_owned(),
                position: vec![1.0, 2.0, -1e7],
                rotation: vec![0.0; 3],
            }],
            cameras: vec![CameraConfig {
                camera_id: 7,
                parent_name: "probe".to_owned(),
                field_of_view: 90.0,
                resolution: vec![64, 48],
                camera_pos_b: vec![0.5, 0.0, 0.0],
                camera_dir_b: vec![1.0 / 3.0, 1.0 / 3.0, -1.0 / 3.0],
                render_mode: 0,
            }],
            epoch: Some(EpochDateTime { year: 2000, month: 1, day: 1, hours: 12, minutes: 0, seconds: 0.0 }),
        }
    }

    fn simulation(message: &VizMessage) -> Simulation {
        let mut out = Simulation::default();
        out.update(&message.encode_to_vec()).unwrap();
        out
    }

    fn moon() -> Vec<String> {
        vec!["Moon".to_owned()]
    }

    #[test]
    fn places_and_turns_are_those_of_the_state() {
        let View { image, frame, .. } = simulation(&state()).view(7, &moon()).unwrap();
        assert!((image.fy_px - 24.0).abs() < 1e-12 && [image.cx_px, image.cy_px] == [32.0, 24.0]);
        assert_eq!(frame.camera_position_m, DVec3::new(1.5, 2.0, -1e7));
        let along = |v: DVec3| frame.camera_from_inertial * v;
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            assert!(along(axis).abs_diff_eq(axis, 1e-12), "{axis} is seen as {}", along(axis));
        }
        let body = &frame.bodies["Moon"];
        assert!((body.body_from_inertial * DVec3::Y).abs_diff_eq(DVec3::X, 1e-12));
        // 2000-01-01T12:00 UTC is 64.184 s before J2000's TDB count of the same name, and 2.5 s have passed.
        assert!((frame.time_s - 66.684).abs() < 1e-3, "{}", frame.time_s);
    }

    /// A quarter turn about z by modified Rodrigues parameters, tan(90 deg / 4): the body's x axis is the inertial y.
    #[test]
    fn rodrigues_parameters_turn_axes_and_not_vectors() {
        let mut state = state();
        state.spacecraft[0].rotation = vec![0.0, 0.0, (std::f64::consts::PI / 8.0).tan()];
        let frame = simulation(&state).view(7, &moon()).unwrap().frame;
        assert!((frame.camera_from_inertial * DVec3::Y).abs_diff_eq(DVec3::X, 1e-12));
        // The camera's place turns with the spacecraft.
        assert!(frame.camera_position_m.abs_diff_eq(DVec3::new(1.0, 2.5, -1e7), 1e-9));
    }

    #[test]
    fn what_is_missing_is_told() {
        let refusal = |change: fn(&mut VizMessage), camera: i64, body: &str| {
            let mut state = state();
            change(&mut state);
            simulation(&state).view(camera, &[body.to_owned()]).unwrap_err()
        };
        for (change, camera, body, expected) in [
            ((|_| ()) as fn(&mut VizMessage), 1, "moon", "no camera 1; it has 7"),
            (|_| (), 7, "eros", "`eros` of the scene is not in the simulation; it has moon, probe, sun"),
            (|s| s.celestial_bodies.truncate(1), 7, "moon", "no Sun"),
            (|s| s.spacecraft[0].spacecraft_name.clear(), 7, "moon", "is no spacecraft of the simulation"),
            (|s| s.cameras[0].resolution = vec![0, 48], 7, "moon", "resolution [0, 48]"),
            (|s| s.cameras[0].field_of_view = f64::NAN, 7, "moon", "field of view of NaN deg"),
            (|s| s.cameras[0].render_mode = 1, 7, "moon", "asks for depths"),
            (|s| s.celestial_bodies[0].rotation = vec![0.0; 9], 7, "moon", "is no rotation"),
            (|s| s.spacecraft[0].position.clear(), 7, "moon", "three numbers"),
            (|s| s.spacecraft[0].position[1] = f64::NAN, 7, "moon", "three numbers"),
            (|s| s.spacecraft[0].rotation[1] = 1e9, 7, "moon", "Rodrigues parameters are expected"),
        ] {
            let said = refusal(change, camera, body);
            assert!(said.contains(expected), "{said}");
        }
    }

    /// Bytes that are no message are refused, whatever they are, and leave the state as it was.
    #[test]
    fn damaged_states_change_nothing() {
        let whole = state().encode_to_vec();
        let mut simulation = simulation(&state());
        let before = simulation.view(7, &moon()).unwrap();
        assert!(simulation.update(&[0xff; 40]).is_err());
        assert_eq!(simulation.view(7, &moon()).unwrap(), before);
        for at in 0..whole.len() {
            for flip in [0x01, 0x80, 0xff] {
                let mut bytes = whole.clone();
                bytes[at] ^= flip;
                let mut damaged = Simulation::default();
                // Neither a panic nor numbers that are none.
                if damaged.update(&bytes).is_ok()
                    && let Ok(view) = damaged.view(7, &moon())
                {
                    assert!(view.frame.camera_position_m.is_finite() && view.image.fx_px > 0.0);
                }
            }
        }
    }
}
