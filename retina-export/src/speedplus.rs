//! SPEED+: `camera.json`, `synthetic/images`, and lists of poses for training and validation. A pose is the active rotation
//! from the target's axes to the camera's, scalar first, and the target's place in the camera's axes, m.

use retina_batch::BatchError;
use retina_files::InputError;
use serde_json::{Value, json};

use crate::export::Writer;
use crate::frames::{Camera, Frame};
use crate::out::Out;

/// A frame has its focal length in pixels alone; the format wants a pitch, too. Their ratio is what counts.
const NOMINAL_PITCH_M: f64 = 1e-5;

#[derive(Default)]
pub(crate) struct SpeedPlus {
    camera: Option<Camera>,
    lists: [Vec<Value>; 2],
}

impl Writer for SpeedPlus {
    fn add(&mut self, out: &Out, frame: &Frame, is_validation: bool) -> Result<(), BatchError> {
        let name = format!("img{:06}.png", frame.index);
        let bodies: Vec<_> = frame.truth.bodies.iter().collect();
        let [(_, body)] = bodies[..] else {
            return Err(InputError::new(
                format!("frame {}", frame.index),
                "SPEED+ has one target in each image",
            )
            .found(format!("{} bodies", bodies.len()))
            .help("the formats bop, coco and webdataset take any number")
            .into());
        };
        self.camera = Some(frame.truth.image_px);
        out.write(&format!("synthetic/images/{name}"), &frame.png)?;
        if let Some(seen) = frame.seen().first() {
            out.write(&format!("synthetic/masks/{name}"), &seen.visible.png()?)?;
        }
        self.lists[usize::from(is_validation)].push(json!({
            "filename": name,
            "q_vbs2tango_true": body.camera_from_body,
            "r_Vo2To_vbs_true": body.position_camera_m,
        }));
        Ok(())
    }

    fn finish(&mut self, out: &Out) -> Result<(), BatchError> {
        for (name, list) in ["train", "validation"].iter().zip(&self.lists) {
            out.write_json(&format!("synthetic/{name}.json"), &Value::from(list.clone()))?;
        }
        let Some(c) = self.camera else { return Ok(()) };
        out.write_json(
            "camera.json",
            &json!({
                "Nu": c.width,
                "Nv": c.height,
                "ppx": NOMINAL_PITCH_M,
                "ppy": NOMINAL_PITCH_M,
                "fx": c.fx * NOMINAL_PITCH_M,
                "fy": c.fy * NOMINAL_PITCH_M,
                "ccx": c.cx,
                "ccy": c.cy,
                "cameraMatrix": [[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]],
                "distCoeffs": [0.0, 0.0, 0.0, 0.0, 0.0],
            }),
        )
    }
}
