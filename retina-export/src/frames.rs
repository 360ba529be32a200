//! A folder of frames: which are there, and what is known of each.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use retina_batch::{BatchError, FolderState, read_exr};
use retina_files::{InputError, hash_bytes, read_bytes, read_text};
use serde::Deserialize;
use serde_json::Value;

use crate::silhouette::Silhouette;

/// The camera of the screen images, px.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(crate) struct Camera {
    pub(crate) fx: f64,
    pub(crate) fy: f64,
    pub(crate) cx: f64,
    pub(crate) cy: f64,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct LimbEllipse {
    pub(crate) center_px: [f64; 2],
    pub(crate) semi_axes_px: [f64; 2],
    pub(crate) angle_deg: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct BodyTruth {
    pub(crate) position_camera_m: [f64; 3],
    /// Scalar first.
    pub(crate) camera_from_body: [f64; 4],
    pub(crate) sun_direction_body: [f64; 3],
    pub(crate) phase_deg: f64,
    pub(crate) reference_semi_axes_m: [f64; 3],
    /// Absent where the body is behind the camera, or the camera within it.
    pub(crate) limb_ellipse_px: Option<LimbEllipse>,
}

impl BodyTruth {
    fn distance_m(&self) -> f64 {
        DVec3::from_array(self.position_camera_m).length()
    }

    pub(crate) fn rotation(&self) -> DMat3 {
        let [w, x, y, z] = self.camera_from_body;
        DMat3::from_quat(DQuat::from_xyzw(x, y, z, w))
    }
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Truth {
    pub(crate) time_s: f64,
    pub(crate) camera_from_inertial: [f64; 4],
    pub(crate) image_px: Camera,
    pub(crate) compensation: String,
    pub(crate) bodies: BTreeMap<String, BodyTruth>,
}

/// A body in a frame.
pub(crate) struct Seen<'a> {
    pub(crate) name: &'a str,
    pub(crate) body: &'a BodyTruth,
    /// All that it would cover alone.
    pub(crate) whole: Silhouette,
    /// What no nearer body hides.
    pub(crate) visible: Silhouette,
}

/// A frame with all that is exported of it.
pub(crate) struct Frame {
    pub(crate) index: usize,
    pub(crate) truth: Truth,
    /// The truth as it was written.
    pub(crate) document: Value,
    /// The screen image's file.
    pub(crate) png: Vec<u8>,
    /// Planes of the linear image, where one was written.
    pub(crate) planes: Option<retina_batch::Channels>,
}

impl Frame {
    /// Which pixels each body in view covers, in the order of their names: of one body alone the mask that was rendered,
    /// else the ellipse of its reference figure.
    pub(crate) fn seen(&self) -> Vec<Seen<'_>> {
        let camera = &self.truth.image_px;
        let size = [camera.width as usize, camera.height as usize];
        let rendered = self.planes.as_ref().and_then(|planes| {
            let (_, mask) = planes.channels.iter().find(|(name, _)| name == "mask")?;
            (planes.width_px == size[0] && planes.height_px == size[1])
                .then(|| Silhouette::of_mask(size, mask))
        });
        let one = self.truth.bodies.len() == 1;
        let whole: Vec<(&str, &BodyTruth, Silhouette)> = self
            .truth
            .bodies
            .iter()
            .filter_map(|(name, body)| {
                let limb = body.limb_ellipse_px.as_ref()?;
                let own = match &rendered {
                    Some(rendered) if one => rendered.clone(),
                    _ => Silhouette::of_ellipse(size, limb),
                };
                Some((name.as_str(), body, own))
            })
            .collect();
        whole
            .iter()
            .map(|(name, body, own)| {
                let nearer = whole.iter().filter(|(_, other, _)| other.distance_m() < body.distance_m());
                let visible = nearer.fold(own.clone(), |left, (_, _, other)| left.without(other));
                Seen { name, body, whole: own.clone(), visible }
            })
            .collect()
    }

    /// The camera's axes in inertial space.
    pub(crate) fn inertial_from_camera(&self) -> DMat3 {
        let [w, x, y, z] = self.truth.camera_from_inertial;
        DMat3::from_quat(DQuat::from_xyzw(x, y, z, w)).transpose()
    }
}

/// The frames of a folder.
pub(crate) struct Frames {
    dir: PathBuf,
    /// Numbers of those that are whole.
    pub(crate) indices: Vec<usize>,
    /// Frames of the sequence that are not there.
    pub(crate) missing: usize,
}

impl Frames {
    pub(crate) fn of(dir: &Path) -> Result<Self, BatchError> {
        let state = FolderState::read(dir, true)?.ok_or_else(|| {
            InputError::new(dir, "holds no frames")
                .expected("a folder that `retina render` or `retina merge` wrote")
        })?;
        if state.done.is_empty() {
            return Err(InputError::new(dir, "holds no finished frame").into());
        }
        if let Some(first) = state.torn.first() {
            return Err(InputError::new(dir, "has frames whose files are not what its manifest says")
                .found(format!("{} of them, the first is frame {first}", state.torn.len()))
                .help("`retina render --resume` makes them again")
                .into());
        }
        let missing = state.frames_of_sequence - state.done.len();
        Ok(Self { dir: dir.to_path_buf(), indices: state.done, missing })
    }

    pub(crate) fn read(&self, index: usize) -> Result<Frame, InputError> {
        let path = self.dir.join(format!("truth/{index:06}.json"));
        let broken = |error: serde_json::Error| {
            InputError::new(&path, format!("is not the truth of a frame: {error}"))
        };
        let document: Value = serde_json::from_str(&read_text(&path)?).map_err(broken)?;
        let truth = Truth::deserialize(&document).map_err(broken)?;
        let png = read_bytes(&self.dir.join(format!("frames/{index:06}.png")))?;
        let linear = self.dir.join(format!("frames/{index:06}.exr"));
        let planes = linear.exists().then(|| read_exr(&linear)).transpose()?.map(|(planes, _)| planes);
        Ok(Frame { index, truth, document, png, planes })
    }
}

/// Whether a frame is one of the validation's: by a hash of its number, so that a longer sequence keeps the split.
pub(crate) fn is_validation(index: usize, seed: u64, share: f64) -> bool {
    let hash = hash_bytes(format!("{seed}/{index}").as_bytes());
    let first = u64::from_str_radix(&hash[..13], 16).unwrap_or(0);
    (first as f64) < share * (1u64 << 52) as f64
}

/// Points of a body's reference figure that a network may learn: its centre, and where its axes leave it. Each has its place
/// in the image, and 2 where it is seen, 1 where this body or a nearer one hides it, 0 beyond the image.
pub(crate) fn keypoints(seen: &Seen<'_>, camera: &Camera) -> Vec<[f64; 3]> {
    let body = seen.body;
    let rotation = body.rotation();
    let centre = DVec3::from_array(body.position_camera_m);
    let axes = DVec3::from_array(body.reference_semi_axes_m);
    let mut places = vec![(DVec3::ZERO, DVec3::ZERO)];
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        places.extend([1.0, -1.0].map(|side| (side * axis * axes, side * axis)));
    }
    places
        .into_iter()
        .map(|(place, normal)| {
            let at = centre + rotation * place;
            let px = [camera.fx * at.x / at.z + camera.cx, camera.fy * at.y / at.z + camera.cy];
            let inside = at.z > 0.0
                && (0.0..f64::from(camera.width)).contains(&px[0])
                && (0.0..f64::from(camera.height)).contains(&px[1]);
            let faces = (rotation * normal).dot(at) < 0.0;
            match inside {
                false => [0.0, 0.0, 0.0],
                true => {
                    let hidden = seen.whole.covers(px) && !seen.visible.covers(px);
                    [px[0], px[1], if faces && !hidden { 2.0 } else { 1.0 }]
                }
            }
        })
        .collect()
}

/// Names of [`keypoints`].
pub(crate) const KEYPOINTS: [&str; 7] = ["centre", "+x", "-x", "+y", "-y", "+z", "-z"];
