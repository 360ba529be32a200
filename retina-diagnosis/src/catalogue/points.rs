//! Effects on points: what they add to a line of sight, arcsec at x = 1 (half the camera's width).

use retina_formats::PointsEffect;

use super::point_forms::{
    background, camera_phase, decentering, drift, knock, lateral_colour, optical_centre, radial, roll_drift,
    row_load, screen_phase, subpixel, thermal, thin_prism, wedge,
};
use super::traced::{bow, flux_coma, flux_shift, tilt};
use super::{Entry, plain};

const ROLL: Option<(&str, &str)> = Some(("camera_roll", "90 deg"));
const CYCLE: Option<(&str, &str)> = Some(("temperature_cycle", "two cycles over the campaign"));
const EXPOSURE: Option<(&str, &str)> = Some(("exposure_time", "change by a factor of 4"));
const DISPLAY: Option<(&str, &str)> = Some(("display_roll", "90 deg"));
const BROWN: &str = "D. C. Brown, Photogrammetric Engineering 32, 1966";
const PLANE: &str =
    "R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., sec. 2.3: homography, to first order";

pub(super) fn entry(effect: PointsEffect) -> Entry {
    use PointsEffect as E;
    match effect {
        E::ScreenTilt => {
            entry!(
                "a (x^2, x y) + b (x y, y^2); behind known lenses: what they make of its depth",
                PLANE,
                &["x", "y"],
                "7 arcsec per 0.1 deg",
                ROLL,
                |d| Ok(plain(tilt(d, false)))
            )
        }
        E::CameraPointing => entry!(
            "a (x^2, x y) + b (x y, y^2), in axes that turn with the camera",
            PLANE,
            &["x", "y"],
            "any",
            ROLL,
            |d| Ok(plain(tilt(d, true)))
        ),
        E::Decentering => entry!(
            "a (r^2 + 2 x^2, 2 x y) + b (2 x y, r^2 + 2 y^2)",
            BROWN,
            &["x", "y"],
            "1 to 7 arcsec",
            ROLL,
            |d| Ok(plain(decentering(d)))
        ),
        E::OpticalCentre => entry!(
            "the distortion about another point; of k1: a (r^2 + 2 x^2, 2 x y) + b (2 x y, r^2 + 2 y^2)",
            BROWN,
            &["x", "y"],
            "2 px of the screen matter",
            Some(("magnification", "the other configuration")),
            |d| Ok(optical_centre(d))
        ),
        E::ThinPrism => entry!(
            "(a, b) r^2",
            "J. Weng, P. Cohen, M. Herniou, IEEE PAMI 14, 1992",
            &["x", "y"],
            "1 to 5 arcsec",
            ROLL,
            thin_prism
        ),
        E::RadialHigherOrder => entry!("a (x, y) r^4", BROWN, &["r"], "1 to 30 arcsec", None, radial),
        E::ScreenBow => entry!(
            "a (x^2 - y^2) (x, y) + b x y (x, y); behind known lenses: what they make of its depth",
            "depth of a bent screen times what depth does to a line of sight",
            &["x", "y"],
            "1 to 6 arcsec",
            None,
            bow
        ),
        E::FluxComa => entry!(
            "a l r^p (x, y), l = log10 of the irradiance from -1 at the faintest to 1 at the brightest point; steady: a K(r) (x, y), K by rays through a window",
            "the facility's paper, Fig. 10",
            &["log10_irradiance", "r"],
            "1 to 15 arcsec",
            None,
            flux_coma
        ),
        E::FluxShift => entry!(
            "(a, b) l, l = log10 of the irradiance from -1 at the faintest to 1 at the brightest point; steady: Q(r) (a, b) + (P(r) - Q(r)) ((a, b) . e) e on the radius e, P and Q by rays",
            "coma of a misaligned lens",
            &["log10_irradiance"],
            "0.5 to 5 arcsec",
            EXPOSURE,
            flux_shift
        ),
        E::BackgroundGradient => entry!(
            "(a, b) F_0 / F, F_0 the irradiance of the faintest point",
            "centroid of a spot on a sloping background",
            &["log10_irradiance"],
            "0.1 to 5 arcsec",
            EXPOSURE,
            background
        ),
        E::LateralColour => entry!(
            "c_channel (x, y)",
            "W. T. Welford, Aberrations of Optical Systems, ch. 10",
            &["channel", "r"],
            "1 to 10 arcsec",
            None,
            lateral_colour
        ),
        E::ColourWedge => {
            entry!("(a, b)_channel", "dispersion of a wedge", &["channel"], "0.5 to 3 arcsec", DISPLAY, wedge)
        }
        E::SubpixelOffset => entry!(
            "a (-1, 0, 1) / 3 screen pixels of r, g, b along x; a = 1, or -1 if the display is turned",
            "sub-pixels side by side",
            &["channel"],
            "a third of a screen pixel",
            DISPLAY,
            subpixel
        ),
        E::ThermalBoresight => entry!(
            "(a, b) T, T lagged by tau",
            "first-order thermal response",
            &["temperature_c"],
            "0.5 to 3 arcsec/K",
            CYCLE,
            |d| thermal(d, false)
        ),
        E::ThermalFocal => entry!(
            "a T (x, y), T lagged by tau; with a lens model as baseline, a longer focal length of that lens",
            "expansion of the mount",
            &["temperature_c"],
            "0.7 arcsec/K at the edge",
            None,
            |d| thermal(d, true)
        ),
        E::Drift => {
            entry!("(a, b) t^p", "settling of the mounts", &["time_s"], "1 to 5 arcsec/h", CYCLE, drift)
        }
        E::RollDrift => {
            entry!("a t (-y, x)", "settling of the mounts", &["time_s"], "0.5 to 3 arcsec", None, roll_drift)
        }
        E::Knock => entry!(
            "(a, b) H(t - t0), or a step of roll, scale or tilt",
            "a sudden change of the mounts",
            &["time_s"],
            "1 to 100 arcsec",
            None,
            knock
        ),
        E::CameraPixelPhase => entry!(
            "(a sin 2 pi phi_x, b sin 2 pi phi_y) of the camera's pixels",
            "R. D. Anderson, I. R. King, PASP 112, 2000",
            &["camera_phase_x", "camera_phase_y"],
            "0.3 to 1.4 arcsec",
            None,
            camera_phase
        ),
        E::ScreenPixelPhase => entry!(
            "(a sin 2 pi phi_x, b sin 2 pi phi_y) of the screen's pixels, times 1 / DN^q",
            "split of a point over screen pixels",
            &["screen_phase_x", "screen_phase_y"],
            "some arcsec at low counts",
            None,
            screen_phase
        ),
        E::RowLoadingShift => entry!(
            "(a, b) row_load",
            "supply of a loaded row",
            &["row_load"],
            "0.5 to 2 arcsec",
            None,
            row_load
        ),
    }
}
