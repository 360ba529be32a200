"""Formulas of another make: tables of points with an error that no known effect explains, written here from its physics.

Campaigns are those of `campaigns.py` (24 to 80 exposures), with the humidity and the air pressure of each exposure.
`retina investigate` is asked for a formula. Its columns are compared with those of the truth, and what it predicts for an
exposure of 600 points, with conditions drawn anew within those of the table, with what the truth adds there.

    python validation/formulas.py --retina target/release/retina --out DIR [--seed N] [--sets N] [--nulls N] [--jobs N]

Equivalent: within 0.2 of the field's rms beside shift, linear terms and k1. A field that a known effect was taken for is
counted by itself. Needs numpy.
"""

import argparse
import collections
import json
import pathlib
import re
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import campaigns
from campaigns import ARCSEC, CAMERA_F, SCREEN_F, Campaign, beyond_baseline

STRENGTHS = [0.3, 1.0, 3.0, 10.0]
HALF = 1024 / CAMERA_F


def dress(c, random):
    """The air of each exposure."""
    air = {"humidity": random.uniform(30, 65, c.exposures), "pressure_hpa": random.uniform(985, 1030, c.exposures)}
    c.air = {name: np.round(values, 2)[c.image] for name, values in air.items()}
    c.limits = {
        "time_s": (0.0, c.at_s[-1]), "temperature_c": (c.temperature.min(), c.temperature.max()),
        "humidity": (30.0, 65.0), "pressure_hpa": (985.0, 1030.0),
    }  # fmt: skip


def fresh(c, random):
    """One exposure's worth of rows for each of 600 conditions."""
    new = object.__new__(Campaign)
    new.rows = 600
    new.screen = [960, 600] + random.uniform(-1, 1, (600, 2)) * [600, 560]
    new.line = (new.screen - [960, 600]) / SCREEN_F
    new.r2 = (new.line**2).sum(1, keepdims=True) / HALF**2
    new.flux = (random.choice(np.unique(c.counts), 600) / 255) ** 2.2
    new.load = random.choice(c.load, 600)
    drawn = {name: random.uniform(*limits, 600) for name, limits in c.limits.items()}
    new.time_s, new.temperature = drawn.pop("time_s"), drawn.pop("temperature_c")
    new.air, new.limits = drawn, c.limits
    new.channel = random.choice(c.channel, 600)
    return new


def part(c, name, values):
    """A column from 0 to 1 over the table's limits."""
    low, high = c.limits[name]
    return ((values - low) / (high - low))[:, None]


def local(c, at, width):
    off = c.line / HALF - at
    return off, 1 / (1 + (off**2).sum(1, keepdims=True) / width**2)


# Each law: columns of the truth, and what it adds to a line of sight. `n` are six numbers from 0 to 1.
def towards(n):
    return np.array([[np.cos(6.28 * n[0]), np.sin(6.28 * n[0])]])


def trail(c, n):  # charge left behind on the way to the register
    y = c.line[:, 1:] / HALF
    return np.hstack([0 * y, (1 + y) / (1 + c.flux[:, None] / (0.02 + 0.1 * n[1]))])


def cell_slips(c, n):
    return towards(n) * (2 / (1 + np.exp(-(part(c, "temperature_c", c.temperature) - 0.3 - 0.4 * n[1]) / 0.08)) - 1)


def mount_swells(c, n):
    wet = part(c, "humidity", c.air["humidity"])
    return towards(n) * (wet + 0.6 * n[1] * wet**2)


def window_bends(c, n):
    return c.line / HALF * c.r2 * (part(c, "pressure_hpa", c.air["pressure_hpa"]) - 0.5)


def air_refracts(c, n):  # a wedge of air, against that of a day when the bench was aligned
    return towards(n) * (c.air["pressure_hpa"][:, None] / 1007 - 1)


def blemish(c, n):
    off, fall = local(c, [n[1] - 0.5, 0.8 * n[2] - 0.4], 0.15 + 0.2 * n[3])
    return off * fall**2


def blister_grows(c, n):
    off, fall = local(c, [n[1] - 0.5, 0.8 * n[2] - 0.4], 0.3 + 0.2 * n[3])
    return off * fall**2 * (1 - np.exp(-3 * part(c, "time_s", c.time_s)))


def frame_sways(c, n):
    turned = c.line[:, ::-1] / HALF * [-1, 1]
    return turned * np.sin(6.28 * ((1.5 + 2 * n[1]) * part(c, "time_s", c.time_s) + n[2]))


def cell_squeezed(c, n):
    x, y = (c.line / HALF).T
    a, b = towards(n)[0]
    return np.stack([a * x + b * y, b * x - a * y], axis=1) * (part(c, "temperature_c", c.temperature) - 0.4) ** 2


def row_sags(c, n):
    return towards(n) * (c.load / (c.load + 0.05 + 0.2 * n[1]))[:, None]


def prism_swells(c, n):
    return towards(n) * c.r2 * np.sqrt(0.05 + part(c, "humidity", c.air["humidity"]))


def image_turns(c, n):
    return c.line[:, ::-1] / HALF * [-1, 1] * np.log1p(c.flux / (0.01 + 0.05 * n[1]))[:, None]


def gate_scratches(c, n):  # a ripple over the field, the stronger the fainter
    phase = c.line / HALF @ np.array([[6 + 4 * n[1]], [4 * n[2] - 2]])
    return towards(n) * np.sin(phase + 6.28 * n[3]) / (1 + c.flux[:, None] / 0.05)


def heat_shimmers(c, n):
    return c.line / HALF * c.load[:, None] * (0.3 + part(c, "temperature_c", c.temperature))


LAWS = {
    trail: {"place", "light"}, cell_slips: {"temperature"}, mount_swells: {"humidity"}, window_bends: {"place", "pressure"},
    air_refracts: {"pressure"}, blemish: {"place"}, blister_grows: {"place", "time"}, frame_sways: {"place", "time"},
    cell_squeezed: {"place", "temperature"}, row_sags: {"load"}, prism_swells: {"place", "humidity"},
    image_turns: {"place", "light"}, gate_scratches: {"place", "light"}, heat_shimmers: {"place", "load", "temperature"},
}  # fmt: skip
COLUMNS = {
    "x": "place", "y": "place", "r": "place", "log10_irradiance": "light", "F": "light", "time_s": "time",
    "temperature_c": "temperature", "humidity": "humidity", "pressure_hpa": "pressure", "row_load": "load",
}  # fmt: skip


def write(folder, seed, law, strength):
    random = np.random.default_rng(seed)
    while True:
        c = Campaign(random)
        # Laws of the light need several counts in an exposure, and one colour: `flux` is the count's alone.
        light = law in (trail, image_turns, gate_scratches)
        if 24 <= c.exposures <= 80 and not (light and (c.by_exposure or c.coloured)):
            break
    c.draw_facility()
    dress(c, random)
    field, numbers, scale = np.zeros((c.rows, 2)), random.random(6), 0.0
    if law:
        left = beyond_baseline(c, law(c, numbers))
        scale = strength * c.noise / CAMERA_F / np.sqrt((left**2).mean())
        field = scale * law(c, numbers)
    camera = c.seen(c.line + field)
    c.add_noise(camera)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(campaigns.SETUP)
    names = ["image", "screen_x_px", "screen_y_px", "digital_count", "channel", "time_s", "temperature_c", "row_load"]
    with open(folder / "points.csv", "w") as out:
        out.write(",".join([*names, *c.air, "camera_x_px", "camera_y_px"]) + "\n")
        for k in range(c.rows):
            row = f"e{c.image[k]:03d},{c.screen[k, 0]:.3f},{c.screen[k, 1]:.3f},{c.counts[k]},{c.channel[k]},"
            row += f"{c.time_s[k]:.2f},{c.temperature[k]:.4f},{c.load[k]:.5f},"
            row += "".join(f"{values[k]:.2f}," for values in c.air.values())
            out.write(row + f"{camera[k, 0]:.5f},{camera[k, 1]:.5f}\n")
    new = fresh(c, np.random.default_rng((*seed, 1)))
    return new, scale * law(new, numbers) if law else None


def predicted(text, fitted, c):
    """A user's effect, lines of sight, at the values that the fit of all formulas together has found."""
    effect = tomllib.loads(text)
    x, y = (c.line / HALF).T
    names = {
        "x": x, "y": y, "r": np.hypot(x, y), "F": c.flux, "L": np.log10(c.flux), "time_s": c.time_s,
        "temperature_c": c.temperature, "row_load": c.load, "pi": np.pi, **c.air,
        "exp": np.exp, "ln": np.log, "tanh": np.tanh, "sin": np.sin, "cos": np.cos, "abs": np.abs, "sqrt": np.sqrt,
        "step": lambda u: (u > 0) * 1.0,
        # Conditions are drawn one by one: each has lasted until everything follows it.
        "lag": lambda u, _: u,
    }  # fmt: skip
    names |= {f"channel_{name}": (c.channel == name) * 1.0 for name in "rgb"}
    names |= {name: fitted[f"{effect['name']}.{name}"]["value"] for name in effect.get("parameters", {})}
    value = lambda text: eval(re.sub(r"\[\w+\]", "", text).replace("^", "**"), {"__builtins__": {}}, names)  # noqa: E731, S307
    return np.stack([np.zeros(c.rows) + value(effect[axis]) for axis in ("dx", "dy")], axis=1) * ARCSEC


def judge(told, law, new, truth):
    """What it comes to, and the error of what is predicted over the field's rms."""
    if law is None:
        return ("found" if told["terms"] or told["known"] else "nothing"), None
    if not told["terms"]:
        return ("known effect" if told["known"] else "nothing"), None
    strong = [term for term in told["terms"] if not term["weak_beside"]]
    columns = {COLUMNS.get(name, name) for term in strong for name in term["covariates"]}
    said = "right columns" if columns == LAWS[law] else "other columns"
    if told["known"]:
        return f"{said}, beside a known effect", None
    made = sum(predicted(term["effect_toml"], told["fit"]["parameters"], new) for term in told["terms"])
    error = beyond_baseline(new, made - truth)
    share = np.sqrt((error**2).mean() / (beyond_baseline(new, truth) ** 2).mean())
    return f"{said}, {'equivalent' if share <= 0.2 else 'not equivalent'}", share


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--retina", required=True)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sets", type=int, default=1, help="of each law and strength")
    parser.add_argument("--nulls", type=int, default=20, help="campaigns without a formula")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    plan = [(law, strength) for law in LAWS for strength in STRENGTHS for _ in range(options.sets)]
    plan += [(None, 0.0)] * options.nulls

    def one(task):
        number, (law, strength) = task
        folder = options.out / f"{number:04d}"
        new, truth = write(folder, (options.seed, number), law, strength)
        done = folder / "investigation.json"
        if not done.exists():
            files = ["--setup", folder / "setup.toml", "--data", folder / "points.csv"]
            answer = subprocess.run([options.retina, "investigate", "--quiet", "--json", *files], capture_output=True, text=True)
            if answer.returncode != 0:
                sys.exit(f"{folder}: retina ended with {answer.returncode}: {answer.stderr}")
            done.write_text(answer.stdout)
        told = json.loads(done.read_text())
        return folder, law, strength, *judge(told, law, new, truth), told

    found = collections.defaultdict(collections.Counter)
    with ThreadPoolExecutor(options.jobs) as pool:
        for folder, law, strength, result, share, told in pool.map(one, enumerate(plan)):
            found[strength][result] += 1
            if result not in ("right columns, equivalent", "found" if law else "nothing"):
                columns = [term["covariates"] for term in told["terms"]]
                off = "" if share is None else f"({share:.2f})"
                print(folder.name, law and law.__name__, strength, result, off, told["known"], columns, flush=True)
    print("\n| strength | sets | right columns | equivalent | what else |\n|---|---|---|---|---|")
    for strength, results in sorted(found.items()):
        sum_of = lambda start, end="": sum(n for r, n in results.items() if r.startswith(start) and r.endswith(end))  # noqa: E731
        rest = ", ".join(f"{name} {number}" for name, number in results.items() if name != "right columns, equivalent")
        print(f"| {strength:g} | {sum(results.values())} | {sum_of('right')} | {sum_of('', ', equivalent')} | {rest} |")


if __name__ == "__main__":
    main()
