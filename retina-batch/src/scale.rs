//! The automatic radiance scale of a sequence.

use retina_files::InputError;
use retina_scene::Scene;

use crate::picture::Picture;
use crate::source::FrameSource;
use crate::{BatchError, ImagePlan};

/// Frames rendered for an automatic radiance scale: so many that promise most, and all of a short sequence.
const SCALE_FRAMES: usize = 3;
const SHORT_SEQUENCE: usize = 8;

/// The frames that may hold the sequence's brightest pixel; none where there is no body. The scene's meshes must still
/// be there.
///
/// # Errors
/// A frame's geometry does not fit.
pub(crate) fn brightest_candidates(scene: &Scene) -> Result<Vec<usize>, InputError> {
    if scene.bodies.is_empty() {
        return Ok(Vec::new());
    }
    let frames = scene.frame_count();
    scene.brightest_frames(if frames <= SHORT_SEQUENCE { frames } else { SCALE_FRAMES })
}

/// The scale at which the brightest pixel of the whole sequence shows just below saturation.
///
/// # Errors
/// The renderer fails, or no frame shows a lit surface.
pub(crate) fn automatic_scale(
    scene: &Scene,
    plan: &ImagePlan,
    picture: &Picture,
    source: &mut FrameSource,
    candidates: &[usize],
) -> Result<f64, BatchError> {
    let mut brightest = 0f32;
    for &index in candidates {
        source.start(&scene.frame(index)?)?;
        if let Some(image) = source.finish()? {
            let light = plan.develop(&image, source.resampler.as_ref()).light;
            brightest = light.iter().fold(brightest, |most, &value| most.max(value));
        }
    }
    if !(brightest > 0.0 && brightest.is_finite()) {
        return Err(InputError::new(
            &scene.file,
            "no frame of the sequence shows a lit surface, so there is no brightest pixel",
        )
        .at("key `radiance_scale`")
        .found("`auto`")
        .expected("a number, or a sequence in which a lit surface is seen")
        .help("check the Sun's position, or set radiance_scale = 0.1")
        .into());
    }
    Ok(picture.scale_for_brightest(f64::from(brightest)))
}
