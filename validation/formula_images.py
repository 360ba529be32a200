"""Formulas of images: an error of pixels that no known effect explains, written here from its physics.

A set has two images of a textured ball, drawn here in numpy at two phase angles: the prediction without the error
(EXR, with its angles), and the measured counts with it. `retina investigate` is asked for a formula. Its columns are
compared with those of the truth, and what the whole model adds to each pixel with what the truth adds there.

    python validation/formula_images.py --retina target/release/retina --out DIR [--seed N] [--sets N] [--nulls N] [--jobs N]

Equivalent: within 0.2 of the error's rms, beside what pose, gains and offset can be. Needs numpy, pillow, OpenEXR.
"""

import argparse
import collections
import csv
import json
import pathlib
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import OpenEXR
from PIL import Image

STRENGTHS = [0.3, 1.0, 3.0, 10.0]
WIDTH, HEIGHT, RADIUS, FINE = 80, 72, 21.0, 4
FULL_DN, READ_DN, ELECTRONS_PER_DN, LARGEST_DN, DRAWS = 2600.0, 2.0, 20.0, 500.0, 40
SETUP = f"""schema = "retina.setup/1"
name = "formula-images"
[screen]
width_px = 1920
height_px = 1200
width_mm = 18.7
height_mm = 11.75
bits = 8
[camera]
width_px = {WIDTH}
height_px = {HEIGHT}
pixel_um = 3.45
focal_mm = 25.0
f_number = 2.8
bits = 12
[facility]
observed_rows_px = 1200
"""


class Ball:
    """An image: light and angles at the pixels, their own rows and columns from -1 to 1."""

    def __init__(self, random, texture, phase):
        centre = np.array([WIDTH / 2, HEIGHT / 2]) + random.uniform(-5, 5, 2)
        y, x = np.mgrid[0 : HEIGHT * FINE, 0 : WIDTH * FINE]
        px, py = ((x + 0.5) / FINE - centre[0]) / RADIUS, ((y + 0.5) / FINE - centre[1]) / RADIUS
        r2 = px**2 + py**2
        on = r2 < 1
        pz = np.sqrt(np.clip(1 - r2, 0, 1))
        sun = random.uniform(0, 2 * np.pi)
        sun = np.array([np.sin(phase) * np.cos(sun), np.sin(phase) * np.sin(sun), np.cos(phase)])
        mu0 = np.clip(px * sun[0] + py * sun[1] + pz * sun[2], 0, 1) * on
        albedo = 0.12 * np.exp(0.25 * sum(a * np.sin(k[0] * px + k[1] * py + k[2] * pz + b) for a, k, b in texture))
        small = lambda v: v.reshape(HEIGHT, FINE, WIDTH, FINE).mean((1, 3))  # noqa: E731
        self.light, self.cover = small(albedo * mu0), small(on * 1.0)
        share = np.maximum(self.cover, 1e-9)
        angle = lambda cosine: np.degrees(np.arccos(np.clip(small(cosine * on) / share, 0, 1)))  # noqa: E731
        self.incidence, self.emission, self.phase = angle(mu0), angle(pz), np.full((HEIGHT, WIDTH), np.degrees(phase))
        v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
        self.u, self.v = (u + 0.5) / WIDTH * 2 - 1, (v + 0.5) / HEIGHT * 2 - 1
        self.lit = (self.cover > 0.99) & (self.light > 0.002)

    def write(self, folder, number, counts):
        channels = {
            "IF": self.light, "mask": self.cover, "incidence_deg": self.incidence, "emission_deg": self.emission,
            "phase_deg": self.phase,
        }  # fmt: skip
        channels = {name: values.astype(np.float32) for name, values in channels.items()}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, channels).write(str(folder / f"predicted{number}.exr"))
        Image.fromarray(np.clip(np.round(counts), 0, 4095).astype(np.uint16)).save(folder / f"measured{number}.png")


# Each law: columns of the truth, and what it adds to a pixel of light l (0 to 1). `n` are six numbers from 0 to 1.
def traps(b, n, l):  # the first electrons of a pixel are lost
    return np.exp(-l / (0.06 + 0.1 * n[0])) - 1


def stage_compresses(b, n, l):  # an amplifier that changes its gain at one level
    return np.maximum(l - 0.3 - 0.3 * n[0], 0) ** 1.1


def two_slopes(b, n, l):
    return 1 / (1 + np.exp(-(l - 0.3 - 0.4 * n[0]) / 0.05))


def corner_glows(b, n, l):
    at = [np.sign(n[0] - 0.5) * (0.5 + 0.4 * n[2]), np.sign(n[1] - 0.5) * (0.5 + 0.4 * n[3])]
    return 1 / (1 + ((b.u - at[0]) ** 2 + (b.v - at[1]) ** 2) / (0.2 + 0.3 * n[4]))


def rows_hum(b, n, l):  # a triangle wave down the rows
    return np.abs((b.v * (1.5 + 2 * n[0]) + n[1]) % 1 - 0.5)


def one_half_brighter(b, n, l):  # two taps read the two halves
    return l * (b.u > 0.5 * n[0] - 0.25)


def wedge_filter(b, n, l):
    return l * np.exp(0.8 * (2 * n[0] - 1 + np.sign(n[0] - 0.5)) * b.v)


def backscatters(b, n, l):  # light goes back where it came from
    return l / (1 + np.radians(b.incidence) / (0.1 + 0.2 * n[0]))


def edge_darkens(b, n, l):
    return np.where(b.cover > 0.5, l * (1 - np.cos(np.radians(b.emission))) ** (0.7 + 0.6 * n[0]), 0)


def stray_of_bright_rows(b, n, l):  # a smear that falls towards the top
    return l / (l + 0.2) * (1 + b.v) ** 1.5


LAWS = {
    traps: {"level"}, stage_compresses: {"level"}, two_slopes: {"level"}, corner_glows: {"place"}, rows_hum: {"place"},
    one_half_brighter: {"level", "place"}, wedge_filter: {"level", "place"}, backscatters: {"level", "incidence"},
    edge_darkens: {"level", "emission"}, stray_of_bright_rows: {"level", "place"},
}  # fmt: skip
COLUMNS = {
    "level_dn": "level", "camera_x_px": "place", "camera_y_px": "place", "axis_r": "place", "incidence_deg": "incidence",
    "emission_deg": "emission", "limb_distance_px": "emission", "phase_deg": "phase",
}  # fmt: skip


def beside(balls, values):
    """Values at the lit pixels of the images, without what shift, scale, roll and gain of each and one offset can be."""
    columns = []
    for k, ball in enumerate(balls):
        dy, dx = np.gradient(ball.light)
        x, y = ball.u * WIDTH / 2, ball.v * HEIGHT / 2
        for of in (ball.light, dx, dy, dx * x + dy * y, dx * y - dy * x):
            columns.append(np.concatenate([(of if j == k else 0 * of)[b.lit] for j, b in enumerate(balls)]))
    columns = np.stack([*columns, np.ones(len(columns[0]))], axis=1)
    columns /= np.abs(columns).max(0)
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]


def write(folder, seed, law, strength, blurred):
    random = np.random.default_rng(seed)
    texture = [(random.normal(), random.normal(0, 6, 3), random.uniform(0, 6.28)) for _ in range(12)]
    balls = [Ball(random, texture, np.radians(random.uniform(*limits))) for limits in ((10, 30), (45, 70))]
    top = max(ball.light.max() for ball in balls)
    noise = [np.sqrt(READ_DN**2 + ball.light / top * FULL_DN / ELECTRONS_PER_DN) for ball in balls]
    rms = np.sqrt((np.concatenate([n[b.lit] for n, b in zip(noise, balls)]) ** 2).mean())
    # An error as large as the light would leave no image. A law that would need one is drawn again; one that always does is
    # as strong as it may be.
    scale, reached = 0.0, 0.0
    for _ in range(DRAWS if law else 0):
        numbers = random.random(6)
        drawn = [law(ball, numbers, ball.light / top) for ball in balls]
        lit = np.concatenate([field[ball.lit] for ball, field in zip(balls, drawn)])
        unit = np.sqrt((beside(balls, lit) ** 2).mean()) / rms
        most = LARGEST_DN / max(np.abs(field).max() for field in drawn)
        if min(strength, most * unit) > reached:
            fields, scale, reached = drawn, min(strength / unit, most), min(strength, most * unit)
        if reached == strength:
            break
    if not law:
        fields = [0 * ball.light for ball in balls]
    counts = []
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(SETUP)
    with open(folder / "frames.csv", "w") as out:
        out.write("predicted,measured\n")
        for k, (ball, field, sigma) in enumerate(zip(balls, fields, noise)):
            light = ball.light / top * FULL_DN
            if blurred:  # a defocus of one pixel: a known effect
                for axis in (0, 1):
                    light = 0.5 * light + 0.25 * (np.roll(light, 1, axis) + np.roll(light, -1, axis))
            counts.append(900 + light + scale * field)
            ball.write(folder, k, counts[-1] + sigma * random.normal(size=light.shape))
            out.write(f"predicted{k}.exr,measured{k}.png\n")
    return balls, counts, [scale * field for field in fields], reached


def predicted(options, folder, told):
    """What the whole model says, with each pixel of the fit, its image and place."""
    files = []
    for term in told["terms"]:
        path = folder / f"{term['name']}.toml"
        path.write_text(term["effect_toml"])
        files += ["--effect", path]
    for name in told["known"]:
        files += ["--effect", name]
    table = folder / "predictions.csv"
    command = [options.retina, "fit", "--quiet", "--setup", folder / "setup.toml", "--data", folder / "frames.csv", *files]
    answer = subprocess.run([*command, "--predictions", table], capture_output=True, text=True)
    if answer.returncode != 0:
        sys.exit(f"{folder}: retina fit ended with {answer.returncode}: {answer.stderr}")
    with open(table) as rows:
        return list(csv.DictReader(rows))


def error_of(options, folder, told, balls, counts, fields):
    """Error of what the model says of the images over the rms of the hidden error, at the pixels that the fit has. Known
    effects change what a baseline is, so only the whole tells."""
    made = [np.full(ball.light.shape, np.nan) for ball in balls]
    for row in predicted(options, folder, told):
        x, y = int(float(row["camera_x_px"])), int(float(row["camera_y_px"]))
        made[int(row["image"]) - 1][y, x] = float(row["baseline"]) + float(row["effect"])
    for ball, values in zip(balls, made):
        ball.lit = ball.lit & np.isfinite(values)
    at = lambda of: np.concatenate([values[ball.lit] for ball, values in zip(balls, of)])  # noqa: E731
    truth, error = beside(balls, at(fields)), beside(balls, at(made) - at(counts))
    return np.sqrt((error**2).mean() / (truth**2).mean())


def judge(options, folder, told, law, balls, counts, fields):
    strong = [name for term in told["terms"] if not term["weak_beside"] for name in term["covariates"]]
    if law is None:
        return ("found" if strong else "a weak formula" if told["terms"] else "nothing"), None
    if not told["terms"] and not told["known"]:
        return "nothing", None
    for name in told["known"]:
        known = subprocess.run([options.retina, "effects", name, "--json"], capture_output=True, text=True, check=True)
        strong += json.loads(known.stdout)["effects"][0]["covariates"]
    columns = {COLUMNS.get(name, name) for name in strong}
    said = "right columns" if columns == LAWS[law] else "other columns"
    share = error_of(options, folder, told, balls, counts, fields)
    return f"{said}, {'equivalent' if share <= 0.2 else 'not equivalent'}", share


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--retina", required=True)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sets", type=int, default=1, help="of each law and strength")
    parser.add_argument("--nulls", type=int, default=20, help="sets without a formula; every second is blurred, which is a known effect")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    plan = [(law, strength) for law in LAWS for strength in STRENGTHS for _ in range(options.sets)]
    plan += [(None, 0.0)] * options.nulls

    def one(task):
        number, (law, strength) = task
        folder = options.out / f"{number:04d}"
        balls, counts, fields, reached = write(folder, (options.seed, number), law, strength, law is None and number % 2 == 1)
        done = folder / "investigation.json"
        if not done.exists():
            files = ["--setup", folder / "setup.toml", "--data", folder / "frames.csv"]
            answer = subprocess.run([options.retina, "investigate", "--quiet", "--json", *files], capture_output=True, text=True)
            if answer.returncode != 0:
                sys.exit(f"{folder}: retina ended with {answer.returncode}: {answer.stderr}")
            done.write_text(answer.stdout)
        told = json.loads(done.read_text())
        # Counted among those that are as strong as it is.
        strength = max([of for of in STRENGTHS if of <= 1.01 * reached], default=0.0) if law else strength
        return folder, law, strength, *judge(options, folder, told, law, balls, counts, fields), told

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
