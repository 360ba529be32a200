"""The command that the wheel installs."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import retina
from conftest import command_path


def ran(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([command_path(), *arguments], capture_output=True, text=True, check=False)


def test_it_is_there_and_has_the_packages_version() -> None:
    assert ran("--version").stdout.strip() == f"retina {retina.__version__}"
    module = subprocess.run([sys.executable, "-m", "retina", "--version"], capture_output=True, text=True, check=True)
    assert module.stdout.strip() == f"retina {retina.__version__}"


def test_bad_input_ends_with_2_and_says_what() -> None:
    done = ran("diagnose", "--setup", "nowhere.toml", "--data", "points.csv")
    assert done.returncode == 2 and "nowhere.toml" in done.stderr and done.stdout == ""
    assert ran("no-such-command").returncode == 2
    assert ran("--help").returncode == 0


def test_an_exceeded_tolerance_ends_with_1(tmp_path: Path, star_scene: retina.Scene) -> None:
    blank = tmp_path / "blank.png"
    from retina import _native

    noise = np.random.default_rng(1).integers(90, 110, (200, 300), dtype=np.uint8)
    blank.write_bytes(_native.grey_png_bytes(noise))
    assert ran("navigate", "stars", str(blank), "--fov-deg", "12", "--all").returncode == 1


@pytest.mark.skipif(sys.platform == "win32", reason="there are no signals")
def test_ctrl_c_ends_it(tmp_path: Path) -> None:
    arguments = ["simulate", "points", "--setup", "wide.toml", "--seed", "1", "--out", "out"]
    (tmp_path / "wide.toml").write_text(
        'schema = "retina.setup/1"\nname = "wide"\n[screen]\nwidth_px = 1920\nheight_px = 1200\nwidth_mm = 18.7\n'
        "height_mm = 11.75\nbits = 8\n[camera]\nwidth_px = 2048\nheight_px = 1536\npixel_um = 3.45\nfocal_mm = 25.0\n"
        "f_number = 2.8\nbits = 12\n[facility]\nobserved_rows_px = 1200\n"
    )
    running = subprocess.Popen([command_path(), *arguments], cwd=tmp_path, stderr=subprocess.DEVNULL)
    time.sleep(1.0)
    assert running.poll() is None
    running.send_signal(signal.SIGINT)
    # Without its own handler a process ends by the signal.
    assert running.wait(timeout=5) == -signal.SIGINT
