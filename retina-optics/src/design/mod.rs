//! A camera put on the bench: from its objective and sensor to the distances and the `setup.toml`.
//!
//! Source: the paper's eqs. 1-6 and 13. A camera of 4:3 cannot fill a screen of 16:10 both ways; eq. 13
//! matches the heights, and so does this by default.

mod figure;
mod setup;

pub use figure::bench_figure;
pub use setup::setup_toml;

use serde::{Deserialize, Serialize};

use crate::constraints::{BenchLimits, Layout, PaperModel};

/// A camera under test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Camera {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Pixel pitch, um.
    pub pixel_um: f64,
    /// Focal length of the objective, mm.
    pub focal_mm: f64,
    /// F-number of the objective.
    pub f_number: f64,
}

impl Camera {
    /// Tangents of half the field: horizontal, vertical, diagonal.
    pub fn half_field_tans(&self) -> [f64; 3] {
        let tan = |pixels: u32| f64::from(pixels) * self.pixel_um * 1e-3 / (2.0 * self.focal_mm);
        let (x, y) = (tan(self.width_px), tan(self.height_px));
        [x, y, x.hypot(y)]
    }

    /// d_cam, mm.
    pub fn pupil_mm(&self) -> f64 {
        self.focal_mm / self.f_number
    }
}

/// A display.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Screen {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Width of the active area, mm.
    pub width_mm: f64,
    /// Height of the active area, mm.
    pub height_mm: f64,
}

impl Screen {
    /// The paper's display: 1920 x 1200 pixels on 18.7 x 11.75 mm.
    pub const PAPER: Self = Self { width_px: 1920, height_px: 1200, width_mm: 18.7, height_mm: 11.75 };

    /// Diagonal of the active area, mm.
    pub fn diagonal_mm(&self) -> f64 {
        self.width_mm.hypot(self.height_mm)
    }
}

/// Which extent of the screen the camera's same extent is matched to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MatchBy {
    /// The height (eq. 13).
    #[default]
    Height,
    /// The width.
    Width,
    /// The diagonal.
    Diagonal,
}

impl MatchBy {
    /// In words, after "matched by".
    pub fn words(self) -> &'static str {
        match self {
            Self::Height => "the height",
            Self::Width => "the width",
            Self::Diagonal => "the diagonal",
        }
    }
}

/// The lenses of a facility as thin ones, mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BenchLenses {
    /// f_c.
    pub collimator_focal_mm: f64,
    /// f_r.
    pub relay_focal_mm: f64,
    /// Clear diameter of both.
    pub diameter_mm: f64,
    /// s_cam.
    pub pupil_collimator_mm: f64,
}

/// How a camera stands on the bench.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BenchDesign {
    /// What is matched.
    pub match_by: MatchBy,
    /// M of eq. 3 and the distances of eqs. 4-6; beams of the sensor's corner.
    #[serde(flatten)]
    pub layout: Layout,
    /// Full fields of the camera, deg: horizontal, vertical, diagonal.
    pub field_deg: [f64; 3],
    /// d_cam, mm.
    pub pupil_mm: f64,
    /// s_cam, mm.
    pub pupil_collimator_mm: f64,
    /// n_v of eq. 13: rows of the screen that the camera's height sees; may exceed the screen's rows.
    pub observed_rows_px: f64,
    /// Rows of these that the screen does not have: dark at the camera's upper and lower edge.
    pub rows_beyond_screen_px: f64,
    /// What is left to each limit; negative where it is exceeded.
    pub margins: Margins,
}

/// What is left to each limit, mm; negative where it is exceeded.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Margins {
    /// To the longest s_oc.
    pub total_length_mm: f64,
    /// To the shortest s_or.
    pub screen_relay_distance_mm: f64,
    /// To the shortest s_rc.
    pub inter_lens_distance_mm: f64,
    /// Relay's rim beyond the boundary rays of the sensor's corner.
    pub relay_vignetting_mm: f64,
    /// Collimator's rim beyond them.
    pub collimator_vignetting_mm: f64,
}

impl Margins {
    /// Whether every limit holds.
    pub fn all_hold(&self) -> bool {
        [
            self.total_length_mm,
            self.screen_relay_distance_mm,
            self.inter_lens_distance_mm,
            self.relay_vignetting_mm,
            self.collimator_vignetting_mm,
        ]
        .into_iter()
        .all(|margin| margin >= 0.0)
    }
}

/// M, distances and margins of a camera behind these lenses.
pub fn bench_design(
    camera: &Camera,
    screen: &Screen,
    lenses: &BenchLenses,
    bench: &BenchLimits,
    match_by: MatchBy,
) -> BenchDesign {
    let tans = camera.half_field_tans();
    let (half_field_tan, screen_mm) = match match_by {
        MatchBy::Width => (tans[0], screen.width_mm),
        MatchBy::Height => (tans[1], screen.height_mm),
        MatchBy::Diagonal => (tans[2], screen.diagonal_mm()),
    };
    let model = PaperModel {
        screen_mm,
        pupil_mm: camera.pupil_mm(),
        collimator_diameter_mm: lenses.diameter_mm,
        relay_diameter_mm: lenses.diameter_mm,
        pupil_collimator_mm: lenses.pupil_collimator_mm,
        ..PaperModel::paper(lenses.collimator_focal_mm, lenses.relay_focal_mm)
    };
    let magnification = model.at_tan(half_field_tan).magnification;
    // The beams that may be cut are those of the sensor's corner, whatever is matched.
    let layout = model.layout(magnification, tans[2]);
    let observed_mm = 2.0 * lenses.collimator_focal_mm * tans[1] / magnification.abs();
    let observed_rows_px = observed_mm / screen.height_mm * f64::from(screen.height_px);
    let beyond_px = observed_rows_px - f64::from(screen.height_px);
    BenchDesign {
        match_by,
        layout,
        field_deg: tans.map(|tan| 2.0 * tan.atan().to_degrees()),
        pupil_mm: model.pupil_mm,
        pupil_collimator_mm: lenses.pupil_collimator_mm,
        observed_rows_px,
        // Rounding of matched heights is not a row.
        rows_beyond_screen_px: if beyond_px > 1e-6 { beyond_px } else { 0.0 },
        margins: Margins {
            total_length_mm: bench.total_length_mm - layout.total_length_mm,
            screen_relay_distance_mm: layout.screen_relay_mm - bench.screen_relay_mm,
            inter_lens_distance_mm: layout.inter_lens_mm - bench.inter_lens_mm,
            relay_vignetting_mm: lenses.diameter_mm / 2.0 - layout.relay_beam_mm,
            collimator_vignetting_mm: lenses.diameter_mm / 2.0 - layout.collimator_beam_mm,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paper(focal_mm: f64, match_by: MatchBy) -> BenchDesign {
        let camera = Camera { width_px: 2048, height_px: 1536, pixel_um: 3.45, focal_mm, f_number: 2.8 };
        let lenses = BenchLenses {
            collimator_focal_mm: 86.8,
            relay_focal_mm: 82.8,
            diameter_mm: 50.8,
            pupil_collimator_mm: 1.3 * 86.8,
        };
        bench_design(&camera, &Screen::PAPER, &lenses, &BenchLimits::PAPER, match_by)
    }

    /// Worked out independently from the paper's camera and screen.
    #[test]
    fn magnifications_of_the_two_configurations() {
        for (match_by, wide, narrow) in [
            (MatchBy::Diagonal, -1.388, -0.694),
            (MatchBy::Height, -1.566, -0.783),
            (MatchBy::Width, -1.312, -0.656),
        ] {
            for (focal_mm, expected) in [(25.0, wide), (50.0, narrow)] {
                let got = paper(focal_mm, match_by).layout.magnification;
                assert!((got - expected).abs() < 5e-4, "{match_by:?} {focal_mm}: {got}");
            }
        }
    }

    /// Table 1's fields; eq. 13's n_v is the screen's height when heights match, and the thin-lens
    /// equation holds between screen and intermediate image.
    #[test]
    fn distances_and_rows() {
        let design = paper(25.0, MatchBy::Height);
        for (got, expected) in design.field_deg.into_iter().zip([16.09, 12.10, 20.03]) {
            assert!((got - expected).abs() < 0.006, "{got} {expected}");
        }
        assert!((design.observed_rows_px - 1200.0).abs() < 1e-9);
        let layout = design.layout;
        assert!((1.0 / layout.screen_relay_mm + 1.0 / layout.relay_image_mm - 1.0 / 82.8).abs() < 1e-15);
        assert!((layout.relay_image_mm / layout.screen_relay_mm + layout.magnification).abs() < 1e-12);
        assert!((layout.inter_lens_mm - layout.relay_image_mm - 86.8).abs() < 1e-12);
        // By the width, the camera sees more rows than there are: 18.7 / (4/3) mm of 11.75.
        let by_width = paper(25.0, MatchBy::Width);
        let rows = by_width.observed_rows_px;
        assert!((rows - 18.7 * 0.75 / 11.75 * 1200.0).abs() < 1e-9, "{rows}");
        assert!((by_width.rows_beyond_screen_px - (rows - 1200.0)).abs() < 1e-9, "{by_width:?}");
        assert!(design.rows_beyond_screen_px == 0.0);
    }

    /// Corner beam at the collimator: s_cam t + d / 2 = 112.84 * 0.17664 + 4.4643 mm.
    #[test]
    fn margins_are_those_of_the_corner() {
        let margins = paper(25.0, MatchBy::Height).margins;
        assert!((margins.collimator_vignetting_mm - (25.4 - 24.3964)).abs() < 1e-3, "{margins:?}");
        assert!(margins.all_hold(), "{margins:?}");
        assert!(!Margins { total_length_mm: -1e-9, ..margins }.all_hold());
    }
}
