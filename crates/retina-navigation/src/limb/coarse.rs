//! The lit blob, and the outline about its outer border: a circle, or an ellipse of known shape.

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
    pub touches_frame: bool,
}

/// Level and noise of the sky, from the darkest tenth of 32 x 32 px squares, DN.
fn sky(image: &CameraImage) -> [f64; 2] {
    let (width, height) = (image.width_px as usize, image.height_px as usize);
    let mut squares: Vec<[f32; 2]> = Vec::new();
    let (mut sample, mut steps) = (Vec::new(), Vec::new());
    for top in (0..height).step_by(32) {
        for left in (0..width).step_by(32) {
            sample.clear();
            steps.clear();
            for row in (top..(top + 32).min(height)).step_by(4) {
                let cells = &image.row(row)[left..(left + 32).min(width)];
                sample.extend(cells.iter().step_by(2));
                // Differences of neighbours: a gradient is no noise.
                steps.extend(cells.windows(2).step_by(2).map(|pair| (pair[1] - pair[0]).abs()));
            }
            // Median of |difference| of normal noise: 0.6745 sqrt(2) sigma.
            squares.push([median(&mut sample), median(&mut steps) / 0.954]);
        }
    }
    squares.sort_by(|a, b| a[0].total_cmp(&b[0]));
    squares.truncate((squares.len() / 10).max(1));
    let mut noise: Vec<f32> = squares.iter().map(|square| square[1]).collect();
    // Whole numbers cannot show less noise than their rounding has.
    [f64::from(squares[squares.len() / 2][0]), f64::from(median(&mut noise)).max(1.0 / 12f64.sqrt())]
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
    let [level, noise_dn] = sky(image);
    let (columns, rows) = (image.width_px as usize / CELL, image.height_px as usize / CELL);
    if columns < 4 || rows < 4 {
        return None;
    }
    let mut cells = vec![0f32; columns * rows];
    for row in 0..rows * CELL {
        let line = &mut cells[(row / CELL) * columns..][..columns];
        for (cell, pixels) in line.iter_mut().zip(image.row(row).chunks_exact(CELL)) {
            *cell += pixels.iter().sum::<f32>();
        }
    }
    let area = (CELL * CELL) as f32;
    cells.iter_mut().for_each(|cell| *cell = *cell / area - level as f32);
    let least = (LIT_SIGMA * noise_dn / CELL as f64) as f32;
    let mut lit: Vec<f32> = cells.iter().copied().filter(|&cell| cell > least).collect();
    if lit.is_empty() {
        return None;
    }
    let at = lit.len() * 19 / 20;
    let bright = *lit.select_nth_unstable_by(at, f32::total_cmp).1;
    let threshold = least.max(LIT_SHARE as f32 * bright);
    let blob = largest_blob(&cells, columns, threshold);
    let bounds = Bounds::of(&blob, columns)?;
    let mut lit_center_px = DVec2::ZERO;
    for &cell in &blob {
        let at = DVec2::new((cell % columns) as f64, (cell / columns) as f64);
        lit_center_px += (at + 0.5) * CELL as f64 / blob.len() as f64;
    }
    let (border, touches_frame) = border(image, &bounds, level + f64::from(threshold).max(5.0 * noise_dn));
    let border: Vec<DVec2> = border.into_iter().map(|pixel| shape.to_circle(pixel)).collect();
    let (center, radius_px) = circle(&border, touches_frame)?;
    let center_px = shape.to_image(center);
    let lit_px2 = (blob.len() * CELL * CELL) as f64;
    Some(Coarse { center_px, radius_px, lit_px2, lit_center_px, noise_dn, touches_frame })
}

/// Indices of the largest connected set of cells above the threshold.
fn largest_blob(cells: &[f32], columns: usize, threshold: f32) -> Vec<usize> {
    let mut seen = vec![false; cells.len()];
    let (mut best, mut stack) = (Vec::new(), Vec::new());
    for start in 0..cells.len() {
        if seen[start] || cells[start] <= threshold {
            continue;
        }
        let mut blob = Vec::new();
        seen[start] = true;
        stack.push(start);
        while let Some(at) = stack.pop() {
            blob.push(at);
            let column = at % columns;
            let near = [
                (column > 0).then(|| at - 1),
                (column + 1 < columns).then_some(at + 1),
                at.checked_sub(columns),
                Some(at + columns).filter(|&next| next < cells.len()),
            ];
            for next in near.into_iter().flatten() {
                if !seen[next] && cells[next] > threshold {
                    seen[next] = true;
                    stack.push(next);
                }
            }
        }
        if blob.len() > best.len() {
            best = blob;
        }
    }
    best
}

/// Pixel bounds of a blob, one cell wider.
struct Bounds {
    left: usize,
    right: usize,
    top: usize,
    bottom: usize,
}

impl Bounds {
    fn of(blob: &[usize], columns: usize) -> Option<Self> {
        let xs = || blob.iter().map(|cell| cell % columns);
        let ys = || blob.iter().map(|cell| cell / columns);
        Some(Self {
            left: (xs().min()? * CELL).saturating_sub(CELL),
            right: (xs().max()? + 2) * CELL,
            top: (ys().min()? * CELL).saturating_sub(CELL),
            bottom: (ys().max()? + 2) * CELL,
        })
    }
}

/// First and last bright pixel of each row and column: the outer border, without craters. Says, too, whether some of it
/// is at the frame.
fn border(image: &CameraImage, bounds: &Bounds, level_dn: f64) -> (Vec<DVec2>, bool) {
    let (right, bottom) =
        (bounds.right.min(image.width_px as usize), bounds.bottom.min(image.height_px as usize));
    let mut out = Vec::new();
    let mut cut = false;
    // Two in a row: one may be noise, a hot pixel or a star.
    let mut scan =
        |count: usize, frame: [usize; 2], value: &dyn Fn(usize) -> f32, place: &dyn Fn(f64) -> DVec2| {
            let bright = |k: usize| f64::from(value(k)) > level_dn;
            let first = (0..count.saturating_sub(1)).find(|&k| bright(k) && bright(k + 1));
            let last = (1..count).rev().find(|&k| bright(k) && bright(k - 1));
            for (found, edge, side) in [(first, frame[0], 0.0), (last, frame[1], 1.0)] {
                match found {
                    Some(k) if k == edge => cut = true,
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
        scan(columns, frame, &|k| row[k], &place);
    }
    for x in (bounds.left..right).step_by(step(columns)) {
        let frame = [begin(bounds.top), end(rows, bottom, image.height_px as usize)];
        let place = |k| DVec2::new(x as f64 + 0.5, bounds.top as f64 + k);
        scan(rows, frame, &|k| image.at(x, bounds.top + k), &place);
    }
    (out, cut)
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
        let score: f64 = points
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
