"""The virtual bench, and measurement campaigns on it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _duck, _native
from ._duck import PathLike
from ._errors import RetinaError
from ._frames import Frame
from ._notebook import Progress, callback, grey_png
from ._setup import Setup, setup_of

Channel = Literal["r", "g", "b", "w"]


class CameraImage:
    """What the camera returns.

    Attributes
    ----------
    dn : ndarray of uint16, shape (height, width)
        Digital numbers.
    exposure_s : float
        Exposure time, s.
    full_scale_dn : int
        Largest digital number.
    """

    def __init__(self, dn: npt.NDArray[np.uint16], exposure_s: float, full_scale_dn: int) -> None:
        self.dn = dn
        self.exposure_s = exposure_s
        self.full_scale_dn = full_scale_dn

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> npt.NDArray[Any]:
        return np.array(self.dn, dtype=dtype) if copy or dtype is not None else self.dn

    def _repr_png_(self) -> bytes:
        return grey_png(self.dn, self.full_scale_dn)

    def __repr__(self) -> str:
        height, width = self.dn.shape
        return f"<CameraImage, {width} x {height} px, {self.exposure_s:.3g} s>"


class Bench:
    """The virtual bench: screen image in, camera image out, by traced optics and a sensor's physics.

    Parameters
    ----------
    setup : Setup, path or str
        The facility.
    effects : sequence of str
        What is wrong with it, such as ``"screen_tilt=0.1deg"``; `bench_effects` lists them.
    seed : int
        Seed of its fixed patterns and its noise.
    nodes : (int, int), optional
        How finely its optics are tabulated, along x and y. Default: 19, 13; 7, 5 is coarse and quick.
    lines : {1, 3, 5}, optional
        Lines that stand for a channel's spectrum. Default: 3.

    Raises
    ------
    RetinaError
        The optics cannot be traced, or an effect does not fit.
    """

    def __init__(
        self,
        setup: Setup | PathLike,
        *,
        effects: Sequence[str] = (),
        seed: int = 1,
        nodes: tuple[int, int] | None = None,
        lines: int | None = None,
    ) -> None:
        self.setup = setup_of(setup)
        self._native = _native.Bench(self.setup._native, list(effects), seed, nodes, lines)
        self.full_scale_dn, self.full_well_e = self._native.sensor()

    def expose(
        self,
        screen: Any,
        exposure_s: float | None = None,
        *,
        temperature_c: float = 20.0,
        frame: int = 0,
        shift_px: tuple[float, float] = (0.0, 0.0),
        roll_rad: float = 0.0,
    ) -> CameraImage:
        """Photograph a screen image.

        Parameters
        ----------
        screen : Frame, or array_like of uint8 of shape (height, width) or (height, width, 3)
            Digital counts.
        exposure_s : float, optional
            Exposure time, s. Default: the brightest pixel fills 60 % of the full well.
        temperature_c : float
            Temperature of the bench, degC.
        frame : int
            Number of the exposure: two of one number have the same noise.
        shift_px : (float, float)
            How the camera's mount has moved the image, camera px.
        roll_rad : float
            How it has rolled, rad.

        Returns
        -------
        CameraImage

        Raises
        ------
        RetinaError
            The image has another size than the screen, or is dark and has no exposure time.
        """
        counts = np.asarray(screen.counts if isinstance(screen, Frame) else screen)
        if counts.dtype != np.uint8:
            raise RetinaError(
                "is no screen image", place="argument `screen`", found=f"values of type {counts.dtype}", expected="uint8"
            )
        width, height = self.setup.screen_size_px
        if counts.shape[:2] != (height, width):
            raise RetinaError(
                "has another size than the screen",
                place="argument `screen`",
                found=f"shape {counts.shape}",
                expected=f"({height}, {width})",
            )
        seconds = None if exposure_s is None else _duck.number(exposure_s, "s", "exposure_s")
        temperature = _duck.number(temperature_c, "deg_C", "temperature_c")
        if not -273.15 < temperature < 200.0:
            raise RetinaError(
                "is out of range", place="argument `temperature_c`", found=f"{temperature:g}", expected="-273 to 200 degC"
            )
        shift_x, shift_y = (_duck.number(value, "pix", "shift_px") for value in shift_px)
        roll = _duck.number(roll_rad, "rad", "roll_rad")
        dn, used_s = self._native.expose(counts, seconds, temperature, frame, (shift_x, shift_y), roll)
        return CameraImage(dn, used_s, self.full_scale_dn)

    def land_px(self, screen_px: tuple[float, float], channel: Channel = "g") -> tuple[float, float] | None:
        """Return where a screen position (px) lands on the sensor (px), without noise; None off the field."""
        return self._native.land_px(float(screen_px[0]), float(screen_px[1]), channel)

    def __repr__(self) -> str:
        return f"<Bench of {self.setup.name}>"


def simulate_points(
    setup: Setup | PathLike,
    *,
    seed: int = 1,
    effects: Sequence[str] = (),
    exposures: int = 40,
    points: int = 50,
    interval_s: float = 60.0,
    temperature: Literal["constant", "warm-up", "cycle"] = "warm-up",
    exposure_s: float | None = None,
    channel: Channel = "w",
    counts: Sequence[int] = (),
    nodes: tuple[int, int] | None = None,
    lines: int | None = None,
    progress: Progress = True,
) -> dict[str, Any]:
    """Show patterns of single pixels on the bench and measure their points.

    Parameters
    ----------
    setup, effects, seed, nodes, lines
        As `Bench` takes them.
    exposures, points : int
        Number of exposures (to 999), and of points in each (to 5000).
    interval_s : float
        Time between exposures, s.
    temperature : {"constant", "warm-up", "cycle"}
        Temperature of the bench over the campaign: 20 degC; from 20 to 24 degC; 18 to 22 degC.
    exposure_s : float, optional
        Exposure time of the faintest group of counts, s. Default: peaks at 60 % of the full well.
    channel : {"r", "g", "b", "w"}
        Sub-pixels to light.
    counts : sequence of int
        Digital counts. Default: every 0.75 mag from 255 to 5.
    progress : bool or callable
        True: tqdm's bar where it is installed. A callable is told the exposures done and their number.

    Returns
    -------
    dict of str to ndarray or list
        The columns of ``points.csv``.
    """
    return _native.simulate_points_table(
        setup_of(setup)._native,
        seed,
        list(effects),
        exposures,
        points,
        interval_s,
        temperature,
        exposure_s,
        channel,
        _counts(counts),
        nodes,
        lines,
        callback(progress, "exposures"),
    )


def simulate_power(
    setup: Setup | PathLike,
    *,
    seed: int = 1,
    effects: Sequence[str] = (),
    series: int = 10,
    counts: Sequence[int] = (),
    squares_px: Sequence[int] | None = None,
) -> dict[str, Any]:
    """Read a power meter in front of lit squares on the bench.

    Parameters
    ----------
    setup, effects, seed
        As `Bench` takes them.
    series : int
        Number of times that the whole set is measured (to 1000).
    counts : sequence of int
        Digital counts. Default: 4, 8, 12, every 16 from 16 to 240, and 255.
    squares_px : sequence of int, optional
        Sides of the lit squares, px; 0 is a dark reading. Default: 0, 50, 100, 200, 600.

    Returns
    -------
    dict of str to ndarray or list
        The columns of ``power.csv``.
    """
    squares = None if squares_px is None else [int(square) for square in squares_px]
    return _native.simulate_power_table(setup_of(setup)._native, seed, list(effects), series, _counts(counts), squares)


def _counts(counts: Sequence[int]) -> list[int]:
    wrong = [count for count in counts if not 1 <= count <= 255]
    if wrong:
        raise RetinaError("is out of range", place="argument `counts`", found=str(wrong[0]), expected="1 to 255")
    return [int(count) for count in counts]


def bench_effects() -> dict[str, dict[str, Any]]:
    """List the effects that the bench takes, by id: ``table``, ``unit``, ``values``, ``meaning``."""
    return {
        name: {"table": table, "unit": unit, "values": values, "meaning": meaning}
        for name, table, unit, values, meaning in _native.bench_effects()
    }


def read_table(path: PathLike) -> dict[str, Any]:
    """Read a CSV table as columns: arrays of numbers (NaN where a cell is empty), lists of texts."""
    return _native.read_columns(os.fspath(path))


def write_table(table: Any, path: PathLike, setup: Setup | PathLike) -> None:
    """Write a table of points or power readings as CSV, with the setup's name in a comment.

    Raises
    ------
    RetinaError
        The table does not fit its schema or the setup.
    """
    _native.write_table(_duck.table(table), os.fspath(path), setup_of(setup)._native)
