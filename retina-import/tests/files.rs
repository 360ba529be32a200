//! Files that mrcal 2.2 and OpenCV 5.0 wrote (validation/mrcal_boards.py, validation/opencv_boards.py) become tables that
//! the workbench explains; damaged ones are refused in words.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use glam::DVec2;
use retina_diagnosis::{Baseline, Comparison, Dataset, Source, compare};
use retina_files::InputError;
use retina_formats::{Calibration, Measurements};
use retina_geometry::Setup;
use retina_import::{Boards, ImportOptions, Imported, read_mrcal, read_opencv};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

fn written(boards: &Boards) -> (tempfile::TempDir, Imported) {
    let folder = tempfile::tempdir().unwrap();
    let imported = boards.write(&folder.path().join("out"), &ImportOptions { pixel_um: 5.0 }).unwrap();
    (folder, imported)
}

/// `compare` on what was written, and pixels a radian at the axis.
fn compared(folder: &Path, baseline: &str) -> (Comparison, f64) {
    let setup = Setup::read(&folder.join("out/setup.toml")).unwrap();
    let tables = Measurements::read(&[folder.join("out/points.csv")]).unwrap();
    let baseline = Baseline::parse(baseline).unwrap();
    let source = Source { tables: &tables, setup: &setup, calibration: None, response: None, baseline };
    (compare(&Dataset::new(&source).unwrap(), &[]), setup.camera_pinhole().fx_px)
}

/// Errors in px, as if the scale were that of the axis.
fn rms_px(folder: &Path, baseline: &str) -> f64 {
    let (result, px_per_rad) = compared(folder, baseline);
    result.rms_unweighted / 206_264.806 * px_per_rad
}

/// A corner's line of sight, and its pixel less the half by which pixels are counted differently.
fn corner(boards: &Boards, view: usize, board: [f64; 2]) -> (DVec2, DVec2) {
    let corner = boards.views[view].corners.iter().find(|c| c.board == board).unwrap();
    (corner.place_camera.truncate() / corner.place_camera.z, corner.camera_px - 0.5)
}

/// Literals: what validation/mrcal_boards.py printed.
#[test]
fn boards_of_mrcal_are_those_of_its_own_solution() {
    let boards = read_mrcal(&[fixture("opencv8.cameramodel")], None).unwrap();
    assert_eq!(boards.views.iter().map(|v| v.corners.len()).sum::<usize>(), 330);
    for (view, board, sight, px) in [
        (0, [0.0, 0.0], [-0.2899171194459725, 0.3909465263818464], [452.50806598995433, 732.7326583902015]),
        (1, [2.0, 1.0], [-0.27953559691617175, -0.5918179709207114], [469.2120107220527, 115.20451371800762]),
        (7, [6.0, 5.0], [1.0263866900001275, 0.3601931509905905], [1163.2712020007914, 663.4269569572915]),
    ] {
        let (own_sight, own_px) = corner(&boards, view, board);
        assert!(own_sight.distance(DVec2::from_array(sight)) < 1e-12, "{own_sight}");
        assert!(own_px.distance(DVec2::from_array(px)) < 1e-9, "{own_px}");
    }
    assert!(
        boards.notes.iter().any(|n| n.starts_with("6 corners that mrcal did not find")),
        "{:?}",
        boards.notes
    );
}

#[test]
fn mrcals_boards_are_explained_by_the_model_that_found_them() {
    let (folder, imported) = written(&read_mrcal(&[fixture("opencv8.cameramodel")], None).unwrap());
    assert_eq!((imported.exposures, imported.rows), (8, 330));
    // mrcal's own solution leaves 0.0487 px rms per axis; refitted, a little less, and angles are not pixels.
    let rational = rms_px(folder.path(), "rational");
    assert!((0.040..0.060).contains(&rational), "{rational}");
    for worse in ["pinhole", "fisheye:stereographic"] {
        assert!(rms_px(folder.path(), worse) > 5.0 * rational, "{worse}");
    }
    // A lens of which this project knows nothing gives boards all the same.
    let (folder, imported) = written(&read_mrcal(&[fixture("splined.cameramodel")], None).unwrap());
    assert!(imported.files.iter().all(|file| !file.ends_with("calibration.toml")));
    // The lens that made the corners is stereographic; mrcal's splines followed some of their noise, and left 0.046 px.
    assert!((0.045..0.075).contains(&rms_px(folder.path(), "fisheye:stereographic")));
    assert!(rms_px(folder.path(), "pinhole") > 1.0);
}

/// The same corners as a table, whose poses are found here: they are mrcal's to what noise of 0.05 px does to both, and
/// to the flat board that a table stands for (mrcal's own has 4 mm of 40 cm).
#[test]
fn tables_of_corners_are_posed_through_the_lens() {
    let files = [fixture("opencv8.cameramodel"), fixture("opencv8.vnl")];
    let boards = read_mrcal(&files, Some(7)).unwrap();
    let truth = read_mrcal(&files[..1], None).unwrap();
    let (mut squares, mut count) = (0.0f64, 0.0f64);
    for (view, own) in truth.views.iter().zip(&boards.views) {
        for corner in &view.corners {
            let found = own.corners.iter().find(|c| c.board == corner.board).unwrap();
            squares += found.place_camera.angle_between(corner.place_camera).powi(2);
            count += 1.0;
        }
    }
    let rms_px = 700.0 * (squares / count).sqrt();
    assert!(rms_px < 1.5, "{rms_px}");
    let said = read_mrcal(&files, None).unwrap_err().to_string();
    assert!(
        said.contains("does not say how many columns the board has (expected --board-columns N)"),
        "{said}"
    );
    let said = read_mrcal(&files, Some(5)).unwrap_err().to_string();
    assert!(said.contains("found 42 corners of `board-0000.png`, expected a multiple of 5"), "{said}");
    let said = read_mrcal(&[fixture("splined.cameramodel"), fixture("opencv8.vnl")], Some(7)).unwrap_err();
    assert!(said.to_string().contains("cannot be found through this lens model"), "{said}");
}

/// Literals: what validation/opencv_boards.py printed.
#[test]
fn boards_of_opencv_are_those_of_its_own_solution() {
    let boards = read_opencv(&[fixture("rational.yaml")], false).unwrap();
    let (sight, px) = corner(&boards, 2, [3.0, 1.0]);
    assert!(sight.distance(DVec2::new(0.8003049196205507, 0.08551637076487408)) < 1e-12, "{sight}");
    // The file has nine digits.
    assert!(px.distance(DVec2::new(983.4017944335938, 512.942138671875)) < 1e-6, "{px}");
    let (folder, imported) = written(&boards);
    assert_eq!((imported.exposures, imported.rows), (9, 432));
    // OpenCV: 0.04505 px rms per axis.
    let rational = rms_px(folder.path(), "rational");
    assert!((0.035..0.060).contains(&rational), "{rational}");
    assert!(rms_px(folder.path(), "pinhole") > 5.0 * rational);

    let boards = read_opencv(&[fixture("fisheye.json")], false).unwrap();
    let (folder, _) = written(&boards);
    let fisheye = rms_px(folder.path(), "fisheye");
    assert!((0.035..0.060).contains(&fisheye), "{fisheye}");
    assert!(
        rms_px(folder.path(), "rational") > 0.8 * fisheye
            && rms_px(folder.path(), "fisheye:equisolid") > 3.0 * fisheye
    );
}

/// Without poses they are found through the lens: OpenCV's own, to noise.
#[test]
fn poses_that_a_file_lacks_are_found() {
    for name in ["rational.yaml", "fisheye.json"] {
        let text = std::fs::read_to_string(fixture(name)).unwrap().replace("extrinsic_parameters", "nothing");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let (found, truth) =
            (read_opencv(&[path], false).unwrap(), read_opencv(&[fixture(name)], false).unwrap());
        for (view, own) in truth.views.iter().zip(&found.views) {
            for (a, b) in view.corners.iter().zip(&own.corners) {
                // Both least squares over the same corners; OpenCV stops its search earlier.
                let off_px = 520.0 * a.place_camera.angle_between(b.place_camera);
                assert!(off_px < 0.02, "{name}: {off_px}");
            }
        }
    }
}

#[test]
fn a_calibration_is_written_where_polynomials_follow_the_lens() {
    let narrow = r#"{"image_width": 1280, "image_height": 960, "camera_matrix": [[2000, 0, 640], [0, 2000, 480], [0, 0, 1]],
        "dist_coeff": [[-0.1, 0.02, 0, 0, 0]], "rvecs": [[0, 0, 0.1]], "tvecs": [[-0.15, -0.1, 0.6]],
        "board_width": 7, "board_height": 5, "square_size": 0.05, "image_points": [["#
        .to_owned();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("narrow.json");
    let with_corners = |corners: &[DVec2]| {
        let cells: Vec<String> = corners.iter().map(|px| format!("[{}, {}]", px.x, px.y)).collect();
        std::fs::write(&path, narrow.clone() + &cells.join(",") + "]]}").unwrap();
        read_opencv(std::slice::from_ref(&path), false).unwrap()
    };
    // Corners anywhere are not those of the poses.
    let anywhere: Vec<DVec2> = (0..35)
        .map(|k| DVec2::new(150.0 + 150.0 * f64::from(k % 7), 150.0 + 150.0 * f64::from(k / 7)))
        .collect();
    let boards = with_corners(&anywhere);
    let refused = boards.write(&folder.path().join("out"), &ImportOptions { pixel_um: 5.0 }).unwrap_err();
    assert!(refused.to_string().contains("poses do not put its corners"), "{refused}");
    assert!(!folder.path().join("out").exists());
    let lens = boards.camera.lens.unwrap();
    let seen: Vec<DVec2> =
        boards.views[0].corners.iter().map(|corner| lens.pixel(corner.place_camera).unwrap()).collect();
    let boards = with_corners(&seen);
    let imported = boards.write(&folder.path().join("out"), &ImportOptions { pixel_um: 5.0 }).unwrap();
    assert!(
        imported.notes.iter().any(|n| n.starts_with("calibration.toml holds the lens")),
        "{:?}",
        imported.notes
    );
    let setup = Setup::read(&folder.path().join("out/setup.toml")).unwrap();
    let calibration = Calibration::read(&folder.path().join("out/calibration.toml"), &setup).unwrap();
    let lens = boards.camera.lens.unwrap();
    let shown = DVec2::new(0.1, -0.05);
    let px = setup.camera_pinhole().pixel(calibration.distortion.distort(shown));
    assert!(px.distance(lens.pixel(shown.extend(1.0)).unwrap()) < 0.02, "{px}");

    let (_, imported) = written(&read_opencv(&[fixture("fisheye.json")], false).unwrap());
    assert!(
        imported.notes.iter().any(|n| n.starts_with("no calibration.toml is written")),
        "{:?}",
        imported.notes
    );
}

type Reader = fn(&Path) -> Result<Boards, InputError>;

fn mrcal(path: &Path) -> Result<Boards, InputError> {
    read_mrcal(&[path.to_path_buf()], None)
}

fn opencv(path: &Path) -> Result<Boards, InputError> {
    read_opencv(&[path.to_path_buf()], false)
}

#[test]
fn damaged_files_are_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let model = std::fs::read_to_string(fixture("opencv8.cameramodel")).unwrap();
    let yaml = std::fs::read_to_string(fixture("rational.yaml")).unwrap();
    let inputs = model.find("b'").unwrap();
    let without_inputs = format!("{}}}", &model[..model.find("    'optimization_inputs'").unwrap()]);
    let swapped = {
        let mut bytes = model.clone().into_bytes();
        bytes[inputs + 3000] = if bytes[inputs + 3000] == b'a' { b'b' } else { b'a' };
        String::from_utf8(bytes).unwrap()
    };
    let (m, o): (Reader, Reader) = (mrcal, opencv);
    for (read, name, text, said) in [
        (
            m,
            "a.cameramodel",
            "hello".to_owned(),
            "line 1: has a value that is none of Python's (found `hello`",
        ),
        (
            m,
            "b.cameramodel",
            "{}".to_owned(),
            "the key `lensmodel` does not fit (found nothing, expected the name of a lens model)",
        ),
        (m, "c.cameramodel", without_inputs, "key `optimization_inputs`: holds a lens but no boards"),
        (m, "d.cameramodel", swapped, "key `optimization_inputs`: holds an array"),
        (
            m,
            "e.cameramodel",
            model.replace("[ 1280, 960,]", "[ 1280, 0.5,]"),
            "the key `imagersize` does not fit",
        ),
        (m, "f.cameramodel", model.replacen("b'P", "b'\"", 1), "the optimization inputs are damaged"),
        (m, "g.cameramodel", model[..inputs + 500].to_owned(), "has a string without an end"),
        (
            o,
            "a.yaml",
            "camera_matrix".to_owned(),
            "line 1: a line is no name with a value (found `camera_matrix`",
        ),
        (
            o,
            "b.yaml",
            yaml.replacen("cols: 3", "cols: 4", 1),
            "key `camera_matrix`: a value does not fit (found something else, expected 3 x 3",
        ),
        (
            o,
            "c.yaml",
            yaml.replace("image_points", "nothing"),
            "holds no corners (found nothing, expected one of image_points,",
        ),
        (
            o,
            "d.yaml",
            yaml.replace("board_width: 8", "board_width: 7"),
            "found 48 corners in view 0, expected 7 x 6 corners",
        ),
        (o, "e.yaml", yaml.replace("image_width", "nothing"), "holds no image size"),
        (o, "f.yaml", yaml[..yaml.len() - 40].to_owned(), "has a bracket that is not closed"),
        (
            o,
            "g.yaml",
            yaml.replacen("rows: 9\n   cols: 6", "rows: 18\n   cols: 3", 1),
            "found 18 views, expected 6 numbers for each of 9 views",
        ),
        (o, "h.xml", "<?xml version=\"1.0\"?>".to_owned(), "is XML, which is not read"),
        (o, "i.json", "{\"camera_matrix\": ".to_owned(), "line 1: is no valid JSON"),
        (o, "j.yaml", format!("a: {}", "[".repeat(200) + &"]".repeat(200)), "has a list that cannot be read"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let error = read(&path).unwrap_err();
        assert!(error.to_string().contains(said), "{name}: {error}");
        assert!(error.help.is_some(), "{name}");
    }
}
