"""Calibration of a facility: where it shows a line of sight, and how bright."""

from __future__ import annotations

import os
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from . import _duck, _native
from ._duck import PathLike, is_path
from ._errors import RetinaError
from ._notebook import Figure, Report, shown, table_html
from ._setup import Setup, setup_of


class Calibration:
    """A calibration of a setup: distortion, its inverse, response.

    Parameters
    ----------
    path : path
        A ``calibration.toml``, or a model that `Fit.write_model` wrote.
    setup : Setup, path or str
        The setup that it is of; another's is refused.
    """

    def __init__(self, path: PathLike, setup: Setup | PathLike) -> None:
        self._native = _native.Calibration.read(os.fspath(path), setup_of(setup)._native)

    @classmethod
    def _of(cls, native: _native.Calibration) -> Calibration:
        out = cls.__new__(cls)
        out._native = native
        return out

    def to_toml(self) -> str:
        """Return it as the text of its file."""
        return self._native.text()

    def write(self, path: PathLike) -> None:
        """Write it."""
        self._native.write(os.fspath(path))


class GeometryCalibration(Report):
    """What `calibrate_geometry` gave. ``to_dict()`` has every coefficient."""

    def __init__(self, native: _native.GeometryFit) -> None:
        super().__init__(native.document())
        self._native = native

    @property
    def rms_arcsec(self) -> float:
        """Root mean square of the errors (great circle), arcsec."""
        return float(self._document["rms_arcsec"])

    @property
    def heldout_rms_arcsec(self) -> float:
        """The same of exposures that the fit has not seen."""
        return float(self._document["heldout"]["rms_arcsec"])

    @property
    def fraction_within_10_arcsec(self) -> float:
        """Share of the points within 10 arcsec."""
        return float(self._document["fraction_within_10_arcsec"])

    @property
    def percentiles_arcsec(self) -> dict[str, float]:
        """Errors at 50, 68, 90, 95, 96 and 99 per cent, arcsec."""
        return dict(self._document["percentiles_arcsec"])

    @property
    def coefficients(self) -> dict[str, npt.NDArray[np.float64]]:
        """Terms of D^-1: powers ``i``, ``j`` of x, y and ``k`` of the irradiance, ``a``, ``b`` and ``sigma``."""
        rows = self._document["coefficients"]
        return {name: np.array([row[name] for row in rows], dtype=float) for name in ("i", "j", "k", "a", "b", "sigma")}

    @property
    def covariance(self) -> npt.NDArray[np.float64]:
        """Covariance of the coefficients of one axis, shape (terms, terms)."""
        return np.array(self._document["covariance"], dtype=float)

    @property
    def points(self) -> dict[str, npt.NDArray[Any]]:
        """The fitted points: ``row`` of the table, ``sight_x``, ``sight_y``, ``log10_irradiance``, ``error_arcsec``,
        ``heldout_arcsec``, ``outlier``."""
        return self._native.points()

    @property
    def outliers(self) -> int:
        """Number of outliers."""
        return int(self._document["outliers"])

    @property
    def warnings(self) -> list[str]:
        """What the user ought to know."""
        return self._texts("warnings")

    @property
    def calibration(self) -> Calibration:
        """The calibration, for whoever takes one."""
        return Calibration._of(self._native.calibration())

    def write(self, path: PathLike) -> None:
        """Write it as ``calibration.toml``. The response of a file that is there is kept."""
        self._native.write(os.fspath(path))

    def write_report(self, path: PathLike) -> None:
        """Write a page with plots, which opens offline."""
        self._native.write_report(os.fspath(path))

    def plots(self) -> dict[str, Figure]:
        """Draw errors over magnitude, their density and distribution, and residuals over the field."""
        return {name: Figure(svg) for name, svg in self._native.figures().items()}

    def __str__(self) -> str:
        return self._native.text()

    def __repr__(self) -> str:
        return f"<GeometryCalibration: {self.rms_arcsec:.2f} arcsec rms, {self.heldout_rms_arcsec:.2f} held out>"

    def _repr_html_(self) -> str:
        names = ("rms_arcsec", "heldout_rms_arcsec", "fraction_within_10_arcsec", "outliers")
        return table_html("geometric calibration", ("", ""), ((name, shown(getattr(self, name))) for name in names))


class RadiometryCalibration(Report):
    """What `calibrate_radiometry` gave. ``to_dict()`` has every channel's knots and covariance."""

    def __init__(self, native: _native.RadiometryFit) -> None:
        super().__init__(native.document())
        self._native = native

    @property
    def magnitude_range(self) -> tuple[float, float]:
        """Brightest and faintest magnitude of one pixel."""
        brightest, faintest = self._document["magnitude_range"]
        return brightest, faintest

    @property
    def rms_relative(self) -> float:
        """Root mean square of the relative errors."""
        return float(self._document["rms_relative"])

    @property
    def monotone(self) -> bool:
        """Whether every channel rises with its digital count."""
        return bool(self._document["monotone"])

    def response(self, channel: str) -> dict[str, npt.NDArray[np.float64]]:
        """Return a channel's response (``"r"``, ``"g"`` or ``"b"``).

        Returns
        -------
        dict
            ``digital_count`` (0 to 255), ``irradiance_w_m2`` of one pixel at the pupil, ``sigma_w_m2``.
        """
        channels = self._document["channels"]
        if channel not in channels:
            raise RetinaError("is no channel", place="argument `channel`", found=channel, expected=", ".join(channels))
        return {name: np.array(values, dtype=float) for name, values in channels[channel]["response"].items()}

    @property
    def calibration(self) -> Calibration:
        """The calibration, for whoever takes one."""
        return Calibration._of(self._native.calibration())

    def write(self, path: PathLike) -> None:
        """Write it as ``calibration.toml``. The other tables of a file that is there are kept."""
        self._native.write(os.fspath(path))

    def plots(self) -> dict[str, Figure]:
        """Draw the response and its magnitudes."""
        response, magnitude = self._native.figures()
        return {"response": Figure(response), "magnitude": Figure(magnitude)}

    def __str__(self) -> str:
        return "\n".join(self._native.text())

    def __repr__(self) -> str:
        brightest, faintest = self.magnitude_range
        return f"<RadiometryCalibration: magnitudes {brightest:.3f} to {faintest:.3f}>"

    def _repr_html_(self) -> str:
        names = ("magnitude_range", "rms_relative", "monotone")
        return table_html("radiometric calibration", ("", ""), ((name, shown(getattr(self, name))) for name in names))


#: A calibration: its file, itself, or the result that has it.
Calibrations: TypeAlias = PathLike | Calibration | GeometryCalibration | RadiometryCalibration


def native_calibration(value: Calibrations | None, setup: Setup) -> _native.Calibration | None:
    """A calibration as the native module takes it."""
    if value is None:
        return None
    if is_path(value):
        return _native.Calibration.read(os.fspath(value), setup._native)  # type: ignore[arg-type]
    calibration = getattr(value, "calibration", value)
    if not isinstance(calibration, Calibration):
        raise RetinaError(
            "is no calibration",
            place="argument `calibration`",
            found=f"an object of type {type(value).__name__}",
            expected="a file, a Calibration, or the result of a calibration",
        )
    return calibration._native


def calibrate_geometry(
    table: Any,
    setup: Setup | PathLike,
    *,
    response: Calibrations | None = None,
    plain: bool = False,
    reference_log10_irradiance: float | None = None,
) -> GeometryCalibration:
    """Calibrate the mapping between lines of sight and the screen, from displayed points and their centroids.

    Parameters
    ----------
    table : table, path or sequence of paths
        ``points.csv``, or columns: ``image``, ``screen_x_px``, ``screen_y_px``, ``digital_count``, ``camera_x_px``,
        ``camera_y_px`` and more.
    setup : Setup, path or str
        The facility.
    response : optional
        A calibration with the display's measured response. Default: the setup's power law.
    plain : bool
        Fit a plain polynomial, without terms in the irradiance.
    reference_log10_irradiance : float, optional
        Irradiance at which D is given: log10, relative to a white pixel at full count. Default: the points' median.

    Returns
    -------
    GeometryCalibration

    Raises
    ------
    RetinaError
        The table does not fit, or does not determine a fit.
    """
    own = setup_of(setup)
    return GeometryCalibration(
        _native.calibrate_geometry(
            _duck.table(table), own._native, plain, reference_log10_irradiance, native_calibration(response, own)
        )
    )


def calibrate_radiometry(
    table: Any, setup: Setup | PathLike, *, for_setup: Setup | PathLike | None = None
) -> RadiometryCalibration:
    """Calibrate the display's response, from readings of a power meter.

    Parameters
    ----------
    table : table, path or sequence of paths
        ``power.csv``, or columns: ``channel``, ``digital_count``, ``square_px``, ``irradiance_w_m2`` and more.
    setup : Setup, path or str
        The facility that was measured.
    for_setup : Setup, path or str, optional
        Scale the response to another magnification of the same display.

    Returns
    -------
    RadiometryCalibration

    Raises
    ------
    RetinaError
        The table does not fit, or no rising response explains it.
    """
    other = None if for_setup is None else setup_of(for_setup)._native
    return RadiometryCalibration(_native.calibrate_radiometry(_duck.table(table), setup_of(setup)._native, other))
