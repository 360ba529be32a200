//! A scenario folder: which files belong to it, what is guessed, and what it becomes.

use std::path::{Path, PathBuf};

use retina_files::{InputError, hash_bytes, hash_file};
use retina_scene::SceneInput;

use crate::folder::{files_of, names};
use crate::geometry::{default_pose, read_geometry};
use crate::pose::{Pose, World};
use crate::settings::Settings;
use crate::shape::{ShapeSource, load_shape};
use crate::sidecar::{BodyTable, Sidecar};

/// Sidecar that is taken where none is named.
const OWN_SIDECAR: &str = "retina.toml";
/// Metres in a Blender unit where nothing says how many.
const DEFAULT_SCALE_M_PER_BU: f64 = 1.0;
/// The Sun's disc gets at least this full angle, rad: a point is at no distance.
const SMALLEST_SUN_RAD: f64 = 1e-6;

/// A scenario, read and checked, without its bodies' meshes.
#[derive(Debug)]
pub struct Scenario {
    /// `scene.json`.
    pub scene_file: PathBuf,
    /// `geometry.json`, or the folder where there is none.
    pub geometry_file: PathBuf,
    /// What `scene.json` asks for.
    pub settings: Settings,
    /// The frames.
    pub poses: Vec<Pose>,
    /// Scale, names and distance of the Sun.
    pub world: World,
    /// What was guessed, replaced or not used, a sentence each.
    pub notes: Vec<String>,
    pub(crate) bodies: Vec<BodySource>,
    pub(crate) inputs: Vec<SceneInput>,
}

/// Where a body comes from.
#[derive(Debug)]
pub(crate) struct BodySource {
    pub(crate) name: String,
    pub(crate) shape: ShapeSource,
}

impl Scenario {
    /// Reads a scenario folder with its sidecar: the one named, else `retina.toml` in the folder,
    /// else none. The bodies' files are found and not yet loaded.
    ///
    /// # Errors
    /// Whatever does not fit in any of the files, or a file that cannot be told without a sidecar.
    pub fn read(folder: &Path, sidecar: Option<&Path>) -> Result<Self, InputError> {
        if !folder.is_dir() {
            return Err(InputError::new(folder, "is no folder")
                .expected("a scenario's folder, with scene/, geometry/ and body/ in it"));
        }
        let mut notes = Vec::new();
        let mut inputs = Vec::new();
        let mut input = |role: &str, hash: String| inputs.push(SceneInput { role: role.into(), hash });
        let own = folder.join(OWN_SIDECAR);
        let sidecar_file = match sidecar {
            Some(file) => Some(file.to_path_buf()),
            None if own.is_file() => {
                notes.push(format!("guessed: the sidecar is {}", own.display()));
                Some(own)
            }
            None => None,
        };
        let sidecar = match &sidecar_file {
            None => None,
            Some(file) => {
                let (read, text) = Sidecar::read(file)?;
                input("sidecar", hash_bytes(text.as_bytes()));
                Some(read)
            }
        };
        let sidecar = sidecar.as_ref();

        let scene_file = named_or_only(
            folder,
            "scene",
            &["json"],
            sidecar.and_then(|s| s.scene.as_deref()),
            "scene",
            &mut notes,
        )?
        .ok_or_else(|| {
            InputError::new(folder.join("scene"), "holds no scene file")
                .expected("scene.json, as CORTO's `State` reads it")
        })?;
        let settings = Settings::read(&scene_file, &mut notes)?;
        input("scene", hash_file(&scene_file)?);
        let count = settings.pass_indices.len();

        let geometry_file = named_or_only(
            folder,
            "geometry",
            &["json", "txt"],
            sidecar.and_then(|s| s.geometry.as_deref()),
            "geometry",
            &mut notes,
        )?;
        let poses = match &geometry_file {
            Some(file) => {
                input("trajectory", hash_file(file)?);
                read_geometry(file, count, &mut notes)?
            }
            None => {
                notes.push(
                    "there is no geometry file: one frame, everything at the origin, as in CORTO".into(),
                );
                vec![default_pose(count)]
            }
        };

        let bodies = bodies(folder, sidecar_file.as_deref(), sidecar, count, &mut notes)?;
        for body in &bodies {
            for (role, hash) in body.shape.inputs()? {
                input(&format!("body {}{role}", body.name), hash);
            }
        }
        let scale_m_per_bu = sidecar.and_then(|s| s.scale_m_per_bu).unwrap_or_else(|| {
            notes.push(format!("guessed: a Blender unit is {DEFAULT_SCALE_M_PER_BU} m"));
            DEFAULT_SCALE_M_PER_BU
        });
        let sun_angle_rad = settings.sun_angle_rad.max(SMALLEST_SUN_RAD);
        let world = World {
            scale_m_per_bu,
            sun_distance_m: retina_radiometry::SUN_RADIUS_M / (0.5 * sun_angle_rad).sin(),
            body_names: bodies.iter().map(|body| body.name.clone()).collect(),
        };
        Ok(Self {
            scene_file,
            geometry_file: geometry_file.unwrap_or_else(|| folder.to_path_buf()),
            settings,
            poses,
            world,
            notes,
            bodies,
            inputs,
        })
    }
}

/// The file in `folder/kind` that the sidecar names; else `kind.json`; else the only one.
fn named_or_only(
    folder: &Path,
    kind: &str,
    extensions: &[&str],
    named: Option<&Path>,
    key: &str,
    notes: &mut Vec<String>,
) -> Result<Option<PathBuf>, InputError> {
    let place = folder.join(kind);
    if let Some(name) = named {
        return Ok(Some(place.join(name)));
    }
    let usual = place.join(format!("{kind}.json"));
    if usual.is_file() {
        return Ok(Some(usual));
    }
    let mut files = files_of(&place, extensions)?;
    match files.len() {
        0 => Ok(None),
        1 => {
            notes.push(format!("guessed: the {kind} is {}", files[0].display()));
            Ok(files.pop())
        }
        _ => Err(InputError::new(&place, format!("which file is the {kind} cannot be told"))
            .found(names(&files))
            .expected(format!("{kind}.json, or one file"))
            .help(format!("name it in a sidecar: {key} = \"NAME.json\""))),
    }
}

fn bodies(
    folder: &Path,
    sidecar_file: Option<&Path>,
    sidecar: Option<&Sidecar>,
    count: usize,
    notes: &mut Vec<String>,
) -> Result<Vec<BodySource>, InputError> {
    let tables: &[BodyTable] = sidecar.map_or(&[], |sidecar| &sidecar.body);
    let blamed = sidecar_file.unwrap_or(folder);
    if !tables.is_empty() && tables.len() != count {
        return Err(InputError::new(blamed, "has another number of bodies than the scene")
            .at("table `body`")
            .found(tables.len())
            .expected(format!("{count}, as many as `body_settings` in the scene file")));
    }
    let unnamed = BodyTable::default();
    let table = |number: usize| tables.get(number).unwrap_or(&unnamed);
    let shapes = crate::shape::shape_files(folder, count, |number| table(number).file.as_deref(), notes)?;
    let mut bodies: Vec<BodySource> = Vec::new();
    for (number, file) in shapes.into_iter().enumerate() {
        let table = table(number);
        let default = if count == 1 { "body".to_owned() } else { format!("body_{}", number + 1) };
        let name = table.name.clone().unwrap_or(default);
        let place = format!("body {}, key `name`", number + 1);
        let simple = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if name.is_empty() || !name.chars().all(simple) || bodies.iter().any(|body| body.name == name) {
            return Err(InputError::new(blamed, "the body's name does not do")
                .at(place)
                .found(format!("`{}`", name.escape_default()))
                .expected("letters, digits, `_` and `-`, another name for each body"));
        }
        let shape = ShapeSource::of(folder, blamed, number, count, file, table, notes)?;
        bodies.push(BodySource { name, shape });
    }
    Ok(bodies)
}

/// The bodies' meshes, loaded.
pub(crate) fn load_bodies(
    scenario: &Scenario,
    notes: &mut Vec<String>,
) -> Result<Vec<retina_scene::BodyParts>, InputError> {
    scenario
        .bodies
        .iter()
        .map(|body| load_shape(&body.name, &body.shape, scenario.world.scale_m_per_bu, notes))
        .collect()
}
