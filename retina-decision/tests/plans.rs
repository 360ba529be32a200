//! Plans: what they hold, that they are the same again, and that they tell rivals apart.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::fmt::Write as _;
use std::path::Path;

use retina_calibration::geometry::MeasurementPlan;
use retina_decision::{Choice, Decision, Design, Factor, Freedom, Wanted};
use retina_diagnosis::{AddedEffect, Baseline, Dataset, Rival, Rivals, Source};
use retina_formats::{Measurements, PointsTable};
use retina_geometry::Setup;

fn setup() -> Setup {
    Setup::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups/wide-fov.toml")).unwrap()
}

/// Twelve exposures of 16 points while the bench warms up by one kelvin in proportion to the time: the boresight moves by
/// 6 arcsec, and nobody can say whether with the time or the temperature. Centroids scatter by a twentieth of a pixel.
fn table(folder: &Path) -> PointsTable {
    let setup = setup();
    let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
    let mut text = String::from(
        "image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,sigma_px,exposure_s,time_s,temperature_c,camera_roll_deg\n",
    );
    let mut state = 11u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    for exposure in 0..12 {
        let passed = f64::from(exposure) / 11.0;
        for k in 0..16 {
            let at = glam::DVec2::new(
                200.0 + 480.0 * f64::from(k % 4) + 150.0 * uniform(),
                150.0 + 360.0 * f64::from(k / 4) + 100.0 * uniform(),
            );
            let sight = camera.line_of_sight(at);
            let screen = facility.pixel(sight).round() + 0.5;
            let moved = facility.line_of_sight(screen) + glam::DVec2::new(6.0 * passed / 206_265.0, 0.0);
            let mut noise = || 0.05 * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0);
            let seen = camera.pixel(moved) + glam::DVec2::new(noise(), noise());
            let count = [40, 80, 160][(k % 3) as usize];
            let _ = writeln!(
                text,
                "e{exposure},{},{},{count},{:.5},{:.5},0.05,0.02,{},{:.4},0",
                screen.x,
                screen.y,
                seen.x,
                seen.y,
                60 * exposure,
                20.0 + passed
            );
        }
    }
    let path = folder.join("points.csv");
    std::fs::write(&path, text).unwrap();
    PointsTable::read(&[path]).unwrap()
}

fn data(table: PointsTable) -> Dataset {
    Dataset::new(&Source {
        tables: &Measurements::Points(table),
        setup: &setup(),
        calibration: None,
        response: None,
        baseline: Baseline::Physical,
    })
    .unwrap()
}

fn designed(table: &PointsTable, freedom: &Freedom, choice: Choice, seed: u64) -> Design {
    let own = data(table.clone());
    let rivals = ["drift", "thermal_boresight"]
        .map(|id| Rival { name: id.to_owned(), effects: vec![AddedEffect::read(id, &own).unwrap()] });
    let fitted = Rivals::fit(&own, &rivals).unwrap();
    let decision = Decision::of(&fitted);
    assert_eq!(decision.left.len(), 2, "{:?}", decision.judgements);
    let setup = setup();
    let wanted = Wanted {
        table,
        setup: &setup,
        rivals: &fitted,
        left: &decision.left,
        freedom,
        exposures: 4,
        seed,
        choice,
    };
    Design::find(&wanted, &|table| Ok(data(table)), &|_| {}).unwrap()
}

#[test]
fn a_plan_tells_time_from_temperature_and_is_the_same_again() {
    let folder = tempfile::tempdir().unwrap();
    let table = table(folder.path());
    let freedom = Freedom::default();
    let design = designed(&table, &freedom, Choice::Separating, 4);
    let [separation] = design.separations[..] else { panic!("{:?}", design.separations) };
    // A drift may settle, too, and is then less unlike the temperature.
    assert!(separation.before < 2.0 && separation.after > 8.0, "{separation:?}");
    assert!(design.gains());
    let again = designed(&table, &freedom, Choice::Separating, 4);
    assert_eq!(design.planned, again.planned);
    // The clock goes on, and a changed temperature is waited for.
    let mut before = (660.0, 21.0);
    for planned in &design.planned {
        let exposure = &planned.exposure;
        let (time_s, temperature_c) = (exposure.time_s.unwrap(), exposure.temperature_c.unwrap());
        let wait_s = if temperature_c == before.1 { 60.0 } else { freedom.settle_s };
        assert!(time_s >= before.0 + wait_s - 1e-9, "{exposure:?}");
        assert!((20.0..=21.0).contains(&temperature_c));
        before = (time_s, temperature_c);
    }
    // Random ones from the same conditions tell less.
    let random = designed(&table, &freedom, Choice::Random, 4);
    assert!(random.separations[0].after < 0.8 * separation.after, "{:?}", random.separations);
}

#[test]
fn what_is_held_stays_and_nothing_is_gained_where_nothing_may_change() {
    let folder = tempfile::tempdir().unwrap();
    let table = table(folder.path());
    let held = vec![Factor::Roll, Factor::Temperature, Factor::Wait, Factor::Channel];
    let design = designed(&table, &Freedom { held, ..Freedom::default() }, Choice::Separating, 1);
    for planned in &design.planned {
        assert_eq!(planned.exposure.camera_roll_deg, Some(0.0));
        assert_eq!(planned.exposure.temperature_c, Some(21.0));
        assert_eq!(planned.exposure.mounting, Some(0.0));
    }
    // With the roll free the camera is mounted anew for each of its turns.
    let held = vec![Factor::Temperature, Factor::Wait];
    let design = designed(&table, &Freedom { held, ..Freedom::default() }, Choice::Random, 2);
    let mut before = (0.0, 0.0);
    for planned in &design.planned {
        let now = (planned.exposure.camera_roll_deg.unwrap(), planned.exposure.mounting.unwrap());
        assert_eq!(now.1 - before.1, f64::from(u8::from(now.0 != before.0)));
        before = now;
    }
}

#[test]
fn a_plan_reads_back_and_spots_do_not_merge() {
    let folder = tempfile::tempdir().unwrap();
    let table = table(folder.path());
    let design = designed(&table, &Freedom { points: Some(60), ..Freedom::default() }, Choice::Separating, 1);
    let plan = design.measurement_plan(&setup());
    let out = folder.path().join("plan");
    plan.write(&out, &setup(), 1).unwrap();
    let back = MeasurementPlan::read(&out, &setup()).unwrap();
    assert_eq!(back.exposures, plan.exposures);
    for (own, read) in plan.pattern.screens.iter().zip(&back.pattern.screens) {
        assert_eq!((own.channel, &own.points), (read.channel, &read.points));
        assert!(own.points.len() > 40);
        for (i, a) in own.points.iter().enumerate() {
            for b in &own.points[..i] {
                // 20 px of the camera, whose pixel is 28.4 arcsec, on the screen, whose pixel is 36.4.
                assert!(a.screen_px().distance(b.screen_px()) > 14.0, "{a:?} {b:?}");
            }
        }
    }
    // The brightest count and its exposure time go together: no point is far brighter than the table's were.
    for planned in &design.planned {
        let most = f64::from(*planned.counts.iter().max().unwrap());
        let dose = (most / 255.0).powf(2.2) * planned.exposure.exposure_s.unwrap();
        assert!(dose < 1.05 * 0.02 * (160.0f64 / 255.0).powf(2.2), "{planned:?}");
    }
}

#[test]
fn saturated_points_are_left_out_of_a_plan() {
    let folder = tempfile::tempdir().unwrap();
    let mut table = table(folder.path());
    for row in table.rows.iter_mut().rev().take(3) {
        row.saturated = true;
    }
    assert!(designed(&table, &Freedom::default(), Choice::Separating, 1).gains());
}
