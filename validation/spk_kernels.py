"""Places of Sun, Moon and planets, from the analytical theories and from an SPK kernel, against jplephem.

    cargo build --release -p retina-sky --example ephemeris_places
    validation/.venv/bin/python validation/spk_kernels.py [--kernel FILE.bsp]

jplephem, the reader that Skyfield stands on, evaluates DE421 of the PyPI package skyfield-data (or another
kernel) link by link; the program reads the same file through anise. Barycentric places at 20 000 epochs of
1950 to 2050 and at the ends of the kernel. The exit code is 1 where the two readers differ by 1 m.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from jplephem.spk import SPK
from skyfield_data import get_skyfield_data_path

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release/examples/ephemeris_places"
DAY_S, J2000 = 86_400.0, 2_451_545.0
ARCSEC = np.pi / 648_000.0
READERS_M = 1.0
# Links to the Solar System's barycentre, by NAIF's numbers.
CHAINS = {
    "sun": [(0, 10)], "mercury": [(0, 1), (1, 199)], "venus": [(0, 2), (2, 299)], "earth": [(0, 3), (3, 399)],
    "moon": [(0, 3), (3, 301)], "mars": [(0, 4)], "jupiter": [(0, 5)], "saturn": [(0, 6)], "uranus": [(0, 7)],
    "neptune": [(0, 8)],
}


def ask(epochs_s, kernels):
    if not EXAMPLE.exists():
        sys.exit(f"error: {EXAMPLE} is missing: cargo build --release -p retina-sky --example ephemeris_places")
    question = json.dumps({"tdb_s": list(epochs_s), "kernels": [str(path) for path in kernels]})
    done = subprocess.run([EXAMPLE], input=question, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(done.stderr)
    answer = json.loads(done.stdout)
    return {name: np.array(answer["places_m"][name]) for name in CHAINS}, answer["timing"]


def reference(kernel, epochs_s):
    """Whole days apart from the rest: jplephem keeps the digits that one Julian date would lose."""
    days = np.floor(epochs_s / DAY_S)
    rest = (epochs_s - days * DAY_S) / DAY_S
    return {
        name: 1e3 * sum(kernel[link].compute(J2000 + days, rest) for link in chain).T
        for name, chain in CHAINS.items()
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kernel", type=Path, default=Path(get_skyfield_data_path()) / "de421.bsp")
    path = parser.parse_args().kernel
    kernel = SPK.open(path)
    random = np.random.default_rng(421)
    epochs_s = np.sort(random.uniform(-50.0, 50.0, 20_000)) * 365.25 * DAY_S
    links = {link for chain in CHAINS.values() for link in chain}
    ends_s = [(max(kernel[link].start_jd for link in links) - J2000) * DAY_S]
    ends_s.append((min(kernel[link].end_jd for link in links) - J2000) * DAY_S)
    with_ends_s = np.concatenate([epochs_s, ends_s])
    expected = reference(kernel, with_ends_s)
    ours, timing = ask(with_ends_s, [path])
    theory, theory_timing = ask(epochs_s, [])
    print(f"{path.name}: {len(with_ends_s)} epochs")
    print(f"{'':10s} {'kernel, m':>22s} {'theories, km':>24s} {'as seen from':>14s} {'arcsec':>20s}")
    print(f"{'':10s} {'rms':>11s} {'largest':>10s} {'rms':>12s} {'largest':>11s} {'':>14s} {'rms':>10s} {'largest':>9s}")
    worst_m = 0.0
    for name in CHAINS:
        readers_m = np.linalg.norm(ours[name] - expected[name], axis=1)
        worst_m = max(worst_m, readers_m.max())
        off_km = np.linalg.norm(theory[name] - expected[name][:-2], axis=1) / 1e3
        # As geometric directions from the Earth's centre, and the Earth's own from the Sun's.
        centre = "sun" if name == "earth" else "earth"
        ways = [places[name] - places[centre] for places in (theory, {k: v[:-2] for k, v in expected.items()})]
        apart = np.linalg.norm(np.cross(*ways), axis=1) / np.linalg.norm(ways[0], axis=1)
        apart = apart / np.linalg.norm(ways[1], axis=1) / ARCSEC
        rms = lambda values: np.sqrt((values**2).mean())
        print(
            f"{name:10s} {rms(readers_m):11.6f} {readers_m.max():10.6f} {rms(off_km):12.2f} {off_km.max():11.2f} "
            f"{centre:>14s} {rms(apart):10.4f} {apart.max():9.4f}"
        )
    print(f"largest difference of the two readers: {worst_m:.6f} m, {READERS_M} m allowed")
    print(f"all ten bodies at one epoch: kernel {timing['all_bodies_us']:.1f} us, theories {theory_timing['all_bodies_us']:.1f} us")
    sys.exit(0 if worst_m < READERS_M else 1)


if __name__ == "__main__":
    main()
