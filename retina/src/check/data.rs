//! JSON, pictures, bodies, lenses, kernels.

use std::path::Path;

use retina_files::{InputError, MOST_IMAGE_PIXELS, decode_image, read_bytes, read_text};
use retina_sky::ephemeris::{Ephemeris, kernel_contents};
use serde_json::Value;

use super::Checked;
use super::toml_file::lenses;

/// Documents that RETINA writes, and what they are.
const DOCUMENTS: [(&str, &str); 27] = [
    ("retina.batch/1", "record of a folder of frames"),
    ("retina.manifest/1", "manifest of frames"),
    ("retina.truth/1", "truth of a frame"),
    ("retina.plan/1", "plan of shards"),
    ("retina.status/1", "status of a campaign"),
    ("retina.run/1", "record of a run"),
    ("retina.runs-summary/1", "summary of runs"),
    ("retina.export/1", "record of a data set"),
    ("retina.error/1", "error"),
    ("retina.campaign/1", "record of a measurement campaign on the bench"),
    ("retina.compare/1", "comparison of a model with measurements"),
    ("retina.diagnosis/1", "diagnosis"),
    ("retina.fit/1", "fit of effects"),
    ("retina.investigation/1", "formulas that were looked for"),
    ("retina.decision/1", "decision between rivals"),
    ("retina.geometry-calibration/1", "summary of a geometric calibration"),
    ("retina.radiometry-calibration/1", "summary of a radiometric calibration"),
    ("retina.navigation-stars/1", "attitudes from stars"),
    ("retina.navigation-limb/1", "position from a limb"),
    ("retina.navigation-full-disk/1", "positions from full discs"),
    ("retina.navigation-flashes/1", "flashes that were found"),
    ("retina.far-range-result/1", "result of the far-range experiment"),
    ("retina.far-range-poses/1", "poses of the far-range experiment"),
    ("retina.full-disk-result/1", "result of the full-disk experiment"),
    ("retina.flashes-result/1", "result of the flash experiment"),
    ("retina.optics/1", "result of an optical analysis"),
    ("retina.optics-search-state/2", "state of a search for lenses, to go on from"),
];

/// Keys without which a document of a schema is none.
const KEYS: [(&str, &[&str]); 4] = [
    ("retina.truth/1", &["frame", "time_s", "image_px", "camera_from_inertial", "bodies", "stars"]),
    ("retina.batch/1", &["input_hash", "quality", "compensation", "backend", "radiance_scale", "frames"]),
    ("retina.manifest/1", &["index", "inputs", "outputs"]),
    ("retina.plan/1", &["work", "source", "items", "shards", "format"]),
];

/// Further documents, which commands print.
const OTHERS: [&str; 24] = [
    "adapter",
    "bench-effects",
    "benchmark",
    "body",
    "check",
    "contact-sheet",
    "corto-sidecar",
    "doctor",
    "effects",
    "far-range-transfer",
    "image",
    "import",
    "merge",
    "pattern",
    "radiance",
    "render",
    "screen",
    "serve",
    "serve-summary",
    "trajectory-summary",
    "undistorted",
    "view",
    "view-session",
    "warp",
];

fn of_document(path: &Path, document: &Value) -> Result<Checked, InputError> {
    let Some(schema) = document["schema"].as_str() else {
        return Err(
            InputError::new(path, "is JSON without a key `schema`").expected("a document that RETINA wrote")
        );
    };
    match DOCUMENTS.iter().find(|(own, _)| *own == schema) {
        Some((_, what)) => {
            let keys = KEYS.iter().find(|(own, _)| *own == schema).map_or(&[][..], |(_, keys)| *keys);
            match keys.iter().find(|key| document.get(**key).is_none()) {
                None => Ok(Checked::of_schema(what, schema)),
                Some(key) => Err(InputError::new(path, format!("is no {what}: a key is missing"))
                    .at(format!("key `{key}`"))
                    .expected(keys.join(", "))),
            }
        }
        None if OTHERS.iter().any(|name| schema == format!("retina.{name}/1")) => {
            Ok(Checked::of_schema("document of RETINA", schema))
        }
        None => Err(InputError::new(path, "is no document of RETINA")
            .at("key `schema`")
            .found(format!("`{schema}`"))),
    }
}

pub(super) fn check_json(path: &Path) -> Result<Checked, InputError> {
    let document: Value = serde_json::from_str(&read_text(path)?)
        .map_err(|error| InputError::new(path, format!("is no JSON: {error}")).line(error.line()))?;
    of_document(path, &document)
}

pub(super) fn check_lines(path: &Path) -> Result<Checked, InputError> {
    let text = read_text(path)?;
    let mut first = None;
    let mut count = 0;
    for (number, line) in text.lines().enumerate() {
        let document: Value = serde_json::from_str(line).map_err(|error| {
            InputError::new(path, format!("a line is no JSON: {error}"))
                .line(number + 1)
                .help("a run that was killed left it; `retina render --resume` mends a manifest")
        })?;
        first.get_or_insert(document);
        count += 1;
    }
    let first = first.ok_or_else(|| InputError::new(path, "is empty"))?;
    Ok(of_document(path, &first)?.says(format!("{count} lines")))
}

pub(super) fn check_body(path: &Path) -> Result<Checked, InputError> {
    let body = retina_model::load_body(path)?;
    let lengths = body.vertices.iter().map(|vertex| vertex.position_m.length());
    let (least, most) =
        lengths.fold((f64::INFINITY, 0.0f64), |(least, most), length| (least.min(length), most.max(length)));
    let mut out = Checked::new("body")
        .says(format!(
            "{} triangles, {} vertices, {} albedo maps",
            body.triangles.len(),
            body.vertices.len(),
            body.albedo_maps.len()
        ))
        .says(format!("its surface lies {least:.1} to {most:.1} m from its origin"));
    if most < 100.0 {
        out = out.note("bodies are in metres: is this one in kilometres? Scale it by 1000 before the export");
    }
    Ok(out)
}

pub(super) fn check_picture(path: &Path) -> Result<Checked, InputError> {
    let options = retina_image::ReadOptions { colour_to_grey: true, ..Default::default() };
    if ["fits", "fit", "fts"].contains(&super::extension(path).as_str()) {
        let image = retina_image::CameraImage::read(path, options)?;
        return Ok(Checked::new("image").says(format!("{} x {} px", image.width_px, image.height_px)));
    }
    use image::ImageFormat::{Jpeg, Png, Tiff};
    let image = decode_image(path, "the file", &read_bytes(path)?, &[Png, Tiff, Jpeg], MOST_IMAGE_PIXELS)?;
    Ok(Checked::new("image").says(format!("{} x {} px, {:?}", image.width(), image.height(), image.color())))
}

pub(super) fn check_exr(path: &Path) -> Result<Checked, InputError> {
    let (channels, metadata) = retina_batch::read_exr(path)?;
    let names: Vec<&str> = channels.channels.iter().map(|(name, _)| name.as_str()).collect();
    let mut out = Checked::new("linear image").says(format!(
        "{} x {} px; channels {}",
        channels.width_px,
        channels.height_px,
        names.join(", ")
    ));
    out.schema = metadata
        .and_then(|text| serde_json::from_str::<Value>(&text).ok())
        .and_then(|document| document["schema"].as_str().map(str::to_owned));
    Ok(out)
}

pub(super) fn check_lenses(path: &Path) -> Result<Checked, InputError> {
    let mut out = lenses(&retina_optics::read_system(path, &[])?).says("`retina optics` analyses it");
    out.kind = "lens system of Zemax".to_owned();
    out.schema = None;
    Ok(out)
}

pub(super) fn check_glasses(path: &Path) -> Result<Checked, InputError> {
    let glasses = retina_optics::glass::read_agf(path)?;
    Ok(Checked::new("glass catalogue").says(format!("{} glasses; `--agf FILE` takes it", glasses.len())))
}

pub(super) fn check_kernel(path: &Path) -> Result<Checked, InputError> {
    let mut out = Checked::new("SPICE kernel");
    for said in kernel_contents(path)? {
        out = out.says(said);
    }
    // What a meta-kernel names must fit together.
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("tm")) {
        let turned = Ephemeris::read(&[path.to_path_buf()])?.turned_bodies();
        if !turned.is_empty() {
            out = out.says(format!("together they turn {}", turned.join(", ")));
        }
    }
    Ok(out.says("a scene names it in `[ephemeris] kernels`"))
}
