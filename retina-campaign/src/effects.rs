//! Physical effects by id: what `--effect ID=VALUE[UNIT][,VALUE...]` may say.

use std::path::Path;

use retina_files::{InputError, nearest};
use retina_formats::{EffectId, FramesEffect, PointsEffect, PowerEffect};

/// An effect that the bench knows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectKind {
    /// Its id. Effects on points show in frames as well.
    pub id: EffectId,
    /// Units and what one of each is in the effect's own; the first is taken where none is written.
    pub units: &'static [(&'static str, f64)],
    /// Most values.
    pub values: usize,
    /// What the value is.
    pub meaning: &'static str,
}

const DEG: f64 = std::f64::consts::PI / 180.0;
const ANGLE: &[(&str, f64)] = &[("deg", DEG), ("arcmin", DEG / 60.0), ("arcsec", DEG / 3600.0)];
const ARCSEC: &[(&str, f64)] = &[("arcsec", DEG / 3600.0), ("arcmin", DEG / 60.0), ("deg", DEG)];
const PATH: &[(&str, f64)] = &[("um", 1e-3), ("nm", 1e-6)];
const SHARE: &[(&str, f64)] = &[("", 1.0), ("%", 0.01)];
const PLAIN: &[(&str, f64)] = &[("", 1.0)];
const PX: &[(&str, f64)] = &[("px", 1.0)];

type Units = &'static [(&'static str, f64)];

/// How an effect's size is written.
struct Form {
    units: Units,
    values: usize,
    meaning: &'static str,
}

fn points(effect: PointsEffect) -> Option<Form> {
    use PointsEffect as E;
    let (units, values, meaning): (Units, usize, &str) = match effect {
        E::ScreenTilt => (ANGLE, 2, "the display's tilt: its +x side, its +y side, away from the lenses"),
        E::CameraPointing => (ANGLE, 2, "the camera's boresight beside the axis, towards +x, +y"),
        E::Decentering => (ARCSEC, 2, "p1, p2 of the objective, as their shift at half the camera's width"),
        E::OpticalCentre => (PX, 2, "the display's centre beside the axis, screen pixels"),
        E::ThinPrism => {
            (ARCSEC, 2, "a wedge in the collimated beam, as its shift at half the camera's width")
        }
        E::RadialHigherOrder => (ARCSEC, 1, "the objective's r^5 distortion at half the camera's width"),
        E::ScreenBow => {
            (PATH, 2, "sag a (x^2 - y^2) + b x y of the display at the edge that the camera sees")
        }
        E::FluxComa => (PATH, 1, "the objective's coma (path at the pupil's rim) at half the camera's width"),
        E::FluxShift => (PATH, 2, "the same all over the field: a lens out of line, along x, y"),
        E::BackgroundGradient => {
            (&[("e/s", 1.0)], 2, "stray light's rise from the centre to the +x, +y edge")
        }
        E::LateralColour => (ARCSEC, 1, "the objective's, from 475 to 605 nm, at half the camera's width"),
        E::ColourWedge => (ARCSEC, 2, "a wedge's dispersion from 475 to 605 nm, along x, y"),
        E::SubpixelOffset => (PX, 1, "pitch of the sub-pixels, screen pixels (a third by itself)"),
        E::ThermalBoresight => {
            (&[("arcsec/K", DEG / 3600.0)], 2, "the mount's turn, along the facility's x, y")
        }
        E::ThermalFocal => (&[("ppm/K", 1e-6)], 1, "the objective's focal length"),
        E::Drift => (&[("arcsec/h", DEG / 3600.0)], 2, "the mount's turn in time, along the facility's x, y"),
        E::RollDrift => {
            (&[("arcsec/h", DEG / 3600.0)], 1, "the camera's roll, as its shift at half its width")
        }
        E::Knock => {
            (ARCSEC, 2, "a step of the mount half way through the campaign, along the facility's x, y")
        }
        E::CameraPixelPhase => (SHARE, 1, "sensitive part of the camera's pixel along each axis"),
        E::RowLoadingShift => (PX, 1, "shift along x of a pixel whose row is all lit, screen pixels"),
        // The split of a point over pixels is always there.
        E::ScreenPixelPhase => return None,
    };
    Some(Form { units, values, meaning })
}

fn power(effect: PowerEffect) -> Option<Form> {
    use PowerEffect as E;
    let (units, values, meaning): (Units, usize, &str) = match effect {
        E::Gamma => (
            PLAIN,
            1,
            "exponent of the display's response, the whole (`diagnose` tells what it is beside the setup's)",
        ),
        E::BlackLevel => (SHARE, 1, "light at count 0 over light at 255"),
        E::SquareLoading => (SHARE, 1, "loss of light where the whole screen is lit"),
        E::PixelCrosstalk => (SHARE, 1, "light that a lit neighbour lends, of a pixel's own"),
        E::SelfHeating => {
            (&[("%", 0.01), ("", 1.0)], 1, "rise of the light until the display is warm (20 min)")
        }
        E::Ageing => (&[("%", 0.01), ("", 1.0)], 1, "loss of light for 1000 hours of full white"),
        E::MeterZero => (&[("nW", 1e-9), ("pW", 1e-12), ("W", 1.0)], 1, "the meter's reading in the dark"),
        E::MeterWavelength => (SHARE, 3, "error of the meter's responsivity: red, green, blue"),
        E::MeterNonlinearity => (SHARE, 1, "excess of the meter's reading at the brightest reading"),
        E::ChannelNonadditivity => (SHARE, 1, "loss of white against red + green + blue"),
        E::AttenuatorNotChanged => (PLAIN, 1, "factor on the readings of one series"),
    };
    Some(Form { units, values, meaning })
}

fn frames(effect: FramesEffect) -> Option<Form> {
    use FramesEffect as E;
    let (units, values, meaning): (Units, usize, &str) = match effect {
        E::Defocus => (&[("mm", 1.0), ("um", 1e-3)], 1, "the display behind its place"),
        E::VeilingGlare => (SHARE, 1, "light spread over the whole image"),
        E::Ghost => (SHARE, 1, "reflectance of a coated surface"),
        E::Vignetting => (SHARE, 1, "clear part of each lens's semi-diameter"),
        E::DarkOffset => (&[("DN", 1.0)], 1, "digital number of no light above the setup's"),
        E::DetectorNonlinearity => (SHARE, 1, "excess of the signal at full well"),
        E::Saturation => (&[("e", 1.0)], 1, "full well, electrons"),
        E::Prnu => (SHARE, 1, "scatter of the camera pixels' response"),
        E::Mura => (SHARE, 1, "scatter of the screen pixels' light"),
        E::ImageShift => (PX, 2, "shift of the camera image, camera pixels"),
        E::Roll => (ANGLE, 1, "turn of the camera"),
        E::Scale => (SHARE, 1, "relative change of the camera's focal length"),
        // The scene's, or the traced lenses' own.
        E::PhotometricFunction
        | E::AlbedoMap
        | E::Relief
        | E::TerrainShadow
        | E::FieldCurvature
        | E::Coma
        | E::Astigmatism
        | E::SourceSize => return None,
    };
    Some(Form { units, values, meaning })
}

impl EffectKind {
    /// What the bench makes of an effect; `None` where it has no part that could.
    pub fn of(id: EffectId) -> Option<Self> {
        let form = match id {
            EffectId::Points(effect) => points(effect),
            EffectId::Power(effect) => power(effect),
            // A body's photometry is the scene's.
            EffectId::Phase(_) => None,
            EffectId::Frames(effect) => frames(effect),
        }?;
        Some(Self { id, units: form.units, values: form.values, meaning: form.meaning })
    }
}

/// All effects that the bench knows.
pub fn known_effects() -> impl Iterator<Item = EffectKind> {
    EffectId::all().filter_map(EffectKind::of)
}

/// An effect and its size.
#[derive(Debug, Clone, PartialEq)]
pub struct Effect {
    /// What it is.
    pub kind: EffectKind,
    /// Its values in radians, mm, pixels, shares ...; at least one, missing ones are 0.
    pub values: Vec<f64>,
    /// As it was written.
    pub text: String,
}

impl Effect {
    /// Reads `ID=VALUE[UNIT][,VALUE[UNIT]]`.
    ///
    /// # Errors
    /// An unknown id or unit, a number that does not read, too many values.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        let error =
            |problem: &str| InputError::new(Path::new("--effect"), problem).found(format!("`{text}`"));
        let (id, values) = text.split_once('=').ok_or_else(|| {
            error("an effect needs a size").expected("ID=VALUE, for example screen_tilt=0.1deg")
        })?;
        let Some(kind) = known_effects().find(|kind| kind.id.name() == id) else {
            let error = error("there is no such effect in the bench");
            let ids = || known_effects().map(|kind| kind.id.name());
            return Err(match nearest(id, ids()) {
                Some(near) => error.help(format!("did you mean `{near}`?")),
                None => error.expected(ids().collect::<Vec<_>>().join(", ")),
            });
        };
        let units = || kind.units.iter().map(|(unit, _)| *unit).filter(|unit| !unit.is_empty());
        let of = |part: &str| {
            let part = part.trim();
            let cut = part
                .char_indices()
                .find(|(i, c)| {
                    let exponent =
                        *c == 'e' && part[i + 1..].starts_with(|c: char| c.is_ascii_digit() || c == '-');
                    !(c.is_ascii_digit() || matches!(c, '.' | '-' | '+') || exponent)
                })
                .map_or(part.len(), |(i, _)| i);
            let (number, unit) = part.split_at(cut);
            let number: f64 = number.parse().map_err(|_| error("the size is no number"))?;
            let unit = unit.trim();
            let factor = if unit.is_empty() {
                Some(kind.units[0].1)
            } else {
                kind.units.iter().find(|(name, _)| *name == unit).map(|(_, factor)| *factor)
            };
            let factor = factor.ok_or_else(|| {
                let expected: Vec<&str> = units().collect();
                error("the effect has no such unit").expected(if expected.is_empty() {
                    "a number without unit".to_owned()
                } else {
                    expected.join(", ")
                })
            })?;
            Ok::<f64, InputError>(number * factor)
        };
        let values: Vec<f64> = values.split(',').map(of).collect::<Result<_, _>>()?;
        if values.len() > kind.values || values.iter().any(|value| !value.is_finite()) {
            return Err(error("the effect takes other values")
                .expected(format!("at most {} finite: {}", kind.values, kind.meaning)));
        }
        Ok(Self { kind, values, text: text.to_owned() })
    }

    /// The first value.
    pub fn value(&self) -> f64 {
        self.values[0]
    }

    /// Two values, the second 0 where it is missing.
    pub fn pair(&self) -> [f64; 2] {
        [self.values[0], self.values.get(1).copied().unwrap_or(0.0)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_read_with_their_units() {
        let tilt = Effect::parse("screen_tilt=0.1deg,6arcmin").unwrap();
        assert!((tilt.pair()[0] - 0.1f64.to_radians()).abs() < 1e-15);
        assert!((tilt.pair()[1] - 0.1f64.to_radians()).abs() < 1e-15);
        assert_eq!(Effect::parse("black_level=1e-4").unwrap().value(), 1e-4);
        assert_eq!(Effect::parse("black_level=2%").unwrap().value(), 0.02);
        assert_eq!(Effect::parse("background_gradient=30e/s").unwrap().value(), 30.0);
        assert_eq!(Effect::parse("saturation=5000e").unwrap().value(), 5000.0);
        for (text, says) in [
            ("screen_tlt=1", "did you mean `screen_tilt`"),
            ("screen_tilt", "ID=VALUE"),
            ("screen_tilt=0.1mm", "no such unit"),
            ("screen_tilt=x", "no number"),
            ("roll=1,2", "at most 1"),
            ("mura=NaN", "no number"),
        ] {
            let error = Effect::parse(text).unwrap_err().to_string();
            let full = format!("{:?}", Effect::parse(text).unwrap_err());
            assert!(error.contains(says) || full.contains(says), "{text}: {full}");
        }
    }
}
