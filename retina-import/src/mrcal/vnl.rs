//! Tables of corners as mrgingham and mrcal keep them (`corners.vnl`): a line for each corner, row by row of the board,
//! image by image. A legend `# filename x y level` names the columns; `-` is a corner that was not found.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use retina_files::{InputError, read_text};

use crate::HALF_PIXEL;
use crate::boards::{Boards, Corner, SourceCamera, View};
use crate::pose::pose;

/// A board of mrcal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BoardShape {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Distance of neighbours.
    pub(crate) spacing: f64,
    /// Deflection at the middle along x and along y.
    pub(crate) warp: [f64; 2],
}

impl BoardShape {
    /// A corner in the board's frame: z = 4 w_x u (1 - u) + 4 w_y v (1 - v) with u, v from 0 to 1 over the board
    /// (`mrcal.ref_calibration_object`).
    pub(crate) fn corner(&self, column: usize, row: usize) -> DVec3 {
        let share = |at: usize, count: usize| if count > 1 { at as f64 / (count - 1) as f64 } else { 0.0 };
        let (u, v) = (share(column, self.width), share(row, self.height));
        let depth = 4.0 * (self.warp[0] * u * (1.0 - u) + self.warp[1] * v * (1.0 - v));
        DVec3::new(column as f64 * self.spacing, row as f64 * self.spacing, depth)
    }
}

/// Corners of an image: places (where found) and relative standard deviations.
struct Image {
    name: String,
    line: usize,
    corners: Vec<Option<(DVec2, f64)>>,
}

/// Boards of tables of corners, seen by a camera whose lens is known.
pub(super) fn read(
    path: &Path,
    camera: SourceCamera,
    tables: &[&PathBuf],
    columns: Option<usize>,
) -> Result<Boards, InputError> {
    let Some(lens) = camera.lens else {
        return Err(InputError::new(path, "the poses of the boards cannot be found through this lens model")
            .at("key `lensmodel`")
            .found(&camera.model)
            .expected("PINHOLE, STEREOGRAPHIC or OPENCV4, 5, 8; or a model with its optimization inputs")
            .help("import the .cameramodel alone: mrcal keeps boards and poses in it"));
    };
    let Some(columns) = columns else {
        return Err(InputError::new(
            tables[0],
            "a table of corners does not say how many columns the board has",
        )
        .expected("--board-columns N")
        .help("it is mrcal's --object-width-n"));
    };
    let (mut views, mut left_out, mut without_pose) = (Vec::new(), 0, Vec::new());
    for table in tables {
        for image in images(table)? {
            if image.corners.iter().all(Option::is_none) {
                continue;
            }
            if image.corners.len() % columns != 0 {
                return Err(InputError::new(
                    table,
                    "an image's corners do not fill a board of so many columns",
                )
                .line(image.line)
                .found(format!("{} corners of `{}`", image.corners.len(), image.name))
                .expected(format!("a multiple of {columns}"))
                .help(
                    "give the number of columns that the board has, and a line for each corner, found or not",
                ));
            }
            let shape = BoardShape {
                width: columns,
                height: image.corners.len() / columns,
                spacing: 1.0,
                warp: [0.0; 2],
            };
            let found: Vec<(usize, DVec2, f64)> = image
                .corners
                .iter()
                .enumerate()
                .filter_map(|(k, c)| c.map(|(px, sigma)| (k, px, sigma)))
                .collect();
            left_out += image.corners.len() - found.len();
            let board: Vec<DVec3> =
                found.iter().map(|(k, ..)| shape.corner(k % columns, k / columns)).collect();
            let seen: Vec<DVec2> = found.iter().map(|(_, px, _)| *px).collect();
            let Some(camera_from_board) = pose(&lens, &board, &seen) else {
                without_pose.push(image.name);
                continue;
            };
            let corners = found.iter().zip(&board).map(|(&(k, camera_px, relative_sigma), point)| Corner {
                place_camera: camera_from_board.apply(*point),
                camera_px,
                board: [(k % columns) as f64, (k / columns) as f64],
                relative_sigma,
            });
            views.push(View { name: image.name, corners: corners.collect() });
        }
    }
    let mut notes = vec![format!(
        "poses of the boards were found through the lens {}: what another model explains worse is partly hidden in them",
        camera.model
    )];
    if left_out > 0 {
        notes.push(format!("{left_out} corners that were not found are left out"));
    }
    if !without_pose.is_empty() {
        notes.push(format!(
            "{} images have no pose that fits and are left out: {}",
            without_pose.len(),
            without_pose[..without_pose.len().min(5)].join(", ")
        ));
    }
    Ok(Boards { file: path.to_path_buf(), camera, views, notes })
}

/// The images of a table, in its order.
fn images(path: &Path) -> Result<Vec<Image>, InputError> {
    let text = read_text(path)?;
    let wrong = |line: usize, problem: &str, found: String, expected: &str| {
        InputError::new(path, problem)
            .line(line)
            .found(found)
            .expected(expected)
            .help("is it a table of corners of mrgingham or mrcal?")
    };
    let mut legend: Option<Vec<&str>> = None;
    let mut out: Vec<Image> = Vec::new();
    for (number, line) in text.lines().enumerate().map(|(k, line)| (k + 1, line.trim())) {
        if line.is_empty() || line.starts_with("##") || line.starts_with("#!") {
            continue;
        }
        if let Some(names) = line.strip_prefix('#') {
            legend.get_or_insert(names.split_whitespace().collect());
            continue;
        }
        let Some(names) = &legend else {
            return Err(wrong(
                number,
                "lacks the legend before its first row",
                format!("`{line}`"),
                "`# filename x y level`",
            ));
        };
        let cells: Vec<&str> = line.split_whitespace().collect();
        let cell = |name: &str| names.iter().position(|n| *n == name).and_then(|at| cells.get(at)).copied();
        let (Some(name), Some(x), Some(y)) = (cell("filename"), cell("x"), cell("y")) else {
            return Err(wrong(
                number,
                "a row does not fit the legend",
                format!("`{line}`"),
                "filename, x and y",
            ));
        };
        let value = |text: &str| -> Result<Option<f64>, InputError> {
            match text.parse::<f64>() {
                _ if text == "-" => Ok(None),
                Ok(value) if value.is_finite() => Ok(Some(value)),
                _ => {
                    Err(wrong(number, "a cell is no number", format!("`{text}`"), "a number, or - for none"))
                }
            }
        };
        // mrcal: the weight is 2^-level; a level below 0 is no corner.
        let level = cell("level").map_or(Ok(None), value)?.unwrap_or(0.0);
        let weight = cell("weight").map_or(Ok(None), value)?.unwrap_or(0.5f64.powf(level));
        let place = value(x)?.zip(value(y)?).filter(|_| level >= 0.0 && weight > 0.0);
        let corner = place.map(|(x, y)| (DVec2::new(x, y) + HALF_PIXEL, 1.0 / weight));
        match out.last_mut().filter(|image| image.name == name) {
            Some(image) => image.corners.push(corner),
            None => out.push(Image { name: name.to_owned(), line: number, corners: vec![corner] }),
        }
    }
    if out.is_empty() {
        return Err(wrong(1, "holds no corners", "nothing".to_owned(), "a row for each corner"));
    }
    Ok(out)
}
