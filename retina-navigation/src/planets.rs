//! Planets in a solved image: which point is one, and its line of sight with covariance.

use glam::{DMat2, DVec2, DVec3};
use retina_sky::ephemeris::EphemerisError;
use retina_sky::observer::Observer;
use retina_sky::planets::{Planet, SeenPlanet, planets_in_cone};
use thiserror::Error;

use crate::stars::{StarPoint, StarSolution};

/// Where the camera is, as far as it is known beforehand.
#[derive(Debug, Clone)]
pub struct PriorPosition {
    /// Epoch, position and velocity that are assumed.
    pub observer: Observer,
    /// Standard deviation of the position along each axis, m. The paper's knowledge is 10^5 km at 3 sigma.
    pub sigma_m: f64,
}

/// The paper's a-priori knowledge of the position, one standard deviation, m.
pub const PAPER_POSITION_SIGMA_M: f64 = 1e8 / 3.0;
/// Squared Mahalanobis distance that a planet's point keeps in 99.9 % of cases (chi-square, two degrees of freedom).
const GATE: f64 = 13.816;
/// A planet's measured magnitude may differ by this standard deviation: the camera's band, window and phase laws.
const MAGNITUDE_SIGMA: f64 = 0.3;
/// Where a second point is this little less likely (difference of log likelihoods), neither is taken.
const LEAST_MARGIN: f64 = 3.0;
/// Greatest chance that a point that is no planet stands in the gate with such a brightness.
const GREATEST_CONFUSION: f64 = 0.05;

/// A planet that was found.
#[derive(Debug, Clone, Copy)]
pub struct PlanetSight {
    /// Which.
    pub planet: Planet,
    /// Index of the point.
    pub point: usize,
    /// Line of sight on the tangent plane, camera frame, focal length and distortion taken off.
    pub line_of_sight: DVec2,
    /// Its covariance, rad^2: the point's noise, what stars show beyond theirs, and the attitude's.
    pub covariance_rad2: DMat2,
    /// Unit vector along inertial axes, as seen (aberration and light-time are in it).
    pub direction: DVec3,
    /// Where it was expected: the planet as the prior position sees it.
    pub expected: SeenPlanet,
    /// Magnitude from the camera, on the matched stars' scale.
    pub magnitude: Option<f64>,
    /// Squared Mahalanobis distance from where it was expected.
    pub distance2: f64,
}

/// What became of a planet that may be in an image.
#[derive(Debug, Clone, Copy)]
pub struct PlanetVerdict {
    /// The planet as the prior position sees it.
    pub expected: SeenPlanet,
    /// The measured line of sight at which it is expected.
    pub place: DVec2,
    /// Whether it was identified, or why not.
    pub outcome: PlanetOutcome,
}

/// Whether a planet was identified, or why not.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PlanetOutcome {
    /// It was.
    #[error("identified")]
    Identified,
    /// Its place is outside the image.
    #[error("its place is outside the image")]
    Outside,
    /// It is too faint for the image.
    #[error(
        "no point near its place: magnitude {magnitude:.1} is fainter than the faintest point, {faintest:.1}"
    )]
    TooFaint {
        /// Expected.
        magnitude: f64,
        /// Of the faintest point.
        faintest: f64,
    },
    /// No free point is where it can be.
    #[error(
        "no point within {gate_arcsec:.0} arcsec of its place that is not a star; the nearest is {nearest_arcsec:.0} arcsec away"
    )]
    NoPoint {
        /// Radius within which it can be.
        gate_arcsec: f64,
        /// Distance of the nearest free point, infinite without one.
        nearest_arcsec: f64,
    },
    /// What is there has another brightness.
    #[error("the point at its place is of magnitude {seen:.1}, and {expected:.1} was expected")]
    Brightness {
        /// By the camera.
        seen: f64,
        /// By the planet's law.
        expected: f64,
    },
    /// Two points there are about as likely.
    #[error("two points at its place are about as likely")]
    Rival,
    /// An unrelated point could stand there.
    #[error(
        "an unrelated point of such a brightness would stand there with a probability of {probability:.2}"
    )]
    Confusion {
        /// Expected number of such points.
        probability: f64,
    },
}

impl PlanetOutcome {
    /// A word for machines.
    pub fn word(self) -> &'static str {
        match self {
            Self::Identified => "identified",
            Self::Outside => "outside",
            Self::TooFaint { .. } => "too_faint",
            Self::NoPoint { .. } => "no_point",
            Self::Brightness { .. } => "brightness",
            Self::Rival => "rival",
            Self::Confusion { .. } => "confusion",
        }
    }
}

/// Finds planets among the points that are no stars of a solution.
///
/// A point is taken where it lies within the gate that the prior position's uncertainty opens at the planet's
/// distance, agrees with its brightness, has no rival, and an unrelated point would hardly stand there. What
/// became of each planet that can be in the field is told, too.
///
/// # Errors
/// The epoch is outside the ephemeris.
pub fn identify_planets(
    solution: &StarSolution,
    points: &[StarPoint],
    prior: &PriorPosition,
    half_field: DVec2,
) -> Result<(Vec<PlanetSight>, Vec<PlanetVerdict>), EphemerisError> {
    let axis = solution.camera_from_inertial().inverse() * DVec3::Z;
    let mut expected = planets_in_cone(&prior.observer, axis, half_field.length().atan() + GATE_MARGIN_RAD)?;
    expected.sort_by(|a, b| a.magnitude.total_cmp(&b.magnitude));
    let mut free = vec![true; points.len()];
    for matched in &solution.matches {
        free[matched.point] = false;
    }
    let area = 4.0 * half_field.x * half_field.y;
    let (mut found, mut verdicts) = (Vec::new(), Vec::new());
    let faintest = points.last().and_then(|point| magnitude(solution, point));
    for planet in expected {
        let Some(place) = solution.fit.project(planet.direction) else { continue };
        let mut decide =
            |outcome: PlanetOutcome| verdicts.push(PlanetVerdict { expected: planet, place, outcome });
        let spread2 = (prior.sigma_m / planet.distance_m).powi(2);
        let mut rated: Vec<(f64, f64, PlanetSight)> = Vec::new();
        let (mut nearest, mut gate, mut unlike) = (f64::INFINITY, GATE.sqrt() * spread2.sqrt(), None);
        for (at, point) in points.iter().enumerate().filter(|(at, _)| free[*at]) {
            let sight = sight(solution, point, at, planet);
            let off = point.line_of_sight - place;
            let total = sight.covariance_rad2 + DMat2::from_diagonal(DVec2::splat(spread2));
            let distance2 = off.dot(total.inverse() * off);
            if off.length() < nearest {
                nearest = off.length();
                gate = (GATE * total.determinant().sqrt()).sqrt();
            }
            if distance2 > GATE {
                continue;
            }
            let darker = sight.magnitude.map_or(0.0, |seen| seen - planet.magnitude);
            // Saturation only hides light.
            let darker = if point.saturated { darker.min(0.0) } else { darker };
            let brightness = (darker / MAGNITUDE_SIGMA).powi(2);
            if brightness > GATE {
                unlike = sight.magnitude;
                continue;
            }
            let gate_sr = std::f64::consts::PI * GATE * total.determinant().sqrt();
            // Twice the negative log likelihood: what stands anywhere in a wide covariance says little.
            let rating = distance2 + brightness + total.determinant().ln();
            rated.push((rating, gate_sr, PlanetSight { distance2, ..sight }));
        }
        rated.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some((best, gate_sr, sight)) = rated.first().copied() else {
            let outside = place.x.abs() > half_field.x || place.y.abs() > half_field.y;
            decide(match (unlike, faintest) {
                (Some(seen), _) => PlanetOutcome::Brightness { seen, expected: planet.magnitude },
                _ if outside => PlanetOutcome::Outside,
                (_, Some(faintest)) if planet.magnitude > faintest => {
                    PlanetOutcome::TooFaint { magnitude: planet.magnitude, faintest }
                }
                _ => PlanetOutcome::NoPoint { gate_arcsec: arcsec(gate), nearest_arcsec: arcsec(nearest) },
            });
            continue;
        };
        let rivalled = rated.get(1).is_some_and(|(next, ..)| (next - best) / 2.0 < LEAST_MARGIN);
        // Points that could be mistaken for it: free ones of about its brightness, wherever they are.
        let similar = points.iter().enumerate().filter(|(at, point)| {
            *at != sight.point
                && free[*at]
                && (point.flux / points[sight.point].flux).log10().abs() < 0.4 * GATE.sqrt() * MAGNITUDE_SIGMA
        });
        let confusion = similar.count() as f64 * gate_sr / area;
        decide(if rivalled {
            PlanetOutcome::Rival
        } else if confusion >= GREATEST_CONFUSION {
            PlanetOutcome::Confusion { probability: confusion }
        } else {
            free[sight.point] = false;
            found.push(sight);
            PlanetOutcome::Identified
        });
    }
    Ok((found, verdicts))
}

fn arcsec(angle_rad: f64) -> f64 {
    angle_rad.to_degrees() * 3600.0
}

/// Of a point, on the matched stars' scale.
fn magnitude(solution: &StarSolution, point: &StarPoint) -> Option<f64> {
    solution.zero_point_magnitude.map(|zero| zero - 2.5 * point.flux.log10())
}

/// A planet may stand outside the image by its gate, rad: 10^5 km at 0.1 au.
const GATE_MARGIN_RAD: f64 = 0.007;

fn sight(solution: &StarSolution, point: &StarPoint, at: usize, expected: SeenPlanet) -> PlanetSight {
    let line_of_sight = solution.fit.corrected(point.line_of_sight);
    let rows = solution.fit.rows(line_of_sight);
    let [x, y] = rows.map(|row| DVec3::new(row[0], row[1], row[2]));
    let attitude = solution.attitude_covariance_rad2;
    let own = point.sigma_rad.powi(2) + solution.excess_sigma_rad.powi(2);
    let (xx, xy, yy) = (x.dot(attitude * x), x.dot(attitude * y), y.dot(attitude * y));
    PlanetSight {
        planet: expected.planet,
        point: at,
        line_of_sight,
        covariance_rad2: DMat2::from_cols(DVec2::new(xx + own, xy), DVec2::new(xy, yy + own)),
        direction: solution.inertial_direction(point.line_of_sight),
        expected,
        magnitude: magnitude(solution, point),
        distance2: 0.0,
    }
}
