//! A panel: two axes and what stands between them.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;

use crate::axis::Axis;
use crate::colour::{Colour, ColourMap};
use crate::picture;
use crate::svg::Svg;

/// Which end of a text stands at its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// Its beginning.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// Stroke and fill.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Style {
    /// Colour of stroke and fill.
    pub colour: Colour,
    /// Stroke width, or radius of dots, px.
    pub width: f64,
    /// SVG dash pattern.
    pub dash: Option<&'static str>,
    /// Opacity of the fill of closed shapes; 0 for none.
    pub fill: f64,
}

impl Style {
    /// A solid line.
    pub fn line(colour: Colour) -> Self {
        Self { colour, width: 1.3, dash: None, fill: 0.0 }
    }

    /// A thin line.
    pub fn thin(colour: Colour) -> Self {
        Self { width: 0.6, ..Self::line(colour) }
    }

    /// Dashed.
    pub fn dashed(self) -> Self {
        Self { dash: Some("5 3"), ..self }
    }

    /// Of another width, px.
    pub fn width(self, width: f64) -> Self {
        Self { width, ..self }
    }

    /// Filled with this opacity.
    pub fn filled(self, fill: f64) -> Self {
        Self { fill, ..self }
    }
}

/// Values on a regular grid.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    /// Centre of the first cell, data coordinates.
    pub origin: [f64; 2],
    /// Cell size, data coordinates.
    pub pitch: [f64; 2],
    /// Cells a row.
    pub columns: usize,
    /// Row by row; NaN stays white.
    pub values: Vec<f64>,
    /// Values at the ends of the colour bar.
    pub range: [f64; 2],
    /// Label of the colour bar, with unit; empty for no bar.
    pub label: String,
}

#[derive(Debug, Clone)]
enum Item {
    Line(Vec<[f64; 2]>, Style),
    Dots(Vec<[f64; 2]>, Style),
    Polygon(Vec<[f64; 2]>, Style),
    Circle([f64; 2], f64, Style),
    Text([f64; 2], [f64; 2], String, f64, Colour, Anchor),
    Arrow([f64; 2], [f64; 2], Style),
    Heat(HeatMap, ColourMap),
    Picture(HeatMap, ColourMap),
}

/// Two axes and items in data coordinates.
#[derive(Debug, Clone)]
pub struct Panel {
    title: String,
    x: Axis,
    y: Axis,
    equal: bool,
    items: Vec<Item>,
    legend: Vec<(String, Style, bool)>,
    legend_left: bool,
}

const TICK_SIZE: f64 = 9.0;
const LABEL_SIZE: f64 = 10.5;
const TITLE_SIZE: f64 = 11.5;

impl Panel {
    /// An empty panel.
    pub fn new(x: Axis, y: Axis) -> Self {
        Self {
            title: String::new(),
            x,
            y,
            equal: false,
            items: Vec::new(),
            legend: Vec::new(),
            legend_left: false,
        }
    }

    /// With a title.
    pub fn title(mut self, title: impl Into<String>) -> Self {
        self.title = title.into();
        self
    }

    /// One unit is as long on x as on y.
    pub fn equal_aspect(mut self) -> Self {
        self.equal = true;
        self
    }

    /// The legend in the upper left corner instead of the upper right one.
    pub fn legend_left(mut self) -> Self {
        self.legend_left = true;
        self
    }

    fn note(&mut self, label: &str, style: Style, dots: bool) {
        if !label.is_empty() && !self.legend.iter().any(|(known, ..)| known == label) {
            self.legend.push((label.to_owned(), style, dots));
        }
    }

    /// A polyline; a label that is not empty enters the legend.
    pub fn line(&mut self, label: &str, points: &[[f64; 2]], style: Style) {
        self.note(label, style, false);
        self.items.push(Item::Line(points.to_vec(), style));
    }

    /// Dots of radius `style.width`.
    pub fn dots(&mut self, label: &str, points: &[[f64; 2]], style: Style) {
        self.note(label, style, true);
        self.items.push(Item::Dots(points.to_vec(), style));
    }

    /// The area between two curves over the same x.
    pub fn band(&mut self, label: &str, low: &[[f64; 2]], high: &[[f64; 2]], style: Style) {
        let points: Vec<[f64; 2]> = low.iter().chain(high.iter().rev()).copied().collect();
        self.note(label, style, false);
        self.items.push(Item::Polygon(points, style));
    }

    /// A closed polygon.
    pub fn polygon(&mut self, points: &[[f64; 2]], style: Style) {
        self.items.push(Item::Polygon(points.to_vec(), style));
    }

    /// A circle of a radius in data units (an ellipse where the axes differ).
    pub fn circle(&mut self, label: &str, centre: [f64; 2], radius: f64, style: Style) {
        self.note(label, style, false);
        self.items.push(Item::Circle(centre, radius, style));
    }

    /// Text at a place in data coordinates, moved by `offset_px` (x right, y down).
    pub fn text(
        &mut self,
        at: [f64; 2],
        offset_px: [f64; 2],
        text: impl Into<String>,
        size: f64,
        anchor: Anchor,
    ) {
        self.items.push(Item::Text(at, offset_px, text.into(), size, Colour::INK, anchor));
    }

    /// A line with heads at both ends, as on a drawing's dimensions.
    pub fn dimension(&mut self, from: [f64; 2], to: [f64; 2], label: impl Into<String>) {
        self.items.push(Item::Arrow(from, to, Style::thin(Colour::INK)));
        let middle = [(from[0] + to[0]) / 2.0, (from[1] + to[1]) / 2.0];
        self.text(middle, [0.0, -3.0], label, 9.0, Anchor::Middle);
    }

    /// A heat map, with its colour bar at the right.
    pub fn heat(&mut self, map: HeatMap) {
        self.items.push(Item::Heat(map, ColourMap::Sequential));
    }

    /// A heat map of many cells, in colours of one's choice, as an image inside the drawing. Browsers show it;
    /// [`crate::png`] leaves images out.
    pub fn picture(&mut self, map: HeatMap, colours: ColourMap) {
        self.items.push(Item::Picture(map, colours));
    }

    fn extent(&self, axis: usize) -> impl Iterator<Item = f64> + '_ {
        self.items.iter().flat_map(move |item| -> Vec<f64> {
            match item {
                Item::Line(points, _) | Item::Dots(points, _) | Item::Polygon(points, _) => {
                    points.iter().map(|point| point[axis]).collect()
                }
                Item::Circle(centre, radius, _) => vec![centre[axis] - radius, centre[axis] + radius],
                Item::Text(at, ..) => vec![at[axis]],
                Item::Arrow(from, to, _) => vec![from[axis], to[axis]],
                Item::Heat(map, _) | Item::Picture(map, _) => {
                    let count = if axis == 0 { map.columns } else { map.values.len() / map.columns.max(1) };
                    let first = map.origin[axis] - map.pitch[axis] / 2.0;
                    vec![first, first + count as f64 * map.pitch[axis]]
                }
            }
        })
    }

    fn bar(&self) -> Option<(&HeatMap, ColourMap)> {
        self.items.iter().find_map(|item| match item {
            Item::Heat(map, colours) | Item::Picture(map, colours) if !map.label.is_empty() => {
                Some((map, *colours))
            }
            _ => None,
        })
    }

    /// Draws the panel into the rectangle x, y, width, height (px).
    pub(crate) fn draw(&self, svg: &mut Svg, frame: [f64; 4]) {
        let [left, top, width, height] = frame;
        let top_margin = if self.title.is_empty() { 10.0 } else { 26.0 };
        let (left_margin, bottom_margin) =
            (if self.y.hidden { 8.0 } else { 54.0 }, if self.x.hidden { 8.0 } else { 40.0 });
        let right_margin = if self.bar().is_some() { 66.0 } else { 14.0 };
        let mut area = [
            left + left_margin,
            top + top_margin,
            width - left_margin - right_margin,
            height - top_margin - bottom_margin,
        ];
        let mut spans = [self.x.span(self.extent(0)), self.y.span(self.extent(1))];
        if self.equal {
            fit_equal(&mut area, &mut spans, self.x.is_given() && self.y.is_given());
        }
        let to_px = Map { area, spans, x: &self.x, y: &self.y };
        if !self.title.is_empty() {
            svg.text(
                [area[0] + area[2] / 2.0, area[1] - 9.0],
                &self.title,
                TITLE_SIZE,
                Colour::INK,
                Anchor::Middle,
                false,
            );
        }
        let ticks = [
            self.x.ticks(spans[0], (area[2] / 70.0).max(2.0)),
            self.y.ticks(spans[1], (area[3] / 38.0).max(2.0)),
        ];
        self.draw_grid(svg, &to_px, &ticks);
        svg.begin_clip(area[0], area[1], area[2], area[3]);
        for item in self.items.iter().filter(|item| !matches!(item, Item::Text(..))) {
            draw_item(svg, &to_px, item);
        }
        svg.end_clip();
        if !self.x.hidden || !self.y.hidden {
            let [x, y, w, h] = area;
            let frame = [[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]];
            svg.path(&frame, Some((Colour::INK, 0.8)), None, None);
        }
        for item in self.items.iter().filter(|item| matches!(item, Item::Text(..))) {
            draw_item(svg, &to_px, item);
        }
        self.draw_legend(svg, area);
        if let Some((map, colours)) = self.bar() {
            draw_bar(svg, area, map, colours);
        }
    }

    fn draw_grid(&self, svg: &mut Svg, map: &Map<'_>, ticks: &[Vec<(f64, String)>; 2]) {
        let [x, y, w, h] = map.area;
        if !self.x.hidden {
            for (place, label) in &ticks[0] {
                let at = map.along(0, *place);
                svg.path(&[[at, y], [at, y + h]], Some((Colour::PALE, 0.6)), None, None);
                svg.text([at, y + h + 13.0], label, TICK_SIZE, Colour::INK, Anchor::Middle, false);
            }
            svg.text(
                [x + w / 2.0, y + h + 30.0],
                &self.x.label,
                LABEL_SIZE,
                Colour::INK,
                Anchor::Middle,
                false,
            );
        }
        if !self.y.hidden {
            for (place, label) in &ticks[1] {
                let at = map.along(1, *place);
                svg.path(&[[x, at], [x + w, at]], Some((Colour::PALE, 0.6)), None, None);
                svg.text([x - 5.0, at + 3.2], label, TICK_SIZE, Colour::INK, Anchor::End, false);
            }
            svg.text([x - 40.0, y + h / 2.0], &self.y.label, LABEL_SIZE, Colour::INK, Anchor::Middle, true);
        }
    }

    fn draw_legend(&self, svg: &mut Svg, area: [f64; 4]) {
        let longest = self.legend.iter().map(|(label, ..)| label.chars().count()).max().unwrap_or(0) as f64;
        let width = 24.0 + 5.2 * longest;
        let x = if self.legend_left { area[0] + 8.0 } else { area[0] + area[2] - width - 4.0 };
        if longest > 0.0 {
            let (w, h) = (width + 4.0, 13.0 * self.legend.len() as f64 + 5.0);
            let corners =
                [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(|[dx, dy]| [x - 4.0 + dx, area[1] + 3.0 + dy]);
            svg.path(&corners, None, None, Some((Colour(255, 255, 255), 0.8)));
        }
        for (i, (label, style, dots)) in self.legend.iter().enumerate() {
            let y = area[1] + 13.0 + 13.0 * i as f64;
            if *dots {
                svg.dots(&[[x + 8.0, y - 3.0]], style.width.max(2.0), style.colour);
            } else if style.fill > 0.0 {
                let corners = [[x, y - 7.0], [x + 16.0, y - 7.0], [x + 16.0, y + 1.0], [x, y + 1.0]];
                svg.path(&corners, None, None, Some((style.colour, style.fill)));
            } else {
                svg.path(
                    &[[x, y - 3.0], [x + 16.0, y - 3.0]],
                    Some((style.colour, style.width)),
                    style.dash,
                    None,
                );
            }
            svg.text([x + 20.0, y], label, TICK_SIZE, Colour::INK, Anchor::Start, false);
        }
    }
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

struct Map<'a> {
    area: [f64; 4],
    spans: [[f64; 2]; 2],
    x: &'a Axis,
    y: &'a Axis,
}

impl Map<'_> {
    /// Axis coordinate to px.
    fn along(&self, axis: usize, place: f64) -> f64 {
        let [low, high] = self.spans[axis];
        let t = (place - low) / (high - low);
        if axis == 0 { self.area[0] + t * self.area[2] } else { self.area[1] + (1.0 - t) * self.area[3] }
    }

    /// Data to px; far outside is drawn just outside, so that lines keep their direction but no number
    /// grows beyond what renderers take.
    fn point(&self, at: [f64; 2]) -> Option<[f64; 2]> {
        let x = self.along(0, self.x.place(at[0])?).clamp(-1e5, 1e5);
        let y = self.along(1, self.y.place(at[1])?).clamp(-1e5, 1e5);
        Some([x, y])
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
            svg.dots(&inside, style.width, style.colour);
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
        Item::Arrow(from, to, style) => {
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
        Item::Heat(heat, colours) => draw_heat(svg, map, heat, *colours),
        Item::Picture(heat, colours) => draw_picture(svg, map, heat, *colours),
    }
}

fn draw_picture(svg: &mut Svg, map: &Map<'_>, heat: &HeatMap, colours: ColourMap) {
    let rows = heat.values.len() / heat.columns.max(1);
    let low = [heat.origin[0] - 0.5 * heat.pitch[0], heat.origin[1] - 0.5 * heat.pitch[1]];
    let high = [low[0] + heat.columns as f64 * heat.pitch[0], low[1] + rows as f64 * heat.pitch[1]];
    let corners = (map.point([low[0], high[1]]), map.point([high[0], low[1]]));
    if let ((Some(a), Some(b)), Some(png)) = (corners, picture::png(heat, colours)) {
        svg.image([a[0], a[1], b[0] - a[0], b[1] - a[1]], &BASE64_STANDARD.encode(&png));
    }
}

/// Cells of one colour in a row become one rectangle; 64 colours.
fn draw_heat(svg: &mut Svg, map: &Map<'_>, heat: &HeatMap, colours: ColourMap) {
    let level = |value: f64| value.is_finite().then(|| picture::shade(value, heat.range));
    for (row, values) in heat.values.chunks(heat.columns.max(1)).enumerate() {
        let low = heat.origin[1] + (row as f64 - 0.5) * heat.pitch[1];
        let mut start = 0;
        while start < values.len() {
            let colour = level(values[start]);
            let end = (start..values.len()).find(|&i| level(values[i]) != colour).unwrap_or(values.len());
            let x = |i: usize| heat.origin[0] + (i as f64 - 0.5) * heat.pitch[0];
            let corners = (map.point([x(start), low + heat.pitch[1]]), map.point([x(end), low]));
            if let (Some(level), (Some(a), Some(b))) = (colour, corners) {
                // A little overlap hides the seams that renderers leave between neighbours.
                svg.rect(
                    a[0],
                    a[1],
                    b[0] - a[0] + 0.3,
                    b[1] - a[1] + 0.3,
                    colours.colour(f64::from(level) / 63.0),
                );
            }
            start = end;
        }
    }
}

fn draw_bar(svg: &mut Svg, area: [f64; 4], map: &HeatMap, colours: ColourMap) {
    let (x, width) = (area[0] + area[2] + 10.0, 10.0);
    for i in 0..64 {
        let t = f64::from(i) / 63.0;
        let y = area[1] + area[3] * (1.0 - f64::from(i + 1) / 64.0);
        svg.rect(x, y, width, area[3] / 64.0 + 0.3, colours.colour(t));
    }
    let axis = Axis::linear("");
    for (place, label) in axis.ticks(map.range, 5.0) {
        let t = (place - map.range[0]) / (map.range[1] - map.range[0]);
        let y = area[1] + (1.0 - t) * area[3];
        svg.text([x + width + 3.0, y + 3.2], &label, TICK_SIZE, Colour::INK, Anchor::Start, false);
    }
    svg.text(
        [x + width + 38.0, area[1] + area[3] / 2.0],
        &map.label,
        TICK_SIZE,
        Colour::INK,
        Anchor::Middle,
        true,
    );
}
