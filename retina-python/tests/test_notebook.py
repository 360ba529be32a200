"""How objects show themselves."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from typing import Any

import numpy as np
import pytest

import retina


def is_svg(text: str) -> bool:
    return Xml.fromstring(text).tag.endswith("svg")


def test_frames_and_images_are_pictures(star_frame: retina.Frame) -> None:
    assert star_frame._repr_png_().startswith(b"\x89PNG") and "1920 x 1200" in repr(star_frame)
    image = retina.CameraImage(np.arange(12, dtype=np.uint16).reshape(3, 4), 0.1, 11)
    assert image._repr_png_().startswith(b"\x89PNG") and np.asarray(image).shape == (3, 4)
    assert np.array(image, dtype=float).dtype == float


def test_results_are_tables(warming: dict[str, Any], star_frame: retina.Frame, star_field_deg: float) -> None:
    solved = retina.solve_stars(star_frame.counts, star_field_deg)
    found = retina.diagnose("wide-fov", warming)
    fitted = retina.fit("wide-fov", warming, "thermal_boresight")
    for shown in (solved, found, fitted, retina.Setup("wide-fov"), retina.detect(star_frame.counts),
                  retina.compare("wide-fov", warming), retina.calibrate_geometry(warming, "wide-fov"),
                  retina.effects()["screen_tilt"], retina.OpticalSystem("reference-1.3fc-wide")):
        page = shown._repr_html_()
        Xml.fromstring(f"<div>{page}</div>")
        assert "<table>" in page and repr(shown)
    assert "thermal_boresight" in found._repr_html_() and found.headline in found._repr_html_()
    assert "<!DOCTYPE html>" in found.to_html()


def test_plots_are_svg(warming: dict[str, Any], star_frame: retina.Frame, star_field_deg: float) -> None:
    system = retina.OpticalSystem("reference-1.3fc-wide")
    drawn = [system.layout(), system.spots().plot(), system.mtf(pupil=64).plot(), retina.compare("wide-fov", warming).plot()]
    drawn.append(retina.solve_stars(star_frame.counts, star_field_deg).plot("stars"))
    drawn += retina.calibrate_geometry(warming, "wide-fov").plots().values()
    assert all(is_svg(figure._repr_svg_()) for figure in drawn)


def test_a_figure_is_saved(tmp_path: Any) -> None:
    retina.OpticalSystem("reference-1.3fc-wide").layout().save(tmp_path / "layout.svg")
    assert is_svg((tmp_path / "layout.svg").read_text())


def test_what_is_shown_is_no_markup() -> None:
    from retina._notebook import table_html

    page = table_html("<script>", ["<b>"], [["<i>"]])
    assert not any(markup in page for markup in ("<script>", "<b>", "<i>")) and "&lt;i&gt;" in page


def test_documents_are_copies(warming: dict[str, Any]) -> None:
    found = retina.compare("wide-fov", warming)
    found.to_dict()["rms"] = -1.0
    assert found.rms > 0 and found.to_dict()["rms"] == pytest.approx(found.rms)
