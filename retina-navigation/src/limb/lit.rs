//! Which part of an outline is a lit limb.

use glam::DVec2;

use super::coarse::Coarse;
use super::edge::Node;
use super::{LimbOptions, Refusal};

/// Points are measured up to this angle from the Sun's direction, cosine: beyond, the terminator is near.
pub(super) const LEAST_COS_SUN: f64 = 0.17;

/// The lit side.
pub(super) struct Lit {
    /// Towards the Sun in the image, unit; `None` where the whole limb is lit.
    pub(super) sun: Option<DVec2>,
    /// Greatest width of the lit area, px.
    pub(super) width_px: f64,
}

impl Lit {
    pub(super) fn new(seen: &Coarse, options: &LimbOptions) -> Self {
        let off = seen.lit_center_px - seen.center_px;
        let whole = off.length() < 1.0 + 0.003 * seen.radius_px;
        let found = (!whole).then(|| off.normalize());
        let given = options.sun_direction_px.and_then(DVec2::try_normalize);
        Self { sun: given.or(found), width_px: seen.width_px() }
    }

    /// Nodes that should show a lit limb: towards the Sun, the terminator further inside than the pixels that are fitted.
    /// At an angle p from the Sun's direction it is w cos^2 p away.
    pub(super) fn choose(&self, nodes: Vec<Node>, half_width_px: f64) -> Vec<Node> {
        let Some(sun) = self.sun else { return nodes };
        let deep = |cos: f64| self.width_px * cos * cos > 1.5 * half_width_px;
        nodes
            .into_iter()
            .filter(|node| {
                let cos = node.normal.dot(sun);
                cos > LEAST_COS_SUN && deep(cos)
            })
            .collect()
    }

    /// Why no blur fits: both borders of a thin crescent are in the pixels that are looked at.
    pub(super) fn unsharp(&self, seen: &Coarse) -> Refusal {
        if self.width_px < 0.3 * seen.radius_px {
            Refusal::ThinCrescent { width_px: self.width_px, arc_deg: 0.0 }
        } else {
            Refusal::NotTheBody { why: "its border is not as sharp as a limb" }
        }
    }

    pub(super) fn too_short(
        &self,
        seen: &Coarse,
        found: usize,
        all: usize,
        options: &LimbOptions,
    ) -> Refusal {
        let arc_deg = 360.0 * found as f64 / all.max(1) as f64;
        if seen.touches_frame {
            Refusal::CutByFrame { arc_deg, least_deg: options.least_arc_rad.to_degrees() }
        } else if self.width_px < 0.5 * seen.radius_px {
            Refusal::ThinCrescent { width_px: self.width_px, arc_deg }
        } else {
            Refusal::NotTheBody { why: "too little of its border is a limb" }
        }
    }
}
