//! Many rays at once: structure of arrays, blocks that stay in the first-level cache, and vector
//! code chosen at run time.

use retina_simd::{Kernel, Level};

use super::compile::{
    Action, Element, ElementShape, Step, Tracer, Turned, meet_figure, meet_ideal, settle, turn,
};
use super::step::{Asphere, Conic, Figure, Hit, Plane, Sphere, State};
use super::{Ray, RayFailure};

/// Rays a block: eight arrays of this length take 8 kB, a quarter of a first-level cache.
const BLOCK: usize = 128;

const ALIVE: u64 = 0;
const MISSED: u64 = 1;
const VIGNETTED: u64 = 2;
const REFLECTED: u64 = 3;

/// Rays as a structure of arrays. Before the trace: positions (mm) and direction cosines in the
/// system's frame. After it: in the image surface's own axes; rays that failed hold no meaning
/// there (see [`RayBatch::failure`]).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RayBatch {
    /// x, mm.
    pub x_mm: Vec<f64>,
    /// y, mm.
    pub y_mm: Vec<f64>,
    /// z, mm.
    pub z_mm: Vec<f64>,
    /// Direction cosine along x.
    pub l: Vec<f64>,
    /// Direction cosine along y.
    pub m: Vec<f64>,
    /// Direction cosine along z.
    pub n: Vec<f64>,
    /// Optical path, mm.
    pub path_mm: Vec<f64>,
    status: Vec<u64>,
}

impl RayBatch {
    /// No rays, room for `count`.
    pub fn with_capacity(count: usize) -> Self {
        let room = || Vec::with_capacity(count);
        Self {
            x_mm: room(),
            y_mm: room(),
            z_mm: room(),
            l: room(),
            m: room(),
            n: room(),
            path_mm: room(),
            status: Vec::with_capacity(count),
        }
    }

    /// Appends a ray.
    pub fn push(&mut self, ray: &Ray) {
        self.x_mm.push(ray.position_mm.x);
        self.y_mm.push(ray.position_mm.y);
        self.z_mm.push(ray.position_mm.z);
        self.l.push(ray.direction.x);
        self.m.push(ray.direction.y);
        self.n.push(ray.direction.z);
        self.path_mm.push(ray.path_mm);
        self.status.push(ALIVE);
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.status.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.status.is_empty()
    }

    /// Whether ray `i` arrived.
    pub fn arrived(&self, i: usize) -> bool {
        self.status[i] == ALIVE
    }

    /// Why ray `i` did not arrive; `None` if it did.
    pub fn failure(&self, i: usize) -> Option<RayFailure> {
        let surface = (self.status[i] >> 8) as usize;
        match self.status[i] & 0xff {
            ALIVE => None,
            MISSED => Some(RayFailure::Missed { surface }),
            VIGNETTED => Some(RayFailure::Vignetted { surface }),
            _ => Some(RayFailure::TotalReflection { surface }),
        }
    }
}

impl FromIterator<Ray> for RayBatch {
    fn from_iter<I: IntoIterator<Item = Ray>>(rays: I) -> Self {
        let rays = rays.into_iter();
        let mut batch = Self::with_capacity(rays.size_hint().0);
        rays.for_each(|ray| batch.push(&ray));
        batch
    }
}

impl Tracer {
    /// Traces a batch to the image with the widest vector instructions there are.
    pub fn trace_batch(&self, rays: &mut RayBatch) {
        self.trace_batch_with(rays, Level::detect());
    }

    /// As [`Tracer::trace_batch`], with stated vector instructions. Results do not depend on them.
    pub fn trace_batch_with(&self, rays: &mut RayBatch, level: Level) {
        let mut start = 0;
        while start < rays.len() {
            let end = (start + BLOCK).min(rays.len());
            let mut block = Block {
                x: &mut rays.x_mm[start..end],
                y: &mut rays.y_mm[start..end],
                z: &mut rays.z_mm[start..end],
                l: &mut rays.l[start..end],
                m: &mut rays.m[start..end],
                n: &mut rays.n[start..end],
                path: &mut rays.path_mm[start..end],
                status: &mut rays.status[start..end],
            };
            level.run(Trace { elements: &self.elements, block: &mut block });
            start = end;
        }
    }

    /// The number of surfaces a ray meets, image included.
    pub fn surface_count(&self) -> usize {
        self.elements.len()
    }
}

struct Block<'a> {
    x: &'a mut [f64],
    y: &'a mut [f64],
    z: &'a mut [f64],
    l: &'a mut [f64],
    m: &'a mut [f64],
    n: &'a mut [f64],
    path: &'a mut [f64],
    status: &'a mut [u64],
}

/// A block through all elements.
struct Trace<'a, 'b> {
    elements: &'a [Element],
    block: &'a mut Block<'b>,
}

impl Kernel for Trace<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        run(self.elements, self.block);
    }
}

/// Surfaces outside, rays inside.
#[inline(always)]
fn run(elements: &[Element], block: &mut Block<'_>) {
    for element in elements {
        let dz = match &element.step {
            Step::Axial(dz) => *dz,
            Step::Full(r, t) => {
                each(block, |s| {
                    turn(r, t, s);
                    ALIVE
                });
                0.0
            }
        };
        match element.shape {
            ElementShape::Plane => surface(Plane, element, dz, block),
            ElementShape::Sphere(c) => surface(Sphere { c }, element, dz, block),
            ElementShape::Conic { c, k } => surface(Conic { c, k }, element, dz, block),
            ElementShape::Asphere { c, k, terms } => surface(Asphere { c, k, terms }, element, dz, block),
            ElementShape::IdealLens(p) => each(block, |s| {
                s.z += dz;
                finish(element, s, meet_ideal(p, s))
            }),
        }
    }
}

#[inline(always)]
fn surface<F: Figure>(figure: F, element: &Element, dz: f64, block: &mut Block<'_>) {
    let mu = element.mu;
    // One loop for each action, so that none is chosen inside.
    match element.action {
        Action::Pass => each(block, |s| {
            s.z += dz;
            finish(element, s, meet_figure(figure, Action::Pass, mu, s))
        }),
        Action::Refract => each(block, |s| {
            s.z += dz;
            finish(element, s, meet_figure(figure, Action::Refract, mu, s))
        }),
        Action::Reflect => each(block, |s| {
            s.z += dz;
            finish(element, s, meet_figure(figure, Action::Reflect, mu, s))
        }),
    }
}

/// Moves and turns the ray, and says what happened: the first of missed, vignetted, reflected.
#[inline(always)]
fn finish(element: &Element, s: &mut State, (hit, turned): (Hit, Turned)) -> u64 {
    let surface = (element.surface as u64) << 8;
    let r2 = hit.at[0] * hit.at[0] + hit.at[1] * hit.at[1];
    let mut status = ALIVE;
    status = if turned.passes { status } else { REFLECTED | surface };
    status =
        if (r2 <= element.outer2_mm2) & (r2 >= element.inner2_mm2) { status } else { VIGNETTED | surface };
    status = if hit.met { status } else { MISSED | surface };
    settle(s, &hit, &turned, element.n_before);
    status
}

/// Applies `step` to every ray of a block; a ray keeps its first failure.
#[inline(always)]
fn each(block: &mut Block<'_>, step: impl Fn(&mut State) -> u64) {
    let count = block.status.len();
    // Equal lengths, told to the compiler once, so that the loop has no bounds checks.
    let (x, y, z) = (&mut block.x[..count], &mut block.y[..count], &mut block.z[..count]);
    let (l, m, n) = (&mut block.l[..count], &mut block.m[..count], &mut block.n[..count]);
    let (path, status) = (&mut block.path[..count], &mut block.status[..count]);
    for i in 0..count {
        let mut s = State { x: x[i], y: y[i], z: z[i], l: l[i], m: m[i], n: n[i], path: path[i] };
        let now = step(&mut s);
        status[i] = if status[i] == ALIVE { now } else { status[i] };
        (x[i], y[i], z[i]) = (s.x, s.y, s.z);
        (l[i], m[i], n[i]) = (s.l, s.m, s.n);
        path[i] = s.path;
    }
}
