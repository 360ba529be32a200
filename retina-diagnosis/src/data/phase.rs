//! `phase.csv` as data: magnitudes against those of a smooth Lambert sphere.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use retina_files::InputError;
use retina_formats::{Channel, PhaseTable, TableKind};

use super::read::{
    Baseline, Named, Source, add_made, bits, bits_of, covariates, first_file, leave_out_lacking, repeated,
    stated,
};
use super::{Covariate, Dataset, DisplayDepth, Flip, Group, RowFrame};

/// Magnitude of a Lambert sphere at a phase angle (rad, 0 to pi) relative to full:
/// -2.5 log10 ((sin a + (pi - a) cos a) / pi) (Russell, Astrophysical Journal 43, 1916).
pub(crate) fn lambert_magnitude(phase_rad: f64) -> f64 {
    let a = phase_rad;
    -2.5 * ((a.sin() + (std::f64::consts::PI - a) * a.cos()) / std::f64::consts::PI).log10()
}

pub(super) fn read(_source: &Source<'_>, table: &PhaseTable) -> Result<Dataset, InputError> {
    let mut notes = Vec::new();
    let mut groups: BTreeMap<(usize, String), Vec<usize>> = BTreeMap::new();
    for (at, row) in table.rows.iter().enumerate() {
        let key = match row.night.as_ref().or(row.series.as_ref()) {
            Some(name) => name.to_string(),
            None => format!("line {:09}", if row.line > 0 { row.line } else { at }),
        };
        groups.entry((row.file, key)).or_default().push(at);
    }
    let cells = |at: usize| {
        let row = &table.rows[at];
        let mut cells = vec![bits_of(&row.night), bits_of(&row.series)];
        cells.extend([row.phase_deg, row.magnitude].map(f64::to_bits));
        cells.extend(bits([row.sigma_mag, row.airmass]));
        cells.extend(table.extra.iter().map(|column| column.values[at].to_bits()));
        cells
    };
    let repeats = repeated(table.rows.len(), cells).len();
    if repeats > 0 {
        notes.push(format!("{repeats} rows repeat others in every cell"));
    }
    let row = |at: usize| &table.rows[at];
    let named: [Named<'_>; 2] =
        [("phase_deg", &|at| Some(row(at).phase_deg)), ("airmass", &|at| row(at).airmass)];
    leave_out_lacking(groups.values_mut(), &named, &table.extra, &mut notes);
    groups.retain(|_, rows| !rows.is_empty());
    let order: Vec<usize> = groups.values().flatten().copied().collect();
    let (mut phase, mut y, mut frame) = (Vec::new(), Vec::new(), Vec::new());
    for &at in &order {
        let row = &table.rows[at];
        phase.push(row.phase_deg);
        y.push(row.magnitude - lambert_magnitude(row.phase_deg.to_radians().abs()));
        frame.push(RowFrame { measured: [row.magnitude, 0.0], to_table: [[1.0, 0.0], [0.0, 0.0]] });
    }
    if phase.iter().all(|p| p.abs() <= std::f64::consts::PI) && phase.len() > 20 {
        return Err(InputError::new(first_file(&table.files), "all phase angles lie within 3.2 degrees")
            .at("column `phase_deg`")
            .help("radians? give degrees"));
    }
    let mut all = covariates(&table.files, &order, &named, &table.extra, &mut notes)?;
    let values = phase.iter().map(|p| p.abs()).collect();
    let absolute = Covariate { name: "absolute_phase_deg".to_owned(), values };
    add_made(first_file(&table.files), &mut all, vec![absolute])?;
    let stated = stated("sigma_mag", order.iter().map(|&at| row(at).sigma_mag), &mut notes);
    let noise_key = match &stated {
        Some(sigma) => sigma.iter().map(|sigma| sigma.ln()).collect(),
        None => vec![0.0; order.len()],
    };
    let rows = order.len();
    let groups = Group::in_order(groups.into_iter().map(|((_, name), rows)| (name, rows.len())));
    let jitters = groups.len() < rows;
    Ok(Dataset {
        kind: TableKind::Phase,
        y,
        groups,
        order,
        table_rows: table.rows.len(),
        in_part: false,
        saturated: 0,
        covariates: all,
        noise_key,
        isotropic_from_error: None,
        jitters,
        flip: Flip::Groups,
        wander: 0.0,
        stated,
        channel: vec![Channel::W; rows],
        white_share: [1.0 / 3.0; 3],
        mounting: vec![0; rows],
        roll_rad: vec![0.0],
        half_tan: 1.0,
        half_height: 1.0,
        display: None,
        default_lenses: false,
        display_depth: DisplayDepth::default(),
        form_error: Arc::default(),
        tracer: None,
        found_coma: None,
        found_gamma: None,
        screen_pixel_arcsec: 0.0,
        frame,
        baseline: Baseline::Physical,
        held: None,
        field: OnceLock::new(),
        pixels: None,
        lens: None,
        files: table.files.iter().map(|file| file.path.clone()).collect(),
        notes,
    })
}
