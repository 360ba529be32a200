"""How fast RETINA is on this machine: one command, one table.

    python3 validation/speed.py [--peers] [--only PART] [--out DIR]

It builds the examples and benches that measure, runs them one after another, and prints a table in Markdown: what was
found, the target, and how many times it is reached. `--peers` adds other programs where they are installed, each beside
RETINA in the same run: Blender Cycles (`validation/setup.sh`, Blender itself) and Optiland (`out/venv-optics`, see
README.md). Needs cargo, and nothing from PyPI. Exit code 0 done, 2 where something could not be run.
"""

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


@dataclass
class Figure:
    """One row: what `pattern` finds in a program's output."""

    name: str
    pattern: str
    unit: str
    target: float | None = None
    more_is_better: bool = False
    scale: float = 1.0

    def found(self, text):
        match = re.search(self.pattern, text)
        return match and self.scale * float(match.group(1))

    def times_reached(self, value):
        if self.target is None:
            return None
        return value / self.target if self.more_is_better else self.target / value


@dataclass
class Part:
    """A program that measures, and what is read from it."""

    name: str
    crate: str
    program: str
    kind: str
    arguments: tuple
    figures: tuple


PARTS = (
    Part(
        "renderer",
        "retina-render",
        "renderers",
        "example",
        ("--fast",),
        (
            Figure("Moon of 1920 x 1200, `draft`", r"native Draft\S* \S+ +(\S+) s", "s a frame"),
            Figure("Moon of 1920 x 1200, `default`", r"native Default\S* \S+ +(\S+) s", "s a frame", 0.4),
            Figure("the same, processor time", r"native Default.* (\S+) CPU s", "s a frame"),
            Figure("Moon of 1920 x 1200, `best`", r"native Best\S* \S+ +(\S+) s", "s a frame", 3.0),
        ),
    ),
    Part(
        "bench",
        "retina-bench",
        "speed",
        "example",
        (),
        (
            Figure("bench built", r"build: (\S+) s", "s", 1.0),
            Figure("300 points photographed", r"300 points: (\S+) frames/s", "frames a second", 100.0, True),
            Figure("disc of 1120 px photographed", r"disc of 1120 px: (\S+) frames/s", "frames a second", 10.0, True),
        ),
    ),
    Part(
        "detection",
        "retina-image",
        "detect_speed",
        "example",
        (),
        (
            Figure("500 points detected and measured", r"500 points .*median (\S+) ms", "ms"),
            Figure("10 000 false points of heavy tails", r"tails of .*median (\S+) ms", "ms", 50.0),
        ),
    ),
    Part(
        "stars",
        "retina-navigation",
        "star_time",
        "example",
        (),
        (Figure("stars in 2048 x 1536, pixels to attitude", r"pixels to attitude: median (\S+) ms", "ms", 3.0),),
    ),
    Part(
        "limb",
        "retina-navigation",
        "limb_time",
        "example",
        (),
        (Figure("limb in 1024 x 1024, phase 45 deg", r"phase +45 deg: median (\S+) ms", "ms"),),
    ),
    Part(
        "calibration",
        "retina-calibration",
        "calibrate_speed",
        "example",
        (),
        (Figure("geometry of 100 000 points", r"100000 points, 100 exposures: median (\S+) s", "s"),),
    ),
    Part(
        "workbench",
        "retina-benchmark",
        "diagnose_rate",
        "bench",
        (),
        (Figure("2000 points diagnosed, nothing hidden", r"2000 rows, noise +: .*diagnosed in (\S+) s", "s", 0.1),),
    ),
    Part(
        "optics",
        "retina-optics",
        "trace_rate",
        "bench",
        (),
        (
            Figure("rays x surfaces, AVX2", r"wide: AVX2: (\S+) rays", "a second and core", 0.9e8, True),
            Figure("rays x surfaces, AVX-512", r"wide: AVX-512: (\S+) rays", "a second and core", 3e8, True),
        ),
    ),
)


def say(*words):
    print(*words, file=sys.stderr, flush=True)


def run(command, **options):
    say("speed:", " ".join(map(str, command)))
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, **options)
    if done.returncode != 0:
        say(done.stderr[-2000:])
        raise Failed(f"`{command[0]}` ended with {done.returncode}")
    return done.stdout


class Failed(Exception):
    """A program ended with an error."""


def cargo(part):
    """The command that runs a part."""
    verb = {"example": "run", "bench": "bench"}[part.kind]
    release = ["--release"] if part.kind == "example" else []
    command = ["cargo", verb, "-q", *release, "--locked", "-p", part.crate, f"--{part.kind}", part.program]
    return command + (["--", *part.arguments] if part.arguments else [])


def machine():
    text = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    model = re.search(r"model name\s*: (.*)", text)
    vectors = "AVX-512" if " avx512f" in text else "AVX2" if " avx2" in text else "no wide vectors"
    return f"{os.cpu_count()} processors ({model.group(1) if model else platform.machine()}), {vectors}"


def measured(part):
    rows = []
    text = run(cargo(part))
    for figure in part.figures:
        value = figure.found("\n" + text)
        if value is None:
            say(f"speed: `{part.program}` did not say: {figure.name}")
            continue
        rows.append(
            {
                "part": part.name,
                "what": figure.name,
                "found": value,
                "unit": figure.unit,
                "target": figure.target,
                "times_reached": figure.times_reached(value),
                "command": " ".join(cargo(part)),
            }
        )
    return rows


def left_out(why):
    say(f"speed: {why}")
    return []


def cycles():
    """Blender Cycles against `default`, both of them rendered now."""
    python = ROOT / "validation/.venv/bin/python"
    if not shutil.which("blender") or not python.exists():
        return left_out("Blender Cycles is left out: `blender` and validation/setup.sh are needed")
    run([python, "validation/bench_cycles.py", "--quick", "--no-cpu", "--fresh"])
    report = json.loads((ROOT / "out/bench-cycles-quick/map/report.json").read_text())
    ratio = next(value for name, value in report["speed_ratios"].items() if "wall" in name and "Cycles 64" in name)
    errors = {name: value["rms"] / value["mean_reference"] for name, value in report["errors"].items()}
    text = ", ".join(f"{name} {1e2 * error:.2f} %" for name, error in errors.items())
    return [{"what": "Moon of 1024 x 1024, Cycles with 64 samples over `default`", "ratio": ratio, "note": f"errors: {text}"}]


def optiland(rows):
    """Optiland's rays a second of processor time against the widest vectors."""
    python = ROOT / "out/venv-optics/bin/python"
    if not python.exists():
        return left_out("Optiland is left out: out/venv-optics is needed (validation/README.md)")
    text = run([python, "validation/optics_optiland.py", "--speed"])
    own = max((row["found"] for row in rows if row["part"] == "optics"), default=None)
    peer = re.search(r"wide: Optiland (\S+) rays", text)
    if own is None or peer is None:
        return left_out("no rate to hold Optiland's against")
    return [{"what": "rays x surfaces, RETINA over Optiland (numpy)", "ratio": own / float(peer.group(1)), "note": ""}]


def table(report):
    lines = [report["machine"], ""]
    if report["peers"]:
        lines += ["| against | ratio | |", "|---|---|---|"]
        lines += [f"| {row['what']} | {row['ratio']:.1f} | {row['note']} |" for row in report["peers"]]
        lines.append("")
    lines += ["| | found | target | times reached |", "|---|---|---|---|"]
    for row in report["rows"]:
        target = "" if row["target"] is None else f"{row['target']:g}"
        reached = "" if row["times_reached"] is None else f"{row['times_reached']:.2f}"
        lines.append(f"| {row['what']} | {row['found']:.4g} {row['unit']} | {target} | {reached} |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", action="store_true", help="run other programs as well, where they are installed")
    parser.add_argument("--only", choices=[part.name for part in PARTS], help="one part alone")
    parser.add_argument("--out", type=Path, default=ROOT / "out/speed", help="default: out/speed")
    arguments = parser.parse_args()
    report = {"schema": "retina.speed/1", "machine": machine(), "peers": [], "rows": []}
    failed = False
    steps = [lambda part=part: measured(part) for part in PARTS if arguments.only in (None, part.name)]
    steps = [("rows", step) for step in steps]
    if arguments.peers:
        steps += [("peers", cycles), ("peers", lambda: optiland(report["rows"]))]
    # What one program cannot do does not cost what the others have measured.
    for kind, step in steps:
        try:
            report[kind] += step()
        except Failed as failure:
            say(f"speed: {failure}")
            failed = True
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    (arguments.out / "report.md").write_text(table(report) + "\n")
    print(table(report))
    return 2 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
