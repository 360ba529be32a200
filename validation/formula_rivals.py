"""Formulas of hidden effects: gplearn and a LASSO on the tables of `retina-benchmark --kind formula`.

    python formula_rivals.py --dir out/formulas --sets 16

Each rival sees what `retina investigate` sees: the errors of a table beside the baseline. Half of the exposures is for the
search, the other half for the proof (a one-sided sign flip of whole exposures at 0.015, as `retina` does it). Beside that
the plain use is scored: all data, no proof. The report is `rivals.md` in the folder.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

# Many small products: threads of a process only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np  # noqa: E402

warnings.filterwarnings("ignore")

ARCSEC = np.degrees(1.0) * 3600.0
FOCAL_PX = 25.0 / 0.00345
CAMERA_PX = np.array([2048.0, 1536.0])
SCREEN_FOCAL_PX = FOCAL_PX * 1200.0 / 1536.0
SCREEN_CENTRE_PX = np.array([960.0, 600.0])
HALF = CAMERA_PX[0] / 2 / FOCAL_PX
LEVEL = 0.015
FLIPS = 1999
EQUIVALENT = 0.2
# A column counts as found if terms with it hold this share of the predicted variance.
SHARE = 0.05
COLUMNS = ["log10_irradiance", "time_s", "temperature_c", "row_load", "humidity"]


class Table:
    """A table's errors along x and y in arcsec, and what they may depend on."""

    def __init__(self, path: Path) -> None:
        with open(path, encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        of = lambda name: np.array([float(row[name]) for row in rows])  # noqa: E731
        screen = (np.column_stack([of("screen_x_px"), of("screen_y_px")]) - SCREEN_CENTRE_PX) / SCREEN_FOCAL_PX
        camera = np.column_stack([of("camera_x_px"), of("camera_y_px")])
        camera = (camera - (CAMERA_PX - 1) / 2) / FOCAL_PX
        self.exposure = np.unique([row["image"] for row in rows], return_inverse=True)[1]
        self.place = screen / HALF
        self.error = (camera - screen) * ARCSEC
        light = 2.2 * np.log10(of("digital_count") / 255.0)
        self.columns = np.column_stack([light, *(of(name) for name in COLUMNS[1:])])

    def baseline(self) -> np.ndarray:
        """Columns of both components: shifts, linear terms, k1; shape (rows, 2, 7)."""
        x, y = self.place.T
        zero, one, r2 = np.zeros_like(x), np.ones_like(x), x * x + y * y
        along = [one, zero, x, y, zero, zero, x * r2]
        across = [zero, one, zero, zero, x, y, y * r2]
        return np.stack([np.column_stack(along), np.column_stack(across)], axis=1)

    def features(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Place and columns, each from -1 to 1 over the table that was learnt from."""
        return np.column_stack([self.place, 2 * (self.columns - low) / np.maximum(high - low, 1e-12) - 1])


def beside(base: np.ndarray, values: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """What the baseline, fitted to the kept rows, leaves of values of shape (rows, 2)."""
    solution = np.linalg.lstsq(base[keep].reshape(-1, base.shape[2]), values[keep].reshape(-1), rcond=None)[0]
    return values - base @ solution


def errors(table: Table) -> tuple[np.ndarray, np.ndarray]:
    """Errors beside the baseline and the rows that are no outliers."""
    base, keep = table.baseline(), np.ones(len(table.error), bool)
    for _ in range(8):
        left = beside(base, table.error, keep)
        size = np.hypot(*left.T)
        # Of a normal pair half lie within 1.177 sigma.
        keep = size < 5.0 * np.median(size[keep]) / 1.177
    return left, keep


def proven(predicted: np.ndarray, left: np.ndarray, rows: np.ndarray, exposure: np.ndarray) -> bool:
    """One-sided sign flips of whole exposures of the half that judges."""
    shares = np.bincount(exposure[rows], (predicted[rows] * left[rows]).sum(axis=1))
    flips = np.random.default_rng(1).choice([-1.0, 1.0], (FLIPS, len(shares)))
    found = shares.sum()
    return bool(found > 0 and (1 + (flips @ shares >= found).sum()) / (1 + FLIPS) <= LEVEL)


def lasso_terms(features: np.ndarray) -> tuple[np.ndarray, list[set[int]]]:
    """Polynomials of the place to the third degree, times laws of one column; with the features of each."""
    x, y = features[:, 0], features[:, 1]
    places = [x**a * y**b for a in range(4) for b in range(4 - a)]
    used = [{0} | {1} if a and b else ({0} if a else ({1} if b else set())) for a in range(4) for b in range(4 - a)]
    out, of = [*places[1:]], [*used[1:]]
    for column in range(2, features.shape[1]):
        u = features[:, column]
        positive = np.maximum((u + 1) / 2, 0) + 0.02
        laws = [u, u**2, u**3, np.log(positive), np.sqrt(positive), np.exp(-3 * positive), np.tanh(3 * u)]
        laws += [(u > at).astype(float) for at in (-0.5, 0.0, 0.5)]
        laws += [f(k * np.pi * u) for k in (1, 2, 4) for f in (np.sin, np.cos)]
        for law in laws:
            for place, names in zip(places, used, strict=True):
                out.append(place * law)
                of.append(names | {column})
    return np.column_stack(out), of


def lasso(features: np.ndarray, target: np.ndarray, groups: np.ndarray):
    from sklearn.linear_model import LassoCV
    from sklearn.model_selection import GroupKFold

    terms, of = lasso_terms(features)
    scale = terms.std(axis=0) + 1e-12
    folds = list(GroupKFold(5).split(terms, groups=groups))
    models = [LassoCV(cv=folds, alphas=30, eps=1e-2, max_iter=1000, tol=1e-3).fit(terms / scale, t) for t in target.T]

    def predict(new: np.ndarray) -> tuple[np.ndarray, list[float]]:
        terms, _ = lasso_terms(new)
        parts = [terms / scale * model.coef_ for model in models]
        whole = sum((part.var(axis=0).sum() for part in parts), 0.0) or 1.0
        held = [
            sum(part[:, [k for k, names in enumerate(of) if feature in names]].var(axis=0).sum() for part in parts) / whole
            for feature in range(new.shape[1])
        ]
        return np.column_stack([part.sum(axis=1) + m.intercept_ for part, m in zip(parts, models, strict=True)]), held

    return predict


def gplearn(features: np.ndarray, target: np.ndarray, groups: np.ndarray):
    from gplearn.genetic import SymbolicRegressor

    names = ("add", "sub", "mul", "div", "sqrt", "log", "abs", "neg", "sin")
    models = [
        SymbolicRegressor(
            population_size=1000, generations=20, function_set=names, parsimony_coefficient=0.001, metric="mse", random_state=1
        ).fit(features, t)
        for t in target.T
    ]

    def predict(new: np.ndarray) -> tuple[np.ndarray, list[float]]:
        used = [any(node == feature for m in models for node in m._program.program if isinstance(node, int)) for feature in range(new.shape[1])]
        return np.column_stack([m.predict(new) for m in models]), [float(u) for u in used]

    return predict


RIVALS = {"LASSO": lasso, "gplearn": gplearn}


def one(task: tuple[str, dict, str]) -> dict:
    folder, plan, rival = Path(task[0]), task[1], task[2]
    own = folder / "sets" / f"{plan['set']:05}"
    table = Table(own / "table.csv")
    left, keep = errors(table)
    low, high = table.columns.min(axis=0), table.columns.max(axis=0)
    features = table.features(low, high)
    half = table.exposure % 2 == 0
    out = {"set": plan["set"], "rival": rival, "hidden": bool(plan["covariates"])}
    for use in ("proof", "plain"):
        start = time.perf_counter()
        learn = keep & half if use == "proof" else keep
        predict = RIVALS[rival](features[learn], left[learn], table.exposure[learn])
        predicted, held = predict(features)
        said = float(predicted.std()) > 1e-9
        if use == "proof":
            said = said and proven(predicted, left, keep & ~half, table.exposure)
        names = ["place", "place", *COLUMNS]
        found = {name for name, share in zip(names, held, strict=True) if share >= SHARE}
        result = {"said": said, "right": said and found == {"place" if c in "xy" else c for c in plan["covariates"]}}
        if plan["covariates"]:
            fresh = Table(own / "fresh.csv")
            base, all_ = fresh.baseline(), np.ones(len(fresh.error), bool)
            truth = np.fromfile(folder / "sealed" / f"{plan['set']:05}-fresh.f32", "<f4").reshape(-1, 2).astype(float)
            made = predict(fresh.features(low, high))[0]
            apart = beside(base, np.nan_to_num(made) - truth, all_)
            result["error"] = float(np.sqrt((apart**2).mean() / (beside(base, truth, all_) ** 2).mean()))
        result["seconds"] = time.perf_counter() - start
        out[use] = result
    return out


def retina(folder: Path, hidden: list[int], nothing: list[int]) -> list[str]:
    """RETINA's row, from what the benchmark has written."""
    listing = [line.split("|")[1:-1] for line in (folder / "results.md").read_text().splitlines() if line.startswith("|")]
    listing = {int(row[0]): [cell.strip() for cell in row] for row in listing if row[0].strip().isdigit() and len(row) == 7}
    said = {s["set"]: s for s in map(json.loads, (folder / "investigated.jsonl").read_text().splitlines())}
    place = lambda name: "place" if name in ("x", "y", "r") else name  # noqa: E731
    known = lambda s: bool(said[s]["known"])  # noqa: E731
    # Columns of known effects are the catalogue's: the benchmark has counted those.
    right = [s for s in hidden if known(s) or {place(n) for f in said[s]["formulas"] for n in f} == set(listing[s][2].split(", "))]
    equal = [s for s in hidden if listing[s][6] and float(listing[s][6]) <= EQUIVALENT]
    false = [s for s in nothing if said[s]["formulas"] or known(s)]
    seconds = np.median([said[s]["seconds"] for s in hidden + nothing])
    return [f"| `retina investigate` | {len(right)} of {len(hidden)} | {len(equal)} of {len(hidden)} | {len(false)} of {len(nothing)} | {seconds:.1f} |"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dir", required=True, type=Path, help="folder of the benchmark")
    parser.add_argument("--sets", type=int, default=16, help="sets, half of them with a formula")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    plans = [json.loads(line) for line in (arguments.dir / "sealed" / "truth.jsonl").read_text().splitlines()]
    hidden = [p for p in plans if p["covariates"] and p["hidden"][0]["strength"] >= 1][: arguments.sets // 2]
    nothing = [p for p in plans if not p["hidden"]][: arguments.sets // 2]
    tasks = [(str(arguments.dir), plan, rival) for rival in RIVALS for plan in hidden + nothing]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        results = list(pool.map(one, tasks))
    lines = retina(arguments.dir, [p["set"] for p in hidden], [p["set"] for p in nothing])
    lines[:0] = ["| search | right columns | equivalent | found where nothing is | s a set, median |", "|---|---|---|---|---|"]
    for rival in RIVALS:
        for use in ("proof", "plain"):
            own = [r for r in results if r["rival"] == rival]
            there, none = [r[use] for r in own if r["hidden"]], [r[use] for r in own if not r["hidden"]]
            equal = sum(r["said"] and r["error"] <= EQUIVALENT for r in there)
            seconds = float(np.median([r[use]["seconds"] for r in own]))
            lines.append(
                f"| {rival}, {'half and half' if use == 'proof' else 'plain'} | {sum(r['right'] for r in there)} of {len(there)} "
                f"| {equal} of {len(there)} | {sum(r['said'] for r in none)} of {len(none)} | {seconds:.1f} |"
            )
    text = "\n".join(lines) + f"\n\nSets with a formula: {[p['set'] for p in hidden]}; without: {[p['set'] for p in nothing]}\n"
    (arguments.dir / "rivals.md").write_text(text)
    (arguments.dir / "rivals.json").write_text(json.dumps(results, indent=1))
    print(text)


if __name__ == "__main__":
    main()
