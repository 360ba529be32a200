//! Hidden effects in campaigns of points are found, and nothing is found in noise.

mod common;

use common::{ARCSEC, Campaign, Point, setup};
use glam::DVec2;
use retina_diagnosis::{
    AddedEffect, Baseline, Dataset, DiagnoseOptions, Diagnosis, Reading, Source, Verdict, decode, diagnose,
    fit, unexplained_shapes,
};
use retina_formats::Measurements;

type Effect = Box<dyn Fn(&Point) -> DVec2>;

/// Every effect by its physics; `s` is about its largest displacement in arcsec.
fn physical(id: &str, s: f64) -> Effect {
    let a = s * ARCSEC;
    // Half the camera's width on the tangent plane, 8.05 deg.
    let half = 0.1413f64;
    match id {
        // A plane that is turned: x / (1 + tilt . x).
        "screen_tilt" | "camera_pointing" => {
            let tilt = DVec2::new(0.8, -0.6) * a / (half * half);
            Box::new(move |p| p.r / (1.0 + tilt.dot(p.r)))
        }
        // The lens's k1 about a point beside the boresight.
        "decentering" | "optical_centre" => {
            let offset = DVec2::new(0.6, 0.8) * a / (3.0 * 0.35 * half * half);
            Box::new(move |p| {
                let d = p.r - offset;
                p.r + 0.35 * (d * d.length_squared() - p.r * p.r.length_squared())
            })
        }
        "thin_prism" => {
            Box::new(move |p| p.r + DVec2::new(0.5, 0.8) * a * p.r.length_squared() / (half * half))
        }
        // Equidistant beside tangent law: tan -> angle has all odd orders.
        "radial_higher_order" => Box::new(move |p| {
            let u = p.r.length() / half;
            p.r + p.r.normalize_or_zero() * a * (u.powi(5) - 0.2 * u.powi(7))
        }),
        // Depth of a saddle times the slope of the ray.
        "screen_bow" => Box::new(move |p| {
            let u = p.r / half;
            p.r + u * a * (u.x * u.x - u.y * u.y + 0.7 * u.x * u.y)
        }),
        // Coma whose share of the light saturates with brightness.
        "flux_coma" => Box::new(move |p| p.r + p.r / half * a * (p.f / (p.f + 0.15) - 0.5) * 2.0),
        "flux_shift" => {
            Box::new(move |p| p.r + DVec2::new(0.8, 0.6) * a * ((p.f / (p.f + 0.1)).powf(0.7) - 0.5))
        }
        "background_gradient" => Box::new(move |p| p.r + DVec2::new(0.3, -0.95) * a * 0.003 / p.f),
        "lateral_colour" => Box::new(move |p| p.r * (1.0 + a / half * [-1.0, 0.0, 0.7, 0.0][p.channel])),
        "colour_wedge" => {
            Box::new(move |p| p.r + DVec2::new(0.4, 0.9) * a * [-1.0, 0.0, 0.8, 0.0][p.channel])
        }
        "subpixel_offset" => Box::new(move |p| p.r + DVec2::X * a * [-1.0, 0.0, 1.0, 0.0][p.channel]),
        "thermal_boresight" => {
            Box::new(move |p| p.r + DVec2::new(0.7, 0.7) * a * (p.temperature_c - 20.0) / 2.0)
        }
        "thermal_focal" => Box::new(move |p| p.r * (1.0 + a / half * (p.temperature_c - 20.0) / 2.0)),
        "drift" => Box::new(move |p| p.r + DVec2::new(-0.6, 0.8) * a * p.time_s / 3600.0),
        "roll_drift" => Box::new(move |p| DVec2::from_angle(a / half * p.time_s / 3600.0).rotate(p.r)),
        "knock" => Box::new(move |p| p.r + DVec2::new(0.9, 0.4) * a * f64::from(u8::from(p.exposure >= 23))),
        // The S-curve of a window centroid.
        "camera_pixel_phase" => Box::new(move |p| {
            let s = (p.camera_px * std::f64::consts::TAU).map(|v: f64| v.sin() + 0.15 * (2.0 * v).sin());
            p.r + a * s
        }),
        // A three-pixel split that is coarser at low counts.
        "screen_pixel_phase" => Box::new(move |p| {
            let s = (p.screen_px * std::f64::consts::TAU).map(f64::sin);
            p.r + a * s * 18.0 / p.count
        }),
        "row_loading_shift" => Box::new(move |p| p.r + DVec2::new(0.2, 1.0) * a * p.row_load),
        _ => panic!("{id}"),
    }
}

const ALL: [&str; 21] = [
    "screen_tilt",
    "camera_pointing",
    "decentering",
    "optical_centre",
    "thin_prism",
    "radial_higher_order",
    "screen_bow",
    "flux_coma",
    "flux_shift",
    "background_gradient",
    "lateral_colour",
    "colour_wedge",
    "subpixel_offset",
    "thermal_boresight",
    "thermal_focal",
    "drift",
    "roll_drift",
    "knock",
    "camera_pixel_phase",
    "screen_pixel_phase",
    "row_loading_shift",
];

fn run(id: &str, s: f64, seed: u64) -> Diagnosis {
    let mut campaign = Campaign::new(seed);
    campaign.colours = ["lateral_colour", "colour_wedge", "subpixel_offset"].contains(&id);
    let data = campaign.data(&setup(), &*physical(id, s));
    diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 })
}

/// Every effect of the catalogue, strong (20 arcsec, noise 1.5) and moderate (4 arcsec): named, or in the set.
#[test]
fn each_effect_is_named_or_in_the_set() {
    let mut wrong = Vec::new();
    for (k, id) in ALL.into_iter().enumerate() {
        // A centroid that is off by most of a pixel is no centroid: its bias is a few hundredths of one.
        for s in if id == "camera_pixel_phase" { [3.0, 1.4] } else { [20.0, 4.0] } {
            let found = run(id, s, 100 + k as u64);
            println!(
                "{id:20} {s:4} {:10} accepted {:?} set {:?} unexplained {:?} p {:.3} steps {:?}",
                found.verdict.name(),
                found.accepted,
                found.indistinguishable,
                found.unexplained.covariates,
                found.unexplained.p_value,
                found.steps.iter().map(|s| (s.heldout_rms * 1e3).round() / 1e3).collect::<Vec<_>>()
            );
            let good = found.indistinguishable.contains(&id)
                && found.accepted.len() == 1
                && matches!(found.verdict, Verdict::Named | Verdict::Confounded);
            if !good {
                wrong.push(format!("{id} {s}"));
            }
        }
    }
    // The screens' own level is 1 % a campaign: of 42 campaigns two are wrong by chance in 6 %, three in 1 %.
    assert!(wrong.len() <= 2, "{wrong:?}");
}

/// False alarms on noise with common shifts and outliers. At the rate of 3 % that the levels have, more than 7 of 100 are
/// there in 1 % of cases.
#[test]
fn noise_is_adequate() {
    let alarms: Vec<String> = (0..100)
        .filter_map(|seed| {
            let mut campaign = Campaign::new(1000 + seed);
            campaign.rows = 800;
            campaign.jitter_arcsec = [0.0, 0.45, 1.5][seed as usize % 3];
            let data = campaign.data(&setup(), &|p| p.r);
            let found = diagnose(&data, &[], &DiagnoseOptions { flips: 499, seed: 1 });
            (found.verdict != Verdict::Adequate)
                .then(|| format!("{seed} {:?} {:?}", found.accepted, found.unexplained))
        })
        .collect();
    println!("{} alarms: {alarms:?}", alarms.len());
    assert!(alarms.len() <= 7, "{alarms:?}");
}

/// A keystone term that changes at once is no tilt of the screen.
#[test]
fn a_step_of_a_keystone_is_no_tilt() {
    for seed in 0..5 {
        let tilt = DVec2::new(0.8, -0.6) * 8.0 * ARCSEC / (0.1413 * 0.1413);
        let effect = move |p: &Point| if p.exposure >= 17 { p.r / (1.0 + tilt.dot(p.r)) } else { p.r };
        let data = Campaign::new(50 + seed).data(&setup(), &effect);
        let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
        let by_time = found.unexplained.covariates.iter().any(|c| c == "time_s");
        assert!(
            found.accepted == ["knock"] || (found.verdict == Verdict::Unknown && by_time),
            "{:?} {:?}",
            found.accepted,
            found.unexplained
        );
        assert!(!found.accepted.contains(&"screen_tilt"));
    }
}

/// Identical columns come out together, and a roll of the camera is what tells them apart.
#[test]
fn a_confounded_pair_is_reported_with_what_separates_it() {
    let found = run("screen_tilt", 8.0, 7);
    assert_eq!(found.verdict, Verdict::Confounded);
    assert!(["screen_tilt", "camera_pointing"].iter().all(|id| found.indistinguishable.contains(id)));
    let next = found.next.unwrap();
    assert_eq!(next.action, "camera_roll");
    assert!(next.separates.contains(&"screen_tilt") && next.separates.contains(&"camera_pointing"));
    assert!(next.expected_sigma.unwrap() > 5.0, "{:?}", next.expected_sigma);
}

/// A swirl that grows with the irradiance is of no effect in the catalogue: what is left depends on the irradiance and on
/// the place.
#[test]
fn an_outside_field_names_irradiance_and_place() {
    let data = Campaign::new(4).data(&setup(), &|p| {
        let swirl = 10.0 * ARCSEC * p.f / 0.1413;
        p.r + swirl * DVec2::new(-p.r.y, p.r.x)
    });
    let found = diagnose(&data, &[], &DiagnoseOptions { flips: 999, seed: 1 });
    let named = &found.unexplained.covariates;
    assert_eq!(found.verdict, Verdict::Unknown, "{:?}", found.accepted);
    assert!(named.iter().any(|n| n == "log10_irradiance") && named.iter().any(|n| n == "x"), "{named:?}");
    let shapes = unexplained_shapes(&data, &[], &found).unwrap();
    let shape = shapes.iter().find(|s| s.covariate == "log10_irradiance").unwrap();
    // The formula to start from, quadratic in the logarithm, takes most of the swirl out.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("start.toml");
    std::fs::write(&path, &shape.formula).unwrap();
    let effect = AddedEffect::read(path.to_str().unwrap(), &data).unwrap();
    let result = fit(&data, &[effect]).unwrap();
    let beyond = |step: usize| result.steps[step].heldout_rms.powi(2) - result.noise.floor().powi(2);
    assert!(beyond(0) > 3.0 && beyond(1) < 0.15 * beyond(0), "{:?} {}", result.steps, result.noise.floor());
}

/// A cubic swallows a tilted screen and the lens's k1; told as physics both come back. By hand, with s = 8 arcsec:
/// r / (1 + t r) is r - t r r, so 0.8 s along x and -0.6 s along y at half the width, with the sign turned; k1 = 0.35 is
/// 0.35 x 0.1413^3 rad = 203.7 arcsec there, of which a cubic keeps what a fifth degree would not take.
#[test]
fn a_polynomial_is_told_as_physics() {
    let setup = setup();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("table.csv");
    let decoded = |id: &str, degree: u32| {
        let effect = physical(id, 8.0);
        std::fs::write(&path, Campaign::new(12).table(&setup, &effect)).unwrap();
        let tables = Measurements::read(std::slice::from_ref(&path)).unwrap();
        let baseline = Baseline::Polynomial(degree);
        let source = Source { tables: &tables, setup: &setup, calibration: None, response: None, baseline };
        decode(&Dataset::new(&source).unwrap())
    };
    // Shift, rotation and scale hold no form of physics.
    assert!(decoded("screen_tilt", 1).is_none());
    let decoded = |id: &str, degree: u32| decoded(id, degree).unwrap();
    let value = |reading: &Reading, name: &str| {
        reading.parameters.iter().find(|p| p.name == name).map(|p| (p.value, p.sigma.unwrap())).unwrap()
    };
    let tilted = decoded("screen_tilt", 3);
    let simplest = &tilted.readings[0];
    println!("{tilted:?}");
    assert_eq!(simplest.effects, ["screen_tilt", "radial_k1"]);
    for (name, truth) in [("screen_tilt_x_arcsec", -6.4), ("screen_tilt_y_arcsec", 4.8)] {
        let (found, sigma) = value(simplest, name);
        // A tenth of an arcsec is left to the forms' higher orders.
        assert!((found - truth).abs() < 4.0 * sigma + 0.1 && sigma < 0.3, "{name}: {found} +- {sigma}");
    }
    let (k1, sigma) = value(simplest, "k1_arcsec");
    assert!((k1 - 203.7).abs() < 4.0 * sigma + 2.0, "{k1} +- {sigma}");
    // The other reading causes the same field with one effect more.
    assert_eq!(tilted.readings[1].effects, ["decentering", "thin_prism", "radial_k1"]);
    let shifted = decoded("decentering", 5);
    println!("{shifted:?}");
    assert_eq!(shifted.readings[0].effects, ["decentering", "radial_k1"]);
}

/// Intervals of 90 % hold the truth in 85 to 95 % of fits: the truth is what the same form takes of the same campaign
/// without noise, so that a form's mismatch with the physics is not counted against the noise.
#[test]
fn intervals_cover_the_truth() {
    let setup = setup();
    let (mut held, mut all) = (0, 0);
    for id in ["screen_tilt", "row_loading_shift", "thin_prism"] {
        let effect = physical(id, 6.0);
        for seed in 0..40 {
            let noisy = Campaign { rows: 600, exposures: 30, ..Campaign::new(700 + seed) };
            let quiet = Campaign { noise_arcsec: 1e-4, jitter_arcsec: 1e-5, outliers: 0.0, ..noisy };
            let fitted = |campaign: &Campaign| {
                let data = campaign.data(&setup, &effect);
                let added = AddedEffect::read(id, &data).unwrap();
                fit(&data, &[added]).unwrap().parameters
            };
            // The same seed draws the same places and settings, in one order; other draws differ with the outliers'.
            let (found, truth) = (fitted(&noisy), fitted(&quiet));
            for p in found.iter().filter(|p| p.name.starts_with(id)) {
                let t = truth.iter().find(|t| t.name == p.name).unwrap().value;
                held += usize::from((p.value - t).abs() <= 1.645 * p.sigma.unwrap());
                all += 1;
            }
        }
    }
    println!("{held} of {all}");
    // 240 intervals: 90 % +- 1.9 %.
    assert!(held as f64 >= 0.85 * all as f64 && held as f64 <= 0.95 * all as f64, "{held} of {all}");
}

/// Noise that grows outwards, of which no column says anything: amplitudes of forms that grow outwards scatter by what is
/// stated of them (1.3 times as much where rows are weighed by their light alone).
#[test]
fn sigmas_hold_where_noise_grows_to_the_edge() {
    let (mut squares, mut count) = (0.0, 0.0);
    for seed in 0..40 {
        let campaign = Campaign { edge: 1.5, rows: 1600, ..Campaign::new(700 + seed) };
        let data = campaign.data(&setup(), &|p| p.r);
        let effect = AddedEffect::read("screen_bow", &data).unwrap();
        for p in fit(&data, &[effect]).unwrap().parameters.iter().filter(|p| p.name.starts_with("screen_bow"))
        {
            squares += (p.value / p.sigma.unwrap()).powi(2);
            count += 1.0;
        }
    }
    let rms = (squares / count).sqrt();
    println!("{rms}");
    assert!((0.8..1.2).contains(&rms), "{rms}");
}

/// The same seed gives the same bits, whatever the number of threads.
#[test]
fn threads_change_no_bit() {
    let data = Campaign::new(31).data(&setup(), &physical("flux_coma", 5.0));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        format!("{:?}", pool.install(|| diagnose(&data, &[], &DiagnoseOptions { flips: 499, seed: 3 })))
    };
    let one = on(1);
    assert!(one.contains("flux_coma"));
    assert!(one == on(2) && one == on(5), "results differ with the number of threads");
}

/// A shift of thirty sigmas that a quarter of the exposures do not share is no outlier of these, but a knock; the two
/// exposures that were bumped are outliers as a whole, and named.
#[test]
fn exposures_that_share_a_shift_are_no_outliers() {
    let mut clean = 0;
    for seed in 0..6 {
        let plain = Campaign::new(90 + seed).data(&setup(), &|p| p.r);
        // One of them is a false alarm in time by itself.
        if !diagnose(&plain, &[], &DiagnoseOptions { flips: 499, seed: 1 }).accepted.is_empty() {
            continue;
        }
        clean += 1;
        let data = Campaign::new(90 + seed).data(&setup(), &|p| {
            let shift = if p.exposure >= 9 { DVec2::new(23.0, 45.0) } else { DVec2::ZERO };
            p.r + shift * ARCSEC
        });
        let found = diagnose(&data, &[], &DiagnoseOptions { flips: 499, seed: 1 });
        assert_eq!(found.accepted, ["knock"], "{seed}");
        let bumped = Campaign::new(90 + seed).data(&setup(), &|p| {
            let shift = if [11, 30].contains(&p.exposure) { DVec2::new(60.0, -80.0) } else { DVec2::ZERO };
            p.r + shift * ARCSEC
        });
        let found = diagnose(&bumped, &[], &DiagnoseOptions { flips: 499, seed: 1 });
        assert!(found.accepted.is_empty(), "{seed}: {:?}", found.accepted);
        let said = found.notes.iter().any(|note| note.contains("2 exposures are outliers: e011, e030"));
        assert!(said, "{:?}", found.notes);
    }
    assert!(clean >= 4, "{clean}");
}

/// Six exposures that lie farther apart than their points scatter do not tell a mount that moves from a knock: nothing found
/// is no `adequate`. Forty do.
#[test]
fn few_exposures_that_differ_are_undecided() {
    let verdicts = |exposures: usize| -> Vec<Verdict> {
        let of = |seed: u64| {
            let campaign =
                Campaign { exposures, rows: 50 * exposures, jitter_arcsec: 8.0, ..Campaign::new(700 + seed) };
            diagnose(&campaign.data(&setup(), &|p| p.r), &[], &DiagnoseOptions { flips: 499, seed: 1 })
                .verdict
        };
        (0..6).map(of).collect()
    };
    let (six, forty) = (verdicts(6), verdicts(40));
    // One of six may be a false alarm.
    let count = |all: &[Verdict], wanted: Verdict| all.iter().filter(|own| **own == wanted).count();
    assert!(count(&six, Verdict::Undecided) >= 5 && count(&six, Verdict::Adequate) == 0, "{six:?}");
    assert!(count(&forty, Verdict::Adequate) >= 5, "{forty:?}");
}
