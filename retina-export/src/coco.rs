//! COCO: images, and instances with masks as runs, boxes and keypoints.

use std::collections::BTreeMap;

use retina_batch::BatchError;
use serde_json::{Value, json};

use crate::export::Writer;
use crate::frames::{Frame, KEYPOINTS, Seen, keypoints};
use crate::out::Out;

#[derive(Default)]
struct Part {
    images: Vec<Value>,
    annotations: Vec<Value>,
}

pub(crate) struct Coco {
    licence: String,
    parts: [Part; 2],
    /// Bodies and their numbers.
    categories: BTreeMap<String, usize>,
}

const PARTS: [&str; 2] = ["train", "val"];

impl Coco {
    pub(crate) fn new(licence: &str) -> Self {
        Self { licence: licence.to_owned(), parts: Default::default(), categories: BTreeMap::new() }
    }
}

impl Writer for Coco {
    fn add(&mut self, out: &Out, frame: &Frame, is_validation: bool) -> Result<(), BatchError> {
        let own = usize::from(is_validation);
        let camera = &frame.truth.image_px;
        let file = format!("{:06}.png", frame.index);
        out.write(&format!("images/{}/{file}", PARTS[own]), &frame.png)?;
        // Numbers from 1: some readers take 0 for none.
        let image = frame.index + 1;
        for name in frame.truth.bodies.keys() {
            let next = self.categories.len() + 1;
            self.categories.entry(name.clone()).or_insert(next);
        }
        let part = &mut self.parts[own];
        part.images.push(json!({
            "id": image,
            "file_name": file,
            "width": camera.width,
            "height": camera.height,
            "license": 1,
            "time_s": frame.truth.time_s,
            "camera": { "fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy },
            "camera_from_inertial": frame.truth.camera_from_inertial,
        }));
        for (at, seen) in frame.seen().iter().enumerate() {
            let Seen { name, body, visible: silhouette, .. } = seen;
            let Some(bounds) = silhouette.bounds() else { continue };
            let points = keypoints(seen, camera);
            part.annotations.push(json!({
                "id": image * 100 + at,
                "image_id": image,
                "category_id": self.categories[*name],
                "bbox": bounds,
                "area": silhouette.area(),
                "iscrowd": 0,
                "segmentation": { "size": [silhouette.height, silhouette.width], "counts": silhouette.runs() },
                "num_keypoints": points.iter().filter(|point| point[2] > 0.0).count(),
                "keypoints": points.concat(),
                "camera_from_body": body.camera_from_body,
                "position_camera_m": body.position_camera_m,
                "sun_direction_body": body.sun_direction_body,
                "phase_deg": body.phase_deg,
            }));
        }
        Ok(())
    }

    fn finish(&mut self, out: &Out) -> Result<(), BatchError> {
        let categories: Vec<Value> = self
            .categories
            .iter()
            .map(|(name, number)| json!({ "id": number, "name": name, "keypoints": KEYPOINTS, "skeleton": [] }))
            .collect();
        for (name, part) in PARTS.iter().zip(&self.parts) {
            let document = json!({
                "info": { "description": "frames rendered by RETINA", "version": "1" },
                "licenses": [{ "id": 1, "name": self.licence, "url": "" }],
                "categories": categories,
                "images": part.images,
                "annotations": part.annotations,
            });
            // On one line: a mask has thousands of runs.
            out.write(&format!("annotations/instances_{name}.json"), format!("{document}\n").as_bytes())?;
        }
        Ok(())
    }
}
