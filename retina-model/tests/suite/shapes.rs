//! ICQ and DSK shapes of `validation/shape_fixtures.py`: an ellipsoid of 3, 2 and 1.5 km, DSK by CSPICE's dskw02.

use std::fs;
use std::path::{Path, PathBuf};

use glam::DVec3;
use retina_model::{Body, external_files, load_body, load_mesh};

const AXES_M: DVec3 = DVec3::new(3000.0, 2000.0, 1500.0);

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/shapes").join(name)
}

fn refusal(name: &str, bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    load_body(&path).unwrap_err().to_string()
}

/// Each vertex on the ellipsoid, all facets outward, and the volume of the facets that were written.
fn check_ellipsoid(name: &str, body: &Body, share: f64) {
    assert!(body.is_closed(), "{name}");
    for vertex in &body.vertices {
        // The text has 0.1 mm.
        let off = (vertex.position_m / AXES_M).length() - 1.0;
        assert!(off.abs() < 1e-6, "{name}: {off}");
    }
    for triangle in 0..body.triangles.len() {
        let [a, b, c] = body.corners_m(triangle);
        assert!((b - a).cross(c - a).dot(a + b + c) > 0.0, "{name}: triangle {triangle}");
    }
    let whole_m3 = 4.0 / 3.0 * std::f64::consts::PI * AXES_M.x * AXES_M.y * AXES_M.z;
    assert!((body.volume_m3() / whole_m3 - share).abs() < 0.01, "{name}: {}", body.volume_m3() / whole_m3);
    assert!(body.surfaces.len() == 1 && body.surfaces[0].flat, "{name}");
}

#[test]
fn an_ellipsoid_in_kilometres_is_read_in_metres() {
    let icq = load_body(&fixture("ellipsoid.icq")).unwrap();
    assert_eq!(icq.triangles.len(), 6 * 6 * 6 * 2);
    check_ellipsoid("icq", &icq, 0.96);
    // The inscribed body of 8 meridians and 7 parallels: in the unit sphere, wedges of sin 45 deg / 2 at 8 sides; each
    // frustum of the polygon is a prismatoid.
    let (sides, lines) = (8.0_f64, 6);
    let area = |latitude_deg: f64| {
        0.5 * sides * (std::f64::consts::TAU / sides).sin() * latitude_deg.to_radians().cos().powi(2)
    };
    let at = |line: i32| -90.0 + 180.0 / f64::from(lines) * f64::from(line);
    let volume: f64 = (0..lines)
        .map(|line| {
            let [low, high] = [at(line), at(line + 1)];
            let [below, above] = [area(low), area(high)];
            let height = high.to_radians().sin() - low.to_radians().sin();
            height * (below + above + (below * above).sqrt()) / 3.0
        })
        .sum();
    let share = volume / (4.0 / 3.0 * std::f64::consts::PI);
    for name in ["ellipsoid.bds", "clockwise.bds", "halves.bds"] {
        let loaded = load_mesh(&fixture(name)).unwrap();
        assert_eq!(loaded.body.triangles.len(), 8 * 2 * 6 - 16, "{name}");
        check_ellipsoid(name, &loaded.body, share);
        assert_eq!(loaded.notes.iter().any(|note| note.contains("clockwise")), name == "clockwise.bds");
        assert!(external_files(&fixture(name)).unwrap().is_empty());
    }
}

#[test]
fn icq_that_does_not_fit_is_refused() {
    let whole = fs::read_to_string(fixture("ellipsoid.icq")).unwrap();
    let few = whole.lines().take(200).collect::<Vec<_>>().join("\n");
    let first = whole.lines().nth(1).unwrap();
    for (text, said) in [
        (String::new(), "the shape is empty"),
        ("x\n".to_owned(), "line 1: q does not read (found x"),
        ("0\n".to_owned(), "q does not read (found 0"),
        ("4000000000\n".to_owned(), "q does not read"),
        (few, "fewer vertices than q says (found 199, expected 294 for q = 6)"),
        (format!("{whole}1 2 3\n"), "line 296: more vertices than q says"),
        (
            whole.replace(first, "1 2"),
            "line 2: a vertex does not read (found 1 2, expected x, y and z in km)",
        ),
        (whole.replace(first, "1 2 nan"), "a vertex does not read"),
        (whole.replace(first, "1 2 1e300"), "too far out"),
        (format!("1\n{}", "0 0 0\n".repeat(24)), "holds no face with an area"),
    ] {
        let error = refusal("body.icq", text.as_bytes());
        assert!(error.contains(said) && error.contains("body.icq"), "{said}: {error}");
    }
}

#[test]
fn dsk_that_does_not_fit_is_refused() {
    let whole = fs::read(fixture("ellipsoid.bds")).unwrap();
    let changed = |at: usize, bytes: &[u8]| {
        let mut file = whole.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        refusal("body.bds", &file)
    };
    assert!(refusal("body.dsk", b"DAS/DSK ").contains("is no DSK kernel (found 8 bytes"));
    assert!(refusal("body.bds", &[b'x'; 2000]).contains("begin with `xxxxxxxx`"));
    assert!(changed(84, b"BIG-IEEE").contains("byte order is not read (found `BIG-IEEE`"));
    assert!(refusal("body.bds", &whole[..3000]).contains("cut short"));
    assert!(changed(68, &i32::MAX.to_le_bytes()).contains("cut short"));
    // The segment's type is its fourth double, 4.0 to 2.0 apart by one bit: found by the body's number before it.
    let center = whole.windows(8).position(|word| word == 2_000_433f64.to_le_bytes()).unwrap();
    assert!(
        changed(center + 16, &4f64.to_le_bytes())
            .contains("segment 1: the type of a segment is not read (found type 4")
    );
    let vertices = center + 8 * 33;
    assert!(
        changed(vertices, &f64::NAN.to_le_bytes()).contains("the kernel is damaged (found a vertex at [NaN")
    );
    // Vertices and plates, 7 rows of 8 and 80 plates, begin the segment's integers.
    let counts: Vec<u8> = [56i32, 80].iter().flat_map(|count| count.to_le_bytes()).collect();
    let counts = whole.windows(8).position(|word| word == counts).unwrap();
    assert!(
        changed(counts, &(-1i32).to_le_bytes())
            .contains("larger or smaller than it may be (found -1 vertices")
    );
    assert!(changed(counts + 4, &100_000i32.to_le_bytes()).contains("the kernel is damaged"));
    assert!(changed(counts + 40, &57i32.to_le_bytes()).contains("a plate of the vertices [57"));
}
