"""Errors say what, where, found, expected, and the mend."""

from __future__ import annotations

import datetime
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import retina


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(retina.RetinaError) as caught:
        retina.Setup("nowhere.toml")
    error = caught.value
    assert error.file == "nowhere.toml" and error.place is None and "cannot be read" in error.problem
    assert error.help and str(error).endswith(f"help: {error.help}")


def test_a_key_in_a_file(setup_file: Path, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(setup_file.read_text().replace("focal_mm", "focal_length_mm"))
    with pytest.raises(retina.RetinaError) as caught:
        retina.Setup(wrong)
    assert caught.value.line and "focal_length_mm" in str(caught.value)
    assert caught.value.file == str(wrong)


def test_a_cell_of_a_table_in_memory_has_its_row(warming: dict[str, Any]) -> None:
    table = {name: np.array(column) for name, column in warming.items()}
    table["digital_count"] = table["digital_count"].astype(float)
    table["digital_count"][5] = 999.0
    with pytest.raises(retina.RetinaError) as caught:
        retina.compare("wide-fov", table)
    error = caught.value
    assert error.place == "argument `table`, row 5, column `digital_count`" and error.found == "999"
    assert error.file is None and error.line is None


def test_a_scene_in_memory_has_no_lines() -> None:
    with pytest.raises(retina.RetinaError, match="deep-spce") as caught:
        retina.Scene({"setup": "wide-fov", "trajectory": {"kind": "deep-spce", "frames": 3}})
    assert caught.value.place == "argument `source`" and "deep-space" in (caught.value.help or "")


def test_infinite_values_and_missing_columns_are_refused(warming: dict[str, Any]) -> None:
    table = dict(warming) | {"camera_x_px": np.full(len(warming["image"]), np.inf)}
    with pytest.raises(retina.RetinaError, match="not a finite number"):
        retina.compare("wide-fov", table)
    with pytest.raises(retina.RetinaError, match="camera_y_px"):
        retina.compare("wide-fov", {k: v for k, v in warming.items() if k != "camera_y_px"})
    with pytest.raises(retina.RetinaError, match="different lengths"):
        retina.compare("wide-fov", dict(warming) | {"time_s": [1.0, 2.0]})


def test_flags_are_keywords(warming: dict[str, Any]) -> None:
    with pytest.raises(retina.RetinaError) as caught:
        retina.compare("wide-fov", warming, baseline="no-such")
    assert caught.value.place == "argument `baseline`" and caught.value.file is None
    with pytest.raises(retina.RetinaError) as caught:
        retina.fit("wide-fov", warming, "thermal_boresigt")
    assert "thermal_boresight" in (caught.value.help or "") and "--" not in str(caught.value)


def test_arguments_out_of_range() -> None:
    image = np.zeros((20, 20), np.uint8)
    for wrong in (
        lambda: retina.detect(image, threshold_sigma=-1),
        lambda: retina.detect(image, centroid="middle"),  # type: ignore[arg-type]
        lambda: retina.detect(np.zeros((3, 3, 3))),
        lambda: retina.detect(np.full((20, 20), np.nan)),
        lambda: retina.solve_stars(image, fov_deg=(20, 10)),
        lambda: retina.solve_stars(image, fov_deg=10, setup="wide-fov"),
        lambda: retina.diagnose("wide-fov", {"a": [1.0]}),
        lambda: retina.diagnose("wide-fov", 7),
        lambda: retina.Ephemeris().position_m("pluto", 0.0),
        lambda: retina.Ephemeris().position_m("moon", "not a date"),
        lambda: retina.OpticalSystem("reference-1.3fc-wide").mtf(pupil=2),
        lambda: retina.effects("pixels"),
        lambda: retina.Bench("wide-fov", effects=["no_such=1deg"], nodes=(7, 5), lines=1),
    ):
        with pytest.raises(retina.RetinaError) as caught:
            wrong()
        assert caught.value.found or caught.value.problem


def test_they_can_be_pickled() -> None:
    error = retina.RetinaError("is wrong", file="a.toml", place="line 3", line=3, found="1", expected="2", help="mend it")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) == "a.toml, line 3: is wrong (found 1, expected 2)\nhelp: mend it"
    assert again.line == 3 and again.help == "mend it"


@pytest.mark.parametrize("time", [None, float("nan"), float("inf"), datetime.date(2027, 8, 2), object()])
def test_what_is_no_epoch_is_refused(time: object) -> None:
    with pytest.raises(retina.RetinaError, match="epoch") as caught:
        retina.time_s(time)
    assert caught.value.place == "argument `time`"


@pytest.mark.parametrize("fov_deg", ["12", ("10", "13"), None.__class__, float("nan"), (13, 10)])
def test_text_is_no_field_of_view(fov_deg: object) -> None:
    with pytest.raises(retina.RetinaError) as caught:
        retina.solve_stars(np.zeros((100, 100), np.uint8), fov_deg)  # type: ignore[arg-type]
    assert caught.value.place == "argument `fov_deg`"


def test_a_velocity_is_never_left_out_in_silence() -> None:
    image = np.zeros((100, 100), np.uint8)
    for place, velocity in ((None, [0, 0, 3e4]), ("earth", [np.nan, 0, 0]), ("earth", [1e9, 0, 0])):
        with pytest.raises(retina.RetinaError) as caught:
            retina.solve_stars(image, 12.0, time=0.0, position_m=place, velocity_m_s=velocity)
        assert caught.value.place == "argument `velocity_m_s`"


def test_a_mask_is_never_left_out_in_silence() -> None:
    image = np.ma.array(np.zeros((100, 100), np.uint8), mask=np.eye(100, dtype=bool))
    with pytest.raises(retina.RetinaError, match="100 of them"):
        retina.detect(image)


def test_places_on_the_earth() -> None:
    with pytest.raises(retina.RetinaError, match="-90 to 90"):
        retina.Ephemeris().site(0.0, latitude_deg=145.0, longitude_deg=0.0)
