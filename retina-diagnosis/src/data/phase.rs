//! `phase.csv` as data: magnitudes against those of a smooth Lambert sphere.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use retina_files::{InputError, Table};

use super::read::{Baseline, Place, Source, covariates, number_in};
use super::{Covariate, Dataset, Group, RowFrame, TableKind};

/// Magnitude of a Lambert sphere at a phase angle (rad, 0 to pi) relative to full:
/// -2.5 log10 ((sin a + (pi - a) cos a) / pi) (Russell, Astrophysical Journal 43, 1916).
pub(crate) fn lambert_magnitude(phase_rad: f64) -> f64 {
    let a = phase_rad;
    -2.5 * ((a.sin() + (std::f64::consts::PI - a) * a.cos()) / std::f64::consts::PI).log10()
}

pub(super) fn read(source: &Source<'_>, tables: &[Table]) -> Result<Dataset, InputError> {
    let mut notes = Vec::new();
    let mut groups: BTreeMap<(usize, String), Vec<Place>> = BTreeMap::new();
    let (mut table_rows, mut first_row) = (0, Vec::new());
    for (t, table) in tables.iter().enumerate() {
        table.require(&["phase_deg", "magnitude"])?;
        first_row.push(table_rows);
        table_rows += table.len();
        for row in 0..table.len() {
            let named = [table.text(row, "night"), table.text(row, "series")];
            let key = match named.iter().find(|name| !name.is_empty()) {
                Some(name) => (*name).to_owned(),
                None => format!("line {:09}", table.line(row)),
            };
            groups.entry((t, key)).or_default().push(Place { table: t, row });
        }
    }
    let places: Vec<Place> = groups.values().flatten().copied().collect();
    let order = places.iter().map(|p| first_row[p.table] + p.row).collect();
    let (mut phase, mut y, mut frame) = (Vec::new(), Vec::new(), Vec::new());
    for place in &places {
        let (table, row) = (&tables[place.table], place.row);
        let angle_deg =
            number_in(table, row, "phase_deg", -178.0..=178.0, "a signed phase angle within 178 deg")?;
        let magnitude = number_in(table, row, "magnitude", -60.0..=60.0, "a magnitude")?;
        phase.push(angle_deg);
        y.push(magnitude - lambert_magnitude(angle_deg.to_radians().abs()));
        frame.push(RowFrame { measured: [magnitude, 0.0], to_table: [[1.0, 0.0], [0.0, 0.0]] });
    }
    if phase.iter().all(|p| p.abs() <= std::f64::consts::PI) && phase.len() > 20 {
        return Err(InputError::new(tables[0].file(), "all phase angles lie within 3.2 degrees")
            .at("column `phase_deg`")
            .help("radians? give degrees"));
    }
    let mut all =
        covariates(tables, &places, &["magnitude", "sigma_mag", "night", "series"], &[], &mut notes)?;
    all.push(Covariate {
        name: "absolute_phase_deg".to_owned(),
        values: phase.iter().map(|p| p.abs()).collect(),
    });
    let mut noise_key = vec![0.0; places.len()];
    if tables.iter().all(|t| t.has("sigma_mag")) {
        for (i, place) in places.iter().enumerate() {
            noise_key[i] =
                number_in(&tables[place.table], place.row, "sigma_mag", 1e-9..=100.0, "a number above 0")?
                    .ln();
        }
    }
    let rows = places.len();
    let groups = Group::in_order(groups.into_iter().map(|((_, name), rows)| (name, rows.len())));
    let jitters = groups.len() < rows;
    Ok(Dataset {
        kind: TableKind::Phase,
        y,
        groups,
        order,
        table_rows,
        in_part: false,
        saturated: 0,
        covariates: all,
        noise_key,
        jitters,
        channel: vec![3; rows],
        mounting: vec![0; rows],
        roll_rad: vec![0.0],
        half_tan: 1.0,
        screen_pixel_arcsec: 0.0,
        frame,
        baseline: Baseline::Physical,
        held: None,
        field: OnceLock::new(),
        pixels: None,
        files: source.files.to_vec(),
        notes,
    })
}
