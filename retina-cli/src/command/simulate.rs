//! `retina simulate points|power|frames`.

use std::path::{Path, PathBuf};

use retina_bench::OpticsDetail;
use retina_campaign::{
    Effect, Facility, FramesOptions, PointsOptions, PointsRecord, PowerOptions, StarsOptions,
    TemperatureProfile, known_effects, simulate_frames, simulate_points, simulate_power, simulate_stars,
};
use retina_files::{InputError, write_atomic};
use retina_formats::{Calibration, Channel, TableKind};
use retina_image::Centroid;
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::output::{print_json, print_lines, tell};
use crate::progress::{advance, counter};
use crate::setup::read_setup;

mod plan;
mod sky;

/// Runs measurement campaigns on the virtual bench.
#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Photographs patterns of single pixels and measures their points: points.csv.
    Points(PointsArguments),
    /// Carries out a plan of `retina decide`: points.csv.
    Plan(plan::Arguments),
    /// Reads a power meter in front of lit squares: power.csv.
    Power(PowerArguments),
    /// Photographs rendered screen images: images/ and frames.csv.
    Frames(FramesArguments),
    /// Shows stars through a calibration and measures where they appear: stars.csv.
    Stars(StarsArguments),
    /// Compares objects on the bench with the same objects in the sky: bench.png, sky.png,
    /// sky.html.
    ///
    /// The page says what makes them differ.
    Sky(sky::Arguments),
    /// Lists the effects that --effect takes.
    Effects(EffectsArguments),
}

/// What every campaign takes.
#[derive(clap::Args)]
struct Common {
    /// Facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Seed of the bench's fixed patterns, of the noise and of the random positions.
    #[arg(long)]
    seed: u64,
    /// Folder for the results.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Effect and its size, for example screen_tilt=0.1deg. Repeat the flag for more.
    #[arg(long = "effect", value_name = "ID=VALUE")]
    effects: Vec<String>,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

/// `--temperature`.
#[derive(Clone, Copy, clap::ValueEnum)]
pub(crate) enum Profile {
    /// Constant, 20 degC.
    Constant,
    /// From 20 to 24 degC, with a time constant of one hour.
    WarmUp,
    /// Between 18 and 22 degC, with a period of 90 minutes.
    Cycle,
}

impl From<Profile> for TemperatureProfile {
    fn from(profile: Profile) -> Self {
        match profile {
            Profile::Constant => Self::Constant,
            Profile::WarmUp => Self::WarmUp,
            Profile::Cycle => Self::Cycle,
        }
    }
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum ChannelName {
    R,
    G,
    B,
    W,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum CentroidName {
    /// Gaussian-weighted mean; the window matches the spot.
    Windowed,
    /// Centre of mass above a threshold.
    Moments,
}

impl From<CentroidName> for Centroid {
    fn from(name: CentroidName) -> Self {
        match name {
            CentroidName::Windowed => Self::Windowed,
            CentroidName::Moments => Self::Moments,
        }
    }
}

#[derive(clap::Args)]
pub(crate) struct PointsArguments {
    #[command(flatten)]
    common: Common,
    /// Number of exposures.
    #[arg(long, default_value_t = 40, value_parser = clap::value_parser!(u16).range(1..=999))]
    exposures: u16,
    /// Number of points in each exposure.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u16).range(1..=5000))]
    points: u16,
    /// Time between exposures, s.
    #[arg(long, default_value_t = 60.0)]
    interval_s: f64,
    /// Temperature of the bench over the campaign.
    #[arg(long, value_enum, default_value = "warm-up")]
    temperature: Profile,
    /// Exposure time of the faintest group of counts, s [default: peaks at 60 % of the full well].
    #[arg(long)]
    exposure_s: Option<f64>,
    /// Sub-pixels to light: red, green, blue, or all three (w).
    #[arg(long, value_enum, default_value = "w")]
    channel: ChannelName,
    /// Digital counts, separated by commas [default: every 0.75 mag from 255 to 5].
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u8).range(1..))]
    counts: Vec<u8>,
    /// Centroid estimator.
    #[arg(long, value_enum, default_value = "windowed")]
    centroid: CentroidName,
    /// Keep the pattern and the camera images, in DIR/pattern and DIR/images.
    #[arg(long)]
    images: bool,
}

#[derive(clap::Args)]
pub(crate) struct PowerArguments {
    #[command(flatten)]
    common: Common,
    /// Digital counts, separated by commas [default: 4, 8, 12, every 16 from 16 to 240, and 255].
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u8).range(1..))]
    counts: Vec<u8>,
    /// Sides of the lit squares, px, separated by commas. 0 is a dark reading.
    #[arg(long, value_delimiter = ',', default_values_t = [0, 50, 100, 200, 600])]
    squares: Vec<u32>,
    /// Number of times that the whole set is measured. Three show most effects, ten show more.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=1000))]
    series: u16,
}

#[derive(clap::Args)]
pub(crate) struct FramesArguments {
    #[command(flatten)]
    common: Common,
    /// Folder of screen images, as `retina render` writes it.
    #[arg(long, value_name = "DIR")]
    screens: PathBuf,
    /// Exposure time, s [default: the brightest pixel of the first frame at 60 % of the full well].
    #[arg(long)]
    exposure_s: Option<f64>,
    /// Time between frames, s.
    #[arg(long, default_value_t = 60.0)]
    interval_s: f64,
    /// Temperature of the bench over the sequence.
    #[arg(long, value_enum, default_value = "constant")]
    temperature: Profile,
}

#[derive(clap::Args)]
pub(crate) struct StarsArguments {
    #[command(flatten)]
    common: Common,
    /// Calibration of the facility [default: none, and nothing is compensated].
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Number of exposures.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=9999))]
    exposures: u16,
    /// Number of stars in each exposure.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u16).range(1..=2000))]
    stars: u16,
    /// Brightest magnitude.
    #[arg(long, default_value_t = 2.0, allow_negative_numbers = true)]
    brightest: f64,
    /// Faintest magnitude.
    #[arg(long, default_value_t = 5.5, allow_negative_numbers = true)]
    faintest: f64,
    /// Exposure time, s [default: the brightest star's peak at 60 % of the full well].
    #[arg(long)]
    exposure_s: Option<f64>,
    /// Centroid estimator.
    #[arg(long, value_enum, default_value = "windowed")]
    centroid: CentroidName,
    /// Exit with code 1 if a smaller share of the errors than this is within --within-arcsec.
    #[arg(long, requires = "within_arcsec")]
    share: Option<f64>,
    /// Error limit for --share, arcsec.
    #[arg(long)]
    within_arcsec: Option<f64>,
}

#[derive(clap::Args)]
pub(crate) struct EffectsArguments {
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Stars(arguments) => stars(arguments),
        Command::Points(arguments) => points(arguments),
        Command::Plan(arguments) => plan::run(arguments),
        Command::Power(arguments) => power(arguments),
        Command::Frames(arguments) => frames(arguments),
        Command::Sky(arguments) => sky::run(arguments),
        Command::Effects(arguments) => effects(arguments),
    }
}

/// A positive number of a flag.
fn positive(flag: &str, value: f64) -> Result<f64, Failure> {
    if value > 0.0 && value.is_finite() {
        return Ok(value);
    }
    Err(InputError::new(Path::new(flag), "is not a positive number").found(value).into())
}

impl Common {
    fn facility(&self, table: TableKind, length_s: f64) -> Result<Facility, Failure> {
        let setup = read_setup(&self.setup)?;
        let effects: Vec<Effect> =
            self.effects.iter().map(|text| Effect::parse(text)).collect::<Result<_, _>>()?;
        let facility = Facility::new(&setup, &effects, table, length_s, self.seed)?;
        Ok(facility)
    }

    /// Makes the folder for the result: after everything that can be refused.
    fn make_folder(&self) -> Result<(), Failure> {
        std::fs::create_dir_all(&self.out)
            .map_err(|error| InputError::new(&self.out, format!("the folder cannot be made: {error}")).into())
    }

    fn write(&self, name: &str, bytes: &[u8]) -> Result<(), Failure> {
        self.make_folder()?;
        let path = self.out.join(name);
        write_atomic(&path, bytes)
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")).into())
    }

    /// Where the folder holds a campaign of another kind, its description goes on as `campaign-KIND.json`.
    fn keep_description(&self, kind: &str) -> Result<(), Failure> {
        let path = self.out.join("campaign.json");
        let Ok(text) = std::fs::read_to_string(&path) else { return Ok(()) };
        let old: Option<Value> = serde_json::from_str(&text).ok();
        let Some(found) = old.as_ref().and_then(|old| old["kind"].as_str()) else { return Ok(()) };
        if found == kind || !found.chars().all(|c| c.is_ascii_lowercase()) {
            return Ok(());
        }
        let name = format!("campaign-{found}.json");
        self.write(&name, text.as_bytes())?;
        tell!("{}: describes the campaign that is in this folder already", self.out.join(name).display());
        Ok(())
    }

    /// `campaign.json` beside the table: what was simulated.
    fn finish(&self, kind: &str, facility: &Facility, mut summary: Value) -> Result<(), Failure> {
        summary["schema"] = "retina.campaign/1".into();
        summary["kind"] = kind.into();
        summary["setup"] = facility.setup.name.clone().into();
        summary["seed"] = self.seed.into();
        summary["effects"] = facility.effects.iter().map(|effect| effect.text.clone()).collect();
        self.keep_description(kind)?;
        self.write("campaign.json", format!("{summary:#}\n").as_bytes())?;
        if self.json { print_json(&summary) } else { Ok(()) }
    }
}

fn points(arguments: &PointsArguments) -> Result<(), Failure> {
    let options = PointsOptions {
        exposures: usize::from(arguments.exposures),
        points: usize::from(arguments.points),
        interval_s: positive("--interval-s", arguments.interval_s)?,
        temperature: arguments.temperature.into(),
        exposure_s: arguments.exposure_s.map(|value| positive("--exposure-s", value)).transpose()?,
        channel: match arguments.channel {
            ChannelName::R => Channel::R,
            ChannelName::G => Channel::G,
            ChannelName::B => Channel::B,
            ChannelName::W => Channel::W,
        },
        counts: arguments.counts.clone(),
        centroid: arguments.centroid.into(),
        ..PointsOptions::default()
    };
    let common = &arguments.common;
    if let Some(old) = ["images", "pattern"].map(|name| common.out.join(name)).iter().find(|old| old.exists())
        && !arguments.images
    {
        return Err(InputError::new(
            old,
            "is of a campaign that was written with --images, and would not fit the new one",
        )
        .help("name another folder, or give --images, or remove the old campaign")
        .into());
    }
    let facility = common.facility(TableKind::Points, options.length_s())?;
    common.make_folder()?;
    let bar = counter(u64::from(arguments.exposures), "exposures");
    let keep = arguments.images.then_some(common.out.as_path());
    let result = simulate_points(&facility, &options, keep, |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    result.table.write(&common.out.join("points.csv"), &facility.setup)?;
    tell!(
        "{}: {} of {} points measured in {} exposures",
        common.out.join("points.csv").display(),
        result.table.rows.len(),
        result.shown,
        result.exposures_s.len()
    );
    common.finish(
        "points",
        &facility,
        json!({
            "points": result.table.rows.len(),
            "shown": result.shown,
            "exposure_s": result.exposures_s,
            "interval_s": options.interval_s,
            "temperature": format!("{:?}", options.temperature),
            "channel": options.channel.letter(),
            "centroid": format!("{:?}", options.centroid),
            "options": PointsRecord::of(&facility, &options),
        }),
    )
}

fn power(arguments: &PowerArguments) -> Result<(), Failure> {
    let mut options = PowerOptions {
        squares_px: arguments.squares.clone(),
        series: usize::from(arguments.series),
        ..PowerOptions::default()
    };
    if !arguments.counts.is_empty() {
        options.counts = arguments.counts.clone();
    }
    let common = &arguments.common;
    let setup = read_setup(&common.setup)?;
    let most = setup.screen.width_px.min(setup.screen.height_px);
    if let Some(found) = options.squares_px.iter().find(|square| **square > most) {
        return Err(InputError::new(Path::new("--squares"), "the square is larger than the screen")
            .found(found)
            .expected(format!("at most {most} pixels"))
            .into());
    }
    let facility = common.facility(TableKind::Power, 0.0)?;
    let readings = simulate_power(&facility, &options)?;
    common.make_folder()?;
    readings.write(&common.out.join("power.csv"), &setup)?;
    tell!("{}: {} readings", common.out.join("power.csv").display(), readings.rows.len());
    let summary = json!({
        "readings": readings.rows.len(),
        "counts": options.counts,
        "squares_px": options.squares_px,
        "series": options.series,
    });
    common.finish("power", &facility, summary)
}

fn frames(arguments: &FramesArguments) -> Result<(), Failure> {
    let common = &arguments.common;
    let [screens, out] = [&arguments.screens, &common.out].map(|path| std::fs::canonicalize(path).ok());
    if screens.is_some() && screens == out {
        return Err(InputError::new(&common.out, "is the folder of the rendered frames")
            .expected("another folder for the photographs")
            .into());
    }
    let options = FramesOptions {
        screens: arguments.screens.clone(),
        places: None,
        exposure_s: arguments.exposure_s.map(|value| positive("--exposure-s", value)).transpose()?,
        interval_s: positive("--interval-s", arguments.interval_s)?,
        temperature: arguments.temperature.into(),
        detail: OpticsDetail::default(),
    };
    let facility = common.facility(TableKind::Frames, f64::MAX)?;
    let bar = counter(0, "frames");
    let result = simulate_frames(&facility, &options, &common.out, |done, all| {
        advance(&bar, done, all);
    })?;
    bar.finish_and_clear();
    tell!("{}: {} frames of {:.3e} s", common.out.display(), result.frames, result.exposure_s);
    common.finish("frames", &facility, json!({"frames": result.frames, "exposure_s": result.exposure_s}))
}

fn stars(arguments: &StarsArguments) -> Result<(), Failure> {
    if let Some(share) = arguments.share.filter(|share| !(0.0..=1.0).contains(share)) {
        return Err(InputError::new(Path::new("--share"), "is not a share")
            .found(share)
            .expected("0 to 1")
            .into());
    }
    if !(arguments.brightest.is_finite() && arguments.faintest >= arguments.brightest) {
        return Err(InputError::new(Path::new("--faintest"), "is brighter than --brightest")
            .found(arguments.faintest)
            .expected(format!("{} or more", arguments.brightest))
            .into());
    }
    let options = StarsOptions {
        exposures: usize::from(arguments.exposures),
        stars: usize::from(arguments.stars),
        magnitudes: [arguments.brightest, arguments.faintest],
        exposure_s: arguments.exposure_s.map(|value| positive("--exposure-s", value)).transpose()?,
        centroid: arguments.centroid.into(),
        ..StarsOptions::default()
    };
    let common = &arguments.common;
    let facility = common.facility(TableKind::Points, f64::MAX)?;
    let calibration = match &arguments.calibration {
        None => None,
        Some(path) => Some(Calibration::read(path, &facility.setup)?),
    };
    let bar = counter(u64::from(arguments.exposures), "exposures");
    let result =
        simulate_stars(&facility, calibration.as_ref(), &options, |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    common.write("stars.csv", result.csv().as_bytes())?;
    let errors = result.errors_arcsec();
    let within = |limit: f64| errors.partition_point(|e| *e <= limit) as f64 / errors.len().max(1) as f64;
    let percentile =
        |p: f64| errors.get(((errors.len() as f64 * p) as usize).min(errors.len().saturating_sub(1)));
    tell!(
        "{}: {} of {} stars measured, {:.3e} s; 50 / 68 / 96 / 99 % within {:.2} / {:.2} / {:.2} / {:.2} arcsec; \
         {:.2} % within 10, {:.2} % within 3",
        common.out.join("stars.csv").display(),
        result.rows.len(),
        result.shown,
        result.exposure_s,
        percentile(0.5).unwrap_or(&f64::NAN),
        percentile(0.68).unwrap_or(&f64::NAN),
        percentile(0.96).unwrap_or(&f64::NAN),
        percentile(0.99).unwrap_or(&f64::NAN),
        100.0 * within(10.0),
        100.0 * within(3.0)
    );
    let summary = json!({
        "shown": result.shown,
        "measured": result.rows.len(),
        "saturated": result.rows.len() - errors.len(),
        "exposure_s": result.exposure_s,
        "percentiles_arcsec": {"50": percentile(0.5), "68": percentile(0.68), "96": percentile(0.96), "99": percentile(0.99)},
        "fraction_within_10_arcsec": within(10.0),
        "fraction_within_3_arcsec": within(3.0),
    });
    common.finish("stars", &facility, summary)?;
    match (arguments.share, arguments.within_arcsec) {
        (Some(share), Some(limit)) if within(limit) < share => Err(Failure::exceeded(format!(
            "{:.2} % of the errors are within {limit} arcsec, {:.2} % were asked for",
            100.0 * within(limit),
            100.0 * share
        ))),
        _ => Ok(()),
    }
}

fn effects(arguments: &EffectsArguments) -> Result<(), Failure> {
    let unit = |kind: &retina_campaign::EffectKind| kind.units[0].0;
    if arguments.json {
        let list: Vec<Value> = known_effects()
            .map(|kind| {
                json!({
                    "id": kind.id.name(),
                    "table": kind.id.table().name(),
                    "unit": unit(&kind),
                    "values": kind.values,
                    "meaning": kind.meaning,
                })
            })
            .collect();
        return print_json(&json!({"schema": "retina.bench-effects/1", "effects": list}));
    }
    let lines: Vec<String> = known_effects()
        .map(|kind| {
            let (id, table) = (kind.id.name(), kind.id.table().name());
            format!("{id:<22} {table:<7} {:<9} {}", unit(&kind), kind.meaning)
        })
        .collect();
    print_lines(&lines)
}
