//! Any of the tables as one kind of data: residuals of one or two components, groups, covariates.

mod copies;
mod frames;
mod lens;
mod lens_choice;
mod phase;
mod places;
mod points;
mod power;
mod read;
mod scale;

use std::borrow::Cow;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

pub(crate) use frames::term as pixel_term;
pub use frames::{MOST_PIXELS, Measure, PixelColumn, PixelEffect, PixelForm, PixelPart, Pixels, Placement};
use glam::{DMat2, DVec2};
pub(crate) use lens::longer_focal;
pub use lens::{FittedLens, lens_of_fit};
pub(crate) use phase::lambert_magnitude;
pub use read::{Baseline, Source};
pub(crate) use retina_geometry::ARCSEC_PER_RAD;
use retina_geometry::{ComaForm, ComaTracer, SpotShifts};

use retina_formats::{Channel, TableKind};

use crate::field::{Field, Held};
use crate::following::read_column;
use crate::form_error::FormError;

/// A column over the rows: its name and its value(s) in a row, in units of the data per unit of its amplitude.
pub(crate) struct Term<'a> {
    pub(crate) name: String,
    /// Amplitudes that something real may have.
    pub(crate) plausible: Option<[f64; 2]>,
    pub(crate) value: Box<dyn Fn(usize) -> [f64; 2] + Send + Sync + 'a>,
}

impl<'a> Term<'a> {
    pub(crate) fn new(name: impl Into<String>, value: impl Fn(usize) -> [f64; 2] + Send + Sync + 'a) -> Self {
        Self { name: name.into(), plausible: None, value: Box::new(value) }
    }
}

/// What residuals may depend on.
#[derive(Debug, Clone)]
pub struct Covariate {
    /// The column's name, or that of a quantity made of columns.
    pub name: String,
    /// Its value in each row, in the data's order; NaN where the row has none.
    pub values: Vec<f64>,
}

impl Covariate {
    /// Whether it takes more than one value.
    pub(crate) fn varies(&self) -> bool {
        let (low, high) = self.range();
        high - low > 1e-9 * high.abs().max(low.abs()).max(1e-300)
    }

    pub(crate) fn range(&self) -> (f64, f64) {
        self.values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)))
    }
}

/// Rows that share their errors: an exposure, a series, a night.
#[derive(Debug, Clone)]
pub struct Group {
    /// Its name in the table.
    pub name: String,
    /// Its rows, in the data's order.
    pub rows: Range<usize>,
}

impl Group {
    /// Groups one after the other, from their names and numbers of rows.
    fn in_order(groups: impl Iterator<Item = (String, usize)>) -> Vec<Self> {
        let mut start = 0;
        groups
            .map(|(name, count)| {
                start += count;
                Self { name, rows: start - count..start }
            })
            .collect()
    }
}

/// What a draw from the null gives one sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Flip {
    /// Whole groups.
    Groups,
    /// Runs of rows within groups.
    Rows,
}

/// A table ready to be explained; rows are sorted by group.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// Which table.
    pub kind: TableKind,
    /// Measured minus the fixed part of the model, components of a row side by side; arcsec, relative or mag.
    pub y: Vec<f64>,
    /// Groups, covering all rows.
    pub groups: Vec<Group>,
    /// For each row: its number among the files' rows.
    pub order: Vec<usize>,
    /// Rows of the files, used or not.
    pub table_rows: usize,
    /// Whether the files were read in part, being too long.
    pub in_part: bool,
    /// Rows left out beforehand (saturated).
    pub saturated: usize,
    /// What residuals may depend on.
    pub covariates: Vec<Covariate>,
    /// ln of a quantity that the noise depends on.
    pub(crate) noise_key: Vec<f64>,
    /// For each row (points): what makes the scatter of its error the same along both axes and keeps its mean square.
    pub(crate) isotropic_from_error: Option<Vec<DMat2>>,
    /// Whether the groups are the same setting repeated or single rows: they then have no common error.
    pub(crate) jitters: bool,
    /// What a draw from the null gives one sign.
    pub(crate) flip: Flip,
    /// Correlation of a group's common error with that of the next one in time.
    pub(crate) wander: f64,
    /// Standard deviation of each row as the table states it, in the unit of `y`.
    pub(crate) stated: Option<Vec<f64>>,
    /// The lit channel of each row.
    pub(crate) channel: Vec<Channel>,
    /// Shares of red, green and blue in white light (power).
    pub(crate) white_share: [f64; 3],
    /// Which mounting (file or number, and camera roll) a row belongs to.
    pub(crate) mounting: Vec<usize>,
    /// For each mounting the angle by which the camera is turned in the facility's frame, rad.
    pub(crate) roll_rad: Vec<f64>,
    /// Scale that makes covariates x and y about 1 at the camera's edge: tangent of half its width (points).
    pub(crate) half_tan: f64,
    /// The y of the camera's upper and lower edge, where x is 1 at the others: its height over its width (points).
    pub(crate) half_height: f64,
    /// What the lenses make of the display's depth, where they are known (points).
    pub(crate) display: Option<SpotShifts>,
    /// Whether these are the default ones, which no setup names.
    pub(crate) default_lenses: bool,
    /// Where the display stands, as far as that is known: the forms of its tilt and bow are those about this place.
    pub(crate) display_depth: DisplayDepth,
    /// Traces the lenses with a coma that was found.
    pub(crate) tracer: Option<Arc<dyn ComaTracer>>,
    /// That coma's form, which is then the only one.
    pub(crate) found_coma: Option<ComaForm>,
    /// What the forms of effects that were found may be off by on lenses as they were built (points).
    pub(crate) form_error: Arc<FormError>,
    /// A display's exponent that was found, about which its form is made (power).
    pub(crate) found_gamma: Option<FoundGamma>,
    /// One pixel of the screen in arcsec (points).
    pub(crate) screen_pixel_arcsec: f64,
    /// Fixed part of the model plus y, in the table's own units: what is needed to write predictions.
    pub(crate) frame: Vec<RowFrame>,
    /// The baseline.
    pub(crate) baseline: Baseline,
    /// A calibration that is held fixed, on these rows.
    pub(crate) held: Option<Held>,
    /// Its error's columns, made when they are first asked for.
    pub(crate) field: OnceLock<Field>,
    /// The pixels, of a table of frames.
    pub(crate) pixels: Option<Arc<Pixels>>,
    /// The lens model that the baseline's columns are derivatives of.
    pub(crate) lens: Option<Arc<FittedLens>>,
    /// The files.
    pub files: Vec<PathBuf>,
    /// What the user ought to know of how it was read.
    pub notes: Vec<String>,
}

/// Amplitudes of the display's tilt and bow, arcsec, each along its two axes.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct DisplayDepth {
    pub(crate) tilt: [f64; 2],
    pub(crate) bow: [f64; 2],
}

/// Readings are gain (B / 255)^exponent times the nominal ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FoundGamma {
    pub(crate) exponent: f64,
    pub(crate) gain: f64,
}

/// How a row's residual goes back to the table's own units.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct RowFrame {
    /// The table's measured value: camera px, W/m^2, mag.
    pub(crate) measured: [f64; 2],
    /// Matrix (rows) from y's units to the table's.
    pub(crate) to_table: [[f64; 2]; 2],
}

impl Dataset {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Where the axis of the facility's lenses is seen, tangents: as a calibration that is held tells it, else on the
    /// boresight.
    pub(crate) fn lens_axis(&self) -> DVec2 {
        let of_rings = |held: &Held| match held {
            Held::Geometry(model) => model.lens_axis(),
            Held::Response(_) => None,
        };
        self.held.as_ref().and_then(of_rings).unwrap_or_default()
    }

    /// Distance of a place (halves of the camera's width) from that axis, tangents.
    pub(crate) fn distance_from_axis(&self, place: DVec2) -> f64 {
        (self.half_tan * place - self.lens_axis()).length()
    }

    /// The same data of a facility whose lenses are known: effects of the display's place have the forms that its lenses
    /// give them, and come as tilts in degrees and sags in micrometres.
    #[must_use]
    pub fn with_spot_shifts(mut self, rays: SpotShifts) -> Self {
        self.display = Some(rays);
        self
    }

    /// And no setup names these lenses: what rests on them is told.
    #[must_use]
    pub fn with_default_lenses(mut self) -> Self {
        self.default_lenses = true;
        self
    }

    /// And the lenses can be traced anew with a coma that is found.
    #[must_use]
    pub fn with_coma_tracer(mut self, tracer: Arc<dyn ComaTracer>) -> Self {
        self.tracer = Some(tracer);
        self
    }

    /// Every n-th group, so that about `most` rows are left; `None` where there are no more than that.
    pub(crate) fn thinned(&self, most: usize) -> Option<Self> {
        let stride = self.len().div_ceil(most);
        // Pixels are few enough from the start, and their columns are made.
        if stride < 2 || self.groups.len() < 2 * stride || self.pixels.is_some() {
            return None;
        }
        let rows: Vec<usize> = self.groups.iter().step_by(stride).flat_map(|g| g.rows.clone()).collect();
        let mut out = self.of_rows(&rows);
        out.notes.push(format!(
            "{} of {} rows were looked at, those of one group in {stride}",
            rows.len(),
            self.len()
        ));
        Some(out)
    }

    /// For each line of the tables its row; `None` for lines that are left out.
    pub(crate) fn rows_of_lines(&self) -> Vec<Option<usize>> {
        let mut out = vec![None; self.table_rows];
        for (row, &line) in self.order.iter().enumerate() {
            out[line] = Some(row);
        }
        out
    }

    /// Values over the components of the rows in the order of the tables' lines; NaN for lines that are left out.
    pub fn in_table_order(&self, values: &[f64]) -> Vec<f64> {
        let n = self.components();
        let of_line =
            |row: Option<usize>| (0..n).map(move |k| row.map_or(f64::NAN, |row| values[n * row + k]));
        self.rows_of_lines().into_iter().flat_map(of_line).collect()
    }

    /// Some of the rows, in their order. Groups of which none is left are gone. Not for pixels.
    pub(crate) fn of_rows(&self, rows: &[usize]) -> Self {
        let n = self.kind.components();
        let mut groups: Vec<Group> = Vec::new();
        for group in &self.groups {
            let start = rows.partition_point(|row| *row < group.rows.start);
            let end = rows.partition_point(|row| *row < group.rows.end);
            if end > start {
                groups.push(Group { name: group.name.clone(), rows: start..end });
            }
        }
        fn of<T: Copy>(rows: &[usize], values: &[T]) -> Vec<T> {
            rows.iter().map(|&row| values[row]).collect()
        }
        Self {
            y: rows.iter().flat_map(|&row| self.y[row * n..(row + 1) * n].iter().copied()).collect(),
            groups,
            order: of(rows, &self.order),
            covariates: self
                .covariates
                .iter()
                .map(|c| Covariate { name: c.name.clone(), values: of(rows, &c.values) })
                .collect(),
            noise_key: of(rows, &self.noise_key),
            isotropic_from_error: self.isotropic_from_error.as_ref().map(|isotropic| of(rows, isotropic)),
            stated: self.stated.as_ref().map(|stated| of(rows, stated)),
            channel: of(rows, &self.channel),
            mounting: of(rows, &self.mounting),
            frame: of(rows, &self.frame),
            roll_rad: self.roll_rad.clone(),
            files: self.files.clone(),
            notes: self.notes.clone(),
            held: self.held.as_ref().map(|held| held.of_rows(rows)),
            form_error: Arc::new(self.form_error.of_rows(rows)),
            field: OnceLock::new(),
            pixels: None,
            lens: self.lens.clone(),
            tracer: self.tracer.clone(),
            ..*self
        }
    }

    /// What makes a row's error isotropic.
    pub(crate) fn isotropic(&self, row: usize) -> DMat2 {
        self.isotropic_from_error.as_ref().map_or(DMat2::IDENTITY, |isotropic| isotropic[row])
    }

    /// The same data beside forms that may be off.
    pub(crate) fn with_form_error(&self, form_error: FormError) -> Self {
        Self { form_error: Arc::new(form_error), field: OnceLock::new(), ..self.clone() }
    }

    /// The error of a calibration that is held fixed.
    pub(crate) fn field(&self) -> Option<&Field> {
        self.held.as_ref().map(|held| self.field.get_or_init(|| held.field(&self.form_error)))
    }

    /// Number of its columns.
    pub(crate) fn field_len(&self) -> usize {
        self.field().map_or(0, Field::len)
    }

    /// What a fit takes of a long table beside a calibration, whose error has a hundred columns; `None` where it takes
    /// all.
    pub fn fitted_part(&self) -> Option<Self> {
        const MOST: usize = 200_000;
        self.held.as_ref().and_then(|_| self.thinned(MOST))
    }

    /// What distances of neighbours are counted in.
    pub(crate) fn px_name(&self) -> &'static str {
        if self.pixels.is_some() { "px of the image" } else { "px of the screen" }
    }

    /// Points: the y of the camera's upper and lower edge, where x is 1 at the others.
    pub fn field_half_height(&self) -> Option<f64> {
        (self.kind == TableKind::Points).then_some(self.half_height)
    }

    /// Components of a row.
    pub fn components(&self) -> usize {
        self.kind.components()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Names of the columns that errors may depend on, one by one: those that vary, without what another holds. Points
    /// have `x`, `y` and `r` besides.
    pub fn screened_columns(&self) -> Vec<&str> {
        crate::screens::screened(self)
    }

    /// Values of a covariate, where it is there.
    pub fn covariate(&self, name: &str) -> Option<&Covariate> {
        self.covariates.iter().find(|c| c.name == name)
    }

    /// Values of what one's own effects may read (see [`OwnEffect::columns`](crate::OwnEffect::columns)); `None` where it
    /// is not there.
    pub fn readable(&self, name: &str) -> Option<Vec<f64>> {
        read_column(self, name).ok().map(Cow::into_owned)
    }

    /// Values of a covariate that every table of this kind has.
    pub(crate) fn values(&self, name: &str) -> &[f64] {
        self.covariate(name).map_or(&[], |c| c.values.as_slice())
    }

    /// A covariate's values, if it is there and not constant.
    pub(crate) fn varying(&self, name: &str) -> Option<&[f64]> {
        self.covariate(name).filter(|c| c.varies()).map(|c| c.values.as_slice())
    }

    /// A covariate's value in each group; `None` where a group has none, or several.
    pub(crate) fn one_a_group(&self, name: &str) -> Option<Vec<f64>> {
        let values = self.values(name);
        let of_group = |group: &Group| {
            let own = &values[group.rows.clone()];
            own.first().copied().filter(|first| own.iter().all(|v| v == first))
        };
        self.groups.iter().map(of_group).collect()
    }

    /// Values of a covariate, shifted and scaled to -1..1; and the offset and half-range.
    pub(crate) fn scaled(&self, name: &str) -> Option<(Vec<f64>, f64)> {
        let covariate = self.covariate(name).filter(|c| c.varies())?;
        let (low, high) = covariate.range();
        let half = 0.5 * (high - low);
        Some((covariate.values.iter().map(|v| (v - 0.5 * (low + high)) / half).collect(), half))
    }

    /// Column of a term, whole.
    pub(crate) fn column(&self, term: &Term<'_>) -> Vec<f64> {
        let n = self.kind.components();
        let mut out = Vec::with_capacity(self.y.len());
        for row in 0..self.len() {
            out.extend_from_slice(&(term.value)(row)[..n]);
        }
        out
    }

    /// The terms that are always fitted.
    pub(crate) fn baseline_terms(&self) -> Vec<Term<'_>> {
        match self.kind {
            TableKind::Points => points::baseline(self),
            TableKind::Power => power::baseline(self),
            TableKind::Phase => vec![Term::new("magnitude", |_| [1.0, 0.0])],
            TableKind::Frames => frames::baseline(self),
        }
    }
}
