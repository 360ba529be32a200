//! `power.csv` as data: irradiance relative to what the nominal response, or a calibrated one, gives.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use faer::Mat;
use retina_files::InputError;
use retina_formats::{Channel, ChannelCurve, PowerRow, PowerTable, RadiometricCalibration, TableKind};

use super::read::{
    Baseline, Named, Source, add_made, bits, bits_of, covariates, first_file, leave_out_lacking, repeated,
    stated,
};
use crate::field::Held;
use crate::linear::cholesky;

use super::{Covariate, Dataset, DisplayDepth, Flip, Group, RowFrame, Term};

/// A series' name, or that of the setting where a row has none.
fn group_of(row: &PowerRow) -> String {
    match &row.series {
        Some(series) => series.to_string(),
        None => format!("{}/{}/{}", row.channel.letter(), row.digital_count, row.square_px),
    }
}

/// Number of rows that repeat others: a meter that rounds may well show the same twice.
fn repeats(table: &PowerTable) -> usize {
    let cells = |at: usize| {
        let row = &table.rows[at];
        let mut cells = vec![bits_of(&row.series), row.channel as u64];
        cells.extend([row.digital_count, row.square_px, row.irradiance_w_m2].map(f64::to_bits));
        cells.extend(bits([row.sigma_w_m2, row.time_s, row.temperature_c]));
        cells.extend(table.extra.iter().map(|column| column.values[at].to_bits()));
        cells
    };
    repeated(table.rows.len(), cells).len()
}

pub(super) fn read(source: &Source<'_>, table: &PowerTable) -> Result<Dataset, InputError> {
    let mut notes = Vec::new();
    let mut groups: BTreeMap<(usize, String), Vec<usize>> = BTreeMap::new();
    for (at, row) in table.rows.iter().enumerate() {
        groups.entry((row.file, group_of(row))).or_default().push(at);
    }
    let by_setting = table.rows.iter().any(|row| row.series.is_none());
    if by_setting {
        notes.push("rows without a series are grouped by channel, count and square".to_owned());
    }
    let repeats = repeats(table);
    if repeats > 0 {
        notes.push(format!("{repeats} rows repeat others in every cell"));
    }
    let row = |at: usize| &table.rows[at];
    let named: [Named<'_>; 4] = [
        ("digital_count", &|at| Some(row(at).digital_count)),
        ("square_px", &|at| Some(row(at).square_px)),
        ("time_s", &|at| row(at).time_s),
        ("temperature_c", &|at| row(at).temperature_c),
    ];
    leave_out_lacking(groups.values_mut(), &named, &table.extra, &mut notes);
    groups.retain(|_, rows| !rows.is_empty());
    let order: Vec<usize> = groups.values().flatten().copied().collect();
    let file = first_file(&table.files);
    let gamma = source.setup.response_gamma();
    let (mut measured, mut nominal, mut channel) = (Vec::new(), Vec::new(), Vec::new());
    let (mut level, mut square) = (Vec::new(), Vec::new());
    for &at in &order {
        let row = &table.rows[at];
        let (count, side, lit) = (row.digital_count, row.square_px, row.channel);
        channel.push(lit);
        level.push(count / 255.0);
        square.push(side);
        let pixel = match source.response {
            Some(response) => lit.lit().map(|c| light(&response.channels[c], count)).sum(),
            None => (count / 255.0).powf(gamma) * lit.lit().len() as f64 / 3.0,
        };
        nominal.push(side * side * pixel);
        measured.push(row.irradiance_w_m2);
    }
    // The gain is a median, so that neither an effect nor an outlier turns the scale.
    let zero = source.response.map_or(0.0, zero_w_m2);
    let mut ratios: Vec<f64> =
        measured.iter().zip(&nominal).filter(|(_, n)| **n > 0.0).map(|(m, n)| (m - zero) / n).collect();
    if ratios.is_empty() {
        return Err(InputError::new(file, "holds dark readings alone").expected("readings of lit squares"));
    }
    let middle = ratios.len() / 2;
    let gain = *ratios.select_nth_unstable_by(middle, f64::total_cmp).1;
    if gain <= 0.0 {
        return Err(InputError::new(file, "half of the irradiances are not above 0").found(gain));
    }
    let faintest = nominal.iter().copied().filter(|n| *n > 0.0).fold(f64::INFINITY, f64::min);
    let scale: Vec<f64> = nominal.iter().map(|n| gain * n.max(faintest)).collect();
    let y = (0..order.len()).map(|i| (measured[i] - zero - nominal[i] * gain) / scale[i]).collect();
    let mut all = covariates(&table.files, &order, &named, &table.extra, &mut notes)?;
    let mut made: Vec<Covariate> = Vec::new();
    let mut add = |name: &str, values: Vec<f64>| made.push(Covariate { name: name.to_owned(), values });
    // Natural logarithms; dark readings stand at the faintest lit one.
    add("ln_irradiance", nominal.iter().map(|n| n.max(faintest).ln()).collect());
    add("level", level.clone());
    add("per_irradiance", scale.iter().map(|s| 1.0 / s).collect());
    add("lit", nominal.iter().map(|n| f64::from(u8::from(*n > 0.0))).collect());
    for (of, name) in Channel::ALL.into_iter().zip(["channel_r", "channel_g", "channel_b", "channel_w"]) {
        add(name, channel.iter().map(|c| f64::from(u8::from(*c == of))).collect());
    }
    add_made(file, &mut all, made)?;
    let mut noise_key: Vec<f64> = nominal.iter().map(|n| -n.max(faintest).ln()).collect();
    let stated: Option<Vec<f64>> =
        stated("sigma_w_m2", order.iter().map(|&at| row(at).sigma_w_m2), &mut notes)
            .map(|sigma| sigma.iter().zip(&scale).map(|(sigma, scale)| sigma / scale).collect());
    if let Some(stated) = &stated {
        noise_key = stated.iter().map(|sigma| sigma.ln()).collect();
    }
    let held = source.response.map(|response| {
        let lit = |row: usize| channel[row].lit();
        Held::Response(open_columns(
            response,
            order.len(),
            &lit,
            &|row| (square[row], level[row] * 255.0),
            &scale,
        ))
    });
    let white_share = source.response.map_or([1.0 / 3.0; 3], |response| {
        let full = [0, 1, 2].map(|c| light(&response.channels[c], 255.0));
        full.map(|own| own / full.iter().sum::<f64>())
    });
    let rows = order.len();
    let groups = Group::in_order(groups.into_iter().map(|((_, name), rows)| (name, rows.len())));
    Ok(Dataset {
        kind: TableKind::Power,
        y,
        groups,
        order,
        table_rows: table.rows.len(),
        in_part: false,
        saturated: 0,
        covariates: all,
        noise_key,
        isotropic_from_error: None,
        jitters: !by_setting,
        flip: Flip::Groups,
        wander: 0.0,
        stated,
        channel,
        white_share,
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
        frame: (0..rows)
            .map(|i| RowFrame { measured: [measured[i], 0.0], to_table: [[scale[i], 0.0], [0.0, 0.0]] })
            .collect(),
        baseline: Baseline::Physical,
        held,
        field: OnceLock::new(),
        pixels: None,
        lens: None,
        files: table.files.iter().map(|file| file.path.clone()).collect(),
        notes,
    })
}

/// A pixel's light, W m^-2; straight between whole counts.
fn light(curve: &ChannelCurve, count: f64) -> f64 {
    let below = (count.floor() as usize).min(254);
    let (low, high) = (curve.irradiance_w_m2[below], curve.irradiance_w_m2[below + 1]);
    low + (count - below as f64) * (high - low)
}

/// The reading without a lit square: one meter's, told three times.
fn zero_w_m2(response: &RadiometricCalibration) -> f64 {
    let zeros: Vec<f64> = response.channels.iter().filter_map(|curve| curve.zero_w_m2).collect();
    zeros.iter().sum::<f64>() / zeros.len().max(1) as f64
}

/// What a response's covariance leaves open of each reading over `scale`, as independent columns of unit variance: with
/// C = L L^T and the derivatives g by its unknowns they are g L.
fn open_columns(
    response: &RadiometricCalibration,
    rows: usize,
    lit: &dyn Fn(usize) -> std::ops::Range<usize>,
    square_and_count: &dyn Fn(usize) -> (f64, f64),
    scale: &[f64],
) -> Vec<Vec<f64>> {
    let mut out = Vec::new();
    for (c, curve) in response.channels.iter().enumerate() {
        let side = curve.covariance.len();
        // A gain in units of full light and a zero in W m^-2 are parts of one matrix: it is made of unit diagonal first.
        let unit: Vec<f64> = (0..side).map(|k| curve.covariance[k][k].max(0.0).sqrt()).collect();
        let correlation = Mat::<f64>::from_fn(side, side, |i, j| {
            let product = unit[i] * unit[j];
            if product > 0.0 { curve.covariance[i][j] / product } else { f64::from(u8::from(i == j)) }
        });
        let Some(factor) = cholesky(&correlation) else { continue };
        let dark = curve.irradiance_w_m2[0];
        for column in 0..side {
            out.push(
                (0..rows)
                    .map(|row| {
                        if !lit(row).contains(&c) {
                            return 0.0;
                        }
                        let (square, count) = square_and_count(row);
                        let area = square * square;
                        let above = area * (light(curve, count) - dark);
                        let slope = if count > 0.0 { (count / 255.0).ln() } else { 0.0 };
                        let by = [above, above * slope, area, 1.0 / lit(row).len() as f64];
                        let sum: f64 =
                            (column..side.min(4)).map(|k| by[k] * unit[k] * factor[(k, column)]).sum();
                        sum / scale[row]
                    })
                    .collect(),
            );
        }
    }
    out
}

/// One gain: dark readings have no light to scale. Beside a response that is held also the optics' fall-off across the
/// square, relative illumination 1 - c r^2 averaged over it, which no response of a pixel has.
pub(super) fn baseline(data: &Dataset) -> Vec<Term<'_>> {
    let lit = data.values("lit");
    let mut out = vec![Term::new("gain_relative", move |i| [lit[i], 0.0])];
    if data.held.is_some()
        && let Some(square) = data.varying("square_px")
    {
        let most = square.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        out.push(Term::new("fall_off_at_largest", move |i| [lit[i] * (square[i] / most).powi(2), 0.0]));
    }
    out
}
