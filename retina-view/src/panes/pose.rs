//! A camera beside a body by the numbers that a person turns: where over the body it stands, how far, what is up, where
//! the Sun is.

use glam::{DMat3, DQuat, DVec3};
use retina_geometry::Pinhole;
use retina_scene::SceneFrame;
use retina_sky::{BodyPose, FramePose};
use serde::{Deserialize, Serialize};

/// See the module. Angles in degrees: people set them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct View {
    /// From the body's centre to the camera, m.
    distance_m: f64,
    /// Place on the body that the camera stands over, body axes.
    longitude_deg: f64,
    latitude_deg: f64,
    /// Direction of the body's north in the image, from +x towards +y.
    north_deg: f64,
    /// Where the body's centre is, px from the image's middle.
    offset_px: [f64; 2],
    /// Sun, body, camera.
    phase_deg: f64,
    /// Direction of the Sun in the image, from +x towards +y.
    sun_deg: f64,
}

/// Straight over a pole no direction is north.
const HIGHEST_LATITUDE_DEG: f64 = 89.999;

/// Axes about the line of sight to the body, +z towards it, as the camera has them where the body is in the middle.
fn camera_from_sight(to_body: DVec3) -> DMat3 {
    DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, to_body.normalize()))
}

/// Columns: towards the observer, east, north, of a place on the body.
fn local_axes(longitude: f64, latitude: f64) -> DMat3 {
    let up = DVec3::new(latitude.cos() * longitude.cos(), latitude.cos() * longitude.sin(), latitude.sin());
    let east = DVec3::new(-longitude.sin(), longitude.cos(), 0.0);
    DMat3::from_cols(up, east, up.cross(east))
}

impl View {
    /// The numbers are finite, and the distance is one.
    pub(super) fn is_sound(&self) -> bool {
        let angles = [self.longitude_deg, self.north_deg, self.phase_deg, self.sun_deg];
        self.distance_m > 0.0
            && self.distance_m < 1e15
            && self.latitude_deg.abs() <= 90.0
            && angles.iter().chain(&self.offset_px).all(|value| value.is_finite() && value.abs() < 1e6)
    }

    /// The view of a body in a frame.
    pub(super) fn of(frame: &SceneFrame, body: usize, image: &Pinhole) -> Self {
        let state = &frame.bodies[body];
        let at = state.position_camera_m;
        let turn = camera_from_sight(at);
        let to_camera = -(state.camera_from_body.transpose() * at).normalize();
        let in_sight = |direction: DVec3| turn.transpose() * (state.camera_from_body * direction);
        let [north, sun] = [in_sight(DVec3::Z), in_sight(state.sun_position_body_m.normalize())];
        let [middle_x, middle_y] = middle(image);
        Self {
            distance_m: at.length(),
            longitude_deg: to_camera.y.atan2(to_camera.x).to_degrees(),
            latitude_deg: to_camera.z.clamp(-1.0, 1.0).asin().to_degrees(),
            north_deg: north.y.atan2(north.x).to_degrees(),
            offset_px: [
                image.cx_px + image.fx_px * at.x / at.z - middle_x,
                image.cy_px + image.fy_px * at.y / at.z - middle_y,
            ],
            phase_deg: state.phase_rad().to_degrees(),
            sun_deg: sun.y.atan2(sun.x).to_degrees(),
        }
    }

    /// The frame with the camera and the Sun of this view; bodies stay where they are.
    pub(super) fn pose(
        &self,
        frame: &SceneFrame,
        names: &[String],
        body: usize,
        image: &Pinhole,
    ) -> FramePose {
        let [middle_x, middle_y] = middle(image);
        let sight = DVec3::new(
            (middle_x + self.offset_px[0] - image.cx_px) / image.fx_px,
            (middle_y + self.offset_px[1] - image.cy_px) / image.fy_px,
            1.0,
        );
        let turn = camera_from_sight(sight);
        let radians = |degrees: f64| degrees.to_radians();
        let latitude = self.latitude_deg.clamp(-HIGHEST_LATITUDE_DEG, HIGHEST_LATITUDE_DEG);
        let body_axes = local_axes(radians(self.longitude_deg), radians(latitude));
        let (sin, cos) = radians(self.north_deg).sin_cos();
        // Towards the observer, east and north about the line of sight.
        let sight_axes =
            DMat3::from_cols(DVec3::NEG_Z, DVec3::new(-sin, cos, 0.0), DVec3::new(cos, sin, 0.0));
        let camera_from_body = turn * sight_axes * body_axes.transpose();

        let inertial_from_camera = frame.camera_from_inertial.inverse();
        let bodies: Vec<BodyPose> = (0..names.len())
            .map(|k| BodyPose {
                position_m: frame.camera_position_m
                    + inertial_from_camera * frame.bodies[k].position_camera_m,
                body_from_inertial: (frame.camera_from_body[k].inverse() * frame.camera_from_inertial)
                    .normalize(),
            })
            .collect();
        let own = bodies[body];
        let camera_from_inertial = (DQuat::from_mat3(&camera_from_body) * own.body_from_inertial).normalize();
        let to_camera = -(sight.normalize() * self.distance_m);
        let (phase, sun) = (radians(self.phase_deg), radians(self.sun_deg));
        let to_sun = turn * DVec3::new(phase.sin() * sun.cos(), phase.sin() * sun.sin(), -phase.cos());
        let sun_distance_m = frame.bodies[body].sun_position_body_m.length();
        let inertial = |in_camera: DVec3| camera_from_inertial.inverse() * in_camera;
        FramePose {
            time_s: frame.time_s,
            camera_position_m: own.position_m + inertial(to_camera),
            camera_from_inertial,
            camera_velocity_m_s: None,
            sun_position_m: Some(own.position_m + inertial(to_sun * sun_distance_m)),
            bodies: names.iter().cloned().zip(bodies).collect(),
        }
    }
}

fn middle(image: &Pinhole) -> [f64; 2] {
    [image.width_px, image.height_px].map(|size| f64::from(size) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use retina_render::BodyState;

    /// A camera at the origin that looks along +z at a turned body.
    fn frame(pose: &FramePose) -> SceneFrame {
        let own = pose.bodies["a"];
        let turn = pose.camera_from_inertial * own.body_from_inertial.inverse();
        let sun = pose.sun_position_m.unwrap() - own.position_m;
        SceneFrame {
            index: 0,
            time_s: 0.0,
            camera_from_inertial: pose.camera_from_inertial,
            camera_position_m: pose.camera_position_m,
            camera_velocity_m_s: None,
            camera_from_body: vec![turn],
            bodies: vec![BodyState {
                position_camera_m: pose.camera_from_inertial * (own.position_m - pose.camera_position_m),
                camera_from_body: DMat3::from_quat(turn),
                sun_position_body_m: own.body_from_inertial * sun,
            }],
        }
    }

    #[test]
    fn a_view_becomes_a_pose_and_the_pose_the_same_view() {
        let start = FramePose {
            time_s: 0.0,
            camera_position_m: DVec3::new(1e3, 2e3, -5e5),
            camera_from_inertial: DQuat::from_rotation_x(0.1),
            camera_velocity_m_s: None,
            sun_position_m: Some(DVec3::new(1.5e11, 3e10, -2e9)),
            bodies: [(
                "a".to_owned(),
                BodyPose {
                    position_m: DVec3::new(1e3, 5e4, 4e4),
                    body_from_inertial: DQuat::from_rotation_z(0.7),
                },
            )]
            .into(),
        };
        let image = Pinhole { cx_px: 310.0, ..Pinhole::centred(2000.0, [640, 400]) };
        let view = View {
            distance_m: 3.3e5,
            longitude_deg: 130.0,
            latitude_deg: -35.0,
            north_deg: 200.0 - 360.0,
            offset_px: [40.0, -25.0],
            phase_deg: 71.0,
            sun_deg: 15.0,
        };
        let pose = view.pose(&frame(&start), &["a".to_owned()], 0, &image);
        let again = View::of(&frame(&pose), 0, &image);
        let numbers = |v: &View| {
            [
                v.distance_m / 1e5,
                v.longitude_deg,
                v.latitude_deg,
                v.north_deg,
                v.offset_px[0],
                v.offset_px[1],
                v.phase_deg,
                v.sun_deg,
            ]
        };
        for (a, b) in numbers(&again).into_iter().zip(numbers(&view)) {
            assert!((a - b).abs() < 1e-6, "{again:?}");
        }
        // The body stays where it is.
        assert!((pose.bodies["a"].position_m - start.bodies["a"].position_m).length() < 1e-4);
    }
}
