//! SPK kernels of circular motions in closed form, read back; and files that are none.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::path::PathBuf;

use glam::DVec3;
use retina_sky::ephemeris::{Ephemeris, EphemerisError, LIGHT_SPEED_M_S, State};
use retina_sky::observer::{Observer, separation_rad};
use retina_sky::planets::{Planet, planets_in_cone, seen_planet, seen_planets};

#[path = "common/spk.rs"]
mod spk;

use spk::{Circle, kernel, solar_system};

/// 2027 March 18 or so.
const FROM_S: f64 = 8.585e8;
const RECORDS: usize = 20;
const DAY_S: f64 = 86_400.0;

/// A folder with files, and the ephemeris that is read of them.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    fn read(&self, name: &str, bytes: &[u8]) -> Result<Ephemeris, String> {
        Ephemeris::read(&[self.file(name, bytes)]).map_err(|error| error.to_string())
    }
}

/// The closed form of a body of [`solar_system`], in its system's chain.
fn expected(target: i32, tdb_s: f64) -> State {
    let bodies = solar_system();
    let (mut at, mut state) = (target, State { position_m: DVec3::ZERO, velocity_m_s: DVec3::ZERO });
    while at != 0 {
        let body = bodies.iter().find(|body| body.target == at).unwrap();
        let [place, rate] = body.state_km(tdb_s).map(|v| DVec3::from_array(v) * 1e3);
        state = State { position_m: state.position_m + place, velocity_m_s: state.velocity_m_s + rate };
        at = body.centre;
    }
    state
}

fn number(planet: Planet) -> i32 {
    match planet {
        Planet::Earth => 399,
        Planet::Moon => 301,
        other => [1, 2, 0, 0, 4, 5, 6, 7, 8][other as usize],
    }
}

#[test]
fn places_are_those_of_the_closed_form() {
    let folder = Folder::new();
    let ephemeris = folder.read("circles.bsp", &kernel(&solar_system(), FROM_S, RECORDS)).unwrap();
    // Ends of the span, seams of records, and between.
    for day in [0.0, 4.0, 7.3, 40.0, 55.123_456_789, 80.0] {
        let tdb_s = FROM_S + day * DAY_S;
        for planet in Planet::ALL {
            let off_m =
                ephemeris.position_m(planet, tdb_s).unwrap() - expected(number(planet), tdb_s).position_m;
            // Neptune's coordinates end at 1 mm in a double, anise's sums a little before.
            assert!(off_m.length() < 0.05, "{planet:?}: {off_m}");
        }
        let bodies = ephemeris.solar_system(tdb_s).unwrap();
        for (state, target) in [(bodies.sun, 10), (bodies.earth, 399), (bodies.moon, 301)] {
            let expected = expected(target, tdb_s);
            assert!((state.position_m - expected.position_m).length() < 0.05, "{target}");
            assert!((state.velocity_m_s - expected.velocity_m_s).length() < 1e-5, "{target}");
        }
        let moon = ephemeris.moon_from_earth(tdb_s).unwrap();
        let [there, here] = [301, 399].map(|target| expected(target, tdb_s).position_m);
        assert!((moon.position_m - (there - here)).length() < 0.05);
    }
}

#[test]
fn light_leaves_the_planets_where_the_kernel_had_them() {
    let folder = Folder::new();
    let ephemeris = folder.read("circles.bsp", &kernel(&solar_system(), FROM_S, RECORDS)).unwrap();
    let (tdb_s, place_m) = (FROM_S + 60.0 * DAY_S, DVec3::new(1.1e11, -0.7e11, 2e10));
    let observer = Observer::new(&ephemeris, tdb_s, place_m, None).unwrap();
    for planet in Planet::ALL {
        let mut light_s = 0.0;
        for _ in 0..8 {
            let then_m = expected(number(planet), tdb_s - light_s).position_m;
            light_s = (then_m - place_m).length() / LIGHT_SPEED_M_S;
        }
        let seen = seen_planet(&observer, planet).unwrap().unwrap();
        assert!((seen.distance_m - light_s * LIGHT_SPEED_M_S).abs() < 200.0, "{planet:?}");
        let there = expected(number(planet), tdb_s - light_s).position_m - place_m;
        // The Sun's deflection is left, 0.1 arcsec some 5 deg from it.
        assert!(separation_rad(seen.direction, there) < 5e-7, "{planet:?}");
        let found = planets_in_cone(&observer, seen.direction, 1e-9).unwrap();
        assert!(found.iter().any(|other| other.planet == planet));
    }
}

#[test]
fn a_planets_centre_and_a_later_kernel_count() {
    let folder = Folder::new();
    let all = solar_system();
    let first = folder.file("first.bsp", &kernel(&all, FROM_S, RECORDS));
    let centre = Circle { target: 599, centre: 5, radius_km: 200.0, period_d: 7.0 };
    let second = folder.file("second.bsp", &kernel(&[centre], FROM_S, RECORDS));
    let sun = Circle { radius_km: 1e6, ..all[0] };
    let third = folder.file("third.bsp", &kernel(&[sun], FROM_S + 8.0 * DAY_S, 2));
    let ephemeris = Ephemeris::read(&[first.clone(), second.clone(), third]).unwrap();
    assert_eq!(ephemeris.name(), "first.bsp, second.bsp, third.bsp");
    let tdb_s = FROM_S + 9.0 * DAY_S;
    let off_m = ephemeris.position_m(Planet::Jupiter, tdb_s).unwrap() - expected(5, tdb_s).position_m;
    assert!((off_m - DVec3::from_array(centre.state_km(tdb_s)[0]) * 1e3).length() < 0.05, "{off_m}");
    // The third has the Sun from the eighth day to the sixteenth.
    for (day, own) in [(7.0, all[0]), (9.0, sun), (17.0, all[0])] {
        let tdb_s = FROM_S + day * DAY_S;
        let found_m = ephemeris.solar_system(tdb_s).unwrap().sun.position_m;
        assert!((found_m - DVec3::from_array(own.state_km(tdb_s)[0]) * 1e3).length() < 0.05, "{day}");
    }
    // What two ephemerides are is their content, not their names.
    let copy = folder.file("copy.bsp", &std::fs::read(&first).unwrap());
    let read = |paths: &[&PathBuf]| {
        Ephemeris::read(&paths.iter().map(|p| (*p).clone()).collect::<Vec<_>>()).unwrap()
    };
    assert_eq!(read(&[&first]), read(&[&copy]));
    assert_ne!(read(&[&first, &second]), read(&[&second, &first]));
    assert_ne!(read(&[&first]), Ephemeris::analytic());
    assert_eq!(
        (Ephemeris::read(&[]).unwrap(), Ephemeris::analytic().name()),
        (Ephemeris::analytic(), "analytic".into())
    );
}

#[test]
fn what_a_kernel_lacks_is_an_error_and_not_the_theory() {
    let folder = Folder::new();
    let without = |target: i32| {
        let bodies: Vec<Circle> = solar_system().into_iter().filter(|body| body.target != target).collect();
        folder.read("short.bsp", &kernel(&bodies, FROM_S, RECORDS)).unwrap()
    };
    let inside_s = FROM_S + DAY_S;
    let error = without(4).position_m(Planet::Mars, inside_s).unwrap_err();
    assert!(matches!(error, EphemerisError::NoBody { .. }));
    let text = error.to_string();
    assert!(
        text.contains("no ephemeris of the barycentre of mars (NAIF 4)") && text.contains("short.bsp"),
        "{text}"
    );
    // The Earth is not where the barycentre of Earth and Moon is, and cannot do without it.
    let text = without(399).solar_system(inside_s).unwrap_err().to_string();
    assert!(text.contains("earth (NAIF 399)"), "{text}");
    let text = without(3).solar_system(inside_s).unwrap_err().to_string();
    assert!(text.contains("the barycentre of Earth and Moon (NAIF 3)"), "{text}");
    assert!(Observer::new(&without(10), inside_s, DVec3::X, None).is_err());
    let neptune = without(8);
    let observer =
        Observer::new(&neptune, inside_s + 9.0 * DAY_S, DVec3::new(1.1e11, 1e10, 1e10), None).unwrap();
    assert!(seen_planets(&observer).unwrap_err().to_string().contains("neptune"));

    let all = folder.read("all.bsp", &kernel(&solar_system(), FROM_S, RECORDS)).unwrap();
    for tdb_s in [FROM_S - 1.0, FROM_S + 80.0 * DAY_S + 1.0, 0.0, f64::NAN, f64::INFINITY] {
        let error = all.solar_system(tdb_s).unwrap_err();
        assert!(matches!(error, EphemerisError::NotCovered { .. }), "{error}");
        // 8.585e8 s are 9936 days, 8 h 13 min and 20 s after 2000 January 1, 12 h: 2027 March 16.
        let text = error.to_string();
        assert!(
            text.contains("covers it from 2027-03-16T20:13:20.000000 TDB to 2027-06-04T20:13:20"),
            "{text}"
        );
        assert!(text.contains("all.bsp") && text.contains("(NAIF "), "{text}");
    }
    // Light from Neptune left four hours before the kernel begins.
    let observer = Observer::new(&all, FROM_S + 3600.0, DVec3::new(1.1e11, 1e10, 1e10), None).unwrap();
    assert!(seen_planet(&observer, Planet::Neptune).unwrap_err().to_string().contains("neptune"));
}

#[test]
fn files_that_are_no_whole_kernel_are_refused() {
    let folder = Folder::new();
    let whole = kernel(&solar_system(), FROM_S, 2);
    let refused = |name: &str, bytes: &[u8]| folder.read(name, bytes).unwrap_err();
    let changed = |at: usize, bytes: &[u8]| {
        let mut file = whole.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        file
    };
    assert!(folder.read("whole.bsp", &whole).is_ok());
    let cut = refused("cut.bsp", &whole[..whole.len() - 8]);
    assert!(cut.contains("cut.bsp: the kernel is cut short"), "{cut}");
    assert!(
        cut.contains(&format!("found {} bytes, expected {} bytes", whole.len() - 8, whole.len())),
        "{cut}"
    );
    assert!(refused("cut.bsp", &whole[..1500]).contains("is cut short"));
    let short = refused("short.bsp", b"DAF/SPK ");
    assert!(short.contains("is cut short (found 8 bytes, expected 1024 bytes"), "{short}");
    for (name, bytes) in [
        ("empty.bsp", &b""[..]),
        ("text.bsp", b"a table of planets, as text"),
        ("attitude.bc", &changed(0, b"DAF/XYZ ")),
    ] {
        let text = refused(name, bytes);
        assert!(
            text.contains(if name == "attitude.bc" { "is not read here" } else { "is no SPICE kernel" })
                && text.contains(name),
            "{text}"
        );
    }
    assert!(
        refused("big.bsp", &changed(88, b"BIG-IEEE")).contains("byte order is not read (found `BIG-IEEE`")
    );
    // The first summary: its epochs, target, centre, axes, type, words.
    let summary = 1024 + 24;
    let axes = refused("ecliptic.bsp", &changed(summary + 24, &17i32.to_le_bytes()));
    assert!(axes.contains("the Sun (NAIF 10): the axes of a segment are not read (found frame 17"), "{axes}");
    let kind = refused("type.bsp", &changed(summary + 28, &21i32.to_le_bytes()));
    assert!(kind.contains("the type of a segment is not read (found type 21"), "{kind}");
    for damaged in [
        changed(8, &3i32.to_le_bytes()),
        changed(76, &0i32.to_le_bytes()),
        changed(1024, &2f64.to_le_bytes()),
        changed(1024 + 16, &99f64.to_le_bytes()),
        changed(summary, &f64::NAN.to_le_bytes()),
        changed(summary + 32, &0i32.to_le_bytes()),
    ] {
        assert!(refused("damaged.bsp", &damaged).contains("the kernel is damaged"));
    }
    // A coefficient of the Sun's: anise would panic on it.
    let broken = refused("nan.bsp", &changed((3 * 128 + 5) * 8, &f64::NAN.to_le_bytes()));
    assert!(broken.contains("the kernel is damaged (found what is no number"), "{broken}");
    assert!(broken.contains("segment of the Sun (NAIF 10), word 390"), "{broken}");
    // Words of the Sun's segment: 2 records of 50, then epoch, length, size and number of records.
    let zero_size = changed((3 * 128 + 102) * 8, &0f64.to_le_bytes());
    let size = refused("size.bsp", &zero_size);
    assert!(
        size.contains("segment of the Sun (NAIF 10): the kernel is damaged (found 100 words in 2"),
        "{size}"
    );
    let missing = Ephemeris::read(&[folder.0.path().join("none.bsp")]).unwrap_err().to_string();
    assert!(missing.contains("none.bsp"), "{missing}");
}

/// A word that has changed is refused, or moves nothing by more than 1 km and 1e-8 of the distance to the Sun.
#[test]
fn a_changed_word_is_refused_or_changes_nothing() {
    let folder = Folder::new();
    let whole = kernel(&solar_system(), FROM_S, 3);
    let places = |ephemeris: &Ephemeris| {
        let mut places = Vec::new();
        for step in 0..48 {
            let tdb_s = FROM_S + f64::from(step) / 4.0 * DAY_S;
            let bodies = ephemeris.solar_system(tdb_s).unwrap();
            places.extend([bodies.sun, bodies.earth, bodies.moon].map(|state| state.position_m));
            places.extend(Planet::ALL.map(|planet| ephemeris.position_m(planet, tdb_s).unwrap()));
        }
        places
    };
    let expected = places(&folder.read("whole.bsp", &whole).unwrap());
    let words = whole.len() / 8;
    let mut refused = 0;
    // 97 has no factor in common with a record's 50 words.
    for (trial, word) in (3 * 128..words).step_by(97).enumerate() {
        let value = f64::from_le_bytes(whole[8 * word..8 * word + 8].try_into().unwrap());
        let wrong = [1e30, -value, value + 1e6, 1e11, value * 1.001 + 10.0, 0.0, f64::MAX][trial % 7];
        let mut file = whole.clone();
        file[8 * word..8 * word + 8].copy_from_slice(&wrong.to_le_bytes());
        match folder.read("changed.bsp", &file) {
            Err(said) => {
                assert!(said.contains("changed.bsp") && said.contains("the kernel is damaged"), "{said}");
                refused += 1;
            }
            Ok(ephemeris) => {
                for (found, expected) in places(&ephemeris).into_iter().zip(&expected) {
                    let moved_m = (found - *expected).length();
                    assert!(
                        moved_m <= 1e3 + 1e-8 * expected.length(),
                        "word {word}: {value} to {wrong}: {moved_m} m"
                    );
                }
            }
        }
    }
    assert!(refused > 10, "{refused}");
}

#[test]
fn bodies_in_each_others_place_are_refused() {
    let folder = Folder::new();
    let mut bodies = solar_system();
    bodies[4].target = 5;
    bodies[5].target = 4;
    let said = folder.read("a.bsp", &kernel(&bodies, FROM_S, 2)).unwrap_err();
    assert!(
        said.contains("the kernel is damaged") && said.contains("km from the Solar System's barycentre"),
        "{said}"
    );
}
