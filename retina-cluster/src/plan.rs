//! Plans: what is done in shards, and the folder that says so.

use std::fs;
use std::path::{Path, PathBuf};

use retina_batch::{BackendChoice, Batch, BatchError, Observer, Options, Selection};
use retina_experiments::experiment::{ExperimentError, Watcher};
use retina_experiments::far_range::{Choice, Scenario};
use retina_experiments::flashes::{self, FlashScenario};
use retina_experiments::full_disk::{self, FullDiskScenario};
use retina_files::{InputError, read_text, write_atomic};
use retina_render::Quality;
use retina_scene::Scene;
use serde::{Deserialize, Serialize};

use crate::engine::{Format, files};
use crate::runs::Runs;

const SCHEMA: &str = "retina.plan/1";
const PLAN: &str = "plan.json";
/// More tasks than this are no plan but a burden for the engine's scheduler.
const MOST_SHARDS: usize = 100_000;

/// What a plan's shards do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Work {
    /// Frames of a scene.
    Scene,
    /// Random poses of a far-range campaign.
    FarRange,
    /// Frames of a full-disk campaign: rendered, photographed and measured.
    FullDisk,
    /// Frames of a campaign of flashes.
    Flashes,
    /// Runs of a command over many values.
    Runs,
}

impl Work {
    /// What there are many of, in the plural.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Scene | Self::FullDisk | Self::Flashes => "frames",
            Self::FarRange => "poses",
            Self::Runs => "runs",
        }
    }

    /// Where the shards' results are joined, in the plan's folder.
    pub(crate) fn results(self) -> &'static str {
        match self {
            Self::Scene => "merged",
            _ => "results",
        }
    }
}

/// Who watches a campaign's preparation, as one of a batch.
struct Preparing<'a>(&'a mut dyn Observer);

impl Watcher for Preparing<'_> {
    fn note(&mut self, text: &str) {
        self.0.note(text);
    }

    fn step(&mut self, name: &str) {
        self.0.note(name);
    }

    fn done(&mut self, _: usize, _: usize) {}
}

fn batch_error(error: ExperimentError) -> BatchError {
    match error {
        ExperimentError::Batch(error) => error,
        ExperimentError::Input(error) => error.into(),
        ExperimentError::Bench(error) => InputError::new(Path::new("the bench"), error.to_string()).into(),
    }
}

/// What is asked of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// A scene, schema `retina.scene/1`, a campaign, schema `retina.far-range/1`, `retina.full-disk/1` or
    /// `retina.flashes/1`, or runs, schema `retina.runs/1`.
    pub source: PathBuf,
    /// In how many parts.
    pub shards: usize,
    /// For which engine.
    pub format: Format,
    /// Which renderer. [`BackendChoice::Auto`] becomes the native one: all machines are to give the same bytes.
    pub backend: BackendChoice,
    /// `None` is the scene's own.
    pub quality: Option<Quality>,
    /// Processor cores that a task asks for.
    pub cpus: usize,
    /// The command `retina` on the machines that will run it.
    pub command: String,
}

/// A plan, as `plan.json` holds it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    schema: String,
    /// What the shards do.
    pub work: Work,
    /// The scene, campaign or file of runs, an absolute path.
    pub source: PathBuf,
    /// Frames, poses or runs of the whole.
    pub items: usize,
    /// In how many parts.
    pub shards: usize,
    /// For which engine.
    pub format: Format,
    /// Where something is rendered: what renders.
    pub backend: Option<String>,
    /// Of a scene: the quality, where it is not the scene's own.
    pub quality: Option<String>,
    /// Of a scene: displayed over true radiance.
    pub radiance_scale: Option<f64>,
    /// Processor cores of a task.
    pub cpus: usize,
    /// The command `retina`.
    pub command: String,
}

impl Plan {
    /// Makes a plan's folder: `plan.json`, the engine's files, and of a scene a folder a shard with the radiance scale of
    /// the whole sequence. The same request into the same folder leaves what is done there.
    ///
    /// # Errors
    /// The source cannot be read or cannot be done in shards; there are more shards than frames or poses; the folder holds
    /// another plan; a file cannot be written.
    pub fn make(request: &Request, dir: &Path, observer: &mut dyn Observer) -> Result<Self, BatchError> {
        let source = fs::canonicalize(&request.source).map_err(|error| {
            InputError::new(&request.source, format!("cannot be read: {error}")).help("check the path")
        })?;
        let work = work_of(&source)?;
        if let (Work::FullDisk | Work::Flashes | Work::FarRange | Work::Runs, Some(_)) =
            (work, request.quality)
        {
            return Err(InputError::new(Path::new("--quality"), "belongs to a scene")
                .found(source.display())
                .help("leave it out: the campaign's scene has a quality of its own")
                .into());
        }
        let scene = match work {
            Work::Scene => Some(Scene::read(&source)?),
            _ => None,
        };
        let items = match (work, &scene) {
            (Work::FullDisk, _) => FullDiskScenario::read(&source)?.chain.frames()?,
            (Work::Flashes, _) => FlashScenario::read(&source)?.chain.frames()?,
            (Work::Runs, _) => Runs::read(&source)?.count(),
            (_, Some(scene)) => scene.frame_count(),
            (_, None) => Scenario::read(&source, &Choice::default())?.poses.count,
        };
        if request.shards == 0 || request.shards > items.min(MOST_SHARDS) {
            return Err(InputError::new(Path::new("--shards"), "does not fit")
                .found(request.shards)
                .expected(format!("1 to {}: there are {items} {}", items.min(MOST_SHARDS), work.unit()))
                .into());
        }
        for (name, path) in [("the scene", &source), ("the plan", &dir.to_path_buf())] {
            if path.to_str().is_none_or(|text| text.contains(['\n', '\r'])) {
                return Err(InputError::new(path, format!("the path of {name} cannot stand in a script"))
                    .expected("UTF-8 without line ends")
                    .into());
            }
        }
        let mut plan = Self {
            schema: SCHEMA.into(),
            work,
            source,
            items,
            shards: request.shards,
            format: request.format,
            backend: matches!(work, Work::Scene | Work::FullDisk | Work::Flashes)
                .then(|| backend_name(request.backend).to_owned()),
            quality: request.quality.map(|quality| quality_name(quality).to_owned()),
            radiance_scale: None,
            cpus: request.cpus,
            command: request.command.clone(),
        };
        plan.refuse_another(dir)?;
        let made = |path: &Path| {
            fs::create_dir_all(path)
                .map_err(|error| InputError::new(path, format!("the folder cannot be made: {error}")))
        };
        made(&dir.join("logs"))?;
        let (results, backend) = (dir.join(work.results()), rendering(request.backend));
        match scene {
            Some(scene) => plan.radiance_scale = Some(plan.prepare(scene, request, dir, observer)?),
            None => made(&results)?,
        }
        let (count, watcher) = (plan.shards, &mut Preparing(observer));
        match work {
            Work::Scene | Work::FarRange | Work::Runs => {}
            Work::FullDisk => {
                let scenario = FullDiskScenario::read(&plan.source)?;
                full_disk::prepare_parts(&scenario, &results, backend, count, watcher)
                    .map_err(batch_error)?;
            }
            Work::Flashes => {
                let scenario = FlashScenario::read(&plan.source)?;
                flashes::prepare_parts(&scenario, &results, backend, count, watcher).map_err(batch_error)?;
            }
        }
        let whole = fs::canonicalize(dir)
            .map_err(|error| InputError::new(dir, format!("the folder cannot be read: {error}")))?;
        for file in files(&plan, &whole) {
            write(&dir.join(&file.name), file.text.as_bytes(), file.runs)?;
        }
        // Last: a folder without it is no plan yet.
        let mut text = serde_json::to_string_pretty(&plan)
            .map_err(|error| BatchError::Encode { what: PLAN.into(), reason: error.to_string() })?;
        text.push('\n');
        write(&dir.join(PLAN), text.as_bytes(), false)?;
        Ok(plan)
    }

    /// Reads a plan's folder; `None` where it is not one.
    ///
    /// # Errors
    /// Its `plan.json` cannot be read.
    pub fn read(dir: &Path) -> Result<Option<Self>, InputError> {
        let file = dir.join(PLAN);
        if !file.exists() {
            return Ok(None);
        }
        let plan: Self = serde_json::from_str(&read_text(&file)?).map_err(|error| {
            InputError::new(&file, format!("is not a plan: {error}"))
                .help("make the plan again by `retina plan`")
        })?;
        if plan.schema != SCHEMA || plan.shards == 0 || plan.shards > plan.items.min(MOST_SHARDS) {
            return Err(InputError::new(&file, "is not a plan of this version")
                .found(format!("`{}`, {} shards of {}", plan.schema, plan.shards, plan.items))
                .expected(format!("`{SCHEMA}`, at most as many shards as {}", plan.work.unit())));
        }
        Ok(Some(plan))
    }

    /// The folder of a scene's shard, in the plan's.
    pub fn shard_folder(&self, shard: usize) -> PathBuf {
        Path::new("shards").join(format!("{shard:05}"))
    }

    /// Frames or poses of a shard.
    pub fn items_of(&self, shard: usize) -> usize {
        (self.items + self.shards - 1 - shard) / self.shards
    }

    /// Numbers of a shard's frames or poses.
    pub(crate) fn numbers_of(&self, shard: usize) -> impl Iterator<Item = usize> {
        (shard..self.items).step_by(self.shards)
    }

    fn refuse_another(&self, dir: &Path) -> Result<(), InputError> {
        let Some(found) = Self::read(dir)? else {
            let left = fs::read_dir(dir).ok().and_then(|mut entries| entries.next()?.ok());
            return match left {
                // A plan that was cut short has no `plan.json`, but the rest.
                Some(entry)
                    if !["logs", "shards", "results"].iter().any(|name| entry.file_name() == *name) =>
                {
                    Err(InputError::new(dir, "holds something that is no plan")
                        .found(entry.file_name().display())
                        .help("give --out a folder of its own"))
                }
                _ => Ok(()),
            };
        };
        let whose = |plan: &Self| {
            (plan.source.clone(), plan.items, plan.shards, plan.backend.clone(), plan.quality.clone())
        };
        if whose(&found) == whose(self) {
            return Ok(());
        }
        let told = |plan: &Self| {
            let backend =
                plan.backend.as_deref().map_or_else(String::new, |name| format!(", backend {name}"));
            let quality =
                plan.quality.as_deref().map_or_else(String::new, |name| format!(", quality {name}"));
            format!("{} in {} shards{backend}{quality}", plan.source.display(), plan.shards)
        };
        Err(InputError::new(dir, "holds another plan")
            .found(told(&found))
            .expected(told(self))
            .help("give --out another folder: shards are not cut anew"))
    }

    fn prepare(
        &self,
        scene: Scene,
        request: &Request,
        dir: &Path,
        observer: &mut dyn Observer,
    ) -> Result<f64, BatchError> {
        let folders: Vec<PathBuf> =
            (0..self.shards).map(|shard| dir.join(self.shard_folder(shard))).collect();
        let options = Options {
            dir: folders[0].clone(),
            selection: Selection::default(),
            resume: true,
            backend: rendering(request.backend),
            quality: request.quality,
        };
        Batch::new(scene, options).prepare(&folders, observer)
    }
}

fn write(path: &Path, bytes: &[u8], runs: bool) -> Result<(), BatchError> {
    let failed = |source| BatchError::Write { path: path.to_path_buf(), source };
    write_atomic(path, bytes).map_err(failed)?;
    #[cfg(unix)]
    if runs {
        use std::os::unix::fs::PermissionsExt as _;
        fs::set_permissions(path, fs::Permissions::from_mode(0o755)).map_err(failed)?;
    }
    Ok(())
}

/// The renderer of all tasks: the native one unless another is asked for.
fn rendering(backend: BackendChoice) -> BackendChoice {
    match backend {
        BackendChoice::Auto => BackendChoice::Native,
        other => other,
    }
}

fn backend_name(backend: BackendChoice) -> &'static str {
    match backend {
        BackendChoice::Gpu => "gpu",
        BackendChoice::Cpu => "cpu",
        BackendChoice::Auto | BackendChoice::Native => "native",
    }
}

fn quality_name(quality: Quality) -> &'static str {
    match quality {
        Quality::Draft => "draft",
        Quality::Default => "default",
        Quality::Best => "best",
    }
}

/// What a file's shards would do.
fn work_of(source: &Path) -> Result<Work, InputError> {
    let text = read_text(source)?;
    let schema =
        text.parse::<toml::Table>().ok().and_then(|table| Some(table.get("schema")?.as_str()?.to_owned()));
    match schema.as_deref() {
        Some("retina.scene/1") => Ok(Work::Scene),
        Some("retina.far-range/1") => Ok(Work::FarRange),
        Some("retina.full-disk/1") => Ok(Work::FullDisk),
        Some("retina.flashes/1") => Ok(Work::Flashes),
        Some("retina.runs/1") => Ok(Work::Runs),
        other => Err(InputError::new(source, "cannot be done in shards")
            .found(other.map_or_else(|| "no key `schema`".to_owned(), |name| format!("schema `{name}`")))
            .expected(
                "a scene (`retina.scene/1`), a campaign (`retina.far-range/1`, `retina.full-disk/1`, \
                 `retina.flashes/1`), or runs (`retina.runs/1`)",
            )),
    }
}
