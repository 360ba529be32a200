//! Predicted, measured, and what is left, side by side.

use retina_plot::{Axis, ColourMap, Figure, HeatMap, Panel};

use crate::FrameSet;
use crate::model::State;

/// Cells across a picture: more are not seen on a page.
const MOST_ACROSS: usize = 160;
/// The column of what was measured.
const MEASURED: usize = 1;
/// Images that are drawn.
const MOST_IMAGES: usize = 3;

/// What [`FrameSet::pictures`] shows, in words.
pub const PICTURES_CAPTION: &str = "One row for each state, from the baseline on. The best prediction has all the usual \
    effects: map, relief, law, blur, glare, response. With the formulas stands the whole model of an investigation. In \
    the errors, purple is darker than predicted and orange is \
    brighter; white pixels do not count. The errors of all states share one scale.";

/// What is predicted of an image, and measured less that: one value for each bin of its window.
struct Shown {
    label: String,
    predicted: Vec<f64>,
    error: Vec<f64>,
}

impl FrameSet {
    /// A figure as SVG: for each image a row a state (the baseline, then with each effect, or the best prediction where
    /// nothing was added), errors on one scale of
    /// colours (purple: measured is darker, orange: brighter). Pixels that do not count are white among the errors.
    pub fn pictures(&self) -> String {
        // Beside a baseline alone stands what could be reached.
        let best = self.best.as_ref().filter(|_| self.history.len() == 1);
        let best = best.map(|state| ("best prediction", state));
        let states: Vec<(&str, &State)> =
            self.history.iter().map(|(label, state)| (label.as_str(), state)).chain(best).collect();
        self.figure(|frame| states.iter().map(|(label, state)| self.of_state(frame, label, state)).collect())
    }

    /// The same for a model that was fitted to the pixels of [`FrameSet::dataset`], which begins at the present state:
    /// `left_dn` is what it leaves of each.
    pub fn pictures_of_fit(&self, label: &str, left_dn: &[f64]) -> String {
        let states = &self.history;
        self.figure(|frame| {
            let of = |(label, state): &(String, State)| self.of_state(frame, label, state);
            states.iter().map(of).chain([self.of_fit(frame, label, left_dn)]).collect()
        })
    }

    fn figure(&self, states: impl Fn(usize) -> Vec<Shown>) -> String {
        let all: Vec<Vec<Shown>> = (0..self.sights.len().min(MOST_IMAGES)).map(states).collect();
        let rows = all.iter().map(Vec::len).sum();
        let mut figure = Figure::new("predicted, measured, left", rows, 3, [330.0, 300.0]);
        let mut row = 0;
        for (frame, states) in all.iter().enumerate() {
            // The baseline's errors set the scale of all, but for the largest hundredth.
            let mut sizes: Vec<f64> =
                states[0].error.iter().map(|e| e.abs()).filter(|e| e.is_finite()).collect();
            sizes.sort_by(f64::total_cmp);
            let most = sizes.get(sizes.len() * 99 / 100).copied().unwrap_or(1.0).max(1e-6);
            for (step, shown) in states.iter().enumerate() {
                let panels = self.panels(frame, shown, most).into_iter().enumerate();
                // What was measured is the same beside every state.
                for (column, panel) in panels.filter(|(column, _)| *column != MEASURED || step == 0) {
                    figure.put(row, column, panel);
                }
                row += 1;
            }
        }
        figure.to_svg()
    }

    fn of_state(&self, frame: usize, label: &str, state: &State) -> Shown {
        let (sight, bins) = (&self.sights[frame], &self.bins[frame]);
        let predicted = sight.detected(frame, state, &sight.light(frame, state));
        let error = |at: usize| if bins.valid[at] { bins.values[at] - predicted[at] } else { f64::NAN };
        let error = (0..predicted.len()).map(error).collect();
        Shown { label: label.to_owned(), predicted, error }
    }

    /// Where pixels do not count, the present state is drawn.
    fn of_fit(&self, frame: usize, label: &str, left_dn: &[f64]) -> Shown {
        let mut shown = self.of_state(frame, label, &self.state);
        shown.error.fill(f64::NAN);
        for (&(of, bin), left) in self.rows.bins.iter().zip(left_dn).filter(|((of, _), _)| *of == frame) {
            shown.error[bin] = *left;
            shown.predicted[bin] = self.bins[of].values[bin] - left;
        }
        shown
    }

    fn panels(&self, frame: usize, shown: &Shown, most: f64) -> [Panel; 3] {
        let (name, label, measured) = (&self.names[frame], &shown.label, &self.bins[frame].values);
        let brightest = measured.iter().copied().fold(1e-6, f64::max);
        let grey =
            |title: &str, values: &[f64]| self.panel(frame, title, values, [0.0, brightest], ColourMap::Grey);
        [
            grey(&format!("{label}: predicted"), &shown.predicted),
            grey(&format!("{name}: measured"), measured),
            self.panel(frame, "measured - predicted", &shown.error, [-most, most], ColourMap::Diverging),
        ]
    }

    fn panel(&self, frame: usize, title: &str, values: &[f64], range: [f64; 2], colours: ColourMap) -> Panel {
        let window = &self.sights[frame].window;
        let stride = window.columns.max(window.rows).div_ceil(MOST_ACROSS).max(1);
        let (columns, rows) = (window.columns / stride, window.rows / stride);
        let mut drawn = Vec::with_capacity(columns * rows);
        // Rows run downwards in an image: the axis is that of -y, from the bottom.
        for y in (0..rows).rev() {
            for x in 0..columns {
                let cells = (0..stride * stride)
                    .map(|k| values[(y * stride + k / stride) * window.columns + x * stride + k % stride]);
                let known: Vec<f64> = cells.filter(|v| v.is_finite()).collect();
                let mean = known.iter().sum::<f64>() / known.len() as f64;
                drawn.push(if known.is_empty() { f64::NAN } else { mean });
            }
        }
        let pitch = (stride * window.bin) as f64;
        let mut panel = Panel::new(Axis::linear("x (px)"), Axis::linear("-y (px)"))
            .title(title.to_owned())
            .equal_aspect();
        panel.picture(
            HeatMap {
                origin: [
                    window.left as f64 + 0.5 * pitch,
                    0.5 * pitch - window.top as f64 - rows as f64 * pitch,
                ],
                pitch: [pitch, pitch],
                columns,
                values: drawn,
                range,
                label: "DN".to_owned(),
            },
            colours,
        );
        panel
    }
}
