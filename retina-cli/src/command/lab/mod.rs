//! `retina lab ...`: real screens and cameras, and the virtual bench in their place.

mod align;
mod calibrate;
mod camera;
mod capture;
mod check;
mod closed_loop;
mod devices;
mod latency;
mod loop_basilisk;
mod measure;
mod monitor;
mod radiometry;
mod show;
mod split;

use std::io::BufRead as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use retina::lab::{
    BenchCamera, BenchCameraOptions, BenchScreen, CameraSpec, CaptureOptions, LabCamera, LabError, Patch,
    Rig, Screen, ScreenSpec, open_camera, open_screen,
};
use retina_campaign::{Effect, Facility};
use retina_files::InputError;
use retina_formats::TableKind;
use retina_geometry::Setup;

use crate::command::simulate::Profile;
use crate::failure::Failure;
use crate::output::tell;
use crate::setup::read_setup;

/// Drives a laboratory's screen and camera, or the virtual bench in their place.
#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Lists the cameras and screens that are there.
    Devices(devices::Arguments),
    /// Looks a bench over: a card of what is wrong, and what to turn or set.
    ///
    /// Dark, flat field, dead pixels, response, refresh, focus, centring, times. Exit code 1 where something is bad.
    Check(check::Arguments),
    /// Shows a sequence on a screen, without a camera.
    ///
    /// The screen is dark at the end. Frames are exact: a window reads each one back.
    Show(show::Arguments),
    /// Splits linear images into screens whose light adds up within one exposure.
    ///
    /// Light then has finer steps than the screen's 8 bits. `retina lab capture` shows the screens of a frame one after
    /// the other while the camera exposes.
    Split(split::Arguments),
    /// Shows a sequence and photographs it.
    ///
    /// The sequence is a pattern (`retina pattern`), a round of `retina decide`, frames (`retina render`), or a folder
    /// of PNG files. An interrupted run goes on where it was when it is started again.
    Capture(capture::Arguments),
    /// Calibrates the facility in one piece: pattern, images, fit, and a check on fresh points.
    #[command(subcommand)]
    Calibrate(calibrate::Command),
    /// Says how far each screw of the bench is off, round by round, while a person turns.
    ///
    /// A round photographs one pattern a dozen times. The places and the widths of its spots are compared with those of
    /// the traced design with its screws turned. Exit code 1 where the bench is not aligned after the last round.
    Align(align::Arguments),
    /// Carries out what `retina decide` has planned: screens, exposures, times, rolls, temperatures.
    ///
    /// The round's points.csv is made of the images. `retina decide` with the same folder goes on from there.
    Measure(measure::Arguments),
    /// Puts the bench into a closed loop: renders each pose, shows it, and gives the camera's image back.
    ///
    /// Poses come over the sockets of CORTO's closed loop (see `retina serve`), or from the scene itself. Frames that
    /// take longer than the wanted rate allows are marked.
    Loop(closed_loop::Arguments),
    /// Measures how long a frame takes to the glass, and its light into an image.
    ///
    /// Frames are changed in the middle of exposures: the part that sees the new frame tells when its light came.
    Latency(latency::Arguments),
    /// Watches whether a calibration still holds, by reference points, round by round.
    ///
    /// Exit code 1 where an alarm was raised.
    Monitor(monitor::Arguments),
    /// Makes the virtual bench a GigE Vision camera that photographs a screen.
    ///
    /// Any program that speaks GigE Vision finds it, sets its features and receives its images. It runs until it is
    /// interrupted.
    Camera(camera::Arguments),
}

pub(crate) fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Devices(arguments) => devices::run(arguments),
        Command::Check(arguments) => check::run(arguments),
        Command::Show(arguments) => show::run(arguments),
        Command::Split(arguments) => split::run(arguments),
        Command::Capture(arguments) => capture::run(arguments),
        Command::Calibrate(command) => calibrate::run(command),
        Command::Align(arguments) => align::run(arguments),
        Command::Measure(arguments) => measure::run(arguments),
        Command::Loop(arguments) => closed_loop::run(arguments),
        Command::Latency(arguments) => latency::run(arguments),
        Command::Monitor(arguments) => monitor::run(arguments),
        Command::Camera(arguments) => camera::run(arguments),
    }
}

/// Time from the start after half of which a `knock` comes, s.
const KNOCK_AFTER_S: f64 = 600.0;

/// The virtual bench: what it is made of.
#[derive(clap::Args)]
struct BenchArguments {
    /// Effect of the virtual bench and its size, for example screen_tilt=0.1deg. Repeat the flag for more. A knock
    /// comes 300 s after the start.
    #[arg(long = "effect", value_name = "ID=VALUE")]
    effects: Vec<String>,
    /// Temperature of the virtual bench from the start on.
    #[arg(long, value_enum, default_value = "constant")]
    temperature: Profile,
    /// Seed of the virtual bench's fixed patterns and of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl BenchArguments {
    fn facility(&self, setup: &Setup) -> Result<Facility, Failure> {
        let effects: Vec<Effect> =
            self.effects.iter().map(|text| Effect::parse(text)).collect::<Result<_, _>>()?;
        Ok(Facility::new(setup, &effects, TableKind::Frames, KNOCK_AFTER_S, self.seed)?)
    }

    fn options(&self) -> BenchCameraOptions {
        BenchCameraOptions { temperature: self.temperature.into(), ..BenchCameraOptions::default() }
    }
}

/// Screen and camera.
#[derive(clap::Args)]
struct DeviceArguments {
    /// Facility, schema retina.setup/1.
    #[arg(long)]
    setup: PathBuf,
    /// Screen: x11:DISPLAY, x11:DISPLAY@OUTPUT, folder:DIR (another program shows its screen.png), exec:COMMAND (shows
    /// the file in $RETINA_FRAME), or bench.
    #[arg(long, value_name = "SCREEN")]
    screen: String,
    /// Camera: aravis, aravis:NAME, folder:DIR (another program writes an image for each frame), exec:COMMAND (writes
    /// an image to $RETINA_OUT, exposed for $RETINA_EXPOSURE_S with $RETINA_GAIN_DB), or bench.
    #[arg(long, value_name = "CAMERA")]
    camera: String,
    #[command(flatten)]
    bench: BenchArguments,
    /// Exposure time, s [default: the brightest pixel of the first frame fills 60 % of the camera's range]. Several,
    /// separated by commas, take each frame with each.
    #[arg(long = "exposure-s", value_name = "S", value_delimiter = ',')]
    exposures_s: Vec<f64>,
    /// Gain of the camera, dB.
    #[arg(long, default_value_t = 0.0)]
    gain_db: f64,
    /// Number of images of each frame.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1000))]
    repeats: u16,
    /// Wait after a frame is shown, s: what the display takes to follow.
    #[arg(long, default_value_t = 0.05)]
    settle_s: f64,
    /// Square of the screen for a photodiode, px, where the camera does not look: white and black in turn with each
    /// frame. It is dark where the whole screen is.
    #[arg(long, value_name = "COLUMN,ROW,SIDE")]
    patch: Option<String>,
}

/// What a command works with.
struct Devices {
    setup: Setup,
    screen: Box<dyn Screen>,
    camera: Box<dyn LabCamera>,
    capture: CaptureOptions,
    settle_s: f64,
    gain_db: f64,
    stop: Arc<AtomicBool>,
}

impl Devices {
    /// Lends the screen and the camera to what works with both.
    fn with<T>(&mut self, work: impl FnOnce(&Setup, &mut Rig<'_>) -> T) -> T {
        let stop = Arc::clone(&self.stop);
        let stop = || stop.load(Ordering::Acquire);
        let mut rig = Rig {
            screen: self.screen.as_mut(),
            camera: self.camera.as_mut(),
            settle_s: self.settle_s,
            gain_db: self.gain_db,
            stop: &stop,
        };
        work(&self.setup, &mut rig)
    }
}

impl DeviceArguments {
    fn open(&self) -> Result<Devices, Failure> {
        let number = |flag: &str, value: f64, good: bool, expected: &str| {
            if good {
                return Ok(value);
            }
            Err(InputError::new(Path::new(flag), "is out of range").found(value).expected(expected))
        };
        for &value in &self.exposures_s {
            number("--exposure-s", value, value > 0.0 && value <= 3600.0, "more than 0, at most 3600")?;
        }
        let settle_s = self.settle_s;
        number("--settle-s", settle_s, (0.0..=60.0).contains(&settle_s), "0 to 60")?;
        number("--gain-db", self.gain_db, (0.0..=60.0).contains(&self.gain_db), "0 to 60")?;
        let (screen, camera): (ScreenSpec, CameraSpec) = (self.screen.parse()?, self.camera.parse()?);
        let setup = read_setup(&self.setup)?;
        if camera != CameraSpec::Bench && !self.bench.effects.is_empty() {
            return Err(InputError::new(Path::new("--effect"), "acts in the virtual bench only")
                .found(format!("camera `{}`", self.camera))
                .expected("--camera bench; `retina lab camera` takes effects as well")
                .into());
        }
        if screen == ScreenSpec::Bench && camera != CameraSpec::Bench {
            return Err(InputError::new(
                Path::new("--screen"),
                "the bench's own screen is seen by its own camera only",
            )
            .found(format!("camera `{}`", self.camera))
            .help("give --camera bench, too")
            .into());
        }
        let stop = interrupted()?;
        let size_px = [setup.screen.width_px, setup.screen.height_px];
        let shared = BenchScreen::new(size_px);
        let bench = if (&screen, &camera) == (&ScreenSpec::Bench, &CameraSpec::Bench) {
            let facility = self.bench.facility(&setup)?;
            Some(BenchCamera::new(facility, Box::new(shared.clone()), self.bench.options())?)
        } else {
            None
        };
        // The camera first: no frame is shown that nobody could see.
        let camera = open_camera(&camera, setup.camera.bits, bench)?;
        let patch = self.patch.as_ref().map(|text| text.parse::<Patch>()).transpose()?;
        let screen = open_screen(&screen, &setup, patch, &shared)?;
        remark_on(screen.as_ref(), &self.screen);
        let capture = CaptureOptions { exposures_s: self.exposures_s.clone(), repeats: self.repeats.into() };
        Ok(Devices { setup, screen, camera, capture, settle_s, gain_db: self.gain_db, stop })
    }
}

/// Tells what a user should know of a screen.
fn remark_on(screen: &dyn Screen, name: &str) {
    for remark in screen.remarks() {
        tell!("warning: screen {name}: {remark}");
    }
    if !screen.verifies() {
        tell!("screen {name}: frames cannot be read back; they are taken as shown");
    }
}

/// Who turns what has no motor of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
enum Turner {
    /// The command waits for Enter.
    #[default]
    Person,
    /// A virtual bench turns its own screws.
    Camera,
}

/// Tells a person what to do and waits until it is done.
fn wait_for_enter(what: &str, stop: &dyn Fn() -> bool) -> Result<(), LabError> {
    tell!("{what}, and press Enter; Ctrl-C and Enter end it");
    let mut line = String::new();
    let read = std::io::stdin().lock().read_line(&mut line);
    if stop() {
        return Err(LabError::Interrupted);
    }
    match read {
        Ok(0) | Err(_) => Err(LabError::Unattended { what: what.into() }),
        Ok(_) => Ok(()),
    }
}

/// Becomes true when the user interrupts.
fn interrupted() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Release))
        .map_err(|error| Failure::new(format!("interrupts cannot be caught: {error}")))?;
    Ok(stop)
}
