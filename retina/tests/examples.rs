//! Every example runs to its end.

#![allow(
    clippy::unwrap_used,
    unreachable_pub,
    reason = "a test may fail; an example is a program of its own, too"
)]

#[path = "../examples/calibrate.rs"]
mod calibrate;
#[path = "../examples/detect_and_solve.rs"]
mod detect_and_solve;
#[path = "../examples/diagnose.rs"]
mod diagnose;
#[path = "../examples/render_a_frame.rs"]
mod render_a_frame;
#[path = "../examples/trace_a_lens.rs"]
mod trace_a_lens;

#[test]
fn a_frame_is_rendered() {
    render_a_frame::main().unwrap();
}

#[test]
fn stars_are_detected_and_solved() {
    detect_and_solve::main().unwrap();
}

#[test]
fn a_facility_is_calibrated() {
    calibrate::main().unwrap();
}

#[test]
fn a_hidden_effect_is_named() {
    diagnose::main().unwrap();
}

#[test]
fn a_lens_is_traced() {
    trace_a_lens::main().unwrap();
}
