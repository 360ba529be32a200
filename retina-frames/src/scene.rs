//! The prediction from a frame of a scene: its reference ellipsoid by formula, its mesh by rays.

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use once_cell::race::OnceBox;
use rayon::prelude::*;
use retina_files::InputError;
use retina_geometry::Pinhole;
use retina_radiometry::{AU_M, Lambert, PhaseFunction, Photometry};
use retina_render::{BodyModel, BodyState, CpuRenderer, CpuSampling, FrameState, Planes, RadianceImage};
use retina_scene::Scene;

use crate::grid::Grid;
use crate::layers::{Angles, Layers, Mesh, Ratios, angles};
use crate::window::{Pose, Window};

/// The body of a scene, with what renders it.
pub(crate) struct SceneBody {
    model: BodyModel,
    semi_axes_m: DVec3,
    /// Renderers of the body as it is, of Lambert's law, and of a white one without its map: their trees take seconds.
    own: OnceBox<CpuRenderer>,
    lambert: OnceBox<CpuRenderer>,
    white: OnceBox<CpuRenderer>,
}

impl SceneBody {
    /// The one body of a scene.
    ///
    /// # Errors
    /// More or fewer bodies than one.
    pub(crate) fn of(scene: &Scene) -> Result<Self, InputError> {
        let (Some(model), 1) = (scene.models().first(), scene.bodies.len()) else {
            return Err(InputError::new(&scene.file, "images are compared with scenes of one body")
                .found(format!("{} bodies", scene.bodies.len()))
                .expected("one table [[body]]")
                .help("render the scene to an EXR and give that as `predicted`"));
        };
        Ok(Self::new(model.clone(), scene.bodies[0].reference_semi_axes_m))
    }

    fn new(model: BodyModel, semi_axes_m: DVec3) -> Self {
        Self { model, semi_axes_m, own: OnceBox::new(), lambert: OnceBox::new(), white: OnceBox::new() }
    }

    fn own(&self) -> &CpuRenderer {
        self.own.get_or_init(|| Box::new(renderer(self.model.clone())))
    }

    fn lambert(&self) -> &CpuRenderer {
        self.lambert.get_or_init(|| {
            Box::new(renderer(BodyModel { photometry: white_lambert(), ..self.model.clone() }))
        })
    }

    fn white(&self) -> &CpuRenderer {
        self.white.get_or_init(|| {
            let mut model = BodyModel { photometry: white_lambert(), ..self.model.clone() };
            model.shape.surfaces.iter_mut().for_each(|s| (s.albedo_map, s.albedo_factor) = (None, 1.0));
            Box::new(renderer(model))
        })
    }
}

/// A frame of a scene.
pub(crate) struct SceneOrigin {
    body: Arc<SceneBody>,
    state: BodyState,
    smooth: bool,
}

/// Lambert's law of a white body: the level is fitted.
/// Coverage, angles, and longitude and latitude (rad) of a cell of the smooth body.
type Cell = (f32, Angles, [f32; 2]);

fn white_lambert() -> Photometry {
    Photometry::new(Lambert, PhaseFunction::CONSTANT, Some(1.0))
}

impl SceneOrigin {
    /// A scene's frame.
    ///
    /// # Errors
    /// No such frame.
    pub(crate) fn new(
        scene: &Scene,
        body: Arc<SceneBody>,
        frame: usize,
        smooth: bool,
    ) -> Result<Self, InputError> {
        Ok(Self { body, state: scene.frame(frame)?.bodies[0], smooth })
    }

    /// Middle and radius of its image, px; `None` behind the camera.
    pub(crate) fn outline(&self, camera: &Pinhole) -> Option<(DVec2, f64)> {
        let place = self.state.position_camera_m;
        let radius = self.body.semi_axes_m.max_element();
        let sine = radius / place.length();
        (sine < 1.0).then_some(())?;
        Some((camera.project(place)?, camera.fx_px * sine / (1.0 - sine * sine).sqrt()))
    }

    fn turned(&self, rotation: DMat3) -> BodyState {
        BodyState {
            position_camera_m: rotation * self.state.position_camera_m,
            camera_from_body: rotation * self.state.camera_from_body,
            ..self.state
        }
    }

    /// The smooth body's light alone, for a first look.
    pub(crate) fn preview(&self, camera: &Pinhole, window: &Window, pose: &Pose) -> Grid {
        self.ellipsoid(&window.pinhole(camera), &self.turned(pose.rotation(camera))).light
    }

    /// The body's light with its map and relief.
    pub(crate) fn detail(&self, camera: &Pinhole, window: &Window) -> Grid {
        let renderer = if self.smooth { self.body.lambert() } else { self.body.own() };
        plane(&render(renderer, window.pinhole(camera), self.state), IF)
    }

    /// The layers that it is registered by: without those of the mesh where the prediction is smooth.
    pub(crate) fn outlines(&self, camera: &Pinhole, window: &Window, pose: &Pose) -> Layers {
        if self.smooth {
            return self.ellipsoid(&window.pinhole(camera), &self.turned(pose.rotation(camera)));
        }
        self.layers(camera, window, pose)
    }

    /// All layers.
    pub(crate) fn layers(&self, camera: &Pinhole, window: &Window, pose: &Pose) -> Layers {
        let pinhole = window.pinhole(camera);
        let state = self.turned(pose.rotation(camera));
        let mut smooth = self.ellipsoid(&pinhole, &state);
        let has_map = self.body.model.shape.surfaces.iter().any(|surface| surface.albedo_map.is_some());
        if !self.smooth {
            let rendered = render(self.body.own(), pinhole, state);
            return Layers {
                light: plane(&rendered, IF),
                coverage: Some(plane(&rendered, MASK)),
                angles: Some(angles_of(&rendered)),
                law: Some(self.body.model.photometry),
                place_rad: smooth.place_rad,
                map: None,
                mesh: None,
                ratios: Ratios::default(),
            };
        }
        if has_map {
            // With the Sun behind the camera nothing is dark, and the map is what light is left of.
            let towards = -(state.camera_from_body.transpose() * state.position_camera_m).normalize();
            let full = BodyState { sun_position_body_m: AU_M * towards, ..state };
            let both = [self.body.lambert(), self.body.white()];
            let [with, without] = both.map(|renderer| plane(&render(renderer, pinhole, full), IF));
            smooth.map = Some(with.map2(&without, |a, b| if b > 1e-3 { a / b } else { 1.0 }));
        }
        let rendered = render(self.body.white(), pinhole, state);
        let (angles, shadow) = (angles_of(&rendered), plane(&rendered, SHADOW));
        let coverage = plane(&rendered, MASK);
        let light: Vec<f32> = angles.iter().zip(&coverage.values).map(|(a, c)| a.mu0.max(0.0) * c).collect();
        // What the night side's own slope hides is no shadow.
        let hidden = |(a, s): (&Angles, &f32)| if a.mu0 > 0.0 { *s } else { 0.0 };
        let shadow = Grid { values: angles.iter().zip(&shadow.values).map(hidden).collect(), ..shadow };
        smooth.mesh = Some(Mesh { light: Grid { values: light, ..coverage }, angles, shadow });
        smooth
    }

    /// The reference ellipsoid under Lambert's law, each cell at its middle, its edge by the cell's covered part.
    fn ellipsoid(&self, pinhole: &Pinhole, state: &BodyState) -> Layers {
        let (columns, rows) = (pinhole.width_px as usize, pinhole.height_px as usize);
        let body_from_camera = state.camera_from_body.transpose();
        let inverse = self.body.semi_axes_m.recip();
        // In units of the semi-axes the body is the unit sphere.
        let origin = -(body_from_camera * state.position_camera_m) * inverse;
        let closest = |cell: DVec2| -> (DVec3, DVec3, f64) {
            let ray = body_from_camera * pinhole.line_of_sight(cell).extend(1.0);
            let along = (ray * inverse).normalize();
            let nearest = origin - along * origin.dot(along);
            (along, nearest, 1.0 - nearest.length())
        };
        let cells: Vec<Cell> = (0..columns * rows)
            .into_par_iter()
            .map(|at| {
                let cell = DVec2::new((at % columns) as f64 + 0.5, (at / columns) as f64 + 0.5);
                let (along, nearest, depth) = closest(cell);
                if depth < -0.5 {
                    return (0.0, Angles::default(), [f32::NAN; 2]);
                }
                let slope = DVec2::new(
                    closest(cell + DVec2::new(0.5, 0.0)).2 - closest(cell - DVec2::new(0.5, 0.0)).2,
                    closest(cell + DVec2::new(0.0, 0.5)).2 - closest(cell - DVec2::new(0.0, 0.5)).2,
                );
                let coverage = (0.5 + depth / slope.length().max(1e-12)).clamp(0.0, 1.0);
                if coverage == 0.0 {
                    return (0.0, Angles::default(), [f32::NAN; 2]);
                }
                let inside = nearest.length().min(1.0);
                let unit = nearest.normalize_or_zero() * inside - along * (1.0 - inside * inside).sqrt();
                let point = unit * self.body.semi_axes_m;
                let normal = (unit * inverse).normalize();
                let to_observer = (origin * self.body.semi_axes_m - point).normalize();
                let to_sun = (state.sun_position_body_m - point).normalize();
                let angles = Angles {
                    mu0: normal.dot(to_sun) as f32,
                    mu: normal.dot(to_observer).max(1e-3) as f32,
                    phase_rad: to_sun.angle_between(to_observer) as f32,
                };
                let place = [point.y.atan2(point.x) as f32, normal.z.clamp(-1.0, 1.0).asin() as f32];
                (coverage as f32, angles, place)
            })
            .collect();
        let grid = |of: &dyn Fn(&Cell) -> f32| Grid { columns, rows, values: cells.iter().map(of).collect() };
        Layers {
            light: grid(&|(c, a, _)| c * a.mu0.max(0.0)),
            coverage: Some(grid(&|(c, ..)| *c)),
            law: Some(white_lambert()),
            place_rad: Some(cells.iter().map(|(.., place)| *place).collect()),
            angles: Some(cells.iter().map(|(_, a, _)| *a).collect()),
            map: None,
            mesh: None,
            ratios: Ratios::default(),
        }
    }
}

/// Indices of the planes.
const IF: usize = 1;
const MASK: usize = 2;
const INCIDENCE: usize = 7;
const EMISSION: usize = 8;
const PHASE: usize = 9;
const SHADOW: usize = 10;

/// Few rays a cell: cells are parts of a pixel already.
const SAMPLING: CpuSampling =
    CpuSampling { grid: 2, refined_grid: 3, sun_points: 1, contrast: f64::INFINITY };

fn renderer(model: BodyModel) -> CpuRenderer {
    CpuRenderer::new(vec![model], SAMPLING, Planes::Layers)
}

fn render(renderer: &CpuRenderer, image: Pinhole, state: BodyState) -> RadianceImage {
    renderer.render(&FrameState { image, distortion: None, bodies: vec![state] })
}

fn plane(image: &RadianceImage, index: usize) -> Grid {
    Grid {
        columns: image.width_px as usize,
        rows: image.height_px as usize,
        values: image.plane(index).to_vec(),
    }
}

fn angles_of(image: &RadianceImage) -> Vec<Angles> {
    angles([INCIDENCE, EMISSION, PHASE].map(|index| image.plane(index)), image.plane(MASK))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lambert's sphere at phase a sends (sin a + (pi - a) cos a) 2/(3 pi) of its disc's area (Russell 1916).
    #[test]
    fn light_of_a_lambert_sphere() {
        let phase = 0.9f64;
        let shape = no_mesh();
        let model = BodyModel { name: "ball".into(), shape, photometry: white_lambert() };
        let distance = 400.0;
        let to_camera = DVec3::new(0.0, 0.0, -1.0);
        let sun = DMat3::from_rotation_y(phase) * to_camera;
        let state = BodyState {
            position_camera_m: DVec3::new(0.0, 0.0, distance),
            camera_from_body: DMat3::IDENTITY,
            sun_position_body_m: sun * 1e9,
        };
        let body = Arc::new(SceneBody::new(model, DVec3::ONE));
        let origin = SceneOrigin { body, state, smooth: true };
        let camera = Pinhole {
            fx_px: 16_000.0,
            fy_px: 16_000.0,
            cx_px: 50.0,
            cy_px: 50.0,
            width_px: 100,
            height_px: 100,
        };
        let window = Window { left: 0, top: 0, columns: 100, rows: 100, bin: 1, fine: 4 };
        let light = origin.preview(&camera, &window, &Pose::NOMINAL);
        let total: f64 = light.values.iter().map(|v| f64::from(*v)).sum::<f64>() / 16.0;
        let radius_px = 16_000.0 / (distance * distance - 1.0).sqrt();
        let pi = std::f64::consts::PI;
        let expected =
            pi * radius_px * radius_px * 2.0 / (3.0 * pi) * (phase.sin() + (pi - phase) * phase.cos());
        assert!((total / expected - 1.0).abs() < 2e-3, "{total} {expected}");
    }

    fn no_mesh() -> retina_model::Body {
        retina_model::Body {
            vertices: Vec::new(),
            triangles: Vec::new(),
            triangle_surface: Vec::new(),
            surfaces: Vec::new(),
            albedo_maps: Vec::new(),
            slope_maps: Vec::new(),
        }
    }
}
