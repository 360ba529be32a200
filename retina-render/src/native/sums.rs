//! A pixel's planes from its fragments.

use glam::Vec3;

use super::pixels::{PLANES, View};
use super::shade::{Fragment, FragmentMap};

/// Work space of [`light_of`].
#[derive(Default)]
pub(crate) struct Reading {
    maps: Vec<FragmentMap>,
    /// Of each fragment: the share of the reads that it has, and the sum of their light over all reads.
    lit: Vec<[f32; 2]>,
}

/// Mean radiance and I/F over a pixel. `seen` is of each read the fragment that it sees, and its light: I/F without the
/// texture.
#[inline(always)]
pub(crate) fn light_of(
    view: &View<'_>,
    fragments: &[Fragment],
    reading: &mut Reading,
    seen: impl Iterator<Item = (u32, f32)>,
) -> [f32; 2] {
    let irradiance = |fragment: &Fragment| view.frame.placed[fragment.body as usize].sun_irradiance_over_pi;
    let Reading { maps, lit } = reading;
    maps.clear();
    maps.extend(fragments.iter().map(|fragment| fragment.map(&view.square, irradiance(fragment))));
    lit.clear();
    lit.resize(fragments.len(), [0.0; 2]);
    let texels = &view.frame.arrays.texels;
    let share = 1.0 / view.reads.places.count() as f32;
    let (mut mean_albedo, mut factor, mut radiance) = (0.0, 0.0, 0.0);
    for (place, (index, light)) in view.reads.places.iter().zip(seen) {
        let index = index as usize;
        let Some(map) = maps.get(index) else { continue };
        let light = share * light;
        let albedo = match &map.grid {
            Some(grid) => grid.albedo(texels, place),
            None => {
                let step = view.square.step(place);
                let at = [0, 1].map(|k| view.square.middle[k] + step[k]);
                fragments[index].albedo(view.frame, at)
            }
        };
        lit[index][0] += share;
        lit[index][1] += light;
        mean_albedo += share * albedo;
        let textured = light * albedo;
        factor += textured;
        radiance += textured * map.irradiance;
    }
    // What the reads get wrong about areas. They are spread evenly, so only this part takes the mean albedo. A fragment
    // without reads is as much in the shade as the others are.
    let shared = fragments.iter().zip(&*lit);
    let unshaded: f32 = shared.clone().map(|(fragment, [read, _])| read * fragment.value).sum();
    let all_light: f32 = lit.iter().map(|[_, light]| light).sum();
    let open = if unshaded > 0.0 { (all_light / unshaded).min(1.0) } else { 0.0 };
    for (fragment, &[read, light]) in shared {
        let Some(area) = fragment.area else { continue };
        let mean = if read > 0.0 { light / read } else { fragment.value * open };
        let textured = (area - read) * mean * mean_albedo;
        factor += textured;
        radiance += textured * irradiance(fragment);
    }
    [radiance, factor]
}

/// The planes beside the light: means over the part of the pixel that a body covers, and that part itself. `hidden` is the
/// part of the pixel that does not see the Sun.
pub(crate) fn layers(
    view: &View<'_>,
    fragments: &[Fragment],
    whole: bool,
    hidden: f32,
    planes: &mut [f32; PLANES],
) {
    let covered: f32 = fragments.iter().map(|fragment| fragment.share).sum();
    let mut normal = Vec3::ZERO;
    for fragment in fragments {
        let weight = fragment.share / covered;
        let placed = &view.frame.placed[fragment.body as usize];
        planes[3] += weight * fragment.depth_m;
        normal += placed.camera_from_body * fragment.normal * weight;
        for (plane, cosine) in [(7, fragment.elevation), (8, fragment.mu), (9, fragment.cos_phase)] {
            planes[plane] += weight * cosine.clamp(-1.0, 1.0).acos();
        }
    }
    planes[2] = if whole { 1.0 } else { covered.min(1.0) };
    let normal = normal / normal.length().max(1e-20);
    planes[4..7].copy_from_slice(&normal.to_array());
    for plane in 7..10 {
        planes[plane] = planes[plane].to_degrees();
    }
    planes[10] = (hidden / covered).min(1.0);
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
    use retina_geometry::Pinhole;
    use retina_model::{AlbedoMap, Body, Surface, Vertex, Wrap};
    use retina_radiometry::{AU_M, Lambert, PhaseFunction, Photometry};

    use crate::{
        BodyModel, BodyState, CpuRenderer, CpuSampling, FrameState, NativeRenderer, Planes, Quality,
    };

    /// Steps that fill the image, each rise and each tread 0.3 pixels wide. Rises are seen so steeply that the map, a wave
    /// that runs evenly over both, takes some fifteen times less of the image there.
    fn stairs(turn: f64) -> (BodyModel, FrameState) {
        let (along, across) = (DVec2::from_angle(turn), DVec2::from_angle(turn).perp());
        const WIDTH_M: f64 = 75.0;
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        let (mut depth_m, mut path_m) = (-3e4, 0.0);
        for step in 0..180u32 {
            let place = across * (f64::from(step) - 90.0) * WIDTH_M;
            for side in [-1e4, 1e4] {
                vertices.push(Vertex {
                    position_m: (place + side * along).extend(depth_m),
                    normal: Vec3::NEG_Z,
                    uv: Vec2::new((path_m / 2.4e3) as f32, 0.5),
                });
            }
            let rise_m = if step % 2 == 0 { 600.0 } else { 30.0 };
            depth_m += rise_m;
            path_m += DVec2::new(WIDTH_M, rise_m).length();
            // Counter-clockwise as the camera sees them: y runs down in the image.
            let first = 2 * step;
            triangles.extend([[first, first + 2, first + 1], [first + 1, first + 2, first + 3]]);
        }
        triangles.truncate(2 * 179);
        let surface = Surface {
            name: "stairs".into(),
            flat: true,
            albedo_map: Some(0),
            albedo_factor: 1.0,
            slope_map: None,
            double_sided: false,
        };
        let map = AlbedoMap {
            width: 256,
            height: 4,
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::Clamp,
            texels: (0..1024).map(|k| 0.5 + 0.4 * (TAU * (k % 256) as f32 / 256.0).sin()).collect(),
        };
        let shape = Body {
            vertices,
            triangle_surface: vec![0; triangles.len()],
            triangles,
            surfaces: vec![surface],
            albedo_maps: vec![map],
            ..Body::default()
        };
        let photometry = Photometry::new(Lambert, PhaseFunction::CONSTANT, Some(0.1));
        let body = BodyState {
            position_camera_m: 1e6 * DVec3::Z,
            camera_from_body: DMat3::IDENTITY,
            sun_position_body_m: AU_M * (DVec3::NEG_Z + 0.1 * along.extend(0.0)).normalize(),
        };
        let state =
            FrameState { image: Pinhole::centred(4000.0, [12; 2]), distortion: None, bodies: vec![body] };
        (BodyModel { name: "stairs".into(), shape, photometry }, state)
    }

    /// The rms error of a pixel, in its own light.
    fn error(turn: f64) -> f64 {
        let (model, state) = stairs(turn);
        let dense = CpuSampling { grid: 16, refined_grid: 16, sun_points: 1, contrast: 1.0 };
        let found = NativeRenderer::new(std::slice::from_ref(&model), Quality::Best, Planes::Radiance);
        let found = found.render(&state);
        let wanted = CpuRenderer::new(vec![model], dense, Planes::Radiance).render(&state);
        let pairs = found.radiance().iter().zip(wanted.radiance());
        let squares: f64 = pairs.map(|(f, w)| f64::from(f / w - 1.0).powi(2)).sum();
        (squares / found.radiance().len() as f64).sqrt()
    }

    /// Where each read takes the triangle of the nearest of 16 samples, the error is 5 to 6 %.
    #[test]
    fn reads_see_the_triangle_that_they_fall_into() {
        for turn in [0.3, 2.4, 4.0] {
            let found = error(turn);
            assert!(found < 0.03, "{turn}: {found}");
        }
    }
}
