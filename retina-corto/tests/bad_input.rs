//! Scenarios that do not fit: the error says which file and key, what was found and expected.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Folder, SCENE};
use serde_json::Value;

/// A scenario whose JSON file had one value replaced, or removed where `value` is `None`.
fn changed(file: &str, pointer: &str, value: Option<Value>) -> Folder {
    let folder = Folder::new();
    let text = std::fs::read_to_string(folder.file(file)).unwrap();
    let mut document: Value = serde_json::from_str(&text).unwrap();
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    let table = document.pointer_mut(parent).unwrap().as_object_mut().unwrap();
    assert!(table.contains_key(key), "{pointer}");
    match value {
        Some(value) => table.insert(key.into(), value),
        None => table.remove(key),
    };
    folder.write(file, &document.to_string());
    folder
}

#[test]
fn every_missing_key_is_named() {
    let document: Value = serde_json::from_str(SCENE).unwrap();
    let mut pointers = Vec::new();
    for (table, keys) in document.as_object().unwrap() {
        pointers.push(format!("/{table}"));
        pointers.extend(keys.as_object().unwrap().keys().map(|key| format!("/{table}/{key}")));
    }
    let optional = [
        "/body_settings/pass_index",
        "/rendering_settings/device",
        "/rendering_settings/samples",
        "/rendering_settings/preview_samples",
    ];
    for pointer in pointers {
        let folder = changed("scene/scene.json", &pointer, None);
        if optional.contains(&pointer.as_str()) {
            assert!(folder.read().is_ok(), "{pointer}");
            continue;
        }
        let error = folder.refusal();
        let path = pointer[1..].replace('/', ".");
        assert!(error.contains("scene.json") && error.contains(&format!("`{path}` is missing")), "{error}");
    }
    for pointer in [
        "/sun",
        "/sun/position",
        "/camera",
        "/camera/position",
        "/camera/orientation",
        "/body",
        "/body/position",
        "/body/orientation",
    ] {
        let error = changed("geometry/geometry.json", pointer, None).refusal();
        let path = pointer[1..].replace('/', ".");
        assert!(
            error.contains("geometry.json") && error.contains(&format!("`{path}` is missing")),
            "{error}"
        );
    }
}

#[test]
fn a_value_of_another_kind_or_out_of_range_is_shown() {
    for (pointer, value, words) in [
        (
            "/camera_settings/fov",
            "\"60\"",
            "key `camera_settings.fov`: the value is of another kind than it should be (found the text \"60\", expected a number)",
        ),
        ("/camera_settings/fov", "0", "found 0"),
        ("/camera_settings/fov", "180", "170"),
        ("/camera_settings/res_x", "64.5", "found the number 64.5, expected a whole number"),
        ("/camera_settings/res_y", "0", "expected 1 to 16384"),
        ("/camera_settings/film_exposure", "null", "found null"),
        ("/camera_settings/film_exposure", "-1", "above 0"),
        ("/camera_settings/sensor", "\"RGBA\"", "expected \"BW\" or \"RGB\""),
        ("/camera_settings/sensor", "3", "a text in quotation marks"),
        ("/camera_settings/bit_encoding", "8", "found the number 8, expected a text"),
        ("/camera_settings/bit_encoding", "\"12\"", "\"8\" or \"16\""),
        ("/camera_settings/viewtransform", "\"Sepia\"", "no view transform"),
        ("/camera_settings/K", "[[1]]", "key `camera_settings.K`"),
        ("/camera_settings/clip_end", "\"far\"", "camera_settings.clip_end"),
        ("/camera_settings", "[]", "expected a table"),
        ("/sun_settings/angle", "-1", "0 to 89"),
        ("/sun_settings/energy", "true", "found true"),
        ("/body_settings/pass_index", "\"1\"", "body_settings.pass_index"),
        ("/rendering_settings/samples", "\"many\"", "rendering_settings.samples"),
    ] {
        let value = serde_json::from_str(value).unwrap();
        let error = changed("scene/scene.json", pointer, Some(value)).refusal();
        assert!(error.contains(words) && error.contains("scene.json"), "{pointer}: {error}");
    }
    for (pointer, value, words) in [
        (
            "/sun/position",
            "[[0, 0, 1], [0, \"x\", 1]]",
            "key `sun.position[1][1]`: the value is of another kind than it should be (found the text \"x\", expected a number)",
        ),
        ("/sun/position", "[0, 0, 1]", "key `sun.position[0]`"),
        ("/sun/position", "[]", "lists have unequal lengths"),
        ("/camera/position", "[[0, 0, 10]]", "`sun.position` 2, `camera.position` 1, `camera.orientation` 2"),
        ("/camera/position", "[[0, 0], [0, 0]]", "found 2 entries, expected a list of 3 numbers"),
        (
            "/camera/orientation",
            "[[1, 0, 0, 0], [1, 0, 0, 0.1]]",
            "key `camera.orientation[1]`: frame 1: the quaternion is not unit",
        ),
        ("/body/orientation", "[[0, 0, 0, 0], [1, 0, 0, 0]]", "frame 0: the quaternion is not unit"),
        ("/body/position", "\"origin\"", "found the text \"origin\""),
        ("/camera/position", "[[0, 0, 0.5], [0, 0, 12]]", "frame 0: the camera is inside the body `body`"),
    ] {
        let value = serde_json::from_str(value).unwrap();
        let error = changed("geometry/geometry.json", pointer, Some(value)).refusal();
        assert!(error.contains(words) && error.contains("geometry.json"), "{pointer}: {error}");
    }
}

#[test]
fn a_body_without_extent_is_refused() {
    let folder = Folder::new();
    folder.write("body/shape/cube.obj", "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n");
    assert!(folder.refusal().contains("cube.obj: holds no face with an area"));
    for scale in ["0", "-1", "[1, 0, 1]", "nan"] {
        let folder = Folder::new();
        folder.write(
            "retina.toml",
            &format!("schema = 'retina.corto-sidecar/1'\n[[body]]\nset_scale = {scale}\n"),
        );
        let error = folder.refusal();
        assert!(
            error.contains("retina.toml, body 1, key `set_scale`: the scale leaves the body without extent"),
            "{error}"
        );
    }
}

#[test]
fn files_that_cannot_be_told_are_asked_for() {
    let folder = Folder::new();
    folder.write("body/shape/second.obj", common::CUBE);
    let error = folder.refusal();
    assert!(error.contains("cube.obj, second.obj") && error.contains("[[body]]"), "{error}");
    let folder = Folder::new();
    std::fs::remove_file(folder.file("body/shape/cube.obj")).unwrap();
    assert!(folder.refusal().contains("no .obj, .glb or .gltf file"));
    let folder = Folder::new();
    std::fs::rename(folder.file("scene/scene.json"), folder.file("scene/a.json")).unwrap();
    folder.write("scene/b.json", SCENE);
    assert!(folder.refusal().contains("a.json, b.json"));
    let folder = Folder::new();
    std::fs::remove_file(folder.file("scene/scene.json")).unwrap();
    assert!(folder.refusal().contains("holds no scene file"));
    let error = retina_corto::Scenario::read(&folder.file("nowhere"), None).unwrap_err().to_string();
    assert!(error.contains("is no folder"), "{error}");
}

#[test]
fn broken_files_and_sidecars_name_the_place() {
    let folder = Folder::new();
    folder.edit("scene/scene.json", "20.0,", "20.0,,");
    assert!(folder.refusal().contains("line 3, column "), "{}", folder.refusal());
    for (text, words) in [
        ("schema = 'retina.scene/1'\n", "is not a sidecar"),
        ("schema = 'retina.corto-sidecar/1'\nscale = 3\n", "line 2"),
        ("schema = 'retina.corto-sidecar/1'\nscale_m_per_bu = 0\n", "scale_m_per_bu"),
        ("schema = 'retina.corto-sidecar/1'\n[[body]]\n[[body]]\n", "found 2, expected 1"),
        ("schema = 'retina.corto-sidecar/1'\n[[body]]\nname = 'a b'\n", "found `a b`"),
        ("schema = 'retina.corto-sidecar/1'\n[[body]]\nfile = 'none.obj'\n", "none.obj: cannot be read"),
        ("schema = 'retina.corto-sidecar/1'\n[[body]]\nfile = 'cube.stl'\n", "`.stl`"),
        ("schema = 'retina.corto-sidecar/1'\n[[body]]\ntexture = 'none.png'\n", "none.png: cannot be read"),
        (
            "schema = 'retina.corto-sidecar/1'\n[[body]]\nphotometry = { model = 'lambert' }\n",
            "normal_albedo",
        ),
    ] {
        let folder = Folder::new();
        folder.write("retina.toml", text);
        assert!(folder.refusal().contains(words), "{text}: {}", folder.refusal());
    }
    let folder = Folder::new();
    std::fs::remove_file(folder.file("geometry/geometry.json")).unwrap();
    for (text, words) in [
        ("", "holds no row"),
        (
            "0 1 2 3\n",
            "line 1: the row has another number of columns than a point cloud (found 4, expected 18)",
        ),
        ("\n0 1 2 3 1 0 0 0 4 5 6 1 0 0 0 7 8 x\n", "line 2: column 18 is not a finite number (found `x`)"),
        ("0 1 2 3 2 0 0 0 4 5 6 1 0 0 0 7 8 9\n", "frame 0: the quaternion is not unit"),
    ] {
        folder.write("geometry/cloud.txt", text);
        assert!(folder.refusal().contains(words), "{text}: {}", folder.refusal());
    }
}
