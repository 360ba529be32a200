//! BOP, scene by scene: a thousand frames a folder, poses in millimetres. The centre of the first pixel is (0, 0) there.

use std::collections::{BTreeMap, BTreeSet};

use retina_batch::BatchError;
use serde_json::{Map, Value, json};

use crate::export::Writer;
use crate::frames::{Camera, Frame, LimbEllipse, Seen};
use crate::out::Out;

/// Frames of a scene's folder.
const CHUNK: usize = 1000;
const MM_PER_M: f64 = 1000.0;

/// The three documents of a scene, by image.
#[derive(Default)]
struct Scene {
    camera: Map<String, Value>,
    poses: Map<String, Value>,
    seen: Map<String, Value>,
}

#[derive(Default)]
pub(crate) struct Bop {
    camera: Option<Camera>,
    scenes: BTreeMap<String, Scene>,
    /// Bodies by name; their numbers are their places among these, from 1.
    bodies: BTreeMap<String, [f64; 3]>,
    names: BTreeSet<String>,
}

impl Writer for Bop {
    fn add(&mut self, out: &Out, frame: &Frame, is_validation: bool) -> Result<(), BatchError> {
        let c = frame.truth.image_px;
        self.camera = Some(c);
        let folder = format!("{}/{:06}", if is_validation { "val" } else { "train" }, frame.index / CHUNK);
        let number = frame.index % CHUNK;
        out.write(&format!("{folder}/rgb/{number:06}.png"), &frame.png)?;
        // All frames of a sequence have the same bodies, so the numbers do not change.
        for (name, body) in &frame.truth.bodies {
            self.bodies.insert(name.clone(), body.reference_semi_axes_m);
            self.names.insert(name.clone());
        }
        let (mut poses, mut seen) = (Vec::new(), Vec::new());
        for (at, Seen { name, body, whole, visible }) in frame.seen().iter().enumerate() {
            out.write(&format!("{folder}/mask/{number:06}_{at:06}.png"), &whole.png()?)?;
            out.write(&format!("{folder}/mask_visib/{number:06}_{at:06}.png"), &visible.png()?)?;
            poses.push(json!({
                "cam_R_m2c": body.rotation().transpose().to_cols_array(),
                "cam_t_m2c": body.position_camera_m.map(|length| length * MM_PER_M),
                "obj_id": self.number_of(name),
            }));
            // What lies beyond the image counts, too.
            let all =
                body.limb_ellipse_px.as_ref().map_or(whole.area(), |limb| whole_area(limb, &c, whole.area()));
            let left = visible.area();
            seen.push(json!({
                "bbox_obj": body.limb_ellipse_px.as_ref().map_or([-1.0; 4], extent),
                "bbox_visib": visible.bounds().map_or(json!([-1, -1, -1, -1]), |bounds| json!(bounds)),
                "px_count_all": all,
                "px_count_valid": whole.area(),
                "px_count_visib": left,
                "visib_fract": if all > 0 { left as f64 / all as f64 } else { 0.0 },
            }));
        }
        let scene = self.scenes.entry(folder).or_default();
        scene.camera.insert(
            number.to_string(),
            json!({ "cam_K": [c.fx, 0.0, c.cx - 0.5, 0.0, c.fy, c.cy - 0.5, 0.0, 0.0, 1.0], "depth_scale": 1.0 }),
        );
        scene.poses.insert(number.to_string(), poses.into());
        scene.seen.insert(number.to_string(), seen.into());
        Ok(())
    }

    fn finish(&mut self, out: &Out) -> Result<(), BatchError> {
        for (folder, scene) in &self.scenes {
            for (name, document) in
                [("scene_camera", &scene.camera), ("scene_gt", &scene.poses), ("scene_gt_info", &scene.seen)]
            {
                out.write_json(&format!("{folder}/{name}.json"), &Value::from(document.clone()))?;
            }
        }
        let mut models = Map::new();
        for (name, axes) in &self.bodies {
            let axes = axes.map(|length| length * MM_PER_M);
            let most = axes.iter().copied().fold(0.0, f64::max);
            models.insert(
                self.number_of(name).to_string(),
                json!({
                    "name": name,
                    "diameter": 2.0 * most,
                    "min_x": -axes[0], "min_y": -axes[1], "min_z": -axes[2],
                    "size_x": 2.0 * axes[0], "size_y": 2.0 * axes[1], "size_z": 2.0 * axes[2],
                }),
            );
        }
        out.write_json("models/models_info.json", &Value::from(models))?;
        let Some(c) = self.camera else { return Ok(()) };
        out.write_json(
            "camera.json",
            &json!({
                "fx": c.fx, "fy": c.fy, "cx": c.cx - 0.5, "cy": c.cy - 0.5,
                "width": c.width, "height": c.height, "depth_scale": 1.0,
            }),
        )
    }
}

impl Bop {
    fn number_of(&self, name: &str) -> usize {
        1 + self.names.iter().position(|own| own == name).unwrap_or(0)
    }
}

/// The box about an ellipse, also beyond the image: x, y, width, height, from the centre of the first pixel.
fn extent(limb: &LimbEllipse) -> [f64; 4] {
    let (sin, cos) = limb.angle_deg.to_radians().sin_cos();
    let [a, b] = limb.semi_axes_px;
    let half = [(a * cos).hypot(b * sin), (a * sin).hypot(b * cos)];
    let [x, y] = limb.center_px;
    [x - half[0] - 0.5, y - half[1] - 0.5, 2.0 * half[0], 2.0 * half[1]]
}

/// Pixels of a silhouette: those in the image, or the ellipse's area where it reaches beyond.
fn whole_area(limb: &LimbEllipse, camera: &Camera, inside: usize) -> usize {
    let [x, y, width, height] = extent(limb);
    let within = x >= -0.5
        && y >= -0.5
        && x + width <= f64::from(camera.width) - 0.5
        && y + height <= f64::from(camera.height) - 0.5;
    let [a, b] = limb.semi_axes_px;
    if within { inside } else { inside.max((std::f64::consts::PI * a * b).round() as usize) }
}
