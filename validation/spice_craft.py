"""Where a spacecraft is and how its camera is turned by SPICE kernels: RETINA against CSPICE, through spiceypy.

    python3 -m venv V && V/bin/pip install -r validation/requirements-spice.txt
    cargo build --release -p retina-sky --example craft_poses
    V/bin/python validation/spice_craft.py [--write]

No network is needed. CSPICE writes an SPK and a CK kernel here: a bus by CK type 3 with a gap, a gimbal by type 2 that is
counted from the bus, a camera at a fixed offset from the gimbal, a scanner by type 1, a comet whose axes are turned by
type 3 from the ecliptic. The frame and clock kernels stand in retina-sky/tests/spice/craft. --write puts the binary
kernels and 24 epochs of CSPICE's answers beside them, where a test of RETINA reads them. The exit code is 1 where an axis
differs by more than 1e-9 or a place by more than 1 cm (rounding of polynomials through places of 2e11 m).
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

from spice_kernels import matrix

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release/examples/craft_poses"
FIXTURES = ROOT / "retina-sky/tests/spice/craft"
TEXT_KERNELS = ("craft.tsc", "craft.tf", "craft.tm")
FROM_S, STEP_S, STEPS = 8.585e8, 600.0, 200
# No attitude of the bus between these steps.
GAP = (90, 100)
TOLERANCE, TOLERANCE_M, SEEN_TOLERANCE_RAD = 1e-9, 1e-2, 1e-7
FRAMES = ("CRAFT_BUS", "CRAFT_CAMERA", "COMET_FIXED")
BODIES = ("CRAFT", "COMET", "10")
AU_KM = 149_597_870.7


def turn(time_s, rates):
    """A smooth attitude as a SPICE quaternion."""
    hours = time_s / 3600.0
    angles = [rates[0] * hours, 0.4 + 0.3 * math.sin(rates[1] * hours), rates[2] * hours]
    return spice.m2q(spice.eul2m(*angles, 3, 1, 3))


def ticks(epoch_s):
    return spice.sce2c(-999, epoch_s)


def write_attitudes(path):
    path.unlink(missing_ok=True)
    handle = spice.ckopn(str(path), "craft", 0)
    epochs_s = FROM_S + STEP_S * np.arange(STEPS)
    at = np.array([ticks(epoch_s) for epoch_s in epochs_s])
    no_rates = np.zeros((STEPS, 3))
    inside = np.r_[0 : GAP[0] + 1, GAP[1] : STEPS]
    bus = np.array([turn(epoch_s - FROM_S, (0.3, 1.1, -0.7)) for epoch_s in epochs_s])
    spice.ckw03(
        handle, at[0], at[-1], -999000, "J2000", False, "bus", len(inside), at[inside], bus[inside],
        no_rates[inside], 2, [at[0], at[GAP[1]]],
    )
    comet = np.array([turn(epoch_s - FROM_S, (0.51, 0.0, 0.0)) for epoch_s in epochs_s])
    spice.ckw03(
        handle, at[0], at[-1], 1999000, "ECLIPJ2000", True, "comet", STEPS, at, comet, no_rates, 1, [at[0]],
    )
    gimbal = np.array([turn(epoch_s - FROM_S, (-0.2, 0.4, 0.1)) for epoch_s in epochs_s[:-1]])
    rates = np.array([[1e-5 * k, -2e-4, 3e-5 * math.cos(k)] for k in range(STEPS - 1)])
    spice.ckw02(
        handle, at[0], at[-1], -999100, "CRAFT_BUS", "gimbal", STEPS - 1, at[:-1], at[1:], gimbal, rates,
        [1.0 / 65536.0] * (STEPS - 1),
    )
    spice.ckw01(handle, at[0], at[-1], -999200, "J2000", False, "scanner", STEPS, at, bus[::-1].copy(), no_rates)
    spice.ckcls(handle)


def write_places(path):
    path.unlink(missing_ok=True)
    handle = spice.spkopn(str(path), "craft", 0)
    epochs_s = np.linspace(FROM_S - 4000.0, FROM_S + STEPS * STEP_S + 4000.0, 60)

    def circle(radius_km, period_s, phase):
        rate = 2.0 * math.pi / period_s
        angle = rate * epochs_s + phase
        c, s = np.cos(angle), np.sin(angle)
        return np.stack([
            radius_km * c, 0.8 * radius_km * s, 0.6 * radius_km * s,
            -rate * radius_km * s, 0.8 * rate * radius_km * c, 0.6 * rate * radius_km * c,
        ], axis=1)

    for target, centre, states in (
        (10, 0, circle(7e5, 3.7e8, 0.0)),
        (3, 0, circle(AU_KM, 3.156e7, 1.0)),
        (399, 3, circle(4670.0, 2.36e6, 2.0)),
        (301, 3, circle(3.8e5, 2.36e6, 2.0 + math.pi)),
        (1000999, 10, circle(1.3 * AU_KM, 4.7e7, 0.4)),
        (-999, 1000999, circle(40.0, 9e4, 0.1)),
    ):
        spice.spkw09(
            handle, target, centre, "J2000", epochs_s[0], epochs_s[-1], f"{target}", 7, len(epochs_s), states, epochs_s
        )
    spice.spkcls(handle)


def write_kernels(folder):
    if folder != FIXTURES:
        for name in TEXT_KERNELS:
            shutil.copy(FIXTURES / name, folder / name)
        shutil.copy(FIXTURES.parent / "leap.tls", folder.parent / "leap.tls")
    spice.kclear()
    for name in ("../leap.tls", "craft.tsc", "craft.tf"):
        spice.furnsh(str(folder / name))
    write_attitudes(folder / "craft.bc")
    write_places(folder / "craft.bsp")


def cspice(folder, epochs_s, instants_s):
    here = os.getcwd()
    os.chdir(folder)
    try:
        spice.kclear()
        spice.furnsh("craft.tm")
        turns = {name: [spice.pxform("J2000", name, t).tolist() for t in epochs_s] for name in FRAMES}
        # CSPICE has attitudes of type 1 at their instants alone; `ckgp` takes a tolerance.
        turns["CRAFT_SCANNER"] = [
            spice.ckgp(-999200, ticks(t), 65536.0, "J2000")[0].tolist() for t in instants_s
        ]
        places = {
            name: [(1e3 * np.array(spice.spkezr(name, t, "J2000", "NONE", "SSB")[0])).tolist() for t in epochs_s]
            for name in BODIES
        }
        # Where the camera sees the comet, with light-time and aberration.
        places["seen"] = [
            (1e3 * np.array(spice.spkpos("COMET", t, "CRAFT_CAMERA", "LT+S", "CRAFT")[0])).tolist() for t in epochs_s
        ]
        return turns, places
    finally:
        os.chdir(here)


def ours(folder, frames, bodies, epochs_s, seen=()):
    question = {
        "tdb_s": list(epochs_s), "kernels": [str(folder / "craft.tm")], "frames": frames, "bodies": bodies,
        "seen": list(seen),
    }
    done = subprocess.run([EXAMPLE], input=json.dumps(question), capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(done.stderr)
    return json.loads(done.stdout)


def covered(random, count):
    """Epochs outside the gap."""
    shares = random.uniform(0.0, STEPS - 1 - (GAP[1] - GAP[0]), count)
    return FROM_S + STEP_S * np.where(shares < GAP[0], shares, shares + GAP[1] - GAP[0])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--write", action="store_true", help="write the fixtures of RETINA's own test")
    write = parser.parse_args().write
    random = np.random.default_rng(999)
    with tempfile.TemporaryDirectory() as temporary:
        folder = FIXTURES if write else Path(temporary) / "craft"
        folder.mkdir(exist_ok=True)
        write_kernels(folder)
        epochs_s = covered(random, 24 if write else 5000)
        instants_s = FROM_S + STEP_S * random.integers(0, STEPS, len(epochs_s)) + random.uniform(-0.4, 0.4, len(epochs_s))
        turns, places = cspice(folder, epochs_s, instants_s)
        seen = places.pop("seen")
        if write:
            expected = {
                "made_by": f"CSPICE {spice.tkvrsn('TOOLKIT')}", "tdb_s": epochs_s.tolist(),
                "instants_tdb_s": instants_s.tolist(), "frame_from_inertial": turns, "states_m": places,
                "comet_seen_camera_m": seen,
            }
            (folder / "expected.json").write_text(json.dumps(expected, indent=1) + "\n")
            return 0
        if not EXAMPLE.exists():
            sys.exit(f"error: {EXAMPLE} is missing: cargo build --release -p retina-sky --example craft_poses")
        print(f"CSPICE {spice.tkvrsn('TOOLKIT')}, spiceypy {spice.__version__}; {len(epochs_s)} epochs each")
        own = ours(folder, list(FRAMES), list(BODIES), epochs_s, ["CRAFT", "CRAFT_CAMERA", "COMET"])
        scanner = ours(folder, ["CRAFT_SCANNER"], [], instants_s)
        worst = worst_m = 0.0
        for name, theirs in turns.items():
            answer = scanner if name == "CRAFT_SCANNER" else own
            off = max(
                np.abs(matrix(*turn) - np.array(expected)).max()
                for turn, expected in zip(answer["frame_from_inertial"][name], theirs, strict=True)
            )
            worst = max(worst, off)
            print(f"{name}: {off:.1e} of a unit vector")
        for name, theirs in places.items():
            off_m = np.abs(np.array(own["states_m"][name]) - np.array(theirs))
            worst_m = max(worst_m, off_m[:, :3].max())
            print(f"{name}: {off_m[:, :3].max():.1e} m, {off_m[:, 3:].max():.1e} m/s")
        seen, own_seen = np.array(seen), np.array(own["seen_camera_m"])
        norms = [np.linalg.norm(places, axis=1, keepdims=True) for places in (seen, own_seen)]
        off = np.linalg.norm(seen / norms[0] - own_seen / norms[1], axis=1).max()
        print(f"the comet in the camera: {off:.1e} rad (3 mm in 40 km, the rounding of its place, are 8e-8)")
        return int(worst > TOLERANCE or worst_m > TOLERANCE_M or off > SEEN_TOLERANCE_RAD)


if __name__ == "__main__":
    sys.exit(main())
