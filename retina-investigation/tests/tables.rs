//! Investigations of tables with a formula that nobody knows, with a known effect, and with nothing.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

#[path = "../../retina-diagnosis/tests/common/mod.rs"]
mod common;

use std::fmt::Write as _;

use common::{ARCSEC, Campaign, Point, dataset, setup};
use glam::DVec2;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use retina_diagnosis::{AddedEffect, Covariate, Dataset, Pixels, White, fit};
use retina_investigation::{Investigation, Options, investigate, investigation_json, investigation_text};

const HALF: f64 = 0.1413;

fn asked(data: &Dataset) -> Investigation {
    investigate(data, &[], &Options::default(), &|_, _| {}).unwrap()
}

/// A field that turns about the axis, the more the more light there is, and saturates.
fn turning(p: &Point) -> DVec2 {
    p.r + p.r.perp() / HALF * (6.0 * p.f / (p.f + 0.08) * ARCSEC)
}

#[test]
fn a_hidden_formula_of_points_is_found_and_holds_elsewhere() {
    let (setup, mut campaign) = (setup(), Campaign::new(11));
    let data = campaign.data(&setup, &turning);
    let found = asked(&data);
    assert_eq!(found.known, []);
    let term = &found.terms[0];
    assert!(term.covariates.contains(&"log10_irradiance".to_owned()), "{:?}", term.covariates);
    assert!(found.terms.iter().all(|t| !t.covariates.iter().any(|c| c == "time_s" || c == "temperature_c")));
    assert!(term.proof.p_value <= 0.001, "{:?}", term.proof);
    assert!((term.proof.ratio - 1.0).abs() < 4.0 * term.proof.ratio_sigma, "{:?}", term.proof);
    assert!(!term.words.says.is_empty() && !term.words.origins.is_empty());
    assert!(term.words.independent_of.contains(&"time_s".to_owned()));

    // The user's file on another campaign, without any of the search: it takes the error down to the noise.
    campaign.seed = 12;
    let fresh = campaign.data(&setup, &turning);
    let model = [AddedEffect::of_text(&term.name, &term.effect, &fresh).unwrap()];
    let (with, without) = (fit(&fresh, &model).unwrap(), fit(&fresh, &[]).unwrap());
    let nothing = fit(&campaign.data(&setup, &|p| p.r), &[]).unwrap();
    assert!(with.heldout_rms < 1.02 * nothing.heldout_rms, "{} {}", with.heldout_rms, nothing.heldout_rms);
    assert!(without.heldout_rms > 1.1 * nothing.heldout_rms, "{}", without.heldout_rms);

    // The same again gives the same answer.
    let again = asked(&data);
    assert_eq!(investigation_text(&data, &again), investigation_text(&data, &found));
    let json = investigation_json(&data, &found, None);
    assert_eq!(json["schema"], "retina.investigation/1");
    assert_eq!(json["verdict"], "found");
}

/// A blemish of the window, forty times the noise at its strongest: most of it looks like outliers, and its skirts fall as a
/// power of the distance. A shift with the temperature that is weak beside it may be its doing, and is told apart.
#[test]
fn a_strong_blemish_is_one_formula_and_what_is_weak_beside_it_is_said() {
    let blemish = |p: &Point| {
        let off = p.r / HALF - DVec2::new(-0.13, 0.3);
        let fall = 1.0 / (1.0 + off.length_squared() / 0.04);
        let warm = DVec2::new(0.8, 0.6) * (p.temperature_c - 20.0);
        p.r + (off * (900.0 * fall * fall) + warm) * ARCSEC
    };
    let data = Campaign::new(41).data(&setup(), &blemish);
    let found = asked(&data);
    let said = investigation_text(&data, &found);
    assert!(found.known.is_empty() && found.terms.len() == 1, "{said:#?}");
    let term = &found.terms[0];
    assert!(term.effect.contains("skirt") && term.covariates == ["x", "y"], "{}", term.effect);
    let weak: Vec<(&str, &str)> = found.known_weak.iter().map(|w| (w.effect, w.beside.as_str())).collect();
    assert_eq!(weak, [("thermal_boresight", "found_1")]);
    assert!(said.iter().any(|line| line.starts_with("thermal_boresight holds on the other half, too")));
    let fitted = |name: &str| {
        found.fit.parameters.iter().find(|p| p.name == format!("found_1.{name}")).unwrap().value.abs()
    };
    for (name, value) in [("centre_x", 0.13), ("centre_y", 0.3), ("extent", 0.2), ("skirt", 2.0)] {
        assert!((fitted(name) / value - 1.0).abs() < 0.1, "{name}: {}", fitted(name));
    }
}

/// A holder that squeezes the field follows the air with a time constant of 600 s: each exposure comes 90 s after the last.
#[test]
fn what_follows_the_temperature_with_a_delay_is_found() {
    let holder = std::cell::Cell::new((0, 20.0));
    let squeezed = |p: &Point| {
        let (exposure, at) = holder.get();
        let at = if p.exposure == exposure {
            at
        } else {
            at + (p.temperature_c - at) * (1.0 - (-90.0 / 600.0f64).exp())
        };
        holder.set((p.exposure, at));
        p.r + DVec2::new(p.r.x, -p.r.y) / HALF * (8.0 * (at - 20.0) * ARCSEC)
    };
    let data = Campaign::new(53).data(&setup(), &squeezed);
    let found = asked(&data);
    let term = &found.terms[0];
    let tau = term.effect.split("lag(temperature_c, ").nth(1).and_then(|rest| rest.split("[s]").next());
    let tau: f64 = tau.unwrap_or_else(|| panic!("{}", term.effect)).parse().unwrap();
    assert!((350.0..=750.0).contains(&tau), "{}", term.effect);
    // Those that are not told from it are told. (The holder here follows in steps, and sooner than a lag of 600 s does.)
    assert!(
        term.words.says.iter().any(|says| says.contains("do not tell time constants from")),
        "{:?}",
        term.words
    );
    assert!(
        term.covariates.contains(&"temperature_c".to_owned()) && term.covariates.contains(&"x".to_owned())
    );
    assert!(term.words.says.iter().any(|says| says.contains("follows temperature_c with a time constant")));
    assert!(term.words.origins[0].mechanism.starts_with("A heavy part"), "{:?}", term.words.origins);
}

/// A second sensor says the same as the first: neither is called needless. Names are free.
#[test]
fn columns_that_go_together_are_told() {
    let turned = |p: &Point| p.r + p.r.perp() / HALF * (2.0 * (p.temperature_c - 20.0) * ARCSEC);
    let text = Campaign::new(61).table(&setup(), &turned);
    let at = text.lines().next().unwrap().split(',').position(|name| name == "temperature_c").unwrap();
    let line = |(k, line): (usize, &str)| match k {
        0 => format!("{},second sensor [mV]\n", line.replace("temperature_c", "first (deg)")),
        _ => format!("{line},{}\n", 4.0 + 10.0 * line.split(',').nth(at).unwrap().parse::<f64>().unwrap()),
    };
    let data = dataset(&setup(), &text.lines().enumerate().map(line).collect::<String>());
    let found = asked(&data);
    let term = &found.terms[0];
    let [first, second] = ["first (deg)", "second sensor [mV]"];
    let used = |name: &str| term.covariates.iter().any(|column| column == name);
    let other = if used(first) { second } else { first };
    assert!(used(first) != used(second), "{:?}", term.covariates);
    assert!(term.words.says.iter().any(|says| says.contains(other)), "{:?}", term.words.says);
    assert!(!term.words.independent_of.iter().any(|name| name == other));
    assert!(fit(&data, &[AddedEffect::of_text("found", &term.effect, &data).unwrap()]).is_ok());
}

#[test]
fn noise_has_no_formula() {
    // One table in fifty has one by chance: these have none.
    for seed in [101, 102, 103] {
        let data = Campaign::new(seed).data(&setup(), &|p| p.r);
        let found = asked(&data);
        assert!(found.terms.is_empty() && found.known.is_empty(), "{:?}", investigation_text(&data, &found));
        assert!(investigation_text(&data, &found)[0].starts_with("No formula"));
    }
}

#[test]
fn a_known_effect_in_disguise_is_called_by_its_name() {
    // Thermal expansion of a mount: the catalogue has it.
    let along = DVec2::new(0.8, 0.6);
    let moved = |p: &Point| p.r + along * (3.0 * (p.temperature_c - 20.0) * ARCSEC);
    let data = Campaign::new(31).data(&setup(), &moved);
    let found = asked(&data);
    let known: Vec<&str> = found.known.iter().map(|known| known.effect).collect();
    assert_eq!(known, ["thermal_boresight"]);
    // The formula is told, with whose it is.
    let formulas = found.formulas();
    assert_eq!((formulas.len(), formulas[0].known), (1, Some("thermal_boresight")));
    assert!(AddedEffect::of_text("found", &formulas[0].effect, &data).is_ok(), "{}", formulas[0].effect);
    let said = investigation_json(&data, &found, None);
    assert!(said["found"] == false && said["formulas"][0]["columns"][0] == "temperature_c", "{said}");
    assert!(found.terms.is_empty(), "{:?}", investigation_text(&data, &found));
}

#[test]
fn few_exposures_are_refused_with_what_is_needed() {
    let mut campaign = Campaign::new(41);
    (campaign.rows, campaign.exposures) = (30, 10);
    let data = campaign.data(&setup(), &|p| p.r);
    let refused = investigate(&data, &[], &Options::default(), &|_, _| {}).err().unwrap();
    assert!(refused.problem.contains("too few groups"), "{refused:?}");
    assert!(refused.help.is_some() && refused.expected.is_some());
}

/// What a reading gains, by the series' humidity and temperature, each about -1 to 1, and the square's side.
type GainOf<'a> = &'a dyn Fn(f64, f64, f64) -> f64;

/// Readings of a power meter in 24 series.
fn readings(gain: GainOf<'_>, seed: u64) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut text = String::from(
        "channel,digital_count,square_px,irradiance_w_m2,series,time_s,humidity,temperature_c\n",
    );
    for series in 0..24 {
        let humidity: f64 = random.random_range(30.0..70.0);
        let temperature: f64 = random.random_range(20.0..24.0);
        for (k, count) in [8.0f64, 24.0, 60.0, 120.0, 255.0].into_iter().cycle().take(20).enumerate() {
            let side = [20.0f64, 60.0, 100.0, 200.0][(series + k) % 4];
            let gained = gain((humidity - 50.0) / 20.0, (temperature - 22.0) / 2.0, side);
            let noise: f64 = StandardNormal.sample(&mut random);
            let light = side * side * (count / 255.0).powf(2.2);
            let read = light * (1.0 + gained) * (1.0 + 0.004 * noise) * 2e-9;
            let time_s = 30 * (20 * series + k);
            let _ = writeln!(
                text,
                "w,{count},{side},{read:e},s{series:02},{time_s},{humidity:.2},{temperature:.3}"
            );
        }
    }
    text
}

#[test]
fn a_hidden_formula_of_power_readings_is_found() {
    let setup = setup();
    // They grow with the humidity, the more the larger the square is.
    let wet = |humidity: f64, _: f64, side: f64| 0.02 * humidity * (side / 200.0).sqrt();
    let data = dataset(&setup, &readings(&wet, 51));
    let found = asked(&data);
    assert!(!found.terms.is_empty(), "{:?}", investigation_text(&data, &found));
    assert!(found.terms[0].covariates.contains(&"humidity".to_owned()), "{:?}", found.terms[0].covariates);
    assert!(found.terms[0].proof.p_value <= 0.01);
    let nothing = asked(&dataset(&setup, &readings(&|_, _, _| 0.0, 52)));
    assert!(nothing.terms.is_empty());
}

/// Two laws that both change from series to series alone: half of the table has twelve series, whose scatter holds all of
/// it until the formula is known.
#[test]
fn a_formula_of_two_columns_of_the_series_is_found() {
    let setup = setup();
    let both = |humidity: f64, temperature: f64, _: f64| 0.05 * (1.0 + humidity) * temperature;
    for seed in 61..64 {
        let data = dataset(&setup, &readings(&both, seed));
        let found = asked(&data);
        let text = investigation_text(&data, &found);
        assert!(!found.terms.is_empty(), "{seed}: {text:?}");
        let columns = &found.terms[0].covariates;
        assert!(columns.contains(&"humidity".to_owned()), "{seed}: {text:?}");
        assert!(columns.contains(&"temperature_c".to_owned()), "{seed}: {text:?}");
    }
}

fn known(found: &Investigation) -> Vec<(&str, &[String])> {
    found.known.iter().map(|known| (known.effect, known.columns.as_slice())).collect()
}

/// Nine tenths of its square are what self-heating does, but the data tell the two apart.
#[test]
fn a_strong_law_that_looks_like_a_known_effect_stays_a_formula() {
    let setup = setup();
    let bent = |_: f64, temperature: f64, _: f64| 0.03 * (temperature + 0.6).max(0.0).powf(1.2);
    let data = dataset(&setup, &readings(&bent, 71));
    let found = asked(&data);
    assert!(found.known.is_empty() && found.terms.len() == 1, "{:?}", investigation_text(&data, &found));
    assert_eq!(found.terms[0].covariates, ["temperature_c"]);
    let straight = |_: f64, temperature: f64, _: f64| 0.03 * temperature;
    let found = asked(&dataset(&setup, &readings(&straight, 71)));
    assert_eq!(known(&found), [("self_heating", &["temperature_c".to_owned()][..])]);
    assert!(found.terms.is_empty());
}

/// The meter's wavelength makes each colour read too much or too little. One colour alone is a formula, until the effect is
/// found beside it.
#[test]
fn a_formula_that_was_a_part_of_a_known_effect_is_taken_out() {
    let setup = setup();
    for seed in 81..84 {
        let text: String =
            readings(&|_, _, _| 0.0, seed).lines().enumerate().map(|(k, line)| in_colour(k, line)).collect();
        let data = dataset(&setup, &text);
        let found = asked(&data);
        let text = investigation_text(&data, &found);
        assert_eq!(
            found.known.iter().map(|k| k.effect).collect::<Vec<_>>(),
            ["meter_wavelength"],
            "{text:?}"
        );
        assert!(found.terms.is_empty(), "{text:?}");
    }
}

/// A line of readings, the heading first, in one colour after the other, as a meter set to a wrong wavelength reads it.
fn in_colour(line: usize, text: &str) -> String {
    let mut cells: Vec<String> = text.split(',').map(str::to_owned).collect();
    if line > 0 {
        // White is all three.
        let colours = [("r", 1.012 / 3.0), ("g", 1.0 / 3.0), ("b", 0.985 / 3.0), ("w", 0.999)];
        let (channel, factor) = colours[(line - 1) / 5 % 4];
        channel.clone_into(&mut cells[0]);
        cells[3] = format!("{:e}", factor * cells[3].parse::<f64>().unwrap());
    }
    cells.join(",") + "\n"
}

/// Pixels of a disc, predicted to the shape of a cosine; `error` is what the prediction lacks, of place and level.
fn pixels(error: &dyn Fn(DVec2, f64) -> f64, seed: u64) -> Dataset {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut pixels = Pixels { pitch_px: 1.0, least_noise: 0.3, ..Pixels::default() };
    let (mut columns, mut white) = (vec![Vec::new(); 3], Vec::new());
    for tile in 0..64 {
        let mut count = 0;
        for k in 0..64 {
            let at = DVec2::new((tile % 8 * 8 + k % 8) as f64, (tile / 8 * 8 + k / 8) as f64);
            let off = (at - DVec2::splat(32.0)).length() / 32.0;
            if off >= 0.98 {
                continue;
            }
            count += 1;
            let level = 200.0 * (1.0 - off * off).sqrt();
            let noise: f64 = StandardNormal.sample(&mut random);
            pixels.predicted.push(level);
            pixels.measured.push(level + error(at, level) + noise);
            pixels.place.push([0.0, at.x, at.y]);
            pixels.noise_key.push(level.ln());
            [at.x, at.y, level].into_iter().zip(&mut columns).for_each(|(v, c)| c.push(v));
            white.push(1.0);
        }
        if count > 0 {
            pixels.groups.push((format!("tile {tile}"), count));
        }
    }
    let names = ["camera_x_px", "camera_y_px", "level_dn"];
    let named = |(name, values): (&&str, Vec<f64>)| Covariate { name: (*name).to_owned(), values };
    pixels.covariates = names.iter().zip(columns).map(named).collect();
    pixels.white = Some(White { sigma_dn: white, source: "made".to_owned() });
    Dataset::of_pixels(pixels).unwrap()
}

/// An amplifier glows within some pixels of a place: one formula, with the place and its skirts.
#[test]
fn a_glow_of_the_detector_is_one_formula_of_the_place() {
    let glow = |at: DVec2| 12.0 / (1.0 + ((at - DVec2::new(40.0, 22.0)) / 7.0).length_squared()).powi(3);
    let data = pixels(&|at, _| glow(at), 7);
    let found = asked(&data);
    let said = investigation_text(&data, &found);
    assert_eq!(found.terms.len(), 1, "{said:#?}");
    let term = &found.terms[0];
    assert_eq!(term.covariates, ["camera_x_px", "camera_y_px"], "{}", term.effect);
    assert!(term.effect.contains("skirt"), "{}", term.effect);
    assert!(term.words.says[0].starts_with("It is a value about pixel (40, 22)"), "{:?}", term.words.says);
    assert!(term.words.origins[0].mechanism.starts_with("The detector glows"), "{:?}", term.words.origins);
    // The file says what the search has evaluated.
    let model = [AddedEffect::of_text("glow", &term.effect, &data).unwrap()];
    let fitted = fit(&data, &model).unwrap();
    let truth: Vec<f64> = (0..data.len())
        .map(|row| {
            let of = |name: &str| data.covariate(name).unwrap().values[row];
            glow(DVec2::new(of("camera_x_px"), of("camera_y_px")))
        })
        .collect();
    let off = |field: &[f64]| field.iter().zip(&truth).map(|(f, t)| (f - t).powi(2)).sum::<f64>().sqrt();
    let size = off(&vec![0.0; truth.len()]);
    assert!(off(&fitted.own_effects_on(&model, &data)) < 0.2 * size, "{}", term.effect);
}

/// Pixels whose places are not told have formulas of what is told, and none of a place.
#[test]
fn pixels_without_places_have_formulas_of_other_columns() {
    let mut data = pixels(&|_, level| 6.0 * (-level / 30.0).exp(), 9);
    data.covariates.retain(|column| column.name == "level_dn");
    let found = asked(&data);
    assert_eq!(found.terms[0].covariates, ["level_dn"], "{}", found.terms[0].effect);
}

#[test]
fn a_hidden_formula_of_pixels_is_found() {
    // A glow at one side that a black level cuts off: light of place and count.
    let glow = |at: DVec2, level: f64| 4.0 * (-at.x / 15.0).exp() * level / (level + 40.0);
    let data = pixels(&glow, 61);
    let found = asked(&data);
    assert!(!found.terms.is_empty(), "{:?}", investigation_text(&data, &found));
    assert!(found.terms[0].covariates.contains(&"camera_x_px".to_owned()), "{:?}", found.terms[0].covariates);
    let nothing = asked(&pixels(&|_, _| 0.0, 62));
    assert!(nothing.terms.is_empty());
}
