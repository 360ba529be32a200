//! Where the brightest pixel of a sequence is to be looked for: images of the bodies' triangles
//! thrown onto the pixels, without visibility or shadow, in place of rendered ones.

use std::collections::BTreeSet;

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use retina_files::InputError;
use retina_model::Body;
use retina_radiometry::{Geometry, sun_irradiance_w_m2_nm};

use crate::checks::Field;
use crate::{Scene, SceneFrame};

/// Triangles looked at on each body in a first pass over all frames.
const PROBES: usize = 1500;
/// Frames looked at with all triangles: this many spread evenly,
const SPREAD: usize = 32;
/// and this many of the first pass' best.
const BEST: usize = 8;

/// A triangle, its centre standing for the whole.
#[derive(Debug, Clone, Copy)]
struct Facet {
    position_m: Vec3,
    /// The normal that the light meets.
    normal: Vec3,
    /// The triangle's area along its own normal, square metres.
    area_m2: Vec3,
    /// Factor of the albedo map, mean 1 over the body.
    albedo: f32,
}

fn facets(shape: &Body) -> Vec<Facet> {
    (0..shape.triangles.len())
        .into_par_iter()
        .map(|triangle| {
            let [a, b, c] = shape.triangles[triangle].map(|v| &shape.vertices[v as usize]);
            let surface = &shape.surfaces[usize::from(shape.triangle_surface[triangle])];
            let texel = surface
                .albedo_map
                .map_or(1.0, |map| shape.albedo_maps[map].sample((a.uv + b.uv + c.uv) / 3.0));
            let area_m2 = (0.5 * (b.position_m - a.position_m).cross(c.position_m - a.position_m)).as_vec3();
            let normal = if surface.flat { area_m2 } else { a.normal + b.normal + c.normal };
            Facet {
                position_m: ((a.position_m + b.position_m + c.position_m) / 3.0).as_vec3(),
                normal: normal.normalize_or_zero(),
                area_m2,
                albedo: texel * surface.albedo_factor,
            }
        })
        .collect()
}

/// The brightest facet of each stretch of neighbouring ones: bright spots are what matters.
fn probes(facets: &[Facet]) -> Vec<Facet> {
    let stretch = facets.len().div_ceil(PROBES).max(1);
    facets
        .chunks(stretch)
        .filter_map(|few| few.iter().max_by(|a, b| a.albedo.total_cmp(&b.albedo)))
        .copied()
        .collect()
}

impl Scene {
    /// The `count` frames in which the brightest pixel of the whole sequence is to be expected,
    /// best first; fewer where fewer show a lit surface. They depend on the scene alone. To be
    /// asked before [`Scene::take_models`].
    ///
    /// # Errors
    /// As [`Scene::frame`].
    pub fn brightest_frames(&self, count: usize) -> Result<Vec<usize>, InputError> {
        let look = Look { scene: self, field: Field::of(self) };
        let facets: Vec<Vec<Facet>> = self.models.iter().map(|model| facets(&model.shape)).collect();
        let probes: Vec<Vec<Facet>> = facets.iter().map(|facets| probes(facets)).collect();
        let frames = self.frame_count();
        let first = look.ranked((0..frames).collect(), |frame| look.brightest_probe(frame, &probes))?;
        // Neighbours look alike: the best of the first pass are taken apart from each other.
        let apart = frames / (4 * SPREAD);
        let mut chosen = BTreeSet::from_iter(spread_out(&first, BEST, apart));
        chosen.extend((0..SPREAD.min(frames)).map(|k| k * frames / SPREAD.min(frames)));
        let second =
            look.ranked(chosen.into_iter().collect(), |frame| look.brightest_pixel(frame, &facets))?;
        Ok(spread_out(&second, count, 0))
    }
}

/// The first `count` of a ranking, no two of them `apart` frames or less from each other.
fn spread_out(ranking: &[usize], count: usize, apart: usize) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    for &index in ranking {
        if chosen.len() < count && chosen.iter().all(|other| other.abs_diff(index) > apart) {
            chosen.push(index);
        }
    }
    chosen
}

struct Look<'a> {
    scene: &'a Scene,
    field: Field,
}

impl Look<'_> {
    /// Frames by falling value, those of value 0 left out.
    fn ranked(
        &self,
        frames: Vec<usize>,
        value: impl Fn(&SceneFrame) -> f64 + Sync,
    ) -> Result<Vec<usize>, InputError> {
        let mut values: Vec<(f64, usize)> = frames
            .into_par_iter()
            .map(|index| Ok((value(&self.scene.frame(index)?), index)))
            .collect::<Result<_, InputError>>()?;
        values.retain(|(value, _)| *value > 0.0);
        values.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        Ok(values.into_iter().map(|(_, index)| index).collect())
    }

    /// The largest radiance of any probe, up to a common factor.
    fn brightest_probe(&self, frame: &SceneFrame, probes: &[Vec<Facet>]) -> f64 {
        let mut brightest = 0.0f64;
        self.each_lit(frame, probes, |radiance, _, _| brightest = brightest.max(radiance));
        brightest
    }

    /// The largest pixel of the image of all facets, up to a common factor: their radiance times
    /// the pixels that each covers, summed where its centre falls.
    fn brightest_pixel(&self, frame: &SceneFrame, facets: &[Vec<Facet>]) -> f64 {
        let image = self.scene.image;
        let (low, high) = (image.pixel(self.field.low).floor(), image.pixel(self.field.high).ceil());
        let (columns, rows) = ((high.x - low.x) as usize + 1, (high.y - low.y) as usize + 1);
        let mut sums = vec![[0f32; 2]; columns * rows];
        self.each_lit(frame, facets, |radiance, sight, covered_sr| {
            let sight = sight.clamp(self.field.low, self.field.high);
            let at = image.pixel(sight) - low;
            let covered_px = covered_sr / image.boresight_pixel_sr();
            if let Some(sum) = sums.get_mut(at.y as usize * columns + at.x as usize) {
                sum[0] += (radiance * covered_px) as f32;
                sum[1] += covered_px as f32;
            }
        });
        // A pixel that is not filled is dimmer; one that is overfilled has large facets.
        sums.iter().map(|[light, covered]| f64::from(light / covered.max(1.0))).fold(0.0, f64::max)
    }

    /// Calls with radiance (up to a common factor), line of sight and solid angle of each facet
    /// that is lit, turned to the camera and within the field.
    fn each_lit(&self, frame: &SceneFrame, facets: &[Vec<Facet>], mut take: impl FnMut(f64, DVec2, f64)) {
        for ((body, at), facets) in self.scene.bodies.iter().zip(&frame.bodies).zip(facets) {
            let body_from_camera = at.camera_from_body.transpose();
            let camera_m = -(body_from_camera * at.position_camera_m);
            let irradiance = sun_irradiance_w_m2_nm(at.sun_position_body_m.length());
            for facet in facets {
                let position_m = facet.position_m.as_dvec3();
                let (to_camera_m, to_sun_m) = (camera_m - position_m, at.sun_position_body_m - position_m);
                let (distance_m, normal) = (to_camera_m.length(), facet.normal.as_dvec3());
                let (to_camera, to_sun) = (to_camera_m / distance_m, to_sun_m.normalize());
                let (mu, mu0) = (normal.dot(to_camera), normal.dot(to_sun));
                let towards_m2 = facet.area_m2.as_dvec3().dot(to_camera);
                if mu <= 0.0 || mu0 <= 0.0 || towards_m2 <= 0.0 {
                    continue;
                }
                let in_camera: DVec3 = at.camera_from_body * position_m + at.position_camera_m;
                let sight = DVec2::new(in_camera.x, in_camera.y) / in_camera.z;
                // A triangle that is larger than the field may be seen though its centre is not.
                let reach = 0.5 * f64::from(facet.area_m2.length()).sqrt() / in_camera.z;
                if in_camera.z <= 0.0 || !self.field.within(sight, reach) {
                    continue;
                }
                let phase_rad = to_camera.dot(to_sun).clamp(-1.0, 1.0).acos();
                let factor = body.photometry.radiance_factor(Geometry { mu0, mu, phase_rad });
                take(
                    factor * f64::from(facet.albedo) * irradiance,
                    sight,
                    towards_m2 / (distance_m * distance_m),
                );
            }
        }
    }
}
