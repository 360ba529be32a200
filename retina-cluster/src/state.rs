//! How far a plan is: what is done, torn, missing and slow.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use retina_batch::{FolderState, Shard};
use retina_experiments::experiment::{busy_folders, torn_in_part};
use retina_experiments::lines::list_name;
use retina_experiments::{flashes, full_disk};
use retina_files::{InputError, read_bytes};

use crate::plan::{Plan, Work};
use crate::runs::{Runs, run_folder};

/// A shard that takes this many times the median time for a frame is slow.
const SLOW: f64 = 2.0;
/// A shard whose last frame is older than this many of its own frames, and than [`QUIET_S`], has stopped.
const QUIET_FRAMES: f64 = 20.0;
const QUIET_S: f64 = 120.0;

/// What a shard is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StateOfShard {
    /// All is there.
    Done,
    /// Nothing is there yet.
    Waiting,
    /// It is at work.
    Running,
    /// It is at work, and takes more than twice as long for a frame as the others.
    Slow,
    /// It has begun, and is not at work.
    Stopped,
}

impl StateOfShard {
    /// In one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Waiting => "waiting",
            Self::Running => "running",
            Self::Slow => "slow",
            Self::Stopped => "stopped",
        }
    }
}

/// A shard.
#[derive(Debug, Clone, PartialEq)]
pub struct ShardState {
    /// Its number.
    pub shard: usize,
    /// Frames or poses that it is to make.
    pub items: usize,
    /// Of those, how many are whole.
    pub done: usize,
    /// Of those, how many are named as finished and are not whole.
    pub torn: usize,
    /// What it is doing.
    pub state: StateOfShard,
    /// Median time between the ends of two frames, s.
    pub seconds_per_item: Option<f64>,
    /// Time since the last one ended, s.
    pub quiet_s: Option<f64>,
}

impl ShardState {
    /// What is neither done nor torn.
    pub fn missing(&self) -> usize {
        self.items - self.done - self.torn
    }
}

/// A plan's shards.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanState {
    /// In the order of their numbers.
    pub shards: Vec<ShardState>,
    /// Of a scene: frames in the joined folder.
    pub merged: Option<usize>,
}

impl PlanState {
    /// Looks at a plan's folder. With `verify` every file is held to its hash.
    ///
    /// # Errors
    /// A shard's folder cannot be read.
    pub fn read(plan: &Plan, dir: &Path, verify: bool) -> Result<Self, InputError> {
        let now = SystemTime::now();
        let mut shards = (0..plan.shards)
            .map(|shard| match plan.work {
                Work::Scene => scene_shard(plan, dir, shard, verify, now),
                Work::FarRange => list_shard(plan, dir, shard, "poses", verify, now),
                Work::FullDisk => list_shard(plan, dir, shard, full_disk::LAST_LIST, verify, now),
                Work::Flashes => list_shard(plan, dir, shard, flashes::LAST_LIST, verify, now),
                Work::Runs => Ok(runs_shard(plan, dir, shard, now)),
            })
            .collect::<Result<Vec<_>, InputError>>()?;
        let mut rates: Vec<f64> = shards.iter().filter_map(|shard| shard.seconds_per_item).collect();
        rates.sort_by(f64::total_cmp);
        if let Some(median) = rates.get(rates.len() / 2) {
            for shard in &mut shards {
                if shard.state == StateOfShard::Running
                    && shard.seconds_per_item.is_some_and(|own| own > SLOW * median)
                {
                    shard.state = StateOfShard::Slow;
                }
            }
        }
        let merged = match plan.work {
            Work::Scene => FolderState::read(&dir.join("merged"), verify)?.map(|found| found.done.len()),
            _ => None,
        };
        Ok(Self { shards, merged })
    }

    /// A count over all shards.
    pub fn sum(&self, of: impl Fn(&ShardState) -> usize) -> usize {
        self.shards.iter().map(of).sum()
    }

    /// How many shards are in a state.
    pub fn count(&self, state: StateOfShard) -> usize {
        self.shards.iter().filter(|shard| shard.state == state).count()
    }

    /// Whether all shards are done.
    pub fn is_complete(&self) -> bool {
        self.count(StateOfShard::Done) == self.shards.len()
    }
}

fn scene_shard(
    plan: &Plan,
    dir: &Path,
    shard: usize,
    verify: bool,
    now: SystemTime,
) -> Result<ShardState, InputError> {
    let items = plan.items_of(shard);
    let Some(found) = FolderState::read(&dir.join(plan.shard_folder(shard)), verify)? else {
        return Ok(ShardState {
            shard,
            items,
            done: 0,
            torn: 0,
            state: StateOfShard::Waiting,
            seconds_per_item: None,
            quiet_s: None,
        });
    };
    let own = |frames: &[usize]| plan.numbers_of(shard).filter(|n| frames.binary_search(n).is_ok()).count();
    let (done, torn) = (own(&found.done), own(&found.torn));
    let seconds_per_item = found.seconds_per_frame;
    let quiet_s = found.last_finished.and_then(|last| Some(now.duration_since(last).ok()?.as_secs_f64()));
    let at_work = found.in_use || is_recent(quiet_s, seconds_per_item);
    let state = state_of(items, done, torn, at_work);
    Ok(ShardState { shard, items, done, torn, state, seconds_per_item, quiet_s })
}

/// A lock cannot be seen from another machine; a frame that has just ended can.
fn is_recent(quiet_s: Option<f64>, seconds_per_item: Option<f64>) -> bool {
    quiet_s.is_some_and(|quiet| quiet < QUIET_S.max(QUIET_FRAMES * seconds_per_item.unwrap_or(0.0)))
}

fn state_of(items: usize, done: usize, torn: usize, at_work: bool) -> StateOfShard {
    match () {
        () if done == items => StateOfShard::Done,
        () if at_work => StateOfShard::Running,
        () if done + torn == 0 => StateOfShard::Waiting,
        () => StateOfShard::Stopped,
    }
}

/// A shard whose results are lines of a list: a first line that says whose they are, then one a pose or frame. A last line
/// that was cut short is torn, and with `verify` a frame whose files are not what they were. Before its list a shard of frames renders and photographs them.
fn list_shard(
    plan: &Plan,
    dir: &Path,
    shard: usize,
    stem: &str,
    verify: bool,
    now: SystemTime,
) -> Result<ShardState, InputError> {
    let items = plan.items_of(shard);
    let results = dir.join(plan.work.results());
    let part = Shard { index: shard, count: plan.shards };
    let path = results.join(list_name(stem, Some(part)));
    let (mut done, mut torn) = (0, 0);
    if path.exists() {
        let text = read_bytes(&path)?;
        done = text.iter().filter(|byte| **byte == b'\n').count().saturating_sub(1).min(items);
        torn = usize::from(text.last().is_some_and(|byte| *byte != b'\n')).min(items - done);
    }
    if verify {
        let damaged = torn_in_part(&results, part)?.len().min(items);
        done = done.min(items - damaged);
        torn = torn.max(damaged);
    }
    let quiet_s = age_s(std::iter::once(path).chain(busy_folders(&results, part)), now);
    let begun = quiet_s.is_some();
    let state = match state_of(items, done, torn, is_recent(quiet_s, None)) {
        StateOfShard::Waiting if begun => StateOfShard::Stopped,
        state => state,
    };
    Ok(ShardState { shard, items, done, torn, state, seconds_per_item: None, quiet_s })
}

/// A shard of runs, each in a folder of its own.
fn runs_shard(plan: &Plan, dir: &Path, shard: usize, now: SystemTime) -> ShardState {
    let (items, results) = (plan.items_of(shard), dir.join(plan.work.results()));
    let done = Runs::done_in(&results, plan.numbers_of(shard));
    let quiet_s = age_s(plan.numbers_of(shard).map(|number| results.join(run_folder(number))), now);
    let state = match state_of(items, done, 0, is_recent(quiet_s, None)) {
        StateOfShard::Waiting if quiet_s.is_some() => StateOfShard::Stopped,
        state => state,
    };
    ShardState { shard, items, done, torn: 0, state, seconds_per_item: None, quiet_s }
}

/// Time since the last of these files or folders changed, s; `None` where there is none.
fn age_s(paths: impl Iterator<Item = PathBuf>, now: SystemTime) -> Option<f64> {
    let last = paths.filter_map(|path| fs::metadata(path).ok()?.modified().ok()).max()?;
    Some(now.duration_since(last).ok()?.as_secs_f64())
}
