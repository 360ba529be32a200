//! Rival models: the odds of measurements against what was expected of them, and mountings that tables share.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use std::path::PathBuf;

use common::{ARCSEC, Campaign, Point, setup};
use glam::DVec2;
use retina_diagnosis::{AddedEffect, Baseline, Dataset, DesignRows, Rival, Rivals, Source, fit};
use retina_formats::Measurements;

const PRISM: &str = "name = \"prism\"\nunit = \"arcsec\"\ndx = \"a * r^2\"\ndy = \"0 * a\"\n[parameters]\na = { start = 1.0, unit = \"arcsec\" }\n";
const SQUARE: &str = "name = \"square\"\nunit = \"arcsec\"\ndx = \"a * x^2\"\ndy = \"0 * a\"\n[parameters]\na = { start = 1.0, unit = \"arcsec\" }\n";

fn rivals(data: &Dataset) -> Vec<Rival> {
    [("prism", PRISM), ("square", SQUARE)]
        .map(|(name, text)| Rival {
            name: name.to_owned(),
            effects: vec![AddedEffect::of_text(name, text, data).unwrap()],
        })
        .to_vec()
}

/// Half the camera's width as a tangent: x is 1 there.
fn place(point: &Point) -> DVec2 {
    let setup = setup();
    let camera = setup.camera_pinhole();
    let half = 0.5 * f64::from(camera.width_px) / camera.fx_px;
    setup.facility_pinhole().line_of_sight(point.screen_px) / half
}

/// 2 ln L_1 / L_2 is normal about T_12 with a variance of 4 T_12 if the first is true, and about -T_21 if the second is
/// (D. R. Cox, Journal of the Royal Statistical Society B 24, 1962, for linear models of one length).
#[test]
fn the_odds_are_those_that_were_expected() {
    for (truth, size) in [(0, 4.0), (1, 4.0), (0, 2.5)] {
        let effect = |point: &Point| {
            let at = place(point);
            let square = if truth == 0 { at.length_squared() } else { at.x * at.x };
            point.r + DVec2::new(size * square, 0.0) * ARCSEC
        };
        let campaign = Campaign { outliers: 0.0, ..Campaign::new(5 + truth as u64) };
        let data = campaign.data(&setup(), &effect);
        let rivals = rivals(&data);
        let fitted = Rivals::fit(&data, &rivals).unwrap();
        let rows = DesignRows { data: &data, measured: &|_| true, stands_for: 1.0, planned_for: 1.0 };
        let expected = fitted.separations(&rows)[truth][1 - truth].square;
        let said = fitted.judgements();
        let found = 2.0 * (said[truth].ln_likelihood - said[1 - truth].ln_likelihood);
        // Tukey's weights take some of the normal errors' square away.
        let apart = (found - expected).abs();
        assert!(expected > 20.0 && apart < 0.15 * expected + 6.0 * expected.sqrt(), "{expected} {found}");
        assert!(said[1 - truth].ln_odds_against > 4.6, "{said:?}");
    }
}

/// Without a difference neither is ruled out, however often one looks: with no effect at all both fit alike.
#[test]
fn nothing_is_decided_where_there_is_nothing() {
    for seed in 0..6 {
        let data = Campaign::new(40 + seed).data(&setup(), &|point| point.r);
        let rivals = rivals(&data);
        let fitted = Rivals::fit(&data, &rivals).unwrap();
        assert!(fitted.judgements().iter().all(|j| j.ln_odds_against < 4.6), "{:?}", fitted.judgements());
    }
}

/// Names of fitted parameters of a campaign and its second half as a table of its own.
fn parameters(mounting: Option<&str>) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let text = Campaign { rows: 400, exposures: 20, ..Campaign::new(3) }.table(&setup(), &|point| point.r);
    let (head, rows) = text.split_once('\n').unwrap();
    let lines: Vec<&str> = rows.lines().collect();
    let first = format!("{head}\n{}\n", lines[..200].join("\n"));
    let second = match mounting {
        None => format!("{head}\n{}\n", lines[200..].join("\n")),
        Some(number) => {
            let rows: Vec<String> = lines[200..].iter().map(|line| format!("{line},{number}")).collect();
            format!("{head},mounting\n{}\n", rows.join("\n"))
        }
    };
    let files: Vec<PathBuf> = ["a.csv", "b.csv"].map(|name| folder.path().join(name)).to_vec();
    std::fs::write(&files[0], first).unwrap();
    std::fs::write(&files[1], second).unwrap();
    let tables = Measurements::read(&files).unwrap();
    let data = Dataset::new(&Source {
        tables: &tables,
        setup: &setup(),
        calibration: None,
        response: None,
        baseline: Baseline::Physical,
    })
    .unwrap();
    fit(&data, &[]).unwrap().parameters.into_iter().map(|parameter| parameter.name).collect()
}

#[test]
fn tables_share_a_mounting_where_they_say_so() {
    let anew = |names: Vec<String>| names.iter().any(|name| name == "shift_x_arcsec_1");
    assert!(anew(parameters(None)));
    assert!(anew(parameters(Some("1"))));
    assert!(!anew(parameters(Some("0"))));
}
