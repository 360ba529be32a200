//! What is asked of an answer: whether a fit is the body's outline, and how far it may be off.

use glam::{DMat3, DVec2, DVec3};
use retina_geometry::{LimbEllipse, limb_ellipse};

use super::coarse::Coarse;
use super::fit::Fit;
use super::lit::Lit;
use super::shading::Shading;
use super::solve::Measurement;
use super::wave::wave;
use super::{LimbBody, LimbCamera, LimbCovariance, LimbOptions, LimbPoint, LimbSolution, Refusal};

/// At least this share of the places that should show a limb has to.
const LEAST_FOUND: f64 = 0.5;
/// What a PSF that is no Gaussian, and an error of its width, may shift all edges by: along the normal, px. An
/// allowance; discs with a square pixel's aperture and Gaussian blurs stay within.
const EDGE_MODEL_SIGMA_PX: f64 = 0.015;
/// The same for a body whose own silhouette is fitted: texture and shadows at the limb, which are in a limb height's
/// uncertainty otherwise. Measured on rendered frames of the Moon, Itokawa and Eros.
const SILHOUETTE_MODEL_SIGMA_PX: f64 = 0.04;
/// What a PSF wider than a pixel adds to it, share of its width beyond: such a one is an aberration's, no Gaussian, and
/// hills and maria within its width pull at the edge. Measured on the virtual bench, whose PSF of 3 px adds 0.2 to 0.3
/// px to the error of the Moon's radius.
const WIDE_EDGE_MODEL_SHARE: f64 = 0.1;
/// What saturation adds to it, px for all pixels inside the limb: without its plateau a shading is not told from a blur.
/// A third saturated moves the radius of shaded discs by 0.03 px.
const SATURATED_EDGE_MODEL_PX: f64 = 0.1;
/// Scatter beyond noise that a body's terrain may have: px, and share of the radius.
const MOST_EXCESS: (f64, f64) = (0.4, 0.006);
/// The same where the silhouette has the terrain: what is left are texture and shadows, 0.13 px at most on rendered frames
/// of the Moon, Itokawa and Eros. An attitude that is off by a degree or two leaves more.
const MOST_SILHOUETTE_EXCESS: (f64, f64) = (0.2, 0.0008);
/// What a PSF wider than a pixel adds to it, share of its width beyond: hills within its width are blurred together. The
/// virtual bench has up to 0.52 px with a PSF of 3 px.
const WIDE_EXCESS_SHARE: f64 = 0.2;
/// A wave of the residuals up to this is the edges' own: px. Discs of three photometric laws have 0.04 at most.
const WAVE_PX: f64 = 0.05;
/// What relief adds to it where less is known, share of the radius: 1400 m on the Moon.
const LEAST_RELIEF: f64 = 0.0008;
/// A limb's wave may be so many times the standard deviation of its height: of 292 rendered and photographed frames of the
/// Moon one has 1.07.
const WAVE_PER_RELIEF: f64 = 1.5;
/// A wave that takes less from the residuals' squares may be chance.
const LEAST_WAVE_GAIN: f64 = 16.0;

/// What is asked of an answer, and the answer.
pub(super) fn judge(
    fit: Fit,
    last: Measurement,
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
        return Err(lit.too_short(seen, used, last.outline_px.len(), options));
    }
    if (used as f64) < LEAST_FOUND * last.inside as f64 {
        return Err(not("most of its border is not where a limb would be"));
    }
    let outline = |position| {
        limb_ellipse(
            &camera.pinhole,
            position,
            body.camera_from_body,
            body.semi_axes_m + options.limb_height_m,
        )
        .ok_or_else(|| not("its border fits no body in front of the camera"))
    };
    let ellipse = outline(fit.position_m)?;
    let mean_radius = |e: &LimbEllipse| 0.5 * (e.semi_axes_px[0] + e.semi_axes_px[1]);
    let radius = mean_radius(&ellipse);
    let wide_px = (last.blur_px - 1.0).max(0.0);
    let off_px = fit.excess_sigma_px;
    if body.shape.is_some() {
        let most_px = (MOST_SILHOUETTE_EXCESS.0 + MOST_SILHOUETTE_EXCESS.1 * radius)
            .hypot(options.limb_height_sigma_m / body.mean_radius_m() * radius)
            .hypot(WIDE_EXCESS_SHARE * wide_px);
        if off_px > most_px {
            return Err(Refusal::NotTheSilhouette { off_px, most_px });
        }
    } else if off_px > MOST_EXCESS.0 + MOST_EXCESS.1 * radius {
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
    let wave = wave(&last.points, &fit, &ellipse);
    let saturated_px = SATURATED_EDGE_MODEL_PX * last.saturated;
    let relief = (WAVE_PER_RELIEF * options.limb_height_sigma_m / body.mean_radius_m()).max(LEAST_RELIEF);
    let allowed_px = WAVE_PX.hypot(relief * radius).hypot(2.0 * saturated_px);
    if wave.rms_px > allowed_px && wave.gain > LEAST_WAVE_GAIN {
        return Err(Refusal::OtherOutline { wave_px: wave.rms_px, allowed_px });
    }
    let distance_m = fit.position_m.length();
    let along = fit.position_m / distance_m;
    let outer = DMat3::from_cols(along * along.x, along * along.y, along * along.z);
    // Both act as an error of the body's radius and, less than that over an arc, of its centre.
    let metres_per_px = body.mean_radius_m() / radius;
    let least_px = if body.shape.is_some() { SILHOUETTE_MODEL_SIGMA_PX } else { EDGE_MODEL_SIGMA_PX };
    let own_px = least_px + WIDE_EDGE_MODEL_SHARE * wide_px + saturated_px;
    let edge_model_px =
        own_px.hypot(options.tone_sigma_share * last.blur_px).hypot(last.shading.sigma_px(&last.edges));
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
    let crescent = moves * Shading::of_crescent(lit, last.blur_px);
    let parts = LimbCovariance {
        points_m2: fit.covariance_m2 * correlation_factor,
        height_m2: by_height(options.limb_height_sigma_m),
        edge_model_m2: by_height(edge_model_px * metres_per_px)
            + DMat3::from_cols(crescent * crescent.x, crescent * crescent.y, crescent * crescent.z),
        side_m2: moves * DMat3::from_mat4(last.open_px2) * moves.transpose(),
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
        outline_px: last.outline_px,
        radius_px: [radius, sigma[0]],
        center_sigma_px: DVec2::new(sigma[1], sigma[2]),
        points: points.collect(),
        rms_px,
        excess_sigma_px: fit.excess_sigma_px,
        correlation_factor,
        wave,
        arc_rad,
        blur_sigma_px: last.blur_px,
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
