//! From an image to a position, or a refusal.

use glam::{DMat3, DMat4, DVec2, DVec3};
use rayon::prelude::*;
use retina_geometry::{LimbEllipse, limb_ellipse};
use retina_image::CameraImage;
use serde_json::{Value, json};

use super::blur::blur;
use super::coarse::{Coarse, Shape, coarse};
use super::edge::{Edge, Node, crossing, ellipse_outline, fit_edge, image_outline, pixels};
use super::fit::{Fit, Measured, fit};
use super::side::side;
use super::{LimbBody, LimbCamera, LimbCovariance, LimbOptions, LimbPoint, LimbSolution, Refusal};

/// Edges are measured about the outline, which they move: at most so many times.
const MOST_TURNS: usize = 3;
/// Not again about one that has moved by less than this, px.
const SAME_OUTLINE_PX: f64 = 0.01;
/// A thinner lit area is a crescent without an inside, px: its width is known to the cells that it is found with.
const LEAST_WIDTH_PX: f64 = 8.0;
/// A step below this share of the limb's brightest quarter is no lit limb.
const LEAST_STEP: f64 = 0.12;
/// Points are measured up to this angle from the Sun's direction, cosine: beyond, the terminator is near.
const LEAST_COS_SUN: f64 = 0.17;
/// More of the pixels inside the limb than this may not be saturated.
const MOST_SATURATED: f64 = 0.6;
/// Nor of a single piece's.
const MOST_SATURATED_PIECE: f64 = 0.8;
/// At least this share of the places that should show a limb has to.
const LEAST_FOUND: f64 = 0.5;
/// Pixels to either side of the limb that the blur is found from.
const BLUR_WINDOW_PX: f64 = 8.0;
/// A blur above this share of the window is looked at in twice the window.
const WIDE_BLUR: f64 = 0.25;
/// What a PSF that is no Gaussian, and an error of its width, may shift all edges by: along the normal, px. An
/// allowance; discs with a square pixel's aperture and Gaussian blurs stay within.
const EDGE_MODEL_SIGMA_PX: f64 = 0.015;
/// What a PSF wider than a pixel adds to it, share of its width beyond: such a one is an aberration's, no Gaussian, and
/// hills and maria within its width pull at the edge. Measured on the virtual bench, whose PSF of 3 px adds 0.2 to 0.3
/// px to the error of the Moon's radius.
const WIDE_EDGE_MODEL_SHARE: f64 = 0.1;
/// What saturation adds to it, px for all pixels inside the limb: without its plateau a shading is not told from a blur.
/// A third saturated moves the radius of shaded discs by 0.03 px.
const SATURATED_EDGE_MODEL_PX: f64 = 0.1;
/// Scatter beyond noise that a body's terrain may have: px, and share of the radius.
const MOST_EXCESS: (f64, f64) = (0.4, 0.006);

/// Measures the limb of `body` in an image: its centre in the camera's frame.
///
/// # Errors
/// There is none, or not enough of it: see [`Refusal`].
pub fn solve_limb(
    image: &CameraImage,
    camera: &LimbCamera,
    body: &LimbBody,
    options: &LimbOptions,
) -> Result<LimbSolution, Refusal> {
    let no_body = Refusal::NoBody { least_radius_px: options.least_radius_px };
    let shape = shape(camera, body);
    let seen = coarse(image, shape).ok_or(no_body)?;
    if seen.radius_px < options.least_radius_px {
        return Err(no_body);
    }
    let size = f64::from(image.width_px.max(image.height_px));
    if seen.radius_px > 4.0 * size {
        return Err(Refusal::NotTheBody { why: "its border is not curved like a body's" });
    }
    let body = LimbBody { semi_axes_m: body.semi_axes_m + options.limb_height_m, ..*body };
    let mut lit = Lit::new(&seen, options);
    if lit.width_px < LEAST_WIDTH_PX {
        return Err(Refusal::ThinCrescent { width_px: lit.width_px, arc_deg: 0.0 });
    }

    let width = (3.0 + 0.012 * seen.radius_px).min(0.3 * seen.radius_px);
    let about = LimbEllipse {
        center_px: seen.center_px,
        semi_axes_px: (shape.stretch * seen.radius_px).to_array(),
        angle_rad: shape.angle_rad,
    };
    let nodes = lit.choose(image_outline(&about), width);
    let first: Vec<Measured> = nodes
        .iter()
        .filter_map(|node| {
            let (samples, _) = pixels(image, node, width)?;
            Some(measured(node, crossing(&samples, width, seen.noise_dn)?, 0.3))
        })
        .collect();
    let not = |why| Refusal::NotTheBody { why };
    let mut current = fit(&first, camera, &body).ok_or_else(|| {
        if first.len() < 6 {
            lit.too_short(&seen, first.len(), nodes.len(), options)
        } else {
            not("its border is no limb")
        }
    })?;

    let mut blur_px = 1.0;
    let mut open_px2 = DMat4::ZERO;
    let mut last = Measurement::default();
    let mut measured_at: Option<LimbEllipse> = None;
    for turn in 0..MOST_TURNS {
        let outline =
            limb_ellipse(&camera.pinhole, current.position_m, body.camera_from_body, body.semi_axes_m)
                .ok_or_else(|| not("its border fits no body in front of the camera"))?;
        if measured_at.is_some_and(|before| moved_px(&before, &outline) < SAME_OUTLINE_PX) {
            break;
        }
        measured_at = Some(outline);
        let mean_radius = 0.5 * (outline.semi_axes_px[0] + outline.semi_axes_px[1]);
        if !(options.least_radius_px * 0.8..4.0 * size).contains(&mean_radius) {
            return Err(not("its border fits no body of the size"));
        }
        let all = ellipse_outline(&outline, camera);
        if turn == 0 {
            // Wide enough that a shading inside the limb is not taken for blur.
            let width = BLUR_WINDOW_PX.min(0.3 * mean_radius);
            let nodes = lit.choose(all.clone(), width);
            let narrow = blur(image, &nodes, width, seen.noise_dn);
            blur_px = match narrow {
                Some(found) if found < WIDE_BLUR * width => Some(found),
                // Flanks that reach beyond the window are looked at in a wider one.
                _ => {
                    let wide = (2.0 * BLUR_WINDOW_PX).min(0.3 * mean_radius);
                    blur(image, &lit.choose(all.clone(), wide), wide, seen.noise_dn).or(narrow)
                }
            }
            .ok_or_else(|| match saturated_share(image, &nodes, width) {
                share if share > MOST_SATURATED => Refusal::Saturated { percent: 100.0 * share },
                _ => lit.unsharp(&seen),
            })?;
        }
        let width = (2.5 * blur_px + 2.5).min(0.3 * mean_radius).max(2.5);
        last = measure(image, &lit.choose(all, width), width, blur_px, &seen);
        if last.saturated > MOST_SATURATED {
            return Err(Refusal::Saturated { percent: 100.0 * last.saturated });
        }
        let points: Vec<Measured> =
            last.edges.iter().map(|edge| measured(&edge.node, edge.shift_px, edge.sigma_px)).collect();
        current = fit(&points, camera, &body).ok_or_else(|| {
            if points.len() < 6 {
                lit.too_short(&seen, points.len(), last.outline, options)
            } else {
                not("its border is no limb")
            }
        })?;
        let judged = lit.sun.is_none().then(|| side(&points, &current, &outline, options.phase_rad));
        if let Some(judged) = judged {
            open_px2 = judged.open_px2;
        }
        if let Some(sun) = judged.and_then(|judged| judged.sun) {
            lit.sun = Some(sun);
            let keep: Vec<bool> =
                last.edges.iter().map(|edge| edge.node.normal.dot(sun) > LEAST_COS_SUN).collect();
            let mut kept = keep.iter();
            last.edges.retain(|_| kept.next() == Some(&true));
            let points: Vec<Measured> =
                last.edges.iter().map(|edge| measured(&edge.node, edge.shift_px, edge.sigma_px)).collect();
            current = fit(&points, camera, &body).ok_or_else(|| not("its border is no limb"))?;
            last.points = points;
        } else {
            last.points = points;
        }
    }
    judge(current, last, blur_px, open_px2, &seen, &lit, camera, &body, options)
}

/// What a first look at an image sees: the lit blob and the circle about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimbLook {
    /// Centre of the circle, px.
    pub center_px: DVec2,
    /// Its radius, px; of an ellipsoid's outline the mean semi-axis.
    pub radius_px: f64,
    /// Greatest width of the lit area, px.
    pub lit_width_px: f64,
    /// Share of the lit area that is saturated.
    pub saturated_share: f64,
    /// The lit area reaches the frame.
    pub touches_frame: bool,
}

impl LimbLook {
    pub(super) fn json(&self) -> Value {
        json!({
            "center_px": self.center_px.to_array(), "radius_px": self.radius_px, "lit_width_px": self.lit_width_px,
            "saturated_share": self.saturated_share, "touches_frame": self.touches_frame,
        })
    }

    pub(super) fn sentence(&self) -> String {
        let Self { center_px, radius_px, lit_width_px, .. } = self;
        let frame = if self.touches_frame { ", cut by the frame" } else { "" };
        let saturated = match 100.0 * self.saturated_share {
            percent if percent >= 1.0 => format!(", {percent:.0} % of it saturated"),
            _ => String::new(),
        };
        format!(
            "a lit area up to {lit_width_px:.1} px wide{frame}{saturated}, with a border like a circle of {radius_px:.1} \
             px radius about ({:.1}, {:.1}) px",
            center_px.x, center_px.y
        )
    }
}

/// A first look at an image; `None` where nothing in it is lit, or what is lit has no round border.
pub fn first_look(image: &CameraImage, camera: &LimbCamera, body: &LimbBody) -> Option<LimbLook> {
    let seen = coarse(image, shape(camera, body))?;
    let saturation = image.full_scale_dn * 0.995;
    let saturated = image.values.iter().filter(|value| **value >= saturation).count();
    Some(LimbLook {
        center_px: seen.center_px,
        radius_px: seen.radius_px,
        lit_width_px: Lit::new(&seen, &LimbOptions::default()).width_px,
        saturated_share: (saturated as f64 / seen.lit_px2).min(1.0),
        touches_frame: seen.touches_frame,
    })
}

/// How far one outline is from another, px, at most.
fn moved_px(before: &LimbEllipse, after: &LimbEllipse) -> f64 {
    let axes = DVec2::from_array(before.semi_axes_px) - DVec2::from_array(after.semi_axes_px);
    before.center_px.distance(after.center_px) + axes.abs().max_element()
}

/// The outline's shape from afar on the boresight: where the body is changes it by little.
fn shape(camera: &LimbCamera, body: &LimbBody) -> Shape {
    let far = DVec3::Z * (1e3 * body.semi_axes_m.max_element());
    match limb_ellipse(&camera.pinhole, far, body.camera_from_body, body.semi_axes_m) {
        None => Shape { angle_rad: 0.0, stretch: DVec2::ONE },
        Some(ellipse) => {
            let axes = DVec2::from_array(ellipse.semi_axes_px);
            Shape { angle_rad: ellipse.angle_rad, stretch: axes * 2.0 / axes.element_sum() }
        }
    }
}

fn measured(node: &Node, shift_px: f64, sigma_px: f64) -> Measured {
    Measured { pixel: node.at + node.normal * shift_px, normal: node.normal, sigma_px, index: node.index }
}

/// The lit side.
struct Lit {
    /// Towards the Sun in the image, unit; `None` where the whole limb is lit.
    sun: Option<DVec2>,
    /// Greatest width of the lit area, px.
    width_px: f64,
}

impl Lit {
    fn new(seen: &Coarse, options: &LimbOptions) -> Self {
        let off = seen.lit_center_px - seen.center_px;
        // A half ellipse of greatest width w beside a half disc: the lit area is pi R w / 2.
        let width_px = 2.0 * seen.lit_px2 / (std::f64::consts::PI * seen.radius_px);
        let whole = off.length() < 1.0 + 0.003 * seen.radius_px;
        let found = (!whole).then(|| off.normalize());
        let given = options.sun_direction_px.and_then(DVec2::try_normalize);
        Self { sun: given.or(found), width_px }
    }

    /// Nodes that should show a lit limb: towards the Sun, the terminator further inside than the pixels that are fitted.
    /// At an angle p from the Sun's direction it is w cos^2 p away.
    fn choose(&self, nodes: Vec<Node>, half_width_px: f64) -> Vec<Node> {
        let Some(sun) = self.sun else { return nodes };
        let deep = |cos: f64| self.width_px * cos * cos > 1.5 * half_width_px;
        nodes
            .into_iter()
            .filter(|node| {
                let cos = node.normal.dot(sun);
                cos > LEAST_COS_SUN && deep(cos)
            })
            .collect()
    }

    /// Why no blur fits: both borders of a thin crescent are in the pixels that are looked at.
    fn unsharp(&self, seen: &Coarse) -> Refusal {
        if self.width_px < 0.3 * seen.radius_px {
            Refusal::ThinCrescent { width_px: self.width_px, arc_deg: 0.0 }
        } else {
            Refusal::NotTheBody { why: "its border is not as sharp as a limb" }
        }
    }

    fn too_short(&self, seen: &Coarse, found: usize, all: usize, options: &LimbOptions) -> Refusal {
        let arc_deg = 360.0 * found as f64 / all.max(1) as f64;
        if seen.touches_frame {
            Refusal::CutByFrame { arc_deg, least_deg: options.least_arc_rad.to_degrees() }
        } else if self.width_px < 0.5 * seen.radius_px {
            Refusal::ThinCrescent { width_px: self.width_px, arc_deg }
        } else {
            Refusal::NotTheBody { why: "too little of its border is a limb" }
        }
    }
}

/// Mean share of the pixels inside the outline that are saturated.
fn saturated_share(image: &CameraImage, nodes: &[Node], half_width_px: f64) -> f64 {
    let shares: Vec<f64> =
        nodes.iter().filter_map(|node| Some(pixels(image, node, half_width_px)?.1)).collect();
    shares.iter().sum::<f64>() / shares.len().max(1) as f64
}

/// Edges of the nodes that show one.
#[derive(Default)]
struct Measurement {
    edges: Vec<Edge>,
    points: Vec<Measured>,
    /// Nodes that are wholly inside the frame.
    inside: usize,
    /// Nodes of the whole outline.
    outline: usize,
    /// Share of inner pixels that are saturated.
    saturated: f64,
}

fn measure(
    image: &CameraImage,
    nodes: &[Node],
    half_width_px: f64,
    blur_px: f64,
    seen: &Coarse,
) -> Measurement {
    let found: Vec<(Option<Edge>, f64)> = nodes
        .par_iter()
        .with_min_len(16)
        .filter_map(|node| {
            let (samples, saturated) = pixels(image, node, half_width_px)?;
            let edge = crossing(&samples, half_width_px, seen.noise_dn)
                .filter(|start| start.abs() < 0.5 * half_width_px)
                .and_then(|start| fit_edge(node, &samples, start, half_width_px, blur_px, seen.noise_dn));
            Some((edge.map(|edge| Edge { saturated, ..edge }), saturated))
        })
        .collect();
    let inside = found.len();
    let saturated = found.iter().map(|(_, share)| share).sum::<f64>() / inside.max(1) as f64;
    let mut edges: Vec<Edge> = found.into_iter().filter_map(|(edge, _)| edge).collect();
    let mut steps: Vec<f64> = edges.iter().map(|edge| edge.amplitude_dn).collect();
    if !steps.is_empty() {
        let at = steps.len() * 3 / 4;
        let least = LEAST_STEP * *steps.select_nth_unstable_by(at, f64::total_cmp).1;
        edges.retain(|edge| {
            // A piece without its plateau says little, and its sigma says so; one without anything below it says nothing.
            edge.amplitude_dn > least.max(0.0) && edge.sigma_px < 1.0 && edge.saturated < MOST_SATURATED_PIECE
        });
    }
    let length = |node: &Node| 2.0 * node.half_length_px / node.curvature_radius_px;
    let outline = nodes.first().map_or(0, |node| (std::f64::consts::TAU / length(node)).round() as usize);
    Measurement { edges, points: Vec::new(), inside, outline, saturated }
}

/// What is asked of an answer, and the answer.
fn judge(
    fit: Fit,
    last: Measurement,
    blur_px: f64,
    open_px2: DMat4,
    seen: &Coarse,
    lit: &Lit,
    camera: &LimbCamera,
    body: &LimbBody,
    options: &LimbOptions,
) -> Result<LimbSolution, Refusal> {
    let not = |why| Refusal::NotTheBody { why };
    let nodes = last.edges.iter().zip(&fit.used).filter(|(_, used)| **used);
    let arc_rad: f64 =
        nodes.map(|(edge, _)| 2.0 * edge.node.half_length_px / edge.node.curvature_radius_px).sum();
    let used = fit.used.iter().filter(|used| **used).count();
    if arc_rad < options.least_arc_rad || used < 10 {
        return Err(lit.too_short(seen, used, last.outline, options));
    }
    if (used as f64) < LEAST_FOUND * last.inside as f64 {
        return Err(not("most of its border is not where a limb would be"));
    }
    let outline = |position| {
        limb_ellipse(&camera.pinhole, position, body.camera_from_body, body.semi_axes_m)
            .ok_or_else(|| not("its border fits no body in front of the camera"))
    };
    let ellipse = outline(fit.position_m)?;
    let mean_radius = |e: &LimbEllipse| 0.5 * (e.semi_axes_px[0] + e.semi_axes_px[1]);
    let radius = mean_radius(&ellipse);
    if fit.excess_sigma_px > MOST_EXCESS.0 + MOST_EXCESS.1 * radius {
        return Err(not("its border is rougher than a limb"));
    }
    let scaled: Vec<(usize, f64)> = (0..last.points.len())
        .filter(|&k| fit.used[k])
        .map(|k| {
            let point = &last.points[k];
            (point.index, fit.residuals_px[k] / point.sigma_px.hypot(fit.excess_sigma_px))
        })
        .collect();
    let correlation_factor = correlation_factor(&scaled);
    let distance_m = fit.position_m.length();
    let along = fit.position_m / distance_m;
    let outer = DMat3::from_cols(along * along.x, along * along.y, along * along.z);
    // Both act as an error of the body's radius and, less than that over an arc, of its centre.
    let metres_per_px = body.mean_radius_m() / radius;
    let edge_model_px = (EDGE_MODEL_SIGMA_PX
        + WIDE_EDGE_MODEL_SHARE * (blur_px - 1.0).max(0.0)
        + SATURATED_EDGE_MODEL_PX * last.saturated)
        .hypot(options.tone_sigma_share * blur_px);
    let by_height = |height_m: f64| {
        outer * (height_m * distance_m / body.mean_radius_m()).powi(2)
            + (DMat3::IDENTITY - outer) * (height_m * height_m)
    };
    // Radius, centre x and centre y of the outline to the position.
    let moves = DMat3::from_cols(
        fit.position_m * (-1.0 / radius),
        (DVec3::X - along * along.x) * metres_per_px,
        (DVec3::Y - along * along.y) * metres_per_px,
    );
    let parts = LimbCovariance {
        points_m2: fit.covariance_m2 * correlation_factor,
        height_m2: by_height(options.limb_height_sigma_m),
        edge_model_m2: by_height(edge_model_px * metres_per_px),
        side_m2: moves * DMat3::from_mat4(open_px2) * moves.transpose(),
    };
    let covariance_m2 = parts.sum_m2();
    // Weights are 1 / (noise^2 + excess^2): what of the weighted scatter is noise.
    let weights = || {
        let used = last.points.iter().zip(&fit.used).filter(|(_, used)| **used);
        used.map(|(point, _)| {
            let own = point.sigma_px * point.sigma_px;
            (own, 1.0 / (own + fit.excess_sigma_px * fit.excess_sigma_px))
        })
    };
    let noise_share =
        weights().map(|(own, w)| w * w * own).sum::<f64>() / weights().map(|(_, w)| w).sum::<f64>();

    // Derivatives of radius and centre by the position, for their standard deviations.
    let step = 1e-5 * distance_m;
    let mut slopes = [DVec3::ZERO; 3];
    for (axis, unit) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
        let [more, less] = [outline(fit.position_m + unit * step)?, outline(fit.position_m - unit * step)?];
        let center = (more.center_px - less.center_px) / (2.0 * step);
        slopes[0][axis] = (mean_radius(&more) - mean_radius(&less)) / (2.0 * step);
        slopes[1][axis] = center.x;
        slopes[2][axis] = center.y;
    }
    let sigma = slopes.map(|slope| slope.dot(covariance_m2 * slope).sqrt());
    let squares = fit.residuals_px.iter().zip(&fit.used).filter(|(_, used)| **used).map(|(r, _)| r * r);
    let rms_px = (squares.sum::<f64>() / used as f64).sqrt();
    let points = last.points.iter().zip(&fit.residuals_px).zip(&fit.used).map(|((point, residual), used)| {
        LimbPoint { pixel: point.pixel, sigma_px: point.sigma_px, residual_px: *residual, used: *used }
    });
    Ok(LimbSolution {
        position_camera_m: fit.position_m,
        covariance_m2,
        parts,
        sun_direction_px: lit.sun,
        noise_covariance_m2: fit.covariance_m2 * noise_share,
        ellipse,
        radius_px: [radius, sigma[0]],
        center_sigma_px: DVec2::new(sigma[1], sigma[2]),
        points: points.collect(),
        rms_px,
        excess_sigma_px: fit.excess_sigma_px,
        correlation_factor,
        arc_rad,
        blur_sigma_px: blur_px,
    })
}

/// 1 + 2 sum of the autocorrelation of residuals (place on the outline, residual) along the outline, up to where it sinks into its noise: by so much the
/// variance of a mean of correlated values is greater. At least 1.
pub(super) fn correlation_factor(scaled: &[(usize, f64)]) -> f64 {
    let power = scaled.iter().map(|(_, r)| r * r).sum::<f64>() / scaled.len().max(1) as f64;
    let noise = 1.5 / (scaled.len() as f64).sqrt();
    let mut factor = 1.0;
    for lag in 1..(scaled.len() / 6).max(2) {
        // Points are in the order of their index, with gaps.
        let (mut sum, mut count) = (0.0, 0usize);
        for (k, (index, value)) in scaled.iter().enumerate() {
            let partner = scaled[k..].iter().take(lag + 1).find(|(other, _)| *other == index + lag);
            if let Some((_, other)) = partner {
                sum += value * other;
                count += 1;
            }
        }
        let correlation = if count > 0 { sum / (count as f64 * power) } else { 0.0 };
        if correlation < noise {
            break;
        }
        factor += 2.0 * correlation;
    }
    factor
}
