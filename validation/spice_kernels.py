"""How SPICE kernels turn bodies and how large they are: RETINA against CSPICE, through spiceypy.

    python3 -m venv V && V/bin/pip install -r validation/requirements-spice.txt
    cargo build --release -p retina-sky --example body_axes
    V/bin/python validation/spice_kernels.py [--write]

The kernels are made here, since no network is needed then: binary PCK kernels by CSPICE's pckw02, text kernels by hand
with the forms that NAIF's use (nutation series of degree 1 and 2, offsets as angles, matrix and quaternion, a
meta-kernel with symbols and continued paths). Their numbers are of the size of the real ones. --write puts the kernels
and 24 epochs of CSPICE's matrices into retina-sky/tests/spice, where a test of RETINA reads them. The exit code is 1
where an axis differs by more than 1e-10 rad.
"""

import argparse
import json
import math
import os
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

TPC = r"""KPL/PCK

Constants of the forms that pck00011.tpc has. BODY301 is that of Archinal et al. (2018).

\begindata
BODY301_RADII     = ( 1737.4  1737.4  1737.4 )
BODY301_POLE_RA   = (  269.9949  0.0031  0. )
BODY301_POLE_DEC  = (   66.5392  0.0130  0. )
BODY301_PM        = (   38.3213 13.17635815 -1.4D-12 )
BODY301_NUT_PREC_RA  = ( -3.8787 -0.1204 0.0700 -0.0172 0.0 0.0072 0.0 0.0 0.0 -0.0052 0.0 0.0 0.0043 )
BODY301_NUT_PREC_DEC = (  1.5419  0.0239 -0.0278 0.0068 0.0 -0.0029 0.0009 0.0 0.0 0.0008 0.0 0.0 -0.0009 )
BODY301_NUT_PREC_PM  = (  3.5610  0.1208 -0.0642 0.0158 0.0252 -0.0066 -0.0047 -0.0046 0.0028 0.0052 0.0040
                          0.0019 -0.0044 )
BODY3_NUT_PREC_ANGLES = ( 125.045 -1935.5364525  250.089 -3871.072905  260.008 475263.3328725
    176.625 487269.629985  357.529 35999.0509575  311.589 964468.49931  134.963 477198.869325
    276.617 12006.300765   34.226 63863.5132425   15.134 -5806.6093575  119.743 131.84064
    239.961 6003.1503825   25.053 473327.79642 )

BODY499_RADII     = ( 3396.19 3396.19 3376.20 )
BODY499_POLE_RA   = ( 317.269202 -0.10927547 )
BODY499_POLE_DEC  = (  54.432516 -0.05827105 )
BODY499_PM        = ( 176.049863 350.891982443297 0. )
BODY4_MAX_PHASE_DEGREE = 2
BODY4_NUT_PREC_ANGLES = ( 190.72646643 15917.10818695 0.  21.4689247 31834.27934054 0.
                          332.86082793 19139.89694742 0.  394.93256437 38280.79631835 12.4 )
BODY499_NUT_PREC_RA  = ( 0.000068 0.000238, 0.000052 0.419057 )
BODY499_NUT_PREC_DEC = ( 0.000051 0.000141 0.000031 1.591274 )
BODY499_NUT_PREC_PM  = ( 0.000145 0.000157 0.000040 0.584542 )
\begintext
A body of its own number and name.
\begindata
NAIF_BODY_NAME += 'PEBBLE'
NAIF_BODY_CODE += 2990001
BODY2990001_RADII    = ( 16.3 8.4 8.0 )
BODY2990001_POLE_RA  = ( 11.35 0. 0. )
BODY2990001_POLE_DEC = ( 17.22 0. 0. )
BODY2990001_PM       = ( 326.07 1639.38864745 0. )
"""

FK = r"""KPL/FK

\begindata
FRAME_MOON_PA_DE440        = 31008
FRAME_31008_NAME           = 'MOON_PA_DE440'
FRAME_31008_CLASS          = 2
FRAME_31008_CLASS_ID       = 31008
FRAME_31008_CENTER         = 301
FRAME_MOON_ME_DE440_ME421  = 31009
FRAME_31009_NAME           = 'MOON_ME_DE440_ME421'
FRAME_31009_CLASS          = 4
FRAME_31009_CLASS_ID       = 31009
FRAME_31009_CENTER         = 301
TKFRAME_31009_SPEC         = 'ANGLES'
TKFRAME_31009_RELATIVE     = 'MOON_PA_DE440'
TKFRAME_31009_ANGLES       = ( 67.8526 78.6944 0.2785 )
TKFRAME_31009_AXES         = ( 3 2 1 )
TKFRAME_31009_UNITS        = 'ARCSECONDS'
FRAME_MOON_ME              = 310010
FRAME_310010_NAME          = 'MOON_ME'
FRAME_310010_CLASS         = 4
FRAME_310010_CLASS_ID      = 310010
FRAME_310010_CENTER        = 301
TKFRAME_310010_SPEC        = 'MATRIX'
TKFRAME_310010_RELATIVE    = 'MOON_ME_DE440_ME421'
TKFRAME_310010_MATRIX      = ( 1 0 0 0 1 0 0 0 1 )
FRAME_PEBBLE_FIXED         = 1990001
FRAME_1990001_NAME         = 'PEBBLE_FIXED'
FRAME_1990001_CLASS        = 4
FRAME_1990001_CLASS_ID     = 1990001
FRAME_1990001_CENTER       = 2990001
TKFRAME_1990001_SPEC       = 'QUATERNION'
TKFRAME_1990001_RELATIVE   = 'PEBBLE_TILTED'
TKFRAME_1990001_Q          = ( 0.8 0.6 0.0 0.0 )
FRAME_PEBBLE_TILTED        = 1990002
FRAME_1990002_NAME         = 'PEBBLE_TILTED'
FRAME_1990002_CLASS        = 4
FRAME_1990002_CLASS_ID     = 1990002
FRAME_1990002_CENTER       = 2990001
TKFRAME_1990002_SPEC       = 'MATRIX'
TKFRAME_1990002_RELATIVE   = 'PEBBLE_TURNING'
TKFRAME_1990002_MATRIX     = ( 0.36 0.48 -0.8
                              -0.8  0.6   0.0
                               0.48 0.64  0.6 )
FRAME_PEBBLE_TURNING       = 1990003
FRAME_1990003_NAME         = 'PEBBLE_TURNING'
FRAME_1990003_CLASS        = 2
FRAME_1990003_CLASS_ID     = 2990001
FRAME_1990003_CENTER       = 2990001
OBJECT_EARTH_FRAME         = 'ITRF93'
OBJECT_2990001_FRAME       = 'PEBBLE_FIXED'
"""

TLS = r"""KPL/LSK
\begindata
DELTET/DELTA_T_A = 32.184
DELTET/K = 1.657D-3
DELTET/EB = 1.671D-2
DELTET/M = ( 6.239996D0 1.99096871D-7 )
DELTET/DELTA_AT = ( 10, @1972-JAN-1 11, @1972-JUL-1 12, @1973-JAN-1 13, @1974-JAN-1 14, @1975-JAN-1
  15, @1976-JAN-1 16, @1977-JAN-1 17, @1978-JAN-1 18, @1979-JAN-1 19, @1980-JAN-1 20, @1981-JUL-1 21, @1982-JUL-1
  22, @1983-JUL-1 23, @1985-JUL-1 24, @1988-JAN-1 25, @1990-JAN-1 26, @1991-JAN-1 27, @1992-JUL-1 28, @1993-JUL-1
  29, @1994-JUL-1 30, @1996-JAN-1 31, @1997-JUL-1 32, @1999-JAN-1 33, @2006-JAN-1 34, @2009-JAN-1 35, @2012-JUL-1
  36, @2015-JUL-1 37, @2017-JAN-1 )
"""

TM = r"""KPL/MK
\begindata
PATH_VALUES  = ( '.' )
PATH_SYMBOLS = ( 'HERE' )
KERNELS_TO_LOAD = ( '$HERE/leap.tls' '$HERE/const+' 'ants.tpc'
                    '$HERE/axes.bpc' '$HERE/frames.tf' )
"""

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
    for name, text in (("constants.tpc", TPC), ("frames.tf", FK), ("leap.tls", TLS), ("all.tm", TM)):
        (folder / name).write_text(text)


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
