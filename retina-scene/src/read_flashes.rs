//! The table `[flashes]` of a scene and the CSV table that it names.

use std::path::Path;

use retina_files::{InputError, Table, hash_bytes, read_text};

use crate::file::FlashesTable;
use crate::flashes::{Flash, Flashes, RandomFlashes};

/// Magnitudes that something on a body's surface can have.
const MAGNITUDES: std::ops::RangeInclusive<f64> = -30.0..=30.0;
/// The longest duration and exposure, s: a day.
const LONGEST_S: f64 = 86_400.0;
/// More flashes than these in a frame are a mistake.
const MOST_A_FRAME: usize = 10_000;

/// Reads and checks the flashes of a scene with these bodies; `input` is told the table's hash.
pub(crate) fn read_flashes(
    path: &Path,
    table: &FlashesTable,
    bodies: &[String],
    input: &mut impl FnMut(String, String),
) -> Result<Flashes, InputError> {
    let refuse = |key: &str, found: String, expected: &str| {
        InputError::new(path, "the value does not fit")
            .at(format!("key `flashes.{key}`"))
            .found(found)
            .expected(expected)
    };
    let above_zero = |value: f64| value > 0.0 && value <= LONGEST_S;
    if !above_zero(table.exposure_s) {
        return Err(refuse("exposure_s", table.exposure_s.to_string(), "seconds above 0, a day at most"));
    }
    if let Some(from_m) = table.seen_from_m.filter(|m| !(m.is_finite() && *m > 0.0)) {
        return Err(refuse("seen_from_m", from_m.to_string(), "metres above 0"));
    }
    if table.table.is_none() && table.number.is_none() {
        return Err(InputError::new(path, "there are no flashes to show")
            .at("table `flashes`")
            .expected("a key `table`, or `number` with `magnitudes` and `durations_s`"));
    }
    let random = match (table.number, table.magnitudes, table.durations_s) {
        (None, None, None) => None,
        (Some(number), Some(magnitudes), Some(durations_s)) => {
            if !(1..=MOST_A_FRAME).contains(&number) {
                return Err(refuse("number", number.to_string(), "1 to 10000, in each frame"));
            }
            let [low, high] = magnitudes;
            if !(MAGNITUDES.contains(&low) && MAGNITUDES.contains(&high) && low <= high) {
                return Err(refuse(
                    "magnitudes",
                    format!("[{low}, {high}]"),
                    "two magnitudes in order, -30 to 30",
                ));
            }
            let [low, high] = durations_s;
            if !(above_zero(low) && above_zero(high) && low <= high) {
                return Err(refuse(
                    "durations_s",
                    format!("[{low}, {high}]"),
                    "two durations in order, above 0 s, a day at most",
                ));
            }
            let body = body_index(path, "key `flashes.body`", table.body.as_deref(), bodies)?;
            Some(RandomFlashes { number, body, magnitudes, durations_s })
        }
        (number, magnitudes, durations_s) => {
            let keys = [
                ("number", number.is_some()),
                ("magnitudes", magnitudes.is_some()),
                ("durations_s", durations_s.is_some()),
            ];
            let missing: Vec<&str> = keys.iter().filter(|(_, given)| !given).map(|(key, _)| *key).collect();
            return Err(InputError::new(
                path,
                "flashes that are drawn need a number, magnitudes and durations",
            )
            .at("table `flashes`")
            .expected(format!("`{}` too", missing.join("`, `"))));
        }
    };
    let listed = match &table.table {
        None => Vec::new(),
        Some(file) => {
            let file = path.parent().unwrap_or(Path::new("")).join(file);
            let text = read_text(&file).map_err(|error| error.named_by(path, "flashes.table"))?;
            input("flashes".into(), hash_bytes(text.as_bytes()));
            listed(path, &file, &text, table.body.as_deref(), bodies)?
        }
    };
    Ok(Flashes { exposure_s: table.exposure_s, seen_from_m: table.seen_from_m, listed, random })
}

/// The body that a name stands for; without one the only body.
fn body_index(path: &Path, place: &str, name: Option<&str>, bodies: &[String]) -> Result<usize, InputError> {
    let found = match (name, bodies) {
        (Some(name), _) => bodies.iter().position(|body| body == name),
        (None, [_]) => Some(0),
        (None, _) => None,
    };
    found.ok_or_else(|| {
        let error = InputError::new(path, "it is not clear on which body the flashes are").at(place);
        let error = match name {
            Some(name) => error.found(format!("`{name}`")),
            None => error.found(format!("no name, and {} bodies", bodies.len())),
        };
        error.expected(if bodies.is_empty() { "a scene with a body".to_owned() } else { bodies.join(", ") })
    })
}

/// The rows of the table; a column `body` names each flash's own.
fn listed(
    scene: &Path,
    file: &Path,
    text: &str,
    body: Option<&str>,
    bodies: &[String],
) -> Result<Vec<Flash>, InputError> {
    let table = Table::parse(file, text)?;
    let columns = ["time_s", "latitude_deg", "longitude_deg", "magnitude", "duration_s"];
    table.require(&columns)?;
    if let Some(other) =
        table.columns().iter().find(|name| *name != "body" && !columns.contains(&name.as_str()))
    {
        return Err(InputError::new(file, format!("there is no column `{other}`"))
            .line(1)
            .expected(format!("{} and body", columns.join(", "))));
    }
    if table.is_empty() {
        return Err(InputError::new(file, "holds no flashes").expected("a row for each"));
    }
    // Without a column the body is the same for all, and asked for once.
    let of_all =
        if table.has("body") { None } else { Some(body_index(scene, "key `flashes.body`", body, bodies)?) };
    (0..table.len())
        .map(|row| {
            let cell = |column: &str, fits: &dyn Fn(f64) -> bool, expected: &str| {
                let value = table.number(row, column)?;
                if fits(value) {
                    return Ok(value);
                }
                Err(InputError::new(file, "the value does not fit")
                    .cell(table.line(row), column)
                    .found(value)
                    .expected(expected))
            };
            let body = match of_all {
                Some(body) => body,
                None => {
                    let name = Some(table.text(row, "body")).filter(|name| !name.is_empty()).or(body);
                    body_index(file, &format!("line {}, column `body`", table.line(row)), name, bodies)?
                }
            };
            Ok(Flash {
                id: format!("flash {row}"),
                time_s: cell("time_s", &|v| v.is_finite(), "TDB seconds since J2000")?,
                duration_s: cell(
                    "duration_s",
                    &|v| v > 0.0 && v <= LONGEST_S,
                    "seconds above 0, a day at most",
                )?,
                body,
                latitude_rad: cell("latitude_deg", &|v| v.abs() <= 90.0, "-90 to 90 deg")?.to_radians(),
                longitude_rad: cell("longitude_deg", &|v| v.abs() <= 360.0, "-360 to 360 deg")?.to_radians(),
                magnitude: cell("magnitude", &|v| MAGNITUDES.contains(&v), "a magnitude, -30 to 30")?,
            })
        })
        .collect()
}
