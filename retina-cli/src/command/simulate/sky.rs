//! `retina simulate sky`.

use std::path::{Path, PathBuf};

use retina_campaign::{SkyObject, SkyOptions, Spot, compare_with_sky, sky_page};
use retina_files::InputError;
use retina_formats::{Calibration, TableKind};
use serde_json::{Value, json};

use super::{Common, positive};
use crate::failure::Failure;
use crate::output::tell;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    common: Common,
    /// Calibration of the facility [default: none, and nothing is compensated].
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Object in the sky: name, magnitude and, unless it is a star, diameter. Repeat the flag for
    /// more.
    ///
    /// [default: Jupiter:-2.26:40 and stars of 0.5 and 2.5 mag]
    #[arg(long = "object", value_name = "NAME:MAG[:ARCSEC]")]
    objects: Vec<String>,
    /// Exposure time, s [default: the brightest object's peak in the sky at 80 % of the full well].
    #[arg(long)]
    exposure_s: Option<f64>,
    /// Atmospheric extinction at the zenith, mag.
    #[arg(long, default_value_t = 0.25)]
    extinction_mag: f64,
    /// Air mass towards the objects.
    #[arg(long, default_value_t = 2.5)]
    airmass: f64,
    /// Brightness of the sky background, mag per square arcsec.
    #[arg(long, default_value_t = 19.5)]
    background_mag_arcsec2: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut options = SkyOptions {
        exposure_s: arguments.exposure_s.map(|value| positive("--exposure-s", value)).transpose()?,
        extinction_mag: not_negative("--extinction-mag", arguments.extinction_mag)?,
        airmass: not_negative("--airmass", arguments.airmass)?,
        background_mag_arcsec2: finite("--background-mag-arcsec2", arguments.background_mag_arcsec2)?,
        ..SkyOptions::default()
    };
    if !arguments.objects.is_empty() {
        options.objects = arguments.objects.iter().map(|text| object(text)).collect::<Result<_, _>>()?;
    }
    if options.objects.len() > 12 {
        return Err(InputError::new(Path::new("--object"), "is given too many times")
            .found(options.objects.len())
            .expected("at most 12 objects")
            .into());
    }
    let common = &arguments.common;
    let facility = common.facility(TableKind::Frames, f64::MAX)?;
    let calibration =
        arguments.calibration.as_deref().map(|path| Calibration::read(path, &facility.setup)).transpose()?;
    let result = compare_with_sky(&facility, calibration.as_ref(), &options)?;
    common.make_folder()?;
    for (name, image) in [("bench.png", &result.bench), ("sky.png", &result.sky)] {
        image.write_png(&common.out.join(name))?;
    }
    sky_page(&result, &options, &facility).write(&common.out.join("sky.html"))?;
    for c in &result.comparisons {
        tell!(
            "{}: {:.2} mag, displayed as {:.2}; {:+.2} mag brighter than in the sky; half of the light within {:.2} px \
             (sky {:.2}); visible in {} px (sky {})",
            c.object.name,
            c.object.magnitude,
            c.displayed_magnitude,
            2.5 * (c.bench.electrons / c.sky.electrons).log10(),
            c.bench.half_light_px,
            c.sky.half_light_px,
            c.seen_px[0],
            c.seen_px[1]
        );
    }
    let spot = |spot: &Spot| json!({"electrons": spot.electrons, "peak_e": spot.peak_e, "half_light_px": spot.half_light_px});
    let objects: Vec<Value> = result
        .comparisons
        .iter()
        .map(|c| {
            json!({
                "name": c.object.name,
                "magnitude": c.object.magnitude,
                "diameter_arcsec": c.object.diameter_arcsec,
                "displayed_magnitude": c.displayed_magnitude,
                "lit_pixels": c.lit_pixels,
                "camera_px": [c.at_px.x, c.at_px.y],
                "above_the_atmosphere": spot(&c.space),
                "sky": spot(&c.sky),
                "ideal_facility": spot(&c.ideal_facility),
                "bench": spot(&c.bench),
                "seen_px": {"bench": c.seen_px[0], "sky": c.seen_px[1]},
            })
        })
        .collect();
    let summary = json!({
        "exposure_s": result.exposure_s, "background_e": result.background_e, "objects": objects
    });
    common.finish("sky", &facility, summary)
}

fn finite(flag: &str, value: f64) -> Result<f64, Failure> {
    if value.is_finite() {
        return Ok(value);
    }
    Err(InputError::new(Path::new(flag), "is not a number").found(value).into())
}

fn not_negative(flag: &str, value: f64) -> Result<f64, Failure> {
    if value >= 0.0 {
        return finite(flag, value);
    }
    Err(InputError::new(Path::new(flag), "is negative").found(value).expected("0 or more").into())
}

/// NAME:MAG or NAME:MAG:ARCSEC.
fn object(text: &str) -> Result<SkyObject, Failure> {
    let wrong = || {
        InputError::new(Path::new("--object"), "is not understood")
            .found(format!("`{text}`"))
            .expected("a name, a magnitude and, if it is no star, a diameter in arcsec: Mars:-1.2:12")
    };
    let mut parts = text.split(':');
    let (name, magnitude) = parts.next().zip(parts.next()).ok_or_else(wrong)?;
    let diameter = parts.next().unwrap_or("0");
    let number = |text: &str| text.parse::<f64>().ok().filter(|value| value.is_finite());
    let (magnitude, diameter_arcsec) = number(magnitude).zip(number(diameter)).ok_or_else(wrong)?;
    // A disc wider than a cut-out is a body, for `retina render`.
    if parts.next().is_some() || name.is_empty() || !(0.0..=300.0).contains(&diameter_arcsec) {
        return Err(wrong().into());
    }
    Ok(SkyObject { name: name.to_owned(), magnitude, diameter_arcsec })
}
