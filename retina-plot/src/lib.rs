//! Plots for engineers as deterministic SVG, and as PNG: the same data give the same bytes.
//!
//! A [`Figure`] is a grid of [`Panel`]s. A panel has two [`Axis`]es and items in data coordinates: lines,
//! points, means with bars, bands, polygons, circles, arrows with a key, text, heat maps. A legend stands above the plot and
//! hides no data. Colours are those of Okabe and Ito, which people
//! with colour-vision deficiency can tell apart; [`wavelength_colour`] shows light as the eye would.
//!
//! ```
//! use retina_plot::{Axis, Figure, PALETTE, Panel, Style};
//! let mut panel = Panel::new(Axis::linear("x (mm)"), Axis::linear("y (um)"));
//! panel.line("a line", &[[0.0, 0.0], [1.0, 2.0]], Style::line(PALETTE[0]));
//! let mut figure = Figure::new("example", 1, 1, [420.0, 300.0]);
//! figure.put(0, 0, panel);
//! assert!(figure.to_svg().starts_with("<svg"));
//! ```

mod arrows;
mod axis;
mod colour;
mod draw;
mod figure;
mod font;
mod heat;
mod panel;
mod picture;
mod raster;
mod svg;

pub use arrows::Arrows;
pub use axis::Axis;
pub use colour::{Colour, ColourMap, PALETTE, heat_colour, wavelength_colour};
pub use figure::Figure;
pub use heat::HeatMap;
pub use panel::{Anchor, Panel, Style};
pub use raster::{RasterError, png};
