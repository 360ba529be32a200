//! Kernels of `validation/spice_kernels.py` against what CSPICE makes of them, and kernels that do not fit.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use retina_sky::ephemeris::{Ephemeris, EphemerisError};
use retina_sky::orientation::body_from_inertial;
use retina_sky::planets::Planet;
use serde_json::Value;

/// A coordinate of a unit vector: CSPICE's own rounding where Mars and the pebble have turned some 10^5 times.
const TOLERANCE: f64 = 1e-10;
/// Within the binary kernel.
const TDB_S: f64 = 8.585e8 + 5e5;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/spice").join(name)
}

fn read(names: &[&str]) -> Ephemeris {
    Ephemeris::read(&names.iter().map(|name| fixture(name)).collect::<Vec<_>>()).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// Copies of all fixtures, of which one may be changed.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for name in ["all.tm", "axes.bpc", "constants.tpc", "frames.tf", "leap.tls"] {
            fs::copy(fixture(name), folder.path().join(name)).unwrap();
        }
        Self(folder)
    }

    fn change(&self, name: &str, from: &str, to: &str) -> &Self {
        let text = fs::read_to_string(fixture(name)).unwrap();
        assert!(text.contains(from), "{name}: {from}");
        fs::write(self.0.path().join(name), text.replace(from, to)).unwrap();
        self
    }

    fn read(&self, name: &str) -> Result<Ephemeris, String> {
        Ephemeris::read(&[self.0.path().join(name)]).map_err(|error| error.to_string())
    }
}

#[test]
fn bodies_are_turned_as_cspice_turns_them() {
    let expected: Value = serde_json::from_slice(&fs::read(fixture("expected.json")).unwrap()).unwrap();
    let epochs_s = numbers(&expected["tdb_s"]);
    let mut compared = 0;
    for case in expected["cases"].as_array().unwrap() {
        let names: Vec<&str> = case["kernels"].as_array().unwrap().iter().flat_map(Value::as_str).collect();
        let ephemeris = read(&names);
        for (body, matrices) in case["body_from_inertial"].as_object().unwrap() {
            for (tdb_s, rows) in epochs_s.iter().zip(matrices.as_array().unwrap()) {
                let rows: Vec<DVec3> =
                    rows.as_array().unwrap().iter().map(|row| DVec3::from_slice(&numbers(row))).collect();
                let theirs = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
                let turn = ephemeris.body_from_inertial(body, *tdb_s).unwrap().unwrap();
                assert!(DMat3::from_quat(turn).abs_diff_eq(theirs, TOLERANCE), "{names:?} {body} {tdb_s}");
                compared += 1;
            }
            let radii_m = ephemeris.semi_axes_m(body).map(|axes_m| axes_m / 1e3);
            let theirs = &case["radii_km"][body];
            let theirs = (!theirs.is_null()).then(|| DVec3::from_slice(&numbers(theirs)));
            assert_eq!(radii_m.is_some(), theirs.is_some(), "{body}");
            assert!(radii_m.unwrap_or_default().distance(theirs.unwrap_or_default()) < 1e-9);
        }
    }
    assert_eq!(compared, 7 * epochs_s.len());
}

#[test]
fn results_say_what_turns_a_body() {
    let all = read(&["all.tm"]);
    assert_eq!(all.name(), "analytic, leap.tls, constants.tpc, axes.bpc, frames.tf");
    for (body, source) in [
        ("moon", Some("MOON_ME (axes.bpc, frames.tf)")),
        ("earth", Some("ITRF93 (axes.bpc)")),
        ("mars", Some("IAU constants of constants.tpc")),
        ("Pebble", Some("PEBBLE_FIXED (constants.tpc, frames.tf)")),
        ("saturn", None),
        ("rock", None),
    ] {
        assert_eq!(all.axes_source(body).as_deref(), source, "{body}");
    }
    // What no kernel turns is turned as without any, and what none knows is not.
    assert_eq!(all.body_from_inertial("saturn", TDB_S), Ok(body_from_inertial("saturn", TDB_S)));
    assert_eq!(all.body_from_inertial("rock", TDB_S), Ok(None));
    // Principal axes are 860 m from the mean Earth axes on the Moon's surface (NAIF, moon_de440_220930.tf).
    let [me, pa]: [DQuat; 2] = [&all, &read(&["axes.bpc"])]
        .map(|ephemeris| ephemeris.body_from_inertial("moon", TDB_S).unwrap().unwrap());
    let apart_m = 1_737_400.0 * (me * pa.inverse()).to_axis_angle().1.abs();
    assert!((800.0..920.0).contains(&apart_m), "{apart_m}");
}

#[test]
fn radii_of_kernels_take_the_place_of_our_own() {
    let folder = Folder::new();
    folder.change("constants.tpc", "( 1737.4  1737.4  1737.4 )", "( 1738.1 1736.0 )");
    let ephemeris = folder.read("constants.tpc").unwrap();
    // SPICE's last value stands for those that are left out.
    assert_eq!(ephemeris.semi_axes_m("moon"), Some(1e3 * DVec3::new(1738.1, 1736.0, 1736.0)));
    assert_eq!(ephemeris.radii_m(Planet::Moon), [1_738_100.0, 1_736_000.0]);
    let plain = Ephemeris::analytic();
    assert_eq!(ephemeris.radii_m(Planet::Venus), plain.radii_m(Planet::Venus));
    assert_eq!(plain.semi_axes_m("moon"), None);
}

#[test]
fn a_later_kernel_counts_and_a_gap_is_an_error() {
    let all = read(&["all.tm"]);
    let error = all.body_from_inertial("moon", 8.0e8).unwrap_err();
    assert!(matches!(error, EphemerisError::AxesNotCovered { .. }));
    let text = error.to_string();
    assert!(
        text.contains("no axes of moon (NAIF 301)")
            && text.contains("axes.bpc")
            && text.contains("2027-03-16"),
        "{text}"
    );
    let folder = Folder::new();
    folder.change("constants.tpc", "11.35", "12.35");
    let own = folder.0.path().join("constants.tpc");
    let both = Ephemeris::read(&[fixture("constants.tpc"), own.clone()]).unwrap();
    let alone = Ephemeris::read(&[own]).unwrap();
    assert_eq!(both.body_from_inertial("pebble", TDB_S), alone.body_from_inertial("pebble", TDB_S));
    assert_ne!(
        both.body_from_inertial("pebble", TDB_S),
        read(&["constants.tpc"]).body_from_inertial("pebble", TDB_S)
    );
    assert!(alone.turned_bodies().contains(&"body 2990001".to_owned()));
    assert_ne!(both, alone);
}

#[test]
fn kernels_that_do_not_fit_are_refused() {
    for (name, from, to, said) in [
        (
            "constants.tpc",
            "BODY499_PM ",
            "BODY499_PN ",
            "pole and meridian are not complete (found no BODY499_PM",
        ),
        (
            "constants.tpc",
            "( 3396.19 3396.19 3376.20 )",
            "( 3396.19 -1 3376.20 )",
            "`BODY499_RADII`: no radii",
        ),
        ("constants.tpc", "DEGREE = 2", "DEGREE = 9", "no degree (found 9, expected 1 to 3"),
        ("constants.tpc", "0.419057 )", "0.419057 1 )", "there are more terms than angles"),
        (
            "constants.tpc",
            "38280.79631835 12.4",
            "38280.79631835",
            "angles are not complete (found 11 numbers",
        ),
        (
            "constants.tpc",
            "( 0.000068 0.000238",
            "( 'x' 0.000238",
            "`BODY499_NUT_PREC_RA`: a value is no number",
        ),
        (
            "constants.tpc",
            "BODY499_RADII ",
            "BODY499_CONSTANTS_JED_EPOCH = 2433282.5\nBODY499_RADII ",
            "constants of another epoch are not read (expected 2451545",
        ),
        (
            "constants.tpc",
            "BODY499_RADII ",
            "BODY499_CONSTANTS_REF_FRAME = 2\nBODY499_RADII ",
            "constants along other axes are not read",
        ),
        ("frames.tf", "'ANGLES'", "'EULER'", "the fixed offset is not read (found EULER"),
        ("frames.tf", "( 3 2 1 )", "( 3 2 4 )", "`TKFRAME_31009_AXES`: no axis (found 4"),
        ("frames.tf", "ARCSECONDS", "GONS", "the unit is not read (found GONS"),
        ("frames.tf", "( 0.8 0.6 0.0 0.0 )", "( 0.8 0.5 0.0 0.0 )", "`TKFRAME_1990001_Q`: no rotation"),
        ("frames.tf", "( 0.36 0.48 -0.8", "( -0.36 -0.48 0.8", "`TKFRAME_1990002_MATRIX`: no rotation"),
        ("frames.tf", "'PEBBLE_TURNING'\nTK", "'PEBBLE_FIXED'\nTK", "the offsets of the frame do not end"),
        ("frames.tf", "_SPEC       = 'QUATERNION'", "_S = 'Q'", "no TKFRAME_PEBBLE_FIXED_SPEC"),
        (
            "frames.tf",
            "FRAME_1990003_CLASS        = 2",
            "FRAME_1990003_CLASS = 5",
            "frames of this class are not read (found 5",
        ),
        (
            "frames.tf",
            "FRAME_31008_CLASS_ID       = 31008",
            "FRAME_31008_CLASS_ID = 31007",
            "no kernel turns these axes (found nothing of axes 31007",
        ),
        ("frames.tf", "'ITRF93'", "'ITRF94'", "the axes are not defined (found no FRAME_ITRF94"),
        ("leap.tls", "37, @2017-JAN-1", "38, @2017-JAN-1", "TAI - UTC of 38 s on 2017-01-01, expected 37 s"),
        ("all.tm", "leap.tls", "gone.tls", "gone.tls"),
        ("all.tm", "$HERE/leap", "$THERE/leap", "unknown symbol (found $THERE/leap.tls"),
        ("all.tm", "$HERE/leap.tls", "all.tm", "a meta-kernel names another one"),
    ] {
        let folder = Folder::new();
        let read = folder.change(name, from, to).read("all.tm");
        let Err(error) = read else { panic!("{from} -> {to} is taken") };
        assert!(error.contains(said), "{from} -> {to}: {error}");
        assert!(error.contains(name) || error.contains("gone.tls"), "{error}");
    }
    let folder = Folder::new();
    fs::write(folder.0.path().join("events.ek"), [&b"DAF/EK  "[..], &[0; 1016]].concat()).unwrap();
    let meta = folder.change("all.tm", "frames.tf", "events.ek").0.path().join("all.tm");
    let error = Ephemeris::read(&[meta]).unwrap_err();
    assert!(error.to_string().contains("events.ek: a binary kernel of a kind that is not read"), "{error}");
    let help = error.help.unwrap();
    assert!(help.contains("SPK, CK and binary PCK") && help.contains("KERNELS_TO_LOAD"), "{help}");
}

#[test]
fn a_damaged_binary_kernel_is_refused() {
    let folder = Folder::new();
    let whole = fs::read(fixture("axes.bpc")).unwrap();
    let changed = |at: usize, bytes: &[u8]| {
        let mut file = whole.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        fs::write(folder.0.path().join("axes.bpc"), file).unwrap();
        folder.read("axes.bpc").map(|ephemeris| ephemeris.name()).unwrap_err()
    };
    // The first summary: its epochs, axes, reference, type, first and last word.
    let summary = 1024 + 24;
    assert!(
        changed(summary + 20, &2i32.to_le_bytes()).contains("the reference frame of a segment is not read")
    );
    assert!(
        changed(summary + 24, &20i32.to_le_bytes())
            .contains("the type of a segment is not read (found type 20")
    );
    assert!(changed(summary + 32, &i32::MAX.to_le_bytes()).contains("cut short"));
    assert!(changed(summary, &f64::NAN.to_le_bytes()).contains("the kernel is damaged"));
    assert!(changed(8, &3i32.to_le_bytes()).contains("expected 2 and 5, as binary PCK kernels have"));
    assert!(changed(3 * 1024 + 24, &f64::NAN.to_le_bytes()).contains("what is no number"));
    assert!(
        changed(3 * 1024, &1e9f64.to_le_bytes()).contains("segment of axes 31008: the kernel is damaged")
    );
    fs::write(folder.0.path().join("axes.bpc"), &whole[..5000]).unwrap();
    assert!(folder.read("axes.bpc").unwrap_err().contains("cut short"));
}
