//! Axes: range, ticks, labels.

/// How an axis is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scale {
    Linear,
    Log,
}

/// An axis: label with unit, scale, range.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    pub(crate) label: String,
    scale: Scale,
    range: Option<[f64; 2]>,
    pub(crate) hidden: bool,
}

impl Axis {
    /// A linear axis; the range is that of the data unless it is given.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Linear, range: None, hidden: false }
    }

    /// A logarithmic axis; data that are not positive are left out.
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Log, range: None, hidden: false }
    }

    /// Neither line, ticks nor grid.
    pub fn hidden() -> Self {
        Self { label: String::new(), scale: Scale::Linear, range: None, hidden: true }
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
            Scale::Linear => value.is_finite().then_some(value),
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

    /// Ticks in axis coordinates with their labels.
    pub(crate) fn ticks(&self, span: [f64; 2], count: f64) -> Vec<(f64, String)> {
        let [low, high] = span;
        if self.scale == Scale::Log && high - low > 0.9 {
            let every = ((high - low) / count).ceil().max(1.0) as i64;
            return (low.ceil() as i64..=high.floor() as i64)
                .filter(|decade| decade.rem_euclid(every) == 0)
                .map(|decade| (decade as f64, decade_label(decade)))
                .collect();
        }
        let (to_value, step) = match self.scale {
            Scale::Linear => (false, nice_step((high - low) / count)),
            Scale::Log => (true, nice_step((10f64.powf(high) - 10f64.powf(low)) / count)),
        };
        let value = |place: f64| if to_value { 10f64.powf(place) } else { place };
        let first = (value(low) / step - 1e-9).ceil() as i64;
        let last = (value(high) / step + 1e-9).floor() as i64;
        (first..=last)
            .filter_map(|i| Some((self.place(i as f64 * step)?, tick_label(i as f64 * step, step))))
            .collect()
    }
}

/// 1, 2 or 5 times a power of ten, at least `rough`.
fn nice_step(rough: f64) -> f64 {
    let power = 10f64.powf(rough.log10().floor());
    let leading = rough / power;
    let nice = [1.0, 2.0, 5.0, 10.0].into_iter().find(|&n| leading <= n * (1.0 + 1e-9)).unwrap_or(10.0);
    nice * power
}

fn decade_label(decade: i64) -> String {
    if (-3..=4).contains(&decade) {
        tick_label(10f64.powi(decade as i32), 10f64.powi(decade as i32))
    } else {
        format!("1e{decade}")
    }
}

/// A number with the decimals that the step needs, and a proper minus sign.
fn tick_label(value: f64, step: f64) -> String {
    let text = if value != 0.0 && (value.abs() >= 1e6 || step < 1e-5) {
        format!("{value:.1e}")
    } else {
        let decimals = (-(step.log10() + 1e-9).floor()).clamp(0.0, 6.0) as usize;
        format!("{value:.decimals$}")
    };
    let text = if text.trim_start_matches(['-', '0', '.']).is_empty() { text.replace('-', "") } else { text };
    text.replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis, span: [f64; 2]) -> Vec<String> {
        axis.ticks(span, 5.0).into_iter().map(|(_, label)| label).collect()
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
}
