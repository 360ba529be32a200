"""False alarms of the workbench beside calibrations: campaigns in which nothing is wrong.

Calibrations of 40 exposures and nulls of 40 exposures of 50 points, photographed by the virtual bench; each null is
diagnosed beside some of the calibrations, in turn. A null should be `adequate`. The bench's camera has a pixel phase of
0.04 arcsec, which may be named alone: it is counted apart. Diagnoses that share a null or a calibration are not
independent (a null whose noise looks like an effect does so beside most calibrations), so the standard error comes from
the nulls' own shares.

    python validation/nulls.py --retina target/release/retina --out DIR [--calibrations 20] [--nulls 80] [--beside 2]

Needs nothing but Python. Photographs and diagnoses are kept; `--again` calibrates and diagnoses anew, as after a
change.
"""

import argparse
import collections
import concurrent.futures
import csv
import json
import pathlib
import subprocess

SETUP = "wide-fov"
# Seeds of the campaigns that calibrations come from, each of 80 exposures and cut in two.
FIRST_CALIBRATION, FIRST_NULL = 61, 301
PIXEL_PHASE = {"camera_pixel_phase"}


def run(retina, *arguments):
    done = subprocess.run([retina, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, arguments))}\n{done.stderr}")
    return done.stdout


def halves(table, folder, stem):
    """Writes the even and the odd exposures of a table apart."""
    with open(table, encoding="utf-8") as file:
        comments, rows = [], []
        for line in file:
            (comments if line.startswith("#") else rows).append(line)
    header, *rows = rows
    column = next(csv.reader([header])).index("image")
    order = {}
    for row in rows:
        order.setdefault(row.split(",")[column], len(order))
    paths = [folder / f"{stem}-{part}.csv" for part in (0, 1)]
    for part, path in enumerate(paths):
        mine = [row for row in rows if order[row.split(",")[column]] % 2 == part]
        path.write_text("".join([*comments, header, *mine]), encoding="utf-8")
    return paths


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--retina", default="target/release/retina")
    parser.add_argument("--out", required=True, type=pathlib.Path)
    parser.add_argument("--calibrations", type=int, default=20)
    parser.add_argument("--nulls", type=int, default=80)
    parser.add_argument("--beside", type=int, default=2, help="calibrations beside which a null is diagnosed")
    parser.add_argument("--again", action="store_true", help="calibrate and diagnose anew")
    a = parser.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)

    def photographed(seed, exposures):
        folder = a.out / f"photographs-{seed}"
        if not (folder / "points.csv").exists():
            run(a.retina, "simulate", "points", "--setup", SETUP, "--seed", seed, "--exposures", exposures,
                "--out", folder)
        return folder / "points.csv"

    tables = []
    for k in range((a.calibrations + 1) // 2):
        seed = FIRST_CALIBRATION + k
        tables += halves(photographed(seed, 80), a.out, f"table-{seed}")
    tables = tables[: a.calibrations]

    def calibrated(table):
        path = table.with_suffix(".toml")
        if a.again or not path.exists():
            run(a.retina, "calibrate", "geometry", "--setup", SETUP, "--data", table, "--out", path)
        return path

    def diagnosed(pair):
        calibration, null = pair
        path = a.out / f"{calibration.stem}-{null.parent.name}.json"
        if a.again or not path.exists():
            path.write_text(run(a.retina, "diagnose", "--setup", SETUP, "--data", null, "--calibration", calibration,
                                "--json"))
        return json.loads(path.read_text())

    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        nulls = list(pool.map(lambda k: photographed(FIRST_NULL + k, 40), range(a.nulls)))
        calibrations = list(pool.map(calibrated, tables))
        pairs = [(calibrations[(k * a.beside + j) % len(calibrations)], null)
                 for k, null in enumerate(nulls) for j in range(a.beside)]
        answers = list(pool.map(diagnosed, pairs))

    wrong, phase, by_name = 0, 0, collections.Counter()
    by_null, by_calibration = collections.Counter(), collections.Counter()
    for (calibration, null), answer in zip(pairs, answers, strict=True):
        accepted = set(answer["accepted"])
        if answer["verdict"] == "adequate":
            continue
        if accepted == PIXEL_PHASE and answer["verdict"] in ("named", "confounded"):
            phase += 1
            continue
        wrong += 1
        name = " + ".join(sorted(accepted - PIXEL_PHASE)) or "something left over"
        by_name[name] += 1
        by_null[null.parent.name] += 1
        by_calibration[calibration.stem] += 1
        print(f"{calibration.stem:12} {null.parent.name:16} {answer['verdict']:12} {' '.join(sorted(accepted))}")
    share = wrong / len(pairs)
    squares = sum((by_null[null.parent.name] / a.beside - share) ** 2 for null in nulls)
    error = (squares / max(len(nulls) - 1, 1) / len(nulls)) ** 0.5
    print(f"\n{len(pairs)} diagnoses: {wrong} wrong ({100 * share:.1f} +- {100 * error:.1f} %), "
          f"the pixel phase alone in {phase}")
    for name, count in by_name.most_common():
        print(f"{count:4} {name}")
    for counter in (by_null, by_calibration):
        print(", ".join(f"{name} {count}" for name, count in counter.most_common(8)))


main()
