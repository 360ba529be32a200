"""Barycentre error of splats over magnitude and sub-pixel phase, with the quantisation floor.

    cargo build --release -p retina-screen --example splat_error
    validation/.venv/bin/python validation/splat_error.py [FIGURE.svg]

Reads the example's CSV; draws, over magnitude, the rms and the largest position error of the joint
choice of counts, that of three roundings, and what rounding is expected to leave; the magnitude
errors of both; and a map over the phase at V 7.
"""

import csv
import io
import subprocess
import sys
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
ORANGE, BLUE, GREEN, GREY = "#E69F00", "#0072B2", "#009E73", "#555555"


def main() -> None:
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "out" / "splat-error.svg"
    program = ROOT / "target" / "release" / "examples" / "splat_error"
    text = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    rows = list(csv.DictReader(io.StringIO(text)))
    table = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    magnitudes = np.unique(table["magnitude"])

    def over(key, reduce):
        return np.array([reduce(table[key][table["magnitude"] == m]) for m in magnitudes])

    rms = lambda values: np.sqrt(np.mean(values**2))
    joint, worst = over("position_error_px", rms), over("position_error_px", np.max)
    rounded, floor = over("three_roundings_px", rms), over("rounding_px", rms)
    light, rounded_light = over("magnitude_error", rms), over("three_roundings_mag", rms)
    for wanted in (-2.25, 0, 2, 4, 5, 6, 7, 8, 8.25):
        k = np.argmin(abs(magnitudes - wanted))
        print(
            f"V {magnitudes[k]:5.2f}: joint {joint[k]:.4f} px rms, {worst[k]:.3f} px at most, {light[k]:.4f} mag rms;"
            f" three roundings {rounded[k]:.4f} px, {rounded_light[k]:.4f} mag rms; floor {floor[k]:.4f} px"
        )

    matplotlib.rcParams.update({"font.size": 9, "svg.hashsalt": "splat"})
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 3.9), width_ratios=[1.2, 1.2, 1])
    left.semilogy(magnitudes, rounded, color=ORANGE, label="three roundings, rms")
    left.semilogy(magnitudes, worst, color=BLUE, ls=":", label="joint counts, largest")
    left.semilogy(magnitudes, joint, color=BLUE, label="joint counts, rms")
    left.semilogy(magnitudes, floor, color=GREY, ls="--", label="quantisation floor of one rounding a pixel")
    left.axvline(-1.44, color=GREY, lw=0.5)
    left.text(-1.35, 0.3, "one pixel at 255", fontsize=7, color=GREY, transform=left.get_xaxis_transform())
    left.set(xlabel="V magnitude (wide configuration)", ylabel="barycentre error / px")
    left.grid(alpha=0.3, which="both", lw=0.4)
    left.legend(fontsize=8)
    middle.semilogy(magnitudes, rounded_light, color=ORANGE, label="three roundings, rms")
    middle.semilogy(magnitudes, light, color=BLUE, label="joint counts, rms")
    middle.set(xlabel="V magnitude (wide configuration)", ylabel="magnitude error / mag")
    middle.grid(alpha=0.3, which="both", lw=0.4)
    middle.legend(fontsize=8)
    chosen = table["magnitude"] == 7
    side = int(np.sqrt(chosen.sum()))
    image = table["position_error_px"][chosen].reshape(side, side)
    drawn = right.imshow(image, origin="lower", extent=(0, 1, 0, 1), cmap="cividis")
    figure.colorbar(drawn, label="barycentre error / px")
    right.set(title="V 7, joint counts", xlabel="phase x / px", ylabel="phase y / px")
    figure.tight_layout()
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, metadata={"Date": None})
    print(target)


if __name__ == "__main__":
    main()
