//! The light that each place of a display has given in all: what it burns in by.

use std::fmt::Write as _;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use retina_bench::ScreenImage;
use retina_files::{InputError, Table, read_text, write_atomic};

use crate::LabError;

/// Side of the places, px. A place counts as its brightest pixel.
const PLACE_PX: u32 = 16;
const DOSE: &str = "light.csv";
const SESSIONS: &str = "sessions.csv";
const LOCK: &str = "lock";

/// The light of a frame, as parts of a white one.
pub(super) struct Light {
    /// Largest count.
    pub most_count: u8,
    /// Mean over pixels and channels.
    pub mean: f64,
    /// Brightest sub-pixel of each place.
    places: Vec<f32>,
}

/// Hours at full light of each place, kept in a folder.
pub(super) struct Dose {
    folder: Option<PathBuf>,
    _one_at_a_time: Option<File>,
    size_px: [u32; 2],
    /// Light of each count.
    light: [f64; 256],
    hours: Vec<f64>,
    began: Instant,
    began_unix_s: f64,
    lit_s: f64,
    /// Mean light times time, s.
    light_s: f64,
    /// Sessions before this one, as lines.
    sessions: String,
}

impl Dose {
    /// `folder`: where it adds up; from nothing on, and for this run alone, where absent.
    pub(super) fn open(folder: Option<PathBuf>, size_px: [u32; 2], gamma: f64) -> Result<Self, LabError> {
        let [across, down] = places(size_px);
        let mut dose = Self {
            folder,
            _one_at_a_time: None,
            size_px,
            light: std::array::from_fn(|count| (count as f64 / 255.0).powf(gamma)),
            hours: vec![0.0; across * down],
            began: Instant::now(),
            began_unix_s: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64()),
            lit_s: 0.0,
            light_s: 0.0,
            sessions: String::from("start_unix_s,lasted_s,lit_s,mean_light,most_light_h\n"),
        };
        if let Some(folder) = dose.folder.clone() {
            std::fs::create_dir_all(&folder).map_err(|error| failed(&folder, &error))?;
            let path = folder.join(LOCK);
            let lock = File::create(&path).map_err(|error| failed(&path, &error))?;
            lock.try_lock().map_err(|_| {
                InputError::new(&folder, "another program counts the light of this display now")
                    .help("end that one first; two displays need two logs")
            })?;
            dose._one_at_a_time = Some(lock);
            dose.read(&folder)?;
        }
        Ok(dose)
    }

    fn read(&mut self, folder: &Path) -> Result<(), LabError> {
        let sessions = folder.join(SESSIONS);
        if sessions.exists() {
            self.sessions = read_text(&sessions)?;
        }
        let path = folder.join(DOSE);
        if !path.exists() {
            return Ok(());
        }
        let table = Table::parse(&path, &read_text(&path)?)?;
        if table.len() != self.hours.len() {
            return Err(InputError::new(&path, "is the log of a display of another size")
                .found(format!("{} places", table.len()))
                .expected(format!("{}, {PLACE_PX} px wide", self.hours.len()))
                .help("name another folder in `screen.limits.log`")
                .into());
        }
        for (row, hours) in self.hours.iter_mut().enumerate() {
            *hours = table.number(row, "light_h")?;
        }
        Ok(())
    }

    pub(super) fn light(&self, image: &ScreenImage) -> Light {
        let [across, down] = places([image.width_px, image.height_px]);
        let mut brightest = vec![0u8; across * down];
        let mut of_counts = [0u64; 256];
        for (row, pixels) in image.counts.chunks_exact(image.width_px.max(1) as usize).enumerate() {
            let first = row / PLACE_PX as usize * across;
            for (column, counts) in pixels.iter().enumerate() {
                let place = &mut brightest[first + column / PLACE_PX as usize];
                for &count in counts {
                    of_counts[usize::from(count)] += 1;
                    *place = (*place).max(count);
                }
            }
        }
        let sum: f64 = of_counts.iter().zip(&self.light).map(|(&number, light)| number as f64 * light).sum();
        Light {
            most_count: brightest.iter().copied().max().unwrap_or(0),
            mean: sum / (3.0 * image.counts.len().max(1) as f64),
            places: brightest.iter().map(|&count| self.light[usize::from(count)] as f32).collect(),
        }
    }

    /// A frame was there for `time_s`.
    pub(super) fn add(&mut self, light: &Light, time_s: f64) {
        for (hours, part) in self.hours.iter_mut().zip(&light.places) {
            *hours += f64::from(*part) * time_s / 3600.0;
        }
        self.lit_s += time_s;
        self.light_s += light.mean * time_s;
    }

    /// Middle of the place that has shone most, px, and its hours.
    pub(super) fn most(&self) -> Option<([u32; 2], f64)> {
        self.most_where(|_| true)
    }

    /// As [`Self::most`], of the places that a frame would light.
    pub(super) fn most_below(&self, light: &Light) -> Option<([u32; 2], f64)> {
        self.most_where(|place| light.places.get(place).is_some_and(|&part| part > 0.0))
    }

    fn most_where(&self, counts: impl Fn(usize) -> bool) -> Option<([u32; 2], f64)> {
        let places = (0..self.hours.len()).filter(|&place| counts(place));
        let most = places.max_by(|&a, &b| self.hours[a].total_cmp(&self.hours[b]))?;
        Some((self.middle_px(most), self.hours[most]))
    }

    fn middle_px(&self, place: usize) -> [u32; 2] {
        let across = places(self.size_px)[0];
        [place % across, place / across].map(|k| k as u32 * PLACE_PX + PLACE_PX / 2)
    }

    /// Writes the log, where one is kept.
    pub(super) fn save(&self) -> Result<(), LabError> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let mut text = String::from("x_px,y_px,light_h\n");
        for (place, hours) in self.hours.iter().enumerate() {
            let [x, y] = self.middle_px(place);
            let _ = writeln!(text, "{x},{y},{hours:e}");
        }
        let path = folder.join(DOSE);
        write_atomic(&path, text.as_bytes()).map_err(|error| failed(&path, &error))?;
        let mean = if self.lit_s > 0.0 { self.light_s / self.lit_s } else { 0.0 };
        let most_h = self.most().map_or(0.0, |(_, hours)| hours);
        let line = format!(
            "{:.0},{:.1},{:.1},{mean:.5},{most_h:.5}\n",
            self.began_unix_s,
            self.began.elapsed().as_secs_f64(),
            self.lit_s
        );
        let path = folder.join(SESSIONS);
        write_atomic(&path, format!("{}{line}", self.sessions).as_bytes())
            .map_err(|error| failed(&path, &error))
    }
}

fn places(size_px: [u32; 2]) -> [usize; 2] {
    size_px.map(|size| size.div_ceil(PLACE_PX) as usize)
}

fn failed(path: &Path, error: &dyn std::fmt::Display) -> LabError {
    InputError::new(path, format!("cannot be written: {error}")).into()
}
