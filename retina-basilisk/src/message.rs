//! The parts of `VizMessage` that an image depends on. Names and numbers of the fields are those that Basilisk 2.12 sends
//! (its message descriptor); all others are passed over.

use prost::Message;

#[derive(Clone, PartialEq, Message)]
pub(crate) struct VizMessage {
    #[prost(message, optional, tag = "1")]
    pub(crate) current_time: Option<TimeStamp>,
    #[prost(message, repeated, tag = "2")]
    pub(crate) celestial_bodies: Vec<CelestialBody>,
    #[prost(message, repeated, tag = "3")]
    pub(crate) spacecraft: Vec<Spacecraft>,
    #[prost(message, repeated, tag = "4")]
    pub(crate) cameras: Vec<CameraConfig>,
    #[prost(message, optional, tag = "8")]
    pub(crate) epoch: Option<EpochDateTime>,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct TimeStamp {
    /// Nanoseconds since the epoch.
    #[prost(double, tag = "2")]
    pub(crate) sim_time_elapsed: f64,
}

/// UTC.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct EpochDateTime {
    #[prost(int32, tag = "1")]
    pub(crate) year: i32,
    #[prost(int32, tag = "2")]
    pub(crate) month: i32,
    #[prost(int32, tag = "3")]
    pub(crate) day: i32,
    #[prost(int32, tag = "4")]
    pub(crate) hours: i32,
    #[prost(int32, tag = "5")]
    pub(crate) minutes: i32,
    #[prost(double, tag = "6")]
    pub(crate) seconds: f64,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct CelestialBody {
    #[prost(string, tag = "1")]
    pub(crate) body_name: String,
    /// m, inertial axes.
    #[prost(double, repeated, tag = "2")]
    pub(crate) position: Vec<f64>,
    /// The rows of the matrix that takes inertial axes to the body's.
    #[prost(double, repeated, tag = "4")]
    pub(crate) rotation: Vec<f64>,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct Spacecraft {
    #[prost(string, tag = "1")]
    pub(crate) spacecraft_name: String,
    /// m, inertial axes.
    #[prost(double, repeated, tag = "2")]
    pub(crate) position: Vec<f64>,
    /// Modified Rodrigues parameters of the body's axes with respect to inertial ones.
    #[prost(double, repeated, tag = "4")]
    pub(crate) rotation: Vec<f64>,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct CameraConfig {
    #[prost(int64, tag = "1")]
    pub(crate) camera_id: i64,
    #[prost(string, tag = "2")]
    pub(crate) parent_name: String,
    /// Edge to edge along the camera's y axis, degrees.
    #[prost(double, tag = "3")]
    pub(crate) field_of_view: f64,
    /// Width and height, px.
    #[prost(int64, repeated, tag = "4")]
    pub(crate) resolution: Vec<i64>,
    /// m, axes of the spacecraft's body.
    #[prost(double, repeated, tag = "7")]
    pub(crate) camera_pos_b: Vec<f64>,
    /// Modified Rodrigues parameters of Unity's camera axes with respect to the body's.
    #[prost(double, repeated, tag = "8")]
    pub(crate) camera_dir_b: Vec<f64>,
    /// 0: an image, 1: depths.
    #[prost(int64, tag = "16")]
    pub(crate) render_mode: i64,
}
