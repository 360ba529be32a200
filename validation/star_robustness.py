"""Star frames as ordinary pictures: how many `retina navigate stars` still solves, and how many points it finds.

    cargo build --release --bin retina
    python -m venv V && V/bin/pip install -r validation/requirements-robustness.txt
    V/bin/python validation/star_robustness.py FRAME.tiff ... [--fov-deg 11.4] [--retina PATH] [--out DIR]

Each 16-bit grey frame is taken whole and in four quadrants, and changed in the ways of `CASES`. A change is
right where its boresight is that of the unchanged frame within --agree-arcsec: no change moves the axis. The table goes to standard output and to DIR/report.md, with all
answers in DIR/report.json. The exit code is 1 where a changed frame is solved elsewhere than the unchanged one,
or an unchanged whole frame is not solved.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from sky_angles import apart_arcsec

ROOT = Path(__file__).resolve().parent.parent
RETINA = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release/retina"
FULL_SCALE_DN = 65535.0


def half_field_deg(fov_deg):
    return float(2 * np.degrees(np.arctan(np.tan(np.radians(fov_deg) / 2) / 2)))


def turned_field_deg(fov_deg, pixels):
    height, width = pixels.shape
    return float(2 * np.degrees(np.arctan(np.tan(np.radians(fov_deg) / 2) * height / width)))


def eight_bits(pixels):
    return np.round(pixels / FULL_SCALE_DN * 255).astype(np.uint8)


def srgb(pixels):
    """The 8-bit values that a camera's own JPEG would have (IEC 61966-2-1)."""
    light = pixels / FULL_SCALE_DN
    coded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    return np.round(coded * 255).astype(np.uint8)


def save_tiff(path, pixels):
    tifffile.imwrite(path.with_suffix(".tiff"), np.ascontiguousarray(pixels))
    return path.with_suffix(".tiff")


def save_png(path, pixels):
    Image.fromarray(pixels).save(path.with_suffix(".png"))
    return path.with_suffix(".png")


def save_jpeg(path, pixels, quality, colour=False):
    picture = Image.fromarray(srgb(pixels))
    (picture.convert("RGB") if colour else picture).save(path.with_suffix(".jpg"), quality=quality)
    return path.with_suffix(".jpg")


def save_jpeg_counts(path, pixels, quality):
    """A JPEG of linear counts, taken out of it again: its losses without its coding."""
    jpeg = path.with_suffix(".jpg")
    Image.fromarray(eight_bits(pixels)).save(jpeg, quality=quality)
    counts = np.asarray(Image.open(jpeg))
    jpeg.unlink()
    return save_png(path, counts)


def halved(pixels):
    height, width = (side // 2 for side in pixels.shape)
    cells = pixels[:2 * height, :2 * width].reshape(height, 2, width, 2).astype(np.float64)
    return np.round(cells.mean(axis=(1, 3))).astype(np.uint16)


def middle(pixels):
    height, width = pixels.shape
    return pixels[height // 4:height // 4 + height // 2, width // 4:width // 4 + width // 2]


def rotated(pixels):
    """By 33 deg about the middle, in a frame of the same size: black corners, as a planetarium's viewer makes them."""
    turned = Image.fromarray(pixels.astype(np.float32)).rotate(33, resample=Image.BICUBIC, fillcolor=0)
    return np.clip(np.round(np.asarray(turned)), 0, FULL_SCALE_DN).astype(np.uint16)


def interlaced(pixels):
    """One field of an interlaced camera: rows 1.93 px high, each the mean of the light in it."""
    height = int(pixels.shape[0] / 1.93)
    edges = np.arange(height + 1) * 1.93
    sums = np.vstack([np.zeros(pixels.shape[1]), np.cumsum(pixels.astype(np.float64), axis=0)])
    at = np.clip(edges, 0, pixels.shape[0])
    low = np.minimum(at.astype(int), pixels.shape[0] - 1)
    cumulated = sums[low] + (at - low)[:, None] * (sums[low + 1] - sums[low])
    return np.round(np.diff(cumulated, axis=0) / 1.93).astype(np.uint16)


def with_light(pixels, light, random):
    """More light, with its own noise: 4 electrons a count."""
    noisy = light + np.sqrt(np.maximum(light, 0) / 4) * random.standard_normal(pixels.shape)
    return np.clip(np.round(pixels + noisy), 0, FULL_SCALE_DN).astype(np.uint16)


def smooth_noise(shape, scale, random):
    """Texture of a size in pixels: noise at that pitch, interpolated."""
    small = random.standard_normal((int(shape[0] / scale) + 2, int(shape[1] / scale) + 2)).astype(np.float32)
    large = Image.fromarray(small).resize((shape[1], shape[0]), Image.BICUBIC)
    return np.asarray(large, dtype=np.float64)


def foreground(kind):
    """Light that is no star. Amplitudes go by the frame's brightest star."""
    def make(pixels):
        random = np.random.default_rng(5)
        height, width = pixels.shape
        y, x = np.mgrid[0:height, 0:width].astype(np.float64)
        top = float(np.percentile(pixels, 99.99)) - float(np.median(pixels))
        if kind == "roof":
            # Below a slanting edge, lit, with the texture of tiles.
            below = y > 0.72 * height - 0.15 * (x - width / 2)
            tiles = 1 + 0.15 * smooth_noise(pixels.shape, 6, random)
            return with_light(np.where(below, np.uint16(np.median(pixels)), pixels), below * top * tiles, random)
        if kind == "leaves":
            # A third of the frame behind leaves that street light catches.
            texture = smooth_noise(pixels.shape, 7, random)
            inside = smooth_noise(pixels.shape, width / 4, random) > 0.45
            light = inside * top * np.clip(0.6 + 0.7 * texture, 0, None)
            return with_light(np.where(inside, np.uint16(np.median(pixels)), pixels), light, random)
        if kind == "corona":
            # An eclipsed Sun: dark disc, brightness falling with the fourth power of the distance.
            r = np.hypot(x - 0.55 * width, y - 0.45 * height) / (0.03 * width)
            light = np.where(r < 1, 0, 60 * top * np.maximum(r, 1) ** -4 + 6 * top * np.maximum(r, 1) ** -2)
            return with_light(pixels, light, random)
        if kind == "moon":
            r = np.hypot(x - 0.3 * width, y - 0.35 * height) / (0.025 * width)
            return with_light(pixels, np.where(r < 1, FULL_SCALE_DN, 20 * top * np.maximum(r, 1) ** -2.2), random)
        if kind == "glow":
            # Light pollution towards a corner, and a vignette over all.
            light = 3 * top * np.exp(-(x / width + (height - y) / height) * 3)
            vignette = 1 - 0.7 * (((x - width / 2) ** 2 + (y - height / 2) ** 2) / ((width / 2) ** 2 + (height / 2) ** 2))
            return np.round(with_light(pixels, light, random) * vignette).astype(np.uint16)
        if kind == "hot pixels":
            # One of 500, as bright as stars.
            hot = random.random(pixels.shape) < 1 / 500
            return with_light(pixels, hot * top * random.random(pixels.shape) ** 2, random)
        if kind == "heavy tails":
            # Student's t with two degrees of freedom, half as wide as the frame's own noise (by neighbours' differences).
            wide = 0.5 * float(np.median(np.abs(np.diff(pixels.astype(np.float64), axis=1)))) / 0.954
            noise = wide * random.standard_t(2, pixels.shape)
            return np.clip(np.round(pixels + noise), 0, FULL_SCALE_DN).astype(np.uint16)
        if kind == "trails":
            # Twelve satellites and aeroplanes.
            light = np.zeros(pixels.shape)
            for _ in range(12):
                angle, off = random.random() * np.pi, (random.random() - 0.5) * height
                across = np.cos(angle) * (x - width / 2) + np.sin(angle) * (y - height / 2) - off
                light += top * random.random() * np.exp(-across ** 2 / 3)
            return with_light(pixels, light, random)
        raise ValueError(kind)
    return lambda path, pixels: save_tiff(path, make(pixels))


FOREGROUNDS = ["roof", "leaves", "corona", "moon", "glow", "hot pixels", "heavy tails", "trails"]

# Title: (how it is written, its field by the unchanged one and its pixels).
CASES = {
    "as it is, 16 bits": (save_tiff, lambda fov, _: fov),
    "8 bits, PNG": (lambda path, pixels: save_png(path, eight_bits(pixels)), lambda fov, _: fov),
    "JPEG 90": (lambda path, pixels: save_jpeg(path, pixels, 90), lambda fov, _: fov),
    "JPEG 50": (lambda path, pixels: save_jpeg(path, pixels, 50), lambda fov, _: fov),
    "JPEG 90, colour": (lambda path, pixels: save_jpeg(path, pixels, 90, colour=True), lambda fov, _: fov),
    "JPEG 90 of linear counts, as PNG": (
        lambda path, pixels: save_jpeg_counts(path, pixels, 90), lambda fov, _: fov),
    "JPEG 50 of linear counts, as PNG": (
        lambda path, pixels: save_jpeg_counts(path, pixels, 50), lambda fov, _: fov),
    "half the size": (lambda path, pixels: save_tiff(path, halved(pixels)), lambda fov, _: fov),
    "its middle half": (
        lambda path, pixels: save_tiff(path, middle(pixels)), lambda fov, _: half_field_deg(fov)),
    "turned by 90 deg": (lambda path, pixels: save_tiff(path, np.rot90(pixels)), turned_field_deg),
    "mirrored": (lambda path, pixels: save_tiff(path, pixels[:, ::-1]), lambda fov, _: fov),
    "turned by 33 deg, black corners": (lambda path, pixels: save_tiff(path, rotated(pixels)), lambda fov, _: fov),
    "interlaced, pixels 1.93 times as high as wide": (
        lambda path, pixels: save_tiff(path, interlaced(pixels)), lambda fov, _: fov),
    "inverted": (lambda path, pixels: save_tiff(path, (FULL_SCALE_DN - pixels).astype(np.uint16)), lambda fov, _: fov),
    **{kind: (foreground(kind), lambda fov, _: fov) for kind in FOREGROUNDS},
}


def quadrants(pixels):
    height, width = pixels.shape
    for row in range(2):
        for column in range(2):
            yield pixels[row * height // 2:(row + 1) * height // 2, column * width // 2:(column + 1) * width // 2]


def answers(retina, paths, fov_deg):
    """One answer a picture; a picture that is not read is not solved."""
    command = [retina, "navigate", "stars", *map(str, paths), "--fov-deg", f"{fov_deg:.6f}", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not done.stdout:
        sys.exit(f"error: {retina} gave no answer:\n{done.stderr}")
    return json.loads(done.stdout)["images"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", nargs="+", type=Path)
    parser.add_argument("--fov-deg", type=float, default=11.4)
    parser.add_argument("--agree-arcsec", type=float, default=120.0)
    parser.add_argument("--retina", type=Path, default=RETINA)
    parser.add_argument("--out", type=Path, default=Path("out/star-robustness"))
    arguments = parser.parse_args()

    whole = {frame.stem: tifffile.imread(frame) for frame in arguments.frames}
    for name, pixels in whole.items():
        if pixels.dtype != np.uint16 or pixels.ndim != 2:
            sys.exit(f"error: {name}: found {pixels.dtype} of {pixels.ndim} axes, expected one 16-bit grey channel")
    parts = {f"{name}-{k}": part for name, pixels in whole.items() for k, part in enumerate(quadrants(pixels))}
    groups = {"whole": (whole, arguments.fov_deg), "quadrants": (parts, half_field_deg(arguments.fov_deg))}

    report, failed = {}, False
    lines = ["| picture | whole frames solved; points, median | quadrants solved; points, median |", "|---|---|---|"]
    for k, (title, (save, field)) in enumerate(CASES.items()):
        cells = []
        for group, (pictures, fov_deg) in groups.items():
            folder = arguments.out / f"{k:02}-{group}"
            folder.mkdir(parents=True, exist_ok=True)
            paths = [save(folder / name, pixels) for name, pixels in pictures.items()]
            found = answers(arguments.retina, paths, field(fov_deg, next(iter(pictures.values()))))
            report[f"{title}, {group}"] = found
            solved = sum(answer["solved"] for answer in found)
            for true, answer in zip(report[f"{next(iter(CASES))}, {group}"], found):
                if answer["solved"] and true["solved"]:
                    off = apart_arcsec(true, answer)
                    if off > arguments.agree_arcsec:
                        failed = True
                        print(f"error: {answer['file']} is {off:.0f} arcsec off", file=sys.stderr)
            failed |= k == 0 and group == "whole" and solved < len(found)
            counts = [answer["points"] for answer in found if "points" in answer]
            typical = f"{statistics.median(counts):.0f}" if counts else "not read"
            cells.append(f"{solved} of {len(found)}; {typical}")
        lines.append(f"| {title} | {' | '.join(cells)} |")
    table = "\n".join(lines) + "\n"
    print(table, end="")
    (arguments.out / "report.md").write_text(table)
    (arguments.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
