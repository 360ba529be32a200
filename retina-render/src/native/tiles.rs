//! The two passes over a tile.

use glam::{DVec2, Vec2};

use super::Listed;
use super::Listing;
use super::coverage::Square;
use super::frame::{Prepared, Tile};
use super::pixels::{Pixel, PixelWork, View};
use super::places::{disc_points, square_point};
use super::rays::LANES;
use super::reads::{Places, Reads};
use super::visibility::{Draw, Samples, Setup};
use crate::Quality;

/// Where the samples of a pixel lie, and which points of the Sun's disc its rays go to.
pub(crate) struct Pattern {
    places: Places,
    /// Within the unit disc: one for each sample, or fewer where only some samples look at the Sun.
    sun_points: Vec<Vec2>,
    /// Where textures are read.
    reads: Reads,
}

impl Pattern {
    fn new(samples_log2: u32, sun_points: u32, reads_log2: u32) -> Self {
        let points = |log2: u32| (0..1 << log2).map(|k| square_point(k, log2)).collect::<Vec<Vec2>>();
        let samples = points(samples_log2);
        Self {
            places: Places::new(&samples),
            sun_points: disc_points(sun_points),
            reads: Reads::new(&points(reads_log2), &samples),
        }
    }

    fn of_samples(samples_log2: u32) -> Self {
        Self::new(samples_log2, 1 << samples_log2, samples_log2)
    }
}

/// How pixels are sampled.
pub(crate) struct Sampling {
    /// All of them; its Sun points are those of a pixel where there is doubt about the Sun.
    first: Pattern,
    /// Whether the areas of triangles within a pixel are measured, or counted in samples.
    measured: bool,
    edge: Pattern,
    inner: Pattern,
    /// A pixel whose fragments hide each other is refined when they differ by more than this part of the body's mean
    /// radiance factor: its samples give their areas to some per cent.
    pub(crate) contrast: f64,
}

impl Sampling {
    pub(crate) fn of(quality: Quality) -> Self {
        let (first_log2, probes, reads_log2, edge_log2, inner_log2, contrast) = match quality {
            Quality::Draft => (2, 4, 2, 5, 4, 0.5),
            Quality::Default => (4, 8, 6, 8, 6, 0.03),
            Quality::Best => (4, 16, 8, 8, 8, 0.01),
        };
        Self {
            first: Pattern::new(first_log2, probes, reads_log2),
            measured: quality != Quality::Draft,
            edge: Pattern::of_samples(edge_log2),
            inner: Pattern::of_samples(inner_log2),
            contrast,
        }
    }
}

/// Work space of one thread.
#[derive(Default)]
pub(crate) struct TileWork {
    samples: Samples,
    setups: Vec<Setup>,
    /// What is to be drawn: see [`Draw`].
    runs: Vec<[u32; 3]>,
    candidates: Candidates,
    pixels: PixelWork,
}

/// For each pixel of a tile the triangles that may touch it.
#[derive(Default)]
struct Candidates {
    /// Where a pixel's begin in `numbers`; one more than there are pixels.
    starts: Vec<u32>,
    /// Indices of the tile's triangles.
    numbers: Vec<u32>,
    next: Vec<u32>,
}

impl Candidates {
    /// Sorts the runs that are to be drawn by pixel; each pixel has `n` samples.
    fn sort(&mut self, runs: &[[u32; 3]], n: usize, pixels: usize) {
        let touched = |&[from, to, _]: &[u32; 3]| from as usize / n..to as usize / n;
        self.starts.clear();
        self.starts.resize(pixels + 1, 0);
        for pixel in runs.iter().flat_map(touched) {
            self.starts[pixel + 1] += 1;
        }
        for pixel in 0..pixels {
            self.starts[pixel + 1] += self.starts[pixel];
        }
        self.next.clone_from(&self.starts);
        self.numbers.clear();
        self.numbers.resize(self.starts[pixels] as usize, 0);
        for run in runs {
            for next in &mut self.next[touched(run)] {
                self.numbers[*next as usize] = run[2];
                *next += 1;
            }
        }
    }

    fn of(&self, pixel: usize) -> &[u32] {
        &self.numbers[self.starts[pixel] as usize..self.starts[pixel + 1] as usize]
    }
}

/// Reference of a tile: where lines of sight are counted from.
struct Reference {
    centre_px: DVec2,
    sight: DVec2,
    /// What a pixel along x and along y adds to the line of sight.
    steps: [[f32; 2]; 2],
}

impl Reference {
    fn of(frame: &Prepared<'_>, tile: &Tile) -> Self {
        let corner = DVec2::new(f64::from(tile.origin[0]), f64::from(tile.origin[1]));
        let centre_px = corner + 0.5 * DVec2::new(f64::from(tile.size[0]), f64::from(tile.size[1]));
        let step = |half: DVec2| {
            (frame.sight(centre_px + half) - frame.sight(centre_px - half)).as_vec2().to_array()
        };
        let steps = [step(DVec2::new(0.5, 0.0)), step(DVec2::new(0.0, 0.5))];
        Self { centre_px, sight: frame.sight(centre_px), steps }
    }
}

impl<'a> View<'a> {
    fn new(
        frame: &'a Prepared<'a>,
        reference: &Reference,
        pattern: &'a Pattern,
        setups: &'a [Setup],
        samples: &'a Samples,
        layers: bool,
    ) -> Self {
        Self {
            frame,
            setups,
            samples,
            sight: reference.sight.as_vec2().to_array(),
            layers,
            sun_points: &pattern.sun_points,
            reads: &pattern.reads,
            places: &pattern.places,
            pixel: 0,
            run: 0..0,
            square: Square { middle: [0.0; 2], steps: reference.steps },
        }
    }
}

impl TileWork {
    /// The pixels of a tile, row by row.
    pub(crate) fn first_pass(
        &mut self,
        frame: &Prepared<'_>,
        index: usize,
        sampling: &Sampling,
        layers: bool,
    ) -> Vec<Pixel> {
        let tile = frame.tile(index);
        let [width, height] = tile.size.map(|side| side as usize);
        let triangles = frame.triangles(index);
        if triangles.is_empty() {
            return vec![Pixel::SKY; width * height];
        }
        if let Some(body) = frame.night(index) {
            return vec![Pixel::night(body); width * height];
        }
        let reference = Reference::of(frame, &tile);
        let n = sampling.first.places.count();
        let all = 0..(width * height) as u32;
        self.place(frame, &tile, &reference, &sampling.first, all);
        self.setups.clear();
        self.runs.clear();
        for triangle in triangles {
            let setup = Setup::new(frame, triangle.triangle, reference.sight);
            let (from, to) = (triangle.low[0] as usize, (triangle.high[0] as usize + 1).min(width));
            for row in triangle.low[1] as usize..=(triangle.high[1] as usize).min(height - 1) {
                let run = [(row * width + from) * n, (row * width + to) * n, self.setups.len()];
                self.runs.push(run.map(|number| number as u32));
            }
            self.setups.push(setup);
        }
        let count = width * height;
        let numbers = |local: usize| local * n..(local + 1) * n;
        let mut out = vec![Pixel::SKY; count];
        let mut left: Vec<usize> = (0..count).collect();
        let Self { samples, setups, runs, candidates, pixels } = self;
        pixels.begin(setups.len());
        if sampling.measured {
            candidates.sort(runs, n, count);
            let mut view = View::new(frame, &reference, &sampling.first, setups, samples, layers);
            left.retain(|&local| {
                view.turn_to(pixel_number(frame, &tile, local as u32), numbers(local));
                let whole = pixels.whole(&view, candidates.of(local));
                out[local] = whole.unwrap_or(Pixel::SKY);
                whole.is_none()
            });
            runs.clear();
            for &local in &left {
                let [from, to] = [local * n, (local + 1) * n].map(|sample| sample as u32);
                runs.extend(candidates.of(local).iter().map(|&candidate| [from, to, candidate]));
            }
        }
        frame.level.run(Draw { samples, setups, runs });
        let mut view = View::new(frame, &reference, &sampling.first, setups, samples, layers);
        for local in left {
            view.turn_to(pixel_number(frame, &tile, local as u32), numbers(local));
            out[local] = pixels.sampled(&view);
        }
        out
    }

    /// Listed pixels anew, with their numbers in the tile.
    pub(crate) fn second_pass(
        &mut self,
        frame: &Prepared<'_>,
        index: usize,
        list: &[Listed],
        sampling: &Sampling,
        layers: bool,
    ) -> Vec<(u32, Pixel)> {
        let mut out = Vec::with_capacity(list.len());
        for (what, pattern) in [(Listing::Edge, &sampling.edge), (Listing::Inner, &sampling.inner)] {
            let chosen: Vec<u32> =
                list.iter().filter(|listed| listed.what == what).map(|listed| listed.local).collect();
            // A few at a time, so that their samples stay near the processor.
            for some in chosen.chunks(64) {
                self.sample_again(frame, index, some, pattern, layers, sampling.measured, &mut out);
            }
        }
        out
    }

    fn sample_again(
        &mut self,
        frame: &Prepared<'_>,
        index: usize,
        chosen: &[u32],
        pattern: &Pattern,
        layers: bool,
        measured: bool,
        out: &mut Vec<(u32, Pixel)>,
    ) {
        let tile = frame.tile(index);
        let reference = Reference::of(frame, &tile);
        let n = pattern.places.count();
        self.place(frame, &tile, &reference, pattern, chosen.iter().copied());
        // For each row the listed pixels in it, by their order in `chosen`.
        let width = tile.size[0];
        let mut rows: Vec<Vec<(u8, usize)>> = vec![Vec::new(); tile.size[1] as usize];
        for (slot, &local) in chosen.iter().enumerate() {
            rows[(local / width) as usize].push(((local % width) as u8, slot));
        }
        self.setups.clear();
        self.runs.clear();
        for triangle in frame.triangles(index) {
            let mut setup = None;
            for row in triangle.low[1]..=triangle.high[1] {
                let Some(row) = rows.get(row as usize) else { continue };
                for &(column, slot) in row {
                    if column >= triangle.low[0] && column <= triangle.high[0] {
                        setup.get_or_insert_with(|| Setup::new(frame, triangle.triangle, reference.sight));
                        let run = [slot * n, (slot + 1) * n, self.setups.len()];
                        self.runs.push(run.map(|number| number as u32));
                    }
                }
            }
            self.setups.extend(setup);
        }
        let Self { samples, setups, runs, candidates, pixels } = self;
        candidates.sort(if measured { runs } else { &[] }, n, chosen.len());
        frame.level.run(Draw { samples, setups, runs });
        pixels.begin(setups.len());
        let mut view = View::new(frame, &reference, pattern, setups, samples, layers);
        for (slot, &local) in chosen.iter().enumerate() {
            view.turn_to(pixel_number(frame, &tile, local), slot * n..(slot + 1) * n);
            let planes = pixels.refined(&view, candidates.of(slot));
            out.push((local, Pixel { planes, ..Pixel::SKY }));
        }
    }

    /// Sets the samples' lines of sight, those of one pixel after those of another.
    fn place(
        &mut self,
        frame: &Prepared<'_>,
        tile: &Tile,
        reference: &Reference,
        pattern: &Pattern,
        pixels: impl ExactSizeIterator<Item = u32>,
    ) {
        let n = pattern.places.count();
        self.samples.clear(pixels.len() * n);
        let [inverse_fx, inverse_fy] = frame.inverse_focal_px;
        // From the tile's middle to the middle of its first pixel.
        let corner =
            0.5 + DVec2::new(f64::from(tile.origin[0]), f64::from(tile.origin[1])) - reference.centre_px;
        let (corner_x, corner_y) = (corner.x as f32, corner.y as f32);
        for (slot, local) in pixels.enumerate() {
            let [x, y] = tile.offset(local).map(|offset| offset as f32);
            let run = slot * n..(slot + 1) * n;
            let places = self.samples.x[run.clone()].iter_mut().zip(&mut self.samples.y[run]);
            for ((to_x, to_y), [px, py]) in places.zip(pattern.places.iter()) {
                *to_x = (corner_x + x + px) * inverse_fx;
                *to_y = (corner_y + y + py) * inverse_fy;
            }
        }
        if let Some(distortion) = &frame.state.distortion {
            let middle = frame.state.image.line_of_sight(reference.centre_px).as_vec2();
            let sight = reference.sight.as_vec2();
            let coefficients: Vec<[f32; 2]> =
                distortion.coefficients().iter().map(|c| c.as_vec2().to_array()).collect();
            let lanes = self.samples.x.chunks_mut(LANES).zip(self.samples.y.chunks_mut(LANES));
            for (x, y) in lanes {
                bend(distortion.degree() as usize, &coefficients, middle.to_array(), sight.to_array(), x, y);
            }
        }
    }
}

/// Undistorted places about `middle` become lines of sight about `sight`: Horner in x of Horner in y.
#[inline(always)]
fn bend(
    degree: usize,
    coefficients: &[[f32; 2]],
    middle: [f32; 2],
    sight: [f32; 2],
    x: &mut [f32],
    y: &mut [f32],
) {
    let count = x.len().min(LANES);
    let (mut at_x, mut at_y) = ([0.0f32; LANES], [0.0f32; LANES]);
    at_x[..count].copy_from_slice(&x[..count]);
    at_y[..count].copy_from_slice(&y[..count]);
    for k in 0..LANES {
        at_x[k] += middle[0];
        at_y[k] += middle[1];
    }
    let (mut sum_x, mut sum_y) = ([0.0f32; LANES], [0.0f32; LANES]);
    let mut index = coefficients.len();
    for i in 0..=degree {
        let (mut row_x, mut row_y) = ([0.0f32; LANES], [0.0f32; LANES]);
        for _ in 0..=i {
            index -= 1;
            let [cx, cy] = coefficients[index];
            for k in 0..LANES {
                row_x[k] = row_x[k] * at_y[k] + cx;
                row_y[k] = row_y[k] * at_y[k] + cy;
            }
        }
        for k in 0..LANES {
            sum_x[k] = sum_x[k] * at_x[k] + row_x[k];
            sum_y[k] = sum_y[k] * at_x[k] + row_y[k];
        }
    }
    for k in 0..count {
        x[k] = sum_x[k] - sight[0];
        y[k] = sum_y[k] - sight[1];
    }
}

/// A pixel's number in the image.
fn pixel_number(frame: &Prepared<'_>, tile: &Tile, local: u32) -> u32 {
    let [x, y] = tile.pixel(local);
    y * frame.state.image.width_px + x
}
