"""The geometric calibration through scipy: the same table, the same weights, another solver.

Makes a table of points (its own facility: Brown's distortion, coma, jitter, outliers), runs
`retina calibrate geometry` on it, and solves eq. 15 with scipy.optimize.least_squares for the form, weights and
outliers that retina states; exposures' common shifts enter as unknowns with a prior of the stated variance, which is
the same estimate by another road. Rings are scipy.interpolate.BSpline, with their prior as rows. --step gives the
facility a step in its distortion, which rings follow. Exit code 1 beyond the tolerance.

    python validation/geometry_scipy.py [--points 8000] [--step] [--max-relative 1e-9]
"""

import argparse
import csv
import json
import pathlib
import subprocess
import sys

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix, hstack, vstack

ROOT = pathlib.Path(__file__).resolve().parent.parent
ARCSEC = np.pi / 648000
SETUP = ROOT / "assets/setups/wide-fov.toml"
F_SCREEN = 1200 / (2 * (1536 * 3.45e-3 / (2 * 25.0)))  # eq. 13
F_CAMERA = 25.0e3 / 3.45


def make_table(path, points, exposures, seed, step):
    """Points of a facility written here, from scratch: screen px, counts, camera px."""
    rng = np.random.default_rng(seed)
    rows = []
    each = points // exposures
    for image in range(exposures):
        jitter = rng.normal(0, 0.8 * ARCSEC, 2)
        x = np.floor(rng.uniform(200, 1720, each)) + 0.5
        y = np.floor(rng.uniform(20, 1180, each)) + 0.5
        count = rng.choice([8, 16, 33, 68, 140, 255], each)
        light = 2.2 * np.log10(count / 255)
        u = np.stack([(x - 960) / F_SCREEN, (y - 600) / F_SCREEN], 1)
        c = np.array([1.2e-3, -0.8e-3])
        d = u - c
        r = c + d * (1 + 0.3 * (d**2).sum(1, keepdims=True))
        r = r * (1 + 10 * ARCSEC / 0.1 * ((1 + light / 3.3) ** 2)[:, None]) + jitter
        if step:  # 14 arcsec outwards at 7 deg from the centre
            d = r - c
            distance = np.linalg.norm(d, axis=1, keepdims=True)
            r = r + 7 * ARCSEC * np.tanh((distance - 0.12) / 0.02) * d / distance
        sigma = np.hypot(0.03, 0.12 * 10 ** (0.5 * (-3 - light)))
        camera = r * F_CAMERA + [1024, 768] + rng.normal(size=(each, 2)) * sigma[:, None]
        wrong = rng.random(each) < 0.02
        camera[wrong] = rng.uniform(0, 1500, (wrong.sum(), 2))
        rows += [(f"{image:03d}", *v) for v in zip(x, y, count, camera[:, 0], camera[:, 1])]
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["image", "screen_x_px", "screen_y_px", "digital_count", "camera_x_px", "camera_y_px"])
        writer.writerows(rows)


def ring_columns(r, rings):
    """(x - c_x) B / radius and (y - c_y) B / radius for cubic B-splines B of |r - c| about 2 h, 3 h, ... radius + h."""
    place = (r - np.array(rings["center"])) / rings["radius"]
    n = rings["intervals"]
    distance = np.minimum(np.linalg.norm(place, axis=1), 1.0) * n
    columns = []
    for knot in range(2, n + 2):
        spline = BSpline.basis_element(np.arange(knot - 2.0, knot + 3.0), extrapolate=False)
        value = np.nan_to_num(spline(distance))
        columns += [place[:, 0] * value, place[:, 1] * value]
    return np.stack(columns, 1)


def solve(design, prior_rows, target, weight, image, jitter):
    """Weighted least squares with one shift an exposure, prior variance jitter^2, and rows of priors on coefficients, by
    scipy; and its covariance."""
    n, exposures = design.shape[1], image.max() + 1
    scale = np.abs(design).max(0)
    root = np.sqrt(weight)
    shift = csr_matrix((root, (np.arange(len(image)), image)), shape=(len(image), exposures))
    prior = csr_matrix(np.eye(exposures) / jitter) if jitter > 0 else None
    top = hstack([csr_matrix(design / scale * root[:, None]), shift * (1 if jitter > 0 else 0)])
    if len(prior_rows):
        top = vstack([top, hstack([csr_matrix(prior_rows / scale), csr_matrix((len(prior_rows), exposures))])])
    matrix = vstack([top, hstack([csr_matrix((exposures, n)), prior])]) if jitter > 0 else top
    matrix = matrix.toarray()
    right = np.concatenate([target * root, np.zeros(matrix.shape[0] - len(target))])
    if jitter == 0:
        matrix = matrix[:, :n]
    # Shifts are tiny beside coefficients: columns of unit length.
    length = np.linalg.norm(matrix, axis=0)
    matrix = matrix / length
    fit = least_squares(
        lambda p: matrix @ p - right, np.zeros(matrix.shape[1]), jac=lambda p: matrix, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    # One more step on the residual takes off what the solver's own factorisation rounds.
    p = fit.x + np.linalg.lstsq(matrix, right - matrix @ fit.x, rcond=None)[0]
    _, r = np.linalg.qr(matrix)
    inverse = np.linalg.inv(r)
    covariance = (inverse @ inverse.T)[:n, :n]
    change = length[:n] * scale
    return p[:n] / change, covariance / np.outer(change, change)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--points", type=int, default=8000)
    parser.add_argument("--exposures", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--step", action="store_true")
    parser.add_argument("--max-relative", type=float, default=1e-9)
    arguments = parser.parse_args()
    out = ROOT / "out/geometry-scipy"
    out.mkdir(parents=True, exist_ok=True)
    make_table(out / "points.csv", arguments.points, arguments.exposures, arguments.seed, arguments.step)
    command = ["cargo", "run", "--release", "--quiet", "-p", "retina-cli", "--", "calibrate", "geometry"]
    command += ["--setup", SETUP, "--data", out / "points.csv", "--out", out / "calibration.toml"]
    command += ["--residuals", out / "residuals.csv", "--json"]
    result = json.loads(subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout)
    points = list(csv.DictReader(open(out / "points.csv")))
    residuals = list(csv.DictReader(open(out / "residuals.csv")))
    used = [row for row in residuals if row["outlier"] == "0"]
    at = [int(row["row"]) for row in used]
    # Everything but weights and outliers is worked out here, from the table.
    number = lambda key: np.array([float(points[i][key]) for i in at])
    r = np.stack([(number("camera_x_px") - 1024) / F_CAMERA, (number("camera_y_px") - 768) / F_CAMERA], 1)
    u = np.stack([(number("screen_x_px") - 960) / F_SCREEN, (number("screen_y_px") - 600) / F_SCREEN], 1)
    light = 2.2 * np.log10(number("digital_count") / 255)
    sigma = np.array([float(row["sigma_arcsec"]) for row in used]) * ARCSEC
    names, image = np.unique([points[i]["image"] for i in at], return_inverse=True)
    terms = [(c["i"], c["j"], c["k"]) for c in result["coefficients"] if "i" in c]
    design = np.stack([r[:, 0] ** i * r[:, 1] ** j * light**k for i, j, k in terms], 1)
    prior_rows = np.zeros((0, len(terms)))
    if result["rings"]:
        design = np.hstack([design, ring_columns(r, result["rings"])])
        prior_rows = np.eye(design.shape[1])[len(terms) :] / result["rings"]["prior_sigma"]
    jitter = result["jitter_arcsec_per_axis"] * ARCSEC
    weight = 1 / sigma**2
    worst, worst_sigma = 0.0, 0.0
    stated = np.array(result["covariance"])
    predicted = 0.0
    for axis, key in enumerate("ab"):
        coefficients, covariance = solve(design, prior_rows, u[:, axis], weight, image, jitter)
        ours = np.array([c[key] for c in result["coefficients"]])
        # Relative to the coefficient, or to its standard deviation where that is larger: noise has no digits.
        scale = np.maximum(np.abs(coefficients), np.sqrt(np.diag(covariance)))
        worst = max(worst, np.abs((ours - coefficients) / scale).max())
        predicted = max(predicted, np.abs(design @ (ours - coefficients)).max() / ARCSEC)
        ratio = np.sqrt(np.diag(stated) / np.diag(covariance))
        worst_sigma = max(worst_sigma, np.abs(ratio - 1).max())
    print(f"{len(used)} points, {len(names)} exposures, {len(terms)} terms and {design.shape[1] - len(terms)} of rings an axis, jitter {jitter / ARCSEC:.3f} arcsec")
    print(f"coefficients: largest relative difference {worst:.1e}; standard deviations: {worst_sigma:.1e}")
    print(f"D^-1 over the points: largest difference {predicted:.1e} arcsec")
    report = {
        "schema": "retina.validation-geometry/1",
        "relative": worst,
        "sigma_relative": worst_sigma,
        "prediction_arcsec": predicted,
    }
    (out / "report.json").write_text(json.dumps(report, indent=1))
    return int(worst > arguments.max_relative)


if __name__ == "__main__":
    sys.exit(main())
