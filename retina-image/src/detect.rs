//! Finding points of light and measuring them.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::candidates::{candidates, nine, without_spikes};
use crate::centroid::{self, WEIGHT_RATIO, Window, Windowed};
use crate::matched::{Wanted, matched};
use crate::plateau::{Plateau, plateau_at};
use crate::surroundings::surroundings;
use crate::width::WidthMap;
use crate::{Background, CameraImage, Centroid};

/// How points are found and measured.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectOptions {
    /// A point's brightest 3 x 3 pixels stand out of the background by this many standard deviations of their sum, as
    /// the image has them ([`Background::alike`]).
    pub threshold_sigma: f64,
    /// Digital number from which a pixel is saturated; the image's full scale where absent.
    pub saturation_dn: Option<f32>,
    /// Gain, electrons per DN: adds the light's own noise to `sigma_px`. Without it only the background's counts.
    pub gain_e_per_dn: Option<f64>,
    /// Standard deviation of the spots, px; measured on the bright ones where absent.
    pub spot_sigma_px: Option<f64>,
    /// The estimator.
    pub centroid: Centroid,
    /// Side of the background's cells, px.
    pub mesh_px: usize,
    /// Whether a single pixel can be a point of light: of stars that are sharper than the pixels, where defects of the
    /// sensor then count, too.
    pub single_pixels: bool,
}

impl Default for DetectOptions {
    fn default() -> Self {
        Self {
            threshold_sigma: 5.0,
            saturation_dn: None,
            gain_e_per_dn: None,
            spot_sigma_px: None,
            centroid: Centroid::Windowed,
            mesh_px: 64,
            single_pixels: false,
        }
    }
}

/// A point of light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightPoint {
    /// Centroid, px.
    pub x_px: f64,
    /// Centroid, px.
    pub y_px: f64,
    /// Standard deviation of the centroid per axis from the image's noise, px.
    pub sigma_px: f64,
    /// Light, DN (background subtracted).
    pub flux_dn: f64,
    /// Brightest pixel above the background, DN.
    pub peak_dn: f64,
    /// A pixel within its width of the centroid is saturated: centroid and light are not to be trusted.
    pub saturated: bool,
    /// Of the saturated pixels' middle from the centroid, px; 0 where none is. Two middles of one spot at different
    /// depths: what an asymmetric spot may have moved the centroid by.
    pub saturation_shift_px: f64,
    /// Half of the longer side of its saturated pixels, px: a disc's radius, half a blooming column's length.
    pub saturation_reach_px: f64,
    /// Another point's light reaches into it.
    pub blended: bool,
    /// Share of its surroundings that is nearly as bright as it is: 0 of a star in the dark, about a half on the edge
    /// of something bright.
    pub bright_surroundings: f64,
    /// A line of light passes through it: a satellite's trail, a blooming column, an edge.
    pub on_line: bool,
    /// Standard deviation of the spot (geometric mean of its axes), px; `None` where noise hides it.
    pub width_px: Option<f64>,
    /// 1 - minor axis / major axis.
    pub ellipticity: Option<f64>,
    /// `flux_dn` over its standard deviation.
    pub snr: f64,
}

/// What an image holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// The points, brightest first.
    pub points: Vec<LightPoint>,
    /// Single-pixel spikes that were left out: (column, row), row by row.
    pub hot_pixels: Vec<[usize; 2]>,
    /// Typical background, DN.
    pub background_dn: f64,
    /// Typical standard deviation of a dark pixel, DN.
    pub noise_dn: f64,
    /// Standard deviation of the spots that the windows were matched to, px.
    pub spot_sigma_px: f64,
}

/// A neighbour within so many standard deviations of the spot reaches into it.
const NEIGHBOUR_SIGMAS: f64 = 6.0;
/// Spots are taken to be this wide until they have been measured, px.
pub(crate) const FIRST_SPOT_SIGMA_PX: f64 = 1.5;
/// The four neighbours of a spike have, on average, less than this share of it. A spot of 1.5 px full width at half
/// maximum (sigma 0.64 px) centred on its pixel has 0.37; a hot pixel 0.
const SPIKE_SHARE: f64 = 0.2;
/// Two peaks are one point where the light between them does not fall below this share of the fainter: a defocused
/// spot is a disc with a brighter rim.
const SADDLE_SHARE: f64 = 0.5;

/// A plateau of saturated pixels that reaches farther than so many standard deviations of a spot is measured in a window
/// of its own size.
const WIDE_PLATEAU: f64 = 4.0;

#[derive(Debug, Clone, Copy)]
pub(crate) struct Peak {
    /// Brightest pixel.
    pub(crate) pixel: [usize; 2],
    /// Sum of the 3 x 3 pixels about the place of the largest such sum, above the background, DN.
    pub(crate) light_dn: f64,
    /// That place.
    pub(crate) centre: [usize; 2],
    pub(crate) blended: bool,
}

/// Finds points of light: background on a mesh, 3 x 3 sums above a threshold, their local maxima, spikes taken out,
/// peaks of one spot joined, and each centroid measured.
pub fn detect_points(image: &CameraImage, options: &DetectOptions) -> Detection {
    let background = Background::estimate(image, options.mesh_px);
    let threshold_sigma = options.threshold_sigma * background.alike();
    let candidates = candidates(image, &background, threshold_sigma);
    let spike_share = spike_share(options.single_pixels);
    let (peaks, hot) = without_spikes(image, &background, threshold_sigma, spike_share, &candidates);
    let peaks = joined(image, &background, peaks, options);
    measured(image, &background, (peaks, hot), options)
}

/// As [`detect_points`], in the pixels where `mask` (row by row) is true; they alone say what the background is.
pub fn detect_points_in(image: &CameraImage, mask: &[bool], options: &DetectOptions) -> Detection {
    let background = Background::estimate_in(image, mask, options.mesh_px);
    let mut candidates = candidates(image, &background, options.threshold_sigma);
    candidates.retain(|&[x, y]| mask[y * image.width_px as usize + x]);
    let spike_share = spike_share(options.single_pixels);
    let (peaks, hot) = without_spikes(image, &background, options.threshold_sigma, spike_share, &candidates);
    let peaks = joined(image, &background, peaks, options);
    measured(image, &background, (peaks, hot), options)
}

/// As [`detect_points_in`], by sums that are matched to a spot of `spot_sigma_px` (1.5 px where absent)
/// and not of 3 x 3 pixels. They stand out by `threshold_sigma` of their own scatter in the mask; where noise is skewed, as
/// that of few electrons is, by so much more that it exceeds them as often as normal noise would. The level follows the
/// image within some spots' widths.
pub fn detect_matched_in(image: &CameraImage, mask: &[bool], options: &DetectOptions) -> Detection {
    let mut background = Background::estimate_in(image, mask, options.mesh_px);
    let wanted = Wanted {
        spot_sigma_px: options.spot_sigma_px.unwrap_or(FIRST_SPOT_SIGMA_PX),
        threshold_sigma: options.threshold_sigma,
        spike_share: spike_share(options.single_pixels),
        largest_skew_dn: options.gain_e_per_dn.map_or(f64::INFINITY, |gain| 1.0 / gain),
    };
    let found = matched(image, mask, &mut background, &wanted);
    let mut detection = measured(image, &background, found, options);
    // A window beside the mask's edge may end on what is brighter beyond it.
    let is_inside =
        |point: &LightPoint| mask[point.y_px as usize * image.width_px as usize + point.x_px as usize];
    detection.points.retain(is_inside);
    detection
}

/// Nothing is a spike whose neighbours are to have no share of its light.
fn spike_share(single_pixels: bool) -> f64 {
    if single_pixels { f64::NEG_INFINITY } else { SPIKE_SHARE }
}

/// The points at these peaks and hot pixels.
fn measured(
    image: &CameraImage,
    background: &Background,
    (peaks, hot_pixels): (Vec<Peak>, Vec<[usize; 2]>),
    options: &DetectOptions,
) -> Detection {
    let saturation = options.saturation_dn.unwrap_or(image.full_scale_dn);
    let widths = match options.spot_sigma_px {
        Some(sigma) => WidthMap::constant(sigma),
        None => WidthMap::measure(image, background, &peaks, saturation, &hot_pixels),
    };
    let measure = |peak: &Peak| measure(image, background, options, peak, &widths, saturation, &hot_pixels);
    let points: Vec<(LightPoint, Option<Plateau>)> =
        peaks.par_iter().with_min_len(64).filter_map(measure).collect();
    let mut points = one_a_plateau(points);
    points.sort_by(|a, b| b.flux_dn.total_cmp(&a.flux_dn));
    let mut points = without_repeats(points);
    flag_neighbours(&mut points, &widths);
    let [background_dn, noise_dn] = background.median_dn();
    Detection { points, hot_pixels, background_dn, noise_dn, spot_sigma_px: widths.typical_px() }
}

/// Drops peaks that belong to a brighter one's spot, and marks those that overlap.
fn joined(
    image: &CameraImage,
    background: &Background,
    mut peaks: Vec<Peak>,
    options: &DetectOptions,
) -> Vec<Peak> {
    let reach_px = 8.0 * options.spot_sigma_px.unwrap_or(FIRST_SPOT_SIGMA_PX);
    peaks.sort_by(|a, b| b.light_dn.total_cmp(&a.light_dn).then(a.centre.cmp(&b.centre)));
    let side = reach_px.max(1.0);
    let columns = (f64::from(image.width_px) / side) as usize + 1;
    let rows = (f64::from(image.height_px) / side) as usize + 1;
    let mut grid: Vec<Vec<usize>> = vec![Vec::new(); columns * rows];
    let mut kept: Vec<Peak> = Vec::new();
    for mut peak in peaks {
        let cell = peak.centre.map(|c| (c as f64 / side) as usize);
        let mut same = false;
        for row in cell[1].saturating_sub(1)..=(cell[1] + 1).min(rows - 1) {
            for column in cell[0].saturating_sub(1)..=(cell[0] + 1).min(columns - 1) {
                for &other in &grid[row * columns + column] {
                    let other: &mut Peak = &mut kept[other];
                    let off = [0, 1].map(|k| peak.centre[k] as f64 - other.centre[k] as f64);
                    let distance = off[0].hypot(off[1]);
                    if distance > reach_px {
                        continue;
                    }
                    let (saddle, noise) = lowest_between(image, background, other.centre, peak.centre);
                    if distance < 2.0 || saddle > SADDLE_SHARE * peak.light_dn - 9.0 * noise {
                        same = true;
                    } else if saddle > 0.1 * peak.light_dn {
                        other.blended = true;
                        peak.blended = true;
                    }
                }
            }
        }
        if !same {
            grid[cell[1] * columns + cell[0]].push(kept.len());
            kept.push(peak);
        }
    }
    kept
}

/// The smallest 3 x 3 sum above the background on the way from one place to another, and the pixel noise, DN.
fn lowest_between(
    image: &CameraImage,
    background: &Background,
    from: [usize; 2],
    to: [usize; 2],
) -> (f64, f64) {
    let off = [0, 1].map(|k| to[k] as f64 - from[k] as f64);
    let steps = off[0].abs().max(off[1].abs()).max(1.0) as usize;
    let level = background.level_dn(to[0] as f64 + 0.5, to[1] as f64 + 0.5);
    let mut lowest = f64::INFINITY;
    for i in 0..=steps {
        let at = [0, 1].map(|k| (from[k] as f64 + off[k] * i as f64 / steps as f64).round() as usize);
        lowest = lowest.min(nine(image, at[0], at[1]) - 9.0 * level);
    }
    (lowest, background.noise_dn(to[0] as f64 + 0.5, to[1] as f64 + 0.5))
}

/// Width (px) and ellipticity of the spot in a Gaussian window: the window's inverse covariance is taken off the weighted one's.
pub(crate) fn shape(window: &Windowed, weight_sigma_px: f64) -> Option<(f64, f64)> {
    let [xx, xy, yy] = window.moments_px2;
    let determinant = xx * yy - xy * xy;
    if !(xx > 0.0 && determinant > 0.0) {
        return None;
    }
    let own = 1.0 / (weight_sigma_px * weight_sigma_px);
    let [a, b, c] = [yy / determinant - own, -xy / determinant, xx / determinant - own];
    let inverse = a * c - b * b;
    if !(a > 0.0 && inverse > 0.0) {
        return None;
    }
    let (mean, half) = ((a + c) / 2.0, ((a - c) / 2.0).hypot(b));
    Some((inverse.powf(-0.25), 1.0 - ((mean - half) / (mean + half)).max(0.0).sqrt()))
}

/// Signal-to-noise ratio from which on a spot's own moments say more than those that the window was made for: the
/// ratio of the spread of M / s^2 among spots (0.1) to its noise (0.7 / SNR).
const TOLD_SNR: f64 = 7.0;
/// Least share of a shift that a window's mean is taken to follow.
const LEAST_SHARE: f64 = 0.1;

/// Standard deviation of the centroid, rms of the axes.
///
/// The window of width s ends where F = sum w f d = 0. With the light L = sum w f and the weighted moments M, a shift of
/// the window changes F by -L (1 - M / s^2), so that the centroid's covariance is A S A^T / L^2, where S is the noise
/// of F (`spread`: xx, xy, yy) and A = (1 - M / s^2)^-1. A long spot is less certain along than across.
fn sigma_px(window: &Windowed, weight_sigma_px: f64, snr: f64, spread: [f64; 3]) -> f64 {
    let told = snr * snr / (snr * snr + TOLD_SNR * TOLD_SNR);
    let matched = 1.0 / (WEIGHT_RATIO + 1.0);
    let [xx, xy, yy] = window.moments_px2.map(|m| told * m / (weight_sigma_px * weight_sigma_px));
    let (a, b, c) = (xx + (1.0 - told) * matched, xy, yy + (1.0 - told) * matched);
    // Along the spot's axes.
    let angle = 0.5 * (2.0 * b).atan2(a - c);
    let (mean, half) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
    let (sin, cos) = angle.sin_cos();
    let along = spread[0] * cos * cos + 2.0 * spread[1] * cos * sin + spread[2] * sin * sin;
    let across = spread[0] + spread[2] - along;
    let variance = |moment: f64, noise: f64| noise.max(0.0) / (1.0 - moment).max(LEAST_SHARE).powi(2);
    (0.5 * (variance(mean + half, along) + variance(mean - half, across))).sqrt() / window.light_dn
}

fn measure(
    image: &CameraImage,
    background: &Background,
    options: &DetectOptions,
    peak: &Peak,
    widths: &WidthMap,
    saturation_dn: f32,
    hot: &[[usize; 2]],
) -> Option<(LightPoint, Option<Plateau>)> {
    let start = peak.centre.map(|c| c as f64 + 0.5);
    let spot_sigma_px = widths.at_px(start);
    let skip = near(hot, peak.centre);
    let mut matched = Window::matched(spot_sigma_px);
    let mut window = centroid::windowed(image, background, start, matched, &skip)?;
    let plateau = plateau_at(image, [window.x_px, window.y_px], spot_sigma_px, saturation_dn);
    if let Some(wide) = plateau.filter(|plateau| plateau.reach_px > WIDE_PLATEAU * spot_sigma_px) {
        // A flat top has no middle in a window that does not reach its flanks.
        matched = Window::matched(wide.reach_px);
        window = centroid::windowed(image, background, wide.centre_px, matched, &skip).unwrap_or(window);
    }
    let weight = matched.sigma_px;
    let noise = background.alike() * background.noise_dn(start[0], start[1]);
    let per_dn = options.gain_e_per_dn.map_or(0.0, |gain| 1.0 / gain);
    // Of a Gaussian spot in the window: its light is ratio / (ratio + 1) of the whole.
    let share = WEIGHT_RATIO / (WEIGHT_RATIO + 1.0);
    let variance = |sums: [f64; 2]| (noise * noise * sums[0] + per_dn * sums[1].max(0.0)).max(0.0);
    let spread = [0, 1, 2].map(|k| noise * noise * window.spread[0][k] + per_dn * window.spread[1][k]);
    let flux = window.light_dn / share;
    let flux_sigma = variance(window.squares).sqrt() / share;
    let [px, py] = peak.pixel;
    let centre = [window.x_px, window.y_px];
    let reach_px = plateau.map_or(0.0, |plateau| plateau.reach_px);
    let around = surroundings(image, background, centre, spot_sigma_px, reach_px);
    let shift_px = |p: Plateau| (p.centre_px[0] - centre[0]).hypot(p.centre_px[1] - centre[1]);
    let mut point = LightPoint {
        x_px: window.x_px,
        y_px: window.y_px,
        sigma_px: sigma_px(&window, weight, flux / flux_sigma, spread),
        flux_dn: flux,
        peak_dn: f64::from(image.at(px, py)) - background.level_dn(start[0], start[1]),
        saturated: plateau.is_some(),
        saturation_shift_px: plateau.map_or(0.0, shift_px),
        saturation_reach_px: reach_px,
        blended: peak.blended || !window.converged,
        bright_surroundings: around.bright_share,
        on_line: around.line,
        width_px: shape(&window, weight).map(|s| s.0),
        ellipticity: shape(&window, weight).map(|s| s.1),
        snr: flux / flux_sigma,
    };
    if options.centroid == Centroid::Moments {
        let (mean, total, variance) = centroid::moments(
            image,
            background,
            peak.pixel,
            options.threshold_sigma,
            options.gain_e_per_dn,
            options.single_pixels,
            &skip,
        )?;
        [point.x_px, point.y_px] = mean;
        point.flux_dn = total;
        point.sigma_px = (0.5 * (variance[0] + variance[1])).sqrt();
    }
    Some((point, plateau))
}

/// The hot pixels, of those row by row, that a window about a place can hold.
pub(crate) fn near(hot: &[[usize; 2]], centre: [usize; 2]) -> Vec<[usize; 2]> {
    const REACH: usize = 32;
    let [first, last] = [centre[1].saturating_sub(REACH - 1), centre[1] + REACH]
        .map(|row| hot.partition_point(|at| at[1] < row));
    hot[first..last].iter().filter(|at| at[0].abs_diff(centre[0]) < REACH).copied().collect()
}

/// Points whose centroids are nearer than this are one, px: peaks of a bright spot's own structure, whose windows have
/// ended at its middle.
const SAME_PX: f64 = 1.5;

/// Of points on one plateau of saturated pixels the one nearest to its middle: a plateau has no peak of its own, and
/// noise about its rim has several.
fn one_a_plateau(points: Vec<(LightPoint, Option<Plateau>)>) -> Vec<LightPoint> {
    let mut nearest: HashMap<[u64; 2], usize> = HashMap::new();
    let key = |plateau: &Plateau| plateau.centre_px.map(f64::to_bits);
    for (at, (point, plateau)) in points.iter().enumerate() {
        let Some(plateau) = plateau else { continue };
        let best = nearest.entry(key(plateau)).or_insert(at);
        if point.saturation_shift_px < points[*best].0.saturation_shift_px {
            *best = at;
        }
    }
    let is_kept = |at: usize, plateau: &Option<Plateau>| plateau.is_none_or(|p| nearest[&key(&p)] == at);
    points
        .into_iter()
        .enumerate()
        .filter(|(at, (_, p))| is_kept(*at, p))
        .map(|(_, (point, _))| point)
        .collect()
}

/// Of points in one place the brightest; the order is kept.
fn without_repeats(points: Vec<LightPoint>) -> Vec<LightPoint> {
    let mut by_cell: HashMap<[i64; 2], Vec<[f64; 2]>> = HashMap::new();
    points
        .into_iter()
        .filter(|point| {
            let at = [point.x_px, point.y_px];
            let [column, row] = at.map(|v| (v / SAME_PX).floor() as i64);
            let near = (column - 1..=column + 1).flat_map(|c| (row - 1..=row + 1).map(move |r| [c, r]));
            let again = near
                .filter_map(|cell| by_cell.get(&cell))
                .flatten()
                .any(|other| (other[0] - at[0]).hypot(other[1] - at[1]) < SAME_PX);
            if !again {
                by_cell.entry([column, row]).or_default().push(at);
            }
            !again
        })
        .collect()
}

/// Marks points with a neighbour of at least a hundredth of their light within reach.
fn flag_neighbours(points: &mut [LightPoint], widths: &WidthMap) {
    let reaches: Vec<f64> =
        points.iter().map(|point| NEIGHBOUR_SIGMAS * widths.at_px([point.x_px, point.y_px])).collect();
    let widest = reaches.iter().copied().fold(0.0, f64::max);
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| points[a].y_px.total_cmp(&points[b].y_px));
    for i in 0..order.len() {
        for j in i + 1..order.len() {
            let (a, b) = (points[order[i]], points[order[j]]);
            if b.y_px - a.y_px > widest {
                break;
            }
            let reach_px = reaches[order[i]].max(reaches[order[j]]);
            if (a.x_px - b.x_px).hypot(a.y_px - b.y_px) < reach_px {
                points[order[i]].blended |= b.flux_dn > 0.01 * a.flux_dn;
                points[order[j]].blended |= a.flux_dn > 0.01 * b.flux_dn;
            }
        }
    }
}
