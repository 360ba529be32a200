//! The textbook's leading forms, against which the physical ones are measured: R^2 says how far a form is from what a
//! fit of the leading form alone would take it for.

use glam::DVec2;

use crate::forms::{HALF, Nature, Point};

/// Columns of the leading form over the points; none for an effect outside the textbook.
pub(crate) fn of(id: &str, nature: &Nature, points: &[Point]) -> Vec<Vec<f64>> {
    let column = |form: &dyn Fn(&Point, DVec2) -> DVec2| -> Vec<f64> {
        points.iter().flat_map(|p| form(p, p.r / HALF).to_array()).collect()
    };
    let both = |g: &dyn Fn(&Point, DVec2) -> f64| {
        vec![column(&|p, u| DVec2::X * g(p, u)), column(&|p, u| DVec2::Y * g(p, u))]
    };
    match id {
        "screen_tilt" | "camera_pointing" => vec![column(&|_, u| u * u.x), column(&|_, u| u * u.y)],
        "decentering" | "optical_centre" => vec![
            column(&|_, u| DVec2::new(3.0 * u.x * u.x + u.y * u.y, 2.0 * u.x * u.y)),
            column(&|_, u| DVec2::new(2.0 * u.x * u.y, u.x * u.x + 3.0 * u.y * u.y)),
        ],
        "thin_prism" => both(&|_, u| u.length_squared()),
        "radial_higher_order" => vec![column(&|_, u| u * u.length_squared().powi(2))],
        "screen_bow" => {
            vec![column(&|_, u| u * (u.x * u.x - u.y * u.y)), column(&|_, u| u * (u.x * u.y))]
        }
        "flux_coma" => vec![column(&|p, u| u * u.length() * p.f.log10())],
        "flux_shift" => both(&|p, _| p.f.log10()),
        "background_gradient" => both(&|p, _| 1.0 / p.f),
        "lateral_colour" => (0..2).map(|c| column(&|p, u| u * f64::from(u8::from(p.channel == c)))).collect(),
        "colour_wedge" => (0..2).flat_map(|c| both(&|p, _| f64::from(u8::from(p.channel == c)))).collect(),
        "subpixel_offset" => vec![column(&|p, _| DVec2::X * [-1.0, 0.0, 1.0, 0.0][p.channel])],
        "thermal_boresight" => both(&|p, _| p.temperature_c),
        "thermal_focal" => vec![column(&|p, u| u * p.temperature_c)],
        "drift" => both(&|p, _| p.time_s),
        "roll_drift" => vec![column(&|p, u| DVec2::new(-u.y, u.x) * p.time_s)],

        "knock" => both(&|p, _| f64::from(u8::from(p.passed >= nature.step))),
        "camera_pixel_phase" => {
            let sine = |px: f64| (std::f64::consts::TAU * px).sin();
            vec![
                column(&|p, _| DVec2::X * sine(p.camera_px.x)),
                column(&|p, _| DVec2::Y * sine(p.camera_px.y)),
            ]
        }
        "screen_pixel_phase" => {
            let sine = |px: f64| (std::f64::consts::TAU * px).sin();
            vec![
                column(&|p, _| DVec2::X * sine(p.screen_px.x) / p.count),
                column(&|p, _| DVec2::Y * sine(p.screen_px.y) / p.count),
            ]
        }
        "row_loading_shift" => both(&|p, _| p.row_load),
        _ => Vec::new(),
    }
}
