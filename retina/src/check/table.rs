//! CSV: measurements, trajectories, plans.

use std::path::Path;

use retina_files::{InputError, Table, read_text};
use retina_formats::{FramesTable, Measurements, TableKind};
use retina_sky::trajectory::Trajectory;

use super::{Checked, Company};

pub(super) fn check_table(path: &Path, company: &Company) -> Result<Checked, InputError> {
    let table = Table::parse(path, &read_text(path)?)?;
    let has = |columns: &[&str]| columns.iter().all(|column| table.has(column));
    if has(&["time_s", "camera_x_m"]) {
        return trajectory(path, &table);
    }
    if has(&["image", "screen", "exposure_s"]) {
        return Ok(Checked::new("exposures of a plan (plan.csv, images.csv)")
            .says(format!("{} exposures; `retina decide` plans them", table.len()))
            .note("times and conditions are checked with the plan's folder"));
    }
    if has(&["screen", "point", "exposure_ratio"]) {
        return Ok(Checked::new("points of a pattern").says(format!("{} points", table.len())));
    }
    let kind = TableKind::of(&table).map_err(|error| {
        error.help(
            "trajectories have time_s and camera_x_m; docs/scene.md and docs/workbench.md list the columns",
        )
    })?;
    if kind == TableKind::Frames {
        let frames = FramesTable::read(path)?;
        return Ok(Checked::new("table of frames").says(format!(
            "{} pairs of predicted and measured images; `retina compare` and `retina diagnose` take them",
            frames.rows.len()
        )));
    }
    let tables = Measurements::read(&[path.to_path_buf()])?;
    let mut out = Checked::new(format!("measurements of {}", kind.name()));
    if let Measurements::Points(points) = &tables {
        out = out.says(format!("{} points in {} exposures", points.rows.len(), points.images.len()));
        let saturated = points.rows.iter().filter(|row| row.saturated).count();
        if saturated > 0 {
            out = out.note(format!("{saturated} points are saturated: fits leave them out"));
        }
        for file in &points.files {
            if let Some(stamp) = &file.setup {
                let name = stamp.name.clone();
                let known = company.setup(&name).is_some();
                out = out.says(format!("measured with the setup `{name}`"));
                if !known {
                    out = out
                        .note("give that setup on the same command line, and the two are held to each other");
                }
            }
            if let Some(note) = &file.note {
                out = out.note(note.clone());
            }
        }
    } else {
        out = out.says(format!("{} rows", table.len()));
    }
    let absent: Vec<&str> =
        ["time_s", "temperature_c"].into_iter().filter(|column| !table.has(column)).collect();
    if !absent.is_empty() && kind == TableKind::Points {
        out = out.note(format!("without {}: effects of it cannot be told", absent.join(", ")));
    }
    let Some(data) = company.dataset(&tables)? else {
        return Ok(
            out.note("whether `retina compare`, `diagnose` and `fit` take it shows with its setup: give one")
        );
    };
    Ok(data.notes.into_iter().fold(out.says("`retina compare`, `diagnose` and `fit` take it"), Checked::note))
}

fn trajectory(path: &Path, table: &Table) -> Result<Checked, InputError> {
    // Bodies are named by their columns: NAME_x_m and so on, beside those of the camera and the Sun.
    let names: Vec<String> = table
        .columns()
        .iter()
        .filter_map(|column| column.strip_suffix("_x_m"))
        .filter(|name| !["camera", "sun"].contains(name))
        .map(str::to_owned)
        .collect();
    let poses = Trajectory::read(path, &names)?;
    let times = (poses.frames.first(), poses.frames.last());
    let span_s = times.0.zip(times.1).map_or(0.0, |(first, last)| last.time_s - first.time_s);
    let mut out = Checked::new("trajectory").says(format!(
        "{} frames over {span_s} s; a scene names it by `trajectory = \"...\"`",
        poses.frames.len()
    ));
    if !names.is_empty() {
        out = out.says(format!("bodies: {}", names.join(", ")));
    }
    Ok(out)
}
