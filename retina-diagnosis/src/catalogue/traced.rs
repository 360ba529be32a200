//! Forms that the setup's lenses give, by images of points through them: the display's depth, and coma.

use glam::DVec2;
use retina_geometry::{ComaForm, ComaShifts, RadialTable, SpotShifts};

use crate::data::{ARCSEC_PER_RAD, Dataset, DisplayDepth, Term};

use super::Variant;
use super::point_forms::{pair, powers_of_l, radial_term, xy};

/// What a depth that grows with a power of the display's height does to a line of sight, over what it would do if the
/// lenses were a pinhole near the axis; 1 where the lenses are not known. A display that is known to stand aside is moved
/// from there: what its whole depth does, over the depth.
fn plane_gain(data: &Dataset, x: f64, y: f64, power: i32) -> f64 {
    data.display.map_or(1.0, |rays| {
        let r = data.half_tan * x.hypot(y);
        let height = rays.height_over_tangent_mm(r) / rays.height_over_tangent_mm(0.0);
        let depth_mm = depth_mm(data, &rays, data.display_depth, [x, y]);
        let from_axis = data.distance_from_axis(DVec2::new(x, y));
        height.powi(power) * rays.tangent_per_depth(from_axis, depth_mm) / rays.tangent_per_depth(0.0, 0.0)
    })
}

/// How far a display of this tilt and bow stands away from the lenses where it shows the line of sight (x, y), mm.
pub(crate) fn depth_mm(data: &Dataset, rays: &SpotShifts, of: DisplayDepth, [x, y]: [f64; 2]) -> f64 {
    let DisplayDepth { tilt: [a, b], bow: [c, d] } = of;
    let height = rays.height_over_tangent_mm(data.half_tan * x.hypot(y)) / rays.height_over_tangent_mm(0.0);
    let arcsec = (a * x + b * y) * height + (c * (x * x - y * y) + d * x * y) * height * height;
    arcsec / (data.half_tan * ARCSEC_PER_RAD * rays.tangent_per_depth(0.0, 0.0))
}

pub(super) fn tilt(data: &Dataset, turns: bool) -> Vec<Term<'_>> {
    let (x, y) = xy(data);
    [(1.0, 0.0), (0.0, 1.0)]
        .into_iter()
        .zip(["a_arcsec", "b_arcsec"])
        .map(|((a, b), name)| {
            Term::new(name, move |i| {
                // Axes of the camera, in the facility's frame.
                let (sin, cos) = if turns { data.roll_rad[data.mounting[i]].sin_cos() } else { (0.0, 1.0) };
                let along = (a * cos - b * sin) * x[i] + (a * sin + b * cos) * y[i];
                let by = if turns { along } else { along * plane_gain(data, x[i], y[i], 1) };
                [by * x[i], by * y[i]]
            })
        })
        .collect()
}

pub(super) fn bow(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let (x, y) = xy(data);
    let with = move |g: fn(f64, f64) -> f64| {
        move |i: usize| {
            let depth = g(x[i], y[i]) * plane_gain(data, x[i], y[i], 2);
            [depth * x[i], depth * y[i]]
        }
    };
    Ok(vec![Variant {
        shape: Vec::new(),
        leading: vec![
            Term::new("a_arcsec", with(|x, y| x * x - y * y)),
            Term::new("b_arcsec", with(|x, y| x * y)),
        ],
        // A saddle that is steeper or flatter at its rim.
        further: vec![
            Term::new("a_r2_arcsec", with(|x, y| (x * x - y * y) * (x * x + y * y))),
            Term::new("b_r2_arcsec", with(|x, y| x * y * (x * x + y * y))),
        ],
    }])
}

/// Name of the shape of forms of coma that do not depend on the light: the coma they were traced for, um.
pub(crate) const STEADY: &str = "steady";

/// Factor by which a coma may differ from the one that its form was traced for.
const MUCH: f64 = 2.5;

/// The forms of growing coma: of all strengths that were traced, or of the one that was found.
fn coma_forms(data: &Dataset, rays: &ComaShifts) -> Vec<ComaForm> {
    data.found_coma.map_or_else(|| rays.growing.to_vec(), |found| vec![found])
}

/// A table's arcsec per um over the place, where it is in halves of the camera's width.
fn per_um(data: &Dataset, table: &RadialTable, place: DVec2) -> f64 {
    1e-3 * ARCSEC_PER_RAD * table.at(data.distance_from_axis(place))
}

/// What 1 um of coma moves a place by, arcsec.
fn moved_by(data: &Dataset, form: &ComaForm, place: DVec2) -> DVec2 {
    1e-3 * ARCSEC_PER_RAD * form.moved(data.half_tan * place, data.lens_axis()) / data.half_tan
}

/// Coma that grows with the field, um at half the camera's width: a form for each of the comas that were traced, since
/// bright cores do not move in proportion to it. Each has further columns: for a little more coma, and for lenses that are
/// not quite those of the design, that of another focus.
fn steady_coma(data: &Dataset, rays: ComaShifts) -> Vec<Variant<'_>> {
    let (x, y) = xy(data);
    let forms = coma_forms(data, &rays);
    let outwards = |name: &str, table: &RadialTable| {
        let values = (0..x.len()).map(|i| per_um(data, table, DVec2::new(x[i], y[i]))).collect();
        radial_term(data, name.to_owned(), 0, Some(values))
    };
    let weakest = forms.iter().map(|form| form.coma_mm.abs()).fold(f64::INFINITY, f64::min);
    forms
        .iter()
        .map(|form| {
            let own_um = 1e3 * form.coma_mm;
            let moved: Vec<[f64; 2]> =
                (0..x.len()).map(|i| moved_by(data, form, DVec2::new(x[i], y[i])).to_array()).collect();
            let mut leading = Term::new("coma_um", move |i: usize| moved[i]);
            // The weakest is that of all weaker ones, too.
            let least = if form.coma_mm.abs() <= weakest { 0.0 } else { own_um / MUCH };
            let most = MUCH * own_um;
            leading.plausible = Some([least.min(most), least.max(most)]);
            Variant {
                shape: vec![(STEADY, own_um)],
                leading: vec![leading],
                further: vec![
                    outwards("more_um", &form.beyond_proportion),
                    outwards("focus_um_mm", &form.coma_per_depth),
                ],
            }
        })
        .collect()
}

/// What lenses that are off make of a coma: its field about another point along x, y, and with a focus that is tilted.
pub(super) fn coma_beside(data: &Dataset, rays: &ComaShifts, coma_um: f64) -> Vec<Vec<f64>> {
    /// Half a step, in halves of the camera's width.
    const STEP: f64 = 0.01;
    let (x, y) = xy(data);
    let forms = coma_forms(data, rays);
    let Some(form) = forms.iter().find(|form| 1e3 * form.coma_mm == coma_um) else { return Vec::new() };
    let moved = |place: DVec2| moved_by(data, form, place);
    let column = |of: &dyn Fn(DVec2) -> DVec2| -> Vec<f64> {
        (0..x.len()).flat_map(|i| of(DVec2::new(x[i], y[i])).to_array()).collect()
    };
    [DVec2::X, DVec2::Y]
        .iter()
        .flat_map(|&axis| {
            [
                column(&|place| (moved(place + STEP * axis) - moved(place - STEP * axis)) / (2.0 * STEP)),
                column(&|place| per_um(data, &form.coma_per_depth, place) * place.dot(axis) * place),
            ]
        })
        .collect()
}

/// Coma that is the same all over the field, along the camera's axes: Q c + (P - Q) (c . e) e on the radius e.
fn steady_shift(data: &Dataset, rays: ComaShifts) -> Vec<Variant<'_>> {
    let (x, y) = xy(data);
    let term = |name: &str, axis: DVec2| {
        Term::new(name, move |i| {
            let coma = DVec2::from_angle(data.roll_rad[data.mounting[i]]).rotate(axis);
            let place = DVec2::new(x[i], y[i]);
            let r = data.distance_from_axis(place);
            let [along, across] =
                rays.tangent_per_even_coma.map(|per_mm| 1e-3 * ARCSEC_PER_RAD * per_mm.at(r));
            let radius = (data.half_tan * place - data.lens_axis()).normalize_or_zero();
            (across * coma + (along - across) * coma.dot(radius) * radius).to_array()
        })
    };
    let leading = vec![term("a_um", DVec2::X), term("b_um", DVec2::Y)];
    vec![Variant { shape: vec![(STEADY, 0.0)], leading, further: Vec::new() }]
}

/// Forms in the light, where it varies, and the steady one, where the lenses are known and a calibration holds what they
/// do by themselves: without it the lenses' own coma would be told as the objective's.
fn with_steady<'a>(
    data: &'a Dataset,
    in_light: Result<Vec<Variant<'a>>, String>,
    steady: fn(&'a Dataset, ComaShifts) -> Vec<Variant<'a>>,
) -> Result<Vec<Variant<'a>>, String> {
    let (Some(rays), Some(_)) = (data.display.and_then(|rays| rays.coma), &data.held) else {
        return in_light;
    };
    let mut forms = in_light.unwrap_or_default();
    forms.extend(steady(data, rays));
    Ok(forms)
}

pub(super) fn flux_coma(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    with_steady(data, coma_in_light(data), steady_coma)
}

fn coma_in_light(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let [l, l2, l3] = powers_of_l(data)?;
    Ok([0, 1, 2]
        .into_iter()
        .map(|p| {
            let mut further = Vec::new();
            for q in [0, 1, 2, 4] {
                for (k, g) in [&l, &l2, &l3].into_iter().enumerate() {
                    if (q, k) != (p, 0) {
                        further.push(radial_term(
                            data,
                            format!("l{}_r{q}_arcsec", k + 1),
                            q,
                            Some(g.clone()),
                        ));
                    }
                }
            }
            Variant {
                shape: vec![("power_of_r", f64::from(p))],
                leading: vec![radial_term(data, "amplitude_arcsec".into(), p, Some(l.clone()))],
                further,
            }
        })
        .collect())
}

pub(super) fn flux_shift(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    with_steady(data, shift_in_light(data), steady_shift)
}

fn shift_in_light(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let [l, l2, l3] = powers_of_l(data)?;
    let mut further = pair(l2, "2");
    further.extend(pair(l3, "3"));
    Ok(vec![Variant { shape: Vec::new(), leading: pair(l, ""), further }])
}
