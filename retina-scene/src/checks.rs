//! What must hold in every frame, looked at before any is rendered.

use glam::{DVec2, DVec3};
use retina_files::InputError;
use retina_radiometry::SUN_RADIUS_M;

use crate::inside::is_inside;
use crate::{Compensation, Scene, SceneBody, SceneFrame};

/// The lines of sight that the screen shows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Field {
    pub(crate) low: DVec2,
    pub(crate) high: DVec2,
}

impl Field {
    /// Bounds of D(K_f^-1 R), or of K_f^-1 R without compensation, over the screen's border.
    pub(crate) fn of(scene: &Scene) -> Self {
        let image = scene.image;
        let size = DVec2::new(f64::from(image.width_px), f64::from(image.height_px));
        let mut field = Self { low: DVec2::INFINITY, high: DVec2::NEG_INFINITY };
        for step in 0..=64 {
            let t = f64::from(step) / 64.0;
            for corner in [DVec2::new(t, 0.0), DVec2::new(t, 1.0), DVec2::new(0.0, t), DVec2::new(1.0, t)] {
                let sight = image.line_of_sight(corner * size);
                let sight = scene.distortion.as_ref().map_or(sight, |d| d.distort(sight));
                field.low = field.low.min(sight);
                field.high = field.high.max(sight);
            }
        }
        field
    }

    /// Whether a line of sight is within the bounds.
    pub(crate) fn shows(&self, sight: DVec2) -> bool {
        self.within(sight, 0.0)
    }

    /// Whether it is within the bounds or so little beyond, as a tangent.
    pub(crate) fn within(&self, sight: DVec2, reach: f64) -> bool {
        sight.cmpge(self.low - reach).all() && sight.cmple(self.high + reach).all()
    }

    /// The largest angle from the boresight, rad.
    pub(crate) fn corner_rad(&self) -> f64 {
        self.low.abs().max(self.high.abs()).length().atan()
    }

    /// Whether a sphere meets the pyramid of the field: not if it is wholly beyond one of its sides
    /// or behind the camera.
    fn meets(&self, center_m: DVec3, radius_m: f64) -> bool {
        let sides = [
            DVec3::new(-1.0, 0.0, self.low.x),
            DVec3::new(1.0, 0.0, -self.high.x),
            DVec3::new(0.0, -1.0, self.low.y),
            DVec3::new(0.0, 1.0, -self.high.y),
            DVec3::NEG_Z,
        ];
        sides.iter().all(|outward| outward.normalize().dot(center_m) <= radius_m)
    }

    /// Width and height, deg, for messages.
    fn size_deg(&self) -> String {
        let angle = |low: f64, high: f64| (high.atan() - low.atan()).to_degrees();
        format!("{:.2} x {:.2} deg", angle(self.low.x, self.high.x), angle(self.low.y, self.high.y))
    }
}

/// Checks every frame of a scene.
pub(crate) fn all_frames(scene: &Scene) -> Result<(), InputError> {
    let mut checks = FrameChecks::of(scene);
    (0..scene.frame_count()).try_for_each(|index| checks.check(scene, &scene.frame(index)?))
}

/// What must hold of each frame: the Sun and the camera are outside the bodies, which are in view
/// as far as the scene says so.
#[derive(Debug)]
pub struct FrameChecks {
    field: Field,
    /// Whether each body's mesh is closed, once it was asked for.
    closed: Vec<Option<bool>>,
}

impl FrameChecks {
    /// The checks of a scene's frames.
    pub fn of(scene: &Scene) -> Self {
        Self { field: Field::of(scene), closed: vec![None; scene.bodies.len()] }
    }

    /// Checks a frame of that scene, whose meshes must still be there.
    ///
    /// # Errors
    /// What does not hold, with the frame's number.
    pub fn check(&mut self, scene: &Scene, frame: &SceneFrame) -> Result<(), InputError> {
        let check = Check { scene, frame };
        for number in 0..scene.bodies.len() {
            check.sun(number)?;
            check.camera_outside(number, &mut self.closed[number])?;
            check.in_front(number)?;
            check.apart(number)?;
        }
        match scene.stars {
            Some(_) => scene.observer(frame).map(drop),
            None => check.something_in_view(&self.field),
        }
    }
}

struct Check<'a> {
    scene: &'a Scene,
    frame: &'a SceneFrame,
}

impl Check<'_> {
    fn sun(&self, number: usize) -> Result<(), InputError> {
        let body = self.body(number);
        let distance_m = self.frame.bodies[number].sun_position_body_m.length();
        let help = "check sun_x_m, sun_y_m, sun_z_m: metres, in the frame of the other positions";
        if distance_m <= body.bounding_radius_m {
            return Err(self
                .error(format!("the Sun is inside the body `{}`", body.name))
                .found(format!("{distance_m:.6e} m from its centre"))
                .expected(format!("farther than the body's radius, {:.6e} m", body.bounding_radius_m))
                .help(help));
        }
        if distance_m <= SUN_RADIUS_M + body.bounding_radius_m {
            return Err(self
                .error(format!("the body `{}` is inside the Sun", body.name))
                .found(format!("{distance_m:.6e} m from the Sun's centre"))
                .expected(format!("farther than the Sun's radius, {SUN_RADIUS_M:.3e} m"))
                .help(help));
        }
        Ok(())
    }

    /// The camera must be above the surface: of a closed mesh, or else of the reference ellipsoid.
    fn camera_outside(&self, number: usize, closed: &mut Option<bool>) -> Result<(), InputError> {
        let (body, at) = (self.body(number), &self.frame.bodies[number]);
        let distance_m = at.position_camera_m.length();
        if distance_m > body.bounding_radius_m.max(body.reference_semi_axes_m.max_element()) {
            return Ok(());
        }
        let camera_m = -(at.camera_from_body.transpose() * at.position_camera_m);
        let within = (camera_m / body.reference_semi_axes_m).length() <= 1.0;
        if within && distance_m > body.bounding_radius_m {
            return Err(self
                .error(format!("the camera is inside the reference ellipsoid of the body `{}`", body.name))
                .found(format!(
                    "{distance_m:.6e} m from the centre, semi-axes {} m, around a mesh of {:.6e} m",
                    body.reference_semi_axes_m, body.bounding_radius_m
                ))
                .expected("a reference sphere or ellipsoid of the mesh's size")
                .help("check reference_radius_m or reference_semi_axes_m: metres"));
        }
        let shape = &self.scene.models[number].shape;
        let (inside, of) = if *closed.get_or_insert_with(|| shape.is_closed()) {
            (is_inside(shape, camera_m), "the mesh: the surface above the camera is farther from the centre")
        } else {
            (within, "the reference ellipsoid (the mesh is not closed)")
        };
        if !inside {
            return Ok(());
        }
        Err(self
            .error(format!("the camera is inside the body `{}`", body.name))
            .found(format!("{distance_m:.6e} m from its centre, inside {of}"))
            .expected(format!(
                "above the surface; the body's largest radius is {:.6e} m",
                body.bounding_radius_m
            ))
            .help("check camera_x_m, camera_y_m, camera_z_m and the model's unit of length (metres)"))
    }

    /// Two bodies at one place are a mistake: most often neither has columns.
    fn apart(&self, number: usize) -> Result<(), InputError> {
        let places = &self.frame.bodies;
        let same = (0..number).find(|&other| {
            places[other].position_camera_m.distance(places[number].position_camera_m)
                < 1e-9 * self.body(number).bounding_radius_m
        });
        let Some(other) = same else { return Ok(()) };
        let (name, other) = (&self.body(number).name, &self.body(other).name);
        Err(self
            .error(format!("the bodies `{other}` and `{name}` stand at the same place"))
            .expected("bodies apart from each other")
            .help(format!(
                "without columns a body stands at the origin; add {name}_x_m, {name}_y_m, {name}_z_m"
            )))
    }

    fn in_front(&self, number: usize) -> Result<(), InputError> {
        let (body, at) = (self.body(number), &self.frame.bodies[number]);
        let nearest_depth_m = at.position_camera_m.z - body.bounding_radius_m;
        if at.position_camera_m.z + body.bounding_radius_m <= 0.0 {
            if body.may_be_behind {
                return Ok(());
            }
            return Err(self
                .error(format!("the body `{}` is behind the camera", body.name))
                .found(format!("{:.6e} m along the boresight", at.position_camera_m.z))
                .expected("a positive depth: the camera looks along its +z")
                .help(
                    "check camera_from_inertial (scalar first), or set may_be_behind = true for the body",
                ));
        }
        if self.scene.compensation == Compensation::Direct && nearest_depth_m <= 0.0 {
            return Err(self
                .error(format!(
                    "the body `{}` reaches the camera's plane, which the mode `direct` cannot show",
                    body.name
                ))
                .found(format!("its nearest depth is {nearest_depth_m:.6e} m"))
                .expected("a body wholly in front of the camera")
                .help("set mode = \"resample\" below [compensation]"));
        }
        Ok(())
    }

    fn something_in_view(&self, field: &Field) -> Result<(), InputError> {
        let scene = self.scene;
        if scene.allow_empty_frames {
            return Ok(());
        }
        let seen = scene
            .bodies
            .iter()
            .zip(&self.frame.bodies)
            .any(|(body, at)| field.meets(at.position_camera_m, body.bounding_radius_m));
        if seen {
            return Ok(());
        }
        let nearest = scene.bodies.iter().zip(&self.frame.bodies).map(|(body, at)| {
            let off_deg = at.position_camera_m.angle_between(DVec3::Z).to_degrees();
            let radius_deg =
                (body.bounding_radius_m / at.position_camera_m.length()).min(1.0).asin().to_degrees();
            (off_deg - radius_deg, off_deg, body)
        });
        let error = self
            .error("no body is in view")
            .help("check the pointing, or set allow_empty_frames = true if frames without a body are meant");
        Err(match nearest.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((_, off_deg, body)) => error
                .found(format!("`{}` {off_deg:.2} deg off the boresight", body.name))
                .expected(format!("a body within the field of {}", field.size_deg())),
            None => error.found("a scene without bodies").expected("a table [[body]]"),
        })
    }

    fn body(&self, number: usize) -> &SceneBody {
        &self.scene.bodies[number]
    }

    /// An error about this frame, which names it also where the table's line does.
    fn error(&self, problem: impl Into<String>) -> InputError {
        self.scene.trajectory.error_at(self.frame.index, problem)
    }
}
