//! TOML: told apart by the key `schema`.

use std::path::Path;

use retina_cluster::Runs;
use retina_diagnosis::AddedEffect;
use retina_experiments::{far_range, flashes, full_disk};
use retina_files::{InputError, nearest, parse_toml, read_text};
use retina_formats::{CalibrationFile, Measurements};
use retina_geometry::Setup;
use retina_scene::Scene;

use super::{Checked, Company};

const SCHEMAS: [&str; 9] = [
    "retina.setup/1",
    "retina.scene/1",
    "retina.calibration/1",
    "retina.far-range/1",
    "retina.full-disk/1",
    "retina.flashes/1",
    "retina.runs/1",
    "retina.optics/1",
    "retina.pattern/1",
];

pub(super) fn check_toml(path: &Path, company: &Company) -> Result<Checked, InputError> {
    let text = read_text(path)?;
    let table: toml::Table = parse_toml(path, &text)?;
    let schema = match table.get("schema") {
        None if ["dx", "dy", "value"].iter().any(|key| table.contains_key(*key)) => {
            return own_effect(path, company);
        }
        None => {
            return Err(InputError::new(path, "has no key `schema`").expected(format!(
                "one of {}; or an own effect with `dx` and `dy`, or `value`",
                SCHEMAS.join(", ")
            )));
        }
        Some(schema) => schema.as_str().unwrap_or_default(),
    };
    let out = |kind: &str| Checked::of_schema(kind, schema);
    match schema {
        "retina.setup/1" => setup(&Setup::read(path)?),
        "retina.scene/1" => scene(&Scene::read(path)?),
        "retina.calibration/1" => calibration(path, &table, company),
        "retina.far-range/1" => {
            let campaign = far_range::Scenario::read(path, &far_range::Choice::default())?;
            Ok(out("far-range campaign").says(format!(
                "{} random poses and a transfer; `retina navigate far-range` runs them, `retina plan` cuts the poses into shards",
                campaign.poses.count
            )))
        }
        "retina.full-disk/1" => {
            let frames = full_disk::FullDiskScenario::read(path)?.chain.frames()?;
            Ok(out("full-disk campaign").says(format!(
                "{frames} frames; `retina navigate full-disk` runs it, `retina plan` cuts it into shards"
            )))
        }
        "retina.flashes/1" => {
            let frames = flashes::FlashScenario::read(path)?.chain.frames()?;
            Ok(out("flash campaign").says(format!(
                "{frames} frames; `retina navigate flashes` runs it, `retina plan` cuts it into shards"
            )))
        }
        "retina.runs/1" => {
            let runs = Runs::read(path)?;
            let first = match runs.count() {
                0 => "none".to_owned(),
                _ => format!("retina {}", runs.words(0, Path::new("RUN")).join(" ")),
            };
            Ok(out("runs of a command")
                .says(format!("{} runs; the first: {first}", runs.count()))
                .says("`retina runs` makes them one after the other, `retina plan` cuts them into shards"))
        }
        "retina.optics/1" => {
            let system = retina_optics::read_system(path, &[])?;
            Ok(lenses(&system).says("`retina optics` analyses it"))
        }
        "retina.pattern/1" => {
            let name = table.get("setup").and_then(|name| name.as_str()).unwrap_or_default().to_owned();
            let checked = out("calibration screens").says(format!("made for the setup `{name}`"));
            let folder = path.parent().unwrap_or(Path::new("."));
            match company.setup(&name) {
                Some(setup) => {
                    let pattern = retina_calibration::geometry::Pattern::read(folder, &setup)?;
                    let points: usize = pattern.screens.iter().map(|screen| screen.points.len()).sum();
                    Ok(checked.says(format!("{} screens with {points} points", pattern.screens.len())))
                }
                None => {
                    Ok(checked.note("give the setup on the same command line, and its screens are checked"))
                }
            }
        }
        other => Err(InputError::new(path, "has a schema that RETINA does not know")
            .at("key `schema`")
            .found(format!("`{other}`"))
            .expected(format!("one of {}", SCHEMAS.join(", ")))
            .help(
                nearest(other, SCHEMAS).map_or_else(String::new, |near| format!("did you mean `{near}`?")),
            )),
    }
}

pub(super) fn setup(setup: &Setup) -> Result<Checked, InputError> {
    let k_f = setup.facility_pinhole();
    let (screen, camera) = (&setup.screen, &setup.camera);
    let field = |pixels: u32| {
        2.0 * (0.5 * f64::from(pixels) * camera.pixel_um * 1e-3 / camera.focal_mm).atan().to_degrees()
    };
    let mut out = Checked::of_schema("facility setup", "retina.setup/1")
        .says(format!(
            "`{}`: a screen of {} x {} px, a camera of {} x {} px",
            setup.name, screen.width_px, screen.height_px, camera.width_px, camera.height_px
        ))
        .says(format!("the camera sees {:.2} x {:.2} deg", field(camera.width_px), field(camera.height_px)))
        .says(format!(
            "K_f: f_x {:.2} px, f_y {:.2} px, c_x {:.2} px, c_y {:.2} px",
            k_f.fx_px, k_f.fy_px, k_f.cx_px, k_f.cy_px
        ));
    if let Some(file) = setup.calibration_path() {
        if file.exists() {
            CalibrationFile::read(&file, setup)
                .map_err(|error| error.named_by(&setup.file, "calibration.file"))?;
            out = out.says(format!("its own calibration is {}", file.display()));
        } else {
            out = out.note(format!("its calibration {} is not there", file.display()));
        }
    }
    if let Some(system) = setup.optics_system() {
        retina_optics::read_system(&system, &[])
            .map_err(|error| error.named_by(&setup.file, "optics.system"))?;
        out = out.says(format!("the bench has the lenses of {}", system.display()));
    }
    Ok(out)
}

fn scene(scene: &Scene) -> Result<Checked, InputError> {
    // The first frame as a run would see it: places, axes, planets.
    if scene.frame_count() > 0 {
        scene.sky(&scene.frame(0)?)?;
    }
    let image = &scene.image;
    let bodies: Vec<&str> = scene.bodies.iter().map(|body| body.name.as_str()).collect();
    let mut out = Checked::of_schema("scene", "retina.scene/1")
        .says(format!("{} frames of {} x {} px", scene.frame_count(), image.width_px, image.height_px))
        .says(match bodies.len() {
            0 => "no bodies".to_owned(),
            _ => format!("bodies: {}", bodies.join(", ")),
        });
    if scene.stars.is_some() {
        out = out.says("stars and planets are shown");
    }
    if scene.flashes.is_some() {
        out = out.says("flashes are shown");
    }
    Ok(out
        .says(format!("compensation `{}`; {} input files", scene.compensation.name(), scene.inputs.len()))
        .says("`retina render` renders it"))
}

fn calibration(path: &Path, table: &toml::Table, company: &Company) -> Result<Checked, InputError> {
    let name = table.get("setup").and_then(|name| name.as_str()).unwrap_or_default();
    let out =
        Checked::of_schema("calibration", "retina.calibration/1").says(format!("of the setup `{name}`"));
    let parts: Vec<&str> = [
        ("distortion", "D"),
        ("inverse", "D^-1"),
        ("covariance", "its covariance"),
        ("response", "the response"),
    ]
    .into_iter()
    .filter(|(key, _)| table.contains_key(*key))
    .map(|(_, what)| what)
    .collect();
    let out = out
        .says(format!("it holds {}", if parts.is_empty() { "nothing".to_owned() } else { parts.join(", ") }));
    let out = match company.setups.is_empty() || company.setups.iter().any(|setup| setup.name == name) {
        true => out,
        false => out.note("none of the setups given beside it has that name"),
    };
    match company.setup(name) {
        Some(setup) => {
            CalibrationFile::read(path, &setup)?;
            if table.contains_key("distortion") || table.contains_key("inverse") {
                retina_formats::Calibration::read(path, &setup)?;
            }
            Ok(out.says("`retina render` uses it where a scene or a setup names it"))
        }
        None => {
            retina_files::read_schema::<CalibrationFile>(path, "retina.calibration/1", "a calibration")?;
            Ok(out.note("give its setup on the same command line, and the two are held to each other"))
        }
    }
}

pub(super) fn lenses(system: &retina_optics::OpticalSystem) -> Checked {
    Checked::of_schema("lens system", "retina.optics/1").says(format!(
        "`{}`: {} surfaces, {} fields, {} wavelengths",
        system.name,
        system.surfaces.len(),
        system.fields.len(),
        system.wavelengths.len()
    ))
}

/// A formula names columns of a table, so it is read with one.
fn own_effect(path: &Path, company: &Company) -> Result<Checked, InputError> {
    let out =
        Checked::new("own effect").says("`--effect FILE` and a folder of `diagnose --catalogue` take it");
    let Some(table) = company.tables.first() else {
        return Ok(
            out.note("its formula is read with a table: give one, and its setup, on the same command line")
        );
    };
    let tables = Measurements::read(std::slice::from_ref(table))?;
    let Some(data) = company.dataset(&tables)? else {
        return Ok(
            out.note("its formula is read with a table and its setup: give a setup on the same command line")
        );
    };
    let effect = AddedEffect::read(&path.display().to_string(), &data)?;
    retina_diagnosis::check_effects(&data, &[effect])?;
    Ok(out.says(format!("it can be fitted to {}", table.display())))
}
