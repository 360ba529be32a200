//! The ground truth of a frame, schema `retina.truth/1`.

use glam::DQuat;
use retina_geometry::{LimbEllipse, limb_ellipse};
use retina_radiometry::magnitude_of_irradiance;
use retina_sky::time::format_epoch_tdb;
use serde_json::{Map, Value, json};

use crate::{DisplayedPoint, Scene, SceneFrame, ShownFlash, ShownPoint};

impl Scene {
    /// The ground truth of a frame shown at `radiance_scale`, with the point sources and the flashes that
    /// were drawn and what is shown of a body that is one of them, as the JSON document's value.
    /// Numbers are printed so that reading them gives the same bits.
    pub fn truth(
        &self,
        frame: &SceneFrame,
        radiance_scale: f64,
        stars: &[ShownPoint],
        flashes: &[ShownFlash],
        unresolved: Option<DisplayedPoint>,
    ) -> Value {
        let image = self.image;
        let mut bodies = Map::new();
        for ((body, at), turn) in self.bodies.iter().zip(&frame.bodies).zip(&frame.camera_from_body) {
            let limb =
                limb_ellipse(&image, at.position_camera_m, at.camera_from_body, body.reference_semi_axes_m);
            let mut entry = json!({
                "position_camera_m": at.position_camera_m.to_array(),
                "distance_m": at.position_camera_m.length(),
                "camera_from_body": scalar_first(*turn),
                "sun_direction_body": at.sun_position_body_m.normalize().to_array(),
                "sun_distance_m": at.sun_position_body_m.length(),
                "phase_deg": at.phase_rad().to_degrees(),
                "center_px": image.project(at.position_camera_m).map(|p| p.to_array()),
                "reference_radius_m": body.reference_radius_m(),
                "reference_semi_axes_m": body.reference_semi_axes_m.to_array(),
                "limb_ellipse_px": limb.map(ellipse),
            });
            if let (Some(source), Some(entry)) = (self.axes_by_kernel(&body.name), entry.as_object_mut()) {
                entry.insert("axes".into(), json!(source));
            }
            if let (Some(shown), Some(entry)) = (unresolved, entry.as_object_mut())
                && at.position_camera_m.z > 0.0
            {
                entry.insert("displayed_px".into(), json!(shown.barycentre_px.to_array()));
                entry.insert("displayed_magnitude".into(), json!(shown.magnitude));
            }
            bodies.insert(body.name.clone(), entry);
        }
        let mut truth = json!({
            "schema": "retina.truth/1",
            "frame": frame.index,
            "time_s": frame.time_s,
            "epoch_tdb": format_epoch_tdb(frame.time_s),
            "camera_from_inertial": scalar_first(frame.camera_from_inertial),
            "image_px": {
                "fx": image.fx_px, "fy": image.fy_px, "cx": image.cx_px, "cy": image.cy_px,
                "width": image.width_px, "height": image.height_px,
            },
            "compensation": self.compensation.name(),
            "radiance_scale": radiance_scale,
            "bodies": bodies,
            "camera_position_m": frame.camera_position_m.to_array(),
            "camera_velocity_m_s": frame.camera_velocity_m_s.map(|v| v.to_array()),
            "stars": stars.iter().map(star).collect::<Vec<Value>>(),
        });
        if let (Some(of), Some(truth)) = (&self.flashes, truth.as_object_mut()) {
            let flashes: Vec<Value> = flashes.iter().map(|shown| self.flash(shown, radiance_scale)).collect();
            truth.insert("exposure_s".into(), json!(of.exposure_s));
            truth.insert("flashes".into(), json!(flashes));
        }
        truth
    }

    fn flash(&self, shown: &ShownFlash, radiance_scale: f64) -> Value {
        let (seen, flash) = (&shown.seen, &shown.seen.flash);
        json!({
            "id": flash.id,
            "body": self.bodies[flash.body].name,
            "time_s": flash.time_s,
            "duration_s": flash.duration_s,
            "latitude_deg": flash.latitude_rad.to_degrees(),
            "longitude_deg": flash.longitude_rad.to_degrees(),
            "position_camera_m": seen.position_camera_m.to_array(),
            "line_of_sight": seen.line_of_sight.map(|r| r.to_array()),
            "position_px": seen.line_of_sight.map(|r| self.image.pixel(r).to_array()),
            "screen_px": shown.screen_px.map(|p| p.to_array()),
            "magnitude": seen.magnitude,
            "exposure_share": seen.share,
            "mean_irradiance_w_m2_nm": seen.mean_irradiance_w_m2_nm,
            "mean_magnitude": magnitude_of_irradiance(seen.mean_irradiance_w_m2_nm),
            "wanted_magnitude": magnitude_of_irradiance(seen.mean_irradiance_w_m2_nm * radiance_scale),
            "hidden": seen.hidden,
            "shown": shown.displayed.is_some(),
            "displayed_px": shown.displayed.map(|d| d.barycentre_px.to_array()),
            "displayed_magnitude": shown.displayed.map(|d| d.magnitude),
            "pixels": shown.displayed.map_or(0, |d| d.pixels),
            "blended": shown.displayed.is_some_and(|d| d.blended),
        })
    }
}

fn star(shown: &ShownPoint) -> Value {
    let mut entry = json!({
        "id": shown.point.id,
        "magnitude": shown.point.magnitude,
        "line_of_sight": shown.point.line_of_sight.to_array(),
        "screen_px": shown.screen_px.to_array(),
        "wanted_magnitude": shown.wanted_magnitude,
        "displayed_px": shown.displayed.map(|d| d.barycentre_px.to_array()),
        "displayed_magnitude": shown.displayed.map(|d| d.magnitude),
        "pixels": shown.displayed.map_or(0, |d| d.pixels),
        "blended": shown.displayed.is_some_and(|d| d.blended),
    });
    if let (Some(planet), Some(entry)) = (shown.point.planet, entry.as_object_mut()) {
        entry.insert("distance_m".into(), json!(planet.distance_m));
        entry.insert("phase_deg".into(), json!(planet.phase_rad.to_degrees()));
        let diameter_arcsec = 2.0 * planet.angular_radius_rad.to_degrees() * 3600.0;
        entry.insert("angular_diameter_arcsec".into(), json!(diameter_arcsec));
        entry.insert("magnitude_extrapolated".into(), json!(planet.magnitude_extrapolated));
    }
    entry
}

fn ellipse(limb: LimbEllipse) -> Value {
    json!({
        "center_px": limb.center_px.to_array(),
        "semi_axes_px": limb.semi_axes_px,
        "angle_deg": limb.angle_rad.to_degrees(),
    })
}

fn scalar_first(q: DQuat) -> [f64; 4] {
    [q.w, q.x, q.y, q.z]
}
