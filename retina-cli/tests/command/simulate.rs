//! `retina simulate`: no campaign loses its description, and what is refused.

use std::path::Path;

use crate::common::{assert_done, assert_refused, retina};

const SETUP: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/setups/wide-fov.toml");

fn simulate(kind: &str, out: &Path, more: &[&str]) -> std::process::Output {
    let common = ["simulate", kind, "--setup", SETUP, "--seed", "1", "--out"];
    retina().args(common).arg(out).args(more).output().unwrap()
}

#[test]
fn a_campaign_is_not_laid_over_another() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("campaign");
    let few = ["--exposures", "3", "--points", "20"];
    assert_done(&simulate("points", &out, &few));
    // The same again, and with its images: nothing is lost.
    assert_done(&simulate("points", &out, &[&few[..], &["--images"]].concat()));
    let before = std::fs::read(out.join("campaign.json")).unwrap();
    // Without them the images would be another campaign's.
    assert_refused(&simulate("points", &out, &few), &["images", "--images"]);
    // A campaign of another kind may stand beside it; each keeps its description.
    let power = simulate("power", &out, &["--series", "1"]);
    assert_done(&power);
    assert!(String::from_utf8_lossy(&power.stderr).contains("campaign-points.json"));
    assert_eq!(std::fs::read(out.join("campaign-points.json")).unwrap(), before);
    assert!(std::fs::read_to_string(out.join("campaign.json")).unwrap().contains("\"power\""));
}

#[test]
fn photographs_do_not_go_among_the_rendered_frames_and_a_share_is_one() {
    let folder = tempfile::tempdir().unwrap();
    let screens = folder.path().join("screens");
    std::fs::create_dir(&screens).unwrap();
    let beside = screens.join("../screens");
    let own = simulate("frames", &beside, &["--screens", screens.to_str().unwrap()]);
    assert_refused(&own, &["is the folder of the rendered frames"]);
    let out = folder.path().join("stars");
    let asked = simulate("stars", &out, &["--share", "96", "--within-arcsec", "10"]);
    assert_refused(&asked, &["--share", "is not a share", "96", "0 to 1"]);
    assert!(!out.exists());
}
