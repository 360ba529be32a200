//! Effects on images. Their columns come with the pixels: they are made of the predicted image.

use crate::data::{Dataset, TableKind, pixel_term};

use super::{Effect, Variant};

/// An entry whose forms come with the pixels.
macro_rules! frames {
    ($id:literal, $formula:literal, $source:literal, $columns:expr, $plausible:literal, $class:expr, $separated:expr $(,)?) => {
        effect!(Frames, $id, $formula, $source, $columns, $plausible, $class, $separated, |data| forms(
            data, $id
        ))
    };
}

pub(super) const EFFECTS: &[Effect] = &[
    frames!(
        "photometric_function",
        "m (I_law - I): from the prediction's law to Lommel-Seeliger's, Minnaert's, Oren and Nayar's or Hapke's, m = 1 where it holds",
        "B. Hapke, Theory of Reflectance and Emittance Spectroscopy, 2nd ed.; M. Minnaert, Astrophysical Journal 93, 1941",
        &["incidence_deg", "emission_deg", "phase_deg"],
        "tens of % at limb and terminator",
        &["photometric_function"],
        None,
    ),
    frames!(
        "albedo_map",
        "c I (t - 1), t the body's map of mean 1; without a map spherical harmonics to degree 3",
        "the scene's body",
        &["longitude_deg", "latitude_deg"],
        "10 to 40 %",
        &["albedo_map"],
        None,
    ),
    frames!(
        "relief",
        "a (I_mesh - I_ellipsoid), both without cast shadows",
        "the scene's body",
        &["incidence_deg"],
        "the terminator's surroundings",
        &["relief", "terrain_shadow"],
        Some(("sun_direction", "the same region under a higher Sun")),
    ),
    frames!(
        "terrain_shadow",
        "-a I s, s the part of the Sun that relief hides",
        "the scene's body",
        &["incidence_deg"],
        "the terminator's surroundings",
        &["relief", "terrain_shadow"],
        Some(("sun_direction", "the same region under a higher Sun")),
    ),
    frames!(
        "defocus",
        "I * G(sigma) - I, a Gaussian's width",
        "M. Born, E. Wolf, Principles of Optics, 7th ed., sec. 8.8",
        &["limb_distance_px"],
        "spots of 8 to 15 um rms, 2 to 4 px",
        &["defocus", "field_curvature"],
        Some(("field", "the same body in the middle and in a corner of the field")),
    ),
    frames!(
        "field_curvature",
        "I * G(sigma r^2) - I, r = 1 at half the camera's width",
        "M. Born, E. Wolf, Principles of Optics, 7th ed., sec. 5.3",
        &["limb_distance_px", "axis_r"],
        "as defocus, at the field's edge",
        &["defocus", "field_curvature"],
        Some(("field", "the same body in the middle and in a corner of the field")),
    ),
    frames!(
        "coma",
        "a r d/dr lap(I): a tail along the radius, r = 1 at half the camera's width",
        "M. Born, E. Wolf, Principles of Optics, 7th ed., sec. 5.3",
        &["limb_distance_px", "axis_r"],
        "1 px^3 at the edge is a centroid that walks with the flux",
        &["coma"],
        None,
    ),
    frames!(
        "astigmatism",
        "a r^2 (d2/dr2 - d2/dt2) I / 2: wider along the radius than across",
        "M. Born, E. Wolf, Principles of Optics, 7th ed., sec. 5.3",
        &["limb_distance_px", "axis_r"],
        "1 px^2 at the edge",
        &["astigmatism"],
        None,
    ),
    frames!(
        "veiling_glare",
        "a (I * K(w) - I), K a broad kernel; of several frames also a <I>",
        "ISO 9358:1994",
        &["limb_distance_px"],
        "0.1 to 1 %",
        &["veiling_glare"],
        None,
    ),
    frames!(
        "ghost",
        "a I(-x): the image mirrored at the axis",
        "R. Hartmann et al., SPIE 5874",
        &["camera_x_px", "camera_y_px"],
        "1e-4 to 1e-3",
        &["ghost"],
        Some(("pointing", "the body nearer to the axis")),
    ),
    frames!(
        "vignetting",
        "-v r^2 I, r = 1 at half the camera's width; further r^4",
        "cos^4 law; paper, constraint analysis",
        &["axis_r"],
        "6 % at 10 deg",
        &["vignetting"],
        None,
    ),
    frames!(
        "dark_offset",
        "b + d t: a level, and one that grows with the exposure time",
        "EMVA 1288, release 4.0, sec. 2",
        &["exposure_s"],
        "1 to 10 DN",
        &["dark_offset"],
        Some(("exposure_s", "two exposure times")),
    ),
    frames!(
        "detector_nonlinearity",
        "a s^2 / full scale",
        "EMVA 1288, release 4.0, sec. 6.7",
        &["level_dn"],
        "0.5 to 2 %",
        &["detector_nonlinearity"],
        None,
    ),
    frames!(
        "saturation",
        "min(s, full well) - s",
        "EMVA 1288, release 4.0, sec. 6.6",
        &["level_dn"],
        "a full well below the full scale",
        &["saturation"],
        None,
    ),
    frames!(
        "prnu",
        "p(x, y) I, a map over the camera's pixels",
        "EMVA 1288, release 4.0, sec. 4",
        &["camera_x_px", "camera_y_px"],
        "0.5 to 1 %",
        &["prnu", "mura"],
        Some(("pointing", "the scene moved over the screen, and the camera over the scene")),
    ),
    frames!(
        "mura",
        "m(x, y) I, a map over the screen's pixels",
        "IDMS 1.1, sec. 8",
        &["camera_x_px", "camera_y_px"],
        "1 to 5 %",
        &["prnu", "mura"],
        Some(("pointing", "the scene moved over the screen, and the camera over the scene")),
    ),
    frames!(
        "image_shift",
        "dx dI/dx + dy dI/dy",
        "first order of a shift",
        &["camera_x_px", "camera_y_px"],
        "any; fitted always but with --baseline gain",
        &["image_shift"],
        None,
    ),
    frames!(
        "roll",
        "a (x dI/dy - y dI/dx) about the axis of the image",
        "first order of a rotation",
        &["camera_x_px", "camera_y_px"],
        "any; fitted always but with --baseline gain",
        &["roll"],
        None,
    ),
    frames!(
        "scale",
        "-a (x dI/dx + y dI/dy)",
        "first order of a change of focal length",
        &["camera_x_px", "camera_y_px"],
        "any; fitted always but with --baseline gain",
        &["scale"],
        None,
    ),
    frames!(
        "source_size",
        "a star is 0 arcsec wide, a screen pixel 36",
        "paper, Table 1",
        &["limb_distance_px"],
        "10 to 30 % of a point's width",
        &["source_size"],
        Some(("table", "images of points of light")),
    ),
];

fn forms<'a>(data: &'a Dataset, id: &str) -> Result<Vec<Variant<'a>>, String> {
    let effect = data.pixels().and_then(|pixels| pixels.effects.iter().find(|effect| effect.id == id));
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
