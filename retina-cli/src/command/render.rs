//! `retina render`.

use std::path::PathBuf;

use retina_batch::{Batch, FrameRange, Options, SPOT_PX, Selection, Shard, Summary};
use retina_scene::Scene;
use serde_json::json;

use super::Rendering;
use super::corto::CortoArguments;
use crate::failure::Failure;
use crate::output::{print_json, tell};
use crate::progress::Reporter;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Scene to render, schema retina.scene/1.
    #[arg(required_unless_present = "corto")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    corto: CortoArguments,
    /// By-products to write under CORTO's names, separated by commas.
    ///
    /// The names are img, depth, mask, slopes, labels, depth_exr and slopes_exr.
    #[arg(long, requires = "corto", value_name = "NAMES")]
    by_products: Option<String>,
    /// Folder for frames/, truth/, manifest.jsonl and the contact sheet.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Render only frames A to B, counted from 0; B is excluded.
    #[arg(long, value_name = "A..B", allow_hyphen_values = true)]
    frames: Option<FrameRange>,
    /// Render only every K-th frame, starting with the first.
    #[arg(long, value_name = "K")]
    every: Option<usize>,
    /// Render only the frames whose number is I modulo N.
    #[arg(long, value_name = "I/N", allow_hyphen_values = true)]
    shard: Option<Shard>,
    /// Keep the frames that an earlier run of the same scene finished, and render the others.
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    rendering: Rendering,
    /// Print the summary as a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: Arguments) -> Result<(), Failure> {
    let (scene, products) = match (&arguments.scene, arguments.corto.folder()) {
        (Some(scene), None) => (Scene::read(scene)?, None),
        (_, Some(folder)) => arguments.corto.scene(folder, arguments.by_products.as_deref())?,
        (None, None) => return Err(Failure::new("neither a scene nor --corto is given")),
    };
    let options = Options {
        dir: arguments.out,
        selection: Selection { range: arguments.frames, every: arguments.every, shard: arguments.shard },
        resume: arguments.resume,
        backend: arguments.rendering.backend.into(),
        quality: arguments.rendering.quality(),
    };
    let mut batch = Batch::new(scene, options);
    if let Some(products) = products {
        batch = batch.with_side_products(Box::new(products));
    }
    let mut reporter = Reporter::new();
    let result = batch.run(&mut reporter);
    reporter.clear();
    let summary = result?;
    report(&summary);
    if arguments.json {
        print_json(&document(&summary))?;
    }
    Ok(())
}

fn seconds_a_frame(summary: &Summary) -> Option<f64> {
    (summary.done > 0).then(|| summary.seconds / summary.done as f64)
}

fn report(summary: &Summary) {
    let dir = summary.dir.display();
    match (&summary.adapter, seconds_a_frame(summary)) {
        (Some(name), Some(each)) => tell!(
            "{} frames rendered in {:.1} s ({each:.3} s each), {} existed already; radiance scale {:.6e}; {} ({}); {dir}",
            summary.done,
            summary.seconds,
            summary.skipped,
            summary.radiance_scale,
            name.adapter,
            name.driver,
        ),
        _ if summary.skipped > 0 => {
            tell!("nothing to do, all {} frames exist already; {dir}", summary.skipped);
        }
        _ => tell!("nothing to do, the selection contains no frame; {dir}"),
    }
    if summary.spot_frames > 0 {
        tell!(
            "warning: {} frames show a planet, star or unresolved body as a spot wider than {SPOT_PX} pixels: its light is right, its \
             size is not; make it a body of the scene",
            summary.spot_frames,
        );
    }
    if summary.saturated_px > 0 {
        tell!(
            "warning: {} pixels in {} frames are brighter than the screen can show; a smaller radiance_scale \
             avoids it",
            summary.saturated_px,
            summary.saturated_frames,
        );
    }
}

fn document(summary: &Summary) -> serde_json::Value {
    let name = summary.adapter.as_ref();
    json!({
        "schema": "retina.render/1",
        "dir": summary.dir,
        "frames_done": summary.done,
        "frames_skipped": summary.skipped,
        "seconds": summary.seconds,
        "seconds_per_frame": seconds_a_frame(summary),
        "radiance_scale": summary.radiance_scale,
        "saturated_px": summary.saturated_px,
        "saturated_frames": summary.saturated_frames,
        "spot_frames": summary.spot_frames,
        "backend": name.map(|name| name.backend),
        "adapter": name.map(|name| &name.adapter),
        "driver": name.map(|name| &name.driver),
        "contact_sheet": summary.contact_sheet,
    })
}
