//! `retina import`.

use std::path::{Path, PathBuf};

use retina_files::InputError;
use retina_import::{Boards, ImportOptions, read_mrcal, read_opencv};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, print_lines};

#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Imports a camera model of mrcal with the boards that it was fitted to.
    ///
    /// The boards are taken from the model's optimization inputs. If you give tables of corners
    /// (.vnl) too, they are taken from these, and their poses are found through the model's lens.
    Mrcal(MrcalArguments),
    /// Imports a calibration of OpenCV with the views of its board.
    ///
    /// It reads what cv::FileStorage writes as YAML or JSON, and the JSON of common tools. You may
    /// give several files: a camera in one, its views in another.
    Opencv(OpencvArguments),
}

#[derive(clap::Args)]
struct Shared {
    /// Folder for points.csv, setup.toml and, if polynomials can follow the lens, calibration.toml.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Pixel pitch of the camera in micrometres, for the setup.
    #[arg(long, value_name = "UM", default_value_t = 5.0)]
    pixel_um: f64,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
pub(crate) struct MrcalArguments {
    /// A .cameramodel, and tables of corners (.vnl) if there are any.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Number of columns of the board, for tables of corners.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=1000))]
    board_columns: Option<u16>,
    #[command(flatten)]
    shared: Shared,
}

#[derive(clap::Args)]
pub(crate) struct OpencvArguments {
    /// Calibration files.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Take the distortion for that of cv::fisheye, if the file does not say so.
    #[arg(long)]
    fisheye: bool,
    #[command(flatten)]
    shared: Shared,
}

pub(crate) fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Mrcal(arguments) => {
            let columns = arguments.board_columns.map(usize::from);
            import("mrcal", &arguments.files, &arguments.shared, |files| read_mrcal(files, columns))
        }
        Command::Opencv(arguments) => import("opencv", &arguments.files, &arguments.shared, |files| {
            read_opencv(files, arguments.fisheye)
        }),
    }
}

fn import(
    source: &str,
    files: &[PathBuf],
    shared: &Shared,
    read: impl FnOnce(&[PathBuf]) -> Result<Boards, InputError>,
) -> Result<(), Failure> {
    if !(0.1..=1000.0).contains(&shared.pixel_um) {
        return Err(InputError::new("--pixel-um", "is no pixel pitch in micrometres")
            .found(shared.pixel_um)
            .expected("0.1 to 1000")
            .into());
    }
    let written = ["points.csv", "setup.toml", "calibration.toml"].map(|name| shared.out.join(name));
    crate::check_apart(files, written.iter().map(Some), None)?;
    let boards = read(files)?;
    let imported = boards.write(&shared.out, &ImportOptions { pixel_um: shared.pixel_um })?;
    let name = |path: &Path| path.display().to_string();
    if shared.json {
        return print_json(&json!({
            "schema": "retina.import/1",
            "source": source,
            "model": boards.camera.model,
            "files": imported.files.iter().map(|path| name(path)).collect::<Vec<_>>(),
            "exposures": imported.exposures,
            "rows": imported.rows,
            "notes": imported.notes,
        }));
    }
    let mut lines = vec![format!(
        "{}: {} corners of {} views, camera model {}",
        name(&shared.out),
        imported.rows,
        imported.exposures,
        boards.camera.model
    )];
    lines.extend(imported.files.iter().map(|path| format!("  {}", name(path))));
    lines.extend(imported.notes.iter().map(|note| format!("note: {note}")));
    print_lines(&lines)
}
