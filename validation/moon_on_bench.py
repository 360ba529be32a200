"""A resolved Moon on the virtual bench: rendered through a calibration, photographed, compared with the ideal pinhole.

Calibrates the narrow bench from a campaign of its own, renders frames of the default sequence once with the
distortion compensated beforehand (upstream) and once without, photographs both, corrects the second afterwards
(downstream), and measures the lit limb of each against that of the ideal radiance, blurred like the photograph.

    python validation/moon_on_bench.py --retina target/release/retina
"""

import argparse
import json
import subprocess
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates

import common

ROOT = Path(__file__).resolve().parent.parent
CAMERA = (2048, 1536, 50.0 / 3.45e-3)
SCREEN = (1920, 1200, 1200.0 / (1536 * 3.45e-3 / 50.0))


def run(*command):
    print("+", *command, flush=True)
    subprocess.run([str(part) for part in command], check=True)


def scene(path, mode, calibration):
    text = f"""schema = "retina.scene/1"
setup = "{ROOT / 'assets/setups/narrow-fov.toml'}"
trajectory = {{ kind = "lumio-halo", frames = 4321, step_s = 300.0 }}
radiance_scale = "auto"
[compensation]
mode = "{mode}"
calibration = "{calibration}"
[[body]]
name = "moon"
model = "{ROOT / 'assets/bodies/moon.glb'}"
shading = "smooth"
photometry = {{ model = "lunar-lambert", normal_albedo = 0.12 }}
[output]
radiance_exr = true
"""
    path.write_text(text)


def photograph(path):
    return np.asarray(Image.open(path)).astype(float)


def ideal_on_camera(radiance):
    """The radiance image of K_f (no distortion) on the camera's pixels."""
    width, height, focal = CAMERA
    scale = SCREEN[2] / focal
    x = (np.arange(width) + 0.5 - width / 2) * scale + SCREEN[0] / 2 - 0.5
    y = (np.arange(height) + 0.5 - height / 2) * scale + SCREEN[1] / 2 - 0.5
    yy, xx = np.meshgrid(y, x, indexing="ij")
    return map_coordinates(radiance, [yy, xx], order=3, mode="constant")


def edges(image, centre, radius, angles):
    """Radius at which the light crosses half of its maximum near the limb, along each direction; nan where dark."""
    r = np.arange(-25.0, 25.0, 0.1)
    found = np.full(len(angles), np.nan)
    level = np.full(len(angles), np.nan)
    for i, angle in enumerate(angles):
        # The mean over two degrees: one line alone is limited by shot noise.
        lines = angle + np.radians(np.arange(-0.875, 1.0, 0.25))[:, None]
        x = centre[0] + (radius + r) * np.cos(lines) - 0.5
        y = centre[1] + (radius + r) * np.sin(lines) - 0.5
        profile = map_coordinates(image, [y, x], order=1, mode="constant").mean(axis=0)
        top = profile[r < -2].max()
        level[i] = top
        below = np.nonzero(profile[:-1] >= top / 2)[0]
        if len(below) and below[-1] + 1 < len(profile):
            k = below[-1]
            share = (profile[k] - top / 2) / max(profile[k] - profile[k + 1], 1e-12)
            found[i] = r[k] + 0.1 * share
    found[level < 0.25 * np.nanmax(level)] = np.nan
    return found


def blur_of(photo, ideal):
    """The Gaussian blur (px) of the ideal image that is nearest to the photograph."""
    best = min(
        np.arange(0.8, 5.0, 0.2),
        key=lambda sigma: np.std(photo / photo.max() - (g := gaussian_filter(ideal, sigma)) / g.max()),
    )
    return float(best)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--retina", default=ROOT / "target/release/retina")
    parser.add_argument("--out", type=Path, default=ROOT / "out/moon-on-bench")
    parser.add_argument("--every", type=int, default=900)
    arguments = parser.parse_args()
    out, retina = arguments.out, arguments.retina
    out.mkdir(parents=True, exist_ok=True)
    setup = ROOT / "assets/setups/narrow-fov.toml"
    calibration = out / "calibration.toml"
    if not calibration.exists():
        run(retina, "simulate", "points", "--setup", setup, "--seed", 1, "--exposures", 24, "--points", 400,
            "--out", out / "points")
        run(retina, "calibrate", "geometry", "--setup", setup, "--data", out / "points/points.csv", "--out",
            calibration)
    for mode in ("direct", "none"):
        scene(out / f"{mode}.toml", mode, calibration)
        if not (out / mode).exists():
            run(retina, "render", out / f"{mode}.toml", "--out", out / mode, "--every", arguments.every)
        if not (out / f"photo-{mode}").exists():
            run(retina, "simulate", "frames", "--setup", setup, "--screens", out / mode, "--seed", 3, "--out",
                out / f"photo-{mode}")
    angles = np.radians(np.arange(0, 360, 2.0))
    rows = []
    for path in sorted((out / "photo-direct/images").glob("*.png")):
        name = path.stem
        ideal = ideal_on_camera(common.read_exr(out / f"none/frames/{name}.exr")["Y"])
        downstream = out / f"corrected-{name}.png"
        run(retina, "warp", out / f"photo-none/images/{name}.png", "--setup", setup, "--calibration", calibration,
            "--direction", "downstream", "--out", downstream)
        truth = json.loads((out / f"none/truth/{name}.json").read_text())
        body = truth["bodies"]["moon"] if isinstance(truth["bodies"], dict) else truth["bodies"][0]
        ellipse = body["limb_ellipse_px"]
        scale = CAMERA[2] / SCREEN[2]
        centre = [(ellipse["center_px"][k] - SCREEN[k] / 2) * scale + CAMERA[k] / 2 for k in range(2)]
        radius = np.mean(ellipse["semi_axes_px"]) * scale
        for label, image in (
            ("upstream", photograph(path)),
            ("downstream", photograph(downstream)),
            ("uncompensated", photograph(out / f"photo-none/images/{name}.png")),
        ):
            image = image - np.median(image[:40])
            sigma = blur_of(image, ideal)
            blurred = gaussian_filter(ideal, sigma)
            difference = edges(image, centre, radius, angles) - edges(blurred, centre, radius, angles)
            difference = difference[np.isfinite(difference)]
            # Spikes of relief shadows at the terminator's ends are not the limb.
            off = np.abs(difference - np.median(difference))
            kept = difference[off < 5 * np.median(off) + 0.05]
            rms = np.sqrt((kept**2).mean())
            rows.append((name, label, len(difference), len(kept), kept.mean(), rms, sigma))
            print("%s %-14s %4d directions (%d kept): mean %+.3f px, rms %.3f px, blur %.1f px" % rows[-1], flush=True)
    for label in ("upstream", "downstream", "uncompensated"):
        rms = [row[5] for row in rows if row[1] == label]
        total = np.sqrt(np.mean(np.square(rms)))
        print(f"{label}: limb within {total:.3f} px rms of the ideal pinhole image's over {len(rms)} frames")


if __name__ == "__main__":
    main()
