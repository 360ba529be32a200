//! SVG to PNG.
//!
//! Text is drawn by strokes of the crate's own font: a machine without fonts gives the same image.

use std::borrow::Cow;

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};

use crate::font::{STROKE_EM, strokes, width_px};
use crate::svg::px;

/// Most pixels of an image: 400 MB of memory.
const MOST_PIXELS: f64 = 1e8;

/// Why an SVG has no PNG.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RasterError {
    /// It is no SVG.
    #[error("the drawing is no SVG: {0}")]
    Parse(String),
    /// Text in another form than this crate writes it.
    #[error("text in the drawing cannot be drawn: {0}")]
    Text(String),
    /// No image has this size.
    #[error(
        "an image of {width:.0} x {height:.0} pixels cannot be drawn: at most {MOST_PIXELS:e} pixels, at least one"
    )]
    Size {
        /// Pixels.
        width: f64,
        /// Pixels.
        height: f64,
    },
    /// The encoder's own words.
    #[error("the PNG cannot be encoded: {0}")]
    Encode(String),
}

/// An SVG of this crate ([`crate::Figure::to_svg`]) as PNG, `scale` pixels for each px.
///
/// # Errors
/// Text that is no SVG; text elements in another form than this crate's; an image without a pixel, or
/// larger than memory should hold.
pub fn png(svg: &str, scale: f64) -> Result<Vec<u8>, RasterError> {
    let stroked = stroke_text(svg)?;
    let tree = Tree::from_str(&stroked, &Options::default())
        .map_err(|error| RasterError::Parse(error.to_string()))?;
    let (width, height) = (f64::from(tree.size().width()) * scale, f64::from(tree.size().height()) * scale);
    let size = RasterError::Size { width, height };
    if !(width >= 1.0 && height >= 1.0 && width * height <= MOST_PIXELS) {
        return Err(size);
    }
    let mut pixmap = Pixmap::new(width.ceil() as u32, height.ceil() as u32).ok_or(size)?;
    resvg::render(&tree, Transform::from_scale(scale as f32, scale as f32), &mut pixmap.as_mut());
    pixmap.encode_png().map_err(|error| RasterError::Encode(error.to_string()))
}

/// Every text element replaced by its strokes.
fn stroke_text(svg: &str) -> Result<String, RasterError> {
    const END: &str = "</text>";
    let mut out = String::with_capacity(2 * svg.len());
    let mut rest = svg;
    while let Some(begin) = rest.find("<text") {
        out.push_str(&rest[..begin]);
        let end = rest[begin..].find(END).ok_or_else(|| RasterError::Text("an element has no end".into()))?;
        let element = &rest[begin..begin + end];
        out.push_str(&stroked(element)?);
        rest = &rest[begin + end + END.len()..];
    }
    out.push_str(rest);
    Ok(out)
}

/// The path of `<text attributes>content`.
fn stroked(element: &str) -> Result<String, RasterError> {
    let bad = || RasterError::Text(element.to_owned());
    let (head, content) = element.split_once('>').ok_or_else(bad)?;
    if content.contains('<') {
        return Err(bad());
    }
    let attribute = |name: &str| {
        let from = head.find(&format!(" {name}=\""))? + name.len() + 3;
        Some(&head[from..from + head[from..].find('"')?])
    };
    let number = |name: &str| attribute(name).and_then(|text| text.parse::<f64>().ok()).ok_or_else(bad);
    let (x, y, size_px) = (number("x")?, number("y")?, number("font-size")?);
    let text = unescape(content);
    let shift = match attribute("text-anchor").unwrap_or("start") {
        "middle" => 0.5,
        "end" => 1.0,
        _ => 0.0,
    };
    let left = x - shift * width_px(&text, size_px);
    let mut d = String::new();
    for stroke in strokes(&text, [left, y], size_px) {
        for (i, point) in stroke.iter().enumerate() {
            d.push(if i == 0 { 'M' } else { 'L' });
            d += &format!("{} {}", px(point[0]), px(point[1]));
        }
    }
    if d.is_empty() {
        return Ok(String::new());
    }
    let turn = attribute("transform").map_or(String::new(), |turn| format!(" transform=\"{turn}\""));
    Ok(format!(
        "<path d=\"{d}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linecap=\"round\" \
         stroke-linejoin=\"round\"{turn}/>",
        attribute("fill").unwrap_or("#000000"),
        px(size_px * STROKE_EM)
    ))
}

fn unescape(text: &str) -> Cow<'_, str> {
    if !text.contains('&') {
        return Cow::Borrowed(text);
    }
    let text = text.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"");
    Cow::Owned(text.replace("&amp;", "&"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(bytes: &[u8]) -> Pixmap {
        Pixmap::decode_png(bytes).unwrap()
    }

    fn dark(image: &Pixmap, [x, y, w, h]: [u32; 4]) -> usize {
        let is_dark = |x: u32, y: u32| image.pixel(x, y).is_some_and(|p| p.red() < 128);
        (y..y + h).flat_map(|y| (x..x + w).map(move |x| (x, y))).filter(|&(x, y)| is_dark(x, y)).count()
    }

    const PAGE: &str = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"60\" height=\"40\" viewBox=\"0 0 60 40\">\
                        <rect width=\"60\" height=\"40\" fill=\"#ffffff\"/>";

    /// A black square of 10 px at a scale of 2 covers 20 x 20 pixels, where the SVG has it.
    #[test]
    fn a_square_covers_its_pixels() {
        let svg = format!("{PAGE}<rect x=\"5\" y=\"20\" width=\"10\" height=\"10\" fill=\"#000000\"/></svg>");
        let image = decode(&png(&svg, 2.0).unwrap());
        assert_eq!((image.width(), image.height()), (120, 80));
        assert_eq!(dark(&image, [0, 0, 120, 80]), 400);
        assert_eq!(dark(&image, [10, 40, 20, 20]), 400);
    }

    /// Text stands on its baseline, beside its anchor, and turns with its transform.
    #[test]
    fn text_stands_where_its_anchor_says() {
        let text = |attributes: &str| {
            let svg =
                format!("{PAGE}<text font-size=\"12\" fill=\"#000000\" {attributes}>a&lt;H</text></svg>");
            decode(&png(&svg, 1.0).unwrap())
        };
        let start = text("x=\"30\" y=\"20\" text-anchor=\"start\"");
        let end = text("x=\"30\" y=\"20\" text-anchor=\"end\"");
        let all = dark(&start, [0, 0, 60, 40]);
        assert!(all > 20, "{all}");
        assert_eq!(dark(&start, [29, 10, 31, 12]), all);
        assert_eq!(dark(&end, [0, 10, 31, 12]), dark(&end, [0, 0, 60, 40]));
        let turned = text("x=\"30\" y=\"38\" transform=\"rotate(-90 30 38)\"");
        assert_eq!(dark(&turned, [19, 0, 13, 40]), dark(&turned, [0, 0, 60, 40]));
        assert!(dark(&turned, [19, 0, 13, 40]) > 20);
    }

    #[test]
    fn what_cannot_be_drawn_is_refused() {
        let text = |svg: &str, scale| png(svg, scale).unwrap_err().to_string();
        assert!(text("no drawing", 1.0).contains("no SVG"));
        assert!(text(&format!("{PAGE}</svg>"), 1e4).contains("pixels cannot be drawn"));
        assert!(text(&format!("{PAGE}</svg>"), f64::NAN).contains("pixels cannot be drawn"));
        assert!(text(&format!("{PAGE}<text x=\"1\">a</text></svg>"), 1.0).contains("text in the drawing"));
    }
}
