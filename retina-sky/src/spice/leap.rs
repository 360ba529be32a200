//! Leap-second kernels: RETINA has the leap seconds itself, so a kernel must say the same.

use retina_files::InputError;

use super::text::{Pool, Value};
use crate::time::{TT_MINUS_TAI_S, days_since_j2000, tai_minus_utc_s};

const TABLE: &str = "DELTET/DELTA_AT";
/// Years for which the two are compared: UTC in its present form, and what bulletins may still add.
const YEARS: std::ops::RangeInclusive<i64> = 1972..=2035;
const MONTHS: [&str; 12] =
    ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"];

/// Refuses leap seconds that are not those of [`crate::time`].
///
/// # Errors
/// They differ, or do not read.
pub(super) fn check(pool: &Pool) -> Result<(), InputError> {
    if let Some(found) = pool.numbers("DELTET/DELTA_T_A", 1..=1)?
        && found[0] != TT_MINUS_TAI_S
    {
        return Err(pool.variables["DELTET/DELTA_T_A"]
            .error("DELTET/DELTA_T_A", "is not TT - TAI")
            .found(format!("{} s", found[0]))
            .expected(format!("{TT_MINUS_TAI_S} s")));
    }
    let Some(variable) = pool.variables.get(TABLE) else { return Ok(()) };
    let misfit = |found: String| {
        variable.error(TABLE, "the table of leap seconds does not read").found(found).expected(
            "pairs of TAI - UTC in seconds and the day from which it holds, such as 10, @1972-JAN-1",
        )
    };
    let mut steps = Vec::new();
    for pair in variable.values.chunks(2) {
        let [Value::Number(offset_s), Value::Date(date)] = pair else {
            return Err(misfit(format!("{pair:?}")));
        };
        steps.push((day(date).ok_or_else(|| misfit(date.clone()))?, *offset_s));
    }
    if !steps.is_sorted_by(|a, b| a.0 < b.0) {
        return Err(misfit("days that do not follow each other".to_owned()));
    }
    // Leap seconds end a month, by preference June or December (ITU-R TF.460).
    for (year, month) in YEARS.flat_map(|year| (1..=12).map(move |month| (year, month))) {
        let first = days_since_j2000(year, month, 1);
        let theirs_s = steps.iter().rev().find(|(day, _)| *day <= first).map(|(_, offset_s)| *offset_s);
        let ours_s = tai_minus_utc_s(first);
        if theirs_s != ours_s {
            let shown = |offset_s: Option<f64>| offset_s.map_or("none".to_owned(), |s| format!("{s} s"));
            return Err(variable
                .error(TABLE, "the leap seconds are not those that RETINA has")
                .found(format!("TAI - UTC of {} on {year}-{month:02}-01", shown(theirs_s)))
                .expected(shown(ours_s))
                .help(
                    "fetch NAIF's latest leap-second kernel; if it is newer than RETINA, RETINA must be updated",
                ));
        }
    }
    Ok(())
}

/// Days after 2000-01-01 of a date such as `1972-JAN-1`.
fn day(date: &str) -> Option<i64> {
    let mut parts = date.split('-');
    let [year, month, day] = [parts.next()?, parts.next()?, parts.next()?];
    let month = 1 + MONTHS.iter().position(|name| name.eq_ignore_ascii_case(month))?;
    let [year, day]: [i64; 2] = [year.parse().ok()?, day.parse().ok()?];
    ((1900..=9999).contains(&year) && (1..=31).contains(&day) && parts.next().is_none())
        .then(|| days_since_j2000(year, month as i64, day))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// naif0012.tls: TAI - UTC and the days from which it holds.
    const NAIF0012: &str = "DELTET/DELTA_T_A = 32.184\nDELTET/K = 1.657D-3\nDELTET/EB = 1.671D-2\n\
        DELTET/M = ( 6.239996D0 1.99096871D-7 )\nDELTET/DELTA_AT = ( 10, @1972-JAN-1\n11, @1972-JUL-1\n\
        12, @1973-JAN-1\n13, @1974-JAN-1\n14, @1975-JAN-1\n15, @1976-JAN-1\n16, @1977-JAN-1\n17, @1978-JAN-1\n\
        18, @1979-JAN-1\n19, @1980-JAN-1\n20, @1981-JUL-1\n21, @1982-JUL-1\n22, @1983-JUL-1\n23, @1985-JUL-1\n\
        24, @1988-JAN-1\n25, @1990-JAN-1\n26, @1991-JAN-1\n27, @1992-JUL-1\n28, @1993-JUL-1\n29, @1994-JUL-1\n\
        30, @1996-JAN-1\n31, @1997-JUL-1\n32, @1999-JAN-1\n33, @2006-JAN-1\n34, @2009-JAN-1\n35, @2012-JUL-1\n\
        36, @2015-JUL-1\n37, @2017-JAN-1 )\n";

    fn checked(data: &str) -> Result<(), String> {
        let mut pool = Pool::default();
        pool.read(Path::new("naif.tls"), format!("\\begindata\n{data}").as_bytes()).unwrap();
        check(&pool).map_err(|error| error.to_string())
    }

    #[test]
    fn the_leap_seconds_of_naif_are_ours_and_others_are_refused() {
        assert_eq!(checked(NAIF0012), Ok(()));
        for (from, to, said) in [
            ("36, @2015-JUL-1\n37, @2017-JAN-1", "36, @2015-JUL-1", "of 36 s on 2017-01-01, expected 37 s"),
            ("37, @2017-JAN-1", "37, @2017-JAN-1 38, @2027-JAN-1", "of 38 s on 2027-01-01, expected 37 s"),
            ("10, @1972-JAN-1\n", "", "TAI - UTC of none on 1972-01-01, expected 10 s"),
            ("32.184", "32.0", "is not TT - TAI (found 32 s, expected 32.184 s"),
            ("@1972-JUL-1", "@1972-XXX-1", "does not read (found 1972-XXX-1"),
            ("12, @1973-JAN-1", "12, @1960-JAN-1", "days that do not follow"),
            ("12, @1973-JAN-1", "12, 13", "does not read"),
        ] {
            assert!(NAIF0012.contains(from));
            let error = checked(&NAIF0012.replace(from, to)).unwrap_err();
            assert!(error.contains(said), "{to}: {error}");
        }
    }
}
