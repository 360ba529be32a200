//! mrcal's camera models (D. Kogan, mrcal.secretsauce.net, formats "cameramodel" and "vnl"), of version 2 and 3.

mod npz;
mod vnl;

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2, DVec3};
use retina_files::{InputError, read_text};
use retina_geometry::{Lens, LensModel, MOST_COEFFICIENTS};

use crate::HALF_PIXEL;
use crate::boards::{Boards, Corner, SourceCamera, View};
use crate::literal::{Literal, parse};
use npz::{Array, arrays, base85};

pub(crate) use vnl::BoardShape;

/// A rotation vector and a translation: p -> R p + t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RigidMotion {
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
}

impl RigidMotion {
    /// Of six numbers, rotation vector (O. Rodrigues) first.
    pub(crate) fn of(values: &[f64]) -> Self {
        let turn = DVec3::new(values[0], values[1], values[2]);
        let rotation = if turn.length() > 0.0 {
            DMat3::from_axis_angle(turn.normalize(), turn.length())
        } else {
            DMat3::IDENTITY
        };
        Self { rotation, translation: DVec3::new(values[3], values[4], values[5]) }
    }

    pub(crate) fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }
}

/// Reads a camera model with the boards that it was fitted to: those in its `optimization_inputs`, else those of tables of
/// corners, whose poses are found with the model's own lens.
///
/// # Errors
/// A file cannot be read or is damaged, there is not exactly one model, or no corner.
pub fn read_mrcal(files: &[PathBuf], board_columns: Option<usize>) -> Result<Boards, InputError> {
    let is_table = |path: &&PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("vnl"));
    let (tables, models): (Vec<&PathBuf>, Vec<&PathBuf>) = files.iter().partition(is_table);
    let [path] = models[..] else {
        return Err(InputError::new(
            files.first().map_or(Path::new("FILE"), |f| f),
            "one camera model is imported at a time",
        )
        .found(format!("{} files of camera models", models.len()))
        .expected("one .cameramodel, with its .vnl tables if there are any")
        .help("import each camera into a folder of its own"));
    };
    let model = parse(path, &read_text(path)?)?;
    let camera = camera(path, &model)?;
    match (model.get("optimization_inputs"), tables.is_empty()) {
        (Some((line, inputs)), true) => of_inputs(path, line, inputs, &model, camera),
        (_, false) => vnl::read(path, camera, &tables, board_columns),
        (None, true) => Err(InputError::new(path, "holds a lens but no boards")
            .at("key `optimization_inputs`")
            .found("nothing")
            .expected("the boards that the model was fitted to")
            .help(
                "give the corner table (.vnl) beside it, or let mrcal-calibrate-cameras write the model anew",
            )),
    }
}

fn wrong_key(path: &Path, key: &str, line: Option<usize>, expected: &str) -> InputError {
    let error = InputError::new(path, format!("the key `{key}` does not fit")).expected(expected);
    let error = match line {
        Some(line) => error.line(line),
        None => error.found("nothing"),
    };
    error.help("is it a .cameramodel of mrcal 2 or later?")
}

/// The camera that a model describes.
fn camera(path: &Path, model: &Literal) -> Result<SourceCamera, InputError> {
    let line = |key: &str| model.get(key).map(|entry| entry.0);
    let Some((_, Literal::Text(name))) = model.get("lensmodel") else {
        return Err(wrong_key(path, "lensmodel", line("lensmodel"), "the name of a lens model"));
    };
    let numbers = |key: &str, least: usize, expected: &str| {
        let values = model.get(key).and_then(|(_, value)| value.numbers());
        values.filter(|v| v.len() >= least).ok_or_else(|| wrong_key(path, key, line(key), expected))
    };
    let intrinsics = numbers("intrinsics", 4, "fx, fy, cx, cy and the distortion")?;
    let size = numbers("imagersize", 2, "width and height in pixels")?;
    let fits = |v: &f64| v.fract() == 0.0 && (1.0..=65_536.0).contains(v);
    if size.len() != 2 || !size.iter().all(fits) {
        return Err(wrong_key(
            path,
            "imagersize",
            line("imagersize"),
            "width and height in pixels, 1 to 65536",
        ));
    }
    if !intrinsics[..2].iter().all(|f| (1.0..=1e8).contains(f)) {
        return Err(wrong_key(path, "intrinsics", line("intrinsics"), "focal lengths of 1 to 1e8 px"));
    }
    let focal_px = DVec2::new(intrinsics[0], intrinsics[1]);
    let centre_px = DVec2::new(intrinsics[2], intrinsics[3]) + HALF_PIXEL;
    let coefficients = match name.as_str() {
        "LENSMODEL_PINHOLE" => Some((LensModel::Pinhole, 0)),
        "LENSMODEL_STEREOGRAPHIC" => Some((LensModel::Stereographic, 0)),
        "LENSMODEL_OPENCV4" => Some((LensModel::Rational, 4)),
        "LENSMODEL_OPENCV5" => Some((LensModel::Rational, 5)),
        "LENSMODEL_OPENCV8" => Some((LensModel::Rational, 8)),
        _ => None,
    };
    let lens = coefficients
        .map(|(model, count)| {
            if intrinsics.len() != 4 + count {
                let expected = format!("4 + {count} numbers for {name}");
                return Err(wrong_key(path, "intrinsics", line("intrinsics"), &expected));
            }
            let mut lens = Lens::new(model, focal_px, centre_px);
            debug_assert!(count <= MOST_COEFFICIENTS);
            lens.coefficients[..count].copy_from_slice(&intrinsics[4..]);
            Ok(lens)
        })
        .transpose()?;
    let size_px = [size[0] as u32, size[1] as u32];
    Ok(SourceCamera { model: name.clone(), focal_px, centre_px, size_px, lens })
}

/// Sides of an array, and its numbers.
type Shaped<'a> = (&'a [usize], &'a [f64]);

/// Arrays that the solver took, by any of their names.
struct Inputs<'a> {
    path: &'a Path,
    arrays: Vec<(String, Array)>,
}

impl Inputs<'_> {
    /// An array of a shape, in which 0 stands for any side; `None` where it is not there or mrcal's None.
    fn numbers(&self, names: &[&str], shape: &[usize]) -> Result<Option<Shaped<'_>>, InputError> {
        let found = self.arrays.iter().find(|(name, _)| names.contains(&name.as_str()));
        let Some((name, Array::Numbers { shape: own, values })) = found else { return Ok(None) };
        let fits = own.len() == shape.len() && own.iter().zip(shape).all(|(o, s)| *s == 0 || o == s);
        if fits && values.iter().all(|v| v.is_finite()) {
            return Ok(Some((own, values)));
        }
        let text = |sides: &[usize]| {
            let sides: Vec<String> =
                sides.iter().map(|s| if *s == 0 { "any".to_owned() } else { s.to_string() }).collect();
            format!("an array of {} finite numbers", sides.join(" x "))
        };
        Err(InputError::new(self.path, "an array of the optimization inputs does not fit")
            .at(format!("array `{name}`"))
            .found(text(own))
            .expected(text(shape))
            .help("the file is damaged; take it anew from mrcal"))
    }

    fn required(&self, names: &[&str], shape: &[usize]) -> Result<Shaped<'_>, InputError> {
        self.numbers(names, shape)?.ok_or_else(|| {
            InputError::new(self.path, "the optimization inputs lack an array")
                .at(format!("array `{}`", names[0]))
                .found("nothing")
                .expected("boards: a calibration from chessboards")
                .help("models of point observations alone cannot be imported")
        })
    }
}

/// Boards of the solve that the model came from.
fn of_inputs(
    path: &Path,
    line: usize,
    inputs: &Literal,
    model: &Literal,
    camera: SourceCamera,
) -> Result<Boards, InputError> {
    let (Literal::Bytes(text) | Literal::Text(text)) = inputs else {
        return Err(wrong_key(path, "optimization_inputs", Some(line), "text of base 85"));
    };
    let Some(archive) = base85(text) else {
        return Err(InputError::new(path, "the optimization inputs are damaged")
            .line(line)
            .found("characters that are none of base 85")
            .expected("text of base 85, as mrcal writes it")
            .help("the file is damaged; take it anew from mrcal"));
    };
    let inputs = Inputs { path, arrays: arrays(path, "key `optimization_inputs`", &archive)? };
    let (board_shape, observed) = inputs.required(&["observations_board"], &[0, 0, 0, 3])?;
    let [views, height, width] = [board_shape[0], board_shape[1], board_shape[2]];
    let (_, indices) = inputs.required(&["indices_frame_camintrinsics_camextrinsics"], &[views, 3])?;
    let (frame_shape, frames) = inputs.required(&["frames_rt_toref", "rt_ref_frame"], &[0, 6])?;
    let (_, spacing) = inputs.required(&["calibration_object_spacing"], &[])?;
    let extrinsics =
        inputs.numbers(&["extrinsics_rt_fromref", "rt_cam_ref"], &[0, 6])?.map_or(&[][..], |e| e.1);
    let warp = inputs.numbers(&["calobject_warp"], &[2])?.map(|(_, w)| [w[0], w[1]]);
    let shape = BoardShape { width, height, spacing: spacing[0], warp: warp.unwrap_or_default() };
    let own = ["icam_intrinsics", "icam_intrinsics_optimization_inputs"]
        .iter()
        .find_map(|key| match model.get(key) {
            Some((_, Literal::Number(value))) => Some(*value),
            _ => None,
        })
        .unwrap_or(0.0);
    let mut out = Vec::new();
    let (mut others, mut left_out) = (0, 0);
    for view in 0..views {
        let [frame, intrinsics, extrinsic] = [0, 1, 2].map(|k| indices[3 * view + k]);
        if intrinsics != own {
            others += 1;
            continue;
        }
        let at =
            |index: f64, count: usize| (index >= 0.0 && (index as usize) < count).then_some(index as usize);
        let camera_from_reference = match extrinsic {
            e if e < 0.0 => Some(RigidMotion::of(&[0.0; 6])),
            e => at(e, extrinsics.len() / 6).map(|e| RigidMotion::of(&extrinsics[6 * e..6 * e + 6])),
        };
        let (Some(frame), Some(camera_from_reference)) = (at(frame, frame_shape[0]), camera_from_reference)
        else {
            return Err(InputError::new(path, "an index of the optimization inputs points at nothing")
                .at("array `indices_frame_camintrinsics_camextrinsics`")
                .found(format!("frame {frame}, camera pose {extrinsic} in row {view}"))
                .expected(format!(
                    "frames below {}, camera poses below {}",
                    frame_shape[0],
                    extrinsics.len() / 6
                ))
                .help("the file is damaged; take it anew from mrcal"));
        };
        let reference_from_board = RigidMotion::of(&frames[6 * frame..6 * frame + 6]);
        let mut corners = Vec::new();
        for (number, cell) in
            observed[3 * view * height * width..].chunks_exact(3).take(height * width).enumerate()
        {
            if cell[2] <= 0.0 {
                left_out += 1;
                continue;
            }
            let (column, row) = (number % width, number / width);
            let place = reference_from_board.apply(shape.corner(column, row));
            corners.push(Corner {
                place_camera: camera_from_reference.apply(place),
                camera_px: DVec2::new(cell[0], cell[1]) + HALF_PIXEL,
                board: [column as f64, row as f64],
                relative_sigma: 1.0 / cell[2],
            });
        }
        out.push(View { name: format!("board-{frame:04}"), corners });
    }
    let mut notes = vec![
        "displayed directions are those of the boards' poses, which the source's own model found: what another model explains worse is partly hidden in them".to_owned(),
    ];
    if left_out > 0 {
        notes.push(format!("{left_out} corners that mrcal did not find or took for outliers are left out"));
    }
    if others > 0 {
        notes.push(format!("{others} views of other cameras of the solve are left out"));
    }
    if inputs.numbers(&["observations_point"], &[0, 3]).ok().flatten().is_some_and(|(s, _)| s[0] > 0) {
        notes.push("observations of single points are left out".to_owned());
    }
    Ok(Boards { file: path.to_path_buf(), camera, views: out, notes })
}
