//! One photograph of a resolved body, from a camera whose attitude is unknown.

use glam::{DMat3, DVec2, DVec3};
use retina_image::CameraImage;
use retina_sky::planets::SeenPlanet;
use serde_json::{Value, json};

use super::body::KnownBody;
use super::solve::{LimbLook, first_look, solve_limb};
use super::{LimbCamera, LimbOptions, LimbSolution, Refusal};

/// Beyond this many standard deviations a range contradicts the ephemeris.
const MOST_SIGMA: f64 = 5.0;

/// What is known before the photograph is looked at.
#[derive(Debug, Clone)]
pub struct LimbQuestion {
    /// Intrinsics and distortion.
    pub camera: LimbCamera,
    /// Standard deviation of the focal length, share of it.
    pub focal_sigma_share: f64,
    /// What is looked at.
    pub body: KnownBody,
    /// Position angle of the Sun in the image, rad: 0 is up, a quarter turn is left.
    pub sun_angle_rad: Option<f64>,
    /// Phase angle, rad, where it is known though no place is.
    pub phase_rad: Option<f64>,
    /// The body as an ephemeris has it from the camera's place.
    pub expected: Option<SeenPlanet>,
    /// What a tone curve that is not known may shift edges by, share of the blur.
    pub tone_sigma_share: f64,
}

/// Where a body is seen, and how far it is.
#[derive(Debug, Clone)]
pub struct LimbSight {
    /// What the limb gave.
    pub solution: LimbSolution,
    /// Centre in the photograph, px.
    pub center_px: DVec2,
    /// Distance of the body's centre and its standard deviation, m.
    pub range_m: [f64; 2],
    /// Unit vector to the centre, camera frame.
    pub line_of_sight: DVec3,
    /// Its covariance, rad^2.
    pub line_of_sight_covariance_rad2: DMat3,
    /// Covariance of the position with the focal length's part, m^2.
    pub covariance_m2: DMat3,
    /// The focal length's part, m^2.
    pub focal_m2: DMat3,
}

/// What a photograph gave.
#[derive(Debug, Clone)]
pub struct LimbAnswer {
    /// The body's place, or why there is none.
    pub sight: Result<LimbSight, Refusal>,
    /// What a first look saw, where something is lit.
    pub look: Option<LimbLook>,
}

/// The smallest asteroid that a spacecraft will visit soon, 1998 KY26, has a radius of 5.5 m (Santana-Ros et al. 2025).
const SMALLEST_BODY_M: f64 = 5.0;

impl LimbQuestion {
    /// Standard deviation of a focal length, share of it: of a lens with a nominal one.
    pub const FOCAL_SIGMA_SHARE: f64 = 0.005;
    /// The same of a 35-mm equivalent, which is rounded to 1 mm.
    pub const EXIF_FOCAL_SIGMA_SHARE: f64 = 0.04;
    /// What a camera's own tone curve may shift an edge by, share of its blur: half the light, raised to a power between
    /// 0.7 and 1.4, stands 0.3 standard deviations off.
    pub const TONE_SIGMA_SHARE: f64 = 0.3;

    /// Measures the limb in a photograph, linear in light.
    pub fn solve(&self, image: &CameraImage) -> LimbAnswer {
        let options = LimbOptions {
            sun_direction_px: self.sun_angle_rad.map(direction_px),
            phase_rad: self.expected.map(|seen| seen.phase_angle_rad).or(self.phase_rad),
            tone_sigma_share: self.tone_sigma_share,
            limb_height_m: self.body.limb_height_m,
            limb_height_sigma_m: self.body.limb_height_sigma_m,
            ..LimbOptions::default()
        };
        let solution = solve_limb(image, &self.camera, &self.body.body, &options);
        LimbAnswer {
            sight: solution.map(|solution| self.sight(solution)),
            look: first_look(image, &self.camera, &self.body.body),
        }
    }

    fn sight(&self, solution: LimbSolution) -> LimbSight {
        let position_m = solution.position_camera_m;
        let range_m = position_m.length();
        let along = position_m / range_m;
        // A focal length longer by e: angles off the axis and the angular radius are smaller by e.
        let tangent = DVec3::new(along.x, along.y, 0.0) / along.z;
        let bend = (along * tangent.length_squared() * along.z - tangent) * along.z;
        let by_focal = (position_m + bend * range_m) * self.focal_sigma_share;
        let focal_m2 = outer(by_focal);
        let covariance_m2 = solution.covariance_m2 + focal_m2;
        let across = (DMat3::IDENTITY - outer(along)) * range_m.recip();
        let center = DVec2::new(position_m.x, position_m.y) / position_m.z;
        LimbSight {
            center_px: self.camera.pixel(center).unwrap_or(solution.ellipse.center_px),
            range_m: [range_m, along.dot(covariance_m2 * along).sqrt()],
            line_of_sight: along,
            line_of_sight_covariance_rad2: across * covariance_m2 * across.transpose(),
            covariance_m2,
            focal_m2,
            solution,
        }
    }

    /// The document of `navigate limb --json`, schema `retina.navigation-limb/1`, but for the file's name and notes.
    pub fn json(&self, answer: &LimbAnswer) -> Value {
        let axes_m = self.body.body.semi_axes_m.to_array();
        let mut out = json!({
            "schema": "retina.navigation-limb/1",
            "solved": answer.sight.is_ok(),
            "body": {
                "name": self.body.name, "outline": self.body.body.outline(), "semi_axes_m": axes_m, "limb_height_m": self.body.limb_height_m,
                "limb_height_sigma_m": self.body.limb_height_sigma_m,
                "limb_height_source": self.body.limb_height_source,
            },
            "focal_px": self.camera.pinhole.fx_px,
            "focal_sigma_percent": 100.0 * self.focal_sigma_share,
            "seen": answer.look.as_ref().map(LimbLook::json),
            "expected": self.expected.map(|seen| json!({
                "range_m": seen.distance_m, "phase_deg": seen.phase_angle_rad.to_degrees(),
                "radius_px": self.expected_radius_px(&seen),
                "range_off_sigma": answer.sight.as_ref().ok().map(|sight| sight.off_sigma(&seen)),
            })),
        });
        let more = match &answer.sight {
            Ok(sight) => sight.json(),
            Err(refusal) => json!({
                "center_px": null, "radius_px": null, "sigma_px": null, "range_m": null, "points": 0,
                "reason": refusal.reason(), "message": self.refusal(refusal, answer),
            }),
        };
        if let (Value::Object(out), Value::Object(more)) = (&mut out, more) {
            out.extend(more);
        }
        out
    }

    /// What makes an accepted answer doubtful, in words; empty where nothing does.
    pub fn doubts(&self, answer: &LimbAnswer) -> Vec<String> {
        let Ok(sight) = &answer.sight else { return Vec::new() };
        let mut out = Vec::new();
        if self.sun_angle_rad.is_none() && answer.look.is_some_and(|look| look.touches_frame) {
            out.push(
                "the body is cut by the frame and the Sun's direction is not given: if the lit limb is outside the \
                 frame, what was measured is the terminator; give --sun-deg"
                    .to_owned(),
            );
        }
        let radius_m = self.body.body.mean_radius_m();
        if radius_m < SMALLEST_BODY_M {
            out.push(format!(
                "the body's mean radius is {radius_m:.3} m: if its mesh or semi-axes are in km, ranges come out in km, too"
            ));
        }
        let off_sigma = self.expected.map_or(0.0, |seen| sight.off_sigma(&seen));
        if off_sigma.abs() > MOST_SIGMA {
            out.push(format!(
                "the range is {off_sigma:.1} sigma off the ephemeris: the body, the time, the place or the focal \
                 length is not what was stated"
            ));
        }
        out
    }

    /// Radius that the ephemeris and the nominal focal length foretell in the image's middle, px.
    pub fn expected_radius_px(&self, seen: &SeenPlanet) -> f64 {
        let radius_m = self.body.body.mean_radius_m() + self.body.limb_height_m;
        let ratio = (radius_m / seen.distance_m).min(1.0);
        self.camera.pinhole.fx_px * ratio.asin().tan()
    }

    /// Why there is no answer, what was seen, and what to try.
    pub fn refusal(&self, refusal: &Refusal, answer: &LimbAnswer) -> String {
        let seen = match &answer.look {
            None => "Nothing that is lit has a round border".to_owned(),
            Some(look) => look.sentence(),
        };
        let expected = self.expected.map_or(String::new(), |seen| {
            format!(
                "; a radius of {:.1} px and a phase of {:.0} deg are expected",
                self.expected_radius_px(&seen),
                seen.phase_angle_rad.to_degrees()
            )
        });
        let advice = match refusal {
            Refusal::NoBody { least_radius_px } => format!(
                "Take a longer focal length (a radius of {least_radius_px:.0} px is needed), or expose for longer"
            ),
            Refusal::CutByFrame { .. } => "Point the camera so that the lit limb is in the frame".to_owned(),
            Refusal::ThinCrescent { .. } => {
                "Take a longer focal length, so that the crescent is wider, or wait for a smaller phase angle".to_owned()
            }
            Refusal::Saturated { .. } => {
                "Expose for a shorter time: the lit side must stay below full scale, whatever happens to stars".to_owned()
            }
            Refusal::OtherOutline { .. } => "A flattened body needs --camera-from-body; a body that is not the one that \
                 was named needs --radii-m. Take out the lens' distortion (--setup, --calibration), expose so briefly that \
                 nothing smears, and keep the lit limb in the frame. --limb-height-sigma-m states the relief of a rough body"
                .to_owned(),
            Refusal::NotTheSilhouette { .. } => "Check the attitude (--camera-from-body turns the body's axes into the \
                 camera's, scalar first; with --stars, the time), the mesh's axes and units, and the Sun (--sun-deg)"
                .to_owned(),
            Refusal::Smeared { .. } => "Expose for a shorter time, hold the camera still, or track the body; a lens with \
                 astigmatism or coma does the same: focus anew, or put the body in the middle"
                .to_owned(),
            Refusal::NotTheBody { .. } if self.sun_angle_rad.is_some() => {
                "Check the body and the Sun's direction (--sun-deg), and try without it; a cloud, a horizon or a tree \
                 beside the body has to be masked (--mask)"
                    .to_owned()
            }
            Refusal::NotTheBody { .. } => "Check the body; say where the Sun is (--sun-deg); a cloud, a horizon or a tree \
                 beside the body has to be masked (--mask)"
                .to_owned(),
        };
        format!("{refusal}. Seen: {seen}{expected}. {advice}")
    }
}

impl LimbSight {
    /// The range less an ephemeris', in standard deviations.
    pub fn off_sigma(&self, expected: &SeenPlanet) -> f64 {
        (self.range_m[0] - expected.distance_m) / self.range_m[1]
    }

    /// Standard deviation of the line of sight across itself, per axis, rad.
    pub fn line_of_sight_sigma_rad(&self) -> f64 {
        let trace = self.line_of_sight_covariance_rad2;
        (0.5 * (trace.x_axis.x + trace.y_axis.y + trace.z_axis.z)).sqrt()
    }

    /// Where the range's standard deviation comes from, m.
    pub fn range_terms_m(&self) -> [(&'static str, f64); 5] {
        let along = self.line_of_sight;
        let parts = &self.solution.parts;
        [
            ("points", parts.points_m2),
            ("limb_height", parts.height_m2),
            ("edge_model", parts.edge_model_m2),
            ("side", parts.side_m2),
            ("focal_length", self.focal_m2),
        ]
        .map(|(name, part)| (name, along.dot(part * along).max(0.0).sqrt()))
    }

    /// Position angle of the Sun in the image, rad: 0 is up, a quarter turn is left; `None` where the whole border was
    /// taken for limb.
    pub fn sun_angle_rad(&self) -> Option<f64> {
        let towards = self.solution.sun_direction_px?;
        Some((-towards.x).atan2(-towards.y).rem_euclid(std::f64::consts::TAU))
    }

    fn json(&self) -> Value {
        let solution = &self.solution;
        let ellipse = &solution.ellipse;
        let center_sigma_px = solution.center_sigma_px;
        let terms: serde_json::Map<String, Value> = self
            .range_terms_m()
            .into_iter()
            .map(|(name, sigma_m)| (name.to_owned(), json!(sigma_m)))
            .collect();
        json!({
            "center_px": self.center_px.to_array(),
            "radius_px": solution.radius_px[0],
            "sigma_px": {
                "center": (0.5 * center_sigma_px.length_squared()).sqrt(), "radius": solution.radius_px[1],
                "center_axes": center_sigma_px.to_array(),
            },
            "ellipse_px": {
                "center_px": ellipse.center_px.to_array(), "semi_axes_px": ellipse.semi_axes_px,
                "angle_deg": ellipse.angle_rad.to_degrees(),
            },
            "range_m": self.range_m[0],
            "range_sigma_m": self.range_m[1],
            "range_sigma_terms_m": terms,
            "line_of_sight": self.line_of_sight.to_array(),
            "line_of_sight_covariance_rad2": self.line_of_sight_covariance_rad2.to_cols_array_2d(),
            "line_of_sight_sigma_arcsec": self.line_of_sight_sigma_rad().to_degrees() * 3600.0,
            "position_camera_m": solution.position_camera_m.to_array(),
            "covariance_m2": self.covariance_m2.to_cols_array_2d(),
            "sun_deg": self.sun_angle_rad().map(f64::to_degrees),
            "points": solution.points.iter().filter(|point| point.used).count(),
            "rejected_points": solution.points.iter().filter(|point| !point.used).count(),
            "arc_deg": solution.arc_rad.to_degrees(),
            "rms_px": solution.rms_px,
            "excess_px": solution.excess_sigma_px,
            "wave_px": solution.wave.rms_px,
            "blur_px": solution.blur_sigma_px,
        })
    }
}

/// In the image, of a position angle (rad): 0 is up, a quarter turn is left.
fn direction_px(angle_rad: f64) -> DVec2 {
    DVec2::new(-angle_rad.sin(), -angle_rad.cos())
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}
