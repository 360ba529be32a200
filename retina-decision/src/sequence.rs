//! A sequence of planned exposures: as rows behind the measured ones, and as screens with their conditions.

use glam::{DMat2, DVec2};
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;
use retina_calibration::geometry::{MeasurementPlan, Pattern, PatternPoint, PatternScreen, PlannedExposure};
use retina_formats::{Channel, PointRow, PointsTable};
use retina_geometry::Setup;

use crate::conditions::{Levels, Setting};
use crate::light::Light;
use crate::places::{APART_PX, Layout, places};

/// One of so many points of an exposure stays where it is when the others move to where they tell most.
const KEPT: usize = 4;
/// Most measured rows that a plan is judged beside.
const MOST_ROWS: usize = 800;

/// What plans are made of: the measured table, the light of its points, and the levels of conditions.
pub(crate) struct Material<'a> {
    pub(crate) setup: &'a Setup,
    pub(crate) light: Light,
    pub(crate) levels: Levels,
    /// Measured rows, thinned.
    thinned: PointsTable,
    /// How many measured rows each of these stands for.
    pub(crate) stands_for: f64,
    /// Time from which on exposures can be made.
    start_s: Option<f64>,
    /// Number of the last mounting of the camera, and its roll.
    mounting: f64,
    roll_deg: Option<f64>,
}

/// An exposure with its conditions in full.
#[derive(Debug, Clone, PartialEq)]
pub struct Planned {
    /// How its points lie: `even`, `edge`, `centre`, or `chosen` one by one.
    pub layout: &'static str,
    /// Digital counts of its points.
    pub counts: Vec<u8>,
    /// Lit sub-pixels.
    pub channel: Channel,
    /// The rest.
    pub exposure: PlannedExposure,
    /// Its points.
    pub points: Vec<PatternPoint>,
}

impl<'a> Material<'a> {
    pub(crate) fn new(table: &PointsTable, setup: &'a Setup, light: Light, levels: Levels) -> Self {
        let last =
            table.rows.iter().max_by(|a, b| a.time_s.unwrap_or(0.0).total_cmp(&b.time_s.unwrap_or(0.0)));
        // Tables that were measured one after the other are numbered; else the camera was mounted for each of them.
        let numbered = table.rows.iter().filter_map(|row| row.mounting).fold(0.0, f64::max);
        let files = table.rows.iter().filter(|row| row.mounting.is_none()).map(|row| row.file).max();
        let mounting = match last.and_then(|row| row.mounting) {
            Some(number) => number,
            None if files.unwrap_or(0) == 0 => 0.0,
            None => numbered + 1.0,
        };
        let stride = table.rows.len().div_ceil(MOST_ROWS).max(1);
        let mut thinned = table.clone();
        let keep = |at: usize| at.is_multiple_of(stride);
        let mut at = 0;
        thinned.rows.retain(|_| {
            at += 1;
            keep(at - 1)
        });
        for column in &mut thinned.extra {
            let mut at = 0;
            column.values.retain(|_| {
                at += 1;
                keep(at - 1)
            });
        }
        Self {
            setup,
            light,
            levels,
            stands_for: table.rows.len() as f64 / thinned.rows.len().max(1) as f64,
            thinned,
            start_s: table.rows.iter().filter_map(|row| row.time_s).reduce(f64::max),
            mounting,
            roll_deg: last.and_then(|row| row.camera_roll_deg),
        }
    }

    /// Measured rows of the design table.
    pub(crate) fn measured(&self) -> usize {
        self.thinned.rows.len()
    }

    /// Conditions one after the other.
    pub(crate) fn planned(&self, settings: &[Setting]) -> Vec<Planned> {
        let levels = &self.levels;
        let mut time_s = self.start_s;
        let (mut mounting, mut roll_deg) = (self.mounting, self.roll_deg);
        let mut temperature_c = levels.temperatures_c[0];
        let mut out = Vec::with_capacity(settings.len());
        for (index, setting) in settings.iter().enumerate() {
            let [layout, counts, channel, exposure, roll, temperature, wait] = setting.levels;
            let layout = levels.layouts[layout];
            let (counts, channel) = (levels.counts[counts].clone(), levels.channels[channel]);
            let (roll, temperature) = (levels.rolls_deg[roll], levels.temperatures_c[temperature]);
            if roll.unwrap_or(0.0) != roll_deg.unwrap_or(0.0) {
                mounting += 1.0;
                roll_deg = roll;
            }
            let mut wait_s = levels.waits_s[wait];
            if temperature != temperature_c {
                wait_s = wait_s.map(|wait| wait.max(levels.settle_s));
                temperature_c = temperature;
            }
            time_s = time_s.zip(wait_s).map(|(time, wait)| time + wait);
            let exposure_s = self.light.exposure_s(channel, &counts, levels.exposures[exposure]);
            out.push(Planned {
                layout: layout.name(),
                points: self.points(layout, &counts, roll_deg, setting.seed),
                counts,
                channel,
                exposure: PlannedExposure {
                    image: format!("{index:03}.png"),
                    screen: index,
                    exposure_s,
                    time_s,
                    temperature_c,
                    camera_roll_deg: roll_deg,
                    mounting: Some(mounting),
                },
            });
        }
        out
    }

    fn points(&self, layout: Layout, counts: &[u8], roll_deg: Option<f64>, seed: u64) -> Vec<PatternPoint> {
        let roll_rad = roll_deg.unwrap_or(0.0).to_radians();
        let places = places(self.setup, layout, roll_rad, self.levels.points, seed);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(1);
        let mut order: Vec<usize> = (0..places.len()).collect();
        order.shuffle(&mut random);
        let point = |([column, row], k): (&[u32; 2], usize)| PatternPoint {
            column: *column,
            row: *row,
            digital_count: counts[k % counts.len()],
        };
        places.iter().zip(order).map(point).collect()
    }

    /// Places and counts from which the points of an exposure may be chosen: `times` as many as it has, its own among them.
    pub(crate) fn pool(&self, planned: &Planned, times: usize, seed: u64) -> Vec<PatternPoint> {
        let roll_rad = planned.exposure.camera_roll_deg.unwrap_or(0.0).to_radians();
        let mut out = planned.points.clone();
        for layer in 1..times {
            let seed = seed.wrapping_add(layer as u64);
            let more = places(self.setup, Layout::Even, roll_rad, planned.points.len(), seed);
            let count = |k: usize| planned.counts[(k + layer) % planned.counts.len()];
            out.extend(more.iter().enumerate().map(|(k, [column, row])| PatternPoint {
                column: *column,
                row: *row,
                digital_count: count(k),
            }));
        }
        out.sort_by_key(|point| (point.row, point.column));
        out.dedup_by_key(|point| (point.row, point.column));
        out
    }

    /// Takes for an exposure those points of a pool that tell most, none of which merge; a share of its own stays.
    pub(crate) fn choose(&self, own: &mut Planned, pool: &Planned, told: &[f64]) {
        let wanted = own.points.len();
        let apart_px = APART_PX * self.setup.facility_pinhole().fx_px / self.setup.camera_pinhole().fx_px;
        let mut out: Vec<PatternPoint> = own.points.iter().copied().step_by(KEPT).collect();
        let mut order: Vec<usize> = (0..pool.points.len()).collect();
        order.sort_by(|&a, &b| {
            let of = |k: usize| told.get(k).copied().unwrap_or(0.0);
            of(b).total_cmp(&of(a))
        });
        for k in order {
            if out.len() >= wanted {
                break;
            }
            let point = pool.points[k];
            if out.iter().all(|other| other.screen_px().distance(point.screen_px()) >= apart_px) {
                out.push(point);
            }
        }
        out.sort_by_key(|point| (point.row, point.column));
        own.points = out;
        own.layout = "chosen";
    }

    /// The measured rows, and behind them those of planned exposures with the places where the camera is expected to see
    /// them.
    pub(crate) fn table(&self, planned: &[Planned]) -> PointsTable {
        let mut out = self.thinned.clone();
        let offsets = Offsets::of(&self.thinned, self.setup);
        for exposure in planned {
            let image = out.images.len();
            out.images.push(format!("planned_{image}"));
            for point in &exposure.points {
                let on_row = exposure.points.iter().filter(|other| other.row == point.row).count();
                let [sigma_px, flux_dn] =
                    self.light.seen(exposure.channel, point.digital_count, exposure.exposure.exposure_s);
                let at = point.screen_px();
                out.rows.push(PointRow {
                    channel: exposure.channel,
                    sigma_px,
                    flux_dn,
                    time_s: exposure.exposure.time_s,
                    temperature_c: exposure.exposure.temperature_c,
                    camera_roll_deg: exposure.exposure.camera_roll_deg,
                    mounting: exposure.exposure.mounting,
                    exposure_s: exposure.exposure.exposure_s,
                    row_load: Some(on_row as f64 / f64::from(self.setup.screen.width_px)),
                    ..PointRow::new(
                        image,
                        at,
                        f64::from(point.digital_count),
                        offsets.camera_px(at, exposure.exposure.camera_roll_deg.unwrap_or(0.0).to_radians()),
                    )
                });
            }
        }
        for column in &mut out.extra {
            let mut known: Vec<f64> = column.values.iter().copied().filter(|v| v.is_finite()).collect();
            known.sort_by(f64::total_cmp);
            let middle = known.get(known.len() / 2).copied().unwrap_or(f64::NAN);
            column.values.resize(out.rows.len(), middle);
        }
        out
    }
}

/// Where the camera saw the measured points, beside where a camera without errors would.
struct Offsets<'a> {
    setup: &'a Setup,
    /// Place on the screen, and how far the line of sight is off in the facility's axes.
    known: Vec<(DVec2, DVec2)>,
}

impl<'a> Offsets<'a> {
    fn of(table: &PointsTable, setup: &'a Setup) -> Self {
        let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
        let sights =
            |row: &PointRow| (facility.line_of_sight(row.screen_px), camera.line_of_sight(row.camera_px));
        // Tables count the roll one way or the other about the boresight: the points of each roll tell by how much they
        // are turned.
        let mut turns: Vec<(Option<f64>, f64, f64)> = Vec::new();
        for row in &table.rows {
            let (shown, seen) = sights(row);
            let at = match turns.iter().position(|(roll, ..)| *roll == row.camera_roll_deg) {
                Some(at) => at,
                None => {
                    turns.push((row.camera_roll_deg, 0.0, 0.0));
                    turns.len() - 1
                }
            };
            turns[at].1 += seen.perp_dot(shown);
            turns[at].2 += seen.dot(shown);
        }
        let turn = |roll: Option<f64>| {
            let known = turns.iter().find(|(own, ..)| *own == roll);
            known.map_or(0.0, |(_, cross, along)| cross.atan2(*along))
        };
        let known = table.rows.iter().map(|row| {
            let (shown, seen) = sights(row);
            (row.screen_px, DMat2::from_angle(turn(row.camera_roll_deg)) * seen - shown)
        });
        Self { setup, known: known.collect() }
    }

    /// As far off as the nearest measured point.
    fn camera_px(&self, screen_px: DVec2, roll_rad: f64) -> DVec2 {
        let near = |a: &&(DVec2, DVec2), b: &&(DVec2, DVec2)| {
            a.0.distance_squared(screen_px).total_cmp(&b.0.distance_squared(screen_px))
        };
        let off = self.known.iter().min_by(near).map_or(DVec2::ZERO, |(_, off)| *off);
        let sight = self.setup.facility_pinhole().line_of_sight(screen_px) + off;
        self.setup.camera_pinhole().pixel(DMat2::from_angle(-roll_rad) * sight)
    }
}

/// Screens and exposures of a plan.
pub(crate) fn measurement_plan(planned: &[Planned], setup: &Setup) -> MeasurementPlan {
    let longest = planned.iter().filter_map(|p| p.exposure.exposure_s).fold(0.0, f64::max);
    let screen = |planned: &Planned| PatternScreen {
        file: planned.exposure.image.clone(),
        exposure_ratio: planned.exposure.exposure_s.map_or(1.0, |exposure| exposure / longest),
        channel: planned.channel,
        points: planned.points.clone(),
    };
    MeasurementPlan {
        pattern: Pattern { setup: setup.name.clone(), screens: planned.iter().map(screen).collect() },
        exposures: planned.iter().map(|planned| planned.exposure.clone()).collect(),
    }
}
