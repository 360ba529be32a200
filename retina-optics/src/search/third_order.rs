//! Third-order aberrations of groups, and the spots that follow from their sums.
//!
//! Seidel sums and first-order colour after W. T. Welford, "Aberrations of Optical Systems" (1986),
//! chs. 8 and 10; W040 = S_I / 8, W131 = S_II / 2, W222 = S_III / 2, W220 = (S_III + S_IV) / 4. The
//! mean square of the transverse aberration grad W / (n' u') over the pupil follows from moments of
//! the unit disc.

use super::candidate::{Group, Library, layout};
use super::exact::{Quadratic, best_common_focus};
use super::request::{Configuration, MOST_FIELDS, SearchRequest};

/// Wavelengths beside the primary one whose colour is summed.
pub(crate) const COLOURS: usize = 2;

/// S_I, S_II, S_III, S_IV and, for each other wavelength, C_I and C_II, mm.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Sums {
    pub(crate) seidel: [f64; 4],
    pub(crate) axial: [f64; COLOURS],
    pub(crate) lateral: [f64; COLOURS],
}

impl Sums {
    pub(crate) fn plus(&self, other: &Self) -> Self {
        let mut sums = *self;
        sums.seidel.iter_mut().zip(other.seidel).for_each(|(a, b)| *a += b);
        sums.axial.iter_mut().zip(other.axial).for_each(|(a, b)| *a += b);
        sums.lateral.iter_mut().zip(other.lateral).for_each(|(a, b)| *a += b);
        sums
    }
}

/// The marginal and the chief ray of the largest field where they enter a group: at its front
/// principal plane, as (height, slope).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry {
    marginal: [f64; 2],
    chief: [f64; 2],
}

/// What ranking needs of a configuration.
pub(crate) struct Ranking {
    /// Entry into the collimator and the relay.
    pub(crate) entries: [Entry; 2],
    /// Fields relative to the largest.
    heights: Vec<f64>,
    /// um on the sensor for a unit gradient of W (mm) over the unit pupil.
    scale_um: f64,
}

impl Ranking {
    pub(crate) fn new(request: &SearchRequest, configuration: &Configuration) -> Self {
        let layout = layout(request, configuration);
        let f_c = request.collimator_focal_mm;
        let largest = configuration.field_tans.iter().map(|t| t.abs()).fold(0.0, f64::max).max(1e-9);
        let radius = configuration.pupil_mm / 2.0;
        let through = |[y, u]: [f64; 2]| {
            let behind = u - y / f_c;
            [y + layout.inter_lens_mm * behind, behind]
        };
        let collimator =
            Entry { marginal: [radius, 0.0], chief: [request.pupil_collimator_mm * largest, largest] };
        let relay = Entry { marginal: through(collimator.marginal), chief: through(collimator.chief) };
        let focal_mm = configuration.facility_focal_mm(f_c);
        Self {
            entries: [collimator, relay],
            heights: configuration.field_tans.iter().map(|t| t.abs() / largest).collect(),
            // 1 / u' = f / radius, and f_camera / f from the screen to the sensor.
            scale_um: focal_mm / radius * configuration.camera_focal_mm / focal_mm * 1e3,
        }
    }

    /// The largest RMS radius over the fields at the best common focus, um on the sensor.
    pub(crate) fn worst_um(&self, sums: &Sums) -> f64 {
        let [s1, s2, s3, s4] = sums.seidel;
        let (a, b, c, curvature) = (s1 / 8.0, s2 / 2.0, s3 / 2.0, (s3 + s4) / 4.0);
        let variance = |values: &[f64; COLOURS]| {
            let count = (COLOURS + 1) as f64;
            let mean = values.iter().sum::<f64>() / count;
            values.iter().map(|v| v * v).sum::<f64>() / count - mean * mean
        };
        let (axial, lateral) = (variance(&sums.axial) / 4.0, variance(&sums.lateral));
        let mut fields = [Quadratic::default(); MOST_FIELDS];
        let count = self.heights.len();
        for (field, &h) in fields.iter_mut().zip(&self.heights) {
            let h2 = h * h;
            // 2 d^2 + 16/3 a d + 2 c h^2 d with d = curvature h^2 + defocus.
            let linear = 16.0 / 3.0 * a + 2.0 * c * h2;
            let d = curvature * h2;
            let rest = 4.0 * a * a + c * c * h2 * h2 + 8.0 / 3.0 * a * c * h2 + 2.0 / 3.0 * b * b * h2;
            *field = Quadratic {
                constant: rest + 2.0 * d * d + linear * d + 2.0 * axial + lateral * h2,
                half_linear: 2.0 * d + linear / 2.0,
                square: 2.0,
            };
        }
        best_common_focus(&fields[..count]).1.max(0.0).sqrt() * self.scale_um
    }
}

/// A group's share of the sums, and how far the beam of the largest field fills its lenses: the largest
/// ratio of the paraxial rim ray's height to a lens's radius. `front_principal_mm` is that of the group.
pub(crate) fn group_sums(
    library: &Library,
    group: &Group,
    front_principal_mm: f64,
    entry: &Entry,
) -> (Sums, f64) {
    let mut sums = Sums::default();
    let at_vertex = |[y, u]: [f64; 2]| (y - front_principal_mm * u, u);
    let ((mut y, mut u), (mut y_bar, mut u_bar)) = (at_vertex(entry.marginal), at_vertex(entry.chief));
    let lagrange = u * y_bar - u_bar * y;
    let others = (0..=COLOURS).filter(|&w| w != library.primary);
    let mut other_indices = [[1.0; COLOURS]; 3 * super::candidate::MOST_LENSES];
    for (k, wavelength) in others.enumerate() {
        let mut surface = 0;
        library.walk(group, wavelength, |_, index, _| {
            other_indices[surface][k] = index;
            surface += 1;
        });
    }
    let (mut n, mut surface, mut other_before) = (1.0, 0, [1.0; COLOURS]);
    let mut filling: f64 = 0.0;
    library.walk(group, library.primary, |c, after, distance| {
        let radius_mm = library.lens(group.elements()[surface / 3]).lens.diameter_mm / 2.0;
        filling = filling.max((y.abs() + y_bar.abs()) / radius_mm);
        let (a, a_bar) = (n * (u + y * c), n * (u_bar + y_bar * c));
        let bent = |y: f64, u: f64| (n * u - y * (after - n) * c) / after;
        let (u_after, u_bar_after) = (bent(y, u), bent(y_bar, u_bar));
        let jump = u_after / after - u / n;
        sums.seidel[0] -= a * a * y * jump;
        sums.seidel[1] -= a * a_bar * y * jump;
        sums.seidel[2] -= a_bar * a_bar * y * jump;
        sums.seidel[3] -= lagrange * lagrange * c * (1.0 / after - 1.0 / n);
        for k in 0..COLOURS {
            let dispersion = (other_indices[surface][k] - after) / after - (other_before[k] - n) / n;
            sums.axial[k] += a * y * dispersion;
            sums.lateral[k] += a_bar * y * dispersion;
        }
        other_before = other_indices[surface];
        (u, u_bar, n) = (u_after, u_bar_after, after);
        y += distance * u;
        y_bar += distance * u_bar;
        surface += 1;
    });
    (sums, filling)
}
