//! The command `retina`: arguments in, libraries called, results and errors shown.
//!
//! Exit codes: 0 done; 1 done, and a tolerance that the caller asked for is exceeded; 2 bad input
//! or failure. With `--json` standard output holds one JSON document and nothing else; of a failure it
//! is one of schema `retina.error/1`.
//!
//! The command is a library, so that the program `retina` and the Python wheel run the same code.

mod command;
mod failure;
mod output;
mod progress;
mod setup;

use std::ffi::OsString;

use clap::{CommandFactory as _, Parser, Subcommand};

use failure::Failure;

/// Software of a camera-in-the-loop test facility for spaceborne vision sensors.
#[derive(Parser)]
#[command(name = "retina", version, arg_required_else_help = true)]
struct Arguments {
    /// Tell nothing but errors: no progress, no notes.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Tell on standard error which files are read and written, and how long the command took.
    #[arg(short, long, global = true)]
    verbose: bool,
    /// Neither read nor write the user's cache folder.
    ///
    /// It keeps what is computed of large bodies' shapes before their first frame.
    #[arg(long, global = true)]
    no_cache: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Renders a scene into screen images, with ground truth for each frame.
    Render(command::render::Arguments),
    /// Cuts a scene or a campaign into shards, and writes what an engine takes to run them.
    Plan(command::cluster::plan::Arguments),
    /// Runs one command over many values, each run in a folder of its own, and joins what they say.
    Runs(command::cluster::runs::Arguments),
    /// Counts what is done, torn, missing and slow in a plan or a folder of frames.
    Status(command::cluster::status::Arguments),
    /// Joins the shards of a scene into one folder, every file held to its hash.
    Merge(command::cluster::merge::Arguments),
    /// Writes frames as a data set that others read: SPEED+, BOP, WebDataset, COCO, FITS, PNG of 16 bits.
    Export(command::export::Arguments),
    /// Renders poses received over the network, by CORTO's closed-loop protocol.
    Serve(command::serve::Arguments),
    /// Resamples an image through the facility's distortion.
    Warp(command::warp::Arguments),
    /// Makes calibration screens and the table of their points.
    Pattern(command::pattern::Arguments),
    /// Calibrates the facility from measurements.
    #[command(subcommand)]
    Calibrate(command::calibrate::Command),
    /// Compares a model with measurements: errors, noise, and what the errors depend on.
    Compare(command::compare::Arguments),
    /// Finds the physical effect that the model lacks, and says what to measure next.
    Diagnose(command::diagnose::Arguments),
    /// Finds a formula for what no known effect explains, and proves it on data it has not seen.
    Investigate(command::investigate::Arguments),
    /// Says which of several models is the true one, and which exposures would decide.
    Decide(command::decide::Arguments),
    /// Fits effects together with the baseline model.
    Fit(command::fit::Arguments),
    /// Imports calibrations of other programs as measurements.
    #[command(subcommand)]
    Import(command::import::Command),
    /// Lists and explains the effects of the catalogue.
    Effects(command::effects::Arguments),
    /// Joins all report pages of a folder into one page that opens offline.
    Report(command::report::Arguments),
    /// Builds a body's mesh and textures from a relief map and an albedo map.
    Body(command::body::Arguments),
    /// Generates a trajectory and writes it as a table.
    Trajectory(command::trajectory::Arguments),
    /// Makes the contact sheet of a folder of frames.
    Sheet(command::sheet::Arguments),
    /// Designs and analyses lens systems: constraints, spots, wavefronts, tolerances, drawings.
    #[command(subcommand)]
    Optics(Box<command::optics::Command>),
    /// Runs measurement campaigns on the virtual bench.
    #[command(subcommand)]
    Simulate(command::simulate::Command),
    /// Drives a laboratory's screen and camera, or the virtual bench in their place.
    #[command(subcommand)]
    Lab(command::lab::Command),
    /// Finds attitude and position from images.
    #[command(subcommand)]
    Navigate(command::navigate::Command),
    /// Opens the workbench in the browser: see where the model fails, add an effect, watch the error fall.
    View(command::view::Arguments),
    /// Writes a commented file to start from.
    New(command::new::Arguments),
    /// Says what files are, whether they read, and what they would do.
    Check(command::check::Arguments),
    /// Prints the JSON Schemas of files and documents, for editors and programs.
    Schema(command::schema::Arguments),
    /// Says what this machine has: renderer, cores, memory, disk.
    Doctor(command::doctor::Arguments),
    /// Shows which graphics adapter would render.
    Adapter(command::adapter::Arguments),
    /// Prints a shell's completions.
    Completions(command::shell::Completions),
    /// Writes manual pages.
    Man(command::shell::Man),
}

/// Where bodies that were prepared for rendering are kept.
pub(crate) fn bodies_folder() -> Option<std::path::PathBuf> {
    Some(retina_files::user_folder("XDG_CACHE_HOME", ".cache")?.join("bodies"))
}

/// Runs the command with these arguments, the program's name first, and gives its exit code.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let wants_json = arguments.iter().any(|argument| argument == "--json");
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Help goes to standard output and is no failure. Where neither stream can be written the code speaks.
            let _ = error.print();
            if wants_json && error.use_stderr() {
                let _ = output::print_json(&Failure::new(error.render().to_string().trim()).document());
            }
            return u8::try_from(error.exit_code()).unwrap_or(2);
        }
    };
    output::be_quiet(arguments.quiet);
    let (verbose, began) = (arguments.verbose, std::time::Instant::now());
    if verbose {
        retina_files::watch_files(|deed, path, bytes| {
            let deed = match deed {
                retina_files::Deed::Read => "read",
                retina_files::Deed::Wrote => "wrote",
            };
            output::tell!("{deed} {}, {bytes} bytes", path.display());
        });
    }
    if !arguments.no_cache
        && let Some(folder) = bodies_folder()
    {
        retina_render::keep_bodies_in(folder);
    }
    let result = match arguments.command {
        Command::Render(arguments) => command::render::run(arguments),
        Command::Plan(arguments) => command::cluster::plan::run(&arguments),
        Command::Runs(arguments) => command::cluster::runs::run(&arguments),
        Command::Status(arguments) => command::cluster::status::run(&arguments),
        Command::Merge(arguments) => command::cluster::merge::run(&arguments),
        Command::Export(arguments) => command::export::run(&arguments),
        Command::Serve(arguments) => command::serve::run(&arguments),
        Command::Warp(arguments) => command::warp::run(arguments),
        Command::Pattern(arguments) => command::pattern::run(&arguments),
        Command::Calibrate(command) => command::calibrate::run(command),
        Command::Compare(arguments) => command::compare::run(&arguments),
        Command::Diagnose(arguments) => command::diagnose::run(&arguments),
        Command::Investigate(arguments) => command::investigate::run(&arguments),
        Command::Decide(arguments) => command::decide::run(&arguments),
        Command::Fit(arguments) => command::fit::run(&arguments),
        Command::Import(command) => command::import::run(&command),
        Command::Effects(arguments) => command::effects::run(&arguments),
        Command::Report(arguments) => command::report::run(&arguments),
        Command::Body(arguments) => command::body::run(arguments),
        Command::Trajectory(arguments) => command::trajectory::run(arguments),
        Command::Sheet(arguments) => command::sheet::run(arguments),
        Command::Optics(command) => command::optics::run(*command),
        Command::Simulate(command) => command::simulate::run(&command),
        Command::Lab(command) => command::lab::run(&command),
        Command::Navigate(command) => command::navigate::run(&command),
        Command::View(arguments) => command::view::run(&arguments),
        Command::New(arguments) => command::new::run(&arguments),
        Command::Check(arguments) => command::check::run(&arguments),
        Command::Schema(arguments) => command::schema::run(&arguments),
        Command::Doctor(arguments) => command::doctor::run(&arguments),
        Command::Completions(arguments) => command::shell::completions(&arguments, Arguments::command()),
        Command::Man(arguments) => command::shell::man(&arguments, Arguments::command()),
        Command::Adapter(arguments) => command::adapter::run(&arguments),
    };
    if verbose {
        output::tell!("took {:.3} s", began.elapsed().as_secs_f64());
    }
    match result {
        Ok(()) => 0,
        Err(failure) => {
            failure.show();
            // A document that is there already says how far the command came.
            if wants_json && output::is_silent() {
                let _ = output::print_json(&failure.document());
            }
            failure.exit_code()
        }
    }
}

/// A file of one kind is to be written: its folder must be there and its name end as it should.
fn check_file(path: &std::path::Path, extension: &str) -> Result<(), Failure> {
    check_target(path)?;
    check_extension(path, extension)
}

fn check_extension(path: &std::path::Path, extension: &str) -> Result<(), Failure> {
    let found = path.extension().and_then(|extension| extension.to_str()).unwrap_or("");
    if found.eq_ignore_ascii_case(extension) {
        return Ok(());
    }
    Err(retina_files::InputError::new(path, "the file has the wrong extension")
        .found(format!("`.{found}`"))
        .expected(format!("`.{extension}`"))
        .help("give the file a name with the expected extension")
        .into())
}

/// Outputs are files of their own: none is an input, no two are one. `both` is read and written on purpose.
fn check_apart<'a>(
    inputs: impl IntoIterator<Item = &'a std::path::PathBuf>,
    outputs: impl IntoIterator<Item = Option<&'a std::path::PathBuf>>,
    both: Option<&'a std::path::PathBuf>,
) -> Result<(), Failure> {
    // A file that is not there yet is known by its folder and name.
    let place = |path: &std::path::Path| {
        path.canonicalize().ok().or_else(|| {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            Some(folder.unwrap_or(std::path::Path::new(".")).canonicalize().ok()?.join(path.file_name()?))
        })
    };
    let inputs: Vec<_> = inputs.into_iter().filter_map(|path| place(path)).collect();
    let mut written = Vec::new();
    for path in outputs.into_iter().flatten() {
        let Some(at) = place(path) else { continue };
        let problem = if written.contains(&at) {
            "is given for two outputs"
        } else if inputs.contains(&at) && both != Some(path) {
            "is an input and would be overwritten"
        } else {
            written.push(at);
            continue;
        };
        return Err(retina_files::InputError::new(path, problem).help("give the output another name").into());
    }
    Ok(())
}

/// Where a file is to be written, its folder must be: `Err` names the folder that is not.
fn check_target(path: &std::path::Path) -> Result<(), Failure> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => {
            Err(retina_files::InputError::new(path, "cannot be written: its folder does not exist")
                .found(folder.display())
                .help("make the folder, or give another path")
                .into())
        }
        _ => Ok(()),
    }
}
