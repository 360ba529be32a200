"""Structure that no effect of the catalogue has, at many scales, and noise that is honest but correlated.

Makes tables of points with its own random fields and asks `retina diagnose` what it says of them:
- six kinds of structure that stays in the field (ripples, square waves, checkerboards, random smooth fields, stripes with
  an offset each, dents), at four scales, at one, three and ten times the noise: `unknown` is right;
- noise alone, noise with air (a new smooth field in each exposure), with a mount that wanders (an autoregressive shift
  from exposure to exposure), and with few exposures: `adequate` (or `undecided`) is right.

    python validation/structures.py --retina target/release/retina --out DIR [--seeds N] [--jobs N]
"""

import argparse
import json
import pathlib
import subprocess
from concurrent.futures import ThreadPoolExecutor

import numpy as np

NOISE = 1.5  # arcsec
ARCSEC = np.pi / 180 / 3600
CAMERA_F = 25.0 / 0.00345
SCREEN_F = CAMERA_F * 1200 / 1536
SIZE = np.array([2048.0, 1536.0])


def smooth(random, places, length):
    """A random field of unit rms over `places` (px) with a correlation length, two components."""
    waves = 200
    k = random.normal(0, 1 / length, (waves, 2))
    phase = random.uniform(0, 2 * np.pi, (waves, 2))
    return np.stack([np.cos(places @ k.T + phase[:, a]).sum(1) * np.sqrt(2 / waves) for a in range(2)], axis=1)


def structure(random, kind, scale, places):
    """Field of unit rms per axis at places in px of the screen; `scale` is its wavelength, px."""
    angle = random.uniform(0, np.pi)
    along = np.array([np.cos(angle), np.sin(angle)])
    towards = random.normal(size=2)
    towards *= np.sqrt(2) / np.linalg.norm(towards)
    t = places @ along / scale + random.uniform()
    across = places @ np.array([-along[1], along[0]]) / scale + random.uniform()
    if kind == "ripple":
        return np.sqrt(2) * np.sin(2 * np.pi * t)[:, None] * towards
    if kind == "square":
        return np.sign(np.sin(2 * np.pi * t))[:, None] * towards
    if kind == "checkerboard":
        return (np.sign(np.sin(2 * np.pi * t)) * np.sign(np.sin(2 * np.pi * across)))[:, None] * towards
    if kind == "smooth":
        return smooth(random, places, scale / 4)
    if kind == "stripes":
        stripe = np.floor(places[:, 0] / (scale / 2)).astype(int)
        offsets = random.normal(size=(stripe.max() + 1, 1)) * np.array([[np.sqrt(2), 0.0]])
        return offsets[stripe]
    centres = random.uniform([0, 0], [1920, 1200], (max(8, int(2304000 / (scale * scale))), 2))
    sign = random.choice([-1, 1], len(centres))
    out = np.zeros((len(places), 2))
    for centre, s in zip(centres, sign):
        d = places - centre
        out += s * d * np.exp(-(d**2).sum(1, keepdims=True) / (2 * (scale / 4) ** 2))
    return out / np.sqrt((out**2).mean())


def table(path, seed, rows=2000, exposures=40, kind=None, scale=0.0, strength=0.0, jitter=0.3, air=0.0, mount=0.0,
          correlation=0.7):
    random = np.random.default_rng(seed)
    places = random.uniform([340, 20], [1580, 1180], (rows, 2))
    counts = random.choice([18, 32, 60, 110, 180, 255], rows)
    exposure = np.arange(rows) * exposures // rows
    u = (places - [960, 600]) / SCREEN_F
    r = u * (1 + 0.35 * (u**2).sum(1, keepdims=True)) * 1.002 + [3e-4, -2e-4]
    sigma = NOISE * (1 + 0.3 * np.minimum(255 / counts - 1, 8) / 8)
    off = random.normal(size=(rows, 2)) * sigma[:, None]
    off += (random.normal(size=(exposures, 2)) * jitter * NOISE)[exposure]
    if mount > 0:
        wander = np.zeros((exposures, 2))
        for k in range(exposures):
            before = wander[k - 1] if k else random.normal(size=2)
            wander[k] = correlation * before + np.sqrt(1 - correlation**2) * random.normal(size=2)
        off += mount * NOISE * wander[exposure]
    if air > 0:
        for k in range(exposures):
            here = exposure == k
            off[here] += air * NOISE * smooth(random, places[here], 150.0)
    if kind:
        off += strength * NOISE * structure(random, kind, scale, places)
    wild = random.uniform(size=rows) < 0.02
    off[wild] += random.normal(size=(wild.sum(), 2)) * 60
    camera = (r + off * ARCSEC) * CAMERA_F + SIZE / 2
    lines = ["image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,time_s"]
    for i in range(rows):
        lines.append(
            f"e{exposure[i]:04},{places[i, 0]:.5f},{places[i, 1]:.5f},{counts[i]},{camera[i, 0]:.6f},{camera[i, 1]:.6f},{90 * exposure[i]}"
        )
    path.write_text("\n".join(lines) + "\n")


def cases(seeds):
    for seed in range(seeds):
        for kind in ["ripple", "square", "checkerboard", "smooth", "stripes", "dents"]:
            for scale in [40, 80, 160, 320]:
                for strength in [1.0, 3.0, 10.0]:
                    yield f"{kind} {strength:g} sigma", dict(kind=kind, scale=scale, strength=strength, seed=seed)
        for k in range(20):
            number = 100 * seed + k
            yield "null", dict(seed=1000 + number)
            yield "null, air of 1 sigma", dict(seed=2000 + number, air=1.0)
            yield "null, wandering mount of 1 sigma", dict(seed=3000 + number, mount=1.0)
            yield "null, wandering mount, correlation 0.9", dict(seed=7000 + number, mount=1.0, correlation=0.9)
            yield "null, wandering mount, correlation 0.97", dict(seed=8000 + number, mount=1.0, correlation=0.97)
            yield "null, 5 exposures of 200", dict(seed=4000 + number, rows=1000, exposures=5)
            yield "null, 3 exposures with air", dict(seed=5000 + number, rows=1200, exposures=3, air=1.0)
        for kind in ["ripple", "smooth", "dents"]:
            yield "structure of 3 sigma, 5 exposures of 200", dict(
                seed=6000 + seed, rows=1000, exposures=5, kind=kind, scale=320, strength=3.0
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--retina", required=True)
    parser.add_argument("--setup", default="assets/setups/wide-fov.toml")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", default="")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    listed = [(k, *case) for k, case in enumerate(cases(arguments.seeds)) if arguments.only in case[0]]

    def run(item):
        k, name, options = item
        path = arguments.out / f"{k}.csv"
        table(path, **options)
        said = subprocess.run(
            [arguments.retina, "diagnose", "--setup", arguments.setup, "--data", path, "--json"],
            capture_output=True,
            text=True,
            check=True,
        )
        path.unlink()
        return name, options, json.loads(said.stdout)

    found = {}
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for name, options, said in pool.map(run, listed):
            found.setdefault(name, []).append((options, said))
    for name, results in found.items():
        verdicts = [said["verdict"] for _, said in results]
        null = name.startswith("null")
        right = sum(v in ("adequate", "undecided") if null else v == "unknown" for v in verdicts)
        noise = np.median([said["baseline"]["noise_floor"] for _, said in results])
        print(f"{name:44} {right:3} of {len(results):3}   noise {noise:.2f} arcsec   {dict((v, verdicts.count(v)) for v in set(verdicts))}")
        for options, said in results:
            wrong = said["verdict"] not in ("adequate", "undecided") if null else said["verdict"] != "unknown"
            if wrong:
                print("      ", {k: options[k] for k in options if k != "kind"}, said["verdict"], said["accepted"], said["unexplained"]["covariates"], said["unexplained"]["p_value"])


if __name__ == "__main__":
    main()
