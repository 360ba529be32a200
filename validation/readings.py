"""Readings of a power meter of another make: one hidden effect, or none, in tables that no code of the project has made.

A display with unequal channels, each with its own exponent and a black that is not black, is calibrated from ten series
(`retina calibrate radiometry`); then campaigns of 3 to 24 series are drawn as laboratories differ (sweeps by channel, or
all settings at random; series that repeat within 0 to 1 %; one day or several), with an effect written here from its
physics. `retina diagnose` is asked what it says of each.

    python validation/readings.py --retina target/release/retina --out DIR [--seed N] [--sets N] [--nulls N] [--jobs N]

Right: the true effect among those that are said to fit, nothing else accepted, nothing left. The oracle knows the form
and the noise; it is sure where the effect is more than six standard deviations beside gains of series. Needs numpy.
"""

import argparse
import collections
import json
import pathlib
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import campaigns

PER_PIXEL = 2.3e-11  # W m^-2 of a white pixel at 255
SHARES = {"r": 0.25, "g": 0.47, "b": 0.28}
COUNTS = [12, 20, 32, 48, 64, 96, 128, 160, 192, 224, 255]
SQUARES = [20, 40, 80, 160, 320, 480]
STRENGTHS = [0.3, 1.0, 3.0, 10.0]
EFFECTS = [
    "gamma", "black_level", "square_loading", "pixel_crosstalk", "self_heating", "ageing", "meter_zero",
    "meter_wavelength", "meter_nonlinearity", "channel_nonadditivity", "attenuator_not_changed",
]  # fmt: skip


class Display:
    def __init__(self, random):
        self.exponent = {c: 2.2 + random.normal(0, 0.05) for c in "rgb"}
        self.black = {c: abs(random.normal(0, 2e-5)) for c in "rgb"}
        self.gain = {c: SHARES[c] * np.exp(random.normal(0, 0.1)) for c in "rgb"}

    def light(self, channel, count, more=0.0, black=0.0):
        lit = "rgb" if channel == "w" else channel
        level = count / 255
        return PER_PIXEL * sum(self.gain[c] * (level ** (self.exponent[c] + more) + self.black[c] + black) for c in lit)


class Readings:
    """Settings, times and noise of a campaign."""

    def __init__(self, random, series):
        self.random, self.series = random, series
        per = int(random.choice([24, 40, 80]))
        by_channel = random.random() < 0.3
        self.channel, self.count, self.square, self.of = [], [], [], []
        for k in range(series):
            lit = "rgbw"[k % 4] if by_channel and series >= 8 else None
            for j in range(per):
                self.channel.append(lit or random.choice(list("rgbw")))
                self.count.append(int(random.choice(COUNTS)))
                self.square.append(0 if j % 20 == 0 else int(random.choice(SQUARES)))
                self.of.append(k)
        self.count, self.square, self.of = map(np.array, (self.count, self.square, self.of))
        self.rows = len(self.of)
        pause = 3600 * random.choice([0.2, 12.0])
        self.time_s = np.cumsum(random.uniform(15, 40, self.rows)) + pause * self.of
        since = self.time_s - np.array([self.time_s[self.of == k][0] for k in range(series)])[self.of]
        self.since = since
        self.temperature = 22 + 3 * (1 - np.exp(-since / 900)) + 0.5 * np.sin(self.time_s / 20000)
        self.relative = random.choice([0.002, 0.005])
        self.floor = random.choice([2e-9, 1e-8]) * 0.05
        self.scatter = random.choice([0.0, 0.003, 0.01])
        self.stated = random.random() < 0.6


def change(name, c, display):
    """What an effect adds to every reading at an amplitude of one, W m^-2; scaled later."""
    random = c.random
    plain = plain_light(c, display)
    if name == "gamma":
        return c.square**2 * np.array(
            [(display.light(ch, n, more=1e-4) - display.light(ch, n)) / 1e-4 for ch, n in zip(c.channel, c.count)]
        ) * random.choice([-1, 1])  # fmt: skip
    if name == "black_level":
        return c.square**2 * np.array([display.light(ch, 0, black=1.0) for ch in c.channel])
    if name == "square_loading":
        load = (c.square / 480) ** random.choice([1, 2]) * (c.count / 255) ** 2.2
        return -plain * load
    if name == "pixel_crosstalk":
        return plain / np.maximum(c.square, 1) * random.choice([-1, 1])
    if name == "self_heating":
        tau = random.choice([300.0, 1200.0])
        return -plain * (1 - np.exp(-c.since / tau))
    if name == "ageing":
        dose = np.cumsum(plain * np.diff(c.time_s, prepend=c.time_s[0]).clip(0, 60))
        return -plain * dose / dose[-1]
    if name == "meter_zero":
        return np.ones(c.rows) * random.choice([-1, 1])
    if name == "meter_wavelength":
        factors = dict(zip("rgb", random.normal(size=3)))
        own = np.array([
            sum(factors[s] * PER_PIXEL * display.gain[s] * ((n / 255) ** display.exponent[s] + display.black[s])
                for s in ("rgb" if ch == "w" else ch))
            for ch, n in zip(c.channel, c.count)
        ])  # fmt: skip
        return c.square**2 * own
    if name == "meter_nonlinearity":
        return plain**2 / plain.max() * random.choice([-1, 1])
    if name == "channel_nonadditivity":
        return -plain * (np.array(c.channel) == "w")
    wrong = random.integers(c.series)
    return plain * (c.of == wrong)


def plain_light(c, display):
    return c.square**2 * np.array([display.light(ch, n) for ch, n in zip(c.channel, c.count)])


def table(path, c, light):
    random = c.random
    sigma = np.hypot(c.relative * light, c.floor)
    gains = np.exp(random.normal(size=c.series) * c.scatter)[c.of]
    reading = light * gains + random.normal(size=c.rows) * sigma
    with open(path, "w") as out:
        out.write("series,channel,digital_count,square_px,time_s,temperature_c,irradiance_w_m2" + (",sigma_w_m2\n" if c.stated else "\n"))
        for k in range(c.rows):
            row = f"s{c.of[k]:02d},{c.channel[k]},{c.count[k]},{c.square[k]},{c.time_s[k]:.1f},{c.temperature[k]:.3f},{reading[k]:.6e}"
            out.write(row + (f",{sigma[k]:.3e}\n" if c.stated else "\n"))
    return sigma


def oracle_sigmas(c, added, light, sigma):
    """Amplitude of the effect over its standard deviation, beside one gain of all and the series' own scatter."""
    weight, gain_variance = 1 / sigma**2, c.scatter**2
    whole, cross, own = 0.0, 0.0, 0.0
    for k in range(c.series):
        mine = c.of == k
        w, f, g = weight[mine], added[mine], light[mine]
        known = (w * g * g).sum()
        kept = gain_variance / (1 + gain_variance * known)
        inner = lambda a, b: (w * a * b).sum() - kept * (w * a * g).sum() * (w * b * g).sum()  # noqa: E731
        whole, cross, own = whole + inner(f, f), cross + inner(f, g), own + inner(g, g)
    return np.sqrt(max(whole - cross**2 / own, 0.0))


def write(folder, seed, name, strength, display):
    random = np.random.default_rng(seed)
    c = Readings(random, int(random.choice([3, 6, 10, 24])))
    light = plain_light(c, display)
    sigma = np.hypot(c.relative * light, c.floor)
    sigmas = 0.0
    if name is not None:
        added = change(name, c, display)
        if name == "attenuator_not_changed":
            added *= random.choice([2.0, 5.0, 10.0]) - 1
        else:
            added *= strength / np.sqrt(np.mean((added / sigma) ** 2))
        sigmas = oracle_sigmas(c, added, light, sigma)
        light = light + added
    folder.mkdir(parents=True, exist_ok=True)
    table(folder / "power.csv", c, light)
    about = {
        "effect": name, "strength": strength, "oracle_sigmas": sigmas, "series": c.series, "rows": c.rows,
        "scatter": c.scatter, "relative": c.relative, "stated": bool(c.stated),
    }  # fmt: skip
    (folder / "truth.json").write_text(json.dumps(about, indent=1))
    return about


def judge(about, told):
    accepted, truth = told["accepted"], about["effect"]
    if truth is None:
        return "right" if told["verdict"] in ("adequate", "undecided") else "false alarm"
    if told["verdict"] in ("adequate", "undecided"):
        return "not seen"
    if told["verdict"] == "unknown" and not accepted:
        return "unknown"
    if truth not in told["indistinguishable"]:
        return "wrong"
    if len(accepted) > 1:
        return "beside others"
    return "something left" if told["verdict"] == "unknown" else "right"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--retina", required=True)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sets", type=int, default=2, help="of each effect and strength")
    parser.add_argument("--nulls", type=int, default=20, help="campaigns without an effect")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng((options.seed, 999_999))
    display = Display(random)
    (options.out / "setup.toml").write_text(campaigns.SETUP)
    base = Readings(random, 10)
    base.stated = True
    table(options.out / "power.csv", base, plain_light(base, display))
    setup, calibration = options.out / "setup.toml", options.out / "calibration.toml"
    command = ["calibrate", "radiometry", "--setup", setup, "--data", options.out / "power.csv", "--out", calibration]
    subprocess.run([options.retina, *command], check=True, capture_output=True)
    plan = [(name, strength) for name in EFFECTS for strength in STRENGTHS for _ in range(options.sets)]
    plan += [(None, 0.0)] * options.nulls

    def one(task):
        number, (name, strength) = task
        folder = options.out / f"{number:04d}"
        about = write(folder, (options.seed, number), name, strength, display)
        done = folder / "diagnosis.json"
        if not done.exists():
            command = ["diagnose", "--quiet", "--json", "--setup", setup, "--data", folder / "power.csv", "--calibration", calibration]
            answer = subprocess.run([options.retina, *command], capture_output=True, text=True)
            if answer.returncode != 0:
                sys.exit(f"{folder}: retina ended with {answer.returncode}: {answer.stderr}")
            done.write_text(answer.stdout)
        told = json.loads(done.read_text())
        return folder, about, judge(about, told), told

    found = collections.defaultdict(collections.Counter)
    with ThreadPoolExecutor(options.jobs) as pool:
        for folder, about, result, told in pool.map(one, enumerate(plan)):
            sure = "null" if about["effect"] is None else "sure" if about["oracle_sigmas"] > 6 else "not sure"
            found[about["strength"], sure][result] += 1
            if result != "right":
                print(
                    f"{folder.name} {about['effect']} {about['strength']} ({about['oracle_sigmas']:.0f} sigma):",
                    f"{result}: {told['verdict']} {told['accepted']} of {told['indistinguishable']}",
                    f"{told['unexplained']['covariates']} [{about['series']} x {about['rows'] // about['series']},",
                    f"scatter {about['scatter']}, noise {about['relative']}, stated {about['stated']}]",
                    flush=True,
                )
    print("\n| strength | oracle | sets | right | what else |\n|---|---|---|---|---|")
    for (strength, sure), results in sorted(found.items()):
        rest = ", ".join(f"{name} {number}" for name, number in results.items() if name != "right")
        print(f"| {strength:g} | {sure} | {sum(results.values())} | {results['right']} | {rest} |")


if __name__ == "__main__":
    main()
