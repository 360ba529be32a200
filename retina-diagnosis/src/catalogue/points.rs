//! Effects on points: what they add to a line of sight, arcsec at x = 1 (half the camera's width).

use crate::data::TableKind;

use super::point_forms::{
    background, bow, camera_phase, decentering, drift, flux_coma, flux_shift, knock, lateral_colour, radial,
    roll_drift, row_load, screen_phase, subpixel, thermal, thin_prism, tilt, wedge,
};
use super::{Effect, plain};

const QUADRATIC: &[&str] = &["screen_tilt", "camera_pointing", "decentering", "optical_centre", "thin_prism"];
const ROLL: Option<(&str, &str)> = Some(("camera_roll", "90 deg"));
const CYCLE: Option<(&str, &str)> = Some(("temperature_cycle", "two cycles over the campaign"));
const EXPOSURE: Option<(&str, &str)> = Some(("exposure_time", "change by a factor of 4"));
const DISPLAY: Option<(&str, &str)> = Some(("display_roll", "90 deg"));
const BROWN: &str = "D. C. Brown, Photogrammetric Engineering 32, 1966";
const PLANE: &str =
    "R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., sec. 2.3: homography, to first order";

pub(super) const EFFECTS: &[Effect] = &[
    effect!(
        Points,
        "screen_tilt",
        "a (x^2, x y) + b (x y, y^2)",
        PLANE,
        &["x", "y"],
        "7 arcsec per 0.1 deg",
        QUADRATIC,
        ROLL,
        |d| Ok(plain(tilt(d, false)))
    ),
    effect!(
        Points,
        "camera_pointing",
        "a (x^2, x y) + b (x y, y^2), in axes that turn with the camera",
        PLANE,
        &["x", "y"],
        "any",
        QUADRATIC,
        ROLL,
        |d| Ok(plain(tilt(d, true)))
    ),
    effect!(
        Points,
        "decentering",
        "a (r^2 + 2 x^2, 2 x y) + b (2 x y, r^2 + 2 y^2)",
        BROWN,
        &["x", "y"],
        "1 to 7 arcsec",
        QUADRATIC,
        ROLL,
        |d| Ok(plain(decentering(d)))
    ),
    effect!(
        Points,
        "optical_centre",
        "k1 about another point: a (r^2 + 2 x^2, 2 x y) + b (2 x y, r^2 + 2 y^2), tied to k1",
        BROWN,
        &["x", "y"],
        "2 px of the screen matter",
        QUADRATIC,
        Some(("magnification", "the other configuration")),
        |d| Ok(plain(decentering(d)))
    ),
    effect!(
        Points,
        "thin_prism",
        "(a, b) r^2",
        "J. Weng, P. Cohen, M. Herniou, IEEE PAMI 14, 1992",
        &["x", "y"],
        "1 to 5 arcsec",
        QUADRATIC,
        ROLL,
        thin_prism
    ),
    effect!(
        Points,
        "radial_higher_order",
        "a (x, y) r^4",
        BROWN,
        &["r"],
        "1 to 30 arcsec",
        &["radial_higher_order"],
        None,
        radial
    ),
    effect!(
        Points,
        "screen_bow",
        "a (x^2 - y^2) (x, y) + b x y (x, y)",
        "depth of a bent screen times the chief ray's slope",
        &["x", "y"],
        "1 to 6 arcsec",
        &["screen_bow"],
        None,
        bow
    ),
    effect!(
        Points,
        "flux_coma",
        "a g(L) r^p (x, y), L = log10 of the irradiance",
        "the facility's paper, Fig. 10",
        &["log10_irradiance", "r"],
        "1 to 15 arcsec",
        &["flux_coma"],
        None,
        flux_coma
    ),
    effect!(
        Points,
        "flux_shift",
        "(a, b) g(L)",
        "coma of a misaligned lens",
        &["log10_irradiance"],
        "0.5 to 5 arcsec",
        &["background_gradient", "flux_shift"],
        EXPOSURE,
        flux_shift
    ),
    effect!(
        Points,
        "background_gradient",
        "(a, b) / F",
        "centroid of a spot on a sloping background",
        &["log10_irradiance"],
        "0.1 to 5 arcsec",
        &["background_gradient", "flux_shift"],
        EXPOSURE,
        background
    ),
    effect!(
        Points,
        "lateral_colour",
        "c_channel (x, y)",
        "W. T. Welford, Aberrations of Optical Systems, ch. 10",
        &["channel", "r"],
        "1 to 10 arcsec",
        &["lateral_colour"],
        None,
        lateral_colour
    ),
    effect!(
        Points,
        "colour_wedge",
        "(a, b)_channel",
        "dispersion of a wedge",
        &["channel"],
        "0.5 to 3 arcsec",
        &["colour_wedge", "subpixel_offset"],
        DISPLAY,
        wedge
    ),
    effect!(
        Points,
        "subpixel_offset",
        "a (-1, 0, 1) / 3 screen pixels of r, g, b along x; a = 1, or -1 if the display is turned",
        "sub-pixels side by side",
        &["channel"],
        "a third of a screen pixel",
        &["colour_wedge", "subpixel_offset"],
        DISPLAY,
        subpixel
    ),
    effect!(
        Points,
        "thermal_boresight",
        "(a, b) T, T lagged by tau",
        "first-order thermal response",
        &["temperature_c"],
        "0.5 to 3 arcsec/K",
        &["drift", "thermal_boresight"],
        CYCLE,
        |d| thermal(d, false)
    ),
    effect!(
        Points,
        "thermal_focal",
        "a T (x, y), T lagged by tau",
        "expansion of the mount",
        &["temperature_c"],
        "0.7 arcsec/K at the edge",
        &["thermal_focal"],
        None,
        |d| thermal(d, true)
    ),
    effect!(
        Points,
        "drift",
        "(a, b) t^p",
        "settling of the mounts",
        &["time_s"],
        "1 to 5 arcsec/h",
        &["drift", "thermal_boresight"],
        CYCLE,
        drift
    ),
    effect!(
        Points,
        "roll_drift",
        "a t (-y, x)",
        "settling of the mounts",
        &["time_s"],
        "0.5 to 3 arcsec",
        &["roll_drift"],
        None,
        roll_drift
    ),
    effect!(
        Points,
        "knock",
        "(a, b) H(t - t0), or a step of roll, scale or tilt",
        "a sudden change of the mounts",
        &["time_s"],
        "1 to 100 arcsec",
        &["knock"],
        None,
        knock
    ),
    effect!(
        Points,
        "camera_pixel_phase",
        "(a sin 2 pi phi_x, b sin 2 pi phi_y) of the camera's pixels",
        "R. D. Anderson, I. R. King, PASP 112, 2000",
        &["camera_phase_x", "camera_phase_y"],
        "0.3 to 1.4 arcsec",
        &["camera_pixel_phase"],
        None,
        camera_phase
    ),
    effect!(
        Points,
        "screen_pixel_phase",
        "(a sin 2 pi phi_x, b sin 2 pi phi_y) of the screen's pixels, times 1 / DN^q",
        "split of a point over screen pixels",
        &["screen_phase_x", "screen_phase_y"],
        "some arcsec at low counts",
        &["screen_pixel_phase"],
        None,
        screen_phase
    ),
    effect!(
        Points,
        "row_loading_shift",
        "(a, b) row_load",
        "supply of a loaded row",
        &["row_load"],
        "0.5 to 2 arcsec",
        &["row_loading_shift"],
        None,
        row_load
    ),
];
