//! An extended Kalman filter over a sequence of limb positions: the spacecraft relative to the Moon.
//!
//! State: position, velocity, an unknown acceleration (first-order Gauss-Markov), and three numbers of unit variance b
//! (Gauss-Markov too) that stand for what images of the same limb share: a measurement is the position, plus L b with
//! L L^T the covariance that is not new in each image (terrain, edge model), plus the new part. So terrain is not
//! averaged away over hours in which the same hills stand on the limb.

use faer::linalg::solvers::Solve as _;
use faer::{Mat, Side};
use glam::{DMat3, DQuat, DVec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};
use retina_files::InputError;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::forces::{LUMIO_PRESSURE_AREA_M2_KG, MoonForces};
use serde::{Deserialize, Serialize};

use super::moon_motion::{MOTION, MoonMotion};
use super::sequence::{FrameResult, percentiles};
use super::truth::FrameTruth;
use crate::far_range::chi2_mean_bounds;
use retina_navigation::filter::product;

/// Position, velocity, acceleration, shared error.
const SIZE: usize = MOTION + 3;
type Matrix = [[f64; SIZE]; SIZE];

/// What the filter is told.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FilterOptions {
    /// Uncertainty of the first state (3 sigma per axis), km.
    pub initial_position_3_sigma_km: f64,
    /// And of its velocity, m/s.
    pub initial_velocity_3_sigma_m_s: f64,
    /// Standard deviation per axis of the acceleration that is not modelled, m/s^2.
    pub acceleration_sigma_m_s2: f64,
    /// Its correlation time, h.
    pub acceleration_time_h: f64,
    /// Reflectivity coefficient times area over mass, for the pressure of sunlight, m^2/kg.
    pub pressure_area_m2_kg: f64,
    /// Angle by which the line of sight turns on the body until what images share has fallen to 1/e, deg.
    pub terrain_tilt_deg: f64,
    /// Angle by which the lit side turns about the line of sight until it has, deg.
    pub terrain_roll_deg: f64,
    /// A fixed correlation time in place of these angles, h.
    pub terrain_time_h: Option<f64>,
    /// Position errors of frames within this time of the first do not enter the distributions, h.
    pub settle_h: f64,
    /// Seed of the first state's error.
    pub seed: u64,
}

impl Default for FilterOptions {
    /// For the built-in halo, whose forces the filter knows. The unmodelled acceleration is a tenth of sunlight's push,
    /// for a coefficient and an area known to 10 %; all forces that are left out are a tenth of that. It lasts as the
    /// Sun's direction does: 10 days are a third of a month. The angles of the terrain are those of the Moon's relief over
    /// views at random (`validation/moon_shape.py`).
    fn default() -> Self {
        Self {
            initial_position_3_sigma_km: 300.0,
            initial_velocity_3_sigma_m_s: 3.0,
            acceleration_sigma_m_s2: 1e-8,
            acceleration_time_h: 240.0,
            pressure_area_m2_kg: LUMIO_PRESSURE_AREA_M2_KG,
            terrain_tilt_deg: 55.0,
            terrain_roll_deg: 27.0,
            terrain_time_h: None,
            settle_h: 12.0,
            seed: 1,
        }
    }
}

impl FilterOptions {
    /// For positions by a silhouette that has the terrain: what is left are texture and shadows on the hills at the limb.
    /// A hill of 3 km stands there while the sight turns by acos(R / (R + 3 km)) = 3.4 deg.
    #[must_use]
    pub fn for_silhouette(self) -> Self {
        Self { terrain_tilt_deg: 3.4, ..self }
    }
}

/// The filter's answer at a frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FilterStep {
    /// Its number.
    pub frame: usize,
    /// Since the first frame, s.
    pub elapsed_s: f64,
    /// Estimate less truth of the body's position, camera axes, m.
    pub error_m: [f64; 3],
    /// Three standard deviations of it, m.
    pub three_sigma_m: [f64; 3],
    /// Length of the velocity's error, m/s, where the truth has a velocity.
    pub velocity_error_m_s: Option<f64>,
    /// Three standard deviations of it: of the covariance's trace, m/s.
    pub velocity_three_sigma_m_s: f64,
    /// Normalised error squared of position and velocity (six degrees), of the position (three) without a velocity.
    pub nees: f64,
    /// Normalised innovation squared, three degrees; nothing where the frame was refused.
    pub nis: Option<f64>,
}

/// A filter's run over a sequence.
#[derive(Debug, Clone, Serialize)]
pub struct FilterResult {
    /// What it was told.
    pub options: FilterOptions,
    /// Where it takes Sun, Earth and Moon from: `analytic`, or kernels by name.
    pub ephemeris: String,
    /// By frame.
    #[serde(skip)]
    pub steps: Vec<FilterStep>,
    /// Measurements taken in.
    pub updates: usize,
    /// Root mean square of the acceleration that the forces leave unexplained in the truth, m/s^2; nothing without
    /// velocities.
    pub unmodelled_m_s2: Option<f64>,
    /// Mean error along the camera's axes after `settle_h`, km.
    pub bias_km: [f64; 3],
    /// Root mean square, km.
    pub rms_km: [f64; 3],
    /// 50, 68, 95 and 99 % of the absolute errors are within, km; by axis.
    pub percentiles_km: [[f64; 4]; 3],
    /// Root mean square of the velocity's error after `settle_h`, m/s.
    pub velocity_rms_m_s: Option<f64>,
    /// Share of the errors within three sigma, by axis.
    pub within_three_sigma: [f64; 3],
    /// Degrees of freedom of NEES.
    pub nees_freedom: usize,
    /// Share of the steps whose NEES is within the central 99 % of chi-square.
    pub nees_within: f64,
    /// Mean NEES. Errors of neighbouring frames are not independent: there are no bounds for its mean.
    pub nees_mean: f64,
    /// Mean NIS, three degrees of freedom.
    pub nis_mean: f64,
    /// Its 99 % bounds.
    pub nis_bounds: [f64; 2],
}

/// The estimate.
struct Filter {
    tdb_s: f64,
    state: [f64; SIZE],
    covariance: Matrix,
}

impl Filter {
    /// To another instant; `decay` is the correlation of what images share then with what they share now.
    fn predict(&mut self, motion: &MoonMotion, to_s: f64, decay: f64) {
        let own: [f64; MOTION] = std::array::from_fn(|i| self.state[i]);
        let (moved, phi, noise) = motion.carry(own, self.tdb_s, to_s);
        let transition: Matrix = std::array::from_fn(|i| {
            std::array::from_fn(|j| match (i < MOTION, j < MOTION) {
                (true, true) => phi[i][j],
                (false, false) if i == j => decay,
                _ => 0.0,
            })
        });
        let carried = product(&transition, &self.covariance);
        self.covariance = retina_navigation::filter::product_transposed(&carried, &transition);
        for i in 0..SIZE {
            for j in 0..SIZE {
                if i < MOTION && j < MOTION {
                    self.covariance[i][j] += noise[i][j];
                } else if i == j {
                    self.covariance[i][j] += 1.0 - decay * decay;
                }
            }
        }
        self.state[..MOTION].copy_from_slice(&moved);
        for value in &mut self.state[MOTION..] {
            *value *= decay;
        }
        self.tdb_s = to_s;
    }

    /// Takes in a position of the camera relative to the body, inertial axes: `shared` is L, `noise` the covariance
    /// of the new part. Gives the normalised innovation squared; `None` where its covariance is singular.
    fn update(&mut self, measured_m: DVec3, shared: DMat3, noise: DMat3) -> Option<f64> {
        let expected = DVec3::new(self.state[0], self.state[1], self.state[2])
            + shared * DVec3::new(self.state[9], self.state[10], self.state[11]);
        let innovation = measured_m - expected;
        let h: [[f64; SIZE]; 3] = std::array::from_fn(|row| {
            std::array::from_fn(|column| match column {
                c if c < 3 => f64::from(u8::from(c == row)),
                c if c >= MOTION => shared.col(c - MOTION)[row],
                _ => 0.0,
            })
        });
        let ph = retina_navigation::filter::product_transposed(&self.covariance, &h);
        let s = product(&h, &ph);
        let mut s = DMat3::from_cols_array_2d(&s).transpose();
        s += noise;
        let determinant = s.determinant();
        if !(determinant > 0.0 && determinant.is_finite()) {
            return None;
        }
        let inverse = s.inverse();
        let gain: [[f64; 3]; SIZE] =
            std::array::from_fn(|i| (inverse.transpose() * DVec3::from_array(ph[i])).to_array());
        for (value, row) in self.state.iter_mut().zip(&gain) {
            *value += DVec3::from_array(*row).dot(innovation);
        }
        // Joseph's form keeps the covariance symmetric and positive.
        let kh = product(&gain, &h);
        let left: Matrix =
            std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j)) - kh[i][j]));
        let kept = retina_navigation::filter::product_transposed(&product(&left, &self.covariance), &left);
        let noise_rows: [[f64; 3]; 3] = noise.transpose().to_cols_array_2d();
        let added = retina_navigation::filter::product_transposed(&product(&gain, &noise_rows), &gain);
        self.covariance = std::array::from_fn(|i| std::array::from_fn(|j| kept[i][j] + added[i][j]));
        Some(innovation.dot(inverse * innovation))
    }

    fn block(&self, first: usize) -> DMat3 {
        DMat3::from_cols_array_2d(&std::array::from_fn(|i| {
            std::array::from_fn(|j| self.covariance[first + i][first + j])
        }))
    }
}

/// The lower Cholesky factor; zero where it is not positive definite.
fn factor(covariance: DMat3) -> DMat3 {
    let rows = Mat::from_fn(3, 3, |i, j| covariance.col(j)[i]);
    match rows.llt(Side::Lower) {
        Err(_) => DMat3::ZERO,
        Ok(llt) => {
            let lower = llt.L();
            let at = |i: usize, j: usize| if j <= i { lower[(i, j)] } else { 0.0 };
            DMat3::from_cols_array_2d(&std::array::from_fn(|j| std::array::from_fn(|i| at(i, j))))
        }
    }
}

/// x^T P^-1 x over the first `size` states.
fn normalised(covariance: &Matrix, x: &[f64], size: usize) -> f64 {
    let scale: Vec<f64> = (0..size).map(|i| covariance[i][i].sqrt()).collect();
    let rows = Mat::from_fn(size, size, |i, j| covariance[i][j] / (scale[i] * scale[j]));
    let Ok(llt) = rows.llt(Side::Lower) else { return f64::NAN };
    let scaled = Mat::from_fn(size, 1, |i, _| x[i] / scale[i]);
    let solved = llt.solve(&scaled);
    (0..size).map(|i| scaled[(i, 0)] * solved[(i, 0)]).sum()
}

/// Central 99 % of chi-square with six and with three degrees of freedom (Abramowitz and Stegun, table 26.8).
pub(super) const CHI2_6: [f64; 2] = [0.6757, 18.548];
pub(super) const CHI2_3: [f64; 2] = [0.0717, 12.838];

/// Runs the filter over frames in the order of time; `truths` are theirs. The first state is the truth with a draw of
/// the first covariance.
///
/// # Errors
/// Fewer than two frames, frames that do not follow each other in time or end before the filter has settled, times
/// beyond the ephemeris.
pub fn run_filter(
    results: &[FrameResult],
    truths: &[FrameTruth],
    options: &FilterOptions,
    ephemeris: &Ephemeris,
) -> Result<FilterResult, InputError> {
    let place = "filter";
    let ordered = truths.windows(2).all(|pair| pair[1].time_s > pair[0].time_s);
    if truths.len() < 2 || results.len() != truths.len() || !ordered {
        return Err(InputError::new(place, "a filter needs frames that follow each other in time")
            .found(format!("{} frames", truths.len()))
            .expected("two at least, with rising time"));
    }
    let span_s = [truths[0].time_s, truths[truths.len() - 1].time_s];
    let motion = MoonMotion {
        forces: MoonForces::new(ephemeris, span_s, options.pressure_area_m2_kg)
            .map_err(|error| InputError::new(place, error.to_string()))?,
        acceleration_sigma_m_s2: options.acceleration_sigma_m_s2,
        acceleration_time_s: 3600.0 * options.acceleration_time_h,
    };
    let mut random = ChaCha8Rng::seed_from_u64(options.seed ^ 0x006c_756d_696f);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let first = &truths[0];
    let known_velocity = truths.iter().all(|truth| truth.velocity_m_s.is_some());
    let velocity = first.velocity_m_s.unwrap_or_else(|| {
        (truths[1].relative_position_m() - first.relative_position_m()) / (truths[1].time_s - first.time_s)
    });
    let sigmas = [
        options.initial_position_3_sigma_km * 1e3 / 3.0,
        options.initial_velocity_3_sigma_m_s / 3.0,
        options.acceleration_sigma_m_s2,
        1.0,
    ];
    let mut filter = Filter { tdb_s: first.time_s, state: [0.0; SIZE], covariance: [[0.0; SIZE]; SIZE] };
    for i in 0..SIZE {
        filter.covariance[i][i] = sigmas[i / 3].powi(2);
    }
    let start = first.relative_position_m();
    for axis in 0..3 {
        filter.state[axis] = start[axis] + sigmas[0] * normal();
        filter.state[axis + 3] = velocity[axis] + sigmas[1] * normal();
    }
    let (mut steps, mut updates) = (Vec::new(), 0);
    let mut before = first;
    for (result, truth) in results.iter().zip(truths) {
        if truth.time_s > filter.tdb_s {
            filter.predict(&motion, truth.time_s, shared_decay(options, before, truth));
        }
        before = truth;
        let turn = DMat3::from_quat(truth.camera_from_inertial.inverse());
        let nis = result.position.as_ref().and_then(|position| {
            let all = DMat3::from_cols_array_2d(&position.covariance_m2);
            let new = DMat3::from_cols_array_2d(&position.noise_covariance_m2);
            let shared = turn * factor(all - new);
            let measured = -(turn * DVec3::from_array(position.position_camera_m));
            filter.update(measured, -shared, turn * new * turn.transpose())
        });
        updates += usize::from(nis.is_some());
        steps.push(step(&filter, result, truth, span_s[0], nis, known_velocity));
    }
    if !steps.iter().any(|step| step.elapsed_s >= 3600.0 * options.settle_h) {
        return Err(InputError::new(place, "the frames end before the filter has settled")
            .found(format!("{:.1} h", (span_s[1] - span_s[0]) / 3600.0))
            .expected(format!("more than {} h", options.settle_h)));
    }
    Ok(summary(*options, ephemeris.name(), steps, updates, unmodelled(&motion, truths)))
}

/// Correlation of what two images share of their limbs' errors. It falls as other terrain comes to the limb: where the
/// line of sight turns on the body, and where the Sun comes round and lights another side.
fn shared_decay(options: &FilterOptions, before: &FrameTruth, now: &FrameTruth) -> f64 {
    if let Some(hours) = options.terrain_time_h {
        return (-(now.time_s - before.time_s) / (3600.0 * hours)).exp();
    }
    let [(sight_before, side_before), (sight, side)] = [before, now].map(|truth| {
        let body_from_camera = truth.camera_from_body.inverse();
        let sight = (body_from_camera * truth.position_camera_m).normalize();
        (sight, (body_from_camera * truth.sun_direction_camera).reject_from_normalized(sight))
    });
    let carried = DQuat::from_rotation_arc(sight_before, sight) * side_before;
    let tilt = sight_before.angle_between(sight) / options.terrain_tilt_deg.to_radians();
    // A Sun on the line of sight has no side.
    let sides = carried.length() > 0.0 && side.length() > 0.0;
    let roll = if sides { carried.angle_between(side) / options.terrain_roll_deg.to_radians() } else { 0.0 };
    (-tilt.hypot(roll)).exp()
}

fn step(
    filter: &Filter,
    result: &FrameResult,
    truth: &FrameTruth,
    start_s: f64,
    nis: Option<f64>,
    known_velocity: bool,
) -> FilterStep {
    let true_m = truth.relative_position_m();
    let off = DVec3::new(filter.state[0], filter.state[1], filter.state[2]) - true_m;
    let velocity = DVec3::new(filter.state[3], filter.state[4], filter.state[5]);
    let velocity_off = truth.velocity_m_s.map(|v| velocity - v);
    let turn: DQuat = truth.camera_from_inertial;
    let matrix = DMat3::from_quat(turn);
    let covariance = matrix * filter.block(0) * matrix.transpose();
    let size = if known_velocity { 6 } else { 3 };
    let v = velocity_off.unwrap_or(DVec3::ZERO);
    FilterStep {
        frame: result.frame,
        elapsed_s: truth.time_s - start_s,
        // The body relative to the camera: the opposite.
        error_m: (-(turn * off)).to_array(),
        three_sigma_m: [0, 1, 2].map(|k| 3.0 * covariance.col(k)[k].sqrt()),
        velocity_error_m_s: velocity_off.map(DVec3::length),
        velocity_three_sigma_m_s: 3.0 * (3..6).map(|i| filter.covariance[i][i]).sum::<f64>().sqrt(),
        nees: normalised(&filter.covariance, &[off.x, off.y, off.z, v.x, v.y, v.z], size),
        nis,
    }
}

/// What the forces leave of the truth's acceleration: differences of velocity over each interval against those that
/// the forces give from the same state, root mean square, m/s^2.
fn unmodelled(motion: &MoonMotion, truths: &[FrameTruth]) -> Option<f64> {
    let mut sum = 0.0;
    for pair in truths.windows(2) {
        let (r, v) = (pair[0].relative_position_m(), pair[0].velocity_m_s?);
        let state = [r.x, r.y, r.z, v.x, v.y, v.z, 0.0, 0.0, 0.0];
        let (end, ..) = motion.carry(state, pair[0].time_s, pair[1].time_s);
        let off = pair[1].velocity_m_s? - DVec3::new(end[3], end[4], end[5]);
        sum += (off / (pair[1].time_s - pair[0].time_s)).length_squared();
    }
    Some((sum / (truths.len() - 1) as f64).sqrt())
}

fn summary(
    options: FilterOptions,
    ephemeris: String,
    steps: Vec<FilterStep>,
    updates: usize,
    unmodelled_m_s2: Option<f64>,
) -> FilterResult {
    let settled: Vec<&FilterStep> =
        steps.iter().filter(|step| step.elapsed_s >= 3600.0 * options.settle_h).collect();
    let count = settled.len().max(1) as f64;
    let mean = |pick: &dyn Fn(&FilterStep) -> f64| settled.iter().map(|s| pick(s)).sum::<f64>() / count;
    let velocity = settled.iter().all(|s| s.velocity_error_m_s.is_some());
    let (nees_freedom, bounds) = if velocity { (6, CHI2_6) } else { (3, CHI2_3) };
    let nis: Vec<f64> = settled.iter().filter_map(|s| s.nis).collect();
    FilterResult {
        options,
        ephemeris,
        updates,
        unmodelled_m_s2,
        bias_km: [0, 1, 2].map(|k| mean(&|s| s.error_m[k] * 1e-3)),
        rms_km: [0, 1, 2].map(|k| mean(&|s| (s.error_m[k] * 1e-3).powi(2)).sqrt()),
        percentiles_km: [0, 1, 2]
            .map(|k| percentiles(settled.iter().map(|s| s.error_m[k].abs() * 1e-3).collect())),
        velocity_rms_m_s: velocity.then(|| mean(&|s| s.velocity_error_m_s.unwrap_or(0.0).powi(2)).sqrt()),
        within_three_sigma: [0, 1, 2]
            .map(|k| mean(&|s| f64::from(u8::from(s.error_m[k].abs() <= s.three_sigma_m[k])))),
        nees_freedom,
        nees_within: mean(&|s| f64::from(u8::from((bounds[0]..=bounds[1]).contains(&s.nees)))),
        nees_mean: mean(&|s| s.nees),
        nis_mean: nis.iter().sum::<f64>() / nis.len().max(1) as f64,
        nis_bounds: chi2_mean_bounds(3, nis.len().max(1)),
        steps,
    }
}
