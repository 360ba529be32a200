//! Lens models of wide fields: where a direction lands in a camera, as OpenCV and mrcal define it.
//!
//! With theta the angle from the optical axis, and f = (f_x, f_y), c = (c_x, c_y) in pixels:
//!
//! | model | image radius / f | source |
//! |---|---|---|
//! | pinhole | tan theta | OpenCV `projectPoints` without distortion, mrcal `LENSMODEL_PINHOLE` |
//! | equidistant | theta | K. Miyamoto, Fish eye lens, JOSA 54, 1964 |
//! | equisolid | 2 sin(theta / 2) | the same |
//! | stereographic | 2 tan(theta / 2) | the same; mrcal `LENSMODEL_STEREOGRAPHIC` |
//! | Kannala-Brandt | theta + k1 theta^3 + k2 theta^5 + k3 theta^7 + k4 theta^9 | J. Kannala, S. S. Brandt, IEEE PAMI 28, 2006; OpenCV `fisheye` |
//! | rational | see [`LensModel::Rational`] | OpenCV `CALIB_RATIONAL_MODEL`, mrcal `LENSMODEL_OPENCV8` |
//!
//! Pixels are this project's: the centre of the first one is (0.5, 0.5). OpenCV and mrcal call it (0, 0).

use glam::{DVec2, DVec3};

/// Most coefficients of a model.
pub const MOST_COEFFICIENTS: usize = 8;

/// A law of projection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LensModel {
    /// r = tan theta.
    Pinhole,
    /// r = theta.
    Equidistant,
    /// r = 2 sin(theta / 2).
    Equisolid,
    /// r = 2 tan(theta / 2).
    Stereographic,
    /// r = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8).
    KannalaBrandt,
    /// With x, y on the tangent plane and r^2 = x^2 + y^2, the factor
    /// g = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) and
    /// x' = x g + 2 p1 x y + p2 (r^2 + 2 x^2), y' = y g + p1 (r^2 + 2 y^2) + 2 p2 x y.
    Rational,
}

/// Why a direction has no place in the image of a model.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum OutOfDomain {
    /// The model uses the tangent plane, which ends at 90 degrees.
    #[error("the direction is 90 degrees or more from the optical axis, where a {0} model has no image")]
    BehindTangentPlane(&'static str),
    /// The direction is opposite to the optical axis, or no direction.
    #[error("the direction is opposite to the optical axis, where the image has no single place")]
    Opposite,
    /// The rational model's denominator.
    #[error("the denominator of the rational model is not above 0 there")]
    Denominator,
}

/// A camera with one of the models.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// The law.
    pub model: LensModel,
    /// Focal lengths along x and y, px.
    pub focal_px: DVec2,
    /// Principal point, px.
    pub centre_px: DVec2,
    /// Coefficients in the order of [`LensModel::coefficient_names`]; the others are 0.
    pub coefficients: [f64; MOST_COEFFICIENTS],
}

/// Where a direction lands, with derivatives.
#[derive(Debug, Clone, Copy)]
pub struct LensImage {
    /// (image - principal point) / focal length.
    pub normalised: DVec2,
    /// Gradients of the normalised x and y by the direction's components.
    pub gradient: [DVec3; 2],
    /// Derivatives of the normalised place by the coefficients.
    pub by_coefficient: [DVec2; MOST_COEFFICIENTS],
}

/// Directions nearer to the optical axis than this are on it: what is left out is of second order, below rounding.
const ON_AXIS: f64 = 1e-9;
/// Steps in which a radial law is checked for a turning point.
const SLOPE_STEPS: u32 = 2000;

impl LensModel {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Pinhole,
        Self::Equidistant,
        Self::Equisolid,
        Self::Stereographic,
        Self::KannalaBrandt,
        Self::Rational,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinhole => "pinhole",
            Self::Equidistant => "fisheye:equidistant",
            Self::Equisolid => "fisheye:equisolid",
            Self::Stereographic => "fisheye:stereographic",
            Self::KannalaBrandt => "fisheye:kannala-brandt",
            Self::Rational => "rational",
        }
    }

    /// From its name; `fisheye` alone is Kannala and Brandt's.
    pub fn of_name(name: &str) -> Option<Self> {
        let name = if name == "fisheye" { "fisheye:kannala-brandt" } else { name };
        Self::ALL.into_iter().find(|model| model.name() == name)
    }

    /// Names of its coefficients, in OpenCV's order.
    pub fn coefficient_names(self) -> &'static [&'static str] {
        match self {
            Self::KannalaBrandt => &["k1", "k2", "k3", "k4"],
            Self::Rational => &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
            _ => &[],
        }
    }
}

impl Lens {
    /// Without distortion.
    pub fn new(model: LensModel, focal_px: DVec2, centre_px: DVec2) -> Self {
        Self { model, focal_px, centre_px, coefficients: [0.0; MOST_COEFFICIENTS] }
    }

    /// The pixel position of a direction in the camera's frame, of any length.
    ///
    /// # Errors
    /// The model has no image there.
    pub fn pixel(&self, direction_camera: DVec3) -> Result<DVec2, OutOfDomain> {
        self.image(direction_camera).map(|image| self.pixel_of(&image))
    }

    /// The pixel position of an image.
    pub fn pixel_of(&self, image: &LensImage) -> DVec2 {
        self.focal_px * image.normalised + self.centre_px
    }

    /// Where a direction lands, with derivatives.
    ///
    /// # Errors
    /// The model has no image there.
    pub fn image(&self, direction_camera: DVec3) -> Result<LensImage, OutOfDomain> {
        match self.model {
            LensModel::Pinhole | LensModel::Rational => self.on_tangent_plane(direction_camera),
            _ => self.by_angle(direction_camera),
        }
    }

    fn on_tangent_plane(&self, d: DVec3) -> Result<LensImage, OutOfDomain> {
        if d.z.is_nan() || d.z <= 0.0 {
            return Err(OutOfDomain::BehindTangentPlane(self.model.name()));
        }
        let (x, y) = (d.x / d.z, d.y / d.z);
        let (mut normalised, mut by_coefficient) = (DVec2::new(x, y), [DVec2::ZERO; MOST_COEFFICIENTS]);
        // Derivatives by x and y on the tangent plane: columns of the Jacobian.
        let (mut by_x, mut by_y) = (DVec2::X, DVec2::Y);
        if self.model == LensModel::Rational {
            let [k1, k2, p1, p2, k3, k4, k5, k6] = self.coefficients;
            let r2 = x * x + y * y;
            let over = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let under = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
            if under.is_nan() || under <= 0.0 {
                return Err(OutOfDomain::Denominator);
            }
            let g = over / under;
            // By r^2.
            let slope =
                (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3) - g * (k4 + r2 * (2.0 * k5 + 3.0 * r2 * k6))) / under;
            let place = DVec2::new(x, y);
            let (first, second) =
                (DVec2::new(2.0 * x * y, r2 + 2.0 * y * y), DVec2::new(r2 + 2.0 * x * x, 2.0 * x * y));
            normalised = place * g + p1 * first + p2 * second;
            by_x = DVec2::new(g, 0.0)
                + place * (2.0 * x * slope)
                + p1 * DVec2::new(2.0 * y, 2.0 * x)
                + p2 * DVec2::new(6.0 * x, 2.0 * y);
            by_y = DVec2::new(0.0, g)
                + place * (2.0 * y * slope)
                + p1 * DVec2::new(2.0 * x, 6.0 * y)
                + p2 * DVec2::new(2.0 * y, 2.0 * x);
            let (r4, r6) = (r2 * r2, r2 * r2 * r2);
            let [up, down] = [place / under, -place * g / under];
            by_coefficient = [up * r2, up * r4, first, second, up * r6, down * r2, down * r4, down * r6];
        }
        let gradient = |axis: usize| {
            let (a, b) = (by_x[axis] / d.z, by_y[axis] / d.z);
            DVec3::new(a, b, -(a * x + b * y))
        };
        Ok(LensImage { normalised, gradient: [gradient(0), gradient(1)], by_coefficient })
    }

    fn by_angle(&self, d: DVec3) -> Result<LensImage, OutOfDomain> {
        let (across, length) = (d.x.hypot(d.y), d.length());
        let near_axis = across <= ON_AXIS * length;
        if length.is_nan() || length <= 0.0 || (near_axis && d.z <= 0.0) {
            return Err(OutOfDomain::Opposite);
        }
        let theta = across.atan2(d.z);
        let (radius, slope) = self.radius(theta);
        // normalised = scale * (x, y); all laws have slope 1 on the axis.
        let (scale, by_across, by_z) = if near_axis {
            (1.0 / d.z, 0.0, -1.0 / (d.z * d.z))
        } else {
            let scale = radius / across;
            let square = length * length;
            (scale, (slope * d.z / square - scale) / across, -slope / square)
        };
        let place = DVec2::new(d.x, d.y);
        let unit = if near_axis { DVec2::ZERO } else { place / across };
        let gradient = |axis: usize| {
            let own = if axis == 0 { DVec2::X } else { DVec2::Y } * scale + place[axis] * by_across * unit;
            own.extend(place[axis] * by_z)
        };
        let mut by_coefficient = [DVec2::ZERO; MOST_COEFFICIENTS];
        if self.model == LensModel::KannalaBrandt {
            let square = theta * theta;
            let mut power = theta;
            for out in &mut by_coefficient[..4] {
                power *= square;
                *out = unit * power;
            }
        }
        Ok(LensImage { normalised: place * scale, gradient: [gradient(0), gradient(1)], by_coefficient })
    }

    /// Radius in focal lengths at an angle from the optical axis, and its derivative; without tangential terms.
    fn radius(&self, theta: f64) -> (f64, f64) {
        let half = 0.5 * theta;
        match self.model {
            LensModel::Equidistant => (theta, 1.0),
            LensModel::Equisolid => (2.0 * half.sin(), half.cos()),
            LensModel::Stereographic => (2.0 * half.tan(), 1.0 / half.cos().powi(2)),
            LensModel::KannalaBrandt => {
                let [k1, k2, k3, k4, ..] = self.coefficients;
                let t = theta * theta;
                let radius = theta * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))));
                (radius, 1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4))))
            }
            LensModel::Pinhole => (theta.tan(), 1.0 / theta.cos().powi(2)),
            LensModel::Rational => {
                let [k1, k2, _, _, k3, k4, k5, k6] = self.coefficients;
                let r = theta.tan();
                let t = r * r;
                let over = 1.0 + t * (k1 + t * (k2 + t * k3));
                let under = 1.0 + t * (k4 + t * (k5 + t * k6));
                let by_t = (k1 + t * (2.0 * k2 + 3.0 * t * k3)) / under
                    - over * (k4 + t * (2.0 * k5 + 3.0 * t * k6)) / (under * under);
                let g = over / under;
                (r * g, (g + 2.0 * t * by_t) * (1.0 + t))
            }
        }
    }

    /// The smallest angle from the optical axis, up to `most_rad`, at which the radius stops growing: from there on two
    /// directions share a place, and a fitted polynomial means nothing. `None` where it grows all the way.
    ///
    /// The angle is sampled in 2000 steps.
    pub fn turning_angle_rad(&self, most_rad: f64) -> Option<f64> {
        let steps = 1..=SLOPE_STEPS;
        steps.map(|k| most_rad * f64::from(k) / f64::from(SLOPE_STEPS)).find(|&theta| {
            let slope = self.radius(theta).1;
            slope.is_nan() || slope <= 0.0
        })
    }
}

#[cfg(test)]
#[path = "lens_models_tests.rs"]
mod tests;
