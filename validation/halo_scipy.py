"""The built-in halo trajectory against scipy's integrator and jplephem's ephemeris.

    cargo build --release -p retina-cli
    validation/.venv/bin/python validation/halo_scipy.py [--kernel FILE.bsp] [--days 15]

`retina trajectory --ephemeris` makes the table with DE421 of the PyPI package skyfield-data (or another kernel). From
frames of it scipy's DOP853 integrates the equations of motion under the Moon, the Earth, the Sun and sunlight, written
out here, with the places of jplephem; what it finds at later frames is compared with the table. The exit code is 1 where
a day's path is off by 1 m or 1 mm/s, or 15 days' by 100 m.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from jplephem.spk import SPK
from scipy.integrate import solve_ivp
from skyfield_data import get_skyfield_data_path

ROOT = Path(__file__).resolve().parent.parent
RETINA = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release/retina"
DAY_S, J2000 = 86_400.0, 2_451_545.0
# m^3/s^2, JPL DE440.
GM = {"sun": 1.327124400412794e20, "earth": 3.98600435507e14, "moon": 4.902800118e12}
AU_M, LIGHT_M_S = 149_597_870_700.0, 299_792_458.0
# N/m^2 at 1 au, and coefficient times area over mass.
PRESSURE, AREA_M2_KG = 1361.0 / LIGHT_M_S, 1.3 * 0.4 / 24.0
STEP_S = 1800.0


def acceleration(kernel, time_s, at):
    days = np.floor(time_s / DAY_S)
    rest = (time_s - days * DAY_S) / DAY_S
    where = lambda *link: 1e3 * kernel[link].compute(J2000 + days, rest)
    moon_barycentric = where(0, 3) + where(3, 301)
    bodies = {"earth": where(0, 3) + where(3, 399), "sun": where(0, 10)}
    total = -GM["moon"] * at / np.linalg.norm(at) ** 3
    for name, place in bodies.items():
        body = place - moon_barycentric
        off = at - body
        total -= GM[name] * (off / np.linalg.norm(off) ** 3 + body / np.linalg.norm(body) ** 3)
    from_sun = at - (bodies["sun"] - moon_barycentric)
    distance = np.linalg.norm(from_sun)
    return total + PRESSURE * AREA_M2_KG * (AU_M / distance) ** 2 * from_sun / distance


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kernel", type=Path, default=Path(get_skyfield_data_path()) / "de421.bsp")
    parser.add_argument("--days", type=float, default=15.0)
    arguments = parser.parse_args()
    if not RETINA.exists():
        sys.exit(f"error: {RETINA} is missing: cargo build --release -p retina-cli")
    frames = int(arguments.days * DAY_S / STEP_S) + 1
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "poses.csv"
        made = subprocess.run(
            [RETINA, "trajectory", "--frames", str(frames), "--step-s", str(STEP_S), "--ephemeris", arguments.kernel]
            + ["--out", table, "--json"],
            capture_output=True,
            text=True,
        )
        if made.returncode != 0:
            sys.exit(made.stderr)
        summary = json.loads(made.stdout)
        rows = list(csv.DictReader(line for line in table.read_text().splitlines() if not line.startswith("#")))
    column = lambda *names: np.array([[float(row[name]) for name in names] for row in rows])
    times_s = column("time_s")[:, 0]
    states = column(*(f"camera_{axis}_m" for axis in "xyz"), *(f"camera_v{axis}_m_s" for axis in "xyz"))
    kernel = SPK.open(arguments.kernel)

    def off(first, last):
        """Position (m) and velocity (m/s) by which scipy's path from one frame misses another."""
        rate = lambda t, y: np.concatenate([y[3:], acceleration(kernel, times_s[first] + t, y[:3])])
        span = [0.0, times_s[last] - times_s[first]]
        end = solve_ivp(rate, span, states[first], method="DOP853", rtol=1e-12, atol=1e-9).y[:, -1]
        return np.linalg.norm((end - states[last])[:3]), np.linalg.norm((end - states[last])[3:])

    print(f"{frames} frames over {arguments.days:g} days, {arguments.kernel.name}; joined to {summary['defect_m']:.1e} m")
    day = round(DAY_S / STEP_S)
    days = [off(first, first + day) for first in range(0, frames - day, day)]
    worst = np.max(days, axis=0)
    print(f"a day from each day's first frame: at most {worst[0]:.4f} m, {worst[1]:.2e} m/s")
    whole = off(0, frames - 1)
    print(f"the whole path from its first frame: {whole[0]:.3f} m, {whole[1]:.2e} m/s")
    return 0 if worst[0] < 1.0 and worst[1] < 1e-3 and (arguments.days > 15 or whole[0] < 100.0) else 1


if __name__ == "__main__":
    sys.exit(main())
