//! A body's outline at a position: an ellipsoid's, or the silhouette of its own shape.

use glam::DVec3;
use retina_geometry::{LimbEllipse, limb_ellipse};

use super::edge::{Node, ellipse_outline};
use super::fit::{Fit, Measured, fit, fit_rim};
use super::shape::RimPieces;
use super::{LimbBody, LimbCamera};

/// An outline and the position that it is seen from.
pub(super) struct Outline {
    /// Of the body's ellipsoid, undistorted.
    pub ellipse: LimbEllipse,
    /// Its pieces, in the image.
    pub nodes: Vec<Node>,
    /// Of a body with a shape of its own.
    rim: Option<RimPieces>,
    position_m: DVec3,
}

impl Outline {
    /// `None` where the body is not in front of the camera. Heights of `height_m` are above the body's surface.
    pub(super) fn new(
        body: &LimbBody,
        height_m: f64,
        position_m: DVec3,
        camera: &LimbCamera,
    ) -> Option<Self> {
        let axes_m = body.semi_axes_m + height_m;
        let ellipse = limb_ellipse(&camera.pinhole, position_m, body.camera_from_body, axes_m)?;
        let rim = match &body.shape {
            None => None,
            Some(shape) => {
                let scale = 1.0 + height_m / body.mean_radius_m();
                Some(shape.pieces(position_m, body.camera_from_body, scale, camera)?)
            }
        };
        let nodes = rim.as_ref().map_or_else(|| ellipse_outline(&ellipse, camera), |rim| rim.nodes.clone());
        Some(Self { ellipse, nodes, rim, position_m })
    }

    /// Position by points measured at its nodes.
    pub(super) fn fit(
        &self,
        points: &[Measured],
        camera: &LimbCamera,
        body: &LimbBody,
        height_m: f64,
    ) -> Option<Fit> {
        match &self.rim {
            None => fit(points, camera, body, height_m),
            Some(rim) => fit_rim(points, camera, rim, self.position_m),
        }
    }
}
