//! Effects on images. Their columns come with the pixels: they are made of the predicted image.

use retina_formats::{EffectId, FramesEffect};

use crate::data::{Dataset, pixel_term};

use super::{Entry, Variant};

pub(super) fn entry(effect: FramesEffect) -> Entry {
    use FramesEffect as E;
    match effect {
        E::PhotometricFunction => entry!(
            "m (I_law - I): from the prediction's law to Lommel-Seeliger's, Minnaert's, Oren and Nayar's or Hapke's, m = 1 where it holds",
            "B. Hapke, Theory of Reflectance and Emittance Spectroscopy, 2nd ed.; M. Minnaert, Astrophysical Journal 93, 1941",
            &["incidence_deg", "emission_deg", "phase_deg"],
            "tens of % at limb and terminator",
            None,
        ),
        E::AlbedoMap => entry!(
            "c I (t - 1), t the body's map of mean 1; without a map spherical harmonics to degree 3",
            "the scene's body",
            &["longitude_deg", "latitude_deg"],
            "10 to 40 %",
            None,
        ),
        E::Relief => entry!(
            "a (I_mesh - I_ellipsoid), both without cast shadows",
            "the scene's body",
            &["incidence_deg"],
            "the terminator's surroundings",
            Some(("sun_direction", "the same region under a higher Sun"))
        ),
        E::TerrainShadow => entry!(
            "-a I s, s the part of the Sun that relief hides",
            "the scene's body",
            &["incidence_deg"],
            "the terminator's surroundings",
            Some(("sun_direction", "the same region under a higher Sun"))
        ),
        E::Defocus => entry!(
            "I * G(sigma) - I, a Gaussian's width",
            "M. Born, E. Wolf, Principles of Optics, 7th ed., sec. 8.8",
            &["limb_distance_px"],
            "spots of 8 to 15 um rms, 2 to 4 px",
            Some(("field", "the same body in the middle and in a corner of the field"))
        ),
        E::FieldCurvature => entry!(
            "I * G(sigma r^2) - I, r = 1 at half the camera's width",
            "M. Born, E. Wolf, Principles of Optics, 7th ed., sec. 5.3",
            &["limb_distance_px", "axis_r"],
            "as defocus, at the field's edge",
            Some(("field", "the same body in the middle and in a corner of the field"))
        ),
        E::Coma => entry!(
            "a r d/dr lap(I): a tail along the radius, r = 1 at half the camera's width",
            "M. Born, E. Wolf, Principles of Optics, 7th ed., sec. 5.3",
            &["limb_distance_px", "axis_r"],
            "1 px^3 at the edge is a centroid that walks with the flux",
            None,
        ),
        E::Astigmatism => entry!(
            "a r^2 (d2/dr2 - d2/dt2) I / 2: wider along the radius than across",
            "M. Born, E. Wolf, Principles of Optics, 7th ed., sec. 5.3",
            &["limb_distance_px", "axis_r"],
            "1 px^2 at the edge",
            None,
        ),
        E::VeilingGlare => entry!(
            "a (I * K(w) - I), K a broad kernel; of several frames also a <I>",
            "ISO 9358:1994",
            &["limb_distance_px"],
            "0.1 to 1 %",
            None,
        ),
        E::Ghost => entry!(
            "a I(-x): the image mirrored at the axis",
            "R. Hartmann et al., SPIE 5874",
            &["camera_x_px", "camera_y_px"],
            "1e-4 to 1e-3",
            Some(("pointing", "the body nearer to the axis"))
        ),
        E::Vignetting => entry!(
            "-v r^2 I, r = 1 at half the camera's width; further r^4",
            "cos^4 law; paper, constraint analysis",
            &["axis_r"],
            "6 % at 10 deg",
            None,
        ),
        E::DarkOffset => entry!(
            "b + d t: a level, and one that grows with the exposure time",
            "EMVA 1288, release 4.0, sec. 2",
            &["exposure_s"],
            "1 to 10 DN",
            Some(("exposure_s", "two exposure times"))
        ),
        E::DetectorNonlinearity => entry!(
            "a s^2 / full scale",
            "EMVA 1288, release 4.0, sec. 6.7",
            &["level_dn"],
            "0.5 to 2 %",
            None,
        ),
        E::Saturation => entry!(
            "min(s, full well) - s",
            "EMVA 1288, release 4.0, sec. 6.6",
            &["level_dn"],
            "a full well below the full scale",
            None,
        ),
        E::Prnu => entry!(
            "p(x, y) I, a map over the camera's pixels",
            "EMVA 1288, release 4.0, sec. 4",
            &["camera_x_px", "camera_y_px"],
            "0.5 to 1 %",
            Some(("pointing", "the scene moved over the screen, and the camera over the scene"))
        ),
        E::Mura => entry!(
            "m(x, y) I, a map over the screen's pixels",
            "IDMS 1.1, sec. 8",
            &["camera_x_px", "camera_y_px"],
            "1 to 5 %",
            Some(("pointing", "the scene moved over the screen, and the camera over the scene"))
        ),
        E::ImageShift => entry!(
            "dx dI/dx + dy dI/dy",
            "first order of a shift",
            &["camera_x_px", "camera_y_px"],
            "any; fitted always but with --baseline gain",
            None,
        ),
        E::Roll => entry!(
            "a (x dI/dy - y dI/dx) about the axis of the image",
            "first order of a rotation",
            &["camera_x_px", "camera_y_px"],
            "any; fitted always but with --baseline gain",
            None,
        ),
        E::Scale => entry!(
            "-a (x dI/dx + y dI/dy)",
            "first order of a change of focal length",
            &["camera_x_px", "camera_y_px"],
            "any; fitted always but with --baseline gain",
            None,
        ),
        E::SourceSize => entry!(
            "a star is 0 arcsec wide, a screen pixel 36",
            "paper, Table 1",
            &["limb_distance_px"],
            "10 to 30 % of a point's width",
            Some(("table", "images of points of light"))
        ),
    }
}

/// The forms that came with the pixels.
pub(super) fn forms<'a>(data: &'a Dataset, id: EffectId) -> Result<Vec<Variant<'a>>, String> {
    let effect = data
        .pixels()
        .and_then(|pixels| pixels.effects.iter().find(|effect| EffectId::Frames(effect.id) == id));
    let forms = effect.ok_or("the prediction has it already")?.forms.as_ref().map_err(Clone::clone)?;
    Ok(forms
        .iter()
        .map(|form| Variant {
            shape: form.shape.clone(),
            leading: form.leading.iter().map(pixel_term).collect(),
            further: Vec::new(),
        })
        .collect())
}
