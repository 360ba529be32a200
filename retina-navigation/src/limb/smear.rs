//! Blur by direction: a limb that is smeared is sharp where it runs along the motion.
//!
//! The edges' model has one blur for all directions. Where they differ, edges are off by a part of the difference, and
//! neither the scatter nor the noise says so. A smear of length L at an angle p adds L^2 / 12 cos^2(t - p) to the variance
//! across an edge whose normal stands at t. Shadows, dark ground and aberrations follow no such law.

use std::f64::consts::PI;

use retina_image::CameraImage;

use super::Refusal;
use super::blur::{NoBlur, blur};
use super::edge::{Node, pixels};

/// Parts of the half turn that normals are sorted into.
const SECTORS: usize = 6;
/// So many nodes of a sector are looked at.
const MOST_NODES: usize = 8;
/// Differences of the blur's variance, px^2, and ratios of the blur that shading, hills and noise make
/// (`validation/limb_draws.py`).
const MOST_DIFFERENCE_PX2: f64 = 2.0;
const MOST_RATIO: f64 = 1.25;
/// A blur below this is that of a pixel alone, which shadows and failed fits look like, too.
const BARE_PX: f64 = 0.5;
/// A wide PSF is an aberration's, which depends on the direction by itself: beyond this width (px) the ratio may be
/// greater, by so much a pixel. The virtual bench, whose PSF is 2.2 to 3.0 px wide, makes up to 1.48.
const WIDE_PX: f64 = 1.5;
const WIDE_RATIO_PER_PX: f64 = 0.35;
/// Refuses a limb whose blur depends on the direction, by the nodes that should show it.
pub(super) fn refuse_smear(
    image: &CameraImage,
    nodes: &[Node],
    half_width_px: f64,
    noise_dn: f64,
) -> Result<(), Refusal> {
    let mut sectors: [Vec<Node>; SECTORS] = Default::default();
    // What the frame or a mask cuts says nothing.
    for node in nodes.iter().filter(|node| pixels(image, node, half_width_px).is_some()) {
        let turn = node.normal.to_angle().rem_euclid(PI) / PI;
        sectors[((turn * SECTORS as f64) as usize).min(SECTORS - 1)].push(*node);
    }
    let found: Vec<Option<f64>> = sectors
        .iter()
        .map(|sector| {
            let step = sector.len().div_ceil(MOST_NODES).max(1);
            let some: Vec<Node> = sector.iter().step_by(step).copied().collect();
            match blur(image, &some, half_width_px, noise_dn) {
                Ok(px) => Some(px),
                // Wider than the pixels that are looked at.
                Err(NoBlur::TooWide) => Some(0.5 * half_width_px),
                Err(NoBlur::FewEdges) => None,
            }
        })
        .collect();
    // A smear makes neighbours wide, too: one sector alone is shadows or a dark ground at the limb.
    let most_px =
        (0..SECTORS).filter_map(|k| Some(found[k]?.min(found[(k + 1) % SECTORS]?))).fold(0.0, f64::max);
    // Nor is one as sharp as a bare pixel by itself: its neighbours have half of a smear's variance at most.
    let least_px = (0..SECTORS)
        .filter_map(|k| {
            let own = found[k]?;
            let half_px2 = 0.5 * (own * own + most_px * most_px);
            let mut beside = [k + SECTORS - 1, k + 1].into_iter().filter_map(|k| found[k % SECTORS]);
            (own > BARE_PX || beside.any(|px| px * px <= half_px2)).then_some(own)
        })
        .fold(f64::INFINITY, f64::min);
    let most_ratio = MOST_RATIO + WIDE_RATIO_PER_PX * (least_px - WIDE_PX).max(0.0);
    let difference_px2 = most_px * most_px - least_px * least_px;
    if difference_px2 > MOST_DIFFERENCE_PX2 && most_px > most_ratio * least_px {
        return Err(Refusal::Smeared { least_px, most_px });
    }
    Ok(())
}
