//! `--quiet` and `--verbose`, for any command.

use crate::common::{self, Fixture, assert_done, assert_refused, stderr};

#[test]
fn quiet_tells_errors_alone_and_verbose_tells_files() {
    let fixture = Fixture::new();
    let usual = fixture.render("usual", &["--frames", "0..1"]);
    assert_done(&usual);
    assert!(
        stderr(&usual).contains("retina: ") && !stderr(&usual).contains("poses.csv, "),
        "{}",
        stderr(&usual)
    );
    let quiet = fixture.render("quiet", &["--frames", "0..1", "-q"]);
    assert_done(&quiet);
    assert_eq!(stderr(&quiet), "");
    let verbose = fixture.render("verbose", &["--frames", "0..1", "--verbose"]);
    assert_done(&verbose);
    let told = stderr(&verbose);
    let bytes = std::fs::metadata(fixture.path("poses.csv")).unwrap().len();
    assert!(told.contains(&format!("poses.csv, {bytes} bytes")), "{told}");
    assert!(
        told.lines().any(|line| line.starts_with("retina: wrote ") && line.contains("truth/000000.json")),
        "{told}"
    );
    assert!(told.lines().last().unwrap().starts_with("retina: took "), "{told}");
    // What is rendered is the same.
    let frame = |out: &str| std::fs::read(fixture.path(&format!("{out}/frames/000000.png"))).unwrap();
    assert!(frame("usual") == frame("quiet") && frame("usual") == frame("verbose"));
    assert_refused(&fixture.render("usual", &["--quiet"]), &["usual"]);
    let both = common::retina().args(["-q", "-v", "doctor"]).output().unwrap();
    assert_refused(&both, &["cannot be used with"]);
}
