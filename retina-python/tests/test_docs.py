"""The guide's examples run from top to bottom."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import numpy as np
import pytest

from conftest import ROOT


def blocks(path: Path) -> list[tuple[int, str]]:
    """The Python blocks of a page, each with the line that it begins on."""
    text = path.read_text(encoding="utf-8")
    return [(text[: m.start(1)].count("\n"), m.group(1)) for m in re.finditer(r"^```python\n(.*?)^```", text, re.M | re.S)]


def test_the_guide_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = ROOT / "docs" / "python.md"
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    found = blocks(page)
    assert len(found) > 8
    for line, code in found:
        # Blank lines before it, so that a traceback has the page's own lines.
        exec(compile("\n" * line + code, str(page), "exec"), names)
    assert (tmp_path / "diagnosis.html").exists() and (tmp_path / "layout.svg").exists()


def test_the_docstrings_examples_run() -> None:
    from retina import _effects

    done = doctest.testmod(_effects, extraglobs={"np": np})
    assert done.attempted > 0 and done.failed == 0
