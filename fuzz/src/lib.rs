//! Every reader of a file or a datagram as a function of bytes, for fuzzers: none may panic, run on or take memory
//! without bound, whatever the bytes. What a reader makes of them is dropped; a refusal is as good as a result.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use retina_diagnosis::{AddedEffect, Baseline, Dataset, Source};
use retina_formats::{Calibration, Measurements, RadiometricCalibration, TableKind};
use retina_geometry::{LensModel, Setup};
use retina_image::{CameraImage, Photograph, PhotographOptions, ReadOptions};

/// A reader that is fed bytes.
pub type Reader = fn(&[u8]);

/// All readers by the names of their corpora.
pub const READERS: [(&str, Reader); 30] = [
    ("setup", setup),
    ("scene", scene),
    ("calibration", calibration),
    ("effect", effect),
    ("prescription", prescription),
    ("points", points),
    ("power", power),
    ("phase", phase),
    ("frames", frames),
    ("poses", poses),
    ("catalogue", catalogue),
    ("glb", glb),
    ("gltf", gltf),
    ("obj", obj),
    ("icq", icq),
    ("dsk", dsk),
    ("exr", exr),
    ("fits", fits),
    ("raster", raster),
    ("spk", spk),
    ("bpc", bpc),
    ("text_kernel", text_kernel),
    ("zmx", zmx),
    ("agf", agf),
    ("corto_scene", corto_scene),
    ("corto_geometry", corto_geometry),
    ("datagram", datagram),
    ("cameramodel", cameramodel),
    ("corners", corners),
    ("opencv", opencv),
];

/// A small camera before a small screen.
const SETUP: &str = r#"schema = "retina.setup/1"
name = "small"
[screen]
width_px = 160
height_px = 100
width_mm = 1.6
height_mm = 1.0
bits = 8
[camera]
width_px = 120
height_px = 90
pixel_um = 5.0
focal_mm = 5.0
f_number = 2.8
bits = 12
[facility]
observed_rows_px = 100
"#;

const CALIBRATION: &str = r#"schema = "retina.calibration/1"
setup = "small"
[distortion]
terms = [[1, 0, 1.0, 0.0], [0, 1, 0.0, 1.0], [3, 0, 0.4, 0.0], [1, 2, 0.4, 0.0]]
"#;

/// A tetrahedron about the origin.
const BODY: &str = "v 900 900 900\nv -900 -900 900\nv -900 900 -900\nv 900 -900 -900\n\
                    f 1 3 2\nf 1 4 3\nf 1 2 4\nf 2 3 4\n";

const POSES: &str = "time_s,camera_x_m,camera_y_m,camera_z_m,camera_from_inertial_w,camera_from_inertial_x,\
camera_from_inertial_y,camera_from_inertial_z,sun_x_m,sun_y_m,sun_z_m\n\
0,0,0,-22500,1,0,0,0,0,0,-1.5e11\n60,0,0,-22500,1,0,0,0,1.5e11,0,0\n";

const LENS: &str =
    "{ 'lensmodel': 'LENSMODEL_OPENCV4', 'intrinsics': [700, 700, 640, 480, 0.1, -0.05, 0.001, -0.002,],
'imagersize': [ 1280, 960,], }";

const POINTS: &str = include_str!("../corpus/points/few.csv");

/// A folder with what files may name, for all readers of the process.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder can be made").keep();
        for (name, text) in [
            ("setup.toml", SETUP),
            ("calibration.toml", CALIBRATION),
            ("rock.obj", BODY),
            ("poses.csv", POSES),
            ("points.csv", POINTS),
            ("lens.cameramodel", LENS),
        ] {
            std::fs::write(folder.join(name), text).expect("the temporary folder can be written");
        }
        folder
    })
}

/// Removes the folder; whoever has finished with the readers calls it.
pub fn clean_up() {
    let _ = std::fs::remove_dir_all(folder());
}

/// Calls a reader of a path with the bytes as that file; one file a thread.
fn with_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path)) {
    let thread: String =
        format!("{:?}", std::thread::current().id()).chars().filter(char::is_ascii_digit).collect();
    let path = folder().join(format!("{thread}-{name}"));
    std::fs::write(&path, bytes).expect("the temporary folder can be written");
    read(&path);
    // A file that is gone before the system writes it out costs no disk.
    let _ = std::fs::remove_file(&path);
}

fn the_setup() -> &'static Setup {
    static SETUP: OnceLock<Setup> = OnceLock::new();
    SETUP.get_or_init(|| Setup::read(&folder().join("setup.toml")).expect("the setup above fits"))
}

fn dataset(files: &[PathBuf]) -> Result<Dataset, retina_files::InputError> {
    let (tables, setup) = (&Measurements::read(files)?, the_setup());
    Dataset::new(&Source { tables, setup, calibration: None, response: None, baseline: Baseline::Physical })
}

/// `setup.toml`, and what follows from its numbers.
pub fn setup(bytes: &[u8]) {
    with_file("setup.toml", bytes, |path| {
        if let Ok(setup) = Setup::read(path) {
            let _ = (setup.facility_pinhole(), setup.camera_pinhole(), setup.brightest_magnitude());
        }
    });
}

/// `scene.toml`, with its setup, trajectory, body and calibration beside it, and its first frames.
pub fn scene(bytes: &[u8]) {
    // A trajectory of thousands of frames takes its time, which is no fault.
    let text = String::from_utf8_lossy(bytes);
    let frames = text.split("frames").skip(1).filter_map(|rest| {
        let digits = rest.trim_start_matches([' ', '=', '+', '"']);
        digits.split(|c: char| !c.is_ascii_digit()).next()?.parse::<f64>().ok()
    });
    if frames.into_iter().any(|frames| frames > 2000.0) {
        return;
    }
    with_file("scene.toml", bytes, |path| {
        if let Ok(scene) = retina_scene::Scene::read(path) {
            (0..scene.frame_count().min(3)).for_each(|index| drop(scene.frame(index)));
            let _ = scene.brightest_frames(1);
        }
    });
}

/// `calibration.toml`: distortion and response.
pub fn calibration(bytes: &[u8]) {
    with_file("calibration.toml", bytes, |path| {
        let _ = Calibration::read(path, the_setup());
        let _ = RadiometricCalibration::read(path, the_setup());
    });
}

/// A file with a formula of one's own, over a table of points.
pub fn effect(bytes: &[u8]) {
    static DATA: OnceLock<Dataset> = OnceLock::new();
    let data = DATA.get_or_init(|| dataset(&[folder().join("points.csv")]).expect("the points fit"));
    with_file("effect.toml", bytes, |path| {
        let _ = AddedEffect::read(&path.to_string_lossy(), data);
    });
}

/// A prescription as TOML, and its first-order figures.
pub fn prescription(bytes: &[u8]) {
    with_file("lenses.toml", bytes, system);
}

/// A prescription of Zemax, and its first-order figures.
pub fn zmx(bytes: &[u8]) {
    with_file("lenses.zmx", bytes, system);
}

fn system(path: &Path) {
    if let Ok(system) = retina_optics::read_system(path, &[]) {
        let _ = retina_optics::paraxial::Paraxial::primary(&system);
    }
}

/// A glass catalogue, and each glass at the middle of its range.
pub fn agf(bytes: &[u8]) {
    with_file("glasses.agf", bytes, |path| {
        for glass in retina_optics::glass::read_agf(path).unwrap_or_default() {
            let middle_um = 0.5 * (glass.range_um[0] + glass.range_um[1]);
            let _ = (glass.index(middle_um), glass.index_at(middle_um, 30.0, 1.0));
        }
    });
}

/// A table of points, beside each lens model too.
pub fn points(bytes: &[u8]) {
    with_file("points.csv", bytes, |path| {
        let files = [path.to_path_buf()];
        drop(dataset(&files));
        let Ok(tables) = &Measurements::read(&files) else { return };
        for model in LensModel::ALL {
            let (setup, baseline) = (the_setup(), Baseline::Lens(model));
            let _ = Dataset::new(&Source { tables, setup, calibration: None, response: None, baseline });
        }
    });
}

/// A table of power readings.
pub fn power(bytes: &[u8]) {
    with_file("power.csv", bytes, |path| drop(dataset(&[path.to_path_buf()])));
}

/// A table of whole-body magnitudes over phase.
pub fn phase(bytes: &[u8]) {
    with_file("phase.csv", bytes, |path| drop(dataset(&[path.to_path_buf()])));
}

/// A table of frames, whose images are not there.
pub fn frames(bytes: &[u8]) {
    with_file("frames.csv", bytes, |path| {
        let _ = TableKind::of_file(path);
        let files = [path.to_path_buf()];
        let source = retina_frames::FramesSource {
            files: &files,
            setup: the_setup(),
            calibration: None,
            register: true,
        };
        let _ = retina_frames::FrameSet::read(&source);
    });
}

/// A trajectory's table.
pub fn poses(bytes: &[u8]) {
    with_file("poses.csv", bytes, |path| drop(retina_sky::Trajectory::read(path, &["rock".to_owned()])));
}

/// A star catalogue's table.
pub fn catalogue(bytes: &[u8]) {
    with_file("stars.csv", bytes, |path| drop(retina_sky::catalogue::StarCatalogue::read(path)));
}

/// A binary glTF model.
pub fn glb(bytes: &[u8]) {
    with_file("body.glb", bytes, |path| drop(retina_model::load_body(path)));
}

/// A glTF model as text.
pub fn gltf(bytes: &[u8]) {
    with_file("body.gltf", bytes, |path| drop(retina_model::load_body(path)));
}

/// An OBJ model.
pub fn obj(bytes: &[u8]) {
    with_file("body.obj", bytes, |path| drop(retina_model::load_obj(path)));
}

/// A shape of R. Gaskell's.
pub fn icq(bytes: &[u8]) {
    with_file("body.icq", bytes, |path| drop(retina_model::load_mesh(path)));
}

/// A DSK kernel.
pub fn dsk(bytes: &[u8]) {
    with_file("body.bds", bytes, |path| drop(retina_model::load_mesh(path)));
}

/// An EXR image.
pub fn exr(bytes: &[u8]) {
    with_file("image.exr", bytes, |path| drop(retina_batch::read_exr(path)));
}

/// A FITS image.
pub fn fits(bytes: &[u8]) {
    camera_image("image.fits", bytes);
}

/// A PNG, TIFF or JPEG image.
pub fn raster(bytes: &[u8]) {
    camera_image("image.png", bytes);
}

fn camera_image(name: &str, bytes: &[u8]) {
    with_file(name, bytes, |path| {
        let _ = CameraImage::read(path, ReadOptions { bits: None, colour_to_grey: true });
        let _ = Photograph::read(path, PhotographOptions { upright: true, ..PhotographOptions::default() });
    });
}

/// An SPK kernel, and where it has the bodies at its first epochs.
pub fn spk(bytes: &[u8]) {
    with_file("kernel.bsp", bytes, |path| {
        let Ok(ephemeris) = retina_sky::ephemeris::Ephemeris::read(&[path.to_path_buf()]) else { return };
        for day in 0..4 {
            // The corpus begins here.
            let tdb_s = 8.585e8 + f64::from(day) * 86_400.0;
            if let Ok(bodies) = ephemeris.solar_system(tdb_s) {
                let places = [bodies.sun, bodies.earth, bodies.moon];
                assert!(
                    places.iter().all(|state| state.position_m.is_finite() && state.velocity_m_s.is_finite())
                );
            }
        }
    });
}

/// A binary PCK kernel.
pub fn bpc(bytes: &[u8]) {
    axes("kernel.bpc", bytes);
}

/// A text kernel: constants, frames, leap seconds, or a list of others.
pub fn text_kernel(bytes: &[u8]) {
    axes("kernel.tpc", bytes);
}

fn axes(name: &str, bytes: &[u8]) {
    with_file(name, bytes, |path| {
        let Ok(ephemeris) = retina_sky::ephemeris::Ephemeris::read(&[path.to_path_buf()]) else { return };
        for body in ["moon", "earth", "mars", "pebble"] {
            for tdb_s in [-1e9, 8.5851e8, 8.6e8] {
                let _ = ephemeris.body_from_inertial(body, tdb_s);
            }
            let _ = ephemeris.axes_source(body);
            let _ = ephemeris.semi_axes_m(body);
        }
    });
}

/// CORTO's `scene.json`.
pub fn corto_scene(bytes: &[u8]) {
    with_file("scene.json", bytes, |path| drop(retina_corto::Settings::read(path, &mut Vec::new())));
}

/// CORTO's `geometry.json`.
pub fn corto_geometry(bytes: &[u8]) {
    with_file("geometry.json", bytes, |path| drop(retina_corto::read_geometry(path, 1, &mut Vec::new())));
}

/// A camera model of mrcal with the boards that it was fitted to, and the files it becomes.
pub fn cameramodel(bytes: &[u8]) {
    with_file("camera.cameramodel", bytes, |path| {
        imported(retina_import::read_mrcal(&[path.to_path_buf()], None));
    });
}

/// A table of corners beside a camera model.
pub fn corners(bytes: &[u8]) {
    with_file("corners.vnl", bytes, |path| {
        imported(retina_import::read_mrcal(
            &[folder().join("lens.cameramodel"), path.to_path_buf()],
            Some(7),
        ));
    });
}

/// A calibration of OpenCV, YAML or JSON.
pub fn opencv(bytes: &[u8]) {
    with_file("calibration.yaml", bytes, |path| {
        imported(retina_import::read_opencv(&[path.to_path_buf()], false));
    });
}

/// What follows from a calibration of another program.
fn imported(boards: Result<retina_import::Boards, retina_files::InputError>) {
    let Ok(boards) = boards else { return };
    let thread: String =
        format!("{:?}", std::thread::current().id()).chars().filter(char::is_ascii_digit).collect();
    let out = folder().join(format!("{thread}-imported"));
    let _ = boards.write(&out, &retina_import::ImportOptions { pixel_um: 5.0 });
    let _ = std::fs::remove_dir_all(out);
}

/// A pose by UDP.
pub fn datagram(bytes: &[u8]) {
    let _ = retina_corto::decode_pose(bytes);
}
