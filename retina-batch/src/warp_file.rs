//! An image file resampled through the distortion into another.

use std::path::Path;

use glam::DVec2;
use image::ImageFormat;
use retina_files::{InputError, write_atomic};
use retina_formats::Calibration;
use retina_geometry::{Setup, WarpDirection, WarpMap};
use retina_radiometry::ScreenResponse;

use crate::linear_image::IntegerImage;
use crate::{BatchError, Canvas, Channels, Resampler, read_exr, write_exr};

/// What a resampling of a file did.
#[derive(Debug, Clone, PartialEq)]
pub struct WarpReport {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// Channels resampled.
    pub channels: usize,
    /// Samples beyond what the file's whole numbers hold, by more than half a step: cut off.
    pub clipped: u64,
    /// Output pixels that read beyond the image's border, which is continued outwards.
    pub outside_px: u64,
    /// Channels of an EXR that hold infinities or NaNs, as a depth does beside a body: left out.
    pub left_out: Vec<String>,
}

/// Resamples the image file `from` into `to`, whose extension says its format.
///
/// Upstream the image has the screen's size and holds digital counts, which are resampled as
/// irradiance through the setup's response, into counts of 8 bits; downstream it has the camera's
/// size and is linear, and keeps its bits. An EXR is linear in either direction.
///
/// # Errors
/// An image of another size or kind, an extension that does not fit it.
pub fn warp_file(
    from: &Path,
    setup: &Setup,
    calibration: &Calibration,
    direction: WarpDirection,
    to: &Path,
) -> Result<WarpReport, BatchError> {
    let pinhole = match direction {
        WarpDirection::Upstream => setup.facility_pinhole(),
        WarpDirection::Downstream => setup.camera_pinhole(),
    };
    let map = WarpMap { pinhole, distortion: calibration.distortion.clone() };
    let resampler = Resampler::new(map.clone(), Canvas::of_image(&map));
    let target = extension(to);
    if extension(from) == "exr" {
        if target != "exr" {
            return Err(wrong_target(to, "an EXR is resampled into an EXR").into());
        }
        return warp_exr(from, &map, &resampler, direction, to);
    }
    let format = match target.as_str() {
        "png" => ImageFormat::Png,
        "tif" | "tiff" => ImageFormat::Tiff,
        _ => return Err(wrong_target(to, "a PNG or TIFF is resampled into a PNG or TIFF").into()),
    };
    let image = IntegerImage::read(from)?;
    check_size(from, [image.width_px, image.height_px], &map, direction)?;
    let (out, clipped) = match direction {
        WarpDirection::Upstream => upstream(&image, &resampler, &calibration.screen_response(setup)),
        WarpDirection::Downstream => downstream(&image, &resampler),
    };
    let schema = match direction {
        WarpDirection::Upstream => "retina.screen/1",
        WarpDirection::Downstream => "retina.undistorted/1",
    };
    let bytes = out.encode(format, schema)?;
    write_atomic(to, &bytes).map_err(BatchError::write(to))?;
    Ok(report(&map, image.channels, clipped))
}

fn upstream(image: &IntegerImage, resampler: &Resampler, response: &ScreenResponse) -> (IntegerImage, u64) {
    let step = if image.bits == 8 { 1.0 } else { 255.0 / 65_535.0 };
    // A count between two of the display's has an irradiance between theirs.
    let irradiance: Vec<f32> = (0..=if image.bits == 8 { 255u32 } else { 65_535 })
        .map(|sample| {
            let count = f64::from(sample) * step;
            let low = count.floor().min(254.0);
            let at = |count: f64| response.irradiance_w_m2_nm([count as u8; 3]);
            (at(low) + (count - low) * (at(low + 1.0) - at(low))) as f32
        })
        .collect();
    let brightest = response.brightest_w_m2_nm();
    let limit = brightest + 0.5 * (brightest - response.irradiance_w_m2_nm([254; 3]));
    let mut clipped = 0;
    let out = each_channel(image, 8, |channel| {
        let source: Vec<f32> = image.channel(channel).map(|sample| irradiance[usize::from(sample)]).collect();
        let warped = resampler.resample(&source);
        clipped += warped.iter().filter(|&&value| f64::from(value) > limit).count() as u64;
        warped.iter().map(|&value| u16::from(response.nearest_count(value))).collect()
    });
    (out, clipped)
}

fn downstream(image: &IntegerImage, resampler: &Resampler) -> (IntegerImage, u64) {
    let largest = image.largest();
    let mut clipped = 0;
    let out = each_channel(image, image.bits, |channel| {
        let source: Vec<f32> = image.channel(channel).map(f32::from).collect();
        let warped = resampler.resample(&source);
        clipped += warped.iter().filter(|&&value| value > largest + 0.5).count() as u64;
        warped.iter().map(|&value| value.round().clamp(0.0, largest) as u16).collect()
    });
    (out, clipped)
}

/// An image of the same size whose channels are made one by one.
fn each_channel(image: &IntegerImage, bits: u32, mut make: impl FnMut(usize) -> Vec<u16>) -> IntegerImage {
    let mut samples = vec![0u16; image.samples.len()];
    for channel in 0..image.channels {
        for (pixel, sample) in make(channel).into_iter().enumerate() {
            samples[pixel * image.channels + channel] = sample;
        }
    }
    IntegerImage { bits, samples, ..image.clone() }
}

fn warp_exr(
    from: &Path,
    map: &WarpMap,
    resampler: &Resampler,
    direction: WarpDirection,
    to: &Path,
) -> Result<WarpReport, BatchError> {
    let (image, source) = read_exr(from)?;
    check_size(from, [image.width_px as u32, image.height_px as u32], map, direction)?;
    let (mut channels, mut left_out) = (Vec::new(), Vec::new());
    for (name, values) in &image.channels {
        let not_finite = values.iter().filter(|value| !value.is_finite()).count();
        if not_finite > 0 {
            left_out.push(name.clone());
            continue;
        }
        channels.push((name.clone(), resampler.resample(values)));
    }
    if channels.is_empty() {
        return Err(InputError::new(from, "holds no channel that can be interpolated")
            .found(format!("infinities or NaNs in {}", left_out.join(", ")))
            .into());
    }
    let count = channels.len();
    let metadata = serde_json::json!({
        "schema": "retina.warped/1",
        "direction": match direction { WarpDirection::Upstream => "upstream", WarpDirection::Downstream => "downstream" },
        "source": source,
    });
    let bytes = write_exr(Channels { channels, ..image }, &metadata.to_string())?;
    write_atomic(to, &bytes).map_err(BatchError::write(to))?;
    Ok(WarpReport { left_out, ..report(map, count, 0) })
}

fn report(map: &WarpMap, channels: usize, clipped: u64) -> WarpReport {
    let (width_px, height_px) = (map.pinhole.width_px, map.pinhole.height_px);
    let (right, bottom) = (f64::from(width_px), f64::from(height_px));
    let outside = |x: u32, y: u32| {
        let at = map.source_of(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        at.x < 0.0 || at.y < 0.0 || at.x > right || at.y > bottom
    };
    let outside_px = (0..height_px).map(|y| (0..width_px).filter(|&x| outside(x, y)).count() as u64).sum();
    WarpReport { width_px, height_px, channels, clipped, outside_px, left_out: Vec::new() }
}

fn check_size(
    from: &Path,
    size: [u32; 2],
    map: &WarpMap,
    direction: WarpDirection,
) -> Result<(), InputError> {
    let (wanted, whose) = (
        [map.pinhole.width_px, map.pinhole.height_px],
        match direction {
            WarpDirection::Upstream => "the screen's",
            WarpDirection::Downstream => "the camera's",
        },
    );
    if size == wanted {
        return Ok(());
    }
    Err(InputError::new(from, "the image has another size than the setup says")
        .found(format!("{} x {} pixels", size[0], size[1]))
        .expected(format!("{} x {}, {whose}", wanted[0], wanted[1]))
        .help("choose the direction and the setup that belong to the image"))
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

fn wrong_target(to: &Path, problem: &str) -> InputError {
    InputError::new(to, problem).help("give --out the extension .png, .tif or .exr that fits the image")
}
