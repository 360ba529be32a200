//! A panel: two axes and what stands between them.

use crate::arrows::Arrows;
use crate::axis::Axis;
use crate::colour::{Colour, ColourMap};
use crate::heat::HeatMap;
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
    /// Opacity of dots.
    pub dots: f64,
}

impl Style {
    /// A solid line.
    pub fn line(colour: Colour) -> Self {
        Self { colour, width: 1.3, dash: None, fill: 0.0, dots: 1.0 }
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

    /// Dots of this opacity: a crowd behind its means.
    pub fn faint(self, dots: f64) -> Self {
        Self { dots, ..self }
    }

    /// Filled with this opacity.
    pub fn filled(self, fill: f64) -> Self {
        Self { fill, ..self }
    }
}

#[derive(Debug, Clone)]
pub(crate) enum Item {
    Line(Vec<[f64; 2]>, Style),
    Dots(Vec<[f64; 2]>, Style),
    Polygon(Vec<[f64; 2]>, Style),
    Circle([f64; 2], f64, Style),
    Text([f64; 2], [f64; 2], String, f64, Colour, Anchor),
    Dimension([f64; 2], [f64; 2], Style),
    /// Place and standard deviation, the latter along y.
    Bars(Vec<[f64; 3]>, Style),
    Arrows(Arrows),
    Heat(HeatMap, ColourMap),
    Picture(HeatMap, ColourMap),
    /// Strokes across the cells that have no value.
    Hatch(HeatMap),
}

/// What stands before a name in the legend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Mark {
    Line,
    Dot,
    Area,
    Hatch,
    /// An arrow of this length, px.
    Arrow(f64),
}

/// Two axes and items in data coordinates.
#[derive(Debug, Clone)]
pub struct Panel {
    pub(crate) title: String,
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    pub(crate) equal: bool,
    pub(crate) items: Vec<Item>,
    pub(crate) legend: Vec<(String, Style, Mark)>,
}

impl Panel {
    /// An empty panel.
    pub fn new(x: Axis, y: Axis) -> Self {
        Self { title: String::new(), x, y, equal: false, items: Vec::new(), legend: Vec::new() }
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

    fn note(&mut self, label: &str, style: Style, mark: Mark) {
        if !label.is_empty() && !self.legend.iter().any(|(known, ..)| known == label) {
            let mark = if mark == Mark::Line && style.fill > 0.0 { Mark::Area } else { mark };
            self.legend.push((label.to_owned(), style, mark));
        }
    }

    /// A polyline; a label that is not empty enters the legend.
    pub fn line(&mut self, label: &str, points: &[[f64; 2]], style: Style) {
        self.note(label, style, Mark::Line);
        self.items.push(Item::Line(points.to_vec(), style));
    }

    /// Dots of radius `style.width`.
    pub fn dots(&mut self, label: &str, points: &[[f64; 2]], style: Style) {
        self.note(label, style, Mark::Dot);
        self.items.push(Item::Dots(points.to_vec(), style));
    }

    /// The area between two curves over the same x.
    pub fn band(&mut self, label: &str, low: &[[f64; 2]], high: &[[f64; 2]], style: Style) {
        let points: Vec<[f64; 2]> = low.iter().chain(high.iter().rev()).copied().collect();
        self.note(label, style, Mark::Line);
        self.items.push(Item::Polygon(points, style));
    }

    /// A closed polygon.
    pub fn polygon(&mut self, points: &[[f64; 2]], style: Style) {
        self.items.push(Item::Polygon(points.to_vec(), style));
    }

    /// A circle of a radius in data units (an ellipse where the axes differ).
    pub fn circle(&mut self, label: &str, centre: [f64; 2], radius: f64, style: Style) {
        self.note(label, style, Mark::Line);
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
        self.items.push(Item::Dimension(from, to, Style::thin(Colour::INK)));
        let middle = [(from[0] + to[0]) / 2.0, (from[1] + to[1]) / 2.0];
        self.text(middle, [0.0, -3.0], label, 9.0, Anchor::Middle);
    }

    /// Means with their standard deviations, each x, y and sigma of y: dots with bars, joined by a thin line.
    pub fn means(&mut self, label: &str, means: &[[f64; 3]], style: Style) {
        self.note(label, style, Mark::Dot);
        let places: Vec<[f64; 2]> = means.iter().map(|&[x, y, _]| [x, y]).collect();
        self.items.push(Item::Line(places.clone(), Style { width: 1.0, ..style }));
        self.items.push(Item::Bars(means.to_vec(), Style { width: 1.2, ..style }));
        self.items.push(Item::Dots(places, Style { width: 2.4, ..style }));
    }

    /// Arrows, with one of a round length and its value above the plot.
    pub fn arrows(&mut self, arrows: Arrows) {
        let (length_px, label) = arrows.key();
        self.note(&label, arrows.style, Mark::Arrow(length_px));
        self.items.push(Item::Arrows(arrows));
    }

    /// A heat map, with its colour bar at the right.
    pub fn heat(&mut self, map: HeatMap) {
        self.items.push(Item::Heat(map, ColourMap::Sequential));
    }

    /// A heat map in colours of one's choice, as rectangles: one for each run of cells of a row that have one shade.
    pub fn cells(&mut self, map: HeatMap, colours: ColourMap) {
        self.items.push(Item::Heat(map, colours));
    }

    /// A heat map of values that have a sign: zero is neutral, and as much below it as above it is as strong a colour.
    pub fn signed(&mut self, map: HeatMap) {
        let most = map.range[0].abs().max(map.range[1].abs());
        self.items.push(Item::Heat(HeatMap { range: [-most, most], ..map }, ColourMap::Diverging));
    }

    /// Strokes across the cells of a map that have no value; a label that is not empty enters the legend where there are
    /// such cells.
    pub fn hatch(&mut self, label: &str, map: &HeatMap) {
        if map.values.iter().any(|value| value.is_nan()) {
            self.note(label, Style::thin(Colour::GREY), Mark::Hatch);
            self.items.push(Item::Hatch(map.clone()));
        }
    }

    /// A heat map of many cells, in colours of one's choice, as an image inside the drawing. Browsers show it;
    /// [`crate::png`] leaves images out.
    pub fn picture(&mut self, map: HeatMap, colours: ColourMap) {
        self.items.push(Item::Picture(map, colours));
    }

    /// The panel alone, of a width and height in px, as SVG text.
    pub fn to_svg(&self, [width, height]: [f64; 2]) -> String {
        let mut svg = Svg::new(width, height, &self.title);
        self.draw(&mut svg, [0.0, 0.0, width, height]);
        svg.finish()
    }

    pub(crate) fn extent(&self, axis: usize) -> impl Iterator<Item = f64> + '_ {
        self.items.iter().flat_map(move |item| -> Vec<f64> {
            match item {
                Item::Line(points, _) | Item::Dots(points, _) | Item::Polygon(points, _) => {
                    points.iter().map(|point| point[axis]).collect()
                }
                Item::Circle(centre, radius, _) => vec![centre[axis] - radius, centre[axis] + radius],
                Item::Text(at, ..) => vec![at[axis]],
                Item::Dimension(from, to, _) => vec![from[axis], to[axis]],
                Item::Bars(means, _) if axis == 1 => {
                    means.iter().flat_map(|&[_, y, sigma]| [y - sigma, y + sigma]).collect()
                }
                Item::Bars(means, _) => means.iter().map(|mean| mean[0]).collect(),
                Item::Arrows(arrows) => arrows.at.iter().map(|at| at[axis]).collect(),
                Item::Heat(map, _) | Item::Picture(map, _) | Item::Hatch(map) => map.extent(axis).to_vec(),
            }
        })
    }

    pub(crate) fn bar(&self) -> Option<(&HeatMap, ColourMap)> {
        self.items.iter().find_map(|item| match item {
            Item::Heat(map, colours) | Item::Picture(map, colours) if !map.label.is_empty() => {
                Some((map, *colours))
            }
            _ => None,
        })
    }
}
