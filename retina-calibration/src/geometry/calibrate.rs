//! The calibration as a whole: checks, weights, form, coefficients, errors.

use glam::DVec2;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use retina_files::InputError;
use retina_formats::{MeasuredResponse, PointsTable, ResponseRecord, measured_or_power_law};
use retina_geometry::{CalibratedField, InverseDistortion, RingField, Setup};
use retina_radiometry::magnitude_of_irradiance;

use super::centre::{centred, rings_about};
use super::checks::check;
use super::direct::{self, DirectFit};
use super::errors::{ErrorSummary, angle_arcsec};
use super::fit::{Fit, Gram, grams, predict, robust_weights};
use super::form::{Domain, ModelForm, RING_SIGMA, Scaling};
use super::noise::{Robust, Weights};
use super::observations::Observations;
use super::physical::PhysicalFit;
use super::select::{self, Rung};
use super::uncertainty;

/// What is asked of a calibration.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CalibrateOptions {
    /// Without terms in the irradiance (the paper's Fig. 10b).
    pub plain: bool,
    /// A form given outright instead of one chosen on exposures left out.
    pub form: Option<ModelForm>,
    /// log10 of the irradiance (relative to white at full count) at which D is given; the points' median where absent.
    pub reference_log10_irradiance: Option<f64>,
    /// The display's measured response; the setup's power law where absent.
    pub response: Option<MeasuredResponse>,
}

/// The result of a calibration.
#[derive(Debug, Clone)]
pub struct GeometryCalibration {
    /// The measured response by which L was computed; the setup's power law where absent.
    pub response: Option<ResponseRecord>,
    /// What the user ought to look into.
    pub warnings: Vec<String>,
    /// The form of D^-1.
    pub form: ModelForm,
    /// D^-1 with the coefficients of its terms (gamma of the paper) and rings, its range of L, and the L at which D is
    /// given.
    pub inverse: InverseDistortion,
    /// Covariance of the coefficients a (of the terms, then of the rings), and then of b in the same order, row by row.
    pub covariance: Vec<f64>,
    /// Standard deviation that the rings' coefficients had before any data, at the covariance's scale, tangent plane.
    pub rings_prior_sigma: f64,
    /// Magnitude of a white pixel at full count, L = 0.
    pub brightest_magnitude: f64,
    /// D at the reference.
    pub direct: DirectFit,
    /// The physical model beside it.
    pub physical: Option<PhysicalFit>,
    /// Forms tried.
    pub ladder: Vec<Rung>,
    /// Rows of the table.
    pub rows: usize,
    /// Saturated rows left out.
    pub saturated: usize,
    /// Rows that are outliers (not fitted).
    pub outliers: usize,
    /// Exposures.
    pub exposures: usize,
    /// Standard deviation per axis of the common shift of an exposure, arcsec.
    pub jitter_arcsec: f64,
    /// Errors of the fitted points.
    pub errors: ErrorSummary,
    /// Errors of the same points from fits without their exposures.
    pub heldout: ErrorSummary,
    /// Whether single points were left out, there being too few exposures.
    pub heldout_by_points: bool,
    /// For each row of the table that was used: its result.
    pub points: Vec<PointResult>,
}

/// What became of a row of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointResult {
    /// Row of the table.
    pub row: usize,
    /// Measured line of sight.
    pub sight: DVec2,
    /// K_f^-1 R^s - D^-1(r), tangent plane.
    pub residual: DVec2,
    /// Standard deviation per axis that it was weighted with, rad (without the exposure's common shift).
    pub sigma: f64,
    /// L.
    pub log10_irradiance: f64,
    /// Angle between the measured line of sight and that of the model, arcsec.
    pub error_arcsec: f64,
    /// The same by a fit without its exposure.
    pub heldout_arcsec: f64,
    /// Not fitted.
    pub outlier: bool,
}

/// D is given where it was measured.
fn check_reference(
    table: &PointsTable,
    observations: &Observations,
    options: &CalibrateOptions,
) -> Result<(), InputError> {
    let Some(reference) = options.reference_log10_irradiance else { return Ok(()) };
    let low = observations.l.iter().copied().fold(f64::INFINITY, f64::min);
    let high = observations.l.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if (low..=high).contains(&reference) {
        return Ok(());
    }
    let file = table.files.first().map(|file| file.path.clone()).unwrap_or_default();
    Err(InputError::new(&file, "no point is as bright or as faint as the reference for D")
        .found(format!("log10 irradiance {reference}"))
        .expected(format!("{low:.3} to {high:.3}, the points'")))
}

/// Fewer exposures than this are not left out one after another; single points are.
const FEWEST_EXPOSURES: usize = 3;

/// Calibrates a setup with points.
///
/// # Errors
/// The table is refused (too few points, on a line, all saturated, columns that do not belong together), or its points
/// do not determine a mapping that can be inverted over the screen.
pub fn calibrate(
    table: &PointsTable,
    setup: &Setup,
    options: &CalibrateOptions,
) -> Result<GeometryCalibration, InputError> {
    let response = measured_or_power_law(options.response.as_ref().map(|measured| &measured.curve), setup);
    let mut observations = Observations::of(table, setup, &response);
    check(table, &observations, setup)?;
    check_reference(table, &observations, options)?;
    let exposures = observations.exposures.len();
    let heldout_by_points = exposures < FEWEST_EXPOSURES;
    if heldout_by_points {
        observations.part_at_random();
    }
    let file = table.files.first().map(|file| file.path.clone()).unwrap_or_default();
    let undetermined = || {
        InputError::new(&file, "the points do not determine the mapping")
            .found(format!("{} unsaturated points in {exposures} exposures", observations.len()))
            .help("display more points, spread over the whole screen and several digital counts")
    };
    let groups = select::folds(observations.exposures.len());
    let scaling = Scaling::of(observations.sight.iter().copied().zip(observations.l.iter().copied()));
    let widest = select::widest(&observations, options.plain);
    let (weights, domain) = first_weights(&observations, scaling, widest).ok_or_else(undetermined)?;
    let (ladder, chosen) =
        select::ladder(&observations, &groups, widest, &domain, &weights).ok_or_else(undetermined)?;
    let form = options.form.unwrap_or(chosen);
    let basis = domain.basis(form);
    let again = [Robust::Tukey, Robust::Cut];
    let (mut weights, _) =
        robust_weights(&observations, &groups, &basis, &again, weights).ok_or_else(undetermined)?;
    let fit = Fit::by_qr(&observations, &groups, &basis, &weights).ok_or_else(undetermined)?;
    let fitted = fit.predict(&observations);
    let residuals: Vec<DVec2> = observations.undistorted.iter().zip(&fitted).map(|(u, f)| *u - *f).collect();
    // The covariance takes the residuals' own scale: reduced chi-square of the whitened rows.
    let reduced = reduced_chi_square(&observations, &residuals, &weights, form.len());
    for weight in &mut weights.inverse_variance {
        *weight /= reduced;
    }
    for sigma in &mut weights.sigma {
        *sigma *= reduced.sqrt();
    }
    weights.jitter_variance *= reduced;
    let inverse = inverse_of(&fit, options, &observations, &weights);
    let direct = direct::fit(&inverse, &setup.facility_pinhole()).ok_or_else(|| {
        let error = InputError::new(&file, "the mapping found cannot be inverted over the screen");
        match of_another_scale(&inverse, setup) {
            Some(scale) => error.help(scale),
            None => error.help(
                "are the points shifted, or do they leave the screen's edges uncovered? Add some there",
            ),
        }
    })?;
    let heldout = heldout_residuals(&observations, &groups, &fit, &weights).ok_or_else(undetermined)?;
    let points = results(&observations, &inverse, &residuals, &heldout, &weights);
    let used = |of: fn(&PointResult) -> f64| {
        ErrorSummary::of(points.iter().filter(|p| !p.outlier).map(of).collect())
    };
    let reference = inverse.reference_log10_irradiance;
    let steady: Vec<DVec2> = (0..observations.len())
        .map(|i| {
            let r = observations.sight[i];
            observations.undistorted[i] - inverse.undistort(r, observations.l[i])
                + inverse.undistort(r, reference)
        })
        .collect();
    let n = basis.len();
    let matrix = basis.to_monomials();
    let covariance = uncertainty::covariance(&observations, &fit, &weights, reduced, &matrix);
    let physical = PhysicalFit::fit(&observations, &steady, &weights);
    Ok(GeometryCalibration {
        form,
        response: options.response.as_ref().map(|measured| measured.record.clone()),
        warnings: of_another_scale(&inverse, setup)
            .into_iter()
            .chain(too_few_points(&observations, widest.degree).filter(|_| options.form.is_none()))
            .chain(observations.stated_note.clone())
            .collect(),
        covariance: (0..4 * n * n).map(|at| covariance[(at / (2 * n), at % (2 * n))]).collect(),
        rings_prior_sigma: RING_SIGMA * reduced.sqrt(),
        brightest_magnitude: magnitude_of_irradiance(response.brightest_w_m2_nm()),
        inverse,
        physical,
        direct,
        ladder,
        rows: table.rows.len(),
        saturated: observations.saturated,
        outliers: points.iter().filter(|p| p.outlier).count(),
        exposures,
        jitter_arcsec: weights.jitter_variance.sqrt().to_degrees() * 3600.0,
        errors: used(|p| p.error_arcsec),
        heldout: used(|p| p.heldout_arcsec),
        heldout_by_points,
        points,
    })
}

/// A scale that is farther from 1 than this is more likely another camera or magnification than K_f's error.
const LIKELY_SCALE: f64 = 0.05;

/// Says so where the screen shows lines of sight at another scale than the setup's.
fn of_another_scale(inverse: &InverseDistortion, setup: &Setup) -> Option<String> {
    let scale = inverse.jacobian(DVec2::ZERO, inverse.reference_log10_irradiance).determinant().abs().sqrt();
    ((scale - 1.0).abs() > LIKELY_SCALE).then(|| {
        format!(
            "the screen shows lines of sight at {scale:.4} times the scale of setup `{}`: K_f is {:.1} % off. Is it the \
             setup of these points (screen, observed_rows_px)? A wrong focal length or pixel pitch does not show here: \
             K_f follows them",
            setup.name,
            100.0 * (1.0 - scale).abs()
        )
    })
}

/// Says so where the points bear no cubic, which the distortion of a facility's lenses is.
fn too_few_points(observations: &Observations, degree: u32) -> Option<String> {
    let wanted = select::points_needed(select::CUBIC);
    (degree < select::CUBIC).then(|| {
        format!(
            "{} points bear a mapping of degree {degree} at most, and the distortion of lenses is cubic: the mapping may be \
             off by far more than it states. Take at least {wanted} points",
            observations.len()
        )
    })
}

/// Points that the first weights are found with: outliers and noise show in these as well as in more.
const SAMPLE: usize = 12_000;
/// The distortion's centre is to be known to this part of the rings' reach.
const CENTRE_KNOWN: f64 = 0.01;

/// Weights of all points from robust fits to a sample of them, and where rings may be. A step in the distortion that no
/// polynomial follows would look like outliers: rings belong to the fit as soon as their centre is known.
fn first_weights(
    observations: &Observations,
    scaling: Scaling,
    widest: ModelForm,
) -> Option<(Weights, Domain)> {
    let sample = observations.sample(observations.len().div_ceil(SAMPLE));
    let groups = select::folds(sample.exposures.len());
    let mut form = select::following(&sample, widest);
    let mut domain = Domain { scaling, rings: None };
    let rounds = [Robust::Huber, Robust::Huber, Robust::Huber, Robust::Tukey, Robust::Tukey, Robust::Cut];
    let start = Weights::equal(sample.len());
    let (mut weights, mut coefficients) =
        robust_weights(&sample, &groups, &domain.basis(form), &rounds, start)?;
    domain.rings = PhysicalFit::fit(&sample, &sample.undistorted, &weights).and_then(|physical| {
        let (center, radius) = rings_about(physical.center, observations);
        (physical.center_sigma.max_element() < CENTRE_KNOWN * radius).then_some((center, radius))
    });
    let ringed = ModelForm { rings: select::RINGS, ..form };
    if domain.rings.is_some() && select::bears(&sample, &ringed) {
        form = ringed;
        let again = [Robust::Huber, Robust::Tukey, Robust::Cut];
        (weights, coefficients) = robust_weights(&sample, &groups, &domain.basis(form), &again, weights)?;
        let moved = centred(&sample, observations, &groups, domain, form, &weights);
        if moved.rings != domain.rings {
            domain = moved;
            (weights, coefficients) = robust_weights(&sample, &groups, &domain.basis(form), &again, weights)?;
        }
    }
    if sample.len() == observations.len() {
        return Some((weights, domain));
    }
    let fitted = predict(observations, &domain.basis(form), &coefficients);
    let residuals: Vec<DVec2> = observations.undistorted.iter().zip(&fitted).map(|(u, f)| *u - *f).collect();
    let mut all = Weights::crude(&residuals);
    for _ in 0..2 {
        all.update(observations, &residuals, form.len(), form.irradiance_power as usize, Robust::Cut);
    }
    Some((all, domain))
}

/// Squares of the whitened residuals over their degrees of freedom.
fn reduced_chi_square(
    observations: &Observations,
    residuals: &[DVec2],
    weights: &Weights,
    columns: usize,
) -> f64 {
    let count = weights.inverse_variance.iter().filter(|weight| **weight > 0.0).count();
    weights.product(observations, residuals, residuals) / (2.0 * (count as f64 - columns as f64).max(1.0))
}

/// D^-1 in monomials and rings, with its reference and range.
fn inverse_of(
    fit: &Fit,
    options: &CalibrateOptions,
    observations: &Observations,
    weights: &Weights,
) -> InverseDistortion {
    let basis = &fit.basis;
    let change = basis.to_monomials();
    let coefficient =
        |row: usize| (0..basis.len()).map(|c| fit.coefficients[c] * change[(row, c)]).sum::<DVec2>();
    let mut l = observations.l.clone();
    l.sort_by(f64::total_cmp);
    let range = [l[0], l[l.len() - 1]];
    let fitted = (0..observations.len()).filter(|&i| !weights.outlier[i]);
    InverseDistortion {
        terms: basis.terms.iter().enumerate().map(|(row, term)| (*term, coefficient(row))).collect(),
        rings: basis.rings.map(|rings| RingField {
            rings,
            coefficients: (basis.terms.len()..basis.len()).map(coefficient).collect(),
        }),
        field: CalibratedField::of(fitted.map(|i| observations.sight[i])),
        reference_log10_irradiance: options.reference_log10_irradiance.unwrap_or(l[l.len() / 2]),
        range_log10_irradiance: range,
    }
}

/// Residuals of each group of exposures by the fit to the others.
fn heldout_residuals(
    observations: &Observations,
    groups: &[Vec<usize>],
    fit: &Fit,
    weights: &Weights,
) -> Option<Vec<DVec2>> {
    let all: Vec<usize> = (0..fit.basis.len()).collect();
    // The fit's own residuals are what is fitted: the normal equations then lose no digits.
    let fitted = fit.predict(observations);
    let target: Vec<DVec2> = observations.undistorted.iter().zip(&fitted).map(|(u, f)| *u - *f).collect();
    let folds = grams(observations, groups, &fit.basis, &target, weights);
    let total = Gram::sum(folds.iter())?;
    let mut out = target.clone();
    let mut values = vec![0.0; all.len()];
    for (group, fold) in groups.iter().zip(&folds) {
        let change = total.without(fold).solve(&fit.basis, &all)?;
        for &exposure in group {
            for i in observations.exposures[exposure].1.clone() {
                fit.basis.fill(observations.sight[i], observations.l[i], &mut values);
                out[i] -= values.iter().zip(&change).map(|(value, c)| *c * *value).sum::<DVec2>();
            }
        }
    }
    Some(out)
}

fn results(
    observations: &Observations,
    inverse: &InverseDistortion,
    residuals: &[DVec2],
    heldout: &[DVec2],
    weights: &Weights,
) -> Vec<PointResult> {
    let mut out: Vec<PointResult> = (0..observations.len())
        .map(|i| {
            let sight = observations.sight[i];
            // The line of sight at which the model shows the point: one Newton step from the measured one, whose
            // error is of second order in a residual of arcseconds.
            let jacobian = inverse.jacobian(sight, observations.l[i]);
            let angle = |residual: DVec2| angle_arcsec(sight, sight + jacobian.inverse() * residual);
            PointResult {
                row: observations.row[i],
                sight,
                residual: residuals[i],
                sigma: weights.variance(i).sqrt(),
                log10_irradiance: observations.l[i],
                error_arcsec: angle(residuals[i]),
                heldout_arcsec: angle(heldout[i]),
                outlier: weights.outlier[i],
            }
        })
        .collect();
    out.sort_by_key(|point| point.row);
    out
}

impl Observations {
    /// Every `stride`-th point of each exposure.
    fn sample(&self, stride: usize) -> Self {
        let pick = |range: &std::ops::Range<usize>| range.clone().step_by(stride).collect::<Vec<_>>();
        let order: Vec<usize> = self.exposures.iter().flat_map(|(_, range)| pick(range)).collect();
        let mut exposures = Vec::with_capacity(self.exposures.len());
        let mut start = 0;
        for (image, range) in &self.exposures {
            let end = start + range.len().div_ceil(stride);
            exposures.push((*image, start..end));
            start = end;
        }
        Self {
            stated_note: self.stated_note.clone(),
            sight: order.iter().map(|&i| self.sight[i]).collect(),
            undistorted: order.iter().map(|&i| self.undistorted[i]).collect(),
            l: order.iter().map(|&i| self.l[i]).collect(),
            noise_key: order.iter().map(|&i| self.noise_key[i]).collect(),
            row: order.iter().map(|&i| self.row[i]).collect(),
            exposures,
            saturated: self.saturated,
        }
    }

    /// Parts few exposures into ten random groups each, so that points can be left out instead.
    fn part_at_random(&mut self) {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut order: Vec<usize> = Vec::with_capacity(self.len());
        let mut parts = Vec::new();
        for (image, range) in &self.exposures {
            let mut own: Vec<usize> = range.clone().collect();
            own.shuffle(&mut random);
            order.extend(&own);
            let count = own.len();
            let ends = (0..=10).map(|part| range.start + part * count / 10);
            let ends: Vec<usize> = ends.collect();
            parts.extend(ends.windows(2).filter(|w| w[1] > w[0]).map(|w| (*image, w[0]..w[1])));
        }
        fn pick<T: Copy>(values: &mut Vec<T>, order: &[usize]) {
            *values = order.iter().map(|&i| values[i]).collect();
        }
        pick(&mut self.sight, &order);
        pick(&mut self.undistorted, &order);
        pick(&mut self.l, &order);
        pick(&mut self.noise_key, &order);
        pick(&mut self.row, &order);
        self.exposures = parts;
    }
}
