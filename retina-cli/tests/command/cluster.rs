//! Plans of shards: what their scripts do, how far they are, and what joining them refuses.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::common::{Fixture, assert_done, assert_refused, contents, json, retina, stderr};

fn plan(fixture: &Fixture, source: &str, out: &str, more: &[&str]) -> Output {
    retina()
        .arg("plan")
        .arg(fixture.path(source))
        .arg("--out")
        .arg(fixture.path(out))
        .args(more)
        .output()
        .unwrap()
}

fn status(folder: &Path, more: &[&str]) -> serde_json::Value {
    json(&retina().arg("status").arg(folder).arg("--json").args(more).output().unwrap())
}

/// Runs a script of a plan's folder from elsewhere.
fn script(folder: &Path, name: &str, arguments: &[&str]) -> Output {
    Command::new(folder.join(name)).args(arguments).env("ATTEMPTS", "1").output().unwrap()
}

fn merge(folders: &[&Path], out: &Path, more: &[&str]) -> Output {
    retina().arg("merge").args(folders).arg("--out").arg(out).args(more).output().unwrap()
}

#[test]
fn the_shards_of_a_plan_are_one_run() {
    let fixture = Fixture::with_frames(11);
    assert_done(&fixture.render("whole", &[]));
    // A path that a careless script would break at.
    let out = "the plan's folder";
    let own = fixture.path(out);
    let cut = ["--shards", "3", "--format", "shell", "--backend", "cpu", "--cpus", "1"];
    assert_done(&plan(&fixture, "scene.toml", out, &cut));
    let found = status(&own, &[]);
    assert_eq!((found["items"].as_u64(), found["missing"].as_u64()), (Some(11), Some(11)));
    assert_eq!(found["shards"][0]["state"], "waiting");
    assert_eq!(found["shards"][2]["items"], 3);
    // One shard is done, another is torn; joining is refused, and says what is missing.
    assert_done(&script(&own, "task.sh", &["0"]));
    assert_done(&script(&own, "task.sh", &["1"]));
    let torn = own.join("shards/00001/frames/000004.png");
    fs::write(&torn, "").unwrap();
    let found = status(&own, &[]);
    assert_eq!(
        (found["done"].as_u64(), found["torn"].as_u64(), found["missing"].as_u64()),
        (Some(7), Some(1), Some(3))
    );
    assert_eq!((&found["shards"][0]["state"], &found["complete"]), (&"done".into(), &false.into()));
    assert_refused(&script(&own, "finish.sh", &[]), &["frames are missing", "8 of 11 frames", "frame 2"]);
    assert!(!own.join("merged").exists());
    // A file of another content is seen where hashes are asked for.
    fs::write(&torn, "another content").unwrap();
    assert_eq!(status(&own, &[])["torn"], 0);
    assert_eq!(status(&own, &["--verify"])["torn"], 1);
    // The plan made again, and all tasks run again, mend it.
    assert_done(&plan(&fixture, "scene.toml", out, &cut));
    assert_done(&script(&own, "submit.sh", &[]));
    assert_eq!(contents(&own.join("merged")), contents(&fixture.path("whole")));
    let found = status(&own, &["--verify"]);
    assert_eq!((found["complete"].as_bool(), found["merged"].as_u64()), (Some(true), Some(11)));
    // Joined again, nothing is done; a joined folder is one of frames.
    let again = json(&merge(&[&own.join("shards/00000")], &own.join("merged"), &["--partial", "--json"]));
    assert_eq!((again["frames_done"].as_u64(), again["frames_skipped"].as_u64()), (Some(0), Some(4)));
    assert_eq!(status(&own.join("merged"), &[])["complete"], true);
    assert_eq!(contents(&own.join("merged")), contents(&fixture.path("whole")));
    // In two parts: what was joined before counts; a plan stands for its shards.
    let shards = [0, 1, 2].map(|shard| own.join(format!("shards/{shard:05}")));
    let parts = own.join("parts");
    assert_done(&merge(&[&shards[0], &shards[1]], &parts, &["--partial"]));
    assert_done(&merge(&[&shards[2]], &parts, &[]));
    assert_done(&merge(&[&own], &own.join("by plan"), &[]));
    for joined in [parts, own.join("by plan")] {
        assert_eq!(contents(&joined), contents(&fixture.path("whole")));
    }
    // A file that is not what its manifest says is not joined.
    let damaged = own.join("shards/00000/truth/000003.json");
    fs::remove_file(&damaged).unwrap();
    fs::write(&damaged, "another content").unwrap();
    assert_refused(&script(&own, "finish.sh", &[]), &["000003.json", "not what its manifest says"]);
    let rest = json(&merge(&[&own], &own.join("rest"), &["--partial", "--json"]));
    assert_eq!(rest["missing"], serde_json::json!([3]));
    assert_eq!(contents(&own.join("merged")), contents(&fixture.path("whole")));
}

#[test]
fn scripts_of_every_engine_are_read_by_a_shell() {
    let fixture = Fixture::with_frames(3);
    for format in ["slurm", "hyperqueue", "snakemake", "kubernetes", "shell"] {
        let own = fixture.path(format);
        assert_done(&plan(&fixture, "scene.toml", format, &["--shards", "2", "--format", format]));
        let mut read = 0;
        for entry in fs::read_dir(&own).unwrap() {
            let path = entry.unwrap().path();
            if fs::read_to_string(&path).is_ok_and(|text| text.starts_with("#!/bin/sh")) {
                let checked = Command::new("sh").arg("-n").arg(&path).output().unwrap();
                assert_done(&checked);
                read += 1;
            }
        }
        assert!(read >= 3, "{format}: {read}");
        // All know the scale of the whole sequence before the first frame.
        let record =
            |shard: &str| fs::read_to_string(own.join("shards").join(shard).join("batch.json")).unwrap();
        assert_eq!(record("00000"), record("00001"));
        assert!(record("00000").contains("\"backend\": \"native\""));
    }
}

#[test]
fn a_far_range_campaign_is_cut_into_shards() {
    let fixture = Fixture::new();
    let asset = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenarios/far-range.toml");
    let setups = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups");
    let text = fs::read_to_string(asset).unwrap().replace("../setups", setups);
    fixture.write(
        "far.toml",
        &text.replace("samples = 100", "samples = 2").replace("count = 5000", "count = 7"),
    );
    assert_done(&plan(&fixture, "far.toml", "far", &["--shards", "2", "--format", "slurm"]));
    let own = fixture.path("far");
    assert_done(&script(&own, "task.sh", &["1"]));
    let found = status(&own, &[]);
    assert_eq!(
        (found["unit"].as_str(), found["done"].as_u64(), found["missing"].as_u64()),
        (Some("poses"), Some(3), Some(4))
    );
    assert_done(&script(&own, "task.sh", &["0"]));
    assert_done(&script(&own, "finish.sh", &[]));
    assert_eq!(status(&own, &[])["complete"], true);
    assert!(own.join("results/far-range.json").exists());
}

#[test]
fn a_full_disk_campaign_in_shards_is_one_run() {
    let fixture = Fixture::with_frames(6);
    fixture.edit("scene.toml", "setup.toml", "wide-fov");
    fixture.edit("scene.toml", "calibration = \"calibration.toml\"", "");
    fixture.write(
        "disk.toml",
        "schema = \"retina.full-disk/1\"\nscene = \"scene.toml\"\nframes = \"1..4\"\nevery = 2\nseed = 5\n\
         campaign = { exposures = 4, points = 40 }\n",
    );
    let whole = |out: &str| {
        let mut command = retina();
        command.args(["navigate", "full-disk"]).arg(fixture.path("disk.toml"));
        command.args(["--backend", "native", "--out"]).arg(fixture.path(out)).output().unwrap()
    };
    assert_done(&whole("whole"));
    let cut = ["--shards", "2", "--format", "shell", "--cpus", "2"];
    assert_done(&plan(&fixture, "disk.toml", "plan", &cut));
    let own = fixture.path("plan");
    let found = status(&own, &[]);
    assert_eq!((found["unit"].as_str(), found["items"].as_u64()), (Some("frames"), Some(2)));
    assert_eq!((&found["shards"][0]["items"], &found["shards"][1]["items"]), (&1.into(), &1.into()));
    assert_done(&script(&own, "task.sh", &["1"]));
    let found = status(&own, &[]);
    assert_eq!((found["done"].as_u64(), &found["shards"][1]["state"]), (Some(1), &"done".into()));
    // What is missing is not made by the script that joins.
    assert_refused(&script(&own, "finish.sh", &[]), &["frames are missing", "1 of 2"]);
    assert_refused(&script(&own, "task.sh", &["2"]), &["there is no shard 2"]);
    assert_done(&script(&own, "task.sh", &["0"]));
    assert_eq!(status(&own, &[])["complete"], true);
    // A damaged photograph is seen, named, not joined, and taken anew.
    let photograph = own.join("results/parts/1-of-2/bench/upstream/images/000003.png");
    let whole_bytes = fs::read(&photograph).unwrap();
    fs::write(&photograph, &whole_bytes[..5000]).unwrap();
    assert_eq!(status(&own, &[])["torn"], 0);
    assert_eq!(status(&own, &["--verify"])["torn"], 1);
    assert_refused(&script(&own, "finish.sh", &[]), &["000003.png", "is not the photograph that was taken"]);
    assert_done(&script(&own, "task.sh", &["1"]));
    assert_eq!(fs::read(&photograph).unwrap(), whole_bytes);
    assert_eq!(status(&own, &["--verify"])["complete"], true);
    // One that is gone is taken anew, and is the same.
    fs::remove_file(&photograph).unwrap();
    let finished = script(&own, "finish.sh", &[]);
    assert_done(&finished);
    assert!(stderr(&finished).contains("1-of-2"), "{}", stderr(&finished));
    let read = |folder: &Path, name: &str| fs::read(folder.join(name)).unwrap();
    let (one, joined) = (fixture.path("whole"), own.join("results"));
    for name in ["screen/uncompensated", "screen/upstream"] {
        for kind in ["frames", "truth"] {
            assert_eq!(contents(&one.join(name).join(kind)), contents(&joined.join(name).join(kind)));
        }
    }
    let photographs = |folder: &Path| {
        let mut found = contents(folder);
        found.retain(|path, _| path.extension().is_some_and(|extension| extension == "png"));
        found
    };
    for name in ["bench/uncompensated/images", "bench/upstream/images"] {
        assert_eq!(photographs(&one.join(name)).len(), 2);
        assert_eq!(photographs(&one.join(name)), photographs(&joined.join(name)), "{name}");
    }
    assert_eq!(read(&one, "full-disk.json"), read(&joined, "full-disk.json"));
    // The parts' photographs are not another copy.
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let linked = fs::metadata(joined.join("bench/upstream/images/000001.png")).unwrap();
        assert_eq!(linked.nlink(), 2);
    }
    assert_refused(
        &plan(&fixture, "disk.toml", "more", &["--shards", "3", "--format", "shell"]),
        &["there are 2 frames"],
    );
}

#[test]
fn runs_of_a_command_are_cut_into_shards() {
    let fixture = Fixture::new();
    let runs = r#"schema = "retina.runs/1"
command = ["trajectory", "--frames", "2", "--step-s", "{step}", "--out", "{out}/halo.csv", "--json"]
collect = { frames = "/frames" }
[values]
step = [60, 86.5, "300"]
"#;
    fixture.write("runs.toml", runs);
    assert_done(&plan(&fixture, "runs.toml", "plan", &["--shards", "2", "--format", "shell"]));
    let own = fixture.path("plan");
    let found = status(&own, &[]);
    assert_eq!((found["unit"].as_str(), found["items"].as_u64()), (Some("runs"), Some(3)));
    assert_refused(&script(&own, "finish.sh", &[]), &["runs are missing", "0 of 3 runs"]);
    assert_done(&script(&own, "task.sh", &["1"]));
    assert_eq!(status(&own, &[])["done"], 1);
    assert_done(&script(&own, "submit.sh", &[]));
    assert_eq!(status(&own, &[])["complete"], true);
    let table = fs::read_to_string(own.join("results/runs.csv")).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!((lines[0], lines.len()), ("number,step,seconds,frames", 4));
    assert!(lines[2].starts_with("1,86.5,") && lines[2].ends_with(",2"), "{}", lines[2]);
    assert!(own.join("results/runs/000001/halo.csv").exists());
    // Done once, done for good; a changed file is another campaign.
    let again = |file: &str, more: &[&str]| {
        let mut command = retina();
        command.arg("runs").arg(fixture.path(file)).arg("--out").arg(own.join("results"));
        command.args(more).output().unwrap()
    };
    assert_eq!(json(&again("runs.toml", &["--json"]))["skipped"], 3);
    fixture.write("other.toml", &runs.replace("\"2\"", "\"3\""));
    for more in [&[][..], &["--collect"]] {
        assert_refused(&again("other.toml", more), &["by another command, or with other values"]);
    }
    // Another pointer and more values at the end are the same campaign.
    let more = runs.replace("/frames", "/out").replace("\"300\"]", "\"300\", 400]");
    fixture.write("more.toml", &more);
    let grown = json(&again("more.toml", &["--json"]));
    assert_eq!((&grown["skipped"], &grown["done"]), (&3.into(), &1.into()));
    // Two at once do each run once.
    fixture.write("two.toml", &runs.replace("[60, 86.5, \"300\"]", "{ from = 60, to = 67 }"));
    let both: Vec<_> = (0..2)
        .map(|_| {
            let mut command = retina();
            command.arg("runs").arg(fixture.path("two.toml")).arg("--out").arg(fixture.path("two"));
            command.stderr(std::process::Stdio::null()).spawn().unwrap()
        })
        .collect();
    for mut one in both {
        assert!(one.wait().unwrap().success());
    }
    for run in 0..8 {
        let folder = fixture.path("two").join(format!("runs/{run:06}"));
        assert!(folder.join("run.json").exists() && folder.join("halo.csv").exists(), "{run}");
    }
    // A run that fails is named; the others are made.
    fixture.write("bad.toml", &runs.replace("[60, 86.5, \"300\"]", "[60, -1, 300]"));
    let mut command = retina();
    command.arg("runs").arg(fixture.path("bad.toml")).arg("--out").arg(fixture.path("bad"));
    assert_refused(&command.output().unwrap(), &["1 runs failed: 1;", "stderr.txt"]);
    let why = fs::read_to_string(fixture.path("bad/runs/000001/stderr.txt")).unwrap();
    assert!(why.contains("--step-s") && fixture.path("bad/runs/000002/run.json").exists(), "{why}");
    assert_eq!(fs::read_to_string(fixture.path("bad/runs.csv")).unwrap().lines().count(), 3);
    for (from, to, said) in [
        ("{step}", "{stop}", "the name {stop} has no values"),
        ("{step}", "60", "`step` does not occur"),
        ("{out}", "out", "own folder"),
        ("[60, 86.5, \"300\"]", "[]", "one value at least"),
        ("[60, 86.5, \"300\"]", "{ from = 3, to = 1 }", "two whole numbers in order"),
        ("[60, 86.5, \"300\"]", "{ from = 1.5, to = 3 }", "a list of numbers, texts or truths"),
        ("\"trajectory\"", "\"trajectroy\"", "did you mean `trajectory`"),
        ("\"trajectory\"", "\"runs\"", "runs do not run runs"),
        ("\"/frames\"", "\"frames\"", "a JSON pointer"),
        (", \"--json\"", "", "no document to collect from"),
        ("frames = \"/", "seconds = \"/", "a column `seconds` already"),
        ("step = ", "out = [1]\nstep = ", "given by the run itself"),
        ("collect", "table = \"runs.csv\"\ncollect", "not from both"),
        ("collect", "colect", "colect"),
    ] {
        assert!(runs.contains(from), "{from}");
        fixture.write("wrong.toml", &runs.replacen(from, to, 1));
        let mut command = retina();
        command.arg("runs").arg(fixture.path("wrong.toml")).arg("--out").arg(fixture.path("wrong"));
        assert_refused(&command.output().unwrap(), &[said, "wrong.toml"]);
        assert!(!fixture.path("wrong").exists());
    }
}

#[test]
fn what_cannot_be_cut_or_joined_is_refused() {
    let fixture = Fixture::new();
    let shell = |shards: &'static str| ["--format", "shell", "--shards", shards];
    for shards in ["0", "7"] {
        assert_refused(
            &plan(&fixture, "scene.toml", "p", &shell(shards)),
            &["--shards", "1 to 6", "6 frames"],
        );
    }
    assert_refused(&plan(&fixture, "setup.toml", "p", &shell("2")), &["retina.setup/1", "retina.scene/1"]);
    assert_refused(&plan(&fixture, "none.toml", "p", &shell("2")), &["none.toml", "cannot be read"]);
    assert!(!fixture.path("p").exists());
    // Another cut, another plan; a folder of something else.
    assert_done(&plan(&fixture, "scene.toml", "p", &shell("2")));
    assert_refused(
        &plan(&fixture, "scene.toml", "p", &shell("3")),
        &["another plan", "2 shards", "3 shards"],
    );
    fs::create_dir(fixture.path("mine")).unwrap();
    fixture.write("mine/notes.txt", "mine");
    assert_refused(&plan(&fixture, "scene.toml", "mine", &shell("2")), &["notes.txt", "folder of its own"]);
    // The scene changes under its plan.
    assert_done(&script(&fixture.path("p"), "task.sh", &["0"]));
    fixture.edit("scene.toml", "0.12", "0.13");
    let changed = script(&fixture.path("p"), "task.sh", &["1"]);
    assert!(stderr(&changed).contains("another scene"), "{}", stderr(&changed));
    assert_refused(&plan(&fixture, "scene.toml", "p", &shell("2")), &["another scene"]);
    // Frames of two scenes, and of one scene by two renderers.
    let shard = fixture.path("p/shards/00000");
    assert_done(&fixture.render("other", &[]));
    assert_refused(
        &merge(&[&shard, &fixture.path("other")], &fixture.path("m"), &[]),
        &["other", "another scene"],
    );
    assert_refused(
        &merge(&[&fixture.path("mine")], &fixture.path("m"), &[]),
        &["mine", "no frames of a run"],
    );
    assert!(!fixture.path("m").exists());
    assert_refused(
        &retina().arg("status").arg(fixture.path("mine")).output().unwrap(),
        &["neither a plan nor frames"],
    );
    fixture.write("p/plan.json", "{\"schema\": \"retina.plan/1\"}");
    assert_refused(
        &retina().arg("status").arg(fixture.path("p")).output().unwrap(),
        &["plan.json", "is not a plan"],
    );
}
