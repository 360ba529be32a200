"""Effects that no catalogue has, which follow a column of the table, beside columns that mean nothing.

Makes tables of points with a humidity that wanders and a pressure that swings, and asks `retina diagnose`:
- effects outside the catalogue that follow the humidity, its square, the pressure, or a swing in time, which shift whole
  exposures, scale them, or have a shape of their own: naming an effect of the catalogue is wrong;
- a knock, and a drift: naming another effect, or none where an oracle sees it, is wrong;
- nothing: anything but `adequate` or `undecided` is wrong.

    python validation/other_columns.py --retina target/release/retina --out DIR [--seed N] [--sets N] [--jobs N]

Needs numpy.
"""

import argparse
import collections
import json
import pathlib
import subprocess
from concurrent.futures import ThreadPoolExecutor

import numpy as np

NOISE = 1.5  # arcsec
JITTER = 0.45
ARCSEC = np.pi / 180 / 3600
CAMERA_F = 25.0 / 0.00345
SCREEN_F = CAMERA_F * 1200 / 1536
HALF = 1024 / CAMERA_F
POINTS = 40
STRENGTHS = [0.5, 1.0, 3.0]
OUTSIDE = ["shift", "square", "scale", "prism", "pressure", "swing"]
INSIDE = {"knock": {"knock"}, "drift": {"drift", "thermal_boresight"}}


def displacement(kind, places, when, drawn):
    """Displacement of each point, without its size; `places` in half widths of the camera."""
    t, humid, pressure, step, phase, towards = (
        when["t"], when["humid"], when["pressure"], drawn["step"], drawn["phase"], drawn["towards"]
    )
    along = towards[None, :] * np.ones((len(places), 1))
    swing = np.sin(2 * np.pi * 1.3 * t + phase)
    x, y = places[:, :1], places[:, 1:]
    return {
        "shift": lambda: along * humid,
        "square": lambda: along * (humid**2 - 1),
        "scale": lambda: places * humid,
        "prism": lambda: along * humid * (0.6 + 0.8 * x),
        "pressure": lambda: along * pressure,
        "swing": lambda: (1.6 * np.hstack([x * y, y * y]) + 0.5 * along) * swing,
        "knock": lambda: along * float(t >= step),
        "drift": lambda: along * t,
        "null": lambda: 0 * along,
    }[kind]()


def table(path, kind, strength, seed):
    """Writes a campaign."""
    random = np.random.default_rng([seed, *kind.encode()])
    exposures = int(random.integers(24, 48))
    time_s = np.arange(exposures) * 120.0 + random.uniform(0, 20, exposures)
    t = (time_s - time_s[0]) / (time_s[-1] - time_s[0])
    temperature = 20 + 0.8 * (1 - np.exp(-time_s / 1500)) + 0.1 * random.normal(size=exposures)
    humid = np.zeros(exposures)
    for k in range(exposures):
        humid[k] = 0.9 * humid[k - 1] + np.sqrt(1 - 0.81) * random.normal() if k else random.normal()
    humid += (t - 0.5) * np.sqrt(12) * random.uniform(-1, 1)
    pressure = np.sqrt(2) * np.sin(2 * np.pi * random.uniform(0.6, 1.6) * t + random.uniform(0, 6))
    angle = random.uniform(0, 2 * np.pi)
    drawn = {
        "step": t[random.integers(exposures // 4, 3 * exposures // 4)],
        "phase": random.uniform(0, 2 * np.pi),
        "towards": np.array([np.cos(angle), np.sin(angle)]),
    }
    places = [random.uniform(-1, 1, (POINTS, 2)) * [1.0, 0.74] for _ in range(exposures)]
    effect = [
        displacement(kind, places[k], {"t": t[k], "humid": humid[k], "pressure": pressure[k]}, drawn)
        for k in range(exposures)
    ]
    if kind == "swing":  # What stands still of it would be a tilt, which the catalogue has.
        swings = np.sin(2 * np.pi * 1.3 * t + drawn["phase"])
        effect = [own * (1 - swings.mean() / swing) for own, swing in zip(effect, swings)]
    rms = np.sqrt(np.mean(np.square(effect)))
    size = strength * NOISE / rms if rms > 0 else 0.0
    with open(path, "w") as out:
        out.write("image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,")
        out.write("time_s,temperature_c,humidity_pct,pressure_hpa\n")
        for k in range(exposures):
            jitter = random.normal(0, JITTER, 2)
            for place, moved in zip(places[k], effect[k]):
                u = place * HALF
                seen = u * (1 + 0.35 * (u @ u))
                seen = 1.002 * np.array([seen[0] - 0.01 * seen[1], seen[1] + 0.01 * seen[0]]) + [3e-4, -2e-4]
                seen += ARCSEC * (size * moved + jitter + random.normal(0, NOISE, 2))
                screen, camera = [960, 600] + SCREEN_F * u, [1024, 768] + CAMERA_F * seen
                count = random.choice([18, 32, 60, 110, 180, 255])
                out.write(
                    f"e{k:03d},{screen[0]:.4f},{screen[1]:.4f},{count},{camera[0]:.6f},{camera[1]:.6f},"
                    f"{time_s[k]:.2f},{temperature[k]:.3f},{45 + 6 * humid[k]:.3f},{1013 + 3 * pressure[k]:.3f}\n"
                )


def judged(kind, answer):
    """What the answer is: right, missed, wrong or doubtful (an effect with a column of the table beside it)."""
    accepted, verdict = answer["accepted"], answer["verdict"]
    if kind == "null":
        return "right" if verdict in ("adequate", "undecided") else "wrong"
    if not accepted:
        return "right" if kind in OUTSIDE and verdict == "unknown" else "missed"
    if kind in INSIDE:
        known = {accepted[0], *answer["rivals"].get(accepted[0], [])}
        alone = len(accepted) == 1 and verdict in ("named", "confounded")
        return "right" if alone and known & INSIDE[kind] else "wrong"
    return "doubtful" if verdict != "unknown" and answer.get("rival_columns") else "wrong"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--retina", required=True)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sets", type=int, default=10, help="of each kind and strength")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    setup = pathlib.Path(__file__).resolve().parent.parent / "assets/setups/wide-fov.toml"
    cases = [
        (kind, strength, options.seed * 1000 + n)
        for kind in [*OUTSIDE, *INSIDE]
        for strength in STRENGTHS
        for n in range(options.sets)
    ]
    cases += [("null", 0.0, options.seed * 1000 + 500 + n) for n in range(6 * options.sets)]

    def one(case):
        kind, strength, seed = case
        path = (options.out / f"{kind}_{strength}_{seed}.csv").resolve()
        table(path, kind, strength, seed)
        command = [options.retina, "diagnose", "--setup", setup, "--data", path, "--json"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        path.unlink()
        return kind, strength, judged(kind, json.loads(done.stdout)), json.loads(done.stdout)

    with ThreadPoolExecutor(options.jobs) as pool:
        answers = list(pool.map(one, cases))
    counts = collections.defaultdict(collections.Counter)
    with open(options.out / "answers.jsonl", "w") as out:
        for kind, strength, says, answer in answers:
            counts[kind, strength][says] += 1
            short = {key: answer[key] for key in ("verdict", "accepted", "headline")}
            out.write(json.dumps({"kind": kind, "strength": strength, "is": says, **short}) + "\n")
    print("| hidden | strength | sets | right | nothing found | doubtful | wrong |\n|---|---|---|---|---|---|---|")
    for (kind, strength), own in counts.items():
        cells = [own[says] for says in ("right", "missed", "doubtful", "wrong")]
        print(f"| {kind} | {strength} | {own.total()} | " + " | ".join(map(str, cells)) + " |")
    for strength in STRENGTHS:
        own = sum((counts[kind, strength] for kind in OUTSIDE), collections.Counter())
        cells = [own[says] for says in ("right", "missed", "doubtful", "wrong")]
        print(f"| all outside | {strength} | {own.total()} | " + " | ".join(map(str, cells)) + " |")


if __name__ == "__main__":
    main()
