//! The fast renderers' images, the GPU's and the native one's, against the f64 renderer's, which shares no
//! intersection, texture or sampling code with either. Each comparison has twins that perturb the image and must fail.

use glam::{DQuat, DVec3};
use retina_geometry::{Distortion, Pinhole};
use retina_radiometry::phase_functions::{Exponential, HenyeyGreenstein, Magnitudes};
use retina_radiometry::{
    AU_M, Akimov, Hapke, Lambert, Law, LommelSeeliger, LunarLambert, Minnaert, OrenNayar, PhaseFunction,
    Photometry, Registered, Rolo,
};
use retina_render::{
    BodyModel, BodyState, CpuRenderer, CpuSampling, FrameState, GpuDevice, GpuRenderer, NativeRenderer,
    Planes, Quality, RadianceImage,
};
use retina_tests::{Comparison, compare, moon, placed, sphere, square_image};

/// Converged enough to stand as the truth: 64 samples a pixel, 400 on edges, four Sun rays each.
const REFERENCE: CpuSampling = CpuSampling { grid: 8, refined_grid: 20, sun_points: 4, contrast: 0.1 };

/// Pixels beyond 2 % on the shadows' edges that the close-up may have, over the body's pixels: a
/// twelfth of its pixels lie on such an edge, where 64 rays see a straight edge to about 2 %.
const OUTLIERS: f64 = 0.015;

/// Largest difference that a pixel of the close-up may have away from every edge that the reference sees. Where sunlight
/// grazes a slope, half a metre of the rays' start decides whether some hundred metres lie in shadow: one pixel of 58 000
/// is off by 3 % in f32, whatever the samples.
const GRAZED: f64 = 0.04;

fn close_up_agrees(found: &Comparison) -> bool {
    found.interior_rms <= 0.002 && found.interior_worst <= GRAZED && found.outlier_fraction <= OUTLIERS
}

fn lunar() -> Photometry {
    let law = LunarLambert { decay_rad: 60f64.to_radians() };
    Photometry::new(law, PhaseFunction::CONSTANT, Some(0.12))
}

fn model(name: &str, shape: retina_model::Body, photometry: Photometry) -> BodyModel {
    BodyModel { name: name.into(), shape, photometry }
}

/// An image of a fast renderer beside its reference.
struct Pair {
    renderer: &'static str,
    reference: RadianceImage,
    image: RadianceImage,
}

/// The native renderer's image, and the GPU's where there is an adapter.
fn pairs(models: &[BodyModel], state: &FrameState, sampling: CpuSampling, quality: Quality) -> Vec<Pair> {
    let reference = CpuRenderer::new(models.to_vec(), sampling, Planes::Layers).render(state);
    images(models, state, quality)
        .into_iter()
        .map(|(renderer, image)| Pair { renderer, reference: reference.clone(), image })
        .collect()
}

fn images(models: &[BodyModel], state: &FrameState, quality: Quality) -> Vec<(&'static str, RadianceImage)> {
    let native = NativeRenderer::new(models, quality, Planes::Layers);
    let mut out = vec![("native", native.render(state))];
    if let Some(gpu) = GpuDevice::open_for_test() {
        let mut renderer =
            GpuRenderer::new(gpu, models.to_vec(), quality, Planes::Layers).expect("the bodies fit");
        renderer.start(state).expect("the frame starts");
        out.push(("gpu", renderer.finish().expect("the frame ends").expect("one frame was started")));
    }
    out
}

/// The Moon from 6000 km at 2 km a pixel, looking down on the terminator: triangles and texels are
/// larger than a pixel, so that both sides resolve them.
fn moon_close_up() -> FrameState {
    let turn = DQuat::from_rotation_x(1.9) * DQuat::from_rotation_z(0.7);
    let sun = DVec3::new(0.99, -0.1, -0.08);
    let body = placed(DVec3::new(2.0e4, 3.0e4, 6.0e6), turn, sun, AU_M);
    FrameState { image: square_image(256, 3000.0), distortion: None, bodies: vec![body] }
}

#[test]
fn moon_with_relief_texture_and_shadows() {
    let state = moon_close_up();
    for Pair { renderer, reference, image } in
        pairs(&[model("moon", moon(), lunar())], &state, REFERENCE, Quality::Best)
    {
        let found = compare(&reference, &image);
        println!("{renderer}: {found:?}");
        assert!(found.interior_pixels > 10_000 && close_up_agrees(&found), "{renderer}: {found:?}");
        assert!((found.flux_ratio - 1.0).abs() < 5e-4, "{renderer}: {found:?}");

        // Twins: what the comparison must not let pass.
        let shifted = perturbed(&image, |image, i| {
            let width = image.width_px as usize;
            let left = if i % width > 0 { i - 1 } else { i };
            0.9 * image.radiance()[i] + 0.1 * image.radiance()[left]
        });
        assert!(!close_up_agrees(&compare(&reference, &shifted)), "a shift of 0.1 px passed");
        let louder = perturbed(&image, |image, i| 1.01 * image.radiance()[i]);
        assert!(!close_up_agrees(&compare(&reference, &louder)), "a gain of 1 % passed");
        // A missing shadow: one crater's shadow filled with its surroundings' light.
        let shadowed: Vec<usize> = (0..reference.pixels())
            .filter(|&i| reference.plane(10)[i] > 0.99 && reference.plane(7)[i] < 88.0)
            .collect();
        assert!(!shadowed.is_empty(), "the scene holds no cast shadow");
        let mut unshadowed = image.clone();
        for &i in &shadowed {
            unshadowed.data[i] = 0.12 * 0.59 * reference.plane(7)[i].to_radians().cos();
        }
        assert!(!close_up_agrees(&compare(&reference, &unshadowed)), "missing shadows passed");
        layers_agree(renderer, &reference, &image);
    }
}

/// The planes beside the light, inside the body: depth, normal, angles, shadow.
fn layers_agree(renderer: &str, reference: &RadianceImage, image: &RadianceImage) {
    let whole: Vec<usize> = (0..reference.pixels()).filter(|&i| reference.plane(2)[i] == 1.0).collect();
    let rms = |plane: usize| {
        let squares = |&i: &usize| f64::from(reference.plane(plane)[i] - image.plane(plane)[i]).powi(2);
        (whole.iter().map(squares).sum::<f64>() / whole.len() as f64).sqrt()
    };
    // Half a facet's slope at most: the f64 renderer has more samples in a pixel.
    for (plane, limit) in
        [(2, 1e-6), (3, 100.0), (4, 0.01), (5, 0.01), (6, 0.01), (7, 0.6), (8, 0.6), (9, 0.01)]
    {
        let found = rms(plane);
        println!("{renderer}, {}: {found}", retina_render::PLANE_NAMES[plane]);
        assert!(found < limit, "{renderer}, {}: {found}", retina_render::PLANE_NAMES[plane]);
    }
    let found = rms(10);
    println!("{renderer}, shadow: {found}");
    assert!(found < 0.05, "{renderer}, shadow: {found}");
}

fn perturbed(image: &RadianceImage, value: impl Fn(&RadianceImage, usize) -> f32) -> RadianceImage {
    let mut out = image.clone();
    for i in 0..image.pixels() {
        out.data[i] = value(image, i);
    }
    out
}

/// Two spheres, the near one's penumbra on the far one: the Sun is brought close so that the
/// penumbra is tens of pixels wide.
fn eclipse(sun_distance_m: f64) -> (Vec<BodyModel>, FrameState) {
    let sun = DVec3::new(1.0, 0.0, 0.0);
    let far = placed(DVec3::new(-2.0e6, 0.0, 3.0e7), DQuat::IDENTITY, sun, sun_distance_m);
    let near = placed(DVec3::new(2.4e6, 0.5e6, 3.0e7), DQuat::IDENTITY, sun, sun_distance_m);
    let lambert = Photometry::new(Lambert, PhaseFunction::CONSTANT, Some(0.2));
    let models = vec![model("far", sphere(1.7e6, 48), lambert), model("near", sphere(0.8e6, 32), lambert)];
    (models, FrameState { image: square_image(192, 900.0), distortion: None, bodies: vec![far, near] })
}

#[test]
fn one_bodys_penumbra_on_another() {
    let (models, state) = eclipse(2.0e10);
    let alone = FrameState { bodies: state.bodies[..1].to_vec(), ..state.clone() };
    let unshadowed = images(&models[..1], &alone, Quality::Best);
    for (Pair { renderer, reference, image }, (_, unshadowed)) in
        pairs(&models, &state, REFERENCE, Quality::Best).into_iter().zip(unshadowed)
    {
        let penumbra = reference.plane(10).iter().filter(|&&v| v > 0.05 && v < 0.95).count();
        assert!(penumbra > 100, "the scene holds {penumbra} pixels of penumbra");
        // 64 points of the disc: a straight edge across it is off by 0.02 of the light or so.
        let full = reference.radiance().iter().copied().fold(0.0, f32::max);
        let errors: Vec<f32> = (0..reference.pixels())
            .filter(|&i| {
                reference.plane(2)[i] == 1.0 && reference.plane(10)[i] > 0.0 && reference.plane(10)[i] < 1.0
            })
            .map(|i| (reference.radiance()[i] - image.radiance()[i]) / full)
            .collect();
        let rms = (errors.iter().map(|e| e * e).sum::<f32>() / errors.len() as f32).sqrt();
        let worst = errors.iter().fold(0.0f32, |worst, e| worst.max(e.abs()));
        println!("{renderer}, penumbra: rms {rms}, worst {worst} over {} pixels", errors.len());
        assert!(rms < 0.02 && worst < 0.1, "{renderer}, penumbra: rms {rms}, worst {worst}");
        assert!((compare(&reference, &image).flux_ratio - 1.0).abs() < 1e-3, "{renderer}");
        // The twin without the caster differs.
        assert!((compare(&reference, &unshadowed).flux_ratio - 1.0).abs() > 1e-2, "{renderer}");
    }
}

/// One of each law, with parameters that all act, and the root mean square that f32 may differ by.
fn every_law() -> Vec<(Law, f64)> {
    let hapke = Hapke { cboe_amplitude: 0.4, cboe_width: 0.2, porosity: 1.2, ..Hapke::lunar() };
    let rolo = Rolo {
        surge_amplitude: 0.05,
        surge_decay_per_deg: 0.2,
        polynomial: [0.2, -3e-3, 2.5e-5, -1.5e-7, 4e-10],
    };
    let out = vec![
        (Lambert.into(), 2e-3),
        (LommelSeeliger.into(), 2e-3),
        (LunarLambert { decay_rad: 1.0 }.into(), 2e-3),
        (OrenNayar { roughness_rad: 0.4 }.into(), 2e-3),
        // Sines and exponentials of the roughness cancel.
        (hapke.into(), 5e-3),
        (Minnaert { k: 0.7 }.into(), 2e-3),
        (Akimov.into(), 2e-3),
        (rolo.into(), 2e-3),
    ];
    let indices: Vec<u32> = out.iter().map(|(law, _): &(Law, f64)| law.index()).collect();
    assert!(indices.into_iter().eq(0..Law::ALL.len() as u32), "a law is left out");
    out
}

/// One of each phase function.
fn every_phase_function() -> Vec<PhaseFunction> {
    let out = vec![
        PhaseFunction::CONSTANT,
        Exponential { scale_rad: 30f64.to_radians() }.into(),
        HenyeyGreenstein { asymmetry: -0.3 }.into(),
        Magnitudes { coefficients: [0.03, -1e-4, 1e-6, -1e-9] }.into(),
    ];
    let indices: Vec<u32> = out.iter().map(PhaseFunction::index).collect();
    assert!(indices.into_iter().eq(0..PhaseFunction::ALL.len() as u32), "a phase function is left out");
    out
}

/// The rows of an image that belong to one of `bands`.
fn band(image: &RadianceImage, index: usize, bands: usize) -> RadianceImage {
    let rows = image.height_px as usize / bands;
    let pixels = rows * image.width_px as usize;
    let data = image
        .data
        .chunks_exact(image.pixels())
        .flat_map(|plane| plane[index * pixels..(index + 1) * pixels].to_vec())
        .collect();
    RadianceImage { height_px: rows as u32, data, ..image.clone() }
}

/// Bodies that the GPU renderer takes in one frame.
const MOST_BODIES: usize = 32;

/// Every law times every phase function through each fast renderer against its f64 formula. A pair has a sphere of its own in a
/// column; the Sun stands beside the column, so that none shadows another.
#[test]
fn every_law_with_every_phase_function_is_the_librarys() {
    let combinations: Vec<(Law, f64, PhaseFunction)> = every_law()
        .into_iter()
        .flat_map(|(law, limit)| every_phase_function().into_iter().map(move |f| (law, limit, f)))
        .collect();
    // The column is less than two degrees high: the phase angle is nearly the same all along.
    let (band_px, focal_px, distance_m) = (32u32, 4.0e4, 1.0e9);
    let band_m = f64::from(band_px) / focal_px * distance_m;
    // All pairs are told, not the first wrong one alone.
    let mut wrong = Vec::new();
    for (phase_deg, combinations) in
        [3.0f64, 70.0].into_iter().flat_map(|deg| combinations.chunks(MOST_BODIES).map(move |c| (deg, c)))
    {
        let sun = DVec3::new(phase_deg.to_radians().sin(), 0.0, -phase_deg.to_radians().cos());
        let count = combinations.len();
        let bodies: Vec<BodyState> = (0..count)
            .map(|i| (i as f64 + 0.5 - 0.5 * count as f64) * band_m)
            .map(|y_m| placed(DVec3::new(0.0, y_m, distance_m), DQuat::IDENTITY, sun, AU_M))
            .collect();
        let column = square_image(band_px * count as u32, focal_px);
        let image = Pinhole { width_px: band_px, cx_px: 0.5 * f64::from(band_px), ..column };
        let state = FrameState { image, distortion: None, bodies };
        let shape = sphere(0.44 * band_m, 48);
        let models: Vec<BodyModel> = combinations
            .iter()
            .map(|&(law, _, function)| {
                model(law.name(), shape.clone(), Photometry::new(law, function, Some(0.15)))
            })
            .collect();
        // Pixels on edges are not compared: neither side needs finer samples there.
        let sampling = CpuSampling { grid: 4, refined_grid: 4, sun_points: 1, contrast: 0.1 };
        for found in pairs(&models, &state, sampling, Quality::Draft) {
            for (i, (law, limit, function)) in combinations.iter().enumerate() {
                let agrees = |found: &Comparison| {
                    found.interior_pixels > 300 && found.interior_rms < *limit && found.interior_worst < 0.02
                };
                let (reference, image) = (band(&found.reference, i, count), band(&found.image, i, count));
                let pair =
                    format!("{}: {} with {} at {phase_deg} deg", found.renderer, law.name(), function.name());
                let found = compare(&reference, &image);
                println!("{pair}: {found:?}");
                if !agrees(&found) {
                    wrong.push(format!("{pair}: {found:?}"));
                }
                // Twins: what the comparison must not let pass.
                let louder = perturbed(&image, |image, i| 1.01 * image.radiance()[i]);
                assert!(!agrees(&compare(&reference, &louder)), "{pair}: a gain of 1 % passed");
                let value = function.value(phase_deg.to_radians()) as f32;
                let without = perturbed(&image, |image, i| image.radiance()[i] / value);
                assert!(
                    *function == PhaseFunction::CONSTANT
                        || phase_deg < 60.0
                        || !agrees(&compare(&reference, &without)),
                    "{pair}: an image without the phase function passed"
                );
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn rendering_through_the_distortion() {
    // Radial and decentring terms, 6 % at the corner: both renderers see r = D(K^-1 R).
    let distortion = Distortion::brown(4.0, 6e-3, 0.0);
    let sun = DVec3::new(0.5, -0.3, -0.8);
    let body = placed(DVec3::new(4.0e5, -3.0e5, 1.0e7), DQuat::IDENTITY, sun, AU_M);
    let state =
        FrameState { image: square_image(128, 700.0), distortion: Some(distortion), bodies: vec![body] };
    let models = vec![model("sphere", sphere(7.0e5, 64), lunar())];
    let sampling = CpuSampling { grid: 4, refined_grid: 16, sun_points: 1, contrast: 0.1 };
    let straight = images(&models, &FrameState { distortion: None, ..state.clone() }, Quality::Best);
    for (Pair { renderer, reference, image }, (_, straight)) in
        pairs(&models, &state, sampling, Quality::Best).into_iter().zip(straight)
    {
        let found = compare(&reference, &image);
        println!("{renderer}: {found:?}");
        assert!(found.interior_rms < 1e-3 && found.interior_worst < 0.02, "{renderer}: {found:?}");
        assert!((found.flux_ratio - 1.0).abs() < 2e-4, "{renderer}: {found:?}");
        // The twin without the distortion differs.
        assert!(compare(&reference, &straight).interior_rms > 1e-2);
    }
}

#[test]
fn the_native_renderer_gives_the_same_bytes_on_every_processor() {
    let (models, state) = eclipse(AU_M);
    let native = NativeRenderer::new(&models, Quality::Default, Planes::Layers);
    let first = native.render(&state);
    assert!(first.radiance().iter().any(|&v| v > 0.0));
    assert!(native.render(&state) == first, "the image changed from one rendering to the next");
    let instructions = native.instructions();
    assert!(native.portable().render(&state) == first, "{instructions} and portable instructions differ");
}

/// Without planes beside the light the night is not shaded; the day must not change by that.
#[test]
fn the_night_is_left_out_and_nothing_else() {
    let (models, state) = ([model("moon", moon(), lunar())], moon_close_up());
    let [light, all] = [Planes::Radiance, Planes::Layers]
        .map(|planes| NativeRenderer::new(&models, Quality::Default, planes).render(&state));
    let mean = all.radiance().iter().sum::<f32>() / all.radiance().len() as f32;
    let worst = light.radiance().iter().zip(all.radiance()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(mean > 0.0 && worst < 1e-3 * mean, "{worst} of {mean}");
}

#[test]
fn the_same_bytes_again() {
    let Some(gpu) = GpuDevice::open_for_test() else { return };
    let (models, state) = eclipse(AU_M);
    let mut renderer =
        GpuRenderer::new(gpu, models, Quality::Default, Planes::RadianceFactor).expect("the bodies fit");
    let mut render = || {
        renderer.start(&state).expect("the frame starts");
        renderer.finish().expect("the frame ends").expect("one frame was started")
    };
    let first = render();
    assert!(first.radiance().iter().any(|&v| v > 0.0));
    for _ in 0..3 {
        assert!(render() == first, "the image changed from one rendering to the next");
    }
}
