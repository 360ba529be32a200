//! Figures of the experiment.

use retina_plot::{Axis, Colour, Figure, PALETTE, Panel, Style};

use super::report::Watched;

fn colour(at: usize) -> Colour {
    PALETTE[at % PALETTE.len()]
}

/// Points of a curve.
const CURVE: usize = 200;

/// Detection rate against magnitude with Wilson's intervals and the fitted curve; errors of magnitude and of place.
pub fn figure_rates(sequences: &[Watched]) -> String {
    let mut figure = Figure::new("", 1, 3, [360.0, 280.0]);
    let magnitudes = || {
        let bins = sequences.iter().flat_map(|sequence| &sequence.summary.rates);
        bins.flat_map(|bin| bin.magnitudes)
    };
    let low = magnitudes().fold(f64::INFINITY, f64::min);
    let high = magnitudes().fold(f64::NEG_INFINITY, f64::max);
    let (low, high) = if low < high { (low, high) } else { (0.0, 1.0) };
    let x = || Axis::linear("magnitude, mean over the exposure").range(low, high);
    let mut rate = Panel::new(x(), Axis::linear("detection rate").range(0.0, 1.05));
    let mut error = Panel::new(x(), Axis::linear("measured less true magnitude"));
    let mut place = Panel::new(x(), Axis::linear("error of the place (km)"));
    for (at, sequence) in sequences.iter().enumerate() {
        let style = Style::line(colour(at));
        let bins = &sequence.summary.rates;
        let middle = |bin: &super::RateBin| 0.5 * (bin.magnitudes[0] + bin.magnitudes[1]);
        let points: Vec<[f64; 2]> = bins.iter().map(|bin| [middle(bin), bin.rate]).collect();
        rate.dots(&sequence.label, &points, style);
        for bin in bins {
            let bar = bin.interval.map(|edge| [middle(bin), edge]);
            rate.line("", &bar, Style::thin(colour(at)));
        }
        if let Some(logistic) = &sequence.summary.logistic {
            let curve: Vec<[f64; 2]> = (0..=CURVE)
                .map(|k| {
                    let m = low + (high - low) * k as f64 / CURVE as f64;
                    [m, logistic.rate(m)]
                })
                .collect();
            rate.line("", &curve, style);
        }
        let found = || sequence.frames.iter().flat_map(|frame| &frame.flashes).filter(|flash| flash.watched);
        let dots = |value: &dyn Fn(&super::FlashOutcome) -> Option<f64>| -> Vec<[f64; 2]> {
            found().filter_map(|flash| Some([flash.magnitude, value(flash)?])).collect()
        };
        error.dots("", &dots(&|flash| flash.error_magnitude), style);
        place.dots("", &dots(&|flash| flash.error_m.map(|m| m * 1e-3)), style);
    }
    figure.put(0, 0, rate);
    figure.put(0, 1, error);
    figure.put(0, 2, place);
    figure.to_svg()
}
