//! Position of a resolved body from its limb.
//!
//! 1. `start`: where the body is, by the lit blob's border. `coarse` lays a circle about it (RANSAC); the silhouette of a
//!    mesh (`shape`) is compared with it as a whole.
//! 2. `edge`: sub-pixel edges along the `outline` on the side that is lit (`lit`), by a step with PSF.
//! 3. `blur`: the width of that PSF, by the edges themselves; `smear`: that width by direction.
//! 4. `side`: which side of a nearly full disc is limb, where the Sun's direction is not known.
//! 5. `fit`: position and covariance: of an ellipsoid without iteration (Christian and Robinson 2016), of a silhouette by
//!    least squares.
//! 6. `shading`: what a body's shading does to its edges, by fits in two widths.
//! 7. `wave`: whether what is left is a body's relief, or another outline.
//!
//! [`solve_limb`] runs them, and `judge` says what comes of it: a body, or a [`Refusal`]. [`LimbQuestion`] asks a
//! photograph of which no attitude is known, alone or with the stars in it (`among_stars`). [`KnownBody`] says what may be
//! in it.

mod among_stars;
mod blur;
mod body;
mod camera;
mod coarse;
mod edge;
mod fit;
mod judge;
mod lit;
mod outline;
mod photograph;
mod shading;
mod shape;
mod side;
mod smear;
mod solve;
mod start;
mod wave;

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use retina_geometry::LimbEllipse;
use thiserror::Error;

pub use among_stars::{AmongStars, AmongStarsError, CameraPlace, StarsEpoch};
pub use body::{BodyError, KnownBody};
pub use camera::{LimbCamera, Mapping, StarLens};
pub use photograph::{LimbAnswer, LimbQuestion, LimbSight};
pub use shape::BodyShape;
pub use solve::{LimbLook, first_look, solve_limb};

/// The body that is looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct LimbBody {
    /// Semi-axes of its ellipsoid along the body axes, m.
    pub semi_axes_m: DVec3,
    /// Turns body axes into camera axes; without effect for a sphere.
    pub camera_from_body: DMat3,
    /// Its own shape, where its silhouette is to be fitted and not the ellipsoid's outline.
    pub shape: Option<Arc<BodyShape>>,
}

impl LimbBody {
    /// A sphere.
    pub fn sphere(radius_m: f64) -> Self {
        Self::ellipsoid(DVec3::splat(radius_m), DMat3::IDENTITY)
    }

    /// An ellipsoid.
    pub fn ellipsoid(semi_axes_m: DVec3, camera_from_body: DMat3) -> Self {
        Self { semi_axes_m, camera_from_body, shape: None }
    }

    /// What is fitted, for files: `ellipsoid` (a sphere is one) or `silhouette`.
    pub fn outline(&self) -> &'static str {
        if self.shape.is_some() { "silhouette" } else { "ellipsoid" }
    }

    /// Mean of the semi-axes, m.
    pub fn mean_radius_m(&self) -> f64 {
        self.semi_axes_m.element_sum() / 3.0
    }
}

/// What is known beforehand, and what is asked of an answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimbOptions {
    /// Towards the Sun in the image, any length; found from the lit shape where absent.
    pub sun_direction_px: Option<DVec2>,
    /// Phase angle (Sun - body - camera), rad, where it is known: it says how deep inside the limb the terminator of a
    /// nearly full disc is.
    pub phase_rad: Option<f64>,
    /// What a tone curve that is not known may shift all edges by, share of the blur's standard deviation.
    pub tone_sigma_share: f64,
    /// Mean height of the seen limb above the reference surface, m: peaks stand before valleys.
    pub limb_height_m: f64,
    /// Standard deviation of the limb's mean height and of its first-degree part over the arc, m. Terrain of shorter
    /// scale shows in the residuals and is counted from there; these two a fit cannot see.
    pub limb_height_sigma_m: f64,
    /// Smallest radius that is taken for a resolved body, px.
    pub least_radius_px: f64,
    /// Least length of the measured arc, rad.
    pub least_arc_rad: f64,
}

impl Default for LimbOptions {
    fn default() -> Self {
        Self {
            sun_direction_px: None,
            phase_rad: None,
            tone_sigma_share: 0.0,
            limb_height_m: 0.0,
            limb_height_sigma_m: 0.0,
            least_radius_px: 8.0,
            least_arc_rad: std::f64::consts::FRAC_PI_3,
        }
    }
}

/// A point of the limb.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimbPoint {
    /// Where it is in the image, px.
    pub pixel: DVec2,
    /// Standard deviation across the limb by the edge's own fit, px.
    pub sigma_px: f64,
    /// Measured less fitted outline along the outward normal, px.
    pub residual_px: f64,
    /// False where it was rejected as an outlier.
    pub used: bool,
}

/// Where a position's uncertainty comes from: parts of its covariance, m^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimbCovariance {
    /// The edges' noise and the terrain that shows in the residuals.
    pub points_m2: DMat3,
    /// The limb's mean height and first degree, which residuals do not show.
    pub height_m2: DMat3,
    /// The model of an edge: a PSF that is no Gaussian, saturation, a tone curve.
    pub edge_model_m2: DMat3,
    /// Which side of a nearly full disc is limb.
    pub side_m2: DMat3,
}

impl LimbCovariance {
    /// All of it.
    pub fn sum_m2(&self) -> DMat3 {
        self.points_m2 + self.height_m2 + self.edge_model_m2 + self.side_m2
    }
}

/// A body's position.
#[derive(Debug, Clone)]
pub struct LimbSolution {
    /// Position of the body's centre, camera frame, m.
    pub position_camera_m: DVec3,
    /// Its covariance, m^2.
    pub covariance_m2: DMat3,
    /// What it consists of.
    pub parts: LimbCovariance,
    /// Towards the Sun in the image, unit: as given, or as found from the lit shape; `None` where the whole border was
    /// taken for limb.
    pub sun_direction_px: Option<DVec2>,
    /// The part of the covariance that is new in each image: the edges' own noise, m^2. The rest is terrain and the edge's model,
    /// which images of the same limb share.
    pub noise_covariance_m2: DMat3,
    /// Outline of the body's ellipsoid at that position in the undistorted image.
    pub ellipse: LimbEllipse,
    /// The outline that was fitted in the image as it is: an ellipse, or the silhouette of the body's own shape, as places
    /// in turn; where a silhouette jumps, some are missing.
    pub outline_px: Vec<DVec2>,
    /// Mean of the ellipse's semi-axes and its standard deviation, px.
    pub radius_px: [f64; 2],
    /// Standard deviations of the outline's centre, px.
    pub center_sigma_px: DVec2,
    /// Points of the limb in the order of the outline.
    pub points: Vec<LimbPoint>,
    /// Root mean square of the used points' residuals, px.
    pub rms_px: f64,
    /// Standard deviation of what the edges' own noise does not explain, px: terrain, distortion.
    pub excess_sigma_px: f64,
    /// Variance of the position over that of unrelated points: neighbours share terrain.
    pub correlation_factor: f64,
    /// What is smooth in the residuals.
    pub wave: LimbWave,
    /// Length of the measured arc, rad.
    pub arc_rad: f64,
    /// Standard deviation of the edge's blur, the pixel's aperture included, px.
    pub blur_sigma_px: f64,
}

/// What is smooth in the residuals of a limb, beyond what its radius and its centre could take: second and third
/// harmonics of the position angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimbWave {
    /// Root mean square over the points in use, px.
    pub rms_px: f64,
    /// What it takes from the residuals' squares, over their scatter beside it: about 4 where there is no wave.
    pub gain: f64,
}

/// Why an image gives no position.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum Refusal {
    /// Nothing is lit that is as large as asked for: an empty sky, stars, a body in eclipse.
    #[error("no lit body of at least {least_radius_px:.0} px radius is in the image")]
    NoBody {
        /// The smallest radius asked for, px.
        least_radius_px: f64,
    },
    /// The frame leaves too short an arc.
    #[error("the body is cut by the frame: an arc of {arc_deg:.0} deg is left, {least_deg:.0} are needed")]
    CutByFrame {
        /// What is left, deg.
        arc_deg: f64,
        /// What is needed, deg.
        least_deg: f64,
    },
    /// The lit crescent is thinner than an edge needs, or too short.
    #[error("the crescent is too thin or short: {width_px:.1} px wide, {arc_deg:.0} deg of limb measured")]
    ThinCrescent {
        /// Greatest width, px.
        width_px: f64,
        /// Measured arc, deg.
        arc_deg: f64,
    },
    /// The limb is saturated: where its edge lies cannot be seen.
    #[error("{percent:.0} % of the pixels inside the limb are saturated: expose shorter")]
    Saturated {
        /// Share of the pixels, %.
        percent: f64,
    },
    /// The border is sharp and smooth, and follows another outline than the body's.
    #[error(
        "the border follows another outline than the body's: residuals have a wave of {wave_px:.3} px, and relief makes \
         {allowed_px:.3} px at most"
    )]
    OtherOutline {
        /// Root mean square of the wave, px.
        wave_px: f64,
        /// What the body's relief and the edges' model may make, px.
        allowed_px: f64,
    },
    /// The border does not follow the silhouette that the mesh has in that attitude.
    #[error(
        "the border does not follow the silhouette of the mesh in that attitude: it is off by {off_px:.2} px rms, and \
         {most_px:.2} px are allowed"
    )]
    NotTheSilhouette {
        /// What the points' noise does not explain, px.
        off_px: f64,
        /// What it may be, px.
        most_px: f64,
    },
    /// The edges are blurred in one direction more than in another.
    #[error(
        "the limb is smeared: its edges are {least_px:.1} px wide in one direction and {most_px:.1} px in another"
    )]
    Smeared {
        /// Least blur of a direction, standard deviation, px.
        least_px: f64,
        /// Greatest, px.
        most_px: f64,
    },
    /// Something is lit, but its border is not the outline of the body.
    #[error("what is lit is not the body: {why}")]
    NotTheBody {
        /// What does not fit.
        why: &'static str,
    },
}

impl Refusal {
    /// A name for files.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::NoBody { .. } => "no_body",
            Self::CutByFrame { .. } => "cut_by_frame",
            Self::ThinCrescent { .. } => "thin_crescent",
            Self::Saturated { .. } => "saturated",
            Self::OtherOutline { .. } => "other_outline",
            Self::NotTheSilhouette { .. } => "not_the_silhouette",
            Self::Smeared { .. } => "smeared",
            Self::NotTheBody { .. } => "not_the_body",
        }
    }
}
