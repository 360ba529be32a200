//! Prescriptions as TOML, schema `retina.optics/1`.
//!
//! ```toml
//! schema = "retina.optics/1"
//! name = "singlet"
//! clear_fraction = 1.0                # optional: part of each clear semi-diameter that light may use
//! aiming = "paraxial"                 # optional: or "stop"
//! glass_files = ["mine.agf"]          # optional, relative to this file
//! [object]
//! distance_mm = 500.0                 # absent table: at infinity
//! [beam]                              # one of entrance_pupil_mm, stop_mm, f_number, object_na
//! entrance_pupil_mm = 10.0
//! [[wavelength]]
//! nm = 544.0
//! weight = 1.0                        # optional
//! primary = true                      # optional: otherwise the middle one
//! [[field]]                           # x_tan, y_tan for an object at infinity, else x_mm, y_mm
//! y_tan = 0.1
//! [[surface]]
//! stop = true                         # exactly one
//! radius_mm = 50.0                    # absent: a plane; conic, aspheric = [a_2, a_4, ...] optional
//! thickness_mm = 5.0                  # to the next surface
//! glass = "N-BK7"                     # or index = 1.5; absent: air
//! semi_diameter_mm = 12.7             # optional; obstruction_mm: radius of a central stop
//! group = "front"                     # optional: neighbours of one name move as one
//! [[surface]]
//! part = "AC508-150-A"                # a stock lens: three surfaces
//! reversed = true
//! thickness_mm = 2.0
//! [[surface]]
//! focal_mm = 25.0                     # an ideal lens
//! [[surface]]                         # the last one is the image
//! [[group]]                           # optional: where a group is not as designed
//! name = "front"
//! pivot_mm = 0.0                      # from the group's first vertex
//! tilt_deg = [0.1, 0.0, 0.0]          # right-handed about x, y, z
//! decentre_mm = [0.0, 0.05, 0.0]
//! ```

use std::path::{Path, PathBuf};

use glam::DVec3;
use retina_files::{InputError, nearest, parse_schema};
use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::glass::{GlassCatalogue, Medium, read_agf};
use crate::stock::stock_doublet;
use crate::surface::{Aperture, Shape, Surface};
use crate::system::{Aiming, Beam, Field, Group, Object, OpticalSystem, Wavelength};
use crate::text::read_text_any;
use crate::zmx::parse_zmx;

const SCHEMA: &str = "retina.optics/1";

/// Names of the designs that ship with RETINA.
pub fn shipped_designs() -> impl Iterator<Item = &'static str> {
    retina_assets::PRESCRIPTIONS.iter().map(|(name, _)| *name)
}

/// A design that ships, by name; `None` if there is none.
///
/// # Errors
/// The asset does not fit: a fault of RETINA's own, met by a test.
pub fn shipped_design(name: &str) -> Option<Result<OpticalSystem, InputError>> {
    let (_, text) = retina_assets::PRESCRIPTIONS.iter().find(|(known, _)| *known == name)?;
    Some(parse_prescription(Path::new(name), text))
}

/// Reads a system from a `.toml` or `.zmx` file, or a shipped design by its name. Glasses of
/// `agf` files are known beside the embedded ones.
///
/// # Errors
/// Whatever does not fit, with its place; a name that is neither a file nor a shipped design.
pub fn read_system(source: &Path, agf: &[PathBuf]) -> Result<OpticalSystem, InputError> {
    let mut glasses = GlassCatalogue::embedded();
    for file in agf {
        glasses.extend(read_agf(file)?);
    }
    let extension = source.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("zmx") => parse_zmx(source, &read_text_any(source)?, &glasses),
        Some("toml") => parse_with(source, &retina_files::read_text(source)?, glasses),
        _ => {
            let name = source.to_string_lossy();
            shipped_design(&name).unwrap_or_else(|| {
                let names: Vec<&str> = shipped_designs().collect();
                let error =
                    InputError::new(source, "is neither a .toml or .zmx file nor a design that ships")
                        .expected(format!("a file, or one of {}", names.join(", ")));
                Err(match nearest(&name, names.iter().copied()) {
                    Some(near) => error.help(format!("did you mean `{near}`?")),
                    None => error.help("give the path of a prescription"),
                })
            })
        }
    }
}

/// Reads a prescription from text; `path` names it in errors and is the folder of its glass files.
///
/// # Errors
/// Whatever does not fit the schema or [`OpticalSystem::check`], with its place.
pub fn parse_prescription(path: &Path, text: &str) -> Result<OpticalSystem, InputError> {
    parse_with(path, text, GlassCatalogue::embedded())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileForm {
    #[serde(rename = "schema")]
    _schema: IgnoredAny,
    name: String,
    #[serde(default = "one")]
    clear_fraction: f64,
    #[serde(default)]
    aiming: AimingForm,
    #[serde(default)]
    glass_files: Vec<PathBuf>,
    object: Option<ObjectForm>,
    beam: BeamForm,
    wavelength: Vec<WavelengthForm>,
    field: Vec<FieldForm>,
    surface: Vec<SurfaceForm>,
    #[serde(default)]
    group: Vec<GroupForm>,
}

fn one() -> f64 {
    1.0
}

#[derive(Deserialize, Default, Clone, Copy)]
#[serde(rename_all = "kebab-case")]
enum AimingForm {
    #[default]
    Paraxial,
    Stop,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectForm {
    distance_mm: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BeamForm {
    entrance_pupil_mm: Option<f64>,
    stop_mm: Option<f64>,
    f_number: Option<f64>,
    object_na: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WavelengthForm {
    nm: f64,
    #[serde(default = "one")]
    weight: f64,
    #[serde(default)]
    primary: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FieldForm {
    x_tan: Option<f64>,
    y_tan: Option<f64>,
    x_mm: Option<f64>,
    y_mm: Option<f64>,
    #[serde(default = "one")]
    weight: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SurfaceForm {
    #[serde(default)]
    label: String,
    radius_mm: Option<f64>,
    conic: Option<f64>,
    #[serde(default)]
    aspheric: Vec<f64>,
    focal_mm: Option<f64>,
    part: Option<String>,
    reversed: Option<bool>,
    #[serde(default)]
    thickness_mm: f64,
    glass: Option<String>,
    index: Option<f64>,
    semi_diameter_mm: Option<f64>,
    #[serde(default)]
    obstruction_mm: f64,
    #[serde(default)]
    stop: bool,
    group: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GroupForm {
    name: String,
    #[serde(default)]
    pivot_mm: f64,
    #[serde(default)]
    tilt_deg: [f64; 3],
    #[serde(default)]
    decentre_mm: [f64; 3],
}

fn parse_with(path: &Path, text: &str, mut glasses: GlassCatalogue) -> Result<OpticalSystem, InputError> {
    let form: FileForm = parse_schema(path, text, SCHEMA, "a prescription")?;
    let error = |at: &str, problem: &str| InputError::new(path, problem).at(at);
    for file in &form.glass_files {
        glasses.extend(read_agf(&path.parent().unwrap_or(Path::new("")).join(file))?);
    }
    let primaries: Vec<usize> = (0..form.wavelength.len()).filter(|&i| form.wavelength[i].primary).collect();
    if primaries.len() > 1 {
        return Err(error("wavelength", "only one wavelength can be the primary").found(primaries.len()));
    }
    let object = form.object.map_or(Object::Infinity, |object| Object::Distance(object.distance_mm));
    let fields = form.field.iter().enumerate().map(|(i, field)| read_field(path, object, i, field));
    let (surfaces, stop, mut groups) = read_surfaces(path, &form.surface, &glasses)?;
    for group in &form.group {
        let names: Vec<String> = groups.iter().map(|known: &Group| known.name.clone()).collect();
        let Some(known) = groups.iter_mut().find(|known| known.name == group.name) else {
            let missing =
                error("group", "no surface belongs to this group").found(format!("`{}`", group.name));
            return Err(match nearest(&group.name, names.iter().map(String::as_str)) {
                Some(near) => missing.help(format!("did you mean `{near}`?")),
                None => missing.help(format!("write group = \"{}\" at its surfaces", group.name)),
            });
        };
        known.pivot_mm = group.pivot_mm;
        known.tilt_rad = DVec3::from(group.tilt_deg.map(f64::to_radians));
        known.decentre_mm = DVec3::from(group.decentre_mm);
    }
    let system = OpticalSystem {
        name: form.name,
        object,
        fields: fields.collect::<Result<_, _>>()?,
        primary: primaries.first().copied().unwrap_or(form.wavelength.len() / 2),
        wavelengths: form.wavelength.iter().map(|w| Wavelength { nm: w.nm, weight: w.weight }).collect(),
        beam: read_beam(path, &form.beam)?,
        stop,
        surfaces,
        groups,
        clear_fraction: form.clear_fraction,
        aiming: match form.aiming {
            AimingForm::Paraxial => Aiming::Paraxial,
            AimingForm::Stop => Aiming::Stop,
        },
    };
    system.check(path)?;
    Ok(system)
}

fn read_field(path: &Path, object: Object, i: usize, field: &FieldForm) -> Result<Field, InputError> {
    let (right, wrong, names) = match object {
        Object::Infinity => ([field.x_tan, field.y_tan], [field.x_mm, field.y_mm], "x_tan, y_tan"),
        Object::Distance(_) => ([field.x_mm, field.y_mm], [field.x_tan, field.y_tan], "x_mm, y_mm"),
    };
    if wrong.iter().any(Option::is_some) {
        return Err(InputError::new(path, "the field does not go with the object")
            .at(format!("field {}", i + 1))
            .expected(names)
            .help("an object at infinity has directions (tangents), a finite one has points (mm)"));
    }
    Ok(Field { at: right.map(|value| value.unwrap_or(0.0)), weight: field.weight })
}

fn read_beam(path: &Path, beam: &BeamForm) -> Result<Beam, InputError> {
    let given: Vec<Beam> = [
        beam.entrance_pupil_mm.map(Beam::EntrancePupil),
        beam.stop_mm.map(Beam::Stop),
        beam.f_number.map(Beam::FNumber),
        beam.object_na.map(Beam::ObjectNa),
    ]
    .into_iter()
    .flatten()
    .collect();
    match given[..] {
        [beam] => Ok(beam),
        _ => Err(InputError::new(path, "the beam's size must be given once")
            .at("beam")
            .found(format!("{} keys", given.len()))
            .expected("one of entrance_pupil_mm, stop_mm, f_number, object_na")),
    }
}

type Surfaces = (Vec<Surface>, usize, Vec<Group>);

fn read_surfaces(
    path: &Path,
    forms: &[SurfaceForm],
    glasses: &GlassCatalogue,
) -> Result<Surfaces, InputError> {
    let mut surfaces: Vec<Surface> = Vec::new();
    let mut groups: Vec<Group> = Vec::new();
    let mut stop = None;
    for (i, form) in forms.iter().enumerate() {
        let error = |problem: &str| InputError::new(path, problem).at(format!("[[surface]] entry {}", i + 1));
        let first = surfaces.len();
        if form.stop && stop.replace(first).is_some() {
            return Err(error("a second surface is the stop").expected("stop = true at one surface"));
        }
        if let Some(part) = &form.part {
            let figure =
                form.radius_mm.or(form.conic).or(form.focal_mm).or(form.index).or(form.semi_diameter_mm);
            if figure.is_some()
                || form.glass.is_some()
                || !form.aspheric.is_empty()
                || form.obstruction_mm != 0.0
            {
                return Err(error("a stock lens brings its own radii, glasses and diameter")
                    .expected("part, reversed, thickness_mm, label, stop and group alone"));
            }
            let lens = stock_doublet(path, part)?;
            surfaces.extend(lens.surfaces(form.reversed.unwrap_or(false), form.thickness_mm));
        } else {
            if form.reversed.is_some() {
                return Err(error("only a stock lens (part) can be reversed"));
            }
            surfaces.push(Surface {
                label: String::new(),
                shape: read_shape(form, &error)?,
                thickness_mm: form.thickness_mm,
                medium: read_medium(path, form, glasses, &error)?,
                aperture: Aperture {
                    inner_mm: form.obstruction_mm,
                    outer_mm: form.semi_diameter_mm.unwrap_or(f64::INFINITY),
                },
            });
        }
        if !form.label.is_empty() {
            surfaces[first].label.clone_from(&form.label);
        }
        if let Some(name) = &form.group {
            let last = surfaces.len() - 1;
            match groups.iter_mut().find(|group| group.name == *name) {
                Some(group) if group.last + 1 == first => group.last = last,
                Some(_) => return Err(error("the surfaces of a group must follow one another").found(name)),
                None => groups.push(Group::aligned(name, first, last)),
            }
        }
    }
    let stop = stop.ok_or_else(|| {
        InputError::new(path, "the system has no stop")
            .at("surface")
            .expected("stop = true at one surface")
            .help("the stop limits the beam of every field; a plane in air can be one")
    })?;
    Ok((surfaces, stop, groups))
}

fn read_shape(form: &SurfaceForm, error: &dyn Fn(&str) -> InputError) -> Result<Shape, InputError> {
    if let Some(focal_mm) = form.focal_mm {
        if form.radius_mm.is_some() || form.conic.is_some() || !form.aspheric.is_empty() {
            return Err(error("an ideal lens (focal_mm) has no radius, conic or aspheric terms"));
        }
        if form.glass.is_some() || form.index.is_some() {
            return Err(error("an ideal lens (focal_mm) stands in air"));
        }
        return Ok(Shape::IdealLens { focal_mm });
    }
    let curvature_per_mm = match form.radius_mm {
        Some(radius) if radius == 0.0 || !radius.is_finite() => {
            return Err(error("a radius must be finite and not 0")
                .found(radius)
                .help("leave it out for a plane"));
        }
        Some(radius) => 1.0 / radius,
        None => 0.0,
    };
    let conic = form.conic.unwrap_or(0.0);
    Ok(if form.aspheric.is_empty() {
        Shape::Conic { curvature_per_mm, conic }
    } else {
        Shape::EvenAsphere { curvature_per_mm, conic, coefficients: form.aspheric.clone() }
    })
}

fn read_medium(
    path: &Path,
    form: &SurfaceForm,
    glasses: &GlassCatalogue,
    error: &dyn Fn(&str) -> InputError,
) -> Result<Medium, InputError> {
    match (&form.glass, form.index) {
        (Some(_), Some(_)) => Err(error("both a glass and an index are given").expected("one of the two")),
        (Some(name), None) => {
            let mut refused = glasses.require(path, name);
            if let Err(bad) = &mut refused {
                bad.place = error("").place;
            }
            Ok(Medium::Glass(refused?))
        }
        (None, Some(index)) => Ok(Medium::Index(index)),
        (None, None) => Ok(Medium::Air),
    }
}
