//! The lit blob, and the outline about its outer border: a circle, or an ellipse of known shape. Pixels that are no
//! number are not seen.

use std::ops::Range;

use glam::{DMat3, DVec2, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use retina_image::CameraImage;

/// Pixels are averaged over cells of so many a side to find the blob.
const CELL: usize = 4;
/// A cell is lit where it stands out of the background by so many standard deviations of its mean.
const LIT_SIGMA: f64 = 6.0;
/// And by so much of the brightness of lit cells.
const LIT_SHARE: f64 = 0.08;
/// Trials of three points.
const TRIALS: usize = 400;
/// About as many points judge a trial.
const JUDGES: usize = 200;

/// The outline's shape: an ellipse of these semi-axes over their mean, turned by an angle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    pub angle_rad: f64,
    pub stretch: DVec2,
}

impl Shape {
    /// Takes the outline to a circle.
    fn to_circle(self, pixel: DVec2) -> DVec2 {
        DVec2::from_angle(-self.angle_rad).rotate(pixel) / self.stretch
    }

    fn to_image(self, point: DVec2) -> DVec2 {
        DVec2::from_angle(self.angle_rad).rotate(point * self.stretch)
    }
}

/// What a first look says.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coarse {
    pub center_px: DVec2,
    /// Mean of the semi-axes.
    pub radius_px: f64,
    /// Area of the lit blob, px^2.
    pub lit_px2: f64,
    /// Centre of the lit area, not weighted by brightness.
    pub lit_center_px: DVec2,
    /// Standard deviation of a dark pixel, DN.
    pub noise_dn: f64,
    /// The border reaches the frame, or pixels that are not seen.
    pub touches_frame: bool,
}

impl Coarse {
    /// Greatest width of the lit area, px: a half ellipse of that width beside a half disc has the area pi R w / 2.
    pub(super) fn width_px(&self) -> f64 {
        2.0 * self.lit_px2 / (std::f64::consts::PI * self.radius_px)
    }
}

/// The largest lit blob.
pub(super) struct LitBorder {
    /// Outer border, px.
    pub points: Vec<DVec2>,
    /// Area, px^2.
    pub lit_px2: f64,
    /// Centre of the area, px.
    pub lit_center_px: DVec2,
    /// Standard deviation of a dark pixel, DN.
    pub noise_dn: f64,
    /// The border reaches the frame, or pixels that are not seen.
    pub touches_frame: bool,
}

/// Level and noise of the sky, from the darkest tenth of 32 x 32 px squares, DN.
fn sky(image: &CameraImage) -> [f64; 2] {
    const SIDE: usize = 32;
    let (width, height) = (image.width_px as usize, image.height_px as usize);
    let rows_of = |top: usize| (top..(top + SIDE).min(height)).step_by(4);
    let columns_of = |left: usize| left..(left + SIDE).min(width);
    // Which ones are dark is told by means, as medians take longer.
    let mut squares: Vec<(f32, [usize; 2])> = Vec::new();
    for top in (0..height).step_by(SIDE) {
        for left in (0..width).step_by(SIDE) {
            let (mut sum, mut count) = (0.0f32, 0usize);
            for row in rows_of(top) {
                let pixels = &image.row(row)[columns_of(left)];
                sum += pixels.iter().sum::<f32>();
                count += pixels.len();
            }
            if !sum.is_nan() {
                squares.push((sum / count as f32, [left, top]));
            }
        }
    }
    squares.sort_by(|a, b| a.0.total_cmp(&b.0));
    squares.truncate((squares.len() / 10).max(1));
    let (mut sample, mut steps) = (Vec::new(), Vec::new());
    let (mut levels, mut noises): (Vec<f32>, Vec<f32>) = squares
        .iter()
        .map(|&(_, [left, top])| {
            sample.clear();
            steps.clear();
            for row in rows_of(top) {
                let pixels = &image.row(row)[columns_of(left)];
                sample.extend(pixels.iter().step_by(2));
                // Differences of neighbours: a gradient is no noise.
                steps.extend(pixels.windows(2).step_by(2).map(|pair| (pair[1] - pair[0]).abs()));
            }
            // Median of |difference| of normal noise: 0.6745 sqrt(2) sigma.
            (median(&mut sample), median(&mut steps) / 0.954)
        })
        .unzip();
    // Whole numbers cannot show less noise than their rounding has.
    [f64::from(median(&mut levels)), f64::from(median(&mut noises)).max(1.0 / 12f64.sqrt())]
}

fn median(values: &mut [f32]) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// The largest lit blob and its circle; `None` where nothing is lit or no circle can be laid about it.
pub(super) fn coarse(image: &CameraImage, shape: Shape) -> Option<Coarse> {
    let LitBorder { points, lit_px2, lit_center_px, noise_dn, touches_frame } = lit_border(image)?;
    let border: Vec<DVec2> = points.into_iter().map(|pixel| shape.to_circle(pixel)).collect();
    let (center, radius_px) = circle(&border, touches_frame)?;
    let center_px = shape.to_image(center);
    Some(Coarse { center_px, radius_px, lit_px2, lit_center_px, noise_dn, touches_frame })
}

/// The largest lit blob and its border; `None` where nothing is lit.
pub(super) fn lit_border(image: &CameraImage) -> Option<LitBorder> {
    let [level, noise_dn] = sky(image);
    let (columns, rows) = (image.width_px as usize / CELL, image.height_px as usize / CELL);
    if columns < 4 || rows < 4 {
        return None;
    }
    let mut cells = vec![0f32; columns * rows];
    let area = (CELL * CELL) as f32;
    let mut sums = vec![0f32; columns * CELL];
    for (row, line) in cells.chunks_exact_mut(columns).enumerate() {
        sums.fill(0.0);
        for y in row * CELL..(row + 1) * CELL {
            for (sum, value) in sums.iter_mut().zip(image.row(y)) {
                *sum += value;
            }
        }
        for (cell, pixels) in line.iter_mut().zip(sums.chunks_exact(CELL)) {
            *cell = pixels.iter().sum::<f32>() / area - level as f32;
        }
    }
    let least = (LIT_SIGMA * noise_dn / CELL as f64) as f32;
    let mut lit: Vec<f32> = cells.iter().copied().filter(|&cell| cell > least).collect();
    if lit.is_empty() {
        return None;
    }
    let at = lit.len() * 19 / 20;
    let bright = *lit.select_nth_unstable_by(at, f32::total_cmp).1;
    let threshold = least.max(LIT_SHARE as f32 * bright);
    let blob = largest_blob(&cells, columns, threshold)?;
    let bounds = Bounds::of(&blob);
    let lit_center_px = blob.centers / blob.cells as f64 * CELL as f64;
    let (points, touches_frame) = border(image, &bounds, level + f64::from(threshold).max(5.0 * noise_dn));
    let lit_px2 = (blob.cells * CELL * CELL) as f64;
    Some(LitBorder { points, lit_px2, lit_center_px, noise_dn, touches_frame })
}

/// A connected set of cells.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Blob {
    cells: usize,
    /// Sum of the cells' centres, cells.
    centers: DVec2,
    /// First and last column and row.
    first: [usize; 2],
    last: [usize; 2],
}

impl Blob {
    /// Cells of a row.
    fn of_run(row: usize, columns: &Range<usize>) -> Self {
        let cells = columns.len();
        let middle = 0.5 * (columns.start + columns.end) as f64;
        let last = columns.end - 1;
        Self {
            cells,
            centers: DVec2::new(middle, row as f64 + 0.5) * cells as f64,
            first: [columns.start, row],
            last: [last, row],
        }
    }

    fn joined(self, other: Self) -> Self {
        Self {
            cells: self.cells + other.cells,
            centers: self.centers + other.centers,
            first: [0, 1].map(|k| self.first[k].min(other.first[k])),
            last: [0, 1].map(|k| self.last[k].max(other.last[k])),
        }
    }
}

/// The largest set of cells above the threshold that touch by their sides: runs of each row, joined with those that they
/// touch in the row before.
fn largest_blob(cells: &[f32], columns: usize, threshold: f32) -> Option<Blob> {
    // Of each run the one that it was joined to; of a set's first run itself.
    let mut parents: Vec<usize> = Vec::new();
    let mut blobs: Vec<Blob> = Vec::new();
    let root = |parents: &[usize], mut run: usize| {
        while parents[run] != run {
            run = parents[run];
        }
        run
    };
    let (mut above, mut own) = (Vec::<(Range<usize>, usize)>::new(), Vec::new());
    for (row, line) in cells.chunks_exact(columns).enumerate() {
        own.clear();
        let mut column = 0;
        while let Some(off) = line[column..].iter().position(|&cell| cell > threshold) {
            let start = column + off;
            let length = line[start..].iter().position(|&cell| cell <= threshold);
            let end = length.map_or(columns, |length| start + length);
            let run = parents.len();
            parents.push(run);
            blobs.push(Blob::of_run(row, &(start..end)));
            for (_, other) in above.iter().filter(|(other, _)| other.start < end && start < other.end) {
                let [a, b] = [root(&parents, run), root(&parents, *other)];
                if a != b {
                    let (first, second) = (a.min(b), a.max(b));
                    parents[second] = first;
                    blobs[first] = blobs[first].joined(blobs[second]);
                }
            }
            own.push((start..end, run));
            column = end;
        }
        std::mem::swap(&mut above, &mut own);
    }
    // The first of equal ones.
    (0..blobs.len())
        .filter(|&run| parents[run] == run)
        .max_by_key(|&run| (blobs[run].cells, std::cmp::Reverse(run)))
        .map(|run| blobs[run])
}

/// Pixel bounds of a blob, one cell wider.
struct Bounds {
    left: usize,
    right: usize,
    top: usize,
    bottom: usize,
}

impl Bounds {
    fn of(blob: &Blob) -> Self {
        Self {
            left: (blob.first[0] * CELL).saturating_sub(CELL),
            right: (blob.last[0] + 2) * CELL,
            top: (blob.first[1] * CELL).saturating_sub(CELL),
            bottom: (blob.last[1] + 2) * CELL,
        }
    }
}

/// First and last bright pixel of each row and column: the outer border, without craters. Says, too, whether some of it
/// is at the frame.
fn border(image: &CameraImage, bounds: &Bounds, level_dn: f64) -> (Vec<DVec2>, bool) {
    let (right, bottom) =
        (bounds.right.min(image.width_px as usize), bounds.bottom.min(image.height_px as usize));
    let mut out = Vec::new();
    let mut cut = false;
    let mut add =
        |values: &dyn Fn(usize) -> f64, count: usize, frame: [usize; 2], place: &dyn Fn(f64) -> DVec2| {
            let ends = ends(count, |k| values(k) > level_dn);
            for ((found, edge), side) in ends.into_iter().zip(frame).zip([0.0, 1.0]) {
                // Its neighbour outside.
                let beside = |k: usize| {
                    if side == 0.0 { k.checked_sub(1) } else { Some(k + 1).filter(|k| *k < count) }
                };
                match found {
                    Some(k) if k == edge || beside(k).is_some_and(|k| values(k).is_nan()) => cut = true,
                    Some(k) => out.push(place(k as f64 + side)),
                    None => {}
                }
            }
        };
    let step = |size: usize| (size / 300).max(1);
    let (columns, rows) = (right - bounds.left, bottom - bounds.top);
    // The frame's edge is the end of a scan only where the bounds reach it.
    let begin = |start: usize| if start == 0 { 0 } else { usize::MAX };
    let end = |count: usize, limit: usize, size: usize| if limit == size { count - 1 } else { usize::MAX };
    for y in (bounds.top..bottom).step_by(step(rows)) {
        let row = &image.row(y)[bounds.left..right];
        let frame = [begin(bounds.left), end(columns, right, image.width_px as usize)];
        let place = |k| DVec2::new(bounds.left as f64 + k, y as f64 + 0.5);
        add(&|k| f64::from(row[k]), columns, frame, &place);
    }
    for x in (bounds.left..right).step_by(step(columns)) {
        let frame = [begin(bounds.top), end(rows, bottom, image.height_px as usize)];
        let place = |k| DVec2::new(x as f64 + 0.5, bounds.top as f64 + k);
        add(&|k| f64::from(image.at(x, bounds.top + k)), rows, frame, &place);
    }
    (out, cut)
}

/// First and last bright place. Two in a row: one may be noise, a hot pixel or a star.
fn ends(count: usize, bright: impl Fn(usize) -> bool) -> [Option<usize>; 2] {
    let first = (0..count.saturating_sub(1)).find(|&k| bright(k) && bright(k + 1));
    [first, first.and_then(|_| (1..count).rev().find(|&k| bright(k) && bright(k - 1)))]
}

/// The circle with most points on it and fewest outside: the limb is the outermost curve, the terminator lies within.
fn circle(points: &[DVec2], cut: bool) -> Option<(DVec2, f64)> {
    if points.len() < 8 {
        return None;
    }
    // A half disc is as long as the whole one is wide; a straight terminator lies on a far larger circle.
    let low = points.iter().copied().reduce(DVec2::min)?;
    let high = points.iter().copied().reduce(DVec2::max)?;
    let most_radius = if cut { f64::INFINITY } else { 0.75 * low.distance(high) };
    // An odd step: firsts and lasts of rows and columns take turns.
    let step = (points.len() / JUDGES) | 1;
    let judges: Vec<DVec2> = points.iter().copied().step_by(step).collect();
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut best: Option<(f64, DVec2, f64)> = None;
    for _ in 0..TRIALS {
        let three: [DVec2; 3] = std::array::from_fn(|_| points[random.next_u32() as usize % points.len()]);
        let Some((center, radius)) = least_squares_circle(&three) else { continue };
        if radius > most_radius {
            continue;
        }
        let tolerance = 1.0 + 0.004 * radius;
        // Squares of the distances to the ring's edges: no root a point.
        let [inner, outer] = [(radius - tolerance).max(0.0).powi(2), (radius + tolerance).powi(2)];
        let score: f64 = judges
            .iter()
            .map(|point| match point.distance_squared(center) {
                far if far >= outer => -2.0,
                on if on > inner => 1.0,
                _ => 0.0,
            })
            .sum();
        if best.is_none_or(|(most, ..)| score > most) {
            best = Some((score, center, radius));
        }
    }
    let (score, mut center, mut radius) = best?;
    if score < 6.0 {
        return None;
    }
    for _ in 0..2 {
        let tolerance = 1.0 + 0.004 * radius;
        let near: Vec<DVec2> =
            points.iter().copied().filter(|p| (p.distance(center) - radius).abs() < tolerance).collect();
        (center, radius) = least_squares_circle(&near)?;
    }
    Some((center, radius))
}

/// Algebraic least squares of x^2 + y^2 = 2 a x + 2 b y + c about the points' mean.
fn least_squares_circle(points: &[DVec2]) -> Option<(DVec2, f64)> {
    let mean = points.iter().sum::<DVec2>() / points.len() as f64;
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for point in points {
        let off = *point - mean;
        let row = DVec3::new(2.0 * off.x, 2.0 * off.y, 1.0);
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        right += row * off.length_squared();
    }
    if normal.determinant().abs() < 1e-6 {
        return None;
    }
    let solved = normal.inverse() * right;
    let radius2 = solved.z + solved.truncate().length_squared();
    (radius2 > 0.0 && radius2.is_finite()).then(|| (mean + solved.truncate(), radius2.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sizes of all sets, by a flood from each cell.
    fn flooded(cells: &[f32], columns: usize) -> Vec<usize> {
        let mut left: Vec<bool> = cells.iter().map(|&cell| cell > 0.5).collect();
        let mut sizes = Vec::new();
        while let Some(start) = left.iter().position(|&lit| lit) {
            let (mut open, mut size) = (vec![start], 0);
            while let Some(at) = open.pop() {
                if !std::mem::take(&mut left[at]) {
                    continue;
                }
                size += 1;
                let column = at % columns;
                open.extend((column > 0).then(|| at - 1));
                open.extend((column + 1 < columns).then_some(at + 1));
                open.extend(at.checked_sub(columns));
                open.extend(Some(at + columns).filter(|&next| next < cells.len()));
            }
            sizes.push(size);
        }
        sizes
    }

    #[test]
    fn the_largest_blob_is_the_one_that_a_flood_finds() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        // About the percolation threshold (0.593 of a square lattice) blobs are as ragged as they get.
        for share in [0.3, 0.5, 0.593, 0.7, 1.0] {
            for columns in [1usize, 7, 40] {
                let lit = |random: &mut ChaCha8Rng| f64::from(random.next_u32()) / 4_294_967_296.0 < share;
                let cells: Vec<f32> =
                    (0..columns * 30).map(|_| f32::from(u8::from(lit(&mut random)))).collect();
                let blob = largest_blob(&cells, columns, 0.5).unwrap();
                assert_eq!(Some(blob.cells), flooded(&cells, columns).into_iter().max(), "{share} {columns}");
            }
        }
        assert_eq!(largest_blob(&[0.0; 12], 4, 0.5), None);
        // A U of two columns, joined in the last row: centre and bounds by hand.
        let blob = largest_blob(&[1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0], 3, 0.5).unwrap();
        assert_eq!((blob.cells, blob.first, blob.last), (7, [0, 0], [2, 2]));
        assert_eq!(blob.centers, DVec2::new(10.5, 11.5));
    }
}
