"""Runs a plan on real engines while tasks are killed at random: nothing may be lost, and the bytes are those of one run.

    validation/cluster_engines.py WORK [--engines shell,hyperqueue,snakemake,slurm] [--frames 60] [--shards 12]
                                  [--kills 8] [--seed 1]

`hyperqueue` and `snakemake` are Python packages (requirements-cluster.txt). `slurm` is Debian's (apt-get install slurm-wlm
munge); the program configures one node and starts the daemons, as root, with its state under WORK.
"""

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RETINA = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release" / "retina"


def say(*words):
    print(*words, file=sys.stderr, flush=True)


def scene(work, frames):
    """LUMIO's Moon over the same days in fewer frames."""
    text = (ROOT / "assets/scenarios/lumio.toml").read_text()
    text = text.replace("../", f"{ROOT}/assets/")
    text = text.replace("frames = 4321, step_s = 300.0", f"frames = {frames}, step_s = {4320 * 300 / (frames - 1)!r}")
    path = work / "scene.toml"
    path.write_text(text)
    return path


def contents(folder):
    """Hash of each file of frames and truth, and of the record."""
    files = sorted(p for kind in ("frames", "truth") for p in (folder / kind).iterdir()) + [folder / "batch.json"]
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def renderers():
    """Processes that render a shard."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if len(words) > 2 and words[0].endswith(b"retina") and words[1] == b"render" and b"--shard" in words:
                found.append(int(entry.name))
    return found


class Killer(threading.Thread):
    """Kills renderers, without a warning, at random times."""

    def __init__(self, kills, seed):
        super().__init__(daemon=True)
        self.left, self.random, self.done, self.over = kills, random.Random(seed), 0, False

    def run(self):
        while self.done < self.left and not self.over:
            time.sleep(self.random.uniform(0.5, 4.0))
            found = renderers()
            if found:
                try:
                    os.kill(self.random.choice(found), signal.SIGKILL)
                    self.done += 1
                except ProcessLookupError:
                    pass


def run(words, **options):
    return subprocess.run([str(word) for word in words], check=False, **options)


def status(plan):
    return json.loads(run([RETINA, "status", plan, "--json", "--verify"], capture_output=True).stdout)


class Slurm:
    """One node of this machine. The configuration is the least that works without cgroups."""

    def __init__(self, work):
        self.work = work / "slurm"
        self.work.mkdir(exist_ok=True)
        host = os.uname().nodename
        conf = self.work / "slurm.conf"
        conf.write_text(
            f"""ClusterName=one
SlurmctldHost={host}(127.0.0.1)
AuthType=auth/munge
SlurmUser=root
SlurmdUser=root
StateSaveLocation={self.work}/state
SlurmdSpoolDir={self.work}/spool
SlurmctldPidFile={self.work}/slurmctld.pid
SlurmdPidFile={self.work}/slurmd.pid
SlurmctldLogFile={self.work}/slurmctld.log
SlurmdLogFile={self.work}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_interval=1
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={os.cpu_count()} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""
        )
        os.environ["SLURM_CONF"] = str(conf)
        Path("/run/munge").mkdir(exist_ok=True)
        shutil.chown("/run/munge", "munge", "munge")
        if run(["pgrep", "-x", "munged"], capture_output=True).returncode != 0:
            run(["runuser", "-u", "munge", "--", "/usr/sbin/munged"])
        for folder in ("state", "spool"):
            (self.work / folder).mkdir(exist_ok=True)
        self.daemons = [
            subprocess.Popen([f"/usr/sbin/{name}", "-D"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            for name in ("slurmctld", "slurmd")
        ]
        for _ in range(60):
            time.sleep(0.5)
            if b"idle" in run(["sinfo", "-h", "-o", "%T"], capture_output=True).stdout:
                return
        sys.exit(f"error: Slurm has no idle node; see {self.work}/slurmctld.log")

    def submit(self, plan):
        if run([plan / "submit.sh"], stdout=subprocess.DEVNULL).returncode != 0:
            return 1
        while run(["squeue", "-h"], capture_output=True).stdout.strip():
            time.sleep(1)
        return 0

    def stop(self):
        for daemon in reversed(self.daemons):
            daemon.terminate()
            daemon.wait()


def attempt(engine, plan, slurm):
    # A renderer that is killed is tried again by its own task, at first; then the plan is submitted again.
    if engine == "slurm":
        return slurm.submit(plan)
    script = {"hyperqueue": [sys.executable, "submit.py"], "snakemake": ["submit.sh"], "shell": ["submit.sh"]}[engine]
    words = [word if word == sys.executable else plan / word for word in script]
    log = (plan / "logs/submit.log").open("a")
    environment = {**os.environ, "JOBS": "2", "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    return run(words, stdout=log, stderr=log, env=environment).returncode


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", type=Path)
    parser.add_argument("--engines", default="shell,hyperqueue,snakemake,slurm")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--shards", type=int, default=12)
    parser.add_argument("--kills", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    work = options.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    path = scene(work, options.frames)
    whole = work / "whole"
    say("one run, for comparison")
    begin = time.monotonic()
    run([RETINA, "render", path, "--backend", "native", "--quality", "draft", "--out", whole, "--resume"], capture_output=True)
    say(f"{time.monotonic() - begin:.0f} s")
    wanted = contents(whole)
    print("| engine | frames | shards | renderers killed | submitted | torn or missing at the end | same bytes as one run | s |")
    print("|---|---|---|---|---|---|---|---|")
    bad = False
    for engine in options.engines.split(","):
        plan = work / engine
        shutil.rmtree(plan, ignore_errors=True)
        run([RETINA, "plan", path, "--shards", options.shards, "--format", engine, "--quality", "draft", "--cpus", 1,
             "--out", plan], capture_output=True)
        slurm = Slurm(work) if engine == "slurm" else None
        # Tasks give up at once, so that the engine and the second submission have something to do.
        os.environ["ATTEMPTS"] = "1" if engine in ("shell", "slurm", "hyperqueue") else "2"
        killer = Killer(options.kills, options.seed)
        killer.start()
        begin, submitted = time.monotonic(), 0
        while submitted < options.kills + 2:
            submitted += 1
            attempt(engine, plan, slurm)
            found = status(plan)
            if found["complete"] and found["merged"] == options.frames:
                break
            say(f"{engine}: after submission {submitted}: {found['done']} done, {found['torn']} torn, {found['missing']} missing")
        killer.over = True
        seconds = time.monotonic() - begin
        if slurm:
            slurm.stop()
        same = (plan / "merged").exists() and contents(plan / "merged") == wanted
        left = found["torn"] + found["missing"]
        bad |= not same or left > 0
        print(f"| {engine} | {found['done']} | {options.shards} | {killer.done} | {submitted} | {left} | {'yes' if same else 'NO'} | {seconds:.0f} |", flush=True)
    sys.exit(bad)


if __name__ == "__main__":
    main()
