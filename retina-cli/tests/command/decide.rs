//! `retina decide`, from a table that cannot decide to the one model that is left.

use std::path::{Path, PathBuf};
use std::process::Output;

use crate::common::{assert_done, assert_refused, retina};

fn setup() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups/wide-fov.toml")
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = retina();
    command.current_dir(folder).args(arguments).arg("--setup").arg(setup());
    command.output().unwrap()
}

/// A grid of points on a display without distortion. The boresight moves by 6 arcsec while the bench warms up by a kelvin
/// in proportion to the time: nobody can say which of the two it follows.
fn campaign(folder: &Path) {
    let mut text = String::from(
        "image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,sigma_px,time_s,temperature_c\n",
    );
    for exposure in 0..12 {
        let passed = f64::from(exposure) / 11.0;
        for k in 0..16 {
            let (x, y) = (f64::from(450 + 340 * (k % 4)), f64::from(150 + 290 * (k / 4)));
            // 25 mm and 3.45 um before the camera; the screen's K_f is that of 1200 rows for 1536.
            let camera = |at: f64, half: f64, centre: f64| centre + (at - half) * 1.28;
            let noise = 0.05 * f64::from((exposure * 16 + k) * 7919 % 101 - 50) / 29.0;
            let text_x = camera(x, 960.0, 1024.0) + 0.21 * passed + noise;
            let text_y = camera(y, 600.0, 768.0) - noise;
            text += &format!(
                "e{exposure},{x},{y},100,{text_x:.5},{text_y:.5},0.05,{},{:.4}\n",
                60 * exposure,
                20.0 + passed
            );
        }
    }
    std::fs::create_dir(folder.join("old")).unwrap();
    std::fs::write(folder.join("old/points.csv"), text).unwrap();
}

/// What the facility of [`campaign`] would measure of a plan, if the boresight follows the temperature.
const LABORATORY: &str = r#"
cd "$RETINA_ROUND" && awk -F, '
    BEGIN { print "image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,sigma_px,time_s,temperature_c,mounting" }
    NR == FNR { if (FNR > 1) { time[$2] = $4; warm[$2] = $5; mounted[$2] = $7 } next }
    FNR > 1 {
        noise = 0.05 * ((FNR * 7919) % 101 - 50) / 29
        x = 1024 + ($3 - 960) * 1.28 + 0.21 * (warm[$1] - 20) + noise
        y = 768 + ($4 - 600) * 1.28 - noise
        printf "%s,%s,%s,%s,%.5f,%.5f,0.05,%s,%s,%s\n", $1, $3, $4, $5, x, y, time[$1], warm[$1], mounted[$1]
    }' plan.csv pattern.csv > points.csv
"#;

const ASKED: [&str; 9] = [
    "decide",
    "--data",
    "old/points.csv",
    "--rival",
    "drift",
    "--rival",
    "thermal_boresight",
    "--out",
    "rounds",
];

fn asked(folder: &Path, more: &[&str]) -> Output {
    run(folder, &[&ASKED[..], more].concat())
}

#[test]
fn exposures_are_planned_made_and_decide() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    campaign(folder);
    let planned = asked(folder, &["--exposures", "3", "--points", "12", "--hold", "roll"]);
    assert_done(&planned);
    let said = String::from_utf8(planned.stdout).unwrap();
    assert!(said.contains("Left are: ") && said.contains("Measure next: 3 exposures"), "{said}");
    for file in ["plan.csv", "pattern.csv", "screens/000.png", "screens/002.png"] {
        assert!(folder.join("rounds/round_01").join(file).is_file(), "{file}");
    }
    // What is planned stays as it is, and is told again.
    let plan = std::fs::read(folder.join("rounds/round_01/plan.csv")).unwrap();
    let again = asked(folder, &["--exposures", "3", "--points", "12", "--hold", "roll", "--json"]);
    assert_done(&again);
    let said = String::from_utf8(again.stdout).unwrap();
    assert!(
        said.contains("\"waiting\": \"rounds/round_01\"") && said.contains("\"verdict\": \"open\""),
        "{said}"
    );
    assert_eq!(plan, std::fs::read(folder.join("rounds/round_01/plan.csv")).unwrap());

    // A command that measures nothing is told so; nothing is lost.
    assert_refused(&asked(folder, &["--take", "true"]), &["the round was not measured", "round_01"]);
    assert_refused(&asked(folder, &["--take", "echo broken >&2; exit 3"]), &["the command failed", "broken"]);

    let done = asked(folder, &["--hold", "roll", "--take", LABORATORY, "--json"]);
    assert_done(&done);
    let said = String::from_utf8(done.stdout).unwrap();
    assert!(said.contains("\"decided\": \"thermal_boresight\""), "{said}");
    assert!(said.contains("\"used\": 3"), "{said}");
    assert!(std::fs::read_to_string(folder.join("rounds/decision.json")).unwrap().contains("\"history\""));

    // Another question does not go on with these rounds.
    let other = run(
        folder,
        &["decide", "--data", "old/points.csv", "--rival", "drift", "--rival", "knock", "--out", "rounds"],
    );
    assert_refused(&other, &["the folder has rounds of another question", "--out"]);
}

#[test]
fn what_cannot_be_asked_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    campaign(folder);
    let refused = |more: &[&str], says: &[&str]| assert_refused(&asked(folder, more), says);
    refused(&["--rival", "drift"], &["--rival", "is given twice"]);
    refused(&["--rival", "drfit"], &["drfit", "did you mean `drift`?"]);
    refused(&["--hold", "rol"], &["--hold", "did you mean `roll`?"]);
    refused(&["--temperature-c", "24,18"], &["--temperature-c", "no range"]);
    refused(
        &["--temperature-c", "18,24", "--hold", "temperature"],
        &["--temperature-c", "--hold temperature"],
    );
    refused(&["--temperature-c", "-400,2000"], &["--temperature-c", "-150 to 150"]);
    refused(&["--rival", "drift+knock", "--rival", "knock+drift"], &["two rivals are the same model"]);
    refused(&["--effect", "drift"], &["in the model already"]);
    let one = run(folder, &["decide", "--data", "old/points.csv", "--rival", "drift", "--out", "rounds"]);
    assert_refused(&one, &["at least two rivals"]);
    assert!(!folder.join("rounds").exists());
}

#[test]
fn data_that_need_none_of_the_rivals_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    campaign(folder);
    let path = folder.join("old/points.csv");
    let still: String = std::fs::read_to_string(&path)
        .unwrap()
        .lines()
        .map(|line| {
            let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
            if let Ok(time_s) = cells[7].parse::<f64>() {
                let seen: f64 = cells[4].parse().unwrap();
                cells[4] = format!("{:.5}", seen - 0.21 * time_s / 660.0);
            }
            cells.join(",") + "\n"
        })
        .collect();
    std::fs::write(&path, still).unwrap();
    let held = ["places", "counts", "channel", "exposure", "roll", "temperature", "wait"];
    let hold: Vec<&str> = held.iter().flat_map(|what| ["--hold", *what]).collect();
    let said = asked(folder, &[&hold[..], &["--json"]].concat());
    assert_done(&said);
    let said = String::from_utf8(said.stdout).unwrap();
    assert!(said.contains("\"verdict\": \"none_needed\"") && said.contains("\"decided\": null"), "{said}");
}

#[test]
fn a_round_is_held_to_its_plan() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    campaign(folder);
    assert_done(&asked(folder, &["--exposures", "2", "--points", "8", "--hold", "roll"]));
    let points = folder.join("rounds/round_01/points.csv");
    let header =
        "image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,time_s,temperature_c,mounting\n";
    let put = |rows: &str| std::fs::write(&points, format!("{header}{rows}")).unwrap();
    put("other.png,960,600,100,1024,768,700,21,0\n");
    assert_refused(&asked(folder, &[]), &["round_01/points.csv", "`other.png`", "remove the file"]);
    put("000.png,960,600,100,1024,768,700,90,0\n");
    let told = asked(folder, &["--budget", "2"]);
    assert_done(&told);
    let told = String::from_utf8(told.stdout).unwrap();
    assert!(told.contains("1 of 2 planned exposures were not measured"), "{told}");
    assert!(told.contains("temperature_c of 000.png was 90, planned was "), "{told}");
}
