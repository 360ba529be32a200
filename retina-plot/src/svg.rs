//! SVG text with fixed decimals.

use std::fmt::Write as _;

use crate::colour::Colour;
use crate::panel::Anchor;

/// Writes elements; coordinates in px, two decimals.
pub(crate) struct Svg {
    body: String,
}

/// "-0.00" and "0.00" are one number.
pub(crate) fn px(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

impl Svg {
    pub(crate) fn new(width: f64, height: f64, title: &str) -> Self {
        let (w, h) = (px(width), px(height));
        let mut body = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" \
             font-family=\"Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif\">\n"
        );
        let _ = writeln!(body, "<title>{}</title>", escape(title));
        let _ = writeln!(body, "<rect width=\"{w}\" height=\"{h}\" fill=\"#ffffff\"/>");
        Self { body }
    }

    pub(crate) fn finish(mut self) -> String {
        self.body.push_str("</svg>\n");
        self.body
    }

    fn push(&mut self, element: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.body.write_fmt(element);
        self.body.push('\n');
    }

    pub(crate) fn begin_clip(&mut self, x: f64, y: f64, w: f64, h: f64) {
        let (x, y, w, h) = (px(x), px(y), px(w), px(h));
        // Figures share a page: clips of one name are the same rectangle.
        let id = format!("{x}_{y}_{w}_{h}");
        self.push(format_args!(
            "<clipPath id=\"c{id}\"><rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"/></clipPath>\n<g clip-path=\"url(#c{id})\">"
        ));
    }

    pub(crate) fn end_clip(&mut self) {
        self.push(format_args!("</g>"));
    }

    /// A polyline, or a filled polygon where `fill` is given.
    pub(crate) fn path(
        &mut self,
        points: &[[f64; 2]],
        stroke: Option<(Colour, f64)>,
        dash: Option<&str>,
        fill: Option<(Colour, f64)>,
    ) {
        if points.is_empty() {
            return;
        }
        let mut d = String::with_capacity(points.len() * 14);
        for (i, point) in points.iter().enumerate() {
            let _ = write!(d, "{}{} {}", if i == 0 { "M" } else { "L" }, px(point[0]), px(point[1]));
        }
        if fill.is_some() {
            d.push('Z');
        }
        let stroke = match stroke {
            Some((colour, width)) => {
                format!("stroke=\"{colour}\" stroke-width=\"{}\" stroke-linejoin=\"round\"", px(width))
            }
            None => "stroke=\"none\"".to_owned(),
        };
        let dash = dash.map_or(String::new(), |dash| format!(" stroke-dasharray=\"{dash}\""));
        let fill = fill.map_or("none".to_owned(), |(colour, opacity)| {
            format!("{colour}\" fill-opacity=\"{}", px(opacity))
        });
        self.push(format_args!("<path d=\"{d}\" {stroke}{dash} fill=\"{fill}\"/>"));
    }

    /// Strokes from point to point, each by itself.
    pub(crate) fn segments(&mut self, strokes: &[[[f64; 2]; 2]], colour: Colour, width: f64) {
        let mut d = String::with_capacity(strokes.len() * 28);
        for [from, to] in strokes {
            let _ = write!(d, "M{} {}L{} {}", px(from[0]), px(from[1]), px(to[0]), px(to[1]));
        }
        if !d.is_empty() {
            self.push(format_args!(
                "<path class=\"segments\" d=\"{d}\" stroke=\"{colour}\" stroke-width=\"{}\" fill=\"none\"/>",
                px(width)
            ));
        }
    }

    /// Filled triangles.
    pub(crate) fn triangles(&mut self, corners: &[[[f64; 2]; 3]], colour: Colour) {
        let mut d = String::with_capacity(corners.len() * 42);
        for [a, b, c] in corners {
            let at = |point: &[f64; 2]| format!("{} {}", px(point[0]), px(point[1]));
            let _ = write!(d, "M{}L{}L{}Z", at(a), at(b), at(c));
        }
        if !d.is_empty() {
            self.push(format_args!("<path d=\"{d}\" stroke=\"none\" fill=\"{colour}\"/>"));
        }
    }

    pub(crate) fn dots(&mut self, points: &[[f64; 2]], radius: f64, colour: Colour, opacity: f64) {
        // Zero-length strokes with round caps: a sixth of the bytes of circles.
        let mut d = String::with_capacity(points.len() * 16);
        for point in points {
            let _ = write!(d, "M{} {}h0", px(point[0]), px(point[1]));
        }
        let faint =
            if opacity < 1.0 { format!(" stroke-opacity=\"{}\"", px(opacity)) } else { String::new() };
        if !d.is_empty() {
            self.push(format_args!(
                "<path d=\"{d}\" stroke=\"{colour}\"{faint} stroke-width=\"{}\" stroke-linecap=\"round\" fill=\"none\"/>",
                px(2.0 * radius)
            ));
        }
    }

    pub(crate) fn ellipse(
        &mut self,
        centre: [f64; 2],
        radii: [f64; 2],
        colour: Colour,
        width: f64,
        dash: Option<&str>,
    ) {
        let dash = dash.map_or(String::new(), |dash| format!(" stroke-dasharray=\"{dash}\""));
        self.push(format_args!(
            "<ellipse cx=\"{}\" cy=\"{}\" rx=\"{}\" ry=\"{}\" stroke=\"{colour}\" stroke-width=\"{}\"{dash} fill=\"none\"/>",
            px(centre[0]),
            px(centre[1]),
            px(radii[0]),
            px(radii[1]),
            px(width)
        ));
    }

    pub(crate) fn rect(&mut self, x: f64, y: f64, w: f64, h: f64, fill: Colour) {
        self.push(format_args!(
            "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{fill}\" shape-rendering=\"crispEdges\"/>",
            px(x),
            px(y),
            px(w),
            px(h)
        ));
    }

    /// A PNG, as base64, over x, y, width and height.
    pub(crate) fn image(&mut self, [x, y, w, h]: [f64; 4], base64: &str) {
        self.push(format_args!(
            "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" image-rendering=\"pixelated\" href=\"data:image/png;base64,{base64}\"/>",
            px(x),
            px(y),
            px(w),
            px(h)
        ));
    }

    pub(crate) fn text(
        &mut self,
        at: [f64; 2],
        text: &str,
        size: f64,
        colour: Colour,
        anchor: Anchor,
        turned: bool,
    ) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let (x, y) = (px(at[0]), px(at[1]));
        let turn = if turned { format!(" transform=\"rotate(-90 {x} {y})\"") } else { String::new() };
        self.push(format_args!(
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\" fill=\"{colour}\" text-anchor=\"{anchor}\"{turn}>{}</text>",
            px(size),
            escape(text)
        ));
    }
}
