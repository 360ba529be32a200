"""Attitude from the stars of one image."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _duck, _native
from ._calibrate import Calibrations, native_calibration
from ._duck import PathLike, Time, Vector, is_path
from ._ephemeris import Ephemeris
from ._errors import RetinaError
from ._notebook import Figure, Solution, shown, table_html
from ._setup import Setup, setup_of

#: Uncertainty of a position, 3 sigma, as the paper has it: 1e5 km.
_POSITION_3_SIGMA_KM = 1.0e5
_LIGHT_M_S = 299_792_458.0


class StarSolution(Solution):
    """What an image of stars gave.

    Where it is not solved, numbers are NaN, arrays are empty, and `reason` and `message` say why.
    """

    def __init__(self, answer: _native.StarAnswer) -> None:
        super().__init__(answer.document())
        self._answer = answer

    @property
    def ra_deg(self) -> float:
        """Right ascension of the boresight, deg."""
        return self._number("ra_deg")

    @property
    def dec_deg(self) -> float:
        """Declination of the boresight, deg."""
        return self._number("dec_deg")

    @property
    def roll_deg(self) -> float:
        """Roll, deg: from celestial north to the image's up, positive towards east."""
        return self._number("roll_deg")

    @property
    def matches(self) -> int:
        """Number of matched stars."""
        return int(self._document["matches"])

    @property
    def rms_arcsec(self) -> float:
        """Root mean square of the residuals, arcsec."""
        return self._number("rms_arcsec")

    @property
    def camera_from_inertial(self) -> npt.NDArray[np.float64]:
        """Rotation from ICRF to the camera's axes: a unit quaternion, scalar first, shape (4,)."""
        found = self._array("camera_from_inertial")
        return np.full(4, np.nan) if found is None else found

    @property
    def attitude_covariance_rad2(self) -> npt.NDArray[np.float64]:
        """Covariance of the attitude about the camera's axes, rad^2, shape (3, 3)."""
        found = self._array("attitude_covariance_rad2")
        return np.full((3, 3), np.nan) if found is None else found

    @property
    def focal_px(self) -> float:
        """Horizontal focal length as the stars have it, px."""
        return self._number("focal_px")

    @property
    def fov_deg(self) -> tuple[float, float]:
        """Horizontal and vertical field of view, deg."""
        width, height = self._document.get("fov_deg") or (np.nan, np.nan)
        return width, height

    @property
    def k1(self) -> float | None:
        """First radial distortion term, where the stars show one."""
        return self._optional("k1")

    @property
    def log10_false_probability(self) -> float:
        """Bound on the probability of a false answer, as log10."""
        return self._number("log10_false_probability")

    @property
    def mirrored(self) -> bool:
        """Whether the image is mirrored left to right: the attitude is that of its mirror image."""
        return bool(self._document.get("mirrored"))

    @property
    def stars(self) -> dict[str, Any]:
        """The matched stars: ``id`` (list), ``magnitude``, ``x_px``, ``y_px``, ``residual_x_arcsec``, ``residual_y_arcsec``."""
        stars = self._document.get("stars") or []
        pixels = np.array([star["camera_px"] for star in stars], dtype=float).reshape(-1, 2)
        residuals = np.array([star["residual_arcsec"] for star in stars], dtype=float).reshape(-1, 2)
        return {
            "id": [star["id"] for star in stars],
            "magnitude": np.array([star["magnitude"] for star in stars], dtype=float),
            "x_px": pixels[:, 0],
            "y_px": pixels[:, 1],
            "residual_x_arcsec": residuals[:, 0],
            "residual_y_arcsec": residuals[:, 1],
        }

    @property
    def planets(self) -> list[dict[str, Any]]:
        """Planets that were identified; they take a time and a position."""
        return list(self._document.get("planets") or [])

    @property
    def solve_ms(self) -> float:
        """Time from points to attitude, ms."""
        return self._number("solve_ms")

    @property
    def detect_ms(self) -> float:
        """Time from pixels to points, ms."""
        return self._number("detect_ms")

    @property
    def warning(self) -> str | None:
        """What the figures do not say by themselves: that the camera's model does not fit."""
        return self._document.get("warning")

    def plot(self, title: str = "") -> Figure:
        """Draw the image with stars, planets, names and coordinates."""
        return Figure(self._answer.svg(title))

    def wcs_header(self) -> bytes:
        """Return the world coordinates as a FITS header (TAN-SIP); ``astropy.wcs.WCS`` takes it.

        Raises
        ------
        RetinaError
            The image is not solved.
        """
        header = self._answer.wcs_header()
        if header is None:
            raise RetinaError("has no coordinates", found=self.message, expected="an image that is solved")
        return bytes(header)

    def save_wcs(self, path: PathLike) -> None:
        """Write the world coordinates as a FITS file without pixels."""
        Path(path).write_bytes(self.wcs_header())

    def __repr__(self) -> str:
        if not self.solved:
            return f"<StarSolution: refused, {self.reason}>"
        return (
            f"<StarSolution: ra {self.ra_deg:.4f} deg, dec {self.dec_deg:.4f} deg, roll {self.roll_deg:.4f} deg, "
            f"{self.matches} stars, {self.rms_arcsec:.2f} arcsec rms>"
        )

    def _repr_html_(self) -> str:
        if not self.solved:
            return table_html("not solved", ("", ""), [("reason", self.reason), ("message", self.message)])
        names = ("ra_deg", "dec_deg", "roll_deg", "matches", "rms_arcsec", "fov_deg", "log10_false_probability")
        return table_html("attitude", ("", ""), ((name, shown(getattr(self, name))) for name in names))


class StarSolver:
    """Finds attitudes by stars, lost in space. What it prepares for one image serves the next of the same size.

    Parameters
    ----------
    setup : Setup, path or str, optional
        The camera.
    calibration : optional
        Calibration of the facility, for images that hold its distortion.
    fov_deg : float or (float, float), optional
        Horizontal field of view, or its range (both ends included), deg. Without it and a setup, the field of an
        image's EXIF is taken; if there is none, or the stars do not agree with it, 2 to 70 deg are searched.
    focal_percent : float
        Uncertainty of the focal length, per cent.
    time : optional
        Epoch of the images. Default: star positions of J2020.0.
    log10_bound : float
        Highest accepted probability of a false answer, as log10.
    most_hypotheses : int, optional
        Number of star patterns after which the search on an image stops.
    threshold_sigma : float
        Detection threshold, standard deviations.
    mirrored : bool
        The images are mirror images. An image that turns out to be one is solved all the same.
    pixel_aspect : float, optional
        How many times as high as wide a pixel is.
    """

    def __init__(
        self,
        *,
        setup: Setup | PathLike | None = None,
        calibration: Calibrations | None = None,
        fov_deg: float | tuple[float, float] | Sequence[float] | None = None,
        focal_percent: float = 3.0,
        time: Time | None = None,
        log10_bound: float = -7.0,
        most_hypotheses: int | None = None,
        threshold_sigma: float = 5.0,
        mirrored: bool = False,
        pixel_aspect: float | None = None,
    ) -> None:
        if setup is not None and fov_deg is not None:
            raise RetinaError("has no effect beside a setup", place="argument `fov_deg`", help="leave out one of the two")
        if setup is None and calibration is not None:
            raise RetinaError("takes a setup", place="argument `calibration`", help="give the setup of the camera")
        for name, value, least, most in (
            ("focal_percent", focal_percent, 0.0, 20.0),
            ("log10_bound", log10_bound, -1000.0, 0.0),
            ("threshold_sigma", threshold_sigma, 1e-6, 1e6),
            ("pixel_aspect", 1.0 if pixel_aspect is None else pixel_aspect, 0.2, 5.0),
        ):
            if not least <= value <= most:
                raise RetinaError("is out of range", place=f"argument `{name}`", found=str(value), expected=f"{least:g} to {most:g}")
        self.time_s = None if time is None else _duck.time_s(time)
        own = None if setup is None else setup_of(setup)
        self._native = _native.StarSolver(
            None if own is None else own._native,
            None if own is None else native_calibration(calibration, own),
            _field_rad(fov_deg),
            focal_percent / 100.0,
            log10_bound,
            most_hypotheses,
            threshold_sigma,
            mirrored,
            pixel_aspect,
            self.time_s,
        )

    def solve(
        self,
        image: Any,
        *,
        bits: int | None = None,
        mask: Any = None,
        position_m: Vector | None = None,
        velocity_m_s: Vector | None = None,
        position_3_sigma_km: float = _POSITION_3_SIGMA_KM,
        ephemeris: Ephemeris | None = None,
    ) -> StarSolution:
        """Find the attitude of an image; see `solve_stars` for the parameters."""
        observer = None
        if velocity_m_s is not None and position_m is None:
            raise RetinaError(
                "takes a position", place="argument `velocity_m_s`", help="give position_m, and time, as well"
            )
        if position_m is not None:
            if self.time_s is None:
                raise RetinaError("takes a time", place="argument `position_m`", help="give the epoch of the image (time)")
            bodies = ephemeris or Ephemeris()
            if isinstance(position_m, str):
                if position_m != "earth":
                    raise RetinaError("is no place", place="argument `position_m`", found=position_m, expected='"earth" or X, Y, Z')
                position_m = bodies.position_m("earth", self.time_s)
                velocity_m_s = bodies.velocity_m_s("earth", self.time_s) if velocity_m_s is None else velocity_m_s
            observer = _native.Observer(
                bodies._native,
                self.time_s,
                _duck.vector(position_m, "m"),
                None if velocity_m_s is None else _velocity_m_s(velocity_m_s),
            )
        answer = self._native.solve(
            os.fspath(image) if is_path(image) else _duck.image(image),
            bits,
            None if mask is None else np.ascontiguousarray(mask, dtype=bool),
            observer,
            1e3 * position_3_sigma_km / 3.0,
        )
        return StarSolution(answer)


def _velocity_m_s(velocity_m_s: Vector) -> npt.NDArray[np.float64]:
    velocity = _duck.vector(velocity_m_s, "m/s")
    speed_m_s = float(np.linalg.norm(velocity))
    if not speed_m_s < _LIGHT_M_S:
        raise RetinaError(
            "is no velocity", place="argument `velocity_m_s`", found=f"{speed_m_s:g} m/s", expected="less than light's"
        )
    return velocity


def _field_rad(fov_deg: Any) -> tuple[float, float] | None:
    if fov_deg is None:
        return None
    ends = [fov_deg] if np.isscalar(fov_deg) or not isinstance(fov_deg, Sequence) else fov_deg
    degrees = np.array([value for end in ends for value in _duck.numbers(end, "deg", "fov_deg")])
    if degrees.size not in (1, 2) or not 0.0 < degrees[0] <= degrees[-1] < 90.0:
        raise RetinaError(
            "is not a field of view",
            place="argument `fov_deg`",
            found=str(fov_deg),
            expected="degrees above 0 and below 90, or a range such as (10, 13)",
        )
    return float(np.radians(degrees[0])), float(np.radians(degrees[-1]))


#: Solvers of the last calls: preparing one takes longer than an image.
_SOLVERS: OrderedDict[Hashable, StarSolver] = OrderedDict()
_MOST_SOLVERS = 8


def solve_stars(
    image: Any,
    fov_deg: float | tuple[float, float] | Sequence[float] | None = None,
    *,
    setup: Setup | PathLike | None = None,
    calibration: Calibrations | None = None,
    time: Time | None = None,
    position_m: Vector | None = None,
    velocity_m_s: Vector | None = None,
    position_3_sigma_km: float = _POSITION_3_SIGMA_KM,
    ephemeris: Ephemeris | None = None,
    bits: int | None = None,
    mask: Any = None,
    focal_percent: float = 3.0,
    log10_bound: float = -7.0,
    most_hypotheses: int | None = None,
    threshold_sigma: float = 5.0,
    mirrored: bool = False,
    pixel_aspect: float | None = None,
) -> StarSolution:
    """Find the attitude of an image of stars, lost in space, and the planets in it.

    Parameters
    ----------
    image : array_like of shape (height, width), or path
        Digital numbers that are linear in light; or a PNG, TIFF, FITS or JPEG file.
    fov_deg, setup, calibration, focal_percent, log10_bound, most_hypotheses, threshold_sigma, mirrored, pixel_aspect
        As `StarSolver` takes them.
    time : float, str, datetime or astropy.time.Time, optional
        Epoch of the image. Default: star positions of J2020.0.
    position_m : array_like of shape (3,) or "earth", optional
        Position of the camera, barycentric ICRF, m. With it and a time, planets are searched for.
    velocity_m_s : array_like of shape (3,), optional
        Velocity of the camera, barycentric ICRF, m/s: the attitude is corrected for aberration. It takes a position
        as well. Default with ``"earth"``: the Earth's.
    position_3_sigma_km : float
        Uncertainty of the position (3 sigma), km.
    ephemeris : Ephemeris, optional
        Where the Sun, the Moon and the planets are taken from. Default: analytical theories.
    bits : int, optional
        Bits of the camera's digital numbers. Default: the setup's, or those of the type or the file.
    mask : array_like of bool, shape (height, width), optional
        True where points are looked for.

    Returns
    -------
    StarSolution
        Also of an image that is not solved: ask `StarSolution.solved`.

    Raises
    ------
    RetinaError
        The image or an argument does not fit.
    """
    options: dict[str, Any] = {
        "fov_deg": fov_deg,
        "setup": setup,
        "calibration": calibration,
        "time": time,
        "focal_percent": focal_percent,
        "log10_bound": log10_bound,
        "most_hypotheses": most_hypotheses,
        "threshold_sigma": threshold_sigma,
        "mirrored": mirrored,
        "pixel_aspect": pixel_aspect,
    }
    return _solver(options).solve(
        image,
        bits=bits,
        mask=mask,
        position_m=position_m,
        velocity_m_s=velocity_m_s,
        position_3_sigma_km=position_3_sigma_km,
        ephemeris=ephemeris,
    )


def _solver(options: dict[str, Any]) -> StarSolver:
    field = options["fov_deg"]
    key = tuple(options.values())
    if field is not None:
        key = (_field_rad(field), *key[1:])
    # A file may change between calls, and not every epoch can be a key.
    if is_path(options["setup"]) or is_path(options["calibration"]) or not _hashable(key):
        return StarSolver(**options)
    solver = _SOLVERS.pop(key, None) or StarSolver(**options)
    _SOLVERS[key] = solver
    if len(_SOLVERS) > _MOST_SOLVERS:
        _SOLVERS.popitem(last=False)
    return solver


def _hashable(key: Hashable) -> bool:
    try:
        hash(key)
    except TypeError:
        return False
    return True
