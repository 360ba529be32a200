"""The package's one exception."""

from __future__ import annotations

from typing import Any


class RetinaError(Exception):
    """Input that does not fit, or work that cannot be done.

    Attributes
    ----------
    problem : str
        What is wrong, in one sentence.
    file : str or None
        The file in which it was found; None where the fault is an argument's or nobody's.
    place : str or None
        Where in the file: a line, a cell, a key; or which argument.
    line : int or None
        The file's line, counted from 1, where the place has one.
    found : str or None
        What was found.
    expected : str or None
        What was expected in its stead.
    help : str or None
        How to mend it.
    """

    def __init__(
        self,
        problem: str,
        *,
        file: str | None = None,
        place: str | None = None,
        line: int | None = None,
        found: str | None = None,
        expected: str | None = None,
        help: str | None = None,
    ) -> None:
        super().__init__(problem)
        self.problem = problem
        self.file = file
        self.place = place
        self.line = line
        self.found = found
        self.expected = expected
        self.help = help

    def __str__(self) -> str:
        where = ", ".join(part for part in (self.file, self.place) if part)
        what = [f"{name} {value}" for name, value in (("found", self.found), ("expected", self.expected)) if value]
        text = f"{where}: {self.problem}" if where else self.problem
        if what:
            text += f" ({', '.join(what)})"
        return f"{text}\nhelp: {self.help}" if self.help else text

    def __reduce__(self) -> tuple[Any, ...]:
        return (_restored, (type(self), self.problem, dict(self.__dict__)))


def _restored(cls: type[RetinaError], problem: str, fields: dict[str, Any]) -> RetinaError:
    """Rebuild a pickled error: workers of a pool send theirs so."""
    error = cls(problem)
    error.__dict__.update(fields)
    return error


class RetinaWarning(UserWarning):
    """Something that the user ought to know, and that stops nothing."""
