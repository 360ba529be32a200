//! Structure of any shape, several kinds of noise, few exposures: what a table says beyond the catalogue.

#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use common::{ARCSEC, Campaign, Point, dataset, setup};
use glam::DVec2;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use retina_diagnosis::{AddedEffect, DiagnoseOptions, Diagnosis, Verdict, compare, diagnose, fit};
use retina_geometry::{DEPTHS_MM, RADIAL_KNOTS, RadialTable, SpotShifts};

const OPTIONS: DiagnoseOptions = DiagnoseOptions { flips: 999, seed: 1 };

fn nothing(p: &Point) -> DVec2 {
    p.r
}

/// A square wave of 90 px of the screen, finer than any polynomial of the screens.
fn wave(arcsec: f64) -> impl Fn(&Point) -> DVec2 {
    move |p| {
        let side = (p.screen_px.dot(DVec2::new(0.8, 0.6)) / 45.0).floor().rem_euclid(2.0);
        p.r + DVec2::new(0.7, -0.7) * arcsec * ARCSEC * (2.0 * side - 1.0)
    }
}

fn of(campaign: Campaign, effect: &dyn Fn(&Point) -> DVec2) -> Diagnosis {
    diagnose(&campaign.data(&setup(), effect), &[], &OPTIONS)
}

#[test]
fn a_fine_structure_is_unknown_and_the_noise_is_not_it() {
    let found = of(Campaign::new(3), &wave(6.0));
    assert_eq!(found.verdict, Verdict::Unknown);
    assert!(found.unexplained.covariates.contains(&"x".to_owned()), "{:?}", found.unexplained);
    assert!(found.unexplained.width_px.is_some_and(|width| width < 60.0), "{:?}", found.unexplained);
    // 6 arcsec along a diagonal are 4.2 an axis; the neighbours' differences and the noise's 1.6 are less than both together.
    assert!(found.noise.structured > 2.0, "{:?}", found.noise);
}

#[test]
fn without_structure_a_table_is_adequate_and_says_what_it_would_have_seen() {
    let found = of(Campaign::new(4), &nothing);
    assert_eq!(found.verdict, Verdict::Adequate);
    let [wavelength, amplitude] = found.unexplained.visible[2];
    assert!(wavelength == 200.0 && (0.5..4.0).contains(&amplitude), "{:?}", found.unexplained.visible);
    // Half as much again is found, a quarter is not: the p-value is that of what counts.
    let ripple = |size: f64| {
        of(Campaign::new(4), &move |p: &Point| {
            let t = std::f64::consts::TAU / wavelength * p.screen_px.dot(DVec2::new(0.6, 0.8));
            p.r + DVec2::splat(std::f64::consts::FRAC_1_SQRT_2) * size * amplitude * ARCSEC * t.sin()
        })
    };
    assert_eq!((ripple(1.5).verdict, ripple(0.25).verdict), (Verdict::Unknown, Verdict::Adequate));
    assert!(ripple(0.25).unexplained.p_value > 0.01);
}

/// The same where each exposure has a value in a column more.
fn with_column(
    campaign: Campaign,
    effect: &dyn Fn(&Point) -> DVec2,
    name: &str,
    value: &dyn Fn(usize) -> f64,
) -> Diagnosis {
    let mut text = String::new();
    for (row, line) in campaign.table(&setup(), effect).lines().enumerate() {
        let cell = match row.checked_sub(1) {
            None => name.to_owned(),
            Some(row) => value(row / 50).to_string(),
        };
        text.push_str(&format!("{line},{cell}\n"));
    }
    diagnose(&dataset(&setup(), &text), &[], &OPTIONS)
}

/// Drawn uniformly from -0.5 to 0.5, the same for the same seed and number.
fn drawn(seed: u64, number: usize) -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(number as u64);
    random.random::<f64>() - 0.5
}

/// Five periods over a stage's travel: no polynomial in its place follows them, and the scatter of exposures holds them.
#[test]
fn a_period_in_another_column_is_seen() {
    let stage_mm = |exposure: usize| 20.0 * drawn(1, exposure);
    let swung = |p: &Point| {
        let turn = DVec2::from_angle(std::f64::consts::TAU * stage_mm(p.exposure) / 4.0);
        p.r + 2.4 * ARCSEC * turn
    };
    let found = with_column(Campaign::new(8), &swung, "stage_mm", &stage_mm);
    assert_eq!(found.verdict, Verdict::Unknown);
    assert_eq!(found.unexplained.covariates, ["stage_mm"]);
    let null = with_column(Campaign::new(8), &nothing, "stage_mm", &stage_mm);
    assert_eq!(null.verdict, Verdict::Adequate, "{:?}", null.unexplained);
}

/// Each exposure is rolled by itself, by 2 arcsec at half the camera's width: no step of the mount. A step is named all the
/// same where there is one, also of the last three exposures alone.
#[test]
fn exposures_with_a_roll_each_are_no_knock() {
    let named = (0..8).filter(|&seed| {
        let rolled = move |p: &Point| {
            // Three uniform numbers make a deviate of half a unit, nearly normal.
            let roll = 4.0 * (0..3).map(|k| drawn(seed + 10 * k, p.exposure)).sum::<f64>();
            p.r + roll / 0.141 * ARCSEC * p.r.perp()
        };
        let accepted = of(Campaign::new(20 + seed), &rolled).accepted;
        accepted.contains(&"knock")
    });
    assert_eq!(named.count(), 0);
    let late = |p: &Point| p.r + if p.exposure >= 37 { 3.0 * ARCSEC * DVec2::X } else { DVec2::ZERO };
    assert_eq!(of(Campaign::new(8), &late).accepted, ["knock"]);
}

/// A shift that follows the humidity: a knock and a drift explain a part of it, and neither is named. A drift beside a
/// humidity that means nothing is named.
#[test]
fn what_follows_another_column_is_no_knock_and_no_drift() {
    let humidity = |exposure: usize| {
        let e = exposure as f64;
        45.0 + 6.0 * ((0.23 * e).sin() + 0.4 * (0.71 * e).cos() + 0.03 * e)
    };
    let diagnosed =
        |effect: &dyn Fn(&Point) -> DVec2| with_column(Campaign::new(8), effect, "humidity_pct", &humidity);
    let along = DVec2::new(0.8, -0.6) * ARCSEC;
    let found = diagnosed(&|p: &Point| p.r + 2.0 * along * (humidity(p.exposure) - 45.0) / 6.0);
    assert_eq!((found.verdict, found.accepted.len()), (Verdict::Unknown, 0), "{:?}", found.accepted);
    assert_eq!(found.unexplained.covariates, ["humidity_pct"]);
    let told = |note: &String| note.contains("is not named: what it would explain follows `humidity_pct`");
    assert!(found.notes.iter().any(told), "{:?}", found.notes);
    let found = diagnosed(&|p: &Point| p.r + 4.0 * along * p.time_s / 3600.0);
    assert_eq!(found.accepted, ["drift"]);
    assert_eq!(found.rival_columns, [None]);
}

/// A keystone and a shift that swing in time: steps of a keystone or a shift explain a part of them, and no knock is named.
#[test]
fn what_swings_in_time_is_no_knock() {
    for (seed, cycles, arcsec) in [(8, 1.3, 5.0), (9, 1.3, 5.0), (8, 2.4, 10.0)] {
        let effect = move |p: &Point| {
            let phase = std::f64::consts::TAU * cycles * p.exposure as f64 / 40.0 + 0.7;
            let swing = arcsec * phase.sin() * ARCSEC;
            let [x, y] = [p.r.x / 0.14, p.r.y / 0.14];
            p.r + swing * DVec2::new(x * y + 0.18, y * y - 0.24)
        };
        let found = of(Campaign::new(seed), &effect);
        let accepted = &found.accepted;
        assert!(found.verdict == Verdict::Unknown && !accepted.contains(&"knock"), "{accepted:?}");
        let told = |note: &String| note.contains("is not named: what it would explain follows `time_s`");
        assert!(found.notes.iter().any(told), "{:?}", found.notes);
    }
}

/// A stated figure a thousand times too large or too small, and exposures that move by four times what their points
/// scatter by: each is told once, whatever the verdict, and nothing is told of a table that states what is so.
#[test]
fn a_table_whose_own_figures_are_doubtful_is_told_so() {
    let campaign = Campaign { outliers: 0.0, ..Campaign::new(7) };
    let notes = |campaign: Campaign, sigma_px: Option<f64>, effect: &dyn Fn(&Point) -> DVec2| {
        let mut text = String::new();
        for (row, line) in campaign.table(&setup(), effect).lines().enumerate() {
            let cell = match sigma_px {
                Some(_) if row == 0 => ",sigma_px".to_owned(),
                Some(sigma_px) => format!(",{sigma_px}"),
                None => String::new(),
            };
            text.push_str(&format!("{line}{cell}\n"));
        }
        let data = dataset(&setup(), &text);
        let said = |notes: Vec<String>| {
            let doubts = |note: &String| note.contains("the table states") || note.starts_with("whole ");
            notes.into_iter().filter(doubts).collect::<Vec<String>>()
        };
        let found = said(diagnose(&data, &[], &OPTIONS).notes);
        assert_eq!(found.len(), said(compare(&data, &[]).notes).len(), "{found:?}");
        found
    };
    // 1.6 arcsec in all.
    let camera = setup().camera_pinhole();
    let true_px = 1.6 * ARCSEC * camera.fx_px;
    let tilted = |p: &Point| p.r + DVec2::new(20.0 * ARCSEC * p.r.x * p.r.x / 0.01, 0.0);
    let none = notes(campaign, Some(true_px), &tilted);
    assert!(none.is_empty(), "{none:?}");
    for (factor, than) in [(1000.0, "less"), (0.001, "more")] {
        let said = notes(campaign, Some(factor * true_px), &tilted);
        assert!(said.len() == 1 && said[0].contains(&format!(" times {than} than the ")), "{said:?}");
    }
    let said = notes(Campaign { jitter_arcsec: 6.4, ..campaign }, None, &nothing);
    assert!(said.len() == 1 && said[0].starts_with("whole exposures differ by "), "{said:?}");
}

/// 1.5 arcsec and 0.3 of it more for faint points is 1.6 over all; the exposures' 0.45 beside it.
#[test]
fn the_noise_is_one_number_whatever_the_model() {
    let data = Campaign::new(5).data(&setup(), &|p: &Point| p.r * (1.0 + 30.0 * ARCSEC * (p.f - 0.5)));
    let coma = AddedEffect::read("flux_coma", &data).unwrap();
    let all = [
        compare(&data, &[]).noise.floor(),
        compare(&data, std::slice::from_ref(&coma)).noise.floor(),
        fit(&data, &[coma]).unwrap().noise.floor(),
        diagnose(&data, &[], &OPTIONS).noise.floor(),
    ];
    assert!(all.iter().all(|noise| *noise == all[0]) && (all[0] / 1.7 - 1.0).abs() < 0.1, "{all:?}");
}

#[test]
fn few_exposures_show_an_effect_and_few_rows_are_undecided() {
    let few = |rows, exposures| Campaign { rows, exposures, ..Campaign::new(6) };
    let tilted = |p: &Point| p.r / (1.0 + DVec2::new(2e-3, 0.0).dot(p.r));
    let found = of(few(900, 3), &tilted);
    // One roll of the camera does not tell these two apart.
    assert!(
        found.accepted.len() == 1 && ["screen_tilt", "camera_pointing"].contains(&found.accepted[0]),
        "{:?} {:?}",
        found.accepted,
        found.notes
    );
    assert!(found.notes.iter().any(|note| note.contains("runs of rows")), "{:?}", found.notes);
    let found = of(few(24, 3), &nothing);
    assert_eq!(found.verdict, Verdict::Undecided, "{:?}", found.notes);
    assert_eq!(found.next.unwrap().action, "repeat");
}

/// Points of an exposure share a smooth field that the next exposure does not have: with three exposures nothing tells it
/// from the facility.
#[test]
fn air_in_few_exposures_is_undecided() {
    let air = |p: &Point| {
        let turn = DVec2::from_angle(2.4 * p.exposure as f64);
        let t = p.screen_px / 70.0;
        p.r + turn.rotate(DVec2::new(t.x.sin() + (0.7 * t.y).cos(), (1.3 * t.x).cos() - t.y.sin()))
            * 3.0
            * ARCSEC
    };
    let found = of(Campaign { rows: 1200, exposures: 3, ..Campaign::new(8) }, &air);
    assert_eq!(found.verdict, Verdict::Undecided, "{:?} {:?}", found.accepted, found.noise);
}

/// A plane turned by 0.2 deg behind a pinhole: x' = x / (1 + tan(tilt) x), its +x side away from the lens. A camera that
/// looks aside by 0.2 deg towards +x does the same, and one roll of it does not tell which it is.
#[test]
fn a_tilt_comes_in_degrees_with_its_side() {
    let tan = 0.2f64.to_radians().tan();
    let data = Campaign::new(9).data(&setup(), &|p: &Point| p.r / (1.0 + tan * p.r.x));
    let pinhole = SpotShifts {
        height_mm: [50.0, 0.0, 0.0],
        per_depth: [RadialTable { half_tan: 1.0, values: [-0.02; RADIAL_KNOTS] }; 4],
        coma: None,
    };
    let found = diagnose(&data.with_spot_shifts(pinhole), &[], &OPTIONS);
    let tilt = found.physical[0].as_ref().unwrap();
    assert!(tilt.unit == "deg" && (tilt.value - 0.2).abs() < 3.0 * tilt.sigma + 0.005, "{tilt:?}");
    let back = match found.accepted[0] {
        "screen_tilt" => "its +x side by 0.2",
        _ => "turn the camera's boresight by x -0.2",
    };
    assert!(tilt.remedy.contains(back), "{tilt:?}");
}

/// A display so far from flat that lenses do not move its image in proportion: the sag is that of the bench, and nothing
/// is left that looks like another effect.
#[test]
fn a_deep_bow_is_traced_at_its_depth() {
    let gain = |z: f64| -0.02 + 0.06 * z - 0.3 * z * z;
    let per_depth = DEPTHS_MM.map(|z| RadialTable { half_tan: 1.0, values: [gain(z); RADIAL_KNOTS] });
    let lens = SpotShifts { height_mm: [50.0, 0.0, 0.0], per_depth, coma: None };
    let camera = setup().camera_pinhole();
    let half_tan = 0.5 * f64::from(camera.width_px) / camera.fx_px;
    let data = Campaign::new(12).data(&setup(), &|p: &Point| {
        let at = p.r / half_tan;
        let z = 0.08 * (at.x * at.x - at.y * at.y);
        p.r * (1.0 + gain(z) * z)
    });
    let found = diagnose(&data.with_spot_shifts(lens), &[], &OPTIONS);
    assert_eq!(found.accepted, ["screen_bow"], "{:?}", found.unexplained.covariates);
    let bow = found.physical[0].as_ref().unwrap();
    // In proportion it would be 75.7 um. Distortion (2 % here) is not in this display's place.
    assert!(bow.unit == "um" && (bow.value - 80.0).abs() < 2.0, "{bow:?}");
}

/// A dent so deep that all its rows are outliers, and as many outliers that have nothing to do with each other.
#[test]
fn outliers_that_lie_together_are_no_accidents() {
    let camera = setup().camera_pinhole();
    let half_tan = 0.5 * f64::from(camera.width_px) / camera.fx_px;
    let dent = |p: &Point| {
        let at = p.r / half_tan;
        let depth = (at.x + at.y - 1.2).max(0.0);
        p.r + 400.0 * depth * ARCSEC * DVec2::new(1.0, 0.5)
    };
    let found = diagnose(&Campaign::new(14).data(&setup(), &dent), &[], &OPTIONS);
    assert_eq!(found.verdict, Verdict::Unknown, "{:?}", found.accepted);
    assert!(found.unexplained.covariates.contains(&"x".to_owned()), "{:?}", found.unexplained);
    assert!(found.notes.iter().any(|note| note.contains("outliers lie together")), "{:?}", found.notes);
    let scattered = Campaign { outliers: 0.08, ..Campaign::new(15) };
    let found = diagnose(&scattered.data(&setup(), &|p| p.r), &[], &OPTIONS);
    assert!(!found.notes.iter().any(|note| note.contains("together")), "{:?}", found.notes);
    assert_eq!(found.verdict, Verdict::Adequate, "{:?} {:?}", found.unexplained, found.outliers);
}
