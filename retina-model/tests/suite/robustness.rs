//! Damaged, lying and unsupported files: an error that names the part, never a panic.

use crate::common::{Draft, load_bytes, png8};
use proptest::prelude::*;
use serde_json::{Value, json};

/// A textured tetrahedron with every attribute.
fn full() -> Draft {
    let mut draft = Draft::tetrahedron(Some(5123));
    draft.attribute("NORMAL", &[[0.0f32, 0.0, 1.0]; 4]);
    draft.attribute("TEXCOORD_0", &[[0.0f32, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
    draft.texture(&png8(4, &[40, 80, 120, 160, 200, 240, 30, 60]));
    draft.json["samplers"] = json!([{ "wrapS": 33071 }]);
    draft.json["textures"][0]["sampler"] = json!(0);
    draft.json["materials"][0]["normalTexture"] = json!({ "index": 1, "scale": 0.5 });
    let normal = image::RgbImage::from_pixel(2, 2, image::Rgb([140, 120, 240]));
    let mut jpeg = std::io::Cursor::new(Vec::new());
    normal.write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
    let view = draft.view(jpeg.get_ref());
    let images = draft.json["images"].as_array_mut().unwrap();
    images.push(json!({ "bufferView": view }));
    draft.json["textures"].as_array_mut().unwrap().push(json!({ "source": 1 }));
    draft
}

#[test]
fn the_whole_sample_loads() {
    let body = full().load().unwrap();
    assert_eq!((body.albedo_maps.len(), body.slope_maps.len()), (1, 1));
}

#[test]
fn each_lie_is_named() {
    type Lie = (&'static str, Value, &'static [&'static str]);
    let gigantic = 1u64 << 60;
    let lies: Vec<Lie> = vec![
        ("/accessors/0/count", json!(5), &["mesh 0 primitive 0 POSITION", "beyond its buffer view"]),
        ("/accessors/0/count", json!(gigantic), &["POSITION", "beyond its buffer view"]),
        ("/accessors/0/count", json!(0), &["below 0"]),
        ("/accessors/0/byteOffset", json!(u64::MAX), &["POSITION", "beyond its buffer view"]),
        ("/accessors/0/componentType", json!(5125), &["POSITION", "F32"]),
        ("/accessors/0/componentType", json!(7), &["POSITION", "componentType"]),
        ("/accessors/0/type", json!("MAT4"), &["POSITION", "matrices"]),
        ("/accessors/0/type", json!("VEC2"), &["POSITION", "3 components"]),
        ("/accessors/0/bufferView", json!(99), &["POSITION", "buffer view 99"]),
        ("/accessors/0/bufferView", Value::Null, &["POSITION", "no buffer view"]),
        (
            "/accessors/0/sparse",
            json!({ "count": 1, "indices": { "bufferView": 0, "componentType": 5121 },
            "values": { "bufferView": 0 } }),
            &["POSITION", "sparse"],
        ),
        ("/accessors/1/normalized", json!(true), &["indices", "U32"]),
        ("/accessors/1/count", json!(11), &["indices", "whole triangles"]),
        ("/accessors/1/componentType", json!(5126), &["indices", "beyond its buffer view"]),
        ("/accessors/2/count", json!(3), &["NORMAL", "each vertex"]),
        ("/accessors/3/count", json!(3), &["TEXCOORD_0", "each vertex"]),
        ("/bufferViews/0/byteLength", json!(gigantic), &["buffer view 0", "beyond its buffer"]),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), &["buffer view 0", "beyond its buffer"]),
        ("/bufferViews/0/byteStride", json!(0), &["stride"]),
        ("/bufferViews/0/byteStride", json!(8), &["stride"]),
        ("/bufferViews/0/byteStride", json!(16), &["beyond its buffer view"]),
        ("/bufferViews/0/buffer", json!(3), &["buffer 3"]),
        ("/nodes/0/mesh", json!(4), &["mesh 4"]),
        ("/nodes/0/children", json!([0]), &["node 0", "more than once"]),
        ("/nodes/0/children", json!([7]), &["node 7"]),
        ("/nodes/0/scale", json!([1, 0, 1]), &["no inverse"]),
        ("/nodes/0/matrix", json!(vec![1e38; 16]), &["no inverse"]),
        ("/nodes/0/translation", json!([1e30, 0, 0]), &["too far"]),
        ("/nodes/0/skin", json!(0), &["skinned"]),
        ("/nodes", json!([{}]), &["no triangle"]),
        ("/scene", json!(2), &["scene 2"]),
        ("/scenes/0/nodes", json!([1]), &["node 1"]),
        ("/meshes/0/primitives/0/mode", json!(1), &["Lines"]),
        ("/meshes/0/primitives/0/mode", json!(9), &["mode"]),
        ("/meshes/0/primitives/0/material", json!(9), &["material 9"]),
        ("/meshes/0/primitives/0/attributes", json!({}), &["POSITION"]),
        ("/meshes/0/primitives/0/attributes/COLOR_0", json!(2), &["vertex colours"]),
        ("/meshes/0/weights", json!([0.5]), &["morphed"]),
        ("/materials/0/pbrMetallicRoughness/baseColorTexture/index", json!(9), &["material 0", "texture 9"]),
        (
            "/materials/0/pbrMetallicRoughness/baseColorTexture/texCoord",
            json!(1),
            &["material 0", "other texture"],
        ),
        ("/materials/0/pbrMetallicRoughness/baseColorFactor", json!([0, 0, 0, 1]), &["black"]),
        ("/materials/0/pbrMetallicRoughness/baseColorFactor", json!([-1, 0, 0, 1]), &["baseColorFactor"]),
        ("/textures/0/source", json!(9), &["image 9"]),
        ("/textures/0/sampler", json!(9), &["sampler 9"]),
        ("/samplers/0/wrapS", json!(1), &["wrapS"]),
        ("/images/0/bufferView", json!(0), &["material 0 baseColorTexture", "image"]),
        ("/images/0", json!({ "uri": "http://example.org/a.png" }), &["remote"]),
        ("/images/0", json!({ "uri": "../a.png" }), &["outside"]),
        ("/images/0", json!({ "uri": "a.png" }), &["a.png"]),
        ("/images/0", json!({ "uri": "data:image/png;base64,!!" }), &["data URI"]),
        ("/images/0", json!({}), &["image 0"]),
        ("/asset/version", json!("1.0"), &["1.0"]),
        ("/extensionsRequired", json!(["KHR_draco_mesh_compression"]), &["KHR_draco_mesh_compression"]),
    ];
    for (pointer, value, words) in lies {
        let mut draft = full();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let place = draft.json.pointer_mut(parent).unwrap();
        match key.parse::<usize>() {
            Ok(i) if place.is_array() => place[i] = value.clone(),
            _ => place[key] = value.clone(),
        }
        let error = draft.load().map(|_| ()).expect_err(&format!("{pointer} = {value}")).to_string();
        for word in words {
            assert!(error.contains(word), "{pointer} = {value}: no `{word}` in: {error}");
        }
    }
}

#[test]
fn bad_values_in_the_data_are_named() {
    let mut nan = full();
    nan.bin[16..20].copy_from_slice(&f32::NAN.to_le_bytes());
    let error = nan.load().unwrap_err().to_string();
    assert!(error.contains("POSITION: element 1 is not finite"), "{error}");
    let mut index = full();
    let at = 48;
    index.bin[at..at + 2].copy_from_slice(&900u16.to_le_bytes());
    let error = index.load().unwrap_err().to_string();
    assert!(error.contains("vertex 900"), "{error}");
    let mut flat = Draft::new();
    flat.attribute("POSITION", &[[1.0f32, 1.0, 1.0]; 6]);
    assert!(flat.load().unwrap_err().to_string().contains("no triangle"));
    let mut normal = Draft::tetrahedron(None);
    normal.attribute("NORMAL", &[[0.0f32; 3]; 12]);
    assert!(normal.load().unwrap_err().to_string().contains("no length"));
    let mut bomb = full();
    // A PNG that claims 100 000 x 100 000 pixels.
    let mut png = png8(1, &[1]);
    png[16..24].copy_from_slice(&[0, 1, 0x86, 0xa0, 0, 1, 0x86, 0xa0]);
    bomb.texture(&png);
    bomb.load().unwrap_err();
}

#[test]
fn instances_cannot_multiply_a_small_file_without_end() {
    let mut draft = Draft::new();
    draft.attribute("POSITION", &vec![[0.0f32, 1.0, 2.0]; 300]);
    draft.json["nodes"] = json!(vec![json!({ "mesh": 0 }); 60_000]);
    draft.json["scenes"] = json!([{ "nodes": (0..60_000).collect::<Vec<_>>() }]);
    let error = draft.load().unwrap_err().to_string();
    assert!(error.contains("larger than it may be"), "{error}");
    // A chain of nodes as deep as that is followed without recursion.
    let mut chain = Draft::tetrahedron(None);
    let mut nodes: Vec<Value> = (1..60_000).map(|i| json!({ "children": [i] })).collect();
    nodes.push(json!({ "mesh": 0 }));
    chain.json["nodes"] = json!(nodes);
    assert_eq!(chain.load().unwrap().triangles.len(), 4);
}

#[test]
fn truncated_containers_are_errors() {
    let glb = full().glb();
    // The last bytes are padding of the last image.
    for length in 0..glb.len() - 3 {
        assert!(load_bytes(&glb[..length]).is_err(), "{length} of {} bytes", glb.len());
    }
    for (at, word) in [(4, 1u32), (8, 7), (8, u32::MAX), (12, u32::MAX), (16, 0)] {
        let mut lying = glb.clone();
        lying[at..at + 4].copy_from_slice(&word.to_le_bytes());
        assert!(load_bytes(&lying).is_err(), "{word} at {at}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), magic: bool) {
        let start: &[u8] = if magic { b"glTF\x02\0\0\0" } else { b"" };
        prop_assert!(load_bytes(&[start, &bytes].concat()).is_err());
    }

    #[test]
    fn corrupted_files_never_panic(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12)) {
        let mut glb = full().glb();
        for (at, value) in edits {
            let i = at.index(glb.len());
            glb[i] = value;
        }
        // Whether it still loads depends on where it was hit; a panic fails the test.
        let _ = load_bytes(&glb).map(|mut body| { body.smooth_normals(); body.is_closed() });
    }

    #[test]
    fn changed_numbers_never_panic(picks in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![
        Just(json!(0)), Just(json!(-1)), Just(json!(1)), Just(json!(3)), Just(json!(65535)),
        Just(json!(u64::MAX)), Just(json!(1e300)), Just(json!(0.5)), Just(json!([])), Just(json!("x")),
    ]), 1..4)) {
        let mut draft = full();
        for (pick, value) in picks {
            let mut places = Vec::new();
            numbers(&draft.json, String::new(), &mut places);
            *draft.json.pointer_mut(&places[pick.index(places.len())]).unwrap() = value;
        }
        let _ = draft.load();
    }
}

/// JSON pointers of all numbers.
fn numbers(value: &Value, at: String, out: &mut Vec<String>) {
    match value {
        Value::Number(_) => out.push(at),
        Value::Array(items) => {
            for (i, item) in items.iter().enumerate() {
                numbers(item, format!("{at}/{i}"), out);
            }
        }
        Value::Object(map) => {
            for (key, item) in map {
                numbers(item, format!("{at}/{key}"), out);
            }
        }
        _ => {}
    }
}
