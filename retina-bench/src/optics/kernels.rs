//! What a sub-pixel's light does to the pixels about its place, at nodes over the sensor.

use glam::DVec2;
use rayon::prelude::*;
use retina_optics::facility::{
    Chebyshev2, Imaging, Kernel, KernelFrame, KernelGrid, SpectralLine, TILT, WAVEFRONT_TERMS, tangents,
};

use super::place::BEYOND;
use super::windowed::Sampling;
use super::{CameraPose, FUNCTIONS, OpticsDetail, PointImage, added, middle_line};
use crate::{BenchError, Display, Imperfections};

/// Samples of a kernel a pixel.
pub(super) const PER_PX: usize = 4;

/// A kernel cut into its phases: plane (py, px) holds the samples (4 j + py, 4 i + px), row j, column i.
/// So neighbouring pixels read neighbouring numbers. A sample is `scale` times its root's square: half of the memory
/// that f32 takes, and reading all kernels is what an exposure's time goes into. Roundings are 2e-5 of the sample at the
/// kernel's peak, and 2e-3 of it where it is 1e-4 of the peak.
#[derive(Debug, Clone)]
pub(super) struct Phases {
    pub(super) roots: Vec<u16>,
    pub(super) scale: f32,
}

/// Kernels of the three channels at nodes that cover the sensor.
pub(super) struct Kernels {
    nodes: [usize; 2],
    /// Where the first node is on the sensor, and how far the last one is from it, px.
    origin_px: DVec2,
    span_px: DVec2,
    half_px: usize,
    /// Index: (row of nodes * columns + column) * 3 + channel.
    phases: Vec<Phases>,
    /// Of each kernel the largest value beyond each whole radius, pixels.
    tails: Vec<Vec<f32>>,
    /// Mean share of the light that lies beyond the kernels.
    beyond: f64,
}

/// The four nodes about a place and their shares.
pub(super) type Blend = [(usize, f32); 4];

/// What makes the images of points.
#[derive(Clone, Copy)]
pub(super) struct Shapes<'a> {
    pub(super) imaging: &'a Imaging,
    pub(super) wrong: &'a Imperfections,
    pub(super) point_image: PointImage,
    pub(super) sampling: &'a Sampling,
}

impl Shapes<'_> {
    /// What is added to the traced wavefront of a place (mm) whose light has these tangents: the objective's part, and
    /// less all of the aberrations where they are left out.
    fn added(
        &self,
        [x, y, z]: [f64; 3],
        toward: [f64; 2],
        nm: f64,
        radius_mm: f64,
    ) -> [f64; WAVEFRONT_TERMS] {
        let mut terms = added(&self.wrong.objective, toward, nm, radius_mm);
        if self.point_image != PointImage::Full {
            let traced = self.imaging.wavefront([x, y], nm, z).coefficients_mm;
            for k in (0..WAVEFRONT_TERMS).filter(|k| !TILT.contains(k)) {
                terms[k] = -traced[k];
            }
        }
        terms
    }

    fn kernel(
        &self,
        place: [f64; 3],
        lines: &[SpectralLine],
        camera: &CameraPose,
        grid: KernelGrid,
    ) -> Result<Kernel, BenchError> {
        let [x, y, z] = place;
        if self.point_image == PointImage::Point {
            let side = grid.side();
            let mut values = vec![0f32; side * side];
            values[side / 2 * side + side / 2] = (grid.per_px * grid.per_px) as f32;
            return Ok(Kernel { grid, values, beyond: 0.0 });
        }
        let mut toward = [0.0; 2];
        let mut radius_mm = 0.0;
        let mut centroid = [0.0; 2];
        let mut offset = [0.0; 2];
        for &(nm, weight) in lines {
            let wavefront = self.imaging.wavefront([x, y], nm, z);
            let tilt = wavefront.reference_tangents();
            radius_mm = wavefront.pupil_radius_mm;
            let seen = wavefront.plus(&self.added(place, tilt, nm, radius_mm));
            let at = tangents(seen.centroid());
            toward = [0, 1].map(|k| toward[k] + weight * tilt[k]);
            centroid = [0, 1].map(|k| centroid[k] + weight * at[k]);
            if nm == middle_line(lines) {
                let found = self.sampling.middle(nm, &seen);
                offset = [0, 1].map(|k| found[k] - at[k]);
            }
        }
        // All lines together are one spot, and are found as the middle one is.
        let reference = [0, 1].map(|k| centroid[k] + offset[k]);
        let frame = KernelFrame { reference, roll_rad: camera.roll_rad };
        let objective = |nm: f64| self.added(place, toward, nm, radius_mm);
        Ok(self.imaging.kernel([x, y], lines, z, frame, grid, objective)?)
    }
}

impl Kernels {
    pub(super) fn new(
        shapes: Shapes<'_>,
        maps: &[Chebyshev2<FUNCTIONS>],
        half_screen_mm: [f64; 2],
        camera: &CameraPose,
        display: &Display,
        lines: &[Vec<SpectralLine>; 3],
        detail: OpticsDetail,
        size_px: [usize; 2],
    ) -> Result<Self, BenchError> {
        let grid = KernelGrid { focal_px: camera.pinhole.fx_px, per_px: PER_PX, half_px: detail.half_px };
        let pixel_fill = shapes.wrong.pixel_fill;
        let fill = if pixel_fill > 0.0 { pixel_fill } else { 1.0 };
        let count = detail.nodes[0] * detail.nodes[1];
        let size = DVec2::from_array(size_px.map(|size| size as f64));
        let (origin_px, span_px) = (-0.5 * BEYOND * size, (1.0 + BEYOND) * size);
        let at_node = |node: usize| {
            let at = [0, 1].map(|k| [node % detail.nodes[0], node / detail.nodes[0]][k] as f64);
            origin_px + DVec2::from_array([0, 1].map(|k| at[k] / (detail.nodes[k] - 1) as f64)) * span_px
        };
        let made: Vec<(Phases, f64)> = (0..3 * count)
            .into_par_iter()
            .map(|i| {
                let (node, channel) = (i / 3, i % 3);
                let (screen, slope) = source_of(&maps[channel], half_screen_mm, at_node(node));
                let place = shapes.wrong.screen.place(screen);
                let mut kernel = shapes.kernel(place, &lines[channel], camera, grid)?;
                kernel.spread(emission_px(slope, display));
                kernel.spread([fill, fill]);
                Ok::<_, BenchError>((Phases::of(&kernel), kernel.beyond))
            })
            .collect::<Result<_, _>>()?;
        let beyond = made.iter().map(|(_, beyond)| beyond).sum::<f64>() / made.len() as f64;
        let phases: Vec<Phases> = made.into_iter().map(|(phases, _)| phases).collect();
        let tails = phases.par_iter().map(|phases| phases.tail(detail.half_px)).collect();
        Ok(Self { nodes: detail.nodes, origin_px, span_px, half_px: detail.half_px, phases, tails, beyond })
    }

    /// Samples of a phase plane along each axis.
    pub(super) fn plane(&self) -> usize {
        2 * self.half_px + 1
    }

    pub(super) fn half_px(&self) -> usize {
        self.half_px
    }

    pub(super) fn beyond(&self) -> f64 {
        self.beyond
    }

    pub(super) fn nodes(&self) -> [usize; 2] {
        self.nodes
    }

    /// Where the first node is on the sensor, px.
    pub(super) fn origin_px(&self) -> DVec2 {
        self.origin_px
    }

    /// From node to node, px.
    pub(super) fn spacing_px(&self) -> DVec2 {
        self.span_px / DVec2::from_array(self.nodes.map(|nodes| (nodes - 1) as f64))
    }

    pub(super) fn phases(&self, node: usize, channel: usize) -> &Phases {
        &self.phases[3 * node + channel]
    }

    /// The largest share of a sub-pixel's light that one pixel receives from any kernel.
    pub(super) fn largest(&self) -> f32 {
        self.tails.iter().map(|tail| tail[0]).fold(0.0, f32::max)
    }

    /// Radius, pixels, from which on no kernel of these has values of `limit` or more.
    pub(super) fn reach(&self, blend: &Blend, channel: usize, limit: f32) -> usize {
        let of_node =
            |&(node, _): &(usize, f32)| self.tails[3 * node + channel].partition_point(|&v| v >= limit);
        blend.iter().map(of_node).max().unwrap_or(0)
    }

    /// Bilinear shares of the nodes about a place on the sensor; places off them take their edge.
    pub(super) fn blend(&self, at_px: DVec2) -> Blend {
        let within = ((at_px - self.origin_px) / self.span_px).clamp(DVec2::ZERO, DVec2::ONE);
        let along = |share: f64, nodes: usize| {
            let at = share * (nodes - 1) as f64;
            let cell = (at as usize).min(nodes - 2);
            (cell, (at - cell as f64) as f32)
        };
        let (x, fx) = along(within.x, self.nodes[0]);
        let (y, fy) = along(within.y, self.nodes[1]);
        let first = y * self.nodes[0] + x;
        let below = first + self.nodes[0];
        [
            (first, (1.0 - fx) * (1.0 - fy)),
            (first + 1, fx * (1.0 - fy)),
            (below, (1.0 - fx) * fy),
            (below + 1, fx * fy),
        ]
    }
}

/// The point of the display (mm) whose light lands at a pixel, and d(pixel) / d(mm): rows x, y. By Newton's
/// method, kept on the table.
fn source_of(
    map: &Chebyshev2<FUNCTIONS>,
    half_screen_mm: [f64; 2],
    at_px: DVec2,
) -> ([f64; 2], [[f64; 2]; 2]) {
    let mut at = [0.0; 2];
    let mut slope = [[0.0; 2]; 2];
    for _ in 0..12 {
        let [x, y, _] = map.at(at);
        let [dx, dy] = map.gradient(at);
        slope = [[dx[0], dy[0]], [dx[1], dy[1]]];
        let miss = [at_px.x - x, at_px.y - y];
        let det = slope[0][0] * slope[1][1] - slope[0][1] * slope[1][0];
        let step = [
            (slope[1][1] * miss[0] - slope[0][1] * miss[1]) / det,
            (slope[0][0] * miss[1] - slope[1][0] * miss[0]) / det,
        ];
        at = [0, 1].map(|k| (at[k] + step[k]).clamp(-half_screen_mm[k], half_screen_mm[k]));
    }
    (at, slope)
}

/// Extent of a sub-pixel's shining area on the sensor, px: a box of the same second moments.
fn emission_px(slope: [[f64; 2]; 2], display: &Display) -> [f64; 2] {
    let mm = [0, 1].map(|k| display.emission_px[k] * display.pitch_mm[k]);
    slope.map(|row| (row[0] * mm[0]).hypot(row[1] * mm[1]))
}

impl Phases {
    fn of(kernel: &Kernel) -> Self {
        let side = kernel.grid.side();
        let plane = 2 * kernel.grid.half_px + 1;
        let peak = kernel.values.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
        let largest = f32::from(u16::MAX);
        let mut roots = vec![0u16; PER_PX * PER_PX * plane * plane];
        for (y, line) in kernel.values.chunks_exact(side).enumerate() {
            for first in 0..PER_PX {
                let phase = (y % PER_PX) * PER_PX + first;
                let start = (phase * plane + y / PER_PX) * plane;
                let samples = line[first..].iter().step_by(PER_PX);
                for (root, value) in roots[start..start + plane].iter_mut().zip(samples) {
                    // The nearest whole number.
                    *root = ((value.max(0.0) / peak).sqrt() * largest + 0.5) as u16;
                }
            }
        }
        Self { roots, scale: peak / (largest * largest) }
    }

    #[inline(always)]
    fn value(&self, root: u16) -> f32 {
        let root = f32::from(root);
        self.scale * root * root
    }

    /// For each r the largest value at a distance of at least r pixels along x or y.
    fn tail(&self, half_px: usize) -> Vec<f32> {
        let plane = 2 * half_px + 1;
        let mut largest = vec![0u16; half_px + 2];
        // Whole pixels from the middle, by a phase along an axis and the sample in it.
        let away: [Vec<usize>; PER_PX] = std::array::from_fn(|phase| {
            (0..plane).map(|at| (PER_PX * at + phase).abs_diff(PER_PX * half_px) / PER_PX).collect()
        });
        for (at, row) in self.roots.chunks_exact(plane).enumerate() {
            let (phase, j) = (at / plane, at % plane);
            let y = away[phase / PER_PX][j];
            for (&root, &x) in row.iter().zip(&away[phase % PER_PX]) {
                let largest = &mut largest[x.max(y)];
                *largest = root.max(*largest);
            }
        }
        let mut tail: Vec<f32> = largest.into_iter().map(|root| self.value(root)).collect();
        for r in (0..tail.len() - 1).rev() {
            tail[r] = tail[r].max(tail[r + 1]);
        }
        tail
    }

    /// The samples at whole pixels from the middle, row by row: 2 half + 1 a side.
    pub(super) fn whole_pixels(&self, plane: usize) -> impl Iterator<Item = f32> {
        self.roots[..plane * plane].iter().map(|&root| self.value(root))
    }
}
