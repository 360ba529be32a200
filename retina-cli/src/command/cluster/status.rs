//! `retina status`.

use std::path::{Path, PathBuf};

use retina::cluster::{Plan, PlanState, ShardState, StateOfShard};
use retina_batch::FolderState;
use retina_files::InputError;
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::output::{print_json, print_lines};

/// Most shards that are named one by one.
const MOST_LINES: usize = 40;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folder of a plan, or of frames.
    dir: PathBuf,
    /// Hold every file to its hash; else it only has to be there and not empty.
    #[arg(long)]
    verify: bool,
    /// Exit with code 2 if something is missing or torn.
    #[arg(long)]
    complete: bool,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { dir, verify, complete, json } = arguments;
    let (document, lines) = if let Some(plan) = Plan::read(dir)? {
        let state = PlanState::read(&plan, dir, *verify)?;
        (plan_document(dir, &plan, &state, *verify), plan_lines(&plan, &state))
    } else if let Some(state) = FolderState::read(dir, *verify)? {
        (folder_document(dir, &state, *verify), folder_lines(&state))
    } else {
        return Err(InputError::new(dir, "holds neither a plan nor frames")
            .expected("a folder that `retina plan`, `retina render` or `retina merge` wrote")
            .into());
    };
    if *json {
        print_json(&document)?;
    } else {
        print_lines(&lines)?;
    }
    if *complete && document["complete"] != true {
        return Err(InputError::new(
            dir,
            format!("{} are missing", document["unit"].as_str().unwrap_or("items")),
        )
        .found(format!("{} of {}", document["done"], document["items"]))
        .help("run the tasks of the shards that are not done again")
        .into());
    }
    Ok(())
}

fn plan_document(dir: &Path, plan: &Plan, state: &PlanState, verified: bool) -> Value {
    let shards: Vec<Value> = state
        .shards
        .iter()
        .map(|shard| {
            json!({
                "shard": shard.shard,
                "state": shard.state.name(),
                "items": shard.items,
                "done": shard.done,
                "torn": shard.torn,
                "missing": shard.missing(),
                "seconds_per_item": shard.seconds_per_item,
                "quiet_s": shard.quiet_s,
            })
        })
        .collect();
    json!({
        "schema": "retina.status/1",
        "dir": dir,
        "kind": "plan",
        "source": plan.source,
        "unit": plan.work.unit(),
        "items": plan.items,
        "done": state.sum(|shard| shard.done),
        "torn": state.sum(|shard| shard.torn),
        "missing": state.sum(ShardState::missing),
        "slow": state.count(StateOfShard::Slow),
        "complete": state.is_complete(),
        "merged": state.merged,
        "verified": verified,
        "shards": shards,
    })
}

fn plan_lines(plan: &Plan, state: &PlanState) -> Vec<String> {
    let unit = plan.work.unit();
    let mut lines = vec![
        format!("{} {unit} of {} in {} shards", plan.items, plan.source.display(), plan.shards),
        format!(
            "{} done, {} torn, {} missing",
            state.sum(|shard| shard.done),
            state.sum(|shard| shard.torn),
            state.sum(ShardState::missing)
        ),
    ];
    let states = [
        StateOfShard::Done,
        StateOfShard::Running,
        StateOfShard::Slow,
        StateOfShard::Stopped,
        StateOfShard::Waiting,
    ];
    let counts = states.map(|of| (state.count(of), of.name()));
    let told: Vec<String> = counts
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, name)| format!("{count} {name}"))
        .collect();
    lines.push(format!("shards: {}", told.join(", ")));
    if let Some(merged) = state.merged {
        lines.push(format!("{merged} of {} {unit} are joined in merged", plan.items));
    }
    let open: Vec<&ShardState> =
        state.shards.iter().filter(|shard| shard.state != StateOfShard::Done).collect();
    if !open.is_empty() {
        lines.push(String::new());
        lines.push("shard  state      done   of  torn  s each  s since the last".to_owned());
    }
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.1}"));
    for shard in open.iter().take(MOST_LINES) {
        lines.push(format!(
            "{:5}  {:8} {:6}{:5}{:6}{:>8}{:>18}",
            shard.shard,
            shard.state.name(),
            shard.done,
            shard.items,
            shard.torn,
            number(shard.seconds_per_item),
            number(shard.quiet_s)
        ));
    }
    if open.len() > MOST_LINES {
        lines.push(format!("and {} more: --json names them all", open.len() - MOST_LINES));
    }
    lines
}

fn folder_document(dir: &Path, state: &FolderState, verified: bool) -> Value {
    let missing = state.frames_of_sequence - state.done.len() - state.torn.len();
    json!({
        "schema": "retina.status/1",
        "dir": dir,
        "kind": "frames",
        "unit": "frames",
        "items": state.frames_of_sequence,
        "done": state.done.len(),
        "torn": state.torn.len(),
        "missing": missing,
        "complete": state.done.len() == state.frames_of_sequence,
        "in_use": state.in_use,
        "seconds_per_item": state.seconds_per_frame,
        "verified": verified,
        "torn_frames": state.torn,
    })
}

fn folder_lines(state: &FolderState) -> Vec<String> {
    let all = state.frames_of_sequence;
    let mut lines = vec![format!(
        "{} of the sequence's {all} frames are done, {} torn, {} missing{}",
        state.done.len(),
        state.torn.len(),
        all - state.done.len() - state.torn.len(),
        if state.in_use { "; a run is at work" } else { "" }
    )];
    if let Some(first) = state.torn.first() {
        lines.push(format!("torn: frame {first}, for one; `retina render --resume` makes it again"));
    }
    lines
}
