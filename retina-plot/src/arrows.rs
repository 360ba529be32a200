//! Arrows over a plane, with a key: one of a round length and its value.

use crate::axis::{decimal, nice_step};
use crate::draw::Map;
use crate::panel::Style;
use crate::svg::Svg;

/// Length of an arrow of the reference value, px.
const REFERENCE_PX: f64 = 28.0;
/// Heads are so long at most, and no longer than this part of their arrow.
const HEAD_PX: f64 = 5.0;
const HEAD_PART: f64 = 0.45;
/// The reference is the length that this share of the arrows does not exceed.
const REFERENCE_SHARE: f64 = 0.95;

/// Vectors at places. Their lengths are in a unit of their own, alike in all directions; they point where the axes grow.
#[derive(Debug, Clone, PartialEq)]
pub struct Arrows {
    pub(crate) at: Vec<[f64; 2]>,
    values: Vec<[f64; 2]>,
    reference: f64,
    unit: String,
    pub(crate) style: Style,
}

impl Arrows {
    /// Vectors `values` at places `at`, drawn so that most of them do not cover each other.
    pub fn new(at: Vec<[f64; 2]>, values: Vec<[f64; 2]>, unit: impl Into<String>, style: Style) -> Self {
        let mut lengths: Vec<f64> =
            values.iter().map(|v| v[0].hypot(v[1])).filter(|l| l.is_finite()).collect();
        lengths.sort_by(f64::total_cmp);
        let last = lengths.len().saturating_sub(1);
        let reference = lengths.get((REFERENCE_SHARE * last as f64).round() as usize).copied();
        Self { at, values, unit: unit.into(), style, reference: 0.0 }.reference(reference.unwrap_or(1.0))
    }

    /// With another value drawn as long as the reference: figures with the same one can be compared.
    #[must_use]
    pub fn reference(self, value: f64) -> Self {
        let reference = if value.is_finite() && value > 0.0 { value } else { 1.0 };
        Self { reference, ..self }
    }

    /// The value that is drawn as long as the reference.
    pub fn reference_value(&self) -> f64 {
        self.reference
    }

    fn px_per_unit(&self) -> f64 {
        REFERENCE_PX / self.reference
    }

    /// Length of the key, px, and what it stands for.
    pub(crate) fn key(&self) -> (f64, String) {
        let value = nice_step(0.8 * self.reference);
        (value * self.px_per_unit(), format!("{} {}", decimal(value, value), self.unit))
    }

    pub(crate) fn draw(&self, svg: &mut Svg, map: &Map<'_>) {
        let scale = self.px_per_unit();
        let ways = map.ways();
        let shafts: Vec<[[f64; 2]; 2]> = self
            .at
            .iter()
            .zip(&self.values)
            .filter(|(_, v)| v[0].is_finite() && v[1].is_finite())
            .filter_map(|(&at, v)| {
                let from = map.point(at)?;
                Some([from, [from[0] + ways[0] * scale * v[0], from[1] + ways[1] * scale * v[1]]])
            })
            .collect();
        draw_arrows(svg, &shafts, self.style);
    }
}

/// Shafts with heads at their ends.
pub(crate) fn draw_arrows(svg: &mut Svg, shafts: &[[[f64; 2]; 2]], style: Style) {
    svg.segments(shafts, style.colour, style.width);
    let heads: Vec<[[f64; 2]; 3]> = shafts
        .iter()
        .filter_map(|&[from, to]| {
            let along = [to[0] - from[0], to[1] - from[1]];
            let length = along[0].hypot(along[1]);
            let head = HEAD_PX.min(HEAD_PART * length);
            (length > 0.5).then(|| {
                let [ux, uy] = [along[0] / length, along[1] / length];
                let back = [to[0] - head * ux, to[1] - head * uy];
                let side = 0.4 * head;
                [to, [back[0] - side * uy, back[1] + side * ux], [back[0] + side * uy, back[1] - side * ux]]
            })
        })
        .collect();
    svg.triangles(&heads, style.colour);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axis, Figure, PALETTE, Panel};

    /// Lengths of the strokes of all arrows in a drawing, in the order they are drawn.
    fn lengths(svg: &str, colour: &str) -> Vec<f64> {
        let mut out = Vec::new();
        for line in svg.lines().filter(|l| l.contains("class=\"segments\"") && l.contains(colour)) {
            let d = line.split("d=\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap_or_default();
            for stroke in d.split('M').skip(1) {
                let numbers: Vec<f64> =
                    stroke.split(['L', ' ']).map(|text| text.parse::<f64>().unwrap()).collect();
                out.push((numbers[2] - numbers[0]).hypot(numbers[3] - numbers[1]));
            }
        }
        out
    }

    /// The key's arrow is as long for its value as those of the data are for theirs, on any axes.
    #[test]
    fn the_key_has_the_scale_of_the_arrows() {
        let colour = PALETTE[0].to_string();
        for size in [0.037, 1.0, 260.0] {
            let values = vec![[3.0 * size, 4.0 * size], [0.0, -2.0 * size], [1.5 * size, 0.0]];
            let at = vec![[0.0, 0.0], [50.0, 0.4], [100.0, 0.8]];
            let arrows = Arrows::new(at, values, "arcsec", Style::line(PALETTE[0]));
            let mut panel = Panel::new(Axis::linear("x"), Axis::linear("y").reversed());
            panel.arrows(arrows);
            let mut figure = Figure::new("", 1, 1, [400.0, 300.0]);
            figure.put(0, 0, panel);
            let svg = figure.to_svg();
            let key = svg.split(" arcsec<").next().and_then(|before| before.rsplit('>').next()).unwrap();
            let value: f64 = key.parse().unwrap();
            let [a, b, c, drawn]: [f64; 4] = lengths(&svg, &colour).try_into().unwrap();
            // Two decimals of a px.
            for (length, of) in [(a, 5.0 * size), (b, 2.0 * size), (c, 1.5 * size)] {
                assert!(
                    (length / of - drawn / value).abs() < 0.03 / of.min(value),
                    "{key}: {length} {drawn}"
                );
            }
            assert!((15.0..60.0).contains(&drawn), "{drawn}");
        }
    }
}
