//! The forms of effects on points: columns over a campaign's rows.

use std::sync::Arc;

use glam::{DMat2, DVec2};
use retina_formats::Channel;

use crate::data::{Dataset, Term, longer_focal};
use crate::field::Held;
use crate::following::lagged;

use super::{Variant, need, plain, step_times, to_unit};

pub(super) fn xy(data: &Dataset) -> (&[f64], &[f64]) {
    (data.values("x"), data.values("y"))
}

pub(super) fn decentering(data: &Dataset) -> Vec<Term<'_>> {
    let (x, y) = xy(data);
    vec![
        Term::new("a_arcsec", move |i| [3.0 * x[i] * x[i] + y[i] * y[i], 2.0 * x[i] * y[i]]),
        Term::new("b_arcsec", move |i| [2.0 * x[i] * y[i], x[i] * x[i] + 3.0 * y[i] * y[i]]),
    ]
}

/// What a shift of the display by a unit of tangent moves a row's line of sight by, beyond a shift of the whole field: of
/// the calibration that is held, or of the lenses. `None` where neither is known.
fn by_display_shift(data: &Dataset, row: usize) -> Option<DMat2> {
    let held = match &data.held {
        Some(Held::Geometry(model)) => model.sight_per_displayed(row),
        _ => None,
    };
    let slope = held.or_else(|| {
        let (x, y) = xy(data);
        let u = [x[row], y[row]].map(|c| c * data.half_tan);
        Some(DMat2::from_cols_array_2d(&data.display?.sight_per_displayed(u)))
    })?;
    Some(slope - DMat2::IDENTITY)
}

/// The lens's own distortion about another point, in arcsec of Brown's decentring that is nearest to it.
pub(super) fn optical_centre(data: &Dataset) -> Vec<Variant<'_>> {
    let Some((columns, gain)) = about_another_point(data) else { return plain(decentering(data)) };
    let columns = Arc::new(columns);
    let term = |name: &str, axis: usize| {
        let columns = columns.clone();
        Term::new(name, move |i| (columns[i].col(axis) / gain).to_array())
    };
    plain(vec![term("a_arcsec", 0), term("b_arcsec", 1)])
}

/// What a shift of the display by one arcsec is in the amplitudes of [`optical_centre`]; `None` where neither lenses nor
/// calibration are known, or they bend nothing.
pub(crate) fn optical_centre_gain(data: &Dataset) -> Option<f64> {
    about_another_point(data).map(|(_, gain)| gain)
}

/// Distortion below this part of a shift is none.
const BENDS: f64 = 1e-5;

fn about_another_point(data: &Dataset) -> Option<(Vec<DMat2>, f64)> {
    let columns = (0..data.len()).map(|row| by_display_shift(data, row)).collect::<Option<Vec<DMat2>>>()?;
    let (x, y) = xy(data);
    let (mut cross, mut square) = (0.0, 0.0);
    for (i, column) in columns.iter().enumerate() {
        let brown = DMat2::from_cols(
            DVec2::new(3.0 * x[i] * x[i] + y[i] * y[i], 2.0 * x[i] * y[i]),
            DVec2::new(2.0 * x[i] * y[i], x[i] * x[i] + 3.0 * y[i] * y[i]),
        );
        for axis in 0..2 {
            cross += brown.col(axis).dot(column.col(axis));
            square += brown.col(axis).length_squared();
        }
    }
    let gain = cross / square;
    (gain.abs() > BENDS).then_some((columns, gain))
}

pub(super) fn thin_prism(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let (x, y) = xy(data);
    let r2: Vec<f64> = x.iter().zip(y).map(|(x, y)| x * x + y * y).collect();
    let further = pair(r2.iter().map(|r2| r2 * r2).collect(), "_r4");
    Ok(vec![Variant { shape: Vec::new(), leading: pair(r2, ""), further }])
}

/// (x, y) r^power g.
pub(super) fn radial_term<'a>(data: &'a Dataset, name: String, power: i32, g: Option<Vec<f64>>) -> Term<'a> {
    let (x, y) = xy(data);
    Term::new(name, move |i| {
        let value = (x[i] * x[i] + y[i] * y[i]).sqrt().powi(power) * g.as_ref().map_or(1.0, |g| g[i]);
        [x[i] * value, y[i] * value]
    })
}

/// (g, 0) and (0, g).
pub(super) fn pair<'a>(g: Vec<f64>, suffix: &str) -> Vec<Term<'a>> {
    let h = g.clone();
    vec![
        Term::new(format!("a{suffix}_arcsec"), move |i| [g[i], 0.0]),
        Term::new(format!("b{suffix}_arcsec"), move |i| [0.0, h[i]]),
    ]
}

pub(super) fn radial(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let mut further: Vec<Term<'_>> =
        [6, 8].map(|p| radial_term(data, format!("r{p}_arcsec"), p, None)).into();
    further.push(radial_term(data, "r1_arcsec".into(), 1, None));
    Ok(vec![Variant {
        shape: Vec::new(),
        leading: vec![radial_term(data, "amplitude_arcsec".into(), 4, None)],
        further,
    }])
}

/// L from 0 at its middle, and its powers.
pub(super) fn powers_of_l(data: &Dataset) -> Result<[Vec<f64>; 3], String> {
    need(data, "log10_irradiance")?;
    let (unit, _) = data.scaled("log10_irradiance").ok_or("column `log10_irradiance` is constant")?;
    Ok([1, 2, 3].map(|p| unit.iter().map(|l| l.powi(p)).collect()))
}

pub(super) fn background(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let l = need(data, "log10_irradiance")?;
    let faintest = l.iter().copied().fold(f64::INFINITY, f64::min);
    // Relative to the faintest: the amplitude is what that point moves by.
    let per = |p: f64| -> Vec<f64> { l.iter().map(|l| 10f64.powf(p * (faintest - l))).collect() };
    // A window takes in more of the slope where a spot is faint or wide.
    let mut further = pair(per(2.0), "_square");
    further.extend(pair(per(0.5), "_root"));
    Ok(vec![Variant { shape: Vec::new(), leading: pair(per(1.0), ""), further }])
}

fn channels(data: &Dataset) -> Result<Vec<Channel>, String> {
    let lit: Vec<Channel> = [Channel::G, Channel::W, Channel::R, Channel::B]
        .into_iter()
        .filter(|channel| data.channel.contains(channel))
        .collect();
    // The first is the reference, which the baseline has.
    if lit.len() < 2 { Err("column `channel` is missing or constant".into()) } else { Ok(lit[1..].to_vec()) }
}

pub(super) fn lateral_colour(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let (mut leading, mut further) = (Vec::new(), Vec::new());
    for channel in channels(data)? {
        let name = channel.letter();
        let here: Vec<f64> = data.channel.iter().map(|c| f64::from(u8::from(*c == channel))).collect();
        leading.push(radial_term(data, format!("{name}_arcsec"), 0, Some(here.clone())));
        further.push(radial_term(data, format!("{name}_r2_arcsec"), 2, Some(here)));
    }
    Ok(vec![Variant { shape: Vec::new(), leading, further }])
}

pub(super) fn wedge(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let (x, y) = xy(data);
    let (mut leading, mut further) = (Vec::new(), Vec::new());
    for channel in channels(data)? {
        let name = channel.letter();
        let here: Vec<f64> = data.channel.iter().map(|c| f64::from(u8::from(*c == channel))).collect();
        let outwards = (0..here.len()).map(|i| here[i] * (x[i] * x[i] + y[i] * y[i])).collect();
        leading.extend(pair(here, &format!("_{name}")));
        further.extend(pair(outwards, &format!("_{name}_r2")));
    }
    Ok(vec![Variant { shape: Vec::new(), leading, further }])
}

pub(super) fn subpixel(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    channels(data)?;
    let third = data.screen_pixel_arcsec / 3.0;
    let offset = move |i: usize| {
        third
            * match data.channel[i] {
                Channel::R => -1.0,
                Channel::G | Channel::W => 0.0,
                Channel::B => 1.0,
            }
    };
    Ok(plain(vec![Term::new("of_a_third_of_a_pixel", move |i| [offset(i), 0.0])]))
}

/// The temperature beside its mean, and lagged by several times, each with its lag in seconds.
pub(super) fn lags(data: &Dataset) -> Result<Vec<(f64, Vec<f64>)>, String> {
    let temperature = need(data, "temperature_c")?;
    let mut forms: Vec<(f64, Vec<f64>)> = vec![(0.0, temperature.to_vec())];
    if let Some(time) = data.varying("time_s") {
        let (low, high) =
            time.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &t| (l.min(t), h.max(t)));
        for fraction in [0.02, 0.05, 0.1, 0.2, 0.4] {
            let tau_s = fraction * (high - low);
            forms.push((tau_s, lagged(&data.mounting, time, temperature, tau_s)));
        }
    }
    let mean = temperature.iter().sum::<f64>() / temperature.len() as f64;
    for (_, values) in &mut forms {
        values.iter_mut().for_each(|value| *value -= mean);
    }
    Ok(forms)
}

pub(super) fn thermal(data: &Dataset, focal: bool) -> Result<Vec<Variant<'_>>, String> {
    let forms = lags(data)?;
    let lens = data.lens.as_ref().filter(|_| focal).map(|lens| Arc::new(longer_focal(data, lens)));
    let columns = |k: usize, suffix: &str| {
        let values = forms[k].1.clone();
        if focal {
            let name = format!("a{suffix}_arcsec_per_k");
            vec![match lens.clone() {
                None => radial_term(data, name, 0, Some(values)),
                Some(outwards) => Term::new(name, move |i| outwards[i].map(|along| along * values[i])),
            }]
        } else {
            pair(values, &format!("{suffix}_per_k"))
        }
    };
    Ok((0..forms.len())
        .map(|k| {
            // Between two lags of the list, and where two parts lag differently.
            let mut further = Vec::new();
            if k > 0 {
                further.extend(columns(k - 1, "_less_lag"));
            }
            if k + 1 < forms.len() {
                further.extend(columns(k + 1, "_more_lag"));
            }
            Variant { shape: vec![("tau_s", forms[k].0)], leading: columns(k, ""), further }
        })
        .collect())
}

pub(super) fn drift(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let time = need(data, "time_s")?;
    let start = time.iter().copied().fold(f64::INFINITY, f64::min);
    let span = time.iter().copied().fold(f64::NEG_INFINITY, f64::max) - start;
    let power = |p: f64| time.iter().map(|t| ((t - start) / span).powf(p)).collect::<Vec<f64>>();
    Ok([1.0, 0.5, 2.0]
        .into_iter()
        .map(|p| Variant {
            shape: vec![("power_of_t", p)],
            leading: pair(power(p), ""),
            further: [1.0, 0.5, 2.0]
                .into_iter()
                .filter(|other| *other != p)
                .flat_map(|other| pair(power(other), &format!("_t{other}")))
                .collect(),
        })
        .collect())
}

pub(super) fn roll_drift(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let (x, y) = xy(data);
    let t = to_unit(need(data, "time_s")?);
    let t2: Vec<f64> = t.iter().map(|t| t * t).collect();
    let term = |name: &str, g: Vec<f64>| Term::new(name, move |i| [-y[i] * g[i], x[i] * g[i]]);
    Ok(vec![Variant {
        shape: Vec::new(),
        leading: vec![term("a_arcsec", t)],
        further: vec![term("a2_arcsec", t2)],
    }])
}

/// What steps: numbers that name it in the shape.
const STEPS: [&str; 4] = ["shift", "roll", "scale", "tilt"];
/// What settles after a step does so within this part of the campaign.
const SETTLING: f64 = 0.03;
/// Times at which a step is looked for.
const STEP_TIMES: usize = 40;

pub(super) fn knock(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let (x, y) = xy(data);
    let time = need(data, "time_s")?;
    let span = time.iter().copied().fold(f64::NEG_INFINITY, f64::max)
        - time.iter().copied().fold(f64::INFINITY, f64::min);
    let mut out = Vec::new();
    for t0 in step_times(data, time, STEP_TIMES) {
        for name in STEPS {
            let after = move |i: usize| f64::from(u8::from(time[i] > t0));
            let term = |suffix: &str, value: fn(f64, f64) -> [f64; 2]| {
                Term::new(format!("{name}{suffix}_arcsec"), move |i| value(x[i], y[i]).map(|v| v * after(i)))
            };
            let leading = match name {
                "shift" => vec![term("_x", |_, _| [1.0, 0.0]), term("_y", |_, _| [0.0, 1.0])],
                "roll" => vec![term("", |x, y| [-y, x])],
                "scale" => vec![term("", |x, y| [x, y])],
                _ => vec![term("_a", |x, y| [x * x, x * y]), term("_b", |x, y| [x * y, y * y])],
            };
            let further = if name == "shift" {
                let settling = time
                    .iter()
                    .map(|t| if *t > t0 { (-(t - t0) / (SETTLING * span)).exp() } else { 0.0 })
                    .collect();
                pair(settling, "_settling")
            } else {
                Vec::new()
            };
            out.push(Variant { shape: vec![("t0_s", t0)], leading, further });
        }
    }
    Ok(out)
}

/// Below this the camera's axes are the facility's.
const SMALL_ROLL_RAD: f64 = 0.03;

/// A form over a pixel, 0 to 1.
type OfPhase = fn(f64) -> f64;

/// What a window of whole pixels does to a centroid: the wings that it cuts off pull towards the middle of the pixel, and
/// where the window moves on by a pixel the pull changes its sign at once. The first harmonic is the small one of a wide
/// spot; a narrow one's is a sawtooth.
pub(super) fn camera_phase(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let (px, py) = (need(data, "camera_phase_x")?, need(data, "camera_phase_y")?);
    let aligned = data.roll_rad.len() == 1 && data.roll_rad[0].abs() < SMALL_ROLL_RAD;
    // The camera's axes in the facility's frame.
    let turned = move |i: usize, v: [f64; 2]| {
        if aligned {
            return v;
        }
        let (sin, cos) = data.roll_rad[data.mounting[i]].sin_cos();
        [cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]]
    };
    fn sine(phase: f64, harmonic: f64) -> f64 {
        (std::f64::consts::TAU * harmonic * phase).sin()
    }
    let along = |name: &str, form: OfPhase| {
        [
            Term::new(format!("a{name}_arcsec"), move |i| turned(i, [form(px[i]), 0.0])),
            Term::new(format!("b{name}_arcsec"), move |i| turned(i, [0.0, form(py[i])])),
        ]
    };
    let further: [(&str, OfPhase); 4] = [
        ("_saw", |phase| 0.5 - phase),
        ("2", |phase| sine(phase, 2.0)),
        ("3", |phase| sine(phase, 3.0)),
        ("4", |phase| sine(phase, 4.0)),
    ];
    Ok(vec![Variant {
        shape: Vec::new(),
        leading: along("", |phase| sine(phase, 1.0)).into(),
        further: further.into_iter().flat_map(|(name, form)| along(name, form)).collect(),
    }])
}

fn phase_terms<'a>(px: &'a [f64], py: &'a [f64], harmonic: f64, g: Vec<f64>, name: &str) -> Vec<Term<'a>> {
    let sine = move |phase: f64| (std::f64::consts::TAU * harmonic * phase).sin();
    let h = g.clone();
    vec![
        Term::new(format!("a{name}_arcsec"), move |i| [sine(px[i]) * g[i], 0.0]),
        Term::new(format!("b{name}_arcsec"), move |i| [0.0, sine(py[i]) * h[i]]),
    ]
}

pub(super) fn screen_phase(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let (px, py) = (need(data, "screen_phase_x")?, need(data, "screen_phase_y")?);
    let lowest = data.values("digital_count").iter().copied().fold(f64::INFINITY, f64::min);
    let light = move |q: f64| -> Vec<f64> {
        data.values("digital_count").iter().map(|b| (lowest / b).powf(q)).collect()
    };
    Ok([0.0, 1.0, 2.0]
        .into_iter()
        .map(|q| {
            let mut further = phase_terms(px, py, 2.0, light(q), "_2nd");
            further.extend(phase_terms(px, py, 1.0, light(if q == 1.0 { 0.0 } else { 1.0 }), "_other"));
            Variant {
                shape: vec![("power_of_count", q)],
                leading: phase_terms(px, py, 1.0, light(q), ""),
                further,
            }
        })
        .collect())
}

pub(super) fn row_load(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let load = need(data, "row_load")?;
    let further = pair(load.iter().map(|load| load * load).collect(), "_square");
    Ok(vec![Variant { shape: Vec::new(), leading: pair(load.to_vec(), ""), further }])
}
