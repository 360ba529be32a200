//! The error of a calibration that is held fixed, as a random field beside the baseline (G. K. Robinson, That BLUP is a
//! good thing, Statistical Science 6, 1991): what its coefficients' covariance leaves open, and smooth modes beyond its
//! polynomial's degree for what that cannot follow, whose size is estimated from the data.

use std::sync::Arc;

use glam::{DMat2, DVec2};
use retina_formats::Calibration;
use retina_geometry::InverseDistortion;

use crate::data::ARCSEC_PER_RAD;
use crate::form_error::FormError;
use crate::linear::Basis;

/// Degrees beyond the calibration's that the modes have.
const DEGREES_BEYOND: u32 = 3;
/// Each degree's modes are smaller than those before by this factor: fields are smooth.
const DECAY: f64 = 0.5;
/// Without a covariance every degree from this one on is open.
const LOWEST_DEGREE: u32 = 2;
/// Components of the covariance that are smaller than this part of the largest are rounding.
const LEAST: f64 = 1e-8;
/// Rows over which the covariance's components are made independent.
const SAMPLE: usize = 4000;

/// A calibration that is held fixed, on the rows it was applied to.
#[derive(Debug, Clone)]
pub(crate) enum Held {
    /// Of the geometry.
    Geometry(HeldModel),
    /// Of the response: columns over the rows, independent and of unit variance, of what its covariance leaves open.
    Response(Vec<Vec<f64>>),
}

impl Held {
    /// Of some of the rows.
    pub(crate) fn of_rows(&self, rows: &[usize]) -> Self {
        match self {
            Self::Geometry(model) => Self::Geometry(model.of_rows(rows)),
            Self::Response(columns) => {
                let of = |column: &Vec<f64>| rows.iter().map(|&row| column[row]).collect();
                Self::Response(columns.iter().map(of).collect())
            }
        }
    }

    /// The field's columns, with those of forms that may be off.
    pub(crate) fn field(&self, forms: &FormError) -> Field {
        match self {
            Self::Geometry(model) => model.field(forms),
            Self::Response(known) => Field { known: known.clone(), modes: Vec::new() },
        }
    }
}

/// A geometric calibration with the rows it was applied to.
#[derive(Debug, Clone)]
pub(crate) struct HeldModel {
    inverse: Option<Arc<InverseDistortion>>,
    covariance: Option<Vec<f64>>,
    degree: u32,
    /// For each row: the model's line of sight.
    pub(crate) sight: Vec<DVec2>,
    /// For each row: log10 of the irradiance as the model holds it.
    pub(crate) l: Vec<f64>,
}

/// Columns of the field over the rows, in the data's unit.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    /// Independent, each of unit variance: the coefficients' errors, and those of forms that were found.
    pub(crate) known: Vec<Vec<f64>>,
    /// Independent, each of a variance that is the square of the field's size.
    pub(crate) modes: Vec<Vec<f64>>,
}

impl HeldModel {
    pub(crate) fn new(calibration: &Calibration, sight: Vec<DVec2>, l: &[f64]) -> Self {
        let degree = match &calibration.inverse {
            Some(inverse) => inverse.degree(),
            None => calibration.distortion.degree(),
        };
        let held = |l: &f64| calibration.inverse.as_ref().map_or(*l, |inverse| inverse.held(*l));
        Self {
            inverse: calibration.inverse.clone().map(Arc::new),
            covariance: calibration.covariance.clone(),
            degree: degree.max(1),
            sight,
            l: l.iter().map(held).collect(),
        }
    }

    /// What a step of the displayed line of sight moves a row's line of sight by (columns); `None` of a calibration that
    /// has no inverse.
    pub(crate) fn sight_per_displayed(&self, row: usize) -> Option<DMat2> {
        let inverse = self.inverse.as_ref()?;
        Some(inverse.jacobian(self.sight[row], self.l[row]).inverse())
    }

    /// Where the axis of the facility's lenses is seen, tangents: the centre of its rings, which their aberrations make.
    pub(crate) fn lens_axis(&self) -> Option<DVec2> {
        Some(self.inverse.as_ref()?.rings.as_ref()?.rings.center)
    }

    /// Degree of its polynomial.
    pub(crate) fn degree(&self) -> u32 {
        self.degree
    }

    /// Whether the calibration says how uncertain it is.
    pub(crate) fn has_covariance(&self) -> bool {
        self.covariance.is_some()
    }

    /// Of some of the rows.
    pub(crate) fn of_rows(&self, rows: &[usize]) -> Self {
        Self {
            sight: rows.iter().map(|&row| self.sight[row]).collect(),
            l: rows.iter().map(|&row| self.l[row]).collect(),
            inverse: self.inverse.clone(),
            covariance: self.covariance.clone(),
            degree: self.degree,
        }
    }

    /// The field's columns.
    fn field(&self, forms: &FormError) -> Field {
        let mut known = match (&self.inverse, &self.covariance) {
            (Some(inverse), Some(covariance)) => self.known(inverse, covariance),
            _ => Vec::new(),
        };
        let lowest = if known.is_empty() { LOWEST_DEGREE } else { self.degree + 1 };
        known.extend(forms.columns.iter().cloned());
        let highest = self.degree.max(LOWEST_DEGREE) + DEGREES_BEYOND;
        let size = |degree: u32| DECAY.powi((degree - lowest) as i32);
        Field { known, modes: products(&self.sight, half_widths(&self.sight), lowest, highest, size) }
    }

    /// Errors of the coefficients as independent fields: with Phi = Q R their columns over the rows, the same along both
    /// axes, and C their covariance, R C R^T = U S U^T gives the fields Phi R^-1 U S^(1/2).
    fn known(&self, inverse: &InverseDistortion, covariance: &[f64]) -> Vec<Vec<f64>> {
        let n = inverse.columns();
        let values = |row: usize| {
            let mut out = vec![0.0; n];
            inverse.fill(self.sight[row], self.l[row], &mut out);
            out
        };
        let stride = self.sight.len().div_ceil(SAMPLE);
        let sample: Vec<usize> = (0..self.sight.len()).step_by(stride).collect();
        let norm = (sample.len() as f64).sqrt();
        let rows: Vec<Vec<f64>> = sample.iter().map(|&row| values(row)).collect();
        let basis = Basis::of((0..n).map(|t| rows.iter().map(|row| row[t] / norm).collect::<Vec<f64>>()));
        let r = basis.triangle_rows();
        let k = basis.q.len();
        let along_both = |i: usize, j: usize| if i / k == j / n { r[i % k][j % n] } else { 0.0 };
        let r = faer::Mat::<f64>::from_fn(2 * k, 2 * n, along_both);
        let c = faer::Mat::<f64>::from_fn(2 * n, 2 * n, |i, j| covariance[i * 2 * n + j]);
        let in_field = &r * &c * r.transpose();
        let Ok(eigen) = in_field.self_adjoint_eigen(faer::Side::Lower) else { return Vec::new() };
        let (u, s) = (eigen.U(), eigen.S().column_vector());
        let largest = (0..2 * k).map(|i| s[i]).fold(0.0, f64::max);
        // Weights of the coefficients in each field: C R^T U S^(-1/2), which needs no inverse of R.
        let weights = &c * r.transpose() * u;
        let jacobian: Vec<glam::DMat2> = (0..self.sight.len())
            .map(|row| inverse.jacobian(self.sight[row], self.l[row]).inverse() * ARCSEC_PER_RAD)
            .collect();
        let kept: Vec<usize> = (0..2 * k).rev().filter(|&i| s[i] > LEAST * largest).collect();
        let weights: Vec<Vec<DVec2>> = kept
            .iter()
            .map(|&i| {
                (0..n).map(|t| DVec2::new(weights[(t, i)], weights[(n + t, i)]) / s[i].sqrt()).collect()
            })
            .collect();
        let of_row = |row: usize| -> Vec<DVec2> {
            let values = values(row);
            let sum = |weights: &Vec<DVec2>| weights.iter().zip(&values).map(|(w, v)| *w * *v).sum::<DVec2>();
            weights.iter().map(|weights| jacobian[row] * sum(weights)).collect()
        };
        let fields: Vec<Vec<DVec2>> = (0..self.sight.len()).map(of_row).collect();
        (0..kept.len()).map(|at| fields.iter().flat_map(|row| row[at].to_array()).collect()).collect()
    }
}

/// Half the width and half the height of a box about the boresight that holds all lines of sight.
pub(crate) fn half_widths(sight: &[DVec2]) -> DVec2 {
    sight.iter().fold(DVec2::splat(f64::MIN_POSITIVE), |half, at| half.max(at.abs()))
}

/// Products of Legendre polynomials along x and y over a box of these half widths, of unit rms there times their degree's
/// size: each along both axes of the error.
pub(crate) fn products(
    sight: &[DVec2],
    half: DVec2,
    from: u32,
    to: u32,
    size: impl Fn(u32) -> f64,
) -> Vec<Vec<f64>> {
    let of = |along: fn(DVec2) -> f64| -> Vec<Vec<f64>> {
        sight
            .iter()
            .map(|r| {
                let mut values = vec![1.0];
                values.extend(crate::screens::legendre(along(*r / half), to as usize));
                for (degree, value) in values.iter_mut().enumerate() {
                    *value *= (2.0 * degree as f64 + 1.0).sqrt();
                }
                values
            })
            .collect()
    };
    let (px, py) = (of(|r| r.x), of(|r| r.y));
    let mut out = Vec::new();
    for degree in from..=to {
        let size = size(degree);
        for i in 0..=degree as usize {
            let j = degree as usize - i;
            let values: Vec<f64> = px.iter().zip(&py).map(|(x, y)| size * x[i] * y[j]).collect();
            out.push(values.iter().flat_map(|v| [*v, 0.0]).collect());
            out.push(values.iter().flat_map(|v| [0.0, *v]).collect());
        }
    }
    out
}

impl Field {
    /// Number of columns.
    pub(crate) fn len(&self) -> usize {
        self.known.len() + self.modes.len()
    }

    /// The columns with the standard deviation of each, where the modes' is `size_arcsec`.
    pub(crate) fn columns(&self, size_arcsec: f64) -> impl Iterator<Item = (&Vec<f64>, f64)> {
        self.known.iter().map(|c| (c, 1.0)).chain(self.modes.iter().map(move |c| (c, size_arcsec)))
    }
}
