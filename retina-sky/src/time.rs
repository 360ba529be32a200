//! Calendar epochs to and from TDB seconds since J2000 (2000-01-01 12:00:00 TDB).
//!
//! UTC goes by TAI (IERS leap seconds, known through 2017, the last one to date) and TT to TDB;
//! TDB - TT is the geocentric series of Fairhead & Bretagnon (1990) as in SOFA's `dtdb` (a few
//! nanoseconds). One f64 of seconds resolves 0.1 microseconds in this century.

use sofars::ts::{dat, dtdb};
use thiserror::Error;

use crate::DAY_S;

/// Julian date of J2000.
pub(crate) const J2000_JD: f64 = 2_451_545.0;
/// TT - TAI, seconds (by definition).
pub(crate) const TT_MINUS_TAI_S: f64 = 32.184;
/// Years that have four digits; what lies outside has no calendar form here.
const YEARS: std::ops::RangeInclusive<i64> = 0..=9999;

/// An epoch that does not fit.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum EpochError {
    /// The text is not of the ISO 8601 form.
    #[error(
        "`{found}` is not an epoch (expected such as 2027-08-02T10:06:00Z, ... UTC, ...+02:00 or ... TDB)"
    )]
    Syntax {
        /// The text found.
        found: String,
    },
    /// A field is outside its range: the calendar has no such day or time.
    #[error("epoch `{found}`: there is no such {field}")]
    Field {
        /// The text found.
        found: String,
        /// The field's name.
        field: &'static str,
    },
    /// UTC before its seconds were SI seconds.
    #[error("epoch `{found}`: UTC is taken from 1972 on; give earlier epochs in TDB")]
    BeforeUtc {
        /// The text found.
        found: String,
    },
}

/// An epoch in TDB seconds since J2000.
///
/// Takes `YYYY-MM-DD`, then optionally `T` (or a space) and `hh:mm`, `hh:mm:ss` or
/// `hh:mm:ss.fff`, then optionally `Z`, `UTC` or `TDB` (with or without a space before it). After a time
/// of day, `+hh:mm` or `-hh:mm` is the clock's offset from UTC. Without a suffix the scale is TDB. A second
/// of 60 is taken where UTC has a leap second.
///
/// # Errors
/// Another form, a date or time that does not exist, UTC before 1972.
pub fn parse_epoch(text: &str) -> Result<f64, EpochError> {
    let found = || text.to_owned();
    let syntax = || EpochError::Syntax { found: found() };
    let no_such = |field| EpochError::Field { found: found(), field };

    let (stamp, scale) = split_scale(text.trim());
    let (date, clock) = match stamp.find(['T', ' ']) {
        Some(at) => (&stamp[..at], Some(&stamp[at + 1..])),
        None => (stamp, None),
    };
    let [year, month, day] = fields(date, '-', [4, 2, 2]).ok_or_else(syntax)?;
    let (hour, minute, second_s) = match clock {
        None => (0, 0, 0.0),
        Some(clock) => parse_clock(clock).ok_or_else(syntax)?,
    };
    if !(1..=12).contains(&month) {
        return Err(no_such("month"));
    }
    if day < 1 || civil(days_since_j2000(year, month, day)) != (year, month, day) {
        return Err(no_such("day of the month"));
    }
    if hour > 23 {
        return Err(no_such("hour"));
    }
    if minute > 59 {
        return Err(no_such("minute"));
    }
    let days = days_since_j2000(year, month, day);
    let leap_second = || {
        let is_last_minute = scale == (Scale::Utc { ahead_minutes: 0 }) && hour == 23 && minute == 59;
        is_last_minute && tai_minus_utc_s(days + 1) > tai_minus_utc_s(days)
    };
    if second_s >= 60.0 && !(second_s < 61.0 && leap_second()) {
        return Err(no_such("second"));
    }
    // Noon is the origin; the whole part is exact, so that only the last sum rounds.
    let whole_s = (days as f64) * DAY_S + (hour * 3600 + minute * 60) as f64 - 0.5 * DAY_S;
    let Scale::Utc { ahead_minutes } = scale else { return Ok(whole_s + second_s) };
    let whole_s = whole_s - (60 * ahead_minutes) as f64;
    let days = ((whole_s + 0.5 * DAY_S) / DAY_S).floor() as i64;
    let tai_minus_utc_s = tai_minus_utc_s(days).ok_or_else(|| EpochError::BeforeUtc { found: found() })?;
    let tt_s = whole_s + (second_s + tai_minus_utc_s + TT_MINUS_TAI_S);
    // UT enters only the observer's diurnal term, which is nil at the geocentre.
    Ok(tt_s + dtdb(J2000_JD, tt_s / DAY_S, 0.0, 0.0, 0.0, 0.0))
}

/// An epoch as `YYYY-MM-DDThh:mm:ss.ffffff TDB`, to the nearest microsecond; [`parse_epoch`]
/// takes it back. Outside the years 0 to 9999 it is given as seconds since J2000 instead.
pub fn format_epoch_tdb(tdb_s: f64) -> String {
    const MICROS_PER_DAY: i64 = 86_400_000_000;
    // Far beyond the years of four digits, well within what microseconds in an i64 hold.
    if tdb_s.abs() < 1e12 {
        // Whole seconds apart from the fraction, so that the product with 1e6 rounds nothing away.
        let whole_s = tdb_s.floor();
        let micros =
            whole_s as i64 * 1_000_000 + ((tdb_s - whole_s) * 1e6).round() as i64 + MICROS_PER_DAY / 2;
        let (year, month, day) = civil(micros.div_euclid(MICROS_PER_DAY));
        if YEARS.contains(&year) {
            let micros = micros.rem_euclid(MICROS_PER_DAY);
            let (second, micro) = (micros / 1_000_000, micros % 1_000_000);
            let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
            return format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{micro:06} TDB");
        }
    }
    format!("{tdb_s} s TDB since J2000")
}

/// The text without its scale, and the scale.
fn split_scale(text: &str) -> (&str, Scale) {
    let utc = Scale::Utc { ahead_minutes: 0 };
    for (suffix, scale) in [("Z", utc), ("UTC", utc), ("TDB", Scale::Tdb)] {
        if let Some(stamp) = text.strip_suffix(suffix) {
            return (stamp.trim_end(), scale);
        }
    }
    offset(text).unwrap_or((text, Scale::Tdb))
}

/// What an epoch's clock shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scale {
    Tdb,
    /// UTC and so many minutes.
    Utc {
        ahead_minutes: i64,
    },
}

/// What stands before an offset from UTC, and that offset; `None` where there is none after a time of day.
fn offset(text: &str) -> Option<(&str, Scale)> {
    let at = text.rfind(['+', '-'])?;
    let (stamp, offset) = text.split_at(at);
    let [hours, minutes] = fields(&offset[1..], ':', [2, 2])?;
    // ISO 8601 has no zone beyond 14 hours.
    let is_offset = stamp.contains(':') && hours <= 14 && minutes <= 59;
    let sign = if offset.starts_with('-') { -1 } else { 1 };
    is_offset.then_some((stamp.trim_end(), Scale::Utc { ahead_minutes: sign * (60 * hours + minutes) }))
}

/// Hours, minutes and seconds of `hh:mm`, `hh:mm:ss` or `hh:mm:ss.fff`.
fn parse_clock(clock: &str) -> Option<(i64, i64, f64)> {
    let (whole, fraction) = match clock.split_once('.') {
        Some((whole, fraction)) => (whole, Some(fraction)),
        None => (clock, None),
    };
    if let Some([hour, minute, second]) = fields(whole, ':', [2, 2, 2]) {
        let fraction_s = match fraction {
            None => 0.0,
            Some(digits) if !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit()) => {
                format!("0.{digits}").parse::<f64>().ok()?
            }
            Some(_) => return None,
        };
        return Some((hour, minute, second as f64 + fraction_s));
    }
    let [hour, minute] = fields(whole, ':', [2, 2])?;
    fraction.is_none().then_some((hour, minute, 0.0))
}

/// Numbers of a fixed count of digits each, between separators.
fn fields<const N: usize>(text: &str, separator: char, digits: [usize; N]) -> Option<[i64; N]> {
    let mut parts = text.split(separator);
    let mut values = [0; N];
    for (value, digits) in values.iter_mut().zip(digits) {
        let part = parts.next()?;
        if part.len() != digits || !part.bytes().all(|b| b.is_ascii_digit()) {
            return None;
        }
        *value = part.parse().ok()?;
    }
    parts.next().is_none().then_some(values)
}

/// TAI - UTC on the UTC day that begins `days` after 2000-01-01, from 1972 on.
pub(crate) fn tai_minus_utc_s(days: i64) -> Option<f64> {
    let (year, month, day) = civil(days);
    if year < 1972 {
        return None;
    }
    dat(year as i32, month as i32, day as i32, 0.0).ok()
}

/// Days from 2000-01-01 to a date of the proleptic Gregorian calendar (Fliegel & Van Flandern
/// 1968, in March-based years so that the leap day comes last).
pub(crate) fn days_since_j2000(year: i64, month: i64, day: i64) -> i64 {
    let (march_year, march_month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let day_of_year = (153 * march_month + 2) / 5 + day - 1;
    // 2000-03-01 opens a 400-year cycle; 2000-01-01 lies 60 days before it.
    let since_2000 = march_year - 2000;
    365 * since_2000 + since_2000.div_euclid(4) - since_2000.div_euclid(100)
        + since_2000.div_euclid(400)
        + day_of_year
        + 60
}

/// The date that lies `days` after 2000-01-01; the inverse of [`days_since_j2000`].
fn civil(days: i64) -> (i64, i64, i64) {
    const CYCLE_D: i64 = 146_097;
    let since_march = days - 60;
    let cycle = since_march.div_euclid(CYCLE_D);
    let day = since_march.rem_euclid(CYCLE_D);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year + year / 4 - year / 100);
    let march_month = (5 * day_of_year + 2) / 153;
    let day_of_month = day_of_year - (153 * march_month + 2) / 5 + 1;
    let (carry, month) = if march_month < 10 { (0, march_month + 3) } else { (1, march_month - 9) };
    (2000 + 400 * cycle + year + carry, month, day_of_month)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn epochs_with_published_seconds_since_j2000() {
        // CSPICE's str2et; its two-term TDB - TT differs from the full series by up to 30 us.
        for (text, tdb_s, tolerance_s) in [
            ("2000-01-01T12:00:00 TDB", 0.0, 0.0),
            ("2000-01-01 12:00", 0.0, 0.0),
            ("2000-01-01", -43_200.0, 0.0),
            ("2000-01-01T12:00:00Z", 64.183_927_28, 5e-5),
            ("2000-01-01 12:00:00.5 UTC", 64.683_927_28, 5e-5),
            ("2017-01-01T00:00:00Z", 536_500_869.184, 2e-3),
            ("1900-03-01TDB", (-36_524.0 + 59.0 - 0.5) * 86_400.0, 0.0),
        ] {
            assert!((parse_epoch(text).unwrap() - tdb_s).abs() <= tolerance_s, "{text}");
        }
        // The leap second at the end of 2016 is a second of its own.
        let at = |text| parse_epoch(text).unwrap();
        let leap = at("2016-12-31T23:59:60Z");
        assert!((leap - at("2016-12-31T23:59:59Z") - 1.0).abs() < 1e-6);
        for (local, utc) in [
            ("2024-03-01T01:30:00+02:00", "2024-02-29T23:30:00Z"),
            ("2023-12-31 20:15:10.5 -03:45", "2024-01-01T00:00:10.5Z"),
            // The leap second's day has ended east of Greenwich, and has not west of it.
            ("2017-01-01T00:30:00+01:00", "2016-12-31T23:30:00Z"),
        ] {
            assert!((at(local) - at(utc)).abs() < 1e-6, "{local}");
        }
        assert!((at("2017-01-01T00:00:00Z") - leap - 1.0).abs() < 1e-6);
    }

    #[test]
    fn what_is_no_epoch_is_refused() {
        for text in [
            "",
            "now",
            "2026-8-12",
            "2026-08-12T17",
            "2026-08-12T1:2:3",
            "2026-08-12T17:37.5",
            "2026-08-12T17:37:00.",
            "12026-08-12",
            "2026-08-12TT17:37",
            "é",
            "2026-08-12+02:00",
            "2026-08-12T17:37+2:00",
            "2026-08-12T17:37+25:00",
        ] {
            assert!(matches!(parse_epoch(text), Err(EpochError::Syntax { .. })), "{text}");
        }
        for (text, expected) in [
            ("2026-13-01", "month"),
            ("2026-02-29", "day of the month"),
            ("1900-02-29", "day of the month"),
            ("2026-04-31", "day of the month"),
            ("2026-04-00", "day of the month"),
            ("2026-01-01T24:00", "hour"),
            ("2026-01-01T00:60", "minute"),
            ("2026-01-01T00:00:60", "second"),
            ("2026-12-31T23:59:60Z", "second"),
            ("2016-12-31T23:59:60 TDB", "second"),
        ] {
            assert!(
                matches!(parse_epoch(text), Err(EpochError::Field { field, .. }) if field == expected),
                "{text}"
            );
        }
        assert!(matches!(parse_epoch("1971-12-31Z"), Err(EpochError::BeforeUtc { .. })));
    }

    #[test]
    fn epochs_are_written_as_they_are_read() {
        assert_eq!(format_epoch_tdb(0.0), "2000-01-01T12:00:00.000000 TDB");
        assert_eq!(format_epoch_tdb(-43_200.000_001), "1999-12-31T23:59:59.999999 TDB");
        assert_eq!(format_epoch_tdb(59.999_999_9), "2000-01-01T12:01:00.000000 TDB");
        assert_eq!(format_epoch_tdb(1e300), format!("{} s TDB since J2000", 1e300));
        assert!(format_epoch_tdb(f64::NAN).contains("NaN"));
    }

    proptest! {
        #[test]
        fn any_epoch_comes_back_within_a_microsecond(tdb_s in -6e10_f64..2e11) {
            let back = parse_epoch(&format_epoch_tdb(tdb_s)).unwrap();
            prop_assert!((back - tdb_s).abs() <= 1e-6_f64.max(tdb_s.abs() * 2e-16));
        }

        #[test]
        fn any_text_is_taken_or_refused(text in "\\PC*") {
            let _ = parse_epoch(&text);
        }
    }
}
