//! A panel drawn: the room that titles, legends and ticks need, then the plot in what is left.

use crate::arrows::draw_arrows;
use crate::axis::{Axis, Ticks};
use crate::colour::Colour;
use crate::font;
use crate::heat::{bar_room, draw_bar, draw_hatch, draw_heat, draw_picture};
use crate::panel::{Anchor, Item, Mark, Panel, Style};
use crate::svg::Svg;

pub(crate) const TICK_SIZE: f64 = 10.0;
pub(crate) const LABEL_SIZE: f64 = 11.0;
const TITLE_SIZE: f64 = 12.0;
const LEGEND_SIZE: f64 = 10.0;
/// Height of a row of the legend, px.
const LEGEND_ROW: f64 = 15.0;
/// Between a mark and its name, and between entries, px.
const MARK_GAP: f64 = 4.0;
const ENTRY_GAP: f64 = 12.0;

/// Width of a text, px: the fonts that browsers take are about as wide as the crate's own.
pub(crate) fn width(text: &str, size: f64) -> f64 {
    font::width_px(text, size)
}

/// A row of the legend: entries with their left edges.
type LegendRow = Vec<(usize, f64)>;

impl Panel {
    /// Draws the panel into the rectangle x, y, width, height (px).
    pub(crate) fn draw(&self, svg: &mut Svg, frame: [f64; 4]) {
        let [left, top, full_width, height] = frame;
        let mut spans = [self.x.span(self.extent(0)), self.y.span(self.extent(1))];
        let bar = self.bar();
        let right_margin = bar.map_or(14.0, |(map, _)| bar_room(map));
        let bottom_margin = if self.x.hidden { 8.0 } else { 42.0 };
        let title_margin = if self.title.is_empty() { 10.0 } else { 26.0 };
        // The ticks' number follows from the height, their widths from that, and the plot's width from these.
        let roughly = height - title_margin - bottom_margin - LEGEND_ROW;
        let y_ticks = |span| self.y.ticks(span, (roughly / 38.0).max(2.0));
        let left_margin = if self.y.hidden { 8.0 } else { left_room(&y_ticks(spans[1])) };
        let legend = self.legend_rows(full_width - left_margin - right_margin);
        let top_margin = title_margin + LEGEND_ROW * legend.len() as f64;
        let mut area = [
            left + left_margin,
            top + top_margin,
            full_width - left_margin - right_margin,
            height - top_margin - bottom_margin,
        ];
        if self.equal {
            fit_equal(&mut area, &mut spans, self.x.is_given() && self.y.is_given());
        }
        let to_px = Map { area, spans, x: &self.x, y: &self.y };
        let [x, y, w, h] = area;
        if !self.title.is_empty() {
            // Above the panel's middle: a title may be wider than the plot.
            let middle = (left + full_width / 2.0).max(left + width(&self.title, TITLE_SIZE) / 2.0 + 2.0);
            svg.text([middle, top + 17.0], &self.title, TITLE_SIZE, Colour::INK, Anchor::Middle, false);
        }
        let x_ticks = self.x.ticks(spans[0], (w / 70.0).max(2.0));
        self.draw_grid(svg, &to_px, &x_ticks, &y_ticks(spans[1]));
        svg.begin_clip(x, y, w, h);
        for item in self.items.iter().filter(|item| !matches!(item, Item::Text(..))) {
            draw_item(svg, &to_px, item);
        }
        svg.end_clip();
        if !self.x.hidden || !self.y.hidden {
            let frame = [[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]];
            svg.path(&frame, Some((Colour::INK, 0.8)), None, None);
        }
        for item in self.items.iter().filter(|item| matches!(item, Item::Text(..))) {
            draw_item(svg, &to_px, item);
        }
        self.draw_legend(svg, [x, y - LEGEND_ROW * legend.len() as f64], &legend);
        if let Some((map, colours)) = bar {
            draw_bar(svg, area, map, colours);
        }
    }

    fn draw_grid(&self, svg: &mut Svg, map: &Map<'_>, x_ticks: &Ticks, y_ticks: &Ticks) {
        let [x, y, w, h] = map.area;
        let ink = Colour::INK;
        if !self.x.hidden {
            for (place, label) in &x_ticks.places {
                let at = map.along(0, *place);
                svg.path(&[[at, y], [at, y + h]], Some((Colour::PALE, 0.6)), None, None);
                svg.text([at, y + h + 14.0], label, TICK_SIZE, ink, Anchor::Middle, false);
            }
            svg.text([x + w / 2.0, y + h + 31.0], &x_ticks.label, LABEL_SIZE, ink, Anchor::Middle, false);
        }
        if !self.y.hidden {
            for (place, label) in &y_ticks.places {
                let at = map.along(1, *place);
                svg.path(&[[x, at], [x + w, at]], Some((Colour::PALE, 0.6)), None, None);
                svg.text([x - 5.0, at + 3.6], label, TICK_SIZE, ink, Anchor::End, false);
            }
            let at = [x - left_room(y_ticks) + LABEL_SIZE + 1.0, y + h / 2.0];
            svg.text(at, &y_ticks.label, LABEL_SIZE, ink, Anchor::Middle, true);
        }
    }

    /// The legend's entries in rows no wider than the plot. It stands above the plot, where it hides nothing.
    fn legend_rows(&self, most: f64) -> Vec<LegendRow> {
        let mut rows: Vec<LegendRow> = Vec::new();
        let mut right = f64::INFINITY;
        for (k, (label, _, mark)) in self.legend.iter().enumerate() {
            let own = mark_px(*mark) + MARK_GAP + width(label, LEGEND_SIZE);
            if right + own > most {
                rows.push(Vec::new());
                right = 0.0;
            }
            if let Some(row) = rows.last_mut() {
                row.push((k, right));
            }
            right += own + ENTRY_GAP;
        }
        rows
    }

    fn draw_legend(&self, svg: &mut Svg, [left, top]: [f64; 2], rows: &[LegendRow]) {
        for (i, row) in rows.iter().enumerate() {
            let y = top + LEGEND_ROW * i as f64 + 10.0;
            for &(entry, offset) in row {
                let (label, style, mark) = &self.legend[entry];
                let x = left + offset;
                let end = x + mark_px(*mark);
                let box_of = [[x, y - 8.0], [end, y - 8.0], [end, y + 1.0], [x, y + 1.0]];
                match mark {
                    Mark::Line => {
                        let stroke = Some((style.colour, style.width.max(1.0)));
                        svg.path(&[[x, y - 3.5], [end, y - 3.5]], stroke, style.dash, None);
                    }
                    Mark::Dot => {
                        svg.dots(&[[x + 4.0, y - 3.5]], style.width.clamp(2.0, 3.0), style.colour, 1.0)
                    }
                    Mark::Area => svg.path(&box_of, None, None, Some((style.colour, style.fill))),
                    Mark::Hatch => {
                        svg.path(&[box_of[3], box_of[1]], Some((style.colour, 0.9)), None, None);
                        let closed = [box_of[0], box_of[1], box_of[2], box_of[3], box_of[0]];
                        svg.path(&closed, Some((style.colour, 0.6)), None, None);
                    }
                    Mark::Arrow(_) => draw_arrows(svg, &[[[x, y - 3.5], [end, y - 3.5]]], *style),
                }
                svg.text([end + MARK_GAP, y], label, LEGEND_SIZE, Colour::INK, Anchor::Start, false);
            }
        }
    }
}

/// Width of what stands before a name, px.
fn mark_px(mark: Mark) -> f64 {
    match mark {
        Mark::Line => 16.0,
        Mark::Dot => 8.0,
        Mark::Area | Mark::Hatch => 14.0,
        Mark::Arrow(length) => length,
    }
}

/// What ticks and label take at the left, px; so much at least, that panels beside each other begin alike.
fn left_room(ticks: &Ticks) -> f64 {
    let widest = ticks.places.iter().map(|(_, label)| width(label, TICK_SIZE)).fold(0.0, f64::max);
    let label = if ticks.label.is_empty() { 0.0 } else { LABEL_SIZE + 5.0 };
    (4.0 + label + widest + 6.0).max(54.0)
}

/// One length for one unit: widens the span of the axis that has room, or, where both spans are given,
/// shrinks the area about its middle.
fn fit_equal(area: &mut [f64; 4], spans: &mut [[f64; 2]; 2], given: bool) {
    let scale = |k: usize| area[2 + k] / (spans[k][1] - spans[k][0]);
    let (k, target) = if scale(0) > scale(1) { (0, scale(1)) } else { (1, scale(0)) };
    if given {
        let length = target * (spans[k][1] - spans[k][0]);
        area[k] += (area[2 + k] - length) / 2.0;
        area[2 + k] = length;
    } else {
        let width = area[2 + k] / target;
        let middle = (spans[k][0] + spans[k][1]) / 2.0;
        spans[k] = [middle - width / 2.0, middle + width / 2.0];
    }
}

pub(crate) struct Map<'a> {
    pub(crate) area: [f64; 4],
    spans: [[f64; 2]; 2],
    x: &'a Axis,
    y: &'a Axis,
}

impl Map<'_> {
    /// Axis coordinate to px.
    pub(crate) fn along(&self, axis: usize, place: f64) -> f64 {
        let [low, high] = self.spans[axis];
        let reversed = if axis == 0 { self.x.reversed } else { self.y.reversed };
        let t = (place - low) / (high - low);
        let t = if reversed { 1.0 - t } else { t };
        if axis == 0 { self.area[0] + t * self.area[2] } else { self.area[1] + (1.0 - t) * self.area[3] }
    }

    /// Data to px; far outside is drawn just outside, so that lines keep their direction but no number
    /// grows beyond what renderers take.
    pub(crate) fn point(&self, at: [f64; 2]) -> Option<[f64; 2]> {
        let x = self.along(0, self.x.place(at[0])?).clamp(-1e5, 1e5);
        let y = self.along(1, self.y.place(at[1])?).clamp(-1e5, 1e5);
        Some([x, y])
    }

    /// The sign in px of a step that grows along each axis.
    pub(crate) fn ways(&self) -> [f64; 2] {
        [if self.x.reversed { -1.0 } else { 1.0 }, if self.y.reversed { 1.0 } else { -1.0 }]
    }

    fn points(&self, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        points.iter().filter_map(|&at| self.point(at)).collect()
    }
}

fn draw_item(svg: &mut Svg, map: &Map<'_>, item: &Item) {
    let stroke = |style: &Style| (style.width > 0.0).then_some((style.colour, style.width));
    match item {
        Item::Line(points, style) => svg.path(&map.points(points), stroke(style), style.dash, None),
        Item::Dots(points, style) => {
            let [x, y, w, h] = map.area;
            let mut inside = map.points(points);
            inside.retain(|p| (x..=x + w).contains(&p[0]) && (y..=y + h).contains(&p[1]));
            svg.dots(&inside, style.width, style.colour, style.dots);
        }
        Item::Polygon(points, style) => {
            svg.path(&map.points(points), stroke(style), style.dash, Some((style.colour, style.fill)));
        }
        Item::Circle(centre, radius, style) => {
            let edge = [centre[0] + radius, centre[1] + radius];
            if let (Some(c), Some(e)) = (map.point(*centre), map.point(edge)) {
                svg.ellipse(
                    c,
                    [(e[0] - c[0]).abs(), (e[1] - c[1]).abs()],
                    style.colour,
                    style.width,
                    style.dash,
                );
            }
        }
        Item::Text(at, offset, text, size, colour, anchor) => {
            if let Some([x, y]) = map.point(*at) {
                svg.text([x + offset[0], y + offset[1]], text, *size, *colour, *anchor, false);
            }
        }
        Item::Dimension(from, to, style) => {
            if let (Some(a), Some(b)) = (map.point(*from), map.point(*to)) {
                svg.path(&[a, b], stroke(style), None, None);
                let length = (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-9);
                let [ux, uy] = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
                for (tip, way) in [(a, 1.0), (b, -1.0)] {
                    let back = [tip[0] + way * 6.0 * ux, tip[1] + way * 6.0 * uy];
                    let head = [
                        tip,
                        [back[0] - 2.0 * uy, back[1] + 2.0 * ux],
                        [back[0] + 2.0 * uy, back[1] - 2.0 * ux],
                    ];
                    svg.path(&head, None, None, Some((style.colour, 1.0)));
                }
            }
        }
        Item::Bars(means, style) => {
            let ends =
                |&[x, y, sigma]: &[f64; 3]| Some([map.point([x, y - sigma])?, map.point([x, y + sigma])?]);
            let bars: Vec<[[f64; 2]; 2]> = means.iter().filter_map(ends).collect();
            svg.segments(&bars, style.colour, style.width);
        }
        Item::Arrows(arrows) => arrows.draw(svg, map),
        Item::Hatch(heat) => draw_hatch(svg, map, heat),
        Item::Heat(heat, colours) => draw_heat(svg, map, heat, *colours),
        Item::Picture(heat, colours) => draw_picture(svg, map, heat, *colours),
    }
}
