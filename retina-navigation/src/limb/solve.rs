//! From an image to a position, or a refusal.

use glam::{DMat4, DVec2};
use rayon::prelude::*;
use retina_geometry::LimbEllipse;
use retina_image::CameraImage;
use serde_json::{Value, json};

use super::blur::blur;
use super::coarse::{Coarse, coarse};
use super::edge::{Edge, Node, crossing, fit_edge, pixels};
use super::fit::Measured;
use super::judge::judge;
use super::lit::LEAST_COS_SUN;
use super::outline::Outline;
use super::shading::Shading;
use super::side::side;
use super::smear::refuse_smear;
use super::start::{Start, no_limb, outline_shape, start};
use super::{LimbBody, LimbCamera, LimbOptions, LimbSolution, Refusal};

/// So many edges are measured in a second width.
const MOST_WIDE: usize = 48;
/// Edges are measured about the outline, which they move: at most so many times.
const MOST_TURNS: usize = 3;
/// Not again about one that has moved by less than this, px.
const SAME_OUTLINE_PX: f64 = 0.01;
/// A step below this share of the limb's brightest quarter is no lit limb.
const LEAST_STEP: f64 = 0.12;
/// More of the pixels inside the limb than this may not be saturated.
const MOST_SATURATED: f64 = 0.6;
/// Nor of a single piece's.
const MOST_SATURATED_PIECE: f64 = 0.8;
/// Pixels to either side of the limb that the blur is found from.
const BLUR_WINDOW_PX: f64 = 8.0;
/// A blur above this share of the window is looked at in twice the window.
const WIDE_BLUR: f64 = 0.25;

/// Directions of the Sun that are tried where a silhouette is fitted and none is given.
const SUNS: usize = 8;
/// A point this near to the outline is on it, px.
const ON_SILHOUETTE_PX: f64 = 0.3;

/// Measures the limb of `body` in an image: its centre in the camera's frame, or the origin of its shape's axes. Pixels
/// that are no number (NaN) are not seen.
///
/// # Errors
/// There is none, or not enough of it: see [`Refusal`].
pub fn solve_limb(
    image: &CameraImage,
    camera: &LimbCamera,
    body: &LimbBody,
    options: &LimbOptions,
) -> Result<LimbSolution, Refusal> {
    if body.shape.is_none() || options.sun_direction_px.is_some() {
        return solve_lit(image, camera, body, options);
    }
    // An irregular outline has a terminator that may look like another part of it: of all directions of the Sun that one
    // counts by which most of the border is the silhouette.
    let suns = (0..SUNS).map(|k| Some(DVec2::from_angle(std::f64::consts::TAU * k as f64 / SUNS as f64)));
    let answers: Vec<Result<LimbSolution, Refusal>> = std::iter::once(None)
        .chain(suns)
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|sun| solve_lit(image, camera, body, &LimbOptions { sun_direction_px: sun, ..*options }))
        .collect();
    let on_it = |solution: &LimbSolution| {
        solution
            .points
            .iter()
            .filter(|point| point.used && point.residual_px.abs() < ON_SILHOUETTE_PX)
            .count()
    };
    let mut answers = answers.into_iter();
    let first = answers.next().unwrap_or(Err(Refusal::NoBody { least_radius_px: options.least_radius_px }));
    answers.fold(first, |best, other| match (&best, &other) {
        (Err(_), Ok(_)) => other,
        (Ok(one), Ok(another)) if on_it(another) > on_it(one) => other,
        _ => best,
    })
}

/// [`solve_limb`] for one direction of the Sun, or one that the border says.
fn solve_lit(
    image: &CameraImage,
    camera: &LimbCamera,
    body: &LimbBody,
    options: &LimbOptions,
) -> Result<LimbSolution, Refusal> {
    let Start { seen, mut lit, mut position_m } = start(image, camera, body, options)?;
    let not = |why| Refusal::NotTheBody { why };
    let size = f64::from(image.width_px.max(image.height_px));
    let height_m = options.limb_height_m;
    let mut blur_px = 1.0;
    let mut width_px = BLUR_WINDOW_PX;
    let mut open_px2 = DMat4::ZERO;
    let mut last = Measurement::default();
    let mut measured_at: Option<Outline> = None;
    for turn in 0..MOST_TURNS {
        let outline = Outline::new(body, height_m, position_m, camera)
            .ok_or_else(|| not("its border fits no body in front of the camera"))?;
        let ellipse = outline.ellipse;
        if let Some(before) = &measured_at
            && moved_px(&before.ellipse, &ellipse) < SAME_OUTLINE_PX
        {
            break;
        }
        let mean_radius = 0.5 * (ellipse.semi_axes_px[0] + ellipse.semi_axes_px[1]);
        if !(options.least_radius_px * 0.8..4.0 * size).contains(&mean_radius) {
            return Err(not("its border fits no body of the size"));
        }
        let all = outline.nodes.clone();
        if turn == 0 {
            // Wide enough that a shading inside the limb is not taken for blur.
            let width = BLUR_WINDOW_PX.min(0.3 * mean_radius);
            width_px = width;
            let nodes = lit.choose(all.clone(), width);
            let narrow = blur(image, &nodes, width, seen.noise_dn).ok();
            blur_px = match narrow {
                Some(found) if found < WIDE_BLUR * width => Some(found),
                // Flanks that reach beyond the window are looked at in a wider one.
                _ => {
                    let wide = (2.0 * BLUR_WINDOW_PX).min(0.3 * mean_radius);
                    blur(image, &lit.choose(all.clone(), wide), wide, seen.noise_dn).ok().or(narrow)
                }
            }
            .ok_or_else(|| match saturated_share(image, &nodes, width) {
                share if share > MOST_SATURATED => Refusal::Saturated { percent: 100.0 * share },
                _ => lit.unsharp(&seen),
            })?;
        }
        let width = (2.5 * blur_px + 2.5).min(0.3 * mean_radius).max(2.5);
        last = measure(image, &lit.choose(all, width), width, blur_px, &seen);
        last.outline_px = outline.nodes.iter().map(|node| node.at).collect();
        if last.saturated > MOST_SATURATED {
            return Err(Refusal::Saturated { percent: 100.0 * last.saturated });
        }
        let fitted = |points: &[Measured]| outline.fit(points, camera, body, height_m);
        last.points = last.measured();
        let mut current = fitted(&last.points)
            .ok_or_else(|| no_limb(&seen, &lit, last.points.len(), last.outline_px.len(), options))?;
        let judged = lit.sun.is_none().then(|| side(&last.points, &current, &ellipse, options.phase_rad));
        if let Some(judged) = judged {
            open_px2 = judged.open_px2;
        }
        if let Some(sun) = judged.and_then(|judged| judged.sun) {
            lit.sun = Some(sun);
            last.edges.retain(|edge| edge.node.normal.dot(sun) > LEAST_COS_SUN);
            last.points = last.measured();
            current = fitted(&last.points).ok_or_else(|| not("its border is no limb"))?;
        }
        position_m = current.position_m;
        measured_at = Some(outline);
    }
    let Some(outline) = measured_at else { return Err(not("its border is no limb")) };
    refuse_smear(image, &lit.choose(outline.nodes.clone(), width_px), width_px, seen.noise_dn)?;
    let nodes: Vec<Node> = last.edges.iter().map(|edge| edge.node).collect();
    let wide = (2.0 * (2.5 * blur_px + 2.5)).min(0.3 * seen.radius_px);
    let some: Vec<Node> = nodes.iter().step_by(nodes.len().div_ceil(MOST_WIDE).max(1)).copied().collect();
    let shading = Shading::between(&last.edges, &measure(image, &some, wide, blur_px, &seen).edges);
    for point in &mut last.points {
        point.pixel -= point.normal * shading.at(point.normal);
    }
    let current = outline.fit(&last.points, camera, body, height_m);
    let current = current.ok_or_else(|| not("its border is no limb"))?;
    judge(current, Measurement { shading, open_px2, ..last }, &seen, &lit, camera, body, options)
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
    let seen = coarse(image, outline_shape(camera, body))?;
    let saturation = image.full_scale_dn * 0.995;
    let saturated = image.count_from(saturation);
    Some(LimbLook {
        center_px: seen.center_px,
        radius_px: seen.radius_px,
        lit_width_px: seen.width_px(),
        saturated_share: (saturated as f64 / seen.lit_px2).min(1.0),
        touches_frame: seen.touches_frame,
    })
}

/// How far one outline is from another, px, at most.
fn moved_px(before: &LimbEllipse, after: &LimbEllipse) -> f64 {
    let axes = DVec2::from_array(before.semi_axes_px) - DVec2::from_array(after.semi_axes_px);
    before.center_px.distance(after.center_px) + axes.abs().max_element()
}

pub(super) fn measured(node: &Node, shift_px: f64, sigma_px: f64) -> Measured {
    Measured { pixel: node.at + node.normal * shift_px, normal: node.normal, sigma_px, index: node.index }
}

/// Mean share of the pixels inside the outline that are saturated.
fn saturated_share(image: &CameraImage, nodes: &[Node], half_width_px: f64) -> f64 {
    let shares: Vec<f64> =
        nodes.iter().filter_map(|node| Some(pixels(image, node, half_width_px)?.1)).collect();
    shares.iter().sum::<f64>() / shares.len().max(1) as f64
}

/// Edges of the nodes that show one.
#[derive(Default)]
pub(super) struct Measurement {
    pub(super) edges: Vec<Edge>,
    pub(super) points: Vec<Measured>,
    /// Nodes that are wholly inside the frame.
    pub(super) inside: usize,
    /// Places of the whole outline, px.
    pub(super) outline_px: Vec<DVec2>,
    /// Share of inner pixels that are saturated.
    pub(super) saturated: f64,
    /// Standard deviation of the edges' blur, px.
    pub(super) blur_px: f64,
    /// What the shading does to the edges; it is taken off the points.
    pub(super) shading: Shading,
    /// Covariance of radius and centre by the choice of the lit side, px^2.
    pub(super) open_px2: DMat4,
}

impl Measurement {
    /// Its edges as points.
    fn measured(&self) -> Vec<Measured> {
        self.edges.iter().map(|edge| measured(&edge.node, edge.shift_px, edge.sigma_px)).collect()
    }
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
    Measurement { edges, inside, saturated, blur_px, ..Measurement::default() }
}
