//! `retina pattern`.

use std::path::PathBuf;

use retina_calibration::geometry::{Pattern, PatternOptions};
use retina_formats::Channel;
use serde_json::json;

use super::calibrate::measured_response;
use crate::failure::Failure;
use crate::output::{print_json, print_lines};
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Folder for screens/NNN.png, pattern.csv and pattern.toml.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Number of points on each screen.
    #[arg(long, default_value_t = 400)]
    points: usize,
    /// Number of screens [default: six for each group of counts that one exposure can hold].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=999))]
    screens: Option<u16>,
    /// Digital counts to show, separated by commas [default: every 0.75 mag from 255 to 5].
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u8).range(1..))]
    counts: Vec<u8>,
    /// Sub-pixels to light: red, green, blue, or all three (w).
    #[arg(long, value_enum, default_value = "w")]
    channel: ChannelName,
    /// Calibration with the display's measured response [default: the setup's power law].
    #[arg(long, value_name = "FILE.toml")]
    response: Option<PathBuf>,
    /// Seed of the random positions.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum ChannelName {
    R,
    G,
    B,
    W,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let setup = read_setup(&arguments.setup)?;
    let options = PatternOptions {
        points: arguments.points,
        screens: arguments.screens.map(usize::from),
        counts: arguments.counts.clone(),
        channel: match arguments.channel {
            ChannelName::R => Channel::R,
            ChannelName::G => Channel::G,
            ChannelName::B => Channel::B,
            ChannelName::W => Channel::W,
        },
        seed: arguments.seed,
        response: match &arguments.response {
            Some(path) => Some(measured_response(path, &setup)?.curve),
            None => None,
        },
    };
    let pattern = Pattern::make(&setup, &options)?;
    pattern.write(&arguments.out, &setup, options.seed)?;
    let mut ratios: Vec<(f64, Vec<&str>)> = Vec::new();
    for screen in &pattern.screens {
        match ratios.iter_mut().find(|(ratio, _)| *ratio == screen.exposure_ratio) {
            Some((_, files)) => files.push(&screen.file),
            None => ratios.push((screen.exposure_ratio, vec![&screen.file])),
        }
    }
    if arguments.json {
        let exposures: Vec<_> = ratios
            .iter()
            .map(|(ratio, files)| json!({ "exposure_ratio": ratio, "screens": files }))
            .collect();
        return print_json(&json!({
            "schema": "retina.pattern/1",
            "out": arguments.out,
            "screens": pattern.screens.len(),
            "points": pattern.screens.iter().map(|screen| screen.points.len()).sum::<usize>(),
            "exposures": exposures,
        }));
    }
    let mut lines = vec![
        format!("{} screens in {}", pattern.screens.len(), arguments.out.join("screens").display()),
        "exposure time over the longest   screens".to_owned(),
    ];
    lines.extend(ratios.iter().map(|(ratio, files)| format!("{ratio:>30.5}   {}", files.join(" "))));
    print_lines(&lines)
}
