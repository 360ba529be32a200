//! Effects on readings of a power meter: what they add to a reading, relative to the nominal irradiance.

use retina_formats::{Channel, PowerEffect};

use crate::data::{Dataset, FoundGamma, Term};
use crate::series::median;

use super::{Entry, Variant, need, plain, to_unit};

pub(super) fn entry(effect: PowerEffect) -> Entry {
    use PowerEffect as E;
    match effect {
        E::Gamma => entry!(
            "a ln(B / 255): (B / 255)^(g + a), g the setup's exponent; `simulate power --effect gamma=G` takes the whole, G = g + a",
            "the facility's paper, radiometric calibration",
            &["digital_count"],
            "a = -0.2 to 0.2 beside g = 2.2: whole exponents 2.0 to 2.4",
            Some(("low_counts", "counts below 16")),
            gamma
        ),
        E::BlackLevel => entry!(
            "b per pixel, relative to a full one: of all its sub-pixels, or of the lit channel alone",
            "light of a black pixel",
            &["digital_count", "square_px"],
            "1e-5 to 1e-3",
            Some(("low_counts", "counts below 16")),
            black_level
        ),
        E::SquareLoading => entry!(
            "a N^p times the level",
            "line and supply loading",
            &["square_px"],
            "0.5 to 5 %",
            Some(("square", "other sizes at one irradiance")),
            loading
        ),
        E::PixelCrosstalk => entry!(
            "a / N: the square's perimeter over its area",
            "neighbouring pixels lend or take light",
            &["square_px"],
            "up to 40 % at low light",
            None,
            crosstalk
        ),
        E::SelfHeating => entry!(
            "a (1 - exp(-t / tau)), or a T",
            "efficiency falls as the display warms",
            &["time_s", "temperature_c"],
            "0.5 to 1 %/K",
            Some(("pause", "let the display cool and repeat")),
            self_heating
        ),
        E::Ageing => entry!(
            "-k D, D the dose shown so far",
            "luminance decay of emitters",
            &["time_s"],
            "1 to 5 % per 1000 h",
            Some(("pause", "let the display cool and repeat")),
            ageing
        ),
        E::MeterZero => entry!(
            "+ b",
            "offset of the meter",
            &["ln_irradiance"],
            "0.1 to 1 nW",
            Some(("dark_reading", "square of 0 pixels")),
            meter_zero
        ),
        E::MeterWavelength => entry!(
            "a_channel",
            "responsivity at another wavelength",
            &["channel"],
            "1 to 3 % per 5 nm",
            None,
            meter_wavelength
        ),
        E::MeterNonlinearity => entry!(
            "a I",
            "saturation of the meter",
            &["ln_irradiance"],
            "0.5 to 2 %",
            Some(("square", "other sizes at one irradiance")),
            nonlinearity
        ),
        E::ChannelNonadditivity => entry!(
            "a where r, g, b are lit together",
            "common supply of the sub-pixels",
            &["channel"],
            "0.5 to 2 %",
            None,
            nonadditivity
        ),
        E::AttenuatorNotChanged => entry!(
            "a constant factor on one series",
            "a range or filter recorded wrongly",
            &["series"],
            "factors of 2 to 10",
            None,
            attenuator
        ),
    }
}

fn term<'a>(name: &str, values: Vec<f64>) -> Term<'a> {
    Term::new(name, move |i| [values[i], 0.0])
}

fn lit(data: &Dataset, value: impl Fn(usize) -> f64) -> Vec<f64> {
    data.values("lit").iter().enumerate().map(|(i, lit)| if *lit > 0.0 { value(i) } else { 0.0 }).collect()
}

fn gamma(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    need(data, "digital_count")?;
    let level = data.values("level");
    let (leading, further) = match data.found_gamma {
        None => (
            term("exponent", lit(data, |i| level[i].ln())),
            term("exponent2", lit(data, |i| level[i].ln().powi(2))),
        ),
        // About an exponent a that was found, with L = B / 255 and the gain k: k (L^a - 1) is in proportion to a, and what
        // a little more of the exponent adds beyond that is the further term. The gain and the exponent are a product,
        // which no sum of theirs is.
        Some(FoundGamma { exponent: a, gain }) => {
            let whole = move |level: f64| gain * (level.powf(a) - 1.0) / a;
            let more = move |level: f64| gain * level.powf(a) * level.ln() - whole(level);
            (
                term("exponent", lit(data, |i| whole(level[i]))),
                term("exponent_more", lit(data, |i| more(level[i]))),
            )
        }
    };
    Ok(vec![Variant { shape: Vec::new(), leading: vec![leading], further: vec![further] }])
}

fn black_level(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    need(data, "digital_count")?;
    let (square, per) = (data.values("square_px"), data.values("per_irradiance"));
    // In units of the faintest reading's own light: all sub-pixels of the square, or those of the channel alone.
    let of = |shape: Vec<(&'static str, f64)>, part: &dyn Fn(usize) -> f64| {
        let values: Vec<f64> = (0..square.len()).map(|i| square[i] * square[i] * per[i] * part(i)).collect();
        let most = values.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let leading = vec![term("relative_to_faintest", values.iter().map(|v| v / most).collect())];
        Variant { shape, leading, further: Vec::new() }
    };
    let share = |i: usize| match Channel::COLOURS.iter().position(|c| *c == data.channel[i]) {
        Some(colour) => data.white_share[colour],
        None => 1.0,
    };
    let mut out = vec![of(Vec::new(), &|_| 1.0)];
    if data.channel.iter().any(|channel| *channel != data.channel[0]) {
        out.push(of(vec![("of_the_channel_alone", 1.0)], &share));
    }
    Ok(out)
}

fn loading(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let square = need(data, "square_px")?;
    let (level, most) = (data.values("level"), square.iter().copied().fold(0.0, f64::max));
    let forms = [(1, 0.0), (2, 0.0), (1, 1.0), (2, 1.0), (1, 2.2), (2, 2.2)];
    let values = |(p, q): (i32, f64)| lit(data, |i| (square[i] / most).powi(p) * level[i].powf(q));
    Ok(forms
        .into_iter()
        .map(|(p, q): (i32, f64)| Variant {
            shape: vec![("power_of_n", f64::from(p)), ("power_of_level", q)],
            leading: vec![term("relative", values((p, q)))],
            // Between the two powers, and what bends where the loss is large.
            further: vec![
                term("relative_other_power", values((3 - p, q))),
                term("relative_squared", values((2 * p, 2.0 * q))),
            ],
        })
        .collect())
}

fn crosstalk(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let square = need(data, "square_px")?;
    let level = data.values("level");
    Ok([0.0, -1.0]
        .into_iter()
        .map(|q: f64| {
            let value = |p: i32| {
                let values = lit(data, |i| square[i].powi(-p) * level[i].powf(q));
                let most = values.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
                values.iter().map(|v| v / most).collect::<Vec<f64>>()
            };
            Variant {
                shape: vec![("power_of_level", q)],
                leading: vec![term("relative", value(1))],
                further: vec![term("relative2", value(2))],
            }
        })
        .collect())
}

fn self_heating(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let mut out = Vec::new();
    if let Some(t) = data.varying("temperature_c") {
        let mean = t.iter().sum::<f64>() / t.len() as f64;
        out.push(Variant {
            shape: Vec::new(),
            leading: vec![term("relative_per_k", lit(data, |i| t[i] - mean))],
            further: Vec::new(),
        });
    }
    if let Some(time) = data.varying("time_s") {
        let run = runs(data, time);
        let start = time.iter().copied().fold(f64::INFINITY, f64::min);
        let longest = run.iter().copied().fold(0.0, f64::max);
        // From the campaign's start, and anew after each pause in which the display cools.
        let since_start: Vec<f64> = time.iter().map(|t| t - start).collect();
        let span = since_start.iter().copied().fold(0.0, f64::max);
        let mut kinds = vec![("tau_s", since_start, span)];
        if longest < span {
            kinds.push(("tau_after_each_pause_s", run, longest));
        }
        for (name, since, span) in kinds {
            for fraction in [0.03, 0.06, 0.12, 0.25, 0.5] {
                let tau_s = fraction * span;
                out.push(Variant {
                    shape: vec![(name, tau_s)],
                    leading: vec![term("relative", lit(data, |i| 1.0 - (-since[i] / tau_s).exp()))],
                    further: Vec::new(),
                });
            }
        }
    }
    if out.is_empty() {
        Err("columns `temperature_c` and `time_s` are missing or constant".into())
    } else {
        Ok(out)
    }
}

/// A gap of so many usual steps between readings is a pause: the display is off.
const PAUSE: f64 = 10.0;

/// Readings in the order of time, with the time for which each was shown: until the next one, or as long as usual before a
/// pause.
fn shown(time: &[f64]) -> Vec<(usize, f64)> {
    let mut order: Vec<usize> = (0..time.len()).collect();
    order.sort_by(|&a, &b| time[a].total_cmp(&time[b]));
    let steps: Vec<f64> = order.windows(2).map(|pair| time[pair[1]] - time[pair[0]]).collect();
    let usual = median(&steps);
    let last = order.last().map(|&last| (last, usual));
    let shown_s = |step: f64| if usual > 0.0 && step > PAUSE * usual { usual } else { step };
    order.iter().zip(&steps).map(|(&row, &step)| (row, shown_s(step))).chain(last).collect()
}

/// Time of each row since the campaign's start or the last pause.
fn runs(data: &Dataset, time: &[f64]) -> Vec<f64> {
    let order = shown(time);
    let mut out = vec![0.0; data.len()];
    let mut start = order.first().map_or(0.0, |(row, _)| time[*row]);
    for pair in order.windows(2) {
        let ((before, shown), (row, _)) = (pair[0], pair[1]);
        if time[row] - time[before] > shown {
            start = time[row];
        }
        out[row] = time[row] - start;
    }
    out
}

fn ageing(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let time = need(data, "time_s")?;
    let (level, square, ln) = (data.values("level"), data.values("square_px"), data.values("ln_irradiance"));
    let order = shown(time);
    let dose = |light: &dyn Fn(usize) -> f64| {
        let (mut dose, mut sum) = (vec![0.0; time.len()], 0.0);
        for &(row, shown) in &order {
            dose[row] = sum;
            sum += if square[row] > 0.0 { light(row) * shown } else { 0.0 };
        }
        to_unit(&dose)
    };
    // Of a pixel by its count or its light, of the whole display by the light that the meter sees; and the time alone.
    let forms = [
        ("relative_over_half_the_dose", dose(&|i| level[i])),
        ("relative_over_half_the_light", dose(&|i| ln[i].exp() / square[i].powi(2))),
        ("relative_over_half_the_irradiance", dose(&|i| ln[i].exp())),
        ("relative_over_half_the_time", to_unit(time)),
    ];
    Ok(forms
        .into_iter()
        .map(|(name, values)| Variant {
            shape: Vec::new(),
            leading: vec![term(name, lit(data, |i| values[i]))],
            further: Vec::new(),
        })
        .collect())
}

fn meter_zero(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    need(data, "ln_irradiance")?;
    let per = data.values("per_irradiance");
    let most = per.iter().copied().fold(0.0, f64::max);
    Ok(plain(vec![term("relative_to_faintest", per.iter().map(|p| p / most).collect())]))
}

fn meter_wavelength(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let single: Vec<Channel> =
        [Channel::G, Channel::R, Channel::B].into_iter().filter(|c| data.channel.contains(c)).collect();
    if single.len() < 2 {
        return Err("column `channel` has fewer than two of r, g and b".into());
    }
    // White has a share of each.
    let share =
        |of: Channel| Channel::COLOURS.iter().position(|c| *c == of).map_or(0.0, |c| data.white_share[c]);
    let leading = single[1..]
        .iter()
        .map(|&of| {
            let on = lit(data, |i| match data.channel[i] {
                Channel::W => share(of),
                colour => f64::from(u8::from(colour == of)),
            });
            term(&format!("{}_relative", of.letter()), on)
        })
        .collect();
    Ok(plain(leading))
}

fn nonlinearity(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let ln = need(data, "ln_irradiance")?;
    let most = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let relative = |p: f64| lit(data, |i| (p * (ln[i] - most)).exp());
    Ok(vec![Variant {
        shape: Vec::new(),
        leading: vec![term("relative_at_brightest", relative(1.0))],
        further: vec![term("squared", relative(2.0))],
    }])
}

fn nonadditivity(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let white = need(data, "channel_w")?;
    Ok(plain(vec![term("relative", lit(data, |i| white[i]))]))
}

fn attenuator(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    if !data.jitters {
        return Err("column `series` is missing in some rows".into());
    }
    if data.groups.len() < 3 || data.groups.len() > 200 {
        return Err(format!("column `series` has {} values, and 3 to 200 are needed", data.groups.len()));
    }
    Ok(data
        .groups
        .iter()
        .enumerate()
        .map(|(g, group)| {
            let rows = group.rows.clone();
            Variant {
                shape: vec![("series_index", g as f64)],
                leading: vec![term("factor_less_1", lit(data, |i| f64::from(u8::from(rows.contains(&i)))))],
                further: Vec::new(),
            }
        })
        .collect())
}
