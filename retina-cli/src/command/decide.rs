//! `retina decide`.

use std::path::PathBuf;
use std::process::Command;

use retina::decision::{Factor, Freedom, Question, Round, decide, decision_json, decision_text};
use retina::workbench::GivenEffect;
use retina_files::InputError;

use super::workbench::Input;
use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};
use crate::progress::counter;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    input: Input,
    /// Model that may be the true one: an effect's id, a file with a formula, or several with `+`
    /// between them. Repeat the flag for each rival [default: those that `diagnose` cannot tell
    /// apart].
    #[arg(long = "rival", value_name = "ID|FILE[+...]")]
    rivals: Vec<String>,
    /// Effect that all rivals have. Repeat the flag for more.
    #[arg(long = "effect", value_name = "ID|FILE")]
    effects: Vec<String>,
    /// Folder of the plans and their measurements: round_01, round_02, ...
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Number of exposures in a round.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=99))]
    exposures: u16,
    /// Largest number of exposures in all rounds.
    #[arg(long, default_value_t = 40, value_parser = clap::value_parser!(u16).range(1..=999))]
    budget: u16,
    /// Number of points in an exposure [default: as many as the table has].
    #[arg(long, value_parser = clap::value_parser!(u16).range(3..=2000))]
    points: Option<u16>,
    /// Condition to leave as it was: places, counts, channel, exposure, roll, temperature or wait.
    /// Repeat the flag for more.
    #[arg(long, value_name = "CONDITION")]
    hold: Vec<String>,
    /// Lowest and highest temperature that the bench can be brought to, degC [default: those of the
    /// table].
    #[arg(long, value_name = "LOW,HIGH", value_delimiter = ',', num_args = 1, allow_hyphen_values = true)]
    temperature_c: Option<Vec<f64>>,
    /// Time that the bench needs to settle at another temperature, s.
    #[arg(long, default_value_t = 1800.0)]
    settle_s: f64,
    /// Seed of the search for exposures.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Command that measures a round; it is run by the shell.
    ///
    /// It finds the round's folder in $RETINA_ROUND, with screens/ and plan.csv, and has to write
    /// points.csv there, or images/ with an images.csv. Rounds follow each other until one rival is
    /// left or the budget is spent.
    #[arg(long, value_name = "COMMAND")]
    take: Option<String>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    fn freedom(&self) -> Result<Freedom, InputError> {
        let held = self.hold.iter().map(|text| Factor::parse(text)).collect::<Result<_, _>>()?;
        let temperature_c = match self.temperature_c.as_deref() {
            None => None,
            Some(&[low, high]) if low < high && low >= -150.0 && high <= 150.0 => Some([low, high]),
            Some(other) => {
                return Err(InputError::new("--temperature-c", "is no range of temperatures")
                    .found(format!("{other:?}"))
                    .expected("the lowest and the highest, such as 18,24, from -150 to 150"));
            }
        };
        if !(self.settle_s >= 0.0 && self.settle_s.is_finite()) {
            return Err(InputError::new("--settle-s", "is no length of time").found(self.settle_s));
        }
        Ok(Freedom { held, temperature_c, settle_s: self.settle_s, points: self.points.map(usize::from) })
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.input.check_outputs(&arguments.effects, &[])?;
    let question = Question {
        rivals: arguments.rivals.clone(),
        common: arguments.effects.iter().cloned().map(GivenEffect::Text).collect(),
        freedom: arguments.freedom()?,
        exposures: usize::from(arguments.exposures),
        budget: usize::from(arguments.budget),
        seed: arguments.seed,
        folder: arguments.out.clone(),
    };
    let bar = counter(100, "%");
    let progress = |what: &str, share: f64| {
        bar.set_message(what.to_owned());
        bar.set_position((100.0 * share) as u64);
    };
    let take = |round: &Round| -> Result<(), InputError> {
        let Some(command) = &arguments.take else { return Ok(()) };
        bar.suspend(|| tell!("measuring round {}", round.number));
        measure(command, round)
    };
    let take: &dyn Fn(&Round) -> Result<(), InputError> = &take;
    let outcome =
        decide(&arguments.input.read()?, &question, arguments.take.as_ref().map(|_| take), &progress);
    bar.finish_and_clear();
    let outcome = outcome?;
    match arguments.json {
        true => print_json(&decision_json(&outcome)),
        false => print_lines(&decision_text(&outcome)),
    }
}

/// Runs the user's command for a round.
fn measure(command: &str, round: &Round) -> Result<(), InputError> {
    let (shell, flag) = if cfg!(windows) { ("cmd", "/C") } else { ("sh", "-c") };
    let folder = std::path::absolute(&round.folder).unwrap_or_else(|_| round.folder.clone());
    // What it prints is for people: standard output is ours.
    let output = Command::new(shell)
        .args([flag, command])
        .env("RETINA_ROUND", &folder)
        .env("RETINA_ROUND_NUMBER", round.number.to_string())
        .stdin(std::process::Stdio::null())
        .stdout(std::process::Stdio::null())
        .output()
        .map_err(|error| InputError::new("--take", format!("cannot be run: {error}")))?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    let said = if said.trim().is_empty() { "it said nothing" } else { said.trim() };
    Err(InputError::new("--take", "the command failed")
        .found(format!("{} in round {}: {said}", output.status, round.number))
        .help("the round stays planned: mend the command and run the same again"))
}
