//! Multiple shooting: the path of the forces near the Moon that is nearest to a given one.
//!
//! The unknowns are the states at nodes in time. The arcs between them obey the forces; a defect is what an arc's end
//! lacks to the next node. Newton's method takes the defects to nothing, and of all steps that do so to first order it
//! takes the one that leaves the nodes nearest to the given ones (least squares with the defects as constraints). Its
//! equations are block tridiagonal, so that time grows with the number of nodes.

use faer::linalg::solvers::Solve as _;
use faer::{Mat, Side};
use glam::DVec3;
use rayon::prelude::*;

use crate::forces::MoonForces;

/// Position (m) and velocity (m/s) relative to the Moon, ICRF axes.
pub(crate) type MoonState = [f64; 6];
type Block = [[f64; 6]; 6];

/// Defects at which the path counts as continuous. Rounding in the arcs' extrapolation leaves a tenth of them.
const DEFECT_M: f64 = 1e-3;
const DEFECT_M_S: f64 = 1e-8;
/// From these defects on the steps mend them alone, which takes one: the nearest path has been found to within that.
const MENDED_M: f64 = 10.0;
/// Newton's steps before it is given up: 15 days take eight, ten years twenty.
const STEPS_MAX: usize = 40;
/// A step that moves a node farther is shortened, as the linear forces no longer hold; only spans of half a year and
/// more need it.
const STEP_LONGEST_M: f64 = 1e7;

/// A path: its nodes, and arcs between them that obey the forces.
#[derive(Debug, Clone)]
pub(crate) struct Path<'a> {
    forces: &'a MoonForces,
    /// When the nodes are, rising.
    times_s: Vec<f64>,
    nodes: Vec<MoonState>,
    /// Largest of the defects that are left, m and m/s.
    pub(crate) defect_m: f64,
    pub(crate) defect_m_s: f64,
}

impl<'a> Path<'a> {
    /// The path nearest to the states `wanted` at `times_s` (rising, two at least). A velocity counts against a distance
    /// by the time `unit_s`. `None` where Newton's method does not come to a path.
    pub(crate) fn near(
        forces: &'a MoonForces,
        times_s: Vec<f64>,
        wanted: &[MoonState],
        unit_s: f64,
    ) -> Option<Self> {
        let mut nodes = wanted.to_vec();
        for _ in 0..STEPS_MAX {
            let arcs: Vec<(MoonState, Block)> = times_s
                .par_windows(2)
                .zip(&nodes)
                .map(|(span_s, node)| forces.propagate_with_transition(*node, span_s[0], span_s[1]))
                .collect::<Option<_>>()?;
            let defects: Vec<MoonState> =
                arcs.iter().zip(&nodes[1..]).map(|((end, _), node)| minus(end, node)).collect();
            let largest = |part: std::ops::Range<usize>| {
                defects.iter().fold(0.0_f64, |most, defect| most.max(length(&defect[part.clone()])))
            };
            let (defect_m, defect_m_s) = (largest(0..3), largest(3..6));
            if defect_m < DEFECT_M && defect_m_s < DEFECT_M_S {
                return Some(Self { forces, times_s, nodes, defect_m, defect_m_s });
            }
            let transitions: Vec<&Block> = arcs.iter().map(|(_, transition)| transition).collect();
            let off: Vec<MoonState> = if defect_m < MENDED_M {
                vec![[0.0; 6]; nodes.len()]
            } else {
                wanted.iter().zip(&nodes).map(|(a, b)| minus(a, b)).collect()
            };
            let steps = newton_step(&transitions, &defects, &off, unit_s)?;
            let longest_m = steps.iter().fold(STEP_LONGEST_M, |most, step| most.max(length(&step[..3])));
            let share = STEP_LONGEST_M / longest_m;
            for (node, step) in nodes.iter_mut().zip(&steps) {
                *node = std::array::from_fn(|i| node[i] + share * step[i]);
            }
        }
        None
    }

    /// States at `times_s`, which lie between the first and the last node. `None` where an arc runs into the Moon.
    pub(crate) fn states(&self, times_s: &[f64]) -> Option<Vec<MoonState>> {
        let arc = |tdb_s: &f64| {
            self.times_s.partition_point(|node_s| node_s <= tdb_s).clamp(1, self.times_s.len() - 1) - 1
        };
        // Times of one arc follow each other from its node on, so that no step is taken twice.
        let groups: Vec<&[f64]> = times_s.chunk_by(|a, b| arc(a) == arc(b)).collect();
        let found: Vec<Vec<MoonState>> = groups
            .into_par_iter()
            .map(|group| {
                let first = arc(&group[0]);
                let (mut state, mut at_s) = (self.nodes[first], self.times_s[first]);
                group
                    .iter()
                    .map(|&tdb_s| {
                        state = self.forces.propagate(state, at_s, tdb_s)?;
                        at_s = tdb_s;
                        Some(state)
                    })
                    .collect()
            })
            .collect::<Option<_>>()?;
        Some(found.concat())
    }

    /// Greatest distance of the nodes within a span of time, or of the one nearest to its middle, from the states they
    /// were to be, m.
    pub(crate) fn farthest_from(&self, wanted: &[MoonState], within_s: [f64; 2]) -> f64 {
        let off = |k: usize| length(&minus(&self.nodes[k], &wanted[k])[..3]);
        let inside = |k: &usize| (within_s[0]..=within_s[1]).contains(&self.times_s[*k]);
        let middle = self.times_s.partition_point(|node_s| *node_s < 0.5 * (within_s[0] + within_s[1]));
        (0..self.nodes.len()).filter(inside).map(off).fold(off(middle.min(self.nodes.len() - 1)), f64::max)
    }
}

fn minus(a: &MoonState, b: &MoonState) -> MoonState {
    std::array::from_fn(|i| a[i] - b[i])
}

fn length(part: &[f64]) -> f64 {
    DVec3::from_slice(part).length()
}

/// Steps s of the nodes with d_k + A_k s_k - s_(k+1) = 0 for each arc's defect d and transition A, such that the sum of
/// |s_k - off_k|^2 is least, in metres and in metres over `unit_s`. `None` where that is singular.
///
/// With e = s - off, the least e under B e = b is B^T (B B^T)^-1 b; B B^T has the blocks A A^T + 1 and -A_(k+1)^T beside
/// them, and is eliminated from the first arc to the last.
fn newton_step(
    transitions: &[&Block],
    defects: &[MoonState],
    off: &[MoonState],
    unit_s: f64,
) -> Option<Vec<MoonState>> {
    let unit = |i: usize| if i < 3 { 1.0 } else { unit_s };
    let scaled = |k: usize| Mat::from_fn(6, 6, |i, j| transitions[k][i][j] * unit(i) / unit(j));
    let column = |state: &MoonState| Mat::from_fn(6, 1, |i, _| state[i] * unit(i));
    let a: Vec<Mat<f64>> = (0..defects.len()).map(scaled).collect();
    // Forward: D_k = A A^T + 1 - A_k D_(k-1)^-1 A_k^T, and the right sides with it.
    let mut pivots = Vec::with_capacity(a.len());
    let mut sides: Vec<Mat<f64>> = Vec::with_capacity(a.len());
    for k in 0..a.len() {
        let b = -(column(&defects[k]) + &a[k] * column(&off[k]) - column(&off[k + 1]));
        let mut block = &a[k] * a[k].transpose() + Mat::<f64>::identity(6, 6);
        let mut side = b;
        if let (Some(pivot), Some(before)) = (pivots.last(), sides.last()) {
            let pivot: &faer::linalg::solvers::Llt<f64> = pivot;
            block -= &a[k] * pivot.solve(a[k].transpose().to_owned());
            side += &a[k] * pivot.solve(before);
        }
        pivots.push(block.llt(Side::Lower).ok()?);
        sides.push(side);
    }
    // Backward: the multipliers, and from them each node's step.
    let mut multipliers = vec![Mat::zeros(6, 1); a.len()];
    for k in (0..a.len()).rev() {
        let side = match multipliers.get(k + 1) {
            Some(next) => &sides[k] + a[k + 1].transpose() * next,
            None => sides[k].clone(),
        };
        multipliers[k] = pivots[k].solve(side);
    }
    let step = |k: usize| -> MoonState {
        let mut e = Mat::zeros(6, 1);
        if let Some(ahead) = multipliers.get(k) {
            e += a[k].transpose() * ahead;
        }
        if let Some(behind) = k.checked_sub(1).map(|k| &multipliers[k]) {
            e -= behind;
        }
        std::array::from_fn(|i| e[(i, 0)] / unit(i) + off[k][i])
    };
    let steps: Vec<MoonState> = (0..off.len()).map(step).collect();
    steps.iter().flatten().all(|v| v.is_finite()).then_some(steps)
}
