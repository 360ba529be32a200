//! Axes: range, ticks, labels.

/// How an axis is divided.
#[derive(Debug, Clone, PartialEq)]
enum Scale {
    Linear,
    Log,
    /// Names at 0, 1, 2, ...
    Named(Vec<String>),
}

/// Ticks of an axis.
pub(crate) struct Ticks {
    /// Places in axis coordinates, with what is written there.
    pub(crate) places: Vec<(f64, String)>,
    /// The axis's label, with the offset and the power of ten that the ticks leave to it.
    pub(crate) label: String,
}

/// An axis: label with unit, scale, range.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    pub(crate) label: String,
    scale: Scale,
    range: Option<[f64; 2]>,
    pub(crate) hidden: bool,
    /// Whether values grow to the left, or downwards.
    pub(crate) reversed: bool,
}

impl Axis {
    /// A linear axis; the range is that of the data unless it is given.
    pub fn linear(label: impl Into<String>) -> Self {
        Self::of(label.into(), Scale::Linear)
    }

    /// A logarithmic axis; data that are not positive are left out.
    pub fn log(label: impl Into<String>) -> Self {
        Self::of(label.into(), Scale::Log)
    }

    /// An axis of things: each has its name at 0, 1, 2, ...
    pub fn named(names: Vec<String>) -> Self {
        let range = [-0.5, names.len().max(1) as f64 - 0.5];
        Self { range: Some(range), ..Self::of(String::new(), Scale::Named(names)) }
    }

    fn of(label: String, scale: Scale) -> Self {
        Self { label, scale, range: None, hidden: false, reversed: false }
    }

    /// Neither line, ticks nor grid.
    pub fn hidden() -> Self {
        Self { hidden: true, ..Self::linear("") }
    }

    /// Values grow downwards (y), as pixels do, or to the left (x).
    pub fn reversed(mut self) -> Self {
        self.reversed = true;
        self
    }

    /// With this range.
    pub fn range(mut self, low: f64, high: f64) -> Self {
        self.range = Some([low, high]);
        self
    }

    /// Whether the range was given.
    pub(crate) fn is_given(&self) -> bool {
        self.range.is_some()
    }

    /// Data to axis coordinate; `None` where the axis has no place for it.
    pub(crate) fn place(&self, value: f64) -> Option<f64> {
        match self.scale {
            Scale::Linear | Scale::Named(_) => value.is_finite().then_some(value),
            Scale::Log => (value > 0.0 && value.is_finite()).then(|| value.log10()),
        }
    }

    /// The span in axis coordinates, from the data unless given; never empty.
    pub(crate) fn span(&self, data: impl Iterator<Item = f64>) -> [f64; 2] {
        if let Some([low, high]) = self.range
            && let (Some(low), Some(high)) = (self.place(low), self.place(high))
            && low < high
        {
            return [low, high];
        }
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in data.filter_map(|value| self.place(value)) {
            (low, high) = (low.min(value), high.max(value));
        }
        match (low.is_finite(), high - low) {
            (false, _) => [0.0, 1.0],
            (true, width) if width <= 1e-12 * high.abs() => [low - 0.5, high + 0.5],
            (true, width) => [low - 0.04 * width, high + 0.04 * width],
        }
    }

    /// Ticks over a span of axis coordinates, about `count` of them and at least two where numbers allow it.
    pub(crate) fn ticks(&self, span: [f64; 2], count: f64) -> Ticks {
        let [low, high] = span;
        match &self.scale {
            Scale::Named(names) => {
                let places = names.iter().enumerate().map(|(k, name)| (k as f64, name.clone()));
                let places = places.filter(|(place, _)| (low..=high).contains(place)).collect();
                Ticks { places, label: self.label.clone() }
            }
            Scale::Log if high - low > DECADES_FOR_POWERS => {
                Ticks { places: decades(span, count), label: self.label.clone() }
            }
            Scale::Log => {
                let values = steps([10f64.powf(low), 10f64.powf(high)], count);
                let mut ticks = written(&self.label, &values);
                ticks.places.iter_mut().for_each(|(place, _)| *place = place.log10());
                ticks
            }
            Scale::Linear => written(&self.label, &steps(span, count)),
        }
    }
}

/// A logarithmic axis longer than this has ticks at powers of ten, a shorter one at round steps.
const DECADES_FOR_POWERS: f64 = 0.9;
/// Up to this length it has them at 2 and 5 as well.
const DECADES_WITH_2_AND_5: f64 = 2.2;

fn decades([low, high]: [f64; 2], count: f64) -> Vec<(f64, String)> {
    let every = ((high - low) / count).ceil().min(((high - low) / 2.0).floor()).max(1.0) as i64;
    let leading: &[f64] = if high - low <= DECADES_WITH_2_AND_5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    (low.floor() as i64..=high.floor() as i64)
        .filter(|decade| decade.rem_euclid(every) == 0)
        .flat_map(|decade| leading.iter().map(move |&leading| (decade, leading)))
        .map(|(decade, leading)| (decade as f64 + leading.log10(), power_label(leading, decade)))
        .filter(|(place, _)| (low..=high).contains(place))
        .collect()
}

/// Multiples of a round step.
struct Steps {
    step: f64,
    values: Vec<f64>,
}

/// Fewest ticks on an axis: two tell a scale, three that it is even.
const FEWEST: usize = 3;

fn steps([low, high]: [f64; 2], count: f64) -> Steps {
    let mut step = nice_step((high - low) / count);
    loop {
        let first = (low / step - 1e-9).ceil();
        let last = (high / step + 1e-9).floor();
        if last - first + 1.0 >= FEWEST as f64 || step <= (high - low) / (2.0 * count) {
            let number = (last - first).max(-1.0) as usize;
            // A product, not a sum: the tick at zero is zero.
            let values = (0..number.saturating_add(1)).map(|i| (first + i as f64) * step).collect();
            return Steps { step, values };
        }
        step = nice_step(0.4 * step);
    }
}

/// Ticks whose size is so many times their step would be all digits: an offset goes into the label.
const OFFSET_FROM: f64 = 1e5;
/// Ticks are written plainly between these sizes; else a power of ten goes into the label.
const PLAIN: [f64; 2] = [1e-3, 1e5];

/// Values with the digits that tell them apart; what they share goes into the label.
fn written(label: &str, Steps { step, values }: &Steps) -> Ticks {
    let largest = |offset: f64| values.iter().map(|v| (v - offset).abs()).fold(0.0, f64::max);
    let extent = values.last().zip(values.first()).map_or(0.0, |(last, first)| last - first);
    let mut offset = 0.0;
    let mut text = label.to_owned();
    if largest(0.0) >= OFFSET_FROM * step && extent > 0.0 {
        let round = 10f64.powf(extent.log10().ceil() + 1.0);
        offset = (values[0] / round).floor() * round;
        if offset != 0.0 {
            let sign = if offset < 0.0 { '+' } else { '\u{2212}' };
            text = format!("{text} {sign} {}", decimal(offset.abs(), round));
        }
    }
    let size = largest(offset);
    let mut factor = 1.0;
    if size > 0.0 && !(PLAIN[0]..PLAIN[1]).contains(&size) {
        let exponent = 3 * (size.log10() / 3.0).floor() as i32;
        factor = 10f64.powi(exponent);
        let power = minus(&format!("1e{exponent}"));
        // "irradiance (W/m^2)" becomes "irradiance (1e-9 W/m^2)".
        text = match text.rfind('(') {
            Some(at) if text.ends_with(')') => format!("{}({power} {}", &text[..at], &text[at + 1..]),
            _ => format!("{text} ({power})"),
        };
    }
    let places =
        values.iter().map(|&value| (value, decimal((value - offset) / factor, step / factor))).collect();
    Ticks { places, label: text }
}

/// 1, 2 or 5 times a power of ten, at least `rough`.
pub(crate) fn nice_step(rough: f64) -> f64 {
    let power = 10f64.powf(rough.log10().floor());
    let leading = rough / power;
    let nice = [1.0, 2.0, 5.0, 10.0].into_iter().find(|&n| leading <= n * (1.0 + 1e-9)).unwrap_or(10.0);
    nice * power
}

/// A round number times a power of ten.
fn power_label(leading: f64, decade: i64) -> String {
    if (-3..=4).contains(&decade) {
        decimal(leading * 10f64.powi(decade as i32), 10f64.powi(decade as i32))
    } else {
        minus(&format!("{leading:.0}e{decade}"))
    }
}

/// A number with the decimals that the step needs, and a proper minus sign.
pub(crate) fn decimal(value: f64, step: f64) -> String {
    let decimals = (-(step.log10() + 1e-9).floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{value:.decimals$}");
    let is_zero = text.trim_start_matches(['-', '0', '.']).is_empty();
    if is_zero { text.replace('-', "") } else { minus(&text) }
}

fn minus(text: &str) -> String {
    text.replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis, span: [f64; 2]) -> Vec<String> {
        axis.ticks(span, 5.0).places.into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::linear("x");
        assert_eq!(labels(&axis, [0.0, 1.0]), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(&axis, [-3.0, 3.0]), ["\u{2212}2", "0", "2"]);
        assert_eq!(labels(&axis, [0.0, 0.03]), ["0.00", "0.01", "0.02", "0.03"]);
        assert_eq!(labels(&Axis::log("x"), [-2.0, 2.0]), ["0.01", "0.1", "1", "10", "100"]);
    }

    #[test]
    fn spans_are_never_empty_and_logs_drop_what_is_not_positive() {
        assert_eq!(Axis::linear("x").span([2.0, 2.0].into_iter()), [1.5, 2.5]);
        assert_eq!(Axis::linear("x").span(std::iter::empty()), [0.0, 1.0]);
        let [low, high] = Axis::log("x").span([0.0, -1.0, 1.0, 100.0].into_iter());
        assert!((low + 0.08).abs() < 1e-12 && (high - 2.08).abs() < 1e-12);
    }

    /// What is alike in all ticks is said once: seconds of an epoch, and powers of ten.
    #[test]
    fn ticks_that_would_be_all_digits_leave_them_to_the_label() {
        let epoch = Axis::linear("time (s)").ticks([1.7e9, 1.7e9 + 2000.0], 5.0);
        assert_eq!(epoch.label, "time (s) \u{2212} 1700000000");
        let labels: Vec<&str> = epoch.places.iter().map(|(_, label)| label.as_str()).collect();
        assert_eq!(labels, ["0", "500", "1000", "1500", "2000"]);
        let small = Axis::linear("irradiance (W/m^2)").ticks([0.0, 4e-9], 5.0);
        assert_eq!(small.label, "irradiance (1e\u{2212}9 W/m^2)");
        assert_eq!(small.places[1].1, "1");
        let large = Axis::linear("count").ticks([0.0, 3e6], 3.0);
        assert_eq!((large.label.as_str(), large.places[1].1.as_str()), ("count (1e6)", "1"));
        // The place stays that of the value.
        assert!((large.places[1].0 - 1e6).abs() < 1e-6);
    }

    /// However a span lies between round steps, it has enough ticks, none twice.
    #[test]
    fn no_axis_is_without_ticks() {
        for k in 1..200 {
            let (low, width) = (f64::from(k) * 0.37 - 30.0, 10f64.powf(f64::from(k % 17) * 0.25 - 2.0));
            for axis in [Axis::linear("x"), Axis::log("x")] {
                let span = [low, low + width];
                if axis.scale == Scale::Log && (width > 6.0 || low.abs() > 8.0) {
                    continue;
                }
                let ticks = axis.ticks(span, 2.0).places;
                assert!(ticks.len() >= 2, "{span:?} {ticks:?}");
                assert!(ticks.windows(2).all(|pair| pair[0].1 != pair[1].1), "{span:?} {ticks:?}");
            }
        }
    }

    #[test]
    fn short_logs_have_twos_and_fives_and_named_axes_their_names() {
        assert_eq!(labels(&Axis::log("x"), [0.0, 1.5]), ["1", "2", "5", "10", "20"]);
        let named = Axis::named(vec!["a".into(), "b".into()]);
        assert_eq!(labels(&named, named.span(std::iter::empty())), ["a", "b"]);
    }
}
