//! Spacecraft clocks: what CK kernels count time in (NAIF, SCLK Required Reading, type 1).

use retina_files::InputError;

use super::text::Pool;

/// Numbers of a line of a clock's coefficients: ticks, parallel time in seconds, seconds a count of the leading field.
const LINE: usize = 3;

/// The time that a clock's coefficients are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Parallel {
    Tdb,
    Tt,
}

/// A spacecraft's clock.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Clock {
    parallel: Parallel,
    /// Ticks of a count of the leading field.
    ticks_a_count: f64,
    /// Ticks, parallel time in seconds since J2000, and seconds a count from there on.
    lines: Vec<[f64; LINE]>,
}

/// The clock of this number, negative as its spacecraft's; `None` where no kernel has it.
///
/// # Errors
/// Its kernel is not complete, or of a kind that is not read.
pub(super) fn clock(pool: &Pool, number: i32) -> Result<Option<Clock>, InputError> {
    let own = number.unsigned_abs();
    let name = |item: &str| format!("{item}_{own}");
    let coefficients = name("SCLK01_COEFFICIENTS");
    let Some(variable) = pool.variables.get(&coefficients) else { return Ok(None) };
    let flaw = |item: &str, problem: &str| pool.variables.get(item).unwrap_or(variable).error(item, problem);
    let kind = name("SCLK_DATA_TYPE");
    if pool.integer(&kind)?.is_some_and(|kind| kind != 1) {
        return Err(flaw(&kind, "clocks of this type are not read").expected("1"));
    }
    let system = name("SCLK01_TIME_SYSTEM");
    let parallel = match pool.integer(&system)? {
        None | Some(1) => Parallel::Tdb,
        Some(2) => Parallel::Tt,
        Some(other) => {
            return Err(flaw(&system, "the time system is not read")
                .found(other)
                .expected("1 (TDB) or 2 (TDT)"));
        }
    };
    let moduli = name("SCLK01_MODULI");
    let Some(fields) = pool.numbers(&moduli, 1..=10)? else {
        return Err(flaw(&coefficients, "the clock is not complete").found(format!("no {moduli}")));
    };
    if let Some(field) = fields.iter().find(|&&field| field < 1.0) {
        return Err(flaw(&moduli, "a field has no counts").found(field).expected("1 or more"));
    }
    let numbers = pool.numbers(&coefficients, LINE..=usize::MAX)?.unwrap_or_default();
    let (lines, rest) = numbers.as_chunks::<LINE>();
    let rises = |pair: &[[f64; LINE]]| pair[1][0] > pair[0][0] && pair[1][1] >= pair[0][1];
    if !rest.is_empty() || lines.iter().any(|line| line[2] <= 0.0) || !lines.windows(2).all(rises) {
        return Err(flaw(&coefficients, "the clock's coefficients do not read").expected(
            "ticks, seconds and seconds a count, line by line, with rising ticks and seconds and rates above 0",
        ));
    }
    Ok(Some(Clock { parallel, ticks_a_count: fields[1..].iter().product(), lines: lines.to_vec() }))
}

impl Clock {
    /// Ticks since the clock's start at an epoch, TDB seconds since J2000. Before the first line and after the last, its
    /// rate goes on.
    pub(super) fn ticks(&self, tdb_s: f64) -> f64 {
        let time_s = match self.parallel {
            Parallel::Tdb => tdb_s,
            Parallel::Tt => tdb_s - tdb_minus_tt_s(tdb_s),
        };
        let line = self.lines.partition_point(|line| line[1] <= time_s).saturating_sub(1);
        let [ticks, from_s, seconds_a_count] = self.lines[line];
        ticks + (time_s - from_s) / seconds_a_count * self.ticks_a_count
    }

    /// The epoch of so many ticks, TDB seconds since J2000: [`Clock::ticks`] the other way round.
    pub(super) fn tdb_s(&self, ticks: f64) -> f64 {
        let line = self.lines.partition_point(|line| line[0] <= ticks).saturating_sub(1);
        let [from_ticks, from_s, seconds_a_count] = self.lines[line];
        let time_s = from_s + (ticks - from_ticks) / self.ticks_a_count * seconds_a_count;
        match self.parallel {
            Parallel::Tdb => time_s,
            Parallel::Tt => time_s + tdb_minus_tt_s(time_s),
        }
    }

    /// Ticks of a second.
    pub(super) fn ticks_a_second(&self) -> f64 {
        self.lines.last().map_or(1.0, |line| self.ticks_a_count / line[2])
    }
}

/// TDB less TT as SPICE takes it, s: K sin E with E = M + e sin M (NAIF, naif0012.tls). Clocks are told by it.
fn tdb_minus_tt_s(tt_s: f64) -> f64 {
    let mean_rad = 6.239_996 + 1.990_968_71e-7 * tt_s;
    1.657e-3 * (mean_rad + 1.671e-2 * mean_rad.sin()).sin()
}
