//! Where the rings of a mapping have their centre.
//!
//! The physical model tells the centre of the distortion. Rings are made by aberrations that change quickly with the field
//! angle, and lenses that are decentred or tilted have these about another point: 22 px from the distortion's centre on a
//! facility drawn within the tolerances of `validation/as_built.py`.

use glam::{DMat2, DVec2};

use super::fit::{Gram, grams, predict};
use super::form::{Domain, ModelForm};
use super::noise::Weights;
use super::observations::Observations;

/// Rings reach so much farther than the points: their slope ends at the last knot, which is to lie outside of the field.
const RINGS_REACH: f64 = 1.02;
/// The centre is moved where chi-square falls by more than this: with two parameters, one time in a thousand by chance.
const SIGNIFICANT: f64 = 13.8;
/// It is found when another step would gain less than this.
const FOUND: f64 = 0.1;
/// Most steps.
const STEPS: usize = 12;
/// A step is at most this part of the distance between two knots.
const LONGEST: f64 = 0.5;

/// Rings about a centre that reach over all points: centre and radius.
pub(crate) fn rings_about(center: DVec2, observations: &Observations) -> (DVec2, f64) {
    let farthest = observations.sight.iter().map(|r| (*r - center).length()).fold(0.0, f64::max);
    (center, RINGS_REACH * farthest)
}

/// Moves the rings' centre to where they leave least, by Gauss-Newton steps of the centre with all coefficients fitted
/// beside it. Unchanged where that gains nothing significant. `all` are the points that the rings are to reach over.
pub(crate) fn centred(
    observations: &Observations,
    all: &Observations,
    groups: &[Vec<usize>],
    domain: Domain,
    form: ModelForm,
    weights: &Weights,
) -> Domain {
    let at = |domain: Domain| Centred::at(observations, groups, domain, form, weights);
    let Some(mut best) = at(domain) else { return domain };
    let start = best.squares;
    for _ in 0..STEPS {
        let Some((step, gain)) = best.step() else { break };
        if gain < FOUND {
            break;
        }
        let Some((center, _)) = best.domain.rings else { break };
        let moved = Domain { rings: Some(rings_about(center + step, all)), ..domain };
        match at(moved) {
            Some(next) if next.squares < best.squares => best = next,
            _ => break,
        }
    }
    if start - best.squares > SIGNIFICANT { best.domain } else { domain }
}

/// A fit with rings about one centre.
struct Centred<'a> {
    observations: &'a Observations,
    groups: &'a [Vec<usize>],
    form: ModelForm,
    weights: &'a Weights,
    domain: Domain,
    coefficients: Vec<DVec2>,
    residuals: Vec<DVec2>,
    /// Chi-square.
    squares: f64,
}

impl<'a> Centred<'a> {
    fn at(
        observations: &'a Observations,
        groups: &'a [Vec<usize>],
        domain: Domain,
        form: ModelForm,
        weights: &'a Weights,
    ) -> Option<Self> {
        let mut out = Self {
            observations,
            groups,
            form,
            weights,
            domain,
            coefficients: Vec::new(),
            residuals: Vec::new(),
            squares: 0.0,
        };
        (out.coefficients, out.residuals) = out.fitted(&observations.undistorted)?;
        out.squares = out.product(&out.residuals, &out.residuals);
        Some(out)
    }

    /// Coefficients of the columns fitted to a target, and what they leave of it.
    fn fitted(&self, target: &[DVec2]) -> Option<(Vec<DVec2>, Vec<DVec2>)> {
        let basis = self.domain.basis(self.form);
        let columns: Vec<usize> = (0..basis.len()).collect();
        let grams = grams(self.observations, self.groups, &basis, target, self.weights);
        let coefficients = Gram::sum(grams.iter())?.solve(&basis, &columns)?;
        let fitted = predict(self.observations, &basis, &coefficients);
        let left = target.iter().zip(&fitted).map(|(target, fitted)| *target - *fitted).collect();
        Some((coefficients, left))
    }

    fn product(&self, a: &[DVec2], b: &[DVec2]) -> f64 {
        self.weights.product(self.observations, a, b)
    }

    /// The next step of the centre, and by how much chi-square is to fall.
    fn step(&self) -> Option<(DVec2, f64)> {
        let basis = self.domain.basis(self.form);
        let rings = basis.rings?;
        let own = &self.coefficients[basis.terms.len()..];
        // A centre that moves by d takes what the rings do to a point by J d back.
        let moved: Vec<DMat2> =
            self.observations.sight.iter().map(|r| rings.jacobian(*r, own) * -1.0).collect();
        let beside = |axis: usize| {
            let column: Vec<DVec2> = moved.iter().map(|moved| moved.col(axis)).collect();
            Some(self.fitted(&column)?.1)
        };
        let (x, y) = (beside(0)?, beside(1)?);
        let cross = self.product(&x, &y);
        let normal = DMat2::from_cols_array(&[self.product(&x, &x), cross, cross, self.product(&y, &y)]);
        let right = DVec2::new(self.product(&x, &self.residuals), self.product(&y, &self.residuals));
        let step = normal.inverse() * right;
        let longest = LONGEST * rings.radius / f64::from(rings.intervals);
        (step.is_finite()).then_some((step.clamp_length_max(longest), step.dot(right)))
    }
}
