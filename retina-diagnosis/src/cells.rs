//! Patterns of cells in which rows are neighbours.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::data::{Dataset, RowFrame};
use crate::screens::{ranks, screened};

/// Coarsest squares over the field: a quarter of its width.
const COARSEST: f64 = 0.25;
/// Halvings of squares and of stripes, at most; cells that hold too few pairs say nothing and are left out later.
const HALVINGS: usize = 9;
/// Stretches of a column, of equal numbers of rows.
const STRETCHES: [usize; 4] = [8, 24, 72, 216];
/// Stretches of each of two columns.
const STRETCHES_OF_TWO: usize = 12;
/// Parts of a pixel.
const PHASES: [usize; 2] = [12, 40];
/// Most columns of which pairs are looked at, and whose halves turn the sign of the field.
const MOST_COLUMNS: usize = 8;

/// One pattern.
#[derive(Debug, Clone)]
pub(crate) struct Cells {
    /// The columns that it is made of.
    pub(crate) covariates: Vec<String>,
    /// Width in pixels of the screen.
    pub(crate) width_px: Option<f64>,
    /// Each row's cell.
    pub(crate) of_row: Vec<u32>,
    /// Signs of the rows: what changes its sign with a column is no longer averaged away.
    pub(crate) sign: Option<Vec<f64>>,
}

impl Cells {
    /// Of a row that is in no cell.
    pub(crate) const NONE: u32 = u32::MAX;

    fn new(
        covariates: &[&str],
        width_px: Option<f64>,
        places: impl Iterator<Item = Option<[i64; 3]>>,
    ) -> Self {
        let mut known: HashMap<[i64; 3], u32> = HashMap::new();
        let of_row = places
            .map(|place| {
                place.map_or(Self::NONE, |place| {
                    let next = known.len() as u32;
                    *known.entry(place).or_insert(next)
                })
            })
            .collect();
        Self {
            covariates: covariates.iter().map(|name| (*name).to_owned()).collect(),
            width_px,
            of_row,
            sign: None,
        }
    }
}

/// A pattern that is still to be made: each takes a while, and they are made side by side.
type Planned<'a> = Box<dyn Fn() -> Cells + Send + Sync + 'a>;

/// All patterns of a table.
pub(crate) fn cells(data: &Dataset) -> Vec<Cells> {
    let names = screened(data);
    let ranked: Vec<Vec<f64>> = names.par_iter().map(|name| ranks(data.values(name))).collect();
    planned(data, &names, &ranked).par_iter().map(|planned| planned()).collect()
}

fn planned<'a>(data: &'a Dataset, names: &'a [&'a str], ranked: &'a [Vec<f64>]) -> Vec<Planned<'a>> {
    let mut out = if data.components() == 2 { of_field(data) } else { Vec::new() };
    let stretch = |rank: f64, count: usize| -> Option<i64> {
        (!rank.is_nan()).then(|| ((0.5 * (rank + 1.0) * count as f64) as i64).min(count as i64 - 1))
    };
    for (name, rank) in names.iter().zip(ranked) {
        if name.contains("_phase_") {
            for count in PHASES {
                let cell = move |phase: &f64| Some([(phase * count as f64).floor() as i64, 0, 0]);
                out.push(Box::new(move || Cells::new(&[name], None, data.values(name).iter().map(cell))));
            }
            continue;
        }
        for count in STRETCHES {
            let cell = move |rank: &f64| Some([stretch(*rank, count)?, 0, 0]);
            out.push(Box::new(move || Cells::new(&[name], None, rank.iter().map(cell))));
        }
    }
    let plain: Vec<usize> =
        (0..names.len()).filter(|&k| !names[k].contains("_phase_")).take(MOST_COLUMNS).collect();
    for (i, &a) in plain.iter().enumerate() {
        for &b in &plain[..i] {
            let cell = move |(p, q): (&f64, &f64)| {
                Some([stretch(*p, STRETCHES_OF_TWO)?, stretch(*q, STRETCHES_OF_TWO)?, 0])
            };
            let both = move || ranked[a].iter().zip(&ranked[b]).map(cell);
            out.push(Box::new(move || Cells::new(&[names[b], names[a]], None, both())));
        }
    }
    if data.components() == 2 {
        // What turns its sign with a column, at three scales of the field.
        for &k in &plain {
            for width in [0.25, 0.08, 0.025] {
                out.push(Box::new(move || {
                    let sign = ranked[k].iter().map(|r| if *r > 0.0 { 1.0 } else { -1.0 });
                    let mut squares = squares(data, width, 0.0);
                    squares.covariates.insert(0, names[k].to_owned());
                    squares.sign = Some(sign.collect());
                    squares
                }));
            }
        }
    }
    out
}

/// Squares and stripes of the field, and stripes of the camera's image.
fn of_field(data: &Dataset) -> Vec<Planned<'_>> {
    let mut out: Vec<Planned<'_>> = Vec::new();
    let widths = (0..HALVINGS).map(|halving| COARSEST * 0.5f64.powi(halving as i32));
    for width in widths.clone() {
        for shift in [0.0, 0.5] {
            out.push(Box::new(move || squares(data, width, shift)));
        }
    }
    let px = px_of_x(data);
    for (axis, name) in ["x", "y"].into_iter().enumerate() {
        for width in widths.clone() {
            let cell = move |v: &f64| Some([(v / width).floor() as i64, 0, 0]);
            let places = move || data.values(name).iter().map(cell);
            out.push(Box::new(move || Cells::new(&[name], Some(width * px), places())));
        }
        // Columns and rows of the camera, which the display's are not: the camera may be turned, and is distorted.
        for width_px in [1.0, 2.0, 4.0, 8.0] {
            let cell = move |frame: &RowFrame| Some([(frame.measured[axis] / width_px).floor() as i64, 0, 0]);
            let places = move || data.frame.iter().map(cell);
            out.push(Box::new(move || Cells::new(&[name], Some(width_px), places())));
        }
    }
    out
}

/// Pixels of the screen in a unit of x.
pub(crate) fn px_of_x(data: &Dataset) -> f64 {
    data.half_tan * retina_geometry::ARCSEC_PER_RAD / data.screen_pixel_arcsec.max(f64::MIN_POSITIVE)
}

/// Squares of a width in units of x, each mounting and colour by itself in the same cells, shifted by a part of a square.
fn squares(data: &Dataset, width: f64, shift: f64) -> Cells {
    let (x, y) = (data.values("x"), data.values("y"));
    let cell = |v: f64| (v / width + shift).floor() as i64;
    let places = x.iter().zip(y).map(|(x, y)| Some([cell(*x), cell(*y), 0]));
    Cells::new(&["x", "y"], Some(width * px_of_x(data)), places)
}
