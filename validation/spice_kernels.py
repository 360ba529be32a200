"""How SPICE kernels turn bodies and how large they are: RETINA against CSPICE, through spiceypy.

    python3 -m venv V && V/bin/pip install -r validation/requirements-spice.txt
    cargo build --release -p retina-sky --example body_axes
    V/bin/python validation/spice_kernels.py [--write]

No network is needed. CSPICE's pckw02 makes a binary PCK kernel here. The text kernels stand in retina-sky/tests/spice:
they are written by hand with the forms that NAIF's use (nutation series of degree 1 and 2, offsets as angles, matrix
and quaternion, a meta-kernel with symbols and continued paths). All numbers are of the size of the real ones. --write
puts the binary kernel and 24 epochs of CSPICE's matrices beside them, where a test of RETINA reads them. The exit code is 1
where an axis differs by more than 1e-10 rad.
"""

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import spiceypy as spice

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release/examples/body_axes"
FIXTURES = ROOT / "retina-sky/tests/spice"
DAY_S = 86_400.0
FROM_S, RECORDS, RECORD_S, DEGREE = 8.585e8, 12, 2.0 * DAY_S, 9
TOLERANCE_RAD = 1e-10

# Written by hand; the test of RETINA reads the same files.
TEXT_KERNELS = ("constants.tpc", "frames.tf", "leap.tls", "all.tm")

# Kernels, then bodies of RETINA and the frames that CSPICE is asked for.
CASES = {
    "text constants": (["leap.tls", "constants.tpc"], {"moon": "IAU_MOON", "mars": "IAU_MARS"}),
    "binary constants, frames": (
        ["all.tm"],
        {"moon": "MOON_ME", "earth": "ITRF93", "mars": "IAU_MARS", "pebble": "PEBBLE_FIXED"},
    ),
    "principal axes": (["axes.bpc"], {"moon": "MOON_PA_DE440"}),
}


def euler_angles(axes, x_s):
    """Smooth angles of the size and rates of MOON_PA and ITRF93, rad."""
    days = x_s / DAY_S
    if axes == 31008:
        return [
            0.01 + 0.05 * math.sin(days / 70.0),
            0.4 + 0.02 * math.cos(days / 4.3),
            -2000.0 + 0.2299708 * days + 1e-4 * math.sin(days / 4.4),
        ]
    return [0.003 - 1e-6 * days, 0.41 + 1e-5 * math.sin(days / 2.2), 4.9 + 6.3003881 * (days - 9900.0)]


def write_kernels(folder):
    path = folder / "axes.bpc"
    path.unlink(missing_ok=True)
    handle = spice.pckopn(str(path), "axes", 0)
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    # Shorter records where the Earth turns.
    for axes, frame in ((31008, "J2000"), (3000, "ECLIPJ2000")):
        words = []
        for record in range(RECORDS):
            middle_s = FROM_S + (record + 0.5) * RECORD_S
            values = np.array([euler_angles(axes, middle_s + x * RECORD_S / 2.0) for x in nodes])
            words += np.polynomial.chebyshev.chebfit(nodes, values, DEGREE).T.ravel().tolist()
        spice.pckw02(
            handle, axes, frame, FROM_S, FROM_S + RECORDS * RECORD_S, f"axes {axes}", RECORD_S, RECORDS, DEGREE,
            words, FROM_S,
        )
    spice.pckcls(handle)
    if folder != FIXTURES:
        for name in TEXT_KERNELS:
            shutil.copy(FIXTURES / name, folder / name)


def cspice(folder, kernels, frames, epochs_s):
    """Matrices body_from_inertial, and radii in km where there are some."""
    here = os.getcwd()
    os.chdir(folder)
    try:
        spice.kclear()
        for kernel in kernels:
            spice.furnsh(kernel)
        if "frames.tf" not in kernels and "all.tm" not in kernels:
            spice.furnsh("frames.tf")
        matrices = {
            body: [spice.pxform("J2000", frame, epoch_s).tolist() for epoch_s in epochs_s]
            for body, frame in frames.items()
        }
        numbers = {"moon": 301, "earth": 399, "mars": 499, "pebble": 2990001}
        radii = {
            body: spice.bodvcd(numbers[body], "RADII", 3)[1].tolist()
            if spice.bodfnd(numbers[body], "RADII") else None
            for body in frames
        }
        return matrices, radii
    finally:
        os.chdir(here)


def ours(folder, kernels, bodies, epochs_s):
    question = json.dumps(
        {"tdb_s": list(epochs_s), "kernels": [str(folder / name) for name in kernels], "bodies": list(bodies)}
    )
    done = subprocess.run([EXAMPLE], input=question, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(done.stderr)
    return json.loads(done.stdout)


def matrix(w, x, y, z):
    """Of v -> q v q*."""
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--write", action="store_true", help="write the fixtures of RETINA's own test")
    write = parser.parse_args().write
    with tempfile.TemporaryDirectory() as temporary:
        folder = FIXTURES if write else Path(temporary)
        folder.mkdir(exist_ok=True)
        write_kernels(folder)
        random = np.random.default_rng(31008)
        span_s = RECORDS * RECORD_S
        if write:
            # The ends, seams of records, and between.
            epochs_s = FROM_S + np.concatenate([
                [0.0, span_s], RECORD_S * np.arange(1, 6), random.uniform(0, span_s, 17),
            ])
            cases = []
            for kernels, frames in CASES.values():
                matrices, radii = cspice(folder, kernels, frames, epochs_s)
                cases.append({"kernels": kernels, "body_from_inertial": matrices, "radii_km": radii})
            expected = {"made_by": f"CSPICE {spice.tkvrsn('TOOLKIT')}", "tdb_s": epochs_s.tolist(), "cases": cases}
            (folder / "expected.json").write_text(json.dumps(expected, indent=1) + "\n")
            return 0
        if not EXAMPLE.exists():
            sys.exit(f"error: {EXAMPLE} is missing: cargo build --release -p retina-sky --example body_axes")
        print(f"CSPICE {spice.tkvrsn('TOOLKIT')}, spiceypy {spice.__version__}; 5000 epochs each")
        worst_rad = 0.0
        for name, (kernels, frames) in CASES.items():
            # Text constants hold at any time; a century either way.
            reach_s = [-50.0 * 365.25 * DAY_S, 50.0 * 365.25 * DAY_S]
            ends_s = reach_s if name == "text constants" else [FROM_S, FROM_S + span_s]
            epochs_s = random.uniform(*ends_s, 5000)
            matrices, radii = cspice(folder, kernels, frames, epochs_s)
            answer = ours(folder, kernels, frames, epochs_s)
            for body, frame in frames.items():
                own = answer[body]
                off = max(
                    np.abs(matrix(*turn) - np.array(expected)).max()
                    for turn, expected in zip(own["body_from_inertial"], matrices[body], strict=True)
                )
                worst_rad = max(worst_rad, off)
                own_km = own["semi_axes_m"] and [axis / 1e3 for axis in own["semi_axes_m"]]
                same = (own_km is None) == (radii[body] is None) and np.allclose(own_km or 0, radii[body] or 0)
                if not same:
                    sys.exit(f"error: radii of {body}: {own_km} and {radii[body]} km")
                print(f"{name}: {body} as {frame}: {off:.1e} rad; {own['axes']}; radii {radii[body]} km")
        print(f"largest difference of an axis' coordinate: {worst_rad:.1e}")
        return int(worst_rad > TOLERANCE_RAD)


if __name__ == "__main__":
    sys.exit(main())
