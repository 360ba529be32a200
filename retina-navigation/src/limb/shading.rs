//! What a body's shading does to its edges.
//!
//! An edge is fitted by a step and a ramp. A body's brightness goes with the root of the depth inside its limb, which is
//! steepest at the limb itself: the more pixels a fit takes, the further the edge is off. So edges that are fitted
//! in two widths differ, and the difference foretells what both are off by.

use glam::{DMat3, DVec2, DVec3};

use super::edge::Edge;
use super::fit::NORMAL_MEDIAN;
use super::judge::correlation_factor;
use super::lit::Lit;

/// What edges are off by, over what they move by when the window is twice as wide. Measured on discs of Lambert's and
/// of Lommel and Seeliger's law, radii 40 to 500 px, phase angles 0 to 110 deg (`validation/limb_draws.py`).
const OFF_PER_MOVE: f64 = 1.5;
/// Share of this that may be wrong (1 sigma). Lambert's law seen nearly full is dark at its limb: its radius is found too
/// small by up to twice of it.
const SIGMA_SHARE: f64 = 1.0;
/// The radius of a crescent of width w, blurred by s, is found too small by this times s / (w / s)^2: its light falls off
/// within a few s of the limb. Measured on discs of Lambert's and of Lommel and Seeliger's law, phase angles 138 to
/// 156 deg, radii 90 to 150 px, blurs 0.4 to 2 px.
const CRESCENT: f64 = 100.0;
/// The centre moves towards the Sun by this part of the radius's error: the lit arc stays where it is.
const CENTRE_OF_CRESCENT: f64 = 0.85;

/// What edges are off by: a change of the radius and of the centre, px.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Shading {
    change: DVec3,
    /// Covariance of the change by the scatter of the differences, px^2.
    covariance_px2: DMat3,
}

impl Shading {
    /// Nothing where fewer than ten edges are in both.
    pub(super) fn between(narrow: &[Edge], wide: &[Edge]) -> Self {
        let mut others = wide.iter().peekable();
        let mut pairs: Vec<(DVec3, f64)> = Vec::new();
        let mut indices = Vec::new();
        for edge in narrow {
            while others.next_if(|other| other.node.index < edge.node.index).is_some() {}
            if let Some(other) = others.peek().filter(|other| other.node.index == edge.node.index) {
                let normal = edge.node.normal;
                indices.push(edge.node.index);
                pairs.push((row(normal), other.shift_px - edge.shift_px));
            }
        }
        let mut found = DVec3::ZERO;
        if pairs.len() < 10 {
            return Self::default();
        }
        // By absolute values: hills and craters differ in the two windows, too.
        for _ in 0..12 {
            let (mut normal, mut right) = (DMat3::from_diagonal(DVec3::splat(1e-9)), DVec3::ZERO);
            for (row, value) in &pairs {
                let weight = 1.0 / ((value - row.dot(found)).abs() + 0.005);
                normal += DMat3::from_cols(*row * row.x, *row * row.y, *row * row.z) * weight;
                right += *row * (weight * value);
            }
            found = normal.inverse() * right;
        }
        let left: Vec<f64> = pairs.iter().map(|(row, value)| value - row.dot(found)).collect();
        let mut sizes: Vec<f64> = left.iter().map(|value| value.abs()).collect();
        let middle = sizes.len() / 2;
        let spread = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / NORMAL_MEDIAN;
        // Hills and dark ground reach over several edges: neighbours are not independent.
        let factor = correlation_factor(&indices.into_iter().zip(left).collect::<Vec<_>>());
        let normal = pairs.iter().fold(DMat3::ZERO, |sum, (row, _)| {
            sum + DMat3::from_cols(*row * row.x, *row * row.y, *row * row.z)
        });
        // As much is believed as stands out of the noise (James and Stein): a flat disc keeps its edges.
        let stands_out = found.dot(normal * found) / (spread * spread * factor).max(1e-12);
        let believed = OFF_PER_MOVE * (1.0 - 3.0 / stands_out).max(0.0);
        Self {
            change: found * believed,
            covariance_px2: normal.inverse() * (believed.powi(2) * spread * spread * factor),
        }
    }

    /// Standard deviation of what it leaves, px.
    pub(super) fn sigma_px(&self, edges: &[Edge]) -> f64 {
        let variance = |edge: &Edge| {
            let row = row(edge.node.normal);
            (SIGMA_SHARE * self.change.dot(row)).powi(2) + row.dot(self.covariance_px2 * row)
        };
        (edges.iter().map(variance).sum::<f64>() / edges.len().max(1) as f64).sqrt()
    }

    /// By how much a crescent's radius and centre may be off together, px (1 sigma).
    pub(super) fn of_crescent(lit: &Lit, blur_px: f64) -> DVec3 {
        let Some(sun) = lit.sun else { return DVec3::ZERO };
        let radius = CRESCENT * blur_px.powi(3) / lit.width_px.powi(2).max(f64::MIN_POSITIVE);
        radius * DVec3::new(1.0, -CENTRE_OF_CRESCENT * sun.x, -CENTRE_OF_CRESCENT * sun.y)
    }

    /// Along a normal of the outline, px.
    pub(super) fn at(&self, normal: DVec2) -> f64 {
        self.change.dot(row(normal))
    }
}

/// What radius and centre do to an edge.
fn row(normal: DVec2) -> DVec3 {
    DVec3::new(1.0, normal.x, normal.y)
}
