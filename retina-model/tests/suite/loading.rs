//! Loading: indices, modes, transforms, textures, against closed forms.

use crate::common::{Draft, png8, png16};
use glam::{DVec3, Vec2, Vec3};
use retina_model::{Wrap, load_body};
use serde_json::json;

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-9 * b.abs().max(1.0)
}

#[test]
fn all_index_types_give_the_same_tetrahedron() {
    for kind in [None, Some(5121), Some(5123), Some(5125)] {
        let body = Draft::tetrahedron(kind).load().unwrap();
        assert_eq!(body.triangles.len(), 4);
        assert!(body.is_closed());
        assert!(close(body.volume_m3(), 1.0 / 6.0));
        assert!(close(body.surface_area_m2(), 1.5 + 0.75f64.sqrt()));
        assert!(close(body.bounding_radius_m(), 1.0));
        assert!(close(body.volume_equivalent_radius_m().powi(3), 1.0 / (8.0 * std::f64::consts::PI)));
        assert!(body.surfaces[0].flat && body.surfaces[0].albedo_factor == 1.0);
    }
    let mut open = Draft::tetrahedron(Some(5121));
    open.json["accessors"][1]["count"] = json!(9);
    assert!(!open.load().unwrap().is_closed());
}

#[test]
fn strips_and_fans_wind_as_the_specification_says() {
    // The tetrahedron as a strip: (0,2,1) (2,3,1) (1,3,0) (3,2,0).
    let mut strip = Draft::tetrahedron(Some(5123));
    strip.indices(&[0, 2, 1, 3, 0, 2], 5123);
    strip.primitive()["mode"] = json!(5);
    let body = strip.load().unwrap();
    assert!(body.is_closed());
    assert!(close(body.volume_m3(), 1.0 / 6.0), "{}", body.volume_m3());

    let mut fan = Draft::new();
    fan.attribute("POSITION", &[[0.0, 0.0, 5.0], [1.0, 0.0, 5.0], [1.0, 1.0, 5.0], [0.0, 1.0, 5.0]]);
    fan.primitive()["mode"] = json!(6);
    let body = fan.load().unwrap();
    assert!(close(body.surface_area_m2(), 1.0));
    assert!(body.vertices.iter().all(|v| v.normal == Vec3::Z));
}

#[test]
fn transforms_nest_and_meshes_are_instanced() {
    let mut draft = Draft::tetrahedron(Some(5121));
    let half = std::f64::consts::FRAC_1_SQRT_2;
    // A quarter turn about z and a shift, with a child scaled by 2; and a matrix shifting by 100.
    draft.json["nodes"] = json!([
        { "translation": [10, 0, 0], "rotation": [0, 0, half, half], "children": [1] },
        { "mesh": 0, "scale": [2, 2, 2] },
        { "mesh": 0, "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,100,1] },
    ]);
    draft.json["scenes"] = json!([{ "nodes": [0, 2] }]);
    let body = draft.load().unwrap();
    assert_eq!((body.triangles.len(), body.surfaces.len()), (8, 1));
    assert!((body.vertices[1].position_m - DVec3::new(10.0, 2.0, 0.0)).length() < 1e-6);
    assert_eq!(body.vertices[7].position_m, DVec3::new(0.0, 0.0, 101.0));
    assert!((body.volume_m3() - 9.0 / 6.0).abs() < 1e-6 && body.is_closed());
    // Without a scene the roots are drawn; with another default scene, only its nodes.
    draft.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(draft.load().unwrap().triangles.len(), 8);
    draft.json["scene"] = json!(0);
    draft.json["scenes"] = json!([{ "nodes": [2] }]);
    assert_eq!(draft.load().unwrap().triangles.len(), 4);
}

#[test]
fn mirrors_keep_the_outside_outside_and_normals_take_the_inverse_transpose() {
    let mut draft = Draft::tetrahedron(None);
    let slope = std::f32::consts::FRAC_1_SQRT_2;
    draft.attribute("NORMAL", &[[slope, slope, 0.0]; 12]);
    draft.json["nodes"][0]["scale"] = json!([-2, 1, 1]);
    let body = draft.load().unwrap();
    assert!(close(body.volume_m3(), 2.0 / 6.0) && body.is_closed());
    let want = Vec3::new(-0.5, 1.0, 0.0).normalize();
    assert!(body.vertices.iter().all(|v| (v.normal - want).length() < 1e-6));
    assert!(!body.surfaces[0].flat);
}

#[test]
fn smooth_normals_of_a_cube_point_to_its_corners_however_it_is_cut() {
    let corners: [[f32; 3]; 8] = std::array::from_fn(|i| [0, 1, 2].map(|b| (i >> b & 1) as f32 * 2.0 - 1.0));
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    for turn in 0..2 {
        let q = |f: [u32; 4], k: usize| f[(k + turn) % 4];
        let indices: Vec<u32> = quads.iter().flat_map(|&f| [0, 1, 2, 0, 2, 3].map(|k| q(f, k))).collect();
        let mut draft = Draft::new();
        // Every corner its own vertex: welding must bring them together.
        let split: Vec<[f32; 3]> = indices.iter().map(|&i| corners[i as usize]).collect();
        draft.attribute("POSITION", &split);
        let mut body = draft.load().unwrap();
        assert!(body.surfaces[0].flat && close(body.volume_m3(), 8.0) && body.is_closed());
        body.smooth_normals();
        assert!(!body.surfaces[0].flat);
        for v in &body.vertices {
            let want = v.position_m.normalize().as_vec3();
            assert!((v.normal - want).length() < 1e-6, "{v:?}");
        }
    }
}

/// A unit square with texture coordinates, split in two triangles.
fn square(uv: &[[f32; 2]; 4], set: u32) -> Draft {
    let mut draft = Draft::new();
    draft.attribute("POSITION", &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    draft.attribute(&format!("TEXCOORD_{set}"), uv);
    draft.indices(&[0, 1, 2, 0, 2, 3], 5121);
    draft
}

const UNIT: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

#[test]
fn mean_albedo_is_one_and_sixteen_bits_keep_their_depth() {
    // Two tones whose sRGB values lie on the linear branch: light 300 to 500, so the mean is 400.
    let mut draft = square(&UNIT, 0);
    draft.texture(&png16(64, &[[300u16; 32], [500; 32]].concat().repeat(64)));
    draft.json["samplers"] = json!([{ "wrapS": 33071, "wrapT": 33648 }]);
    draft.json["textures"][0]["sampler"] = json!(0);
    let body = draft.load().unwrap();
    let map = &body.albedo_maps[0];
    assert_eq!((map.width, map.height, map.wrap_u, map.wrap_v), (64, 64, Wrap::Clamp, Wrap::Mirror));
    let factor = body.surfaces[0].albedo_factor;
    let dark = map.sample(Vec2::new(0.2, 0.5)) * factor;
    let light = map.sample(Vec2::new(0.8, 0.5)) * factor;
    assert!((dark - 0.75).abs() < 2e-3 && (light - 1.25).abs() < 2e-3, "{dark} {light}");
    assert!((body.mean_albedo() - 1.0).abs() < 1e-6);
}

#[test]
fn factors_count_in_luminance_and_weigh_by_area() {
    // A red and a white square of equal area: 0.2126 and 1 scaled to the mean 1.
    let mut draft = square(&UNIT, 0);
    draft.json["materials"] =
        json!([{ "pbrMetallicRoughness": { "baseColorFactor": [1, 0, 0, 1] } }, { "name": "white" }]);
    let mut second = draft.primitive().clone();
    draft.primitive()["material"] = json!(0);
    second["material"] = json!(1);
    draft.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(second);
    let body = draft.load().unwrap();
    let factors = [body.surfaces[0].albedo_factor, body.surfaces[1].albedo_factor];
    assert!((factors[0] / factors[1] - 0.2126).abs() < 1e-6);
    assert!((factors[0] + factors[1] - 2.0).abs() < 1e-6);
    assert_eq!(body.surfaces[1].name, "white");
}

#[test]
fn texture_coordinates_come_from_the_set_and_transform_asked_for() {
    let mut draft = square(&UNIT, 3);
    draft.texture(&png8(1, &[200]));
    draft.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({
        "index": 0, "texCoord": 0,
        "extensions": { "KHR_texture_transform": {
            "texCoord": 3, "offset": [0.5, 0.25], "scale": [2, 1], "rotation": std::f64::consts::FRAC_PI_2,
        } },
    });
    draft.json["extensionsRequired"] = json!(["KHR_texture_transform"]);
    let body = draft.load().unwrap();
    // (u, v) -> offset + (v, -2u): a quarter turn counter-clockwise as seen in the image.
    for (vertex, [u, v]) in body.vertices.iter().zip(UNIT) {
        assert!((vertex.uv - Vec2::new(0.5 + v, 0.25 - 2.0 * u)).length() < 1e-6, "{:?}", vertex.uv);
    }
}

#[test]
fn normalised_integers_are_fractions() {
    for (kind, bytes) in [(5121, vec![255u8, 0, 51, 0]), (5123, vec![255, 255, 0, 0, 51, 51, 0, 0])] {
        let mut draft = square(&UNIT, 1);
        draft.texture(&png8(1, &[200]));
        // Vertices must be 4-byte aligned: u8 pairs are padded by the stride.
        let padded: Vec<u8> = match kind {
            5121 => [[255, 0, 0, 0], [51, 0, 0, 0]].concat().repeat(2),
            _ => bytes.repeat(2),
        };
        let index = draft.accessor(&padded, kind, 4, "VEC2");
        draft.json["accessors"][index]["normalized"] = json!(true);
        let view = draft.json["accessors"][index]["bufferView"].as_u64().unwrap() as usize;
        draft.json["bufferViews"][view]["byteStride"] = json!(4);
        draft.primitive()["attributes"]["TEXCOORD_0"] = json!(index);
        let body = draft.load().unwrap();
        let us: Vec<f32> = body.vertices.iter().map(|v| v.uv.x).collect();
        assert_eq!(us, [1.0, 0.2, 1.0, 0.2], "type {kind}");
    }
}

#[test]
fn quantised_positions_are_read_where_the_file_says_so() {
    let mut draft = Draft::new();
    let corners = [[0i16, 0, 0, 0], [32767, 0, 0, 0], [0, -32767, 0, 0]];
    let bytes: Vec<u8> = corners.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    let index = draft.accessor(&bytes, 5122, 3, "VEC3");
    draft.json["accessors"][index]["normalized"] = json!(true);
    draft.json["bufferViews"][0]["byteStride"] = json!(8);
    draft.primitive()["attributes"]["POSITION"] = json!(index);
    assert!(draft.load().unwrap_err().to_string().contains("I16, normalised"));
    draft.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    draft.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let body = draft.load().unwrap();
    assert_eq!(body.vertices[1].position_m, DVec3::X);
    assert_eq!(body.vertices[2].position_m, DVec3::NEG_Y);
}

#[test]
fn buffers_and_images_may_lie_in_files_or_data_uris() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("body.gltf");
    let mut draft = square(&UNIT, 0);
    draft.texture(&png8(1, &[200]));
    draft.json["images"] = json!([{ "uri": "maps/a%20map.png" }]);
    draft.json["buffers"] = json!([{ "byteLength": draft.bin.len(), "uri": "body.bin" }]);
    std::fs::create_dir(folder.path().join("maps")).unwrap();
    std::fs::write(folder.path().join("maps/a map.png"), png8(2, &[100, 200])).unwrap();
    std::fs::write(folder.path().join("body.bin"), &draft.bin).unwrap();
    std::fs::write(&path, draft.json.to_string()).unwrap();
    assert_eq!(load_body(&path).unwrap().albedo_maps[0].width, 2);
    let files = retina_model::external_files(&path).unwrap();
    assert_eq!(files, [folder.path().join("body.bin"), folder.path().join("maps/a map.png")]);
    std::fs::remove_file(folder.path().join("body.bin")).unwrap();
    let error = load_body(&path).unwrap_err().to_string();
    assert!(error.contains("buffer 0") && error.contains("body.bin"), "{error}");

    // A triangle whose buffer is a data URI: nine zero bytes a row but for the ones (0000803f).
    let uri = "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    let triangle = json!({
        "asset": { "version": "2.0" }, "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{ "byteLength": 36, "uri": uri }],
    });
    std::fs::write(&path, triangle.to_string()).unwrap();
    assert!(close(load_body(&path).unwrap().surface_area_m2(), 0.5));
}

#[test]
fn the_facilitys_bodies_load() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/bodies");
    // Published volumes: Itokawa 1.84e7 m3 (Fujiwara 2006), Eros 2503 km3 (Cheng 2002). The facet
    // counts are those of the shape models.
    for (name, triangles, volume_m3, tolerance) in [
        ("moon.glb", 516_960, 4.0 / 3.0 * std::f64::consts::PI * 1.7374e6f64.powi(3), 0.002),
        ("itokawa.glb", 49_152, 1.84e7, 0.06),
        ("eros.glb", 7_790, 2.503e12, 0.03),
    ] {
        let path = folder.join(name);
        if !path.exists() {
            eprintln!("skipped: {} is not there", path.display());
            continue;
        }
        let start = std::time::Instant::now();
        let body = load_body(&path).unwrap();
        let volume = body.volume_m3();
        eprintln!(
            "{name}: {:.2} s, volume {volume:.4e} m3, closed {}",
            start.elapsed().as_secs_f64(),
            body.is_closed()
        );
        assert_eq!(body.triangles.len(), triangles, "{name}");
        assert!((volume / volume_m3 - 1.0).abs() < tolerance, "{name}: {volume}");
        assert!((body.mean_albedo() - 1.0).abs() < 1e-6, "{name}");
        let outward = |v: &retina_model::Vertex| v.normal.as_dvec3().dot(v.position_m) > 0.0;
        let share = body.vertices.iter().filter(|v| outward(v)).count() as f64 / body.vertices.len() as f64;
        assert!(share > 0.9, "{name}: {share}");
    }
}
