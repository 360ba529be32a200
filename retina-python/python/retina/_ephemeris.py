"""Where the Sun, the Moon and the planets are, and how they are turned."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _duck, _native
from ._duck import PathLike, Time, Vector
from ._errors import RetinaError


@dataclass(frozen=True)
class SeenBody:
    """A planet or the Moon as an observer sees it.

    Attributes
    ----------
    direction : ndarray, shape (3,)
        Apparent direction of its centre, ICRF unit vector: with light-time, deflection by the Sun and, where the
        observer has a velocity, aberration.
    distance_m, sun_distance_m : float
        Distance that the light came, and from the Sun when it left, m.
    phase_rad, angular_radius_rad : float
        Angle Sun - body - observer, and apparent radius of the equator, rad.
    magnitude : float
        V magnitude of the whole.
    magnitude_extrapolated : bool
        Whether the magnitude lies outside what was observed.
    """

    direction: npt.NDArray[np.float64]
    distance_m: float
    sun_distance_m: float
    phase_rad: float
    angular_radius_rad: float
    magnitude: float
    magnitude_extrapolated: bool


class Ephemeris:
    """Places of bodies: by analytical theories (1900 to 2100), or from SPICE kernels.

    Times are TDB seconds since J2000 (SPICE's et), text, datetimes or ``astropy.time.Time``; see `retina.time_s`.
    Positions are barycentric, ICRF axes.

    Parameters
    ----------
    kernels : path or sequence of paths, optional
        SPICE kernels, such as ``de440s.bsp`` or a meta-kernel. Of those that have a body the last one named counts.

    Raises
    ------
    RetinaError
        A kernel cannot be read; in methods, a body or an epoch that the ephemeris does not have.
    """

    def __init__(self, kernels: PathLike | Sequence[PathLike] = ()) -> None:
        files = [kernels] if isinstance(kernels, (str, os.PathLike)) else list(kernels)
        self._native = _native.Ephemeris([os.fspath(file) for file in files])

    @property
    def name(self) -> str:
        """``analytic``, or the kernels' names."""
        return self._native.name()

    def position_m(self, body: str, time: Any) -> npt.NDArray[np.float64]:
        """Return the geometric position of a body, m, shape (3,); of shape (times, 3) for an array of times.

        Parameters
        ----------
        body : str
            ``"sun"``, ``"moon"``, a planet such as ``"earth"``, or what kernels have, by name or NAIF's number as text
            (a spacecraft: ``"-226"``).
        time : float, str, datetime, astropy.time.Time, or an array of them
            Epochs.
        """
        return _one_or_all(self._native.positions_m(body, _duck.times_s(time)), time)

    def velocity_m_s(self, body: str, time: Any) -> npt.NDArray[np.float64]:
        """Return the velocity of a body, m/s, shaped as `position_m` gives it.

        Without kernels there are velocities of the Sun, the Earth and the Moon.
        """
        return _one_or_all(self._native.velocities_m_s(body, _duck.times_s(time)), time)

    def body_from_inertial(self, body: str, time: Any) -> npt.NDArray[np.float64]:
        """Return the rotation from ICRF to a body's axes: scalar-first quaternions, shape (4,) or (times, 4).

        Kernels turn the bodies that they have (see `axes_source`), the built-in IAU elements the others.
        """
        return _one_or_all(self._native.orientations(body, _duck.times_s(time)), time)

    def frame_from_inertial(self, frame: str, time: Any) -> npt.NDArray[np.float64]:
        """Return the rotation from ICRF to a frame of the kernels: scalar-first quaternions, shape (4,) or (times, 4).

        The frame is a spacecraft's, an instrument's or a body's, by name or NAIF's number as text. CK, frame and clock
        kernels say how it is turned.
        """
        return _one_or_all(self._native.frame_turns(frame, _duck.times_s(time)), time)

    def axes_source(self, body: str) -> str | None:
        """Return the frame or the constants, and their kernels, that turn a body; None for the built-in elements."""
        return self._native.axes_source(body)

    def semi_axes_m(self, body: str) -> tuple[float, float, float] | None:
        """Return a body's semi-axes by text PCK kernels, m along its own axes; None if no kernel has them."""
        axes_m = self._native.semi_axes_m(body)
        return None if axes_m is None else (axes_m[0], axes_m[1], axes_m[2])

    def seen(
        self, body: str, time: Time, position_m: Vector, velocity_m_s: Vector | None = None
    ) -> SeenBody:
        """Return a planet or the Moon as seen from a barycentric position (m) by an observer of this velocity (m/s)."""
        fields = self._native.seen(
            body,
            _duck.time_s(time),
            _duck.vector(position_m, "m"),
            None if velocity_m_s is None else _duck.vector(velocity_m_s, "m/s"),
        )
        fields["direction"] = np.array(fields["direction"])
        return SeenBody(**fields)

    def site(
        self, time: Time, *, latitude_deg: float, longitude_deg: float, altitude_m: float = 0.0
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return barycentric position (m) and velocity (m/s) of a place on the Earth (WGS 84), each of shape (3,).

        A kernel that has the Earth's axes turns it; otherwise precession, nutation and the Earth rotation angle do,
        with UTC in the place of UT1: the place is good to 420 m, and to 100 m since 2017. Before 1972 there is no UTC of
        this kind, and the place is off by kilometres.
        """
        latitude = _duck.number(latitude_deg, "deg", "latitude_deg")
        if abs(latitude) > 90.0:
            raise RetinaError(
                "is out of range", place="argument `latitude_deg`", found=f"{latitude:g}", expected="-90 to 90"
            )
        position_m, velocity_m_s = self._native.site(
            _duck.time_s(time),
            np.radians(latitude),
            np.radians(_duck.number(longitude_deg, "deg", "longitude_deg")),
            _duck.number(altitude_m, "m", "altitude_m"),
        )
        return np.array(position_m), np.array(velocity_m_s)

    def next_new_moon_s(self, after: Time) -> float:
        """Return the first new Moon after an epoch, TDB seconds since J2000."""
        return self._native.next_new_moon_s(_duck.time_s(after))

    def __repr__(self) -> str:
        return f"Ephemeris({self.name!r})"


def _one_or_all(rows: npt.NDArray[np.float64], time: Any) -> npt.NDArray[np.float64]:
    scalar = getattr(time, "isscalar", None)
    if scalar is None:
        scalar = np.ndim(time) == 0
    return rows[0] if scalar else rows
