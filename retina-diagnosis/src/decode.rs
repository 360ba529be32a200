//! A polynomial told as physics: which tilt, prism, decentring and lens law its coefficients are worth.
//!
//! The field that the polynomial gives over the data's points is fitted by the leading forms of what bends a facility
//! (shift and linear terms aside), least squares over the field; the covariance is that of the polynomial's own
//! coefficients. Of second degree there are three effects of two amplitudes each and four that are independent:
//! decentring p is prism p and tilt 2 p (A. E. Conrady, Monthly Notices of the RAS 79, 1919; D. C. Brown,
//! Photogrammetric Engineering 32, 1966). So the part of second degree has three readings, each with two of the three.

use crate::data::{ARCSEC_PER_RAD, Baseline, Dataset};
use crate::estimate::{Parameter, estimate};
use crate::field::Held;
use crate::linear::{Basis, cholesky, matrix};
use crate::noise::robust_fit;
use retina_formats::TableKind;

/// Points of the data over which fields are compared, at most.
const SAMPLE: usize = 2000;
/// Standard deviations beyond which an amplitude is there.
const THERE: f64 = 3.0;

/// Effects that cause one and the same field.
#[derive(Debug, Clone)]
pub struct Reading {
    /// What is there, simplest names; of `screen_tilt` and `camera_pointing`, `decentering` and `optical_centre` neither
    /// is told from the other in one mounting of the camera.
    pub effects: Vec<&'static str>,
    /// Amplitudes, arcsec at half the camera's width.
    pub parameters: Vec<Parameter>,
}

/// A polynomial as physics.
#[derive(Debug, Clone)]
pub struct Decoded {
    /// Which polynomial.
    pub of: String,
    /// The simplest first.
    pub readings: Vec<Reading>,
    /// What none of the forms explains, rms per axis over the data's points, arcsec.
    pub remainder_rms_arcsec: f64,
    /// The same expected of the polynomial's own uncertainty; absent where that is not known.
    pub remainder_expected_arcsec: Option<f64>,
}

type Form = (&'static str, u32, fn(f64, f64) -> [f64; 2]);

/// Shift and linear terms: what no effect is told from.
const NUISANCE: [fn(f64, f64) -> [f64; 2]; 6] = [
    |_, _| [1.0, 0.0],
    |_, _| [0.0, 1.0],
    |x, _| [x, 0.0],
    |_, y| [y, 0.0],
    |x, _| [0.0, x],
    |_, y| [0.0, y],
];
/// Name, degree, form; the first four are the independent ones of second degree.
const FORMS: [Form; 9] = [
    ("tilt_x", 2, |x, y| [x * x, x * y]),
    ("tilt_y", 2, |x, y| [x * y, y * y]),
    ("prism_x", 2, |x, y| [x * x + y * y, 0.0]),
    ("prism_y", 2, |x, y| [0.0, x * x + y * y]),
    ("k1", 3, |x, y| [x * (x * x + y * y), y * (x * x + y * y)]),
    ("bow_a", 3, |x, y| [(x * x - y * y) * x, (x * x - y * y) * y]),
    ("bow_b", 3, |x, y| [x * y * x, x * y * y]),
    ("k2", 5, |x, y| [x * (x * x + y * y).powi(2), y * (x * x + y * y).powi(2)]),
    ("k3", 7, |x, y| [x * (x * x + y * y).powi(3), y * (x * x + y * y).powi(3)]),
];

/// The polynomial of the baseline, or of a calibration that is held, as physics; `None` where there is neither.
pub fn decode(data: &Dataset) -> Option<Decoded> {
    if data.kind != TableKind::Points {
        return None;
    }
    let (of, field, errors, degree) = match (&data.held, data.baseline) {
        (Some(Held::Geometry(model)), _) => {
            let (x, y) = (data.values("x"), data.values("y"));
            let field = model.sight.iter().enumerate().flat_map(|(row, sight)| {
                let seen = *sight - glam::DVec2::new(x[row], y[row]) * data.half_tan;
                [seen.x * ARCSEC_PER_RAD, seen.y * ARCSEC_PER_RAD]
            });
            let field: Vec<f64> = field.collect();
            let errors = data.field().map(|field| field.known.clone()).filter(|known| !known.is_empty());
            ("the calibration".to_owned(), field, errors, model.degree())
        }
        (None, Baseline::Polynomial(degree)) => {
            let (field, errors) = polynomial(data);
            (format!("polynomial:{degree}"), field, errors, degree)
        }
        _ => return None,
    };
    // Shift, rotation and scale alone hold none of the forms.
    (degree >= 2).then(|| decoded(data, of, &field, errors.as_deref(), degree))
}

/// The fitted baseline's field, and its independent errors of unit variance.
fn polynomial(data: &Dataset) -> (Vec<f64>, Option<Vec<Vec<f64>>>) {
    let columns: Vec<Vec<f64>> = data.baseline_terms().iter().map(|term| data.column(term)).collect();
    let fit = robust_fit(data, &columns);
    let found = estimate(data, &columns, &fit.weights);
    let sum = |weights: &dyn Fn(usize) -> f64| {
        let mut out = vec![0.0; data.y.len()];
        for (k, column) in columns.iter().enumerate() {
            let weight = weights(k);
            out.iter_mut().zip(column).for_each(|(o, c)| *o += weight * c);
        }
        out
    };
    let n = columns.len();
    let covariance = faer::Mat::<f64>::from_fn(n, n, |i, j| found.covariance[i][j]);
    let errors = cholesky(&covariance).map(|l| (0..n).map(|j| sum(&|k| l[(k, j)])).collect());
    (sum(&|k| found.values[k]), errors)
}

fn decoded(data: &Dataset, of: String, field: &[f64], errors: Option<&[Vec<f64>]>, degree: u32) -> Decoded {
    let (x, y) = (data.values("x"), data.values("y"));
    let rows: Vec<usize> = (0..data.len()).step_by(data.len().div_ceil(SAMPLE)).collect();
    let sampled = |column: &[f64]| -> Vec<f64> {
        rows.iter().flat_map(|&row| [column[2 * row], column[2 * row + 1]]).collect()
    };
    let forms: Vec<&Form> = FORMS.iter().filter(|form| form.1 <= degree).collect();
    let all = NUISANCE.iter().chain(forms.iter().map(|form| &form.2));
    let basis =
        Basis::of(all.map(|form| rows.iter().flat_map(|&row| form(x[row], y[row])).collect::<Vec<f64>>()));
    let field = sampled(field);
    let values = basis.coefficients(&field)[NUISANCE.len()..].to_vec();
    let errors: Option<Vec<Vec<f64>>> = errors.map(|all| all.iter().map(|e| sampled(e)).collect());
    // Each error's own amplitudes: their products' sum is the amplitudes' covariance.
    let spread = errors.as_ref().map(|errors| {
        let amplitudes: Vec<Vec<f64>> =
            errors.iter().map(|e| basis.coefficients(e)[NUISANCE.len()..].to_vec()).collect();
        let a = matrix(&amplitudes);
        &a * a.transpose()
    });
    let rms = |column: &[f64]| (column.iter().map(|v| v * v).sum::<f64>() / column.len() as f64).sqrt();
    let remainder_expected_arcsec = errors
        .as_ref()
        .map(|errors| errors.iter().map(|e| rms(&basis.residual(e.clone())).powi(2)).sum::<f64>().sqrt());
    let sigma = |weights: &[f64]| -> Option<f64> {
        let spread = spread.as_ref()?;
        let sum = weights
            .iter()
            .enumerate()
            .flat_map(|(i, a)| weights.iter().enumerate().map(move |(j, b)| a * b * spread[(i, j)]));
        Some(sum.sum::<f64>().max(0.0).sqrt())
    };
    let linear = |name: String, weights: Vec<f64>| Parameter {
        name,
        value: weights.iter().zip(&values).map(|(w, v)| w * v).sum(),
        sigma: sigma(&weights),
    };
    let unit = |parts: &[(usize, f64)]| {
        let mut weights = vec![0.0; forms.len()];
        parts.iter().for_each(|(k, w)| weights[*k] = *w);
        weights
    };
    // Of tilt T and prism P: (T, P), or decentring T / 2 and prism P - T / 2, or decentring P and tilt T - 2 P.
    let pairs: [[(&str, [f64; 2]); 2]; 3] = [
        [("screen_tilt", [1.0, 0.0]), ("thin_prism", [0.0, 1.0])],
        [("decentering", [0.5, 0.0]), ("thin_prism", [-0.5, 1.0])],
        [("decentering", [0.0, 1.0]), ("screen_tilt", [1.0, -2.0])],
    ];
    let mut readings: Vec<(usize, Reading)> = pairs
        .iter()
        .map(|pair| {
            let (mut effects, mut parameters) = (Vec::new(), Vec::new());
            let mut there = |name: &'static str, own: Vec<Parameter>| {
                let seen = own.iter().any(|p| p.value.abs() > THERE * p.sigma.unwrap_or(0.0));
                if seen {
                    effects.push(name);
                }
                parameters.extend(own);
            };
            for (name, [tilt, prism]) in pair {
                let along = |axis: usize, letter: &str| {
                    linear(format!("{name}_{letter}_arcsec"), unit(&[(axis, *tilt), (axis + 2, *prism)]))
                };
                there(name, vec![along(0, "x"), along(1, "y")]);
            }
            for (name, effect) in
                [("k1", "radial_k1"), ("k2", "radial_higher_order"), ("k3", "radial_higher_order")]
            {
                if let Some(k) = forms.iter().position(|form| form.0 == name) {
                    there(effect, vec![linear(format!("{name}_arcsec"), unit(&[(k, 1.0)]))]);
                }
            }
            if let Some(k) = forms.iter().position(|form| form.0 == "bow_a") {
                let bow =
                    |k: usize, letter: &str| linear(format!("screen_bow_{letter}_arcsec"), unit(&[(k, 1.0)]));
                there("screen_bow", vec![bow(k, "a"), bow(k + 1, "b")]);
            }
            effects.dedup();
            (effects.len(), Reading { effects, parameters })
        })
        .collect();
    readings.sort_by_key(|(count, _)| *count);
    // Two readings in which the same is there are one.
    readings.dedup_by(|later, before| later.1.effects == before.1.effects);
    Decoded {
        of,
        readings: readings.into_iter().map(|(_, reading)| reading).collect(),
        remainder_rms_arcsec: rms(&basis.residual(field)),
        remainder_expected_arcsec,
    }
}
