//! What a renderer is asked for and what it gives back.

use glam::{DMat3, DVec2, DVec3};
use retina_geometry::{Distortion, Pinhole};
use retina_model::Body;
use retina_radiometry::{Geometry, Photometry};

/// A body and how it scatters light; the same in every frame.
#[derive(Debug, Clone)]
pub struct BodyModel {
    /// Name, as the scene calls it.
    pub name: String,
    /// Triangles and textures, body-fixed axes, metres.
    pub shape: Body,
    /// Photometric function; the texture multiplies it.
    pub photometry: Photometry,
}

/// Where a body is in one frame.
#[derive(Debug, Clone, Copy)]
pub struct BodyState {
    /// Its centre in the camera's frame, m.
    pub position_camera_m: DVec3,
    /// Turns body axes into camera axes.
    pub camera_from_body: DMat3,
    /// From the body's centre to the Sun, body axes, m.
    pub sun_position_body_m: DVec3,
}

impl BodyState {
    /// Phase angle at the body's centre, rad.
    pub fn phase_rad(&self) -> f64 {
        let to_camera = -(self.camera_from_body.transpose() * self.position_camera_m);
        to_camera.angle_between(self.sun_position_body_m)
    }
}

/// One frame: the camera and where everything is.
#[derive(Debug, Clone)]
pub struct FrameState {
    /// The image to fill: K_f of the screen, or any other pinhole.
    pub image: Pinhole,
    /// With it, pixel R sees the line of sight D(K^-1 R); without, K^-1 R.
    pub distortion: Option<Distortion>,
    /// One state for each body model, in the same order.
    pub bodies: Vec<BodyState>,
}

/// How finely a frame is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// For a first look.
    Draft,
    /// Limb within 0.01 px rms of the geometry.
    Default,
    /// Limb within 0.003 px rms of the geometry; slower.
    Best,
}

impl Quality {
    /// log2 of the samples of a pixel on an edge of visibility.
    pub fn edge_samples_log2(self) -> u32 {
        match self {
            Self::Draft => 5,
            Self::Default => 6,
            Self::Best => 8,
        }
    }

    /// log2 of the samples of a pixel inside a body that is refined.
    pub fn inner_samples_log2(self) -> u32 {
        self.edge_samples_log2() - 2
    }

    /// A pixel is refined when its first samples differ by more than this part of the body's
    /// mean radiance factor.
    pub fn contrast(self) -> f64 {
        match self {
            Self::Draft => 0.5,
            Self::Default => 0.12,
            Self::Best => 0.01,
        }
    }
}

/// Mean radiance factor of a smooth sphere of this photometry over its whole disc, never less
/// than a twentieth of the normal value: the yardstick for [`Quality::contrast`].
pub(crate) fn contrast_reference(photometry: &Photometry, phase_rad: f64) -> f64 {
    let normal = photometry.radiance_factor(Geometry { mu0: 1.0, mu: 1.0, phase_rad: 0.0 });
    photometry.sphere_disc_integral(phase_rad, 24).max(0.05 * normal)
}

/// Which quantities are wanted back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Planes {
    /// Radiance alone.
    Radiance,
    /// Radiance and radiance factor.
    RadianceFactor,
    /// All of [`PLANE_NAMES`].
    Layers,
}

/// Names of the planes, in their order, as EXR channels have them.
pub const PLANE_NAMES: [&str; 11] = [
    "Y",
    "IF",
    "mask",
    "depth",
    "normal.x",
    "normal.y",
    "normal.z",
    "incidence_deg",
    "emission_deg",
    "phase_deg",
    "shadow",
];

impl Planes {
    /// How many planes that is.
    pub fn count(self) -> usize {
        match self {
            Self::Radiance => 1,
            Self::RadianceFactor => 2,
            Self::Layers => PLANE_NAMES.len(),
        }
    }
}

/// A rendered image: planes of width x height, row by row, in the order of [`PLANE_NAMES`].
#[derive(Debug, Clone, PartialEq)]
pub struct RadianceImage {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// The planes, one after the other: spectral radiance at 550 nm (W m^-2 sr^-1 nm^-1), I/F, ...
    pub data: Vec<f32>,
    /// Where the frame's one body is unresolved (its bounding sphere's radius is 0.75 px or less): the
    /// centroid of its light, px. The pixels hold how much light there is, not where in a pixel.
    pub photocentre_px: Option<DVec2>,
}

impl RadianceImage {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width_px as usize * self.height_px as usize
    }

    /// Number of planes held.
    pub fn plane_count(&self) -> usize {
        self.data.len() / self.pixels().max(1)
    }

    /// Plane `index` of [`PLANE_NAMES`].
    pub fn plane(&self, index: usize) -> &[f32] {
        &self.data[index * self.pixels()..(index + 1) * self.pixels()]
    }

    /// Spectral radiance at 550 nm, W m^-2 sr^-1 nm^-1.
    pub fn radiance(&self) -> &[f32] {
        self.plane(0)
    }
}

/// A rendering that could not be done.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// No adapter, or one that lacks what is needed.
    #[error("no graphics adapter can be used: {0}")]
    NoAdapter(String),
    /// The scene does not fit the adapter's limits.
    #[error("{what} takes {needed} and the adapter {adapter} allows {allowed}")]
    TooLarge {
        /// What does not fit.
        what: &'static str,
        /// How much it needs.
        needed: u64,
        /// How much there is.
        allowed: u64,
        /// Name of the adapter.
        adapter: String,
    },
    /// The driver left loops of a shader before their end.
    #[error(
        "the driver ended {0} shader invocations before their time: the image would be wrong; use --backend cpu or a coarser body"
    )]
    CutShort(u32),
    /// The device was lost or a read-back failed.
    #[error("the graphics device failed: {0}")]
    Device(String),
    /// More bodies than a scene may hold.
    #[error("the scene holds {0} bodies, at most 32 can be rendered")]
    TooManyBodies(usize),
}

impl BodyModel {
    /// The same body without its triangles and textures, once a device holds them.
    #[cfg(feature = "gpu")]
    pub(crate) fn without_shape(self) -> Self {
        let empty = Body {
            vertices: Vec::new(),
            triangles: Vec::new(),
            triangle_surface: Vec::new(),
            surfaces: Vec::new(),
            albedo_maps: Vec::new(),
            slope_maps: Vec::new(),
        };
        Self { shape: empty, ..self }
    }
}
