//! Power and phase tables, and a user's formula.

mod common;

use std::fmt::Write as _;

use common::{ARCSEC, Campaign, dataset, setup};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use retina_diagnosis::{
    AddedEffect, Baseline, Dataset, DiagnoseOptions, OwnEffect, OwnParameter, Source, Verdict, diagnose, fit,
};
use retina_formats::{Measurements, RadiometricCalibration};
use retina_response::{Calibrated, PowerReadings};

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

/// Readings of lit squares: an effect is what the meter shows for true relative light and its setting.
fn power(seed: u64, meter: &dyn Fn(f64, f64, f64, &str) -> f64) -> String {
    power_above(seed, 0.0, meter)
}

/// The same by a meter with so much noise in the dark, relative light.
fn power_above(seed: u64, floor: f64, meter: &dyn Fn(f64, f64, f64, &str) -> f64) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut text = String::from("channel,digital_count,square_px,irradiance_w_m2,series\n");
    for series in 0..24 {
        for channel in ["r", "g", "b", "w"] {
            for count in [24.0f64, 48.0, 96.0, 160.0, 255.0] {
                let side = [20.0, 60.0, 100.0, 200.0][(series + count as usize) % 4];
                let share = if channel == "w" { 1.0 } else { 1.0 / 3.0 };
                let light = side * side * share * (count / 255.0).powf(2.2);
                let shown = meter(light, side, count, channel) * (1.0 + 0.004 * normal(&mut random));
                let dark = if floor > 0.0 { floor * normal(&mut random) } else { 0.0 };
                let value = (shown + dark) * 2.1e-9;
                let _ = writeln!(text, "{channel},{count},{side},{value:e},s{series}");
            }
        }
    }
    text
}

/// Laws of a display and a meter, not their first orders.
#[test]
fn effects_on_power_are_named_or_in_the_set() {
    type Meter = fn(f64, f64, f64, &str) -> f64;
    let cases: [(&str, Meter); 6] = [
        ("gamma", |light, _, count, _| light * (count / 255.0f64).powf(0.06)),
        ("meter_zero", |light, _, _, _| light + 0.02),
        ("meter_nonlinearity", |light, _, _, _| light / (1.0 - light / 2e6)),
        ("channel_nonadditivity", |light, _, _, channel| light * if channel == "w" { 0.985 } else { 1.0 }),
        ("meter_wavelength", |light, _, _, channel| {
            // White is a third of each.
            light * [("b", 1.03), ("w", 1.01)].iter().find(|(c, _)| *c == channel).map_or(1.0, |(_, f)| *f)
        }),
        ("black_level", |light, side, _, _| light + 6e-5 * side * side),
    ];
    let setup = setup();
    for (id, meter) in cases {
        let data = dataset(&setup, &power(5, &meter));
        let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
        println!(
            "{id:22} {} {:?} {:?} {:?}",
            found.verdict.name(),
            found.accepted,
            found.indistinguishable,
            found.unexplained
        );
        assert!(found.indistinguishable.contains(&id), "{id}: {:?} {:?}", found.accepted, found.unexplained);
    }
    let data = dataset(&setup, &power(6, &|light, _, _, _| light));
    assert_eq!(diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 }).verdict, Verdict::Adequate);
}

/// An exponent is one of a power beside a gain, which no sum of logarithms is.
/// A gain that follows the humidity, in a table that also has a time: no drift of the display or the meter.
#[test]
fn a_gain_that_follows_the_humidity_is_no_drift() {
    let humidity = |series: usize| 45.0 + 2.0 * (0.5 * series as f64).sin() + series as f64;
    let mut text = String::new();
    for (row, line) in power(31, &|light, _, _, _| light).lines().enumerate() {
        if row == 0 {
            writeln!(text, "{line},time_s,humidity_pct").unwrap();
            continue;
        }
        let series = (row - 1) / 20;
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        let value: f64 = cells[3].parse().unwrap();
        cells[3] = format!("{:e}", value * (1.0 + 0.005 * (humidity(series) - 45.0)));
        writeln!(text, "{},{},{}", cells.join(","), 600 * series, humidity(series)).unwrap();
    }
    let found = diagnose(&dataset(&setup(), &text), &[], &DiagnoseOptions { flips: 999, seed: 1 });
    assert_eq!((found.verdict, found.accepted.len()), (Verdict::Unknown, 0), "{:?}", found.accepted);
    assert!(found.unexplained.covariates.contains(&"humidity_pct".to_owned()), "{:?}", found.unexplained);
}

#[test]
fn a_strong_exponent_is_right_within_its_sigma() {
    let setup = setup();
    for exponent in [-0.2, 0.1, 0.2] {
        let data =
            dataset(&setup, &power(21, &|light, _, count, _| light * (count / 255.0f64).powf(exponent)));
        let fitted = fit(&data, &[AddedEffect::read("gamma", &data).unwrap()]).unwrap();
        let own = fitted.parameters.iter().find(|p| p.name == "gamma.exponent").unwrap();
        let found = diagnose(&data, &[], &DiagnoseOptions { flips: 499, seed: 1 });
        assert_eq!((found.verdict, found.accepted), (Verdict::Named, vec!["gamma"]));
        let physical = found.physical[0].as_ref().unwrap();
        for (value, sigma) in [(own.value, own.sigma.unwrap()), (physical.value, physical.sigma)] {
            let off = (value - exponent).abs() / sigma;
            assert!(off < 3.5 && sigma < 1e-3, "{exponent}: {value} +- {sigma}");
        }
    }
}

/// The meter's noise in the dark is ten times the dimmest reading, and a 6000th of the brightest. Dim readings are no
/// outliers, and effects are found as by a meter without that noise.
#[test]
fn readings_below_the_meters_noise_are_no_outliers() {
    let setup = setup();
    let found = |seed: u64, meter: &dyn Fn(f64, f64, f64, &str) -> f64| {
        let data = dataset(&setup, &power_above(seed, 7.0, meter));
        let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
        println!("{} {:?} {}", found.verdict.name(), found.accepted, found.outliers);
        found
    };
    for seed in 0..6 {
        let null = found(seed, &|light, _, _, _| light);
        assert_eq!(null.verdict, Verdict::Adequate, "seed {seed}");
        // Of 480 normal errors none is beyond 4.5 sigma.
        assert!(null.outliers <= 2, "{}", null.outliers);
    }
    let gamma = found(9, &|light, _, count, _| light * (count / 255.0f64).powf(0.06));
    assert!(gamma.indistinguishable.contains(&"gamma") && gamma.accepted.len() == 1);
    let zero = found(9, &|light, _, _, _| light + 5.0);
    assert!(zero.indistinguishable.contains(&"meter_zero") && zero.accepted.len() == 1);
}

/// White light reads 4 % less than the sum of the channels, ten times the noise: all of its readings are far from what the
/// others say, and yet they are the effect, also where they are few.
#[test]
fn a_channel_that_is_far_off_is_no_accident() {
    let setup = setup();
    let all = power(7, &|light, _, _, channel| light * if channel == "w" { 0.96 } else { 1.0 });
    for keep in [1, 6] {
        let mut white = 0;
        let mut kept = |line: &&str| {
            white += usize::from(line.starts_with("w,"));
            !line.starts_with("w,") || white % keep == 0
        };
        let lines: Vec<&str> = all.lines().filter(&mut kept).collect();
        let data = dataset(&setup, &lines.join("\n"));
        let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
        println!("{} of {}: {:?} {}", lines.len(), data.len(), found.accepted, found.outliers);
        assert_eq!(found.verdict, Verdict::Named, "{:?}", found.unexplained);
        assert_eq!(found.accepted, ["channel_nonadditivity"]);
        assert!(found.outliers <= 2, "{}", found.outliers);
    }
}

/// Allen's law of the Moon, V = -12.73 + 0.026 |a| + 4e-9 a^4 (deg), is no Lambert sphere: a phase function is missing.
#[test]
fn the_moons_phase_law_is_a_phase_function() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut text = String::from("phase_deg,magnitude,night\n");
    for night in 0..60 {
        for _ in 0..5 {
            let a = -118.0 + 4.0 * f64::from(night) + normal(&mut random);
            let v = -12.73 + 0.026 * a.abs() + 4e-9 * a.powi(4) + 0.03 * normal(&mut random);
            let _ = writeln!(text, "{a:.3},{v:.4},n{night}");
        }
    }
    let data = dataset(&setup(), &text);
    let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
    println!(
        "{} {:?} {:?} {:?}",
        found.verdict.name(),
        found.accepted,
        found.indistinguishable,
        found.unexplained
    );
    assert_eq!(found.accepted.first(), Some(&"phase_function"));
    // The ladder ends near the noise that was put on.
    assert!(found.steps.last().unwrap().heldout_rms < 0.04, "{:?}", found.steps);
}

/// Parameters of a formula come back within their standard deviations, and errors point at the character.
#[test]
fn a_formula_is_fitted() {
    let setup = setup();
    let data =
        Campaign::new(9).data(&setup, &|p| p.r * (1.0 + 12.0 * ARCSEC / 0.1413 * (-p.time_s / 900.0).exp()));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settling.toml");
    let text = |dx: &str| {
        format!(
            "name = \"settling\"\nunit = \"arcsec\"\ndx = \"{dx}\"\ndy = \"a * y * exp(-time_s / tau)\"\n[parameters]\na = {{ start = 3.0, unit = \"arcsec\" }}\ntau = {{ start = 500.0, unit = \"s\" }}\n"
        )
    };
    std::fs::write(&path, text("a * x * exp(-time_s / tau)")).unwrap();
    let effect = AddedEffect::read(path.to_str().unwrap(), &data).unwrap();
    let result = fit(&data, &[effect]).unwrap();
    for (name, truth) in [("settling.a", 12.0), ("settling.tau", 900.0)] {
        let p = result.parameters.iter().find(|p| p.name == name).unwrap();
        let sigma = p.sigma.unwrap();
        println!("{name} {} +- {sigma}", p.value);
        // Half the camera's width is 0.1413 to four digits; 4 sigma is once in 16 000.
        assert!((p.value - truth).abs() < 4.0 * sigma && sigma < 0.1 * truth, "{name} {} {sigma}", p.value);
    }
    std::fs::write(&path, text("a * xs")).unwrap();
    let error = AddedEffect::read(path.to_str().unwrap(), &data).err().unwrap();
    let snippet = error.snippet.clone().unwrap();
    assert_eq!(&snippet.text[snippet.offset..snippet.offset + snippet.length], "xs");
    assert!(error.to_string().contains("line 3, column 11"), "{error}");
    std::fs::write(&path, text("a * x + 0 * a / (x - x)")).unwrap();
    let effect = AddedEffect::read(path.to_str().unwrap(), &data).unwrap();
    assert!(fit(&data, &[effect]).err().unwrap().to_string().contains("not finite"));
}

/// The same effect as a formula and in Rust, whose derivatives are differences, comes out alike.
#[test]
fn an_effect_in_rust_is_fitted_as_its_formula_is() {
    struct Settling(Vec<OwnParameter>, &'static str);
    impl OwnEffect for Settling {
        fn name(&self) -> &str {
            "settling"
        }
        fn parameters(&self) -> &[OwnParameter] {
            &self.0
        }
        fn columns(&self) -> Vec<&str> {
            vec!["x", "y", self.1]
        }
        fn value(&self, columns: &[f64], p: &[f64]) -> [f64; 2] {
            let grown = p[0] * (-columns[2] / p[1]).exp();
            [grown * columns[0], grown * columns[1]]
        }
    }
    let data = Campaign::new(9)
        .data(&setup(), &|p| p.r * (1.0 + 12.0 * ARCSEC / 0.1413 * (-p.time_s / 900.0).exp()));
    let of = |name: &str, start| OwnParameter { name: name.into(), start, unit: String::new() };
    let parameters = vec![of("a", 3.0), of("tau", 500.0)];
    let own = AddedEffect::own(Settling(parameters.clone(), "time_s"), &data).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settling.toml");
    let text = "name = \"settling\"\nunit = \"arcsec\"\ndx = \"a * x * exp(-time_s / tau)\"\ndy = \"a * y * exp(-time_s / tau)\"\n[parameters]\na = { start = 3.0, unit = \"arcsec\" }\ntau = { start = 500.0, unit = \"s\" }\n";
    std::fs::write(&path, text).unwrap();
    let file = AddedEffect::read(path.to_str().unwrap(), &data).unwrap();
    let (own, file) = (fit(&data, &[own]).unwrap(), fit(&data, &[file]).unwrap());
    for (a, b) in own.parameters.iter().zip(&file.parameters) {
        let sigma = b.sigma.unwrap();
        assert!(a.name == b.name && (a.value - b.value).abs() < 1e-3 * sigma, "{a:?} {b:?}");
    }
    let refused = AddedEffect::own(Settling(parameters, "humidity"), &data).err().unwrap();
    assert!(refused.to_string().contains("humidity"), "{refused}");
    // Arcsec times seconds are no arcsec.
    std::fs::write(&path, text.replace("exp(-time_s / tau)", "time_s")).unwrap();
    let refused = AddedEffect::read(path.to_str().unwrap(), &data).err().unwrap();
    assert!(refused.to_string().contains("the formula gives arcsec s"), "{refused}");
    // A step's place has no slope, and that is said.
    let text = text.replace("exp(-time_s / tau)", "step(time_s - tau)");
    std::fs::write(&path, text).unwrap();
    let effect = AddedEffect::read(path.to_str().unwrap(), &data).unwrap();
    let refused = fit(&data, &[effect]).err().unwrap().to_string();
    assert!(refused.contains("nothing changes with parameter `tau`"), "{refused}");
}

/// A series that carries another's label is found by diagnosis and by fit alike.
#[test]
fn the_fit_finds_the_series_that_is_off() {
    let readings = power(5, &|light, _, _, _| light);
    let mut text = String::new();
    for line in readings.lines() {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if cells[4] == "s7" {
            cells[3] = format!("{:e}", cells[3].parse::<f64>().unwrap() * 3.0);
        }
        text.push_str(&(cells.join(",") + "\n"));
    }
    let data = dataset(&setup(), &text);
    let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
    assert_eq!(found.accepted, ["attenuator_not_changed"], "{:?}", found.unexplained);
    let effect = AddedEffect::read("attenuator_not_changed", &data).unwrap();
    let result = fit(&data, &[effect]).unwrap();
    let factor =
        result.parameters.iter().find(|p| p.sigma.is_some() && p.name.contains("attenuator")).unwrap();
    assert!((factor.value - 2.0).abs() < 0.02, "{:?}", result.parameters);
}

/// A display that is not the nominal one: blue is 17 % stronger and gamma 2.3. Against the nominal response that is what
/// is found; against a response that was calibrated from another campaign, noise alone is `adequate`, its own error
/// included, and what is new is named.
#[test]
fn a_calibrated_response_is_held() {
    let setup = setup();
    let display = |light: f64, count: f64, channel: &str| {
        let gain =
            [("b", 1.17), ("w", 1.0 + 0.17 / 3.0)].iter().find(|(c, _)| *c == channel).map_or(1.0, |g| g.1);
        light * gain * (count / 255.0).powf(0.1)
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("power.csv");
    std::fs::write(&path, power(40, &|light, _, count, channel| display(light, count, channel))).unwrap();
    let readings = PowerReadings::read(std::slice::from_ref(&path)).unwrap();
    let response = Calibrated::fit(&setup, readings).unwrap().calibration;
    let verdict = |text: String, response: Option<&RadiometricCalibration>| {
        std::fs::write(&path, text).unwrap();
        let tables = Measurements::read(std::slice::from_ref(&path)).unwrap();
        let baseline = Baseline::Physical;
        let source = Source { tables: &tables, setup: &setup, calibration: None, response, baseline };
        let data = Dataset::new(&source).unwrap();
        let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
        println!("{} {:?} {:?}", found.verdict.name(), found.accepted, found.unexplained);
        found
    };
    let plain = |seed| power(seed, &|light, _, count, channel| display(light, count, channel));
    let nominal = verdict(plain(41), None);
    assert!(nominal.accepted.contains(&"gamma") && nominal.accepted.contains(&"meter_wavelength"));
    let alarms = (42..50).filter(|&seed| verdict(plain(seed), Some(&response)).verdict != Verdict::Adequate);
    assert!(alarms.count() <= 1);
    let lossy = power(60, &|light, _, count, channel| {
        display(light, count, channel) * if channel == "w" { 0.985 } else { 1.0 }
    });
    assert_eq!(verdict(lossy, Some(&response)).accepted, ["channel_nonadditivity"]);
}
