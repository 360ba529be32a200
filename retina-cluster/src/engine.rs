//! The engines, and the files that each takes.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::plan::Plan;
use crate::script::{finish_script, task_script};

/// An engine that runs a plan's tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Job arrays of Slurm.
    Slurm,
    /// An array of HyperQueue.
    HyperQueue,
    /// Rules of Snakemake.
    Snakemake,
    /// An indexed job of Kubernetes.
    Kubernetes,
    /// This machine alone, by a shell script.
    Shell,
}

/// A file of a plan's folder.
pub(crate) struct PlanFile {
    pub(crate) name: String,
    pub(crate) text: String,
    pub(crate) runs: bool,
}

fn file(name: &str, text: String) -> PlanFile {
    PlanFile { name: name.to_owned(), text, runs: name.starts_with("submit") || name.ends_with(".sh") }
}

/// All files for a plan's engine. `dir` is the plan's folder, an absolute path.
pub(crate) fn files(plan: &Plan, dir: &Path) -> Vec<PlanFile> {
    let mut files = vec![file("task.sh", task_script(plan)), file("finish.sh", finish_script(plan))];
    files.extend(match plan.format {
        Format::Slurm => slurm(plan),
        Format::HyperQueue => {
            vec![file("submit.sh", hyperqueue(plan)), file("submit.py", hyperqueue_python(plan))]
        }
        Format::Snakemake => snakemake(plan),
        Format::Kubernetes => kubernetes(plan, dir),
        Format::Shell => vec![file("submit.sh", shell(plan))],
    });
    files
}

/// Tasks of one array: Slurm's own default allows 1001.
const SLURM_ARRAY: usize = 1000;

fn slurm(plan: &Plan) -> Vec<PlanFile> {
    let (shards, cpus) = (plan.shards, plan.cpus);
    let head = format!(
        "#!/bin/sh\n#SBATCH --job-name=retina\n#SBATCH --cpus-per-task={cpus}\n#SBATCH --requeue\n#SBATCH --open-mode=append\n"
    );
    let submit = format!(
        r#"#!/bin/sh
# Submits all shards to Slurm, and after them what joins them. Submit again after a failure: what is done stays.
# Partition, account and time limit: SBATCH_PARTITION, SBATCH_ACCOUNT and SBATCH_TIMELIMIT in the environment.
set -eu
cd "$(dirname "$0")"
jobs=
first=0
while [ "$first" -lt {shards} ]; do
    last=$((first + {most}))
    [ "$last" -lt {shards} ] || last={end}
    job=$(sbatch --parsable --chdir="$PWD" --export="ALL,FIRST=$first" --array="0-$((last - first))" array.sbatch)
    jobs="$jobs:${{job%%;*}}"
    first=$((last + 1))
done
sbatch --chdir="$PWD" --dependency="afterok$jobs" --kill-on-invalid-dep=yes finish.sbatch
"#,
        most = SLURM_ARRAY - 1,
        end = shards - 1,
    );
    vec![
        file("submit.sh", submit),
        file(
            "array.sbatch",
            format!(
                "{head}#SBATCH --output=logs/%A_%a.log\nexec ./task.sh \"$((${{FIRST:-0}} + SLURM_ARRAY_TASK_ID))\"\n"
            ),
        ),
        file("finish.sbatch", format!("{head}#SBATCH --output=logs/finish_%j.log\nexec ./finish.sh\n")),
    ]
}

fn hyperqueue(plan: &Plan) -> String {
    format!(
        r#"#!/bin/sh
# Submits all shards to HyperQueue's server, waits, and joins them. Submit again after a failure: what is done stays.
set -eu
cd "$(dirname "$0")"
hq submit --name retina --array 0-{last} --cpus {cpus} --crash-limit 10 --stdout 'logs/%{{TASK_ID}}.log' --stderr none --wait \
    -- sh -c 'exec ./task.sh "$HQ_TASK_ID" 2>&1'
./finish.sh
"#,
        last = plan.shards - 1,
        cpus = plan.cpus,
    )
}

fn hyperqueue_python(plan: &Plan) -> String {
    format!(
        r#"#!/usr/bin/env python3
"""Runs all shards by HyperQueue's Python package (PyPI `hyperqueue`) and joins them. Run it again after a failure: what is
done stays.

./submit.py FOLDER   on the server whose folder it is (`hq server start --server-dir FOLDER`)
./submit.py          on this machine alone
"""

import os
import sys

from hyperqueue import Client, Job, LocalCluster
from hyperqueue.cluster import WorkerConfig
from hyperqueue.ffi.protocol import ResourceRequest

SHARDS, CPUS = {shards}, {cpus}


def run(client):
    job = Job(max_fails=None, name="retina")
    shards = [
        job.program(["./task.sh", str(shard)], cwd=".", stdout=f"logs/{{shard}}.out", stderr=f"logs/{{shard}}.log",
                    resources=ResourceRequest(cpus=CPUS), crash_limit=10)
        for shard in range(SHARDS)
    ]
    job.program(["./finish.sh"], cwd=".", stdout="logs/finish.out", stderr="logs/finish.log", deps=shards, crash_limit=10)
    client.wait_for_jobs([client.submit(job)])


os.chdir(os.path.dirname(os.path.abspath(__file__)))
if len(sys.argv) > 1:
    run(Client(sys.argv[1]))
else:
    with LocalCluster() as cluster:
        cluster.start_worker(WorkerConfig(cores=max(CPUS, os.cpu_count())))
        run(cluster.client())
"#,
        shards = plan.shards,
        cpus = plan.cpus,
    )
}

fn snakemake(plan: &Plan) -> Vec<PlanFile> {
    let rules = format!(
        r#"# All shards, and after them what joins them. The marks say that a task has ended well; frames are counted by
# `retina status`, not by Snakemake.
rule all:
    input: "marks/finished"

rule shard:
    output: touch("marks/{{shard}}.done")
    log: "logs/{{shard}}.log"
    threads: {cpus}
    retries: 3
    shell: "./task.sh {{wildcards.shard}} > {{log}} 2>&1"

rule finish:
    input: expand("marks/{{shard}}.done", shard=range({shards}))
    output: touch("marks/finished")
    log: "logs/finish.log"
    shell: "./finish.sh > {{log}} 2>&1"
"#,
        cpus = plan.cpus,
        shards = plan.shards,
    );
    let submit = r#"#!/bin/sh
# Runs Snakemake with the arguments given, on all cores of this machine where there are none. On a cluster:
# ./submit.sh --executor slurm --jobs 100
set -eu
cd "$(dirname "$0")"
[ $# -gt 0 ] || set -- --cores all
exec snakemake --keep-going --rerun-incomplete "$@"
"#;
    vec![file("Snakefile", rules), file("submit.sh", submit.to_owned())]
}

fn shell(plan: &Plan) -> String {
    format!(
        r#"#!/bin/sh
# Runs all shards on this machine, JOBS at a time (one where it is not set), and joins them. Run it again after a
# failure: what is done stays.
set -eu
cd "$(dirname "$0")"
number=0
while [ "$number" -lt {shards} ]; do
    echo "$number"
    number=$((number + 1))
done | xargs -P "${{JOBS:-1}}" -I '{{}}' sh -c './task.sh {{}} >> logs/{{}}.log 2>&1 || {{ echo "shard {{}} failed: logs/{{}}.log" >&2; exit 1; }}'
./finish.sh
"#,
        shards = plan.shards,
    )
}

fn kubernetes(plan: &Plan, dir: &Path) -> Vec<PlanFile> {
    let above =
        plan.source.ancestors().skip(1).find(|folder| dir.starts_with(folder)).unwrap_or(Path::new("/"));
    // A JSON text is a YAML one, whatever the path has in it.
    let text = |path: &Path| serde_json::Value::from(path.to_string_lossy()).to_string();
    let (work, shared) = (text(dir), text(above));
    let pod = |indent: &str, script: &str| {
        [
            "restartPolicy: Never".to_owned(),
            "containers:".into(),
            "  - name: retina".into(),
            "    image: retina:latest           # built from the Containerfile".into(),
            format!("    workingDir: {work}"),
            format!("    command: [\"/bin/sh\", \"-c\", {script}]"),
            "    env: [{ name: RETINA, value: retina }]".into(),
            format!("    resources: {{ requests: {{ cpu: \"{}\" }} }}", plan.cpus),
            format!("    volumeMounts: [{{ name: shared, mountPath: {shared} }}]"),
            "volumes:".into(),
            "  - name: shared".into(),
            "    persistentVolumeClaim: { claimName: retina }".into(),
        ]
        .map(|line| format!("{indent}{line}\n"))
        .concat()
    };
    let job = format!(
        r#"# All shards as one indexed job. The claim `retina` is a volume that every node can write; it must show the scene and
# this folder under the same paths as here.
apiVersion: batch/v1
kind: Job
metadata: {{ name: retina-shards }}
spec:
  completionMode: Indexed
  completions: {shards}
  parallelism: {parallel}
  backoffLimitPerIndex: 10
  template:
    spec:
{pod}"#,
        shards = plan.shards,
        parallel = plan.shards.min(100),
        pod = pod("      ", r#""exec ./task.sh $JOB_COMPLETION_INDEX""#),
    );
    let finish = format!(
        "apiVersion: batch/v1\nkind: Job\nmetadata: {{ name: retina-finish }}\nspec:\n  backoffLimit: 3\n  template:\n    spec:\n{}",
        pod("      ", r#""exec ./finish.sh""#),
    );
    let container = "# podman build -t retina:latest -f Containerfile FOLDER, where FOLDER holds the command `retina`\n\
                     FROM docker.io/library/debian:12-slim\n\
                     COPY retina /usr/local/bin/retina\n";
    let submit = r#"#!/bin/sh
# Runs all shards, waits, and joins them. Run it again after a failure: what is done stays.
set -eu
cd "$(dirname "$0")"
kubectl delete --ignore-not-found job retina-shards retina-finish
kubectl apply -f shards.yaml
kubectl wait --for=condition=complete --timeout="${TIMEOUT:-168h}" job/retina-shards
kubectl apply -f finish.yaml
kubectl wait --for=condition=complete --timeout="${TIMEOUT:-168h}" job/retina-finish
"#;
    vec![
        file("shards.yaml", job),
        file("finish.yaml", finish),
        file("Containerfile", container.to_owned()),
        file("submit.sh", submit.to_owned()),
    ]
}
