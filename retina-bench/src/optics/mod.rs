//! From the screen to the sensor: where a sub-pixel's light lands, how much of it, and how it is spread.
//!
//! For each channel, position on the sensor and relative light are tabulated over the display through the centroid of the
//! traced wavefront. A spot's place is where a detector's window finds it: an offset from the centroid ([`windowed`]). The
//! image's shape is computed at nodes over the sensor ([`Kernels`]) and blended between them. Kernels are centred on the
//! same place, so that shapes that are blended have their cores on one another.

mod dense;
mod kernels;
mod patches;
mod place;
mod scene;
mod sparse;
mod spot_tracer;
mod stray;
mod windowed;

use glam::DVec2;
use once_cell::race::OnceBox;
use rayon::prelude::*;
use retina_geometry::Setup;
use retina_optics::OpticalSystem;
use retina_optics::facility::{
    COMA, Chebyshev2, Imaging, ImagingOptions, SpectralLine, TILT, WAVEFRONT_TERMS, tangents,
};
use retina_radiometry::QuantumEfficiency;

pub use place::{CameraPose, ExposurePose, facility_system};
pub use scene::SceneLight;
pub(crate) use scene::Shown;
pub use spot_tracer::SpotTracer;

use crate::buffers::Buffers;
use crate::imperfections::Objective;
use crate::{BenchError, Display, Imperfections};
use dense::Dense;
use kernels::{Kernels, Shapes};
pub(crate) use patches::Patches;
use stray::Ghosts;
pub(crate) use stray::Stray;
use windowed::{Offsets, Sampling};

/// Light that lands on the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Source {
    /// Where a detector's window finds it, camera pixels.
    pub at_px: DVec2,
    /// 0 red, 1 green, 2 blue.
    pub channel: usize,
    /// Electrons that the whole image makes, nothing cut.
    pub electrons: f64,
}

/// A screen image's light where it lands on the sensor.
pub enum Landed {
    /// Few sub-pixels, each on its own.
    Points(Vec<Source>),
    /// So many that their light is laid on the grid of camera pixels.
    Scene(SceneLight),
}

impl Landed {
    /// Electrons in all.
    fn total_e(&self) -> f64 {
        match self {
            Self::Points(sources) => sources.iter().map(|source| source.electrons).sum(),
            Self::Scene(light) => light.total_e,
        }
    }
}

/// How finely the bench's optics are tabulated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpticsDetail {
    /// Kernel nodes along x and y of the sensor.
    pub nodes: [usize; 2],
    /// Lines that stand for a channel's spectrum, 1, 3 or 5.
    pub lines: usize,
    /// Kernels reach this far, pixels.
    pub half_px: usize,
}

/// What of the image of a point is modelled: to see what each part adds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PointImage {
    /// A point stays one: the sub-pixel's area and the camera's pixel alone spread it.
    Point,
    /// The pupil's diffraction, as if the wavefront had no aberrations.
    Diffraction,
    /// Diffraction and aberrations.
    #[default]
    Full,
}

impl Default for OpticsDetail {
    /// 19 x 13 nodes, 3 lines a channel, 24 pixels. With 13 x 9 nodes centroids by a window were within 0.014 px rms an axis
    /// of those with 49 x 33 nodes, and this was seen in campaigns.
    fn default() -> Self {
        Self { nodes: [19, 13], lines: 3, half_px: 24 }
    }
}

/// Functions tabulated over the display: x and y of the centroid on the sensor (px), relative light.
const FUNCTIONS: usize = 3;

/// Spacing of the grid from which positions of full scenes are interpolated, screen pixels: straight lines
/// between its points are off by 0.001 px at most where distortion is 2 %.
const MAP_STEP_PX: usize = 8;

/// The optics of a bench.
pub struct BenchOptics {
    imaging: Imaging,
    camera: CameraPose,
    half_screen_mm: [f64; 2],
    maps: Vec<Chebyshev2<FUNCTIONS>>,
    offsets: [Offsets; 3],
    kernels: Kernels,
    dense: OnceBox<Dense>,
    ghosts: Ghosts,
    /// Positions and light of full scenes: channel, row, column; `None` off the tabulated field.
    grid: [usize; 2],
    map_grid: Vec<Vec<[f32; FUNCTIONS]>>,
    size_px: [usize; 2],
}

/// Spectral lines of the three channels, shares by the electrons they make: Gaussian lines of the setup's
/// widths, by Gauss-Hermite quadrature, times the sensor's efficiency.
pub fn channel_lines(setup: &Setup, efficiency: &QuantumEfficiency, count: usize) -> [Vec<SpectralLine>; 3] {
    // Abramowitz & Stegun, table 25.10, scaled to a standard normal distribution.
    let nodes: &[(f64, f64)] = match count {
        1 => &[(0.0, 1.0)],
        3 => &[(-1.732_050_807_568_877, 1.0 / 6.0), (0.0, 2.0 / 3.0), (1.732_050_807_568_877, 1.0 / 6.0)],
        _ => &[
            (-2.856_970_013_872_806, 0.011_257_411_327_720_69),
            (-1.355_626_179_974_266, 0.222_075_922_005_612_6),
            (0.0, 0.533_333_333_333_333_3),
            (1.355_626_179_974_266, 0.222_075_922_005_612_6),
            (2.856_970_013_872_806, 0.011_257_411_327_720_69),
        ],
    };
    let wavelength = &setup.screen.wavelength_nm;
    let centres = [wavelength.r, wavelength.g, wavelength.b];
    std::array::from_fn(|c| {
        // FWHM = 2 sqrt(2 ln 2) sigma.
        let sigma = setup.optics.linewidth_nm[c] / 2.354_820_045_030_949;
        let lines: Vec<SpectralLine> = nodes
            .iter()
            .map(|(z, weight)| {
                let nm = centres[c] + z * sigma;
                (nm, weight * efficiency.relative(nm))
            })
            .collect();
        let sum: f64 = lines.iter().map(|line| line.1).sum();
        lines.into_iter().map(|(nm, weight)| (nm, weight / sum)).collect()
    })
}

/// The line in the middle of a channel's, nm.
fn middle_line(lines: &[SpectralLine]) -> f64 {
    lines[lines.len() / 2].0
}

/// What the objective adds to the wavefront of a direction (tangents) at a wavelength, mm.
fn added(objective: &Objective, at: [f64; 2], nm: f64, radius_mm: f64) -> [f64; WAVEFRONT_TERMS] {
    let mut terms = [0.0; WAVEFRONT_TERMS];
    let colour = (nm - 544.0) / (605.0 - 475.0);
    for k in 0..2 {
        terms[COMA[k]] = objective.coma_mm * at[k] + objective.coma_offset_mm[k];
        // Small against the field: tangents and cosines differ by a few percent of it.
        terms[TILT[k]] = (objective.lateral_colour * at[k] + objective.wedge_rad[k]) * colour * radius_mm;
    }
    terms
}

impl BenchOptics {
    /// Traces and tabulates a system for a display and a camera.
    ///
    /// # Errors
    /// Rays that do not arrive; a kernel that cannot be sampled.
    pub fn new(
        system: &OpticalSystem,
        setup: &Setup,
        display: &Display,
        wrong: &Imperfections,
        lines: &[Vec<SpectralLine>; 3],
        detail: OpticsDetail,
        point_image: PointImage,
    ) -> Result<Self, BenchError> {
        let camera = CameraPose::new(setup, wrong);
        let half_screen_mm = place::half_screen_mm(system, setup, &camera)?;
        // The display's own points: its sag and tilt are distances from the image surface.
        let corners = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];
        let deepest = corners
            .map(|[x, y]| wrong.screen.place([x * half_screen_mm[0], y * half_screen_mm[1]])[2].abs())
            .into_iter()
            .fold(0.0, f64::max);
        let reach = [0, 1].map(|k| {
            let far = corners
                .map(|[x, y]| wrong.screen.place([x * half_screen_mm[0], y * half_screen_mm[1]])[k].abs());
            far.into_iter().fold(half_screen_mm[k], f64::max)
        });
        let extremes = lines.iter().flatten().map(|line| line.0);
        let (low, high) = extremes.fold((f64::MAX, f64::MIN), |(low, high), nm| (low.min(nm), high.max(nm)));
        let options = ImagingOptions {
            defocus_mm: deepest * 1.01,
            wavelengths_nm: [low - 1.0, high + 1.0],
            ..ImagingOptions::new(reach)
        };
        let imaging = Imaging::new(system, options)?;
        let seen = |[x, y, z]: [f64; 3], nm: f64| {
            let wavefront = imaging.wavefront([x, y], nm, z);
            let terms =
                added(&wrong.objective, wavefront.reference_tangents(), nm, wavefront.pupil_radius_mm);
            wavefront.plus(&terms)
        };
        let centroid = |at_mm: [f64; 2], lines: &[SpectralLine]| {
            let [x, y, z] = wrong.screen.place(at_mm);
            let mut sum = [0.0; 2];
            for &(nm, weight) in lines {
                let at = tangents(seen([x, y, z], nm).centroid());
                sum = [0, 1].map(|k| sum[k] + weight * at[k]);
            }
            sum
        };
        let sampling = Sampling::new(camera.pinhole.fx_px);
        // Solid angle of the display's element, projected on the pupil: d2t cos^4.
        let light = |at_mm: [f64; 2], lines: &[SpectralLine]| {
            let h = 0.01;
            let of = |dx: f64, dy: f64| centroid([at_mm[0] + dx, at_mm[1] + dy], lines);
            let (x, y) = ([of(-h, 0.0), of(h, 0.0)], [of(0.0, -h), of(0.0, h)]);
            let slope = |pair: [[f64; 2]; 2], k: usize| (pair[1][k] - pair[0][k]) / (2.0 * h);
            let det = slope(x, 0) * slope(y, 1) - slope(x, 1) * slope(y, 0);
            let [tx, ty] = of(0.0, 0.0);
            det.abs() / (1.0 + tx * tx + ty * ty).powi(2)
        };
        let maps = lines
            .par_iter()
            .map(|lines| {
                let on_axis = light([0.0; 2], lines);
                // One step inside, so that differences stay on the table.
                let inside = |at: [f64; 2]| [0, 1].map(|k| at[k] * (1.0 - 0.011 / half_screen_mm[k]));
                Chebyshev2::new(half_screen_mm, 12, |at| {
                    let px = camera.pixel(centroid(at, lines));
                    Ok::<_, BenchError>([px.x, px.y, light(inside(at), lines) / on_axis])
                })
            })
            .collect::<Result<Vec<_>, _>>()?;
        let offsets = lines.each_ref().map(|lines| {
            Offsets::new(half_screen_mm, |at| {
                let (nm, place) = (middle_line(lines), wrong.screen.place(at));
                let wavefront = seen(place, nm);
                let found = camera.pixel(sampling.middle(nm, &wavefront));
                found - camera.pixel(tangents(wavefront.centroid()))
            })
        });
        let size_px = [setup.camera.width_px as usize, setup.camera.height_px as usize];
        let shapes = Shapes { imaging: &imaging, wrong, point_image, sampling: &sampling };
        let kernels = Kernels::new(shapes, &maps, half_screen_mm, &camera, display, lines, detail, size_px)?;
        let ghosts = Ghosts::new(system, setup, kernels.beyond())?;
        let mut optics = Self {
            imaging,
            camera,
            half_screen_mm,
            maps,
            offsets,
            kernels,
            dense: OnceBox::new(),
            ghosts,
            grid: display.size_px.map(|size| (size as usize).div_ceil(MAP_STEP_PX) + 1),
            map_grid: Vec::new(),
            size_px,
        };
        optics.map_grid = (0..3).map(|channel| optics.grid_of(channel, display)).collect();
        Ok(optics)
    }

    fn grid_of(&self, channel: usize, display: &Display) -> Vec<[f32; FUNCTIONS]> {
        (0..self.grid[0] * self.grid[1])
            .into_par_iter()
            .map(|i| {
                let at = [i % self.grid[0], i / self.grid[0]].map(|k| (k * MAP_STEP_PX) as f64);
                let landed = self.land(display.mm([at[0], at[1]]), channel);
                landed.map_or([f32::NAN; FUNCTIONS], |(at_px, light)| {
                    [at_px.x as f32, at_px.y as f32, light as f32]
                })
            })
            .collect()
    }

    fn contains(&self, at_mm: [f64; 2]) -> bool {
        (0..2).all(|k| at_mm[k].abs() <= self.half_screen_mm[k])
    }

    /// Where a point of the display (mm from its centre) is found on the sensor, px, by a Gaussian window as wide as its
    /// image, and its light relative to the centre's; `None` far off the field. Before anything that belongs to an
    /// exposure.
    pub fn land(&self, at_mm: [f64; 2], channel: usize) -> Option<(DVec2, f64)> {
        if !self.contains(at_mm) {
            return None;
        }
        let [x, y, light] = self.maps[channel].at(at_mm);
        Some((DVec2::new(x, y) + self.offsets[channel].at(at_mm), light))
    }

    /// The largest share of a sub-pixel's light that one pixel receives, where the optics are sharpest.
    pub fn sharpest_share(&self) -> f64 {
        f64::from(self.kernels.largest())
    }

    /// The camera as it stands.
    pub fn camera(&self) -> &CameraPose {
        &self.camera
    }

    /// The tables behind the kernels.
    pub fn imaging(&self) -> &Imaging {
        &self.imaging
    }

    /// Adds the images of sources one by one to an image of electrons: for points.
    pub fn add_points(&self, image: &mut [f32], sources: &[Source]) {
        sparse::add(image, self.size_px, &self.kernels, sources);
    }

    /// The image of a scene, by Fourier transforms.
    pub(crate) fn tiles(&self, light: &SceneLight, buffers: &Buffers) -> Patches {
        let dense = self.dense.get_or_init(|| Box::new(Dense::new(&self.kernels, self.size_px)));
        dense.image(&self.kernels, light, buffers)
    }

    /// The images of sources one by one; `None` where they are so many that [`BenchOptics::add_points`] suits them
    /// better.
    pub(crate) fn spots(&self, sources: &[Source]) -> Option<Patches> {
        sparse::spots(self.size_px[1], &self.kernels, sources)
    }

    /// Ghosts and veiling glare of a screen image.
    pub(crate) fn stray(&self, landed: &Landed) -> Stray {
        self.ghosts.of(self.size_px, &self.camera, landed)
    }

    /// Lays all light of a screen image on the grid of camera pixels, as a pose of one exposure sees it.
    pub(crate) fn scene(&self, shown: Shown<'_>, pose: &ExposurePose, buffers: &Buffers) -> SceneLight {
        SceneLight::lay(self, shown, pose, buffers)
    }

    /// Sources of lit sub-pixels as a pose of one exposure sees them; `full_electrons`: what a sub-pixel at
    /// count 255 on the axis makes, by channel. Those whose light misses the sensor are left out.
    pub fn sources(
        &self,
        display: &Display,
        lit: &[crate::display::SubPixel],
        pose: &ExposurePose,
        full_electrons: [f64; 3],
    ) -> Vec<Source> {
        let margin = self.kernels.half_px() as f64;
        let moved = pose.map(&self.camera);
        lit.par_iter()
            .with_min_len(1024)
            .filter_map(|sub| {
                let (at_px, light) = self.land(display.mm(sub.at_px), sub.channel)?;
                let at_px = moved.transform_point2(at_px);
                let [w, h] = self.size_px.map(|size| size as f64 + margin);
                let lands = at_px.x > -margin && at_px.y > -margin && at_px.x < w && at_px.y < h;
                lands.then_some(Source {
                    at_px,
                    channel: sub.channel,
                    electrons: sub.light * light * full_electrons[sub.channel],
                })
            })
            .collect()
    }
}
