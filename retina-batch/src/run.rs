//! A run: the chosen frames of a scene rendered into a folder.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use retina_files::{InputError, hash_bytes, write_atomic};
use retina_render::{Quality, RadianceImage};
use retina_scene::{DisplayedPoint, RadianceScale, Scene, SceneFrame, ShownPoint};
use serde_json::json;

use crate::folder::{Folder, ManifestLine, Record, frame_file};
use crate::picture::{Picture, PointSources};
use crate::scale::{automatic_scale, brightest_candidates};
use crate::source::FrameSource;
use crate::{
    AdapterName, BackendChoice, BatchError, ImagePlan, Selection, SideProducts, contact_sheet, write_exr,
};

/// Threads that encode and write finished frames while further ones are rendered.
const ENCODERS: usize = 2;

/// What is asked of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The output folder.
    pub dir: PathBuf,
    /// Which frames.
    pub selection: Selection,
    /// Keep the frames that are there.
    pub resume: bool,
    /// Which renderer.
    pub backend: BackendChoice,
    /// In the place of the scene's own.
    pub quality: Option<Quality>,
}

/// How far a run is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Frames finished by this run.
    pub done: usize,
    /// Frames that this run is to make.
    pub to_do: usize,
    /// Frames that were there already.
    pub skipped: usize,
}

/// Is told what happens.
pub trait Observer {
    /// Something the user should know, one sentence.
    fn note(&mut self, text: &str);
    /// The rendering begins, or a frame is finished.
    fn progress(&mut self, progress: Progress);
}

/// What a run did.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The folder.
    pub dir: PathBuf,
    /// Frames made.
    pub done: usize,
    /// Frames that were there already.
    pub skipped: usize,
    /// Wall-clock time of the frames' rendering and writing, s.
    pub seconds: f64,
    /// Displayed over true radiance.
    pub radiance_scale: f64,
    /// Pixels beyond the screen's brightest count, over the selected frames.
    pub saturated_px: u64,
    /// Selected frames that have such pixels.
    pub saturated_frames: usize,
    /// Frames of this run with a planet, a star or an unresolved body whose spot is no point: see [`SPOT_PX`].
    pub spot_frames: usize,
    /// What rendered; `None` where there was nothing to render.
    pub adapter: Option<AdapterName>,
    /// The contact sheet.
    pub contact_sheet: Option<PathBuf>,
}

/// A run of a scene.
pub struct Batch {
    scene: Scene,
    options: Options,
    plan: ImagePlan,
    picture: Picture,
    side_products: Option<Box<dyn SideProducts>>,
    inputs: BTreeMap<String, String>,
}

struct Job {
    frame: SceneFrame,
    image: RadianceImage,
}

/// What is told of a finished frame.
struct FrameDone {
    saturated_px: u64,
    has_spot: bool,
}

type Done = Result<FrameDone, BatchError>;

/// A planet whose disc is wider than this, px, or a source that fills as wide a disc, is shown as a spot of
/// equal light whose size is not its own.
pub const SPOT_PX: f64 = 12.0;

impl Batch {
    /// Prepares a run; nothing is written or rendered yet.
    pub fn new(scene: Scene, options: Options) -> Self {
        let plan = ImagePlan::of(&scene);
        let picture = Picture::of(&scene);
        let inputs = scene.inputs.iter().map(|input| (input.role.clone(), input.hash.clone())).collect();
        Self { scene, options, plan, picture, side_products: None, inputs }
    }

    /// Makes further files of each frame.
    pub fn with_side_products(mut self, products: Box<dyn SideProducts>) -> Self {
        self.plan.add_side_products(products.planes());
        self.inputs.insert("side products".into(), hash_bytes(products.description().as_bytes()));
        self.side_products = Some(products);
        self
    }

    /// Renders the frames.
    ///
    /// # Errors
    /// A selection or a folder that does not fit, a renderer that fails, a file that cannot be
    /// written. A frame that is not finished leaves no file under its name.
    pub fn run(mut self, observer: &mut dyn Observer) -> Result<Summary, BatchError> {
        let selected = self.options.selection.frames(self.scene.frame_count())?;
        let folder = Folder::at(&self.options.dir);
        let found = folder.record()?;
        if let Some(found) = &found {
            // Backend and scale are known later; until then they are taken as they are.
            folder.check_same(found, &self.record(&found.backend, found.radiance_scale))?;
            if !self.options.resume {
                folder.refuse_present(&selected)?;
            }
        }
        let (to_do, saturated_before) = self.missing(&folder, &selected)?;
        let skipped = selected.len() - to_do.len();
        let mut summary = Summary {
            dir: self.options.dir.clone(),
            done: 0,
            skipped,
            seconds: 0.0,
            radiance_scale: found.as_ref().map_or(f64::NAN, |found| found.radiance_scale),
            saturated_px: saturated_before.iter().sum(),
            saturated_frames: saturated_before.iter().filter(|&&px| px > 0).count(),
            spot_frames: 0,
            adapter: None,
            contact_sheet: None,
        };
        for note in self.scene.flash_notes() {
            observer.note(&note);
        }
        if !to_do.is_empty() {
            self.render(&to_do, found, &mut summary, observer)?;
        }
        if summary.done + summary.skipped > 0 {
            summary.contact_sheet = Some(contact_sheet(&self.options.dir)?);
        }
        Ok(summary)
    }

    fn quality(&self) -> Quality {
        self.options.quality.unwrap_or(self.scene.quality)
    }

    pub(crate) fn record(&self, backend: &str, radiance_scale: f64) -> Record {
        let quality = match self.quality() {
            Quality::Draft => "draft",
            Quality::Default => "default",
            Quality::Best => "best",
        };
        let (scene, frames) = (&self.scene, self.scene.frame_count());
        let mut input_hash = scene.input_hash();
        if let Some(products) = &self.side_products {
            input_hash = hash_bytes(format!("{input_hash}\n{}", products.description()).as_bytes());
        }
        Record::new(input_hash, quality, scene.compensation.name(), backend, radiance_scale, frames)
    }

    /// The frames that are not there whole, and the saturated pixels of those that are.
    fn missing(&self, folder: &Folder, selected: &[usize]) -> Result<(Vec<usize>, Vec<u64>), InputError> {
        let manifest = folder.manifest()?;
        let (mut missing, mut saturated) = (Vec::new(), Vec::new());
        for &index in selected {
            match manifest.get(&index) {
                Some(line) if folder.is_whole(line, &self.files(index)) => saturated.push(line.saturated_px),
                _ => missing.push(index),
            }
        }
        Ok((missing, saturated))
    }

    /// The files of a frame, in the order in which they are written.
    fn files(&self, index: usize) -> Vec<String> {
        let mut files = Vec::new();
        if self.scene.output.exr {
            files.push(frame_file("frames", index, "exr"));
        }
        if let Some(products) = &self.side_products {
            files.extend(products.files(index));
        }
        files.push(frame_file("truth", index, "json"));
        files.push(frame_file("frames", index, "png"));
        files
    }

    /// The folders that those files lie in.
    pub(crate) fn kinds(&self) -> BTreeSet<String> {
        let folder = |file: &String| file.rsplit_once('/').map(|(folder, _)| folder.to_string());
        self.files(0).iter().filter_map(folder).collect()
    }

    fn render(
        &mut self,
        to_do: &[usize],
        found: Option<Record>,
        summary: &mut Summary,
        observer: &mut dyn Observer,
    ) -> Result<(), BatchError> {
        let (mut source, radiance_scale) = self.open_source(found.as_ref(), observer)?;
        let record = self.record(source.name.backend, radiance_scale);
        let folder = Folder::open(&self.options.dir, &record, &self.kinds())?;
        summary.radiance_scale = radiance_scale;
        summary.adapter = Some(source.name.clone());
        observer.progress(Progress { done: 0, to_do: to_do.len(), skipped: summary.skipped });
        let start = Instant::now();
        self.pipeline(&folder, &mut source, to_do, radiance_scale, summary, observer)?;
        summary.seconds = start.elapsed().as_secs_f64();
        folder.close()
    }

    /// The renderer, and the sequence's radiance scale: that of a folder that was found, the scene's, or one that is looked
    /// for.
    pub(crate) fn open_source(
        &mut self,
        found: Option<&Record>,
        observer: &mut dyn Observer,
    ) -> Result<(FrameSource, f64), BatchError> {
        let candidates = match (self.scene.radiance_scale, found) {
            (RadianceScale::Auto, None) => brightest_candidates(&self.scene)?,
            _ => Vec::new(),
        };
        let models = self.scene.take_models();
        let (mut source, fallback) =
            FrameSource::open(self.options.backend, models, self.quality(), &self.plan)?;
        if let Some(reason) = fallback {
            observer.note(&format!("rendering on the processor's cores: {reason}"));
        }
        if let Some(found) = found {
            let wanted = self.record(source.name.backend, found.radiance_scale);
            Folder::at(&self.options.dir).check_same(found, &wanted)?;
        }
        let radiance_scale = match (self.scene.radiance_scale, found) {
            (RadianceScale::Value(value), _) => value,
            (RadianceScale::Auto, Some(found)) => found.radiance_scale,
            // Stars and planets alone are shown as bright as they are.
            (RadianceScale::Auto, None) if self.scene.bodies.is_empty() => 1.0,
            (RadianceScale::Auto, None) => {
                observer.note("looking for the brightest pixel of the sequence, for its radiance scale");
                automatic_scale(&self.scene, &self.plan, &self.picture, &mut source, &candidates)?
            }
        };
        Ok((source, radiance_scale))
    }

    /// Renders on this thread and encodes on others; what waits between them is bounded.
    fn pipeline(
        &self,
        folder: &Folder,
        source: &mut FrameSource,
        to_do: &[usize],
        radiance_scale: f64,
        summary: &mut Summary,
        observer: &mut dyn Observer,
    ) -> Result<(), BatchError> {
        let (jobs, waiting) = sync_channel::<Job>(1);
        let waiting = Arc::new(Mutex::new(waiting));
        let (reports, finished) = channel::<Done>();
        let resampler = source.resampler.take();
        let name = source.name.clone();
        let writer = FrameWriter { batch: self, folder, resampler, radiance_scale, name };
        let mut tell = |summary: &mut Summary, done: Done| -> Result<(), BatchError> {
            let FrameDone { saturated_px, has_spot } = done?;
            summary.spot_frames += usize::from(has_spot);
            summary.done += 1;
            summary.saturated_px += saturated_px;
            summary.saturated_frames += usize::from(saturated_px > 0);
            let progress = Progress { done: summary.done, to_do: to_do.len(), skipped: summary.skipped };
            observer.progress(progress);
            Ok(())
        };
        std::thread::scope(|scope| {
            for _ in 0..ENCODERS {
                let (waiting, reports, writer) = (Arc::clone(&waiting), reports.clone(), &writer);
                scope.spawn(move || encode_all(&waiting, &reports, writer));
            }
            // Only the encoders hold these now, so a channel closes when they are gone.
            drop((reports, waiting));
            let jobs = jobs;
            let mut next = to_do.iter();
            let mut under_way = VecDeque::new();
            loop {
                while source.in_flight() < source.capacity() {
                    let Some(&index) = next.next() else { break };
                    let frame = self.scene.frame(index)?;
                    source.start(&frame)?;
                    under_way.push_back(frame);
                }
                let (Some(image), Some(frame)) = (source.finish()?, under_way.pop_front()) else { break };
                if jobs.send(Job { frame, image }).is_err() {
                    break;
                }
                for done in finished.try_iter() {
                    tell(summary, done)?;
                }
            }
            drop(jobs);
            finished.iter().try_for_each(|done| tell(summary, done))
        })
    }
}

/// Takes jobs until there are no more or one fails.
fn encode_all(waiting: &Mutex<Receiver<Job>>, reports: &Sender<Done>, writer: &FrameWriter<'_>) {
    loop {
        let job = waiting.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(job) = job else { return };
        let done = writer.write(job);
        let failed = done.is_err();
        if reports.send(done).is_err() || failed {
            return;
        }
    }
}

/// Whether a point's light fills a disc of [`SPOT_PX`].
fn fills_a_spot(shown: &DisplayedPoint) -> bool {
    shown.pixels as f64 > std::f64::consts::FRAC_PI_4 * SPOT_PX * SPOT_PX
}

/// Makes the files of a frame.
struct FrameWriter<'a> {
    batch: &'a Batch,
    folder: &'a Folder,
    resampler: Option<crate::Resampler>,
    radiance_scale: f64,
    name: AdapterName,
}

impl FrameWriter<'_> {
    /// Writes a frame's files, the screen image last, then its line of the manifest.
    fn write(&self, job: Job) -> Done {
        let Job { frame, image } = job;
        let (batch, index) = (self.batch, frame.index);
        let developed = batch.plan.develop(&image, self.resampler.as_ref());
        let sources = PointSources { sky: batch.scene.sky(&frame)?, flashes: batch.scene.flashes_of(&frame) };
        let painted = batch.picture.paint(index, &developed, sources, self.radiance_scale)?;
        let png = batch.picture.png(index, &painted.samples, painted.filtered)?;
        let mut outputs = BTreeMap::new();
        if let Some(channels) = developed.channels {
            let metadata = json!({
                "schema": "retina.radiance/1",
                "frame": index,
                "time_s": frame.time_s,
                "geometry": batch.plan.exr_geometry(),
                "wavelength_nm": 550,
                "radiance_scale_of_screen": self.radiance_scale,
                "adapter": self.name.adapter,
                "driver": self.name.driver,
            });
            let bytes = write_exr(channels, &metadata.to_string())?;
            self.put(frame_file("frames", index, "exr"), &bytes, &mut outputs)?;
        }
        if let Some(products) = &batch.side_products {
            let made = products.make(&frame, &image, &png)?;
            for (file, bytes) in products.files(index).into_iter().zip(made) {
                self.put(file, &bytes, &mut outputs)?;
            }
        }
        let truth =
            batch.scene.truth(&frame, self.radiance_scale, &painted.stars, &painted.flashes, painted.body);
        let mut text =
            serde_json::to_vec_pretty(&truth).map_err(|error| BatchError::encode("the truth", &error))?;
        text.push(b'\n');
        self.put(frame_file("truth", index, "json"), &text, &mut outputs)?;
        self.put(frame_file("frames", index, "png"), &png, &mut outputs)?;
        self.folder.append(&ManifestLine::new(
            index,
            batch.inputs.clone(),
            outputs,
            batch.scene.seed,
            self.radiance_scale,
            painted.saturated_px,
            &self.name,
        ))?;
        let has_spot = painted.stars.iter().any(|star| self.is_spot(star))
            || painted.body.is_some_and(|body| fills_a_spot(&body));
        Ok(FrameDone { saturated_px: painted.saturated_px, has_spot })
    }

    fn is_spot(&self, star: &ShownPoint) -> bool {
        let disc_px = star
            .point
            .planet
            .map_or(0.0, |planet| 2.0 * planet.angular_radius_rad * self.batch.scene.image.fx_px);
        disc_px > SPOT_PX || star.displayed.is_some_and(|shown| fills_a_spot(&shown))
    }

    fn put(
        &self,
        file: String,
        bytes: &[u8],
        outputs: &mut BTreeMap<String, String>,
    ) -> Result<(), BatchError> {
        let path: &Path = &self.folder.dir().join(&file);
        write_atomic(path, bytes).map_err(BatchError::write(path))?;
        outputs.insert(file, hash_bytes(bytes));
        Ok(())
    }
}
