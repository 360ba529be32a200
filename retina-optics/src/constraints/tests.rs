use super::*;

fn range(change: impl FnOnce(&mut PaperModel)) -> FieldRange {
    let mut model = PaperModel::paper(86.8, 82.8);
    change(&mut model);
    model.field_range(&BenchLimits::PAPER).unwrap()
}

/// Worked out independently for the facility's focal lengths; digits beyond those given were cut.
#[test]
fn the_facilitys_field() {
    let got = range(|_| ());
    assert!((got.min_rad.to_degrees() - 2.06).abs() < 0.005, "{got:?}");
    assert!((got.max_rad.to_degrees() - 18.84).abs() < 0.01, "{got:?}");
    assert_eq!((got.limit_at_min, got.limit_at_max), (Limit::TotalLength, Limit::RelayVignetting));
    for (factor, expected_deg) in [(1.15, 23.1), (1.2, 22.2)] {
        let got = range(|model| model.pupil_collimator_mm = factor * 86.8);
        assert!((got.max_rad.to_degrees() - expected_deg).abs() < 0.05, "{factor}: {got:?}");
    }
    // The paper's 22 deg is reached with pupils of 7 mm and less.
    assert!(range(|model| model.pupil_mm = 7.0).max_rad.to_degrees() > 22.0);
    assert!(range(|model| model.pupil_mm = 7.5).max_rad.to_degrees() < 22.0);
}

#[test]
fn beams_at_22_deg() {
    let layout = PaperModel::paper(86.8, 82.8).at_tan(11f64.to_radians().tan());
    assert!((layout.collimator_beam_mm - 21.9).abs() < 0.05, "{layout:?}");
    assert!((layout.relay_beam_mm - 28.9).abs() < 0.05, "{layout:?}");
}

/// s_cam = f_c makes the chief ray parallel to the axis behind the collimator: r_r is
/// f_c t + (d / 2) f_r (1 + |M|) / f_c. Without vignetting the field ends where
/// |M| + 1 / |M| = (850 - f_c) / f_r - 2 on both sides.
#[test]
fn closed_forms() {
    let model = PaperModel::paper(100.0, 90.0);
    let layout = model.at_tan(0.1);
    let m = 2.0 * 100.0 * 0.1 / 22.09;
    assert!((layout.relay_beam_mm - (10.0 + 5.0 * 90.0 * (1.0 + m) / 100.0)).abs() < 1e-12);
    assert!((1.0 / layout.screen_relay_mm + 1.0 / layout.relay_image_mm - 1.0 / 90.0).abs() < 1e-15);

    let open = PaperModel { collimator_diameter_mm: 1e4, relay_diameter_mm: 1e4, ..model };
    let got = open.field_range(&BenchLimits { screen_relay_mm: 1.0, ..BenchLimits::PAPER }).unwrap();
    let k: f64 = 750.0 / 90.0 - 2.0;
    let m = [(k - (k * k - 4.0).sqrt()) / 2.0, (k + (k * k - 4.0).sqrt()) / 2.0];
    assert!((got.min_rad - 2.0 * (m[0] * 22.09 / 200.0).atan()).abs() < 1e-12);
    assert!((got.max_rad - 2.0 * (m[1] * 22.09 / 200.0).atan()).abs() < 1e-12);
    assert_eq!((got.limit_at_min, got.limit_at_max), (Limit::TotalLength, Limit::TotalLength));
}

/// Every limit can bind: s_or >= 100 gives |M| <= f_r / (100 - f_r); s_rc >= 100 gives
/// |M| >= (100 - f_c) / f_r - 1; r_c = s_cam t + d / 2.
#[test]
fn each_limit_binds_where_it_must() {
    let open = |f_c, f_r| PaperModel {
        collimator_diameter_mm: 1e4,
        relay_diameter_mm: 1e4,
        ..PaperModel::paper(f_c, f_r)
    };
    let got = open(86.8, 60.0).field_range(&BenchLimits::PAPER).unwrap();
    assert_eq!(got.limit_at_max, Limit::ScreenRelayDistance);
    assert!((got.max_rad - 2.0 * (1.5 * 22.09 / 2.0 / 86.8_f64).atan()).abs() < 1e-12);

    let got = open(30.0, 45.0).field_range(&BenchLimits::PAPER).unwrap();
    assert_eq!((got.limit_at_min, got.limit_at_max), (Limit::InterLensDistance, Limit::ScreenRelayDistance));
    assert!((got.min_rad - 2.0 * ((70.0 / 45.0 - 1.0) * 22.09 / 2.0 / 30.0_f64).atan()).abs() < 1e-12);

    let narrow = PaperModel { collimator_diameter_mm: 20.0, ..open(86.8, 82.8) };
    let got = narrow.field_range(&BenchLimits::PAPER).unwrap();
    assert_eq!(got.limit_at_max, Limit::CollimatorVignetting);
    assert!((got.max_rad - 2.0 * (5.0 / 86.8_f64).atan()).abs() < 1e-12);

    assert_eq!(PaperModel::paper(700.0, 200.0).field_range(&BenchLimits::PAPER), None);
}

/// The roots against a scan in steps of 0.001 deg over many focal lengths.
#[test]
fn closed_form_ends_agree_with_a_scan() {
    for f_c in [40.0, 86.8, 140.0, 200.0] {
        for f_r in [50.0, 82.8, 120.0] {
            for factor in [0.8, 1.0, 1.3] {
                let model = PaperModel { pupil_collimator_mm: factor * f_c, ..PaperModel::paper(f_c, f_r) };
                let holds = |i: i32| {
                    let layout = model.at_tan((f64::from(i) * 5e-4).to_radians().tan());
                    layout.total_length_mm <= 850.0
                        && layout.screen_relay_mm >= 100.0
                        && layout.inter_lens_mm >= 100.0
                        && layout.relay_beam_mm.max(layout.collimator_beam_mm) <= 25.4
                };
                // The longest run of steps that hold.
                let (mut best, mut run) = ((0, 0), 0);
                for i in 1..90_000 {
                    run = if holds(i) { run + 1 } else { 0 };
                    if run > best.1 - best.0 {
                        best = (i - run, i);
                    }
                }
                let got = model.field_range(&BenchLimits::PAPER);
                assert_eq!(got.is_some(), best.1 > 0, "{f_c} {f_r} {factor}: {got:?} {best:?}");
                if let Some(got) = got {
                    let scanned = [f64::from(best.0 + 1) * 1e-3, f64::from(best.1) * 1e-3];
                    assert!((got.min_rad.to_degrees() - scanned[0]).abs() < 1.1e-3, "{got:?} {scanned:?}");
                    assert!((got.max_rad.to_degrees() - scanned[1]).abs() < 1.1e-3, "{got:?} {scanned:?}");
                }
            }
        }
    }
}
