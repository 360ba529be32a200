//! Where the points of a planned exposure are.

use glam::{DMat2, DVec2};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use retina_geometry::Setup;

/// How points lie in the camera's field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Layout {
    /// All over it.
    Even,
    /// In its outer part.
    Edge,
    /// In its inner part.
    Centre,
}

/// Spots nearer to each other than this merge, camera px.
pub(crate) const APART_PX: f64 = 20.0;
/// Points keep this share of the sensor's side from its edge: distortion moves them.
const MARGIN: f64 = 0.03;
/// Share of the half diagonal beyond which the outer part begins, and below which the inner part ends.
const OUTER: f64 = 0.62;
const INNER: f64 = 0.5;
/// Places that are tried for each point.
const TRIES: usize = 200;

impl Layout {
    pub(crate) fn name(self) -> &'static str {
        ["even", "edge", "centre"][self as usize]
    }

    fn holds(self, share: f64) -> bool {
        match self {
            Self::Even => true,
            Self::Edge => share >= OUTER,
            Self::Centre => share <= INNER,
        }
    }
}

/// Pixels of the screen, column and row, that a camera sees which is turned by `roll_rad` against the facility; at most
/// `most`, fewer where they would merge.
pub(crate) fn places(setup: &Setup, layout: Layout, roll_rad: f64, most: usize, seed: u64) -> Vec<[u32; 2]> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
    let size = DVec2::new(f64::from(camera.width_px), f64::from(camera.height_px));
    let facility_from_camera = DMat2::from_angle(roll_rad);
    let half_diagonal = 0.5 * size.length();
    // Even points keep more of their mean distance than a crowd at the edge can.
    let spread = 0.6 * (size.x * size.y / most.max(1) as f64).sqrt();
    let apart = if layout == Layout::Even { spread.max(APART_PX) } else { APART_PX };
    let mut out: Vec<([u32; 2], DVec2)> = Vec::with_capacity(most);
    for _ in 0..TRIES * most {
        if out.len() == most {
            break;
        }
        let share =
            DVec2::new(random.random_range(MARGIN..1.0 - MARGIN), random.random_range(MARGIN..1.0 - MARGIN));
        let at = size * share;
        let far = |other: &DVec2| other.distance(at) >= apart;
        if !layout.holds((at - 0.5 * size).length() / half_diagonal) || !out.iter().all(|(_, o)| far(o)) {
            continue;
        }
        let screen = facility.pixel(facility_from_camera * camera.line_of_sight(at));
        let inside = screen.x >= 1.0
            && screen.y >= 1.0
            && screen.x < f64::from(facility.width_px) - 1.0
            && screen.y < f64::from(facility.height_px) - 1.0;
        if inside {
            out.push(([screen.x as u32, screen.y as u32], at));
        }
    }
    let mut places: Vec<[u32; 2]> = out.into_iter().map(|(place, _)| place).collect();
    places.sort_unstable_by_key(|place| (place[1], place[0]));
    places
}
