//! An accepted effect as a quantity of the bench, with what to do about it.

use retina_formats::{EffectId, PointsEffect, PowerEffect};

use crate::catalogue::{STEADY, optical_centre_gain};
use crate::data::{ARCSEC_PER_RAD, Dataset};
use crate::estimate::Parameter;

/// A quantity that somebody at the bench can read or turn.
#[derive(Debug, Clone)]
pub struct Physical {
    /// What the effect is called at this size, where its id says another thing.
    pub called: Option<&'static str>,
    /// What it is.
    pub parameter: &'static str,
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// Standard deviation.
    pub sigma: f64,
    /// What to do, with signs and axes.
    pub remedy: String,
}

/// Two components of a direction in the facility's axes, with their standard deviations.
struct Along {
    x: [f64; 2],
    y: [f64; 2],
}

impl Along {
    /// Of the first two parameters, times a factor.
    fn of(parameters: &[Parameter], factor: f64) -> Option<Self> {
        let [a, b] = [parameters.first()?, parameters.get(1)?];
        let scaled = |p: &Parameter| Some([p.value * factor, p.sigma? * factor.abs()]);
        Some(Self { x: scaled(a)?, y: scaled(b)? })
    }

    fn size(&self) -> [f64; 2] {
        let size = self.x[0].hypot(self.y[0]);
        let variance = (self.x[0] * self.x[1]).powi(2) + (self.y[0] * self.y[1]).powi(2);
        [size, if size > 0.0 { variance.sqrt() / size } else { self.x[1] }]
    }

    fn text(&self, unit: &str) -> String {
        format!(
            "x {:+.3} +- {:.3} {unit}, y {:+.3} +- {:.3} {unit}",
            self.x[0], self.x[1], self.y[0], self.y[1]
        )
    }
}

/// The quantity that an effect is on this bench; `None` where the catalogue's amplitude is all that can be said.
/// `parameters` are the effect's own, `k1_arcsec` the baseline's radial term where it is fitted.
///
/// A camera turned by tau moves a line of sight u (tangents) by -tau (u . e) u, which in units of half the camera's width
/// w is tau w^2; a display turned by tau by k tau (u . e) u, k from rays ([`retina_geometry::SpotShifts`]).
/// A roll by rho moves the edge by rho w, a focal length that is longer by a part eps by eps w.
pub(crate) fn physical(
    data: &Dataset,
    effect: EffectId,
    parameters: &[Parameter],
    k1_arcsec: Option<f64>,
) -> Option<Physical> {
    match effect {
        EffectId::Points(effect) => of_points(data, effect, parameters, k1_arcsec),
        EffectId::Power(effect) => of_power(data, effect, parameters),
        EffectId::Phase(_) | EffectId::Frames(_) => None,
    }
}

fn of_points(
    data: &Dataset,
    effect: PointsEffect,
    parameters: &[Parameter],
    k1_arcsec: Option<f64>,
) -> Option<Physical> {
    use PointsEffect as E;
    let w = data.half_tan;
    let deg = (1.0 / ARCSEC_PER_RAD / (w * w)).to_degrees();
    let made = |parameter, [value, sigma]: [f64; 2], unit, remedy| {
        Some(Physical { called: None, parameter, value, unit, sigma, remedy })
    };
    let one = |factor: f64| -> Option<[f64; 2]> {
        let p = parameters.first()?;
        Some([p.value * factor, p.sigma? * factor.abs()])
    };
    let span_h = || {
        let (low, high) = data.covariate("time_s")?.range();
        (high > low).then_some((high - low) / 3600.0)
    };
    let shape = |name: &str| parameters.iter().find(|p| p.name.ends_with(name)).map(|p| p.value);
    // What follows the logged temperature late must not be corrected by that itself.
    let lag = || match shape("tau_s") {
        Some(tau_s) if tau_s > 0.0 => {
            format!(" of the temperature as the bench follows it, late by {tau_s:.0} s (first order)")
        }
        _ => String::new(),
    };
    match effect {
        E::ScreenTilt => {
            // A pinhole's display that is turned away on its +x side shows a smaller x there: its gain is -1.
            let gain = data.display.map_or(-1.0, |rays| rays.tilt_gain());
            let along = Along::of(parameters, deg / gain)?;
            let side = |away: f64| if away > 0.0 { "towards the lenses" } else { "away from the lenses" };
            let remedy = format!(
                "turn the display back: its +x side by {:.3} +- {:.3} deg {}, its +y side by {:.3} +- {:.3} deg {}{}",
                along.x[0].abs(),
                along.x[1],
                side(along.x[0]),
                along.y[0].abs(),
                along.y[1],
                side(along.y[0]),
                if data.display.is_some() { "" } else { " (as if it stood behind one thin lens)" }
            );
            made("tilt", along.size(), "deg", remedy)
        }
        E::CameraPointing => {
            let along = Along::of(parameters, -deg)?;
            let back = Along { x: [-along.x[0], along.x[1]], y: [-along.y[0], along.y[1]] };
            let remedy = format!("turn the camera's boresight by {} in its own axes", back.text("deg"));
            made("boresight_off_axis", along.size(), "deg", remedy)
        }
        E::ScreenBow => {
            let rays = data.display?;
            // The second amplitude is that of x y, so of the diagonals.
            let um = 1e3 / ARCSEC_PER_RAD / (rays.tangent_per_depth(0.0, 0.0) * w);
            let sag = Along::of(parameters, um)?;
            let remedy = format!(
                "flatten the display's mounting: sag {:+.2} +- {:.2} um (x^2 - y^2) {:+.2} +- {:.2} um x y at the edge, away from the lenses",
                sag.x[0], sag.x[1], sag.y[0], sag.y[1]
            );
            made("sag_at_half_width", sag.size(), "um", remedy)
        }
        E::OpticalCentre => {
            // The lens about another point is known from a calibration or its prescription, else from the fitted k1.
            let gain = optical_centre_gain(data)
                .or_else(|| Some(k1_arcsec.filter(|k1| k1.abs() > 1.0)? / (w * ARCSEC_PER_RAD)))?;
            let along = Along::of(parameters, -1.0 / (gain * data.screen_pixel_arcsec))?;
            let remedy =
                format!("move the display, or the principal point of K_f, by {} of the screen", along.text("px"));
            made("centre_off_axis", along.size(), "px", remedy)
        }
        E::Decentering => {
            // At half the camera's width along x: (3 p1 w^2, p2 w^2).
            let mut along = Along::of(parameters, 1.0)?;
            along.x = along.x.map(|value| 3.0 * value);
            let remedy = format!("centre the objective, or calibrate with p1, p2: {}", along.text("arcsec"));
            made("decentring_at_half_width", along.size(), "arcsec", remedy)
        }
        E::ThinPrism => {
            let along = Along::of(parameters, 1.0)?;
            let remedy = format!("look for a wedge or a tilted window in the beam: {}", along.text("arcsec"));
            made("prism_at_half_width", along.size(), "arcsec", remedy)
        }
        E::RadialHigherOrder => {
            made("r5_at_half_width", one(1.0)?, "arcsec", "calibrate with radial terms beyond k1".to_owned())
        }
        E::ThermalBoresight => {
            let along = Along::of(parameters, 1.0)?;
            let remedy = format!(
                "hold the temperature, or correct the boresight by minus this per kelvin{}: {}",
                lag(),
                along.text("arcsec/K")
            );
            made("boresight_per_kelvin", along.size(), "arcsec/K", remedy)
        }
        E::ThermalFocal => made(
            "focal_length_per_kelvin",
            one(1e6 / ARCSEC_PER_RAD / w)?,
            "ppm/K",
            format!("hold the temperature, or scale K_f by minus this per kelvin{}", lag()),
        ),
        E::Drift => {
            let power = shape("power_of_t").unwrap_or(1.0);
            let along = Along::of(parameters, 1.0 / span_h()?)?;
            let mean = if power == 1.0 { "" } else { " on average" };
            let remedy = format!("let the mounts settle; the boresight moves{mean} by {}", along.text("arcsec/h"));
            made("boresight_drift", along.size(), "arcsec/h", remedy)
        }
        E::RollDrift => made(
            "roll_drift",
            one(2.0 / w / span_h()?)?,
            "arcsec/h",
            "let the mounts settle, or tighten what holds the camera's roll".to_owned(),
        ),
        E::Knock => {
            let t0 = shape("t0_s")?;
            let remedy = format!("look for what happened at {t0:.0} s, and calibrate anew from then on");
            let size = Along::of(parameters, 1.0).map_or_else(|| one(1.0), |along| Some(along.size()))?;
            made("step_at_half_width", size, "arcsec", remedy)
        }
        E::SubpixelOffset => {
            made("sub_pixel_offset", one(1.0 / 3.0)?, "px", "show each colour at its own sub-pixels".to_owned())
        }
        E::FluxShift if shape(STEADY).is_some() => {
            let along = Along::of(parameters, 1.0)?;
            let remedy = format!("centre the objective's elements, or calibrate anew: {}", along.text("um"));
            let called = Some("coma all over the field");
            let [value, sigma] = along.size();
            Some(Physical { called, parameter: "coma_all_over_the_field", value, unit: "um", sigma, remedy })
        }
        E::FluxComa if shape(STEADY).is_some() => {
            let [value, sigma] = one(1.0)?;
            let remedy = "look for a lens that sits wrongly along the axis, or calibrate anew".to_owned();
            let called = Some("coma of the objective");
            Some(Physical { called, parameter: "coma_at_half_width", value, unit: "um", sigma, remedy })
        }
        E::FluxShift => {
            let along = Along::of(parameters, 2.0)?;
            let remedy = format!(
                "centre the objective, or calibrate at the counts that are used; from faintest to brightest {}",
                along.text("arcsec")
            );
            made("shift_over_the_light", along.size(), "arcsec", remedy)
        }
        E::BackgroundGradient => {
            let along = Along::of(parameters, 1.0)?;
            let remedy =
                format!("shield stray light or subtract a background; against bright ones the faintest move by {}", along.text("arcsec"));
            made("shift_of_the_faintest", along.size(), "arcsec", remedy)
        }
        E::FluxComa => made(
            "coma_over_half_the_light",
            one(1.0)?,
            "arcsec",
            "calibrate at several counts (D^-1 as a function of L), or use centroids that a tail does not move"
                .to_owned(),
        ),
        E::LateralColour
        | E::ColourWedge
        | E::CameraPixelPhase
        | E::ScreenPixelPhase
        | E::RowLoadingShift => None,
    }
}

fn of_power(data: &Dataset, effect: PowerEffect, parameters: &[Parameter]) -> Option<Physical> {
    use PowerEffect as E;
    let first = parameters.first()?;
    let sigma = first.sigma?;
    let made = |parameter, factor: f64, unit, remedy: String| {
        Some(Physical {
            called: None,
            parameter,
            value: factor * first.value,
            unit,
            sigma: factor.abs() * sigma,
            remedy,
        })
    };
    match effect {
        E::Gamma => made(
            "exponent_less_the_setup's",
            1.0,
            "",
            "calibrate the response anew: the display's exponent has changed".to_owned(),
        ),
        E::MeterZero => {
            let most = data.values("per_irradiance").iter().copied().fold(0.0, f64::max);
            made(
                "zero",
                1.0 / most,
                "W/m^2",
                "zero the meter, or take a dark reading with each series".to_owned(),
            )
        }
        E::MeterNonlinearity => made(
            "loss_at_brightest",
            -100.0,
            "%",
            "measure with another range or attenuator, or correct the meter's linearity".to_owned(),
        ),
        E::ChannelNonadditivity => made(
            "white_less_the_sum",
            100.0,
            "%",
            "calibrate white by itself, not as the sum of its channels".to_owned(),
        ),
        E::MeterWavelength => made(
            "responsivity_of_the_first_channel",
            100.0,
            "%",
            "set the meter's wavelength for each channel".to_owned(),
        ),
        E::AttenuatorNotChanged => {
            let number = parameters.iter().find(|p| p.name.ends_with("series_index"))?.value as usize;
            let name = data.groups.get(number).map_or("?", |group| group.name.as_str());
            let value = 1.0 + first.value;
            let remedy =
                format!("divide series `{name}` by {value:.4}: a range or filter was recorded wrongly");
            Some(Physical { called: None, parameter: "factor", value, unit: "", sigma, remedy })
        }
        E::SelfHeating | E::Ageing => made(
            "loss",
            -100.0,
            "%",
            "let the display warm up before a series, and repeat its first readings at the end".to_owned(),
        ),
        E::BlackLevel | E::SquareLoading | E::PixelCrosstalk => None,
    }
}
