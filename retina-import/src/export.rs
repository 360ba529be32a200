//! A lens as mrcal or OpenCV keep it.

use std::fmt::Write as _;
use std::path::Path;

use retina_files::{InputError, write_atomic};
use retina_geometry::{Lens, LensModel};
use serde_json::json;

use crate::HALF_PIXEL;
use crate::boards::cannot_write;

/// Writes a lens: `.cameramodel` for mrcal, `.yaml`, `.yml` or `.json` for OpenCV.
///
/// # Errors
/// The name ends otherwise, the program has no such model, or the file cannot be written.
pub fn write_camera_model(path: &Path, lens: &Lens, size_px: [u32; 2]) -> Result<(), InputError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let text = match extension.as_str() {
        "cameramodel" => mrcal(path, lens, size_px)?,
        "yaml" | "yml" => opencv(path, lens)?.yaml(size_px),
        "json" => opencv(path, lens)?.json(size_px),
        other => {
            return Err(InputError::new(path, "the file has the wrong extension")
                .found(format!("`.{other}`"))
                .expected("`.cameramodel` (mrcal), `.yaml` or `.json` (OpenCV)")
                .help("give the file a name with one of these extensions"));
        }
    };
    write_atomic(path, text.as_bytes()).map_err(|e| cannot_write(path, &e))
}

fn refused(path: &Path, program: &str, model: LensModel, expected: &str, help: &str) -> InputError {
    InputError::new(path, format!("{program} has no lens model of this kind"))
        .found(format!("`{}`", model.name()))
        .expected(expected)
        .help(help)
}

fn mrcal(path: &Path, lens: &Lens, [width, height]: [u32; 2]) -> Result<String, InputError> {
    let (name, count) = match lens.model {
        LensModel::Pinhole => ("LENSMODEL_PINHOLE", 0),
        LensModel::Stereographic => ("LENSMODEL_STEREOGRAPHIC", 0),
        LensModel::Rational => ("LENSMODEL_OPENCV8", 8),
        other => {
            let expected = "pinhole, fisheye:stereographic or rational";
            return Err(refused(
                path,
                "mrcal",
                other,
                expected,
                "fit one of these, or write .yaml for OpenCV",
            ));
        }
    };
    let centre = lens.centre_px - HALF_PIXEL;
    let mut values = vec![lens.focal_px.x, lens.focal_px.y, centre.x, centre.y];
    values.extend(&lens.coefficients[..count]);
    let numbers: Vec<String> = values.iter().map(|v| format!("{v:?}")).collect();
    Ok(format!(
        "{{\n    'lensmodel':  '{name}',\n\n    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n    'intrinsics': [ {},],\n\n    # extrinsics are rt_fromref\n    'extrinsics': [ 0, 0, 0, 0, 0, 0,],\n\n    'imagersize': [ {width}, {height},],\n}}\n",
        numbers.join(", ")
    ))
}

/// What a calibration of OpenCV says.
struct OpenCv {
    fisheye: bool,
    matrix: [f64; 9],
    distortion: Vec<f64>,
}

fn opencv(path: &Path, lens: &Lens) -> Result<OpenCv, InputError> {
    let (fisheye, count) = match lens.model {
        LensModel::Pinhole => (false, 5),
        LensModel::Rational => (false, 8),
        // Equidistant is Kannala and Brandt's without coefficients.
        LensModel::KannalaBrandt | LensModel::Equidistant => (true, 4),
        other => {
            let expected = "pinhole, rational, fisheye:kannala-brandt or fisheye:equidistant";
            let help = "fit one of these: fisheye:kannala-brandt follows the others closely";
            return Err(refused(path, "OpenCV", other, expected, help));
        }
    };
    let (f, c) = (lens.focal_px, lens.centre_px - HALF_PIXEL);
    Ok(OpenCv {
        fisheye,
        matrix: [f.x, 0.0, c.x, 0.0, f.y, c.y, 0.0, 0.0, 1.0],
        distortion: lens.coefficients[..count].to_vec(),
    })
}

impl OpenCv {
    fn yaml(&self, [width, height]: [u32; 2]) -> String {
        let mut out = format!("%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\n");
        if self.fisheye {
            out.push_str("fisheye_model: 1\n");
        }
        let count = self.distortion.len();
        for (name, rows, columns, values) in [
            ("camera_matrix", 3, 3, &self.matrix[..]),
            ("distortion_coefficients", count, 1, &self.distortion[..]),
        ] {
            let numbers: Vec<String> = values.iter().map(|v| format!("{v:?}")).collect();
            // Writing into a string cannot fail.
            let _ = write!(
                out,
                "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {} ]\n",
                numbers.join(", ")
            );
        }
        out
    }

    fn json(&self, [width, height]: [u32; 2]) -> String {
        let matrix = |rows: usize, columns: usize, data: &[f64]| json!({ "type_id": "opencv-matrix", "rows": rows, "cols": columns, "dt": "d", "data": data });
        let mut out = json!({ "image_width": width, "image_height": height });
        if self.fisheye {
            out["fisheye_model"] = json!(1);
        }
        out["camera_matrix"] = matrix(3, 3, &self.matrix);
        out["distortion_coefficients"] = matrix(self.distortion.len(), 1, &self.distortion);
        format!("{out:#}\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{read_mrcal, read_opencv};
    use glam::DVec2;

    fn lens(model: LensModel) -> Lens {
        let mut out = Lens::new(model, DVec2::new(700.25, 702.5), DVec2::new(641.0, 479.5));
        let count = model.coefficient_names().len();
        (0..count).for_each(|k| out.coefficients[k] = 0.01 / (k + 3) as f64);
        out
    }

    #[test]
    fn lenses_are_written_and_read_back() {
        let folder = tempfile::tempdir().unwrap();
        for (model, name) in [
            (LensModel::Pinhole, "a.cameramodel"),
            (LensModel::Stereographic, "b.cameramodel"),
            (LensModel::Rational, "c.cameramodel"),
            (LensModel::Rational, "d.yaml"),
            (LensModel::KannalaBrandt, "e.yml"),
            (LensModel::KannalaBrandt, "f.json"),
        ] {
            let (path, own) = (folder.path().join(name), lens(model));
            write_camera_model(&path, &own, [1280, 960]).unwrap();
            // Corners to go with it: a camera alone is no measurement.
            let corners = folder.path().join("corners.json");
            let json = r#"{"image_points": [[[600, 400], [650, 400], [700, 402], [600, 450], [650, 452], [700, 455]]], "board_width": 3, "board_height": 2, "square_size": 0.05}"#;
            std::fs::write(&corners, json).unwrap();
            let table = folder.path().join("corners.vnl");
            std::fs::write(&table, "# filename x y level\na 600 400 0\na 650 400 0\na 700 402 0\na 600 450 0\na 650 452 0\na 700 455 0\n").unwrap();
            let found = if name.ends_with("cameramodel") {
                read_mrcal(&[path, table], Some(3))
            } else {
                read_opencv(&[path, corners], false)
            };
            let camera = found.unwrap().camera;
            assert_eq!((camera.lens, camera.size_px), (Some(own), [1280, 960]), "{name}");
        }
    }

    #[test]
    fn what_a_program_does_not_have_is_refused() {
        for (model, name, said) in [
            (
                LensModel::KannalaBrandt,
                "a.cameramodel",
                "mrcal has no lens model of this kind (found `fisheye:kannala-brandt`",
            ),
            (
                LensModel::Equisolid,
                "a.yaml",
                "OpenCV has no lens model of this kind (found `fisheye:equisolid`",
            ),
            (LensModel::Pinhole, "a.xml", "the file has the wrong extension (found `.xml`"),
        ] {
            let error = write_camera_model(Path::new(name), &lens(model), [10, 10]).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
