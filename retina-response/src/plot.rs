//! Figures 6 and 7 of the paper, of this facility.

use retina_formats::Channel;
use retina_plot::{Anchor, Axis, Colour, Figure, PALETTE, Panel, Style};
use retina_report::{Page, Section};

use crate::Calibrated;

const PANEL_PX: [f64; 2] = [400.0, 310.0];
/// Half length of an error bar.
const ERROR_SIGMAS: f64 = 1.0;

fn colour(channel: Channel) -> Colour {
    match channel {
        Channel::R => PALETTE[1],
        Channel::G => PALETTE[2],
        Channel::B => PALETTE[0],
        Channel::W => Colour::INK,
    }
}

/// Two SVG figures: a pixel's irradiance against count for each channel with readings and error bars
/// (Fig. 6), and effective irradiance and magnitude at equal counts (Fig. 7).
pub fn figures(calibrated: &Calibrated) -> [String; 2] {
    [channels(calibrated), magnitudes(calibrated)].map(|figure| figure.to_svg())
}

fn channels(calibrated: &Calibrated) -> Figure {
    let lowest = calibrated.fits.iter().map(|fit| fit.irradiance_w_m2[1]).fold(f64::MAX, f64::min);
    let highest = calibrated.fits.iter().map(|fit| fit.full_w_m2.value).fold(0.0, f64::max);
    let mut panel = Panel::new(
        Axis::linear("digital count B").range(0.0, 255.0),
        Axis::log("irradiance of a pixel (W m\u{207b}\u{b2})").range(lowest, 2.0 * highest),
    )
    .title(format!("Response of {}", calibrated.calibration.setup));
    for fit in &calibrated.fits {
        let ink = colour(fit.channel);
        let curve: Vec<[f64; 2]> = (1..256).map(|b| [b as f64, fit.irradiance_w_m2[b]]).collect();
        panel.line(fit.channel.name(), &curve, Style::line(ink));
        for &(count, light, sigma) in &fit.measured {
            let x = count as f64;
            let (low, high) = (light - ERROR_SIGMAS * sigma, light + ERROR_SIGMAS * sigma);
            panel.line("", &[[x, low.max(0.1 * lowest)], [x, high]], Style::thin(ink));
        }
        let dots: Vec<[f64; 2]> =
            fit.measured.iter().map(|&(count, light, _)| [count as f64, light]).collect();
        panel.dots("", &dots, Style::line(ink).width(1.6));
    }
    let mut figure = Figure::new("", 1, 1, PANEL_PX);
    figure.put(0, 0, panel);
    figure
}

fn magnitudes(calibrated: &Calibrated) -> Figure {
    let calibration = &calibrated.calibration;
    let range = calibration.magnitude_range();
    let grey =
        |f: &dyn Fn([u8; 3]) -> f64| (1..=255u8).map(|b| [f64::from(b), f([b; 3])]).collect::<Vec<_>>();
    let count = || Axis::linear("digital count B").range(0.0, 255.0);
    let mut light =
        Panel::new(count(), Axis::log("effective irradiance (W m\u{207b}\u{b2})")).title("Eq. 10");
    light.line("", &grey(&|c| calibration.effective_w_m2(c)), Style::line(PALETTE[0]));
    let mut magnitude = Panel::new(count(), Axis::linear("magnitude"))
        .title(format!("Magnitudes {:.2} to {:.2}", range.brightest, range.faintest));
    let sigma = |c| calibration.magnitude_sigma(c);
    let known = |points: Vec<[f64; 2]>| -> Vec<[f64; 2]> {
        points.into_iter().skip(usize::from(range.faintest_count) - 1).collect()
    };
    let low = known(grey(&|c| calibration.magnitude(c) - sigma(c)));
    let high = known(grey(&|c| calibration.magnitude(c) + sigma(c)));
    magnitude.band("one sigma", &low, &high, Style::thin(PALETTE[4]).filled(0.4));
    magnitude.line("equal counts", &grey(&|c| calibration.magnitude(c)), Style::line(PALETTE[0]));
    let faintest = [f64::from(range.faintest_count), range.faintest];
    magnitude.dots("", &[faintest], Style::line(PALETTE[1]).width(3.0));
    magnitude.text(faintest, [8.0, 3.0], "faintest", 9.0, Anchor::Start);
    let mut figure = Figure::new("", 1, 2, PANEL_PX);
    figure.put(0, 0, light);
    figure.put(0, 1, magnitude);
    figure
}

/// One page with both figures and the text of the summary.
pub fn report_page(calibrated: &Calibrated, summary: &[String]) -> Page {
    let warnings: Vec<String> = calibrated
        .fits
        .iter()
        .flat_map(|fit| fit.warnings.iter().map(|text| format!("{}: {text}", fit.channel.name())))
        .collect();
    let files = calibrated.readings.files.iter().map(|file| (file.path.as_path(), file.blake3.as_str()));
    Page::new(
        "calibrate radiometry",
        &format!("Radiometric calibration of {}", calibrated.calibration.setup),
    )
    .section(Section::new("").lines(summary).list(&warnings))
    .section(Section::new("Response of the channels").figures(
        &channels(calibrated).panel_svgs(),
        "Irradiance of one pixel at the camera's pupil against its digital count: the fit, and the readings with one \
         standard deviation (the paper's Fig. 6).",
    ))
    .section(Section::new("Effective irradiance and magnitude").figures(
        &magnitudes(calibrated).panel_svgs(),
        "At equal counts of the three channels, weighted by the camera's relative efficiency (eqs. 7, 9, 10; the \
         paper's Fig. 7).",
    ))
    .section(Section::new("Readings").files(files))
}
