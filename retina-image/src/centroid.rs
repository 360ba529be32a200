//! Where a point of light is, to a small fraction of a pixel.

use crate::{Background, CameraImage};

/// How the centroid is formed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Centroid {
    /// Gaussian-weighted mean, the weight centred on the result. The weight has the same width for all points
    /// of an image, whatever their light, so the result of a linear camera does not move with the light.
    #[default]
    Windowed,
    /// Centre of mass of the pixels above the threshold (the paper's). The threshold cuts deeper into the flanks of a
    /// faint point than of a bright one: where the spot is asymmetric, the centroid walks with the light.
    Moments,
}

/// Variance of the weight in units of the spot's. A Gaussian spot's centroid then has (k + 1)^2 / (k (k + 2)) of the
/// Cramer-Rao bound's sigma in photon noise and (k + 1)^2 / (4 k) in background noise: 1.125 both at k = 2.
pub(crate) const WEIGHT_RATIO: f64 = 2.0;

/// What the window at a place holds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Windowed {
    pub(crate) x_px: f64,
    pub(crate) y_px: f64,
    /// Sum of weight times light, DN.
    pub(crate) light_dn: f64,
    /// Weighted second moments xx, xy, yy, px^2.
    pub(crate) moments_px2: [f64; 3],
    /// Sums of w^2 d d^T over the window (xx, xy, yy, px^2), and of the same times light.
    pub(crate) spread: [[f64; 3]; 2],
    /// Sum of w^2, and of w^2 times light.
    pub(crate) squares: [f64; 2],
    pub(crate) converged: bool,
}

/// Steps after which a centroid that still moves is given up.
const MOST_ROUNDS: usize = 30;
/// Half the largest window, pixels.
const LARGEST_HALF_PX: usize = 32;

/// The Gaussian weight and where it ends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Window {
    /// Standard deviation of the spots that it is for, px.
    pub(crate) spot_sigma_px: f64,
    /// Its own, px.
    pub(crate) sigma_px: f64,
    /// A step shorter than this ends the iteration, px; it is taken yet.
    pub(crate) settled_px: f64,
}

impl Window {
    /// Matched to spots of a width, for their centroids: settled within a tenth of the best ones' error (0.001 px at a
    /// signal-to-noise ratio of 1000).
    pub(crate) fn matched(spot_sigma_px: f64) -> Self {
        Self { spot_sigma_px, sigma_px: spot_sigma_px * WEIGHT_RATIO.sqrt(), settled_px: 1e-4 }
    }
}

/// Light above a plane: the background about a place.
struct Ground {
    at: [f64; 2],
    level: f64,
    slope: [f64; 2],
}

impl Ground {
    fn about(background: &Background, [x, y]: [f64; 2]) -> Self {
        let slope = [
            (background.level_dn(x + 4.0, y) - background.level_dn(x - 4.0, y)) / 8.0,
            (background.level_dn(x, y + 4.0) - background.level_dn(x, y - 4.0)) / 8.0,
        ];
        Self { at: [x, y], level: background.level_dn(x, y), slope }
    }

    fn dn(&self, x: f64, y: f64) -> f64 {
        self.level + self.slope[0] * (x - self.at[0]) + self.slope[1] * (y - self.at[1])
    }
}

/// Iterates the Gaussian-weighted mean from a start. `None` where no light is left or the window does not fit into the
/// image.
pub(crate) fn windowed(
    image: &CameraImage,
    background: &Background,
    start: [f64; 2],
    window: Window,
    skip: &[[usize; 2]],
) -> Option<Windowed> {
    let size = [image.width_px as f64, image.height_px as f64];
    let sigma = window.sigma_px;
    let reach = (3.0 * sigma).min(LARGEST_HALF_PX as f64 - 1.0);
    let ground = Ground::about(background, start);
    let [mut x, mut y] = start;
    // The spot's own width makes the weighted mean fall short of the shift by this factor.
    let step = 1.0 + (window.spot_sigma_px / sigma).powi(2);
    let mut converged = false;
    let mut round = 0;
    let mut weights = [AxisWeights::EMPTY; 2];
    loop {
        // The window is cut alike on both sides, so that an edge does not pull.
        let half = [0, 1].map(|k| reach.min([x, y][k].min(size[k] - [x, y][k])));
        if half.iter().any(|&h| h < sigma) {
            return None;
        }
        weights[0].set(x, half[0], sigma);
        weights[1].set(y, half[1], sigma);
        if converged || round == MOST_ROUNDS {
            return measured(image, &ground, [x, y], &weights, skip, converged);
        }
        let [light, mx, my] = means(image, &ground, [x, y], &weights, skip);
        if light <= 0.0 {
            return None;
        }
        let [mx, my] = [mx / light, my / light];
        converged = step * mx.hypot(my) < window.settled_px;
        // A step beyond the spot's width means that something else pulls.
        x += (step * mx).clamp(-sigma, sigma);
        y += (step * my).clamp(-sigma, sigma);
        if (x - start[0]).hypot(y - start[1]) > 4.0 * sigma {
            return None;
        }
        round += 1;
    }
}

/// Sums of weight times light, and of the same times the offsets (x, y) from the centre.
///
/// Columns are summed down first, side by side, and joined by their weights at the end.
fn means(
    image: &CameraImage,
    ground: &Ground,
    [x, y]: [f64; 2],
    [across, down]: &[AxisWeights; 2],
    skip: &[[usize; 2]],
) -> [f64; 3] {
    let mut columns = [[0.0f64; MOST_WEIGHTS]; 2];
    let count = across.count;
    let [sums, moments] = &mut columns;
    let (sums, moments) = (&mut sums[..count], &mut moments[..count]);
    // The background's slope along x is the same in all rows: it is taken off the columns' sums.
    let mut total = [0.0; 2];
    for (row, &weight) in down.values().iter().enumerate() {
        let dy = down.offset(row, y);
        let level = ground.dn(x, y + dy);
        let with_offset = weight * dy;
        let pixels = &image.row(down.first + row)[across.first..across.first + count];
        for ((sum, moment), value) in sums.iter_mut().zip(moments.iter_mut()).zip(pixels) {
            let light = f64::from(*value) - level;
            *sum += weight * light;
            *moment += with_offset * light;
        }
        total = [total[0] + weight, total[1] + with_offset];
    }
    for &[column, row] in skip {
        if let (Some(c), Some(r)) = (across.index(column), down.index(row)) {
            let (weight, dy) = (down.values[r], down.offset(r, y));
            // What the slope takes off a column is not taken off here.
            let light = f64::from(image.at(column, row)) - ground.dn(across.offset(c, x) + x, y + dy);
            sums[c] -= weight * light;
            moments[c] -= weight * dy * light;
        }
    }
    let mut out = [0.0; 3];
    for (column, &weight) in across.values().iter().enumerate() {
        let dx = across.offset(column, x);
        let tilt = ground.slope[0] * dx;
        let sum = sums[column] - tilt * total[0];
        out[0] += weight * sum;
        out[1] += weight * dx * sum;
        out[2] += weight * (moments[column] - tilt * total[1]);
    }
    out
}

/// All that a window at its place says.
fn measured(
    image: &CameraImage,
    ground: &Ground,
    [x, y]: [f64; 2],
    [across, down]: &[AxisWeights; 2],
    skip: &[[usize; 2]],
    converged: bool,
) -> Option<Windowed> {
    let mut sums = [0.0f64; 6];
    let mut squares = [0.0f64; 2];
    let mut spread = [[0.0f64; 3]; 2];
    for (row, &wy) in down.values().iter().enumerate() {
        let dy = down.offset(row, y);
        let pixels = &image.row(down.first + row)[across.first..across.first + across.count];
        let mut line = [0.0f64; 3];
        let mut line_noise = [[0.0f64; 3]; 2];
        for (column, (&wx, &value)) in across.values().iter().zip(pixels).enumerate() {
            if skip.contains(&[across.first + column, down.first + row]) {
                continue;
            }
            let dx = across.offset(column, x);
            let light = f64::from(value) - ground.dn(x + dx, y + dy);
            let weighted = wx * light;
            line[0] += weighted;
            line[1] += weighted * dx;
            line[2] += weighted * dx * dx;
            let w2 = wx * wx;
            for (sums, factor) in line_noise.iter_mut().zip([w2, w2 * light]) {
                sums[0] += factor;
                sums[1] += factor * dx;
                sums[2] += factor * dx * dx;
            }
        }
        let w2 = wy * wy;
        sums[0] += wy * line[0];
        sums[1] += wy * line[1];
        sums[2] += wy * dy * line[0];
        sums[3] += wy * line[2];
        sums[4] += wy * dy * line[1];
        sums[5] += wy * dy * dy * line[0];
        for ((squares, spread), line) in squares.iter_mut().zip(&mut spread).zip(line_noise) {
            *squares += w2 * line[0];
            spread[0] += w2 * line[2];
            spread[1] += w2 * dy * line[1];
            spread[2] += w2 * dy * dy * line[0];
        }
    }
    if sums[0] <= 0.0 {
        return None;
    }
    let [mx, my] = [sums[1] / sums[0], sums[2] / sums[0]];
    Some(Windowed {
        x_px: x,
        y_px: y,
        light_dn: sums[0],
        moments_px2: [sums[3] / sums[0] - mx * mx, sums[4] / sums[0] - mx * my, sums[5] / sums[0] - my * my],
        spread,
        squares,
        converged,
    })
}

const MOST_WEIGHTS: usize = 2 * LARGEST_HALF_PX + 2;

/// Gaussian weights of pixels along an axis.
#[derive(Debug, Clone, Copy)]
struct AxisWeights {
    first: usize,
    count: usize,
    values: [f64; MOST_WEIGHTS],
}

impl AxisWeights {
    const EMPTY: Self = Self { first: 0, count: 0, values: [0.0; MOST_WEIGHTS] };

    /// Of the pixels whose area is within `half` of `centre`; one that the window's edge cuts counts by its part inside, so
    /// that the sums are smooth in `centre`.
    fn set(&mut self, centre: f64, half: f64, sigma: f64) {
        let first = (centre - half).max(0.0) as usize;
        let mut count = 0;
        // g(d + 1) = g(d) r(d) with r(d + 1) = r(d) exp(-1 / sigma^2): three exponentials for all.
        let squared = 1.0 / (sigma * sigma);
        let off = first as f64 + 0.5 - centre;
        let mut weight = (-0.5 * off * off * squared).exp();
        let mut ratio = (-(off + 0.5) * squared).exp();
        let ratio_step = (-squared).exp();
        while count < MOST_WEIGHTS && ((first + count) as f64) < centre + half {
            let left = (first + count) as f64;
            let inside = (left + 1.0).min(centre + half) - left.max(centre - half);
            self.values[count] = inside * weight;
            weight *= ratio;
            ratio *= ratio_step;
            count += 1;
        }
        (self.first, self.count) = (first, count);
    }

    fn values(&self) -> &[f64] {
        &self.values[..self.count]
    }

    /// Centre of the k-th pixel less that of the window, px.
    fn offset(&self, k: usize, centre: f64) -> f64 {
        (self.first + k) as f64 + 0.5 - centre
    }

    /// Which of the window's pixels it is.
    fn index(&self, pixel: usize) -> Option<usize> {
        pixel.checked_sub(self.first).filter(|k| *k < self.count)
    }
}

/// Centre of mass and sum (px, px, DN) of the connected pixels above `threshold_sigma` of noise around a
/// peak, with the variance of each axis's centroid from a pixel noise (DN) and a gain (electrons per DN). Pixels that
/// touch at a corner are connected if `by_corners`: a point on a screen can be two of them.
pub(crate) fn moments(
    image: &CameraImage,
    background: &Background,
    peak: [usize; 2],
    threshold_sigma: f64,
    gain_e_per_dn: Option<f64>,
    by_corners: bool,
    skip: &[[usize; 2]],
) -> Option<([f64; 2], f64, [f64; 2])> {
    const HALF: usize = 24;
    const SIDE: usize = 2 * HALF + 1;
    let (width, height) = (image.width_px as usize, image.height_px as usize);
    let noise = background.noise_dn(peak[0] as f64 + 0.5, peak[1] as f64 + 0.5);
    let light =
        |x: usize, y: usize| f64::from(image.at(x, y)) - background.level_dn(x as f64 + 0.5, y as f64 + 0.5);
    let mut seen = [false; SIDE * SIDE];
    let mut open = vec![peak];
    let mut lit = Vec::new();
    seen[HALF * SIDE + HALF] = true;
    while let Some([x, y]) = open.pop() {
        let value = light(x, y);
        if value < threshold_sigma * noise || skip.contains(&[x, y]) {
            continue;
        }
        lit.push(([x as f64 + 0.5, y as f64 + 0.5], value));
        let (left, up) = (x.wrapping_sub(1), y.wrapping_sub(1));
        let sides = [(left, y), (x + 1, y), (x, up), (x, y + 1)];
        let corners = [(left, up), (x + 1, up), (left, y + 1), (x + 1, y + 1)];
        for &(nx, ny) in sides.iter().chain(if by_corners { &corners[..] } else { &[] }) {
            let [cx, cy] =
                [[nx, peak[0]], [ny, peak[1]]].map(|[at, from]| at.wrapping_add(HALF).wrapping_sub(from));
            if nx < width && ny < height && cx < SIDE && cy < SIDE && !seen[cy * SIDE + cx] {
                seen[cy * SIDE + cx] = true;
                open.push([nx, ny]);
            }
        }
    }
    // The order of the walk does not matter to the result beyond rounding; rows first makes it a fixed one.
    lit.sort_by(|a, b| (a.0[1], a.0[0]).partial_cmp(&(b.0[1], b.0[0])).unwrap_or(std::cmp::Ordering::Equal));
    let total: f64 = lit.iter().map(|(_, value)| value).sum();
    if lit.is_empty() || total <= 0.0 {
        return None;
    }
    let mean = [0, 1].map(|k| lit.iter().map(|(at, value)| at[k] * value).sum::<f64>() / total);
    let variance = [0, 1].map(|k| {
        let one = |(at, value): &([f64; 2], f64)| {
            let shot = gain_e_per_dn.map_or(0.0, |gain| value / gain);
            // A pixel's light lies anywhere in it.
            ((at[k] - mean[k]).powi(2) + 1.0 / 12.0) * (noise * noise + shot)
        };
        lit.iter().map(one).sum::<f64>() / (total * total)
    });
    Some((mean, total, variance))
}
