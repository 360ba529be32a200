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
    /// Sum of w^2 dx^2 over the window, and of the same times light: (x, y) means.
    pub(crate) spread: [f64; 2],
    /// Sum of w^2, and of w^2 times light.
    pub(crate) squares: [f64; 2],
    pub(crate) converged: bool,
}

/// Steps after which a centroid that still moves is given up.
const MOST_ROUNDS: usize = 30;
/// Half the largest window, pixels.
const LARGEST_HALF_PX: usize = 32;

/// Iterates the Gaussian-weighted mean from a start; `weight_sigma_px` is the weight's standard deviation.
/// `None` where no light is left or the window does not fit into the image.
pub(crate) fn windowed(
    image: &CameraImage,
    background: &Background,
    start: [f64; 2],
    spot_sigma_px: f64,
    weight_sigma_px: f64,
    skip: &[[usize; 2]],
) -> Option<Windowed> {
    let size = [image.width_px as f64, image.height_px as f64];
    let reach = (3.0 * weight_sigma_px).min(LARGEST_HALF_PX as f64 - 1.0);
    let [mut x, mut y] = start;
    let level = background.level_dn(x, y);
    let slope = [
        (background.level_dn(x + 4.0, y) - background.level_dn(x - 4.0, y)) / 8.0,
        (background.level_dn(x, y + 4.0) - background.level_dn(x, y - 4.0)) / 8.0,
    ];
    let at = [x, y];
    // The spot's own width makes the weighted mean fall short of the shift by this factor.
    let step = 1.0 + (spot_sigma_px / weight_sigma_px).powi(2);
    let mut converged = false;
    let mut round = 0;
    loop {
        // The window is cut alike on both sides, so that an edge does not pull.
        let half = [0, 1].map(|k| reach.min([x, y][k].min(size[k] - [x, y][k])));
        if half.iter().any(|&h| h < weight_sigma_px) {
            return None;
        }
        let weights = [axis_weights(x, half[0], weight_sigma_px), axis_weights(y, half[1], weight_sigma_px)];
        let last = converged || round == MOST_ROUNDS;
        let mut sums = [0.0f64; 6];
        let mut noise = [0.0f64; 4];
        let (x0, y0) = (weights[0].first, weights[1].first);
        for (row, &wy) in weights[1].values[..weights[1].count].iter().enumerate() {
            let dy = (y0 + row) as f64 + 0.5 - y;
            let pixels = &image.row(y0 + row)[x0..x0 + weights[0].count];
            let ground = level + slope[1] * (dy + y - at[1]) - slope[0] * at[0];
            let mut line = [0.0f64; 3];
            let mut line_noise = [0.0f64; 4];
            for (column, (&wx, &value)) in weights[0].values.iter().zip(pixels).enumerate() {
                let place = (x0 + column) as f64 + 0.5;
                let dx = place - x;
                if !skip.is_empty() && skip.contains(&[x0 + column, y0 + row]) {
                    continue;
                }
                let light = f64::from(value) - ground - slope[0] * place;
                let weighted = wx * light;
                line[0] += weighted;
                line[1] += weighted * dx;
                if last {
                    line[2] += weighted * dx * dx;
                    let w2 = wx * wx;
                    line_noise[0] += w2;
                    line_noise[1] += w2 * light;
                    line_noise[2] += w2 * dx * dx;
                    line_noise[3] += w2 * dx * dx * light;
                }
            }
            sums[0] += wy * line[0];
            sums[1] += wy * line[1];
            sums[2] += wy * dy * line[0];
            if last {
                let w2 = wy * wy;
                sums[3] += wy * line[2];
                sums[4] += wy * dy * line[1];
                sums[5] += wy * dy * dy * line[0];
                noise[0] += w2 * line_noise[0];
                noise[1] += w2 * line_noise[1];
                noise[2] += 0.5 * w2 * (line_noise[2] + dy * dy * line_noise[0]);
                noise[3] += 0.5 * w2 * (line_noise[3] + dy * dy * line_noise[1]);
            }
        }
        if sums[0] <= 0.0 {
            return None;
        }
        let [mx, my] = [sums[1] / sums[0], sums[2] / sums[0]];
        if last {
            return Some(Windowed {
                x_px: x,
                y_px: y,
                light_dn: sums[0],
                moments_px2: [
                    sums[3] / sums[0] - mx * mx,
                    sums[4] / sums[0] - mx * my,
                    sums[5] / sums[0] - my * my,
                ],
                spread: [noise[2], noise[3]],
                squares: [noise[0], noise[1]],
                converged,
            });
        }
        // A tenth of the best centroids' error (0.001 px at a signal-to-noise ratio of 1000); the step is taken yet.
        converged = step * mx.hypot(my) < 1e-4;
        // A step beyond the spot's width means that something else pulls.
        let limit = weight_sigma_px;
        x += (step * mx).clamp(-limit, limit);
        y += (step * my).clamp(-limit, limit);
        if (x - start[0]).hypot(y - start[1]) > 4.0 * weight_sigma_px {
            return None;
        }
        round += 1;
    }
}

struct AxisWeights {
    first: usize,
    count: usize,
    values: [f64; 2 * LARGEST_HALF_PX + 2],
}

/// Gaussian weights of the pixels whose centres lie within `half` of `centre`; a pixel that the window's
/// edge cuts counts by its part inside, so that the sums are smooth in `centre`.
fn axis_weights(centre: f64, half: f64, sigma: f64) -> AxisWeights {
    let first = (centre - half).max(0.0) as usize;
    let mut values = [0.0; 2 * LARGEST_HALF_PX + 2];
    let mut count = 0;
    while count < values.len() && ((first + count) as f64) < centre + half {
        let left = (first + count) as f64;
        let inside = (left + 1.0).min(centre + half) - left.max(centre - half);
        let off = (left + 0.5 - centre) / sigma;
        values[count] = inside * (-0.5 * off * off).exp();
        count += 1;
    }
    AxisWeights { first, count, values }
}

/// Centre of mass and sum (px, px, DN) of the connected pixels above `threshold_sigma` of noise around a
/// peak, with the variance of each axis's centroid from a pixel noise (DN) and a gain (electrons per DN).
pub(crate) fn moments(
    image: &CameraImage,
    background: &Background,
    peak: [usize; 2],
    threshold_sigma: f64,
    gain_e_per_dn: Option<f64>,
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
        for (nx, ny) in [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)] {
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
