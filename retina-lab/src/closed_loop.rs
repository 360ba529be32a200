//! The bench in a closed loop: a rendered frame goes onto the screen, and the camera's image of it comes back.

use std::fmt::Write as _;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use retina_bench::ScreenImage;
use retina_files::InputError;
use retina_image::CameraImage;

use crate::capture::unix_s;
use crate::{LabError, Rig, find_exposure};

/// How a loop is run.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopOptions {
    /// Exposure time, s; looked for with the first frame that is not dark where absent.
    pub exposure_s: Option<f64>,
    /// Time from a pose to its image, s, above which a frame is late; none is where absent.
    pub most_s: Option<f64>,
    /// Folder for `images/` and `loop.csv`; nothing is kept where absent.
    pub out: Option<PathBuf>,
}

/// A frame that went round the loop.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopFrame {
    /// Its number, from 0.
    pub index: usize,
    /// The camera's image.
    pub image: CameraImage,
    /// From the pose to the rendered frame, s.
    pub render_s: f64,
    /// ... showing it and waiting for the display, s.
    pub show_s: f64,
    /// ... taking its image, s.
    pub take_s: f64,
    /// From the pose to the image, s.
    pub whole_s: f64,
    /// It took longer than it may.
    pub late: bool,
}

const HEAD: &str = "frame,image,unix_s,render_s,show_s,take_s,whole_s,late,exposure_s,lost,temperature_c";

/// A loop that runs.
pub struct ClosedLoop {
    options: LoopOptions,
    exposure_s: Option<f64>,
    log: Option<File>,
    frames: usize,
    late: usize,
}

impl ClosedLoop {
    /// Begins. `truth` names the columns that each frame's truth fills.
    ///
    /// # Errors
    /// The folder holds another loop's frames, or cannot be written.
    pub fn open(options: LoopOptions, truth: &[&str]) -> Result<Self, LabError> {
        let log = options.out.as_deref().map(|folder| open_log(folder, truth)).transpose()?;
        Ok(Self { exposure_s: options.exposure_s, options, log, frames: 0, late: 0 })
    }

    /// Frames so far, and how many of them were late.
    pub fn counts(&self) -> [usize; 2] {
        [self.frames, self.late]
    }

    /// Shows a frame and photographs it. `asked` is when its pose came, `truth` what it shows.
    ///
    /// # Errors
    /// A device fails, the user wants an end, or a file cannot be written.
    pub fn photograph(
        &mut self,
        rig: &mut Rig<'_>,
        screen: &ScreenImage,
        asked: Instant,
        truth: &[f64],
    ) -> Result<LoopFrame, LabError> {
        let rendered = Instant::now();
        let exposure_s = self.exposure_s(rig, screen)?;
        rig.show(screen)?;
        let shown = Instant::now();
        let taken = rig.take(exposure_s)?;
        let end = Instant::now();
        let seconds = |from: Instant, to: Instant| to.duration_since(from).as_secs_f64();
        let whole_s = seconds(asked, end);
        let frame = LoopFrame {
            index: self.frames,
            image: taken.image,
            render_s: seconds(asked, rendered),
            show_s: seconds(rendered, shown),
            take_s: seconds(shown, end),
            whole_s,
            late: self.options.most_s.is_some_and(|most| whole_s > most),
        };
        if let (Some(folder), Some(log)) = (&self.options.out, &mut self.log) {
            let name = format!("{:06}.png", frame.index);
            frame.image.write_png(&folder.join("images").join(&name))?;
            let mut line = format!(
                "{},images/{name},{:.6},{:.6},{:.6},{:.6},{whole_s:.6},{},{},{},{}",
                frame.index,
                unix_s(),
                frame.render_s,
                frame.show_s,
                frame.take_s,
                u8::from(frame.late),
                taken.exposure_s,
                taken.lost,
                taken.temperature_c.map_or_else(String::new, |value| value.to_string())
            );
            for value in truth {
                let _ = write!(line, ",{value}");
            }
            writeln!(log, "{line}").map_err(|error| failed(&folder.join("loop.csv"), error))?;
        }
        self.frames += 1;
        self.late += usize::from(frame.late);
        Ok(frame)
    }

    /// The exposure time: one for all frames, so that their light can be compared.
    fn exposure_s(&mut self, rig: &mut Rig<'_>, screen: &ScreenImage) -> Result<f64, LabError> {
        const WHILE_DARK_S: f64 = 0.01;
        if let Some(exposure_s) = self.exposure_s {
            return Ok(exposure_s);
        }
        if screen.counts.iter().all(|counts| *counts == [0; 3]) {
            return Ok(WHILE_DARK_S);
        }
        let found = find_exposure(rig, screen, WHILE_DARK_S)?;
        self.exposure_s = Some(found);
        Ok(found)
    }
}

fn failed(path: &Path, error: impl std::fmt::Display) -> LabError {
    InputError::new(path, format!("cannot be written: {error}")).into()
}

fn open_log(folder: &Path, truth: &[&str]) -> Result<File, LabError> {
    let path = folder.join("loop.csv");
    let images = folder.join("images");
    if path.exists() || images.exists() {
        return Err(InputError::new(folder, "holds the frames of another loop")
            .help("give --out another folder: a loop cannot be gone on with")
            .into());
    }
    std::fs::create_dir_all(&images).map_err(|error| failed(&images, error))?;
    let mut head = HEAD.to_owned();
    for column in truth {
        let _ = write!(head, ",{column}");
    }
    let mut log =
        OpenOptions::new().create_new(true).append(true).open(&path).map_err(|error| failed(&path, error))?;
    writeln!(log, "{head}").map_err(|error| failed(&path, error))?;
    Ok(log)
}
