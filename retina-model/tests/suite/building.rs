//! The builder: shape, evenness, watertightness, and where the maps' features come out.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::{Path, PathBuf};

use crate::common::{direction, load_bytes, look, png8, png16};
use retina_model::{AlbedoSource, Body, BuildSpec, BuiltBody, Relief, build_body};

const RADIUS_M: f64 = 1.7374e6;

fn sphere(cells: u32) -> BuildSpec {
    BuildSpec {
        name: "ball".into(),
        radius_m: RADIUS_M,
        relief: None,
        albedo: None,
        cells,
        texels: 64,
        jpeg_quality: None,
        sources: vec!["test".into()],
        copyright: Some("nobody".into()),
    }
}

fn build(spec: &BuildSpec) -> (BuiltBody, Body) {
    let built = build_body(spec).unwrap();
    let mut body = load_bytes(&built.glb).unwrap();
    body.smooth_normals();
    (built, body)
}

fn write(folder: &Path, name: &str, bytes: Vec<u8>) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn sphere_has_the_closed_forms_area_and_volume_to_second_order() {
    let error = |cells| {
        let (built, body) = build(&sphere(cells));
        assert_eq!(built.report.triangles, 12 * (cells * cells) as usize);
        assert_eq!(body.triangles.len(), built.report.triangles);
        assert!(body.is_closed());
        for v in body.vertices.iter() {
            assert!(v.normal.as_dvec3().dot(v.position_m.normalize()) > 0.9999);
        }
        [
            1.0 - body.surface_area_m2() / (4.0 * PI * RADIUS_M.powi(2)),
            1.0 - body.volume_m3() / (4.0 / 3.0 * PI * RADIUS_M.powi(3)),
        ]
    };
    let (coarse, fine) = (error(32), error(64));
    for (c, f) in coarse.into_iter().zip(fine) {
        assert!(f > 0.0 && f < 4e-4, "{f}");
        assert!((c / f - 4.0).abs() < 0.05, "halving the cell quarters the error: {}", c / f);
    }
    let (odd, body) = build(&sphere(7));
    assert!(body.is_closed() && odd.report.area_ratio < 1.6, "{:?}", odd.report);
}

#[test]
fn triangles_are_even_and_wide_indices_are_used_when_needed() {
    let (built, body) = build(&sphere(256));
    let report = &built.report;
    // The area element of equal angles is (1+x2)(1+y2)/(1+x2+y2)^1.5: 1 in the middle of a face,
    // 1/sqrt(2) in the middle of its edges, where it is least.
    assert!((report.area_ratio - 2f64.sqrt()).abs() < 0.01, "{report:?}");
    assert!(report.max_edge_rad < FRAC_PI_2 / 256.0 * 2f64.sqrt() * 1.001, "{report:?}");
    assert!(report.edge_ratio < 2.1, "{report:?}");
    // 257^2 vertices a face do not fit 16 bits.
    assert!(body.is_closed());
    assert_eq!(report.bytes, built.glb.len());
}

#[test]
fn relief_stands_where_the_map_has_it_and_leaves_no_crack() {
    let folder = tempfile::tempdir().unwrap();
    // 10 degrees a pixel; a rough map, with a tower at longitude 45..55, latitude 30..40.
    let value = |x: u32, y: u32| if (x, y) == (22, 5) { 60_000 } else { (x * 7919 + y * 104_729) % 2000 };
    let pixels: Vec<u16> = (0..18).flat_map(|y| (0..36).map(move |x| value(x, y) as u16)).collect();
    for (left_deg, shift) in [(-180.0, 0), (0.0, 18)] {
        let turned: Vec<u16> =
            pixels.chunks(36).flat_map(|row| (0..36).map(move |x| row[(x + shift) % 36])).collect();
        let path = write(folder.path(), "relief.png", png16(36, &turned));
        let relief = Relief { path, metres_per_unit: 0.5, offset_m: -300.0, longitude_left_deg: left_deg };
        let (built, body) = build(&BuildSpec { relief: Some(relief), ..sphere(54) });
        assert!(body.is_closed());
        // A pixel's centre is interpolated exactly: 0.5 * 60000 - 300, but for the facet's sag.
        let (tower_m, _) = look(&body, direction(45.0, 35.0));
        assert!((tower_m - RADIUS_M - 29_700.0).abs() < 2500.0, "{tower_m}");
        assert!(built.report.max_height_m > 25_000.0 && built.report.min_height_m < 0.0);
        let highest =
            body.vertices.iter().map(|v| v.position_m).max_by(|a, b| a.length().total_cmp(&b.length()));
        assert!(highest.unwrap().normalize().dot(direction(45.0, 35.0)) > 2f64.to_radians().cos());
        let (south_m, _) = look(&body, direction(45.0, -35.0));
        assert!((south_m - RADIUS_M).abs() < 1500.0);
    }
}

#[test]
fn a_fine_relief_is_averaged_over_the_cell() {
    let folder = tempfile::tempdir().unwrap();
    // A chessboard of one-pixel squares, far finer than the cells: its mean remains.
    let pixels: Vec<u16> = (0..256).flat_map(|y| (0..512).map(move |x| (x + y) % 2 * 10_000)).collect();
    let path = write(folder.path(), "relief.png", png16(512, &pixels));
    let relief = Relief { path, metres_per_unit: 1.0, offset_m: 0.0, longitude_left_deg: -180.0 };
    let report = build_body(&BuildSpec { relief: Some(relief), ..sphere(9) }).unwrap().report;
    assert!(report.min_height_m > 4500.0 && report.max_height_m < 5500.0, "{report:?}");
}

#[test]
fn albedo_keeps_its_place_its_mean_and_the_same_value_on_both_sides_of_an_edge() {
    let folder = tempfile::tempdir().unwrap();
    // Dark west (longitude -180..0), light east, and a white spot at (120, -20).
    let value = |x: usize, y: usize| match (x, y) {
        _ if x.abs_diff(300) < 6 && y.abs_diff(110) < 6 => 255,
        _ if x < 180 => 100,
        _ => 160,
    };
    let pixels: Vec<u8> = (0..180).flat_map(|y| (0..360).map(move |x| value(x, y))).collect();
    let path = write(folder.path(), "albedo.png", png8(360, &pixels));
    let spec = BuildSpec {
        albedo: Some(AlbedoSource { path, longitude_left_deg: -180.0 }),
        texels: 128,
        ..sphere(40)
    };
    let (built, body) = build(&spec);
    assert_eq!(built.glb, build_body(&spec).unwrap().glb, "the bytes are the same each time");
    assert!((body.mean_albedo() - 1.0).abs() < 1e-6);
    let linear = |s: f64| ((s / 255.0 + 0.055) / 1.055).powf(2.4);
    let (dark, light) = (linear(100.0), linear(160.0));
    // The spot covers 11 x 11 square degrees at latitude -20 of the sphere's 41253.
    let spot = (11.0 * 11.0 * 20f64.to_radians().cos()) / (360.0 * 360.0 / PI);
    let mean = 0.5 * (dark + light) + spot * (1.0 - light);
    for (longitude, latitude, want) in [
        (-90.0, 0.0, dark),
        (-10.0, 60.0, dark),
        (-120.0, -85.0, dark),
        (90.0, 40.0, light),
        (10.0, 80.0, light),
        (100.0, -80.0, light),
        (120.0, 20.0, light),
        (120.0, -20.0, 1.0),
    ] {
        let (_, albedo) = look(&body, direction(longitude, latitude));
        let want = want / mean;
        // A step of 8-bit sRGB is up to 1 % at these levels.
        assert!((albedo / want - 1.0).abs() < 0.02, "({longitude}, {latitude}): {albedo}, not {want}");
    }
    // Face borders: the vertices that coincide read the same albedo on both faces. Where the two
    // tones meet (longitude 0 and 180) the 16-bit coordinates shift the step by 1/100 texel.
    let albedo = |v: usize, map: usize| body.albedo_maps[map].sample(body.vertices[v].uv);
    let mut at = std::collections::BTreeMap::<[u64; 3], Vec<f32>>::new();
    for (t, triangle) in body.triangles.iter().enumerate() {
        let map = body.surfaces[usize::from(body.triangle_surface[t])].albedo_map.unwrap();
        for &v in triangle {
            let key = body.vertices[v as usize].position_m.to_array().map(f64::to_bits);
            at.entry(key).or_default().push(albedo(v as usize, map));
        }
    }
    let spread = |values: &Vec<f32>| {
        values.iter().fold(0.0f32, |m, v| m.max(*v)) - values.iter().fold(1.0f32, |m, v| m.min(*v))
    };
    assert!(at.values().map(spread).fold(0.0, f32::max) < 0.01);
}

#[test]
fn what_cannot_be_built_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let square = write(folder.path(), "square.png", png8(4, &[9; 16]));
    let flat = write(folder.path(), "flat.png", png8(4, &[9; 8]));
    let relief = |path: &Path, offset_m: f64| {
        Some(Relief { path: path.into(), metres_per_unit: 1.0, offset_m, longitude_left_deg: 0.0 })
    };
    for (spec, word) in [
        (BuildSpec { radius_m: f64::NAN, ..sphere(4) }, "radius_m"),
        (BuildSpec { jpeg_quality: Some(0), ..sphere(4) }, "jpeg_quality"),
        (sphere(0), "cells"),
        (sphere(100_000), "cells"),
        (BuildSpec { relief: relief(&square, 0.0), ..sphere(4) }, "twice as wide"),
        (BuildSpec { relief: relief(&flat, -2e6), ..sphere(4) }, "centre"),
        (BuildSpec { relief: relief(&flat, f64::INFINITY), ..sphere(4) }, "offset_m"),
        (BuildSpec { relief: relief(Path::new("absent.png"), 0.0), ..sphere(4) }, "absent.png"),
    ] {
        let error = build_body(&spec).unwrap_err().to_string();
        assert!(error.contains(word), "{word}: {error}");
    }
}

#[test]
fn the_projects_moon_has_the_maps_heights_and_an_independent_meshs_tones() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let ours = root.join("../assets/bodies/moon.glb");
    let theirs = root.join("../../shared/data/bodies/moon.glb");
    if !ours.exists() || !theirs.exists() {
        eprintln!("skipped: {} or {} is not there", ours.display(), theirs.display());
        return;
    }
    assert!(std::fs::metadata(&ours).unwrap().len() < 7_500_000);
    let start = std::time::Instant::now();
    let ours = retina_model::load_body(&ours).unwrap();
    eprintln!("loaded in {:.2} s", start.elapsed().as_secs_f64());
    let theirs = retina_model::load_body(&theirs).unwrap();
    assert!(ours.is_closed());
    // The map that its relief comes from: heights above 1737.4 km are samples less 10 000 m, longitude 0 at the left.
    let map = root.join("../../shared/data/bodies/moon_dem_16ppd.png");
    let map = image::open(map).unwrap().into_luma16();
    let height_m = |longitude_deg: f64, latitude_deg: f64| {
        let x = longitude_deg.rem_euclid(360.0) / 360.0 * f64::from(map.width());
        let y = (90.0 - latitude_deg) / 180.0 * f64::from(map.height());
        f64::from(map.get_pixel(x as u32, y as u32).0[0]) - 10_000.0
    };
    let highest = look(&ours, direction(201.34, 5.34)).0 - RADIUS_M;
    assert!((9200.0..10_800.0).contains(&highest), "the highest point is 10 714 m: {highest}");
    // Maria and highlands: heights where the land is smooth, and the tone of the ground.
    for (name, longitude, latitude) in [
        ("Mare Serenitatis", 18.0, 27.0),
        ("Mare Crisium", 59.0, 17.0),
        ("Mare Imbrium", -16.0, 35.0),
        ("Oceanus Procellarum", -57.0, 18.0),
        ("Mare Nectaris", 35.0, -15.0),
        ("Southern highlands", 10.0, -45.0),
        ("Far side", 170.0, 20.0),
        ("Mare Moscoviense", 148.0, 27.0),
        ("North of Mare Frigoris", 0.0, 70.0),
    ] {
        // Five by five rays over two degrees: single texels are laid out differently in the two.
        let mean = |body: &Body| {
            let offset = |k: i32| 0.5 * f64::from(k - 2);
            let rays = (0..25).map(|k| direction(longitude + offset(k % 5), latitude + offset(k / 5)));
            let sum = rays.map(|ray| look(body, ray)).fold((0.0, 0.0), |s, v| (s.0 + v.0, s.1 + v.1));
            (sum.0 / 25.0, sum.1 / 25.0)
        };
        let ((r1, a1), (_, a2)) = (mean(&ours), mean(&theirs));
        let offset = |k: i32| 0.5 * f64::from(k - 2);
        let heights = (0..25).map(|k| height_m(longitude + offset(k % 5), latitude + offset(k / 5)));
        let expected = RADIUS_M + heights.sum::<f64>() / 25.0;
        eprintln!("{name}: {:+.0} m, by the map {:+.0} m", r1 - RADIUS_M, expected - RADIUS_M);
        // Single samples against means over cells of 11 km.
        let rough = if name.starts_with("Mare") || name.starts_with("Oceanus") { 60.0 } else { 300.0 };
        assert!((r1 - expected).abs() < rough, "{name}: {r1} and {expected}");
        assert!((a1 / a2 - 1.0).abs() < 0.03, "{name}: {a1} and {a2}");
    }
}

#[test]
fn a_meshs_ellipsoid_is_the_one_that_it_was_made_from() {
    use glam::{DMat3, DQuat, DVec3, EulerRot};
    let path = Path::new("rock");
    let (_, mut body) = build(&sphere(64));
    let turn = DMat3::from_quat(DQuat::from_euler(EulerRot::XYZ, 0.3, -0.7, 1.1));
    let center_m = DVec3::new(3e4, -2e4, 5e3);
    for vertex in &mut body.vertices {
        vertex.position_m = center_m + turn * (vertex.position_m * DVec3::new(0.8, 1.0, 1.3));
    }
    let found = body.ellipsoid(path).unwrap();
    let expected = RADIUS_M * DVec3::new(0.8, 1.0, 1.3);
    // Chords of 1.4 deg lie 0.5e-4 of the radius inside.
    assert!((found.semi_axes_m / expected - 1.0).abs().max_element() < 2e-4, "{found:?}");
    assert!((found.center_m - center_m).length() < 1.0, "{found:?}");
    for axis in 0..3 {
        assert!(found.body_from_axes.col(axis).dot(turn.col(axis)).abs() > 1.0 - 1e-9, "{found:?}");
    }
    assert!((found.body_from_axes.determinant() - 1.0).abs() < 1e-9 && found.rms_height_m < 3e-4 * RADIUS_M);
    body.triangles.pop();
    let error = body.ellipsoid(path).unwrap_err().to_string();
    assert!(error.contains("open edges") && error.contains("rock"), "{error}");
}
