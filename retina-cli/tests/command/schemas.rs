//! The schemas that ship: files fit them, and readers take the keys that they name and no others.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{self, assert_done, assert_fits_its_schema, assert_refused, fits, json};
use retina_assets::SCHEMAS;
use serde_json::{Map, Value, json as value};

fn schema(name: &str) -> Value {
    serde_json::from_str(SCHEMAS.iter().find(|(own, _)| *own == name).unwrap().1).unwrap()
}

fn retina(arguments: &[&str]) -> std::process::Output {
    common::retina().args(arguments).output().unwrap()
}

fn assets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets")
}

fn toml_file(path: &Path) -> Value {
    let table: toml::Table = fs::read_to_string(path).unwrap().parse().unwrap();
    serde_json::to_value(table).unwrap()
}

#[test]
fn schemas_are_printed_listed_and_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("schemas");
    assert_done(&retina(&["schema", "--out", out.to_str().unwrap()]));
    let listed = String::from_utf8(retina(&["schema", "--list"]).stdout).unwrap();
    for (name, text) in SCHEMAS {
        assert_eq!(String::from_utf8(retina(&["schema", name]).stdout).unwrap(), text);
        assert_eq!(fs::read_to_string(out.join(format!("{name}.schema.json"))).unwrap(), text);
        assert!(
            listed.lines().any(|line| line.starts_with(&format!("{name} ")) && line.len() > 24),
            "{listed}"
        );
        let schema: Value = serde_json::from_str(text).unwrap();
        // A schema that does not fit its own says so; `null` fits none of them.
        assert!(fits(&schema, &Value::Null).unwrap_err().contains("want object"), "{name}");
        assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema", "{name}");
        assert!(schema["description"].as_str().unwrap().len() > 20, "{name}");
    }
    assert_refused(
        &retina(&["schema", "scnee"]),
        &["there is no such schema", "`scnee`", "did you mean `scene`?"],
    );
}

#[test]
fn files_that_ship_and_files_to_start_from_fit() {
    let assets = assets();
    let mut fitting = 0;
    for folder in ["setups", "scenarios", "calibrations"] {
        for entry in fs::read_dir(assets.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            assert!(assert_fits_its_schema(&toml_file(&path)), "{} has no schema", path.display());
            fitting += 1;
        }
    }
    let folder = tempfile::tempdir().unwrap();
    for kind in ["setup", "scene", "campaign"] {
        let path = folder.path().join(format!("{kind}.toml"));
        // A scene and a campaign bring a setup where there is none.
        if !path.exists() {
            assert_done(&retina(&["new", kind, "--out", path.to_str().unwrap()]));
        }
        assert!(assert_fits_its_schema(&toml_file(&path)), "{kind}");
        fitting += 1;
    }
    assert!(fitting >= 13, "{fitting}");
    // A key that a schema does not have is refused by it.
    let mut setup = toml_file(&assets.join("setups/wide-fov.toml"));
    setup["screen"]["widht_px"] = value!(3);
    assert!(fits(&schema("setup"), &setup).is_err());
}

#[test]
fn documents_of_commands_fit() {
    let fixture = common::Fixture::new();
    assert_done(&fixture.render("out", &["--frames", "0..1"]));
    let truth: Value =
        serde_json::from_slice(&fs::read(fixture.path("out/truth/000000.json")).unwrap()).unwrap();
    assert!(assert_fits_its_schema(&truth));
    let record: Value = serde_json::from_slice(&fs::read(fixture.path("out/batch.json")).unwrap()).unwrap();
    let manifest = fs::read_to_string(fixture.path("out/manifest.jsonl")).unwrap();
    let frame: Value = serde_json::from_str(manifest.lines().next().unwrap()).unwrap();
    let devices = json(&retina(&["lab", "devices", "--json"]));
    let setup = assets().join("setups/wide-fov.toml");
    let power = fixture.path("power");
    let campaign = ["--setup", setup.to_str().unwrap(), "--seed", "1", "--out", power.to_str().unwrap()];
    let campaign = json(&retina(&[&["simulate", "power", "--json"], &campaign[..]].concat()));
    let setup = fixture.path("setup.toml");
    let constraints = json(&retina(&["optics", "constraints", "--f-c", "150", "--f-r", "100", "--json"]));
    let checked = json(&retina(&["check", setup.to_str().unwrap(), "--json"]));
    for document in [&constraints, &checked, &record, &frame, &devices, &campaign] {
        assert!(assert_fits_its_schema(document));
    }
}

/// A value that a schema allows: the first of what it leaves open.
fn sample(schema: &Value) -> Value {
    if let Some(own) = schema.get("const").or(schema["enum"].get(0)) {
        return own.clone();
    }
    if let Some(first) = schema["anyOf"].get(0)
        && schema.get("properties").is_none()
    {
        return sample(first);
    }
    match schema["type"].as_str().unwrap() {
        "string" => value!("x"),
        "integer" => value!(schema["minimum"].as_u64().unwrap_or(1).max(1)),
        "number" => value!(1.5),
        "boolean" => value!(true),
        "array" => {
            let count = schema["minItems"].as_u64().unwrap_or(0) as usize;
            Value::Array(vec![if count > 0 { sample(&schema["items"]) } else { Value::Null }; count])
        }
        "object" => {
            let required = schema["required"].as_array().into_iter().flatten().flat_map(Value::as_str);
            let all = required.map(|key| (key.to_owned(), sample(&schema["properties"][key])));
            Value::Object(all.collect::<Map<_, _>>())
        }
        other => panic!("{other}"),
    }
}

/// A closed table of a schema: its keys, and a whole file in which it has one more, `zzz`.
fn tables(schema: &Value) -> Vec<(String, BTreeSet<String>, Value)> {
    let mut found = Vec::new();
    match schema {
        _ if schema["properties"].is_object() => {
            let properties = schema["properties"].as_object().unwrap();
            if schema["additionalProperties"] == false {
                let mut file = sample(schema);
                file["zzz"] = value!(1);
                found.push((String::new(), properties.keys().cloned().collect(), file));
            }
            for (key, property) in properties {
                for (place, keys, inner) in tables(property) {
                    let mut file = sample(schema);
                    file[key] = inner;
                    found.push((format!(".{key}{place}"), keys, file));
                }
            }
        }
        _ if schema["anyOf"].is_array() => {
            found.extend(schema["anyOf"].as_array().unwrap().iter().flat_map(tables))
        }
        _ if schema["items"].is_object() => {
            let inner = tables(&schema["items"]).into_iter();
            found.extend(inner.map(|(place, keys, inner)| (place, keys, value!([inner]))));
        }
        _ => {}
    }
    found
}

/// The reader says itself which keys it takes, when it meets one that it does not.
#[test]
fn readers_take_the_keys_of_the_schemas_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file.toml");
    fs::write(folder.path().join("setup.toml"), common::SETUP).unwrap();
    let [setup, points] = ["setup.toml", "points.csv"].map(|name| folder.path().join(name));
    let corpus = concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz/corpus/points/few.csv");
    fs::copy(corpus, &points).unwrap();
    let mut compared = 0;
    for name in ["setup", "scene", "far-range", "full-disk", "flashes", "runs", "calibration", "effect"] {
        for (place, keys, mut file) in tables(&schema(name)) {
            if name == "effect" {
                // The file is known by a formula, and read with the table that it is given together with.
                file["value"] = value!("x");
            }
            let text = toml::to_string(&serde_json::from_value::<toml::Table>(file).unwrap()).unwrap();
            fs::write(&path, &text).unwrap();
            let [path, setup, points] = [&path, &setup, &points].map(|path| path.to_str().unwrap());
            let with_table = ["check", path, points, setup, "--json"];
            let output =
                if name == "effect" { retina(&with_table) } else { retina(&["check", path, "--json"]) };
            let document: Value = serde_json::from_slice(&output.stdout).unwrap();
            let problem = document["files"][0]["input"]["problem"].as_str().unwrap_or_default();
            let (unknown, expected) = problem.split_once(", expected ").unwrap_or((problem, ""));
            assert_eq!(unknown, "unknown field `zzz`", "{name}{place}: {document}\n{text}");
            let taken: BTreeSet<String> = expected.split('`').skip(1).step_by(2).map(str::to_owned).collect();
            assert_eq!(taken, keys, "{name}{place}");
            compared += 1;
        }
    }
    assert!(compared > 35, "{compared}");
}
