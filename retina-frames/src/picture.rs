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
    effects: map, relief, law, blur, glare, response. In the errors, purple is darker than predicted and orange is \
    brighter; white pixels do not count. The errors of all states share one scale.";

impl FrameSet {
    /// A figure as SVG: for each image a row a state (the baseline, then with each effect, or the best prediction where
    /// nothing was added), errors on one scale of
    /// colours (purple: measured is darker, orange: brighter). Pixels that do not count are white among the errors.
    pub fn pictures(&self) -> String {
        let images = self.sights.len().min(MOST_IMAGES);
        // Beside a baseline alone stands what could be reached.
        let best = self.best.as_ref().filter(|_| self.history.len() == 1);
        let best = best.map(|state| ("best prediction", state));
        let states: Vec<(&str, &State)> =
            self.history.iter().map(|(label, state)| (label.as_str(), state)).chain(best).collect();
        let mut figure = Figure::new("predicted, measured, left", images * states.len(), 3, [330.0, 300.0]);
        for frame in 0..images {
            for (step, &(label, state)) in states.iter().enumerate() {
                let row = frame * states.len() + step;
                let panels = self.panels(frame, label, state).into_iter().enumerate();
                // What was measured is the same beside every state.
                for (column, panel) in panels.filter(|(column, _)| *column != MEASURED || step == 0) {
                    figure.put(row, column, panel);
                }
            }
        }
        figure.to_svg()
    }

    fn panels(&self, frame: usize, label: &str, state: &State) -> [Panel; 3] {
        let sight = &self.sights[frame];
        let of = |state: &State| sight.detected(frame, state, &sight.light(frame, state));
        let (predicted, bins) = (of(state), &self.bins[frame]);
        let errors: Vec<f64> = (0..predicted.len())
            .map(|at| if bins.valid[at] { bins.values[at] - predicted[at] } else { f64::NAN })
            .collect();
        let mut sizes: Vec<f64> = {
            let first = of(&self.history[0].1);
            (0..first.len())
                .filter(|&at| bins.valid[at])
                .map(|at| (bins.values[at] - first[at]).abs())
                .collect()
        };
        sizes.sort_by(f64::total_cmp);
        // The baseline's errors set the scale of all, but for the largest hundredth.
        let most = sizes.get(sizes.len() * 99 / 100).copied().unwrap_or(1.0).max(1e-6);
        let brightest = bins.values.iter().copied().fold(1e-6, f64::max);
        let name = &self.names[frame];
        [
            self.panel(frame, &format!("{label}: predicted"), &predicted, [0.0, brightest], ColourMap::Grey),
            self.panel(frame, &format!("{name}: measured"), &bins.values, [0.0, brightest], ColourMap::Grey),
            self.panel(frame, "measured - predicted", &errors, [-most, most], ColourMap::Diverging),
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
