//! Blur by direction: a limb that is smeared is sharp where it runs along the motion.
//!
//! The edges' model has one blur for all directions. Where they differ, edges are off by a part of the difference, and
//! neither the scatter nor the noise says so.

use retina_image::CameraImage;

use super::Refusal;
use super::blur::blur;
use super::edge::Node;

/// Parts of the half turn that normals are sorted into.
const SECTORS: usize = 6;
/// A sector with fewer nodes says nothing.
const LEAST_NODES: usize = 4;
/// So many are looked at.
const MOST_NODES: usize = 10;
/// Differences of the blur's variance, px^2, and ratios of the blur that shading and noise make: 0.97 and 1.43 at most
/// on sharp discs of three photometric laws, and never both (`validation/limb_draws.py`). A smear of length L adds up to
/// L^2 / 12.
const MOST_DIFFERENCE_PX2: f64 = 1.2;
const MOST_RATIO: f64 = 1.25;

/// Refuses a limb whose blur depends on the direction, by the nodes that should show it.
pub(super) fn refuse_smear(
    image: &CameraImage,
    nodes: &[Node],
    half_width_px: f64,
    noise_dn: f64,
) -> Result<(), Refusal> {
    let mut sectors: [Vec<Node>; SECTORS] = Default::default();
    for node in nodes {
        let turn = node.normal.to_angle().rem_euclid(std::f64::consts::PI) / std::f64::consts::PI;
        sectors[((turn * SECTORS as f64) as usize).min(SECTORS - 1)].push(*node);
    }
    let found: Vec<Option<f64>> = sectors
        .iter()
        .map(|sector| {
            let step = sector.len().div_ceil(MOST_NODES).max(1);
            let some: Vec<Node> = sector.iter().step_by(step).copied().collect();
            // Flanks that no blur fits are wider than the pixels that are looked at.
            (some.len() >= LEAST_NODES)
                .then(|| blur(image, &some, half_width_px, noise_dn).unwrap_or(0.5 * half_width_px))
        })
        .collect();
    let least_px = found.iter().flatten().copied().fold(f64::INFINITY, f64::min);
    // A smear makes neighbours wide, too: one sector alone is shadows or a dark ground at the limb.
    let most_px =
        (0..SECTORS).filter_map(|k| Some(found[k]?.min(found[(k + 1) % SECTORS]?))).fold(0.0, f64::max);
    let difference_px2 = most_px * most_px - least_px * least_px;
    if difference_px2 > MOST_DIFFERENCE_PX2 && most_px > MOST_RATIO * least_px {
        return Err(Refusal::Smeared { least_px, most_px });
    }
    Ok(())
}
