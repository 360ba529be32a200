//! Effects as changes of the prediction: each form has a shape from a list and parameters that are fitted.

use retina_formats::FramesEffect;
use retina_radiometry::{
    Hapke, Lambert, Law, LommelSeeliger, Minnaert, OrenNayar, PhaseFunction, Photometry,
};

/// What a form does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Change {
    /// [m]: share of another law.
    Law(Photometry),
    /// [c]: contrast of the body's map to a power.
    Map { power: f64 },
    /// [c1..]: real spherical harmonics of longitude and latitude, without the constant.
    Harmonics,
    /// [a]: from the ellipsoid to the mesh.
    Relief,
    /// [a]: cast shadows.
    Shadow,
    /// [variance, px^2].
    Blur,
    /// [variance at r = 1, px^2]: grows as r^4.
    FieldBlur,
    /// [c, px]: Seidel's, the length of a third of its tail at r = 1.
    Coma,
    /// [difference of variances at r = 1, px^2].
    Astigmatism,
    /// [a]: share of light in a broad kernel of this width, px.
    Glare { width_px: f64 },
    /// [a]: share of the frame's mean.
    MeanGlare,
    /// [a]: the image mirrored at the axis.
    Ghost,
    /// [v]: loss at r = 1 by r^power.
    Vignetting { power: i32 },
    /// [b, DN].
    DarkLevel,
    /// [d, DN/s].
    DarkCurrent,
    /// [a]: s + a s^2 / full scale.
    Nonlinearity,
    /// [a]: min(s, part of full scale).
    FullWell { share: f64 },
    /// [dx, dy, px].
    Shift,
    /// [rad] about the window's middle.
    Roll,
    /// [relative].
    Scale,
}

/// Degree of the harmonics, and how many they are.
pub(crate) const HARMONICS: usize = 3;
const HARMONIC_COUNT: usize = (HARMONICS + 1) * (HARMONICS + 1) - 1;

impl Change {
    /// Names of the parameters, with units.
    pub(crate) fn names(&self) -> Vec<String> {
        let one = |name: &str| vec![name.to_owned()];
        match self {
            Self::Law(_) => one("share"),
            Self::Map { .. } => one("contrast"),
            Self::Harmonics => (1..=HARMONIC_COUNT).map(|k| format!("harmonic_{k}")).collect(),
            Self::Relief | Self::Shadow | Self::Glare { .. } | Self::MeanGlare | Self::Ghost => one("share"),
            Self::Blur => one("variance_px2"),
            Self::FieldBlur => one("variance_at_edge_px2"),
            Self::Coma => one("sagittal_at_edge_px"),
            Self::Astigmatism => one("variance_difference_at_edge_px2"),
            Self::Vignetting { .. } => one("loss_at_edge"),
            Self::DarkLevel => one("dn"),
            Self::DarkCurrent => one("dn_per_s"),
            Self::Nonlinearity => one("at_full_scale"),
            Self::FullWell { .. } => one("share"),
            Self::Shift => vec!["x_px".to_owned(), "y_px".to_owned()],
            Self::Roll => one("rad"),
            Self::Scale => one("relative"),
        }
    }

    /// A value by which a first fit looks whether the effect is there; linear forms have any.
    pub(crate) fn probe(&self) -> f64 {
        match self {
            Self::Law(_) | Self::Map { .. } | Self::Relief | Self::Shadow | Self::FullWell { .. } => 1.0,
            Self::DarkLevel | Self::DarkCurrent => 1.0,
            Self::Harmonics | Self::Glare { .. } | Self::MeanGlare | Self::Vignetting { .. } => 0.05,
            Self::Ghost | Self::Nonlinearity => 0.02,
            Self::Blur | Self::FieldBlur | Self::Astigmatism | Self::Coma => 0.5,
            Self::Shift => 0.1,
            Self::Roll | Self::Scale => 1e-3,
        }
    }

    /// The values that have a meaning.
    pub(crate) fn range(&self) -> [f64; 2] {
        match self {
            Self::Blur | Self::FieldBlur => [0.0, 400.0],
            Self::Glare { .. } | Self::MeanGlare | Self::Ghost => [-0.2, 0.9],
            Self::Law(_) => [-0.5, 1.5],
            Self::FullWell { .. } | Self::Shadow => [-0.5, 1.5],
            _ => [f64::NEG_INFINITY, f64::INFINITY],
        }
    }

    /// The values that something real may have, where there are bounds; fits may go beyond, and then it is told.
    pub(crate) fn plausible(&self) -> Option<[f64; 2]> {
        match self {
            Self::Law(_) | Self::Shadow | Self::FullWell { .. } => Some([0.0, 1.5]),
            Self::Map { .. } | Self::Relief => Some([0.0, 2.0]),
            Self::Harmonics => Some([-1.0, 1.0]),
            Self::Blur | Self::FieldBlur => Some([0.0, 400.0]),
            Self::Coma => Some([-50.0, 50.0]),
            Self::Astigmatism => Some([-20.0, 20.0]),
            Self::Glare { .. } | Self::MeanGlare => Some([0.0, 0.5]),
            Self::Ghost => Some([0.0, 0.1]),
            Self::Vignetting { .. } => Some([0.0, 1.0]),
            Self::DarkCurrent => Some([0.0, f64::INFINITY]),
            Self::Nonlinearity => Some([-0.5, 0.5]),
            Self::DarkLevel | Self::Shift | Self::Roll | Self::Scale => None,
        }
    }

    /// Where in the prediction it acts.
    pub(crate) fn stage(&self) -> Stage {
        match self {
            Self::Law(_) | Self::Map { .. } | Self::Harmonics | Self::Relief | Self::Shadow => Stage::Surface,
            Self::Shift | Self::Roll | Self::Scale => Stage::Place,
            Self::Blur | Self::FieldBlur | Self::Coma | Self::Astigmatism => Stage::Optics,
            Self::Glare { .. } | Self::MeanGlare | Self::Ghost => Stage::Stray,
            Self::Vignetting { .. }
            | Self::DarkLevel
            | Self::DarkCurrent
            | Self::Nonlinearity
            | Self::FullWell { .. } => Stage::Detector,
        }
    }
}

/// The stages of a prediction, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Stage {
    /// The body's light, cell by cell.
    Surface,
    /// Where the body is in the image.
    Place,
    /// What the optics do within a few pixels.
    Optics,
    /// Light that goes astray over many.
    Stray,
    /// Digital numbers.
    Detector,
}

/// A form of an effect.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Form {
    pub(crate) change: Change,
    /// Where it is looked for first: the probe of each parameter.
    pub(crate) probe: f64,
    pub(crate) shape: Vec<(&'static str, f64)>,
}

impl Form {
    fn new(change: Change, shape: &[(&'static str, f64)]) -> Self {
        Self { change, probe: change.probe(), shape: shape.to_vec() }
    }
}

/// What the frames can show, for the choice of forms.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Abilities {
    pub(crate) registered: bool,
    pub(crate) angles: bool,
    pub(crate) map: bool,
    pub(crate) mesh: bool,
    /// Longitude and latitude are known.
    pub(crate) places: bool,
    /// Least and largest distance from the axis, 1 at half the camera's width.
    pub(crate) axis: [f64; 2],
    pub(crate) mirrored: bool,
    pub(crate) exposures: bool,
    /// Several frames of different mean levels.
    pub(crate) levels: bool,
    /// Largest measured level, share of full scale.
    pub(crate) brightest: f64,
    /// The prediction's law is known to be Lambert's.
    pub(crate) lambert: bool,
}

/// Relative change of r over the pixels below which the field cannot be seen.
const LEAST_FIELD: f64 = 0.15;

fn laws(lambert: bool) -> Vec<Form> {
    fn form(law: impl Into<Law>, name: &'static str, value: f64) -> Form {
        let photometry = Photometry::new(law, PhaseFunction::CONSTANT, Some(1.0));
        Form::new(Change::Law(photometry), &[(name, value)])
    }
    let mut out = vec![form(LommelSeeliger, "lommel_seeliger", 1.0)];
    if !lambert {
        out.push(form(Lambert, "lambert", 1.0));
    }
    for k in [0.5, 0.7, 0.85] {
        out.push(form(Minnaert { k }, "minnaert_k", k));
    }
    for deg in [15.0f64, 30.0] {
        out.push(form(OrenNayar { roughness_rad: deg.to_radians() }, "oren_nayar_deg", deg));
    }
    for deg in [5.0f64, 15.0, 24.0, 35.0] {
        let law = Hapke { roughness_rad: deg.to_radians(), ..Hapke::lunar() };
        out.push(form(law, "hapke_roughness_deg", deg));
    }
    out
}

/// The forms of every effect on frames, or why these frames cannot show it.
pub(crate) fn catalogue(can: &Abilities) -> Vec<(FramesEffect, Result<Vec<Form>, String>)> {
    FramesEffect::ALL.iter().map(|&effect| (effect, forms(effect, can))).collect()
}

/// The forms of an effect, or why these frames cannot show it.
fn forms(effect: FramesEffect, can: &Abilities) -> Result<Vec<Form>, String> {
    use FramesEffect as E;
    let when =
        |able: bool, forms: Vec<Form>, reason: &str| if able { Ok(forms) } else { Err(reason.to_owned()) };
    let always = format!("`{}` is fitted always; --baseline gain leaves it open", effect.name());
    let single = |change: Change| vec![Form::new(change, &[])];
    let in_field = can.axis[1] > 0.02 && can.axis[1] - can.axis[0] > LEAST_FIELD * can.axis[1];
    let field = "column `axis_r` hardly varies: frames with the body elsewhere in the field";
    let aside = |change: Change| {
        when(can.axis[1] > 0.02, single(change), "the body stands on the axis: a frame with it elsewhere")
    };
    let blurs = |change: Change| -> Vec<Form> {
        [0.15, 0.4, 0.8, 1.5, 3.0, 6.0, 12.0].map(|probe| Form { change, probe, shape: Vec::new() }).to_vec()
    };
    let mesh =
        "the prediction has the mesh already, or none is known: give `scene` and `frame` with start = smooth";
    let placed = |change: Change| if can.registered { Err(always.clone()) } else { Ok(single(change)) };
    match effect {
        E::PhotometricFunction => when(
            can.angles,
            laws(can.lambert),
            "layers `incidence_deg`, `emission_deg`, `phase_deg` and `mask` are missing",
        ),
        E::AlbedoMap if can.map => Ok([0.5, 1.0, 1.5, 2.0]
            .map(|power| Form::new(Change::Map { power }, &[("power", power)]))
            .to_vec()),
        E::AlbedoMap => when(
            can.places,
            single(Change::Harmonics),
            "longitude and latitude are not known: give `scene` and `frame`",
        ),
        E::Relief => when(can.mesh, single(Change::Relief), mesh),
        E::TerrainShadow => when(can.mesh, single(Change::Shadow), mesh),
        E::Defocus => Ok(blurs(Change::Blur)),
        E::FieldCurvature => when(in_field, blurs(Change::FieldBlur), field),
        E::Coma => when(
            can.axis[1] > 0.02,
            // Its spread grows with the square: it is looked for at some sizes, on both sides.
            [0.5, 2.0, 6.0, -0.5, -2.0, -6.0].map(|probe| Form { change: Change::Coma, probe, shape: Vec::new() }).to_vec(),
            "the body stands on the axis: a frame with it elsewhere",
        ),
        E::Astigmatism => aside(Change::Astigmatism),
        E::VeilingGlare => {
            let mut glares: Vec<Form> = [2.0, 4.0, 8.0, 16.0]
                .map(|width_px| Form::new(Change::Glare { width_px }, &[("width_px", width_px)]))
                .to_vec();
            if can.levels {
                glares.push(Form::new(Change::MeanGlare, &[("of_mean", 1.0)]));
            }
            Ok(glares)
        }
        E::Ghost => when(
            can.mirrored,
            single(Change::Ghost),
            "the mirrored body lies outside the pixels looked at: a frame with it nearer to the axis",
        ),
        E::Vignetting => when(
            in_field,
            [2, 4]
                .map(|power| Form::new(Change::Vignetting { power }, &[("power_of_r", f64::from(power))]))
                .to_vec(),
            field,
        ),
        E::DarkOffset => match (can.registered, can.exposures) {
            (false, false) => Ok(single(Change::DarkLevel)),
            (false, true) => {
                Ok(vec![Form::new(Change::DarkLevel, &[]), Form::new(Change::DarkCurrent, &[("grows", 1.0)])])
            }
            (true, true) => Ok(single(Change::DarkCurrent)),
            (true, false) => Err(format!("{always}; column `exposure_s` does not vary")),
        },
        E::DetectorNonlinearity => Ok(single(Change::Nonlinearity)),
        E::Saturation => {
            let wells: Vec<Form> = [0.6, 0.7, 0.8, 0.9, 0.95]
                .into_iter()
                .filter(|share| *share < can.brightest)
                .map(|share| Form::new(Change::FullWell { share }, &[("full_well", share)]))
                .collect();
            let bright = format!("the brightest pixel that counts is at {:.2} of full scale", can.brightest);
            when(!wells.is_empty(), wells, &bright)
        }
        E::Prnu | E::Mura => Err(
            "a map over pixels is not fitted from images of a body; measure it: at least 16 frames of an even field, averaged and divided by their smooth part, and divide the images by it. The camera's own (prnu) stays where it is when the display is shifted behind it, the display's (mura) moves along"
                .to_owned(),
        ),
        E::ImageShift => placed(Change::Shift),
        E::Roll => placed(Change::Roll),
        E::Scale => placed(Change::Scale),
        E::SourceSize => {
            Err("an image of a body does not show the width of points: give a table of points".to_owned())
        }
    }
}

/// Real spherical harmonics of degrees 1 to 3, not normalised, of a unit vector (cartesian forms).
pub(crate) fn harmonics(longitude_rad: f64, latitude_rad: f64) -> [f64; HARMONIC_COUNT] {
    let (x, y, z) = (
        latitude_rad.cos() * longitude_rad.cos(),
        latitude_rad.cos() * longitude_rad.sin(),
        latitude_rad.sin(),
    );
    [
        x,
        y,
        z,
        x * y,
        y * z,
        x * z,
        x * x - y * y,
        1.5 * z * z - 0.5,
        y * (3.0 * x * x - y * y),
        x * y * z,
        y * (5.0 * z * z - 1.0),
        z * (5.0 * z * z - 3.0),
        x * (5.0 * z * z - 1.0),
        z * (x * x - y * y),
        x * (x * x - 3.0 * y * y),
    ]
}
