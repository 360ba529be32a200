"""How results show themselves, and how far long work is."""

from __future__ import annotations

import copy
import html
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from . import _native
from ._duck import PathLike

#: Called with the parts done and the parts in all.
Progress: TypeAlias = Callable[[int, int], object] | bool | None


class Figure:
    """A drawing as SVG, which notebooks show.

    Attributes
    ----------
    svg : str
        The drawing.
    """

    def __init__(self, svg: str) -> None:
        self.svg = svg

    def _repr_svg_(self) -> str:
        return self.svg

    def save(self, path: PathLike) -> None:
        """Write the drawing as a file."""
        Path(path).write_text(self.svg, encoding="utf-8")

    def __repr__(self) -> str:
        return f"<Figure, SVG of {len(self.svg)} characters>"


class Report:
    """A result that has a document: what the command prints with ``--json``."""

    def __init__(self, document: dict[str, Any]) -> None:
        self._document = document

    def to_dict(self) -> dict[str, Any]:
        """Return the document that the command prints with ``--json``, as a copy."""
        return copy.deepcopy(self._document)

    def _optional(self, key: str) -> float | None:
        value = self._document.get(key)
        return None if value is None else float(value)

    def _array(self, key: str) -> npt.NDArray[np.float64] | None:
        value = self._document.get(key)
        return None if value is None else np.array(value, dtype=float)

    def _texts(self, key: str) -> list[str]:
        return list(self._document.get(key) or [])


class Solution(Report):
    """What one image gave, or why it gave nothing. Where it is not solved, numbers are NaN."""

    @property
    def solved(self) -> bool:
        """Whether there is an answer."""
        return bool(self._document["solved"])

    @property
    def reason(self) -> str | None:
        """Why there is no answer, in one word."""
        return self._document.get("reason")

    @property
    def message(self) -> str | None:
        """Why there is no answer, what was seen, and what to try."""
        return self._document.get("message")

    @property
    def notes(self) -> list[str]:
        """What was done with the picture, and what makes the answer doubtful."""
        return self._texts("notes")

    def _number(self, key: str) -> float:
        value = self._document.get(key)
        return float("nan") if value is None else float(value)


def grey_png(values: npt.NDArray[Any], most: float) -> bytes:
    """A PNG of values from 0 to `most`; every value above is white."""
    scaled = np.clip(np.asarray(values, dtype=np.float64) * (255.0 / most if most > 0 else 0.0), 0.0, 255.0)
    return _native.grey_png_bytes(np.ascontiguousarray(scaled.round(), dtype=np.uint8))


def table_html(heading: str, headings: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A table of texts; nothing in it becomes markup."""
    head = "".join(f"<th>{html.escape(name)}</th>" for name in headings)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    caption = f"<caption>{html.escape(heading)}</caption>" if heading else ""
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def shown(value: object) -> str:
    """A number as people read it."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return "-" if value is None else str(value)


class _Bar:
    """tqdm's bar, told of parts done."""

    def __init__(self, unit: str) -> None:
        from tqdm.auto import tqdm  # type: ignore[import-untyped,unused-ignore]

        self._bar = tqdm(unit=unit)

    def __call__(self, done: int, total: int) -> None:
        self._bar.total = total
        self._bar.update(done - self._bar.n)
        if done >= total:
            self._bar.close()


def callback(progress: Progress, unit: str) -> Callable[[int, int], object] | None:
    """What is told of progress: a function of one's own, tqdm's bar where `progress` is True and tqdm is installed."""
    if progress is None or progress is False:
        return None
    if progress is True:
        try:
            return _Bar(unit)
        except ImportError:
            return None
    return progress
