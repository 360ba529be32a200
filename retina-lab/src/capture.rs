//! Showing a sequence and photographing it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use retina_bench::ScreenImage;
use retina_campaign::predicted_by;
use retina_files::{InputError, Table, hash_bytes, hash_file, write_atomic};

use crate::exposure::find_exposure;
use crate::sequence::Planned;
use crate::{LabError, Rig, Sequence, SequenceFrame, SequenceKind, ShownPart};

/// Log of a folder of images: a line an image, written when the image is on the disk.
const LOG: &str = "captures.csv";
const LOG_HEAD: &str = "image,frame,exposure_index,repeat,exposure_s,gain_db,time_s,unix_s,camera_time_s,\
                        temperature_c,verified,lost,patch";
/// How long each of several screens was there in an image's exposure.
const PARTS: &str = "parts.csv";
/// What the folder's images were taken of.
const MADE_FROM: &str = "captures.txt";
/// First trial where the exposure is looked for, s.
const FIRST_TRIAL_S: f64 = 0.01;

/// How a sequence is taken.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureOptions {
    /// Exposure times, s, of frames whose ratio is 1; each frame is taken with each. One is looked for where empty.
    pub exposures_s: Vec<f64>,
    /// Images of each frame and exposure.
    pub repeats: usize,
}

impl Default for CaptureOptions {
    fn default() -> Self {
        Self { exposures_s: Vec::new(), repeats: 1 }
    }
}

/// What was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Captured {
    /// The table that lists the images: `images/images.csv` or `frames.csv`.
    pub table: PathBuf,
    /// Images taken by this run.
    pub taken: usize,
    /// Images that were there already.
    pub skipped: usize,
    /// Images that came torn or not at all, and were taken again.
    pub lost: u64,
    /// Exposure times of frames of ratio 1, s.
    pub exposures_s: Vec<f64>,
}

/// A line of the log.
#[derive(Debug, Clone, PartialEq)]
struct Line {
    frame: usize,
    exposure: usize,
    image: String,
    exposure_s: f64,
    time_s: f64,
    unix_s: f64,
    temperature_c: Option<f64>,
    lost: u64,
}

/// A frame that is about to be shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Upcoming<'a> {
    /// The frame.
    pub frame: &'a SequenceFrame,
    /// Images that are there.
    pub taken: usize,
    /// Time since the first image, s; none where there is none.
    pub elapsed_s: Option<f64>,
}

/// What is done before a frame is shown.
pub type Before<'a> = dyn FnMut(&mut Rig<'_>, &Upcoming<'_>) -> Result<(), LabError> + 'a;

/// Shows each frame and photographs it: `out/images/NAME.png`, listed in `out/images/images.csv` (a pattern) or
/// `out/frames.csv`, with a log beside. Images that an interrupted run of the same left are kept. The screen is dark at
/// the end. `before` is called before each frame is shown; `progress` is told how many of how many are there.
///
/// # Errors
/// A device fails, a file cannot be written, the user wants an end, or the folder holds images of something else.
pub fn capture(
    sequence: &Sequence,
    rig: &mut Rig<'_>,
    options: &CaptureOptions,
    out: &Path,
    before: &mut Before<'_>,
    mut progress: impl FnMut(usize, usize),
) -> Result<Captured, LabError> {
    let folder = Folder::open(out, sequence, options, rig)?;
    let _one_at_a_time = folder.lock()?;
    let mut lines = folder.lines()?;
    let exposures_s = match (options.exposures_s.as_slice(), lines.values().next()) {
        // The exposure that an interrupted run found holds for the rest.
        ([], Some(line)) => vec![line.exposure_s / ratio(sequence, line.frame)],
        ([], None) => {
            let frame = &sequence.frames[0];
            vec![find_exposure(rig, &frame.image()?, FIRST_TRIAL_S)? / frame.exposure_ratio]
        }
        (given, _) => given.to_vec(),
    };
    // Before the first image: an exposure that is too short for a frame's screens.
    for frame in sequence.frames.iter().filter(|frame| !frame.parts.is_empty()) {
        for exposure_s in &exposures_s {
            Rig::check_sum(*exposure_s, frame.parts.iter().map(|part| part.share))?;
        }
    }
    let total = sequence.frames.len() * exposures_s.len() * options.repeats;
    let skipped = lines.len();
    progress(skipped, total);
    for (index, frame) in sequence.frames.iter().enumerate() {
        let mut shown = false;
        for (nth, exposure_s) in exposures_s.iter().enumerate() {
            let exposure_s = frame.exposure_s.unwrap_or(exposure_s * frame.exposure_ratio);
            for repeat in 0..options.repeats {
                let image = image_name(&frame.name, nth, exposures_s.len(), repeat, options.repeats);
                if lines.contains_key(&image) {
                    continue;
                }
                if let Err(interrupted) = rig.go_on() {
                    folder.write_table(sequence, &lines)?;
                    return Err(interrupted);
                }
                let sum = !frame.parts.is_empty();
                if !shown {
                    let start_s = lines.values().map(|line: &Line| line.unix_s - line.time_s).next();
                    let elapsed_s = start_s.map(|start| unix_s() - start);
                    before(rig, &Upcoming { frame, taken: lines.len(), elapsed_s })?;
                    if !sum {
                        rig.show(&frame.image()?)?;
                    }
                    shown = true;
                }
                let unix_s = unix_s();
                let taken = if sum {
                    let screens = frame.screens()?;
                    let (taken, shown) = rig.take_sum(exposure_s, &screens)?;
                    folder.append_parts(&image, frame, &shown)?;
                    taken
                } else {
                    rig.take(exposure_s)?
                };
                taken.image.write_png(&folder.images.join(&image))?;
                let first_s =
                    lines.values().map(|line: &Line| line.unix_s - line.time_s).next().unwrap_or(unix_s);
                let line = Line {
                    frame: index,
                    exposure: nth,
                    image: image.clone(),
                    exposure_s: taken.exposure_s,
                    time_s: unix_s - first_s,
                    unix_s,
                    temperature_c: taken.temperature_c,
                    lost: taken.lost.into(),
                };
                // Of several screens `parts.csv` says it.
                let patch = if sum { None } else { rig.screen.patch() };
                folder.append(&line, repeat, rig, taken.time_s, patch)?;
                lines.insert(image, line);
                progress(lines.len(), total);
            }
        }
    }
    let size = sequence.frames[0].image()?;
    rig.screen.show(&ScreenImage::dark(size.width_px, size.height_px))?;
    let table = folder.write_table(sequence, &lines)?;
    Ok(Captured {
        table,
        taken: lines.len() - skipped,
        skipped,
        lost: lines.values().map(|line| line.lost).sum(),
        exposures_s,
    })
}

fn ratio(sequence: &Sequence, frame: usize) -> f64 {
    sequence.frames.get(frame).map_or(1.0, |frame| frame.exposure_ratio)
}

pub(crate) fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64())
}

fn image_name(frame: &str, exposure: usize, exposures: usize, repeat: usize, repeats: usize) -> String {
    let mut name = frame.to_owned();
    if exposures > 1 {
        let _ = write!(name, "-e{exposure}");
    }
    if repeats > 1 {
        let _ = write!(name, "-r{repeat}");
    }
    name + ".png"
}

struct Folder {
    out: PathBuf,
    images: PathBuf,
}

fn failed(path: &Path, error: impl std::fmt::Display) -> LabError {
    InputError::new(path, format!("cannot be written: {error}")).into()
}

impl Folder {
    /// Makes the folder, or finds it as an earlier run of the same left it.
    fn open(
        out: &Path,
        sequence: &Sequence,
        options: &CaptureOptions,
        rig: &Rig<'_>,
    ) -> Result<Self, LabError> {
        let images = out.join("images");
        let mut text = format!("{options:?} {} {} ", rig.gain_db, rig.camera.name());
        let _ = writeln!(text, "{}", rig.screen.patch().is_some());
        for frame in &sequence.frames {
            for file in frame.files() {
                let _ = writeln!(text, "{} {:?} {}", frame.name, frame.exposure_s, hash_file(file)?);
            }
        }
        let own = format!("{}\n", hash_bytes(text.as_bytes()));
        let mark = out.join(MADE_FROM);
        if mark.exists() {
            // Where nothing was taken yet, other options are welcome.
            if out.join(LOG).exists() && retina_files::read_text(&mark)? != own {
                return Err(InputError::new(
                    out,
                    "holds images of another sequence, or taken by another camera or with other options",
                )
                .help("give --out another folder")
                .into());
            }
        } else if images.exists() {
            return Err(InputError::new(&images, "holds images of which nothing says what they show")
                .help("give --out another folder")
                .into());
        }
        std::fs::create_dir_all(&images).map_err(|error| failed(&images, error))?;
        write_atomic(&mark, own.as_bytes()).map_err(|error| failed(&mark, error))?;
        Ok(Self { out: out.into(), images })
    }

    /// Two programs do not take images into one folder.
    fn lock(&self) -> Result<File, LabError> {
        let path = self.out.join(MADE_FROM);
        let file = File::open(&path).map_err(|error| failed(&path, error))?;
        file.try_lock()
            .map_err(|_| InputError::new(&self.out, "another program takes images into this folder"))?;
        Ok(file)
    }

    /// The log's lines whose images are there, by name.
    fn lines(&self) -> Result<BTreeMap<String, Line>, LabError> {
        let path = self.out.join(LOG);
        if !path.exists() {
            return Ok(BTreeMap::new());
        }
        // A line that a killed run did not finish: its image is taken again.
        let text = retina_files::read_text(&path)?;
        let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
        if whole.len() < text.len() {
            write_atomic(&path, whole.as_bytes()).map_err(|error| failed(&path, error))?;
        }
        let table = Table::parse(&path, whole)?;
        let mut lines = BTreeMap::new();
        for row in 0..table.len() {
            let image = table.text(row, "image").to_owned();
            if !self.images.join(&image).is_file() {
                continue;
            }
            let line = Line {
                frame: table.number(row, "frame")? as usize,
                exposure: table.number(row, "exposure_index")? as usize,
                image: image.clone(),
                exposure_s: table.number(row, "exposure_s")?,
                time_s: table.number(row, "time_s")?,
                unix_s: table.number(row, "unix_s")?,
                temperature_c: table.number_or_empty(row, "temperature_c")?,
                lost: table.number(row, "lost")? as u64,
            };
            lines.insert(image, line);
        }
        Ok(lines)
    }

    fn append(
        &self,
        line: &Line,
        repeat: usize,
        rig: &Rig<'_>,
        camera_time_s: f64,
        patch: Option<bool>,
    ) -> Result<(), LabError> {
        let (gain_db, verified) = (rig.gain_db, rig.screen.verifies());
        let path = self.out.join(LOG);
        let new = !path.exists();
        let mut file =
            OpenOptions::new().create(true).append(true).open(&path).map_err(|error| failed(&path, error))?;
        let mut text = if new { format!("{LOG_HEAD}\n") } else { String::new() };
        let _ = writeln!(
            text,
            "{},{},{},{repeat},{},{gain_db},{:.6},{:.6},{camera_time_s:.9},{},{},{},{}",
            line.image,
            line.frame,
            line.exposure,
            line.exposure_s,
            line.time_s,
            line.unix_s,
            cell(line.temperature_c),
            u8::from(verified),
            line.lost,
            patch_cell(patch)
        );
        file.write_all(text.as_bytes()).and_then(|()| file.sync_data()).map_err(|error| failed(&path, error))
    }

    /// How long each screen of a sum was there.
    fn append_parts(&self, image: &str, frame: &SequenceFrame, shown: &[ShownPart]) -> Result<(), LabError> {
        let path = self.out.join(PARTS);
        let mut text =
            if path.exists() { String::new() } else { "image,screen,share,shown_s,patch\n".to_owned() };
        for (part, shown) in frame.parts.iter().zip(shown) {
            let screen = part.file.file_name().unwrap_or_default().to_string_lossy();
            let patch = patch_cell(shown.patch);
            let _ = writeln!(text, "{image},{screen},{},{:.6},{patch}", part.share, shown.shown_s);
        }
        let file = OpenOptions::new().create(true).append(true).open(&path);
        file.and_then(|mut file| file.write_all(text.as_bytes())).map_err(|error| failed(&path, error))
    }

    /// The table for the commands that go on from here.
    fn write_table(&self, sequence: &Sequence, lines: &BTreeMap<String, Line>) -> Result<PathBuf, LabError> {
        let mut ordered: Vec<&Line> = lines.values().collect();
        ordered.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let (path, mut text) = match sequence.kind {
            SequenceKind::Pattern => (
                self.images.join("images.csv"),
                String::from("image,screen,exposure_s,time_s,temperature_c,camera_roll_deg,mounting\n"),
            ),
            SequenceKind::Frames => (
                self.out.join("frames.csv"),
                String::from("predicted,measured,time_s,temperature_c,exposure_s\n"),
            ),
        };
        // Times go on from those of the measurements before, where a plan says when it begins.
        let from_s = sequence.frames.first().and_then(|frame| frame.planned.time_s).unwrap_or(0.0);
        for line in ordered {
            let frame = &sequence.frames[line.frame];
            let (time_s, exposure_s, temperature) =
                (from_s + line.time_s, line.exposure_s, cell(line.temperature_c));
            let _ = match sequence.kind {
                SequenceKind::Pattern => {
                    let screen = frame.file.file_name().unwrap_or_default().to_string_lossy();
                    let Planned { camera_roll_deg, mounting, .. } = frame.planned;
                    let (roll, mounting) = (cell(camera_roll_deg), cell(mounting));
                    writeln!(
                        text,
                        "{},{screen},{exposure_s},{time_s:.6},{temperature},{roll},{mounting}",
                        line.image
                    )
                }
                SequenceKind::Frames => {
                    let predicted = predicted_by(&frame.file);
                    let measured = &line.image;
                    writeln!(
                        text,
                        "{},images/{measured},{time_s:.6},{temperature},{exposure_s}",
                        predicted.display()
                    )
                }
            };
        }
        write_atomic(&path, text.as_bytes()).map_err(|error| failed(&path, error))?;
        Ok(path)
    }
}

fn patch_cell(white: Option<bool>) -> String {
    white.map_or_else(String::new, |white| u8::from(white).to_string())
}

fn cell(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}
