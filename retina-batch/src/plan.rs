//! Which image is rendered for a frame, and how the screen's is made of it.

use glam::DVec2;
use retina_geometry::{Distortion, Pinhole, WarpMap};
use retina_render::{PLANE_NAMES, Planes, RadianceImage};
use retina_scene::{Compensation, Display, Layer, Scene};

use crate::{Canvas, Channels, Resampler};

/// What is rendered for each frame of a scene, and what becomes of it.
#[derive(Debug, Clone)]
pub struct ImagePlan {
    /// The image that is rendered.
    pub image: Pinhole,
    /// D in the lines of sight that are rendered (mode `direct`).
    pub distortion: Option<Distortion>,
    /// The resampling into the screen's image (mode `resample`).
    pub resampling: Option<(WarpMap, Canvas)>,
    /// Planes that are rendered.
    pub planes: Planes,
    screen: Pinhole,
    /// Index of the plane that the picture shows: radiance in a facility, else the radiance factor.
    light: usize,
    channels: Option<Vec<&'static str>>,
    side_products: bool,
    mode: Compensation,
}

/// A frame's images.
pub(crate) struct Developed {
    /// Light of each of the picture's pixels: radiance, W m^-2 sr^-1 nm^-1, or radiance factor;
    /// empty where there is no body.
    pub(crate) light: Vec<f32>,
    /// Where on the screen an unresolved body's light is to be shown, px.
    pub(crate) photocentre_px: Option<DVec2>,
    /// The EXR's channels, where one is asked for.
    pub(crate) channels: Option<Channels>,
}

impl ImagePlan {
    /// The plan of a scene.
    pub fn of(scene: &Scene) -> Self {
        let screen = scene.image;
        let light = usize::from(matches!(scene.display, Display::Plain(_)));
        let channels = scene.output.exr.then(|| {
            let mut names = vec!["Y", "IF"];
            names.extend(scene.output.layers.iter().flat_map(|layer: &Layer| layer.channels()));
            names.dedup();
            names
        });
        let planes = match &channels {
            None if light == 0 => Planes::Radiance,
            None => Planes::RadianceFactor,
            Some(names) if names.len() == 2 => Planes::RadianceFactor,
            Some(_) => Planes::Layers,
        };
        let mode = scene.compensation;
        let mut plan = Self {
            image: screen,
            distortion: None,
            resampling: None,
            planes,
            screen,
            light,
            channels,
            side_products: false,
            mode,
        };
        match (mode, &scene.distortion) {
            (Compensation::Direct, Some(distortion)) => plan.distortion = Some(distortion.clone()),
            (Compensation::Resample, Some(distortion)) => {
                let map = WarpMap { pinhole: screen, distortion: distortion.clone() };
                let canvas = Canvas::around(&map);
                plan.image = Pinhole {
                    cx_px: screen.cx_px - f64::from(canvas.origin_px[0]),
                    cy_px: screen.cy_px - f64::from(canvas.origin_px[1]),
                    width_px: canvas.size_px[0],
                    height_px: canvas.size_px[1],
                    ..screen
                };
                plan.resampling = Some((map, canvas));
            }
            _ => {}
        }
        plan
    }

    /// Also renders what side products are made of.
    pub(crate) fn add_side_products(&mut self, planes: Planes) {
        self.planes = self.planes.max(planes);
        self.side_products = true;
    }

    /// Whether the rendered image is wanted whole, besides the screen's.
    pub(crate) fn keeps_rendered(&self) -> bool {
        self.channels.is_some() || self.side_products || self.light > 0
    }

    /// What an EXR's pixels are, for its metadata.
    pub(crate) fn exr_geometry(&self) -> &'static str {
        match self.mode {
            Compensation::None => "screen: pixel R is the line of sight K_f^-1 R",
            Compensation::Direct => "screen: pixel R is the line of sight D(K_f^-1 R)",
            Compensation::Resample => {
                "undistorted K_f image: pixel R is the line of sight K_f^-1 R; the screen image is resampled from it"
            }
        }
    }

    /// What a scene without bodies gives: no planes at all where nobody looks at them.
    pub(crate) fn dark(&self) -> RadianceImage {
        let Pinhole { width_px, height_px, .. } = self.image;
        let planes = if self.keeps_rendered() { self.planes.count() } else { 0 };
        RadianceImage {
            width_px,
            height_px,
            data: vec![0.0; planes * width_px as usize * height_px as usize],
            photocentre_px: None,
        }
    }

    /// The screen's radiance and the EXR's channels from what was rendered.
    pub(crate) fn develop(&self, rendered: &RadianceImage, resampler: Option<&Resampler>) -> Developed {
        let channels = self.channels.as_ref().map(|names| self.crop(rendered, names));
        if rendered.plane_count() == 0 {
            return Developed { light: Vec::new(), photocentre_px: None, channels };
        }
        // A warp on the GPU leaves the one plane that it made.
        let light = rendered.plane(self.light.min(rendered.plane_count() - 1));
        let light = resampler.map_or_else(|| light.to_vec(), |resampler| resampler.resample(light));
        // Resampled light is already spread over several pixels.
        let photocentre_px = rendered.photocentre_px.filter(|_| self.resampling.is_none());
        Developed { light, photocentre_px, channels }
    }

    /// The channels over the screen's area.
    fn crop(&self, rendered: &RadianceImage, names: &[&str]) -> Channels {
        let (width, height) = (self.screen.width_px as usize, self.screen.height_px as usize);
        let [left, top] =
            self.resampling.as_ref().map_or([0, 0], |(_, canvas)| canvas.origin_px.map(|o| (-o) as usize));
        let rendered_width = rendered.width_px as usize;
        let cut = |name: &str| -> Option<Vec<f32>> {
            let plane = rendered.plane(PLANE_NAMES.iter().position(|plane| *plane == name)?);
            Some(
                (0..height)
                    .flat_map(|y| {
                        let first = (y + top) * rendered_width + left;
                        plane[first..first + width].iter().copied()
                    })
                    .collect(),
            )
        };
        let mut channels: Vec<(String, Vec<f32>)> =
            names.iter().filter_map(|name| Some((String::from(*name), cut(name)?))).collect();
        // Where there is no body, the depth is without bound.
        if let Some((_, depth)) = channels.iter_mut().find(|(name, _)| name == "depth")
            && let Some(mask) = cut("mask")
        {
            for (depth, coverage) in depth.iter_mut().zip(mask) {
                if coverage == 0.0 {
                    *depth = f32::INFINITY;
                }
            }
        }
        Channels { width_px: width, height_px: height, channels }
    }
}
