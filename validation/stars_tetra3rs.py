"""Attitudes of real star frames by `retina navigate stars` against tetra3rs and cedar-solve, with times.

    cargo build --release --bin retina
    python -m venv V && V/bin/pip install -r validation/requirements-stars.txt
    V/bin/python validation/stars_tetra3rs.py FRAME.tiff ... [--fov-deg 11.4] [--repeats 20]

Each frame is solved whole and in four quadrants, whose fields are half as wide. tetra3rs has a database of
its own (Gaia); its camera is calibrated on the whole frames first, with radial distortion, as RETINA fits
k1 frame by frame. cedar-solve finds its centroids by tetra3's extractor and has its own default database.
A frame's answers agree where the boresights are within --agree-arcsec. Times are medians over --repeats on
one thread. The exit code is 1 where a whole frame is not solved by RETINA, its residuals exceed 12 arcsec,
or its answer is not tetra3rs'.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
RETINA = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release/retina"
LARGEST_RMS_ARCSEC = 12.0


def unit(ra_deg, dec_deg):
    ra, dec = np.radians([ra_deg, dec_deg])
    return np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])


def apart_arcsec(a, b):
    u, v = unit(*a), unit(*b)
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v)) * 3600


def quadrants(pixels):
    height, width = pixels.shape
    for row in range(2):
        for column in range(2):
            yield pixels[row * height // 2:(row + 1) * height // 2, column * width // 2:(column + 1) * width // 2]


def by_retina(paths, fov_deg, repeats):
    """Solutions, and median milliseconds of detection and solution."""
    command = [RETINA, "navigate", "stars", *map(str, paths), "--fov-deg", str(fov_deg), "--json"]
    environment = {**os.environ, "RAYON_NUM_THREADS": "1"}
    runs = [json.loads(subprocess.run(command, env=environment, check=True, capture_output=True).stdout)["images"]
            for _ in range(repeats)]
    times = [[statistics.median(run[i][key] for run in runs) for key in ("detect_ms", "solve_ms")]
             for i in range(len(paths))]
    return list(zip(runs[0], times))


def by_tetra3rs(database, pixels, camera, repeats):
    import tetra3rs
    extract, solve = [], []
    for _ in range(repeats):
        start = time.perf_counter()
        found = tetra3rs.extract_centroids(pixels.astype(np.float32))
        extract.append(1e3 * (time.perf_counter() - start))
        result = database.solve_from_centroids(found.centroids, camera_model=camera, fov_max_error_deg=0.5)
        solve.append(result.solve_time_ms)
    return result, found, [statistics.median(extract), statistics.median(solve)]


def by_cedar(solver, pixels, fov_deg, repeats):
    from tetra3 import get_centroids_from_image
    extract, solve = [], []
    for _ in range(repeats):
        start = time.perf_counter()
        centroids = get_centroids_from_image(pixels)
        extract.append(1e3 * (time.perf_counter() - start))
        result = solver.solve_from_centroids(
            centroids, pixels.shape, fov_estimate=fov_deg, fov_max_error=0.5, solve_timeout=2000)
        solve.append(result["T_solve"])
    return result, [statistics.median(extract), statistics.median(solve)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", nargs="+", type=Path)
    parser.add_argument("--fov-deg", type=float, default=11.4)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--agree-arcsec", type=float, default=30.0)
    arguments = parser.parse_args()
    import tetra3rs
    from tetra3 import Tetra3

    database = tetra3rs.SolverDatabase.generate_from_gaia(
        max_fov_deg=1.1 * arguments.fov_deg, min_fov_deg=0.4 * arguments.fov_deg, epoch_proper_motion_year=2020.0)
    cedar = Tetra3()
    half_deg = 2 * np.degrees(np.arctan(np.tan(np.radians(arguments.fov_deg) / 2) / 2))
    failed = False
    for title, fov_deg, cut in [("whole frames", arguments.fov_deg, False), ("quadrants", half_deg, True)]:
        with tempfile.TemporaryDirectory() as folder:
            images = []
            for frame in arguments.frames:
                pixels = np.asarray(Image.open(frame)).astype(np.uint16)
                for part, cutting in enumerate(quadrants(pixels) if cut else [pixels]):
                    path = Path(folder) / f"{frame.stem}-{part}.tiff"
                    Image.fromarray(np.ascontiguousarray(cutting)).save(path)
                    images.append((path, cutting))
            ours = by_retina([path for path, _ in images], fov_deg, arguments.repeats)
        height, width = images[0][1].shape
        camera = tetra3rs.CameraModel.from_fov(fov_deg, width, height)
        first = [by_tetra3rs(database, pixels, camera, 1) for _, pixels in images]
        solved = [(result, found.centroids) for result, found, _ in first if result]
        if not cut:
            camera = database.calibrate_camera(
                [result for result, _ in solved], [centroids for _, centroids in solved],
                image_width=width, image_height=height).camera_model
        rates = {"retina": 0, "tetra3rs": 0, "cedar-solve": 0}
        all_times = {name: [] for name in rates}
        print(f"\n{title}, {fov_deg:.2f} deg: matches, rms arcsec (two-dimensional), ms to find points + to solve")
        for (path, pixels), (mine, my_times) in zip(images, ours):
            theirs, _, their_times = by_tetra3rs(database, pixels, camera, arguments.repeats)
            other, other_times = by_cedar(cedar, pixels, fov_deg, arguments.repeats)
            line = f"{path.stem[-22:]:>24}"
            if mine["solved"]:
                rates["retina"] += 1
                line += f"  retina {mine['matches']:4d} {mine['rms_arcsec']:6.2f} {my_times[0]:5.1f} + {my_times[1]:6.2f}"
            else:
                line += f"  retina refused ({mine['reason']})"
            place = (mine["ra_deg"], mine["dec_deg"])
            agrees = False
            if theirs:
                rates["tetra3rs"] += 1
                line += (f"  tetra3rs {theirs.num_matches:4d} {theirs.rmse_arcsec:6.2f} {their_times[0]:5.1f} + "
                         f"{their_times[1]:6.2f}")
                if mine["solved"]:
                    off = apart_arcsec(place, (theirs.ra_deg, theirs.dec_deg))
                    agrees = off <= arguments.agree_arcsec
                    line += f" ({off:.1f} arcsec apart)"
            else:
                line += "  tetra3rs -"
            if other["RA"] is not None:
                rates["cedar-solve"] += 1
                line += f"  cedar {other['Matches']:4d} {other['RMSE']:6.2f} {other_times[0]:5.1f} + {other_times[1]:6.2f}"
                if mine["solved"]:
                    line += f" ({apart_arcsec(place, (other['RA'], other['Dec'])):.1f} arcsec apart)"
            else:
                line += "  cedar -"
            print(line)
            for name, times in [("retina", my_times), ("tetra3rs", their_times), ("cedar-solve", other_times)]:
                all_times[name].append(times)
            if not cut and not (mine["solved"] and mine["rms_arcsec"] <= LARGEST_RMS_ARCSEC and agrees):
                failed = True
            if cut and mine["solved"] and theirs and not agrees:
                failed = True
        for name, count in rates.items():
            medians = np.median(np.array(all_times[name]), axis=0)
            print(f"  {name}: {count} of {len(images)} solved, medians {medians[0]:.2f} + {medians[1]:.2f} ms")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
