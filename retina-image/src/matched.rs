//! Points of light of a known spot in a part of an image: sums that are matched to the spot, and where they stand out.
//!
//! The sum of light times the spot's shares, over its standard deviation, tells a spot from noise best. Both are formed of
//! the mask's pixels alone, so that a spot which the mask's edge cuts has what is left of it.

use crate::detect::Peak;
use crate::separable::{Grid, bell, spot_shares};
use crate::{Background, CameraImage};

/// The level is a plane through the pixels about a place, weighted by a bell of this many standard deviations of the spot.
const LEVEL_SPOTS: f64 = 5.0;
/// And of no fewer pixels.
const LEAST_LEVEL_PX: f64 = 8.0;
/// Noise is that of surroundings so many times as wide.
const NOISE_LEVELS: f64 = 3.0;
/// What stands out by so much is no level: it is left out with all that is within `LIT_SPOTS` of it.
const LIT_SIGMA: f64 = 4.0;
const LIT_SPOTS: f64 = 3.0;
/// A plane needs so many pixels' weight; fewer have a mean, and with hardly any the level is the mesh's.
const PLANE_WEIGHT: f64 = 60.0;
const LEAST_WEIGHT: f64 = 10.0;
/// A single pixel that noise does not make: one in 3.5 million is above it.
const SPIKE_SIGMA: f64 = 5.0;
/// Pixels beyond this many standard deviations are light or defects, and say nothing of the noise.
const NOISE_SIGMA: f64 = 4.5;
/// So many independent sums say how much they scatter, to a tenth; fewer are taken for white noise.
const ENOUGH_SUMS: f64 = 100.0;
/// Quantiles of a normal distribution at the middle and one standard deviation below.
const QUANTILES: [f64; 2] = [0.5, 0.158_655];
/// Two maxima are one spot where the sums between them fall below this share of the lower one's by less than noise.
const SADDLE_SHARE: f64 = 0.5;
/// Maxima of one spot are this near, spots' standard deviations.
const SAME_SPOTS: f64 = 8.0;

/// What is to stand out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wanted {
    /// Standard deviation of the spot, px.
    pub(crate) spot_sigma_px: f64,
    /// Standard deviations of normal noise.
    pub(crate) threshold_sigma: f64,
    /// Neighbours of a spike have less than this share of it.
    pub(crate) spike_share: f64,
    /// Third moment of a pixel's noise over its variance, DN, at most: the DN of an electron, where all noise is theirs.
    pub(crate) largest_skew_dn: f64,
}

/// The level of pixels above a mesh's and their noise, DN, on a part of an image.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Local {
    first: [usize; 2],
    level: Grid,
    noise: Grid,
}

impl Local {
    /// Level in the pixel that holds a position.
    pub(crate) fn level_dn(&self, x_px: f64, y_px: f64) -> Option<f64> {
        self.index(x_px, y_px).map(|at| f64::from(self.level.values[at]))
    }

    /// Noise of the pixel that holds a position.
    pub(crate) fn noise_dn(&self, x_px: f64, y_px: f64) -> Option<f64> {
        self.index(x_px, y_px).map(|at| f64::from(self.noise.values[at]))
    }

    fn index(&self, x_px: f64, y_px: f64) -> Option<usize> {
        let [x, y] = [x_px, y_px].map(|v| v.max(0.0) as usize);
        let (x, y) = (x.checked_sub(self.first[0])?, y.checked_sub(self.first[1])?);
        let at = y * self.level.width + x;
        (x < self.level.width && at < self.level.values.len()).then_some(at)
    }
}

/// The rectangle that holds a mask, and what is searched in it.
struct Field<'a> {
    image: &'a CameraImage,
    background: &'a Background,
    first: [usize; 2],
    size: [usize; 2],
    /// 1 in the mask, 0 outside and in spikes.
    inside: Grid,
    /// Light above the mesh's level, DN, where `inside` is not 0.
    light: Grid,
    /// Noise of a pixel, DN.
    noise: Grid,
}

/// Sums matched to the spot.
struct Sums {
    /// Over their standard deviation in white noise.
    snr: Grid,
    /// Sum of the cubes of the shares over the power 1.5 of that of the squares: what is left of a pixel's skewness.
    skew_left: Grid,
}

/// Spikes, row by row, and the peaks of what stands out of `background`, which gets the local level and the likeness of
/// neighbours in `mask`.
pub(crate) fn matched(
    image: &CameraImage,
    mask: &[bool],
    background: &mut Background,
    wanted: &Wanted,
) -> (Vec<Peak>, Vec<[usize; 2]>) {
    let Some((first, size)) = rectangle(image, mask, wanted.spot_sigma_px) else {
        return (Vec::new(), Vec::new());
    };
    let mut field = Field::new(image, mask, background, (first, size));
    let spikes = field.take_spikes(wanted.spike_share);
    let ones = Grid::of(size, |_, _| 1.0);
    let level = field.level(&ones, wanted.spot_sigma_px);
    field.measure_noise(&level, &ones, wanted.spot_sigma_px);
    let found = field.sums(&level, wanted.spot_sigma_px);
    let dark = field.dark(&found, wanted.spot_sigma_px);
    let level = field.level(&dark, wanted.spot_sigma_px);
    field.measure_noise(&level, &dark, wanted.spot_sigma_px);
    let sums = field.sums(&level, wanted.spot_sigma_px);
    let alike = field.scatter(&sums, &dark, wanted.spot_sigma_px);
    let skew_dn = field.skew_dn(&level, &dark).min(wanted.largest_skew_dn);
    let peaks = field.peaks(&sums, &level, alike, skew_dn, wanted);
    let noise = field.noise;
    background.refine(Local { first, level, noise }, alike);
    (peaks, spikes)
}

/// First pixel and size of what holds the mask and the windows about its pixels.
fn rectangle(image: &CameraImage, mask: &[bool], spot_sigma_px: f64) -> Option<([usize; 2], [usize; 2])> {
    let (width, height) = (image.width_px as usize, image.height_px as usize);
    let around = (5.0 * spot_sigma_px).ceil() as usize + 4;
    let rows = mask.chunks(width.max(1)).enumerate().filter(|(_, row)| row.contains(&true));
    let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
    for (y, row) in rows {
        let inside = || row.iter().enumerate().filter(|(_, inside)| **inside).map(|(x, _)| x);
        let (Some(left), Some(right)) = (inside().next(), inside().next_back()) else { continue };
        low = [low[0].min(left), low[1].min(y)];
        high = [high[0].max(right), high[1].max(y)];
    }
    let first = low.map(|v| v.saturating_sub(around));
    let last = [(high[0] + around + 1).min(width), (high[1] + around + 1).min(height)];
    (low[0] <= high[0]).then(|| (first, [last[0] - first[0], last[1] - first[1]]))
}

impl<'a> Field<'a> {
    fn new(
        image: &'a CameraImage,
        mask: &[bool],
        background: &'a Background,
        (first, size): ([usize; 2], [usize; 2]),
    ) -> Self {
        let width = image.width_px as usize;
        let centre = |x: usize, y: usize| [(first[0] + x) as f64 + 0.5, (first[1] + y) as f64 + 0.5];
        let is_inside = |x: usize, y: usize| mask[(first[1] + y) * width + first[0] + x];
        let inside = Grid::of(size, |x, y| f32::from(u8::from(is_inside(x, y))));
        let light = Grid::of(size, |x, y| {
            let [cx, cy] = centre(x, y);
            let above = f64::from(image.at(first[0] + x, first[1] + y)) - background.level_dn(cx, cy);
            if is_inside(x, y) { above as f32 } else { 0.0 }
        });
        let noise = Grid::of(size, |x, y| {
            let [cx, cy] = centre(x, y);
            background.noise_dn(cx, cy) as f32
        });
        Self { image, background, first, size, inside, light, noise }
    }

    /// Takes out single pixels that stand out and whose neighbours do not: the image's columns and rows.
    fn take_spikes(&mut self, share: f64) -> Vec<[usize; 2]> {
        let mut spikes = Vec::new();
        let [width, height] = [self.image.width_px, self.image.height_px].map(|side| side as usize);
        for at in 0..self.light.values.len() {
            let light = f64::from(self.light.values[at]);
            if light <= SPIKE_SIGMA * f64::from(self.noise.values[at]) {
                continue;
            }
            let [x, y] = [self.first[0] + at % self.size[0], self.first[1] + at / self.size[0]];
            let level = self.background.level_dn(x as f64 + 0.5, y as f64 + 0.5);
            let around = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
            let near: Vec<f64> = around
                .iter()
                .filter(|(c, r)| *c < width && *r < height)
                .map(|&(c, r)| f64::from(self.image.at(c, r)) - level)
                .collect();
            if near.iter().sum::<f64>() < share * light * near.len() as f64 {
                spikes.push([x, y]);
            }
        }
        for [x, y] in &spikes {
            let at = (y - self.first[1]) * self.size[0] + x - self.first[0];
            (self.inside.values[at], self.light.values[at]) = (0.0, 0.0);
        }
        spikes
    }

    /// The level above the mesh's: at each pixel the plane of least squares through those of the mask about it, `weight`
    /// times as much of each.
    fn level(&self, weight: &Grid, spot_sigma_px: f64) -> Grid {
        let sigma_px = (LEVEL_SPOTS * spot_sigma_px).max(LEAST_LEVEL_PX);
        let taps = [0, 1, 2].map(|power| bell(sigma_px, power));
        let weights = self.inside.times(weight);
        let light = self.light.times(weight);
        let rows = taps.each_ref().map(|taps| weights.along_rows(taps));
        let light_rows = [&taps[0], &taps[1]].map(|taps| light.along_rows(taps));
        let [one, x, xx] = [0, 1, 2].map(|k| rows[k].along_columns(&taps[0]));
        let [y, xy] = [0, 1].map(|k| rows[k].along_columns(&taps[1]));
        let yy = rows[0].along_columns(&taps[2]);
        let [sum, sum_x] = [0, 1].map(|k| light_rows[k].along_columns(&taps[0]));
        let sum_y = light_rows[0].along_columns(&taps[1]);
        Grid::of(self.size, |c, r| {
            let [one, x, y, xx, xy, yy, sum, sum_x, sum_y] =
                [&one, &x, &y, &xx, &xy, &yy, &sum, &sum_x, &sum_y].map(|grid| f64::from(grid.at(c, r)));
            if one < LEAST_WEIGHT {
                return 0.0;
            }
            // About the weights' own middle, where mean and slopes part.
            let [mx, my, mean] = [x / one, y / one, sum / one];
            let [xx, xy, yy] = [xx / one - mx * mx, xy / one - mx * my, yy / one - my * my];
            let [sx, sy] = [sum_x / one - mx * mean, sum_y / one - my * mean];
            let determinant = xx * yy - xy * xy;
            // A strip has no slope across itself.
            if one < PLANE_WEIGHT || determinant < (0.2 * sigma_px).powi(4) {
                return mean as f32;
            }
            let slope = [(yy * sx - xy * sy) / determinant, (xx * sy - xy * sx) / determinant];
            (mean - slope[0] * mx - slope[1] * my) as f32
        })
    }

    /// The noise about the level, in a wider surroundings: a cell's own holds the level's slope, too.
    fn measure_noise(&mut self, level: &Grid, weight: &Grid, spot_sigma_px: f64) {
        let taps = bell(NOISE_LEVELS * (LEVEL_SPOTS * spot_sigma_px).max(LEAST_LEVEL_PX), 0);
        let off = |x: usize, y: usize| f64::from(self.light.at(x, y) - level.at(x, y));
        let used = Grid::of(self.size, |x, y| {
            let kept = off(x, y).abs() < NOISE_SIGMA * f64::from(self.noise.at(x, y));
            if kept { self.inside.at(x, y) * weight.at(x, y) } else { 0.0 }
        });
        let squares = Grid::of(self.size, |x, y| used.at(x, y) * off(x, y).powi(2) as f32);
        let [count, squares] = [used, squares].map(|grid| grid.along_rows(&taps).along_columns(&taps));
        // Rounding to whole numbers is noise, however few of them there are.
        let rounding = f64::from(self.image.step_dn(0.0)) / 12f64.sqrt();
        let noise = Grid::of(self.size, |x, y| {
            let [count, squares] = [&count, &squares].map(|grid| f64::from(grid.at(x, y)));
            if count < PLANE_WEIGHT {
                self.noise.at(x, y)
            } else {
                (squares / count).sqrt().max(rounding).max(1e-6) as f32
            }
        });
        self.noise = noise;
    }

    fn sums(&self, level: &Grid, spot_sigma_px: f64) -> Sums {
        let shares = spot_shares(spot_sigma_px);
        let powers =
            [1, 2, 3].map(|power| shares.iter().map(|share| share.powi(power)).collect::<Vec<f32>>());
        let over = |grid: &Grid, taps: &[f32]| grid.along_rows(taps).along_columns(taps);
        let light = Grid::of(self.size, |x, y| (self.light.at(x, y) - level.at(x, y)) * self.inside.at(x, y));
        let light = over(&light, &powers[0]);
        let [squares, cubes] = [1, 2].map(|k| over(&self.inside, &powers[k]));
        let seen = |x: usize, y: usize| squares.at(x, y) > 0.0;
        let snr = Grid::of(self.size, |x, y| {
            let sigma = self.noise.at(x, y) * squares.at(x, y).sqrt();
            if seen(x, y) { light.at(x, y) / sigma } else { f32::NEG_INFINITY }
        });
        let skew_left =
            Grid::of(
                self.size,
                |x, y| {
                    if seen(x, y) { cubes.at(x, y) / squares.at(x, y).powf(1.5) } else { 0.0 }
                },
            );
        Sums { snr, skew_left }
    }

    /// 1 where nothing shines, 0 about what stands out.
    fn dark(&self, sums: &Sums, spot_sigma_px: f64) -> Grid {
        let box_of = vec![1.0; 2 * (LIT_SPOTS * spot_sigma_px).ceil() as usize + 1];
        let is_lit =
            |x: usize, y: usize| self.inside.at(x, y) > 0.0 && f64::from(sums.snr.at(x, y)) > LIT_SIGMA;
        let lit = Grid::of(self.size, |x, y| f32::from(u8::from(is_lit(x, y))));
        let near = lit.along_rows(&box_of).along_columns(&box_of);
        Grid::of(self.size, |x, y| f32::from(u8::from(near.at(x, y) == 0.0)))
    }

    /// How many times the sums scatter what white noise would make them, 1 at least. What is below the middle says it: light
    /// is above.
    fn scatter(&self, sums: &Sums, dark: &Grid, spot_sigma_px: f64) -> f64 {
        let used = self.inside.values.iter().zip(&dark.values).zip(&sums.snr.values);
        let mut values: Vec<f32> =
            used.filter(|((inside, dark), _)| **inside * **dark > 0.0).map(|(_, snr)| *snr).collect();
        // Sums about places 2 sqrt(pi) standard deviations of the spot apart are independent.
        let independent = values.len() as f64 / (4.0 * std::f64::consts::PI * spot_sigma_px.powi(2)).max(1.0);
        if independent < ENOUGH_SUMS {
            return 1.0;
        }
        let [middle, below] = QUANTILES.map(|share| {
            let at = (share * values.len() as f64) as usize;
            f64::from(*values.select_nth_unstable_by(at, f32::total_cmp).1)
        });
        (middle - below).max(1.0)
    }

    /// Third moment of a pixel's noise over its variance, DN, 0 at least: for electrons that are counted, the DN of one.
    fn skew_dn(&self, level: &Grid, dark: &Grid) -> f64 {
        let (mut cubes, mut scale) = (0.0, 0.0);
        for (at, noise) in self.noise.values.iter().enumerate() {
            let relative = f64::from((self.light.values[at] - level.values[at]) / noise);
            if self.inside.values[at] * dark.values[at] > 0.0 && relative.abs() < NOISE_SIGMA {
                cubes += relative.powi(3);
                scale += 1.0 / f64::from(*noise);
            }
        }
        if scale > 0.0 { (cubes / scale).max(0.0) } else { 0.0 }
    }

    fn peaks(&self, sums: &Sums, level: &Grid, alike: f64, skew_dn: f64, wanted: &Wanted) -> Vec<Peak> {
        let threshold = wanted.threshold_sigma;
        // Cornish and Fisher (1938): what skewed noise exceeds as often as normal noise does the threshold.
        let further = skew_dn * (threshold * threshold - 1.0) / 6.0;
        let limit = |x: usize, y: usize| {
            alike * (threshold + further * f64::from(sums.skew_left.at(x, y) / self.noise.at(x, y)))
        };
        let [width, height] = self.size;
        let mut found: Vec<([usize; 2], f64)> = Vec::new();
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let own = sums.snr.at(x, y);
                if self.inside.at(x, y) == 0.0 || f64::from(own) <= limit(x, y) {
                    continue;
                }
                // Outside the mask, too: what grows towards its edge has its maximum elsewhere.
                let before =
                    (x - 1..=x + 1).all(|c| sums.snr.at(c, y - 1) < own) && sums.snr.at(x - 1, y) < own;
                let after =
                    (x - 1..=x + 1).all(|c| sums.snr.at(c, y + 1) <= own) && sums.snr.at(x + 1, y) <= own;
                if before && after {
                    found.push(([x, y], f64::from(own)));
                }
            }
        }
        found.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let mut kept: Vec<([usize; 2], f64)> = Vec::new();
        for (at, snr) in found {
            let is_of = |other: &[usize; 2]| {
                let off = [0, 1].map(|k| at[k] as f64 - other[k] as f64);
                off[0].hypot(off[1]) < SAME_SPOTS * wanted.spot_sigma_px
                    && lowest_between(&sums.snr, *other, at) > SADDLE_SHARE * snr - alike
            };
            if !kept.iter().any(|(other, _)| is_of(other)) {
                kept.push((at, snr));
            }
        }
        kept.iter().map(|(at, _)| self.peak(*at, level)).collect()
    }

    fn peak(&self, [x, y]: [usize; 2], level: &Grid) -> Peak {
        let mut pixel = [x, y];
        let mut light_dn = 0.0;
        for r in y - 1..=y + 1 {
            for c in x - 1..=x + 1 {
                light_dn += f64::from((self.light.at(c, r) - level.at(c, r)) * self.inside.at(c, r));
                if self.light.at(c, r) > self.light.at(pixel[0], pixel[1]) {
                    pixel = [c, r];
                }
            }
        }
        let in_image = |at: [usize; 2]| [self.first[0] + at[0], self.first[1] + at[1]];
        Peak { pixel: in_image(pixel), light_dn, centre: in_image([x, y]), blended: false }
    }
}

/// The least value on the way from one place to another.
fn lowest_between(grid: &Grid, from: [usize; 2], to: [usize; 2]) -> f64 {
    let off = [0, 1].map(|k| to[k] as f64 - from[k] as f64);
    let steps = off[0].abs().max(off[1].abs()).max(1.0) as usize;
    let at = |i: usize| [0, 1].map(|k| (from[k] as f64 + off[k] * i as f64 / steps as f64).round() as usize);
    (0..=steps).map(|i| f64::from(grid.at(at(i)[0], at(i)[1]))).fold(f64::INFINITY, f64::min)
}
