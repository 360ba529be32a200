//! What every engine runs: one shard, and what joins them.

use std::fmt::Write as _;

use crate::plan::{Plan, Work};

/// A word of a shell, whatever is in it.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// A comment holds no line end, and paths have none.
fn head(plan: &Plan) -> String {
    format!(
        "retina=${{RETINA:-{command}}}\ncommand -v \"$retina\" >/dev/null 2>&1 || {{ echo \"$retina is not there: retina of the PATH is taken\" >&2; retina=retina; }}\nexport RAYON_NUM_THREADS=\"${{RAYON_NUM_THREADS:-{cpus}}}\"\n",
        command = quoted(&plan.command),
        cpus = plan.cpus,
    )
}

/// The command of a campaign, whose shards and whole write into one folder.
fn campaign(plan: &Plan) -> String {
    let name = match plan.work {
        Work::Scene => "render",
        Work::FarRange => "navigate far-range",
        Work::FullDisk => "navigate full-disk",
        Work::Flashes => "navigate flashes",
        Work::Runs => "runs",
    };
    let source = quoted(&plan.source.to_string_lossy());
    let mut text = format!("{name} {source} --out {}", plan.work.results());
    if let Some(backend) = &plan.backend {
        let _ = write!(text, " --backend {backend}");
    }
    text
}

/// `task.sh`: makes one shard, however often it is started.
pub(crate) fn task_script(plan: &Plan) -> String {
    let source = quoted(&plan.source.to_string_lossy());
    let shards = plan.shards;
    let run = match plan.work {
        Work::Scene => {
            let mut run = format!(
                r#"render {source} --out "$(printf 'shards/%05d' "$shard")" --shard "$shard/{shards}" --resume"#
            );
            for (option, value) in [("backend", &plan.backend), ("quality", &plan.quality)] {
                if let Some(value) = value {
                    let _ = write!(run, " --{option} {value}");
                }
            }
            run
        }
        _ => format!(r#"{} --shard "$shard/{shards}""#, campaign(plan)),
    };
    format!(
        r#"#!/bin/sh
# Makes one shard: ./task.sh NUMBER, from 0 to {last}. It may be killed and started again: what is done stays.
# RETINA names the command `retina`, ATTEMPTS says how often it is tried (3), RAYON_NUM_THREADS how many cores it takes.
set -u
shard=${{1:?give the number of a shard, 0 to {last}}}
case $shard in *[!0-9]*) shard={shards} ;; esac
[ "$shard" -lt {shards} ] || {{ echo "there is no shard $1: give a number from 0 to {last}" >&2; exit 2; }}
cd "$(dirname "$0")" || exit 2
{head}attempt=1
while :; do
    "$retina" {run} && exit 0
    status=$?
    [ "$attempt" -lt "${{ATTEMPTS:-3}}" ] || exit "$status"
    attempt=$((attempt + 1))
    sleep "$attempt"
done
"#,
        last = shards - 1,
        head = head(plan),
    )
}

/// `finish.sh`: joins what the shards have made.
pub(crate) fn finish_script(plan: &Plan) -> String {
    let (check, run) = match plan.work {
        Work::Scene => ("", "merge shards/* --out merged".to_owned()),
        Work::Runs => ("", format!("{} --collect", campaign(plan))),
        // Their own command would make what is missing here.
        _ => ("\"$retina\" status . --complete >/dev/null\n", campaign(plan)),
    };
    format!(
        "#!/bin/sh\n# Joins what the shards have made. It refuses as long as something is missing.\nset -eu\ncd \"$(dirname \"$0\")\"\n{head}{check}exec \"$retina\" {run}\n",
        head = head(plan),
    )
}
