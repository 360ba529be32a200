//! Sub-pixel edges along an outline.
//!
//! The pixels about a short piece of the outline are fitted together, each at its own distance u inside the outline, by a
//! step and a ramp behind a Gaussian PSF of standard deviation s:
//! y = b + a Phi((u + d) / s) + c [(u + d) Phi((u + d) / s) + s phi((u + d) / s)].
//! Nothing is interpolated, so the pixels' noise stays their own. A pixel's square aperture has the variance 1/12 px^2
//! across an edge of any direction and is part of s. The ramp is what a curved body's shading is near its limb; without
//! it the edge is drawn inwards.

use std::sync::LazyLock;

use glam::{DMat4, DVec2, DVec4};
use retina_geometry::LimbEllipse;
use retina_image::CameraImage;

use super::LimbCamera;

/// A short piece of the outline.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    /// Its place on the outline, index.
    pub index: usize,
    pub at: DVec2,
    /// Outward, unit.
    pub normal: DVec2,
    pub curvature_radius_px: f64,
    /// Half its length, px.
    pub half_length_px: f64,
}

/// A measured edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    pub node: Node,
    /// The edge less the node along the normal, px.
    pub shift_px: f64,
    /// The same of the blurred step alone: where a fit with another blur begins.
    pub blurred_shift_px: f64,
    pub sigma_px: f64,
    /// Step, DN.
    pub amplitude_dn: f64,
    /// Sum of squared residuals and degrees of freedom.
    pub misfit: (f64, usize),
    /// Share of the inner pixels that are saturated.
    pub saturated: f64,
}

/// Pieces of an ellipse in the image itself.
pub(super) fn image_outline(ellipse: &LimbEllipse) -> Vec<Node> {
    let count = node_count(0.5 * (ellipse.semi_axes_px[0] + ellipse.semi_axes_px[1]));
    outline(count, |k| Some(place(ellipse, k, count)))
}

/// The k-th of `count` places on an ellipse.
fn place(ellipse: &LimbEllipse, k: usize, count: usize) -> DVec2 {
    let angle = DVec2::from_angle(std::f64::consts::TAU * k as f64 / count as f64);
    ellipse.center_px
        + DVec2::from_angle(ellipse.angle_rad).rotate(angle * DVec2::from_array(ellipse.semi_axes_px))
}

/// Pieces of an ellipse of the undistorted image, where the camera shows them.
pub(super) fn ellipse_outline(ellipse: &LimbEllipse, camera: &LimbCamera) -> Vec<Node> {
    let count = node_count(0.5 * (ellipse.semi_axes_px[0] + ellipse.semi_axes_px[1]));
    outline(count, |k| camera.pixel(camera.pinhole.line_of_sight(place(ellipse, k, count))))
}

/// Pieces of about 5 px.
pub(super) fn node_count(radius_px: f64) -> usize {
    ((std::f64::consts::TAU * radius_px / 5.0) as usize).clamp(24, 720)
}

fn outline(count: usize, at: impl Fn(usize) -> Option<DVec2>) -> Vec<Node> {
    let points: Vec<Option<DVec2>> = (0..count).map(at).collect();
    (0..count)
        .filter_map(|index| {
            let here = points[index]?;
            let before = points[(index + count - 1) % count]?;
            let after = points[(index + 1) % count]?;
            let chord = after - before;
            let normal = DVec2::new(chord.y, -chord.x).normalize();
            // Sagitta h of a chord 2 s: R = (s^2 + h^2) / 2 h.
            let (half, sagitta) = (0.5 * chord.length(), (here - 0.5 * (before + after)).dot(normal));
            let curvature_radius_px = (half * half + sagitta * sagitta) / (2.0 * sagitta);
            let usable = curvature_radius_px.is_finite() && curvature_radius_px > 0.0;
            usable.then_some(Node {
                index,
                at: here,
                normal,
                curvature_radius_px,
                half_length_px: 0.5 * half,
            })
        })
        .collect()
}

/// A pixel about a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Distance inside the outline, px.
    pub inside: f64,
    /// DN.
    pub value: f64,
    /// At full scale: the light is this or more.
    pub full: bool,
}

/// The pixels about a node, and the share of inner ones that are saturated; `None` where some would be outside the
/// frame, or are not seen (no number).
pub(super) fn pixels(image: &CameraImage, node: &Node, half_width_px: f64) -> Option<(Vec<Sample>, f64)> {
    let tangent = node.normal.perp();
    let reach = node.normal.abs() * half_width_px + tangent.abs() * node.half_length_px;
    let (low, high) = ((node.at - reach - 0.5).floor(), (node.at + reach + 0.5).ceil());
    let size = DVec2::new(f64::from(image.width_px), f64::from(image.height_px));
    if low.min_element() < 0.0 || high.cmpgt(size).any() {
        return None;
    }
    let saturation = image.full_scale_dn * 0.995;
    // Columns (offsets) of a row at which |slope x + offset| is within a limit.
    let between = |slope: f64, offset: f64, limit: f64| match (limit / slope).abs() {
        reach if reach < f64::MAX => [-offset / slope - reach, -offset / slope + reach],
        _ => [f64::MIN, f64::MAX],
    };
    // What a piece's end is inside the outline's tangent.
    let sagitta = node.half_length_px * node.half_length_px / (2.0 * node.curvature_radius_px);
    let mut out = Vec::with_capacity((4.0 * (half_width_px + 1.0) * (node.half_length_px + 1.0)) as usize);
    let (mut inner, mut saturated) = (0usize, 0usize);
    for row in low.y as usize..high.y as usize {
        let line = image.row(row);
        let down = row as f64 + 0.5 - node.at.y;
        let [by_length, by_width] = [
            between(tangent.x, tangent.y * down, node.half_length_px),
            between(node.normal.x, node.normal.y * down, half_width_px + sagitta),
        ];
        let first = (node.at.x - 0.5 + by_length[0].max(by_width[0])).floor().max(low.x);
        let end = (node.at.x + 0.5 + by_length[1].min(by_width[1])).ceil().min(high.x);
        for column in first as usize..end.max(0.0) as usize {
            let off = DVec2::new(column as f64 + 0.5 - node.at.x, down);
            let along = off.dot(tangent);
            let inside = -off.dot(node.normal) - along * along / (2.0 * node.curvature_radius_px);
            if along.abs() > node.half_length_px || inside.abs() > half_width_px {
                continue;
            }
            if line[column].is_nan() {
                return None;
            }
            let full = line[column] >= saturation;
            inner += usize::from(inside > 0.0);
            saturated += usize::from(full && inside > 0.0);
            out.push(Sample { inside, value: f64::from(line[column]), full });
        }
    }
    Some((out, saturated as f64 / inner.max(1) as f64))
}

/// The outermost place where the profile has half its step, px outside the outline: a start for [`fit_edge`]. `None`
/// without a step above the noise.
pub(super) fn crossing(samples: &[Sample], half_width_px: f64, noise_dn: f64) -> Option<f64> {
    let count = (2.0 * half_width_px).ceil() as usize;
    let mut bins = vec![(0.0, 0usize); count];
    for Sample { inside, value, .. } in samples {
        let bin = &mut bins[((inside + half_width_px) as usize).min(count - 1)];
        *bin = (bin.0 + value, bin.1 + 1);
    }
    let profile: Vec<[f64; 2]> = bins
        .iter()
        .enumerate()
        .filter(|(_, bin)| bin.1 > 0)
        .map(|(k, bin)| [k as f64 + 0.5 - half_width_px, bin.0 / bin.1 as f64])
        .collect();
    let outside = profile.first()?[1].min(profile.get(1)?[1]);
    let most = profile.iter().map(|bin| bin[1]).fold(f64::MIN, f64::max);
    if most - outside < 5.0 * noise_dn {
        return None;
    }
    let half = 0.5 * (most + outside);
    let pair = profile.windows(2).find(|pair| pair[0][1] < half && pair[1][1] >= half)?;
    let part = (half - pair[0][1]) / (pair[1][1] - pair[0][1]);
    Some(-(pair[0][0] + part * (pair[1][0] - pair[0][0])))
}

/// A step shorter than this is the last, px: what is left after it is far below a thousandth.
const SETTLED_PX: f64 = 2e-4;

/// Fits the edge of one node's pixels by Gauss-Newton; `None` where it does not converge within `half_width_px / 2`.
/// A saturated pixel says that its light is at least full scale (a censored observation, Tobin 1958): it counts while
/// the model is below that, and not where it is above.
pub(super) fn fit_edge(
    node: &Node,
    samples: &[Sample],
    start_px: f64,
    half_width_px: f64,
    blur_px: f64,
    noise_dn: f64,
) -> Option<Edge> {
    if samples.iter().filter(|sample| !sample.full).count() < 12 {
        return None;
    }
    let table = &*NORMAL;
    let per_blur = 1.0 / blur_px;
    let mut shift = start_px;
    let mut solution = DVec4::ZERO;
    for turn in 0..8 {
        // The last column is the derivative by the shift, with the amplitudes of the turn before.
        let [by_density, by_step] =
            if turn == 0 { [per_blur, 0.0] } else { [solution.y * per_blur, solution.z] };
        let mut sums = Sums::default();
        for &Sample { inside, value, full } in samples {
            let u = inside + shift;
            let (step, density) = table.at(u * per_blur);
            let ramp = u * step + blur_px * density;
            if full && turn > 0 && solution.x + solution.y * step + solution.z * ramp >= value {
                continue;
            }
            sums.add([step, ramp, by_density * density + by_step * step], value);
        }
        let (normal, right) = sums.equations();
        // Columns are scaled to unit length: DN and pixels differ by many digits.
        let scale = DVec4::from_array([0, 1, 2, 3].map(|k| normal.col(k)[k].max(1e-30).sqrt().recip()));
        let scaling = DMat4::from_diagonal(scale);
        let scaled = scaling * normal * scaling;
        if scaled.determinant().abs() < 1e-14 {
            return None;
        }
        let inverse = scaling * scaled.inverse() * scaling;
        let solved = inverse * right;
        let change = if turn == 0 { solved.w / solved.y } else { solved.w };
        solution = solved;
        if !change.is_finite() {
            return None;
        }
        shift += change.clamp(-0.5 * blur_px - 0.3, 0.5 * blur_px + 0.3);
        if shift.abs() > 0.5 * half_width_px {
            return None;
        }
        if turn > 0 && change.abs() < SETTLED_PX {
            // |y - J p|^2, in the form that errors of p change least.
            let misfit = (sums.square - 2.0 * solved.dot(right) + solved.dot(normal * solved)).max(0.0);
            let freedom = (sums.count as usize).saturating_sub(4).max(1);
            let variance = (misfit / freedom as f64).max(noise_dn * noise_dn);
            return Some(Edge {
                node: *node,
                // A Gaussian blur draws the half level of a disc of radius R inwards by s^2 / 2 R.
                shift_px: shift + blur_px * blur_px / (2.0 * node.curvature_radius_px),
                blurred_shift_px: shift,
                sigma_px: (variance * inverse.w_axis.w).sqrt(),
                amplitude_dn: solution.y,
                misfit: (misfit, freedom),
                saturated: 0.0,
            });
        }
    }
    None
}

/// Normal equations of rows (1, a, b, c), symmetric: each product is summed once.
#[derive(Default)]
struct Sums {
    count: f64,
    first: [f64; 3],
    squares: [f64; 6],
    right: [f64; 4],
    /// Of the values' squares.
    square: f64,
}

impl Sums {
    fn add(&mut self, [a, b, c]: [f64; 3], value: f64) {
        self.count += 1.0;
        self.square += value * value;
        for (sum, term) in self.first.iter_mut().zip([a, b, c]) {
            *sum += term;
        }
        for (sum, term) in self.squares.iter_mut().zip([a * a, a * b, a * c, b * b, b * c, c * c]) {
            *sum += term;
        }
        for (sum, term) in self.right.iter_mut().zip([value, a * value, b * value, c * value]) {
            *sum += term;
        }
    }

    fn equations(&self) -> (DMat4, DVec4) {
        let ([a, b, c], [aa, ab, ac, bb, bc, cc]) = (self.first, self.squares);
        let columns = [[self.count, a, b, c], [a, aa, ab, ac], [b, ab, bb, bc], [c, ac, bc, cc]];
        (DMat4::from_cols_array_2d(&columns), DVec4::from_array(self.right))
    }
}

/// Nodes of the table on each side of 0 for a unit.
const NODES: usize = 64;
/// Where the tails are taken for 0: Phi(-6) = 1e-9.
const REACH: usize = 6;

/// Phi and phi of the standard normal distribution at the nodes; between them by Taylor's series about the nearest, whose
/// error is (1 / 128)^4 / 24 times the fourth derivative: 2e-10.
struct NormalTable(Vec<[f64; 2]>);

static NORMAL: LazyLock<NormalTable> = LazyLock::new(|| {
    let node = |k: usize| normal_distribution(k as f64 / NODES as f64 - REACH as f64);
    NormalTable((0..=2 * REACH * NODES).map(node).collect())
});

impl NormalTable {
    /// (Phi, phi).
    fn at(&self, x: f64) -> (f64, f64) {
        if x.is_nan() || x.abs() >= REACH as f64 {
            return (if x > 0.0 { 1.0 } else { 0.0 }, 0.0);
        }
        let place = (x + REACH as f64) * NODES as f64;
        let nearest = (place + 0.5) as usize;
        let [step, density] = self.0[nearest];
        let node = nearest as f64 / NODES as f64 - REACH as f64;
        let off = (place - nearest as f64) / NODES as f64;
        // Derivatives of phi over phi: -x, x^2 - 1, 3 x - x^3.
        let (first, second) = (-node, node * node - 1.0);
        let third = node * (2.0 - second);
        let integral = 1.0 + off * (first / 2.0 + off * (second / 6.0 + off * (third / 24.0)));
        let value = 1.0 + off * (first + off * (second / 2.0 + off * (third / 6.0)));
        (step + density * off * integral, density * value)
    }
}

/// [Phi, phi] of the standard normal distribution; Phi by Abramowitz and Stegun 7.1.26, within 7.5e-8.
fn normal_distribution(x: f64) -> [f64; 2] {
    let bell = (-0.5 * x * x).exp();
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs() * std::f64::consts::FRAC_1_SQRT_2);
    let series = t
        * (0.254_829_592
            + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    let tail = 0.5 * series * bell;
    [if x > 0.0 { 1.0 - tail } else { tail }, bell / std::f64::consts::TAU.sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_distribution_is_the_tables() {
        // Phi and phi by an independent routine (scipy.stats.norm); the approximation is good to 7.5e-8.
        for (x, step, density) in [
            (0.02, 0.507978313717, 0.398862499924),
            (1.01, 0.843752354979, 0.239551097728),
            (2.5, 0.993790334674, 0.017528300494),
        ] {
            let (found_step, found_density) = NORMAL.at(x);
            assert!((found_step - step).abs() < 1e-7, "{x}: {found_step}");
            assert!((found_density - density).abs() < 1e-9, "{x}: {found_density}");
            let (mirrored, _) = NORMAL.at(-x);
            assert!((mirrored + found_step - 1.0).abs() < 1e-7);
        }
        assert_eq!((NORMAL.at(7.0), NORMAL.at(-7.0)), ((1.0, 0.0), (0.0, 0.0)));
    }
}
