//! Calibrations of OpenCV: what its sample programs write by `cv::FileStorage`, ROS's camera files, and the JSON of common
//! tools. Names differ between them; all that are known are tried.

mod storage;

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use retina_files::InputError;
use retina_geometry::{Lens, LensModel};
use serde_json::{Map, Value};

use crate::HALF_PIXEL;
use crate::boards::{Boards, Corner, SourceCamera, View};
use crate::mrcal::{BoardShape, RigidMotion};
use crate::pose::pose;

const CAMERA_MATRIX: &[&str] =
    &["camera_matrix", "Camera_Matrix", "cameraMatrix", "intrinsic_matrix", "camera_intrinsics", "mtx", "K"];
const DISTORTION: &[&str] = &[
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distCoeffs",
    "dist_coeffs",
    "dist_coeff",
    "dist_coefs",
    "distortion",
    "dist",
    "D",
];
const WIDTH: &[&str] = &["image_width", "image_Width", "width"];
const HEIGHT: &[&str] = &["image_height", "image_Height", "height"];
const SIZE: &[&str] = &["image_size", "imageSize", "img_size", "resolution", "image_shape"];
const POSES: &[&str] = &["extrinsic_parameters", "Extrinsic_Parameters", "extrinsics"];
const ROTATIONS: &[&str] = &["rvecs", "rotation_vectors", "rvec", "R_vecs"];
const TRANSLATIONS: &[&str] = &["tvecs", "translation_vectors", "tvec", "T_vecs"];
const SEEN: &[&str] = &["image_points", "Image_points", "imagePoints", "imgpoints", "img_points", "corners"];
const SHOWN: &[&str] =
    &["object_points", "objectPoints", "objpoints", "obj_points", "grid_points", "board_points"];
const NAMES: &[&str] = &["image_names", "images", "image_files", "filenames", "images_list"];
const COLUMNS: &[&str] = &["board_width", "board_Width", "BoardSize_Width", "pattern_width"];
const ROWS: &[&str] = &["board_height", "board_Height", "BoardSize_Height", "pattern_height"];
const SQUARE: &[&str] = &["square_size", "square_Size", "Square_Size", "squareSize"];
const LAW: &[&str] = &["distortion_model", "camera_model", "model", "model_type"];

/// Keys of one or several files.
struct Keys {
    files: Vec<(PathBuf, Map<String, Value>)>,
}

impl Keys {
    fn get(&self, names: &[&'static str]) -> Option<(&Path, &'static str, &Value)> {
        names.iter().find_map(|name| {
            self.files
                .iter()
                .find_map(|(path, map)| map.get(*name).map(|value| (path.as_path(), *name, value)))
        })
    }

    fn first(&self) -> &Path {
        self.files.first().map_or(Path::new("FILE"), |(path, _)| path)
    }

    fn missing(&self, names: &[&'static str], what: &str, help: &str) -> InputError {
        InputError::new(self.first(), format!("holds no {what}"))
            .at(format!("key `{}`", names[0]))
            .found("nothing")
            .expected(format!("one of {}", names.join(", ")))
            .help(help)
    }

    fn number(&self, names: &[&'static str]) -> Option<f64> {
        let numbers = flat(self.get(names)?.2)?;
        (numbers.len() == 1).then(|| numbers[0])
    }
}

fn wrong(path: &Path, key: &str, found: String, expected: &str) -> InputError {
    InputError::new(path, "a value does not fit")
        .at(format!("key `{key}`"))
        .found(found)
        .expected(expected)
        .help("is it a calibration of OpenCV?")
}

/// All numbers of a value, in its order: of a number, of lists within lists, of OpenCV's matrices.
fn flat(value: &Value) -> Option<Vec<f64>> {
    fn add(value: &Value, out: &mut Vec<f64>) -> Option<()> {
        match value {
            Value::Number(number) => out.push(number.as_f64().filter(|v| v.is_finite())?),
            Value::Array(items) => items.iter().try_for_each(|item| add(item, out))?,
            Value::Object(map) => {
                let before = out.len();
                add(map.get("data")?, out)?;
                // A matrix that says its size has as many numbers.
                if let (Some(rows), Some(columns)) = (map.get("rows"), map.get("cols")) {
                    let count = rows.as_f64()? * columns.as_f64()? * channels(map);
                    if count != (out.len() - before) as f64 {
                        return None;
                    }
                }
            }
            _ => return None,
        }
        Some(())
    }
    let mut out = Vec::new();
    add(value, &mut out).map(|()| out)
}

/// Channels of a matrix by its `dt`: 2 of `2f`.
fn channels(map: &Map<String, Value>) -> f64 {
    let digits =
        map.get("dt").and_then(Value::as_str).unwrap_or("").trim_matches(|c: char| !c.is_ascii_digit());
    digits.parse().unwrap_or(1.0)
}

/// Numbers view by view: the rows of a matrix, or the items of a list.
fn views(value: &Value) -> Option<Vec<Vec<f64>>> {
    match value {
        Value::Array(items) => items.iter().map(flat).collect(),
        Value::Object(map) => {
            let all = flat(value)?;
            let rows = match (map.get("rows"), map.get("sizes")) {
                (Some(rows), _) => rows.as_f64()?,
                (None, Some(Value::Array(sizes))) => sizes.first()?.as_f64()?,
                _ => return None,
            } as usize;
            let width = all.len().checked_div(rows)?;
            (width > 0 && width * rows == all.len())
                .then(|| all.chunks_exact(width).map(<[f64]>::to_vec).collect())
        }
        _ => None,
    }
}

/// Reads a calibration of OpenCV. Several files are read as one: a camera in one, its views in another. `fisheye` says that
/// the distortion is that of `cv::fisheye`, where no file does.
///
/// # Errors
/// A file cannot be read, keys are missing, or sizes do not agree.
pub fn read_opencv(files: &[PathBuf], fisheye: bool) -> Result<Boards, InputError> {
    let keys = Keys {
        files: files
            .iter()
            .map(|path| Ok((path.clone(), storage::read(path)?)))
            .collect::<Result<_, InputError>>()?,
    };
    let mut notes = Vec::new();
    let camera = camera(&keys, fisheye, &mut notes)?;
    let Some((path, seen_key, seen)) = keys.get(SEEN) else {
        return Err(keys.missing(
            SEEN,
            "corners",
            "write the image points too (OpenCV's sample: -op), or give the file that holds them",
        ));
    };
    let Some(seen) = views(seen).filter(|seen| seen.iter().all(|view| view.len() % 2 == 0)) else {
        return Err(wrong(
            path,
            seen_key,
            "something else".to_owned(),
            "x and y of the corners of each view",
        ));
    };
    let board = Board::read(&keys, &seen)?;
    let poses = poses(&keys, seen.len())?;
    let names: Option<Vec<String>> = keys.get(NAMES).and_then(|(_, _, value)| {
        let items = value.as_array().filter(|items| items.len() == seen.len())?;
        items.iter().map(|item| item.as_str().map(str::to_owned)).collect()
    });
    let mut out = Vec::new();
    let mut without_pose = 0;
    for (number, view) in seen.iter().enumerate() {
        let seen_px: Vec<DVec2> =
            view.chunks_exact(2).map(|xy| DVec2::new(xy[0], xy[1]) + HALF_PIXEL).collect();
        let points = board.of_view(number);
        let motion = match (&poses, &camera.lens) {
            (Some(poses), _) => Some(RigidMotion::of(&poses[number])),
            (None, Some(lens)) => pose(lens, points, &seen_px),
            (None, None) => {
                return Err(keys.missing(
                    POSES,
                    "poses of the boards, which cannot be found through this lens",
                    "write the extrinsic parameters too (OpenCV's sample: -oe)",
                ));
            }
        };
        let Some(motion) = motion else {
            without_pose += 1;
            continue;
        };
        let corners = points.iter().zip(&seen_px).enumerate().map(|(k, (point, px))| Corner {
            place_camera: motion.apply(*point),
            camera_px: *px,
            board: board.columns.map_or([k as f64, 0.0], |n| [(k % n) as f64, (k / n) as f64]),
            relative_sigma: 1.0,
        });
        let name = names.as_ref().map_or_else(|| format!("view-{number:04}"), |names| names[number].clone());
        out.push(View { name, corners: corners.collect() });
    }
    notes.push(if poses.is_some() {
        "displayed directions are those of the boards' poses, which the source's own model found: what another model explains worse is partly hidden in them".to_owned()
    } else {
        "the file has no poses of the boards; they were found through its lens".to_owned()
    });
    if without_pose > 0 {
        notes.push(format!("{without_pose} views have no pose that fits and are left out"));
    }
    Ok(Boards { file: keys.first().to_path_buf(), camera, views: out, notes })
}

/// The camera of the files.
fn camera(keys: &Keys, fisheye: bool, notes: &mut Vec<String>) -> Result<SourceCamera, InputError> {
    let Some((path, key, value)) = keys.get(CAMERA_MATRIX) else {
        return Err(keys.missing(CAMERA_MATRIX, "camera matrix", "is it a calibration of OpenCV?"));
    };
    let k = flat(value).filter(|k| k.len() == 9 && k[..6].iter().all(|v| v.abs() < 1e8));
    let Some(k) = k.filter(|k| k[0] >= 1.0 && k[4] >= 1.0) else {
        return Err(wrong(
            path,
            key,
            "something else".to_owned(),
            "3 x 3 numbers with focal lengths of 1 to 1e8 px",
        ));
    };
    let focal_px = DVec2::new(k[0], k[4]);
    let centre_px = DVec2::new(k[2], k[5]) + HALF_PIXEL;
    let size = keys
        .number(WIDTH)
        .zip(keys.number(HEIGHT))
        .or_else(|| flat(keys.get(SIZE)?.2).filter(|s| s.len() == 2).map(|s| (s[0], s[1])));
    let Some((width, height)) = size else {
        return Err(keys.missing(WIDTH, "image size", "add image_width and image_height to the file"));
    };
    if ![width, height].iter().all(|v| v.fract() == 0.0 && (1.0..=65_536.0).contains(v)) {
        return Err(wrong(
            path,
            WIDTH[0],
            format!("{width} x {height}"),
            "whole numbers of pixels, 1 to 65536",
        ));
    }
    let distortion = match keys.get(DISTORTION) {
        None => Vec::new(),
        Some((path, key, value)) => flat(value)
            .filter(|d| d.iter().all(|v| v.abs() < 1e8))
            .ok_or_else(|| wrong(path, key, "something else".to_owned(), "a list of coefficients"))?,
    };
    let law = keys.get(LAW).and_then(|(_, _, value)| value.as_str()).unwrap_or("").to_lowercase();
    let says_fisheye = ["fisheye", "equidistant", "kannala"].iter().any(|name| law.contains(name));
    let flagged = keys.number(&["fisheye_model", "fisheye"]).is_some_and(|v| v != 0.0);
    let fisheye = fisheye || says_fisheye || flagged;
    let (model, count) = match (fisheye, distortion.len()) {
        (true, 4) => (Some(LensModel::KannalaBrandt), 4),
        (true, count) => {
            return Err(wrong(
                path,
                DISTORTION[0],
                format!("{count} coefficients"),
                "4 coefficients of a fisheye lens",
            ));
        }
        (false, 0) => (Some(LensModel::Pinhole), 0),
        (false, count @ (4 | 5 | 8)) => (Some(LensModel::Rational), count),
        (false, 12 | 14) if distortion[8..].iter().all(|v| *v == 0.0) => (Some(LensModel::Rational), 8),
        (false, 12 | 14) => (None, 0),
        (false, count) => {
            return Err(wrong(
                path,
                DISTORTION[0],
                format!("{count} coefficients"),
                "4, 5, 8, 12 or 14 coefficients, as OpenCV has them",
            ));
        }
    };
    if !fisheye && distortion.len() == 4 && law.is_empty() {
        notes.push(
            "the 4 coefficients are taken for k1, k2, p1, p2; --fisheye takes them for a fisheye's k1 to k4"
                .to_owned(),
        );
    }
    let lens = model.map(|model| {
        let mut lens = Lens::new(model, focal_px, centre_px);
        lens.coefficients[..count].copy_from_slice(&distortion[..count]);
        lens
    });
    let name = if fisheye {
        "OpenCV fisheye".to_owned()
    } else {
        format!("OpenCV with {} coefficients", distortion.len())
    };
    Ok(SourceCamera { model: name, focal_px, centre_px, size_px: [width as u32, height as u32], lens })
}

/// Points of the boards, one grid for all views or one for each.
struct Board {
    grids: Vec<Vec<DVec3>>,
    columns: Option<usize>,
}

impl Board {
    fn read(keys: &Keys, seen: &[Vec<f64>]) -> Result<Self, InputError> {
        let whole = |value: f64| value.fract() == 0.0 && (1.0..=10_000.0).contains(&value);
        let side = |names| keys.number(names).filter(|v| whole(*v)).map(|v| v as usize);
        let (columns, rows) = (side(COLUMNS), side(ROWS));
        let points = |all: &[f64]| -> Vec<DVec3> { all.chunks_exact(3).map(DVec3::from_slice).collect() };
        let grids = if let Some((path, key, value)) = keys.get(SHOWN) {
            let fits = |grid: &[f64], view: &[f64]| 2 * grid.len() == 3 * view.len();
            let each =
                views(value).filter(|v| v.len() == seen.len() && v.iter().zip(seen).all(|(g, s)| fits(g, s)));
            let one = || flat(value).filter(|grid| seen.iter().all(|view| fits(grid, view)));
            match (each, one) {
                (Some(each), _) => each.iter().map(|grid| points(grid)).collect(),
                (None, one) => match one() {
                    Some(grid) => vec![points(&grid)],
                    None => {
                        let expected = "x, y and z of each corner, for all views or for each of them";
                        return Err(wrong(
                            path,
                            key,
                            "another number of points than are seen".to_owned(),
                            expected,
                        ));
                    }
                },
            }
        } else {
            let (Some(width), Some(height)) = (columns, rows) else {
                return Err(keys.missing(
                    SHOWN,
                    "points of the board",
                    "add the object points, or board_width, board_height and square_size",
                ));
            };
            let spacing = keys.number(SQUARE).filter(|v| *v > 0.0).unwrap_or(1.0);
            let shape = BoardShape { width, height, spacing, warp: [0.0; 2] };
            if let Some(view) = seen.iter().position(|view| view.len() != 2 * width * height) {
                let found = format!("{} corners in view {view}", seen[view].len() / 2);
                return Err(wrong(keys.first(), SEEN[0], found, &format!("{width} x {height} corners")));
            }
            vec![(0..width * height).map(|k| shape.corner(k % width, k / width)).collect()]
        };
        Ok(Self { grids, columns })
    }

    fn of_view(&self, view: usize) -> &[DVec3] {
        &self.grids[if self.grids.len() == 1 { 0 } else { view }]
    }
}

/// Rotation vector and translation of each view; `None` where the files have none.
fn poses(keys: &Keys, count: usize) -> Result<Option<Vec<Vec<f64>>>, InputError> {
    let of = |names: &[&'static str], width: usize| -> Result<Option<Vec<Vec<f64>>>, InputError> {
        let Some((path, key, value)) = keys.get(names) else { return Ok(None) };
        match views(value).filter(|v| v.len() == count && v.iter().all(|pose| pose.len() == width)) {
            Some(found) => Ok(Some(found)),
            None => {
                let found =
                    views(value).map_or("something else".to_owned(), |v| format!("{} views", v.len()));
                Err(wrong(path, key, found, &format!("{width} numbers for each of {count} views")))
            }
        }
    };
    if let Some(whole) = of(POSES, 6)? {
        return Ok(Some(whole));
    }
    match (of(ROTATIONS, 3)?, of(TRANSLATIONS, 3)?) {
        (Some(turns), Some(steps)) => {
            Ok(Some(turns.into_iter().zip(steps).map(|(turn, step)| [turn, step].concat()).collect()))
        }
        (None, None) => Ok(None),
        (Some(_), None) => {
            Err(keys.missing(TRANSLATIONS, "translations beside its rotations", "both are needed"))
        }
        (None, Some(_)) => {
            Err(keys.missing(ROTATIONS, "rotations beside its translations", "both are needed"))
        }
    }
}
