//! What an exposure may be like: its counts, channel, exposure time, roll, temperature, and how long one waits for it.

use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use retina_files::{InputError, nearest};
use retina_formats::{Channel, PointRow, PointsTable};

use crate::light::Light;
use crate::places::Layout;

/// A condition that a plan may change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Factor {
    /// Where the points are.
    Places,
    /// Their digital counts.
    Counts,
    /// The lit sub-pixels.
    Channel,
    /// The exposure time beside what the counts ask for.
    Exposure,
    /// The roll of the camera in its mount.
    Roll,
    /// The temperature.
    Temperature,
    /// The time that one waits before an exposure.
    Wait,
}

impl Factor {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Places,
        Self::Counts,
        Self::Channel,
        Self::Exposure,
        Self::Roll,
        Self::Temperature,
        Self::Wait,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        ["places", "counts", "channel", "exposure", "roll", "temperature", "wait"][self as usize]
    }

    /// From its name.
    ///
    /// # Errors
    /// There is none of that name.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        let names = Self::ALL.map(Self::name);
        Self::ALL.into_iter().find(|factor| factor.name() == text).ok_or_else(|| {
            let error = InputError::new("--hold", "is no condition that a plan may change")
                .found(format!("`{text}`"))
                .expected(names.join(", "));
            match nearest(text, names) {
                Some(near) => error.help(format!("did you mean `{near}`?")),
                None => error,
            }
        })
    }
}

/// What a plan may change, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Freedom {
    /// Conditions that stay as they are.
    pub held: Vec<Factor>,
    /// Lowest and highest temperature, degrees Celsius; those of the table where absent.
    pub temperature_c: Option<[f64; 2]>,
    /// Least wait after a change of the temperature, s.
    pub settle_s: f64,
    /// Points in an exposure; as many as the table has where absent.
    pub points: Option<usize>,
}

impl Default for Freedom {
    fn default() -> Self {
        Self { held: Vec::new(), temperature_c: None, settle_s: 1800.0, points: None }
    }
}

/// The values from which conditions are chosen. The first of each is how it was last.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Levels {
    pub(crate) layouts: Vec<Layout>,
    pub(crate) counts: Vec<Vec<u8>>,
    pub(crate) channels: Vec<Channel>,
    /// Of the exposure time that suits the counts.
    pub(crate) exposures: Vec<f64>,
    pub(crate) rolls_deg: Vec<Option<f64>>,
    pub(crate) temperatures_c: Vec<Option<f64>>,
    pub(crate) waits_s: Vec<Option<f64>>,
    pub(crate) settle_s: f64,
    pub(crate) points: usize,
}

/// The conditions of one exposure: which of the levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Setting {
    pub(crate) levels: [usize; 7],
    /// Of the places and of the order of counts.
    pub(crate) seed: u64,
}

/// Single counts among which one is chosen.
const MOST_COUNTS: usize = 5;
/// Most light over least that one exposure holds.
const HOLDS: f64 = 25.0;
/// Temperatures this near are the same, K.
const SAME_C: f64 = 0.3;

impl Levels {
    pub(crate) fn of(table: &PointsTable, light: &Light, freedom: &Freedom) -> Result<Self, InputError> {
        let usable: Vec<&PointRow> = table.rows.iter().filter(|row| !row.saturated).collect();
        let last = usable
            .iter()
            .copied()
            .max_by(|a, b| a.time_s.unwrap_or(0.0).total_cmp(&b.time_s.unwrap_or(0.0)))
            .ok_or_else(|| InputError::new("--data", "holds no usable points"))?;
        let free = |factor: Factor| !freedom.held.contains(&factor);
        let mut out = Self {
            layouts: vec![Layout::Even],
            counts: light.counts_alike(last.channel, HOLDS),
            channels: vec![last.channel],
            exposures: vec![1.0],
            rolls_deg: vec![last.camera_roll_deg],
            temperatures_c: vec![last.temperature_c],
            waits_s: vec![interval_s(table)],
            settle_s: freedom.settle_s,
            points: freedom.points.unwrap_or(usable.len() / exposures(table).max(1)).max(3),
        };
        if free(Factor::Places) {
            out.layouts.extend([Layout::Edge, Layout::Centre]);
        }
        if free(Factor::Counts) {
            out.counts.extend(light.single_counts(MOST_COUNTS).into_iter().map(|count| vec![count]));
        }
        if free(Factor::Channel) {
            let others = Channel::ALL.into_iter().filter(|own| usable.iter().any(|row| row.channel == *own));
            out.channels.extend(others.filter(|own| *own != last.channel));
        }
        if free(Factor::Exposure) && last.exposure_s.is_some() {
            out.exposures.push(0.25);
        }
        if free(Factor::Roll) {
            let now = last.camera_roll_deg.unwrap_or(0.0);
            out.rolls_deg.extend([90.0, 180.0].map(|turn| Some((now + turn) % 360.0)));
        }
        if free(Factor::Temperature) {
            out.temperatures_c.extend(temperatures(&usable, last.temperature_c, freedom)?);
        } else if freedom.temperature_c.is_some() {
            return Err(InputError::new("--temperature-c", "is given, and --hold temperature too")
                .help("leave out one of the two"));
        }
        if free(Factor::Wait) {
            out.waits_s.extend(out.waits_s[0].map(|wait| Some(10.0 * wait)));
        }
        Ok(out)
    }

    fn sizes(&self) -> [usize; 7] {
        [
            self.layouts.len(),
            self.counts.len(),
            self.channels.len(),
            self.exposures.len(),
            self.rolls_deg.len(),
            self.temperatures_c.len(),
            self.waits_s.len(),
        ]
    }

    /// Any conditions.
    pub(crate) fn any(&self, random: &mut ChaCha8Rng) -> Setting {
        Setting { levels: self.sizes().map(|size| random.random_range(0..size)), seed: random.random() }
    }

    /// Conditions that differ in one thing.
    pub(crate) fn another(&self, setting: &Setting, random: &mut ChaCha8Rng) -> Setting {
        let mut out = *setting;
        let sizes = self.sizes();
        let free: Vec<usize> = (0..sizes.len()).filter(|&k| sizes[k] > 1).collect();
        if free.is_empty() {
            out.seed = random.random();
            return out;
        }
        let factor = free[random.random_range(0..free.len())];
        out.levels[factor] = (out.levels[factor] + random.random_range(1..sizes[factor])) % sizes[factor];
        out
    }

    /// How far conditions are from each other: in how many things they differ.
    pub(crate) fn distance(a: &Setting, b: &Setting) -> usize {
        a.levels.iter().zip(&b.levels).filter(|(a, b)| a != b).count()
    }
}

/// Lowest, middle and highest, without the one that is there.
fn temperatures(
    rows: &[&PointRow],
    now: Option<f64>,
    freedom: &Freedom,
) -> Result<Vec<Option<f64>>, InputError> {
    let Some(now) = now else {
        return match freedom.temperature_c {
            None => Ok(Vec::new()),
            Some(_) => Err(InputError::new("--temperature-c", "is given for a table without temperatures")
                .help("add the column temperature_c, or leave the option out")),
        };
    };
    let all = || rows.iter().filter_map(|row| row.temperature_c);
    let [low, high] = freedom
        .temperature_c
        .unwrap_or_else(|| [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)]);
    let levels = [low, 0.5 * (low + high), high].into_iter();
    // As one would set it.
    let levels = levels.map(|level| (20.0 * level).round() / 20.0);
    Ok(levels.filter(|level| (level - now).abs() > SAME_C).map(Some).collect())
}

fn exposures(table: &PointsTable) -> usize {
    let mut images: Vec<usize> = table.rows.iter().map(|row| row.image).collect();
    images.sort_unstable();
    images.dedup();
    images.len()
}

/// Median time between exposures, s.
fn interval_s(table: &PointsTable) -> Option<f64> {
    let mut times: Vec<f64> = table.rows.iter().filter_map(|row| row.time_s).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied()
}
