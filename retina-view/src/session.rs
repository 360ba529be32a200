//! A session: its inputs, what was computed of them, and its job.

mod news;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::http::StatusCode;
use retina::workbench::{GivenCalibration, GivenEffect, Input, Measured, TableMaterial, added_effects};
use retina_diagnosis::{AddedEffect, DiagnoseOptions, Diagnosis, Fit, diagnose, fit};
use retina_files::{InputError, hash_bytes, write_atomic};
use retina_geometry::Setup;
use retina_investigation::{Investigation, Options, investigate};
use tokio::sync::watch;

use crate::bench::{campaign_beside, measure};
use crate::failure::Refusal;
use crate::job::{self, Ended, Job, Kind, Watch};
use crate::state::{Model, State};

/// Fits and diagnoses that are kept, so that undo and blinking need no second fit.
const MOST_KEPT: usize = 16;
/// How the names of tables begin that the bench measured in addition.
const MEASURED: &str = "measured-";

/// Results by model, the latest last.
struct Kept<T>(Vec<(Model, Arc<T>)>);

impl<T> Kept<T> {
    fn get(&self, model: &Model) -> Option<Arc<T>> {
        self.0.iter().find(|(own, _)| own == model).map(|(_, value)| Arc::clone(value))
    }

    fn put(&mut self, model: Model, value: Arc<T>) {
        self.0.retain(|(own, _)| *own != model);
        if self.0.len() >= MOST_KEPT {
            self.0.remove(0);
        }
        self.0.push((model, value));
    }
}

struct Inner {
    state: State,
    material: Option<Arc<TableMaterial>>,
    /// What keeps the session from going on.
    problem: Option<Refusal>,
    job: Option<Job>,
    fits: Kept<Fit>,
    diagnoses: Kept<Diagnosis>,
    investigations: Kept<Investigation>,
}

/// See the module.
pub(crate) struct Session {
    pub(crate) id: String,
    pub(crate) folder: PathBuf,
    inner: Mutex<Inner>,
    /// Counts changes; windows wait for the next.
    revision: watch::Sender<u64>,
    /// Held by the job that runs.
    working: Mutex<()>,
    /// Held while the tables are read.
    reading: Mutex<()>,
    /// Held from the reading of the model to its change: two windows step one after the other.
    stepping: Mutex<()>,
}

/// Greater than those that an earlier server counted to: windows that stay open take its news as new.
fn first_revision() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    since.map_or(1, |since| since.as_millis() as u64)
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What a fault left behind is whole: every change is a single assignment.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Session {
    pub(crate) fn new(id: String, folder: PathBuf, state: State) -> Arc<Self> {
        let inner = Inner {
            state,
            material: None,
            problem: None,
            job: None,
            fits: Kept(Vec::new()),
            diagnoses: Kept(Vec::new()),
            investigations: Kept(Vec::new()),
        };
        Arc::new(Self {
            id,
            folder,
            inner: Mutex::new(inner),
            revision: watch::Sender::new(first_revision()),
            working: Mutex::new(()),
            reading: Mutex::new(()),
            stepping: Mutex::new(()),
        })
    }

    pub(crate) fn state(&self) -> State {
        lock(&self.inner).state.clone()
    }

    pub(crate) fn revision(&self) -> watch::Receiver<u64> {
        self.revision.subscribe()
    }

    fn changed(&self) {
        self.revision.send_modify(|revision| *revision += 1);
    }

    /// Changes what is kept, on the disk first.
    fn change(&self, change: impl FnOnce(&mut State)) -> Result<(), InputError> {
        let mut inner = lock(&self.inner);
        let mut state = inner.state.clone();
        change(&mut state);
        state.write(&self.folder)?;
        inner.state = state;
        drop(inner);
        self.changed();
        Ok(())
    }

    // ---- what is computed

    /// The tables with what they are compared with; read when they are first asked for.
    pub(crate) fn material(&self) -> Result<Arc<TableMaterial>, Refusal> {
        let _turn = lock(&self.reading);
        if let Some(material) = &lock(&self.inner).material {
            return Ok(Arc::clone(material));
        }
        let state = self.state();
        let setup = Setup::read(&state.setup)?;
        let calibration =
            state.calibration.as_ref().map(|path| GivenCalibration::read(path, &setup)).transpose()?;
        let campaign = state.tables.first().and_then(|table| campaign_beside(table, &setup));
        let tables = state.tables.clone();
        let measured = Measured::Files(state.tables);
        let mut material = Input { setup, measured, calibration, baseline: state.baseline }.table()?;
        if let Some(part) = material.data.fitted_part() {
            material.data = part;
        }
        if state.campaign.is_none()
            && let Some(campaign) = campaign
        {
            self.change(|state| state.campaign = Some(campaign))?;
        }
        let material = Arc::new(material);
        let mut inner = lock(&self.inner);
        // Tables that came or went while these were read are read at the next asking.
        if inner.state.tables == tables {
            inner.material = Some(Arc::clone(&material));
        }
        drop(inner);
        self.changed();
        Ok(material)
    }

    /// The effects of a model.
    pub(crate) fn added(&self, model: &Model, material: &TableMaterial) -> Result<Vec<AddedEffect>, Refusal> {
        let given: Vec<GivenEffect> =
            model.iter().map(|text| GivenEffect::Text(self.effect_text(text))).collect();
        Ok(added_effects(&given, &material.data)?)
    }

    /// As `--effect` takes it: files with formulas lie in the session's folder.
    pub(crate) fn effect_text(&self, text: &str) -> String {
        if is_own(text) { self.folder.join(text).display().to_string() } else { text.to_owned() }
    }

    /// The fit of a model.
    pub(crate) fn fit_of(&self, model: &Model) -> Result<Arc<Fit>, Refusal> {
        let material = self.material()?;
        if let Some(fit) = lock(&self.inner).fits.get(model) {
            return Ok(fit);
        }
        let added = self.added(model, &material)?;
        let result = Arc::new(fit(&material.data, &added)?);
        let mut inner = lock(&self.inner);
        if inner.material.as_ref().is_some_and(|own| Arc::ptr_eq(own, &material)) {
            inner.fits.put(model.clone(), Arc::clone(&result));
        }
        Ok(result)
    }

    /// The diagnosis of the model that is looked at, if it was made.
    pub(crate) fn diagnosis(&self) -> Option<Arc<Diagnosis>> {
        let inner = lock(&self.inner);
        inner.diagnoses.get(inner.state.model())
    }

    fn diagnose(&self) -> Result<(), Refusal> {
        if self.diagnosis().is_some() {
            return Ok(());
        }
        let (material, model) = (self.material()?, self.state().model().clone());
        let added = self.added(&model, &material)?;
        let result = diagnose(&material.data, &added, &DiagnoseOptions::default());
        let mut inner = lock(&self.inner);
        if inner.material.as_ref().is_some_and(|own| Arc::ptr_eq(own, &material)) {
            inner.diagnoses.put(model, Arc::new(result));
        }
        Ok(())
    }

    /// The formulas that were found beside the model that is looked at, if they were looked for.
    pub(crate) fn investigation(&self) -> Option<Arc<Investigation>> {
        let inner = lock(&self.inner);
        inner.investigations.get(inner.state.model())
    }

    fn investigate(&self, watch: &Watch) -> Result<(), Refusal> {
        let (material, model) = (self.material()?, self.state().model().clone());
        let added = self.added(&model, &material)?;
        let progress =
            |_: &str, share: f64| self.report(watch, Kind::Investigate, (100.0 * share) as usize, 100);
        let result = investigate(&material.data, &added, &Options::default(), &progress)?;
        watch.check();
        let mut inner = lock(&self.inner);
        if inner.material.as_ref().is_some_and(|own| Arc::ptr_eq(own, &material)) {
            inner.investigations.put(model, Arc::new(result));
        }
        Ok(())
    }

    // ---- jobs

    fn start(
        self: &Arc<Self>,
        kind: Kind,
        work: impl FnOnce(&Self, &Watch) -> Result<(), Refusal> + Send + 'static,
    ) {
        let watch = {
            let mut inner = lock(&self.inner);
            if let Some(job) = inner.job.take() {
                job.abandon();
            }
            inner.problem = None;
            let job = Job::new(kind);
            let watch = job.watch();
            inner.job = Some(job);
            watch
        };
        self.changed();
        let (session, own) = (Arc::clone(self), watch.clone());
        let thread = std::thread::Builder::new().stack_size(job::STACK_BYTES).spawn(move || {
            let ended = {
                let _turn = lock(&session.working);
                job::run(|| {
                    own.check();
                    work(&session, &own)
                })
            };
            session.ended(&own, ended);
        });
        if let Err(error) = thread {
            self.ended(
                &watch,
                Ended::Done(Err(Refusal::new(StatusCode::INSUFFICIENT_STORAGE, error.to_string()))),
            );
        }
    }

    fn ended(&self, watch: &Watch, ended: Ended<Result<(), Refusal>>) {
        let mut inner = lock(&self.inner);
        if inner.job.as_ref().is_none_or(|job| !watch.is_of(job)) {
            return;
        }
        inner.job = None;
        inner.problem = match ended {
            Ended::Done(Ok(())) | Ended::Abandoned => None,
            Ended::Done(Err(refusal)) => Some(refusal),
            Ended::Broken => Some(Refusal::new(
                StatusCode::INTERNAL_SERVER_ERROR,
                "the program failed here; its message is where it was started. This is a fault of the program",
            )),
        };
        drop(inner);
        self.changed();
    }

    /// Tells how far a job is; ends it where it is abandoned.
    fn report(&self, watch: &Watch, kind: Kind, done: usize, total: usize) {
        watch.check();
        if let Some(job) = lock(&self.inner).job.as_mut().filter(|job| watch.is_of(job)) {
            (job.kind, job.done, job.total) = (kind, done, total);
        }
        self.changed();
    }

    /// Data from the bench if they are not there yet; tables, fit and candidates.
    fn go_through(&self, watch: &Watch) -> Result<(), Refusal> {
        let state = self.state();
        if let Some(recipe) = &state.recipe {
            recipe.make(&self.folder, |done, total| self.report(watch, Kind::Bench, done, total))?;
        }
        self.report(watch, Kind::Read, 0, 0);
        self.fit_of(self.state().model())?;
        self.report(watch, Kind::Diagnose, 0, 0);
        self.diagnose()
    }

    /// Begins, where nothing has begun.
    pub(crate) fn wake(self: &Arc<Self>) {
        let idle = {
            let inner = lock(&self.inner);
            inner.material.is_none() && inner.job.is_none() && inner.problem.is_none()
        };
        if idle {
            self.look_again();
        }
    }

    /// Looks for candidates, from the beginning if need be.
    pub(crate) fn look_again(self: &Arc<Self>) {
        let kind = if lock(&self.inner).material.is_some() { Kind::Diagnose } else { Kind::Read };
        self.start(kind, Self::go_through);
    }

    /// Looks for a formula of what the model leaves.
    pub(crate) fn look_for_formula(self: &Arc<Self>) {
        if self.investigation().is_none() {
            self.start(Kind::Investigate, |session, watch| {
                session.report(watch, Kind::Investigate, 0, 100);
                session.investigate(watch)
            });
        }
    }

    /// Gives the job up.
    pub(crate) fn cancel(&self) {
        let mut inner = lock(&self.inner);
        if let Some(job) = inner.job.take() {
            job.abandon();
            if inner.material.is_none() {
                inner.problem = Some(Refusal::conflict("stopped"));
            }
        }
        drop(inner);
        self.changed();
    }

    // ---- what the page does

    /// Changes the model that is looked at, fits it and goes on to it; then candidates are looked for.
    pub(crate) fn go_on(self: &Arc<Self>, change: impl FnOnce(&mut Model)) -> Result<(), Refusal> {
        let _turn = lock(&self.stepping);
        let before = self.state().model().clone();
        let mut model = before.clone();
        change(&mut model);
        if model == before {
            return Ok(());
        }
        self.fit_of(&model)?;
        self.change(|state| state.push(model))?;
        self.look_again();
        Ok(())
    }

    /// Goes to a model that was tried.
    pub(crate) fn go_to(self: &Arc<Self>, at: usize) -> Result<(), Refusal> {
        let _turn = lock(&self.stepping);
        let state = self.state();
        let model = state.models.get(at).ok_or_else(|| Refusal::not_found("such model"))?;
        self.fit_of(model)?;
        self.change(|state| state.at = at)?;
        if self.diagnosis().is_none() {
            self.look_again();
        }
        Ok(())
    }

    /// A formula as it is typed: its name, if it fits the table.
    pub(crate) fn check_formula(&self, text: &str) -> Result<String, Refusal> {
        let material = self.material()?;
        let effect = AddedEffect::of_text("formula", text, &material.data)?;
        let name = effect.name().to_owned();
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
        if name.is_empty() || name.len() > 40 || !name.chars().all(plain) {
            return Err(InputError::new(Path::new("formula"), "the name cannot be a file's")
                .at("key `name`")
                .found(format!("`{name}`"))
                .expected("at most 40 letters, digits and `_`")
                .into());
        }
        retina_diagnosis::check_effects(&material.data, &[effect])?;
        Ok(name)
    }

    /// Keeps a formula as a file, and adds it to the model in place of one of its name.
    pub(crate) fn add_formula(self: &Arc<Self>, text: &str) -> Result<(), Refusal> {
        let name = self.check_formula(text)?;
        // Each version is a file of its own, so that undo finds the one that was fitted.
        let file = format!("effects/{name}-{}.toml", &hash_bytes(text.as_bytes())[..8]);
        let path = self.folder.join(&file);
        let folder = self.folder.join("effects");
        std::fs::create_dir_all(&folder)
            .and_then(|()| write_atomic(&path, text.as_bytes()))
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))?;
        self.go_on(|model| {
            model.retain(|own| effect_name(own) != name);
            model.push(file);
        })
    }

    /// The formula of an own effect.
    pub(crate) fn formula(&self, text: &str) -> Option<String> {
        std::fs::read_to_string(self.folder.join(text)).ok().filter(|_| is_own(text))
    }

    /// Whether the bench can take the measurement that is proposed.
    fn can_measure(&self) -> bool {
        let Some(action) = self.diagnosis().and_then(|found| Some(found.next.as_ref()?.action)) else {
            return false;
        };
        self.state().campaign.is_some_and(|campaign| campaign.under(action).is_some())
    }

    /// Takes the proposed measurement on the bench, and reads its data in.
    pub(crate) fn measure_next(self: &Arc<Self>) -> Result<(), Refusal> {
        let next = self.diagnosis().and_then(|found| found.next.clone());
        let next = next.ok_or_else(|| Refusal::conflict("no measurement is proposed"))?;
        let state = self.state();
        let campaign =
            state.campaign.ok_or_else(|| Refusal::conflict("these data did not come from the bench"))?;
        // Each measurement has a file, noise and places of its own, also after one was left out.
        let number = 1 + self.last_measured();
        let seed = campaign.seed + number as u64;
        let record = retina_campaign::PointsRecord { seed, ..campaign }
            .under(next.action)
            .ok_or_else(|| Refusal::conflict(format!("the bench cannot change this: {}", next.action)))?;
        let table = self.folder.join(format!("{MEASURED}{number}-{}.csv", next.action));
        let setup_file = state.setup;
        self.start(Kind::Bench, move |session, watch| {
            let setup = Setup::read(&setup_file)?;
            let total = record.exposures;
            measure(&record, &setup, &table, |done| session.report(watch, Kind::Bench, done, total))?;
            session.with_tables(|tables| tables.push(table.clone()))?;
            session.go_through(watch)
        });
        Ok(())
    }

    /// The greatest number of a table that the bench has measured in addition.
    fn last_measured(&self) -> usize {
        let files = std::fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let number = |name: String| name.strip_prefix(MEASURED)?.split('-').next()?.parse().ok();
        files.filter_map(|file| number(file.file_name().into_string().ok()?)).max().unwrap_or(0)
    }

    /// Leaves a table out that was measured in addition.
    pub(crate) fn leave_out(self: &Arc<Self>, table: usize) -> Result<(), Refusal> {
        if table == 0 || table >= self.state().tables.len() {
            return Err(Refusal::not_found("such added table"));
        }
        self.with_tables(|tables| {
            tables.remove(table);
        })?;
        self.look_again();
        Ok(())
    }

    fn with_tables(&self, change: impl FnOnce(&mut Vec<PathBuf>)) -> Result<(), InputError> {
        self.change(|state| change(&mut state.tables))?;
        let mut inner = lock(&self.inner);
        inner.material = None;
        (inner.fits, inner.diagnoses) = (Kept(Vec::new()), Kept(Vec::new()));
        inner.investigations = Kept(Vec::new());
        Ok(())
    }
}

/// Whether an effect of a model is a formula of one's own.
pub(crate) fn is_own(text: &str) -> bool {
    text.ends_with(".toml")
}

/// An effect's name: of one's own, without its file's folder and version.
pub(crate) fn effect_name(text: &str) -> &str {
    let Some(stem) = text.strip_suffix(".toml") else { return text };
    let stem = stem.rsplit('/').next().unwrap_or(stem);
    stem.rsplit_once('-').map_or(stem, |(name, _)| name)
}

pub(crate) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}
