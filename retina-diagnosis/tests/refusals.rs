//! Input that cannot be used is refused or told of in words that say how to mend it.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::path::PathBuf;

use common::{Campaign, Point, setup};
use glam::DVec2;
use retina_diagnosis::{AddedEffect, Baseline, Dataset, DiagnoseOptions, Source, check_effects, diagnose};
use retina_files::InputError;
use retina_formats::Measurements;

fn nothing(p: &Point) -> DVec2 {
    p.r
}

fn read(text: &str) -> Result<Dataset, InputError> {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("table.csv");
    std::fs::write(&path, text).unwrap();
    let setup = setup();
    let tables = Measurements::read(&[path])?;
    let source = Source {
        tables: &tables,
        setup: &setup,
        calibration: None,
        response: None,
        baseline: Baseline::Physical,
    };
    Dataset::new(&source)
}

fn campaign(exposures: usize) -> Campaign {
    Campaign { rows: 400, exposures, ..Campaign::new(3) }
}

/// The table with column `name` changed in every row.
fn with_column(text: &str, name: &str, value: impl Fn(&str) -> String) -> String {
    let at = text.lines().next().unwrap().split(',').position(|n| n == name).unwrap();
    let mut out = String::new();
    for (k, line) in text.lines().enumerate() {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if k > 0 {
            cells[at] = value(&cells[at]);
        }
        out.push_str(&(cells.join(",") + "\n"));
    }
    out
}

#[test]
fn effects_say_which_column_would_make_them_testable() {
    let text = campaign(20).table(&setup(), &nothing);
    let constant = with_column(&text, "temperature_c", |_| "20".to_owned());
    let missing = with_column(&constant, "row_load", |_| String::new());
    let found = diagnose(&read(&missing).unwrap(), &[], &DiagnoseOptions { flips: 199, seed: 1 });
    let reason = |id: &str| {
        found.not_testable.iter().find(|n| n.effect == id).map(|n| n.reason.clone()).unwrap_or_default()
    };
    assert_eq!(reason("thermal_boresight"), "column `temperature_c` is constant");
    assert_eq!(reason("thermal_focal"), "column `temperature_c` is constant");
    assert_eq!(reason("row_loading_shift"), "column `row_load` is missing");
    assert_eq!(reason("lateral_colour"), "column `channel` is missing or constant");
    assert!(!found.candidates.iter().any(|c| c.effect == "thermal_focal"));
}

#[test]
fn few_exposures_are_cut_into_runs_of_rows() {
    let data = read(&campaign(5).table(&setup(), &nothing)).unwrap();
    let found = diagnose(&data, &[], &DiagnoseOptions { flips: 199, seed: 1 });
    let note = found.notes.iter().find(|note| note.contains("flipped")).unwrap();
    assert!(note.contains("5 groups (fewer than 8) were cut into 25 runs of rows"), "{note}");
}

#[test]
fn rows_that_repeat_are_refused_with_their_lines() {
    let text = campaign(10).table(&setup(), &nothing);
    let again = text.lines().nth(7).unwrap().to_owned();
    let error = read(&format!("{text}{again}\n")).unwrap_err();
    let told = format!("{error:?}");
    assert!(told.contains("repeats another in every cell") && told.contains("first is line 8"), "{told}");
}

#[test]
fn a_coordinate_that_is_constant_is_refused() {
    let text = campaign(10).table(&setup(), &nothing);
    let told =
        format!("{:?}", read(&with_column(&text, "camera_y_px", |_| "411.25".to_owned())).unwrap_err());
    assert!(told.contains("the same in all rows") && told.contains("column `camera_y_px`"), "{told}");
    let shown = |text: &str| with_column(text, "screen_x_px", |_| "960.5".to_owned());
    let told = format!("{:?}", read(&shown(&text)).unwrap_err());
    assert!(told.contains("the same in all rows") && told.contains("column `screen_x_px`"), "{told}");
    // Points of one column of the screen, which the camera sees in a line.
    let line = with_column(&shown(&text), "camera_x_px", |x| {
        (1024.0 + 1e-3 * x.parse::<f64>().unwrap()).to_string()
    });
    assert!(read(&line).is_ok());
}

/// In other units, mirrored, halved, shown beside the screen: refused or said. A camera that is turned is none of these.
#[test]
fn places_that_cannot_be_are_told() {
    let text = campaign(10).table(&setup(), &nothing);
    let scaled = |text: &str, column: &str, by: f64, plus: f64| {
        with_column(text, column, |c| (c.parse::<f64>().unwrap() * by + plus).to_string())
    };
    let both = |by: f64| scaled(&scaled(&text, "camera_x_px", by, 0.0), "camera_y_px", by, 0.0);
    let told = format!("{:?}", read(&both(3.45e-3)).unwrap_err());
    assert!(told.contains("do not follow the screen's") && told.contains("millimetres"), "{told}");
    let notes = |text: &str| read(text).unwrap().notes.join("; ");
    assert!(notes(&both(0.5)).contains("0.503 times as wide"), "{}", notes(&both(0.5)));
    assert!(notes(&scaled(&text, "camera_x_px", -1.0, 2048.0)).contains("mirrored"));
    assert!(notes(&scaled(&text, "screen_x_px", 1.0, 1500.0)).contains("off the screen"));
    let turned = scaled(&scaled(&text, "camera_x_px", -1.0, 2048.0), "camera_y_px", -1.0, 1536.0);
    for plain in [&text, &turned] {
        let said = notes(plain);
        assert!(!["times as wide", "mirrored", "off the"].iter().any(|word| said.contains(word)), "{said}");
    }
}

/// The noise of copies is none, and whatever they have in common is significant.
#[test]
fn copies_of_an_exposure_are_left_out_and_said() {
    let text = campaign(20).table(&setup(), &nothing);
    let first = text.lines().nth(2).unwrap().split(',').next().unwrap().to_owned();
    let copied: String = (0..12).fold(String::new(), |mut all, copy| {
        for row in text.lines().filter(|row| row.starts_with(&first)) {
            all += &row.replacen(&first, &format!("copy{copy}.png"), 1);
            all.push('\n');
        }
        all
    });
    let (own, with) = (read(&text).unwrap(), read(&format!("{text}{copied}")).unwrap());
    assert_eq!(own.len(), with.len());
    assert!(!own.notes.iter().any(|note| note.contains("copies")), "{:?}", own.notes);
    let note = with.notes.iter().find(|note| note.contains("copies")).unwrap();
    assert!(
        note.contains("12 of 32 exposures")
            && note.contains(&format!("`copy0.png` has every point where `{first}`")),
        "{note}"
    );
}

/// Rows of an exposure have no order of their own.
#[test]
fn the_order_of_rows_does_not_matter() {
    let text = campaign(12).table(&setup(), &nothing);
    let mut rows: Vec<&str> = text.lines().skip(1).collect();
    for exposure in rows.chunks_mut(400 / 12) {
        exposure.reverse();
    }
    let other = format!("{}\n{}\n", text.lines().next().unwrap(), rows.join("\n"));
    let white = |text: &str| {
        let found = diagnose(&read(text).unwrap(), &[], &DiagnoseOptions { flips: 199, seed: 1 });
        (found.noise.white, found.baseline_heldout_rms)
    };
    assert_eq!(white(&text), white(&other));
}

/// A regression with nearly as many columns as there are numbers leaves no errors, and that is no noise.
#[test]
fn few_rows_do_not_make_a_noise_of_nothing() {
    let campaign = Campaign { rows: 40, outliers: 0.0, ..campaign(40) };
    let data = read(&campaign.table(&setup(), &nothing)).unwrap();
    let found = diagnose(&data, &[], &DiagnoseOptions { flips: 199, seed: 1 });
    let part = found.noise.floor() / campaign.noise_arcsec.hypot(campaign.jitter_arcsec);
    assert!((0.7..1.5).contains(&part), "{part} {:?}", found.noise);
    assert!(found.noise.source[0].contains("rows are too few"), "{:?}", found.noise.source);
}

#[test]
fn units_are_checked_by_their_magnitude() {
    let text = campaign(10).table(&setup(), &nothing);
    let kelvin = with_column(&text, "temperature_c", |c| (c.parse::<f64>().unwrap() + 273.15).to_string());
    assert!(format!("{:?}", read(&kelvin).unwrap_err()).contains("kelvin? subtract 273.15"));
    let percent = with_column(&text, "row_load", |c| (c.parse::<f64>().unwrap() * 100.0).to_string());
    assert!(format!("{:?}", read(&percent).unwrap_err()).contains("not per cent"));
    let days = with_column(&text, "time_s", |c| (c.parse::<f64>().unwrap() / 86_400.0 * 0.1).to_string());
    assert!(format!("{:?}", read(&days).unwrap_err()).contains("days? multiply by 86400"));
}

#[test]
fn effects_and_formulas_that_do_not_fit_are_refused() {
    let data = read(&campaign(10).table(&setup(), &nothing)).unwrap();
    let refused = |text: &str| format!("{:?}", AddedEffect::read(text, &data).map(|_| ()).unwrap_err());
    assert!(refused("screen_tlt").contains("did you mean `screen_tilt`?"));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("own.toml");
    let own = |dx: &str, dy: &str| {
        let text = format!(
            "name = \"own\"\nunit = \"arcsec\"\ndx = \"{dx}\"\ndy = \"{dy}\"\n[parameters]\na = {{ start = 1.0 }}\nb = {{ start = 1.0 }}\n"
        );
        std::fs::write(&path, text).unwrap();
        AddedEffect::read(path.to_str().unwrap(), &data)
            .and_then(|effect| check_effects(&data, &[effect]))
            .map_err(|error| format!("{error:?}"))
            .unwrap_err()
    };
    // Two parameters of which only the product is told.
    assert!(own("a * b * row_load", "0").contains("cannot be told from the others"));
    // A shift is the baseline's.
    assert!(own("a", "b * row_load").contains("parameter `a` cannot be told"));
    assert!(own("a / (time_s - time_s)", "b * row_load").contains("is not finite at its start values"));
    assert!(own("a * row_lod", "b * row_load").contains("row_lod"));
}

/// A few empty cells cost their rows; many cost the column.
#[test]
fn rows_are_left_out_where_a_column_is_empty() {
    let text = campaign(20).table(&setup(), &nothing);
    let empty = |every: usize| -> String {
        let line = |(k, line): (usize, &str)| match k {
            0 => format!("{line},humidity\n"),
            k if k % every == 0 => format!("{line},\n"),
            k => format!("{line},{}\n", 40 + k % 7),
        };
        text.lines().enumerate().map(line).collect()
    };
    let few = read(&empty(40)).unwrap();
    assert_eq!(few.len(), read(&text).unwrap().len() - 10);
    assert!(few.covariate("humidity").is_some());
    let note = "rows left out, since the column `humidity` is empty there: 10";
    assert!(few.notes.iter().any(|n| n == note), "{:?}", few.notes);
    let many = read(&empty(3)).unwrap();
    assert_eq!((many.len(), many.covariate("humidity").is_some()), (read(&text).unwrap().len(), false));
}

/// `x` is the place in the field and `F` the light, whatever a table calls its own columns.
#[test]
fn columns_with_names_of_made_quantities_are_refused() {
    let text = campaign(20).table(&setup(), &nothing);
    for name in ["x", "r", "F", "log10_irradiance"] {
        let line = |(k, line): (usize, &str)| match k {
            0 => format!("{line},{name}\n"),
            k => format!("{line},{k}\n"),
        };
        let error = read(&text.lines().enumerate().map(line).collect::<String>()).err().unwrap();
        assert!(error.to_string().contains(&format!("column `{name}`")), "{error}");
    }
}
