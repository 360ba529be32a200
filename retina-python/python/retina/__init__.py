"""RETINA: software of a camera-in-the-loop test facility for spaceborne vision sensors.

Conventions
-----------
Pixels have x to the right and y down; pixel (0, 0) covers [0, 1) x [0, 1), and its centre is (0.5, 0.5). Arrays of
images have shape (height, width). The camera looks along +z, with +x right and +y down. Inertial axes are ICRF. Times
are TDB seconds since J2000, which is SPICE's et. Quaternions are scalar-first and unit; ``camera_from_inertial`` takes
a vector from inertial to camera axes. Lengths and angles carry their unit in the name. Every error is a `RetinaError`.
"""

from ._bench import (
    Bench,
    CameraImage,
    bench_effects,
    read_table,
    simulate_points,
    simulate_power,
    write_table,
)
from ._calibrate import (
    Calibration,
    GeometryCalibration,
    RadiometryCalibration,
    calibrate_geometry,
    calibrate_radiometry,
)
from ._duck import time_s
from ._effects import Effect, OwnEffect, effects
from ._ephemeris import Ephemeris, SeenBody
from ._errors import RetinaError, RetinaWarning
from ._findings import Candidate, Comparison, Diagnosis, Fit, Formula, Investigation
from ._frames import Frame, Renderer, Scene
from ._images import Detection, detect
from ._limb import LimbSolution, fit_limb
from ._native import __version__
from ._notebook import Figure
from ._optics import Crossings, Mtf, OpticalSystem, Psf, Rays, Spots
from ._setup import Pinhole, Setup
from ._stars import StarSolution, StarSolver, solve_stars
from ._workbench import compare, diagnose, fit, investigate

__all__ = [
    "Bench",
    "Calibration",
    "CameraImage",
    "Candidate",
    "Comparison",
    "Crossings",
    "Detection",
    "Diagnosis",
    "Effect",
    "Ephemeris",
    "Figure",
    "Fit",
    "Formula",
    "Frame",
    "GeometryCalibration",
    "Investigation",
    "LimbSolution",
    "Mtf",
    "OpticalSystem",
    "OwnEffect",
    "Pinhole",
    "Psf",
    "RadiometryCalibration",
    "Rays",
    "Renderer",
    "RetinaError",
    "RetinaWarning",
    "Scene",
    "SeenBody",
    "Setup",
    "Spots",
    "StarSolution",
    "StarSolver",
    "__version__",
    "bench_effects",
    "calibrate_geometry",
    "calibrate_radiometry",
    "compare",
    "detect",
    "diagnose",
    "effects",
    "fit",
    "fit_limb",
    "investigate",
    "read_table",
    "simulate_points",
    "simulate_power",
    "solve_stars",
    "time_s",
    "write_table",
]
