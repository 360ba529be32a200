"""Tables of frames: the workbench on pixels, against the command."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest

import retina
from conftest import assert_same, command_path
from test_frames import scene_file


@pytest.fixture(scope="module")
def frames(sphere: Path, setup_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three frames, rendered and photographed on the virtual bench."""
    folder = tmp_path_factory.mktemp("frames")
    scene = scene_file(folder, sphere, setup_file)
    scene.write_text(scene.read_text() + "[output]\nradiance_exr = true\n")
    for arguments in (
        ["render", scene, "--out", folder / "out", "--backend", "native"],
        ["simulate", "frames", "--setup", setup_file, "--screens", folder / "out", "--seed", "1", "--out", folder / "seen"],
    ):
        subprocess.run([command_path(), *map(str, arguments)], check=True, capture_output=True)
    return folder / "seen" / "frames.csv"


def test_frames_are_compared_as_the_command_does(frames: Path, setup_file: Path, command: Any) -> None:
    told = command("compare", "--setup", setup_file, "--data", frames)
    found = retina.compare(setup_file, frames)
    assert_same(found.to_dict(), told, 0)
    assert found.unit == "DN" and found.plot().svg.startswith("<svg")
    with pytest.raises(retina.RetinaError, match="which frames do not take"):
        retina.fit(setup_file, frames, retina.OwnEffect(lambda x, a: a * x, {"a": 1.0}, "own"))
