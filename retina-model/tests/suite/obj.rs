//! OBJ files: forms of corners, indices, polygons, shading, textures, against closed forms.

use std::fs;
use std::path::PathBuf;

use glam::{DMat3, DVec3, Vec3};
use proptest::prelude::*;
use retina_model::{Layout, LoadedMesh, load_body, load_obj};

fn file(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("body.obj");
    fs::write(&path, text).unwrap();
    (folder, path)
}

fn load(text: &str) -> LoadedMesh {
    load_obj(&file(text).1).unwrap()
}

fn refusal(text: &str) -> String {
    let (_folder, path) = file(text);
    load_obj(&path).unwrap_err().to_string()
}

const CORNERS: &str = "v 1 1 1\nv -1 1 1\nv -1 -1 1\nv 1 -1 1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 -1\nv 1 -1 -1\n";

/// A cube of edge 2 in quads, outward.
const QUADS: &str = "f 1 2 3 4\nf 8 7 6 5\nf 1 4 8 5\nf 2 1 5 6\nf 3 2 6 7\nf 4 3 7 8\n";

#[test]
fn quads_make_a_closed_cube() {
    let cube = load(&format!("# cube\no Cube\ng side\n{CORNERS}s off\n{QUADS}")).body;
    assert_eq!((cube.vertices.len(), cube.triangles.len()), (8, 12));
    assert!(cube.is_closed());
    assert!((cube.volume_m3() - 8.0).abs() < 1e-12 && (cube.surface_area_m2() - 24.0).abs() < 1e-12);
    assert!(cube.surfaces.len() == 1 && cube.surfaces[0].flat && cube.surfaces[0].double_sided);
}

#[test]
fn all_forms_of_a_corner_and_both_ways_of_counting_are_the_same_face() {
    let lists = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 2\n";
    for face in [
        "f 1 2 3",
        "f 1/1 2/2 3/3",
        "f 1//1 2//1 3//1",
        "f 1/1/1 2/2/1 3/3/1",
        "f -3 -2 -1",
        "f -3/-3/-1 -2/-2/-1 -1/-1/-1",
        "f 1/1/1 \\\n 2/2/1 3/3/1",
        "  f\t1 2 3   # a comment",
    ] {
        let body = load(&format!("{lists}{face}\n")).body;
        assert_eq!(body.triangles.len(), 1, "{face}");
        assert_eq!(body.corners_m(0), [DVec3::ZERO, DVec3::X, DVec3::Y], "{face}");
        assert!(body.vertices.iter().all(|vertex| vertex.normal == Vec3::Z), "{face}");
        assert_eq!(
            body.surfaces[0].flat,
            !face.contains("/1/") && !face.contains("//") && !face.contains("/-1")
        );
    }
    // The file counts v upwards from the image's lower edge.
    let body = load(&format!("{lists}f 1/1 2/2 3/3\n")).body;
    assert_eq!(
        body.vertices.iter().map(|v| v.uv.to_array()).collect::<Vec<_>>(),
        [[0., 1.], [1., 1.], [0., 0.]]
    );
}

#[test]
fn smoothing_groups_and_normals_decide_the_shading() {
    let smooth = load(&format!("{CORNERS}s 1\n{QUADS}")).body;
    assert!(!smooth.surfaces[0].flat);
    // By symmetry the normals of a smooth cube lie along its diagonals (a fan's two triangles weigh
    // by their angle, so how the quads are cut does not matter).
    for vertex in &smooth.vertices {
        assert!((vertex.normal.as_dvec3() - vertex.position_m.normalize()).length() < 1e-6);
    }
    let mixed = load("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\ns 3\nf 1 2 3\ns 0\nf 2 4 3\n").body;
    assert_eq!(mixed.triangle_surface, [0, 1]);
    assert!(!mixed.surfaces[0].flat && mixed.surfaces[1].flat);
}

#[test]
fn clockwise_faces_are_turned_and_told() {
    let turned = QUADS.lines().map(|line| {
        let mut corners: Vec<&str> = line[2..].split(' ').collect();
        corners.reverse();
        format!("f {}\n", corners.join(" "))
    });
    let cube = load(&format!("{CORNERS}s 1\n{}", turned.collect::<String>()));
    assert!((cube.body.volume_m3() - 8.0).abs() < 1e-12);
    assert!(cube.body.vertices.iter().all(|v| v.normal.as_dvec3().dot(v.position_m) > 0.0));
    assert!(cube.notes[0].contains("clockwise"));
}

#[test]
fn what_is_not_read_is_named() {
    let cube = load(&format!("mtllib cube.mtl\n{CORNERS}usemtl grey\n{QUADS}l 1 2\nvp 0.1\n"));
    assert!(cube.notes[0].contains("materials") && cube.notes[0].contains("line 1"), "{:?}", cube.notes);
    assert!(cube.notes[1].contains("`l` (line 17), `vp` (line 18)"), "{:?}", cube.notes);
}

#[test]
fn faults_are_refused_with_their_line() {
    for (text, words) in [
        ("", "no face with an area"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no face with an area"),
        ("v 0 0 zero\n", "line 1: `v` holds what is not a finite number (found `zero`"),
        ("v 0 0 nan\n", "found `nan`"),
        ("v 0 0\n", "found 2, expected 3 to 8"),
        ("v 0 0 1e13\n", "too far out"),
        ("\nvn 0 0 0\n", "line 2: the normal has no length"),
        ("v 0 0 0\nf 1 1\n", "line 2: the face has too few corners (found 2"),
        (
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
            "line 4: a face names a vertex that does not exist (found vertex 4",
        ),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "found `0`"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 2 3\n", "found `-4`"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/1 3/1\n", "texture coordinate that does not exist"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1//2 2//2 3//2\n", "normal that does not exist"),
        ("v 0 0 0\nf 1/2/3/4 1 1\n", "v/vt/vn"),
        ("v 0 0 0\nf a 1 1\n", "found `a`"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\nf 1 2 3\n", "line 6: some corners have texture"),
    ] {
        let error = refusal(text);
        assert!(error.contains(words) && error.contains("body.obj"), "{text}: {error}");
    }
}

#[test]
fn the_extension_says_how_a_model_is_read() {
    let (folder, path) = file(&format!("{CORNERS}{QUADS}"));
    assert_eq!(load_body(&path).unwrap().triangles.len(), 12);
    let other = folder.path().join("body.stl");
    fs::rename(&path, &other).unwrap();
    let error = load_body(&other).unwrap_err().to_string();
    assert!(error.contains("`.stl`") && error.contains("`.obj`"), "{error}");
}

/// An octahedron of radius 1: two poles, a triangle across the map's edge at y < 0, x < 0.
const OCTAHEDRON: &str = "v 1 0 0\nv 0 1 0\nv -1 0 0\nv 0 -1 0\nv 0 0 1\nv 0 0 -1\n\
    f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 2 1 6\nf 3 2 6\nf 4 3 6\nf 1 4 6\n";

#[test]
fn a_map_lies_by_longitude_and_latitude_where_there_are_no_coordinates() {
    // Northern half 200, southern 100 of 255; the map's edge in the middle of the far side.
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("map.png");
    let image = image::GrayImage::from_fn(64, 32, |_, y| image::Luma([if y < 16 { 200 } else { 100 }]));
    image.save(&map).unwrap();
    let LoadedMesh { mut body, layout, .. } = load(OCTAHEDRON);
    assert_eq!(layout, Layout::LongitudeLatitude);
    let mean = body.paint(&map, layout).unwrap();
    // IEC 61966-2-1: code 200 is 0.577580, code 100 is 0.127438; the halves are equal by symmetry.
    assert!((mean - 0.5 * (0.577_580 + 0.127_438)).abs() < 2e-3, "{mean}");
    assert!((body.mean_albedo() - 1.0).abs() < 1e-6);
    for triangle in &body.triangles {
        let u = triangle.map(|v| body.vertices[v as usize].uv.x);
        let spread = u.iter().fold(f32::MIN, |m, u| m.max(*u)) - u.iter().fold(f32::MAX, |m, u| m.min(*u));
        assert!((spread - 0.25).abs() < 1e-6, "a triangle goes round the body: {u:?}");
    }
    let at = |x: f64, y: f64| {
        let found = body.vertices.iter().find(|v| (v.position_m - DVec3::new(x, y, 0.0)).length() < 1e-12);
        // A vertex may also stand one turn further on.
        let uv = found.unwrap().uv;
        [uv.x.rem_euclid(1.0), uv.y]
    };
    assert_eq!((at(1.0, 0.0), at(0.0, 1.0), at(0.0, -1.0)), ([0.5, 0.5], [0.75, 0.5], [0.25, 0.5]));
}

#[test]
fn a_transform_turns_then_scales() {
    let mut cube = load(&format!("{CORNERS}s 1\n{QUADS}")).body;
    // Blender's turn of glTF: (x, y, z) becomes (x, -z, y).
    let turn = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);
    cube.transform(turn, DVec3::new(2.0, 3.0, 5.0));
    assert_eq!(cube.vertices[0].position_m, DVec3::new(2.0, -3.0, 5.0));
    assert!((cube.volume_m3() - 8.0 * 30.0).abs() < 1e-9);
    let normal = cube.vertices[0].normal.as_dvec3();
    // The gradient of |x/2| + |y/3| + |z/5|.
    assert!((normal - DVec3::new(15.0, -10.0, 6.0).normalize()).length() < 1e-6);
}

#[test]
fn faces_of_many_corners_and_many_kinds_of_statement_are_bounded() {
    let ring = |count: usize| {
        let angle = |k: usize| std::f64::consts::TAU * k as f64 / count as f64;
        let mut text: String =
            (0..count).map(|k| format!("v {} {} 0\n", angle(k).cos(), angle(k).sin())).collect();
        text += "f";
        (1..=count).for_each(|k| text += &format!(" {k}"));
        text
    };
    assert_eq!(load(&ring(1000)).body.triangles.len(), 998);
    let said = refusal(&ring(10_000));
    assert!(
        said.ends_with("line 10001: the face has too many corners (found 10000, expected at most 1000)"),
        "{said}"
    );
    let strange: String = (0..200_000).map(|k| format!("word{k} 1\n")).collect();
    let notes = load(&format!("{strange}{CORNERS}{QUADS}")).notes;
    assert!(notes.len() == 1 && notes[0].contains("`word31` (line 32)") && !notes[0].contains("word32"));
}

proptest! {
    #[test]
    fn no_text_panics(
        lines in proptest::collection::vec(
            ("(v|vt|vn|f|s|o|l|#)", "[-0-9/.e ]{0,24}", "(|\\\\)"), 0..40,
        )
    ) {
        let text: String = lines.iter().map(|(word, rest, end)| format!("{word} {rest}{end}\n")).collect();
        let (_folder, path) = file(&text);
        let _ = load_obj(&path);
    }
}
