//! The same runs on a graphics adapter, where there is one.

use crate::common::{self, Fixture, assert_done, contents, counts, json};
use retina_render::GpuDevice;

/// Whether there is an adapter; says so where there is none.
fn adapter() -> bool {
    GpuDevice::open_for_test().is_some()
}

#[test]
fn gpu_and_cpu_show_the_same_counts() {
    if !adapter() {
        return;
    }
    let fixture = Fixture::new();
    fixture.edit("scene.toml", "\"auto\"", "0.001");
    for backend in ["gpu", "cpu"] {
        assert_done(&fixture.render(backend, &["--backend", backend, "--frames", "0..3"]));
    }
    for index in 0..3 {
        let [gpu, cpu] = ["gpu", "cpu"].map(|b| counts(&fixture.path(&format!("{b}/frames/{index:06}.png"))));
        // Inside the limb; in radiance, as a count is a large step where it is dark. One step of the
        // brightest counts is 0.9 %.
        let radiance = |count: u8| (f64::from(count) / 255.0).powf(2.2);
        let worst = (0..gpu.len())
            .filter(|i| (i % 160).abs_diff(80).pow(2) + (i / 160).abs_diff(50).pow(2) < 38 * 38)
            .map(|i| (radiance(gpu[i]) - radiance(cpu[i])).abs())
            .fold(0.0, f64::max);
        assert!(worst < 0.01, "frame {index}: {worst}");
        assert!(cpu[50 * 160 + 80] > 50);
    }
}

#[test]
fn shards_on_the_gpu_give_the_bytes_of_one_run() {
    if !adapter() {
        return;
    }
    let fixture = Fixture::new();
    fixture.edit("scene.toml", "\"none\"", "\"resample\"");
    assert_done(&fixture.render("one", &["--backend", "gpu"]));
    for shard in ["1/2", "0/2"] {
        assert_done(&fixture.render("two", &["--backend", "gpu", "--shard", shard]));
    }
    assert_eq!(contents(&fixture.path("one")), contents(&fixture.path("two")));
}

#[test]
fn the_adapter_is_named() {
    let mut command = common::retina();
    let found = json(&command.args(["adapter", "--json", "--backend", "cpu"]).output().unwrap());
    assert_eq!((found["backend"].as_str(), found["adapter"].as_str()), (Some("cpu"), Some("cpu")));
    // Left open, it is a real GPU or the native renderer, never a driver on the processor.
    let found = json(&common::retina().args(["adapter", "--json"]).output().unwrap());
    assert!(["gpu", "native"].contains(&found["backend"].as_str().unwrap()), "{found}");
    assert!(!found["adapter"].as_str().unwrap().contains("llvmpipe"), "{found}");
    if adapter() {
        let found = json(&common::retina().args(["adapter", "--json", "--backend", "gpu"]).output().unwrap());
        assert_eq!(found["backend"], "gpu");
    }
}
