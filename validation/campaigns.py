"""Campaigns of another make: one hidden effect, or none, in tables of points that no code of the project has made.

Effects are written here from their physics (finite rotations, lags, laws of light that saturate), campaigns are drawn
as laboratories differ: 12 to 200 exposures of 10 to 150 points, at random places, on one grid or in the middle; counts
that change in an exposure or between exposures; channels, temperature cycles or one warm-up, breaks, jitter, outliers,
with stated sigmas or without. `retina diagnose` is asked what it says of each. An oracle that knows the effect's form
and the noise says whether it could be seen.

    python validation/campaigns.py --retina target/release/retina --out DIR [--seed N] [--sets N] [--nulls N] [--jobs N]

Right: the true effect or one that EFFECTS' classes do not tell from it, nothing else, nothing left. Needs numpy.
"""

import argparse
import collections
import json
import pathlib
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np

ARCSEC = np.pi / 180 / 3600
CAMERA_F = 25.0 / 0.00345
SCREEN_F = CAMERA_F * 1200 / 1536
SETUP = """schema = "retina.setup/1"
name = "campaigns"
[screen]
width_px = 1920
height_px = 1200
width_mm = 18.7
height_mm = 11.75
bits = 8
wavelength_nm = { r = 605.0, g = 544.0, b = 475.0 }
[camera]
width_px = 2048
height_px = 1536
pixel_um = 3.45
focal_mm = 25.0
f_number = 2.8
bits = 12
[facility]
observed_rows_px = 1200
"""
CLASSES = [
    {"screen_tilt", "camera_pointing", "decentering", "optical_centre", "thin_prism"},
    {"thermal_boresight", "drift"},
    {"background_gradient", "flux_shift"},
    {"colour_wedge", "subpixel_offset"},
]
STRENGTHS = [0.3, 1.0, 3.0, 10.0]


class Campaign:
    """Where, when and how bright points are shown, and what a camera without the effect sees."""

    def __init__(self, random):
        self.random = random
        self.exposures = int(random.choice([12, 24, 40, 80, 200]))
        per = int(random.choice([10, 30, 50, 150]))
        while per * self.exposures > 4000:
            per = int(random.choice([10, 30, 50]))
        self.rows = per * self.exposures
        self.image = np.repeat(np.arange(self.exposures), per)
        self.layout = random.choice(["random", "grid", "middle"])
        if self.layout == "grid":
            side = int(np.ceil(np.sqrt(per)))
            x, y = np.meshgrid(np.linspace(340, 1580, side), np.linspace(30, 1170, side))
            cells = random.permutation(side * side)[:per]
            places = np.stack([x.ravel()[cells], y.ravel()[cells]], axis=1)
            self.screen = np.tile(places, (self.exposures, 1)) + random.uniform(-0.5, 0.5, (self.rows, 2))
        else:
            share = 0.7 if self.layout == "middle" else 1.0
            half = np.array([620.0, 580.0]) * share
            self.screen = [960, 600] + random.uniform(-1, 1, (self.rows, 2)) * half
        self.screen = np.round(self.screen, 3)
        self.by_exposure = random.random() < 0.3
        levels = random.choice([24, 40, 64, 100, 160, 255], self.exposures if self.by_exposure else self.rows)
        self.counts = levels[self.image] if self.by_exposure else levels
        self.coloured = random.random() < 0.4
        channel = random.choice(list("rgb"), self.exposures) if self.coloured else np.full(self.exposures, "w")
        self.channel = channel[self.image]
        steps = random.uniform(20, 90, self.exposures)
        if random.random() < 0.3:
            steps[random.integers(1, self.exposures)] += 3600
        self.at_s = np.cumsum(steps) - steps[0]
        hours = self.at_s / 3600
        span = hours[-1]
        self.cycled = random.random() < 0.6
        period, phase = span / random.uniform(1.5, 4), random.uniform(0, 6)
        self.room = lambda t: 21 + (
            2.5 * np.sin(2 * np.pi * t / period + phase) if self.cycled else 4 * (1 - np.exp(-np.maximum(t, 0) / (0.4 * span)))
        )
        self.before_h = random.choice([0.0, 2.0])  # how long the bench has followed the room when the first exposure is taken
        self.exposure_temperature = self.room(hours)
        self.time_s = self.at_s[self.image]
        self.temperature = self.exposure_temperature[self.image]
        self.load = np.clip(random.gamma(2.0, 0.08, self.rows), 0, 1)
        self.flux = (self.counts / 255) ** 2.2
        self.line = (self.screen - [960, 600]) / SCREEN_F
        self.r2 = (self.line**2).sum(1, keepdims=True) / (1024 / CAMERA_F) ** 2
        self.noise = random.choice([0.03, 0.05, 0.1])  # px of the camera
        self.sigma = self.noise * (1 + random.uniform(0, 0.6) * np.minimum(1 / self.flux - 1, 60) / 60)
        self.jitter = random.choice([0.0, 0.3, 1.0]) * self.noise
        self.outliers = random.choice([0.0, 0.01, 0.03])
        self.stated = random.random() < 0.5

    def seen(self, line, behind=0.0):
        """Camera px of places on the screen: the facility's own distortion, what acts behind it, then the camera, slightly
        turned."""
        k1, scale, roll, aside = self.facility
        radial = line * (1 + k1 * (line**2).sum(1, keepdims=True)) * scale + behind
        c, s = np.cos(roll), np.sin(roll)
        turned = radial @ np.array([[c, -s], [s, c]]).T + aside
        return turned * CAMERA_F + [1024, 768]

    def add_noise(self, camera):
        """Each point's own, what an exposure's points share, and outliers."""
        random = self.random
        camera += random.normal(size=(self.rows, 2)) * self.sigma[:, None]
        camera += (random.normal(size=(self.exposures, 2)) * self.jitter)[self.image]
        wild = random.random(self.rows) < self.outliers
        camera[wild] += random.uniform(-4, 4, (wild.sum(), 2))

    def draw_facility(self):
        random = self.random
        self.facility = (
            random.uniform(-0.1, 0.4),
            1 + random.normal(0, 0.004),
            random.normal(0, 0.005),
            random.normal(0, 4e-4, 2),
        )

    def lagged(self, tau_s):
        """The bench's temperature behind a first-order lag of the room's, in steps of a second, less its mean."""
        t = np.arange(-3600 * self.before_h, self.at_s[-1] + 2.0)
        room = self.room(t / 3600)
        inside = np.empty_like(room)
        inside[0] = room[0]
        for k in range(1, len(t)):
            inside[k] = inside[k - 1] + (1 - np.exp(-1 / tau_s)) * (room[k] - inside[k - 1])
        own = np.interp(self.at_s, t, inside)
        return (own - own.mean())[self.image][:, None]


def law_of_light(random, flux):
    """What grows with the light, in one of three ways."""
    light = np.log10(flux)[:, None]
    kind = random.integers(3)
    if kind == 0:
        return light
    if kind == 1:
        half = 10 ** random.uniform(-1.5, -0.5)
        return (flux / (flux + half))[:, None]
    return np.log10(flux + 10 ** random.uniform(-2, -1))[:, None]


def effect(name, c):
    """Displacement of every point, lines of sight, at an amplitude that is scaled later; None: this campaign cannot show it."""
    random, u, r2 = c.random, c.line / (1024 / CAMERA_F), c.r2
    angle = random.uniform(0, 2 * np.pi)
    towards = np.array([np.cos(angle), np.sin(angle)])[None]
    light = np.log10(c.flux)[:, None]
    if name == "screen_tilt":
        return u * (u @ towards.T)
    if name == "decentering":
        p, q = towards[0]
        x, y = u.T
        return np.stack([p * (r2[:, 0] + 2 * x * x) + 2 * q * x * y, 2 * p * x * y + q * (r2[:, 0] + 2 * y * y)], axis=1)
    if name == "thin_prism":
        return towards * r2
    if name == "radial_higher_order":
        power = random.choice([2, 3])
        return u * r2**power
    if name == "screen_bow":
        x, y = u.T
        return u * (towards[0, 0] * (x * x - y * y) + 2 * towards[0, 1] * x * y)[:, None]
    if name == "flux_coma":
        return None if c.by_exposure and c.exposures < 24 else law_of_light(random, c.flux) * u * r2 ** random.uniform(0, 1)
    if name == "flux_shift":
        return None if c.by_exposure else law_of_light(random, c.flux) * towards
    if name == "background_gradient":
        return None if c.by_exposure else towards / c.flux[:, None]
    if name in ("lateral_colour", "colour_wedge", "subpixel_offset"):
        if not c.coloured:
            return None
        number = np.searchsorted(list("bgr"), c.channel)
        if name == "subpixel_offset":
            return np.stack([(number - 1) / 3.0, np.zeros(c.rows)], axis=1)
        share = random.normal(size=3)[number][:, None]
        return share * u * (1 + random.uniform(0, 0.5) * r2) if name == "lateral_colour" else share * towards
    if name == "thermal_boresight":
        return towards * c.lagged(random.choice([1.0, 300.0, 1200.0]))
    if name == "thermal_focal":
        return u * c.lagged(random.choice([1.0, 300.0, 1200.0]))
    share_of_time = (c.time_s / c.time_s.max())[:, None]
    if name == "drift":
        return towards * share_of_time ** random.choice([0.5, 1.0, 2.0])
    if name == "roll_drift":
        return u[:, ::-1] * [-1, 1] * share_of_time
    if name == "knock":
        return towards * (c.image >= random.integers(c.exposures // 4, 3 * c.exposures // 4))[:, None]
    if name == "camera_pixel_phase":
        phase = 2 * np.pi * c.seen(c.line)
        return (np.sin(phase) + random.uniform(0, 0.2) * np.sin(2 * phase)) * (0.6 + np.abs(towards))
    if name == "screen_pixel_phase":
        phase = 2 * np.pi * c.screen
        return np.sin(phase) * (0.6 + np.abs(towards)) / (c.counts[:, None] / 24)
    if name == "row_loading_shift":
        return towards * c.load[:, None]
    raise ValueError(name)


EFFECTS = [
    "screen_tilt", "decentering", "thin_prism", "radial_higher_order", "screen_bow", "flux_coma", "flux_shift",
    "background_gradient", "lateral_colour", "colour_wedge", "subpixel_offset", "thermal_boresight", "thermal_focal",
    "drift", "roll_drift", "knock", "camera_pixel_phase", "screen_pixel_phase", "row_loading_shift",
]  # fmt: skip


def beyond_baseline(c, field):
    """A field less shift, linear terms and k1, all fitted."""
    u, r2 = c.line / (1024 / CAMERA_F), c.r2
    zero, one = np.zeros(c.rows), np.ones(c.rows)
    columns = [np.stack([v, zero], 1).ravel() for v in (one, u[:, 0], u[:, 1])]
    columns += [np.stack([zero, v], 1).ravel() for v in (one, u[:, 0], u[:, 1])]
    columns += [(u * r2).ravel()]
    columns = np.stack(columns, axis=1)
    return field - (columns @ np.linalg.lstsq(columns, field.ravel(), rcond=None)[0]).reshape(-1, 2)


def oracle_sigmas(c, left):
    """How many standard deviations the effect is, by its form and the noise: exposures share a jitter."""
    total = 0.0
    for k in range(c.exposures):
        mine = c.image == k
        weight = 1 / (c.sigma[mine, None] / CAMERA_F) ** 2
        field = left[mine]
        whole = weight.sum()
        mean = (weight * field).sum(0) / whole
        total += (weight * (field - mean) ** 2).sum() + (mean**2).sum() / (1 / whole + (c.jitter / CAMERA_F) ** 2)
    return np.sqrt(total)


def write(folder, seed, name, strength):
    random = np.random.default_rng(seed)
    for _ in range(200):
        c = Campaign(random)
        c.draw_facility()
        if name in ("camera_pixel_phase", "screen_pixel_phase"):
            # A pixel's phase moves centroids by some hundredths of a pixel: strong is what is strong beside the noise.
            quieter = min(1.0, 0.05 / (strength * c.noise))
            c.noise, c.sigma, c.jitter = c.noise * quieter, c.sigma * quieter, c.jitter * quieter
        field = np.zeros((c.rows, 2)) if name is None else effect(name, c)
        if field is not None:
            break
    sigmas = 0.0
    if name is not None:
        left = beyond_baseline(c, field)
        scale = strength * c.noise / CAMERA_F / np.sqrt((left**2).mean())
        field *= scale
        sigmas = oracle_sigmas(c, left * scale)
    # An effect of the display or the lenses acts before the distortion, one of the camera behind it; half of them each.
    camera = c.seen(c.line, field) if random.random() < 0.5 else c.seen(c.line + field)
    c.add_noise(camera)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(SETUP)
    head = "image,screen_x_px,screen_y_px,digital_count,channel,time_s,temperature_c,row_load,camera_x_px,camera_y_px"
    with open(folder / "points.csv", "w") as out:
        out.write(head + (",sigma_px" if c.stated else "") + "\n")
        for k in range(c.rows):
            row = f"e{c.image[k]:03d},{c.screen[k, 0]:.3f},{c.screen[k, 1]:.3f},{c.counts[k]},{c.channel[k]},"
            row += f"{c.time_s[k]:.2f},{c.temperature[k]:.4f},{c.load[k]:.5f},{camera[k, 0]:.5f},{camera[k, 1]:.5f}"
            out.write(row + (f",{c.sigma[k]:.5f}" if c.stated else "") + "\n")
    about = {
        "effect": name, "strength": strength, "oracle_sigmas": sigmas, "exposures": c.exposures, "rows": c.rows,
        "layout": str(c.layout), "by_exposure": bool(c.by_exposure), "coloured": bool(c.coloured),
        "cycled": bool(c.cycled), "jitter": c.jitter / c.noise, "outliers": c.outliers, "stated": bool(c.stated),
    }  # fmt: skip
    (folder / "truth.json").write_text(json.dumps(about, indent=1))
    return about


def equals(name):
    return next((group for group in CLASSES if name in group), {name})


def judge(about, told):
    accepted = told["accepted"]
    if about["effect"] is None:
        return "right" if told["verdict"] in ("adequate", "undecided") else "false alarm"
    same = equals(about["effect"])
    others = [one for one in accepted if one not in same]
    if told["verdict"] in ("adequate", "undecided"):
        return "not seen"
    if others and not any(one in same for one in accepted):
        rivals = set(told["indistinguishable"])
        if told["verdict"] == "confounded" and about["effect"] in rivals and len(others) == 1:
            return "right"
        return "wrong"
    if others:
        return "beside others"
    if told["verdict"] == "unknown":
        return "something left" if accepted else "unknown"
    return "right"


def run(retina, folder, about):
    done = folder / "diagnosis.json"
    if not done.exists():
        command = [retina, "diagnose", "--quiet", "--json", "--setup", folder / "setup.toml", "--data", folder / "points.csv"]
        answer = subprocess.run(command, capture_output=True, text=True)
        if answer.returncode != 0:
            sys.exit(f"{folder}: retina ended with {answer.returncode}: {answer.stderr}")
        done.write_text(answer.stdout)
    told = json.loads(done.read_text())
    return judge(about, told), told


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--retina", required=True)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sets", type=int, default=2, help="of each effect and strength")
    parser.add_argument("--nulls", type=int, default=20, help="campaigns without an effect")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    plan = [(name, strength) for name in EFFECTS for strength in STRENGTHS for _ in range(options.sets)]
    plan += [(None, 0.0)] * options.nulls

    def one(task):
        number, (name, strength) = task
        folder = options.out / f"{number:04d}"
        about = write(folder, (options.seed, number), name, strength)
        return folder, about, *run(options.retina, folder, about)

    table = collections.defaultdict(collections.Counter)
    with ThreadPoolExecutor(options.jobs) as pool:
        for folder, about, result, told in pool.map(one, enumerate(plan)):
            sure = "null" if about["effect"] is None else "sure" if about["oracle_sigmas"] > 6 else "not sure"
            table[about["strength"], sure][result] += 1
            if result != "right":
                print(
                    f"{folder.name} {about['effect']} {about['strength']} ({about['oracle_sigmas']:.0f} sigma):",
                    f"{result}: {told['verdict']} {told['accepted']} {told['unexplained']['covariates']}",
                    f"[{about['exposures']} x {about['rows'] // about['exposures']}, {about['layout']},",
                    f"jitter {about['jitter']}, outliers {about['outliers']}, stated {about['stated']},",
                    f"by exposure {about['by_exposure']}, cycled {about['cycled']}]",
                    flush=True,
                )
    print("\n| strength | oracle | sets | right | what else |\n|---|---|---|---|---|")
    for (strength, sure), results in sorted(table.items()):
        rest = ", ".join(f"{name} {number}" for name, number in results.items() if name != "right")
        print(f"| {strength:g} | {sure} | {sum(results.values())} | {results['right']} | {rest} |")


if __name__ == "__main__":
    main()
