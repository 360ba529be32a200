"""Facility configurations."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from ._duck import PathLike, is_path
from ._errors import RetinaError, RetinaWarning
from ._notebook import shown, table_html


@dataclass(frozen=True)
class Pinhole:
    """An ideal camera: lines of sight (x, y, 1) to pixels and back.

    Pixels have x to the right and y down. Pixel (0, 0) covers [0, 1) x [0, 1), and its centre is (0.5, 0.5).

    Attributes
    ----------
    fx_px, fy_px : float
        Focal lengths, px.
    cx_px, cy_px : float
        Principal point, px.
    width_px, height_px : int
        Size of the image, px.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: int
    height_px: int

    @property
    def matrix(self) -> npt.NDArray[np.float64]:
        """The matrix K, shape (3, 3)."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    def pixel(self, line_of_sight: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Pixels of lines of sight (x, y), tangents; shape (..., 2) in and out."""
        return np.asarray(line_of_sight, dtype=float) * (self.fx_px, self.fy_px) + (self.cx_px, self.cy_px)

    def line_of_sight(self, pixel: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Lines of sight (x, y), tangents, of pixels; shape (..., 2) in and out."""
        return (np.asarray(pixel, dtype=float) - (self.cx_px, self.cy_px)) / (self.fx_px, self.fy_px)


class Setup:
    """A facility configuration: screen, camera, and how the one shows on the other.

    Parameters
    ----------
    source : path or str
        A file of schema ``retina.setup/1``, or the name of a setup that ships: ``"wide-fov"`` or ``"narrow-fov"``.

    Attributes
    ----------
    name : str
        Its name.
    file : str
        The file it was read from, or the name of the one that ships.
    screen_size_px, camera_size_px : tuple of int
        Width and height, px.
    screen_size_mm : tuple of float
        Width and height of the screen's active area, mm.
    wavelength_nm : tuple of float
        Effective wavelengths of red, green and blue, nm.
    pixel_um, focal_mm, f_number, bits : float, float, float, int
        The camera's pixel pitch, focal length, f-number, and bits of a digital number.
    facility_pinhole : Pinhole
        K_f: lines of sight to screen pixels (paper, eqs. 11 to 13).
    camera_pinhole : Pinhole
        C: lines of sight to camera pixels, without distortion.
    response_gamma : float
        Exponent of the display's response.
    brightest_magnitude : float
        Magnitude of one pixel at digital count 255.
    calibration_file : str or None
        The calibration that the setup names.

    Raises
    ------
    RetinaError
        The file cannot be read, holds an unknown key, or a value out of range.
    """

    name: str
    file: str
    screen_size_px: tuple[int, int]
    screen_size_mm: tuple[float, float]
    wavelength_nm: tuple[float, float, float]
    camera_size_px: tuple[int, int]
    pixel_um: float
    focal_mm: float
    f_number: float
    bits: int
    facility_pinhole: Pinhole
    camera_pinhole: Pinhole
    response_gamma: float
    brightest_magnitude: float
    calibration_file: str | None

    def __init__(self, source: PathLike) -> None:
        shipped = _native.Setup.shipped(source) if isinstance(source, str) else None
        self._take(shipped or _native.Setup.read(os.fspath(source)))
        if self.calibration_file is not None and not Path(self.calibration_file).exists():
            warnings.warn(
                f"{self.file}: key `calibration.file` names {self.calibration_file}, which is not there "
                "(paths are relative to the setup)",
                RetinaWarning,
                stacklevel=2,
            )

    @classmethod
    def parse(cls, text: str, name: PathLike = "setup.toml") -> Setup:
        """Read a setup from text; `name` names it in errors, and paths in it are relative to `name`."""
        setup = cls.__new__(cls)
        setup._take(_native.Setup.parse(text, os.fspath(name)))
        return setup

    def _take(self, native: _native.Setup) -> None:
        self._native = native
        fields: dict[str, Any] = native.fields()
        for name in ("facility_pinhole", "camera_pinhole"):
            fields[name] = Pinhole(*fields[name])
        self.__dict__.update(fields)

    def __repr__(self) -> str:
        return f"Setup({self.name!r})"

    def _repr_html_(self) -> str:
        names = (
            "screen_size_px",
            "camera_size_px",
            "pixel_um",
            "focal_mm",
            "f_number",
            "bits",
            "brightest_magnitude",
            "calibration_file",
        )
        return table_html(f"setup {self.name}", ("", ""), ((name, shown(getattr(self, name))) for name in names))


def setup_of(value: Setup | PathLike) -> Setup:
    """A setup, or the one of a file or name."""
    if isinstance(value, Setup):
        return value
    if is_path(value):
        return Setup(value)
    raise RetinaError(
        "is no setup",
        place="argument `setup`",
        found=f"an object of type {type(value).__name__}",
        expected="a Setup, its file, or the name of one that ships",
    )
