"""Times, units, directions and tables of other packages, by what they can do and not by what they are.

Nothing here imports astropy, pandas, polars or xarray.
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from . import _native
from ._errors import RetinaError

PathLike: TypeAlias = str | os.PathLike[str]
#: Seconds since J2000 (TDB, which is SPICE's et), an epoch as text, a datetime, or an ``astropy.time.Time``.
Time: TypeAlias = float | str | datetime.datetime | np.datetime64 | Any
#: An array, a sequence, or a quantity with a unit.
Vector: TypeAlias = npt.ArrayLike | Any

_J2000_JD = 2451545.0
_DAY_S = 86400.0


def time_s(time: Time) -> float:
    """TDB seconds since J2000 of one epoch. SPICE's ``et`` is the same number.

    Parameters
    ----------
    time : float, str, datetime, numpy.datetime64 or astropy.time.Time
        A number is TDB seconds since J2000 already. Text is ISO 8601 with ``Z``, ``UTC`` or ``TDB`` (TDB without a
        suffix). A datetime is UTC: one without a time zone, and a datetime64, is taken as UTC.

    Returns
    -------
    float
        TDB seconds since J2000.

    Raises
    ------
    RetinaError
        The text is no epoch.
    """
    values = times_s(time)
    if values.size != 1:
        raise RetinaError("one epoch is needed", place="argument `time`", found=f"{values.size}", expected="1")
    if not np.isfinite(values[0]):
        raise RetinaError("is no epoch", place="argument `time`", found=str(values[0]), expected="a finite number")
    return float(values[0])


def times_s(times: Any) -> npt.NDArray[np.float64]:
    """As `time_s`, for one epoch or an array of them; shape (times,)."""
    tdb = getattr(times, "tdb", None)
    if tdb is not None:
        # Two parts, so that no digit is lost: a Julian date in one double resolves 40 microseconds.
        days = np.asarray(tdb.jd1, dtype=float) - _J2000_JD
        return np.atleast_1d(days * _DAY_S + np.asarray(tdb.jd2, dtype=float) * _DAY_S).ravel()
    if isinstance(times, str):
        return np.array([_native.parse_time(times)])
    if isinstance(times, datetime.datetime):
        moment = times if times.tzinfo is None else times.astimezone(datetime.timezone.utc)
        return np.array([_native.parse_time(moment.replace(tzinfo=None).isoformat() + "Z")])
    array = np.asarray(times)
    if array.dtype.kind == "M":
        texts = np.datetime_as_string(np.atleast_1d(array).astype("datetime64[ns]"))
        return np.array([_native.parse_time(f"{text}Z") for text in texts.ravel()])
    if array.ndim == 0 and array.dtype.kind not in "iufU":
        raise RetinaError(
            "is no epoch",
            place="argument `time`",
            found=repr(times),
            expected="TDB seconds since J2000, ISO text, a datetime, numpy.datetime64 or astropy.time.Time",
        )
    if array.dtype.kind in "OU":
        return np.concatenate([times_s(item) for item in array.ravel()]) if array.size else np.empty(0)
    return np.atleast_1d(np.asarray(magnitude(times, "s"), dtype=float)).ravel()


def magnitude(value: Any, unit: str) -> Any:
    """The number of a quantity in a unit; a bare number is in that unit already."""
    convert = getattr(value, "to_value", None)
    if convert is None:
        return value
    try:
        return convert(unit)
    except Exception as error:
        raise RetinaError(
            "the quantity cannot be converted", found=str(getattr(value, "unit", value)), expected=unit
        ) from error


def numbers(value: Any, unit: str, argument: str) -> npt.NDArray[np.float64]:
    """Numbers in a unit, shape (numbers,); text is none."""
    found = np.atleast_1d(np.asarray(magnitude(value, unit)))
    if found.dtype.kind not in "uif":
        raise RetinaError("is not a number", place=f"argument `{argument}`", found=repr(value), expected=unit)
    return found.astype(np.float64).ravel()


def number(value: Any, unit: str, argument: str) -> float:
    """One finite number in a unit."""
    found = numbers(value, unit, argument)
    if found.size != 1 or not np.isfinite(found[0]):
        raise RetinaError("is not one finite number", place=f"argument `{argument}`", found=repr(value), expected=unit)
    return float(found[0])


def vector(value: Vector, unit: str = "") -> npt.NDArray[np.float64]:
    """A contiguous array of doubles; quantities are converted to the unit."""
    cartesian = getattr(value, "cartesian", None)
    if cartesian is not None and hasattr(cartesian, "xyz"):
        # SkyCoord and its like; a direction without a distance has no unit.
        value = cartesian.xyz
        unit = unit if getattr(getattr(value, "unit", None), "physical_type", None) == "length" else ""
    if unit:
        value = magnitude(value, unit)
    elif hasattr(value, "to_value"):
        value = value.to_value()
    return np.ascontiguousarray(value, dtype=np.float64)


def image(value: Any) -> npt.NDArray[Any]:
    """A 2-d array of a type that the native module takes, without a copy where there is one already.

    xarray's DataArray and astropy's CCDData come as the arrays that they hold.
    """
    if np.ma.is_masked(value):
        raise RetinaError(
            "has masked pixels",
            place="argument `image`",
            found=f"{int(np.ma.getmaskarray(value).sum())} of them",
            expected="an array without a mask",
            help="fill them (image.filled(...)); solve_stars takes their inverse as `mask`",
        )
    array = np.asarray(magnitude(value, str(value.unit)) if hasattr(value, "to_value") else value)
    if array.ndim != 2:
        raise RetinaError(
            "is not a grey image",
            place="argument `image`",
            found=f"an array of shape {array.shape}",
            expected="shape (height, width)",
            help="give the camera's grey values, or one channel of a colour image",
        )
    if array.dtype in (np.uint8, np.uint16, np.float32, np.float64) and array.dtype.isnative:
        return array
    if array.dtype.kind not in "uif":
        raise RetinaError(
            "is not an image of numbers",
            place="argument `image`",
            found=f"values of type {array.dtype}",
            expected="uint8, uint16, float32 or float64",
        )
    if array.dtype.kind in "ui" and array.size and 0 <= array.min() and array.max() <= 0xFFFF:
        return array.astype(np.uint16)
    return array.astype(np.float64)


def is_path(value: Any) -> bool:
    """Whether a value names a file."""
    return isinstance(value, (str, os.PathLike))


#: A unit that ends a column's name, and how astropy calls it.
_UNITS = {"_px": "pix", "_s": "s", "_m": "m", "_mm": "mm", "_deg": "deg", "_w_m2": "W / m2", "_mag": "mag"}


def table(value: Any) -> list[str] | list[tuple[str, Any]]:
    """A table as the native module takes it: paths, or columns by name.

    Parameters
    ----------
    value : path, sequence of paths, mapping, structured array, or anything with columns
        Columns are looked for as in pandas and polars (``columns``), astropy (``colnames``), pyarrow
        (``column_names``) and xarray (``data_vars``).
    """
    if is_path(value):
        return [os.fspath(value)]
    if isinstance(value, Sequence) and value and all(is_path(item) for item in value):
        return [os.fspath(item) for item in value]
    return columns(value)


def columns(value: Any) -> list[tuple[str, Any]]:
    """The columns of anything that has them, by name: arrays of doubles, or lists of texts."""
    return [(name, _column(name, value[name])) for name in _names(value)]


def _names(value: Any) -> list[str]:
    names = [str(name) for name in _named(value)]
    if not names:
        raise RetinaError("has no columns", place="argument `table`", expected="columns by name")
    return names


def _named(value: Any) -> Any:
    if isinstance(value, Mapping) and not hasattr(value, "data_vars"):
        return value.keys()
    if isinstance(value, np.ndarray) and value.dtype.names is not None:
        return value.dtype.names
    for attribute in ("colnames", "column_names", "columns", "data_vars"):
        if hasattr(value, attribute):
            return getattr(value, attribute)
    raise RetinaError(
        "is no table",
        place="argument `table`",
        found=f"an object of type {type(value).__name__}",
        expected="a file, a dict of arrays, or anything with columns (pandas, polars, astropy.table)",
    )


def _column(name: str, values: Any) -> Any:
    unit = next((unit for suffix, unit in _UNITS.items() if name.endswith(suffix)), None)
    if hasattr(values, "to_value"):
        values = values.to_value(unit) if unit else values.to_value()
    if isinstance(values, np.ma.MaskedArray):
        texts = values.dtype.kind in "OUS"
        masked: Any = values.astype(object if texts else float)
        values = masked.filled(None if texts else np.nan)
    array = np.asarray(values)
    if array.ndim != 1:
        raise RetinaError(
            "is not a column", place=f"column `{name}`", found=f"shape {array.shape}", expected="shape (rows,)"
        )
    if array.dtype.kind in "uifb":
        return np.ascontiguousarray(array, dtype=np.float64)
    if array.dtype.kind == "O" and all(item is None or isinstance(item, (int, float, np.number)) for item in array):
        return np.array([np.nan if item is None else item for item in array], dtype=np.float64)
    return [None if _is_missing(item) else str(item) for item in array.tolist()]


def _is_missing(item: Any) -> bool:
    return item is None or item != item  # NaN alone differs from itself
