//! How wide the spots are over an image: field curvature makes them differ.

use rayon::prelude::*;

use crate::centroid::{self, Window};
use crate::detect::{FIRST_SPOT_SIGMA_PX, Peak, near, shape};
use crate::width_field::{MeasuredWidth, WidthField};
use crate::{Background, CameraImage};

/// Most spots whose width is measured, the brightest ones.
const MOST_SPOTS: usize = 400;
/// A window is centred this well on a spot whose width it measures, px: moments are taken about their own mean.
const SETTLED_PX: f64 = 0.01;
/// Windows reach 3 weights, at most 31 px; narrower than half a pixel is no optics' image.
const RANGE_PX: [f64; 2] = [0.5, 7.0];

/// Standard deviation of the spots over the image: one field of widths through all that are measured (`WidthField`),
/// so that windows depend neither on a point's own light or noise nor on how many other points the image holds. (A spot
/// that is not symmetric has another centroid in another window: means over neighbours, whose reach goes by the points'
/// density, move the field's edge by an arcsecond between sparse and dense patterns.)
#[derive(Debug, Clone)]
pub struct WidthMap {
    field: WidthField,
    typical_px: f64,
}

impl WidthMap {
    /// The same everywhere.
    pub(crate) fn constant(sigma_px: f64) -> Self {
        Self { field: WidthField::constant(sigma_px), typical_px: sigma_px }
    }

    /// From the bright, unsaturated, single spots of an image; peaks are sorted by their light.
    pub(crate) fn measure(
        image: &CameraImage,
        background: &Background,
        peaks: &[Peak],
        saturation_dn: f32,
        hot: &[[usize; 2]],
    ) -> Self {
        let good = |peak: &&Peak| {
            let noise = background.noise_dn(peak.centre[0] as f64, peak.centre[1] as f64);
            !peak.blended
                && peak.light_dn > 20.0 * 3.0 * noise
                && image.at(peak.pixel[0], peak.pixel[1]) < 0.9 * saturation_dn
        };
        let bright: Vec<&Peak> = peaks.iter().filter(good).take(MOST_SPOTS).collect();
        let spots: Vec<MeasuredWidth> = bright
            .par_iter()
            .with_min_len(16)
            .filter_map(|peak| {
                let start = peak.centre.map(|c| c as f64 + 0.5);
                let (at_px, sigma) = own_width(image, background, start, &near(hot, peak.centre))?;
                Some(MeasuredWidth { at_px, log_sigma: sigma.ln() })
            })
            .collect();
        Self::through_measured([image.width_px, image.height_px].map(f64::from), &spots)
    }

    /// Through spots of an image with these places and standard deviations, px. Fewer than three do not say what the
    /// spots of an image are like: the map is the detector's first width everywhere then.
    pub fn through(size_px: [f64; 2], spots: &[([f64; 2], f64)]) -> Self {
        let spots: Vec<MeasuredWidth> =
            spots.iter().map(|&(at_px, sigma)| MeasuredWidth { at_px, log_sigma: sigma.ln() }).collect();
        Self::through_measured(size_px, &spots)
    }

    fn through_measured(size_px: [f64; 2], spots: &[MeasuredWidth]) -> Self {
        if spots.len() < 3 {
            return Self::constant(FIRST_SPOT_SIGMA_PX);
        }
        let mut logs: Vec<f64> = spots.iter().map(|spot| spot.log_sigma).collect();
        logs.sort_by(f64::total_cmp);
        let typical_px = logs[logs.len() / 2].exp();
        Self { field: WidthField::through(size_px, spots, &logs), typical_px }
    }

    /// Standard deviation of a spot at a place, px.
    pub fn at_px(&self, at: [f64; 2]) -> f64 {
        self.field.at_px(at)
    }

    /// The median over the image, px.
    pub(crate) fn typical_px(&self) -> f64 {
        self.typical_px
    }
}

/// A spot's own place and standard deviation: the window is matched to it, from a narrow one.
fn own_width(
    image: &CameraImage,
    background: &Background,
    start: [f64; 2],
    hot: &[[usize; 2]],
) -> Option<([f64; 2], f64)> {
    let mut at = start;
    let mut sigma = FIRST_SPOT_SIGMA_PX;
    for _ in 0..12 {
        let matched = Window { settled_px: SETTLED_PX, ..Window::matched(sigma) };
        let window = centroid::windowed(image, background, at, matched, hot)?;
        // Light that is even over the window has no width in it: a wider window is tried.
        let next =
            shape(&window, matched.sigma_px).map_or(1.5 * sigma, |s| s.0).clamp(sigma / 1.5, 1.5 * sigma);
        let next = next.clamp(RANGE_PX[0], RANGE_PX[1]);
        at = [window.x_px, window.y_px];
        let settled = (next / sigma).ln().abs() < 0.01;
        sigma = next;
        if settled {
            return Some((at, sigma));
        }
    }
    None
}
