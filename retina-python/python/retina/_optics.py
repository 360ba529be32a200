"""Lens systems, traced exactly."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from ._duck import PathLike
from ._errors import RetinaError
from ._notebook import Figure, grey_png, shown, table_html

Floats = npt.NDArray[np.float64]


class _Drawn:
    """A result with its drawing."""

    _svg: str

    def plot(self) -> Figure:
        """Draw it."""
        return Figure(self._svg)

    def _repr_svg_(self) -> str:
        return self._svg


@dataclass(frozen=True)
class Rays:
    """Rays on the image surface. A ray that is lost has NaN.

    Attributes
    ----------
    x_mm, y_mm, z_mm : ndarray, shape (rays,)
        Where they land, mm from the first vertex.
    direction : ndarray, shape (rays, 3)
        Unit vectors of their directions.
    path_mm : ndarray, shape (rays,)
        Optical path lengths, mm.
    lost : list of str or None
        Why a ray is lost; None where it arrives.
    """

    x_mm: Floats
    y_mm: Floats
    z_mm: Floats
    direction: Floats
    path_mm: Floats
    lost: list[str | None]


@dataclass(frozen=True)
class Crossings:
    """A ray at every surface.

    Attributes
    ----------
    position_mm, direction : ndarray, shape (surfaces, 3)
        Where it meets the surface, mm from the first vertex, and its direction behind it.
    incidence_rad, path_mm : ndarray, shape (surfaces,)
        Angle of incidence, rad, and optical path length so far, mm.
    """

    position_mm: Floats
    direction: Floats
    incidence_rad: Floats
    path_mm: Floats


@dataclass(frozen=True)
class Spots(_Drawn):
    """Spots of a system's fields.

    Attributes
    ----------
    field, centroid_mm : ndarray, shape (fields, 2)
        Fields (tangents, or mm of a finite object) and centroids, mm.
    rms_um, largest_um, vignetted_fraction : ndarray, shape (fields,)
        Sizes about the polychromatic centroid, um, and the share of the beam that apertures stop.
    airy_radius_um : float or None
        Radius of the Airy disc, um.
    points_mm : list of list of ndarray, shape (rays, 2)
        Where rays land, mm, by field and wavelength.
    """

    field: Floats
    centroid_mm: Floats
    rms_um: Floats
    largest_um: Floats
    vignetted_fraction: Floats
    airy_radius_um: float | None
    points_mm: list[list[Floats]]
    _svg: str


@dataclass(frozen=True)
class Psf(_Drawn):
    """Polychromatic point spread functions of a system's fields.

    Attributes
    ----------
    field : ndarray, shape (fields, 2)
        Fields: tangents, or mm of a finite object.
    values : ndarray, shape (fields, side, side)
        Irradiance; the diffraction limit's peak is 1.
    pitch_um : tuple of float
        Pitch of the grid along x and y, um.
    energy_on_grid : ndarray, shape (fields,)
        Share of the light that is on the grid.
    """

    field: Floats
    values: Floats
    pitch_um: tuple[float, float]
    energy_on_grid: Floats
    _svg: str

    def _repr_png_(self) -> bytes:
        # The square root shows the wings.
        strip = np.sqrt(np.clip(np.concatenate(list(self.values), axis=1), 0.0, None))
        return grey_png(strip, float(strip.max()))


@dataclass(frozen=True)
class Mtf(_Drawn):
    """Polychromatic modulation transfer of a system's fields.

    Attributes
    ----------
    field : ndarray, shape (fields, 2)
        Fields: tangents, or mm of a finite object.
    frequency_per_mm : ndarray, shape (frequencies,)
        Spatial frequencies, cycles/mm.
    x, y : ndarray, shape (fields, frequencies)
        Contrast of patterns that vary along x, and along y.
    diffraction_limit : ndarray, shape (fields, frequencies)
        The same without aberration, along x.
    """

    field: Floats
    frequency_per_mm: Floats
    x: Floats
    y: Floats
    diffraction_limit: Floats
    _svg: str


class OpticalSystem:
    """A lens system: surfaces, media, apertures, fields, wavelengths.

    Light travels along +z; x is right, y is down; lengths are mm.

    Parameters
    ----------
    source : path or str
        A prescription (.toml, or a sequential Zemax .zmx), or the name of a design that ships; see `shipped`.
    agf : sequence of paths
        Glass catalogues besides the embedded glasses.
    clear_fraction : float, optional
        Part of each clear semi-diameter that light may use. Default: the file's.
    unclipped : bool
        Let no aperture stop a ray.

    Attributes
    ----------
    name : str
        Its name.
    fields : ndarray, shape (fields, 2)
        Fields: tangents, or mm of a finite object.
    wavelengths_nm : ndarray, shape (wavelengths,)
        Wavelengths, nm.
    primary_nm : float
        The wavelength of first-order figures, nm.
    surfaces : list of str
        Labels of the surfaces; the last one is the image.

    Raises
    ------
    RetinaError
        The file does not fit; in methods, rays that the system has not.
    """

    name: str
    fields: Floats
    wavelengths_nm: Floats
    primary_nm: float
    clear_fraction: float
    infinite_object: bool
    surfaces: list[str]

    def __init__(
        self,
        source: PathLike,
        *,
        agf: Sequence[PathLike] = (),
        clear_fraction: float | None = None,
        unclipped: bool = False,
    ) -> None:
        files = [os.fspath(file) for file in agf]
        self._native = _native.OpticalSystem.read(os.fspath(source), files, clear_fraction, unclipped)
        self.__dict__.update(self._native.fields())

    @staticmethod
    def shipped() -> list[str]:
        """Return the names of the designs that ship."""
        return _native.OpticalSystem.shipped()

    def first_order(self) -> dict[str, Any]:
        """Return focal lengths, pupils and principal planes at the primary wavelength, mm."""
        return self._native.first_order()

    def trace(
        self, field: npt.ArrayLike = (0.0, 0.0), pupil: npt.ArrayLike = (0.0, 0.0), wavelength_nm: float | None = None
    ) -> Rays:
        """Trace rays to the image surface.

        Parameters
        ----------
        field : array_like, shape (2,) or (rays, 2)
            Fields: tangents x, y, or mm of a finite object.
        pupil : array_like, shape (2,) or (rays, 2)
            Points on the unit disc.
        wavelength_nm : float, optional
            Default: the primary wavelength.

        Returns
        -------
        Rays
        """
        fields, pupils = np.broadcast_arrays(
            np.atleast_2d(np.asarray(field, dtype=float)), np.atleast_2d(np.asarray(pupil, dtype=float))
        )
        found = self._native.trace(np.ascontiguousarray(fields), np.ascontiguousarray(pupils), wavelength_nm)
        direction = np.column_stack([found.pop(name) for name in ("l", "m", "n")])
        return Rays(direction=direction, **found)

    def trace_ray(
        self,
        field: tuple[float, float] = (0.0, 0.0),
        pupil: tuple[float, float] = (0.0, 0.0),
        wavelength_nm: float | None = None,
    ) -> Crossings:
        """Trace one ray through all surfaces."""
        if len(field) != 2 or len(pupil) != 2:
            raise RetinaError("is no pair", place="arguments `field` and `pupil`", expected="two numbers each")
        at, through = (float(field[0]), float(field[1])), (float(pupil[0]), float(pupil[1]))
        return Crossings(**self._native.trace_ray(at, through, wavelength_nm))

    def spots(self, *, rings: int = 24, arms: int = 48) -> Spots:
        """Compute spot diagrams by Gaussian quadrature of the pupil: 1 to 200 rings, 3 to 1000 arms."""
        found = self._native.spots(rings, arms)
        return Spots(_svg=found.pop("svg"), **found)

    def psf(self, *, pupil: int | None = None, pixels: int | None = None, pitch_um: float | None = None) -> Psf:
        """Compute polychromatic point spread functions.

        Parameters
        ----------
        pupil : int, optional
            Pupil points a side, 8 to 1024. Default: enough to keep repetitions apart.
        pixels : int, optional
            Pixels a side, 8 to 1024. Default: with the pitch, enough for 99 % of the light.
        pitch_um : float, optional
            Pixel pitch, um.
        """
        found = self._native.psf(pupil, pixels, pitch_um)
        return Psf(
            field=np.array(found["field"], dtype=float),
            values=np.stack(found["values"]),
            pitch_um=found["pitch_um"],
            energy_on_grid=np.array(found["energy_on_grid"], dtype=float),
            _svg=found["svg"],
        )

    def mtf(self, *, pupil: int = 128, highest_per_mm: float = 100.0, count: int = 100) -> Mtf:
        """Compute the modulation transfer at `count` + 1 frequencies up to `highest_per_mm`, cycles/mm."""
        found = self._native.mtf(pupil, float(highest_per_mm), count)
        return Mtf(_svg=found.pop("svg"), **found)

    def layout(self) -> Figure:
        """Draw the layout."""
        return Figure(self._native.layout_svg())

    def _repr_svg_(self) -> str:
        return self._native.layout_svg()

    def _repr_html_(self) -> str:
        rows = ((name, shown(value)) for name, value in self.first_order().items())
        return table_html(self.name, ("", ""), rows)

    def __repr__(self) -> str:
        return f"<OpticalSystem {self.name!r}, {len(self.surfaces)} surfaces>"
