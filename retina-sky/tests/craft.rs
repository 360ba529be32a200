//! Spacecraft kernels of `validation/spice_craft.py` against what CSPICE makes of them, and kernels that do not fit.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use retina_sky::ephemeris::{Ephemeris, LIGHT_SPEED_M_S};
use retina_sky::spacecraft::{Pointing, SpacecraftFrames, camera_from_axes};
use serde_json::Value;

/// Epochs that the kernels cover, and the gap in the bus' attitudes, TDB seconds since J2000.
const SPAN_S: [f64; 2] = [8.585e8, 8.585e8 + 199.0 * 600.0];
const GAP_S: [f64; 2] = [8.585e8 + 90.0 * 600.0, 8.585e8 + 100.0 * 600.0];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/spice/craft").join(name)
}

/// Copies of the fixtures, one of which a function changes.
fn changed(name: &str, change: impl Fn(Vec<u8>) -> Vec<u8>) -> Result<Ephemeris, String> {
    let folder = tempfile::tempdir().unwrap();
    let kernels: Vec<PathBuf> = ["craft.tsc", "craft.tf", "craft.bsp", "craft.bc"]
        .iter()
        .map(|own| {
            let bytes = fs::read(fixture(own)).unwrap();
            let path = folder.path().join(own);
            fs::write(&path, if *own == name { change(bytes) } else { bytes }).unwrap();
            path
        })
        .collect();
    Ephemeris::read(&kernels).map_err(|error| error.to_string())
}

fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let text = String::from_utf8(bytes.to_vec()).unwrap();
    assert!(text.contains(from), "{from}");
    text.replace(from, to).into_bytes()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

#[test]
fn craft_and_comet_are_where_cspice_has_them_and_turned_so() {
    let expected: Value = serde_json::from_slice(&fs::read(fixture("expected.json")).unwrap()).unwrap();
    let ephemeris = Ephemeris::read(&[fixture("craft.tm")]).unwrap();
    let epochs_s = numbers(&expected["tdb_s"]);
    let instants_s = numbers(&expected["instants_tdb_s"]);
    let mut compared = 0;
    for (frame, matrices) in expected["frame_from_inertial"].as_object().unwrap() {
        let times_s = if frame == "CRAFT_SCANNER" { &instants_s } else { &epochs_s };
        for (tdb_s, rows) in times_s.iter().zip(matrices.as_array().unwrap()) {
            let rows: Vec<DVec3> =
                rows.as_array().unwrap().iter().map(|row| DVec3::from_slice(&numbers(row))).collect();
            let theirs = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            let turn = ephemeris.frame_from_inertial(frame, *tdb_s).unwrap();
            assert!(DMat3::from_quat(turn).abs_diff_eq(theirs, 1e-9), "{frame} {tdb_s}");
            compared += 1;
        }
    }
    for (body, states) in expected["states_m"].as_object().unwrap() {
        for (tdb_s, state) in epochs_s.iter().zip(states.as_array().unwrap()) {
            let (own, theirs) = (ephemeris.state(body, *tdb_s).unwrap(), numbers(state));
            // The polynomials go through places of 2e11 m.
            assert!(own.position_m.distance(DVec3::from_slice(&theirs)) < 0.01, "{body} {tdb_s}");
            assert!(own.velocity_m_s.distance(DVec3::from_slice(&theirs[3..])) < 1e-6, "{body} {tdb_s}");
        }
    }
    assert_eq!(compared, 4 * epochs_s.len());
    // A body's own axes by a CK kernel, as a frame's.
    let tdb_s = epochs_s[0];
    assert_eq!(
        ephemeris.body_from_inertial("comet", tdb_s).unwrap(),
        Some(ephemeris.frame_from_inertial("COMET_FIXED", tdb_s).unwrap())
    );
    assert_eq!(ephemeris.axes_source("comet").as_deref(), Some("COMET_FIXED (craft.bc, craft.tf)"));
}

/// The comet is 40 km away, and its place of 2e11 m is rounded to 3 mm. CSPICE's `LT+S` has no deflection by the Sun,
/// which is none so near.
#[test]
fn the_comet_stands_where_the_camera_sees_it() {
    let expected: Value = serde_json::from_slice(&fs::read(fixture("expected.json")).unwrap()).unwrap();
    let ephemeris = Ephemeris::read(&[fixture("craft.tm")]).unwrap();
    let places = expected["comet_seen_camera_m"].as_array().unwrap();
    for (epoch_tdb_s, theirs) in numbers(&expected["tdb_s"]).into_iter().zip(places) {
        let frames = |pointing: Pointing| {
            let (observer, bodies) = ("craft".to_owned(), vec!["comet".to_owned()]);
            let wanted =
                SpacecraftFrames { observer, pointing, bodies, frames: 2, step_s: 1e-3, epoch_tdb_s };
            wanted.generate(&ephemeris).unwrap().frames.remove(0)
        };
        // The camera's right is its frame's y, its down -x.
        let camera_from_frame = camera_from_axes(["+y", "-x", "+z"]).unwrap();
        let pose = frames(Pointing::Frame { name: "CRAFT_CAMERA".to_owned(), camera_from_frame });
        let comet = pose.bodies["comet"];
        let from_m = comet.position_m - pose.camera_position_m;
        let theirs = DVec3::from_slice(&numbers(theirs));
        let seen = pose.camera_from_inertial * from_m;
        assert!(seen.normalize().distance(DVec3::new(theirs.y, -theirs.x, theirs.z).normalize()) < 1e-7);
        assert!((from_m.length() - theirs.length()).abs() < 1.0, "{}", from_m.length() - theirs.length());
        // The Sun over the comet is where it is, though the comet's place is an apparent one.
        let light_s = from_m.length() / LIGHT_SPEED_M_S;
        let [sun, there] =
            ["10", "comet"].map(|body| ephemeris.state(body, epoch_tdb_s - light_s).unwrap().position_m);
        let over_m = pose.sun_position_m.unwrap() - comet.position_m;
        assert!(over_m.normalize().distance((sun - there).normalize()) < 1e-7);
        assert_eq!(
            pose.camera_velocity_m_s,
            Some(ephemeris.state("-999", epoch_tdb_s).unwrap().velocity_m_s)
        );
        let looking = frames(Pointing::FirstBody);
        assert!((looking.camera_from_inertial * from_m).normalize().distance(DVec3::Z) < 1e-9);
    }
}

#[test]
fn an_attitude_that_is_not_there_is_an_error() {
    let ephemeris = Ephemeris::read(&[fixture("craft.tm")]).unwrap();
    let said = |frame: &str, tdb_s: f64| ephemeris.frame_from_inertial(frame, tdb_s).unwrap_err().to_string();
    let inside_s = 0.5 * (GAP_S[0] + GAP_S[1]);
    for frame in ["CRAFT_BUS", "-999000", "CRAFT_CAMERA"] {
        assert!(
            said(frame, inside_s).contains("with a gap from 2027-03-17T11:13:20.0000"),
            "{}",
            said(frame, inside_s)
        );
        for at_s in [GAP_S[0], GAP_S[1] + 1e-3, SPAN_S[0] + 1e-3, SPAN_S[1] - 1e-3] {
            ephemeris.frame_from_inertial(frame, at_s - 1e-4).unwrap();
        }
    }
    for at_s in [SPAN_S[0] - 2.0, SPAN_S[1] + 2.0] {
        let text = said("CRAFT_BUS", at_s);
        assert!(text.contains("no axes of CRAFT_BUS at 2027-03-1") && !text.contains("gap"), "{text}");
        assert!(text.contains("craft.bc has attitudes of -999000 from 2027-03-16T20:13:20.0000"), "{text}");
    }
    // Between the instants of type 1.
    assert!(said("CRAFT_SCANNER", SPAN_S[0] + 300.0).contains("gap"));
    let unknown = said("CRAFT_LIDAR", inside_s);
    assert!(
        unknown.contains("the axes are not defined") && unknown.contains("FRAME_CRAFT_LIDAR"),
        "{unknown}"
    );
    let text = ephemeris.state("CRAFT", SPAN_S[0] - 1e6).unwrap_err().to_string();
    assert!(text.contains("craft.bsp") && text.contains("covers it from"), "{text}");
    assert!(ephemeris.state("LANDER", SPAN_S[0]).unwrap_err().to_string().contains("no ephemeris of LANDER"));
    assert!(ephemeris.state("-998", SPAN_S[0]).unwrap_err().to_string().contains("body -998"));
}

#[test]
fn kernels_that_do_not_fit_are_refused_or_said_when_asked() {
    let at_s = SPAN_S[0] + 50.0;
    let frame = |ephemeris: &Ephemeris, name: &str| ephemeris.frame_from_inertial(name, at_s);
    // Without the clock.
    let clockless = changed("craft.tsc", |_| b"KPL/SCLK\n\\begindata\nNOTHING = 1\n".to_vec()).unwrap();
    let text = frame(&clockless, "CRAFT_BUS").unwrap_err().to_string();
    assert!(text.contains("no kernel has the clock of -999000") && text.contains(".tsc"), "{text}");
    // Without the attitudes.
    let still = Ephemeris::read(&[fixture("craft.tsc"), fixture("craft.tf")]).map_err(|e| e.to_string());
    let still = still.unwrap();
    assert!(frame(&still, "CRAFT_BUS").unwrap_err().to_string().contains("no CK kernel has attitudes"));
    for (from, to, said) in [
        ("SCLK_DATA_TYPE_999       = ( 1 )", "SCLK_DATA_TYPE_999 = ( 2 )", "clocks of this type"),
        ("TIME_SYSTEM_999   = ( 2 )", "TIME_SYSTEM_999 = ( 3 )", "the time system is not read"),
        ("SCLK01_MODULI_999 ", "SCLK01_MODULA_999 ", "no SCLK01_MODULI_999"),
        ("( 4294967296 65536 )", "( 4294967296 0 )", "a field has no counts"),
        ("3.6000000000000E+11 ", "3.0000000000000E+11 ", "do not read"),
        ("    1.0000002000000E+00 )", " )", "do not read"),
    ] {
        let text = changed("craft.tsc", |bytes| replaced(&bytes, from, to)).unwrap_err();
        assert!(text.contains(said) && text.contains("craft.tsc"), "{to}: {text}");
    }
    let ring = |bytes: Vec<u8>| replaced(&bytes, "RELATIVE   = 'CRAFT_GIMBAL'", "RELATIVE = 'CRAFT_CAMERA'");
    let ringed = changed("craft.tf", ring).unwrap();
    assert!(frame(&ringed, "CRAFT_CAMERA").unwrap_err().to_string().contains("do not end"));
    // A segment of a type that is not read, and words that cannot be: the first summary begins at byte 1048.
    let summary = 1024 + 24;
    let whole = fs::read(fixture("craft.bc")).unwrap();
    let with = |at: usize, new: &[u8]| {
        let mut bytes = whole.clone();
        bytes[at..at + new.len()].copy_from_slice(new);
        bytes
    };
    let first_word = i32::from_le_bytes(whole[summary + 32..summary + 36].try_into().unwrap()) as usize;
    let last_word = i32::from_le_bytes(whole[summary + 36..summary + 40].try_into().unwrap()) as usize;
    for (bytes, said) in [
        (with(summary + 24, &5i32.to_le_bytes()), "the type of a segment is not read (found type 5"),
        (with(8 * (last_word - 1), &12.0f64.to_le_bytes()), "attitudes in 2 intervals"),
        (with(8 * (last_word - 1), &f64::NAN.to_le_bytes()), "what is no number"),
        (with(8 * (last_word - 2), &0.0f64.to_le_bytes()), "a count of 0"),
        (with(8 * (first_word - 1), &3.0f64.to_le_bytes()), "a quaternion of norm"),
        (with(8 * (first_word + 4 * 191), &0.0f64.to_le_bytes()), "instant 2 at 0 ticks"),
        (whole[..whole.len() - 1024].to_vec(), "cut short"),
    ] {
        let text = changed("craft.bc", |_| bytes.clone()).unwrap_err();
        assert!(text.contains(said) && text.contains("craft.bc"), "{said}: {text}");
    }
}

/// Random bytes in the attitudes are refused or turn something; nothing panics.
#[test]
fn changed_words_of_attitudes_never_panic() {
    let whole = fs::read(fixture("craft.bc")).unwrap();
    let mut refused = 0;
    for (trial, word) in (128..whole.len() / 8).step_by(61).enumerate() {
        let wrong = [f64::MAX, -1.0, 0.0, 1e300, f64::MIN_POSITIVE, 1e12, 200.0][trial % 7];
        let mut bytes = whole.clone();
        bytes[8 * word..8 * word + 8].copy_from_slice(&wrong.to_le_bytes());
        match changed("craft.bc", |_| bytes.clone()) {
            Err(_) => refused += 1,
            Ok(ephemeris) => {
                for step in 0..20 {
                    for frame in ["CRAFT_BUS", "CRAFT_CAMERA", "CRAFT_SCANNER", "COMET_FIXED"] {
                        let turn = ephemeris.frame_from_inertial(frame, SPAN_S[0] + 6000.0 * f64::from(step));
                        assert!(turn.is_err() || (turn.unwrap().length() - 1.0).abs() < 1e-9);
                    }
                }
            }
        }
    }
    assert!(refused > 10, "{refused}");
}
