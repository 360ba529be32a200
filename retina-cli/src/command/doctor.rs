//! `retina doctor`: what this machine has, and what of it RETINA would use.

use std::path::Path;
use std::process::Command;

use retina_batch::{AdapterName, BackendChoice};
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::output::{print_json, print_lines};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

/// A finding: its name, what was found, and what to do where it is not well.
struct Finding {
    name: &'static str,
    found: String,
    advice: Option<String>,
}

impl Finding {
    fn new(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, found: found.into(), advice: None }
    }

    fn advice(mut self, text: impl Into<String>) -> Self {
        self.advice = Some(text.into());
        self
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let findings = [version(), processor(), memory(), graphics(), kept_memory(), browser(), temporary()];
    if arguments.json {
        let each: Vec<Value> = findings
            .iter()
            .map(|finding| json!({ "name": finding.name, "found": finding.found, "advice": finding.advice }))
            .collect();
        return print_json(&json!({ "schema": "retina.doctor/1", "findings": each }));
    }
    let mut lines = Vec::new();
    for finding in &findings {
        lines.push(format!("{:<12} {}", finding.name, finding.found));
        lines.extend(finding.advice.iter().map(|advice| format!("{:<12}   {advice}", "")));
    }
    print_lines(&lines)
}

fn version() -> Finding {
    Finding::new(
        "version",
        format!(
            "retina {} for {} on {}",
            env!("CARGO_PKG_VERSION"),
            std::env::consts::ARCH,
            std::env::consts::OS
        ),
    )
}

fn processor() -> Finding {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let set = std::env::var("RAYON_NUM_THREADS").ok();
    let threads = set.map_or_else(String::new, |set| format!("; RAYON_NUM_THREADS is {set}"));
    Finding::new("processor", format!("{cores} cores; {}{threads}", vectors()))
}

/// The vector instructions that the native renderer and the ray tracer choose among.
fn vectors() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") {
            return "AVX-512";
        }
        if is_x86_feature_detected!("avx2") {
            return "AVX2";
        }
    }
    "no AVX2: portable instructions, which are slower"
}

fn memory() -> Finding {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let gigabytes = |key: &str| -> Option<f64> {
        let line = text.lines().find(|line| line.starts_with(key))?;
        Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1e6)
    };
    match gigabytes("MemTotal:").zip(gigabytes("MemAvailable:")) {
        Some((all, free)) if free < 2.0 => Finding::new("memory", format!("{free:.1} of {all:.1} GB are free"))
            .advice("the default Moon and its horizons take some 1 GB; close other programs, or render on another machine"),
        Some((all, free)) => Finding::new("memory", format!("{free:.1} of {all:.1} GB are free")),
        None => Finding::new("memory", "not known on this system"),
    }
}

fn graphics() -> Finding {
    match AdapterName::of_choice(BackendChoice::Auto) {
        Ok((name, None)) => {
            Finding::new("renderer", format!("{}: {} ({})", name.backend, name.adapter, name.driver))
        }
        Ok((name, Some(reason))) => {
            Finding::new("renderer", format!("{}, on the processor's cores: {reason}", name.backend))
                .advice("a GPU needs its Vulkan driver; without one nothing is missing but speed")
        }
        Err(error) => {
            Finding::new("renderer", format!("none: {error}")).advice("--backend native needs no adapter")
        }
    }
}

/// What is kept outside the folders that the user names: prepared bodies, and the sessions of `retina view`.
fn kept_memory() -> Finding {
    let own = [
        ("prepared bodies", crate::bodies_folder()),
        ("sessions of the page", retina_view::default_state_folder()),
    ];
    let kept = own.into_iter().filter_map(|(what, folder)| {
        let folder = folder?;
        let files = std::fs::read_dir(&folder).ok()?;
        let bytes: u64 = files.filter_map(|file| file.ok()?.metadata().ok()).map(|data| data.len()).sum();
        Some(format!("{what}: {} MB in {}", bytes.div_ceil(1 << 20), folder.display()))
    });
    let kept: Vec<String> = kept.collect();
    if kept.is_empty() {
        return Finding::new("caches", "none");
    }
    Finding::new("caches", kept.join("; "))
        .advice("the bodies may be deleted at any time, and --no-cache keeps none; the sessions are yours")
}

fn browser() -> Finding {
    let names = ["xdg-open", "firefox", "chromium", "google-chrome"];
    let there = |name: &&&str| {
        let path = std::env::var_os("PATH").unwrap_or_default();
        std::env::split_paths(&path).any(|folder| folder.join(name).is_file())
    };
    match names.iter().find(there) {
        Some(name) => Finding::new("browser", format!("`retina view` opens one by {name}")),
        None => Finding::new("browser", "none was found")
            .advice("`retina view --no-browser` prints the address; open it through an ssh tunnel"),
    }
}

fn temporary() -> Finding {
    let folder = std::env::temp_dir();
    let free = Command::new("df").args(["-Pk"]).arg(Path::new(".")).output().ok();
    let free = free.and_then(|output| {
        let text = String::from_utf8(output.stdout).ok()?;
        Some(text.lines().nth(1)?.split_whitespace().nth(3)?.parse::<f64>().ok()? / 1e6)
    });
    let disk =
        free.map_or_else(|| "not known".to_owned(), |free| format!("{free:.0} GB free in this folder"));
    let found = Finding::new("disk", format!("{disk}; temporary files go to {}", folder.display()));
    match free {
        Some(free) if free < 3.0 => found.advice("the default sequence takes 2.4 GB"),
        _ => found,
    }
}
