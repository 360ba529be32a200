//! Physical forms of effects on points, none of them a template of the workbench: what a point's line of sight becomes.
//! Each is given its amplitude `a`, an angle in radians at half the camera's width, and what the campaign fixed.

use glam::DVec2;

use crate::formulas::Formula;

/// Tangent of half the camera's width of view, 8.05 deg.
pub(crate) const HALF: f64 = 0.141_312;
/// Radial distortion of the facility's lens, on tangents.
pub(crate) const K1: f64 = 0.35;

/// What an effect sees of a point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    /// Line of sight in the facility's axes, distorted.
    pub(crate) r: DVec2,
    /// Where the camera would see it without the effect, px.
    pub(crate) camera_px: DVec2,
    /// Where it is shown, px.
    pub(crate) screen_px: DVec2,
    pub(crate) count: f64,
    /// Irradiance relative to full.
    pub(crate) f: f64,
    pub(crate) time_s: f64,
    /// Share of the campaign that has passed.
    pub(crate) passed: f64,
    pub(crate) temperature_c: f64,
    /// What a part of the mount has of it, lagged.
    pub(crate) lagged_c: f64,
    pub(crate) row_load: f64,
    pub(crate) humidity: f64,
    /// 0, 1, 2: r, g, b; 3: w.
    pub(crate) channel: usize,
    /// Turn of the camera, rad.
    pub(crate) roll_rad: f64,
}

/// Constants of an effect that are drawn once for a campaign.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nature {
    /// A direction in the plane.
    pub(crate) along: DVec2,
    /// A shape parameter, 0 to 1.
    pub(crate) shape: f64,
    /// Time of a step as a share of the campaign, 0.2 to 0.8.
    pub(crate) step: f64,
    /// Of the formula, where the effect is one.
    pub(crate) seed: u64,
}

/// Effects on points that the catalogue knows.
pub(crate) const KNOWN: [&str; 21] = [
    "screen_tilt",
    "flux_coma",
    "knock",
    "radial_higher_order",
    "thermal_boresight",
    "decentering",
    "background_gradient",
    "lateral_colour",
    "screen_bow",
    "drift",
    "camera_pixel_phase",
    "camera_pointing",
    "flux_shift",
    "thermal_focal",
    "row_loading_shift",
    "colour_wedge",
    "roll_drift",
    "thin_prism",
    "screen_pixel_phase",
    "subpixel_offset",
    "optical_centre",
];

/// Effects that it does not know, with the columns they depend on.
pub(crate) const OUTSIDE: [(&str, &[&str]); 7] = [
    ("swirl", &["x", "y"]),
    ("dent", &["x", "y"]),
    ("breathing", &["time_s"]),
    ("anamorphic_in_time", &["time_s"]),
    ("anamorphic_with_temperature", &["temperature_c"]),
    ("humidity_shift", &["humidity"]),
    ("load_scale", &["row_load"]),
];

/// The effect that is a formula of its own in each set.
pub(crate) const FORMULA: &str = "formula";

/// Whether it needs points of several colours.
pub(crate) fn needs_colours(id: &str) -> bool {
    ["lateral_colour", "colour_wedge", "subpixel_offset"].contains(&id)
}

/// Line of sight with the effect in.
pub(crate) fn seen(id: &str, nature: &Nature, a: f64, p: &Point) -> DVec2 {
    let (r, u) = (p.r, p.r / HALF);
    let along = nature.along;
    match id {
        // A plane turned about an axis, then seen through the lens: D(H(u)).
        "screen_tilt" => {
            let flat = undistorted(r);
            distorted(flat / (1.0 + (along * a / (HALF * HALF)).dot(flat)))
        }
        // The camera looks aside: its own image plane turns.
        "camera_pointing" => {
            let turned = DVec2::from_angle(p.roll_rad).rotate(along);
            let turn = turned * a / (HALF * HALF);
            r / (1.0 + turn.dot(r)) + turn * 0.5 * a
        }
        // Brown's lens about another point, with its second radial term.
        "decentering" | "optical_centre" => {
            let offset = along * a / (3.0 * K1 * HALF * HALF);
            let lens = |d: DVec2| d * (K1 * d.length_squared() + 1.2 * d.length_squared().powi(2));
            r + lens(r - offset) - lens(r)
        }
        // A wedge of glass by Snell's law to third order in the field.
        "thin_prism" => r + along * a * (u.length_squared() + 0.12 * u.length_squared().powi(2)),
        // An equisolid lens instead of a tangent one: all odd orders.
        "radial_higher_order" => {
            let angle = r.length().atan() * 5.0;
            let law = 2.0 * (0.5 * angle).sin() - angle + angle.powi(3) / 24.0;
            let edge = HALF.atan() * 5.0;
            let at_edge = 2.0 * (0.5 * edge).sin() - edge + edge.powi(3) / 24.0;
            r + r.normalize_or_zero() * a * law / at_edge
        }
        // A saddle that flattens towards its rim.
        "screen_bow" => {
            let depth = (u.x * u.x - u.y * u.y) * along.x + 2.0 * u.x * u.y * along.y;
            r + u * a * depth / (1.0 + 0.25 * u.length_squared())
        }
        // Light in the coma's tail above the threshold, which saturates.
        "flux_coma" => {
            let half = 0.03 + 0.4 * nature.shape;
            r + u * u.length().powf(nature.shape) * a * (p.f / (p.f + half))
        }
        "flux_shift" => r + along * a * (p.f / (p.f + 0.02 + 0.3 * nature.shape)).powf(0.7),
        // Centroid of a spot on a slope: the slope's share of all light in the window.
        "background_gradient" => r + along * a * (0.004 / (p.f + 0.004 * nature.shape)),
        // Cauchy's dispersion at 605, 544, 475 nm and their mean.
        "lateral_colour" => {
            let c = [-0.62, -0.08, 0.83, 0.04][p.channel];
            r + u * a * c * (1.0 + 0.15 * u.length_squared())
        }
        "colour_wedge" => {
            r + along * a * [-0.62, -0.08, 0.83, 0.04][p.channel] * (1.0 + 0.1 * u.length_squared())
        }
        "subpixel_offset" => r + DVec2::X * a * [-1.0, 0.0, 1.0, 0.0][p.channel],
        "thermal_boresight" => r + along * a * (p.lagged_c - 20.0) / 2.0,
        "thermal_focal" => r * (1.0 + a / HALF * (p.lagged_c - 20.0) / 2.0),
        // Settling that slows down.
        "drift" => r + along * a * (1.0 - (-p.passed * (0.3 + 3.0 * nature.shape)).exp()),
        "roll_drift" => {
            let turn = a / HALF * (p.passed - 0.25 * nature.shape * p.passed * p.passed);
            DVec2::from_angle(turn).rotate(r)
        }
        // A step with a fast relaxation.
        "knock" => {
            let since = p.passed - nature.step;
            if since < 0.0 { r } else { r + along * a * (1.0 + 0.3 * (-since / 0.02).exp()) }
        }
        "camera_pixel_phase" => {
            let s = p.camera_px.map(|px| s_curve(px.rem_euclid(1.0) - 0.5, 0.42 + 0.15 * nature.shape));
            r + DVec2::from_angle(p.roll_rad).rotate(s * a / 0.05)
        }
        // Split over pixels whose counts are coarse: a sawtooth that is rounded off.
        "screen_pixel_phase" => {
            let saw = |px: f64| {
                let t = std::f64::consts::TAU * px;
                t.sin() + 0.22 * (2.0 * t).sin() + 0.07 * (3.0 * t).sin()
            };
            r + p.screen_px.map(saw) * a * (18.0 / p.count).powf(0.6 + 0.8 * nature.shape)
        }
        "row_loading_shift" => r + along * a * (p.row_load + 0.3 * p.row_load * p.row_load),
        "swirl" => DVec2::from_angle(a / HALF * u.length_squared()).rotate(r),
        "dent" => {
            let d = u - along * 0.5;
            r + d * a * (-d.length_squared() / 0.06).exp() * 3.0
        }
        "breathing" => r + along * a * (std::f64::consts::TAU * (5.5 * p.passed + nature.shape)).sin(),
        "anamorphic_in_time" => r + DVec2::new(u.x, -u.y) * a * (p.passed - 0.5),
        "anamorphic_with_temperature" => r + DVec2::new(u.x, -u.y) * a * (p.temperature_c - 20.0) / 2.0,
        "humidity_shift" => r + along * a * (p.humidity - 50.0) / 20.0,
        "load_scale" => r + u * a * (p.row_load - 0.5),
        FORMULA => r + Formula::of(nature.seed).value(p) * a,
        // An id is written in this file alone.
        _ => r,
    }
}

/// The facility's lens.
pub(crate) fn distorted(u: DVec2) -> DVec2 {
    u * (1.0 + K1 * u.length_squared())
}

fn undistorted(r: DVec2) -> DVec2 {
    let mut u = r;
    for _ in 0..20 {
        u = r / (1.0 + K1 * u.length_squared());
    }
    u
}

/// Error of a centre of mass over three pixels of a Gaussian spot that these integrate; `at` is the spot's place off the
/// middle pixel's centre and `sigma` its width, px.
fn s_curve(at: f64, sigma: f64) -> f64 {
    let light = |pixel: f64| {
        let steps = 16;
        (0..steps)
            .map(|k| pixel - 0.5 + (f64::from(k) + 0.5) / f64::from(steps))
            .map(|x| (-0.5 * ((x - at) / sigma).powi(2)).exp())
            .sum::<f64>()
    };
    let (left, middle, right) = (light(-1.0), light(0.0), light(1.0));
    (right - left) / (left + middle + right) - at
}

#[cfg(test)]
mod tests {
    /// A spot of 0.5 px that three pixels hold: its centroid is pulled towards the middle, and not at all at 0.
    #[test]
    fn a_window_pulls_a_centroid_to_its_middle() {
        assert!(super::s_curve(0.0, 0.5).abs() < 1e-12);
        assert!(super::s_curve(0.25, 0.5) < -1e-3 && super::s_curve(-0.25, 0.5) > 1e-3);
    }
}
