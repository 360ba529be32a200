"""Star images of any folder by `retina navigate stars`, tetra3rs and cedar-solve in turn, on the same pixels.

    cargo build --release --bin retina
    python -m venv V && V/bin/pip install -r validation/requirements-stars.txt tifffile
    V/bin/python validation/star_solvers.py FOLDER|IMAGE ... [--fov-deg 2..70] [--agree-arcsec 600] [--out DIR]

All that Pillow or tifffile reads is taken; colours become their mean for the other two solvers, RETINA reads the
files themselves. A solver that is not installed is left out, and said to be. tetra3rs has a database over the part of
the range from 8 to 30 deg (from 4 deg on making it takes 40 s, from 2 deg on minutes), of its own Gaia catalogue; where
it needs an estimate of the field it gets the geometric mean of the range and no limit of its error. cedar-solve has its
default database (10 to 30 deg). Times are wall-clock: points and solution, without reading files and preparing
catalogues.

Printed are a row an image, and for each solver: solved, medians of matches, residuals and time, and the greatest
time. Two answers disagree where their boresights are farther apart than --agree-arcsec. DIR/report.json has all. The
exit code is 1 where two solvers disagree.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from sky_angles import apart_arcsec

ROOT = Path(__file__).resolve().parent.parent
RETINA = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release/retina"
SUFFIXES = {".png", ".tif", ".tiff", ".jpg", ".jpeg"}


def pixels_of(path):
    if path.suffix.lower() in {".tif", ".tiff"}:
        import tifffile
        pixels = tifffile.imread(path)
    else:
        from PIL import Image
        pixels = np.asarray(Image.open(path))
    if pixels.ndim == 3:
        pixels = pixels[..., :3].mean(axis=2)
    return pixels.astype(np.float32)


def by_retina(retina, paths, fov_deg):
    command = [retina, "navigate", "stars", *map(str, paths), "--json"]
    command += ["--fov-deg", f"{fov_deg[0]}..{fov_deg[1]}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not done.stdout:
        sys.exit(f"error: {retina} gave no answer:\n{done.stderr}")
    answers = []
    for image in json.loads(done.stdout)["images"]:
        answers.append({
            "solved": image["solved"], "ra_deg": image["ra_deg"], "dec_deg": image["dec_deg"],
            "matches": image["matches"], "rms_arcsec": image["rms_arcsec"], "reason": image.get("message"),
            "ms": image.get("detect_ms", 0.0) + image.get("solve_ms", 0.0),
        })
    return answers


def by_tetra3rs(paths, fov_deg):
    try:
        import tetra3rs
    except ImportError:
        return None
    database = tetra3rs.SolverDatabase.generate_from_gaia(
        max_fov_deg=min(fov_deg[1], 30.0), min_fov_deg=max(fov_deg[0], 8.0), epoch_proper_motion_year=2020.0)
    middle = float(np.sqrt(fov_deg[0] * fov_deg[1]))
    answers = []
    for path in paths:
        pixels = pixels_of(path)
        start = time.perf_counter()
        found = tetra3rs.extract_centroids(pixels)
        result = database.solve_from_centroids(
            found.centroids, camera_model=tetra3rs.CameraModel.from_fov(middle, pixels.shape[1], pixels.shape[0]))
        ms = 1e3 * (time.perf_counter() - start)
        answers.append({"solved": True, "ra_deg": result.ra_deg, "dec_deg": result.dec_deg, "ms": ms,
                        "matches": result.num_matches, "rms_arcsec": result.rmse_arcsec}
                       if result else {"solved": False, "ms": ms})
    return answers


def by_cedar(paths, _):
    try:
        from tetra3 import Tetra3, get_centroids_from_image
    except ImportError:
        return None
    solver = Tetra3()
    answers = []
    for path in paths:
        pixels = pixels_of(path)
        start = time.perf_counter()
        centroids = get_centroids_from_image(pixels)
        result = solver.solve_from_centroids(centroids, pixels.shape, solve_timeout=5000)
        ms = 1e3 * (time.perf_counter() - start)
        answers.append({"solved": True, "ra_deg": result["RA"], "dec_deg": result["Dec"], "ms": ms,
                        "matches": result["Matches"], "rms_arcsec": result["RMSE"]}
                       if result["RA"] is not None else {"solved": False, "ms": ms})
    return answers


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("images", nargs="+", type=Path)
    parser.add_argument("--fov-deg", default="2..70")
    parser.add_argument("--agree-arcsec", type=float, default=600.0)
    parser.add_argument("--retina", type=Path, default=RETINA)
    parser.add_argument("--out", type=Path, default=Path("out/star-solvers"))
    arguments = parser.parse_args()
    fov_deg = [float(part) for part in arguments.fov_deg.split("..")]
    fov_deg = [fov_deg[0], fov_deg[-1]]
    paths = []
    for given in arguments.images:
        found = sorted(p for p in given.rglob("*") if p.suffix.lower() in SUFFIXES) if given.is_dir() else [given]
        if not found:
            sys.exit(f"error: {given} holds no image ({', '.join(sorted(SUFFIXES))})")
        paths += found

    solvers = {"retina": by_retina(arguments.retina, paths, fov_deg)}
    for name, solve in [("tetra3rs", by_tetra3rs), ("cedar-solve", by_cedar)]:
        answers = solve(paths, fov_deg)
        if answers is None:
            print(f"{name} is not installed, and left out", file=sys.stderr)
        else:
            solvers[name] = answers

    disagree = []
    for k, path in enumerate(paths):
        cells = []
        for name, answers in solvers.items():
            answer = answers[k]
            if answer["solved"]:
                cells.append(f"{name} {answer['matches']:4d} {answer['rms_arcsec']:7.2f} arcsec {answer['ms']:8.1f} ms")
            else:
                cells.append(f"{name} refused {answer['ms']:8.1f} ms")
        names = [name for name, answers in solvers.items() if answers[k]["solved"]]
        for i, one in enumerate(names):
            for other in names[i + 1:]:
                off = apart_arcsec(solvers[one][k], solvers[other][k])
                if off > arguments.agree_arcsec:
                    disagree.append({"image": str(path), "solvers": [one, other], "apart_arcsec": off})
                    cells.append(f"{one} and {other} DISAGREE by {off:.0f} arcsec")
        print(f"{path.name:>32}  {'; '.join(cells)}")

    print(f"\n| solver | solved of {len(paths)} | matches, median | residuals, median arcsec | ms, median; most |\n|---|---|---|---|---|")
    for name, answers in solvers.items():
        solved = [answer for answer in answers if answer["solved"]]
        times = [answer["ms"] for answer in answers]
        def median(key):
            return f"{statistics.median(answer[key] for answer in solved):.1f}" if solved else "-"
        print(f"| {name} | {len(solved)} | {median('matches')} | {median('rms_arcsec')} | "
              f"{statistics.median(times):.1f}; {max(times):.1f} |")
    print(f"\n{len(disagree)} disagreements")
    arguments.out.mkdir(parents=True, exist_ok=True)
    report = {"images": [str(path) for path in paths], "solvers": solvers, "disagreements": disagree}
    (arguments.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    sys.exit(1 if disagree else 0)


if __name__ == "__main__":
    main()
