"""How often `retina navigate limb` is wrong without saying so, on discs drawn by numpy.

Draws shaded discs of bodies without relief, some of them such that no answer can be right: the lit limb outside the
frame, a flattened body that is said to be a sphere, smear. Counts for each kind how many are solved, how many of those
are wrong (centre or radius off by more than five of their own standard deviations and 0.5 px), how many of the wrong
ones come without a note, and how many right ones with one.
Exit code 0 done, 2 bad input or failure.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

import common
from common import say

WIDTH, HEIGHT = 640, 480
# So long that a sphere off the axis is still a circle, to 0.01 px.
FOCAL_PX = 40000.0
RADIUS_M = 1.0e6
PARTS = 3
KINDS = ("whole", "nearly full", "cut, limb inside", "cut, limb outside", "flattened", "smeared")
LAWS = ("uniform", "lambert", "lommel-seeliger")


def brightness(law, mu0, mu):
    if law == "uniform":
        return (mu0 > 0).astype(float)
    if law == "lambert":
        return np.maximum(mu0, 0.0)
    return np.where(mu0 > 0, 2.0 * mu0 / np.maximum(mu0 + mu, 1e-6), 0.0)


def disc(centre, radius, phase, towards, law, flattening=0.0, tilt=0.0):
    """An orthographic disc: `towards` is the angle of the Sun's direction in the image, from +x to +y."""
    step = 1.0 / PARTS
    x = (np.arange(WIDTH * PARTS) + 0.5) * step - centre[0]
    y = (np.arange(HEIGHT * PARTS) + 0.5) * step - centre[1]
    u, v = np.meshgrid(x, y)
    if flattening:
        along, across = np.cos(tilt) * u + np.sin(tilt) * v, -np.sin(tilt) * u + np.cos(tilt) * v
        along, across = along * (1 + flattening / 3), across * (1 + flattening / 3) / (1 - flattening)
        u, v = np.cos(tilt) * along - np.sin(tilt) * across, np.sin(tilt) * along + np.cos(tilt) * across
    u, v = u / radius, v / radius
    square = u * u + v * v
    inside = square < 1.0
    mu = np.sqrt(np.where(inside, 1.0 - square, 1.0))
    sun = np.array([np.sin(phase) * np.cos(towards), np.sin(phase) * np.sin(towards), np.cos(phase)])
    light = np.where(inside, brightness(law, u * sun[0] + v * sun[1] + mu * sun[2], mu), 0.0)
    return light.reshape(HEIGHT, PARTS, WIDTH, PARTS).mean((1, 3))


def draw(kind, seed):
    random = np.random.default_rng([KINDS.index(kind), seed])
    law = LAWS[seed % len(LAWS)]
    radius = random.uniform(40.0, 200.0)
    phase = np.radians(random.uniform(0.0, 20.0) if kind == "nearly full" else random.uniform(30.0, 110.0))
    towards = random.uniform(0.0, 2 * np.pi)
    centre = np.array([random.uniform(radius + 15, WIDTH - radius - 15), random.uniform(radius + 15, HEIGHT - radius - 15)])
    if kind.startswith("cut"):
        radius = random.uniform(150.0, 500.0)
        # The frame's edge stands at a share of the radius from the centre, on the Sun's side or on the other.
        side = int(random.integers(4))
        outward = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]][side], float)
        middle = np.array([WIDTH, HEIGHT]) / 2
        half = abs(outward @ middle)
        share = random.uniform(0.1, 0.6) if kind.endswith("inside") else random.uniform(-0.2, 0.5)
        sign = -1.0 if kind.endswith("inside") else 1.0
        towards = np.arctan2(outward[1], outward[0]) + (0 if sign > 0 else np.pi) + random.uniform(-0.4, 0.4)
        centre = middle + outward * (half - share * radius) + random.uniform(-20, 20) * outward[::-1]
    flattening = random.uniform(0.03, 0.1) if kind == "flattened" else 0.0
    image = disc(centre, radius, phase, towards, law, flattening, random.uniform(0, np.pi))
    blur = random.uniform(0.5, 1.5)
    image = ndimage.gaussian_filter(image, blur)
    if kind == "smeared":
        length, angle = random.uniform(6.0, 20.0), random.uniform(0, np.pi)
        steps = np.linspace(-0.5, 0.5, 41) * length
        image = np.mean([ndimage.shift(image, (s * np.sin(angle), s * np.cos(angle)), order=1) for s in steps], 0)
    image = image / max(image.max(), 1e-9) * random.uniform(1500, 3300)
    image = image + 60.0 + random.normal(size=image.shape) * np.sqrt(4.0 + np.maximum(image, 0) / 4.0)
    return np.clip(np.round(image), 0, 4095).astype(np.uint16), centre, radius


def solve(folder, kind, seed):
    path = folder / f"{KINDS.index(kind)}-{seed}.png"
    image, centre, radius = draw(kind, seed)
    Image.fromarray(image).save(path)
    command = [common.RETINA, "navigate", "limb", path, "--focal-mm", str(FOCAL_PX * 1e-3), "--pixel-um", "1"]
    command += ["--radii-m", str(RADIUS_M), "--bits", "12", "--limb-height-m", "0", "--limb-height-sigma-m", "0", "--json"]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        common.fail(f"{path}: {done.stderr}")
    answer = json.loads(done.stdout)
    if not answer["solved"]:
        return {"solved": False, "reason": answer["reason"], "seed": seed}
    off = np.linalg.norm(np.array(answer["center_px"]) - centre)
    off_radius = abs(answer["radius_px"] - radius)
    sigma = answer["sigma_px"]
    wrong = off > max(0.5, 5 * sigma["center"]) or off_radius > max(0.5, 5 * sigma["radius"])
    return {"solved": True, "seed": seed, "off_px": off, "off_radius_px": off_radius, "wrong": bool(wrong),
            "notes": answer["notes"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=60, help="discs of each kind")
    parser.add_argument("--kind", action="append", choices=KINDS, help="only these kinds; may be repeated")
    parser.add_argument("--keep", type=Path, help="folder for the images")
    parser.add_argument("--json", type=Path, help="file for every draw's outcome")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        every = {}
        print(f"{'kind':20} solved   wrong  unsaid  right with a note  worst of the unsaid, px  radius of the right, rms px")
        for kind in arguments.kind or KINDS:
            with ThreadPoolExecutor(2) as pool:
                outcomes = list(pool.map(lambda seed: solve(folder, kind, seed), range(arguments.draws)))
            every[kind] = outcomes
            solved = [outcome for outcome in outcomes if outcome["solved"]]
            wrong = [outcome for outcome in solved if outcome["wrong"]]
            unsaid = [outcome for outcome in wrong if not outcome["notes"]]
            noted = [outcome for outcome in solved if not outcome["wrong"] and outcome["notes"]]
            worst = max((max(outcome["off_px"], outcome["off_radius_px"]) for outcome in unsaid), default=0.0)
            right = [outcome["off_radius_px"] for outcome in solved if not outcome["wrong"]]
            rms = np.sqrt(np.mean(np.square(right))) if right else np.nan
            print(f"{kind:20} {len(solved):6} {len(wrong):7} {len(unsaid):7} {len(noted):18} {worst:24.1f} {rms:28.3f}",
                  flush=True)
    if arguments.json:
        common.write_json(arguments.json, every)
    say("done")
    return 0


if __name__ == "__main__":
    sys.exit(main())
