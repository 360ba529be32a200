//! Accepted effects on images as quantities, with what to do about them.

use retina_diagnosis::{Parameter, Physical};

use crate::form::Change;
use crate::model::Part;

/// A glare narrower than this is no stray light over the field: it belongs to the image of a point. px.
const WINGS_PX: f64 = 4.0;

/// What a part is; `parameters` are its own, fitted. `None` where the amplitude is all that can be said.
pub(crate) fn physical(part: &Part, parameters: &[Parameter]) -> Option<Physical> {
    let first = parameters.first()?;
    let sigma = first.sigma?;
    let told = |parameter: &'static str, unit: &'static str, remedy: &str| Physical {
        called: None,
        parameter,
        value: first.value,
        unit,
        sigma,
        remedy: remedy.to_owned(),
    };
    Some(match part.form.change {
        Change::Glare { width_px } if width_px <= WINGS_PX => Physical {
            called: Some("wings of the point spread"),
            ..told(
                "light_in_the_wings",
                "of all",
                &format!(
                    "this light lies within some {:.0} px of its source, so it is no stray light over the field: give the prediction the measured image of a point, and look at focus, diffraction, cross-talk of pixels and sharpening in the camera",
                    4.0 * width_px
                ),
            )
        },
        Change::Glare { width_px } => told(
            "light_in_the_halo",
            "of all",
            &format!(
                "this light reaches some {:.0} px far: clean and shade the optics, or give the prediction a halo of this share and width",
                4.0 * width_px
            ),
        ),
        Change::Blur => {
            let width = first.value.max(0.0).sqrt();
            if width <= 0.0 {
                return None;
            }
            Physical {
                value: width,
                sigma: sigma / (2.0 * width),
                ..told(
                    "blur_sigma",
                    "px",
                    "refocus if this is more than the lens ought to have, or blur the prediction by it",
                )
            }
        }
        Change::Coma => told(
            "sagittal_coma_at_the_edge",
            "px",
            "centre and square the lens: its tails point away from the axis where this is positive; or give the prediction the lens's own images of points",
        ),
        Change::Vignetting { .. } => {
            told("light_lost_at_the_edge", "of all", "divide the images by a flat field")
        }
        Change::DarkLevel => told("dark_level", "DN", "subtract a dark frame"),
        Change::DarkCurrent => told("dark_current", "DN/s", "subtract a dark frame of the same exposure"),
        Change::Nonlinearity => told(
            "excess_at_full_scale",
            "of full scale",
            "calibrate the detector's response; pictures for the eye (JPEG, sRGB) are never linear: take the raw counts",
        ),
        Change::FullWell { share } => told(
            "light_cut",
            "of what exceeds the full well",
            &format!("expose so that the brightest pixel stays below {share:.2} of full scale"),
        ),
        Change::Ghost => told(
            "light_in_the_ghost",
            "of all",
            "look for a plane surface before the detector (window, filter) that stands square to the axis: coat or tilt it",
        ),
        Change::Map { .. } => told(
            "contrast_of_the_map",
            "of the map's own",
            "give the scene the map (start = as-given); a contrast other than 1 says that the map is another wavelength's or was not linear",
        ),
        Change::Relief => {
            told("share_of_the_relief", "of the mesh's own", "give the scene the mesh (start = as-given)")
        }
        Change::Shadow => told("share_of_cast_shadows", "of the mesh's own", "render cast shadows"),
        Change::Law(_) => told(
            "share_of_the_other_law",
            "of the light",
            &format!(
                "write the law into the scene's `photometry`: {}",
                part.form.shape.iter().map(|(name, v)| format!("{name} {v}")).collect::<Vec<_>>().join(", ")
            ),
        ),
        Change::Harmonics
        | Change::FieldBlur
        | Change::Astigmatism
        | Change::MeanGlare
        | Change::Shift
        | Change::Roll
        | Change::Scale => return None,
    })
}
