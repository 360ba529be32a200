//! A pixel from the triangles that it sees: fragments and sunlight.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::coverage::{Measure, Part, Square};
use super::frame::Prepared;
use super::places::pixel_turn;
use super::rays::{Blocked, LANES, Packet};
use super::reads::{Edge, Find, Places, Reads};
use super::shade::{Facet, Fragment, Light};
use super::sums::{Reading, layers, light_of};
use super::visibility::{Samples, Setup};
use crate::PLANE_NAMES;

/// Planes at most.
pub(crate) const PLANES: usize = PLANE_NAMES.len();

/// What a pixel shows.
#[derive(Clone, Copy)]
pub(crate) struct Pixel {
    pub planes: [f32; PLANES],
    pub owner: Owner,
    pub light: Sunlit,
    /// Its samples differ much.
    pub uneven: bool,
}

/// What a pixel's samples see.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Owner {
    Sky,
    Body(u32),
    Mixed,
}

/// What is known of a pixel's light; two bits, so that neighbours can be joined.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Sunlit(pub u8);

impl Sunlit {
    pub(crate) const UNSEEN: Self = Self(0);
    pub(crate) const DARK: Self = Self(2);
    pub(crate) const EDGE: Self = Self(3);
}

impl Pixel {
    pub(crate) const SKY: Self =
        Self { planes: [0.0; PLANES], owner: Owner::Sky, light: Sunlit::UNSEEN, uneven: false };

    /// A body's pixel of which no part faces the Sun. (Sky beside it counts as body: it has no light either.)
    pub(crate) fn night(body: u32) -> Self {
        Self { owner: Owner::Body(body), light: Sunlit::DARK, ..Self::SKY }
    }

    /// The same pixel without light.
    pub(crate) fn in_shadow(&self) -> Self {
        let mut out = *self;
        (out.planes[0], out.planes[1], out.planes[10]) = (0.0, 0.0, 1.0);
        out
    }
}

/// A Sun ray that waits for the others.
#[derive(Clone, Copy)]
struct SunRay {
    sample: u32,
    fragment: u32,
    origin: Vec3,
    direction: Vec3,
}

/// Parts of a pixel below this are left out, as a share of its area.
const LEAST_AREA: f32 = 1e-5;
/// Areas that make up a pixel add to 1 within this: triangles in front of each other, or sky, rarely come closer.
const AREA_SLACK: f32 = 1e-3;

/// No fragment, no facet.
const NONE: u32 = u32::MAX;

/// Work space of one thread.
#[derive(Default)]
pub(crate) struct PixelWork {
    /// Of the tile's triangles those that are seen; for each triangle its place among them, or `NONE`.
    facets: Vec<Facet>,
    facet_of: Vec<u32>,
    fragments: Vec<Fragment>,
    /// Of each fragment: see `Fragment::sun_axes`.
    sun_axes: Vec<[Vec3; 2]>,
    /// The fragment of each sample; `NONE` for the sky.
    of_sample: Vec<u32>,
    sums: Vec<([f32; 2], u32, u32)>,
    parts: Vec<Part>,
    /// Of each candidate.
    measured: Vec<Part>,
    rays: Vec<SunRay>,
    /// Of each sample of the pixel: I/F without the texture, and the part of the Sun that is hidden.
    light: Vec<[f32; 2]>,
    reading: Reading,
    /// Of each fragment: its triangle's edge functions within the pixel.
    edges: Vec<[Edge; 3]>,
    /// The fragment of each read; `NONE` for the sky.
    of_read: Vec<u32>,
}

/// Which rays of a packet in a body's axes do not see the Sun: `relief` may be stopped by the body itself, all of
/// `group` by another.
fn stopped(frame: &Prepared<'_>, body: usize, packet: &Packet, group: u32, relief: u32) -> u32 {
    let blocked = |body: usize, rays: &Packet, open: u32| {
        frame.level.run(Blocked { arrays: frame.arrays, body, rays, open })
    };
    let mut stopped = if relief == 0 { 0 } else { blocked(body, packet, relief) };
    for (caster, turn, shift) in &frame.placed[body].casters {
        let open = group & !stopped;
        if open == 0 {
            break;
        }
        stopped |= blocked(*caster, &packet.moved(turn, *shift), open);
    }
    stopped
}

/// Where a pixel's samples lie, and what they belong to.
pub(crate) struct View<'a> {
    pub frame: &'a Prepared<'a>,
    pub setups: &'a [Setup],
    pub samples: &'a Samples,
    /// The tile's reference line of sight.
    pub sight: [f32; 2],
    pub layers: bool,
    /// Points of the Sun's disc that the pixel looks at.
    pub sun_points: &'a [Vec2],
    pub reads: &'a Reads,
    /// Where in the pixel its samples lie.
    pub places: &'a Places,
    /// The pixel's number in the image, its samples, and its square.
    pub pixel: u32,
    pub run: Range<usize>,
    pub square: Square,
}

impl View<'_> {
    /// Turns to a pixel.
    pub(crate) fn turn_to(&mut self, pixel: u32, run: Range<usize>) {
        let first = [self.samples.x[run.start], self.samples.y[run.start]];
        let from_middle = self.places.iter().next().unwrap_or_default();
        let back = self.square.step(from_middle.map(|offset| -offset));
        self.square.middle = [first[0] + back[0], first[1] + back[1]];
        self.pixel = pixel;
        self.run = run;
    }
}

impl PixelWork {
    /// Turns to a tile of `triangles` triangles.
    pub(crate) fn begin(&mut self, triangles: usize) {
        self.facets.clear();
        self.facet_of.clear();
        self.facet_of.resize(triangles, NONE);
    }

    /// Parts a pixel's samples into fragments: sum of their places, number, and the triangle's index + 1.
    fn part(&mut self, view: &View<'_>) {
        self.of_sample.clear();
        self.sums.clear();
        let mut last = 0u32;
        let mut index = NONE;
        for sample in view.run.clone() {
            let seen = view.samples.seen[sample];
            if seen == 0 {
                self.of_sample.push(NONE);
                continue;
            }
            if seen != last {
                last = seen;
                let found = self.sums.iter().position(|&(_, _, number)| number == seen);
                index = found.unwrap_or(self.sums.len()) as u32;
                if found.is_none() {
                    self.sums.push(([0.0; 2], 0, seen));
                }
            }
            let (sum, samples, _) = &mut self.sums[index as usize];
            sum[0] += view.samples.x[sample];
            sum[1] += view.samples.y[sample];
            *samples = samples.wrapping_add(1);
            self.of_sample.push(index);
        }
    }

    /// Measures the areas of all triangles that the pixel may see; whether they make up the pixel. Otherwise some hide
    /// others, or a part of the pixel is sky, or a triangle is not known as a whole.
    fn measure(&mut self, view: &View<'_>, candidates: &[u32]) -> bool {
        view.frame.level.run(Measure {
            square: view.square,
            setups: view.setups,
            candidates,
            parts: &mut self.measured,
        });
        let total: f32 = self.measured.iter().map(|part| part.area).sum();
        (total - 1.0).abs() < AREA_SLACK
    }

    /// The parts of what samples see, and of triangles that no sample sees.
    fn add_measured(&mut self, candidates: &[u32]) {
        let sampled = self.sums.len();
        self.parts.clear();
        self.parts.resize(sampled, Part::default());
        for (&candidate, part) in candidates.iter().zip(&self.measured) {
            let seen = candidate.wrapping_add(1);
            if let Some(at) = self.sums[..sampled].iter().position(|&(_, _, number)| number == seen) {
                self.parts[at] = *part;
            } else if part.area > LEAST_AREA {
                self.parts.push(*part);
                self.sums.push(([0.0; 2], 0, seen));
            }
        }
    }

    /// Shades the fragments, each in its middle: of its area where that was measured, else of its samples.
    fn shade(&mut self, view: &View<'_>, measured: bool) {
        self.fragments.clear();
        let of_samples = 1.0 / view.run.len() as f32;
        for (index, &(sum, samples, seen)) in self.sums.iter().enumerate() {
            let samples = samples as f32;
            let part = measured.then(|| &self.parts[index]);
            let (mut middle, mut share) = (sum.map(|value| value / samples), samples * of_samples);
            if let Some(part) = part.filter(|part| part.area > 0.0) {
                (middle, share) = (part.middle, part.area);
            }
            let number = seen.wrapping_sub(1);
            let (frame, setup) = (view.frame, &view.setups[number as usize]);
            let facet = &mut self.facet_of[number as usize];
            if *facet == NONE {
                *facet = self.facets.len() as u32;
                self.facets.push(Facet::new(frame, setup.triangle));
            }
            let facet = &self.facets[*facet as usize];
            let read_px = view.reads.apart_px;
            let mut fragment = Fragment::new(frame, setup, facet, number, view.sight, middle, share, read_px);
            fragment.area = part.map(|part| part.area);
            self.fragments.push(fragment);
        }
    }

    /// A pixel of the first pass that the triangles that may touch it, `candidates`, make up, none hiding another;
    /// `None` where they do not: such a pixel needs samples.
    pub(crate) fn whole(&mut self, view: &View<'_>, candidates: &[u32]) -> Option<Pixel> {
        if candidates.is_empty() {
            return Some(Pixel::SKY);
        }
        if !self.measure(view, candidates) {
            return None;
        }
        self.sums.clear();
        self.add_measured(candidates);
        self.shade(view, true);
        self.edges.clear();
        let setups = self.fragments.iter().map(|fragment| &view.setups[fragment.number as usize]);
        self.edges.extend(setups.map(|setup| setup.edges.map(|edge| edge.within(&view.square))));
        Some(self.shaded(view, true))
    }

    /// A pixel of the first pass by its samples.
    pub(crate) fn sampled(&mut self, view: &View<'_>) -> Pixel {
        self.part(view);
        if self.sums.is_empty() {
            return Pixel::SKY;
        }
        self.shade(view, false);
        self.shaded(view, false)
    }

    /// A pixel of the first pass whose fragments are there: shaded as if nothing stood before the Sun, with a packet of
    /// rays where it may.
    fn shaded(&mut self, view: &View<'_>, whole: bool) -> Pixel {
        let body = self.fragments[0].body;
        let sky = !whole && self.of_sample.contains(&NONE);
        let owner = if sky || self.fragments.iter().any(|fragment| fragment.body != body) {
            Owner::Mixed
        } else {
            Owner::Body(body)
        };
        let doubt = self.fragments.iter().any(|fragment| matches!(fragment.light, Light::Doubt { .. }));
        let away = self.fragments.iter().any(|fragment| fragment.light == Light::Away);
        let free = self.fragments.iter().any(|fragment| fragment.light == Light::Free);
        let mut light = Sunlit(u8::from(free) | u8::from(away && !free && !doubt) << 1);
        // A pixel on an edge is sampled anew in any case, and so is one of which a ray sees no Sun, unless it lies in
        // shadow as a whole.
        let mut again = owner == Owner::Mixed;
        if doubt && !again {
            if whole {
                find(view, view.places, &self.edges, &mut self.of_sample);
            }
            let probed = self.probe(view);
            again = probed.0 & Sunlit::DARK.0 != 0;
            light = Sunlit(light.0 | probed.0);
        }
        let mut planes = [0.0f32; PLANES];
        if !again && self.fragments.iter().any(|fragment| fragment.value > 0.0) {
            if whole {
                find(view, &view.reads.places, &self.edges, &mut self.of_read);
            } else {
                self.read_as_samples(view);
            }
            let fragments = &self.fragments;
            let seen = self
                .of_read
                .iter()
                .map(|&index| (index, fragments.get(index as usize).map_or(0.0, |fragment| fragment.value)));
            [planes[0], planes[1]] = light_of(view, fragments, &mut self.reading, seen);
        }
        if view.layers {
            let hidden = self.fragments.iter().filter(|fragment| fragment.light == Light::Away);
            let hidden = hidden.map(|fragment| fragment.share).sum();
            layers(view, &self.fragments, whole, hidden, &mut planes);
        }
        let values = self.fragments.iter().map(|fragment| fragment.value);
        let (least, most) = values.fold((f32::INFINITY, 0.0f32), |(a, b), v| (a.min(v), b.max(v)));
        let uneven = !whole && most - least > view.frame.placed[body as usize].contrast;
        Pixel { planes, owner, light, uneven }
    }

    /// Each read sees what the nearest sample sees.
    fn read_as_samples(&mut self, view: &View<'_>) {
        let nearest = view.reads.nearest.iter();
        self.of_read.clear();
        self.of_read.extend(nearest.map(|&sample| self.of_sample[sample as usize]));
    }

    /// Rays from samples spread over the pixel to points spread over the Sun. Only samples in doubt count: the others
    /// are as well known as a sample can be.
    fn probe(&mut self, view: &View<'_>) -> Sunlit {
        let count = view.run.len() as u32;
        let turn = pixel_turn(view.pixel);
        let points = view.sun_points;
        self.find_sun_axes(view);
        let step = (count / points.len() as u32).max(1);
        self.rays.clear();
        self.light.clear();
        self.light.resize(count as usize, [0.0; 2]);
        let mut below = 0;
        for (&point, sample) in points.iter().zip((0..count).step_by(step as usize)) {
            let fragment = self.fragments.get(self.of_sample[sample as usize] as usize);
            if fragment.is_some_and(|fragment| matches!(fragment.light, Light::Doubt { .. })) {
                below += usize::from(!self.aim(view, sample, turn.rotate(point)));
            }
        }
        let hidden = self.trace(view);
        Sunlit(u8::from(hidden < self.rays.len()) | u8::from(hidden + below > 0) << 1)
    }

    fn find_sun_axes(&mut self, view: &View<'_>) {
        let axes = |fragment: &Fragment| fragment.sun_axes(&view.frame.placed[fragment.body as usize]);
        self.sun_axes.clear();
        self.sun_axes.extend(self.fragments.iter().map(axes));
    }

    /// Shades a sample that looks at a point of the Sun's disc, and has a ray wait to be traced; `false` where the point
    /// lies below the horizon.
    fn aim(&mut self, view: &View<'_>, sample: u32, place: Vec2) -> bool {
        let index = self.of_sample[sample as usize];
        let Some(fragment) = self.fragments.get(index as usize) else { return false };
        let placed = &view.frame.placed[fragment.body as usize];
        let [side, up] = self.sun_axes[index as usize];
        let direction = (fragment.sun + side * place.x + up * place.y).normalize();
        let mu0 = fragment.normal.dot(direction);
        if mu0 <= 0.0 || fragment.geometric.dot(direction) <= 0.0 {
            self.light[sample as usize] = [0.0, 1.0];
            return false;
        }
        self.light[sample as usize] = [fragment.radiance_factor(placed, mu0), 0.0];
        let number = fragment.number as usize;
        let at = view.run.start + sample as usize;
        let (weights, _) = view.setups[number].weights_and_depth(view.samples.x[at], view.samples.y[at]);
        let point = self.facets[self.facet_of[number] as usize].point(weights);
        let origin = point + fragment.geometric * placed.ray_offset_m;
        self.rays.push(SunRay { sample, fragment: index, origin, direction });
        true
    }

    /// Traces the rays that wait, takes the light from samples that do not see the Sun, and counts them.
    fn trace(&mut self, view: &View<'_>) -> usize {
        let mut hidden = 0;
        for start in (0..self.rays.len()).step_by(LANES) {
            let rays = &self.rays[start..(start + LANES).min(self.rays.len())];
            let mut waiting = (1u32 << rays.len()) - 1;
            // A packet holds rays of one body; a pixel rarely sees two.
            while waiting != 0 {
                let first = waiting.trailing_zeros() as usize;
                let body = self.fragments[rays[first].fragment as usize].body;
                let (mut group, mut relief) = (0u32, 0u32);
                for (k, ray) in rays.iter().enumerate() {
                    let fragment = &self.fragments[ray.fragment as usize];
                    if fragment.body == body {
                        group |= 1 << k;
                        relief |= u32::from(fragment.light == Light::Doubt { own_relief: true }) << k;
                    }
                }
                let mut packet = Packet::default();
                for k in 0..LANES {
                    let ray = &rays[if group >> k & 1 == 1 { k } else { first }];
                    packet.set(k, ray.origin, ray.direction);
                }
                let stopped = stopped(view.frame, body as usize, &packet, group, relief);
                for (k, ray) in rays.iter().enumerate() {
                    if stopped >> k & 1 == 1 {
                        self.light[ray.sample as usize] = [0.0, 1.0];
                        hidden += 1;
                    }
                }
                waiting &= !group;
            }
        }
        hidden
    }

    /// A pixel sampled anew: each sample looks at its own point of the Sun.
    /// `candidates` are the triangles that may touch it.
    pub(crate) fn refined(&mut self, view: &View<'_>, candidates: &[u32]) -> [f32; PLANES] {
        let count = view.run.len() as u32;
        self.part(view);
        let measured = !self.of_sample.contains(&NONE) && self.measure(view, candidates);
        if measured {
            self.add_measured(candidates);
        }
        self.shade(view, measured);
        self.light.clear();
        self.light.resize(count as usize, [0.0; 2]);
        self.rays.clear();
        let turn = pixel_turn(view.pixel);
        self.find_sun_axes(view);
        for sample in 0..count {
            let Some(fragment) = self.fragments.get(self.of_sample[sample as usize] as usize) else {
                continue;
            };
            match fragment.light {
                Light::Free => self.light[sample as usize] = [fragment.value, 0.0],
                Light::Away => self.light[sample as usize] = [0.0, 1.0],
                // One point of the Sun's disc a sample, from all over the disc for neighbouring samples.
                Light::Doubt { .. } => {
                    let point = sample.wrapping_mul(37) & (count - 1);
                    self.aim(view, sample, turn.rotate(view.sun_points[point as usize]));
                }
            }
        }
        self.trace(view);
        let mut planes = [0.0f32; PLANES];
        if self.light.iter().any(|&[value, _]| value > 0.0) {
            self.read_as_samples(view);
            let nearest = view.reads.nearest.iter();
            let light = nearest.map(|&sample| self.light[sample as usize][0]);
            let seen = self.of_read.iter().copied().zip(light);
            [planes[0], planes[1]] = light_of(view, &self.fragments, &mut self.reading, seen);
        }
        if view.layers {
            let hidden = self.light.iter().map(|&[_, hidden]| hidden).sum::<f32>() / count as f32;
            layers(view, &self.fragments, measured, hidden, &mut planes);
        }
        planes
    }
}

/// The fragment that each of some places in a pixel sees, by the edge functions of all of them.
fn find(view: &View<'_>, places: &Places, triangles: &[[Edge; 3]], found: &mut Vec<u32>) {
    found.clear();
    // A place in no triangle, by rounding, is taken for one in the first.
    found.resize(places.count(), 0);
    view.frame.level.run(Find { places, triangles, found });
}
