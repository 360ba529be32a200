//! Where a body is, to a few pixels: the start of a measurement.
//!
//! An ellipsoid's outline is laid about the lit border (`coarse`). A shape of its own is compared with the border by
//! support functions: the furthest reach in each direction, which grows with the body's size, moves with its place, and
//! on the lit side depends on nothing else.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};
use retina_geometry::{LimbEllipse, limb_ellipse};
use retina_image::CameraImage;

use super::coarse::{Coarse, Shape, coarse, lit_border};
use super::edge::{Node, crossing, image_outline, pixels};
use super::fit::{Measured, fit};
use super::lit::Lit;
use super::outline::Outline;
use super::shape::BodyShape;
use super::solve::measured;
use super::{LimbBody, LimbCamera, LimbOptions, Refusal};

/// A thinner lit area is a crescent without an inside, px: its width is known to the cells that it is found with.
const LEAST_WIDTH_PX: f64 = 8.0;
/// Directions of the support function, and of the Sun where it is looked for.
const DIRECTIONS: usize = 72;
/// Directions up to this angle from the Sun's are limb, cosine.
const LEAST_COS_LIMB: f64 = 0.1;
/// Turns of the support function's fit: a body is seen from elsewhere when it stands elsewhere.
const SUPPORT_TURNS: usize = 3;
/// A border that fits the whole silhouette within this is lit all round: share of the radius.
const WHOLE: f64 = 0.015;
/// Borders that fit no better than this are not the body's: share of the radius.
const MOST_OFF: f64 = 0.15;

/// What a measurement begins with.
pub(super) struct Start {
    pub seen: Coarse,
    pub lit: Lit,
    pub position_m: DVec3,
}

/// Finds the body.
pub(super) fn start(
    image: &CameraImage,
    camera: &LimbCamera,
    body: &LimbBody,
    options: &LimbOptions,
) -> Result<Start, Refusal> {
    let no_body = Refusal::NoBody { least_radius_px: options.least_radius_px };
    let found = match &body.shape {
        None => of_ellipsoid(image, camera, body, options),
        Some(shape) => of_shape(image, camera, body, shape, options),
    };
    found?.ok_or(no_body)
}

/// The body's size is one that can be measured.
fn check_size(image: &CameraImage, seen: &Coarse, lit: &Lit, options: &LimbOptions) -> Result<(), Refusal> {
    if seen.radius_px < options.least_radius_px {
        return Err(Refusal::NoBody { least_radius_px: options.least_radius_px });
    }
    if seen.radius_px > 4.0 * f64::from(image.width_px.max(image.height_px)) {
        return Err(Refusal::NotTheBody { why: "its border is not curved like a body's" });
    }
    if lit.width_px < LEAST_WIDTH_PX {
        return Err(Refusal::ThinCrescent { width_px: lit.width_px, arc_deg: 0.0 });
    }
    Ok(())
}

fn of_ellipsoid(
    image: &CameraImage,
    camera: &LimbCamera,
    body: &LimbBody,
    options: &LimbOptions,
) -> Result<Option<Start>, Refusal> {
    let shape = outline_shape(camera, body);
    let Some(seen) = coarse(image, shape) else { return Ok(None) };
    let lit = Lit::new(&seen, options);
    check_size(image, &seen, &lit, options)?;
    let width = first_width_px(seen.radius_px);
    let about = LimbEllipse {
        center_px: seen.center_px,
        semi_axes_px: (shape.stretch * seen.radius_px).to_array(),
        angle_rad: shape.angle_rad,
    };
    let nodes = lit.choose(image_outline(&about), width);
    let all = nodes.len();
    let points = crossings(image, nodes, width, seen.noise_dn);
    let found = fit(&points, camera, body, options.limb_height_m)
        .ok_or_else(|| no_limb(&seen, &lit, points.len(), all, options))?;
    Ok(Some(Start { seen, lit, position_m: found.position_m }))
}

/// The outline's shape from afar on the boresight: where the body is changes it by little.
pub(super) fn outline_shape(camera: &LimbCamera, body: &LimbBody) -> Shape {
    let far = DVec3::Z * (1e3 * body.semi_axes_m.max_element());
    match limb_ellipse(&camera.pinhole, far, body.camera_from_body, body.semi_axes_m) {
        None => Shape { angle_rad: 0.0, stretch: DVec2::ONE },
        Some(ellipse) => {
            let axes = DVec2::from_array(ellipse.semi_axes_px);
            Shape { angle_rad: ellipse.angle_rad, stretch: axes * 2.0 / axes.element_sum() }
        }
    }
}

fn of_shape(
    image: &CameraImage,
    camera: &LimbCamera,
    body: &LimbBody,
    shape: &BodyShape,
    options: &LimbOptions,
) -> Result<Option<Start>, Refusal> {
    let not = |why| Refusal::NotTheBody { why };
    let Some(border) = lit_border(image) else { return Ok(None) };
    let places: Vec<DVec2> = border.points.iter().filter_map(|pixel| camera.line_of_sight(*pixel)).collect();
    if places.len() < 12 {
        return Ok(None);
    }
    let mut position_m = DVec3::Z * (1e3 * body.semi_axes_m.max_element());
    let mut sun = options.sun_direction_px.and_then(DVec2::try_normalize);
    let mut support = None;
    for _ in 0..SUPPORT_TURNS {
        let found = Support::new(shape, body.camera_from_body, position_m, &places, sun)
            .ok_or_else(|| not("its border is not the shape's"))?;
        position_m = found.position_m;
        support = Some(found);
    }
    let Some(support) = support else { return Ok(None) };
    if support.rms > MOST_OFF * support.radius {
        return Err(not("its border is not the shape's"));
    }
    sun = sun.or(support.sun);
    let center = position_m.truncate() / position_m.z;
    let seen = Coarse {
        center_px: camera.pixel(center).ok_or_else(|| not("it stands outside the camera's field"))?,
        radius_px: support.radius * camera.pinhole.fx_px,
        lit_px2: border.lit_px2,
        lit_center_px: border.lit_center_px,
        noise_dn: border.noise_dn,
        touches_frame: border.touches_frame,
    };
    let lit = Lit { sun, width_px: seen.width_px() };
    check_size(image, &seen, &lit, options)?;
    let width = first_width_px(seen.radius_px);
    let outline = Outline::new(body, options.limb_height_m, position_m, camera)
        .ok_or_else(|| not("its border fits no body in front of the camera"))?;
    let points = crossings(image, lit.choose(outline.nodes.clone(), width), width, seen.noise_dn);
    let found = outline
        .fit(&points, camera, body, options.limb_height_m)
        .ok_or_else(|| no_limb(&seen, &lit, points.len(), outline.nodes.len(), options))?;
    Ok(Some(Start { seen, lit, position_m: found.position_m }))
}

/// Half the width in which edges are looked for first, px.
fn first_width_px(radius_px: f64) -> f64 {
    (3.0 + 0.012 * radius_px).min(0.3 * radius_px)
}

/// Where the nodes' profiles have half their step.
fn crossings(image: &CameraImage, nodes: Vec<Node>, half_width_px: f64, noise_dn: f64) -> Vec<Measured> {
    nodes
        .iter()
        .filter_map(|node| {
            let (samples, _) = pixels(image, node, half_width_px)?;
            Some(measured(node, crossing(&samples, half_width_px, noise_dn)?, 0.3))
        })
        .collect()
}

pub(super) fn no_limb(seen: &Coarse, lit: &Lit, found: usize, all: usize, options: &LimbOptions) -> Refusal {
    if found < 6 {
        lit.too_short(seen, found, all, options)
    } else {
        Refusal::NotTheBody { why: "its border is no limb" }
    }
}

/// A border compared with a shape by their support functions, on the tangent plane.
struct Support {
    position_m: DVec3,
    /// Mean of the silhouette's reach.
    radius: f64,
    /// What is left of the limb's reach, root mean square.
    rms: f64,
    sun: Option<DVec2>,
}

impl Support {
    /// With the silhouette as it is seen at `position_m`. Without the Sun's direction that one is taken whose half of the
    /// border fits best; none, where the whole border does.
    fn new(
        shape: &BodyShape,
        camera_from_body: DMat3,
        position_m: DVec3,
        border: &[DVec2],
        sun: Option<DVec2>,
    ) -> Option<Self> {
        let directions: Vec<DVec2> =
            (0..DIRECTIONS).map(|k| DVec2::from_angle(TAU * k as f64 / DIRECTIONS as f64)).collect();
        let reach: Vec<f64> = directions
            .iter()
            .map(|direction| border.iter().map(|at| direction.dot(*at)).fold(f64::MIN, f64::max))
            .collect();
        let own = shape.supports(position_m, camera_from_body, &directions)?;
        let fitted = |sun: Option<DVec2>| {
            let limb: Vec<usize> = (0..DIRECTIONS)
                .filter(|&k| sun.is_none_or(|sun| sun.dot(directions[k]) > LEAST_COS_LIMB))
                .collect();
            let rows: Vec<(DVec3, f64)> =
                limb.iter().map(|&k| (directions[k].extend(own[k]), reach[k])).collect();
            by_absolute_values(&rows)
        };
        // Nothing of the border may be further out than the shape, on the dark side either.
        let off = |found: DVec3, k: usize| reach[k] - directions[k].extend(own[k]).dot(found);
        let (found, rms, sun) = match sun {
            Some(sun) => {
                let (found, rms) = fitted(Some(sun))?;
                (found, rms, Some(sun))
            }
            None => {
                let whole = fitted(None)?;
                let mean = own.iter().sum::<f64>() / DIRECTIONS as f64 * whole.0.z;
                if whole.1 < WHOLE * mean {
                    (whole.0, whole.1, None)
                } else {
                    let cost = |(found, rms): (DVec3, f64)| {
                        let beyond = (0..DIRECTIONS).map(|k| off(found, k).max(0.0).powi(2)).sum::<f64>();
                        rms * rms + beyond / DIRECTIONS as f64
                    };
                    directions
                        .iter()
                        .filter_map(|sun| Some((fitted(Some(*sun))?, *sun)))
                        .min_by(|a, b| cost(a.0).total_cmp(&cost(b.0)))
                        .map(|((found, rms), sun)| (found, rms, Some(sun)))?
                }
            }
        };
        // A silhouette that is k times as large as it would be at the position is k times as near.
        let scale = found.z;
        if !(scale.is_finite() && scale > 0.0) {
            return None;
        }
        let radius = own.iter().sum::<f64>() / DIRECTIONS as f64 * scale;
        let position_m = found.truncate().extend(1.0) * (position_m.z / scale);
        Some(Self { position_m, radius, rms, sun })
    }
}

/// Centre and scale of rows (direction and reach of the shape, reach of the border), and what is left, root mean square.
fn by_absolute_values(rows: &[(DVec3, f64)]) -> Option<(DVec3, f64)> {
    let size = rows.iter().map(|(row, _)| row.z.abs()).sum::<f64>() / rows.len().max(1) as f64;
    let mut found = DVec3::ZERO;
    for turn in 0..12 {
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for (row, value) in rows {
            let row = DVec3::new(row.x, row.y, row.z / size);
            let weight = if turn == 0 { 1.0 } else { 1.0 / ((value - row.dot(found)).abs() + 1e-3 * size) };
            normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z) * weight;
            right += row * (weight * value);
        }
        if normal.determinant().abs() < 1e-12 * normal.x_axis.x.max(normal.y_axis.y).powi(3) {
            return None;
        }
        found = normal.inverse() * right;
    }
    let mut sizes: Vec<f64> = rows
        .iter()
        .map(|(row, value)| (value - DVec3::new(row.x, row.y, row.z / size).dot(found)).abs())
        .collect();
    let middle = sizes.len() / 2;
    let rms = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / super::fit::NORMAL_MEDIAN;
    Some((DVec3::new(found.x, found.y, found.z / size), rms))
}
