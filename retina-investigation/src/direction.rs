//! Which way errors point from place to place: vector fields that a law multiplies, and how the values of images lie over
//! their place.

use retina_formats::TableKind;

use crate::columns::{Place, Table};
use crate::law::{Move, Shape};

/// A vector field over the place (x, y), 1 at half the camera's width; each is linear in one to four amplitudes. In images
/// the place counts from the middle of the pixels that are looked at, in half their width.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Direction {
    /// A value: tables of one component.
    Value,
    /// The same way everywhere.
    Fixed,
    /// The same way everywhere in axes that turn with the camera.
    FixedInCamera,
    /// Along the radius, in proportion to it: scale.
    Radial,
    /// Across the radius, in proportion to it: a turn.
    Tangential,
    /// A stretch along x.
    StretchX,
    /// A stretch along y.
    StretchY,
    /// A shift along x in proportion to y.
    ShearX,
    /// A shift along y in proportion to x.
    ShearY,
    /// A stretch along one axis and a squeeze across it, along any axis.
    Anamorphic,
    /// Any linear field.
    Linear,
    /// (x^2, x y) and (x y, y^2): a tilted plane.
    Tilted,
    /// r^2 the same way everywhere: a prism.
    Prism,
    /// Away from a place, within a width of it.
    Dent,
    /// About a place, within a width of it.
    Swirl,
    /// The same way within a width of a place.
    Spot,
    /// A dent with wide skirts: it falls as a power of the distance.
    WideDent,
    /// A swirl with wide skirts.
    WideSwirl,
    /// A spot with wide skirts.
    WideSpot,
    /// The same way, in waves over the field.
    Wave,
    /// A value of pixels within a width of a place.
    Glow,
    /// A glow with wide skirts.
    WideGlow,
    /// A value of pixels in waves over the image.
    Fringes,
}

const fn place(name: &'static str) -> Shape {
    Shape { name, has_unit: false, smooth: true }
}

const LOCAL: [Shape; 3] = [place("centre_x"), place("centre_y"), place("extent")];
const WIDE: [Shape; 4] = [place("centre_x"), place("centre_y"), place("extent"), place("skirt")];
/// Exponent of the skirts that a search begins with.
const SKIRT: f64 = 2.0;
const WAVE: [Shape; 2] = [place("wave_x"), place("wave_y")];

/// A vector's two components as text.
type Texts = [String; 2];

impl Direction {
    /// Those of points that laws of other columns multiply first; the others are tried beside what these find.
    pub(crate) const FIRST: [Self; 6] =
        [Self::Fixed, Self::Radial, Self::Tangential, Self::Linear, Self::Tilted, Self::Prism];

    /// Those of points that a search may change to.
    pub(crate) const PLAIN: [Self; 12] = [
        Self::Fixed,
        Self::FixedInCamera,
        Self::Radial,
        Self::Tangential,
        Self::StretchX,
        Self::StretchY,
        Self::ShearX,
        Self::ShearY,
        Self::Anamorphic,
        Self::Linear,
        Self::Tilted,
        Self::Prism,
    ];

    /// Those of a table that are confined or wavy. Those with wide skirts are tried where a narrow one is good
    /// ([`Self::twin`]).
    pub(crate) fn shaped(kind: TableKind) -> &'static [Self] {
        match kind {
            TableKind::Points => &[Self::Dent, Self::Swirl, Self::Spot, Self::Wave],
            TableKind::Frames => &[Self::Glow, Self::Fringes],
            TableKind::Power | TableKind::Phase => &[],
        }
    }

    pub(crate) fn shapes(self) -> &'static [Shape] {
        match self {
            Self::Dent | Self::Swirl | Self::Spot | Self::Glow => &LOCAL,
            Self::WideDent | Self::WideSwirl | Self::WideSpot | Self::WideGlow => &WIDE,
            Self::Wave | Self::Fringes => &WAVE,
            _ => &[],
        }
    }

    /// Shape parameters at which a search begins.
    pub(crate) fn starts(self) -> Vec<Vec<f64>> {
        self.starts_on([-0.75, -0.375, 0.0, 0.375, 0.75], [-0.5, 0.0, 0.5], [0.15, 0.35])
    }

    /// The same, close to each other: a confined field that is further off than its extent shows nothing.
    pub(crate) fn close_starts(self) -> Vec<Vec<f64>> {
        let x = [-0.8, -0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6, 0.8];
        self.starts_on(x, [-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6], [0.12, 0.25, 0.5])
    }

    fn starts_on<const X: usize, const Y: usize, const W: usize>(
        self,
        x: [f64; X],
        y: [f64; Y],
        widths: [f64; W],
    ) -> Vec<Vec<f64>> {
        match self {
            Self::Dent | Self::Swirl | Self::Spot | Self::Glow => {
                let mut out = Vec::new();
                for x in x {
                    for y in y {
                        out.extend(widths.map(|width| vec![x, y, width]));
                    }
                }
                out
            }
            Self::Wave | Self::Fringes => {
                // Half a plane of wave vectors: the other half are the same waves.
                let mut out = Vec::new();
                for kx in 0..=6 {
                    for ky in -6..=6 {
                        let (kx, ky) = (2.5 * f64::from(kx), 2.5 * f64::from(ky));
                        if (kx > 0.0 || ky > 0.0) && (4.0..16.0).contains(&kx.hypot(ky)) {
                            out.push(vec![kx, ky]);
                        }
                    }
                }
                out
            }
            _ => vec![Vec::new()],
        }
    }

    /// The same without wide skirts.
    pub(crate) fn narrow(self) -> Self {
        match self {
            Self::WideDent => Self::Dent,
            Self::WideSwirl => Self::Swirl,
            Self::WideSpot => Self::Spot,
            Self::WideGlow => Self::Glow,
            other => other,
        }
    }

    /// The same with wide skirts, or without, at the same place; none of those that are not confined.
    pub(crate) fn twin(self, shape: &[f64]) -> Option<(Self, Vec<f64>)> {
        let twin = match self {
            Self::Dent => Self::WideDent,
            Self::Swirl => Self::WideSwirl,
            Self::Spot => Self::WideSpot,
            Self::Glow => Self::WideGlow,
            Self::WideDent | Self::WideSwirl | Self::WideSpot | Self::WideGlow => self.narrow(),
            _ => return None,
        };
        let place = shape.iter().copied().chain([SKIRT]).take(twin.shapes().len()).collect();
        Some((twin, place))
    }

    pub(crate) fn moves(self) -> Vec<Move> {
        match self {
            Self::Dent | Self::Swirl | Self::Spot | Self::Glow => {
                vec![Move::By(0.12), Move::By(0.12), Move::Times(1.5)]
            }
            Self::WideDent | Self::WideSwirl | Self::WideSpot | Self::WideGlow => {
                vec![Move::By(0.12), Move::By(0.12), Move::Times(1.5), Move::Times(1.4)]
            }
            Self::Wave | Self::Fringes => vec![Move::By(0.8), Move::By(0.8)],
            _ => Vec::new(),
        }
    }

    pub(crate) fn allows(self, shape: &[f64]) -> bool {
        match self {
            Self::Dent
            | Self::Swirl
            | Self::Spot
            | Self::Glow
            | Self::WideDent
            | Self::WideSwirl
            | Self::WideSpot
            | Self::WideGlow => {
                let skirt = shape.get(3).copied().unwrap_or(SKIRT);
                shape[0].abs() <= 1.3
                    && shape[1].abs() <= 1.3
                    && (0.03..=2.0).contains(&shape[2])
                    && (0.5..=12.0).contains(&skirt)
            }
            Self::Wave | Self::Fringes => shape[0].hypot(shape[1]) <= 60.0,
            _ => true,
        }
    }

    /// Whether every model of the baseline can be this field: a constant times it is none of its own.
    pub(crate) fn in_baseline(self) -> bool {
        !matches!(
            self,
            Self::FixedInCamera
                | Self::Tilted
                | Self::Prism
                | Self::Dent
                | Self::Swirl
                | Self::Spot
                | Self::WideDent
                | Self::WideSwirl
                | Self::WideSpot
                | Self::Wave
                | Self::Glow
                | Self::WideGlow
                | Self::Fringes
        )
    }

    /// Number of its amplitudes.
    pub(crate) fn width(self) -> usize {
        match self {
            Self::Fixed
            | Self::FixedInCamera
            | Self::Anamorphic
            | Self::Tilted
            | Self::Prism
            | Self::Spot
            | Self::WideSpot
            | Self::Fringes => 2,
            Self::Linear | Self::Wave => 4,
            _ => 1,
        }
    }

    /// Its vectors in a row, one for each amplitude.
    pub(crate) fn vectors(self, table: &Table, row: usize, shape: &[f64], out: &mut Vec<[f64; 2]>) {
        out.clear();
        if self == Self::Value {
            out.push([1.0, 0.0]);
            return;
        }
        let (x, y) = (table.x[row], table.y[row]);
        let local = || {
            let (dx, dy) = (x - shape[0], y - shape[1]);
            let square = (dx * dx + dy * dy) / (shape[2] * shape[2]);
            let fall = match shape.get(3) {
                Some(skirt) => (1.0 + square).powf(-skirt),
                None => (-square).exp(),
            };
            (dx, dy, fall)
        };
        match self {
            Self::Value => {}
            Self::Fixed => out.extend([[1.0, 0.0], [0.0, 1.0]]),
            Self::FixedInCamera => {
                let (sin, cos) = table.roll_rad.get(row).copied().unwrap_or(0.0).sin_cos();
                out.extend([[cos, sin], [-sin, cos]]);
            }
            Self::Radial => out.push([x, y]),
            Self::Tangential => out.push([-y, x]),
            Self::StretchX => out.push([x, 0.0]),
            Self::StretchY => out.push([0.0, y]),
            Self::ShearX => out.push([y, 0.0]),
            Self::ShearY => out.push([0.0, x]),
            Self::Anamorphic => out.extend([[x, -y], [y, x]]),
            Self::Linear => out.extend([[x, 0.0], [y, 0.0], [0.0, x], [0.0, y]]),
            Self::Tilted => out.extend([[x * x, x * y], [x * y, y * y]]),
            Self::Prism => {
                let r2 = x * x + y * y;
                out.extend([[r2, 0.0], [0.0, r2]]);
            }
            Self::Dent | Self::WideDent => {
                let (dx, dy, fall) = local();
                out.push([dx * fall, dy * fall]);
            }
            Self::Swirl | Self::WideSwirl => {
                let (dx, dy, fall) = local();
                out.push([-dy * fall, dx * fall]);
            }
            Self::Spot | Self::WideSpot => {
                let (_, _, fall) = local();
                out.extend([[fall, 0.0], [0.0, fall]]);
            }
            Self::Wave => {
                let (sin, cos) = (shape[0] * x + shape[1] * y).sin_cos();
                out.extend([[sin, 0.0], [cos, 0.0], [0.0, sin], [0.0, cos]]);
            }
            Self::Glow | Self::WideGlow => {
                let (_, _, fall) = local();
                out.push([fall, 0.0]);
            }
            Self::Fringes => {
                let (sin, cos) = (shape[0] * x + shape[1] * y).sin_cos();
                out.extend([[sin, 0.0], [cos, 0.0]]);
            }
        }
    }

    /// The same as text, one pair for each amplitude; an empty text is 0, "1" is 1.
    pub(crate) fn texts(self, shape: &[String], place: &Place) -> Vec<Texts> {
        let pair = |x: &str, y: &str| [x.to_owned(), y.to_owned()];
        let at = |k: usize| shape.get(k).map_or("", String::as_str);
        let local = || {
            let [x, y] = &place.texts;
            let (dx, dy) = (format!("({x} - {})", at(0)), format!("({y} - {})", at(1)));
            let square = format!("({dx}^2 + {dy}^2) / {}^2", at(2));
            let fall = match shape.get(3) {
                Some(skirt) => format!("(1 + {square})^(-{skirt})"),
                None => format!("exp(-{square})"),
            };
            (dx, dy, fall)
        };
        const ROLL: &str = "(camera_roll_deg * pi / 180)";
        match self {
            Self::Value => vec![pair("1", "")],
            Self::Fixed => vec![pair("1", ""), pair("", "1")],
            Self::FixedInCamera => vec![
                [format!("cos{ROLL}"), format!("sin{ROLL}")],
                [format!("(-sin{ROLL})"), format!("cos{ROLL}")],
            ],
            Self::Radial => vec![pair("x", "y")],
            Self::Tangential => vec![pair("(-y)", "x")],
            Self::StretchX => vec![pair("x", "")],
            Self::StretchY => vec![pair("", "y")],
            Self::ShearX => vec![pair("y", "")],
            Self::ShearY => vec![pair("", "x")],
            Self::Anamorphic => vec![pair("x", "(-y)"), pair("y", "x")],
            Self::Linear => vec![pair("x", ""), pair("y", ""), pair("", "x"), pair("", "y")],
            Self::Tilted => vec![pair("x^2", "x * y"), pair("x * y", "y^2")],
            Self::Prism => vec![pair("r^2", ""), pair("", "r^2")],
            Self::Dent | Self::WideDent => {
                let (dx, dy, fall) = local();
                vec![[format!("{dx} * {fall}"), format!("{dy} * {fall}")]]
            }
            Self::Swirl | Self::WideSwirl => {
                let (dx, dy, fall) = local();
                vec![[format!("(-{dy}) * {fall}"), format!("{dx} * {fall}")]]
            }
            Self::Spot | Self::WideSpot => {
                let (_, _, fall) = local();
                vec![pair(&fall, ""), pair("", &fall)]
            }
            Self::Wave | Self::Fringes => {
                let [x, y] = &place.texts;
                let phase = format!("({} * {x} + {} * {y})", at(0), at(1));
                let (sin, cos) = (format!("sin{phase}"), format!("cos{phase}"));
                let along_x = [pair(&sin, ""), pair(&cos, "")];
                let along_y = [pair("", &sin), pair("", &cos)];
                let both = along_x.into_iter().chain(along_y);
                both.take(self.width()).collect()
            }
            Self::Glow | Self::WideGlow => vec![pair(&local().2, "")],
        }
    }
}
