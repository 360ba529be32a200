//! Tables that do not fit are refused with file, place, what was found and what was expected.

#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use std::path::PathBuf;

use common::{TRUTH, Truth, fit, plan, readings};
use retina_files::InputError;
use retina_response::{ChannelResponse, PowerReadings, Reading};

fn read(text: &str) -> Result<PowerReadings, InputError> {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("power.csv");
    std::fs::write(&path, text).unwrap();
    PowerReadings::read(&[path])
}

const HEADER: &str = "channel,digital_count,square_px,irradiance_w_m2\n";

/// Rows of five counts for each of these channels.
fn rows(channels: &str) -> String {
    let each =
        |c: char| (1..=5).map(move |k| format!("{c},{},100,{}e-6\n", 50 * k, k * k)).collect::<String>();
    channels.chars().map(each).collect()
}

fn refused<T>(result: Result<T, InputError>, texts: &[&str]) {
    let error = result.err().expect("it is refused");
    let all = format!("{error}; {}", error.help.clone().unwrap_or_default());
    for text in texts {
        assert!(all.contains(text), "`{text}` is not in: {all}");
    }
}

#[test]
fn cells_that_do_not_fit() {
    let with = |row: &str| read(&format!("{HEADER}{}{row}\n", rows("rgb")));
    assert!(with("w,255,100,1e-5").is_ok());
    refused(
        with("x,255,100,1e-5"),
        &["power.csv, line 17, column `channel`", "found `x`", "`w` for all three"],
    );
    refused(with("r,256,100,1e-5"), &["line 17, column `digital_count`", "found 256", "0 to 255"]);
    refused(with("r,1.5,100,1e-5"), &["column `digital_count`", "found 1.5", "each other's places"]);
    refused(with("r,255,-1,1e-5"), &["column `square_px`", "found -1"]);
    // The irradiance column holds counts, the count column irradiances.
    refused(with("r,2.1e-6,100,200"), &["column `digital_count`", "each other's places"]);
    refused(
        with("r,20,100,200"),
        &["column `irradiance_w_m2`", "found 200", "not a digital count, milliwatts or microwatts"],
    );
    refused(with("r,255,100,"), &["line 17, column `irradiance_w_m2`", "the cell is empty"]);
    let stated = "channel,digital_count,square_px,irradiance_w_m2,sigma_w_m2\nr,255,100,1e-5,0\n";
    refused(read(stated), &["column `sigma_w_m2`", "found 0", "above 0"]);
    refused(read("channel,count,square_px,irradiance_w_m2\n"), &["column `digital_count` is missing"]);
}

#[test]
fn a_channel_that_is_missing_and_too_few_counts() {
    refused(read(&format!("{HEADER}{}", rows("rg"))), &["no reading of the blue channel", "rows with `b`"]);
    let few = "b,10,100,1e-7\nb,10,100,1e-7\nb,90,100,1e-6\nb,200,100,2e-6\nb,255,100,3e-6\nb,0,100,1e-9\n";
    refused(
        read(&format!("{HEADER}{}{few}", rows("rg"))),
        &["blue channel was measured at too few counts", "4 different counts above 0", "at least 5"],
    );
}

fn drawn() -> Vec<Reading> {
    readings(&TRUTH, &plan(), 2, true)
}

fn first_at(drawn: &[Reading], count: usize) -> usize {
    drawn.iter().position(|r| r.count == count && r.square_px > 0.0).unwrap()
}

#[test]
fn light_in_the_dark_and_negative_light() {
    let mut lit = drawn();
    lit[3].irradiance_w_m2 = 2e-4;
    refused(
        fit(&lit),
        &["line 5, column `irradiance_w_m2`", "dark reading (square_px 0) shows light", "2e-4"],
    );
    let mut negative = drawn();
    let at = first_at(&negative, 255);
    negative[at].irradiance_w_m2 *= -1.0;
    let line = format!("line {}", negative[at].place.1);
    refused(fit(&negative), &[&line, "negative beyond its noise", "sigma below the zero"]);
    let mut all = drawn();
    all.iter_mut().for_each(|r| r.irradiance_w_m2 *= -1.0);
    refused(fit(&all), &["the green channel shows no light where it is brightest"]);
    // A faint reading that noise has made a little negative is no fault.
    let noisy = Truth { zero_w_m2: 0.0, floor_w_m2: 2e-6, ..TRUTH };
    let faint = readings(&noisy, &plan(), 2, true);
    assert!(faint.iter().any(|r| r.square_px > 0.0 && r.irradiance_w_m2 < 0.0));
    assert!(fit(&faint).is_ok());
}

fn dip(counts: std::ops::RangeInclusive<usize>, factor: f64) -> Result<ChannelResponse, InputError> {
    let mut dipped = drawn();
    let zero = TRUTH.zero_w_m2;
    for reading in dipped.iter_mut().filter(|r| r.square_px > 0.0 && counts.contains(&r.count)) {
        reading.irradiance_w_m2 = zero + factor * (reading.irradiance_w_m2 - zero);
    }
    fit(&dipped)
}

/// Counts 114, 123 and 133 at 0.7 of their light (repeats agree) are below 104: (114 / 104)^2.2 x 0.7 = 0.86.
#[test]
fn a_response_that_falls() {
    refused(
        dip(110..=140, 0.7),
        &[
            "the green channel's response falls where the count rises",
            "at count 104",
            "at count 114",
            "sigma",
            "rises with the count",
        ],
    );
    // All readings of one count agree: no outlier. 0.75 (123 / 114)^2.2 = 0.89.
    refused(dip(123..=123, 0.75), &["falls", "at count 123"]);
    let mut backwards = drawn();
    backwards.iter_mut().filter(|r| r.square_px > 0.0).for_each(|r| {
        r.square_px = 100.0;
        r.irradiance_w_m2 = 1e4 * TRUTH.pixel_w_m2(255 - r.count) + TRUTH.zero_w_m2;
    });
    assert!(fit(&backwards).is_err());
    // A dip that does not reach below the next lower count is a departure, not a fall.
    assert!(dip(123..=123, 0.97).is_ok());
}
