//! What an effect is beyond its leading form: second orders and other shapes of its own, which show where it is strong.
//! They are taken out with it only where they lower the error of what is left out, and never name an effect.

use retina_formats::{Channel, EffectId, PointsEffect, PowerEffect};

use crate::data::Dataset;

use super::traced::{STEADY, coma_beside};

/// The further columns of a form, beside its leading and further ones; none of an effect whose form is whole.
pub(crate) fn wide(data: &Dataset, effect: EffectId, shape: &[(&'static str, f64)]) -> Vec<Vec<f64>> {
    match effect {
        EffectId::Points(effect) => points(data, effect, shape),
        EffectId::Power(effect) => power(data, effect),
        EffectId::Phase(_) | EffectId::Frames(_) => Vec::new(),
    }
}

/// What lenses that are not those of the setup make of an effect, beside its columns.
///
/// Before steady lenses, a shift d at u is moved by the radial term's own slope, d r^2 + 2 u (u.d), in proportion to the
/// distortion that the baseline fits: one column for each of the effect's. And of a display's depth other lenses make
/// something else than those that were traced: its leading form.
pub(crate) fn of_other_lenses(data: &Dataset, effect: EffectId, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    use PointsEffect as E;
    let EffectId::Points(effect) = effect else { return Vec::new() };
    // What lies behind the lenses.
    if matches!(effect, E::CameraPixelPhase | E::CameraPointing) {
        return Vec::new();
    }
    let (x, y) = (data.values("x"), data.values("y"));
    let bent = |column: &Vec<f64>| -> Vec<f64> {
        column
            .chunks_exact(2)
            .zip(x.iter().zip(y))
            .flat_map(|(d, (x, y))| {
                let (r2, along) = (x * x + y * y, 2.0 * (x * d[0] + y * d[1]));
                [d[0] * r2 + x * along, d[1] * r2 + y * along]
            })
            .collect()
    };
    let depths: &[fn(f64, f64) -> f64] = match effect {
        E::ScreenTilt => &[|x, _| x, |_, y| y],
        E::ScreenBow => &[|x, y| x * x - y * y, |x, y| x * y],
        _ => &[],
    };
    let leading = depths
        .iter()
        .map(|depth| x.iter().zip(y).flat_map(|(x, y)| scaled(*x, *y, depth(*x, *y))).collect::<Vec<f64>>());
    columns.iter().map(bent).chain(leading).collect()
}

/// Time constants of settling, of the table's time.
const SETTLING: [f64; 8] = [0.02, 0.035, 0.06, 0.1, 0.17, 0.3, 0.5, 0.9];

/// Forms that an effect has on a longer table than the one that named it. Mounts settle exponentially (K. Ogata, Modern
/// Control Engineering, sec. 5-2), which a power of the time is for a while alone.
pub(crate) fn later_forms(data: &Dataset, effect: EffectId) -> Vec<Vec<Vec<f64>>> {
    if effect != EffectId::Points(PointsEffect::Drift) {
        return Vec::new();
    }
    let time = data.values("time_s");
    let start = time.iter().copied().fold(f64::INFINITY, f64::min);
    let span = time.iter().copied().fold(f64::NEG_INFINITY, f64::max) - start;
    let settled = |part: f64, axis: usize| -> Vec<f64> {
        let value = |t: &f64| 1.0 - (-(t - start) / (part * span)).exp();
        time.iter().flat_map(|t| [0, 1].map(|own| if own == axis { value(t) } else { 0.0 })).collect()
    };
    SETTLING.iter().map(|part| vec![settled(*part, 0), settled(*part, 1)]).collect()
}

/// A vector over the field for each of the field's rows, times a value of the row.
type Placed = fn(f64, f64) -> [f64; 2];

fn points(data: &Dataset, effect: PointsEffect, shape: &[(&'static str, f64)]) -> Vec<Vec<f64>> {
    use PointsEffect as E;
    let (x, y) = (data.values("x"), data.values("y"));
    let times = |g: &dyn Fn(usize) -> f64, forms: &[Placed]| -> Vec<Vec<f64>> {
        forms
            .iter()
            .map(|form| (0..data.len()).flat_map(|i| form(x[i], y[i]).map(|v| v * g(i))).collect())
            .collect()
    };
    let one = |_: usize| 1.0;
    let shift: [Placed; 2] = [|_, _| [1.0, 0.0], |_, _| [0.0, 1.0]];
    let outwards: [Placed; 3] =
        [|x, y| [x, y], |x, y| scaled(x, y, x.hypot(y)), |x, y| scaled(x, y, x * x + y * y)];
    // A projective map squared, and its product with the lens's own distortion.
    let plane: [Placed; 7] = [
        |x, y| scaled(x, y, x * x),
        |x, y| scaled(x, y, x * y),
        |x, y| scaled(x, y, y * y),
        |x, y| scaled(x, y, x * (x * x + y * y)),
        |x, y| scaled(x, y, y * (x * x + y * y)),
        |x, y| [x * x + y * y, 0.0],
        |x, y| [0.0, x * x + y * y],
    ];
    // A lens about another point with its next radial terms, of which these are the derivatives.
    let lens: [Placed; 9] = [
        |x, y| scaled(x, y, x * (x * x + y * y)),
        |x, y| scaled(x, y, y * (x * x + y * y)),
        |x, y| [(x * x + y * y).powi(2), 0.0],
        |x, y| [0.0, (x * x + y * y).powi(2)],
        |x, y| scaled(x, y, x * x - y * y),
        |x, y| scaled(x, y, x * y),
        |x, y| scaled(x, y, (x * x + y * y).powi(2)),
        |x, y| [x * x + y * y, 0.0],
        |x, y| [0.0, x * x + y * y],
    ];
    let light = data.scaled("log10_irradiance").map(|(l, _)| l);
    let steady = shape.iter().find(|(name, _)| *name == STEADY).map(|(_, coma_um)| *coma_um);
    match effect {
        // Radial, of lenses as they are, and along one axis, of sub-pixels side by side, whose spots coma moves one by
        // one. A tilt beside it is not its own.
        E::FluxComa
            if let (Some(coma_um), Some(rays)) = (steady, data.display.and_then(|rays| rays.coma)) =>
        {
            let forms: [Placed; 6] = [
                |x, y| [x * x + y * y, 0.0],
                |x, y| [0.0, x * x + y * y],
                |x, y| scaled(x, y, x * x + y * y),
                |x, y| scaled(x, y, x.hypot(y).powi(4)),
                |x, y| scaled(x, y, x.hypot(y).powi(6)),
                |x, y| scaled(x, y, x.hypot(y).powi(8)),
            ];
            let mut own = coma_beside(data, &rays, coma_um);
            own.extend(times(&one, &forms));
            own
        }
        E::FluxShift if steady.is_some() => Vec::new(),
        E::ScreenTilt | E::CameraPointing => times(&one, &plane),
        E::Decentering | E::OpticalCentre => times(&one, &lens),
        E::ThinPrism => {
            let forms: [Placed; 4] = [
                |x, y| [(x * x + y * y).powi(3), 0.0],
                |x, y| [0.0, (x * x + y * y).powi(3)],
                |x, y| scaled(x, y, x),
                |x, y| scaled(x, y, y),
            ];
            times(&one, &forms)
        }
        E::RadialHigherOrder => {
            let forms: [Placed; 3] = [
                |x, y| scaled(x, y, x.hypot(y).powi(3)),
                |x, y| scaled(x, y, x.hypot(y).powi(5)),
                |x, y| scaled(x, y, x.hypot(y).powi(10)),
            ];
            times(&one, &forms)
        }
        E::ScreenBow => {
            let forms: [Placed; 4] = [
                |x, y| scaled(x, y, (x * x - y * y) * (x * x + y * y).powi(2)),
                |x, y| scaled(x, y, x * y * (x * x + y * y).powi(2)),
                |x, y| scaled(x, y, (x * x - y * y).powi(2)),
                |x, y| scaled(x, y, x * y * (x * x - y * y)),
            ];
            times(&one, &forms)
        }
        E::FluxComa => light.map_or_else(Vec::new, |l| {
            // Where the light shifts nothing is not known: a part of the form does not depend on it.
            let steady: [Placed; 2] = [outwards[1], |x, y| scaled(x, y, x.hypot(y).sqrt())];
            let with_light = (1..=5).flat_map(|k| {
                let forms: [Placed; 6] = [
                    outwards[0],
                    outwards[1],
                    outwards[2],
                    |x, y| scaled(x, y, x.hypot(y).powi(3)),
                    |x, y| scaled(x, y, (x * x + y * y).powi(2)),
                    |x, y| scaled(x, y, x.hypot(y).sqrt()),
                ];
                times(&|i| l[i].powi(k), &forms)
            });
            times(&one, &steady).into_iter().chain(with_light).collect()
        }),
        E::FluxShift => {
            light.map_or_else(Vec::new, |l| (2..=6).flat_map(|k| times(&|i| l[i].powi(k), &shift)).collect())
        }
        E::BackgroundGradient => {
            let l = data.values("log10_irradiance");
            let faintest = l.iter().copied().fold(f64::INFINITY, f64::min);
            [0.25, 0.75, 1.5, 3.0]
                .iter()
                .flat_map(|p| times(&|i| 10f64.powf(p * (faintest - l[i])), &shift))
                .collect()
        }
        E::LateralColour | E::ColourWedge => [Channel::R, Channel::B, Channel::W]
            .into_iter()
            .filter(|channel| data.channel.contains(channel))
            .flat_map(|channel| {
                let forms: &[Placed] = if effect == E::LateralColour {
                    &[|x, y| scaled(x, y, x * x + y * y), |x, y| scaled(x, y, (x * x + y * y).powi(2))]
                } else {
                    &[
                        |x, y| [x * x + y * y, 0.0],
                        |x, y| [0.0, x * x + y * y],
                        |x, y| scaled(x, y, x),
                        |x, y| scaled(x, y, y),
                    ]
                };
                times(&|i| f64::from(u8::from(data.channel[i] == channel)), forms)
            })
            .collect(),
        E::ThermalBoresight | E::ThermalFocal => {
            let forms: &[Placed] = if effect == E::ThermalFocal { &outwards[..1] } else { &shift };
            let lags = super::point_forms::lags(data).unwrap_or_default();
            let mut own: Vec<Vec<f64>> =
                lags.iter().flat_map(|(_, lagged)| times(&|i| lagged[i], forms)).collect();
            // A bench that was not as warm as its sensor when the first exposure was taken.
            if let Some(time) = data.varying("time_s") {
                let start = time.iter().copied().fold(f64::INFINITY, f64::min);
                let late = lags.iter().map(|(tau_s, _)| *tau_s).filter(|tau_s| *tau_s > 0.0);
                own.extend(late.flat_map(|tau_s| times(&|i| (-(time[i] - start) / tau_s).exp(), forms)));
            }
            own
        }
        E::Drift => powers_of_time(data, &[0.3, 0.5, 1.0, 2.0, 3.0], |p| times(p, &shift)),
        E::RollDrift => powers_of_time(data, &[0.5, 1.0, 2.0, 3.0], |p| times(p, &[|x, y| [-y, x]])),
        E::Knock => {
            // Each side of the step settles in its own way.
            let t0 = shape.iter().find(|(name, _)| *name == "t0_s").map_or(0.0, |(_, t0)| *t0);
            let time = data.values("time_s");
            let span = time.iter().copied().fold(f64::NEG_INFINITY, f64::max) - t0;
            [0.01, 0.06, 0.2]
                .iter()
                .flat_map(|fraction| {
                    let after = |i: usize| {
                        let since = time[i] - t0;
                        if since > 0.0 { (-since / (fraction * span)).exp() } else { 0.0 }
                    };
                    times(&after, &shift)
                })
                .collect()
        }
        E::RowLoadingShift => {
            let load = data.values("row_load");
            (2..=4).flat_map(|k| times(&|i| load[i].powi(k), &shift)).collect()
        }
        E::CameraPixelPhase => pixel_steps(data, ["camera_phase_x", "camera_phase_y"], &[0.0], true),
        E::ScreenPixelPhase => {
            pixel_steps(data, ["screen_phase_x", "screen_phase_y"], &[0.0, 1.0, 2.0], false)
        }
        E::SubpixelOffset => Vec::new(),
    }
}

fn scaled(x: f64, y: f64, by: f64) -> [f64; 2] {
    [x * by, y * by]
}

fn powers_of_time(
    data: &Dataset,
    powers: &[f64],
    columns: impl Fn(&dyn Fn(usize) -> f64) -> Vec<Vec<f64>>,
) -> Vec<Vec<f64>> {
    let time = data.values("time_s");
    let start = time.iter().copied().fold(f64::INFINITY, f64::min);
    let span = time.iter().copied().fold(f64::NEG_INFINITY, f64::max) - start;
    powers.iter().flat_map(|p| columns(&|i| ((time[i] - start) / span).powf(*p))).collect()
}

/// Any function of the phase of a pixel: steps, ramps and harmonics, times powers of the light. A display that shows
/// whole counts rounds a point's place, which is a step, and no sum of a few sines.
fn pixel_steps(data: &Dataset, names: [&str; 2], powers: &[f64], turns: bool) -> Vec<Vec<f64>> {
    /// Parts of a pixel between which a step may lie.
    const PARTS: usize = 12;
    let lowest = data.values("digital_count").iter().copied().fold(f64::INFINITY, f64::min);
    let mut out = Vec::new();
    for (axis, name) in names.into_iter().enumerate() {
        let phase = data.values(name);
        for &power in powers {
            let light = |i: usize| (lowest / data.values("digital_count")[i]).powf(power);
            let mut add = |form: &dyn Fn(f64) -> f64| {
                out.push(
                    (0..data.len())
                        .flat_map(|i| {
                            let value = form(phase[i]) * light(i);
                            let along = if axis == 0 { [value, 0.0] } else { [0.0, value] };
                            if !turns {
                                return along;
                            }
                            let (sin, cos) = data.roll_rad[data.mounting[i]].sin_cos();
                            [cos * along[0] - sin * along[1], sin * along[0] + cos * along[1]]
                        })
                        .collect(),
                );
            };
            add(&|phase| phase - 0.5);
            add(&|phase| (phase + 0.5).rem_euclid(1.0) - 0.5);
            for part in 1..PARTS {
                let from = part as f64 / PARTS as f64;
                add(&|phase| f64::from(u8::from(phase >= from)));
            }
        }
    }
    out
}

fn power(data: &Dataset, effect: PowerEffect) -> Vec<Vec<f64>> {
    use PowerEffect as E;
    let (level, square, lit) = (data.values("level"), data.values("square_px"), data.values("lit"));
    let of = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..data.len()).map(|i| if lit[i] > 0.0 { value(i) } else { 0.0 }).collect()
    };
    match effect {
        E::Gamma => vec![of(&|i| level[i].ln().powi(3))],
        E::BlackLevel => {
            let per = data.values("per_irradiance");
            vec![of(&|i| square[i] * square[i] * per[i] * level[i])]
        }
        E::SquareLoading => {
            let most = square.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
            [(1, 1.0), (2, 1.0), (2, 2.0), (3, 1.0), (4, 2.0)]
                .iter()
                .map(|(p, q)| of(&|i| (square[i] / most).powi(*p) * level[i].powf(*q)))
                .collect()
        }
        E::PixelCrosstalk => (2..=3).map(|p| of(&|i| square[i].max(1.0).powi(-p))).collect(),
        E::SelfHeating | E::Ageing => match data.varying("time_s") {
            Some(time) => {
                let start = time.iter().copied().fold(f64::INFINITY, f64::min);
                let span = time.iter().copied().fold(f64::NEG_INFINITY, f64::max) - start;
                [0.05, 0.15, 0.4]
                    .iter()
                    .map(|tau| of(&|i| 1.0 - (-(time[i] - start) / (tau * span)).exp()))
                    .collect()
            }
            None => Vec::new(),
        },
        E::MeterNonlinearity => {
            let ln = data.values("ln_irradiance");
            let most = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            [2.0, 3.0].iter().map(|p| of(&|i| (p * (ln[i] - most)).exp())).collect()
        }
        E::MeterZero | E::MeterWavelength | E::ChannelNonadditivity | E::AttenuatorNotChanged => Vec::new(),
    }
}
