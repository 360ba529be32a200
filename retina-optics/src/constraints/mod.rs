//! The paper's paraxial constraint analysis: which fields a collimator and a relay can serve.
//!
//! Source: the paper's sections "Facility design" and "Paraxial constraint analysis", eqs. 1-6,
//! Figs. 1 and 2. Thin lenses; lengths in mm; fields are full diagonal angles. With t = tan(FoV / 2),
//! |M| = 2 f_c t / h_s (eq. 3) and every limit is a polynomial of degree two in t, so that the ends of
//! the field are roots in closed form and none is missed between the steps of a scan.

mod figure;
mod grid;

pub use figure::field_range_figure;
pub use grid::{FieldGrid, FieldRequirement, field_grid};

use serde::{Deserialize, Serialize};

/// The optical bench of the facility (paper, "Paraxial constraint analysis"), mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BenchLimits {
    /// Longest s_oc, screen to collimator.
    pub total_length_mm: f64,
    /// Shortest s_or, screen to relay.
    pub screen_relay_mm: f64,
    /// Shortest s_rc, relay to collimator.
    pub inter_lens_mm: f64,
}

impl BenchLimits {
    /// The paper's bench: s_oc <= 850, s_or >= 100, s_rc >= 100 mm.
    pub const PAPER: Self = Self { total_length_mm: 850.0, screen_relay_mm: 100.0, inter_lens_mm: 100.0 };
}

/// Two thin lenses between screen and camera (paper, Fig. 1), mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PaperModel {
    /// f_c, collimator.
    pub collimator_focal_mm: f64,
    /// f_r, relay.
    pub relay_focal_mm: f64,
    /// h_s, the extent of the screen that the field is matched to; the diagonal for diagonal fields.
    pub screen_mm: f64,
    /// d_cam, the camera's entrance pupil.
    pub pupil_mm: f64,
    /// 2 R_c, the collimator's clear diameter.
    pub collimator_diameter_mm: f64,
    /// 2 R_r, the relay's clear diameter.
    pub relay_diameter_mm: f64,
    /// s_cam, camera pupil to collimator.
    pub pupil_collimator_mm: f64,
}

impl PaperModel {
    /// Diagonal of the paper's screen, 18.7 x 11.75 mm.
    pub const SCREEN_DIAGONAL_MM: f64 = 22.09;
    /// The paper's pupil d_cam.
    pub const PUPIL_MM: f64 = 10.0;
    /// The paper's lens diameter, 2 inches.
    pub const LENS_DIAMETER_MM: f64 = 50.8;

    /// The paper's settings for these focal lengths: d_cam = 10 mm, 2 inch lenses, s_cam = f_c.
    pub fn paper(collimator_focal_mm: f64, relay_focal_mm: f64) -> Self {
        Self {
            collimator_focal_mm,
            relay_focal_mm,
            screen_mm: Self::SCREEN_DIAGONAL_MM,
            pupil_mm: Self::PUPIL_MM,
            collimator_diameter_mm: Self::LENS_DIAMETER_MM,
            relay_diameter_mm: Self::LENS_DIAMETER_MM,
            pupil_collimator_mm: collimator_focal_mm,
        }
    }

    /// Distances and beam radii at the field of this tangent (of half the angle), matched to the screen by eq. 3.
    pub fn at_tan(&self, half_field_tan: f64) -> Layout {
        self.layout(-2.0 * self.collimator_focal_mm * half_field_tan / self.screen_mm, half_field_tan)
    }

    /// Distances at a magnification M < 0, and the beams' radii for the boundary rays of a field.
    pub fn layout(&self, magnification: f64, half_field_tan: f64) -> Layout {
        let (f_c, f_r, t) = (self.collimator_focal_mm, self.relay_focal_mm, half_field_tan);
        let screen_relay_mm = (magnification - 1.0) / magnification * f_r;
        let relay_image_mm = (1.0 - magnification) * f_r;
        let inter_lens_mm = relay_image_mm + f_c;
        // The two boundary rays leave the rims of the camera's pupil with the slope of the field.
        let edges = [-0.5, 0.5].map(|rim| {
            let at_collimator = self.pupil_collimator_mm * t + rim * self.pupil_mm;
            let at_relay = at_collimator + inter_lens_mm * (t - at_collimator / f_c);
            (at_collimator.abs(), at_relay.abs())
        });
        Layout {
            magnification,
            screen_relay_mm,
            relay_image_mm,
            inter_lens_mm,
            total_length_mm: screen_relay_mm + inter_lens_mm,
            collimator_beam_mm: edges[0].0.max(edges[1].0),
            relay_beam_mm: edges[0].1.max(edges[1].1),
        }
    }

    /// The limit that is exceeded most, as a share of the limit, or `None` where all hold.
    fn exceeded(&self, half_field_tan: f64, bench: &BenchLimits) -> Option<Limit> {
        let layout = self.at_tan(half_field_tan);
        let excess = [
            (Limit::TotalLength, layout.total_length_mm / bench.total_length_mm - 1.0),
            (Limit::ScreenRelayDistance, 1.0 - layout.screen_relay_mm / bench.screen_relay_mm),
            (Limit::InterLensDistance, 1.0 - layout.inter_lens_mm / bench.inter_lens_mm),
            (Limit::RelayVignetting, 2.0 * layout.relay_beam_mm / self.relay_diameter_mm - 1.0),
            (
                Limit::CollimatorVignetting,
                2.0 * layout.collimator_beam_mm / self.collimator_diameter_mm - 1.0,
            ),
        ];
        let worst = excess.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        (worst.1 > 0.0).then_some(worst.0)
    }

    /// Every t > 0 at which a limit is met: the candidates for ends of the field, ascending.
    fn critical_tans(&self, bench: &BenchLimits) -> Vec<f64> {
        let (f_c, f_r) = (self.collimator_focal_mm, self.relay_focal_mm);
        // |M| = a t.
        let a = 2.0 * f_c / self.screen_mm;
        let mut tans = Vec::new();
        // s_oc = f_c + f_r (2 + |M| + 1 / |M|).
        let room = (bench.total_length_mm - f_c) / f_r - 2.0;
        tans.extend(roots(a * a, -room * a, 1.0));
        // s_or = f_r (1 + 1 / |M|); s_rc = f_c + f_r (1 + |M|).
        tans.extend(roots(0.0, a * (bench.screen_relay_mm - f_r), -f_r));
        tans.extend(roots(0.0, a * f_r, f_c + f_r - bench.inter_lens_mm));
        for rim in [-0.5 * self.pupil_mm, 0.5 * self.pupil_mm] {
            for side in [-0.5, 0.5] {
                let s = self.pupil_collimator_mm;
                tans.extend(roots(0.0, s, rim - side * self.collimator_diameter_mm));
                // y_r = y_c + s_rc (t - y_c / f_c), y_c = s t + rim, s_rc = f_c + f_r (1 + a t).
                let square = a * f_r * (1.0 - s / f_c);
                let linear = f_c + f_r - f_r * s / f_c - rim * a * f_r / f_c;
                tans.extend(roots(square, linear, -rim * f_r / f_c - side * self.relay_diameter_mm));
            }
        }
        tans.retain(|t| t.is_finite() && *t > 0.0);
        tans.sort_by(f64::total_cmp);
        tans
    }

    /// The fields within all limits: the widest run without a gap. `None` where there is none.
    pub fn field_range(&self, bench: &BenchLimits) -> Option<FieldRange> {
        let critical = self.critical_tans(bench);
        // Between neighbouring critical values no limit changes sides: one point in each stands for all.
        // Before the first and after the last, s_oc grows without bound, so those are never feasible.
        let mut runs: Vec<(f64, f64)> = Vec::new();
        for pair in critical.windows(2) {
            if pair[1] > pair[0] && self.exceeded(0.5 * (pair[0] + pair[1]), bench).is_none() {
                match runs.last_mut() {
                    Some(run) if run.1 == pair[0] => run.1 = pair[1],
                    _ => runs.push((pair[0], pair[1])),
                }
            }
        }
        let field_rad = |t: f64| 2.0 * t.atan();
        let (low, high) = runs
            .into_iter()
            .max_by(|a, b| (field_rad(a.1) - field_rad(a.0)).total_cmp(&(field_rad(b.1) - field_rad(b.0))))?;
        // Just outside an end only the limit that binds there is exceeded.
        let outside = 1e-9;
        Some(FieldRange {
            min_rad: field_rad(low),
            max_rad: field_rad(high),
            limit_at_min: self.exceeded(low * (1.0 - outside), bench).unwrap_or(Limit::None),
            limit_at_max: self.exceeded(high * (1.0 + outside), bench).unwrap_or(Limit::None),
        })
    }
}

/// Distances (eqs. 4-6) and beam radii at one field, mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Layout {
    /// M, negative: the intermediate image is real and inverted.
    pub magnification: f64,
    /// s_or.
    pub screen_relay_mm: f64,
    /// s_ri.
    pub relay_image_mm: f64,
    /// s_rc.
    pub inter_lens_mm: f64,
    /// s_oc.
    pub total_length_mm: f64,
    /// r_c, farthest boundary ray from the axis at the collimator.
    pub collimator_beam_mm: f64,
    /// r_r, the same at the relay.
    pub relay_beam_mm: f64,
}

/// What keeps a field from being smaller or larger.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Limit {
    /// s_oc.
    TotalLength,
    /// s_or.
    ScreenRelayDistance,
    /// s_rc.
    InterLensDistance,
    /// r_r.
    RelayVignetting,
    /// r_c.
    CollimatorVignetting,
    /// Nothing does.
    None,
}

/// Smallest and largest diagonal field (full angle) within all limits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FieldRange {
    /// Smallest, rad.
    pub min_rad: f64,
    /// Largest, rad.
    pub max_rad: f64,
    /// What binds at the smallest.
    pub limit_at_min: Limit,
    /// What binds at the largest.
    pub limit_at_max: Limit,
}

/// Real roots of a x^2 + b x + c, by the form that does not cancel.
fn roots(a: f64, b: f64, c: f64) -> Vec<f64> {
    let scale = b.abs().max(c.abs());
    if a.abs() < 1e-14 * scale || a == 0.0 {
        return if b == 0.0 { Vec::new() } else { vec![-c / b] };
    }
    let square = b * b - 4.0 * a * c;
    if square < 0.0 {
        return Vec::new();
    }
    let q = -0.5 * (b + b.signum() * square.sqrt());
    if q == 0.0 { vec![0.0] } else { vec![q / a, c / q] }
}

#[cfg(test)]
mod tests;
