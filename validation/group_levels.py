"""What whole exposures and series do by themselves, and columns that they follow: tables that no code of the project makes.

- `own roll`, `own scale`: each exposure is rolled or scaled by itself, normally distributed. There is no effect: anything
  but `adequate` or `undecided` is wrong.
- `period`: exposures move round a circle of 3 times the noise as a stage travels, one turn every 4 or 6 mm of 20.
- `humidity`: a power meter's gain follows the humidity by 3 or 10 %, a column of one value in each of 24 series.
- `dent`: points within 0.15 of half the camera's width of a place are moved by up to 10 times the noise, 400 points in all.
  Of these three, right is `unknown` with the column (the place, for the dent); an effect beside it is wrong.
- `none`: the same tables without any of it.

    python validation/group_levels.py --retina target/release/retina --out DIR [--seed N] [--sets N] [--jobs N]

Needs numpy.
"""

import argparse
import collections
import json
import pathlib
import subprocess
from concurrent.futures import ThreadPoolExecutor

import numpy as np

ARCSEC = np.pi / 180 / 3600
CAMERA_F = 25.0 / 0.00345
SCREEN_F = CAMERA_F * 1200 / 1536
HALF = 1024 / CAMERA_F
NOISE, JITTER = 0.8, 0.3  # arcsec
# Kind, amplitude, exposures, points in each.
POINTS = [
    ("none", 0.0, 24, 40),
    ("none", 0.0, 40, 40),
    ("none", 0.0, 12, 33),
    ("own roll", 1.0, 24, 40),
    ("own roll", 2.0, 24, 40),
    ("own roll", 1.0, 24, 120),
    ("own scale", 1.0, 24, 40),
    ("period", 4.0, 40, 40),
    ("period", 6.0, 40, 40),
    ("dent", 10.0, 1, 400),
    ("dent", 10.0, 12, 33),
]
POWER = [("none", 0.0), ("humidity", 0.03), ("humidity", 0.10)]
COLUMN = {"period": {"stage_mm"}, "humidity": {"humidity_percent"}, "dent": {"x", "y"}}


def points(path, kind, amplitude, exposures, count, seed):
    """Writes a campaign of points."""
    random = np.random.default_rng([seed, exposures, count, *kind.encode()])
    with open(path, "w") as out:
        out.write("image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,sigma_px,")
        out.write("time_s,temperature_c,stage_mm\n")
        for k in range(exposures):
            places = random.uniform(-1, 1, (count, 2)) * [1.0, 0.74]
            stage = random.uniform(0, 20)
            own = random.normal(0, amplitude)
            turn = 2 * np.pi * stage / max(amplitude, 1.0)
            near = np.exp(-((places[:, 0] - 0.7) ** 2 + (places[:, 1] - 0.5) ** 2) / 2 / 0.15**2)
            moved = {
                "none": np.zeros((count, 2)),
                "own roll": own * places[:, ::-1] * [-1, 1],
                "own scale": own * places,
                "period": 3 * NOISE * np.ones((count, 1)) * [np.cos(turn), np.sin(turn)],
                "dent": amplitude * NOISE * np.outer(near, [1, 0]),
            }[kind]
            jitter = random.normal(0, JITTER, 2)
            u = places * HALF
            seen = u * (1 + 0.35 * (u**2).sum(1, keepdims=True))
            seen = seen + ARCSEC * (moved + jitter + random.normal(0, NOISE, (count, 2)))
            counts = random.choice([18, 32, 60, 110, 180, 255], count)
            for place, at, level in zip([960, 600] + SCREEN_F * u, [1024, 768] + CAMERA_F * seen, counts):
                out.write(
                    f"e{k:03d},{place[0]:.4f},{place[1]:.4f},{level},{at[0]:.6f},{at[1]:.6f},"
                    f"{NOISE * ARCSEC * CAMERA_F:.5f},{60 * k},{20 + np.sin(0.9 * k):.3f},{stage:.4f}\n"
                )


def power(path, kind, amplitude, seed):
    """Writes 24 series of a power meter: readings to 1 %, series to 1 %."""
    random = np.random.default_rng([seed, *kind.encode()])
    with open(path, "w") as out:
        out.write("channel,digital_count,square_px,irradiance_w_m2,sigma_w_m2,time_s,series,humidity_percent\n")
        for k in range(24):
            humidity = 45 + 8 * random.normal()
            gain = (1 + random.normal(0, 0.01)) * (1 + amplitude * (humidity - 45) / 8)
            for n in range(20):
                channel, count = "rgb"[n % 3], [40, 80, 120, 180, 255][n // 4]
                light = 1e-7 * (count / 255) ** 2.2
                read = light * gain * (1 + random.normal(0, 0.01))
                out.write(f"{channel},{count},200,{read:.6e},{0.01 * light:.3e},{600 * k + 5 * n},s{k},{humidity:.3f}\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--retina", required=True)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sets", type=int, default=10, help="of each kind")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    setup = pathlib.Path(__file__).resolve().parent.parent / "assets/setups/wide-fov.toml"
    cases = [("points", *case, options.seed * 1000 + n) for case in POINTS for n in range(options.sets)]
    cases += [("power", *case, options.seed * 1000 + n) for case in POWER for n in range(options.sets)]

    def one(number):
        of, kind, *drawn = cases[number]
        path = (options.out / f"{number}.csv").resolve()
        (points if of == "points" else power)(path, kind, *drawn)
        command = [options.retina, "diagnose", "--setup", setup, "--data", path, "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
        path.unlink()
        if done.returncode != 0:
            raise SystemExit(done.stdout + done.stderr)
        answer = json.loads(done.stdout)
        wanted = COLUMN.get(kind)
        if wanted is None:
            right = answer["verdict"] in ("adequate", "undecided")
        else:
            right = bool(answer["verdict"] == "unknown" and wanted & set(answer["unexplained"]["covariates"]))
            right = right and not answer["accepted"]
        return (of, kind, *drawn[:-1]), right, "+".join([answer["verdict"], *answer["accepted"]])

    with ThreadPoolExecutor(options.jobs) as pool:
        answers = list(pool.map(one, range(len(cases))))
    table = collections.defaultdict(list)
    for case, right, says in answers:
        table[case].append((right, says))
    print("| table | amplitude | exposures x points | right | of | others |\n|---|---|---|---|---|---|")
    for (of, kind, amplitude, *size), own in table.items():
        others = collections.Counter(says for right, says in own if not right)
        cells = [f"{of}, {kind}", amplitude, " x ".join(map(str, size)) or "24 series", sum(right for right, _ in own)]
        told = ", ".join(f"{n} {says}" for says, n in others.most_common())
        print("| " + " | ".join(map(str, [*cells, len(own), told])) + " |")


if __name__ == "__main__":
    main()
