//! The truth beside a rendered frame, schema `retina.truth/1`.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DQuat, DVec2, DVec3};
use retina_files::{InputError, read_text};
use retina_geometry::Pinhole;
use serde::Deserialize;

use retina_navigation::limb::LimbBody;

/// What is true of a frame.
#[derive(Debug, Clone)]
pub struct FrameTruth {
    /// Its number.
    pub frame: usize,
    /// TDB seconds since J2000.
    pub time_s: f64,
    /// Attitude.
    pub camera_from_inertial: DQuat,
    /// K_f of the screen image.
    pub image: Pinhole,
    /// Whether the screen image was distorted beforehand.
    pub compensated: bool,
    /// The body's centre in the camera frame, m.
    pub position_camera_m: DVec3,
    /// Turns body axes into camera axes.
    pub camera_from_body: DQuat,
    /// From the body towards the Sun, camera frame, unit.
    pub sun_direction_camera: DVec3,
    /// Sun, body, camera, rad.
    pub phase_rad: f64,
    /// Semi-axes of the reference ellipsoid, m.
    pub semi_axes_m: DVec3,
    /// Velocity of the camera relative to the body, inertial axes, m/s, where the file's origin is the body.
    pub velocity_m_s: Option<DVec3>,
}

#[derive(Deserialize)]
struct File {
    schema: String,
    frame: usize,
    time_s: f64,
    camera_from_inertial: [f64; 4],
    image_px: ImageFile,
    compensation: String,
    bodies: BTreeMap<String, BodyFile>,
    camera_position_m: Option<[f64; 3]>,
    camera_velocity_m_s: Option<[f64; 3]>,
}

#[derive(Deserialize)]
struct ImageFile {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: u32,
    height: u32,
}

#[derive(Deserialize)]
struct BodyFile {
    position_camera_m: [f64; 3],
    camera_from_body: [f64; 4],
    sun_direction_body: [f64; 3],
    phase_deg: f64,
    reference_radius_m: f64,
    reference_semi_axes_m: Option<[f64; 3]>,
}

/// The origin of a file is the body where the camera's place agrees with the body's to this, m.
const SAME_ORIGIN_M: f64 = 1.0;

impl FrameTruth {
    /// Reads a frame's truth about `body`; without a name, about the only one.
    ///
    /// # Errors
    /// It does not fit, or has no such body.
    pub fn read(path: &Path, body: Option<&str>) -> Result<Self, InputError> {
        let file: File = serde_json::from_str(&read_text(path)?).map_err(|error| {
            InputError::new(path, format!("is not the truth of a frame: {error}"))
                .expected("schema `retina.truth/1`, as `retina render` writes it")
        })?;
        if file.schema != "retina.truth/1" {
            return Err(InputError::new(path, "is not the truth of a frame")
                .at("key `schema`")
                .found(format!("`{}`", file.schema))
                .expected("`retina.truth/1`"));
        }
        let names: Vec<&str> = file.bodies.keys().map(String::as_str).collect();
        let found = match (body, &names[..]) {
            (Some(name), _) => file.bodies.get(name),
            (None, [only]) => file.bodies.get(*only),
            (None, _) => None,
        };
        let Some(seen) = found else {
            let listed = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            let error = InputError::new(
                path,
                match body {
                    Some(_) => "the body that is asked for is not in it",
                    None => "it is not clear which body is measured",
                },
            );
            let error = error.at("key `bodies`").found(listed);
            return Err(match body {
                Some(name) => error.expected(format!("`{name}`")),
                None => error.expected("one body").help("name one by --body, or render a scene that has one"),
            });
        };
        let quaternion = |key: &str, [w, x, y, z]: [f64; 4]| {
            let q = DQuat::from_xyzw(x, y, z, w);
            if (q.length() - 1.0).abs() < 1e-6 {
                return Ok(q.normalize());
            }
            Err(InputError::new(path, "is not a unit quaternion")
                .at(format!("key `{key}`"))
                .found(q.length())
                .expected("length 1"))
        };
        let camera_from_inertial = quaternion("camera_from_inertial", file.camera_from_inertial)?;
        let camera_from_body = quaternion("camera_from_body", seen.camera_from_body)?;
        let position_camera_m = DVec3::from_array(seen.position_camera_m);
        let semi_axes_m =
            seen.reference_semi_axes_m.map_or(DVec3::splat(seen.reference_radius_m), DVec3::from_array);
        if !(position_camera_m.is_finite() && semi_axes_m.min_element() > 0.0 && semi_axes_m.is_finite()) {
            return Err(InputError::new(path, "the body's place or size does not fit")
                .found(format!("{position_camera_m} m, semi-axes {semi_axes_m} m"))
                .expected("finite numbers, semi-axes above 0"));
        }
        let relative_m = -(camera_from_inertial.inverse() * position_camera_m);
        let about_body = file
            .camera_position_m
            .is_some_and(|at| DVec3::from_array(at).distance(relative_m) < SAME_ORIGIN_M);
        let ImageFile { fx, fy, cx, cy, width, height } = file.image_px;
        Ok(Self {
            frame: file.frame,
            time_s: file.time_s,
            camera_from_inertial,
            image: Pinhole { fx_px: fx, fy_px: fy, cx_px: cx, cy_px: cy, width_px: width, height_px: height },
            compensated: file.compensation != "none",
            position_camera_m,
            camera_from_body,
            sun_direction_camera: camera_from_body * DVec3::from_array(seen.sun_direction_body),
            phase_rad: seen.phase_deg.to_radians(),
            semi_axes_m,
            velocity_m_s: file.camera_velocity_m_s.filter(|_| about_body).map(DVec3::from_array),
        })
    }

    /// The camera relative to the body, inertial axes, m.
    pub fn relative_position_m(&self) -> DVec3 {
        -(self.camera_from_inertial.inverse() * self.position_camera_m)
    }

    /// The body as the limb's fit takes it.
    pub fn limb_body(&self) -> LimbBody {
        LimbBody::ellipsoid(self.semi_axes_m, glam::DMat3::from_quat(self.camera_from_body))
    }

    /// Towards the Sun in the image; `None` where it stands behind the camera or behind the body to a degree.
    pub fn sun_direction_px(&self) -> Option<DVec2> {
        let along = self.position_camera_m.normalize();
        let across = self.sun_direction_camera - along * self.sun_direction_camera.dot(along);
        (across.length() > 1f64.to_radians().sin()).then(|| across.truncate())
    }
}
