//! CORTO's by-products under its own names: image, depth, masks, slopes, labels.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use glam::{DMat3, DQuat, DVec2, DVec3};
use retina_batch::{BatchError, Channels, PngShape, SideProducts, png_bytes, write_exr};
use retina_files::InputError;
use retina_geometry::{Distortion, Pinhole};
use retina_render::{PLANE_NAMES, Planes, RadianceImage};
use retina_scene::{Compensation, Scene, SceneFrame};

use crate::convert::Shown;
use crate::pose::{ObjectPose, Pose};
use crate::scenario::Scenario;

/// Depth of a pixel that shows nothing, Blender units: what Cycles writes.
const NOWHERE_BU: f32 = 1e10;

/// A by-product that can be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Product {
    /// `img/NNNNNN.png`: the frame's image again.
    Image,
    /// `depth/NNNNNN.exr`: depth along the boresight, Blender units.
    Depth,
    /// `mask_ID_K/` and `mask_ID_shadow_K/NNNNNN.png`: the body, and what of it is lit.
    Mask,
    /// `slopes/NNNNNN.exr`: the surface's normal in the world's axes.
    Slopes,
    /// [`Self::Depth`] in the folder `depth_exr`, as later versions of CORTO have it.
    DepthExr,
    /// [`Self::Slopes`] in the folder `slopes_exr`.
    SlopesExr,
    /// `labels/NNNNNN.txt`: the pose, as a row of CORTO's point clouds.
    Labels,
}

impl Product {
    /// By its name on the command line.
    pub fn of(name: &str) -> Option<Self> {
        Some(match name {
            "img" => Self::Image,
            "depth" => Self::Depth,
            "mask" => Self::Mask,
            "slopes" => Self::Slopes,
            "labels" => Self::Labels,
            "depth_exr" => Self::DepthExr,
            "slopes_exr" => Self::SlopesExr,
            _ => return None,
        })
    }

    /// All names.
    pub const NAMES: [&'static str; 7] =
        ["img", "depth", "mask", "slopes", "labels", "depth_exr", "slopes_exr"];

    /// In the order in which files are made.
    const ALL: [Self; 7] =
        [Self::Image, Self::Depth, Self::DepthExr, Self::Mask, Self::Slopes, Self::SlopesExr, Self::Labels];

    /// Whether it is made of more than the picture and the pose.
    fn is_map(self) -> bool {
        !matches!(self, Self::Image | Self::Labels)
    }
}

/// CORTO's by-products of a scenario's frames.
#[derive(Debug)]
pub struct Products {
    wanted: Vec<Product>,
    /// Of each body; bodies may share one.
    pass_indices: Vec<u32>,
    bounding_radii_m: Vec<f64>,
    scale_m_per_bu: f64,
    image: Pinhole,
    /// D in the lines of sight of the image's pixels.
    distortion: Option<Distortion>,
    poses: Vec<Pose>,
}

impl Products {
    /// The by-products asked for, in CORTO's order, each once.
    ///
    /// # Errors
    /// Maps of a compensated screen image that is resampled from another; masks of bodies so near to
    /// each other that a surface point does not tell whose it is.
    pub fn of(
        scenario: &Scenario,
        shown: &Shown,
        scene: &Scene,
        wanted: &[Product],
    ) -> Result<Self, InputError> {
        let wanted: Vec<Product> =
            Product::ALL.into_iter().filter(|product| wanted.contains(product)).collect();
        let maps = wanted.iter().any(|product| product.is_map());
        if maps && matches!(shown, Shown::Facility { compensation: Compensation::Resample, .. }) {
            return Err(InputError::new(
                &scenario.scene_file,
                "depth, mask and slopes are maps of the rendered image, which is not the screen's",
            )
            .at("option --by-products")
            .found("--compensation resample")
            .help("use --compensation direct, whose maps are those of the screen's pixels, or none"));
        }
        let products = Self {
            wanted,
            pass_indices: scenario.settings.pass_indices.clone(),
            bounding_radii_m: scene.bodies.iter().map(|body| body.bounding_radius_m).collect(),
            scale_m_per_bu: scenario.world.scale_m_per_bu,
            image: scene.image,
            distortion: scene.distortion.clone(),
            poses: scenario.poses.clone(),
        };
        if products.wanted.contains(&Product::Mask) {
            (0..scene.frame_count())
                .try_for_each(|index| products.check_apart(scenario, &scene.frame(index)?))?;
        }
        Ok(products)
    }

    /// Bodies are told apart by the spheres around them.
    fn check_apart(&self, scenario: &Scenario, frame: &SceneFrame) -> Result<(), InputError> {
        for (i, one) in frame.bodies.iter().enumerate() {
            for (j, other) in frame.bodies.iter().enumerate().skip(i + 1) {
                let distance_m = one.position_camera_m.distance(other.position_camera_m);
                let needed_m = self.bounding_radii_m[i] + self.bounding_radii_m[j];
                if distance_m <= needed_m && self.pass_indices[i] != self.pass_indices[j] {
                    let names = &scenario.world.body_names;
                    return Err(InputError::new(
                        &scenario.geometry_file,
                        format!(
                            "frame {}: `{}` and `{}` are too near to each other for masks by id",
                            frame.index, names[i], names[j]
                        ),
                    )
                    .at("option --by-products")
                    .found(format!("{distance_m:.6e} m between their centres"))
                    .expected(format!("more than the sum of their largest radii, {needed_m:.6e} m"))
                    .help("leave `mask` out"));
                }
            }
        }
        Ok(())
    }

    /// The distinct pass indices, in ascending order.
    fn mask_ids(&self) -> BTreeSet<u32> {
        self.pass_indices.iter().copied().collect()
    }

    /// For each pixel that shows any surface the pass index of its body: the one around whose centre
    /// the surface point, at the pixel's mean depth, lies.
    fn pass_index_of_pixels(&self, frame: &SceneFrame, image: &RadianceImage) -> Vec<Option<u32>> {
        let (depth_m, coverage) = (plane(image, "depth"), plane(image, "mask"));
        let width = image.width_px as usize;
        (0..image.pixels())
            .map(|pixel| {
                if coverage[pixel] <= 0.0 {
                    return None;
                }
                let middle = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
                let sight = self.image.line_of_sight(middle);
                let sight = self.distortion.as_ref().map_or(sight, |d| d.distort(sight));
                let point_m = sight.extend(1.0) * f64::from(depth_m[pixel]);
                let outside = |body: usize| {
                    point_m.distance(frame.bodies[body].position_camera_m) - self.bounding_radii_m[body]
                };
                let body = (0..frame.bodies.len()).min_by(|&a, &b| outside(a).total_cmp(&outside(b)))?;
                Some(self.pass_indices[body])
            })
            .collect()
    }

    fn exr(&self, frame: &SceneFrame, what: &str, planes: [Vec<f32>; 3]) -> Result<Vec<u8>, BatchError> {
        let (width_px, height_px) = (self.image.width_px as usize, self.image.height_px as usize);
        // Blender's file has an alpha of 1 everywhere.
        let alpha = vec![1.0; width_px * height_px];
        let channels = ["R", "G", "B", "A"]
            .map(str::to_owned)
            .into_iter()
            .zip(planes.into_iter().chain([alpha]))
            .collect();
        let metadata = format!("{{\"schema\":\"retina.corto-{what}/1\",\"frame\":{}}}", frame.index);
        write_exr(Channels { width_px, height_px, channels }, &metadata)
    }

    fn depth(&self, frame: &SceneFrame, image: &RadianceImage) -> Result<Vec<u8>, BatchError> {
        let per_bu = self.scale_m_per_bu;
        let depth_bu: Vec<f32> = plane(image, "depth")
            .iter()
            .zip(plane(image, "mask"))
            .map(
                |(&depth_m, &coverage)| {
                    if coverage > 0.0 { (f64::from(depth_m) / per_bu) as f32 } else { NOWHERE_BU }
                },
            )
            .collect();
        self.exr(frame, "depth", [depth_bu.clone(), depth_bu.clone(), depth_bu])
    }

    fn slopes(&self, frame: &SceneFrame, image: &RadianceImage) -> Result<Vec<u8>, BatchError> {
        let world_from_camera = DMat3::from_quat(frame.camera_from_inertial.inverse());
        let axes = ["normal.x", "normal.y", "normal.z"].map(|name| plane(image, name));
        let mut planes: [Vec<f32>; 3] = Default::default();
        for pixel in 0..image.pixels() {
            let normal = world_from_camera * DVec3::from_array(axes.map(|axis| f64::from(axis[pixel])));
            // An average over the pixel's surface is shorter than 1; a pixel without any has none.
            let normal = normal.normalize_or_zero().as_vec3();
            for (plane, component) in planes.iter_mut().zip(normal.to_array()) {
                plane.push(component);
            }
        }
        self.exr(frame, "slopes", planes)
    }

    fn mask(&self, frame: &SceneFrame, what: &str, values: &[bool]) -> Result<Vec<u8>, BatchError> {
        let samples: Vec<u8> = values.iter().map(|&set| if set { 255 } else { 0 }).collect();
        let Pinhole { width_px, height_px, .. } = self.image;
        let shape = PngShape { width_px, height_px, channels: 1, bits: 8, filtered: true };
        let texts = [("schema", format!("retina.corto-{what}/1")), ("frame", frame.index.to_string())];
        png_bytes(&format!("the mask of frame {}", frame.index), shape, &samples, &texts)
    }
}

impl SideProducts for Products {
    fn description(&self) -> String {
        format!("retina.corto-products/1 {:?} {:?}", self.wanted, self.pass_indices)
    }

    fn planes(&self) -> Planes {
        if self.wanted.iter().any(|product| product.is_map()) { Planes::Layers } else { Planes::Radiance }
    }

    fn files(&self, index: usize) -> Vec<String> {
        let mut files = Vec::new();
        for product in &self.wanted {
            match product {
                Product::Image => files.push(format!("img/{index:06}.png")),
                Product::Depth => files.push(format!("depth/{index:06}.exr")),
                Product::Mask => {
                    for id in self.mask_ids() {
                        files.push(format!("mask_ID_{id}/{index:06}.png"));
                        files.push(format!("mask_ID_shadow_{id}/{index:06}.png"));
                    }
                }
                Product::Slopes => files.push(format!("slopes/{index:06}.exr")),
                Product::DepthExr => files.push(format!("depth_exr/{index:06}.exr")),
                Product::SlopesExr => files.push(format!("slopes_exr/{index:06}.exr")),
                Product::Labels => files.push(format!("labels/{index:06}.txt")),
            }
        }
        files
    }

    fn make(
        &self,
        frame: &SceneFrame,
        image: &RadianceImage,
        picture: &[u8],
    ) -> Result<Vec<Vec<u8>>, BatchError> {
        let mut files = Vec::new();
        for product in &self.wanted {
            match product {
                Product::Image => files.push(picture.to_vec()),
                Product::Depth | Product::DepthExr => files.push(self.depth(frame, image)?),
                Product::Mask => {
                    let ids = self.pass_index_of_pixels(frame, image);
                    let (coverage, light) = (plane(image, "mask"), plane(image, "IF"));
                    for id in self.mask_ids() {
                        let with = |set: &dyn Fn(usize) -> bool| -> Vec<bool> {
                            (0..ids.len()).map(|pixel| ids[pixel] == Some(id) && set(pixel)).collect()
                        };
                        let body = with(&|pixel| coverage[pixel] >= 0.5);
                        files.push(self.mask(frame, "mask", &body)?);
                        let lit = with(&|pixel| coverage[pixel] >= 0.5 && light[pixel] > 0.0);
                        files.push(self.mask(frame, "mask-lit", &lit)?);
                    }
                }
                Product::Slopes | Product::SlopesExr => files.push(self.slopes(frame, image)?),
                Product::Labels => {
                    files.push(self.poses.get(frame.index).map(row).unwrap_or_default().into_bytes())
                }
            }
        }
        Ok(files)
    }
}

/// A plane of an image that was rendered with all of them.
fn plane<'a>(image: &'a RadianceImage, name: &str) -> &'a [f32] {
    let index = PLANE_NAMES.iter().position(|plane| *plane == name);
    image.plane(index.expect("the names are PLANE_NAMES' own"))
}

/// A pose as a row of CORTO's point clouds; the columns of a body repeat for each.
pub fn row(pose: &Pose) -> String {
    let mut text = format!("{}", pose.time_s);
    let mut put = |position: DVec3, turn: Option<DQuat>| {
        let turn = turn.map(|q| [q.w, q.x, q.y, q.z]);
        for value in position.to_array().into_iter().chain(turn.into_iter().flatten()) {
            // Writing to a text cannot fail.
            let _ = write!(text, " {value}");
        }
    };
    let objects = pose.bodies.iter().chain([&pose.camera]);
    for ObjectPose { position_bu, world_from_object } in objects {
        put(*position_bu, Some(*world_from_object));
    }
    put(pose.sun_position_bu, None);
    text.push('\n');
    text
}

/// Reads `--by-products`: names parted by commas.
///
/// # Errors
/// A name that is none, in the words of `place`.
pub fn parse_products(place: &Path, text: &str) -> Result<Vec<Product>, InputError> {
    text.split(',')
        .map(|name| {
            Product::of(name.trim()).ok_or_else(|| {
                InputError::new(place, "there is no such by-product")
                    .found(format!("`{}`", name.trim().escape_default()))
                    .expected(Product::NAMES.join(", "))
            })
        })
        .collect()
}
