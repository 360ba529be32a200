//! `retina optics search`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use retina_files::InputError;
use retina_optics::constraints::{BenchLimits, PaperModel};
use retina_optics::design::{BenchLenses, MatchBy, bench_design};
use retina_optics::search::{
    Configuration, Limit, NearestMiss, Phase, Removed, SearchObserver, SearchProgress, SearchReport,
    SearchRequest, SearchedDesign, SearchedLens, pareto_figure, search,
};

use super::bench::{Matching, camera_and_screen};
use super::constraints::check;
use super::{Output, write_file};
use crate::failure::Failure;
use crate::output::tell;
use crate::setup::read_setup;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Focal length of the collimator, mm.
    #[arg(long, value_name = "MM", default_value_t = 86.8)]
    f_c: f64,
    /// Focal length of the relay, mm.
    #[arg(long, value_name = "MM", default_value_t = 82.8)]
    f_r: f64,
    /// Distance from the camera pupil to the collimator's principal plane, mm [default: 1.3 times
    /// f_c].
    #[arg(long, value_name = "MM")]
    s_cam_mm: Option<f64>,
    /// Setup of a configuration to serve. Repeat the flag for more [default: the paper's two].
    #[arg(long, value_name = "FILE")]
    setup: Vec<PathBuf>,
    /// Extent in which the fields are matched to the screen, by default the height (eq. 13), as in `design` and in setups.
    ///
    /// The reference designs that ship are matched by the diagonal.
    #[arg(long, value_enum, default_value_t)]
    match_by: Matching,
    /// Number of doublets of the collimator, 2 or 3.
    #[arg(long, value_name = "N", default_value_t = 3)]
    collimator_lenses: usize,
    /// Number of doublets of the relay, 2 or 3.
    #[arg(long, value_name = "N", default_value_t = 2)]
    relay_lenses: usize,
    /// Use only parts whose number starts with this prefix. Repeat the flag for more.
    #[arg(long, value_name = "PREFIX")]
    part: Vec<String>,
    /// Smallest lens diameter, mm.
    #[arg(long, value_name = "MM", default_value_t = 45.0)]
    min_diameter_mm: f64,
    /// Smallest gap between lenses, on the axis and at the rim, mm.
    #[arg(long, value_name = "MM", default_value_t = 0.5)]
    min_gap_mm: f64,
    /// Largest gap between lenses of a group, mm.
    #[arg(long, value_name = "MM", default_value_t = 40.0)]
    max_gap_mm: f64,
    /// Largest distance from the screen to the collimator, mm.
    #[arg(long, value_name = "MM", default_value_t = BenchLimits::PAPER.total_length_mm)]
    max_length_mm: f64,
    /// Smallest distance from the glass of the relay to the screen, mm.
    #[arg(long, value_name = "MM", default_value_t = BenchLimits::PAPER.screen_relay_mm)]
    min_screen_gap_mm: f64,
    /// Fraction of each lens's semi-diameter that light may use.
    #[arg(long, value_name = "FRACTION", default_value_t = 1.0)]
    clear: f64,
    /// Largest share of a field's beam that the lenses may vignette.
    #[arg(long, value_name = "SHARE", default_value_t = 0.01)]
    max_vignetted: f64,
    /// Number of collimator and relay pairs to refit with exact rays.
    #[arg(long, value_name = "N", default_value_t = 20_000)]
    candidates: usize,
    /// Number of leading designs whose lenses are swapped, and of batches of random swaps.
    #[arg(long, value_name = "N", default_value_t = 12)]
    leaders: usize,
    /// Seed of the random swaps.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// File for the state of the search. If it exists, the search continues from it.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Write the best design as prescriptions that every optics command reads.
    ///
    /// There is one file for each configuration: FILE.toml becomes FILE-wide-fov.toml and so on.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Rank of the design that --out writes.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..), requires = "out")]
    rank: u16,
    #[command(flatten)]
    output: Output,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.output.check()?;
    arguments.state.as_deref().map_or(Ok(()), crate::check_target)?;
    arguments.out.as_deref().map_or(Ok(()), |file| crate::check_file(file, "toml"))?;
    let request = request(arguments)?;
    let mut reporter = Reporter::new();
    let report = search(&request, Path::new("the search"), arguments.state.as_deref(), &mut reporter);
    reporter.clear();
    let report = report?;
    if report.designs.is_empty() {
        if arguments.output.document.json {
            arguments.output.print("search", &Matched::new(&report, &request), Vec::new)?;
        }
        return Err(Failure::new(nothing_found(&report)));
    }
    arguments.output.draw(|| Ok(pareto_figure(&report)))?;
    if let Some(file) = &arguments.out {
        write_design(file, usize::from(arguments.rank), &report, &request)?;
    }
    arguments.output.print("search", &Matched::new(&report, &request), || table(&report, &request))
}

/// The document: the report's own keys, how the magnifications were chosen, and each design's prescriptions.
#[derive(serde::Serialize)]
struct Matched<'a> {
    match_by: MatchBy,
    pupil_collimator_mm: f64,
    designs: Vec<WithPrescriptions<'a>>,
    removed: &'a [Removed],
    #[serde(skip_serializing_if = "Option::is_none")]
    nearest_miss: Option<&'a NearestMiss>,
}

/// A design, with the text of a prescription for each configuration.
#[derive(serde::Serialize)]
struct WithPrescriptions<'a> {
    #[serde(flatten)]
    design: &'a SearchedDesign,
    prescriptions: BTreeMap<String, String>,
}

impl<'a> Matched<'a> {
    fn new(report: &'a SearchReport, request: &SearchRequest) -> Self {
        let with = |design: &'a SearchedDesign| WithPrescriptions {
            design,
            prescriptions: design.prescriptions(request).into_iter().collect(),
        };
        Self {
            match_by: request.match_by,
            pupil_collimator_mm: report.pupil_collimator_mm,
            designs: report.designs.iter().map(with).collect(),
            removed: &report.removed,
            nearest_miss: report.nearest_miss.as_ref(),
        }
    }
}

/// Why there is no design, and what comes nearest to one.
fn nothing_found(report: &SearchReport) -> String {
    let mut text = "no design keeps all limits; candidates that each limit excluded:".to_owned();
    for entry in report.removed.iter().filter(|entry| entry.candidates > 0) {
        text += &format!("\n  {:8}  {}", entry.candidates, entry.limit.words());
    }
    let Some(NearestMiss { design, exceeds }) = &report.nearest_miss else {
        return text + "\nnone of the best-ranked candidates lets its rays through";
    };
    text += &format!("\nnearest miss: {:.3} um, {}", design.worst_rms_um, lenses(design));
    for excess in exceeds {
        text += &match excess.limit {
            Limit::Vignetting => {
                format!("\n  {}: by {:.2} % of the beam", excess.limit.words(), 100.0 * excess.by)
            }
            limit => format!("\n  {}: by {:.2} mm", limit.words(), excess.by),
        };
    }
    text
}

/// A design of the table as a file for each configuration.
fn write_design(
    file: &Path,
    rank: usize,
    report: &SearchReport,
    request: &SearchRequest,
) -> Result<(), Failure> {
    let design = report.designs.get(rank - 1).ok_or_else(|| {
        InputError::new("--rank", "there is no such design")
            .found(rank)
            .expected(format!("1 to {}", report.designs.len()))
    })?;
    let stem = file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    for (name, text) in design.prescriptions(request) {
        // Names are free text; file names are not.
        let name: String = name.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect();
        write_file(&file.with_file_name(format!("{stem}-{name}.toml")), text.as_bytes())?;
    }
    Ok(())
}

/// The lenses of a design from the camera on.
fn lenses(design: &SearchedDesign) -> String {
    let lens = |lens: &SearchedLens| {
        let turned = if lens.reversed { "(r)" } else { "" };
        let gap = lens.gap_after_mm.map_or(" |".to_owned(), |gap| format!(" {gap:.2}"));
        format!("{}{turned}{gap}", lens.part)
    };
    design.lenses.iter().map(lens).collect::<Vec<_>>().join(" ")
}

fn request(arguments: &Arguments) -> Result<SearchRequest, Failure> {
    let pupil_collimator_mm = arguments.s_cam_mm.unwrap_or(1.3 * arguments.f_c);
    check(&[
        ("--f-c", arguments.f_c),
        ("--f-r", arguments.f_r),
        ("--max-length-mm", arguments.max_length_mm),
    ])?;
    let lenses = BenchLenses {
        collimator_focal_mm: arguments.f_c,
        relay_focal_mm: arguments.f_r,
        diameter_mm: PaperModel::LENS_DIAMETER_MM,
        pupil_collimator_mm,
    };
    let paper = SearchRequest::paper(pupil_collimator_mm / arguments.f_c);
    let mut configurations = Vec::new();
    for path in &arguments.setup {
        let setup = read_setup(path)?;
        let (camera, screen) = camera_and_screen(&setup);
        let design = bench_design(&camera, &screen, &lenses, &BenchLimits::PAPER, arguments.match_by.into());
        configurations.push(Configuration::of_camera(&setup.name, &camera, design.layout.magnification));
    }
    if configurations.is_empty() {
        use retina_optics::design::{Camera, Screen};
        for (name, focal_mm) in [("wide-fov", 25.0), ("narrow-fov", 50.0)] {
            let camera = Camera { width_px: 2048, height_px: 1536, pixel_um: 3.45, focal_mm, f_number: 2.8 };
            let design = bench_design(
                &camera,
                &Screen::PAPER,
                &lenses,
                &BenchLimits::PAPER,
                arguments.match_by.into(),
            );
            configurations.push(Configuration::of_camera(name, &camera, design.layout.magnification));
        }
    }
    Ok(SearchRequest {
        collimator_focal_mm: arguments.f_c,
        relay_focal_mm: arguments.f_r,
        collimator_lenses: arguments.collimator_lenses,
        relay_lenses: arguments.relay_lenses,
        pupil_collimator_mm,
        configurations,
        match_by: arguments.match_by.into(),
        bench: BenchLimits { total_length_mm: arguments.max_length_mm, ..BenchLimits::PAPER },
        min_screen_gap_mm: arguments.min_screen_gap_mm,
        min_gap_mm: arguments.min_gap_mm,
        max_gap_mm: arguments.max_gap_mm,
        clear_fraction: arguments.clear,
        max_vignetted: arguments.max_vignetted,
        part_prefixes: arguments.part.clone(),
        min_diameter_mm: arguments.min_diameter_mm,
        exact_candidates: arguments.candidates,
        leaders: arguments.leaders,
        seed: arguments.seed,
        ..paper
    })
}

/// The ranked table; designs on the pareto front of spot and length bear a star.
fn table(report: &SearchReport, request: &SearchRequest) -> Vec<String> {
    let front = report.pareto();
    let magnifications: Vec<String> = request
        .configurations
        .iter()
        .map(|configuration| format!("{} {:.4}", configuration.name, configuration.magnification))
        .collect();
    let mut lines = vec![
        format!(
            "M, camera and screen matched by {}: {}",
            request.match_by.words(),
            magnifications.join(", ")
        ),
        format!(
            "s_cam {:.2} mm; spots on the sensor, apertures open; (r) reversed, gaps in mm",
            report.pupil_collimator_mm
        ),
    ];
    lines.push("      worst um  length mm  lost %  lenses from the camera".to_owned());
    for (i, design) in report.designs.iter().enumerate() {
        let star = if front.contains(&i) { '*' } else { ' ' };
        let lost = design.vignetted_fraction() * 100.0;
        let (worst, length) = (design.worst_rms_um, design.length_mm);
        lines.push(format!("{:3} {star} {worst:8.3}  {length:9.2}  {lost:6.2}  {}", i + 1, lenses(design)));
    }
    lines
}

/// Time between lines where standard error is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// A bar on a terminal, a line now and then elsewhere.
struct Reporter {
    bar: Option<ProgressBar>,
    phase: Option<Phase>,
    /// When the phase began, and the steps that were done then.
    began: (Instant, usize),
    last_line: Instant,
}

impl Reporter {
    fn new() -> Self {
        let bar = crate::output::shows_progress().then(|| {
            let style =
                ProgressStyle::with_template("{wide_bar} {pos}/{len} {msg}, {elapsed} elapsed, {eta} left");
            ProgressBar::new(0).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        Self { bar, phase: None, began: (Instant::now(), 0), last_line: Instant::now() }
    }

    fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl SearchObserver for Reporter {
    fn note(&mut self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| tell!("{text}")),
            None => tell!("{text}"),
        }
    }

    fn progress(&mut self, progress: SearchProgress) {
        let what = match progress.phase {
            Phase::Rank => "rankings of pairs",
            Phase::Refit => "pairs refitted",
            Phase::Swap => "leaders swapped",
            Phase::Kick => "random batches",
        };
        if self.phase != Some(progress.phase) {
            self.phase = Some(progress.phase);
            self.began = (Instant::now(), progress.done);
            if let Some(bar) = &self.bar {
                bar.reset();
            }
        }
        let best = progress.best_um.map_or(String::new(), |best| format!(", best {best:.2} um"));
        if let Some(bar) = &self.bar {
            bar.set_length(progress.total as u64);
            bar.set_position(progress.done as u64);
            bar.set_message(format!("{what}{best}"));
            return;
        }
        let done = progress.done.saturating_sub(self.began.1);
        if self.last_line.elapsed() < LINE_INTERVAL || done == 0 {
            return;
        }
        self.last_line = Instant::now();
        let left_s =
            self.began.0.elapsed().as_secs_f64() / done as f64 * (progress.total - progress.done) as f64;
        tell!("{}/{} {what}{best}, {left_s:.0} s left", progress.done, progress.total);
    }
}
