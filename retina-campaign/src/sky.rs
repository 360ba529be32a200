//! Objects as the bench shows them and as the sky does, to the same camera with the same settings (the paper's Fig. 8),
//! and why the two differ.

use glam::DVec2;
use retina_bench::{Bench, BenchError, Exposure, OpticsDetail, ScreenImage};
use retina_files::InputError;
use retina_formats::{Calibration, measured_or_power_law};
use retina_geometry::ARCSEC_PER_RAD;
use retina_image::CameraImage;
use retina_optics::facility::{Kernel, KernelGrid, SpectralLine, airy_kernel};
use retina_radiometry::{irradiance_of_magnitude_w_m2_nm, magnitude_of_irradiance};
use retina_screen::PointPainter;

use crate::Facility;
use crate::points::camera_image;

/// Half the side of a cut-out, pixels.
pub(crate) const CUT_PX: usize = 16;
/// Objects stand so far apart in the camera's image, pixels.
const APART_PX: f64 = 90.0;
/// Wavelengths of a flat spectrum.
const SKY_LINES: usize = 12;
/// Samples a pixel of the camera's own image of a star.
const PER_PX: usize = 8;

/// An object of the sky.
#[derive(Debug, Clone, PartialEq)]
pub struct SkyObject {
    /// What it is called.
    pub name: String,
    /// Its magnitude above the atmosphere.
    pub magnitude: f64,
    /// Its apparent diameter, arcsec; 0 for a star.
    pub diameter_arcsec: f64,
}

/// What is compared, and under which sky.
#[derive(Debug, Clone, PartialEq)]
pub struct SkyOptions {
    /// The objects.
    pub objects: Vec<SkyObject>,
    /// Exposure time, s; by default the brightest object's peak in the sky fills 80 % of the full well.
    pub exposure_s: Option<f64>,
    /// What the atmosphere takes at the zenith, mag.
    pub extinction_mag: f64,
    /// Air masses that the objects are seen through.
    pub airmass: f64,
    /// Brightness of the sky's background, mag per square arcsec.
    pub background_mag_arcsec2: f64,
    /// Detail of the optics.
    pub detail: OpticsDetail,
}

impl Default for SkyOptions {
    /// Jupiter of the paper's Fig. 8 and two stars, at a low elevation under a sky of Bortle's class 4 with moonlight.
    fn default() -> Self {
        let object = |name: &str, magnitude, diameter_arcsec| SkyObject {
            name: name.to_owned(),
            magnitude,
            diameter_arcsec,
        };
        Self {
            objects: vec![
                object("Jupiter", -2.26, 40.0),
                object("star of 0.5 mag", 0.5, 0.0),
                object("star of 2.5 mag", 2.5, 0.0),
            ],
            exposure_s: None,
            extinction_mag: 0.25,
            airmass: 2.5,
            background_mag_arcsec2: 19.5,
            detail: OpticsDetail::default(),
        }
    }
}

/// How an object's light lies on the sensor, without noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Its electrons, all of them.
    pub electrons: f64,
    /// Those in the brightest pixel.
    pub peak_e: f64,
    /// Radius that holds half of its light, pixels.
    pub half_light_px: f64,
}

/// One object, step by step from the sky to the bench.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The object.
    pub object: SkyObject,
    /// Magnitude that the screen's counts make.
    pub displayed_magnitude: f64,
    /// Lit pixels of the screen.
    pub lit_pixels: usize,
    /// Its place in both images, camera px.
    pub at_px: DVec2,
    /// In the sky, through the atmosphere.
    pub sky: Spot,
    /// The same above the atmosphere.
    pub space: Spot,
    /// The screen's lit pixels through lenses without aberration.
    pub ideal_facility: Spot,
    /// The bench.
    pub bench: Spot,
    /// Pixels more than five times the noise above the background: in the bench's image, in the sky's.
    pub seen_px: [usize; 2],
}

/// What both cameras saw.
#[derive(Debug, Clone, PartialEq)]
pub struct SkyResult {
    /// The bench's image.
    pub bench: CameraImage,
    /// The sky's.
    pub sky: CameraImage,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Background of the sky's image, electrons a pixel.
    pub background_e: f64,
    /// Object by object.
    pub comparisons: Vec<Comparison>,
}

/// Shows the objects on the bench and in the sky.
///
/// # Errors
/// The bench cannot be built; an object does not fit on its screen.
pub fn compare_with_sky(
    facility: &Facility,
    calibration: Option<&Calibration>,
    options: &SkyOptions,
) -> Result<SkyResult, BenchError> {
    let bench = facility.bench(options.detail)?;
    let setup = &facility.setup;
    let camera = setup.camera_pinhole();
    let size = [camera.width_px as usize, camera.height_px as usize];
    let star = star_image(&bench, &flat_spectrum(&bench))?;
    let response = calibration
        .map_or_else(|| measured_or_power_law(None, setup), |calibration| calibration.screen_response(setup));
    let k_f = setup.facility_pinhole();
    let painter = PointPainter::new(k_f, calibration.map(|c| c.distortion.clone()), response)
        .with_inverse(calibration.and_then(|c| c.inverse.clone()));

    // In a row through the middle, between pixels as chance would have it.
    let place = |i: usize| {
        let along = (i as f64 - (options.objects.len() as f64 - 1.0) / 2.0) * APART_PX;
        DVec2::new(camera.cx_px.floor() + along.floor() + 0.2, camera.cy_px.floor() + 0.7)
    };
    let disc = |object: &SkyObject| {
        // A disc's second moment is that of a box sqrt(3)/2 as wide.
        let wide = 0.75f64.sqrt() * object.diameter_arcsec / ARCSEC_PER_RAD * camera.fx_px;
        let mut image = star.clone();
        if wide > 0.0 {
            image.spread([wide, wide]);
        }
        image.spread([1.0, 1.0]);
        image
    };
    let discs: Vec<Kernel> = options.objects.iter().map(disc).collect();
    let dimming = 10f64.powf(-0.4 * options.extinction_mag * options.airmass);
    let exposure_s = options.exposure_s.unwrap_or_else(|| {
        let peak = |(object, disc): (&SkyObject, &Kernel)| {
            bench.star_e_s(object.magnitude)
                * dimming
                * f64::from(disc.values.iter().copied().fold(0.0, f32::max))
        };
        0.8 * bench.sensor().full_well_e() / options.objects.iter().zip(&discs).map(peak).fold(0.0, f64::max)
    });
    let exposure = Exposure::new(exposure_s, 0);
    let pixel_arcsec2 = (ARCSEC_PER_RAD / camera.fx_px) * (ARCSEC_PER_RAD / camera.fy_px);
    let background_e = bench.star_e_s(options.background_mag_arcsec2) * pixel_arcsec2 * exposure_s;

    let dark = || vec![0f32; size[0] * size[1]];
    let (mut sky, mut space, mut ideal) = (dark(), dark(), dark());
    let mut counts = vec![0u8; (k_f.width_px * k_f.height_px) as usize];
    let mut shown = Vec::new();
    let mut screen_pixel = star.clone();
    let screen_px = camera.fx_px / k_f.fx_px;
    screen_pixel
        .spread([screen_px / 3.0 * setup.optics.emission_fill[0], screen_px * setup.optics.emission_fill[1]]);
    screen_pixel.spread([1.0, 1.0]);
    for (i, (object, disc)) in options.objects.iter().zip(&discs).enumerate() {
        let electrons = bench.star_e_s(object.magnitude) * exposure_s;
        lay(&mut space, size[0], disc, place(i), electrons);
        lay(&mut sky, size[0], disc, place(i), electrons * dimming);
        let wanted = irradiance_of_magnitude_w_m2_nm(object.magnitude);
        let mut own = vec![0u8; counts.len()];
        let drawn = painter
            .screen_px(camera.line_of_sight(place(i)), wanted)
            .and_then(|at| painter.draw(&mut own, at, wanted))
            .ok_or_else(|| {
                let text = format!("`{}` of magnitude {} cannot be shown", object.name, object.magnitude);
                InputError::new(&setup.file, text)
                    .help("its screen is too dim or too coarse for it: take another magnitude")
            })?;
        let screen = ScreenImage::grey(k_f.width_px, k_f.height_px, &own);
        for source in bench.sources(&screen, &exposure)? {
            lay(&mut ideal, size[0], &screen_pixel, source.at_px, source.electrons);
        }
        counts.iter_mut().zip(&own).for_each(|(all, own)| *all = (*all).max(*own));
        shown.push((magnitude_of_irradiance(drawn.splat.displayed_w_m2_nm), drawn.splat.pixels.len()));
    }
    sky.iter_mut().for_each(|value| *value += background_e as f32);
    let screen = ScreenImage::grey(k_f.width_px, k_f.height_px, &counts);
    let shown_light = bench.light_e(&screen, &exposure)?;
    let bench_image = camera_image(&bench, bench.read(&shown_light, &exposure));
    let sky_image = camera_image(&bench, bench.read(&sky, &Exposure { frame: 1, ..exposure }));
    let comparisons = options
        .objects
        .iter()
        .zip(shown)
        .enumerate()
        .map(|(i, (object, (displayed_magnitude, lit_pixels)))| {
            let spot = |light: &[f32]| Spot::of(light, size, place(i));
            let seen = |image: &CameraImage, light: &[f32]| seen_px(&bench, image, light, size, place(i));
            Comparison {
                object: object.clone(),
                displayed_magnitude,
                lit_pixels,
                at_px: place(i),
                sky: spot(&sky),
                space: spot(&space),
                ideal_facility: spot(&ideal),
                bench: spot(&shown_light),
                seen_px: [seen(&bench_image, &shown_light), seen(&sky_image, &sky)],
            }
        })
        .collect();
    Ok(SkyResult { bench: bench_image, sky: sky_image, exposure_s, background_e, comparisons })
}

/// A flat spectrum as lines, shares by the electrons they make (eq. 9).
fn flat_spectrum(bench: &Bench) -> Vec<SpectralLine> {
    let efficiency = bench.sensor().efficiency();
    let [from, to] = efficiency.range_nm();
    let nm = |i: usize| from + (to - from) * (i as f64 + 0.5) / SKY_LINES as f64;
    let sum: f64 = (0..SKY_LINES).map(|i| efficiency.relative(nm(i))).sum();
    (0..SKY_LINES).map(|i| (nm(i), efficiency.relative(nm(i)) / sum)).collect()
}

fn star_image(bench: &Bench, lines: &[SpectralLine]) -> Result<Kernel, BenchError> {
    let camera = &bench.setup().camera;
    let grid = KernelGrid { focal_px: bench.camera().pinhole.fx_px, per_px: PER_PX, half_px: CUT_PX };
    Ok(airy_kernel(camera.focal_mm / camera.f_number / 2.0, lines, grid)?)
}

/// Adds a kernel's light about a place: bilinear between its samples.
fn lay(image: &mut [f32], width: usize, kernel: &Kernel, at: DVec2, electrons: f64) {
    let side = kernel.grid.side();
    let (per_px, half) = (kernel.grid.per_px as f64, kernel.grid.half_px as f64);
    let height = image.len() / width;
    let sample = |x: usize, y: usize| f64::from(kernel.values[y * side + x]);
    let span = |v: f64, size: usize| (v - half).max(0.0) as usize..((v + half).max(0.0) as usize).min(size);
    for y in span(at.y, height) {
        for x in span(at.x, width) {
            let u = (x as f64 + 0.5 - at.x + half) * per_px;
            let v = (y as f64 + 0.5 - at.y + half) * per_px;
            let (i, j) = ((u.max(0.0) as usize).min(side - 2), (v.max(0.0) as usize).min(side - 2));
            let (fx, fy) = (u - i as f64, v - j as f64);
            if !((0.0..=1.0).contains(&fx) && (0.0..=1.0).contains(&fy)) {
                continue;
            }
            let row = |j: usize| sample(i, j) * (1.0 - fx) + sample(i + 1, j) * fx;
            image[y * width + x] += (electrons * (row(j) * (1.0 - fy) + row(j + 1) * fy)) as f32;
        }
    }
}

/// Pixels of a cut-out about a place: x, y and their index.
fn cut([width, height]: [usize; 2], at: DVec2) -> impl Iterator<Item = (f64, f64, usize)> {
    let span = |v: f64, size: usize| (v as usize).saturating_sub(CUT_PX)..(v as usize + CUT_PX + 1).min(size);
    let columns = span(at.x, width);
    span(at.y, height)
        .flat_map(move |y| columns.clone().map(move |x| (x as f64 + 0.5, y as f64 + 0.5, y * width + x)))
}

/// The median of a cut-out's rim: its background.
fn rim(values: &[f32], size: [usize; 2], at: DVec2) -> f64 {
    let far = |x: f64, y: f64| (x - at.x).abs().max((y - at.y).abs()) > CUT_PX as f64 - 2.0;
    let mut rim: Vec<f64> =
        cut(size, at).filter(|&(x, y, _)| far(x, y)).map(|(_, _, i)| f64::from(values[i])).collect();
    rim.sort_by(f64::total_cmp);
    rim.get(rim.len() / 2).copied().unwrap_or(0.0)
}

impl Spot {
    fn of(light: &[f32], size: [usize; 2], at: DVec2) -> Self {
        let background = rim(light, size, at);
        let own: Vec<(f64, f64, f64)> =
            cut(size, at).map(|(x, y, i)| (x, y, (f64::from(light[i]) - background).max(0.0))).collect();
        let electrons: f64 = own.iter().map(|pixel| pixel.2).sum();
        let mean = |of: fn(&(f64, f64, f64)) -> f64| {
            own.iter().map(|pixel| of(pixel) * pixel.2).sum::<f64>() / electrons
        };
        let centre = DVec2::new(mean(|p| p.0), mean(|p| p.1));
        // Pixels are cut finely, so that the radius is not a pixel's.
        const CUTS: usize = 5;
        let mut shells: Vec<(f64, f64)> = own
            .iter()
            .flat_map(|&(x, y, e)| {
                (0..CUTS * CUTS).map(move |k| {
                    let off = |k: usize| (k as f64 + 0.5) / CUTS as f64 - 0.5;
                    let part = DVec2::new(x + off(k % CUTS), y + off(k / CUTS));
                    (part.distance(centre), e / (CUTS * CUTS) as f64)
                })
            })
            .collect();
        shells.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut sum = 0.0;
        let half = shells.iter().find(|shell| {
            sum += shell.1;
            sum >= 0.5 * electrons
        });
        Self {
            electrons,
            peak_e: own.iter().map(|pixel| pixel.2).fold(0.0, f64::max),
            half_light_px: half.map_or(0.0, |shell| shell.0),
        }
    }
}

/// Pixels of an image that stand out from its background by five times its noise.
fn seen_px(bench: &Bench, image: &CameraImage, light: &[f32], size: [usize; 2], at: DVec2) -> usize {
    let values = &image.values;
    let background = rim(values, size, at);
    let gain = bench.sensor().gain_e_per_dn;
    let read_e = bench.setup().noise.read_noise_e;
    let sigma_dn = ((rim(light, size, at) + read_e * read_e).sqrt() / gain).max(0.5);
    cut(size, at).filter(|&(_, _, i)| f64::from(values[i]) > background + 5.0 * sigma_dn).count()
}
