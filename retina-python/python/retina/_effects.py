"""Effects: the catalogue's, and those of one's own."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from . import _native
from ._errors import RetinaError
from ._notebook import Figure, Report, shown, table_html


class OwnEffect:
    """An effect of one's own: a function of a table's columns and of parameters that are fitted.

    Parameters
    ----------
    function : callable
        Its arguments are names of columns and of parameters. Columns come as arrays of shape (rows,), parameters as
        numbers. It returns ``(dx, dy)`` in arcsec for points, and one array (relative, or mag) for other tables.
        Beside a table's own columns, points have ``x`` and ``y`` (1 at half the camera's width), ``r``, ``L``
        (log10 of the irradiance relative to full) and ``F`` (the irradiance).
    parameters : dict of str to float, or to (float, str)
        Start value, and unit, of each parameter.
    name : str, optional
        Default: the function's name.

    Examples
    --------
    >>> def settling(x, y, time_s, a_arcsec, tau_s):
    ...     grown = a_arcsec * (1 - np.exp(-time_s / tau_s))
    ...     return grown * x, grown * y
    >>> effect = OwnEffect(settling, {"a_arcsec": 2.0, "tau_s": 300.0})
    >>> effect.columns
    ['x', 'y', 'time_s']
    """

    def __init__(
        self,
        function: Callable[..., Any],
        parameters: Mapping[str, float | tuple[float, str]],
        name: str | None = None,
    ) -> None:
        self.function = function
        self.name = name or function.__name__
        self.parameters: dict[str, tuple[float, str]] = {}
        for parameter, start in parameters.items():
            value, unit = start if isinstance(start, tuple) else (start, "")
            self.parameters[parameter] = (float(value), unit)
        arguments = inspect.signature(function).parameters
        missing = [parameter for parameter in self.parameters if parameter not in arguments]
        if missing:
            raise RetinaError(
                "takes no such parameter",
                place=f"effect `{self.name}`",
                found=", ".join(missing),
                expected=f"arguments {', '.join(arguments)}",
                help="name the function's arguments after the columns and the parameters",
            )
        self.columns = [argument for argument in arguments if argument not in self.parameters]

    def _described(self) -> tuple[str, Callable[..., Any], list[str], list[tuple[str, float, str]]]:
        parameters = [(name, start, unit) for name, (start, unit) in self.parameters.items()]
        return self.name, self.function, self.columns, parameters

    def __repr__(self) -> str:
        return f"<OwnEffect {self.name} of {', '.join(self.columns)}>"


#: An id of the catalogue, a file that ends in ``.toml``, or an `OwnEffect`.
Effects: TypeAlias = str | os.PathLike[str] | OwnEffect


class Effect(Report):
    """An effect of the catalogue."""

    @property
    def name(self) -> str:
        """Its id."""
        return str(self._document["effect"])

    @property
    def table(self) -> str:
        """The kind of table that shows it: points, power, phase or frames."""
        return str(self._document["table"])

    @property
    def formula(self) -> str:
        """Its form."""
        return str(self._document["formula"])

    @property
    def source(self) -> str:
        """Where it is from."""
        return str(self._document["source"])

    @property
    def covariates(self) -> list[str]:
        """The columns that it depends on."""
        return self._texts("covariates")

    def plots(self) -> list[Figure]:
        """Draw its signature."""
        return [Figure(svg) for svg in _native.effect_svgs(self.name)]

    def __repr__(self) -> str:
        return f"<Effect {self.name} on {self.table}>"

    def _repr_html_(self) -> str:
        names = ("table", "formula", "source", "covariates")
        return table_html(self.name, ("", ""), ((name, shown(getattr(self, name))) for name in names))


def effects(table: str | None = None) -> dict[str, Effect]:
    """List the effects of the catalogue, by id.

    Parameters
    ----------
    table : {"points", "power", "phase", "frames"}, optional
        Only those on this kind of table.
    """
    return {entry["effect"]: Effect(entry) for entry in _native.effect_list(table)}
