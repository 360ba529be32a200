"""Range and direction of a body from its limb in one image."""

from __future__ import annotations

import os
from collections.abc import Sequence
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


class LimbSolution(Solution):
    """What a body's limb gave. Where the image is refused, numbers are NaN, and `message` says why."""

    def __init__(self, answer: _native.LimbAnswer) -> None:
        super().__init__(answer.document())
        self._answer = answer

    @property
    def center_px(self) -> npt.NDArray[np.float64]:
        """Centre of the body in the image, px, shape (2,)."""
        return self._found("center_px", 2)

    @property
    def radius_px(self) -> float:
        """Mean of the outline's semi-axes, px."""
        return self._number("radius_px")

    @property
    def center_sigma_px(self) -> float:
        """Standard deviation of the centre per axis, px."""
        return float((self._document.get("sigma_px") or {}).get("center", np.nan))

    @property
    def radius_sigma_px(self) -> float:
        """Standard deviation of the radius, px."""
        return float((self._document.get("sigma_px") or {}).get("radius", np.nan))

    @property
    def range_m(self) -> float:
        """Distance of the body's centre, m."""
        return self._number("range_m")

    @property
    def range_sigma_m(self) -> float:
        """Standard deviation of the range, m."""
        return self._number("range_sigma_m")

    @property
    def range_sigma_terms_m(self) -> dict[str, float]:
        """Where the range's standard deviation comes from, m."""
        return dict(self._document.get("range_sigma_terms_m") or {})

    @property
    def line_of_sight(self) -> npt.NDArray[np.float64]:
        """Unit vector to the body's centre, camera frame, shape (3,)."""
        return self._found("line_of_sight", 3)

    @property
    def line_of_sight_sigma_arcsec(self) -> float:
        """Standard deviation of the line of sight per axis, arcsec."""
        return self._number("line_of_sight_sigma_arcsec")

    @property
    def position_camera_m(self) -> npt.NDArray[np.float64]:
        """Position of the body's centre, camera frame, m, shape (3,)."""
        return self._found("position_camera_m", 3)

    @property
    def covariance_m2(self) -> npt.NDArray[np.float64]:
        """Covariance of that position, m^2, shape (3, 3)."""
        found = self._array("covariance_m2")
        return np.full((3, 3), np.nan) if found is None else found

    @property
    def sun_deg(self) -> float | None:
        """Position angle of the Sun in the image, deg: 0 is up, 90 is left."""
        return self._optional("sun_deg")

    @property
    def camera_from_inertial(self) -> npt.NDArray[np.float64]:
        """Attitude by the stars beside the body, scalar first, shape (4,); NaN without `stars`."""
        found = (self._document.get("stars") or {}).get("camera_from_inertial")
        return np.full(4, np.nan) if found is None else np.asarray(found, dtype=np.float64)

    @property
    def position_from_body_m(self) -> npt.NDArray[np.float64]:
        """Place of the camera relative to the body, ICRF axes, m, shape (3,); NaN where the stars did not give it."""
        found = (self._document.get("place") or {}).get("position_from_body_m")
        return np.full(3, np.nan) if found is None else np.asarray(found, dtype=np.float64)

    @property
    def points(self) -> dict[str, npt.NDArray[Any]]:
        """Points of the limb: ``x_px``, ``y_px``, ``sigma_px``, ``residual_px``, ``used``."""
        return self._answer.points()

    @property
    def rms_px(self) -> float:
        """Root mean square of the used points' residuals, px."""
        return self._number("rms_px")

    def plot(self, title: str = "") -> Figure:
        """Draw the image with the fitted outline, and the residuals along the limb."""
        return Figure(self._answer.svg(title))

    def __repr__(self) -> str:
        if not self.solved:
            return f"<LimbSolution: refused, {self.reason}>"
        return (
            f"<LimbSolution: centre ({self.center_px[0]:.2f}, {self.center_px[1]:.2f}) px, radius "
            f"{self.radius_px:.2f} px, range {self.range_m:.6g} +- {self.range_sigma_m:.2g} m>"
        )

    def _repr_html_(self) -> str:
        if not self.solved:
            return table_html("not solved", ("", ""), [("reason", self.reason), ("message", self.message)])
        names = ("center_px", "radius_px", "range_m", "range_sigma_m", "line_of_sight_sigma_arcsec", "rms_px")
        return table_html("limb", ("", ""), ((name, shown(getattr(self, name))) for name in names))

    def _found(self, key: str, size: int) -> npt.NDArray[np.float64]:
        found = self._array(key)
        return np.full(size, np.nan) if found is None else found


def fit_limb(
    image: Any,
    *,
    setup: Setup | PathLike | None = None,
    calibration: Calibrations | None = None,
    focal_mm: float | None = None,
    pixel_um: float | None = None,
    fov_deg: float | None = None,
    focal_percent: float | None = None,
    body: str | PathLike | float | Sequence[float] = "moon",
    camera_from_body: Vector | None = None,
    limb_height_m: float | None = None,
    limb_height_sigma_m: float | None = None,
    sun_deg: float | None = None,
    time: Time | None = None,
    site: tuple[float, float, float] | None = None,
    position_m: Vector | None = None,
    ephemeris: Ephemeris | None = None,
    bits: int | None = None,
    silhouette: PathLike | None = None,
    mask: Any = None,
    stars: bool = False,
) -> LimbSolution:
    """Measure a body's limb: its centre, its range, and its line of sight.

    Parameters
    ----------
    image : array_like of shape (height, width), or path
        Digital numbers that are linear in light; or a PNG, TIFF, FITS or JPEG file.
    setup : Setup, path or str, optional
        The camera. Without it give `focal_mm` and `pixel_um`, or `fov_deg`; a file may have a focal length in its EXIF.
    calibration : optional
        Calibration of the facility, for an image that holds its distortion.
    focal_mm, pixel_um : float, optional
        Focal length, mm, and size of a pixel, um.
    fov_deg : float, optional
        Horizontal field of view, deg.
    focal_percent : float, optional
        Uncertainty of the focal length (1 sigma), per cent. Default: 0.5; 4 of an EXIF focal length.
    body : str, path, float or sequence of three floats
        ``"moon"``, a planet, a mesh (.glb, .gltf, .obj, .icq, .bds) whose silhouette is fitted if the attitude is given, a radius (m), or
        three semi-axes (m).
    camera_from_body : array_like of shape (4,), optional
        Rotation from the body's axes to the camera's, scalar first. Only a body that is not nearly round needs it.
    limb_height_m, limb_height_sigma_m : float, optional
        Mean height of the seen limb above the reference surface, and its uncertainty (1 sigma), m. Default: the body's.
    sun_deg : float, optional
        Position angle of the Sun in the image, deg: 0 is up, 90 is left. Default: found from the lit shape.
    time : float, str, datetime or astropy.time.Time, optional
        Epoch. With a place it gives the phase angle, and the range and radius that are expected.
    site : (latitude_deg, longitude_deg, altitude_m), optional
        Place on the Earth (WGS 84).
    position_m : array_like of shape (3,), optional
        Position of the camera, barycentric ICRF, m, instead of a site.
    ephemeris : Ephemeris, optional
        Where the Sun, the Moon and the planets are taken from. Default: analytical theories.
    bits : int, optional
        Bits of the camera's digital numbers. Default: the setup's, or those of the type or the file.
    silhouette : path, optional
        Mesh of the body in its own axes, whose silhouette is fitted, terrain included. The attitude must be known:
        `camera_from_body`, or `stars` with `time`.
    mask : array_like of bool, shape (height, width), optional
        True where pixels count: False for a tree or a cloud beside the body.
    stars : bool
        Find the stars beside the body, too: they give the attitude, the focal length and the camera's place. With `time`
        alone, the place may be left out.

    Returns
    -------
    LimbSolution
        Also of an image that is refused: ask `LimbSolution.solved`.

    Raises
    ------
    RetinaError
        The image or an argument does not fit.
    """
    picture = os.fspath(image) if is_path(image) else _duck.image(image)
    own = None if setup is None else setup_of(setup)
    if own is None and calibration is not None:
        raise RetinaError("takes a setup", place="argument `calibration`", help="give the setup of the camera")
    fov_deg = _bare(fov_deg, "deg", "fov_deg")
    sun_deg = _bare(sun_deg, "deg", "sun_deg")
    focal_px = _focal_px(own, _bare(focal_mm, "mm", "focal_mm"), _bare(pixel_um, "um", "pixel_um"), fov_deg)
    for name, value, least, most in (
        ("focal_percent", focal_percent, 0.0, 20.0),
        ("sun_deg", sun_deg, -360.0, 360.0),
        ("limb_height_m", limb_height_m, -1e8, 1e8),
        ("limb_height_sigma_m", limb_height_sigma_m, 0.0, 1e8),
    ):
        if value is not None and not least <= value <= most:
            raise RetinaError("is out of range", place=f"argument `{name}`", found=str(value), expected=f"{least:g} to {most:g}")
    known = os.fspath(body) if isinstance(body, (str, os.PathLike)) else np.atleast_1d(_duck.vector(body, "m"))
    answer = _native.fit_limb(
        picture,
        None if own is None else own._native,
        None if own is None else native_calibration(calibration, own),
        focal_px,
        None if fov_deg is None else float(np.radians(fov_deg)),
        None if focal_percent is None else focal_percent / 100.0,
        known,
        None if camera_from_body is None else _duck.vector(camera_from_body),
        limb_height_m,
        limb_height_sigma_m,
        None if sun_deg is None else float(np.radians(sun_deg)),
        None if stars and site is None and position_m is None else _observer(time, site, position_m, ephemeris),
        bits,
        None if silhouette is None else os.fspath(silhouette),
        None if mask is None else np.ascontiguousarray(mask, dtype=bool),
        _native.StarsBeside((ephemeris or Ephemeris())._native, None if time is None else _duck.time_s(time)) if stars else None,
    )
    return LimbSolution(answer)


def _bare(value: Any, unit: str, argument: str) -> float | None:
    return None if value is None else _duck.number(value, unit, argument)


def _focal_px(
    setup: Setup | None, focal_mm: float | None, pixel_um: float | None, fov_deg: float | None
) -> float | None:
    given = [name for name, value in (("setup", setup), ("focal_mm", focal_mm), ("fov_deg", fov_deg)) if value is not None]
    if len(given) > 1:
        raise RetinaError("say the same", place=f"arguments {' and '.join(given)}", help="leave out all but one")
    if (focal_mm is None) != (pixel_um is None):
        missing = "pixel_um" if pixel_um is None else "focal_mm"
        raise RetinaError("is needed as well", place=f"argument `{missing}`", help="a focal length in pixels takes both")
    for name, value, least, most in (("focal_mm", focal_mm, 0.1, 1e5), ("pixel_um", pixel_um, 0.1, 1e3), ("fov_deg", fov_deg, 0.01, 120.0)):
        if value is not None and not least <= value <= most:
            raise RetinaError("is out of range", place=f"argument `{name}`", found=str(value), expected=f"{least:g} to {most:g}")
    if focal_mm is not None and pixel_um is not None:
        return 1e3 * focal_mm / pixel_um
    return None


def _observer(
    time: Time | None, site: Any, position_m: Vector | None, ephemeris: Ephemeris | None
) -> _native.Observer | None:
    if site is None and position_m is None:
        if time is not None:
            raise RetinaError("says nothing without a place", place="argument `time`", help="give site or position_m, or leave time out")
        return None
    if time is None or (site is not None and position_m is not None):
        raise RetinaError("take a time, and one of the two", place="arguments `site` and `position_m`")
    bodies = ephemeris or Ephemeris()
    velocity_m_s = None
    if site is not None:
        latitude_deg, longitude_deg, altitude_m = (
            _duck.number(value, unit, "site") for value, unit in zip(site, ("deg", "deg", "m"), strict=True)
        )
        if abs(latitude_deg) > 90.0 or abs(longitude_deg) > 360.0 or abs(altitude_m) > 1e5:
            raise RetinaError(
                "is no place on the Earth",
                place="argument `site`",
                found=str(site),
                expected="latitude -90 to 90 deg, east longitude -360 to 360 deg, height -100000 to 100000 m",
            )
        position_m, velocity_m_s = bodies.site(
            time, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=altitude_m
        )
    return _native.Observer(bodies._native, _duck.time_s(time), _duck.vector(position_m, "m"), velocity_m_s)
